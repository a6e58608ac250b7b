//! Which Gaussians are invalid, and their removal from a [`Scene`].
//!
//! Real files hold such Gaussians: a diverged training run writes NaN, and one published model
//! held 889,536 rows of zeros whose quaternions have no direction. One of them is enough to
//! turn a rendered pixel, a bounding cube or a mean over Gaussians into NaN.

use std::path::{Path, PathBuf};

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
    /// How many are invalid in each field of [`Field::ALL`]; one Gaussian may count in several.
    pub by_field: [usize; 5],
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
        match self.invalid().error(Path::new("<scene>")) {
            Some(e) => Err(e),
            None => Ok(()),
        }
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
                let mut part = InvalidReport::default();
                for i in c * ROWS..n.min((c + 1) * ROWS) {
                    part.check(self, i);
                }
                part
            })
            .collect();
        let mut all = InvalidReport::default();
        for part in parts {
            all.count += part.count;
            for (a, b) in all.by_field.iter_mut().zip(part.by_field) {
                *a += b;
            }
            all.first = all.first.or(part.first);
        }
        all
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

    /// The first invalid value in a field of Gaussian `i`.
    fn bad_value(&self, i: usize, field: Field) -> Option<f32> {
        let not_finite = |values: &[f32]| values.iter().copied().find(|v| !v.is_finite());
        match field {
            Field::Mean => not_finite(&self.means[i]),
            Field::Rotation => {
                let q = self.rotations[i];
                not_finite(&q).or_else(|| {
                    let norm2 = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3];
                    (!norm2.is_normal()).then_some(q[0])
                })
            }
            Field::LogScale => not_finite(&self.log_scales[i]),
            Field::OpacityLogit => not_finite(&[self.opacity_logits[i]]),
            Field::Sh => not_finite(self.sh_of(i).as_flattened()),
        }
    }

    /// The first invalid field of Gaussian `i`, and its value.
    fn defect(&self, i: usize) -> Option<(Field, f32)> {
        Field::ALL.into_iter().find_map(|f| self.bad_value(i, f).map(|v| (f, v)))
    }
}

impl InvalidReport {
    /// Counts Gaussian `i` if it is invalid.
    fn check(&mut self, scene: &Scene, i: usize) {
        let mut first = None;
        for (k, field) in Field::ALL.into_iter().enumerate() {
            if let Some(value) = scene.bad_value(i, field) {
                self.by_field[k] += 1;
                first = first.or(Some(InvalidGaussian { index: i, field, value }));
            }
        }
        if first.is_some() {
            self.count += 1;
            self.first = self.first.or(first);
        }
    }

    /// The error about the first invalid Gaussian, if there is one.
    pub(crate) fn error(&self, file: &Path) -> Option<Error> {
        self.first.map(|InvalidGaussian { index, field, value }| Error::InvalidGaussian {
            file: PathBuf::from(file),
            index,
            field,
            value,
            count: self.count,
        })
    }
}
