//! Short runs on the scene in `fixtures/room`.

use std::ops::ControlFlow;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use finetune::framing::nearby;
use finetune::{Photo, RenderOptions, TrainView, Visibility, render};
use gs_model::{Camera, Scene, dataset, ply};
use gsvx::{Aim, EncodeOptions, Encoder};
use tune::{
    Error, Layout, Progress, Target, Targets, Tune, TuneEffort, TuneOptions, TuneOutcome, TunePlan,
};

fn room() -> PathBuf {
    testing::fixture("room")
}

fn model() -> Scene {
    ply::read(room().join("point_cloud.ply")).unwrap().0
}

/// All views, in order.
fn views() -> Vec<TrainView> {
    let load = |view: gs_model::View| {
        let photo = image::open(&view.image_path).unwrap().to_rgb8();
        let (width, height) = photo.dimensions();
        let photo = Photo::new(width, height, photo.into_raw()).unwrap();
        TrainView { camera: view.camera.scaled_to(width, height).unwrap(), photo }
    };
    dataset::open_views(room()).unwrap().into_iter().map(load).collect()
}

fn training() -> Vec<TrainView> {
    views().into_iter().enumerate().filter(|(i, _)| i % 8 != 0).map(|(_, v)| v).collect()
}

fn photos() -> Targets {
    Targets::Photos(training())
}

fn short(target: Target) -> TuneOptions {
    let mut options = TuneOptions::new(target);
    options.plan = Some(TunePlan {
        quality: 54.0,
        fraction: 0.5,
        rounds: 2,
        round_steps: 60,
        loop_steps: 150,
    });
    options
}

fn tuned(options: &TuneOptions) -> TuneOutcome {
    Tune::new(model(), photos(), options.clone()).unwrap().run(|_| ()).unwrap()
}

fn bits(scene: &Scene) -> Vec<u32> {
    let Scene { means, rotations, log_scales, opacity_logits, sh, .. } = scene;
    let floats = means.as_flattened().iter().chain(rotations.as_flattened());
    let floats = floats.chain(log_scales.as_flattened()).chain(opacity_logits);
    floats.chain(sh.as_flattened()).map(|v| v.to_bits()).collect()
}

/// The prototype coded the latents again, and lost up to 1 dB.
#[test]
fn the_stream_is_what_the_loop_rendered_and_its_bytes_are_those_counted() {
    let outcome = tuned(&short(Target::Quality(54.0)));
    let decoded = gsvx::decode(&outcome.encoded.bytes).unwrap();
    assert_eq!(bits(&decoded), bits(&outcome.scene));
    let (camera, options) = (&views()[0].camera, RenderOptions::default());
    assert_eq!(render(&decoded, camera, &options), render(&outcome.scene, camera, &options));
    let (counted, real) = (outcome.counted_bytes as f64, outcome.encoded.bytes.len() as f64);
    assert!((counted / real - 1.0).abs() < 0.005, "{counted} counted, {real} real");
}

/// Of the shortest effort: fewer bytes than without tuning, and a higher PSNR at views that were held out.
#[test]
fn a_short_tune_saves_bytes_at_held_out_views() {
    let held_out: Vec<TrainView> = views().into_iter().step_by(8).collect();
    let score =
        |scene: &Scene| held_out.iter().map(|v| v.psnr(scene)).sum::<f64>() / held_out.len() as f64;
    let mut options = TuneOptions::new(Target::Quality(60.0));
    options.effort = TuneEffort::Quick;
    let outcome = tuned(&options);
    let cameras: Vec<Camera> = training().into_iter().map(|v| v.camera).collect();
    let importance = Visibility::of_all(&model(), &cameras).squared;
    // The untuned stream of the same PSNR.
    let options = EncodeOptions::default();
    let untuned = gsvx::encode(&model(), Some(&importance), 50.0, &options).unwrap().bytes;
    let (tuned_db, untuned_db) = (score(&outcome.scene), score(&gsvx::decode(&untuned).unwrap()));
    let (tuned, untuned) = (outcome.encoded.bytes.len(), untuned.len());
    println!("tuned {tuned} bytes, {tuned_db:.2} dB; untuned {untuned} bytes, {untuned_db:.2} dB");
    assert!(tuned_db > untuned_db && (tuned as f64) < 0.8 * untuned as f64);
}

