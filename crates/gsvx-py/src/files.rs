//! Models in files: whatever gs-model reads and writes, and streams.

use crate::arrays::{self, Splats};
use crate::background::{pool, run};
use crate::decode::explain;
use crate::error::{Fault, Result};
use gs_model::Scene;
use gs_model::ply::{Invalid, ReadOptions};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

/// Reads a model or a stream. Returns a dict of arrays and notes.
#[pyfunction]
pub(crate) fn read_model(
    py: Python<'_>,
    path: PathBuf,
    drop_invalid: bool,
) -> PyResult<(Bound<'_, PyDict>, Vec<String>)> {
    let (scene, notes) = run(py, pool()?, None, move |_| read(&path, drop_invalid))?;
    Ok((arrays::dict(py, scene)?, notes))
}

fn read(path: &Path, drop_invalid: bool) -> Result<(Scene, Vec<String>)> {
    let name = path.display();
    if path.is_dir() {
        return Err(Fault::Failed(format!("{name}: is a folder; name the model in it")));
    }
    let failed =
        |e: io::Error| Fault::Io(io::Error::new(e.kind(), format!("{name}: cannot be read: {e}")));
    if starts_like_stream(path).map_err(failed)? {
        let stream = std::fs::read(path).map_err(failed)?;
        let scene = gsvx::decode(&stream).map_err(|e| explain(e, &name.to_string()))?;
        return Ok((scene, Vec::new()));
    }
    let invalid = if drop_invalid { Invalid::Drop } else { Invalid::Error };
    let options = ReadOptions { invalid, ..Default::default() };
    let (scene, report) = gs_model::model::read(path, &options)?;
    let mut notes: Vec<String> = (report.ply.iter().flat_map(|ply| &ply.unknown_properties))
        .map(|property| format!("{name}: property {property} is not part of a 3DGS model"))
        .collect();
    let (kept, all) = (scene.len(), report.gaussians_in_file);
    if kept < all {
        let (n, s) = (all - kept, if all - kept == 1 { "" } else { "s" });
        notes.push(format!("{name}: left out: {n} invalid Gaussian{s} of {all}"));
    }
    Ok((scene, notes))
}

fn starts_like_stream(path: &Path) -> io::Result<bool> {
    let mut start = Vec::new();
    File::open(path)?.take(gsvx::SIGNATURE.len() as u64).read_to_end(&mut start)?;
    Ok(start == gsvx::SIGNATURE)
}

/// Writes a model; the extension names the format.
#[pyfunction]
pub(crate) fn write_model(py: Python<'_>, path: PathBuf, splats: Splats<'_>) -> PyResult<()> {
    let pool = pool()?;
    let scene = splats.scene(&pool)?;
    run(py, pool, None, move |_| write(&path, &scene))
}

fn write(path: &Path, scene: &Scene) -> Result<()> {
    let file = path.file_name().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
    let (front, extension) = file.rsplit_once('.').unwrap_or_default();
    match extension {
        "ply" if front.ends_with(".compressed") => {
            gs_model::ply::compressed::write(path, scene)?;
        }
        "glb" => gs_model::gltf::write(path, scene)?,
        "ply" => gs_model::ply::write(path, scene)?,
        "spz" => gs_model::spz::write(path, scene, &Default::default())?,
        "splat" => gs_model::splat::write(path, scene)?,
        "gsvx" => {
            let name = path.display();
            return Err(Fault::Usage(format!(
                "{name}: this function writes models; to write a stream, use compress"
            )));
        }
        _ => {
            let name = path.display();
            return Err(Fault::Usage(format!(
                "{name}: its extension names no format; use .ply, .compressed.ply, .glb, .splat or .spz"
            )));
        }
    }
    Ok(())
}
