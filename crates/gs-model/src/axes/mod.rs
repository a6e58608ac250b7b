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

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: [Axes; 4] = [Axes::Stored, Axes::YUp, Axes::Unity, Axes::Unreal];

    /// A Gaussian to the right, above and in front of the origin.
    fn one() -> Scene {
        Scene {
            means: vec![[1.0, -2.0, 3.0]],
            rotations: vec![[0.5, 0.1, 0.2, 0.3]],
            log_scales: vec![[-1.0, -2.0, -3.0]],
            opacity_logits: vec![0.5],
            sh_degree: 3,
            sh: (0..16).map(|k| [0.1, 0.7, -0.3].map(|v| v * k as f32)).collect(),
            ..Scene::default()
        }
    }

    #[test]
    fn right_up_and_forward_are_where_the_engine_has_them() {
        let expected = [[1.0, -2.0, 3.0], [1.0, 2.0, -3.0], [1.0, 2.0, 3.0], [3.0, 1.0, 2.0]];
        for (axes, mean) in ALL.into_iter().zip(expected) {
            let mut scene = one();
            axes.turn(&mut scene);
            assert_eq!(scene.means, [mean], "{axes:?}");
            assert_eq!(axes.turn_box([one().means[0]; 2]), [mean; 2]);
        }
    }

    #[test]
    fn turned_back_a_scene_is_what_it_was() {
        for axes in ALL {
            let mut scene = one();
            axes.turn(&mut scene);
            axes.turn_back(&mut scene);
            let sh = std::mem::take(&mut scene.sh);
            for (a, b) in sh.as_flattened().iter().zip(one().sh.as_flattened()) {
                assert!((a - b).abs() < 1e-5, "{axes:?}");
            }
            assert_eq!(scene, Scene { sh: Vec::new(), ..one() }, "{axes:?}");
        }
    }

    #[test]
    fn a_turned_box_has_its_least_corner_first() {
        let turned = Axes::Unreal.turn_box([[0.0, 1.0, 4.0], [1.0, 3.0, 5.0]]);
        assert_eq!(turned, [[4.0, 0.0, -3.0], [5.0, 1.0, -1.0]]);
    }
}
