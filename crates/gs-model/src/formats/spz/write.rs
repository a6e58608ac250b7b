//! Writes version 4, and version 3 for those who read no newer one.

use std::io::Write;
use std::path::Path;

use flate2::Compression;
use flate2::write::GzEncoder;
use rayon::prelude::*;
use ruzstd::encoding::{CompressionLevel, compress_to_vec};

use super::layout::{ANTIALIASED, COLOUR_SCALE};
use super::{HEADER, MAGIC, streams};
use crate::axes::ABOUT_X;
use crate::error::{Error, Result};
use crate::formats::splat::opacity_byte;
use crate::math::{smallest_three, unit};
use crate::scene::Scene;

/// Fractional bits of positions by default: a step of 2^-12 world units, as in Niantic's packer, and
/// coordinates to +-2048.
const FRACTIONAL_BITS: i32 = 12;
/// Bits of a fixed-point position beside its sign.
const POSITION_BITS: i32 = 23;
/// Fewest fractional bits that are written.
const LEAST_FRACTIONAL_BITS: i32 = 4;
/// Largest magnitude of a coordinate that is written, in world units: the largest whole number in 23
/// bits, 4 of them fractional.
pub const MAX_COORDINATE: f32 = ((1 << (POSITION_BITS - LEAST_FRACTIONAL_BITS)) - 1) as f32;
/// A scene is at least this many steps wide (a power of two): small scenes get more fractional
/// bits than [`FRACTIONAL_BITS`].
const LEAST_STEPS: i32 = 16;

/// Bits per SH coefficient.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ShBits {
    /// Of degree 1, 1 to 8; others are moved into that range.
    pub degree_1: u8,
    /// Of degrees 2 and 3, 1 to 8.
    pub rest: u8,
}

impl Default for ShBits {
    /// All 8 bits of the format. Niantic's packer defaults to 5 and 4: half the bytes, and on
    /// trained scenes a loss of about a decibel against the photos.
    fn default() -> Self {
        Self { degree_1: 8, rest: 8 }
    }
}

pub(super) fn write(file: &Path, out: &mut dyn Write, scene: &Scene) -> Result<()> {
    out.write_all(&pack(file, scene, ShBits::default())?).map_err(|e| Error::io(file, "write", e))
}

/// Writes the bytes of an attribute of the Gaussian at an index.
type WriteBytes<'a> = dyn Fn(usize, &mut [u8]) + Sync + 'a;

/// An attribute: its bytes per Gaussian, and how they are written.
struct Attribute<'a> {
    size: usize,
    write: Box<WriteBytes<'a>>,
}

impl<'a> Attribute<'a> {
    fn new(size: usize, write: impl Fn(usize, &mut [u8]) + Sync + 'a) -> Self {
        Self { size, write: Box::new(write) }
    }

    /// The bytes of all `n` Gaussians.
    fn bytes(&self, n: usize) -> Vec<u8> {
        const ROWS: usize = 4096;
        let mut raw = vec![0; self.size * n];
        // There may be no higher SH coefficients.
        raw.par_chunks_mut(self.size.max(1) * ROWS).enumerate().for_each(|(chunk, part)| {
            for (i, out) in part.chunks_exact_mut(self.size).enumerate() {
                (self.write)(chunk * ROWS + i, out);
            }
        });
        raw
    }

    /// The bytes of all `n` Gaussians, compressed, and their length before.
    fn compressed(&self, n: usize) -> (usize, Vec<u8>) {
        let raw = self.bytes(n);
        (raw.len(), compress_to_vec(&raw[..], CompressionLevel::Fastest))
    }
}

