//! From covariances and sensitivities to a codebook.

use super::{Codebook, Codeword, MAX_CODEWORDS, Precision, TrainingReport};
use crate::covariance::{Covariance, Feature, Metric, from_feature};
use crate::error::{Error, Result};
use crate::kmeans::{self, Schedule};
use crate::rng::SplitMix64;
use crate::seeding::kmeans_plus_plus;

/// Which covariances become codewords of their own ("importance include" of Compressed 3DGS)
/// instead of taking part in the clustering.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Keep {
    /// None.
    #[default]
    Nothing,
    /// Those whose sensitivity is larger than this, in the units of the sensitivities given.
    Above(f32),
    /// This share of them, in 0..=1, the most sensitive first (equal ones in order).
    Share(f64),
}

/// How to train a codebook. The defaults are for a file that is encoded once; `cargo bench -p vq`
/// shows time against distortion.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Options {
    /// Codewords to train (K), 1..=2^20; kept ones come on top. The result has fewer if the
    /// data has fewer distinct covariances at the stored precision.
    pub codewords: usize,
    /// Seed of all random choices.
    pub seed: u64,
    /// What is minimised.
    pub metric: Metric,
    /// Covariances that become codewords of their own.
    pub keep: Keep,
    /// Points drawn for the clustering; at least 16 K are taken if there are as many. Kept ones
    /// are not drawn from.
    pub training_sample: usize,
    /// Points of those drawn for the k-means++ start; at least 4 K are taken if there are as many.
    pub seeding_sample: usize,
    /// Points in a mini-batch; with no more points than this there are only full iterations.
    pub batch_size: usize,
    /// Mini-batch steps before the full iterations.
    pub mini_batches: usize,
    /// Most full iterations.
    pub full_iterations: usize,
    /// Full iterations end when one lowers the distortion by less than this part of it.
    pub tolerance: f64,
    /// Bits of each of the three rotation integers of a codeword, 4..=14.
    pub rotation_bits: u8,
    /// Fraction bits of the log-scale integers of a codeword, 2..=10.
    pub log_scale_bits: u8,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            codewords: 4096,
            seed: 0,
            metric: Metric::default(),
            keep: Keep::default(),
            training_sample: 1 << 18,
            seeding_sample: 1 << 17,
            batch_size: 1 << 18,
            mini_batches: 4,
            full_iterations: 8,
            tolerance: 2e-3,
            rotation_bits: 8,
            log_scale_bits: 5,
        }
    }
}

impl Options {
    /// The defaults with K codewords.
    pub fn with_codewords(codewords: usize) -> Self {
        Self { codewords, ..Self::default() }
    }
}

pub(super) fn train(
    covariances: &[Covariance],
    sensitivities: &[f32],
    options: &Options,
) -> Result<(Codebook, TrainingReport)> {
    let precision = Precision::new(options.rotation_bits, options.log_scale_bits)?;
    check(covariances, sensitivities, options)?;
    let (kept, clustered) = split(sensitivities, options.keep);
    if options.codewords + kept.len() > MAX_CODEWORDS {
        return Err(Error::TooManyCodewords { count: options.codewords + kept.len() });
    }

    let mut codewords: Vec<Codeword> =
        kept.iter().map(|&i| precision.quantise(&covariances[i as usize])).collect();
    let mut history = Vec::new();
    if !clustered.is_empty() {
        let mut rng = SplitMix64::new(options.seed);
        let wanted = options.training_sample.max(16 * options.codewords);
        let clustered = sample(&clustered, wanted, &mut rng);
        let chosen: Vec<Covariance> = clustered.iter().map(|&i| covariances[i as usize]).collect();
        let points = super::features(&chosen, options.metric);
        let weights = weights(sensitivities, &clustered);
        let mut centres = seed(&points, &weights, options, &mut rng);
        let schedule = Schedule {
            batch_size: options.batch_size.max(1),
            mini_batches: options.mini_batches,
            full_iterations: options.full_iterations,
            tolerance: options.tolerance,
        };
        history = kmeans::train(&points, &weights, &mut centres, &schedule, &mut rng);
        for centre in centres {
            let covariance = from_feature(centre.map(f64::from), options.metric)?;
            codewords.push(precision.quantise(&covariance));
        }
    }
    let codebook = Codebook::from_codewords(precision, options.metric, codewords);
    Ok((codebook, TrainingReport { kept: kept.len(), weighted_distortion: history }))
}

fn check(covariances: &[Covariance], sensitivities: &[f32], options: &Options) -> Result<()> {
    check_sensitivities(covariances, sensitivities)?;
    // Indices are u32, and the top bit is taken in the search tree.
    if covariances.is_empty() || covariances.len() > (1 << 31) - 1 {
        return Err(Error::BadCount { count: covariances.len() });
    }
    if !(1..=MAX_CODEWORDS).contains(&options.codewords) {
        return Err(Error::TooManyCodewords { count: options.codewords });
    }
    Ok(())
}

