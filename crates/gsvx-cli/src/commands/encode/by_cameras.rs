//! An encode with the cameras and photos that a path names, its progress and its errors.

use crate::progress::Meter;
use crate::views::Origin;
use crate::{doubts, views};
use anyhow::{Result, anyhow};
use gs_model::{Camera, Scene};
use gsvx::EncodeProgress;
use std::ops::ControlFlow;
use std::path::Path;
use tune::{EncodeEvent, EncodeOutcome, EncodeRecipe};

/// The stream by a recipe with the cameras at `path`, and where these are from.
pub(super) fn encoded(
    scene: Scene,
    name: &str,
    path: Option<&Path>,
    recipe: EncodeRecipe<'_>,
) -> Result<(EncodeOutcome, Option<Origin>)> {
    let (photos, placed) = views::with_photos(path, &scene)?;
    let (cameras, origin) = placed.map(|p| (p.cameras, p.origin)).unzip();
    let recipe = EncodeRecipe { cameras: cameras.as_deref(), photos: &photos, ..recipe };
    let path = path.unwrap_or(Path::new(""));
    let outcome = tune::encode(scene, &recipe, meters(recipe.cameras))
        .map_err(|error| explained(error, path, name))?;
    outcome.doubts.iter().for_each(|doubt| doubts::warn(path, doubt));
    Ok((outcome, origin.flatten()))
}

/// Why a model, which is called `name`, was not encoded. `cameras` names the cameras.
pub(crate) fn explained(error: tune::Error, cameras: &Path, name: &str) -> anyhow::Error {
    match error {
        tune::Error::OtherPhotos { .. } => doubts::refused(cameras, &error),
        tune::Error::NothingSeen => anyhow!("{}: {error}", cameras.display()),
        other => anyhow::Error::new(other).context(name.to_owned()),
    }
}

/// Shows how far an encode is.
pub(crate) fn meters(
    cameras: Option<&[Camera]>,
) -> impl FnMut(EncodeEvent<'_>) -> ControlFlow<()> + use<> {
    let mut bar = cameras.map(|cameras| Meter::new("importance", cameras.len()));
    move |event| {
        let (what, done, all) = match event {
            EncodeEvent::Visibility(done, all) => ("importance", done, all),
            EncodeEvent::References(done, all) => ("renders of the input", done, all),
            EncodeEvent::Encoder(event) => {
                bar = None;
                if let EncodeProgress::Begins(quality) = event {
                    bar = Some(Meter::spinner(format!("encoding at quality {quality:.1}")));
                }
                return ControlFlow::Continue(());
            }
        };
        bar.get_or_insert_with(|| Meter::new(what, all)).set(done as u64, String::new());
        if done == all {
            bar = None;
        }
        ControlFlow::Continue(())
    }
}
