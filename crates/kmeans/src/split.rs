//! The start: one cluster of all points, of which those that cost most are halved until there are enough.

use rayon::prelude::*;

use crate::squared_distance;

/// A round halves all clusters that cost at least this part of the most costly one.
const COSTLY: f64 = 0.6;
/// Most turns of k-means between two halves.
const TURNS: usize = 3;

struct Group {
    /// Sum of weight times squared distance to the mean; 0 if it cannot be halved.
    cost: f64,
    points: Vec<u32>,
}

/// The cluster of each point, at most `count` clusters; fewer if there are fewer distinct points.
pub(crate) fn split<const D: usize>(
    points: &[[f32; D]],
    weights: &[f32],
    count: usize,
) -> Vec<u32> {
    let all = Group { cost: f64::INFINITY, points: (0..points.len() as u32).collect() };
    let mut groups = vec![all];
    while groups.len() < count {
        groups.sort_by(|a, b| b.cost.total_cmp(&a.cost).then(a.points.cmp(&b.points)));
        let least = COSTLY * groups[0].cost;
        let costly = groups.iter().take_while(|g| g.cost > 0.0 && g.cost >= least).count();
        let halved = costly.min(count - groups.len());
        if halved == 0 {
            break;
        }
        let rest = groups.split_off(halved);
        groups = groups.par_iter().flat_map_iter(|g| halves(points, weights, &g.points)).collect();
        groups.extend(rest);
    }
    let mut of_point = vec![0; points.len()];
    for (k, group) in (0..).zip(&groups) {
        group.points.iter().for_each(|&i| of_point[i as usize] = k);
    }
    of_point
}

/// Weight, and of each coordinate the mean and the sum of weight times squared difference from it.
fn spread<const D: usize>(
    points: &[[f32; D]],
    weights: &[f32],
    ids: &[u32],
) -> (f64, [f64; D], [f64; D]) {
    // Relative to the first point, squares of coordinates far from zero lose nothing.
    let (origin, mut mass) = (points[ids[0] as usize], 0.0);
    let (mut sum, mut square) = ([0.0f64; D], [0.0f64; D]);
    for &i in ids {
        let (point, weight) = (&points[i as usize], f64::from(weights[i as usize]));
        mass += weight;
        for k in 0..D {
            let d = f64::from(point[k]) - f64::from(origin[k]);
            sum[k] += weight * d;
            square[k] += weight * d * d;
        }
    }
    let mean = std::array::from_fn(|k| f64::from(origin[k]) + sum[k] / mass);
    (mass, mean, std::array::from_fn(|k| square[k] - sum[k] * sum[k] / mass))
}

/// The two halves of a cluster: on both sides of its mean along the coordinate that spreads most, then by k-means.
fn halves<const D: usize>(points: &[[f32; D]], weights: &[f32], ids: &[u32]) -> Vec<Group> {
    let (_, mean, squares) = spread(points, weights, ids);
    let axis = (1..D).fold(0, |most, k| if squares[k] > squares[most] { k } else { most });
    let beyond = |&i: &u32| f64::from(points[i as usize][axis]) > mean[axis];
    let mut parts: [Vec<u32>; 2] = ids.iter().partition(|i| beyond(i)).into();
    for _ in 0..TURNS {
        if parts.iter().any(Vec::is_empty) {
            break;
        }
        let [a, b] = parts.each_ref().map(|part| spread(points, weights, part).1.map(|v| v as f32));
        let first = |&i: &u32| {
            let point = &points[i as usize];
            squared_distance(point, &a) < squared_distance(point, &b)
        };
        let new: [Vec<u32>; 2] = ids.iter().partition(|i| first(i)).into();
        if std::mem::replace(&mut parts, new) == parts {
            break;
        }
    }
    let whole = parts.iter().any(Vec::is_empty);
    let group = |points_of: Vec<u32>| {
        let cost = match points_of.len() {
            1 => 0.0,
            _ if whole => 0.0,
            _ => spread(points, weights, &points_of).2.iter().sum::<f64>().max(0.0),
        };
        Group { cost, points: points_of }
    };
    parts.into_iter().filter(|part| !part.is_empty()).map(group).collect()
}
