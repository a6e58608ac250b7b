//! [`Doubts`]: what makes one doubt that a model is what it seems. Numbers that were stored without logarithm and
//! logit, and positions whose steps are coarse beside the Gaussians.

use crate::limits::is_point;
use crate::scene::{SH_C0, Scene};

/// Fewer Gaussians than this say nothing.
const LEAST: usize = 8;
/// Standard deviation of log-scales below which all Gaussians are about the same size, which no trained model's are.
const ALIKE: f64 = 0.5;
/// A step of positions above this part of a Gaussian's largest axis shows.
const COARSE: f64 = 0.25;
/// Steps are coarse if they are for one Gaussian in so many.
const ONE_IN: usize = 10;

/// Least and greatest of some numbers.
#[derive(Clone, Copy, Debug)]
struct Bounds {
    low: f32,
    high: f32,
}

impl Default for Bounds {
    fn default() -> Self {
        Self { low: f32::INFINITY, high: f32::NEG_INFINITY }
    }
}

impl Bounds {
    fn add(&mut self, values: impl IntoIterator<Item = f32>) {
        for v in values {
            (self.low, self.high) = (self.low.min(v), self.high.max(v));
        }
    }

    fn within(self, low: f32, high: f32) -> bool {
        self.low >= low && self.high <= high
    }
}

/// What was seen of the Gaussians of a model, which may come in parts.
#[derive(Clone, Copy, Debug, Default)]
pub struct Doubts {
    count: usize,
    scales: Bounds,
    scale_sum: f64,
    scale_squares: f64,
    opacities: Bounds,
    colours: Bounds,
    means: [Bounds; 3],
    steps: CoarseSteps,
}

impl Doubts {
    /// Of a whole model.
    #[must_use]
    pub fn of(scene: &Scene) -> Self {
        let mut doubts = Self::default();
        doubts.add(scene);
        doubts
    }

    /// Looks at some valid Gaussians.
    pub(crate) fn add(&mut self, scene: &Scene) {
        self.count += scene.len();
        for &scale in scene.log_scales.as_flattened() {
            self.scales.add([scale]);
            self.scale_sum += f64::from(scale);
            self.scale_squares += f64::from(scale) * f64::from(scale);
        }
        self.opacities.add(scene.opacity_logits.iter().copied());
        for i in 0..scene.len() {
            self.colours.add(scene.sh_of(i)[0]);
            (0..3).for_each(|k| self.means[k].add([scene.means[i][k]]));
        }
        self.steps.add(scene, |i| {
            let far = scene.means[i].into_iter().fold(0f32, |far, x| far.max(x.abs()));
            f64::from(far.next_up()) - f64::from(far)
        });
    }

    /// A sentence for each doubt, without the name of the file.
    #[must_use]
    pub fn sentences(&self) -> Vec<String> {
        if self.count < LEAST {
            return Vec::new();
        }
        let [scales, opacities] = [self.scales_are_activated(), self.opacities_are_activated()];
        let stored = match (scales, opacities) {
            (true, true) => Some(
                "all scales are positive and all opacities between 0 and 1: were they stored without log and logit? \
                 A model has the logarithms of scales and the logits of opacities; export those",
            ),
            (true, false) => Some(
                "all scales are positive, so that the Gaussians are as large as the scene: were they stored without \
                 log? A model has the logarithms of scales; export those",
            ),
            (false, true) => Some(
                "all opacities are between 0 and 1: were they stored without logit? A model has the logits of \
                 opacities; export those",
            ),
            (false, false) => None,
        };
        let mut all: Vec<String> = stored.into_iter().map(Into::into).collect();
        all.extend(self.colours_are_activated().map(|most| {
            format!(
                "all colours are between 0 and {most}: were they stored as colours? A model has SH coefficients, \
                 (colour - 0.5) / {SH_C0:.4} with colours from 0 to 1; export those"
            )
        }));
        if let Some(coarse) = self.steps.found().filter(|_| !scales) {
            all.push(format!(
                "positions come in steps of {} so far from the origin, and the Gaussians are {} wide: subtract an \
                 offset from the positions before training, or export them as doubles",
                short(coarse.step),
                short(coarse.size)
            ));
        }
        all
    }

    fn scales_are_activated(&self) -> bool {
        let Bounds { low, high } = self.scales;
        if low < 0.0 || low == high {
            return false;
        }
        let n = 3.0 * self.count as f64;
        let mean = self.scale_sum / n;
        let spread = (self.scale_squares / n - mean * mean).max(0.0).sqrt();
        let width = self.means.iter().fold(0f32, |most, b| most.max(b.high - b.low));
        spread < ALIKE || mean > libm::log(f64::from(width)) || self.opacities_are_activated()
    }

