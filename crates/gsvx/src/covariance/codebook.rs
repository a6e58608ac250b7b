//! Covariances as an index into a trained codebook and one scale factor per Gaussian.
//!
//! The paper's lossy mode (after Compressed 3DGS), with everything a decoder needs in the
//! stream and counted: the codebook, the entropy-coded indices, and the scale factors, which
//! go through the same weighted transform as the other attributes.
//!
//! Sensitivities are those of the encoder's options: from cameras the sum over all pixels of the
//! squared derivatives with respect to log-scales and rotation; else the importances, which are
//! opacity times size where there are no cameras at all.

use super::Covariances;
use crate::attributes::group::{Coding, Transform};
use crate::error::{Error, Result};
use crate::options::EncodeOptions;
use crate::stream::{Reader, Writer};
use gs_model::Scene;
use rayon::prelude::*;
use vq::{Codebook, Covariance};

/// Accepted binary logarithms of the number of codewords.
const BITS: std::ops::RangeInclusive<u8> = 8..=16;
/// Log-scales are moved into this range before coding: e^+-100 is beyond what f32 means hold.
const LOG_SCALE_LIMIT: f32 = 100.0;

pub(super) fn encode(
    scene: &Scene,
    bits: u8,
    transform: &Transform,
    coding: Coding,
    options: &EncodeOptions,
) -> Result<Vec<u8>> {
    if !BITS.contains(&bits) {
        return Err(Error::Option {
            option: "covariance codebook bits",
            value: bits.into(),
            range: "between 8 and 16",
        });
    }
    let mut out = Writer::default();
    if scene.is_empty() {
        return Ok(out.bytes);
    }
    let parts: Vec<(Covariance, f32)> = scene
        .rotations
        .par_iter()
        .zip(&scene.log_scales)
        .map(|(&q, l)| Covariance::split(q, l.map(|v| v.clamp(-LOG_SCALE_LIMIT, LOG_SCALE_LIMIT))))
        .collect::<std::result::Result<_, _>>()?;
    let covariances: Vec<Covariance> = parts.iter().map(|p| p.0).collect();
    let given = options.covariance_sensitivity.as_ref().or(options.importance.as_ref());
    let sensitivities = match given {
        Some(given) if given.len() != scene.len() => {
            return Err(Error::CountMismatch { scene: given.len(), leaves: scene.len() });
        }
        Some(given) => {
            given.iter().map(|&v| if v.is_finite() { v.max(0.0) } else { 0.0 }).collect()
        }
        None => crate::importance::without_cameras(scene),
    };
    let settings = vq::Options::with_codewords(1 << bits);
    let book = Codebook::train(&covariances, &sensitivities, &settings)?;
    let indices = book.assign(&covariances);
    out.block(&book.to_bytes());
    out.block(&vq::index::encode(&indices, book.len())?);
    let step = f64::from(options.steps.covariance);
    let log_gamma = |i: usize, row: &mut [f64]| row.fill(f64::from(parts[i].1));
    out.bytes.extend(transform.encode(&[step], coding, log_gamma)?.0);
    Ok(out.bytes)
}

pub(super) fn decode(payload: &[u8], transform: &Transform, count: usize) -> Result<Covariances> {
    if count == 0 {
        return Ok(Covariances::default());
    }
    let mut r = Reader::new(payload, "covariance");
    let book = Codebook::from_bytes_within(r.block()?, 1 << BITS.end())?;
    let indices = vq::index::decode(r.block()?, count, book.len())?;
    let mut log_gamma = Vec::with_capacity(count);
    transform.decode(r.take(r.remaining())?, 1, |_, row| log_gamma.push(row[0]))?;
    let codewords = book.decode_all();
    indices
        .iter()
        .zip(&log_gamma)
        .map(|(&index, &gamma)| {
            let (q, l) = *codewords
                .get(index as usize)
                .ok_or(Error::Corrupt { what: "covariance index", value: index.into() })?;
            Ok((q, l.map(|v| (f64::from(v) + gamma) as f32)))
        })
        .collect()
}
