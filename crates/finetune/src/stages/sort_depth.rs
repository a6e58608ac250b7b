//! Stage `sort_depth`: places of the splats, near to far, ties by place.

/// A stable radix sort on the bits of the depth (positive floats order as their bits do).
/// Voxelized means lie on a lattice, so exact ties are common; stability breaks them by index.
pub(crate) fn sort_depth(keys: &[u32], order: &mut Vec<u32>) {
    let mut pairs: Vec<(u32, u32)> = keys.iter().copied().zip(0..).collect();
    let mut other = vec![(0u32, 0u32); pairs.len()];
    for shift in [0u32, 11, 22] {
        let digit = |k: u32| ((k >> shift) & 0x7ff) as usize;
        let mut start = [0u32; 2048];
        for &(k, _) in &pairs {
            start[digit(k)] += 1;
        }
        let mut sum = 0;
        for s in &mut start {
            let count = *s;
            *s = sum;
            sum += count;
        }
        for &pair in &pairs {
            let slot = &mut start[digit(pair.0)];
            other[*slot as usize] = pair;
            *slot += 1;
        }
        std::mem::swap(&mut pairs, &mut other);
    }
    order.clear();
    order.extend(pairs.iter().map(|&(_, i)| i));
}
