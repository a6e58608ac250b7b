//! Virtual viewpoints: how much a place shows, where no cameras are known.
//!
//! Cameras of a capture stand where the content is, at the content's own scale, and look at it. So
//! a few viewpoints are put where the Gaussians are dense, each with the distance within which a
//! tenth of all Gaussians lie as its scale. Around a viewpoint a place shows the less the farther it is,
//! and a length counts as a share of the scale.
//!
//! *Invariant:* scaling the scene scales all results alike, and two far apart copies of a scene, one of them
//! larger, show alike. Viewpoints are found in the order of the scene, and sums run over them in order, so
//! the result does not depend on the number of threads.

use rayon::prelude::*;

/// Number of viewpoints. The estimate costs this many distances per Gaussian.
const VIEWPOINTS: usize = 16;
/// Means that viewpoints are chosen from, and whose distances give a viewpoint its scale.
const SAMPLES: usize = 1024;
/// Share of the Gaussians that lie within the scale of a viewpoint.
const NEAR: f64 = 0.1;

/// A place with the scale of what is around it.
struct Viewpoint {
    at: [f64; 3],
    /// The reciprocal of the squared scale.
    per_scale_squared: f64,
    /// The reciprocal of the scale.
    per_scale: f64,
}

/// How large a length at each mean appears, in any unit: for a viewpoint at distance `d` with scale
/// `s` it is `(1 + d^2/s^2)^(-3/2) / s`, summed over the viewpoints. An exponent of -1/2 would be
/// perspective; cameras that look at the middle of the content show what is around it more rarely
/// still (-1.2 to -1.7 fits the training cameras of fox, bonsai and the room).
pub(crate) fn magnification(means: &[[f32; 3]]) -> Vec<f64> {
    let viewpoints = viewpoints(means);
    if viewpoints.is_empty() {
        return vec![1.0; means.len()];
    }
    means
        .par_iter()
        .map(|mean| {
            let of_one = |v: &Viewpoint| {
                let near = 1.0 / (1.0 + distance_squared(*mean, v.at) * v.per_scale_squared);
                v.per_scale * near * near.sqrt()
            };
            viewpoints.iter().map(of_one).sum()
        })
        .collect()
}

fn viewpoints(means: &[[f32; 3]]) -> Vec<Viewpoint> {
    let step = means.len().div_ceil(SAMPLES).max(1);
    let finite = |p: &&[f32; 3]| p.iter().all(|x| x.is_finite());
    let samples: Vec<[f32; 3]> = means.iter().step_by(step).filter(finite).copied().collect();
    let near = (NEAR * samples.len() as f64) as usize;
    let chosen = (0..VIEWPOINTS.min(samples.len())).map(|k| {
        let at = samples[(2 * k + 1) * samples.len() / (2 * VIEWPOINTS.min(samples.len()))];
        let at = at.map(f64::from);
        let mut squares: Vec<f64> = samples.iter().map(|&p| distance_squared(p, at)).collect();
        let scale_squared = *squares.select_nth_unstable_by(near, f64::total_cmp).1;
        Viewpoint {
            at,
            per_scale_squared: 1.0 / scale_squared,
            per_scale: 1.0 / scale_squared.sqrt(),
        }
    });
    // Where a tenth of all means are one point, the scale is 0.
    chosen.filter(|v| v.per_scale_squared.is_finite()).collect()
}

fn distance_squared(a: [f32; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|k| (f64::from(a[k]) - b[k]) * (f64::from(a[k]) - b[k])).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use testing::{Rng, trained_like};

    #[test]
    fn a_copy_far_away_and_larger_shows_alike() {
        let one = trained_like(4000, 0, &mut Rng::seeded(5)).means;
        let far = one.iter().map(|p| [10.0 * p[0] + 1e6, 10.0 * p[1], 10.0 * p[2]]);
        let two: Vec<[f32; 3]> = one.iter().copied().chain(far).collect();
        let shows = magnification(&two);
        let mean = |part: &[f64]| part.iter().sum::<f64>() / part.len() as f64;
        let ratio = mean(&shows[..4000]) / mean(&shows[4000..]);
        assert!((8.0..12.0).contains(&ratio), "{ratio}: a length is 10 times as large there");
    }

    #[test]
    fn one_point_and_no_point() {
        assert!(magnification(&[]).is_empty());
        assert_eq!(magnification(&[[3.0; 3]; 50]), vec![1.0; 50]);
        let broken = magnification(&[[f32::NAN; 3], [0.0; 3], [1.0; 3]]);
        assert!(broken[1..].iter().all(|v| v.is_finite()));
    }
}
