//! [`Scene`]: a trained 3DGS model as a struct of arrays, [`SceneMut`]: a part of it, and [`Field`]: one of the arrays.

use std::collections::TryReserveError;
use std::fmt;
use std::ops::Range;

#[cfg(feature = "files")]
use crate::math::{self, axes_product};

/// The constant of the degree-0 spherical harmonic, 1 / (2 sqrt(pi)).
///
/// A Gaussian without view dependence has colour `0.5 + SH_C0 * sh[0]`.
pub const SH_C0: f32 = 0.282_094_79;

/// No rasterizer draws a Gaussian whose opacity logit is below this: its alpha is below 1/255 everywhere. It is -ln 254.
pub const LEAST_DRAWN_LOGIT: f32 = -5.537_334_4;

/// A trained 3DGS model: `len()` Gaussians as a struct of arrays, in training parametrisation.
///
/// Every array has one entry per Gaussian, except [`Scene::sh`], which has
/// [`Scene::sh_len`] consecutive entries per Gaussian.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Scene {
    /// Means (positions), world units.
    pub means: Vec<[f32; 3]>,
    /// Rotations as quaternions `[w, x, y, z]`, not necessarily of unit norm.
    pub rotations: Vec<[f32; 4]>,
    /// Natural logarithms of the three standard deviations, world units.
    pub log_scales: Vec<[f32; 3]>,
    /// Opacity before the sigmoid.
    pub opacity_logits: Vec<f32>,
    /// Highest spherical-harmonic degree, 0 to 3.
    pub sh_degree: u8,
    /// SH coefficients, **coefficient-major RGB**: entry `i * sh_len() + k` is the `[r, g, b]`
    /// triple of basis function `k` of Gaussian `i`; `k = 0` is the DC term. (Inria PLY files
    /// store `f_rest` channel-major; the reader and the writer convert.)
    pub sh: Vec<[f32; 3]>,
    /// Whether the model is trained to be drawn with compensated opacity: a rasterizer blurs each Gaussian by 0.3
    /// pixels squared, and lowers its opacity by as much as that enlarges it (Mip-Splatting; gsplat's mode
    /// `antialiased`).
    pub antialiased: bool,
    /// Where the origin of the means lies in the coordinates of a georeferenced model: what is to be added to the means,
    /// in f64. Finite; 0 in others.
    pub origin: [f64; 3],
}

/// One array of a [`Scene`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Field {
    /// [`Scene::means`].
    Mean,
    /// [`Scene::rotations`].
    Rotation,
    /// [`Scene::log_scales`].
    LogScale,
    /// [`Scene::opacity_logits`].
    OpacityLogit,
    /// [`Scene::sh`].
    Sh,
}

impl fmt::Display for Field {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Mean => "mean",
            Self::Rotation => "rotation",
            Self::LogScale => "log-scale",
            Self::OpacityLogit => "opacity logit",
            Self::Sh => "SH coefficient",
        })
    }
}

impl Scene {
    /// A scene of `n` Gaussians, all numbers 0. The memory comes zeroed from the system, so pages cost
    /// nothing until they are written.
    #[must_use]
    pub fn zeros(n: usize, sh_degree: u8) -> Self {
        Self {
            means: vec![[0.0; 3]; n],
            rotations: vec![[0.0; 4]; n],
            log_scales: vec![[0.0; 3]; n],
            opacity_logits: vec![0.0; n],
            sh_degree,
            sh: vec![[0.0; 3]; n * sh_len(sh_degree)],
            ..Self::default()
        }
    }

    /// As [`Scene::zeros`], or an error if the system has no memory.
    #[cfg(feature = "files")]
    pub(crate) fn try_zeros(n: usize, sh_degree: u8) -> Result<Self, TryReserveError> {
        // Asked for and given back: memory that is reserved does not come zeroed.
        Self { sh_degree, ..Self::default() }.try_reserve(n)?;
        Ok(Self::zeros(n, sh_degree))
    }

    /// A scene without Gaussians that is antialiased if this one is, and has its origin.
    #[must_use]
    pub fn emptied(&self, sh_degree: u8) -> Self {
        Self { sh_degree, antialiased: self.antialiased, origin: self.origin, ..Self::default() }
    }

