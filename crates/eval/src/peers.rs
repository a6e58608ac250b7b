//! Formats of other projects, written here: measured on the same model as gsvx, on any scene.

pub(crate) mod lgsc;

use anyhow::Result;
use gs_model::spz::{self, ShBits};
use gs_model::{Format, Invalid, ReadOptions, Scene};

use crate::published;
use crate::record::{Curve, Record};
use crate::scenes::TestScene;
use crate::study::{StreamRecord, Study, slug};

/// Bits of SH coefficients of degree 1 and of the others, which are the rate of SPZ. 5 and 4 are the default of
/// Niantic's packer.
const SPZ_BITS: [[u8; 2]; 5] = [[3, 2], [5, 4], [6, 5], [6, 6], [8, 8]];

/// Names of the files, by which gs-model knows the formats.
const SPZ: &str = "model.spz";
const COMPRESSED: &str = "model.compressed.ply";

/// What is known of other codecs on the scene, and the formats, but for those that are recorded.
pub(crate) fn curves(study: &Study) -> Result<Vec<Curve>> {
    let TestScene { model, files, .. } = &study.test;
    let mut out = published::others(&files.dataset.dir, &files.name)?;
    let read = |file: &str, bytes: &[u8]| -> Result<Scene> {
        let options = ReadOptions { invalid: Invalid::Drop, ..Default::default() };
        Ok(gs_model::model::read_named(file, bytes, &options)?.0)
    };
    let spz = SPZ_BITS.iter().map(|&[degree_1, rest]| {
        let pack = || Ok(spz::pack(SPZ, model, ShBits { degree_1, rest })?);
        point(study, SPZ, &format!("SH bits {degree_1}/{rest}"), pack, |b| read(SPZ, b))
    });
    let compressed = Format::of_name(COMPRESSED).into_iter().map(|format| {
        let write = || {
            let mut bytes = Vec::new();
            format.write_to(COMPRESSED, &mut bytes, model)?;
            Ok(bytes)
        };
        point(study, COMPRESSED, "", write, |b| read(COMPRESSED, b))
    });
    let lgsc = (0..).zip(lgsc::LEVELS).map(|(number, level): (usize, _)| {
        let code = || lgsc::code(model, level);
        let setting = format!("level {number}");
        point(study, "model.lgsc", &setting, || Ok(code()?.0), |_| Ok(code()?.1))
    });
    let all: [(&str, &mut dyn Iterator<Item = Result<Record>>); 3] = [
        ("SPZ v4", &mut { spz }),
        ("PlayCanvas compressed PLY", &mut { compressed }),
        ("L-GSC", &mut { lgsc }),
    ];
    for (name, points) in all {
        if !out.iter().any(|curve| curve.name == name) {
            let (name, what) = (name.into(), "written and measured here".into());
            let points = points.collect::<Result<_>>()?;
            out.push(Curve { name, what, points, ..Curve::default() });
        }
    }
    Ok(out)
}

fn point(
    study: &Study,
    file: &str,
    setting: &str,
    encode: impl FnOnce() -> Result<Vec<u8>>,
    decode: impl FnOnce(&[u8]) -> Result<Scene>,
) -> Result<Record> {
    let (stem, extension) = file.split_once('.').unwrap_or((file, ""));
    let name = slug(&format!("{stem} {extension} {setting}"));
    let encode = || StreamRecord::timed(|| Ok((encode()?, Vec::new())));
    let record = study.point(&study.cache, &name, extension, &(), encode, decode)?;
    Ok(Record { setting: setting.into(), ..record })
}
