//! The fine-tune of attributes recovers a spoilt model, gives the same bits for any number of threads and after
//! a resumption, and stops as the options say.

#[path = "../../finetune/tests/common/mod.rs"]
mod common;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use finetune::{Loss, Photo, RenderOptions, TrainView, render};
use gs_model::Scene;
use gs_model::lens::Lens;
use testing::sha256;
use tune::{Error, FineTune, FineTuneOptions, FineTuneOutcome, StopReason};

const SIZE: (u32, u32) = (70, 45);

/// Views of a scene from cameras around [`common::camera`].
fn views(scene: &Scene, count: usize) -> Vec<TrainView> {
    let view = |i| {
        let mut camera = common::camera(SIZE.0, SIZE.1);
        camera.translation += glam::DVec3::new(0.2 * i as f64 - 0.4, 0.1 * i as f64, 0.0);
        let image = render(scene, &camera, &RenderOptions::default());
        let photo = Photo::from(&image);
        TrainView { camera, photo }
    };
    (0..count).map(view).collect()
}

fn scene() -> Scene {
    common::scene(80, 2, 5)
}

/// The scene with every trainable attribute disturbed.
fn spoilt() -> Scene {
    let mut r = testing::Rng::seeded(99);
    let mut s = scene();
    s.sh.iter_mut().flatten().for_each(|v| *v += r.range_f32(-0.2, 0.2));
    s.opacity_logits.iter_mut().for_each(|v| *v += r.range_f32(-0.5, 0.5));
    s.log_scales.iter_mut().flatten().for_each(|v| *v += r.range_f32(-0.3, 0.3));
    s.rotations.iter_mut().flatten().for_each(|v| *v += r.range_f32(-0.1, 0.1));
    s
}

fn options(steps: u64) -> FineTuneOptions {
    FineTuneOptions { steps, ..FineTuneOptions::default() }
}

fn run(options: FineTuneOptions) -> FineTuneOutcome {
    FineTune::new(spoilt(), views(&scene(), 7), options).unwrap().run(|_| {}).unwrap()
}

#[test]
fn recovers_a_spoilt_model_without_moving_means() {
    for loss in [Loss::MSE, Loss::L1_SSIM] {
        let out = run(FineTuneOptions { loss, ..options(300) });
        let (first, last) = (out.pass_psnr[0], *out.pass_psnr.last().unwrap());
        println!("{loss:?}: {first:.2} dB -> {last:.2} dB");
        assert_eq!(out.reason, StopReason::Steps);
        assert_eq!(out.scene.means, scene().means);
        assert!(last > first + 8.0 && last > 35.0, "{loss:?}: {first} -> {last}");
    }
}

#[test]
fn same_bits_for_any_number_of_threads_and_twice() {
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        sha256(&pool.install(|| run(options(25))).scene)
    };
    let one = on(1);
    assert!([2, 8, 2].into_iter().all(|threads| on(threads) == one));
    let other = run(FineTuneOptions { seed: 1, ..options(25) });
    assert_ne!(sha256(&other.scene), one, "the seed has no effect");
}

#[test]
fn an_interrupted_run_resumes_to_the_same_bits() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run.ckpt");
    let whole = run(options(33));
    let with = |cancel| FineTuneOptions { checkpoint: Some(path.clone()), cancel, ..options(33) };
    // Cancelled in the middle of a pass over seven views.
    let flag = Arc::new(AtomicBool::new(false));
    let part = FineTune::new(spoilt(), views(&scene(), 7), with(Some(flag.clone()))).unwrap();
    let out = part.run(|p| flag.store(p.step >= 20, Ordering::Relaxed)).unwrap();
    assert_eq!((out.reason, out.steps), (StopReason::Cancelled, 20));
    let rest = FineTune::new(spoilt(), views(&scene(), 7), with(None)).unwrap();
    assert_eq!(rest.steps_done(), 20);
    let out = rest.run(|_| {}).unwrap();
    assert_eq!(sha256(&out.scene), sha256(&whole.scene));
    assert_eq!(out.pass_psnr, whole.pass_psnr);
}

#[test]
fn bad_checkpoints_are_errors() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run.ckpt");
    let set = || FineTuneOptions { checkpoint: Some(path.clone()), ..options(3) };
    run(set());
    let good = std::fs::read(&path).unwrap();
    let open = |scene: Scene, o| {
        let views = views(&common::scene(80, 2, 5), 7);
        FineTune::new(scene, views, o).map(|f| f.steps_done())
    };
    assert_eq!(open(spoilt(), set()).unwrap(), 3);
    for cut in [0, 7, 12, 40, good.len() / 2, good.len() - 1] {
        std::fs::write(&path, &good[..cut]).unwrap();
        let error = open(spoilt(), set());
        assert!(matches!(error, Err(Error::Checkpoint { .. })), "cut at {cut}");
    }
    for at in (0..good.len()).step_by(good.len() / 50) {
        let mut bad = good.clone();
        bad[at] ^= 0x10;
        std::fs::write(&path, &bad).unwrap();
        assert!(open(spoilt(), set()).is_err(), "flipped a bit of byte {at}");
    }
    std::fs::write(&path, &good).unwrap();
    let mut moved = spoilt();
    moved.means[3][1] += 1e-3;
    assert!(matches!(open(moved, set()), Err(Error::OtherRun { .. })));
    let other = FineTuneOptions { loss: Loss::MSE, ..set() };
    assert!(matches!(open(spoilt(), other), Err(Error::OtherRun { .. })));
    // More steps than the run before had.
    assert_eq!(open(spoilt(), FineTuneOptions { steps: 9, ..set() }).unwrap(), 3);
}

#[test]
fn stops_at_the_target() {
    let reached = run(FineTuneOptions { target_psnr: Some(25.0), ..options(2000) });
    assert_eq!(reached.reason, StopReason::TargetReached);
    assert!(reached.steps < 2000 && reached.steps.is_multiple_of(7));
    assert!(*reached.pass_psnr.last().unwrap() >= 25.0);
}

#[test]
fn bad_input_is_an_error() {
    use finetune::Error as Views;
    let good = views(&scene(), 2);
    let new = |scene: &Scene, views: &[TrainView], o| {
        FineTune::new(scene.clone(), views.to_vec(), o).map(|_| ())
    };
    let refused = |views: &[TrainView]| match new(&scene(), views, options(1)) {
        Err(Error::Finetune(error)) => error,
        other => panic!("{other:?}"),
    };
    assert!(new(&scene(), &good, options(1)).is_ok());
    assert!(matches!(refused(&[]), Views::NoViews));
    let mut bad = good.clone();
    bad[1].photo = Photo::black(3, 3);
    assert!(matches!(refused(&bad), Views::PhotoSize { index: 1, .. }));
    bad[1].photo = Photo::black(0, 0);
    bad[1].camera.width = 0;
    assert!(matches!(refused(&bad), Views::ViewSize { index: 1, .. }));
    let mut distorted = good.clone();
    let lens = Lens { model: "SIMPLE_RADIAL".into(), coefficients: vec![0.1] };
    distorted[1].camera.lens = Some(lens);
    let error = refused(&distorted);
    assert!(matches!(error, Views::DistortedView { index: 1, .. }), "{error}");
    let mut nan = scene();
    nan.log_scales[4][1] = f32::NAN;
    assert!(matches!(new(&nan, &good, options(1)), Err(Error::Scene(_))));
    let o = FineTuneOptions { loss: Loss::mse_ssim(-0.2), ..options(1) };
    assert!(matches!(
        new(&scene(), &good, o),
        Err(Error::Option { option: "weight of the loss", .. })
    ));
}
