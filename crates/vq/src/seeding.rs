//! Exact weighted k-means++ over a bounding-box tree of the points.
//!
//! Plain k-means++ (Arthur and Vassilvitskii 2007) measures every point against every new centre:
//! 1.7e10 distances for 65,536 centres and a quarter of a million points. Here each tree node
//! stores the largest squared distance of a point below it, so a new centre visits only points that
//! it may be nearest to. It also stores the sum of weight times squared distance, so drawing a
//! point is one descent. Every centre is a data point, and so a valid covariance.

use crate::covariance::Feature;
use crate::nearest::{bounds_of, split_in_two, squared_distance};
use crate::rng::SplitMix64;

const LEAF_SIZE: usize = 16;

#[derive(Debug, Clone)]
struct Node {
    low: Feature,
    high: Feature,
    /// Range of `ids`.
    first: u32,
    end: u32,
    /// Index of the right child; the left one follows the node. 0 for a leaf.
    right: u32,
    /// Largest squared distance of a point below to its nearest centre.
    farthest: f32,
    /// Sum over the points below of weight times squared distance.
    mass: f64,
}

struct Tree<'a> {
    points: &'a [Feature],
    weights: &'a [f32],
    ids: Vec<u32>,
    nodes: Vec<Node>,
    /// Squared distance to the nearest centre, in the order of `ids`.
    distance: Vec<f32>,
}

/// Indices of up to `count` distinct points, drawn one after another with probability
/// proportional to weight times squared distance to the nearest point drawn before. Fewer if
/// the points with a positive weight run out of distinct positions.
pub(crate) fn kmeans_plus_plus(
    points: &[Feature],
    weights: &[f32],
    count: usize,
    rng: &mut SplitMix64,
) -> Vec<u32> {
    let mut tree = Tree::new(points, weights);
    let mut chosen = Vec::with_capacity(count.min(points.len()));
    let mut draw = tree.draw(rng);
    tree.forget_distances();
    while let Some(id) = draw {
        chosen.push(id);
        if chosen.len() == count {
            break;
        }
        tree.add_centre(0, &points[id as usize]);
        draw = tree.draw(rng);
    }
    chosen
}

impl<'a> Tree<'a> {
    /// Distances are 1 to begin with: the first draw is by weight alone.
    fn new(points: &'a [Feature], weights: &'a [f32]) -> Self {
        let mut ids: Vec<u32> = (0..points.len() as u32).collect();
        let distance = vec![1.0; points.len()];
        let mut tree = Self { points, weights, ids: Vec::new(), nodes: Vec::new(), distance };
        tree.build(&mut ids, 0);
        tree.ids = ids;
        tree
    }

    /// The first centre must replace the distances of 1 everywhere.
    fn forget_distances(&mut self) {
        self.distance.fill(f32::INFINITY);
        self.nodes.iter_mut().for_each(|node| node.farthest = f32::INFINITY);
    }

    fn build(&mut self, ids: &mut [u32], first: u32) {
        let [low, high] = bounds_of(self.points, ids);
        let index = self.nodes.len();
        let end = first + ids.len() as u32;
        let leaf = Node { low, high, first, end, right: 0, farthest: 1.0, mass: 0.0 };
        self.nodes.push(leaf);
        if ids.len() <= LEAF_SIZE {
            ids.sort_unstable();
            self.nodes[index].mass = ids.iter().map(|&i| f64::from(self.weights[i as usize])).sum();
            return;
        }
        let [a, b] = split_in_two(self.points, ids);
        let middle = first + a.len() as u32;
        self.build(a, first);
        let right = self.nodes.len();
        self.build(b, middle);
        let mass = self.nodes[index + 1].mass + self.nodes[right].mass;
        let node = &mut self.nodes[index];
        node.right = right as u32;
        node.mass = mass;
    }

