//! Coordinate axes that change their signs: half turns and mirrors. They change no bit but signs.

use crate::scene::Scene;

/// The signs that the axes get.
pub(crate) struct Signs {
    /// Of x, y and z.
    pub(crate) axes: [f32; 3],
    /// Of each basis function, degrees 0 to 3.
    sh: [f32; 16],
}

/// All stay as they are.
#[cfg(feature = "formats")]
pub(crate) const STAYING: Signs = Signs { axes: [1.; 3], sh: [1.; 16] };

/// `(x, -y, -z)`, half a turn: SPZ.
pub(crate) const ABOUT_X: Signs = Signs {
    axes: [1., -1., -1.],
    sh: [1., -1., -1., 1., -1., 1., 1., -1., 1., -1., 1., -1., -1., 1., -1., 1.],
};

/// `(-x, -y, z)`, half a turn: glTF.
#[cfg(feature = "formats")]
pub(crate) const ABOUT_Z: Signs = Signs {
    axes: [-1., -1., 1.],
    sh: [1., -1., 1., -1., 1., -1., 1., -1., 1., -1., 1., -1., 1., -1., 1., -1.],
};

/// `(x, -y, z)`, a mirror: Unity.
pub(crate) const MIRROR_Y: Signs = Signs {
    axes: [1., -1., 1.],
    sh: [1., -1., 1., 1., -1., -1., 1., 1., 1., -1., -1., -1., 1., 1., 1., 1.],
};

impl Signs {
    pub(crate) fn mean(&self, mean: [f32; 3]) -> [f32; 3] {
        std::array::from_fn(|k| self.axes[k] * mean[k])
    }

    /// A place in double precision, as an origin is.
    pub(crate) fn place(&self, place: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|k| f64::from(self.axes[k]) * place[k])
    }

    /// A quaternion `[w, x, y, z]`. A mirror turns the sense of a rotation. The axes of its Gaussian keep their
    /// names: each of them changes its sign at most, and a Gaussian is symmetric.
    pub(crate) fn rotation(&self, [w, x, y, z]: [f32; 4]) -> [f32; 4] {
        let sense: f32 = self.axes.iter().product();
        let [x, y, z] = self.mean([x, y, z]).map(|v| sense * v);
        [w, x, y, z]
    }

    /// The coefficient of basis function `k`.
    pub(crate) fn sh(&self, k: usize, value: f32) -> f32 {
        self.sh[k] * value
    }

    pub(crate) fn scene(&self, scene: &mut Scene) {
        let per_gaussian = scene.sh_len();
        scene.means.iter_mut().for_each(|m| *m = self.mean(*m));
        scene.origin = self.place(scene.origin);
        scene.rotations.iter_mut().for_each(|q| *q = self.rotation(*q));
        for (i, rgb) in scene.sh.iter_mut().enumerate() {
            *rgb = rgb.map(|v| self.sh(i % per_gaussian, v));
        }
    }
}
