//! Short trainings on the scene in `fixtures/room`.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use finetune::TrainView;
use gs_model::colmap::Point;
use gs_model::dataset;
use tune::{StopReason, Train, TrainOptions, TrainOutcome};

fn room() -> PathBuf {
    testing::fixture("room")
}

fn points() -> Vec<Point> {
    dataset::open_points(room()).unwrap()
}

/// The views to train on, and those held out.
fn views() -> [Vec<TrainView>; 2] {
    let all = dataset::open_views(room()).unwrap();
    let all = tune::photos(&room(), &all).unwrap().views;
    let (mut training, mut held_out) = (Vec::new(), Vec::new());
    for (i, view) in all.into_iter().enumerate() {
        if i % 8 == 0 { held_out.push(view) } else { training.push(view) }
    }
    [training, held_out]
}

fn train(options: &TrainOptions) -> TrainOutcome {
    let [training, _] = views();
    Train::new(&points(), training, options.clone()).unwrap().run(|_| ()).unwrap()
}

#[test]
fn a_model_grows_from_points_to_its_cap_and_shows_the_held_out_photos() {
    let options = TrainOptions { steps: 600, cap: 5000, ..TrainOptions::default() };
    let trained = train(&options);
    assert!(!trained.scene.antialiased);
    assert_eq!((trained.scene.len(), trained.reason), (5000, StopReason::Steps));
    trained.scene.validate().unwrap();
    let [_, held_out] = views();
    let psnr = held_out.iter().map(|v| v.psnr(&trained.scene)).sum::<f64>() / held_out.len() as f64;
    assert!(psnr > 23.0, "{psnr}");
}

/// It is interrupted between relocations and in the step of one. Large photos come in windows at the end.
#[test]
fn a_training_that_is_interrupted_ends_with_the_same_model() {
    let dir = tempfile::tempdir().unwrap();
    let whole = TrainOptions { steps: 300, cap: 4000, pixels: 5000, ..TrainOptions::default() };
    let cancel = Arc::new(AtomicBool::new(false));
    let parts = TrainOptions {
        checkpoint: Some(dir.path().join("room.ckpt")),
        cancel: Some(cancel.clone()),
        ..whole.clone()
    };
    for stop in [130, 200] {
        cancel.store(false, Ordering::Relaxed);
        let [training, _] = views();
        let run = Train::new(&points(), training, parts.clone()).unwrap();
        let part = run.run(|p| cancel.store(p.step >= stop, Ordering::Relaxed)).unwrap();
        assert_eq!((part.steps, part.reason), (stop, StopReason::Cancelled));
    }
    cancel.store(false, Ordering::Relaxed);
    assert_eq!(train(&parts).scene, train(&whole).scene);
}

#[test]
fn an_antialiased_model_is_trained_as_such() {
    let options = TrainOptions { steps: 20, cap: 4000, ..TrainOptions::default() };
    let [plain, antialiased] = [false, true]
        .map(|antialiased| train(&TrainOptions { antialiased, ..options.clone() }).scene);
    assert!(antialiased.antialiased && !plain.antialiased);
    assert_ne!(antialiased.opacity_logits, plain.opacity_logits);
}

#[test]
fn what_cannot_be_trained_is_refused_in_one_line() {
    let refused = |points: &[Point], options: TrainOptions, views: Vec<TrainView>| {
        let error = Train::new(points, views, options).unwrap_err().to_string();
        assert!(!error.contains('\n'), "{error}");
        error
    };
    let [training, _] = views();
    let none = refused(&[], TrainOptions::default(), training.clone());
    assert!(none.contains("number of points"), "{none}");
    let few = TrainOptions { cap: 100, ..TrainOptions::default() };
    assert!(refused(&points(), few, training).contains("cap is 100"));
    refused(&points(), TrainOptions::default(), Vec::new());
}
