//! Earlier Gaussians near each Gaussian of a chunk.

/// Neighbours per Gaussian.
pub(super) const NEIGHBOURS: usize = 8;
/// Gaussians before the current one, in Morton order, that are looked at.
const WINDOW: usize = 64;

/// The rows of the nearest earlier Gaussians, nearest first; the first rows of a chunk repeat
/// what there is, and row 0 names itself.
pub(super) type NearRows = Vec<[u32; NEIGHBOURS]>;

/// Finds the neighbours by the distance of the means' cells; ties go to the later row.
pub(super) fn find(means: &[Vec<i32>]) -> NearRows {
    let n = means[0].len();
    let points: Vec<[i64; 3]> =
        (0..n).map(|i| std::array::from_fn(|a| i64::from(means[a][i]))).collect();
    let mut out = Vec::with_capacity(n);
    for i in 0..n {
        let mut best = [(u64::MAX, i.saturating_sub(1) as u32); NEIGHBOURS];
        let here = points[i];
        for j in (i.saturating_sub(WINDOW)..i).rev() {
            let p = points[j];
            let d = (0..3).map(|a| ((here[a] - p[a]) * (here[a] - p[a])) as u64).sum::<u64>();
            if d < best[NEIGHBOURS - 1].0 {
                let mut at = NEIGHBOURS - 1;
                while at > 0 && d < best[at - 1].0 {
                    best[at] = best[at - 1];
                    at -= 1;
                }
                best[at] = (d, j as u32);
            }
        }
        out.push(best.map(|(_, j)| j));
    }
    out
}
