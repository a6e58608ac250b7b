//! Covariances as floats, colours and SH coefficients as bytes: what the GaussianSplat addon of three.js takes.

use super::{colour, unit};
use crate::math::scaled_rotation;
use crate::scene::Scene;

/// Words of four bytes for the coefficients of degree 1, 2, 3.
pub const SH_WORDS: [usize; 3] = [3, 4, 6];
/// The byte of a coefficient that is zero.
const ZERO: u8 = 128;

/// Red, green, blue and opacity as bytes, in this order in memory.
#[must_use]
pub fn colour_word(scene: &Scene, i: usize) -> u32 {
    u32::from_le_bytes(colour(scene, i).map(unit_byte))
}

/// The words of the coefficients of a degree from 1 to 3: [`SH_WORDS`] of them. Coefficient after coefficient red,
/// green and blue, from -1 to 1 as bytes from 0 to 255, and filled up with 128.
pub fn sh_words(scene: &Scene, i: usize, degree: usize) -> impl Iterator<Item = u32> {
    let of_degree = &scene.sh_of(i)[degree * degree..(degree + 1) * (degree + 1)];
    of_degree.as_flattened().chunks(4).map(|four| {
        let mut bytes = [ZERO; 4];
        for (byte, v) in bytes.iter_mut().zip(four) {
            *byte = (v * 128.0 + 128.5) as u8;
        }
        u32::from_le_bytes(bytes)
    })
}

/// The covariance of a Gaussian: xx, xy, xz, yy, yz, zz.
#[must_use]
pub fn covariance(scene: &Scene, i: usize) -> [f32; 6] {
    of_shape(scene.rotations[i], scene.log_scales[i])
}

/// A number from 0 to 1 as a byte; what is beyond is cut.
fn unit_byte(v: f32) -> u8 {
    (v * 255.0 + 0.5) as u8
}

/// `R S S R^T`, its upper triangle by rows.
fn of_shape(rotation: [f32; 4], log_scale: [f32; 3]) -> [f32; 6] {
    let r = scaled_rotation(unit(rotation), 2.0);
    let variance = log_scale.map(|s| libm::expf(2.0 * s));
    let entry = |i: usize, j: usize| (0..3).map(|k| r[i][k] * variance[k] * r[j][k]).sum();
    [entry(0, 0), entry(0, 1), entry(0, 2), entry(1, 1), entry(1, 2), entry(2, 2)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_quarter_turn_about_z_exchanges_x_and_y() {
        let half = std::f32::consts::FRAC_1_SQRT_2;
        let logs = [2.0f32, 3.0, 5.0].map(libm::logf);
        let c = of_shape([half, 0.0, 0.0, half], logs);
        for (got, want) in c.into_iter().zip([9.0, 0.0, 0.0, 4.0, 0.0, 25.0]) {
            assert!((got - want).abs() < 1e-4, "{c:?}");
        }
    }

    #[test]
    fn bytes_beyond_their_range_are_cut() {
        assert_eq!([-3.0, 0.0, 0.5, 1.0, 7.0].map(unit_byte), [0, 0, 128, 255, 255]);
        let mut scene = Scene::zeros(1, 1);
        scene.sh[1..3].copy_from_slice(&[[0.0, -9.0, 9.0], [0.5, 0.0, 0.0]]);
        let words: Vec<u32> = sh_words(&scene, 0, 1).collect();
        assert_eq!(words, [u32::from_le_bytes([128, 0, 255, 192]), 0x8080_8080, 0x8080_8080]);
    }
}