/// A scene as an SPZ file of version 4. `file` is its name in errors.
///
/// The format is lossy: positions in steps of 2^-12 world units (finer where the whole scene is
/// smaller than 16 units, coarser beyond 2048), log-scales in steps of 1/16 within -10..5.94,
/// opacities and colours as bytes, rotations to about 0.1 degrees, SH coefficients within -1..1.
///
/// # Errors
/// [`Error::SceneShape`] or [`Error::SceneDegree`] if the arrays do not fit together,
/// [`Error::Unwritable`] for a coordinate beyond [`MAX_COORDINATE`] or not finite.
pub fn pack(file: impl AsRef<Path>, scene: &Scene, bits: ShBits) -> Result<Vec<u8>> {
    let (mut out, fractional_bits) = start(file.as_ref(), scene, 4)?;
    let packed: Vec<(usize, Vec<u8>)> = attributes(scene, fractional_bits, bits)
        .par_iter()
        .filter(|attribute| attribute.size > 0 && !scene.is_empty())
        .map(|attribute| attribute.compressed(scene.len()))
        .collect();
    out.push(packed.len() as u8);
    out.extend((streams::HEADER as u32).to_le_bytes());
    out.extend([0; 12]);
    for (raw, part) in &packed {
        out.extend((part.len() as u64).to_le_bytes());
        out.extend((*raw as u64).to_le_bytes());
    }
    for (_, part) in &packed {
        out.extend(part);
    }
    Ok(out)
}

/// As [`pack`], but of version 3, which is one gzip stream.
///
/// # Errors
/// As [`pack`].
pub fn pack_version_3(file: impl AsRef<Path>, scene: &Scene, bits: ShBits) -> Result<Vec<u8>> {
    let file = file.as_ref();
    let (mut head, fractional_bits) = start(file, scene, 3)?;
    head.resize(HEADER, 0);
    let mut zipped = GzEncoder::new(Vec::new(), Compression::default());
    let io = |e| Error::io(file, "write", e);
    zipped.write_all(&head).map_err(io)?;
    for attribute in attributes(scene, fractional_bits, bits) {
        zipped.write_all(&attribute.bytes(scene.len())).map_err(io)?;
    }
    zipped.finish().map_err(io)
}

/// The header up to its flags, and the fractional bits of positions.
fn start(file: &Path, scene: &Scene, version: u32) -> Result<(Vec<u8>, u8)> {
    scene.check_shape()?;
    let n = u32::try_from(scene.len())
        .map_err(|_| Error::unwritable(file, "SPZ holds at most 2^32 - 1 Gaussians"))?;
    let fractional_bits = fractional_bits(file, scene)?;
    let mut out = MAGIC.to_vec();
    out.extend(version.to_le_bytes());
    out.extend(n.to_le_bytes());
    let flags = if scene.antialiased { ANTIALIASED } else { 0 };
    out.extend([scene.sh_degree, fractional_bits, flags]);
    Ok((out, fractional_bits))
}

/// The attributes in file order.
fn attributes(scene: &Scene, fractional_bits: u8, bits: ShBits) -> [Attribute<'_>; 6] {
    let steps = f64::from(1u32 << fractional_bits);
    let buckets = [bits.degree_1, bits.rest].map(|b| 1u8 << (8 - b.clamp(1, 8)));
    [
        Attribute::new(9, move |i, out| {
            for (k, v) in ABOUT_X.mean(scene.means[i]).into_iter().enumerate() {
                let fixed = libm::round(f64::from(v) * steps) as i32;
                out[3 * k..3 * k + 3].copy_from_slice(&fixed.to_le_bytes()[..3]);
            }
        }),
        Attribute::new(1, |i, out| out[0] = opacity_byte(scene.opacity_logits[i])),
        Attribute::new(3, |i, out| {
            for (o, v) in out.iter_mut().zip(scene.sh_of(i)[0]) {
                *o = byte(255.0 * (0.5 + COLOUR_SCALE * v));
            }
        }),
        Attribute::new(3, |i, out| {
            for (o, v) in out.iter_mut().zip(scene.log_scales[i]) {
                *o = byte(16.0 * (v + 10.0));
            }
        }),
        Attribute::new(4, |i, out| {
            out.copy_from_slice(&packed_rotation(scene.rotations[i]).to_le_bytes());
        }),
        Attribute::new(3 * (scene.sh_len() - 1), move |i, out| {
            let coefficients = &scene.sh_of(i)[1..];
            for (k, (rgb, out)) in coefficients.iter().zip(out.chunks_exact_mut(3)).enumerate() {
                let bucket = buckets[usize::from(k >= 3)];
                for (o, v) in out.iter_mut().zip(rgb) {
                    *o = sh_byte(ABOUT_X.sh(k + 1, *v), bucket);
                }
            }
        }),
    ]
}

