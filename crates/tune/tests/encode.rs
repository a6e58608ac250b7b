//! `tune::encode`: what `gsvx encode` does, for Rust.

use std::ops::ControlFlow;

use finetune::TrainView;
use gs_model::{Camera, Scene, dataset, ply};
use gsvx::{Aim, LEFT_OUT};
use tune::{CameraDoubt, EncodeEvent, EncodeOutcome, EncodeRecipe, Error};

/// The room, and some of its cameras.
fn room() -> (Scene, Vec<Camera>) {
    let room = testing::fixture("room");
    let views = dataset::open_views(&room).unwrap().into_iter().step_by(4);
    (ply::read(room.join("point_cloud.ply")).unwrap().0, views.map(|view| view.camera).collect())
}

fn encode(scene: &Scene, recipe: &EncodeRecipe<'_>) -> tune::Result<EncodeOutcome> {
    tune::encode(scene.clone(), recipe, |_| ControlFlow::Continue(()))
}

#[test]
fn rows_and_counts_are_those_of_the_whole_model() {
    let (scene, cameras) = room();
    let recipe = EncodeRecipe { cameras: Some(&cameras), ..EncodeRecipe::default() };
    let outcome = encode(&scene, &recipe).unwrap();
    let (encoded, seen) = (&outcome.output.encoded, outcome.seen.unwrap());
    assert!(encoded.transparent > 0 && !outcome.cameras_ignored());
    let left_out = encoded.rows.iter().filter(|row| **row == LEFT_OUT).count();
    assert_eq!(encoded.rows.len(), scene.len());
    assert_eq!(left_out, encoded.transparent + encoded.left_out);
    assert_eq!(seen.unseen + seen.hardly_seen - seen.kept, encoded.left_out);
}

#[test]
fn cameras_of_another_frame_decide_nothing() {
    let (scene, mut cameras) = room();
    let plain = encode(&scene, &EncodeRecipe::default()).unwrap().output;
    cameras.iter_mut().for_each(|camera| camera.translation *= 0.3);
    let recipe = EncodeRecipe { cameras: Some(&cameras), ..EncodeRecipe::default() };
    let outcome = encode(&scene, &recipe).unwrap();
    assert!(matches!(outcome.doubts[..], [.., CameraDoubt::Misfit(_)]), "{:?}", outcome.doubts);
    assert!(outcome.output.encoded.bytes == plain.encoded.bytes);
    // Cameras that look away.
    cameras.iter_mut().for_each(|camera| camera.translation.z = -1e6);
    let recipe = EncodeRecipe { cameras: Some(&cameras), ..EncodeRecipe::default() };
    assert!(matches!(encode(&scene, &recipe), Err(Error::NothingSeen)));
}

#[test]
fn with_cameras_a_lower_degree_keeps_the_colours_that_they_see() {
    let (scene, cameras) = room();
    let mut recipe = EncodeRecipe { cameras: Some(&cameras), ..EncodeRecipe::default() };
    recipe.options.code.max_sh_degree = 1;
    let mut cut = scene.clone();
    cut.cut_sh(1);
    let psnr = |model: &Scene| {
        let encoded = encode(model, &recipe).unwrap().output.encoded;
        let decoded = encoded.decode().unwrap();
        assert_eq!(decoded.sh_degree, 1);
        let views = cameras.iter().step_by(3).map(|c| TrainView::rendered(&scene, c.clone()));
        views.map(|view| view.psnr(&decoded)).sum::<f64>()
    };
    let views = cameras.len().div_ceil(3) as f64;
    assert!(psnr(&scene) > psnr(&cut) + 0.5 * views);
}

#[test]
fn a_bound_on_errors_is_that_of_the_lower_coefficients_as_they_are() {
    let (scene, cameras) = room();
    let aim = Aim::MaxError(gsvx::MaxError::all(0.01));
    let mut recipe = EncodeRecipe { aim, cameras: Some(&cameras), ..EncodeRecipe::default() };
    recipe.options.code.max_sh_degree = 1;
    let mut cut = scene.clone();
    cut.cut_sh(1);
    let bytes = |model: &Scene| encode(model, &recipe).unwrap().output.encoded.bytes;
    assert!(bytes(&scene) == bytes(&cut));
}

#[test]
fn a_break_ends_the_work_at_any_event() {
    let (scene, cameras) = room();
    let aim = Aim::Alike { measure: gsvx::Measure::Psnr, target: 30.0 };
    let recipe = EncodeRecipe { aim, cameras: Some(&cameras), ..EncodeRecipe::default() };
    let kinds: [fn(&EncodeEvent<'_>) -> bool; 3] = [
        |event| matches!(event, EncodeEvent::Visibility(..)),
        |event| matches!(event, EncodeEvent::References(..)),
        |event| matches!(event, EncodeEvent::Encoder(_)),
    ];
    for is_kind in kinds {
        let end = |event: EncodeEvent<'_>| match is_kind(&event) {
            true => ControlFlow::Break(()),
            false => ControlFlow::Continue(()),
        };
        let ended = tune::encode(scene.clone(), &recipe, end);
        assert!(matches!(ended, Err(Error::Codec(gsvx::Error::Cancelled))));
    }
}