/// # Errors
/// [`Error::LengthMismatch`], [`Error::BadSensitivity`].
pub(super) fn check_sensitivities(covariances: &[Covariance], sensitivities: &[f32]) -> Result<()> {
    if covariances.len() != sensitivities.len() {
        return Err(Error::LengthMismatch {
            covariances: covariances.len(),
            others: sensitivities.len(),
        });
    }
    for (index, &value) in sensitivities.iter().enumerate() {
        if !(value.is_finite() && value >= 0.0) {
            return Err(Error::BadSensitivity { index, value });
        }
    }
    Ok(())
}

/// Indices of the covariances to keep and to cluster, both ascending.
fn split(sensitivities: &[f32], keep: Keep) -> (Vec<u32>, Vec<u32>) {
    let all = 0..sensitivities.len() as u32;
    match keep {
        Keep::Nothing => (Vec::new(), all.collect()),
        Keep::Above(threshold) => all.partition(|&i| sensitivities[i as usize] > threshold),
        Keep::Share(share) => {
            let count = (share.clamp(0.0, 1.0) * sensitivities.len() as f64) as usize;
            let mut order: Vec<u32> = all.collect();
            order.sort_unstable_by(|&a, &b| {
                let (sa, sb) = (sensitivities[a as usize], sensitivities[b as usize]);
                sb.total_cmp(&sa).then(a.cmp(&b))
            });
            let mut rest = order.split_off(count.min(order.len()));
            order.sort_unstable();
            rest.sort_unstable();
            (order, rest)
        }
    }
}

/// Sensitivities over their maximum. Where all are zero, every point counts the
/// same; a point of zero sensitivity among others still counts a little, or it could end up
/// anywhere.
fn weights(sensitivities: &[f32], ids: &[u32]) -> Vec<f32> {
    const LEAST: f32 = 1e-9;
    let largest = ids.iter().map(|&i| sensitivities[i as usize]).fold(0.0, f32::max);
    if largest <= 0.0 {
        return vec![1.0; ids.len()];
    }
    let weight = |s: f32| (s / largest).max(LEAST);
    ids.iter().map(|&i| weight(sensitivities[i as usize])).collect()
}

/// k-means++ centres from all points or a sample of them.
fn seed(
    points: &[Feature],
    weights: &[f32],
    options: &Options,
    rng: &mut SplitMix64,
) -> Vec<Feature> {
    let wanted = options.seeding_sample.max(4 * options.codewords);
    let all: Vec<u32> = (0..points.len() as u32).collect();
    let drawn = sample(&all, wanted, rng);
    let from: Vec<Feature> = drawn.iter().map(|&i| points[i as usize]).collect();
    let from_weights: Vec<f32> = drawn.iter().map(|&i| weights[i as usize]).collect();
    let chosen = kmeans_plus_plus(&from, &from_weights, options.codewords, rng);
    chosen.into_iter().map(|i| from[i as usize]).collect()
}

/// `wanted` of the ids in order, every subset equally likely (Knuth's algorithm S), or all.
fn sample(ids: &[u32], wanted: usize, rng: &mut SplitMix64) -> Vec<u32> {
    if ids.len() <= wanted {
        return ids.to_vec();
    }
    let mut drawn = Vec::with_capacity(wanted);
    for (i, &id) in ids.iter().enumerate() {
        if rng.below(ids.len() - i) < wanted - drawn.len() {
            drawn.push(id);
        }
    }
    drawn
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_are_even_subsets() {
        let ids: Vec<u32> = (0..1000).map(|i| 3 * i).collect();
        let mut uses = vec![0; 3000];
        let mut rng = SplitMix64::new(5);
        for _ in 0..400 {
            let drawn = sample(&ids, 100, &mut rng);
            assert_eq!(drawn.len(), 100);
            assert!(drawn.windows(2).all(|p| p[0] < p[1]));
            drawn.iter().for_each(|&i| uses[i as usize] += 1);
        }
        // Expected 40 each, standard deviation 6.
        assert!(ids.iter().all(|&i| (12..=70).contains(&uses[i as usize])));
        assert_eq!(sample(&ids, 1000, &mut rng), ids);
    }

    #[test]
    fn the_kept_share_takes_the_most_sensitive() {
        let sensitivities = [1.0, 5.0, 2.0, 5.0, 0.0];
        assert_eq!(split(&sensitivities, Keep::Share(0.4)), (vec![1, 3], vec![0, 2, 4]));
        assert_eq!(split(&sensitivities, Keep::Share(0.2)), (vec![1], vec![0, 2, 3, 4]));
        assert_eq!(split(&sensitivities, Keep::Above(1.0)), (vec![1, 2, 3], vec![0, 4]));
        assert_eq!(split(&sensitivities, Keep::Nothing).0, vec![]);
    }
}
