//! Weighted k-means of many short vectors into many clusters.
//!
//! Clusters come from splitting: while there are fewer than asked for, those that cost most are halved (`split`). Then
//! points move to nearer centres and centres to the means of their points, in turns. A point looks for a nearer centre
//! in a tree whose planes are drawn anew in each turn (`tree`): what one tree misses, another one finds. No point ever
//! moves to a farther centre, so the cost only falls.
//!
//! *Invariant:* equal input gives equal clusters on every machine and for any number of threads.
//!
//! ```
//! let points = [[0.0, 0.1], [0.0, 0.3], [9.0, 9.0]];
//! let clusters = kmeans::cluster(&points, &[1.0, 1.0, 1.0], 2);
//! assert_eq!(clusters.of_point[0], clusters.of_point[1]);
//! assert_eq!(clusters.centres[clusters.of_point[2] as usize], [9.0, 9.0]);
//! ```

mod lloyd;
mod rng;
mod split;
mod tree;

pub use lloyd::{Clusters, cluster};
pub use rng::SplitMix64;

/// Squared distance, always summed in this order.
#[inline(always)]
fn squared_distance<const D: usize>(a: &[f32; D], b: &[f32; D]) -> f32 {
    let square = |a: f32, b: f32| (a - b) * (a - b);
    sum_of(a, b, square)
}

/// Product of two vectors, always summed in this order.
#[inline(always)]
fn dot<const D: usize>(a: &[f32; D], b: &[f32; D]) -> f32 {
    sum_of(a, b, |a, b| a * b)
}

#[inline(always)]
fn sum_of<const D: usize>(a: &[f32; D], b: &[f32; D], of: impl Fn(f32, f32) -> f32) -> f32 {
    let ((a, a_rest), (b, b_rest)) = (a.as_chunks::<LANES>(), b.as_chunks::<LANES>());
    let mut sums = [0.0f32; LANES];
    for (a, b) in a.iter().zip(b) {
        for lane in 0..LANES {
            sums[lane] += of(a[lane], b[lane]);
        }
    }
    let rest: f32 = a_rest.iter().zip(b_rest).map(|(&a, &b)| of(a, b)).sum();
    sums.iter().sum::<f32>() + rest
}

/// Numbers that are added side by side.
const LANES: usize = 8;

// The README's example is a test too.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
