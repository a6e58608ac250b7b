//! Failures of the device: it is lost during a run, is out of memory, or ends loops early.

use super::*;
use crate::backend::Backend;
use crate::error::Error;
use crate::gpu::device::wait;
use crate::gpu::loops;
use crate::train::{Outcome, fine_tune_on};
use crate::{FineTune, StopReason};

/// Three views of a scene whose slots do not fit into those that the executor begins with.
fn run_of(n: usize, (w, h): (u32, u32)) -> (Scene, Vec<TrainView>, FineTuneOptions) {
    let mut scene = scene(n, 1, 5);
    scene.log_scales.iter_mut().flatten().for_each(|l| *l = l.max(-1.0));
    let views = (0..3).map(|i| {
        let mut camera = camera(w, h);
        camera.translation.x += 0.1 * f64::from(i);
        TrainView { camera, photo: photo(w, h) }
    });
    let options = FineTuneOptions {
        steps: 20,
        checkpoint_every: 6,
        report_every: 1,
        background: BACKGROUND,
        backend: Backend::Auto,
        ..Default::default()
    };
    (scene, views.collect(), options)
}

/// The outcome must be a whole run, finished by the processor for the reason given.
fn finished_by_the_processor(outcome: &Outcome, reason: &str, from: &str) {
    assert_eq!((outcome.steps, outcome.reason), (20, StopReason::Steps));
    assert_eq!(outcome.backend.used, Backend::Cpu);
    let said = &outcome.backend.reason;
    assert!(said.contains(reason) && said.contains(from) && !said.contains('\n'), "{said}");
}

#[test]
fn a_run_whose_device_is_lost_goes_on_from_the_last_kept_step() {
    let Some(lost) = context() else { return };
    let (scene, views, options) = run_of(400, (60, 40));
    let device = lost.device.clone();
    let tune = fine_tune_on(lost, scene.clone(), views.clone(), options.clone()).unwrap();
    assert_eq!(tune.backend().used, Backend::Gpu);
    let mut seen = Vec::new();
    let outcome = tune
        .run(|p| {
            seen.push((p.step, p.backend));
            if seen.len() == 14 {
                device.destroy();
            }
        })
        .unwrap();
    finished_by_the_processor(&outcome, "the device was lost", "from step 12");
    let gpu: Vec<_> = (1..=14).map(|s| (s, Backend::Gpu)).collect();
    let cpu: Vec<_> = (13..=20).map(|s| (s, Backend::Cpu)).collect();
    assert_eq!(seen, [gpu, cpu].concat());

    // With `Backend::Gpu`: one line, the checkpoint stays, and another run continues it to the same
    // bits.
    let dir = tempfile::tempdir().unwrap();
    let checkpoint = Some(dir.path().join("run.ckpt"));
    let options = FineTuneOptions { backend: Backend::Gpu, checkpoint, ..options };
    let lost = Context::software().unwrap();
    let device = lost.device.clone();
    let tune = fine_tune_on(lost, scene.clone(), views.clone(), options.clone()).unwrap();
    let error = tune
        .run(|p| {
            if p.step == 14 {
                device.destroy()
            }
        })
        .unwrap_err();
    assert!(matches!(&error, Error::Gpu { reason } if reason.contains("lost")), "{error}");
    assert!(!error.to_string().contains('\n'), "{error}");
    let options = FineTuneOptions { backend: Backend::Cpu, ..options };
    let tune = FineTune::new(scene, views, options).unwrap();
    assert_eq!(tune.steps_done(), 12);
    assert_eq!(tune.run(|_| ()).unwrap().scene, outcome.scene);
}

#[test]
fn a_device_lost_before_the_first_step_costs_nothing() {
    let Some(lost) = context() else { return };
    lost.device.destroy();
    let (scene, views, options) = run_of(400, (60, 40));
    let tune = fine_tune_on(lost, scene.clone(), views.clone(), options.clone()).unwrap();
    let outcome = tune.run(|_| ()).unwrap();
    finished_by_the_processor(&outcome, "the device was lost", "from step 0");
    let options = FineTuneOptions { backend: Backend::Cpu, ..options };
    let whole = FineTune::new(scene, views, options).unwrap().run(|_| ()).unwrap();
    assert_eq!(outcome.scene, whole.scene);
}

#[test]
fn a_device_without_room_is_left() {
    let Some(mut small) = context() else { return };
    let (scene, views, options) = run_of(6000, (120, 80));
    let run = |context, options: &FineTuneOptions| {
        fine_tune_on(context, scene.clone(), views.clone(), options.clone())
    };
    let cpu = FineTuneOptions { backend: Backend::Cpu, ..options.clone() };
    let whole = FineTune::new(scene.clone(), views.clone(), cpu).unwrap().run(|_| ()).unwrap();
    // The records of the slots that the executor begins with fit, those that it needs do not.
    small.limits.max_storage_buffer_binding_size = 700_000;
    let tune = run(small, &options).unwrap();
    assert_eq!(tune.backend().used, Backend::Gpu, "{:?}", tune.backend());
    let outcome = tune.run(|_| ()).unwrap();
    finished_by_the_processor(&outcome, "records needs", "from step 0");
    assert_eq!(outcome.scene, whole.scene);
    // Not even the scene fits.
    let mut tiny = Context::software().unwrap();
    tiny.limits.max_buffer_size = 1000;
    let tune = run(tiny, &options).unwrap();
    assert_eq!(tune.backend().used, Backend::Cpu);
    let outcome = tune.run(|_| ()).unwrap();
    finished_by_the_processor(&outcome, "the adapter binds 1000", "from step 0");
    assert_eq!(outcome.scene, whole.scene);
    // Asked for the GPU: one line.
    let mut tiny = Context::software().unwrap();
    tiny.limits.max_buffer_size = 1000;
    let options = FineTuneOptions { backend: Backend::Gpu, ..options };
    let error = run(tiny, &options).unwrap_err().to_string();
    assert!(error.starts_with("GPU: ") && !error.contains('\n'), "{error}");
}

