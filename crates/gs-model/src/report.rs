//! [`ReadOptions`] and [`Report`]: how a model is read, and what its file held.

use std::path::Path;

use crate::codec::Codec;
use crate::error::Result;
use crate::scene::Scene;

/// What to do with Gaussians that are invalid (see [`crate::validate::InvalidGaussians`]).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Invalid {
    /// Fail with [`crate::Error::InvalidGaussian`], which names the first one and their number.
    #[default]
    Error,
    /// Leave them out; the report counts them.
    Drop,
}

/// The opacity logit that [`ReadOptions::clamp_infinite_opacity`] is meant for.
///
/// The sigmoid of -10 is 4.5e-5, far below the 1/255 under which a Gaussian is not drawn, and
/// that of +10 is as near to 1, above the 0.99 at which renderers cap alpha.
pub const CLAMPED_OPACITY_LOGIT: f32 = 10.0;

/// How to read a model. The default is strict: any invalid Gaussian is an error.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ReadOptions {
    /// What to do with invalid Gaussians.
    pub invalid: Invalid,
    /// Replace opacity logits of -inf and +inf by minus and plus this number (say
    /// [`CLAMPED_OPACITY_LOGIT`]) before looking for invalid Gaussians.
    ///
    /// Tools that convert 8-bit opacities (SPZ, compressed.ply) write 0 and 255 as infinite
    /// logits; these Gaussians are fully transparent or opaque rather than broken.
    pub clamp_infinite_opacity: Option<f32>,
    /// Decodes primitives of glTF that are compressed. Without it they are an error.
    pub codec: Option<&'static Codec>,
    /// Accept so many Gaussians that are compressed, even if [`Codec::most`] is less.
    pub max_gaussians: Option<u64>,
}

/// What a model file held. What only PLY files have is empty for other formats.
#[derive(Clone, Debug, Default)]
#[non_exhaustive]
pub struct Report {
    /// The [`crate::Format::name`] of the format.
    pub format: &'static str,
    /// The form of the file in words: `SPZ, version 4`.
    pub form: String,
    /// Bytes of the files beside it that belong to the model: the images of a SOG.
    pub bytes_beside: u64,
    /// Gaussians in the file.
    pub gaussians_in_file: usize,
    /// Invalid Gaussians that were left out.
    pub dropped: usize,
    /// Infinite opacity logits that were replaced.
    pub clamped_opacities: usize,
    /// How a model that is not in the Inria layout was read, in words: see [`crate::ply`].
    pub notes: Vec<&'static str>,
    /// Properties of a PLY's `vertex` that are not part of the Inria layout, in file order; ignored.
    pub unknown_properties: Vec<String>,
    /// What a PLY holds that a scene does not keep: properties that are not zero everywhere, other elements,
    /// numbers that no float holds.
    pub lost: Vec<String>,
    /// `comment` and `obj_info` lines of a PLY.
    pub comments: Vec<String>,
    /// Bytes after the last row that a PLY's header declares; ignored. (In ASCII files, white space
    /// at the end does not count.)
    pub trailing_bytes: usize,
}

impl Report {
    /// Of a file of this form that holds nothing but Gaussians.
    pub(crate) fn of(format: &'static str, form: impl Into<String>) -> Self {
        Self { format, form: form.into(), ..Self::default() }
    }
}

impl ReadOptions {
    /// Does to a scene just read what the options ask for, and reports it. `file` is for the message.
    pub(crate) fn apply(&self, file: &Path, scene: &mut Scene, report: &mut Report) -> Result<()> {
        report.gaussians_in_file = scene.len();
        if let Some(limit) = self.clamp_infinite_opacity {
            for logit in scene.opacity_logits.iter_mut().filter(|l| l.is_infinite()) {
                *logit = limit.copysign(*logit);
                report.clamped_opacities += 1;
            }
        }
        match self.invalid {
            Invalid::Drop => report.dropped = scene.drop_invalid(),
            Invalid::Error => scene.refuse_invalid(file)?,
        }
        Ok(())
    }
}
