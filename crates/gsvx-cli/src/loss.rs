//! How much less a stream shows than its model: an estimate after every encode.

use crate::output::counted;
use finetune::{Likeness, Pictures};
use gsvx::DecodeOptions;
use serde_json::{Value, json};

/// Compares with what a stream decodes to; `None` if the pictures show nothing.
///
/// # Errors
/// Those of the decoder.
pub(crate) fn loss(pictures: &Pictures, stream: &[u8]) -> gsvx::Result<Option<Likeness>> {
    if pictures.is_empty() {
        return Ok(None);
    }
    let mut options = DecodeOptions::default();
    options.max_gaussians = Some(u64::MAX);
    Ok(pictures.likeness(&gsvx::decode_with(stream, &options)?.scene))
}

/// For a person.
pub(crate) fn human(loss: &Likeness) -> String {
    let Likeness { psnr, ssim, views } = loss;
    format!(
        "estimated loss: about {psnr:.0} dB PSNR, SSIM {ssim:.3}, against the input in {}: {}",
        counted(views, "picture"),
        loss.meaning()
    )
}

/// The same as JSON.
pub(crate) fn json(loss: &Likeness) -> Value {
    let Likeness { psnr, ssim, views } = loss;
    json!({ "psnr": psnr, "ssim": ssim, "views": views, "meaning": loss.meaning() })
}
