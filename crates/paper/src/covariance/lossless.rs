//! Lossless covariance compression: "each dimension of the quaternion and scale vectors independently, as if
//! they were point cloud intensities". What is lossless are integers of 16 bits, as in the authors' code.

use gpcc_lite::Octree;
use gpcc_lite::paper::predict::{Neighbours, decode_lossless, encode_lossless};
use gs_model::Scene;

use super::DecodedCovariances;
use crate::container::ContainerReader;
use crate::error::{Error, Result, coding};
use crate::sh_and_opacity::finite;

/// Components of a covariance: log-scales, then quaternions.
const CHANNELS: usize = 7;
/// Greatest integer.
const TOP: f64 = 65_535.0;

const NAME: &str = "covariance";

/// Codes the covariances of a scene that has Gaussians.
pub(super) fn encode(scene: &Scene, octree: &Octree) -> Result<Vec<u8>> {
    let mut out = Vec::new();
    let mut channels: Vec<Vec<i32>> = Vec::with_capacity(CHANNELS);
    for k in 0..CHANNELS {
        let value =
            |i: usize| if k < 3 { scene.log_scales[i][k] } else { scene.rotations[i][k - 3] };
        let (mut min, mut max) = (f32::INFINITY, f32::NEG_INFINITY);
        for v in (0..scene.len()).map(value) {
            min = min.min(v);
            max = max.max(v);
        }
        out.extend(min.to_le_bytes());
        out.extend(max.to_le_bytes());
        let (min, range) = (f64::from(min), f64::from(max) - f64::from(min));
        // Floats that differ do so by more than 1e-60.
        let scale = TOP / range.max(1e-60);
        let integer = |i| ((f64::from(value(i)) - min) * scale).round() as i32;
        channels.push((0..scene.len()).map(integer).collect());
    }
    let near = Neighbours::new(octree);
    let channels: Vec<&[i32]> = channels.iter().map(Vec::as_slice).collect();
    out.extend(encode_lossless(&near, &channels).map_err(coding(NAME))?);
    Ok(out)
}

/// Decodes what [`encode`] coded.
pub(super) fn decode(
    mut coded: ContainerReader<'_>,
    octree: &Octree,
) -> Result<DecodedCovariances> {
    let mut ranges = [[0.0; 2]; CHANNELS];
    for end in ranges.as_flattened_mut() {
        *end = coded.float(NAME)?;
    }
    let near = Neighbours::new(octree);
    let channels = decode_lossless(&near, coded.0, CHANNELS).map_err(coding(NAME))?;
    if channels.len() != CHANNELS {
        return Err(Error::Corrupt { what: "number of covariance channels" });
    }
    let value = |k: usize, i: usize| {
        let [min, max] = ranges[k];
        finite(min + f64::from(channels[k][i]) * ((max - min) / TOP))
    };
    let covariance = |i| {
        let rotation: [f32; 4] = std::array::from_fn(|k| value(3 + k, i));
        (with_direction(rotation), std::array::from_fn(|k| value(k, i)))
    };
    Ok((0..near.len()).map(covariance).collect())
}

/// The identity instead of a quaternion that cannot be normalised.
fn with_direction(q: [f32; 4]) -> [f32; 4] {
    let square = q.iter().map(|c| c * c).sum::<f32>();
    if square.is_normal() { q } else { [1.0, 0.0, 0.0, 0.0] }
}
