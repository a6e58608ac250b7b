//! The covariance section: rotations and log-scales in one of several modes.
//!
//! A payload starts with a byte that names the mode.

mod codebook;
mod integers;
pub mod log_euclidean;

use crate::attributes::group::Transform;
use crate::encode::Leaves;
use crate::error::{Error, Result};
use crate::gaussians::Values;
use crate::options::{CovarianceMode, EncodeOptions};
use crate::stream::SectionKind;
use gpcc_lite::attribute::Rows;

const TRANSFORM: u8 = 0;
const INTEGERS: u8 = 1;
const CODEBOOK: u8 = 2;

/// Rotations (unit quaternions) and log-scales.
pub(crate) type Covariances = (Vec<[f32; 4]>, Vec<[f32; 3]>);

pub(crate) fn encode(
    values: Values<'_>,
    leaves: &Leaves,
    transform: &Transform,
    options: &EncodeOptions,
) -> Result<Vec<u8>> {
    let coding = leaves.coding(SectionKind::Covariance, options);
    match options.covariance {
        CovarianceMode::Transform => {
            let step = f64::from(options.steps.covariance);
            let mut out = vec![TRANSFORM];
            let leaf = move |i: usize, row: &mut [f64]| {
                let (q, l) = values.covariance_of(i);
                row.copy_from_slice(&log_euclidean::coordinates(q, l));
            };
            out.extend(transform.encode(&[step; 6], coding, leaf)?.0);
            Ok(out)
        }
        CovarianceMode::Lossless { bits } => {
            let mut out = vec![INTEGERS];
            out.extend(integers::encode(values.scene, leaves, bits)?);
            Ok(out)
        }
        CovarianceMode::Vq { bits } => {
            let mut out = vec![CODEBOOK];
            out.extend(codebook::encode(values.scene, bits, transform, coding, options)?);
            Ok(out)
        }
    }
}

/// What a section says of covariances.
#[derive(Debug, Default)]
pub(crate) enum Shapes {
    /// There is none.
    #[default]
    Missing,
    /// The coordinates of [`log_euclidean`], which are elsewhere.
    Coordinates,
    /// Rotations and log-scales.
    Whole(Covariances),
}

/// Decodes a section; [`Shapes::Coordinates`] are in `rows`.
pub(crate) fn decode(
    payload: &[u8],
    transform: &Transform,
    j_high: u8,
    rows: &mut Rows,
) -> Result<Shapes> {
    let Some((&mode, payload)) = payload.split_first() else {
        return Err(Error::Truncated { what: "covariance", offset: 0, need: 1, have: 0 });
    };
    match mode {
        TRANSFORM => {
            transform.decode_rows(payload, 6, rows)?;
            Ok(Shapes::Coordinates)
        }
        INTEGERS => integers::decode(payload, transform.leaves(), j_high).map(Shapes::Whole),
        CODEBOOK => codebook::decode(payload, transform, transform.len()).map(Shapes::Whole),
        other => Err(Error::Corrupt { what: "covariance mode", value: other.into() }),
    }
}
