//! Importances of Gaussians, and their classes: what the encoder decides.

use super::{CLASSES, MEAN_CLASS};
use gs_model::Scene;
use rayon::prelude::*;

/// Gaussians of a neighbourhood, for [`without_cameras`].
const NEIGHBOURHOOD: usize = 128;
/// Powers of opacity, of relative area and of the area of the neighbours in [`without_cameras`], chosen for the least
/// loss on any of eleven scenes.
const OPACITY_POWER: f64 = 1.1;
const AREA_POWER: f64 = 0.75;
const AROUND_POWER: f64 = 0.5;
/// Greatest distance of the logarithm of the neighbours' area from the median: a sky counts as large, whatever its size.
const MAX_LOG_AROUND: f64 = 2.0;
/// Logarithm of the greatest relative area in [`without_cameras`]: a few Gaussians of another part of the scene
/// among the neighbours must not take the precision of all others.
const MAX_LOG_RELATIVE_AREA: f64 = 4.5;
/// The least importance without cameras, in units of that of an opaque Gaussian as large as its neighbours.
/// It bounds the error of the position of faint and small Gaussians to a few times their size.
const MIN_IMPORTANCE: f64 = 1e-3;

/// Importance without cameras: `alpha^1.1 * relative_area^0.75 * around^0.5`. The area is that of the two largest axes,
/// relative to the mean area of the neighbours; `around` is that mean relative to its median over the scene, from
/// `e^-2` to `e^2`.
///
/// Where all is about as far from the cameras, as around an object, large Gaussians show more. In a room and outdoors
/// the size of the neighbours stands for the distance, and area relative to theirs shows. So the size of the
/// neighbours counts within bounds. The result does not depend on the scene's scale. This guess does not know what
/// is hidden. With cameras, the rasterizer's sum of squared blending weights over the training views is better.
#[must_use]
pub fn without_cameras(scene: &Scene) -> Vec<f32> {
    let area = |ls: &[f32; 3]| {
        let thin = ls.iter().copied().fold(f32::INFINITY, f32::min);
        let log_area = f64::from(ls[0]) + f64::from(ls[1]) + f64::from(ls[2]) - f64::from(thin);
        // Trained scenes lie far inside this range. It keeps sums over neighbours finite.
        if log_area.is_nan() { 0.0 } else { log_area.clamp(-80.0, 80.0) }
    };
    let areas: Vec<f64> = scene.log_scales.par_iter().map(area).collect();
    // Means that are not finite: all Gaussians count as neighbours. Voxelization refuses such scenes later.
    let around = voxel::local_means(scene, &areas, NEIGHBOURHOOD).unwrap_or_else(|_| {
        let mean = areas.iter().sum::<f64>() / areas.len().max(1) as f64;
        vec![mean; areas.len()]
    });
    let median = median(around.clone());
    let guess = |((&logit, area), around): ((&f32, f64), f64)| {
        let log_alpha = crate::attributes::opacity::log_alpha_of_logit(logit);
        let log = OPACITY_POWER * log_alpha
            + AREA_POWER * (area - around).min(MAX_LOG_RELATIVE_AREA)
            + AROUND_POWER * (around - median).clamp(-MAX_LOG_AROUND, MAX_LOG_AROUND);
        libm::exp(log.clamp(-80.0, 80.0)).max(MIN_IMPORTANCE) as f32
    };
    scene.opacity_logits.par_iter().zip(areas).zip(around).map(guess).collect()
}

/// The middle one of some values; 0 if there are none.
fn median(mut values: Vec<f64>) -> f64 {
    let middle = values.len() / 2;
    match values.is_empty() {
        true => 0.0,
        false => *values.select_nth_unstable_by(middle, f64::total_cmp).1,
    }
}

/// Greatest importance of a Gaussian that cameras hardly see, relative to the guess: as if at 30 quality points less.
const UNSEEN: f64 = 1.0 / 16.0;
/// What cameras hardly see gets at most this share of the importance at quality 50, and half of that every six points
/// higher: then about the same Gaussians are kept at each quality, and cost at most 2 % of the bytes.
const UNSEEN_SHARE_AT_50: f64 = 1e-3;
const POINTS_PER_HALF: f64 = 6.0;
/// Cameras that see less than this share of the guessed importance may be those of a part, or of another scene: then
/// the share has no bound.
const LEAST_SEEN: f64 = 0.5;

