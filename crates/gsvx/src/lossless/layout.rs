//! A scene as columns of bit patterns, in coding order.
//!
//! Means first (they decide the order and the neighbours), then opacity, log-scales, rotation,
//! and SH coefficients, colour channels innermost.

use gs_model::Scene;

/// Columns of the means.
pub(super) const MEANS: usize = 3;
/// Columns that are not SH.
pub(super) const PLAIN: usize = MEANS + 1 + 3 + 4;

/// Number of columns of a scene of this SH degree.
pub(crate) fn columns(sh_degree: u8) -> usize {
    PLAIN + 3 * (usize::from(sh_degree) + 1) * (usize::from(sh_degree) + 1)
}

/// What a column holds; columns of one kind share their probability models.
pub(super) fn kind(column: usize) -> usize {
    match column {
        0..=3 => 0,
        4..=6 => 1,
        7..=10 => 2,
        11..=13 => 3,
        _ => 4 + (column - PLAIN) % 3,
    }
}

/// Number of values of [`kind`].
pub(super) const KINDS: usize = 7;

/// Column `c` of the scene, Gaussians in the order of `order`.
#[cfg(feature = "encode")]
pub(super) fn gather(scene: &Scene, c: usize, order: &[u32]) -> Vec<u32> {
    let k = scene.sh_len();
    order
        .iter()
        .map(|&i| {
            let i = i as usize;
            match c {
                0..=2 => scene.means[i][c],
                3 => scene.opacity_logits[i],
                4..=6 => scene.log_scales[i][c - 4],
                7..=10 => scene.rotations[i][c - 7],
                _ => scene.sh[i * k + (c - PLAIN) / 3][(c - PLAIN) % 3],
            }
            .to_bits()
        })
        .collect()
}

/// Rows of all columns, Gaussians in the order of `order`.
#[cfg(feature = "encode")]
pub(crate) fn gather_rows(scene: &Scene, order: &[u32]) -> Vec<u32> {
    let mut out = Vec::with_capacity(order.len() * columns(scene.sh_degree));
    for &i in order {
        let i = i as usize;
        out.extend(scene.means[i].map(f32::to_bits));
        out.push(scene.opacity_logits[i].to_bits());
        out.extend(scene.log_scales[i].map(f32::to_bits));
        out.extend(scene.rotations[i].map(f32::to_bits));
        out.extend(scene.sh_of(i).as_flattened().iter().map(|v| v.to_bits()));
    }
    out
}

/// Puts one row at Gaussian `i`.
pub(crate) fn scatter(scene: &mut Scene, i: usize, row: &[u32]) {
    let v = |c: usize| f32::from_bits(row[c]);
    scene.means[i] = [v(0), v(1), v(2)];
    scene.opacity_logits[i] = v(3);
    scene.log_scales[i] = [v(4), v(5), v(6)];
    scene.rotations[i] = [v(7), v(8), v(9), v(10)];
    let k = scene.sh_len();
    for (j, rgb) in scene.sh[i * k..(i + 1) * k].iter_mut().enumerate() {
        *rgb = std::array::from_fn(|a| v(PLAIN + 3 * j + a));
    }
}