/// Memory beyond the driver's limits is an error, not a panic.
#[test]
fn memory_that_the_driver_refuses_is_an_error() {
    let Some(mut context) = context() else { return };
    let words = (context.device.limits().max_buffer_size / 4 + 1024) as usize;
    context.limits.max_buffer_size = u64::MAX;
    context.limits.max_storage_buffer_binding_size = u64::MAX;
    let sizes = Sizes {
        count: 10,
        sh_len: 1,
        capacity: 16,
        tiles: 1,
        pixels: 256,
        codec: crate::gpu::CodecSizes::default(),
    };
    let workspace = Workspace::new(context, sizes).unwrap();
    let _ = workspace.storage("photo", words);
    let error = workspace.read::<u32>("state", 4).unwrap_err().to_string();
    assert!(error.starts_with("GPU: ") && !error.contains('\n'), "{error}");
}

/// wgpu panics if a device is lost during a wait.
#[test]
fn a_panic_in_a_wait_is_an_error() {
    assert_eq!(wait(|| Ok(3)).unwrap(), 3);
    let error = wait::<u32>(|| panic!("as wgpu does")).unwrap_err();
    assert!(matches!(&error, Error::Gpu { reason } if reason.contains("lost")), "{error}");
}

/// `n` small Gaussians in the first tile of 16x16, so faint that no pixel stops.
fn crowd(n: usize) -> Scene {
    let mut r = Rng(17);
    let mut s = Scene { sh_degree: 0, ..Scene::default() };
    for _ in 0..n {
        let z = uniform(&mut r, 2.0, 4.0);
        let at = |r: &mut Rng| (uniform(r, 1.0, 15.0) - 16.0) * (z + 0.5) / 32.0;
        s.means.push([at(&mut r), at(&mut r), z]);
        s.rotations.push([1.0, 0.0, 0.0, 0.0]);
        s.log_scales.push([-7.0; 3]);
        s.opacity_logits.push(-4.5);
        s.sh.push([0; 3].map(|_| uniform(&mut r, -1.0, 1.0)));
    }
    s
}

/// Lists of the largest length that is accepted are blended completely, on every driver.
#[test]
fn the_longest_list_that_is_let_through_is_not_cut() {
    let n = loops::longest_list(65_535) as usize;
    let Some(p) = pair_of(crowd(n), (32, 32), Loss::Mse) else { return };
    println!("loops end after: {:?}", p.gpu.context.loop_limit);
    upload_lists(&p);
    let f = &p.cpu.forward;
    assert_eq!(f.last[0] as usize, n, "some pixel needs every splat");
    p.gpu.run(&[Stage::Blend], &p.u, None);
    let wanted = flat(&f.tiles);
    let got: Vec<f32> = p.gpu.read("pixels", wanted.len()).unwrap();
    assert_eq!(worst_ulps("blend", &got, &wanted), 0);
    p.gpu.write("pixels", &wanted);
    p.gpu.write("gradient", &flat(&p.cpu.tiles));
    p.gpu.run(&[Stage::BlendAdjoint], &p.u, None);
    let wanted = flat(&p.cpu.records);
    let got: Vec<f32> = p.gpu.read("records", wanted.len()).unwrap();
    assert_eq!(worst_ulps("blend_adjoint", &got, &wanted), 0);
}

/// Mesa's software Vulkan 22.3.6 cut the lists of crowded tiles without an error. Now the CPU takes
/// the run over if the driver would cut a list; otherwise the GPU finishes it.
#[test]
fn lists_that_the_driver_would_cut_are_refused() {
    let Some(context) = context() else { return };
    let limit = context.loop_limit;
    let (scene, size) = (crowd(55_000), 32);
    let views = vec![TrainView { camera: camera(size, size), photo: photo(size, size) }];
    let options = FineTuneOptions { steps: 1, backend: Backend::Auto, ..Default::default() };
    let tune = fine_tune_on(context, scene.clone(), views.clone(), options.clone()).unwrap();
    let outcome = tune.run(|_| ()).unwrap();
    let cpu = FineTuneOptions { backend: Backend::Cpu, ..options };
    let whole = FineTune::new(scene, views, cpu).unwrap().run(|_| ()).unwrap();
    match limit {
        Some(limit) => {
            let reason = format!("ends loops after {limit} iterations, too few for 55000");
            assert!(outcome.backend.reason.contains(&reason), "{:?}", outcome.backend);
            assert_eq!(outcome.scene, whole.scene);
        }
        None => assert_eq!(outcome.backend.used, Backend::Gpu),
    }
    assert!((outcome.epoch_psnr[0] - whole.epoch_psnr[0]).abs() < 1e-3);
}

/// A view of more tiles than the loops over one Gaussian's tiles may count.
#[test]
fn views_whose_loops_the_driver_would_cut_are_refused() {
    let view = |size| {
        let camera = camera(size, size);
        StepUniform::of_view(&View::new(&camera, &RenderOptions::default()))
    };
    assert!(loops::check_view(65_535, &view(3200)).is_ok());
    let error = loops::check_view(65_535, &view(4096)).unwrap_err().to_string();
    assert!(error.contains("4096x4096"), "{error}");
}
