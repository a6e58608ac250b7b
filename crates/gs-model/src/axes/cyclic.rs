//! The axes that change places: `(x, y, z)` becomes `(z, x, y)`, a third of a turn.

use crate::scene::Scene;

/// Square roots of 3/4, 15/16, 5/8 and 3/8.
const R3: f32 = 0.866_025_4;
const R15: f32 = 0.968_245_86;
const R10: f32 = 0.790_569_4;
const R6: f32 = 0.612_372_46;

/// Puts the last axis first.
pub(super) fn scene(scene: &mut Scene) {
    let per_gaussian = scene.sh_len();
    scene.means.iter_mut().for_each(|m| *m = axes(*m));
    scene.origin = axes(scene.origin);
    // The Gaussian's own axes change places with those of space.
    scene.rotations.iter_mut().for_each(|[_, v @ ..]| *v = axes(*v));
    scene.log_scales.iter_mut().for_each(|s| *s = axes(*s));
    scene.sh.chunks_exact_mut(per_gaussian).for_each(sh);
}

/// Three numbers, one for each axis.
pub(super) fn axes<T>([x, y, z]: [T; 3]) -> [T; 3] {
    [z, x, y]
}

/// The coefficients of a Gaussian.
fn sh(all: &mut [[f32; 3]]) {
    for channel in 0..3 {
        let old: [f32; 16] = std::array::from_fn(|k| all.get(k).map_or(0.0, |c| c[channel]));
        all.iter_mut().zip(turned(old)).for_each(|(c, v)| c[channel] = v);
    }
}

/// The function that `c` stands for, with the axes in their new places. A degree stays what it is.
fn turned(c: [f32; 16]) -> [f32; 16] {
    [
        c[0],
        c[3],
        -c[1],
        -c[2],
        -c[7],
        -c[4],
        -0.5 * c[6] - R3 * c[8],
        c[5],
        R3 * c[6] - 0.5 * c[8],
        R15 * c[13] - 0.25 * c[15],
        c[10],
        -0.25 * c[13] - R15 * c[15],
        R10 * c[9] + R6 * c[11],
        R6 * c[12] + R10 * c[14],
        R6 * c[9] - R10 * c[11],
        R6 * c[14] - R10 * c[12],
    ]
}
