//! The axes of SPZ files.
//!
//! PLY models have x right, y down, z forward; SPZ has x right, y up, z back. gs-model turns one
//! into the other whenever it reads or writes SPZ. Turning twice gives the numbers as they are in
//! the file.

use clap::ValueEnum;
use gs_model::Scene;

/// What is done about the axes of SPZ files.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Axes {
    /// Turned between SPZ (y up) and the other formats (y down), as SPZ's specification asks.
    Turn,
    /// Numbers stay as they are, as in Niantic's ply_to_spz and spz_to_ply.
    Keep,
}

/// Sign of each SH basis function under `(x, y, z) -> (x, -y, -z)`, degrees 0 to 3.
const SH_SIGNS: [f32; 16] =
    [1., -1., -1., 1., -1., 1., 1., -1., 1., -1., 1., -1., -1., 1., -1., 1.];

/// Turns a scene by half a turn about x: `(x, y, z)` becomes `(x, -y, -z)`.
pub(crate) fn turn(scene: &mut Scene) {
    for mean in &mut scene.means {
        *mean = [mean[0], -mean[1], -mean[2]];
    }
    for q in &mut scene.rotations {
        *q = [q[0], q[1], -q[2], -q[3]];
    }
    let per_gaussian = scene.sh_len();
    for (i, coefficient) in scene.sh.iter_mut().enumerate() {
        let sign = SH_SIGNS[i % per_gaussian];
        *coefficient = coefficient.map(|v| sign * v);
    }
}
