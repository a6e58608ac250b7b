//! L-GSC, Qualcomm's codec that is proposed for glTF (`qualcomm/lite-3Dgsplat-codec`): Gaussians in Morton order,
//! each number quantised uniformly between bounds, the bytes through gzip.

use std::io::Write;

use anyhow::Result;
use flate2::Compression;
use flate2::write::GzEncoder;
use gs_model::{Scene, morton_order};

/// SH coefficients of degrees 1 to 3.
const REST: usize = 15;
/// From RGB to a luma and two differences of colours, and back.
const TO_YUV: [[f32; 3]; 3] =
    [[0.2126, 0.7152, 0.0722], [-0.1146, -0.3854, 0.5], [0.5, -0.4542, -0.0458]];
const TO_RGB: [[f32; 3]; 3] = [[1.0, 0.0, 1.5748], [1.0, -0.1873, -0.4681], [1.0, 1.8556, 0.0]];
/// Bytes of the header: its own length, the number of Gaussians, parameters, two bounds for each of 59 channels.
const HEADER: usize = 4 + 4 + 11 + 59 * 8;
/// Bounds of rotations and of SH coefficients of degrees 1 to 3. Other channels have their own.
const UNIT: Option<[f64; 2]> = Some([-1.0, 1.0]);

/// A compression level: bits of a number.
#[derive(Clone, Copy)]
pub(crate) struct Level {
    position: u32,
    /// SH coefficients of degrees 1 to 3.
    rest: u32,
    other: u32,
}

/// Levels 0 to 2 of the codec.
pub(crate) const LEVELS: [Level; 3] = [
    Level { position: 18, rest: 8, other: 12 },
    Level { position: 16, rest: 6, other: 8 },
    Level { position: 16, rest: 5, other: 8 },
];

/// The stream of a model, and what a decoder returns. The header is left blank, because only its length counts here.
pub(crate) fn code(model: &Scene, level: Level) -> Result<(Vec<u8>, Scene)> {
    let mut scene = Scene { sh_degree: 3, ..Scene::default() };
    scene.append(&model.select(&morton_order(&model.means)));
    let mut stream = vec![0; HEADER];

    let steps = quantise(&mut scene.means, None, level.position, true);
    let planes: Vec<[u32; 1]> = (0..3).flat_map(|k| steps.iter().map(move |s| [s[k]])).collect();
    append_gzip(&mut stream, &bytes(&planes, level.position))?;

    let mut dc: Vec<[f32; 3]> = scene.sh.chunks(REST + 1).map(|sh| sh[0]).collect();
    let mut attributes = bytes(&quantise(&mut dc, None, level.other, true), level.other);
    let mut rest: Vec<_> = scene.sh.chunks(REST + 1).map(yuv_planes).collect();
    attributes.extend(bytes(&quantise(&mut rest, UNIT, level.rest, false), level.rest));
    for (sh, (dc, rest)) in scene.sh.chunks_mut(REST + 1).zip(dc.iter().zip(&rest)) {
        sh[0] = *dc;
        let yuv = |k: usize| [rest[k], rest[REST + k], rest[2 * REST + k]];
        (0..REST).for_each(|k| sh[1 + k] = transform(&TO_RGB, yuv(k)));
    }
    let mut opacities: Vec<_> = scene.opacity_logits.iter().map(|&o| [o]).collect();
    attributes.extend(bytes(&quantise(&mut opacities, None, level.other, true), level.other));
    scene.opacity_logits = opacities.into_iter().flatten().collect();
    attributes
        .extend(bytes(&quantise(&mut scene.log_scales, None, level.other, true), level.other));
    let (mut three, largest): (Vec<_>, Vec<_>) =
        scene.rotations.iter().map(|&q| three_smallest(q)).unzip();
    let steps = quantise(&mut three, UNIT, level.other, true);
    let steps: Vec<_> =
        steps.iter().zip(&largest).map(|(&[a, b, c], &k)| [a, b, c, k as u32]).collect();
    attributes.extend(bytes(&steps, level.other));
    scene.rotations =
        three.into_iter().zip(largest).map(|(three, k)| with_largest(three, k)).collect();
    append_gzip(&mut stream, &attributes)?;
    Ok((stream, scene))
}

/// Rounds each channel to the steps between its bounds, and returns the numbers of the steps. The last step is the
/// upper bound, or else one step below it.
fn quantise<const N: usize>(
    rows: &mut [[f32; N]],
    bounds: Option<[f64; 2]>,
    bits: u32,
    last_is_bound: bool,
) -> Vec<[u32; N]> {
    let mut out = vec![[0; N]; rows.len()];
    let last = f64::from((1u32 << bits) - 1);
    let symbols = if last_is_bound { last } else { last + 1.0 };
    for k in 0..N {
        let channel = || rows.iter().map(|row| f64::from(row[k]));
        let [low, high] = bounds.unwrap_or_else(|| {
            [channel().fold(f64::MAX, f64::min), channel().fold(f64::MIN, f64::max)]
        });
        let step = (high - low).max(f64::MIN_POSITIVE) / symbols;
        for (row, out) in rows.iter_mut().zip(&mut out) {
            let number = ((f64::from(row[k]) - low) / step).round().clamp(0.0, last);
            (row[k], out[k]) = ((low + number * step) as f32, number as u32);
        }
    }
    out
}

