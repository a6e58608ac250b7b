//! Models in files: whatever gs-model reads and writes, and streams.

use crate::arrays::{self, SplatArrays};
use crate::background::{pool, run};
use crate::error::{Fault, Result};
use gs_model::{FileAxes, Format, Invalid, ReadOptions, Scene};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

/// Reads a model or a stream. Returns a dict of arrays, and what is to be said of the file, a sentence each.
#[pyfunction]
pub(crate) fn read_model(
    py: Python<'_>,
    path: PathBuf,
    drop_invalid: bool,
    keep_axes: bool,
) -> PyResult<(Bound<'_, PyDict>, Vec<String>)> {
    let invalid = if drop_invalid { Invalid::Drop } else { Invalid::Error };
    let axes = if keep_axes { FileAxes::Keep } else { FileAxes::Turn };
    let codec = Some(&gsvx::gltf::CODEC);
    let options = ReadOptions { invalid, axes, codec, max_gaussians: None };
    let (scene, notes) = run(py, pool()?, None, move |_| read(&path, &options))?;
    Ok((arrays::dict(py, scene)?, notes))
}

fn read(path: &Path, options: &ReadOptions) -> Result<(Scene, Vec<String>)> {
    let name = path.display();
    if path.is_dir() {
        return Err(Fault::Failed(format!("{name}: is a folder; name the model in it")));
    }
    let failed =
        |e: io::Error| Fault::Io(io::Error::new(e.kind(), format!("{name}: cannot be read: {e}")));
    if starts_like_stream(path).map_err(failed)? {
        let stream = std::fs::read(path).map_err(failed)?;
        let scene = gsvx::decode(&stream).map_err(|e| Fault::from(e).named(&name.to_string()))?;
        return Ok((scene, Vec::new()));
    }
    let (scene, report) = gs_model::model::read(path, options)?;
    Ok((scene, report.sentences().iter().map(|note| format!("{name}: {note}")).collect()))
}

fn starts_like_stream(path: &Path) -> io::Result<bool> {
    let mut start = Vec::new();
    File::open(path)?.take(gsvx::SIGNATURE.len() as u64).read_to_end(&mut start)?;
    Ok(start == gsvx::SIGNATURE)
}

/// Writes a model; the extension names the format. False if the format does not say that the model is antialiased.
#[pyfunction]
pub(crate) fn write_model(
    py: Python<'_>,
    path: PathBuf,
    splats: SplatArrays<'_>,
) -> PyResult<bool> {
    let (pool, scene) = splats.take()?;
    run(py, pool, None, move |_| write(&path, &scene))
}

fn write(path: &Path, scene: &Scene) -> Result<bool> {
    let name = path.display();
    let Some(format) = Format::of_name(path).filter(|format| format.is_written()) else {
        let written = Format::all().iter().filter(|format| format.is_written());
        let extensions: Vec<String> = written.map(|f| format!(".{}", f.extensions[0])).collect();
        let why = if path.extension().is_some_and(|e| e == "gsvx") {
            "this function writes models; to write a stream, use compress".into()
        } else {
            format!("its extension names no format that is written; use {}", extensions.join(", "))
        };
        return Err(Fault::Usage(format!("{name}: {why}")));
    };
    format.write(path, scene)?;
    Ok(format.says_antialiased || !scene.antialiased)
}
