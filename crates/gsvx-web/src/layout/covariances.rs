//! What the GaussianSplat addon of three.js takes: means and covariances as floats, colours and SH
//! coefficients as bytes.

use super::column::Column;
use super::{ArrayLayout, base_colour, of_degree, opacity};
use gs_model::Scene;
use js_sys::Object;

/// Words of four bytes for the coefficients of degree 1, 2, 3.
const WORDS: [usize; 3] = [3, 4, 6];
/// The byte of a coefficient that is zero.
const ZERO: u8 = 128;

/// `centers`, `covariances` (xx, xy, xz, yy, yz, zz), `colors` (a word of red, green, blue and alpha),
/// `sh1` to `sh3`.
pub(crate) struct Covariances {
    centers: Column<f32>,
    covariances: Column<f32>,
    colours: Column<u32>,
    sh: Vec<Column<u32>>,
}

impl Covariances {
    pub(crate) fn of(arrays: &Object, capacity: usize, sh_degree: u8) -> Self {
        let degrees = ["sh1", "sh2", "sh3"].into_iter().zip(WORDS).take(sh_degree.into());
        Self {
            centers: Column::of(arrays, "centers", 3, capacity),
            covariances: Column::of(arrays, "covariances", 6, capacity),
            colours: Column::of(arrays, "colors", 1, capacity),
            sh: degrees.map(|(name, words)| Column::of(arrays, name, words, capacity)).collect(),
        }
    }
}

impl ArrayLayout for Covariances {
    fn put(&mut self, first: usize, block: &Scene) {
        self.centers.copy(first, block.means.as_flattened());
        for i in 0..block.len() {
            let covariance = covariance(block.rotations[i], block.log_scales[i]);
            self.covariances.block.extend(covariance);
            let sh = block.sh_of(i);
            let [r, g, b] = sh[0].map(|dc| unit_byte(base_colour(dc)));
            let alpha = unit_byte(opacity(block.opacity_logits[i]));
            self.colours.block.push(u32::from_le_bytes([r, g, b, alpha]));
            for (degree, column) in (1..).zip(&mut self.sh) {
                push_words(&mut column.block, of_degree(sh, degree));
            }
        }
        self.covariances.flush(first);
        self.colours.flush(first);
        self.sh.iter_mut().for_each(|column| column.flush(first));
    }
}

/// A number from 0 to 1 as a byte; what is beyond is cut.
fn unit_byte(v: f32) -> u8 {
    (v * 255.0 + 0.5) as u8
}

/// The bytes of coefficients, four in a word.
fn push_words(out: &mut Vec<u32>, coefficients: &[[f32; 3]]) {
    for four in coefficients.as_flattened().chunks(4) {
        let mut bytes = [ZERO; 4];
        for (byte, v) in bytes.iter_mut().zip(four) {
            *byte = (v * 128.0 + 128.5) as u8;
        }
        out.push(u32::from_le_bytes(bytes));
    }
}

/// `R S S R^T`, its upper triangle by rows.
fn covariance(rotation: [f32; 4], log_scale: [f32; 3]) -> [f32; 6] {
    let length = rotation.iter().map(|v| v * v).sum::<f32>().sqrt().max(f32::MIN_POSITIVE);
    let [w, x, y, z] = rotation.map(|v| v / length);
    let r = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ];
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
        let c = covariance([half, 0.0, 0.0, half], logs);
        for (got, want) in c.into_iter().zip([9.0, 0.0, 0.0, 4.0, 0.0, 25.0]) {
            assert!((got - want).abs() < 1e-4, "{c:?}");
        }
    }

    #[test]
    fn bytes_beyond_their_range_are_cut() {
        assert_eq!([-3.0, 0.0, 0.5, 1.0, 7.0].map(unit_byte), [0, 0, 128, 255, 255]);
        let mut words = Vec::new();
        push_words(&mut words, &[[0.0, -9.0, 9.0], [0.5, 0.0, 0.0]]);
        assert_eq!(words, [u32::from_le_bytes([128, 0, 255, 192]), 0x8080_8080]);
    }
}
