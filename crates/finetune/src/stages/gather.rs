//! Stage `gather`: sums the records of a splat's slots.

use rayon::prelude::*;

use super::tiles::TileLists;

/// `out[i]` = sum of `records[slot]` over the slots of splat `i`, in tile order, which is
/// the order of emission; `finish` may change it. Each task owns a range of splats and scans all slots, so the
/// order of the additions does not depend on the number of tasks.
pub(crate) fn gather<const N: usize>(
    lists: &TileLists,
    records: &[[f32; N]],
    splats: usize,
    out: &mut Vec<[f32; N]>,
    finish: impl Fn(usize, &mut [f32; N]) + Sync,
) {
    out.clear();
    out.resize(splats, [0.0; N]);
    // The number of ranges affects speed only: every range sums in the same order.
    let chunk = splats.div_ceil(2 * rayon::current_num_threads()).max(1);
    out.par_chunks_mut(chunk).enumerate().for_each(|(c, sums)| {
        let first = (c * chunk) as u32;
        for (&i, record) in lists.ids.iter().zip(records) {
            if let Some(sum) = sums.get_mut(i.wrapping_sub(first) as usize) {
                for (s, r) in sum.iter_mut().zip(record) {
                    *s += r;
                }
            }
        }
        for (j, sum) in sums.iter_mut().enumerate() {
            finish(c * chunk + j, sum);
        }
    });
}