#[test]
fn what_the_photos_do_not_show_stays_unless_it_is_dropped() {
    // The cameras look at one side.
    let few: Vec<TrainView> = training().into_iter().take(10).collect();
    let run = |drop_unseen: bool| {
        let mut options = short(Target::Quality(54.0));
        options.drop_unseen = drop_unseen;
        let mut looks = Vec::new();
        let looked = |done, all| looks.push((done, all));
        let run =
            Tune::with_progress(model(), Targets::Photos(few.clone()), options, looked).unwrap();
        let all = looks.len();
        assert!(all == if drop_unseen { 10 } else { 19 }, "{all}");
        assert_eq!(looks, (1..=all).map(|done| (done, all)).collect::<Vec<_>>());
        run.run(|_| ()).unwrap()
    };
    let (dropped, kept) = (run(true), run(false));
    let [without, with] = [&dropped, &kept].map(|outcome| outcome.against_input.unwrap());
    assert!(with.nearby > without.nearby + 3.0, "{with:?}, dropped: {without:?}");
    assert!(with.aside > without.aside - 2.0, "{with:?}, dropped: {without:?}");

    // At other views beside the cameras it is better than an untuned stream of as many bytes.
    let cameras: Vec<Camera> = few.into_iter().map(|v| v.camera).collect();
    let mut untuned = Encoder::new(Aim::Bytes(kept.encoded.bytes.len() as u64));
    let importance = Visibility::of_all(&model(), &cameras).squared;
    let untuned = untuned.encode(&model(), Some(&importance)).unwrap().encoded.decode().unwrap();
    let render = |camera| TrainView::rendered(&model(), camera);
    let beside: Vec<_> = nearby(&model(), &cameras, 12, 2).into_iter().map(render).collect();
    let psnr = |scene: &Scene| beside.iter().map(|v| v.psnr(scene)).sum::<f64>() / 12.0;
    let (tuned, untuned) = (psnr(&kept.scene), psnr(&untuned));
    assert!(tuned > untuned, "{tuned:.2} dB, {untuned:.2} dB without tuning");
}

/// A page showed nothing of a tuned stream before all of it had come.
#[test]
fn a_tuned_stream_for_the_web_begins_with_a_coarse_level_that_fits_the_target() {
    let mut options = short(Target::Bytes(60_000));
    options.layout = Layout::Web;
    let outcome = tuned(&options);
    let (bytes, counted) = (outcome.encoded.bytes.len(), outcome.counted_bytes as f64);
    assert!(outcome.reached && bytes > 58_000, "{bytes}");
    assert!((counted / bytes as f64 - 1.0).abs() < 0.005, "{counted} counted, {bytes} real");
    assert_eq!(bits(&gsvx::decode(&outcome.encoded.bytes).unwrap()), bits(&outcome.scene));
    let chunks = &outcome.encoded.index.chunks;
    assert!(chunks[0].lod > 0 && chunks.iter().all(|c| c.count <= 1 << 14));
    // What arrives first looks like the whole, as much as that of an encoder does.
    let camera = &views()[0].camera;
    let whole = TrainView::rendered(&outcome.scene, camera.clone());
    let coarse = |stream: &[u8]| {
        let mut options = gsvx::DecodeOptions::default();
        options.lod = 1;
        gsvx::decode_with(stream, &options).unwrap().scene
    };
    let mut encoder = Encoder::new(Aim::Quality(54.0));
    encoder.options.code.for_web();
    let untuned = encoder.encode(&model(), None).unwrap().encoded;
    let theirs = TrainView::rendered(&untuned.decode().unwrap(), camera.clone());
    let (tuned, untuned) =
        (whole.psnr(&coarse(&outcome.encoded.bytes)), theirs.psnr(&coarse(&untuned.bytes)));
    println!("coarse from whole: {tuned:.2} dB tuned, {untuned:.2} dB untuned");
    assert!(tuned > untuned - 2.0, "{tuned} dB, {untuned} dB untuned");
}