/// Importances from cameras for an encoder that keeps something of what cameras hardly see: at least a part of
/// [`without_cameras`], in the unit of `seen`. Where nothing is seen at all, it is [`without_cameras`].
///
/// `seen` is the rasterizer's sum of squared blending weights, one per Gaussian; what is not a positive
/// number counts as not seen.
#[must_use]
pub fn with_unseen(scene: &Scene, seen: &[f32], quality: f32) -> Vec<f32> {
    let guess = without_cameras(scene);
    let mut unit = UnseenUnit::default();
    unit.add(seen, &guess);
    unit.fill(seen, &guess, quality)
}

/// The importance of what cameras hardly see follows from these sums.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub(crate) struct UnseenUnit {
    seen: f64,
    guessed: f64,
    /// Guesses of what no camera sees.
    unseen: f64,
    /// Guesses by how much is seen relative to the guess, on a logarithmic scale.
    by_ratio: Vec<f64>,
}

/// Bins of [`UnseenUnit`]: four for a factor of two, around 1.
const BINS: usize = 512;
const BINS_PER_OCTAVE: f64 = 4.0;

/// The ratio at the lower end of a bin.
fn ratio_at(bin: usize) -> f64 {
    libm::exp2((bin as f64 - (BINS / 2) as f64) / BINS_PER_OCTAVE)
}

impl UnseenUnit {
    /// Adds some Gaussians.
    pub(crate) fn add(&mut self, seen: &[f32], guess: &[f32]) {
        self.by_ratio.resize(BINS, 0.0);
        for (s, g) in seen.iter().zip(guess).map(|(&s, &g)| (clean(s), f64::from(g))) {
            if s > 0.0 {
                self.seen += s;
                self.guessed += g;
            } else {
                self.unseen += g;
            }
            // A ratio of 0 falls into the first bin.
            let bin = BINS_PER_OCTAVE * libm::log2(s / g) + (BINS / 2) as f64;
            self.by_ratio[(bin.max(0.0) as usize).min(BINS - 1)] += g;
        }
    }

    /// The least importance of a Gaussian, relative to the guess.
    fn least(&self, quality: f32) -> f64 {
        if self.guessed <= 0.0 {
            return 1.0;
        }
        let greatest = UNSEEN * self.seen / self.guessed;
        if self.guessed < LEAST_SEEN * (self.guessed + self.unseen) {
            return greatest;
        }
        let halves = (f64::from(quality) - 50.0) / POINTS_PER_HALF;
        let share = UNSEEN_SHARE_AT_50 * libm::exp2(-halves) * self.seen;
        let (mut below, mut least) = (0.0, 0.0);
        for (bin, guess) in self.by_ratio.iter().enumerate() {
            let ratio = ratio_at(bin);
            if ratio > greatest || ratio * below > share {
                break;
            }
            (least, below) = (ratio, below + guess);
        }
        least
    }

    /// Importances of some Gaussians.
    pub(crate) fn fill(&self, seen: &[f32], guess: &[f32], quality: f32) -> Vec<f32> {
        let least = self.least(quality);
        let pairs = seen.iter().map(|&s| clean(s)).zip(guess);
        pairs.map(|(s, &g)| s.max(least * f64::from(g)) as f32).collect()
    }
}

/// Classes per factor of four in importance. On `fox` at equal rendered error the streams of
/// slopes 0, 0.5, 0.7, 1 are 1.00, 0.87, 0.86, 0.91 in size.
const SLOPE: f64 = 0.7;
/// Lowest class, relative to [`MEAN_CLASS`]: steps are at most `2^3` times the mean one.
const FLOOR: f64 = 3.0;
/// Greatest step of covariances at the lowest class, in log-scale; it matters at qualities below 33. A faint
/// Gaussian whose log-scale errs by more may become as large as its neighbours, and then shows where it did not
/// before. With steps up to 6.4, quality 23 of `fox` was 0.44 dB worse than 22.5.
const GREATEST_STEP: f64 = 4.0;

