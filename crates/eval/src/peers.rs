//! Formats of other projects, written here: measured on the same model as gsvx, on any scene.

pub(crate) mod lgsc;

use anyhow::Result;
use gs_model::spz::{self, ShBits};
use gs_model::{Format, Invalid, ReadOptions, Scene, model};

use crate::cache::Cache;
use crate::measure;
use crate::progress::Bar;
use crate::published::{Other, OtherPoint};
use crate::scenes::TestScene;

/// Bits of SH coefficients of degree 1 and of the others, which are the rate of SPZ. 5 and 4 are the default of
/// Niantic's packer.
const SPZ_BITS: [[u8; 2]; 5] = [[3, 2], [5, 4], [6, 5], [6, 6], [8, 8]];

/// Names of the files, by which gs-model knows the formats.
const SPZ: &str = "model.spz";
const COMPRESSED: &str = "model.compressed.ply";

/// The curves of the formats, but for those that `known` has.
pub(crate) fn curves(cache: &Cache, scene: &TestScene, known: &[Other]) -> Result<Vec<Other>> {
    let mut out = Vec::new();
    let is_known = |name: &str| known.iter().any(|o| o.name == name);
    if !is_known("SPZ v4") {
        let at = |&[degree_1, rest]: &[u8; 2]| {
            let bits = ShBits { degree_1, rest };
            let pack = |model: &Scene| Ok(spz::pack(SPZ, model, bits)?);
            point(cache, scene, SPZ, &format!("SH bits {degree_1}/{rest}"), pack)
        };
        let points = SPZ_BITS.iter().map(at).collect::<Result<_>>()?;
        out.push(Other { name: "SPZ v4".into(), source: SOURCE.into(), points });
    }
    if let (false, Some(format)) =
        (is_known("PlayCanvas compressed PLY"), Format::of_name(COMPRESSED))
    {
        let write = |model: &Scene| {
            let mut bytes = Vec::new();
            format.write_to(COMPRESSED, &mut bytes, model)?;
            Ok(bytes)
        };
        let points = vec![point(cache, scene, COMPRESSED, "", write)?];
        out.push(Other { name: "PlayCanvas compressed PLY".into(), source: SOURCE.into(), points });
    }
    let at = |level: usize| {
        let label = format!("level {level}");
        measured(cache, scene, "L-GSC", &label, || lgsc::code(&scene.model, lgsc::LEVELS[level]))
    };
    let points = (0..lgsc::LEVELS.len()).map(at).collect::<Result<Vec<_>>>()?;
    out.push(Other { name: "L-GSC".into(), source: SOURCE.into(), points });
    Ok(out)
}

const SOURCE: &str = "written and measured here";

fn point(
    cache: &Cache,
    scene: &TestScene,
    file: &str,
    label: &str,
    write: impl FnOnce(&Scene) -> Result<Vec<u8>>,
) -> Result<OtherPoint> {
    let read = |bytes: &[u8]| -> Result<Scene> {
        let options = ReadOptions { invalid: Invalid::Drop, ..Default::default() };
        Ok(model::read_named(file, bytes, &options)?.0)
    };
    measured(cache, scene, file, label, || {
        let stream = write(&scene.model)?;
        let decoded = read(&stream)?;
        Ok((stream, decoded))
    })
}

/// The point of a stream and what it decodes to.
fn measured(
    cache: &Cache,
    scene: &TestScene,
    name: &str,
    label: &str,
    code: impl FnOnce() -> Result<(Vec<u8>, Scene)>,
) -> Result<OtherPoint> {
    cache.run("peer", &(name, label), || {
        let (stream, decoded) = code()?;
        let bar = Bar::new(&format!("render {name} {label}"), scene.held_out.len() as u64);
        let (score, _) = measure::score(&decoded, &scene.held_out, &bar);
        bar.done();
        let (ssim, ssimulacra2) = (Some(score.ssim), Some(score.ssimulacra2));
        let (label, bytes) = (label.to_owned(), stream.len() as u64);
        Ok(OtherPoint { label, bytes, psnr_db: score.psnr_db, ssim, ssimulacra2 })
    })
}
