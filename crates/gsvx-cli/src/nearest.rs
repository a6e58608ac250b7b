//! Nearest neighbours among points: an implicit k-d tree.

/// A k-d tree over points: each half split at its median, axes in turn.
pub(crate) struct Tree<'a> {
    points: &'a [[f32; 3]],
    order: Vec<u32>,
}

impl<'a> Tree<'a> {
    /// A tree over finite points.
    pub(crate) fn new(points: &'a [[f32; 3]]) -> Self {
        let mut order: Vec<u32> = (0..points.len() as u32).collect();
        split(points, &mut order, 0);
        Self { points, order }
    }

    /// Index of the point nearest to `p`, the lowest of several; `None` if there is no point.
    pub(crate) fn nearest(&self, p: [f32; 3]) -> Option<usize> {
        let mut best = (f64::INFINITY, u32::MAX);
        search(self.points, &self.order, 0, p, &mut best);
        (best.1 != u32::MAX).then_some(best.1 as usize)
    }
}

fn split(points: &[[f32; 3]], order: &mut [u32], axis: usize) {
    if order.len() < 2 {
        return;
    }
    let middle = order.len() / 2;
    order.select_nth_unstable_by(middle, |&a, &b| {
        points[a as usize][axis].total_cmp(&points[b as usize][axis])
    });
    let (low, high) = order.split_at_mut(middle);
    rayon::join(
        || split(points, low, (axis + 1) % 3),
        || split(points, &mut high[1..], (axis + 1) % 3),
    );
}

fn search(points: &[[f32; 3]], order: &[u32], axis: usize, p: [f32; 3], best: &mut (f64, u32)) {
    if order.is_empty() {
        return;
    }
    let middle = order.len() / 2;
    let here = order[middle];
    let q = points[here as usize];
    let distance: f64 = (0..3).map(|k| square(f64::from(q[k]) - f64::from(p[k]))).sum();
    if distance < best.0 || (distance == best.0 && here < best.1) {
        *best = (distance, here);
    }
    let gap = f64::from(p[axis]) - f64::from(q[axis]);
    let (near, far) = if gap < 0.0 {
        (&order[..middle], &order[middle + 1..])
    } else {
        (&order[middle + 1..], &order[..middle])
    };
    search(points, near, (axis + 1) % 3, p, best);
    if gap * gap <= best.0 {
        search(points, far, (axis + 1) % 3, p, best);
    }
}

/// `v^2`.
pub(crate) fn square(v: f64) -> f64 {
    v * v
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn finds_what_looking_at_every_point_finds() {
        let mut seed = 7u32;
        let mut next = || {
            seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            // Few distinct values, so that there are ties.
            ((seed >> 24) % 16) as f32
        };
        let points: Vec<[f32; 3]> = (0..400).map(|_| [next(), next(), next()]).collect();
        let tree = Tree::new(&points);
        for _ in 0..300 {
            let p = [next() + 0.3, next() - 0.2, next()];
            let distance = |q: [f32; 3]| -> f64 {
                (0..3).map(|k| square(f64::from(q[k]) - f64::from(p[k]))).sum()
            };
            let slow = (0..points.len())
                .min_by(|&a, &b| distance(points[a]).total_cmp(&distance(points[b])))
                .unwrap();
            assert_eq!(tree.nearest(p), Some(slow));
        }
        assert_eq!(Tree::new(&[]).nearest([0.0; 3]), None);
    }
}
