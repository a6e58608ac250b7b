//! The Gaussians of a slice on their way into sections.
//!
//! SH coefficients are four fifths of a model. Where merged ones are made for the encoder, each
//! degree is an array of its own, that is gone as soon as the rows of its section are filled: no
//! value is in memory twice for long.

use crate::error::Result;
use crate::stream::SectionKind;
use gs_model::Scene;
use rayon::prelude::*;
use std::borrow::Cow;
use std::mem::take;
use std::ops::Range;
use voxel::{Importance, Merge, Voxelization};

/// One Gaussian per leaf of a slice.
#[derive(Debug, Default)]
pub(crate) struct Gaussians<'a> {
    /// All of them but for `upper`.
    pub(crate) scene: Cow<'a, Scene>,
    /// SH coefficients of the degrees above the scene's, ascending: `2 degree + 1` per leaf.
    pub(crate) upper: Vec<Vec<[f32; 3]>>,
}

impl<'a> From<Cow<'a, Scene>> for Gaussians<'a> {
    fn from(scene: Cow<'a, Scene>) -> Self {
        Self { scene, upper: Vec::new() }
    }
}

impl<'a> Gaussians<'a> {
    /// Merges the members of every leaf. A scene that is owned loses what has been merged, degree
    /// by degree, so that there is never more than it and one degree.
    pub(crate) fn merged(
        mut scene: Cow<'a, Scene>,
        voxels: &Voxelization,
        weights: &Importance,
    ) -> Result<Gaussians<'static>> {
        let mut upper = Vec::new();
        for degree in (1..=scene.sh_degree).rev() {
            upper.push(voxel::merge_sh(&scene, voxels, Merge::Moments, weights, degree)?);
            if let Cow::Owned(scene) = &mut scene {
                scene.cut_sh(degree - 1);
            }
        }
        upper.reverse();
        let merged = voxel::merge_up_to(&scene, voxels, Merge::Moments, weights, 0)?;
        Ok(Gaussians { scene: Cow::Owned(merged), upper })
    }

    /// Number of Gaussians.
    pub(crate) fn len(&self) -> usize {
        self.scene.len()
    }

    /// Takes the Gaussians from `at` on off these.
    pub(crate) fn split_off(&mut self, at: usize) -> Self {
        let n = self.len();
        let Self { scene, upper } = self;
        let each = |array: &Vec<[f32; 3]>| array.len() / n.max(1);
        let upper = upper.iter_mut().map(|array| {
            let at = at * each(array);
            cut(array, at)
        });
        let upper = upper.collect();
        let scene = scene.to_mut();
        let at_sh = at * scene.sh_len();
        let scene = Scene {
            means: cut(&mut scene.means, at),
            rotations: cut(&mut scene.rotations, at),
            log_scales: cut(&mut scene.log_scales, at),
            opacity_logits: cut(&mut scene.opacity_logits, at),
            sh_degree: scene.sh_degree,
            sh: cut(&mut scene.sh, at_sh),
        };
        Self { scene: Cow::Owned(scene), upper }
    }

    /// Means are their leaves' centres, which nobody codes.
    pub(crate) fn forget_means(&mut self) {
        if let Cow::Owned(scene) = &mut self.scene {
            scene.means = Vec::new();
        }
    }

    /// Takes out what a section codes, if it is the encoder's own: no other section needs it.
    pub(crate) fn take(&mut self, kind: SectionKind) -> Option<Own> {
        let Cow::Owned(scene) = &mut self.scene else { return None };
        Some(match kind {
            SectionKind::Opacity => Own::Opacity(take(&mut scene.opacity_logits)),
            SectionKind::Covariance => {
                Own::Covariance(take(&mut scene.rotations), take(&mut scene.log_scales))
            }
            _ => {
                let degree = kind.sh_coefficients().len() / 2;
                match degree.checked_sub(usize::from(scene.sh_degree) + 1) {
                    Some(upper) => Own::Sh(take(self.upper.get_mut(upper)?)),
                    None if scene.sh_degree == 0 => Own::Sh(take(&mut scene.sh)),
                    None => return None,
                }
            }
        })
    }

    /// Whether all of the SH coefficients pass.
    pub(crate) fn all_sh(&self, ok: impl Fn(f32) -> bool + Sync) -> bool {
        let arrays = std::iter::once(&self.scene.sh).chain(&self.upper);
        let ok = |chunk: &[[f32; 3]]| chunk.as_flattened().iter().all(|&v| ok(v));
        arrays.into_iter().all(|array| array.par_chunks(1 << 14).all(ok))
    }

    /// The SH coefficients of one Gaussian, all degrees.
    pub(crate) fn sh_of(&self, i: usize) -> Vec<f32> {
        let mut sh = self.scene.sh_of(i).as_flattened().to_vec();
        for array in &self.upper {
            let each = array.len() / self.len();
            sh.extend(array[i * each..(i + 1) * each].as_flattened());
        }
        sh
    }
}

/// Splits a list and gives the memory of what has gone back; all of it is only moved.
pub(crate) fn cut<T>(list: &mut Vec<T>, at: usize) -> Vec<T> {
    if at == 0 {
        return take(list);
    }
    let end = list.split_off(at);
    list.shrink_to_fit();
    end
}

/// What one section codes.
#[derive(Debug)]
pub(crate) enum Own {
    /// Logits.
    Opacity(Vec<f32>),
    /// Rotations and log-scales.
    Covariance(Vec<[f32; 4]>, Vec<[f32; 3]>),
    /// SH coefficients of one degree, `2 degree + 1` per leaf.
    Sh(Vec<[f32; 3]>),
}

/// Where a section's values are.
pub(crate) struct Values<'a> {
    /// Those of all sections, if they are not its own.
    pub(crate) scene: &'a Scene,
    pub(crate) own: Option<Own>,
    /// Its SH coefficients.
    pub(crate) range: Range<usize>,
}

impl Values<'_> {
    /// The opacity logits.
    pub(crate) fn opacity_logits(&self) -> &[f32] {
        match &self.own {
            Some(Own::Opacity(own)) => own,
            _ => &self.scene.opacity_logits,
        }
    }

    /// Rotation and log-scales of Gaussian `i`.
    #[inline]
    pub(crate) fn covariance_of(&self, i: usize) -> ([f32; 4], [f32; 3]) {
        match &self.own {
            Some(Own::Covariance(rotations, log_scales)) => (rotations[i], log_scales[i]),
            _ => (self.scene.rotations[i], self.scene.log_scales[i]),
        }
    }

    /// The SH coefficients of the section, of Gaussian `i`.
    #[inline]
    pub(crate) fn sh_of(&self, i: usize) -> &[[f32; 3]] {
        match &self.own {
            Some(Own::Sh(own)) => &own[i * self.range.len()..(i + 1) * self.range.len()],
            _ => &self.scene.sh_of(i)[self.range.clone()],
        }
    }
}