    /// Shrinks the distances of the points below node `at` that are nearer to `centre`.
    fn add_centre(&mut self, at: usize, centre: &Feature) {
        let node = &self.nodes[at];
        if box_distance(&node.low, &node.high, centre) >= node.farthest {
            return;
        }
        let (farthest, mass) = if node.right == 0 {
            let (mut farthest, mut mass) = (0.0f32, 0.0f64);
            for slot in node.first as usize..node.end as usize {
                let id = self.ids[slot] as usize;
                let d = self.distance[slot].min(squared_distance(&self.points[id], centre));
                self.distance[slot] = d;
                farthest = farthest.max(d);
                mass += f64::from(d) * f64::from(self.weights[id]);
            }
            (farthest, mass)
        } else {
            let right = node.right as usize;
            self.add_centre(at + 1, centre);
            self.add_centre(right, centre);
            let (a, b) = (&self.nodes[at + 1], &self.nodes[right]);
            (a.farthest.max(b.farthest), a.mass + b.mass)
        };
        self.nodes[at].farthest = farthest;
        self.nodes[at].mass = mass;
    }

    /// A point with probability proportional to its mass; `None` when no mass is left.
    fn draw(&self, rng: &mut SplitMix64) -> Option<u32> {
        let mut at = 0;
        if self.nodes[0].mass <= 0.0 {
            return None;
        }
        let mut rest = rng.unit() * self.nodes[0].mass;
        while self.nodes[at].right != 0 {
            let (left, right) = (at + 1, self.nodes[at].right as usize);
            // Rounding may leave `rest` at the very end of the mass: never enter an empty side.
            if rest < self.nodes[left].mass || self.nodes[right].mass <= 0.0 {
                at = left;
            } else {
                rest -= self.nodes[left].mass;
                at = right;
            }
        }
        let node = &self.nodes[at];
        let mut last = None;
        for slot in node.first as usize..node.end as usize {
            let id = self.ids[slot];
            let mass = f64::from(self.distance[slot]) * f64::from(self.weights[id as usize]);
            if mass > 0.0 {
                last = Some(id);
                if rest < mass {
                    break;
                }
                rest -= mass;
            }
        }
        last
    }
}

fn box_distance(low: &Feature, high: &Feature, x: &Feature) -> f32 {
    let mut sum = 0.0;
    for k in 0..6 {
        let d = (low[k] - x[k]).max(x[k] - high[k]).max(0.0);
        sum += d * d;
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::random_points;

    #[test]
    fn distances_equal_the_plain_algorithm() {
        let (points, weights) = random_points(3000, 5);
        let mut rng = SplitMix64::new(9);
        let chosen = kmeans_plus_plus(&points, &weights, 200, &mut rng);
        assert_eq!(chosen.len(), 200);
        // Rebuild the tree's state for these centres and compare every distance.
        let mut tree = Tree::new(&points, &weights);
        tree.forget_distances();
        for &c in &chosen {
            tree.add_centre(0, &points[c as usize]);
        }
        let mut total = 0.0;
        for (slot, &id) in tree.ids.iter().enumerate() {
            let reference = chosen
                .iter()
                .map(|&c| squared_distance(&points[id as usize], &points[c as usize]))
                .fold(f32::INFINITY, f32::min);
            assert_eq!(tree.distance[slot], reference);
            total += f64::from(reference) * f64::from(weights[id as usize]);
        }
        assert!((tree.nodes[0].mass - total).abs() < 1e-9 * total);
    }

    #[test]
    fn drawn_points_are_distinct_and_carry_weight() {
        let (mut points, mut weights) = random_points(500, 6);
        for k in 0..100 {
            points[k] = points[0];
            weights[400 + k % 100] = 0.0;
        }
        let chosen = kmeans_plus_plus(&points, &weights, 500, &mut SplitMix64::new(1));
        assert_eq!(chosen.len(), 301, "300 distinct weighted points and the one repeated");
        let mut seen = chosen.clone();
        seen.sort_unstable();
        seen.dedup();
        assert_eq!(seen.len(), 301);
        assert!(chosen.iter().all(|&c| c < 400));
    }

    #[test]
    fn the_first_draw_follows_the_weights() {
        let (points, _) = random_points(40, 2);
        let mut weights = vec![1.0; 40];
        weights[17] = 39.0 * 3.0;
        let mut rng = SplitMix64::new(3);
        let hits =
            (0..2000).filter(|_| kmeans_plus_plus(&points, &weights, 1, &mut rng) == [17]).count();
        assert!((1400..1600).contains(&hits), "expected near 1500 of 2000, got {hits}");
    }

    #[test]
    fn without_weight_there_is_nothing_to_draw() {
        let none = kmeans_plus_plus(&[[0.0; 6]; 3], &[0.0; 3], 4, &mut SplitMix64::new(0));
        assert!(none.is_empty());
    }
}
