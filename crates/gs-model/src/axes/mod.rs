//! Coordinate axes: those of trained scenes, those of engines, and those of files.

mod cyclic;
#[cfg(feature = "formats")]
mod placement;
mod signs;

use crate::scene::Scene;
#[cfg(feature = "formats")]
pub(crate) use placement::Placement;
#[cfg(feature = "formats")]
pub(crate) use signs::{ABOUT_X, ABOUT_Z, STAYING, Signs};

/// Coordinate axes of scenes. Lengths stay as they are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Axes {
    /// As trained and as PLY files and streams have them: right-handed, x to the right, y down, z forward.
    #[default]
    Stored,
    /// Right-handed: x to the right, y up, z backward, as in OpenGL.
    YUp,
    /// Left-handed: x to the right, y up, z forward.
    Unity,
    /// Left-handed: x forward, y to the right, z up.
    Unreal,
}

impl Axes {
    /// Turns a scene from [`Axes::Stored`] to these axes: means, rotations, scales where axes change places, and SH
    /// coefficients. All but the SH coefficients of [`Axes::Unreal`] change places and signs alone.
    pub fn turn(self, scene: &mut Scene) {
        self.flip(scene);
        if self == Self::Unreal {
            cyclic::scene(scene);
        }
    }

    /// The inverse of [`Axes::turn`].
    pub fn turn_back(self, scene: &mut Scene) {
        if self == Self::Unreal {
            cyclic::scene(scene);
            cyclic::scene(scene);
        }
        self.flip(scene);
    }

    /// Turns a box, as least and greatest coordinates.
    #[must_use]
    pub fn turn_box(self, [low, high]: [[f32; 3]; 2]) -> [[f32; 3]; 2] {
        let turned = [low, high].map(|corner| {
            let corner = self.signs().map_or(corner, |signs| signs.mean(corner));
            if self == Self::Unreal { cyclic::axes(corner) } else { corner }
        });
        let [a, b] = turned;
        [std::array::from_fn(|k| a[k].min(b[k])), std::array::from_fn(|k| a[k].max(b[k]))]
    }

    fn flip(self, scene: &mut Scene) {
        if let Some(signs) = self.signs() {
            signs.scene(scene);
        }
    }

    fn signs(self) -> Option<signs::Signs> {
        match self {
            Self::Stored => None,
            Self::YUp => Some(signs::ABOUT_X),
            Self::Unity | Self::Unreal => Some(signs::MIRROR_Y),
        }
    }
}

#[cfg(all(test, feature = "formats"))]
mod tests {
    use super::*;
    use crate::math::{Matrix, axes_product, rotation, sh_basis};

    /// A Gaussian to the right, above and in front of the origin.
    fn one() -> Scene {
        Scene {
            means: vec![[1.0, -2.0, 3.0]],
            rotations: vec![[0.5, 0.1, 0.2, 0.3]],
            log_scales: vec![[-1.0, -2.0, -3.0]],
            opacity_logits: vec![0.5],
            sh_degree: 3,
            sh: (0..16).map(|k| [0.1, 0.7, -0.3].map(|v| v * (k * k % 7) as f32)).collect(),
            ..Scene::default()
        }
    }

    fn colour(scene: &Scene, direction: [f64; 3]) -> f64 {
        let basis = sh_basis::values(direction);
        scene.sh.iter().zip(basis).map(|(rgb, b)| f64::from(rgb[1]) * b).sum()
    }

    fn covariance(scene: &Scene) -> Matrix {
        let variances = scene.log_scales[0].map(|s| libm::exp(2.0 * f64::from(s)));
        let [xx, yy, zz, xy, xz, yz] = axes_product(&rotation(scene.rotations[0]), variances);
        [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]
    }

    /// What is done to a scene: a point `p` goes to `scale * matrix p + shift`.
    type Change = (Matrix, f64, [f64; 3], Box<dyn Fn(&mut Scene)>);

