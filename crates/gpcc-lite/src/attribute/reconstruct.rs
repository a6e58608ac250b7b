//! From levels back to the means of the children.

use crate::coefficients::Level;
use crate::raht::{self, LANES, Lanes, Plan, Rows};

/// Rebuilds the means of the children that the coefficients of a level split.
pub(super) fn reconstruct(plan: &Plan, level: &Level, steps: &[f32], rows: &mut Rows) {
    // With a width known at compile time, copying a row is a few instructions instead of a call.
    match rows.width() {
        1 => reconstruct_rows::<1>(plan, level, steps, rows),
        2 => reconstruct_rows::<2>(plan, level, steps, rows),
        3 => reconstruct_rows::<3>(plan, level, steps, rows),
        4 => reconstruct_rows::<4>(plan, level, steps, rows),
        6 => reconstruct_rows::<6>(plan, level, steps, rows),
        width => {
            let mut all = vec![[0.0; LANES]; width];
            all.as_flattened_mut()[..steps.len()].copy_from_slice(steps);
            let mut active = level.active.iter().zip(level.levels.chunks_exact(width)).peekable();
            for i in 0..level.count {
                let k = level.first + i;
                let (left, right, share) = raht::split(plan, k - 1, &mut rows.lanes, width);
                match active.next_if(|(row, _)| **row == i as u32) {
                    Some((_, levels)) => {
                        undo_row(left, right, levels, &all, (plan.scale_of(k), share))
                    }
                    None => right.copy_from_slice(left),
                }
            }
        }
    }
}

fn reconstruct_rows<const W: usize>(plan: &Plan, level: &Level, steps: &[f32], rows: &mut Rows) {
    let mut all = [[0.0; LANES]; W];
    all.as_flattened_mut()[..steps.len()].copy_from_slice(steps);
    let (levels, _) = level.levels.as_chunks::<W>();
    let mut active = level.active.iter().zip(levels).peekable();
    for i in 0..level.count {
        let k = level.first + i;
        let (left, right, share) = raht::split(plan, k - 1, &mut rows.lanes, W);
        let (Some(left), Some(right)) = (left.first_chunk_mut::<W>(), right.first_chunk_mut::<W>())
        else {
            return;
        };
        match active.next_if(|(row, _)| **row == i as u32) {
            Some((_, levels)) => undo_row(left, right, levels, &all, (plan.scale_of(k), share)),
            None => *right = *left,
        }
    }
}

/// The means of both children of a coefficient, from the node's and the levels.
#[inline(always)]
fn undo_row(
    left: &mut [Lanes],
    right: &mut [Lanes],
    levels: &[[i32; LANES]],
    steps: &[Lanes],
    (scale, share): (f32, f32),
) {
    for (((left, right), levels), step) in left.iter_mut().zip(right).zip(levels).zip(steps) {
        for i in 0..LANES {
            right[i] = levels[i] as f32 * step[i] * scale;
        }
        raht::undo(left, right, share);
    }
}
