//! [`Placement`]: any rotation or mirror, with a uniform scale and a shift.

use rayon::prelude::*;

use super::Signs;
use crate::math::{Matrix, quaternion, quaternion_product, sh_basis};
use crate::scene::Scene;

/// Largest difference of a matrix from a rotation or mirror of uniform scale, relative to the scale. Matrices of
/// files are floats.
const TOLERANCE: f64 = 1e-4;

/// A shift beyond this, in world units, moves the origin of a scene and not its means.
const FAR: f64 = 10_000.0;

const IDENTITY: Matrix = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

/// A point `p` goes to `matrix p + shift`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Placement {
    /// Rows.
    pub(crate) matrix: Matrix,
    pub(crate) shift: [f64; 3],
}

impl Placement {
    /// Everything stays where it is.
    pub(crate) const STAYING: Self = Self { matrix: IDENTITY, shift: [0.0; 3] };

    /// `first`, then this.
    pub(crate) fn after(&self, first: &Self) -> Self {
        let (a, b) = (&self.matrix, &first.matrix);
        let product = |i: usize, j: usize| (0..3).map(|k| a[i][k] * b[k][j]).sum::<f64>();
        let matrix = std::array::from_fn(|i| std::array::from_fn(|j| product(i, j)));
        Self { matrix, shift: self.point(first.shift) }
    }

    /// The same placement of what has turned its axes: turned back, placed, turned.
    pub(crate) fn seen_from(&self, turn: &Signs) -> Self {
        let sign = turn.axes.map(f64::from);
        let turned = |i: usize, j: usize| sign[i] * self.matrix[i][j] * sign[j];
        Self {
            matrix: std::array::from_fn(|i| std::array::from_fn(|j| turned(i, j))),
            shift: std::array::from_fn(|i| sign[i] * self.shift[i]),
        }
    }

    fn point(&self, p: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|i| {
            self.shift[i] + (0..3).map(|k| self.matrix[i][k] * p[k]).sum::<f64>()
        })
    }

    /// The matrix without its scale, and the scale; `None` if it shears, scales axes apart, has no extent or is
    /// not finite.
    fn turn_and_scale(&self) -> Option<(Matrix, f64)> {
        let square: f64 = self.matrix.as_flattened().iter().map(|v| v * v).sum();
        let scale = (square / 3.0).sqrt();
        if !scale.is_normal() || self.shift.iter().any(|v| !v.is_finite()) {
            return None;
        }
        let turn = self.matrix.map(|row| row.map(|v| v / scale));
        let dot = |i: usize, j: usize| (0..3).map(|k| turn[i][k] * turn[j][k]).sum::<f64>();
        let off = |i: usize, j: usize| (dot(i, j) - IDENTITY[i][j]).abs();
        let fits = (0..3).all(|i| (0..3).all(|j| off(i, j) < TOLERANCE));
        fits.then_some((turn, scale))
    }

    /// Places a scene. False, and nothing is done, if the matrix shears or scales axes apart.
    pub(crate) fn scene(&self, scene: &mut Scene) -> bool {
        if *self == Self::STAYING {
            return true;
        }
        let Some((turn, scale)) = self.turn_and_scale() else { return false };
        // Means far away would lose their last bits: the scene's origin moves instead.
        let is_far = self.shift.iter().any(|v| v.abs() > FAR);
        let linear = Self { shift: [0.0; 3], ..*self };
        let [origin, means] = if is_far { [self, &linear] } else { [&linear, self] };
        scene.origin = origin.point(scene.origin);
        scene.means.par_iter_mut().for_each(|mean| {
            *mean = means.point(mean.map(f64::from)).map(|v| v as f32);
        });
        if scale != 1.0 {
            let longer = libm::log(scale) as f32;
            scene.log_scales.par_iter_mut().for_each(|s| *s = s.map(|v| v + longer));
        }
        if turn != IDENTITY {
            let rotation = rotation(&turn);
            scene.rotations.par_iter_mut().for_each(|q| {
                *q = quaternion_product(rotation, q.map(f64::from)).map(|v| v as f32);
            });
            turn_sh(scene, &turn);
        }
        true
    }
}

/// The quaternion of a rotation, or of the rotation that a mirror is but for the sign of all axes: a Gaussian
/// looks the same with all its axes turned round.
fn rotation(turn: &Matrix) -> [f64; 4] {
    let [a, b, c] = *turn;
    let cross = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
    let determinant: f64 = (0..3).map(|k| cross[k] * c[k]).sum();
    quaternion(&turn.map(|row| row.map(|v| v * determinant.signum())))
}

/// Turns the SH coefficients: the function in the direction `turn d` is what it was in the direction `d`.
fn turn_sh(scene: &mut Scene, turn: &Matrix) {
    let matrix = sh_matrix(turn);
    let per_gaussian = scene.sh_len();
    if per_gaussian == 1 {
        return;
    }
    scene.sh.par_chunks_mut(per_gaussian).for_each(|sh| {
        let old: [[f64; 3]; 16] =
            std::array::from_fn(|k| sh.get(k).map_or([0.0; 3], |rgb| rgb.map(f64::from)));
        for (k, rgb) in sh.iter_mut().enumerate().skip(1) {
            let degree = k.isqrt();
            let own = degree * degree..(degree + 1) * (degree + 1);
            *rgb = std::array::from_fn(|c| {
                own.clone().map(|j| matrix[k][j] * old[j][c]).sum::<f64>() as f32
            });
        }
    });
}

/// The coefficients that each basis function has after the turn: column `j` is turned basis function `j`.
///
/// They are integrals over the sphere of products of two basis functions. The 26 points of Lebedev's rule, which
/// lie in the directions of a cube's faces, edges and corners, integrate polynomials up to degree 7 exactly.
fn sh_matrix(turn: &Matrix) -> [[f64; 16]; 16] {
    /// Of points with one, two and three coordinates that are not zero.
    const WEIGHTS: [f64; 3] = [1.0 / 21.0, 4.0 / 105.0, 9.0 / 280.0];
    let mut matrix = [[0.0; 16]; 16];
    for point in 0..27usize {
        let d = [point % 3, point / 3 % 3, point / 9].map(|v| v as f64 - 1.0);
        let square: f64 = d.iter().map(|v| v * v).sum();
        if square == 0.0 {
            continue;
        }
        let weight = 4.0 * std::f64::consts::PI * WEIGHTS[square as usize - 1];
        let d = d.map(|v| v / square.sqrt());
        let back = std::array::from_fn(|j| (0..3).map(|i| turn[i][j] * d[i]).sum());
        let (new, old) = (sh_basis::values(d), sh_basis::values(back));
        for (row, n) in matrix.iter_mut().zip(new) {
            row.iter_mut().zip(old).for_each(|(m, o)| *m += weight * n * o);
        }
    }
    matrix
}