    fn changes() -> Vec<Change> {
        let diagonal = |[x, y, z]: [f64; 3]| [[x, 0.0, 0.0], [0.0, y, 0.0], [0.0, 0.0, z]];
        let mut all: Vec<Change> =
            vec![(diagonal([-1.0, -1.0, 1.0]), 1.0, [0.0; 3], Box::new(|s| ABOUT_Z.scene(s)))];
        let of_engines = [
            (Axes::Stored, diagonal([1.0; 3])),
            (Axes::YUp, diagonal([1.0, -1.0, -1.0])),
            (Axes::Unity, diagonal([1.0, -1.0, 1.0])),
            (Axes::Unreal, [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]),
        ];
        for (axes, matrix) in of_engines {
            all.push((matrix, 1.0, [0.0; 3], Box::new(move |scene| axes.turn(scene))));
        }
        // A turn about an axis in no special direction, and a mirror.
        let turn = rotation([0.5, 0.1, -0.7, 0.4]);
        for matrix in [turn, [turn[1], turn[0], turn[2]]] {
            let twice = matrix.map(|row| row.map(|v| 2.0 * v));
            let placement = Placement { matrix: twice, shift: [5.0, 6.0, 7.0] };
            let place = move |scene: &mut Scene| assert!(placement.scene(scene));
            all.push((matrix, 2.0, placement.shift, Box::new(place)));
        }
        all
    }

    #[test]
    fn a_turned_gaussian_looks_the_same_from_the_turned_direction() {
        for (matrix, scale, shift, change) in changes() {
            let turned = |p: [f64; 3]| matrix.map(|m| m[0] * p[0] + m[1] * p[1] + m[2] * p[2]);
            let (before, mut after) = (one(), one());
            change(&mut after);
            for d in [[0.6, 0.0, 0.8], [0.36, -0.48, 0.8], [-0.48, 0.8, -0.36], [0.0, -1.0, 0.0]] {
                let off = colour(&before, d) - colour(&after, turned(d));
                assert!(off.abs() < 1e-6, "{matrix:?}: {off}");
            }
            let mean = turned(before.means[0].map(f64::from));
            let [old, new] = [&before, &after].map(covariance);
            for i in 0..3 {
                let expected = scale * mean[i] + shift[i];
                assert!((f64::from(after.means[0][i]) - expected).abs() < 1e-5, "{matrix:?}");
                for j in 0..3 {
                    let pairs = (0..3).flat_map(|k| (0..3).map(move |l| (k, l)));
                    let sum: f64 =
                        pairs.map(|(k, l)| matrix[i][k] * old[k][l] * matrix[j][l]).sum();
                    assert!((new[i][j] - scale * scale * sum).abs() < 1e-6, "{matrix:?}");
                }
            }
        }
    }

    #[test]
    fn turned_back_a_scene_is_what_it_was() {
        for axes in [Axes::Stored, Axes::YUp, Axes::Unity, Axes::Unreal] {
            let mut scene = one();
            axes.turn(&mut scene);
            assert_eq!(axes.turn_box([one().means[0]; 2]), [scene.means[0]; 2]);
            axes.turn_back(&mut scene);
            let sh = std::mem::take(&mut scene.sh);
            for (a, b) in sh.as_flattened().iter().zip(one().sh.as_flattened()) {
                assert!((a - b).abs() < 1e-5, "{axes:?}");
            }
            assert_eq!(scene, Scene { sh: Vec::new(), ..one() }, "{axes:?}");
        }
        let turned = Axes::Unreal.turn_box([[0.0, 1.0, 4.0], [1.0, 3.0, 5.0]]);
        assert_eq!(turned, [[4.0, 0.0, -3.0], [5.0, 1.0, -1.0]], "the least corner first");
    }

    #[test]
    fn shear_and_uneven_scales_are_refused() {
        let uneven = [[1.01, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let sheared = [[1.0, 0.1, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        for matrix in [uneven, sheared, [[0.0; 3]; 3], [[f64::NAN; 3]; 3]] {
            let mut scene = one();
            assert!(!Placement { matrix, shift: [0.0; 3] }.scene(&mut scene));
            assert_eq!(scene, one());
        }
    }
}
