//! Writes `compressed.ply`.

use std::io::Write;
use std::path::Path;

use rayon::prelude::*;

use super::layout::{pack, pack_rotation, sh_byte, step};
use super::order::order;
use super::{BOUNDS, CHUNK, WORDS};
use crate::error::{Error, Result};
use crate::formats::ply::columns::rest_names;
use crate::formats::ply::write::{element, header_of};
use crate::scene::{SH_C0, Scene, bounds_of};

/// Log-scales are kept within minus and plus this: one infinite scale would spoil its whole chunk.
const MAX_LOG_SCALE: f32 = 20.0;

/// Writes a scene as a `compressed.ply`.
///
/// The format is lossy: means and log-scales in 1,024 or 2,048 steps between the least and the greatest
/// of their chunk of 256 Gaussians, colours in 256 steps likewise, opacities as bytes, rotations to
/// about 0.1 degrees, SH coefficients in steps of 1/32 within -4..4. The order is that of [`order`].
pub(super) fn write(file: &Path, out: &mut dyn Write, scene: &Scene) -> Result<()> {
    let order = order(scene);
    let chunks: Vec<Chunk> = order.par_chunks(CHUNK).map(|part| Chunk::of(scene, part)).collect();
    let mut put = |bytes: &[u8]| out.write_all(bytes).map_err(|e| Error::io(file, "write", e));
    put(&header(scene))?;
    let bounds = chunks.iter().flat_map(|c| c.bounds.as_flattened().as_flattened());
    let bounds = bounds.flat_map(|bound| bound.to_le_bytes());
    put(&bounds.collect::<Vec<u8>>())?;
    for chunk in &chunks {
        let words = chunk.words.as_flattened().iter().flat_map(|w| w.to_le_bytes());
        put(&words.collect::<Vec<u8>>())?;
    }
    order.chunks(CHUNK).try_for_each(|part| put(&sh_bytes(scene, part)))
}

/// The largest step of the position of each Gaussian.
pub(super) fn steps(scene: &Scene) -> Vec<f64> {
    let mut steps = vec![0.0; scene.len()];
    for part in order(scene).chunks(CHUNK) {
        let [low, high] = bounds_of(part.iter().map(|&i| scene.means[i]));
        // x and z have 11 bits, y has 10.
        let of = |k: usize| f64::from(high[k] - low[k]) / [2047.0, 1023.0, 2047.0][k];
        let step = of(0).max(of(1)).max(of(2));
        part.iter().for_each(|&i| steps[i] = step);
    }
    steps
}

fn header(scene: &Scene) -> Vec<u8> {
    let (n, rest) = (scene.len(), 3 * (scene.sh_len() - 1));
    let mut elements = vec![
        element("chunk", n.div_ceil(CHUNK), "float", BOUNDS.as_flattened()),
        element("vertex", n, "uint", &WORDS),
    ];
    if rest > 0 {
        elements.push(element("sh", n, "uchar", &rest_names(rest)));
    }
    header_of(&elements, scene)
}

/// The higher SH coefficients of some Gaussians, channel-major.
fn sh_bytes(scene: &Scene, part: &[usize]) -> Vec<u8> {
    let mut out = Vec::new();
    for &i in part {
        for channel in 0..3 {
            out.extend(scene.sh_of(i)[1..].iter().map(|rgb| sh_byte(rgb[channel])));
        }
    }
    out
}

/// The bounds of means, log-scales and colours, and the words, of some Gaussians.
struct Chunk {
    bounds: [[[f32; 3]; 2]; 3],
    words: Vec<[u32; 4]>,
}

impl Chunk {
    fn of(scene: &Scene, part: &[usize]) -> Self {
        let log_scale =
            |i: usize| scene.log_scales[i].map(|v| v.clamp(-MAX_LOG_SCALE, MAX_LOG_SCALE));
        let colour = |i: usize| scene.sh_of(i)[0].map(|v| 0.5 + SH_C0 * v);
        let all = || part.iter().copied();
        let means = bounds_of(all().map(|i| scene.means[i]));
        let log_scales = bounds_of(all().map(log_scale));
        let colours = bounds_of(all().map(colour));
        let words = part.iter().map(|&i| {
            let [r, g, b] = parts(colours, colour(i)).map(|t| step(t, 8) as u8);
            let opacity = 1.0 / (1.0 + libm::exp(-f64::from(scene.opacity_logits[i])));
            [
                pack(parts(means, scene.means[i])),
                pack_rotation(scene.rotations[i]),
                pack(parts(log_scales, log_scale(i))),
                u32::from_be_bytes([r, g, b, step(opacity, 8) as u8]),
            ]
        });
        Self { words: words.collect(), bounds: [means, log_scales, colours] }
    }
}

/// Where numbers lie between bounds, from 0 to 1.
fn parts([low, high]: [[f32; 3]; 2], values: [f32; 3]) -> [f64; 3] {
    std::array::from_fn(|k| {
        let [low, high, v] = [low[k], high[k], values[k]].map(f64::from);
        if high > low { (v - low) / (high - low) } else { 0.0 }
    })
}