/// Fractional bits that hold every coordinate.
fn fractional_bits(file: &Path, scene: &Scene) -> Result<u8> {
    let mut largest = 0.0f32;
    for (index, mean) in scene.means.iter().enumerate() {
        for &value in mean {
            if value.is_nan() || value.abs() > MAX_COORDINATE {
                let (what, most) =
                    (format!("Gaussian {index}: coordinate {value}"), MAX_COORDINATE);
                let reason = format!("{what} is outside the range of SPZ, -{most} to {most}");
                return Err(Error::unwritable(file, reason));
            }
            largest = largest.max(value.abs());
        }
    }
    // The exponent: largest < 2^exponent. One step is kept free for rounding up.
    let exponent = libm::frexpf(largest * (1.0 + 1e-6)).1;
    let fits = POSITION_BITS - exponent;
    let wanted = FRACTIONAL_BITS.max(LEAST_STEPS - exponent);
    Ok(wanted.clamp(LEAST_FRACTIONAL_BITS, POSITION_BITS).min(fits.max(LEAST_FRACTIONAL_BITS))
        as u8)
}

/// The step of every position; nothing of a scene that cannot be written.
pub(super) fn steps(scene: &Scene) -> Vec<f64> {
    let bits = fractional_bits(Path::new("scene"), scene);
    bits.map_or(Vec::new(), |bits| vec![1.0 / f64::from(1u32 << bits); scene.len()])
}

/// The nearest byte; NaN gives 0.
fn byte(v: f32) -> u8 {
    libm::roundf(v) as u8
}

/// The nearest multiple of `bucket` from the middle of the range.
fn sh_byte(v: f32, bucket: u8) -> u8 {
    let bucket = f32::from(bucket);
    (libm::roundf(128.0 * v / bucket) * bucket + 128.0) as u8
}

/// A quaternion `[w, x, y, z]` of any norm, turned to SPZ's axes, as its three smallest
/// components.
fn packed_rotation(q: [f32; 4]) -> u32 {
    let [w, x, y, z] = unit(ABOUT_X.rotation(q));
    let (largest, others) = smallest_three([x, y, z, w]);
    others.iter().fold(largest as u32, |bits, v| {
        let magnitude = (511.0 * std::f64::consts::SQRT_2 * v.abs() + 0.5) as u32;
        bits << 10 | u32::from(*v < 0.0) << 9 | magnitude.min(511)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(coordinate: f32) -> Result<u8> {
        let scene = Scene { means: vec![[coordinate, 0.0, 0.0]], ..Default::default() };
        fractional_bits(Path::new("a"), &scene)
    }

    #[test]
    fn positions_fit_and_small_scenes_keep_their_detail() {
        for (coordinate, bits) in
            [(0.0, 16), (0.3, 17), (10.0, 12), (2047.0, 12), (2048.5, 11), (500_000.0, 4)]
        {
            assert_eq!(at(coordinate).unwrap(), bits, "{coordinate}");
            assert!(f64::from(coordinate) * f64::from(1u32 << bits) < 8_388_607.5);
        }
        for coordinate in [524_288.0, f32::NAN, f32::INFINITY] {
            assert!(at(coordinate).unwrap_err().to_string().contains("Gaussian 0"));
        }
    }

    #[test]
    fn sh_bytes_are_the_nearest_bucket() {
        assert_eq!([0.0, 1.0, -1.0, 9.0, -9.0].map(|v| sh_byte(v, 16)), [128, 255, 0, 255, 0]);
        // 0.1 * 128 = 12.8: nearest multiple of 8 is 16.
        assert_eq!((sh_byte(0.1, 8), sh_byte(-0.1, 8), sh_byte(0.03, 8)), (144, 112, 128));
    }
}
