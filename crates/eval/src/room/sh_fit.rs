//! Least-squares fit of spherical harmonics of degree 3 to colours seen from directions.

use glam::DVec3;

/// Basis functions up to degree 3.
const TERMS: usize = 16;
/// Ridge weight per degree, relative to the sum of the sample weights: keeps high degrees near
/// zero where the directions do not determine them.
const RIDGE: [f64; 4] = [0.0, 0.002, 0.004, 0.008];

/// One observation: colour 0..1 along the unit `direction` from the camera to the point.
pub(crate) struct Sample {
    pub(crate) direction: DVec3,
    pub(crate) colour: [f64; 3],
    pub(crate) weight: f64,
}

/// Accumulated normal equations.
#[derive(Clone, Debug, Default)]
pub(crate) struct Fit {
    normal: [[f64; TERMS]; TERMS],
    right: [[f64; 3]; TERMS],
    weight: f64,
}

/// The basis of Inria's renderer, in file order (Ramamoorthi and Hanrahan's real SH, signs as
/// in 3DGS).
fn basis(d: DVec3) -> [f64; TERMS] {
    let (x, y, z) = (d.x, d.y, d.z);
    let (xx, yy, zz) = (x * x, y * y, z * z);
    [
        0.282_094_791_773_878_14,
        -0.488_602_511_902_919_9 * y,
        0.488_602_511_902_919_9 * z,
        -0.488_602_511_902_919_9 * x,
        1.092_548_430_592_079_2 * x * y,
        -1.092_548_430_592_079_2 * y * z,
        0.315_391_565_252_520_05 * (2.0 * zz - xx - yy),
        -1.092_548_430_592_079_2 * x * z,
        0.546_274_215_296_039_6 * (xx - yy),
        -0.590_043_589_926_643_5 * y * (3.0 * xx - yy),
        2.890_611_442_640_554 * x * y * z,
        -0.457_045_799_464_465_8 * y * (4.0 * zz - xx - yy),
        0.373_176_332_590_115_4 * z * (2.0 * zz - 3.0 * xx - 3.0 * yy),
        -0.457_045_799_464_465_8 * x * (4.0 * zz - xx - yy),
        1.445_305_721_320_277 * z * (xx - yy),
        -0.590_043_589_926_643_5 * x * (xx - 3.0 * yy),
    ]
}

impl Fit {
    /// Adds an observation.
    pub(crate) fn add(&mut self, sample: &Sample) {
        let y = basis(sample.direction);
        self.weight += sample.weight;
        for (i, &yi) in y.iter().enumerate() {
            for (j, &yj) in y.iter().enumerate() {
                self.normal[i][j] += sample.weight * yi * yj;
            }
            for (c, &colour) in sample.colour.iter().enumerate() {
                self.right[i][c] += sample.weight * yi * (colour - 0.5);
            }
        }
    }

    /// The coefficients, DC first. All zero (mid grey) if nothing was added.
    pub(crate) fn solve(mut self) -> [[f32; 3]; TERMS] {
        for i in 0..TERMS {
            // Term i belongs to degree floor(sqrt(i)).
            let degree = (1..4).rev().find(|d| d * d <= i).unwrap_or(0);
            self.normal[i][i] += RIDGE[degree] * self.weight + 1e-9;
        }
        let lower = cholesky(self.normal);
        let mut out = [[0.0; 3]; TERMS];
        for c in 0..3 {
            let mut y = [0.0; TERMS];
            for i in 0..TERMS {
                let known: f64 = (0..i).map(|k| lower[i][k] * y[k]).sum();
                y[i] = (self.right[i][c] - known) / lower[i][i];
            }
            for i in (0..TERMS).rev() {
                let known: f64 = (i + 1..TERMS).map(|k| lower[k][i] * y[k]).sum();
                y[i] = (y[i] - known) / lower[i][i];
                out[i][c] = y[i] as f32;
            }
        }
        out
    }
}

/// The lower factor of a symmetric positive definite matrix. The ridge keeps pivots positive;
/// the floor guards the last bits.
fn cholesky(a: [[f64; TERMS]; TERMS]) -> [[f64; TERMS]; TERMS] {
    let mut l = [[0.0; TERMS]; TERMS];
    for i in 0..TERMS {
        for j in 0..=i {
            let dot: f64 = (0..j).map(|k| l[i][k] * l[j][k]).sum();
            l[i][j] =
                if i == j { (a[i][i] - dot).max(1e-12).sqrt() } else { (a[i][j] - dot) / l[j][j] };
        }
    }
    l
}

#[cfg(test)]
mod tests {
    use super::*;
    use testing::Rng;

    fn directions(n: usize) -> Vec<DVec3> {
        let mut rng = Rng::keyed(9, &[]);
        let mut cube = || DVec3::new(rng.unit() - 0.5, rng.unit() - 0.5, rng.unit() - 0.5);
        (0..n).map(|_| cube().normalize()).collect()
    }

    #[test]
    fn a_constant_colour_is_all_dc() {
        let mut fit = Fit::default();
        for direction in directions(60) {
            fit.add(&Sample { direction, colour: [0.75, 0.5, 0.25], weight: 1.0 });
        }
        let sh = fit.solve();
        for (c, want) in [0.25, 0.0, -0.25].into_iter().enumerate() {
            assert!((f64::from(sh[0][c]) * 0.282_094_79 - want).abs() < 1e-3);
            assert!(sh[1..].iter().all(|k| k[c].abs() < 1e-3));
        }
    }

    #[test]
    fn a_known_expansion_comes_back() {
        let truth: Vec<f64> = (0..TERMS).map(|k| 0.05 * ((k * 7 % 5) as f64 - 2.0)).collect();
        let mut fit = Fit::default();
        for direction in directions(3000) {
            let value = 0.5 + basis(direction).iter().zip(&truth).map(|(a, b)| a * b).sum::<f64>();
            fit.add(&Sample { direction, colour: [value; 3], weight: 1.0 });
        }
        for (k, coefficient) in fit.solve().iter().enumerate() {
            // The ridge pulls by RIDGE / (mean of the squared basis = 1 / (4 pi)), 10 % at most.
            assert!((f64::from(coefficient[1]) - truth[k]).abs() < 0.012, "{k}: {coefficient:?}");
        }
    }
}
