//! How close two models come to the photos.

use super::words;
use crate::progress::Meter;
use finetune::TrainView;
use finetune::metrics::Scores;
use gs_model::Scene;

/// Means over the photos, of each model; `None` without photos.
pub(super) fn scores(models: [&Scene; 2], photos: &[TrainView]) -> Option<[Scores; 2]> {
    if photos.is_empty() {
        return None;
    }
    let steps = Meter::new("photos", 2 * photos.len());
    let score = |photo: &TrainView, model| {
        steps.inc();
        photo.scores(model)
    };
    Some(
        models
            .map(|model| Scores::mean(&photos.iter().map(|p| score(p, model)).collect::<Vec<_>>())),
    )
}

/// For a person.
pub(super) fn human(scores: &[Scores; 2], photos: usize) -> String {
    let [reference, model] = scores.each_ref().map(words);
    format!(
        "photos, mean over {photos}: the reference {reference}\n                    the model {model}\n"
    )
}
