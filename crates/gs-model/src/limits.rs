//! Values at the limits of their range: an opacity of 0 or 1, a scale of 0, a quaternion of extreme length.
//!
//! Their logits and logarithms are infinite, as are squares of the quaternion, and writers leave them so. Such Gaussians
//! are valid. Here they get numbers that look the same.

use rayon::prelude::*;

use crate::math::unit_quaternion;
use crate::scene::Scene;
use crate::validate::has_direction;

/// The logit that stands for an opacity of 1, and its negative for one of 0.
///
/// The sigmoid of -10 is 4.5e-5, far below the 1/255 under which a Gaussian is not drawn, and
/// that of +10 is as near to 1, above the 0.99 at which renderers cap alpha.
pub const CLAMPED_OPACITY_LOGIT: f32 = 10.0;

/// Natural logarithm of a disc's thickness, relative to the shortest of its other axes.
pub(crate) const LOG_THICKNESS: f32 = -6.907_755_4;

/// The log-scales of a Gaussian all of whose scales are 0: that of the least normal float.
const POINT: f32 = -87.336_55;

/// A log-scale below this is no logarithm but stands for that of 0. That of the least double is -745.
const BELOW_LOGARITHMS: f32 = -1e6;

/// How many Gaussians had values at a limit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Limits {
    /// Of an opacity of 1: logit +inf.
    pub opaque: usize,
    /// Of an opacity of 0: logit -inf.
    pub transparent: usize,
    /// With one or two scales of 0: log-scale -inf, or below any logarithm, such as the lowest float.
    pub flat: usize,
    /// With three scales of 0.
    pub points: usize,
    /// With a quaternion so long or short that floats do not hold its square.
    pub scaled: usize,
}

impl Limits {
    /// Counts those of other Gaussians too.
    #[must_use]
    pub(crate) fn plus(self, other: Self) -> Self {
        Self {
            opaque: self.opaque + other.opaque,
            transparent: self.transparent + other.transparent,
            flat: self.flat + other.flat,
            points: self.points + other.points,
            scaled: self.scaled + other.scaled,
        }
    }

    /// What became of them: a sentence for each kind that there is.
    #[must_use]
    pub fn sentences(self) -> Vec<String> {
        let say = |n: usize, one: &str, many: &str, then: &str| {
            (n > 0).then(|| format!("{n} {}; read as {then}", if n == 1 { one } else { many }))
        };
        let all = [
            say(self.opaque, "opacity is infinite", "opacities are infinite", "the largest"),
            say(
                self.transparent,
                "opacity is minus infinity",
                "opacities are minus infinity",
                "the smallest",
            ),
            say(
                self.flat,
                "Gaussian has a scale of 0",
                "Gaussians have a scale of 0",
                "a thousandth of the shortest other scale",
            ),
            say(
                self.points,
                "Gaussian has three scales of 0",
                "Gaussians have three scales of 0",
                "the smallest size",
            ),
            say(
                self.scaled,
                "rotation is a quaternion of extreme length",
                "rotations are quaternions of extreme length",
                "those of length 1",
            ),
        ];
        all.into_iter().flatten().collect()
    }
}

impl Scene {
    /// Replaces infinite opacity logits by plus or minus [`CLAMPED_OPACITY_LOGIT`], the log-scales of axes without extent
    /// by that of a thin disc, and quaternions of extreme length by those of length 1. Returns how many there were. An
    /// infinite scale and a rotation of zeros stay: they are invalid.
    pub fn clamp_limits(&mut self) -> Limits {
        let logits = self.opacity_logits.par_iter_mut().with_min_len(1 << 14);
        let opacities = logits.filter(|l| l.is_infinite()).map(|logit| {
            let opaque = usize::from(*logit > 0.0);
            *logit = CLAMPED_OPACITY_LOGIT.copysign(*logit);
            Limits { opaque, transparent: 1 - opaque, ..Limits::default() }
        });
        let opacities = opacities.reduce(Limits::default, Limits::plus);
        let scales = self.log_scales.par_iter_mut().with_min_len(1 << 14);
        let scales = scales.map(thicken).reduce(Limits::default, Limits::plus);
        let rotations = self.rotations.par_iter_mut().with_min_len(1 << 14);
        let scaled = rotations.map(|q| usize::from(shorten(q))).sum();
        scales.plus(opacities).plus(Limits { scaled, ..Limits::default() })
    }
}

/// Whether a Gaussian has no extent at all: its three log-scales are those that [`Scene::clamp_limits`] gives a point.
/// The size of such a Gaussian says nothing about the sizes in a model.
#[must_use]
pub fn is_point(log_scales: [f32; 3]) -> bool {
    log_scales.iter().all(|&s| s <= POINT)
}

/// Gives a quaternion of extreme length the length 1, and says whether it was one.
fn shorten(q: &mut [f32; 4]) -> bool {
    let extreme = !has_direction(q) && q.iter().all(|v| v.is_finite()) && *q != [0.0; 4];
    if extreme {
        *q = unit_quaternion(q.map(f64::from)).map(|v| v as f32);
    }
    extreme
}

/// Gives the axes of a Gaussian that have no extent a little of it.
fn thicken(log_scales: &mut [f32; 3]) -> Limits {
    let is_zero = |s: f32| s < BELOW_LOGARITHMS;
    if !log_scales.iter().any(|&s| is_zero(s)) {
        return Limits::default();
    }
    let others = log_scales.iter().copied().filter(|&s| !is_zero(s));
    let least = others.fold(f32::INFINITY, f32::min);
    let thin = match least.is_finite() {
        true => (least + LOG_THICKNESS).max(BELOW_LOGARITHMS),
        false => POINT,
    };
    log_scales.iter_mut().filter(|s| is_zero(**s)).for_each(|s| *s = thin);
    let points = usize::from(!least.is_finite());
    Limits { points, flat: 1 - points, ..Limits::default() }
}
