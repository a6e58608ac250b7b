//! From levels back to the means of the children.

use crate::coefficients::LevelRows;
use crate::raht::{self, LANES, RahtPlan, Rows};

/// Rebuilds the means of the children that the coefficients of a level split.
pub(super) fn reconstruct(plan: &RahtPlan, level: &LevelRows, steps: &[f32], rows: &mut Rows) {
    // With a width known at compile time, copying a row is a few instructions instead of a call.
    match rows.width() {
        1 => reconstruct_rows(plan, level, steps, rows, 1),
        2 => reconstruct_rows(plan, level, steps, rows, 2),
        3 => reconstruct_rows(plan, level, steps, rows, 3),
        4 => reconstruct_rows(plan, level, steps, rows, 4),
        6 => reconstruct_rows(plan, level, steps, rows, 6),
        width => reconstruct_rows(plan, level, steps, rows, width),
    }
}

/// As [`reconstruct`], for rows of this width.
#[inline(always)]
fn reconstruct_rows(
    plan: &RahtPlan,
    level: &LevelRows,
    steps: &[f32],
    rows: &mut Rows,
    width: usize,
) {
    let mut all = vec![[0.0; LANES]; width];
    all.as_flattened_mut()[..steps.len()].copy_from_slice(steps);
    let mut active = level.active.iter().zip(level.levels.chunks_exact(width)).peekable();
    for i in 0..level.count {
        let k = level.first + i;
        let (left, right, share) = raht::split(plan, k - 1, &mut rows.lanes, width);
        let Some((_, levels)) = active.next_if(|(row, _)| **row == i as u32) else {
            right.copy_from_slice(left);
            continue;
        };
        let scale = plan.scale_of(k);
        for (((left, right), levels), step) in left.iter_mut().zip(right).zip(levels).zip(&all) {
            let difference = std::array::from_fn(|i| levels[i] as f32 * step[i] * scale);
            raht::undo(left, right, difference, share);
        }
    }
}
