//! How much less a stream shows than its model, in words: an estimate after every encode.

use crate::output::counted;
use finetune::Likeness;
use serde_json::{Value, json};

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
