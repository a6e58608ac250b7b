//! Gaussians where they are needed: *3D Gaussian Splatting as Markov Chain Monte Carlo* (Kheradmand et al. 2024).
//!
//! Gaussians that have faded move to others, which are drawn in proportion to their opacities, and the number of
//! Gaussians grows in the same way. Those at one place share what was one Gaussian (section 3.2, equation 9, of
//! which the render is nearly the same). Noise on the means lets faded Gaussians wander (equation 8).

use finetune::optimiser::{AdamMoments, SplitMix};
use gs_model::Scene;
use gs_model::math::rotation;

use super::begin::logit;

/// A Gaussian of at most this opacity has faded.
const FADED: f32 = 0.005;
/// Most Gaussians that share one place.
const MOST_SHARERS: usize = 51;
/// Greatest opacity after sharing.
const MOST_OPACITY: f32 = 1.0 - f32::EPSILON;
/// Noise over the rate of the means, and how it falls with the opacity: a sigmoid of this slope.
const NOISE: f32 = 5e5;
const SLOPE: f32 = 100.0;
/// Above this opacity there is no noise that matters.
const STILL: f32 = 0.15;

fn opacity(logit: f32) -> f32 {
    1.0 / (1.0 + libm::expf(-logit))
}

/// Moves all Gaussians that have faded to others. Says how many.
pub(super) fn relocate(
    scene: &mut Scene,
    moments: &mut AdamMoments,
    random: &mut SplitMix,
) -> usize {
    let faded: Vec<usize> =
        (0..scene.len()).filter(|&i| opacity(scene.opacity_logits[i]) <= FADED).collect();
    if faded.len() < scene.len() {
        share(scene, moments, random, &faded);
    }
    faded.len()
}

/// Adds `more` Gaussians.
pub(super) fn grow(
    scene: &mut Scene,
    moments: &mut AdamMoments,
    random: &mut SplitMix,
    more: usize,
) {
    let old = scene.len();
    if old == 0 {
        return;
    }
    scene.append(&scene.select(&vec![0; more]));
    let stride = moments.first.len() / old;
    for all in [&mut moments.first, &mut moments.second] {
        all.resize(stride * (old + more), 0.0);
    }
    // The new Gaussians have an opacity of 0 until they have a place.
    scene.opacity_logits[old..].fill(f32::NEG_INFINITY);
    let places: Vec<usize> = (old..old + more).collect();
    share(scene, moments, random, &places);
}

/// Draws for each Gaussian of `newcomers` one of the others, in proportion to their opacities, and puts it there.
fn share(scene: &mut Scene, moments: &mut AdamMoments, random: &mut SplitMix, newcomers: &[usize]) {
    let mut weights: Vec<f64> =
        scene.opacity_logits.iter().map(|&l| f64::from(opacity(l))).collect();
    newcomers.iter().for_each(|&i| weights[i] = 0.0);
    let hosts = drawn(&weights, newcomers.len(), random);
    // Equal hosts follow each other.
    let stride = moments.first.len() / scene.len();
    let mut rest = newcomers;
    for group in hosts.chunk_by(|a, b| a == b) {
        let (guests, others) = rest.split_at(group.len());
        rest = others;
        let host = group[0];
        let (logit, by) = shared(scene.opacity_logits[host], (group.len() + 1).min(MOST_SHARERS));
        scene.opacity_logits[host] = logit;
        scene.log_scales[host].iter_mut().for_each(|s| *s += by);
        for all in [&mut moments.first, &mut moments.second] {
            all[host * stride..(host + 1) * stride].fill(0.0);
        }
        guests.iter().for_each(|&guest| copy(scene, host, guest));
    }
}

fn copy(scene: &mut Scene, from: usize, to: usize) {
    scene.means[to] = scene.means[from];
    scene.rotations[to] = scene.rotations[from];
    scene.log_scales[to] = scene.log_scales[from];
    scene.opacity_logits[to] = scene.opacity_logits[from];
    let k = scene.sh_len();
    scene.sh.copy_within(from * k..(from + 1) * k, to * k);
}

/// `count` indices in proportion to weights, ascending.
fn drawn(weights: &[f64], count: usize, random: &mut SplitMix) -> Vec<usize> {
    let sum: f64 = weights.iter().sum();
    let mut at: Vec<f64> = (0..count).map(|_| sum * random.uniform()).collect();
    at.sort_unstable_by(f64::total_cmp);
    let (mut out, mut i, mut reached) = (Vec::with_capacity(count), 0, weights[0]);
    for at in at {
        while at >= reached && i + 1 < weights.len() {
            i += 1;
            reached += weights[i];
        }
        out.push(i);
    }
    out
}