/// Real-valued classes from importances (any unit; negative and NaN count as 0), relative to
/// their mean. `covariance_step` is that of [`MEAN_CLASS`].
pub(crate) fn log_classes(importance: &[f32], covariance_step: f32) -> Vec<f32> {
    let mean = sum(importance) / importance.len().max(1) as f64;
    log_classes_about(mean, importance, covariance_step)
}

/// The sum of importances.
pub(crate) fn sum(importance: &[f32]) -> f64 {
    importance.iter().map(|&v| clean(v)).sum()
}

/// As [`log_classes`], relative to a mean importance that is given.
pub(crate) fn log_classes_about(mean: f64, importance: &[f32], covariance_step: f32) -> Vec<f32> {
    let floor = libm::log2(GREATEST_STEP / f64::from(covariance_step)).clamp(0.0, FLOOR);
    let lowest = f64::from(MEAN_CLASS) - floor;
    importance
        .par_iter()
        .map(|&v| {
            let v = clean(v);
            if v == 0.0 || mean == 0.0 {
                return lowest as f32;
            }
            let class = f64::from(MEAN_CLASS) + 0.5 * SLOPE * libm::log2(v / mean);
            class.clamp(lowest, f64::from(CLASSES - 1)) as f32
        })
        .collect()
}

/// An importance, or 0 for what is none.
fn clean(importance: f32) -> f64 {
    if importance.is_finite() && importance > 0.0 { f64::from(importance) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rounded(importance: &[f32]) -> Vec<u8> {
        log_classes(importance, 0.1).iter().map(|v| v.round() as u8).collect()
    }

    #[test]
    fn equal_importance_gives_the_mean_class() {
        assert_eq!(rounded(&[3.0; 5]), vec![MEAN_CLASS; 5]);
    }

    #[test]
    fn broken_importances_get_the_lowest_class() {
        let c = rounded(&[f32::NAN, -1.0, 0.0, f32::INFINITY, 1.0]);
        let lowest = MEAN_CLASS - FLOOR as u8;
        assert_eq!(&c[..4], &[lowest; 4]);
        assert!(c[4] > lowest);
        assert_eq!(rounded(&[]), Vec::<u8>::new());
    }

    /// Large Gaussians on a sphere, as large as their distance from each other.
    fn with_sky(content: usize, sky: usize, radius: f32) -> Scene {
        let mut rng = testing::Rng::seeded(9);
        let mut scene = testing::trained_like(content, 0, &mut rng);
        for _ in 0..sky {
            let p: [f32; 3] = std::array::from_fn(|_| rng.signed() + 0.01);
            let length = (p[0] * p[0] + p[1] * p[1] + p[2] * p[2]).sqrt();
            scene.means.push(p.map(|x| radius * x / length));
            scene.rotations.push([1.0, 0.0, 0.0, 0.0]);
            scene.log_scales.push([libm::logf(radius * 0.08); 3]);
            scene.opacity_logits.push(2.0);
            scene.sh.push([0.5; 3]);
        }
        scene
    }

    #[test]
    fn a_sky_takes_little_precision_from_the_foreground() {
        let alone = log_classes(&without_cameras(&with_sky(6000, 0, 1.0)), 0.1);
        for radius in [30.0, 500.0, 20_000.0] {
            let both = log_classes(&without_cameras(&with_sky(6000, 2000, radius)), 0.1);
            let of = |classes: &[f32]| classes.iter().map(|&c| f64::from(c)).sum::<f64>() / 6000.0;
            let lost = of(&alone) - of(&both[..6000]);
            // A class is a factor of two in all steps. Importance from opacity and size alone loses 2 classes.
            assert!(lost < 0.35, "radius {radius}: {lost} classes");
        }
    }

    #[test]
    fn two_desks_far_apart_are_nearly_alike_also_if_one_is_larger() {
        let one = testing::trained_like(4000, 0, &mut testing::Rng::seeded(5));
        let mut both = one.clone();
        both.append(&one);
        for i in 4000..8000 {
            both.means[i] = both.means[i].map(|x| 10.0 * x);
            both.means[i][0] += 1e5;
            both.log_scales[i] = both.log_scales[i].map(|l| l + libm::logf(10.0));
        }
        let importance = without_cameras(&both);
        let sum = |part: &[f32]| part.iter().map(|&v| f64::from(v)).sum::<f64>();
        // Area alone is 100 times as large.
        let ratio = sum(&importance[..4000]) / sum(&importance[4000..]);
        assert!((0.2..5.0).contains(&ratio), "{ratio}");
    }

    #[test]
    fn broken_gaussians_have_an_importance() {
        let mut scene = testing::trained_like(50, 0, &mut testing::Rng::seeded(5));
        scene.means[3] = [f32::NAN; 3];
        scene.log_scales[4] = [f32::INFINITY; 3];
        scene.log_scales[5] = [f32::NAN; 3];
        assert!(without_cameras(&scene).iter().all(|v| v.is_finite() && *v > 0.0));
        assert!(without_cameras(&Scene::default()).is_empty());
    }

    #[test]
    fn what_no_camera_sees_keeps_a_part_of_the_guess() {
        let scene = testing::trained_like(500, 0, &mut testing::Rng::seeded(3));
        let guess = without_cameras(&scene);
        let mut seen = vec![0.0; 500];
        assert_eq!(with_unseen(&scene, &seen, 80.0), guess);
        seen[7] = 3.0;
        seen[8] = f32::NAN;
        let filled = with_unseen(&scene, &seen, 80.0);
        assert_eq!(filled[7], 3.0);
        let unit = 3.0 / 16.0 / guess[7];
        for i in (0..500).filter(|&i| i != 7) {
            assert!((filled[i] / (unit * guess[i]) - 1.0).abs() < 1e-5, "{i}");
        }
    }

    #[test]
    fn what_cameras_hardly_see_takes_a_bounded_share_of_importance() {
        let scene = testing::trained_like(4000, 0, &mut testing::Rng::seeded(3));
        // Four in ten are hardly seen, or not at all.
        let guess = without_cameras(&scene);
        let worth = |i: usize| [0.0, 1e-6, 1e-4, 1e-3, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0][i % 10];
        let seen: Vec<f32> = guess.iter().enumerate().map(|(i, g)| worth(i) * g).collect();
        let total = sum(&seen);
        for quality in [50.0, 62.0, 80.0] {
            let added = (sum(&with_unseen(&scene, &seen, quality)) - total) / total;
            let most = 1e-3 * libm::exp2((50.0 - f64::from(quality)) / 6.0);
            assert!((0.1 * most..=1.001 * most).contains(&added), "{quality}: {added}");
        }
        // Where few Gaussians are unseen, they keep a sixteenth of their guessed importance.
        let seen: Vec<f32> = (0..4000).map(|i| if i == 7 { 0.0 } else { guess[i] }).collect();
        let kept = with_unseen(&scene, &seen, 50.0)[7];
        assert!(kept > 0.8 / 16.0 * guess[7], "{kept}");
    }

    #[test]
    fn a_faint_gaussian_keeps_its_size_at_every_quality() {
        let importance: Vec<f32> = (0..=20).map(|i| libm::powf(10.0, -0.5 * i as f32)).collect();
        for quality in 0..=100 {
            let step = crate::Steps::of_quality(quality as f32).unwrap().covariance;
            let classes = log_classes(&importance, step);
            let lowest = classes.iter().copied().fold(f32::INFINITY, f32::min);
            let greatest = step * libm::exp2f(f32::from(MEAN_CLASS) - lowest);
            assert!(greatest < 4.001, "quality {quality}: {greatest}");
            // Where steps are fine anyway, nothing changes.
            assert!(quality < 34 || lowest == 2.0, "quality {quality}: {lowest}");
        }
    }

    #[test]
    fn a_factor_of_four_is_one_slope() {
        let c = log_classes(&[1.0, 4.0, 16.0], 0.1);
        assert!(
            (c[1] - c[0] - SLOPE as f32).abs() < 1e-6 && (c[2] - c[1] - SLOPE as f32).abs() < 1e-6
        );
    }
}