/// Little-endian, in whole bytes.
fn bytes<const N: usize>(rows: &[[u32; N]], bits: u32) -> Vec<u8> {
    let width = bits.div_ceil(8) as usize;
    rows.iter().flatten().flat_map(|v| v.to_le_bytes().into_iter().take(width)).collect()
}

fn append_gzip(stream: &mut Vec<u8>, bytes: &[u8]) -> Result<()> {
    let mut packer = GzEncoder::new(Vec::new(), Compression::default());
    packer.write_all(bytes)?;
    let packed = packer.finish()?;
    stream.extend((packed.len() as u32).to_le_bytes());
    stream.extend(packed);
    Ok(())
}

fn transform(matrix: &[[f32; 3]; 3], v: [f32; 3]) -> [f32; 3] {
    matrix.map(|row| row[0] * v[0] + row[1] * v[1] + row[2] * v[2])
}

/// The coefficients after the DC term, channel by channel.
fn yuv_planes(sh: &[[f32; 3]]) -> [f32; 3 * REST] {
    let mut out = [0.0; 3 * REST];
    for (k, &rgb) in sh[1..].iter().enumerate() {
        transform(&TO_YUV, rgb).into_iter().enumerate().for_each(|(c, v)| out[c * REST + k] = v);
    }
    out
}

/// A rotation without its largest component, which is made positive, and the place of that.
fn three_smallest(q: [f32; 4]) -> ([f32; 3], usize) {
    let norm = q.iter().map(|v| v * v).sum::<f32>().sqrt();
    let k = (0..4).fold(0, |best, k| if q[k].abs() > q[best].abs() { k } else { best });
    let scale = if q[k] < 0.0 { -norm } else { norm };
    let mut others = (0..4).filter(|&j| j != k).map(|j| q[j] / scale);
    (std::array::from_fn(|_| others.next().unwrap_or_default()), k)
}

/// Undoes [`three_smallest`].
fn with_largest(three: [f32; 3], k: usize) -> [f32; 4] {
    let largest = (1.0 - three.iter().map(|v| v * v).sum::<f32>()).max(0.0).sqrt();
    let mut others = three.into_iter();
    std::array::from_fn(|j| if j == k { largest } else { others.next().unwrap_or_default() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenes;

    #[test]
    fn a_rotation_comes_back_without_its_largest_component() {
        for q in [[0.9, 0.1, -0.3, 0.2], [0.1, -0.8, 0.3, 0.2], [0.0, 0.3, -0.1, 0.7]] {
            let norm = q.iter().map(|v| v * v).sum::<f32>().sqrt();
            let (three, k) = three_smallest(q);
            let sign = q[k].signum() / norm;
            for (a, b) in with_largest(three, k).into_iter().zip(q) {
                assert!((a - b * sign).abs() < 1e-6, "{q:?}");
            }
        }
    }

    #[test]
    fn errors_are_at_most_half_a_step() {
        let model = testing::trained_like(500, 3, &mut testing::Rng::seeded(1));
        for level in LEVELS {
            let (_, decoded) = code(&model, level).unwrap();
            let model = model.select(&morton_order(&model.means));
            let span = model
                .log_scales
                .iter()
                .flatten()
                .fold([f32::MAX, f32::MIN], |[a, b], &v| [a.min(v), b.max(v)]);
            let step = (span[1] - span[0]) / ((1 << level.other) - 1) as f32;
            for (a, b) in decoded.log_scales.iter().flatten().zip(model.log_scales.iter().flatten())
            {
                assert!((a - b).abs() <= 0.51 * step);
            }
        }
    }

    #[test]
    fn streams_of_fox_are_as_long_as_those_of_qualcomms_code() {
        let Ok(fox) = scenes::find("fox") else {
            eprintln!("SKIPPED: no fox scene in ../shared/scenes");
            return;
        };
        let model = scenes::read_model(&fox.dataset.model_path).unwrap();
        // Recorded with its version 1.0, MB.
        for (level, recorded) in LEVELS.into_iter().zip([4.81, 2.46, 2.01]) {
            let length = code(&model, level).unwrap().0.len() as f64 / 1e6;
            assert!((length / recorded - 1.0).abs() < 0.01, "{length} MB, recorded {recorded}");
        }
    }
}
