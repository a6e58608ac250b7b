//! Entropy-constrained assignment and training (Chou, Lookabaugh and Gray 1989).
//!
//! With a price on bits a codeword costs its squared distance times the point's weight plus lambda
//! times the length of its index. Points of small weight then share a few frequent codewords, and
//! points of large weight get exact, rare ones. Codewords that cost more than they gain lose all
//! their points and are removed.

use rayon::prelude::*;

use crate::covariance::Feature;
use crate::kmeans::{CHUNK, move_to_means};
use crate::nearest::{Hit, Nearest};

/// What a codeword costs in the coded table, in bits: about 5 to 7 bytes on real scenes. Training
/// divides it among the codeword's uses.
const TABLE_BITS: f64 = 45.0;

/// Index lengths in bits for counted uses, as an adaptive coder would have them on average: half
/// a use is added to each, so that no length is infinite.
pub(crate) fn index_lengths(uses: &[u32]) -> Vec<f32> {
    let total: f64 = uses.iter().map(|&n| f64::from(n) + 0.5).sum();
    uses.iter().map(|&n| libm::log2(total / (f64::from(n) + 0.5)) as f32).collect()
}

pub(crate) fn count_uses(hits: &[Hit], codewords: usize) -> Vec<u32> {
    let mut uses = vec![0u32; codewords];
    hits.iter().for_each(|h| uses[h.id as usize] += 1);
    uses
}

/// The codeword of least weight * squared distance + lambda * length for every point. The cost
/// of a hit is divided by the point's weight.
pub(crate) fn assign(
    points: &[Feature],
    weights: &[f32],
    codewords: &[Feature],
    lengths: &[f32],
    lambda: f64,
) -> Vec<Hit> {
    let tree = Nearest::with_penalties(codewords, lengths);
    let mut hits = vec![Hit { id: 0, cost: 0.0 }; points.len()];
    hits.par_chunks_mut(CHUNK).enumerate().for_each(|(chunk, out)| {
        let first = chunk * CHUNK;
        for (k, hit) in out.iter_mut().enumerate() {
            *hit = tree.find_penalised(&points[first + k], price(lambda, weights[first + k]));
        }
    });
    hits
}

/// Price of a bit in squared distance of a point of this weight. It is limited, so that costs stay
/// finite and can be compared; at the limit only the length counts.
fn price(lambda: f64, weight: f32) -> f32 {
    const LARGEST: f64 = 1e6;
    let price = lambda / f64::from(weight);
    if price < LARGEST { price as f32 } else { LARGEST as f32 }
}

/// Alternates entropy-constrained assignment and means from the nearest-centre assignment
/// `hits`; centres that lose all their points are removed.
pub(crate) fn train(
    points: &[Feature],
    weights: &[f32],
    centres: &mut Vec<Feature>,
    lambda: f64,
    iterations: usize,
) {
    let plain = crate::kmeans::assign(points, centres, None);
    let mut uses = count_uses(&plain, centres.len());
    for _ in 0..iterations {
        let lengths: Vec<f32> = index_lengths(&uses)
            .into_iter()
            .zip(&uses)
            .map(|(length, &n)| length + (TABLE_BITS / f64::from(n.max(1))) as f32)
            .collect();
        let hits = assign(points, weights, centres, &lengths, lambda);
        uses = count_uses(&hits, centres.len());
        move_to_means(points, weights, &hits, centres);
        let mut alive = uses.iter().map(|&n| n > 0);
        centres.retain(|_| alive.next().unwrap_or(false));
        uses.retain(|&n| n > 0);
    }
}