#[test]
fn the_bytes_are_the_same_for_any_number_of_threads() {
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| tuned(&short(Target::Quality(54.0)))).encoded.bytes
    };
    assert!(on(1) == on(3));
}

#[test]
fn a_run_that_was_cut_goes_on_to_the_same_bytes() {
    let dir = tempfile::tempdir().unwrap();
    let web = || TuneOptions { layout: Layout::Web, ..short(Target::Bytes(60_000)) };
    let whole = tuned(&web()).encoded.bytes;
    // Cut in a round, in the loop, and in its last part, where the best state is kept.
    for cut in [70, 190, 260] {
        let mut options = web();
        options.checkpoint = Some(dir.path().join(format!("{cut}.ckpt")));
        let cancel = Arc::new(AtomicBool::new(false));
        options.cancel = Some(Arc::clone(&cancel));
        let first = Tune::new(model(), photos(), options.clone()).unwrap();
        let first = first.run(|p| cancel.store(p.step >= cut, Ordering::Relaxed)).unwrap();
        assert!(first.cancelled && !gsvx::decode(&first.encoded.bytes).unwrap().is_empty());
        cancel.store(false, Ordering::Relaxed);
        let second = Tune::new(model(), photos(), options).unwrap();
        assert!(second.steps_done() > 0 && second.steps_done() <= cut);
        assert!(second.run(|_| ()).unwrap().encoded.bytes == whole, "cut at step {cut}");
    }
    // Another run does not take the checkpoint.
    let mut other = short(Target::Quality(40.0));
    other.checkpoint = Some(dir.path().join("70.ckpt"));
    let error = Tune::new(model(), photos(), other.clone()).unwrap_err();
    assert!(matches!(error, Error::OtherRun { .. }), "{error}");
    let path = dir.path().join("70.ckpt");
    let mut bytes = std::fs::read(&path).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    std::fs::write(&path, &bytes).unwrap();
    let error = Tune::new(model(), photos(), other).unwrap_err();
    assert!(error.to_string().contains("checksum"), "{error}");
}

#[test]
fn further_streams_are_smaller_and_the_same_after_an_interruption() {
    let dir = tempfile::tempdir().unwrap();
    let mut options = short(Target::Quality(54.0));
    (options.effort, options.further) = (TuneEffort::Quick, vec![46.0]);
    let streams = |options: &TuneOptions, cut: Option<u64>| {
        let mut options = options.clone();
        let cancel = Arc::new(AtomicBool::new(false));
        options.cancel = Some(Arc::clone(&cancel));
        let mut made = Vec::new();
        let run = Tune::new(model(), photos(), options).unwrap();
        let see = |p: &Progress<'_>| {
            let cut = cut.is_some_and(|cut| p.step >= cut);
            cancel.store(cut, Ordering::Relaxed);
        };
        let end = run.run_all(see, |outcome| {
            made.push((outcome.quality, outcome.encoded.bytes, outcome.scores.psnr));
            ControlFlow::Continue(())
        });
        end.unwrap();
        made
    };
    let whole = streams(&options, None);
    assert_eq!(whole.iter().map(|s| s.0).collect::<Vec<_>>(), [54.0, 46.0]);
    assert!(whole[1].1.len() < whole[0].1.len() * 3 / 4 && whole[1].2 > 24.0);
    // Cut in the second stream, which is then not made.
    options.checkpoint = Some(dir.path().join("further.ckpt"));
    assert!(streams(&options, Some(330)) == whole[..1]);
    assert!(streams(&options, None) == whole[1..]);
    options.checkpoint = None;
    options.further = vec![60.0];
    let error = Tune::new(model(), photos(), options).unwrap_err();
    assert!(error.to_string().contains("further quality"), "{error}");
}

/// Before its first step the loop has no scene to score.
#[test]
fn the_loop_begins_with_the_psnr_of_its_input() {
    let run = Tune::new(model(), photos(), short(Target::Quality(54.0))).unwrap();
    let least = run.input_scores().psnr - 8.0;
    let mut scores = Vec::new();
    run.run(|p| scores.extend(p.aside_psnr)).unwrap();
    assert!(!scores.is_empty() && scores.iter().all(|&db| db > least), "{scores:?}");
}