    fn opacities_are_activated(&self) -> bool {
        let Bounds { low, high } = self.opacities;
        // Opacities that are all the same are those of a tool that has none.
        self.opacities.within(0.0, 1.0) && (low < high || low == 1.0)
    }

    /// The greatest colour, if these are no SH coefficients.
    fn colours_are_activated(&self) -> Option<u32> {
        let Bounds { low, high } = self.colours;
        // SH coefficients within 0 to 1 are colours from 0.5 to 0.78: nothing dark in the scene.
        let unit = self.colours.within(0.0, 1.0) && low < 0.1 && high > 0.9 && self.count >= 100;
        let bytes = self.colours.within(0.0, 255.0) && high > 32.0;
        if bytes { Some(255) } else { unit.then_some(1) }
    }
}

/// Steps of positions beside the sizes of Gaussians: the one place that compares them, for all formats.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct CoarseSteps {
    count: usize,
    coarse: usize,
    log_step: f64,
    log_size: f64,
}

/// Steps of positions that show.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Coarse {
    /// Gaussians of coarse positions.
    pub(crate) gaussians: usize,
    /// The typical step, and the largest axis of these Gaussians, in world units.
    pub(crate) step: f64,
    pub(crate) size: f64,
}

impl CoarseSteps {
    /// Counts Gaussians whose positions come in steps that `step` gives.
    pub(crate) fn add(&mut self, scene: &Scene, step: impl Fn(usize) -> f64) {
        self.count += scene.len();
        for (i, log_scale) in scene.log_scales.iter().enumerate() {
            let largest = log_scale.iter().copied().fold(f32::NEG_INFINITY, f32::max);
            let (step, size) = (step(i), libm::exp(f64::from(largest)));
            if step > COARSE * size && !is_point(*log_scale) {
                self.coarse += 1;
                self.log_step += libm::log(step);
                self.log_size += f64::from(largest);
            }
        }
    }

    /// The coarse Gaussians, if there are enough to be seen.
    pub(crate) fn found(&self) -> Option<Coarse> {
        let n = self.coarse as f64;
        let typical = |sum: f64| libm::exp(sum / n);
        (self.coarse > self.count / ONE_IN).then(|| Coarse {
            gaussians: self.coarse,
            step: typical(self.log_step),
            size: typical(self.log_size),
        })
    }
}

/// The farthest Gaussian is said to be far out if it is so many times as far from the median as half of all are.
const FAR_OUT: f32 = 50.0;

/// A sentence, if positions that a format holds in these steps, one for each Gaussian, show that they do.
pub(crate) fn coarse_when_written(scene: &Scene, steps: &[f64], extension: &str) -> Option<String> {
    if steps.len() != scene.len() {
        return None;
    }
    let mut seen = CoarseSteps::default();
    seen.add(scene, |i| steps[i]);
    let Coarse { gaussians, step, size } = seen.found()?;
    let far = farthest(scene).map_or(String::new(), |i| {
        let [x, y, z] = scene.means[i].map(|v| short(f64::from(v)));
        format!("; Gaussian {i} at ({x}, {y}, {z}) lies far from all others: leave it out")
    });
    Some(format!(
        ".{extension} holds positions in steps of {} here, and {gaussians} of {} Gaussians are about {} wide{far}{} write \
         .ply, which holds them as floats",
        short(step),
        scene.len(),
        short(size),
        if far.is_empty() { ";" } else { ", or" },
    ))
}

/// The Gaussian that is farthest from the median, if it is far out.
fn farthest(scene: &Scene) -> Option<usize> {
    let median = |mut values: Vec<f32>| {
        let middle = values.len() / 2;
        *values.select_nth_unstable_by(middle, f32::total_cmp).1
    };
    if scene.is_empty() {
        return None;
    }
    let centre = [0, 1, 2].map(|k| median(scene.means.iter().map(|m| m[k]).collect()));
    let away = |m: &[f32; 3]| (0..3).map(|k| (m[k] - centre[k]).abs()).fold(0.0, f32::max);
    let distances: Vec<f32> = scene.means.iter().map(away).collect();
    let (at, far) = distances.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1))?;
    (*far > FAR_OUT * median(distances.clone())).then_some(at)
}

/// A number with two significant digits.
pub(crate) fn short(v: f64) -> String {
    if v == 0.0 || !v.is_finite() {
        return v.to_string();
    }
    let digits = (1.0 - libm::floor(libm::log10(v.abs()))).clamp(0.0, 12.0) as usize;
    let text = format!("{v:.digits$}");
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').into() } else { text }
}
