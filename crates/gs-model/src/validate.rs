//! Which Gaussians are invalid, and their removal from a [`Scene`].
//!
//! Real files hold such Gaussians: a diverged training run writes NaN, and one published model
//! held 889,536 rows of zeros whose quaternions have no direction. One of them is enough to
//! turn a rendered pixel, a bounding cube or a mean over Gaussians into NaN.

use std::path::Path;

use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::scene::{Field, Scene, sh_len};

/// No trained model has a log-scale or an SH coefficient of a greater magnitude, by far.
pub const LARGEST: f32 = 18_900.0;

/// Whether normalising a quaternion in `f32` gives a rotation.
pub(crate) fn has_direction(q: &[f32; 4]) -> bool {
    (q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]).is_normal()
}

/// The invalid Gaussians of a scene.
///
/// A Gaussian is invalid if any of its numbers is NaN or infinite (readers give infinite opacities and scales of 0
/// finite numbers first, and quaternions of extreme length another one: [`Scene::clamp_limits`]), or if its quaternion has no
/// direction: `w² + x² + y² + z²` in `f32`, summed in this order, is zero, subnormal or
/// infinite, so that normalising it in `f32` cannot give a rotation.
#[derive(Clone, Copy, Debug)]
pub struct InvalidGaussians {
    /// How many there are.
    pub count: usize,
    /// The least index of one in the scene that was checked.
    pub index: usize,
    /// Its first invalid field, in the order of the variants.
    pub field: Field,
    /// The value that is not finite; of a quaternion without direction, its w.
    pub value: f32,
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
    /// first invalid Gaussian (see [`InvalidGaussians`]) and how many there are.
    pub fn validate(&self) -> Result<()> {
        self.check_shape()?;
        self.refuse_invalid(Path::new("scene"))
    }

    /// Refuses a scene with invalid Gaussians; `file` is for the message.
    pub(crate) fn refuse_invalid(&self, file: &Path) -> Result<()> {
        let Some(invalid) = self.invalid() else { return Ok(()) };
        let InvalidGaussians { index, field, value, count } = invalid;
        Err(Error::InvalidGaussian { file: file.into(), index, field, value, count })
    }

    /// Finds and counts the invalid Gaussians; `None` if there are none.
    ///
    /// The arrays must have consistent lengths ([`Scene::check_shape`]); Gaussians beyond the
    /// shortest array are ignored.
    #[must_use]
    pub fn invalid(&self) -> Option<InvalidGaussians> {
        const ROWS: usize = 1 << 14;
        let n = self.checked_len();
        let parts = (0..n.div_ceil(ROWS)).into_par_iter().filter_map(|c| {
            let rows = c * ROWS..n.min((c + 1) * ROWS);
            let mut all = rows.filter_map(|index| self.defect(index));
            let first = all.next()?;
            Some(InvalidGaussians { count: 1 + all.count(), ..first })
        });
        parts.reduce_with(|a, b| InvalidGaussians { count: a.count + b.count, ..a })
    }

    /// Removes the invalid Gaussians and those with a log-scale or an SH coefficient beyond +-[`LARGEST`], keeping
    /// the order of the others. Returns how many there were.
    ///
    /// A scene whose arrays have inconsistent lengths loses its surplus entries too.
    pub fn drop_invalid(&mut self) -> usize {
        const ROWS: usize = 1 << 14;
        let n = self.checked_len();
        let rows = (0..n).into_par_iter().with_min_len(ROWS);
        let count = rows.filter(|&i| !self.is_sound(i)).count();
        if count > 0 || self.check_shape().is_err() {
            self.keep(&self.sound_indices());
        }
        count
    }

    /// The indices of the Gaussians that [`Scene::drop_invalid`] keeps.
    #[must_use]
    pub fn sound_indices(&self) -> Vec<usize> {
        (0..self.checked_len()).filter(|&i| self.is_sound(i)).collect()
    }

    fn is_sound(&self, i: usize) -> bool {
        let held = |values: &[f32]| values.iter().all(|v| v.abs() <= LARGEST);
        self.defect(i).is_none() && held(&self.log_scales[i]) && held(self.sh_of(i).as_flattened())
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
    fn defect(&self, index: usize) -> Option<InvalidGaussians> {
        let not_finite = |values: &[f32]| values.iter().copied().find(|v| !v.is_finite());
        let bad_value = |field: Field| match field {
            Field::Mean => not_finite(&self.means[index]),
            Field::Rotation => {
                let q = self.rotations[index];
                not_finite(&q).or_else(|| (!has_direction(&q)).then_some(q[0]))
            }
            Field::LogScale => not_finite(&self.log_scales[index]),
            Field::OpacityLogit => not_finite(&[self.opacity_logits[index]]),
            Field::Sh => not_finite(self.sh_of(index).as_flattened()),
        };
        let fields =
            [Field::Mean, Field::Rotation, Field::LogScale, Field::OpacityLogit, Field::Sh];
        fields.into_iter().find_map(|field| {
            Some(InvalidGaussians { count: 1, index, field, value: bad_value(field)? })
        })
    }
}
