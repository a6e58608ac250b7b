//! From covariances and sensitivities to the centres of clusters.

use kmeans::SplitMix64;
use rayon::prelude::*;

use crate::covariance::{Covariance, Feature};
use crate::error::{Error, Result};
use crate::nearest::CHUNK;

/// Seed of all random choices.
const SEED: u64 = 0;
/// Covariances drawn for the clustering; at least 16 a centre are taken if there are as many.
const SAMPLE: usize = 1 << 18;

pub(crate) fn check(covariances: &[Covariance], sensitivities: &[f32]) -> Result<()> {
    let (covariances, others) = (covariances.len(), sensitivities.len());
    if covariances != others {
        return Err(Error::LengthMismatch { covariances, sensitivities: others });
    }
    let bad = |value: f32| !(value.is_finite() && value >= 0.0);
    if let Some(index) = sensitivities.iter().position(|&s| bad(s)) {
        return Err(Error::BadSensitivity { index, value: sensitivities[index] });
    }
    // Indices are u32, and the top bit is taken in the search tree.
    if covariances == 0 || covariances >= 1 << 31 {
        return Err(Error::BadCount { count: covariances });
    }
    Ok(())
}

/// At most `count` centres, of clusters of a sample.
pub(crate) fn centres(
    covariances: &[Covariance],
    sensitivities: &[f32],
    count: usize,
) -> Vec<Feature> {
    let mut rng = SplitMix64::new(SEED);
    let drawn = sample(covariances.len(), SAMPLE.max(16 * count), &mut rng);
    let feature = |&i: &u32| covariances[i as usize].feature();
    let points: Vec<Feature> = drawn.par_iter().with_min_len(CHUNK).map(feature).collect();
    let weights = weights(drawn.iter().map(|&i| sensitivities[i as usize]).collect());
    kmeans::cluster(&points, &weights, count).centres
}

/// Sensitivities over their maximum. Where all are zero, every point counts the
/// same; a point of zero sensitivity among others still counts a little, or it could end up
/// anywhere.
fn weights(mut sensitivities: Vec<f32>) -> Vec<f32> {
    const LEAST: f32 = 1e-9;
    let largest = sensitivities.iter().copied().fold(0.0, f32::max);
    let weight = |s: f32| if largest > 0.0 { (s / largest).max(LEAST) } else { 1.0 };
    sensitivities.iter_mut().for_each(|s| *s = weight(*s));
    sensitivities
}

/// `wanted` of the numbers below `len` in order, every subset equally likely (Knuth's algorithm S),
/// or all.
fn sample(len: usize, wanted: usize, rng: &mut SplitMix64) -> Vec<u32> {
    if len <= wanted {
        return (0..len as u32).collect();
    }
    let mut drawn = Vec::with_capacity(wanted);
    for i in 0..len {
        if rng.below(len - i) < wanted - drawn.len() {
            drawn.push(i as u32);
        }
    }
    drawn
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_are_even_subsets() {
        let mut uses = vec![0; 1000];
        let mut rng = SplitMix64::new(5);
        for _ in 0..400 {
            let drawn = sample(1000, 100, &mut rng);
            assert_eq!(drawn.len(), 100);
            assert!(drawn.windows(2).all(|p| p[0] < p[1]));
            drawn.iter().for_each(|&i| uses[i as usize] += 1);
        }
        // Expected 40 each, standard deviation 6.
        assert!(uses.iter().all(|uses| (12..=70).contains(uses)));
        assert_eq!(sample(1000, 1000, &mut rng).len(), 1000);
    }

    #[test]
    fn weights_are_positive() {
        assert_eq!(weights(vec![0.0, 2.0, 4.0]), [1e-9, 0.5, 1.0]);
        assert_eq!(weights(vec![0.0; 2]), [1.0; 2]);
    }
}
