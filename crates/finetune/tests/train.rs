//! The fine-tune recovers a spoilt model, gives the same bits for any number of threads and after
//! a resumption, and stops as the options say.

mod common;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use finetune::{
    Error, FineTune, FineTuneOptions, Image, Loss, Outcome, Quantization, QuantizationMode,
    RenderOptions, StopReason, TrainView, render,
};
use gs_model::Scene;

const SIZE: (u32, u32) = (70, 45);

/// Views of a scene from cameras around [`common::camera`].
fn views(scene: &Scene, count: usize) -> Vec<TrainView> {
    (0..count)
        .map(|i| {
            let mut camera = common::camera(SIZE.0, SIZE.1);
            camera.translation += glam::DVec3::new(0.2 * i as f64 - 0.4, 0.1 * i as f64, 0.0);
            let image = render(scene, &camera, &RenderOptions::default());
            let photo = Image::from_rgb8(SIZE.0, SIZE.1, &image.to_rgb8()).unwrap();
            TrainView { camera, photo }
        })
        .collect()
}

/// The scene with every trainable attribute disturbed.
fn spoilt(scene: &Scene) -> Scene {
    let mut r = testing::Rng::seeded(99);
    let mut s = scene.clone();
    s.sh.iter_mut().flatten().for_each(|v| *v += r.range_f32(-0.2, 0.2));
    s.opacity_logits.iter_mut().for_each(|v| *v += r.range_f32(-0.5, 0.5));
    s.log_scales.iter_mut().flatten().for_each(|v| *v += r.range_f32(-0.3, 0.3));
    s.rotations.iter_mut().flatten().for_each(|v| *v += r.range_f32(-0.1, 0.1));
    s
}

fn options(steps: u64) -> FineTuneOptions {
    FineTuneOptions { steps, ..FineTuneOptions::default() }
}

fn run(options: FineTuneOptions) -> Outcome {
    let scene = common::scene(80, 2, 5);
    let views = views(&scene, 5);
    FineTune::new(spoilt(&scene), views, options).unwrap().run(|_| {}).unwrap()
}

fn hash(scene: &Scene) -> u64 {
    let mut h = 0xcbf2_9ce4_8422_2325u64;
    let all = scene.sh.as_flattened().iter().chain(&scene.opacity_logits);
    let all = all.chain(scene.log_scales.as_flattened()).chain(scene.rotations.as_flattened());
    for v in all {
        h = (h ^ u64::from(v.to_bits())).wrapping_mul(0x0100_0000_01b3);
    }
    h
}

#[test]
fn recovers_a_spoilt_model_without_moving_means() {
    let scene = common::scene(80, 2, 5);
    for loss in [Loss::Mse, Loss::default()] {
        let out = run(FineTuneOptions { loss, ..options(300) });
        let (first, last) = (out.epoch_psnr[0], *out.epoch_psnr.last().unwrap());
        println!("{loss:?}: {first:.2} dB -> {last:.2} dB");
        assert_eq!(out.reason, StopReason::Steps);
        assert_eq!(out.scene.means, scene.means);
        assert!(last > first + 8.0 && last > 35.0, "{loss:?}: {first} -> {last}");
    }
}

#[test]
fn same_bits_for_any_number_of_threads_and_twice() {
    let hashes: Vec<u64> = [1, 2, 8, 2]
        .into_iter()
        .map(|threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            hash(&pool.install(|| run(options(25))).scene)
        })
        .collect();
    assert!(hashes.iter().all(|&h| h == hashes[0]), "{hashes:x?}");
    let other = run(FineTuneOptions { seed: 1, ..options(25) });
    assert_ne!(hash(&other.scene), hashes[0], "the seed has no effect");
}

#[test]
fn an_interrupted_run_resumes_to_the_same_bits() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run.ckpt");
    let noise = Quantization {
        mode: QuantizationMode::UniformNoise,
        sh_rest: 0.05,
        opacity_logit: 0.1,
        ..Quantization::default()
    };
    let with = |checkpoint, cancel| FineTuneOptions {
        checkpoint,
        cancel,
        quantization: Some(noise),
        report_every: 1,
        ..options(33)
    };
    let whole = run(with(None, None));
    let scene = common::scene(80, 2, 5);
    // Cancelled in the middle of an epoch of five views.
    let flag = Arc::new(AtomicBool::new(false));
    let set = with(Some(path.clone()), Some(flag.clone()));
    let part = FineTune::new(spoilt(&scene), views(&scene, 5), set).unwrap();
    let out = part
        .run(|p| {
            if p.step == 18 {
                flag.store(true, Ordering::Relaxed);
            }
        })
        .unwrap();
    assert_eq!((out.reason, out.steps), (StopReason::Cancelled, 18));
    let rest = with(Some(path.clone()), None);
    let rest = FineTune::new(spoilt(&scene), views(&scene, 5), rest).unwrap();
    assert_eq!(rest.steps_done(), 18);
    let out = rest.run(|_| {}).unwrap();
    assert_eq!(hash(&out.scene), hash(&whole.scene));
    assert_eq!(out.epoch_psnr, whole.epoch_psnr);
}

