//! The covariance section: rotations and log-scales in one of several modes.
//!
//! A payload starts with a byte that names the mode.

mod codebook;
mod integers;
pub mod log_euclidean;

use crate::attributes::group::Transform;
use crate::encode::Leaves;
use crate::error::{Error, Result};
use crate::options::{CovarianceMode, EncodeOptions};
use crate::stream::SectionKind;
use gpcc_lite::Leaf;
use gs_model::Scene;

const TRANSFORM: u8 = 0;
const INTEGERS: u8 = 1;
const CODEBOOK: u8 = 2;

/// Rotations (unit quaternions) and log-scales.
pub(crate) type Covariances = (Vec<[f32; 4]>, Vec<[f32; 3]>);

pub(crate) fn encode(
    scene: &Scene,
    leaves: &Leaves<'_>,
    transform: &Transform,
    options: &EncodeOptions,
) -> Result<Vec<u8>> {
    match options.covariance {
        CovarianceMode::Transform => {
            let step = f64::from(options.steps.covariance);
            let mut out = vec![TRANSFORM];
            let leaf = |i: usize, row: &mut [f64]| {
                let (q, l) = (scene.rotations[i], scene.log_scales[i]);
                row.copy_from_slice(&log_euclidean::coordinates(q, l));
            };
            out.extend(
                transform.encode(&[step; 6], options.coding(SectionKind::Covariance), leaf)?.0,
            );
            Ok(out)
        }
        CovarianceMode::Lossless { bits } => {
            let mut out = vec![INTEGERS];
            out.extend(integers::encode(scene, leaves, bits)?);
            Ok(out)
        }
        CovarianceMode::Vq { bits } => {
            let mut out = vec![CODEBOOK];
            out.extend(codebook::encode(scene, bits, transform, options)?);
            Ok(out)
        }
    }
}

pub(crate) fn decode(
    payload: &[u8],
    transform: &Transform,
    leaves: &[Leaf],
    j_high: u8,
) -> Result<Covariances> {
    let Some((&mode, payload)) = payload.split_first() else {
        return Err(Error::Truncated { what: "covariance", offset: 0, need: 1, have: 0 });
    };
    match mode {
        TRANSFORM => {
            let mut coordinates = Vec::with_capacity(leaves.len());
            transform.decode(payload, 6, |_, row| {
                coordinates
                    .push([row[0], row[1], row[2], row[3], row[4], row[5]].map(|v| v as f32));
            })?;
            Ok(log_euclidean::decompose_all(&coordinates))
        }
        INTEGERS => integers::decode(payload, leaves, j_high),
        CODEBOOK => codebook::decode(payload, transform, leaves.len()),
        other => Err(Error::Corrupt { what: "covariance mode", value: other.into() }),
    }
}
