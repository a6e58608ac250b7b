//! Streams in which every Gaussian is coded bit for bit.

use super::assemble::{assemble, exact_chunk};
use super::check::check_lengths;
use super::encoded::EncodedStream;
use crate::error::{Error, Result};
use crate::head::{Header, Steps};
use gpcc_lite::Cube;
use gs_model::Scene;

/// Encodes a scene bit for bit. Gaussians come back in Morton order of their means, or in their own order
/// at `ceil(log2 N)` bits each. Values need not be valid: NaN, infinities and zero quaternions are kept.
///
/// # Errors
/// [`Error::Length`] if the arrays of the scene differ in length, [`Error::Limit`] beyond
/// 2^32 - 2 Gaussians.
pub fn encode_lossless(scene: &Scene, keep_order: bool) -> Result<EncodedStream> {
    check_lengths(scene)?;
    all_exact(scene, keep_order)
}

/// As [`encode_lossless`], of a scene whose arrays have been checked.
pub(crate) fn all_exact(scene: &Scene, keep_order: bool) -> Result<EncodedStream> {
    let n = scene.len();
    if n as u64 >= u64::from(u32::MAX) {
        return Err(Error::Limit { points: n as u64, limit: u64::from(u32::MAX) - 1 });
    }
    let header = Header {
        count: n as u64,
        sh_degree: scene.sh_degree,
        j_high: 0,
        cube: Cube { origin: [0.0; 3], side: 1.0 },
        steps: Steps::from_dc(1.0),
        antialiased: scene.antialiased,
        origin: scene.origin,
    };
    if n == 0 {
        return assemble(header, Vec::new());
    }
    let (chunk, order) = exact_chunk(scene, keep_order);
    let mut rows: Vec<u32> = (0..n as u32).collect();
    (0..).zip(&order).for_each(|(row, &i)| rows[i as usize] = row);
    Ok(EncodedStream { rows, ..assemble(header, vec![chunk])? })
}