/// The logit of each of `n` Gaussians that share the place of one, and what is added to its log-scales.
fn shared(from: f32, n: usize) -> (f32, f32) {
    let before = f64::from(opacity(from));
    let each = 1.0 - libm::pow(1.0 - before, 1.0 / n as f64);
    let mut sum = 0.0;
    for i in 0..n {
        // Binomial coefficients of i, one after the other.
        let (mut binomial, mut power) = (1.0, each);
        for k in 0..=i {
            let sign = if k % 2 == 0 { 1.0 } else { -1.0 };
            sum += sign * binomial * power / ((k + 1) as f64).sqrt();
            binomial *= (i - k) as f64 / (k + 1) as f64;
            power *= each;
        }
    }
    let each = (each as f32).clamp(FADED, MOST_OPACITY);
    (logit(each), libm::log(before / sum) as f32)
}

/// The noise on the mean of Gaussian `i`, in world units, at a rate of the means.
pub(super) fn noise(scene: &Scene, i: usize, rate: f32, mut random: SplitMix) -> Option<[f32; 3]> {
    let opacity = opacity(scene.opacity_logits[i]);
    if opacity > STILL {
        return None;
    }
    let size = NOISE * rate / (1.0 + libm::expf(SLOPE * (opacity - FADED)));
    let [x, y] = random.normal();
    let [z, _] = random.normal();
    let axes = rotation(scene.rotations[i]);
    let variances = scene.log_scales[i].map(|s| libm::exp(2.0 * f64::from(s)));
    // The covariance times the noise.
    let along = |k: usize| variances[k] * (0..3).map(|j| axes[j][k] * [x, y, z][j]).sum::<f64>();
    let along = [along(0), along(1), along(2)];
    let moved = |j: usize| size * (0..3).map(|k| axes[j][k] * along[k]).sum::<f64>() as f32;
    Some([moved(0), moved(1), moved(2)])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn those_that_share_a_place_cover_what_one_did() {
        for (from, n) in [(-3.0f32, 2), (0.0, 2), (2.0, 5), (6.0, 51)] {
            let (each, by) = shared(from, n);
            // Behind all of them is as much light as behind the one, at the centre.
            let left = libm::pow(1.0 - f64::from(opacity(each)), n as f64);
            assert!((1.0 - left - f64::from(opacity(from))).abs() < 1e-3, "{from} {n}");
            assert!(by.is_finite() && by <= 1e-6, "{from} {n}: {by}");
        }
        let (alone, by) = shared(1.5, 1);
        assert!((alone - 1.5).abs() < 1e-5 && by.abs() < 1e-6);
    }

    #[test]
    fn faded_gaussians_move_to_opaque_ones_and_new_ones_too() {
        let mut scene = testing::trained_like(50, 1, &mut testing::Rng::seeded(3));
        scene.opacity_logits.fill(-20.0);
        scene.opacity_logits[7] = 2.0;
        scene.opacity_logits[9] = 2.0;
        let mut moments = AdamMoments::zeros(50 * 23);
        moments.first.fill(1.0);
        let mut random = SplitMix::new(1);
        let homes = [scene.means[7], scene.means[9]];
        assert_eq!(relocate(&mut scene, &mut moments, &mut random), 48);
        grow(&mut scene, &mut moments, &mut random, 30);
        scene.validate().unwrap();
        assert_eq!((scene.len(), moments.second.len()), (80, 80 * 23));
        assert!(scene.means.iter().all(|m| homes.contains(m)));
        assert!(scene.means.contains(&homes[0]) && scene.means.contains(&homes[1]));
        assert!(moments.first[7 * 23..8 * 23].iter().all(|&m| m == 0.0));
    }

    #[test]
    fn a_scene_of_faded_gaussians_stays_and_opaque_ones_do_not_wander() {
        let mut scene = testing::trained_like(5, 0, &mut testing::Rng::seeded(3));
        scene.opacity_logits.fill(-20.0);
        let before = scene.clone();
        relocate(&mut scene, &mut AdamMoments::zeros(5 * 14), &mut SplitMix::new(1));
        assert_eq!(scene, before);
        assert!(noise(&scene, 0, 1e-4, SplitMix::new(2)).is_some());
        scene.opacity_logits[0] = 1.0;
        assert!(noise(&scene, 0, 1e-4, SplitMix::new(2)).is_none());
    }
}
