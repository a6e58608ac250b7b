//! [`estimated_loss`]: how much less a stream shows than its model.

use finetune::{Likeness, Pictures};
use gsvx::DecodeOptions;

/// Compares a stream with pictures of its model; `None` if they show nothing.
///
/// # Errors
/// Those of the decoder.
pub fn estimated_loss(pictures: &Pictures, stream: &[u8]) -> gsvx::Result<Option<Likeness>> {
    if pictures.is_empty() {
        return Ok(None);
    }
    let mut options = DecodeOptions::default();
    options.max_gaussians = Some(u64::MAX);
    Ok(pictures.likeness(&gsvx::decode_with(stream, &options)?.scene))
}
