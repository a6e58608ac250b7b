//! Points to centres, centres to means, in turns.
//!
//! Only points run in parallel, and they do not depend on each other; sums are taken in point order. So the result does
//! not depend on the number of threads.

use multiversion::multiversion;
use rayon::prelude::*;

use crate::rng::SplitMix64;
use crate::split::split;
use crate::squared_distance;
use crate::tree::{Hit, Tree};

/// Points handed to a thread at a time.
const CHUNK: usize = 4096;
/// Seed of all random choices.
const SEED: u64 = 0;
/// Most turns.
const TURNS: usize = 10;
/// Turns end when one lowers the cost by less than this part of it.
const TOLERANCE: f64 = 2e-3;

/// Clusters of points.
#[derive(Debug, Clone, PartialEq)]
pub struct Clusters<const D: usize> {
    /// The weighted means of the points of each cluster.
    pub centres: Vec<[f32; D]>,
    /// The cluster of each point.
    pub of_point: Vec<u32>,
}

/// At most `count` clusters of finite points, fewer than 2^32, whose weights (one each) are greater than zero. There are
/// fewer clusters if there are fewer distinct points. The sum of weight times squared distance to the centre is that of
/// a good local minimum; see the README for figures.
pub fn cluster<const D: usize>(points: &[[f32; D]], weights: &[f32], count: usize) -> Clusters<D> {
    if points.is_empty() || count == 0 {
        return Clusters { centres: Vec::new(), of_point: Vec::new() };
    }
    let mut of_point = split(points, weights, count);
    let clusters = of_point.iter().max().map_or(0, |&last| last as usize + 1);
    let mut centres = vec![[0.0; D]; clusters];
    move_to_means(points, weights, &of_point, &mut centres);
    let mut rng = SplitMix64::new(SEED);
    let mut before = f64::INFINITY;
    for _ in 0..TURNS {
        let tree = Tree::new(&centres, &mut rng);
        let hits = assign(points, &centres, &of_point, &tree);
        of_point = hits.iter().map(|hit| hit.id).collect();
        let cost = |(hit, &w): (&Hit, &f32)| f64::from(w) * f64::from(hit.cost);
        let now: f64 = hits.iter().zip(weights).map(cost).sum();
        let empty = move_to_means(points, weights, &of_point, &mut centres);
        revive(points, weights, &hits, &mut of_point, &mut centres, &empty);
        if empty.is_empty() && before - now <= TOLERANCE * now {
            break;
        }
        before = now;
    }
    move_to_means(points, weights, &of_point, &mut centres);
    Clusters { centres, of_point }
}

/// A centre for each point: its own, or a nearer one.
fn assign<const D: usize>(
    points: &[[f32; D]],
    centres: &[[f32; D]],
    of_point: &[u32],
    tree: &Tree<D>,
) -> Vec<Hit> {
    let parts = points.par_chunks(CHUNK).zip(of_point.par_chunks(CHUNK));
    parts.flat_map_iter(|(points, of_point)| hits(points, centres, of_point, tree)).collect()
}

/// As [`assign`], of some points.
#[multiversion(targets("x86_64+avx2"))]
fn hits<const D: usize>(
    points: &[[f32; D]],
    centres: &[[f32; D]],
    of_point: &[u32],
    tree: &Tree<D>,
) -> Vec<Hit> {
    let mut hits = Vec::with_capacity(points.len());
    for (point, &id) in points.iter().zip(of_point) {
        let mut hit = Hit { id, cost: squared_distance(point, &centres[id as usize]) };
        tree.improve(point, &mut hit);
        hits.push(hit);
    }
    hits
}

/// Every centre becomes the weighted mean of its points; returns those that have none.
fn move_to_means<const D: usize>(
    points: &[[f32; D]],
    weights: &[f32],
    of_point: &[u32],
    centres: &mut [[f32; D]],
) -> Vec<u32> {
    let mut sums = vec![[0.0f64; D]; centres.len()];
    let mut mass = vec![0.0f64; centres.len()];
    for ((point, &weight), &id) in points.iter().zip(weights).zip(of_point) {
        let (w, c) = (f64::from(weight), id as usize);
        mass[c] += w;
        sums[c].iter_mut().zip(point).for_each(|(sum, &v)| *sum += w * f64::from(v));
    }
    let mut empty = Vec::new();
    for (c, centre) in centres.iter_mut().enumerate() {
        if mass[c] > 0.0 {
            *centre = sums[c].map(|s| (s / mass[c]) as f32);
        } else {
            empty.push(c as u32);
        }
    }
    empty
}

/// Gives centres without points the points that cost most, one each.
fn revive<const D: usize>(
    points: &[[f32; D]],
    weights: &[f32],
    hits: &[Hit],
    of_point: &mut [u32],
    centres: &mut [[f32; D]],
    empty: &[u32],
) {
    let cost = |i: u32| weights[i as usize] * hits[i as usize].cost;
    let mut costly: Vec<u32> = match empty {
        [] => return,
        _ => (0..points.len() as u32).filter(|&i| cost(i) > 0.0).collect(),
    };
    costly.sort_unstable_by(|&a, &b| cost(b).total_cmp(&cost(a)).then(a.cmp(&b)));
    for (&c, &i) in empty.iter().zip(&costly) {
        of_point[i as usize] = c;
        centres[c as usize] = points[i as usize];
    }
}