#[test]
fn bad_checkpoints_are_errors() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run.ckpt");
    let set = || FineTuneOptions { checkpoint: Some(path.clone()), ..options(3) };
    run(set());
    let good = std::fs::read(&path).unwrap();
    let scene = common::scene(80, 2, 5);
    let open = |scene: Scene| {
        let views = views(&scene, 5);
        FineTune::new(scene, views, set()).map(|f| f.steps_done())
    };
    assert_eq!(open(scene.clone()).unwrap(), 3);
    for cut in [0, 7, 12, 40, good.len() / 2, good.len() - 1] {
        std::fs::write(&path, &good[..cut]).unwrap();
        assert!(matches!(open(scene.clone()), Err(Error::Checkpoint { .. })), "cut at {cut}");
    }
    for at in (0..good.len()).step_by(good.len() / 50) {
        let mut bad = good.clone();
        bad[at] ^= 0x10;
        std::fs::write(&path, &bad).unwrap();
        assert!(open(scene.clone()).is_err(), "flipped a bit of byte {at}");
    }
    std::fs::write(&path, &good).unwrap();
    let mut moved = scene;
    moved.means[3][1] += 1e-3;
    assert!(matches!(open(moved), Err(Error::CheckpointMismatch { .. })));
}

#[test]
fn stops_at_the_target_and_when_nothing_improves() {
    let reached = run(FineTuneOptions { target_psnr: Some(25.0), ..options(2000) });
    assert_eq!(reached.reason, StopReason::TargetReached);
    assert!(reached.steps < 2000 && *reached.epoch_psnr.last().unwrap() >= 25.0);
    let rates = finetune::LearningRates {
        sh_dc: 0.0,
        sh_rest: 0.0,
        opacity: 0.0,
        log_scale: 0.0,
        rotation: 0.0,
    };
    let stale = run(FineTuneOptions { rates, patience: Some(3), ..options(2000) });
    assert_eq!((stale.reason, stale.steps), (StopReason::NoImprovement, 20));
}

#[test]
fn quantisation_in_the_loop_makes_the_quantised_model_better() {
    let q = Quantization {
        sh_dc: 0.15,
        sh_rest: 0.3,
        opacity_logit: 0.8,
        log_scale: 0.25,
        ..Quantization::default()
    };
    let coarse = |scene: &Scene| {
        let mut s = scene.clone();
        let round = |v: &mut f32, step: f32| *v = (*v / step).round() * step;
        let k = s.sh_len();
        for (i, v) in s.sh.iter_mut().enumerate() {
            v.iter_mut().for_each(|v| round(v, if i % k == 0 { q.sh_dc } else { q.sh_rest }));
        }
        s.opacity_logits.iter_mut().for_each(|v| round(v, q.opacity_logit));
        s.log_scales.iter_mut().flatten().for_each(|v| round(v, q.log_scale));
        s
    };
    let scene = common::scene(80, 2, 5);
    let views = views(&scene, 5);
    let psnr = |scene: &Scene| {
        let sum: f64 = views
            .iter()
            .map(|v| {
                let image = render(scene, &v.camera, &RenderOptions::default());
                finetune::metrics::psnr(&image, &v.photo)
            })
            .sum();
        sum / views.len() as f64
    };
    // The gain of one run depends on how values happen to round, so the test takes a mean.
    let mut gain = 0.0;
    for seed in 0..3 {
        let o = || FineTuneOptions { seed, ..options(1500) };
        let blind = psnr(&coarse(&run(o()).scene));
        let aware = run(FineTuneOptions { quantization: Some(q), ..o() });
        let aware = psnr(&coarse(&aware.scene));
        println!("seed {seed}, quantised after tuning: {blind:.2} dB blind, {aware:.2} dB aware");
        gain += (aware - blind) / 3.0;
    }
    assert!(gain > 0.5, "{gain} dB");
}

#[test]
fn bad_input_is_an_error() {
    let scene = common::scene(10, 0, 1);
    let good = views(&scene, 2);
    let new = |scene: &Scene, views: &[TrainView], o| {
        FineTune::new(scene.clone(), views.to_vec(), o).map(|_| ())
    };
    assert!(new(&scene, &good, options(1)).is_ok());
    assert!(matches!(new(&scene, &[], options(1)), Err(Error::NoViews)));
    let mut bad = good.clone();
    bad[1].photo = Image::new(3, 3);
    assert!(matches!(new(&scene, &bad, options(1)), Err(Error::PhotoSize { index: 1, .. })));
    bad[1].photo = Image::new(0, 0);
    bad[1].camera.width = 0;
    assert!(matches!(new(&scene, &bad, options(1)), Err(Error::ViewSize { index: 1, .. })));
    let mut distorted = good.clone();
    distorted[1].camera.ignored_distortion = Some("SIMPLE_RADIAL".into());
    let error = new(&scene, &distorted, options(1)).unwrap_err();
    assert!(matches!(error, Error::DistortedView { index: 1, .. }), "{error}");
    assert!(error.to_string().contains("colmap image_undistorter"), "{error}");
    let mut nan = scene.clone();
    nan.log_scales[4][1] = f32::NAN;
    assert!(matches!(new(&nan, &good, options(1)), Err(Error::Scene(_))));
    let o = FineTuneOptions { final_rate: 0.0, ..options(1) };
    assert!(matches!(new(&scene, &good, o), Err(Error::Option { option: "final_rate", .. })));
}