    /// Reserves memory for `more` Gaussians.
    ///
    /// # Errors
    /// If the system has none: the scene stays as it is.
    pub fn try_reserve(&mut self, more: usize) -> Result<(), TryReserveError> {
        self.means.try_reserve_exact(more)?;
        self.rotations.try_reserve_exact(more)?;
        self.log_scales.try_reserve_exact(more)?;
        self.opacity_logits.try_reserve_exact(more)?;
        self.sh.try_reserve_exact(more.saturating_mul(self.sh_len()))
    }

    /// Number of Gaussians.
    #[must_use]
    pub fn len(&self) -> usize {
        self.means.len()
    }

    /// True if the scene holds no Gaussian.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.means.is_empty()
    }

    /// SH coefficients per Gaussian and colour channel: `(sh_degree + 1)^2`, DC included.
    #[must_use]
    pub fn sh_len(&self) -> usize {
        sh_len(self.sh_degree)
    }

    /// Least and greatest coordinates of the means; of an empty scene infinity and minus infinity.
    #[must_use]
    pub fn bounds(&self) -> [[f32; 3]; 2] {
        bounds_of(self.means.iter().copied())
    }

    /// As [`Scene::bounds`], of all points within one standard deviation of a Gaussian; no coordinate is infinite.
    #[cfg(feature = "files")]
    #[must_use]
    pub fn extent(&self) -> [[f32; 3]; 2] {
        let each = self.means.iter().zip(&self.rotations).zip(&self.log_scales);
        let corners = each.flat_map(|((mean, &rotation), log_scale)| {
            let variance = log_scale.map(|s| libm::exp(2.0 * f64::from(s)));
            let [xx, yy, zz, ..] = axes_product(&math::rotation(rotation), variance);
            let size = [xx, yy, zz].map(|v| v.sqrt() as f32);
            let corner = |k: usize, size: f32| (mean[k] + size).clamp(f32::MIN, f32::MAX);
            [-1.0, 1.0].map(|sign| std::array::from_fn(|k| corner(k, sign * size[k])))
        });
        bounds_of(corners)
    }

    /// The greatest log-scale of a small Gaussian: a tenth of all are smaller. `None` of an empty scene.
    #[must_use]
    pub fn small_log_scale(&self) -> Option<f32> {
        let largest = |s: &[f32; 3]| s[0].max(s[1]).max(s[2]);
        let mut sizes: Vec<f32> = self.log_scales.iter().map(largest).collect();
        let tenth = sizes.len() / 10;
        (!sizes.is_empty()).then(|| *sizes.select_nth_unstable_by(tenth, f32::total_cmp).1)
    }

    /// How much pictures show of Gaussian `i`, about: the logarithm of its opacity times its two longer scales.
    #[cfg(feature = "formats")]
    pub(crate) fn log_prominence(&self, i: usize) -> f64 {
        let mut scales = self.log_scales[i];
        scales.sort_unstable_by(f32::total_cmp);
        let log_opacity = -libm::log1p(libm::exp(-f64::from(self.opacity_logits[i])));
        log_opacity + f64::from(scales[1]) + f64::from(scales[2])
    }

    /// The SH coefficients of Gaussian `i`, DC first; `sh_len()` RGB triples.
    #[must_use]
    pub fn sh_of(&self, i: usize) -> &[[f32; 3]] {
        let k = self.sh_len();
        &self.sh[i * k..(i + 1) * k]
    }

    /// The indices of the Gaussians that are not transparent (see [`LEAST_DRAWN_LOGIT`]), ascending; `None` if no
    /// Gaussian is.
    #[must_use]
    pub fn drawn(&self) -> Option<Vec<usize>> {
        let transparent = |&logit: &f32| logit < LEAST_DRAWN_LOGIT;
        if !self.opacity_logits.iter().any(transparent) {
            return None;
        }
        let logits = self.opacity_logits.iter().enumerate();
        Some(logits.filter(|(_, logit)| !transparent(logit)).map(|(i, _)| i).collect())
    }

    /// Keeps only the Gaussians at `indices`, which ascend, in the memory that the scene has.
    pub fn keep(&mut self, indices: &[usize]) {
        fn compact<T: Copy>(all: &mut Vec<T>, indices: &[usize], each: usize) {
            for (to, &from) in indices.iter().enumerate() {
                all.copy_within(each * from..each * (from + 1), each * to);
            }
            all.truncate(each * indices.len());
        }
        let sh_len = self.sh_len();
        compact(&mut self.means, indices, 1);
        compact(&mut self.rotations, indices, 1);
        compact(&mut self.log_scales, indices, 1);
        compact(&mut self.opacity_logits, indices, 1);
        compact(&mut self.sh, indices, sh_len);
    }

    /// A scene with the Gaussians at `indices`, in that order (repeats allowed).
    #[must_use]
    pub fn select(&self, indices: &[usize]) -> Self {
        let k = self.sh_len();
        let mut out = Self {
            means: indices.iter().map(|&i| self.means[i]).collect(),
            rotations: indices.iter().map(|&i| self.rotations[i]).collect(),
            log_scales: indices.iter().map(|&i| self.log_scales[i]).collect(),
            opacity_logits: indices.iter().map(|&i| self.opacity_logits[i]).collect(),
            sh: Vec::with_capacity(indices.len() * k),
            ..self.emptied(self.sh_degree)
        };
        for &i in indices {
            out.sh.extend_from_slice(self.sh_of(i));
        }
        out
    }

    /// Appends the Gaussians of `other`, at this scene's SH degree: their higher coefficients are
    /// left out, missing ones are zero. They come to lie about this scene's origin. An empty scene takes the origin
    /// of `other`, and whether it is antialiased.
    pub fn append(&mut self, other: &Self) {
        self.append_range(other, 0..other.len());
    }

    /// As [`Scene::append`], for a range of the Gaussians of `other`.
    ///
    /// # Panics
    /// If the range exceeds `other`.
    pub fn append_range(&mut self, other: &Self, range: Range<usize>) {
        let len = self.sh_len();
        if self.is_empty() {
            (self.antialiased, self.origin) = (other.antialiased, other.origin);
        }
        let moved = other.means[range.clone()].iter().map(|&mean| other.about(self.origin, mean));
        self.means.extend(moved);
        self.rotations.extend_from_slice(&other.rotations[range.clone()]);
        self.log_scales.extend_from_slice(&other.log_scales[range.clone()]);
        self.opacity_logits.extend_from_slice(&other.opacity_logits[range.clone()]);
        if other.sh_degree == self.sh_degree {
            self.sh.extend_from_slice(&other.sh[range.start * len..range.end * len]);
            return;
        }
        for i in range {
            let row = other.sh_of(i);
            self.sh.extend((0..len).map(|j| row.get(j).copied().unwrap_or_default()));
        }
    }

    /// Gives the scene another origin: the means change, the places of the Gaussians do not, but for rounding.
    pub fn move_origin(&mut self, origin: [f64; 3]) {
        let mut means = std::mem::take(&mut self.means);
        means.iter_mut().for_each(|mean| *mean = self.about(origin, *mean));
        (self.means, self.origin) = (means, origin);
    }

    /// A mean of this scene about another origin.
    fn about(&self, origin: [f64; 3], mean: [f32; 3]) -> [f32; 3] {
        if origin == self.origin {
            return mean;
        }
        std::array::from_fn(|k| (f64::from(mean[k]) + (self.origin[k] - origin[k])) as f32)
    }

    /// Removes the SH coefficients above `degree` in place and frees their memory. A scene of a lower
    /// degree stays as it is.
    pub fn cut_sh(&mut self, degree: u8) {
        let (from, to) = (self.sh_len(), sh_len(degree));
        if to >= from {
            return;
        }
        for i in 1..self.len() {
            self.sh.copy_within(i * from..i * from + to, i * to);
        }
        self.sh.truncate(self.len() * to);
        self.sh.shrink_to_fit();
        self.sh_degree = degree;
    }

    /// Removes all Gaussians. The memory stays allocated, and the SH degree stays.
    pub fn clear(&mut self) {
        self.means.clear();
        self.rotations.clear();
        self.log_scales.clear();
        self.opacity_logits.clear();
        self.sh.clear();
    }

    /// Removes the Gaussians from index `at` on and returns them: the inverse of [`Scene::append`].
    /// If the scene has at most `at` Gaussians, none are removed.
    #[must_use]
    pub fn split_off(&mut self, at: usize) -> Self {
        let at = at.min(self.len());
        Self {
            means: self.means.split_off(at),
            rotations: self.rotations.split_off(at),
            log_scales: self.log_scales.split_off(at),
            opacity_logits: self.opacity_logits.split_off(at),
            sh: self.sh.split_off(at * self.sh_len()),
            ..self.emptied(self.sh_degree)
        }
    }
}

