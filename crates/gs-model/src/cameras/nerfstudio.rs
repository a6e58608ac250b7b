//! The world of nerfstudio's models. Its trainer turns, shifts and scales the cameras of a `transforms.json` and saves
//! that transform in `dataparser_transforms.json`. Exported models are not moved back.

use std::path::Path;

use glam::{DMat3, DVec3};
use serde_json::{Map, Value};

use crate::cameras::camera::Camera;
use crate::cameras::json::{self, number, numbers};
use crate::error::{Error, Result};
use crate::fs;

/// The file, beside the `transforms.json`.
pub(super) const FILE: &str = "dataparser_transforms.json";

/// A point `p` of the `transforms.json` becomes `scale * (rotation * p + shift)`.
pub(crate) struct Placement {
    rotation: DMat3,
    shift: DVec3,
    scale: f64,
}

impl Placement {
    /// Reads the file beside a `transforms.json`, if there is one. `all` are the values of the `transforms.json`.
    ///
    /// Its cameras may have been transformed before, by `applied_transform` and `applied_scale`. The saved transform
    /// includes that one, so it is taken out.
    pub(crate) fn beside(transforms: &Path, all: &Map<String, Value>) -> Result<Option<Self>> {
        let file = transforms.with_file_name(FILE);
        if !file.is_file() {
            return Ok(None);
        }
        let saved = json::parse(&file, &fs::read(&file)?)?;
        let rows = |value: Option<&Value>| numbers(value?, 16).filter(|n| n.len() >= 12);
        let applied = match all.get("applied_transform") {
            None => Some((DMat3::IDENTITY, DVec3::ZERO)),
            value => rows(value).map(|rows| parts(&rows)),
        };
        let applied_scale = all.get("applied_scale").and_then(number).unwrap_or(1.0);
        let scale = saved.get("scale").and_then(number).unwrap_or(f64::NAN) / applied_scale;
        let usable = scale.is_finite() && scale > 0.0;
        let transform = rows(saved.get("transform")).map(|rows| parts(&rows));
        let both = transform.zip(applied).filter(|_| usable);
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

/// The rotation and the shift of the first three rows of four numbers.
fn parts(rows: &[f64]) -> (DMat3, DVec3) {
    let column = |k: usize| DVec3::new(rows[k], rows[4 + k], rows[8 + k]);
    (DMat3::from_cols(column(0), column(1), column(2)), column(3))
}
