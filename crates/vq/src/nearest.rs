//! Exact nearest-codeword search in six dimensions.
//!
//! The codewords are in a tree of bounding boxes with eight children per node. Boxes and codewords
//! are stored as eight lanes per dimension, so that the compiler turns the inner loops into vector
//! instructions.
//!
//! Invariant: the answer is that of a scan over all codewords, and of equally near ones the lowest
//! index. The bound of a box and the distance to a codeword sum the same six squares in the same
//! order, and IEEE rounding is monotone, so a bound never exceeds the computed distance of a
//! codeword inside.

use crate::covariance::Feature;

/// Covariances handed to a thread at a time.
pub(crate) const CHUNK: usize = 4096;

const LANES: usize = 8;

/// Squared distance, summed in the order of the tree.
#[cfg(test)]
fn squared_distance(a: &Feature, b: &Feature) -> f32 {
    let mut sum = 0.0;
    for k in 0..6 {
        let d = a[k] - b[k];
        sum += d * d;
    }
    sum
}

/// Eight bounding boxes and what lies below them.
#[derive(Debug, Clone)]
struct Node {
    low: [[f32; LANES]; 6],
    high: [[f32; LANES]; 6],
    /// Index of a node, or of a leaf with [`LEAF`] set.
    child: [u32; LANES],
}

const LEAF: u32 = 1 << 31;

/// Up to eight codewords; unused lanes lie at infinity.
#[derive(Debug, Clone)]
struct Leaf {
    position: [[f32; LANES]; 6],
    id: [u32; LANES],
}

/// A search structure over a fixed list of codewords.
#[derive(Debug, Clone)]
pub(crate) struct Nearest {
    nodes: Vec<Node>,
    leaves: Vec<Leaf>,
    root: u32,
}

/// The nearest codeword so far.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Hit {
    pub(crate) id: u32,
    /// Squared distance.
    pub(crate) cost: f32,
}

impl Nearest {
    /// `codewords` must be finite, at least one and fewer than 2^31.
    pub(crate) fn new(codewords: &[Feature]) -> Self {
        let mut ids: Vec<u32> = (0..codewords.len() as u32).collect();
        let mut tree = Self { nodes: Vec::new(), leaves: Vec::new(), root: 0 };
        tree.root = tree.build(codewords, &mut ids);
        tree
    }

    fn build(&mut self, codewords: &[Feature], ids: &mut [u32]) -> u32 {
        if ids.len() <= LANES {
            ids.sort_unstable();
            let mut leaf = Leaf { position: [[f32::INFINITY; LANES]; 6], id: [u32::MAX; LANES] };
            for (lane, &id) in ids.iter().enumerate() {
                leaf.id[lane] = id;
                for k in 0..6 {
                    leaf.position[k][lane] = codewords[id as usize][k];
                }
            }
            self.leaves.push(leaf);
            return LEAF | (self.leaves.len() - 1) as u32;
        }
        let index = self.nodes.len();
        self.nodes.push(Node {
            low: [[0.0; LANES]; 6],
            high: [[0.0; LANES]; 6],
            child: [0; LANES],
        });
        let mut parts: Vec<&mut [u32]> = vec![ids];
        while parts.len() < LANES {
            parts = parts.into_iter().flat_map(|p| split_in_two(codewords, p)).collect();
        }
        for (lane, part) in parts.into_iter().enumerate() {
            let [low, high] = bounds_of(codewords, part);
            let child = self.build(codewords, part);
            let node = &mut self.nodes[index];
            for k in 0..6 {
                node.low[k][lane] = low[k];
                node.high[k][lane] = high[k];
            }
            node.child[lane] = child;
        }
        index as u32
    }

    /// The nearest codeword to `x`; of equally near ones the lowest index.
    pub(crate) fn find(&self, x: &Feature) -> Hit {
        let mut best = Hit { id: u32::MAX, cost: f32::INFINITY };
        self.descend(self.root, x, &mut best);
        best
    }

    fn descend(&self, at: u32, x: &Feature, best: &mut Hit) {
        if at & LEAF != 0 {
            let leaf = &self.leaves[(at & !LEAF) as usize];
            let cost = lane_distances(&leaf.position, x);
            // Most leaves hold nothing better, which one vector minimum shows.
            if least(&cost) > best.cost {
                return;
            }
            for lane in 0..LANES {
                let (d, id) = (cost[lane], leaf.id[lane]);
                if d < best.cost || (d == best.cost && id < best.id) {
                    *best = Hit { id, cost: d };
                }
            }
            return;
        }
        let node = &self.nodes[at as usize];
        let mut bound = box_distances(&node.low, &node.high, x);
        loop {
            let nearest = least(&bound);
            // A box at exactly the best distance may hold a lower index.
            if nearest > best.cost || nearest == f32::INFINITY {
                return;
            }
            let lane = bound.iter().position(|&b| b == nearest).unwrap_or(0);
            self.descend(node.child[lane], x, best);
            bound[lane] = f32::INFINITY;
        }
    }
}

