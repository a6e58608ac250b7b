//! Which Gaussians are invalid, and their removal from a [`Scene`].
//!
//! Real files hold such Gaussians: a diverged training run writes NaN, and one published model
//! held 889,536 rows of zeros whose quaternions have no direction. One of them is enough to
//! turn a rendered pixel, a bounding cube or a mean over Gaussians into NaN.

use std::path::Path;

use rayon::prelude::*;

use crate::error::{Error, Result};
pub use crate::field::Field;
use crate::scene::{Scene, sh_len};

/// One invalid Gaussian.
#[derive(Clone, Copy, Debug)]
pub struct InvalidGaussian {
    /// Its index in the scene that was checked.
    pub index: usize,
    /// Its first invalid field, in the order of [`Field::ALL`].
    pub field: Field,
    /// The value that is not finite; of a quaternion without direction, its w.
    pub value: f32,
}

/// The invalid Gaussians of a scene.
///
/// A Gaussian is invalid if any of its numbers is NaN or infinite, or if its quaternion has no
/// direction: `w² + x² + y² + z²` in `f32`, summed in this order, is zero, subnormal or
/// infinite, so that normalising it in `f32` cannot give a rotation.
#[derive(Clone, Debug, Default)]
pub struct InvalidReport {
    /// How many Gaussians are invalid.
    pub count: usize,
    /// The invalid Gaussian with the smallest index.
    pub first: Option<InvalidGaussian>,
}

impl Scene {
    /// Checks that the arrays have the lengths that go with `means` and `sh_degree`.
    ///
    /// # Errors
    /// [`Error::SceneShape`], [`Error::SceneDegree`].
    pub fn check_shape(&self) -> Result<()> {
        if self.sh_degree > 3 {
            return Err(Error::SceneDegree { degree: self.sh_degree });
        }
        let n = self.means.len();
        for (field, len, expected) in [
            (Field::Rotation, self.rotations.len(), n),
            (Field::LogScale, self.log_scales.len(), n),
            (Field::OpacityLogit, self.opacity_logits.len(), n),
            (Field::Sh, self.sh.len(), n * sh_len(self.sh_degree)),
        ] {
            if len != expected {
                return Err(Error::SceneShape { field, len, expected });
            }
        }
        Ok(())
    }

    /// Checks the shape of the scene and every number in it.
    ///
    /// # Errors
    /// [`Error::SceneShape`] or [`Error::SceneDegree`]; [`Error::InvalidGaussian`] naming the
    /// first invalid Gaussian (see [`InvalidReport`]) and how many there are.
    pub fn validate(&self) -> Result<()> {
        self.check_shape()?;
        self.invalid().error(Path::new("scene")).map_or(Ok(()), Err)
    }

    /// Finds and counts the invalid Gaussians.
    ///
    /// The arrays must have consistent lengths ([`Scene::check_shape`]); Gaussians beyond the
    /// shortest array are ignored.
    #[must_use]
    pub fn invalid(&self) -> InvalidReport {
        const ROWS: usize = 1 << 14;
        let n = self.checked_len();
        // Integer counts, combined in chunk order: the same for any number of threads.
        let parts: Vec<InvalidReport> = (0..n.div_ceil(ROWS))
            .into_par_iter()
            .map(|c| {
                let rows = c * ROWS..n.min((c + 1) * ROWS);
                let mut all = rows.filter_map(|index| self.defect(index));
                let first = all.next();
                InvalidReport { count: usize::from(first.is_some()) + all.count(), first }
            })
            .collect();
        let first = parts.iter().find_map(|part| part.first);
        InvalidReport { count: parts.iter().map(|part| part.count).sum(), first }
    }

    /// Removes the invalid Gaussians, keeping the order of the others.
    ///
    /// Returns what was removed; indices in it are those before the removal. A scene whose
    /// arrays have inconsistent lengths loses its surplus entries too.
    pub fn drop_invalid(&mut self) -> InvalidReport {
        let report = self.invalid();
        if report.count > 0 || self.check_shape().is_err() {
            *self = self.select(&self.valid_indices());
        }
        report
    }

    /// The indices of the Gaussians that are valid: those that [`Scene::drop_invalid`] keeps.
    #[must_use]
    pub fn valid_indices(&self) -> Vec<usize> {
        (0..self.checked_len()).filter(|&i| self.defect(i).is_none()).collect()
    }

    /// Number of Gaussians of which every array has an entry.
    fn checked_len(&self) -> usize {
        self.means
            .len()
            .min(self.rotations.len())
            .min(self.log_scales.len())
            .min(self.opacity_logits.len())
            .min(self.sh.len() / self.sh_len())
    }

    /// What is wrong with Gaussian `index`, if anything is.
    fn defect(&self, index: usize) -> Option<InvalidGaussian> {
        let not_finite = |values: &[f32]| values.iter().copied().find(|v| !v.is_finite());
        let bad_value = |field: Field| match field {
            Field::Mean => not_finite(&self.means[index]),
            Field::Rotation => {
                let q = self.rotations[index];
                not_finite(&q).or_else(|| {
                    let norm2 = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3];
                    (!norm2.is_normal()).then_some(q[0])
                })
            }
            Field::LogScale => not_finite(&self.log_scales[index]),
            Field::OpacityLogit => not_finite(&[self.opacity_logits[index]]),
            Field::Sh => not_finite(self.sh_of(index).as_flattened()),
        };
        let bad = |field| bad_value(field).map(|value| InvalidGaussian { index, field, value });
        Field::ALL.into_iter().find_map(bad)
    }
}

impl InvalidReport {
    /// The error about the first invalid Gaussian, if there is one.
    pub(crate) fn error(&self, file: &Path) -> Option<Error> {
        let InvalidGaussian { index, field, value } = self.first?;
        Some(Error::InvalidGaussian { file: file.into(), index, field, value, count: self.count })
    }
}
