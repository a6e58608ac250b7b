//! How much less a stream shows than its model, in words: an estimate after every encode.

use crate::output::counted;
use finetune::metrics::{Scores, decibels};
use finetune::{Likeness, LossEstimate};
use serde_json::{Value, json};

/// For a person: the worse of the loss at the cameras and around the model, and the other one if it is far from it.
pub(crate) fn human(loss: &LossEstimate) -> String {
    let Some(worse) = loss.worse() else { return NOTHING.into() };
    let Likeness { psnr, ssim, ssimulacra2, views } = worse;
    let (here, there) = match loss.at_cameras {
        None => ("", None),
        Some(seen) if seen == worse => {
            (" at the cameras", loss.around.map(|l| ("around the model", l)))
        }
        Some(seen) => (" around the model", Some(("at the cameras", seen))),
    };
    let other = there.filter(|_| loss.is_far_apart());
    let other = other.map(|(place, l)| format!("; {place} about {:.0} dB", l.psnr));
    format!(
        "estimated loss: about {psnr:.0} dB PSNR, SSIM {ssim:.3}, SSIMULACRA2 {ssimulacra2:.0}, against the input in \
         {}{here}: {}{}",
        counted(views, "picture"),
        worse.meaning(),
        other.unwrap_or_default()
    )
}

/// PSNR of equal pictures, and the greatest that is told, dB.
const EQUAL: f64 = 99.0;

/// The likeness of pictures of these scores.
pub(crate) fn likeness(scores: &[Scores]) -> Likeness {
    let squared_error = |s: &Scores| libm::exp10(-0.1 * s.psnr);
    let mean = scores.iter().map(squared_error).sum::<f64>() / scores.len() as f64;
    let Scores { ssim, ssimulacra2, .. } = Scores::mean(scores);
    Likeness { psnr: decibels(mean).min(EQUAL), ssim, ssimulacra2, views: scores.len() }
}

/// What is said where there is nothing to compare.
const NOTHING: &str = "no estimate of the loss: nothing of the model shows in the pictures";

/// The worse of both as JSON, and both.
pub(crate) fn json(loss: &LossEstimate) -> Value {
    let Some(worse) = loss.worse() else { return Value::Null };
    let mut all = one(&worse);
    all["at_cameras"] = loss.at_cameras.as_ref().map_or(Value::Null, one);
    all["around"] = loss.around.as_ref().map_or(Value::Null, one);
    all
}

fn one(likeness: &Likeness) -> Value {
    let Likeness { psnr, ssim, ssimulacra2, views } = likeness;
    let meaning = likeness.meaning();
    json!({ "psnr": psnr, "ssim": ssim, "ssimulacra2": ssimulacra2, "views": views, "meaning": meaning })
}

/// What helps against a loss that is easy to see.
pub(crate) fn warning(loss: &LossEstimate, drop_unseen: bool, by_cameras: bool) -> Option<String> {
    loss.worse().filter(Likeness::is_poor)?;
    Some(match (loss.at_cameras.is_some_and(|l| l.is_poor()), drop_unseen) {
        (false, true) => "away from the cameras the loss is easy to see; without --drop-unseen the rest is kept".into(),
        _ if by_cameras => "the loss is easy to see; a higher --quality keeps more".into(),
        _ => "the loss is easy to see; a higher --quality keeps more, and so does --cameras at the same size".into(),
    })
}
