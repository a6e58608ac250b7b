//! The bytes of each attribute, and how a Gaussian is decoded from them.

use std::path::Path;

use crate::axes::Signs;
use crate::bytes::word;
use crate::error::{Error, Result};
use crate::formats::splat::opacity_logit;
use crate::report::DEGREE_4;
use crate::rows::{self, SH};
use crate::scene::{Scene, sh_len};

/// A colour's byte is `255 (1/2 + COLOUR_SCALE * coefficient)`.
pub(super) const COLOUR_SCALE: f32 = 0.15;

/// The flag of a model that is antialiased.
pub(super) const ANTIALIASED: u8 = 1;

/// What the header says about the attributes.
pub(super) struct SpzLayout {
    version: u32,
    sh_degree: u8,
    fractional_bits: u8,
    antialiased: bool,
}

impl SpzLayout {
    pub(super) fn new(
        file: &Path,
        version: u32,
        [sh_degree, fractional_bits, flags]: [u8; 3],
    ) -> Result<Self> {
        let bad = |reason: &str| Err(Error::malformed(file, "SPZ header", reason));
        if sh_degree > 4 {
            return bad("an SH degree above 4; lower it with the tool that wrote the file");
        }
        if fractional_bits > 31 {
            return bad("more than 31 fractional bits");
        }
        Ok(Self { version, sh_degree, fractional_bits, antialiased: flags & ANTIALIASED != 0 })
    }

    /// Bytes per Gaussian of each attribute, in file order.
    pub(super) fn sizes(&self) -> [usize; 6] {
        let rotation = if self.version == 2 { 3 } else { 4 };
        [9, 1, 3, 3, rotation, 3 * (sh_len(self.sh_degree) - 1)]
    }

    /// What a scene does not keep, a sentence each.
    pub(super) fn notes(&self) -> Vec<String> {
        if self.sh_degree > 3 { vec![DEGREE_4.into()] } else { Vec::new() }
    }

    /// The scene of `n` Gaussians whose attributes are `streams`, in file order. The axes get these signs.
    pub(super) fn scene(
        &self,
        file: &Path,
        streams: [&[u8]; 6],
        n: usize,
        signs: &Signs,
    ) -> Result<Scene> {
        let sizes = self.sizes();
        let unit = 1.0 / f64::from(1u32 << self.fractional_bits);
        let scene = rows::scene_of(file, n, self.sh_degree.min(3), |i| {
            let at = |k: usize| &streams[k][i * sizes[k]..(i + 1) * sizes[k]];
            let [position, opacity, colour, log_scale, rotation, sh] = std::array::from_fn(at);
            let mean = [0, 1, 2].map(|k| (unit * f64::from(fixed24(&position[3 * k..]))) as f32);
            let q = match self.version {
                2 => first_three(rotation),
                _ => smallest_three(word(rotation, 0)),
            };
            let (mean, q) = (signs.mean(mean), signs.rotation(q));
            move |c| match c {
                0..3 => mean[c],
                3..7 => q[c - 3],
                7..10 => f32::from(log_scale[c - 7]) / 16.0 - 10.0,
                10 => opacity_logit(opacity[0]),
                11..14 => (f32::from(colour[c - SH]) / 255.0 - 0.5) / COLOUR_SCALE,
                _ => signs.sh((c - SH) / 3, (f32::from(sh[c - SH - 3]) - 128.0) / 128.0),
            }
        })?;
        Ok(Scene { antialiased: self.antialiased, ..scene })
    }
}

/// A 24-bit two's complement number.
fn fixed24(bytes: &[u8]) -> i32 {
    // In the upper three bytes, so that the shift back extends the sign.
    i32::from_le_bytes([0, bytes[0], bytes[1], bytes[2]]) >> 8
}

/// Version 2: x, y, z as bytes; w is not negative and makes the norm 1.
fn first_three(bytes: &[u8]) -> [f32; 4] {
    let [x, y, z] = [0, 1, 2].map(|i| f32::from(bytes[i]) / 127.5 - 1.0);
    [(1.0 - x * x - y * y - z * z).max(0.0).sqrt(), x, y, z]
}

/// From version 3: the top two bits say which of x, y, z, w is largest and left out; the others
/// follow, the last in the lowest bits, as a sign and nine bits of magnitude up to sqrt(1/2).
pub(super) fn smallest_three(mut bits: u32) -> [f32; 4] {
    let largest = (bits >> 30) as usize;
    let mut q = [0.0f32; 4];
    let mut norm2 = 0.0;
    for i in (0..4).rev().filter(|&i| i != largest) {
        let magnitude = std::f32::consts::FRAC_1_SQRT_2 * (bits & 511) as f32 / 511.0;
        q[i] = if bits & 512 == 0 { magnitude } else { -magnitude };
        norm2 += magnitude * magnitude;
        bits >>= 10;
    }
    q[largest] = (1.0 - norm2).max(0.0).sqrt();
    [q[3], q[0], q[1], q[2]]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fixed_point_extends_its_sign() {
        for v in [0, 1, -1, 8_388_607, -8_388_608, -70_000] {
            assert_eq!(fixed24(&i32::to_le_bytes(v)[..3]), v);
        }
    }

    #[test]
    fn rotations_are_unit_quaternions() {
        assert_eq!(smallest_three(3 << 30), [1.0, 0.0, 0.0, 0.0]);
        assert_eq!(smallest_three(0), [0.0, 1.0, 0.0, 0.0]);
        // y largest: x = -511/511, z = 0, w = 256/511, of sqrt(1/2).
        let q = smallest_three((1 << 30) | ((512 + 511) << 20) | 256);
        let most = std::f32::consts::FRAC_1_SQRT_2;
        assert!((q[1] + most).abs() < 1e-6 && q[3] == 0.0, "{q:?}");
        assert!((q[0] - most * 256.0 / 511.0).abs() < 1e-6, "{q:?}");
        for bits in (0..1u64 << 32).step_by(65_537 * 31) {
            let q = smallest_three(bits as u32);
            let norm2: f32 = q.iter().map(|v| v * v).sum();
            // Three components near sqrt(1/2) leave nothing for the largest.
            assert!((0.999..1.51).contains(&norm2), "{q:?}");
        }
        assert_eq!(first_three(&[255, 128, 127])[0], 0.0);
    }
}
