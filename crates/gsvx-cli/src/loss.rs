//! How much less a stream shows than its model: an estimate after every encode.

use crate::output::counted;
use finetune::Likeness;
use gs_model::{Camera, Scene};
use gsvx::DecodeOptions;
use serde_json::{Value, json};

/// The pictures of a model, for comparison with those of a stream.
pub(crate) struct Pictures(finetune::Pictures);

/// How much less a stream shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Loss(Likeness);

impl Pictures {
    /// Draws the model from some of the cameras; without cameras, from places around it.
    pub(crate) fn of(scene: &Scene, cameras: Option<&[Camera]>) -> Self {
        Self(finetune::Pictures::of(scene, cameras))
    }

    /// Compares with what a stream decodes to; `None` if the views show nothing.
    ///
    /// # Errors
    /// Those of the decoder.
    pub(crate) fn loss(&self, stream: &[u8]) -> gsvx::Result<Option<Loss>> {
        if self.0.is_empty() {
            return Ok(None);
        }
        let mut options = DecodeOptions::default();
        options.max_gaussians = Some(u64::MAX);
        let scene = gsvx::decode_with(stream, &options)?.scene;
        Ok(self.0.likeness(&scene).map(Loss))
    }
}

impl Loss {
    /// For a person.
    pub(crate) fn human(&self) -> String {
        let Likeness { psnr, ssim, views } = self.0;
        format!(
            "estimated loss: about {psnr:.0} dB PSNR, SSIM {ssim:.3}, against the input in {}: {}",
            counted(views as u64, "picture"),
            self.0.meaning()
        )
    }

    /// What to do where much is lost.
    pub(crate) fn warning(&self) -> Option<&'static str> {
        (self.0.psnr.round() < Likeness::POOR).then_some(
            "warning: the loss is easy to see; a higher --quality keeps more, and so does --cameras at \
             the same size",
        )
    }

    /// The same as JSON.
    pub(crate) fn json(&self) -> Value {
        let Likeness { psnr, ssim, views } = self.0;
        json!({ "psnr": psnr, "ssim": ssim, "views": views, "meaning": self.0.meaning() })
    }
}