#[test]
fn a_target_in_bytes_is_met_from_below() {
    for target in [50_000, 80_000] {
        let outcome = tuned(&short(Target::Bytes(target)));
        let bytes = outcome.encoded.bytes.len() as u64;
        assert!(outcome.reached && bytes <= target, "{bytes} of {target}");
        assert!(bytes as f64 > 0.97 * target as f64, "{bytes} of {target}");
    }
}

/// No stream has this PSNR: the run ends with the best it found, and says that it is not enough.
#[test]
fn a_psnr_out_of_reach_ends_with_the_best() {
    let mut options = short(Target::Psnr(60.0));
    let plan = options.plan.as_mut().unwrap();
    (plan.round_steps, plan.loop_steps) = (10, 60);
    let outcome = tuned(&options);
    assert!(!outcome.reached && outcome.scores.psnr > 20.0, "{} dB", outcome.scores.psnr);
    assert_eq!(bits(&gsvx::decode(&outcome.encoded.bytes).unwrap()), bits(&outcome.scene));
}

#[test]
fn bad_input_gives_one_line() {
    let error = |scene: Scene, views: Vec<TrainView>, target: Target| {
        let mut options = TuneOptions::new(target);
        options.effort = tune::TuneEffort::Quick;
        let text = Tune::new(scene, Targets::Photos(views), options).unwrap_err().to_string();
        assert_eq!(text.lines().count(), 1, "{text}");
        text
    };
    let quality = Target::Quality(54.0);
    assert!(error(model(), Vec::new(), quality).contains("no training views"));
    let mut black = training();
    black.iter_mut().for_each(|v| v.photo.rgb.fill(0));
    black.iter_mut().for_each(|v| v.photo.rgb.iter_mut().step_by(2).for_each(|p| *p = 255));
    let black = tune::Photos { views: black, warnings: Vec::new() }.check(&model(), false);
    assert!(black.unwrap_err().to_string().contains("do not show this model"));
    let mut small = training();
    small[2].photo = Photo::black(1, 2);
    assert!(error(model(), small, quality).contains("1x2"));
    assert!(error(model(), training(), Target::Bytes(300)).contains("300 bytes"));
    assert!(error(model(), training(), Target::Psnr(f64::NAN)).contains("target PSNR"));
    assert!(error(model(), training(), Target::Quality(101.0)).contains("between 0 and 100"));
    let mut nan = model();
    nan.sh[5][1] = f32::NAN;
    assert!(error(nan, training(), quality).contains("invalid scene"));
}

/// Two pixels, one view, one Gaussian: no panic, and a stream that decodes.
#[test]
fn the_smallest_runs_end() {
    let options = || {
        let mut options = short(Target::Quality(54.0));
        let plan = options.plan.as_mut().unwrap();
        (plan.round_steps, plan.loop_steps) = (2, 2);
        options
    };
    let mut one = training().remove(0);
    // The two pixels in the middle of four by three.
    one.camera = one.camera.scaled_to(4, 3).unwrap();
    (one.camera.width, one.camera.height) = (2, 1);
    one.camera.cx -= 1.0;
    one.camera.cy -= 1.0;
    let mut one = TrainView::rendered(&model(), one.camera);
    let run = Tune::new(model(), Targets::Photos(vec![one.clone()]), options()).unwrap();
    assert!(!gsvx::decode(&run.run(|_| ()).unwrap().encoded.bytes).unwrap().is_empty());
    let importance = Visibility::of_all(&model(), &[one.camera.clone()]).squared;
    let most = (0..importance.len()).max_by(|&a, &b| importance[a].total_cmp(&importance[b]));
    let scene = model().select(&[most.unwrap()]);
    one = TrainView::rendered(&scene, one.camera);
    let run = Tune::new(scene, Targets::Photos(vec![one]), options()).unwrap();
    assert_eq!(gsvx::decode(&run.run(|_| ()).unwrap().encoded.bytes).unwrap().len(), 1);
}
