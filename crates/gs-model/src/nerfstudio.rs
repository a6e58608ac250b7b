//! The world of nerfstudio's models. Its trainer turns, shifts and scales the cameras of a `transforms.json` and saves
//! that transform in `dataparser_transforms.json`. Exported models are not moved back.

use std::collections::BTreeMap;
use std::path::Path;

use glam::{DMat3, DVec3};
use serde::Deserialize;
use serde_json::Value;

use crate::camera::Camera;
use crate::error::{Error, Result};
use crate::fs;

/// The file, beside the `transforms.json`.
const FILE: &str = "dataparser_transforms.json";

#[derive(Deserialize)]
struct Saved {
    transform: Vec<[f64; 4]>,
    scale: f64,
}

/// A point `p` of the `transforms.json` becomes `scale * (rotation * p + shift)`.
pub(crate) struct Placed {
    rotation: DMat3,
    shift: DVec3,
    scale: f64,
}

impl Placed {
    /// Reads the file beside a `transforms.json`, if there is one. `all` are the values of the `transforms.json`.
    ///
    /// Its cameras may have been transformed before, by `applied_transform` and `applied_scale`. The saved transform
    /// includes that one, so it is taken out.
    pub(crate) fn beside(transforms: &Path, all: &BTreeMap<String, Value>) -> Result<Option<Self>> {
        let file = transforms.with_file_name(FILE);
        if !file.is_file() {
            return Ok(None);
        }
        let saved: Saved = serde_json::from_slice(&fs::read(&file)?)
            .map_err(|e| Error::json(&file, "nerfstudio's transform", e))?;
        let applied = match all.get("applied_transform") {
            None => Some((DMat3::IDENTITY, DVec3::ZERO)),
            Some(value) => {
                let rows: Option<Vec<[f64; 4]>> = serde_json::from_value(value.clone()).ok();
                rows.and_then(|rows| parts(&rows))
            }
        };
        let applied_scale = all.get("applied_scale").and_then(Value::as_f64).unwrap_or(1.0);
        let scale = saved.scale / applied_scale;
        let usable = scale.is_finite() && scale > 0.0;
        let both = parts(&saved.transform).zip(applied).filter(|_| usable);
        let Some(((rotation, shift), (before, before_shift))) = both else {
            let reason = "3 rows of 4 numbers and a positive scale expected";
            return Err(Error::malformed(&file, "transform", reason));
        };
        let rotation = rotation * before.transpose();
        Ok(Some(Self { rotation, shift: shift - rotation * before_shift, scale }))
    }

    /// The camera in the world of the trainer's models.
    pub(crate) fn camera(&self, camera: Camera) -> Camera {
        let rotation = camera.rotation * self.rotation.transpose();
        let translation = self.scale * (camera.translation - rotation * self.shift);
        Camera { rotation, translation, ..camera }
    }
}

/// The rotation and the shift of the first three rows.
fn parts(rows: &[[f64; 4]]) -> Option<(DMat3, DVec3)> {
    let &[x, y, z, ..] = rows else { return None };
    let column = |k: usize| DVec3::new(x[k], y[k], z[k]);
    Some((DMat3::from_cols(column(0), column(1), column(2)), column(3)))
}
