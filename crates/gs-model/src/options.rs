//! [`ReadOptions`]: what to do with invalid Gaussians in a file.

use std::path::Path;

use crate::error::Result;
use crate::scene::Scene;
use crate::validate::InvalidReport;

/// What to do with Gaussians that are invalid (see [`InvalidReport`]).
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
}

impl ReadOptions {
    /// Does to a scene just read what the options ask for. Returns the number of opacities
    /// clamped and the invalid Gaussians dropped. `file` is for the message.
    pub(crate) fn apply(&self, scene: &mut Scene, file: &Path) -> Result<(usize, InvalidReport)> {
        let clamped = match self.clamp_infinite_opacity {
            Some(limit) => clamp_infinite(&mut scene.opacity_logits, limit),
            None => 0,
        };
        match self.invalid {
            Invalid::Drop => Ok((clamped, scene.drop_invalid())),
            Invalid::Error => match scene.invalid().error(file) {
                Some(error) => Err(error),
                None => Ok((clamped, InvalidReport::default())),
            },
        }
    }
}

fn clamp_infinite(opacity_logits: &mut [f32], limit: f32) -> usize {
    let mut clamped = 0;
    for logit in opacity_logits.iter_mut().filter(|l| l.is_infinite()) {
        *logit = limit.copysign(*logit);
        clamped += 1;
    }
    clamped
}