/// The arrays of consecutive Gaussians of a scene, to be filled in.
#[derive(Debug)]
pub struct SceneMut<'a> {
    /// Means, world units.
    pub means: &'a mut [[f32; 3]],
    /// Quaternions, w first.
    pub rotations: &'a mut [[f32; 4]],
    /// Natural logarithms of the standard deviations.
    pub log_scales: &'a mut [[f32; 3]],
    /// Opacities before the sigmoid.
    pub opacity_logits: &'a mut [f32],
    /// SH coefficients, the same number for each Gaussian.
    pub sh: &'a mut [[f32; 3]],
}

impl<'a> SceneMut<'a> {
    /// All Gaussians of a scene.
    pub fn of(scene: &'a mut Scene) -> Self {
        let Scene { means, rotations, log_scales, opacity_logits, sh, .. } = scene;
        Self { means, rotations, log_scales, opacity_logits, sh }
    }

    /// Number of Gaussians.
    #[must_use]
    pub fn len(&self) -> usize {
        self.means.len()
    }

    /// True without a Gaussian.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.means.is_empty()
    }

    /// SH coefficients of each Gaussian; 0 without a Gaussian.
    #[must_use]
    pub fn sh_len(&self) -> usize {
        self.sh.len() / self.len().max(1)
    }

    /// The first `n` and the others.
    ///
    /// # Panics
    /// If there are fewer than `n`.
    #[must_use]
    pub fn split_at(self, n: usize) -> (Self, Self) {
        let sh_len = self.sh_len();
        let (means, means_rest) = self.means.split_at_mut(n);
        let (rotations, rotations_rest) = self.rotations.split_at_mut(n);
        let (log_scales, log_scales_rest) = self.log_scales.split_at_mut(n);
        let (opacity_logits, opacity_logits_rest) = self.opacity_logits.split_at_mut(n);
        let (sh, sh_rest) = self.sh.split_at_mut(n * sh_len);
        let rest = Self {
            means: means_rest,
            rotations: rotations_rest,
            log_scales: log_scales_rest,
            opacity_logits: opacity_logits_rest,
            sh: sh_rest,
        };
        (Self { means, rotations, log_scales, opacity_logits, sh }, rest)
    }

    /// Copies as many Gaussians from `first` on; coefficients beyond those of `scene` become 0.
    ///
    /// # Panics
    /// If `scene` has fewer.
    pub fn copy_from(&mut self, scene: &Scene, first: usize) {
        let range = first..first + self.len();
        self.means.copy_from_slice(&scene.means[range.clone()]);
        self.rotations.copy_from_slice(&scene.rotations[range.clone()]);
        self.log_scales.copy_from_slice(&scene.log_scales[range.clone()]);
        self.opacity_logits.copy_from_slice(&scene.opacity_logits[range.clone()]);
        let sh_len = self.sh_len();
        for (out, i) in self.sh.chunks_exact_mut(sh_len.max(1)).zip(range) {
            let from = scene.sh_of(i);
            let common = from.len().min(sh_len);
            out[..common].copy_from_slice(&from[..common]);
            out[common..].fill([0.0; 3]);
        }
    }
}

/// Least and greatest coordinates; without a point infinity and minus infinity.
pub(crate) fn bounds_of(points: impl Iterator<Item = [f32; 3]>) -> [[f32; 3]; 2] {
    let (mut low, mut high) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    for point in points {
        low = std::array::from_fn(|k| low[k].min(point[k]));
        high = std::array::from_fn(|k| high[k].max(point[k]));
    }
    [low, high]
}

/// SH coefficients per colour channel of a given degree, DC included.
#[must_use]
pub const fn sh_len(degree: u8) -> usize {
    (degree as usize + 1) * (degree as usize + 1)
}