/// Smallest of eight, none of them NaN.
#[inline]
fn least(values: &[f32; LANES]) -> f32 {
    let smaller = |a: f32, b: f32| if b < a { b } else { a };
    let [a, b, c, d, e, f, g, h] = *values;
    smaller(smaller(smaller(a, e), smaller(c, g)), smaller(smaller(b, f), smaller(d, h)))
}

#[inline]
fn lane_distances(position: &[[f32; LANES]; 6], x: &Feature) -> [f32; LANES] {
    let mut sum = [0.0f32; LANES];
    for k in 0..6 {
        for lane in 0..LANES {
            let d = x[k] - position[k][lane];
            sum[lane] += d * d;
        }
    }
    sum
}

/// The squared distance to each box: a lower bound of that to anything inside.
#[inline]
fn box_distances(low: &[[f32; LANES]; 6], high: &[[f32; LANES]; 6], x: &Feature) -> [f32; LANES] {
    let mut sum = [0.0f32; LANES];
    for k in 0..6 {
        for lane in 0..LANES {
            let (below, above) = (low[k][lane] - x[k], x[k] - high[k][lane]);
            let d = if below > above { below } else { above };
            let d = if d > 0.0 { d } else { 0.0 };
            sum[lane] += d * d;
        }
    }
    sum
}

/// Smallest box around points.
pub(crate) fn bounds<'a>(points: impl IntoIterator<Item = &'a Feature>) -> [Feature; 2] {
    let (mut low, mut high) = ([f32::INFINITY; 6], [f32::NEG_INFINITY; 6]);
    for point in points {
        low = std::array::from_fn(|k| low[k].min(point[k]));
        high = std::array::from_fn(|k| high[k].max(point[k]));
    }
    [low, high]
}

/// Smallest box around some of the points.
fn bounds_of(points: &[Feature], ids: &[u32]) -> [Feature; 2] {
    bounds(ids.iter().map(|&id| &points[id as usize]))
}

/// Halves two or more at the median of the widest dimension; equal values are told apart by index, so the
/// two sets do not depend on the sort's inner workings.
fn split_in_two<'a>(points: &[Feature], ids: &'a mut [u32]) -> [&'a mut [u32]; 2] {
    let [low, high] = bounds_of(points, ids);
    let width = |k: usize| high[k] - low[k];
    let widest = (1..6).fold(0, |best, k| if width(k) > width(best) { k } else { best });
    let middle = ids.len() / 2;
    ids.select_nth_unstable_by(middle, |&a, &b| {
        points[a as usize][widest].total_cmp(&points[b as usize][widest]).then(a.cmp(&b))
    });
    ids.split_at_mut(middle).into()
}

/// The reference: a scan over all codewords.
#[cfg(test)]
fn brute_force(codewords: &[Feature], x: &Feature) -> Hit {
    let mut best = Hit { id: 0, cost: f32::INFINITY };
    for (id, codeword) in codewords.iter().enumerate() {
        let d = squared_distance(x, codeword);
        if d < best.cost {
            best = Hit { id: id as u32, cost: d };
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Coordinates on a coarse grid: many exact ties and duplicates.
    fn coarse() -> impl Strategy<Value = Feature> {
        prop::array::uniform6((-3i8..=3).prop_map(|i| f32::from(i) / 3.0))
    }

    #[test]
    fn a_bound_is_the_squared_distance_to_the_box() {
        let (low, high) = ([[-1.0; LANES]; 6], [[1.0; LANES]; 6]);
        let x = [0.0, -3.0, 4.0, 0.5, 1.0, -1.0];
        assert_eq!(box_distances(&low, &high, &x), [4.0 + 9.0; LANES]);
    }

    #[test]
    fn a_set_is_halved_across_its_widest_dimension() {
        let point = |i: u8| [f32::from(1 + i % 2), 0.0, f32::from(10 + i), 0.0, 0.0, 0.0];
        let points: Vec<Feature> = (0..8).map(point).collect();
        let mut ids = [7, 2, 5, 0, 3, 6, 1, 4];
        let [low, high] = split_in_two(&points, &mut ids);
        assert!(low.iter().all(|&id| id < 4) && high.len() == 4, "{low:?} {high:?}");
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        #[test]
        fn equals_brute_force_with_ties(
            codewords in prop::collection::vec(coarse(), 1..700),
            queries in prop::collection::vec(coarse(), 1..50),
        ) {
            let tree = Nearest::new(&codewords);
            for x in &queries {
                prop_assert_eq!(tree.find(x), brute_force(&codewords, x));
            }
        }

        #[test]
        fn equals_brute_force_on_any_floats(
            codewords in prop::collection::vec(prop::array::uniform6(-1.0f32..1.0), 1..2000),
            queries in prop::collection::vec(prop::array::uniform6(-1.1f32..1.1), 1..20),
        ) {
            let tree = Nearest::new(&codewords);
            for x in &queries {
                prop_assert_eq!(tree.find(x), brute_force(&codewords, x));
            }
        }
    }
}
