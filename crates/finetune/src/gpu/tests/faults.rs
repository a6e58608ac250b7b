//! Failures of the device: it is lost during a run, is out of memory, or ends loops early.

use super::*;
use crate::error::Error;
use crate::gpu::device::wait;
use crate::gpu::loops;

/// Whether an error is one line about the device.
fn one_line(error: &Error, reason: &str) {
    assert!(matches!(error, Error::Gpu { reason: r } if r.contains(reason)), "{error}");
    assert!(!error.to_string().contains('\n'), "{error}");
}

#[test]
fn a_lost_device_is_an_error() {
    let Some(context) = context() else { return };
    let (scene, views) = large(400, [60, 40]);
    let device = context.device.clone();
    let mut run = on_device(context, &scene, &views).unwrap();
    run.step(0, 1, 1.0).unwrap();
    assert_eq!(run.losses().unwrap().len(), 1);
    device.destroy();
    let error = run.step(1, 2, 1.0).and_then(|()| run.losses()).unwrap_err();
    one_line(&error, "the device was lost");
    let lost = Context::software().unwrap();
    lost.device.destroy();
    let run = on_device(lost, &scene, &views);
    let error = run.and_then(|mut run| run.step(0, 1, 1.0).and_then(|()| run.losses()));
    one_line(&error.unwrap_err(), "the device was lost");
}

#[test]
fn a_device_without_room_is_an_error() {
    let Some(mut small) = context() else { return };
    let (scene, views) = large(12_000, [120, 80]);
    // The records of the slots that the executor begins with fit, those of a single row of tiles do not.
    (small.page, small.limits.max_storage_buffer_binding_size) = (1000, 200_000);
    let mut run = on_device(small, &scene, &views).unwrap();
    let error = run.step(0, 1, 1.0).and_then(|()| run.losses()).unwrap_err();
    one_line(&error, "view 0: a row of tiles shows");
    // Not even the scene fits.
    let mut tiny = Context::software().unwrap();
    tiny.limits.max_buffer_size = 1000;
    let error = on_device(tiny, &scene, &views).map(|_| ()).unwrap_err();
    one_line(&error, "at most 249 fit a binding of 1000 bytes");
}

/// Memory beyond the driver's limits is an error, not a panic.
#[test]
fn memory_that_the_driver_refuses_is_an_error() {
    let Some(mut context) = context() else { return };
    let words = (context.device.limits().max_buffer_size / 4 + 1024) as usize;
    context.limits.max_buffer_size = u64::MAX;
    context.limits.max_storage_buffer_binding_size = u64::MAX;
    let sizes = Sizes {
        pages: vec![10],
        moments: true,
        sh_len: 1,
        capacity: 16,
        splats: 10,
        tiles: 1,
        pixels: 256,
    };
    let workspace = Workspace::new(context, sizes, None).unwrap();
    let _ = workspace.storage("photo", words);
    let error = workspace.read::<u32>("state", 0, 4).unwrap_err().to_string();
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
    let mut r = Rng::seeded(17);
    let mut s = Scene { sh_degree: 0, ..Scene::default() };
    for _ in 0..n {
        let z = r.range_f32(2.0, 4.0);
        let at = |r: &mut Rng| (r.range_f32(1.0, 15.0) - 16.0) * (z + 0.5) / 32.0;
        s.means.push([at(&mut r), at(&mut r), z]);
        s.rotations.push([1.0, 0.0, 0.0, 0.0]);
        s.log_scales.push([-7.0; 3]);
        s.opacity_logits.push(-4.5);
        s.sh.push([0; 3].map(|_| r.range_f32(-1.0, 1.0)));
    }
    s
}

/// Lists of the largest length that is accepted are blended completely, on every driver.
#[test]
fn the_longest_list_that_is_let_through_is_not_cut() {
    let n = loops::longest_list(65_535) as usize;
    let Some(p) = pair_of(crowd(n), [32, 32], Loss::MSE) else { return };
    println!("loops end after: {:?}", p.gpu.context.loop_limit);
    upload_lists(&p);
    let f = &p.cpu.forward;
    assert_eq!(f.last[0] as usize, n, "some pixel needs every splat");
    p.gpu.run(&[GpuStage::Blend], &p.u, &[]);
    let wanted = flat(&f.tiles);
    let got: Vec<f32> = p.gpu.read("pixels", 0, wanted.len()).unwrap();
    assert_equal(&p.gpu.context, "blend", 1, &got, &wanted);
    p.gpu.write("pixels", 0, &wanted);
    p.gpu.write("gradient", 0, &flat(&p.cpu.tiles));
    p.gpu.run(&[GpuStage::BlendAdjoint], &p.u, &[]);
    let wanted = flat(&p.cpu.records);
    let got: Vec<f32> = p.gpu.read("records", 0, wanted.len()).unwrap();
    assert_equal(&p.gpu.context, "blend_adjoint", 9, &got, &wanted);
}

/// Mesa's software Vulkan 22.3.6 cut the lists of crowded tiles without an error. Now it is an error.
#[test]
fn lists_that_the_driver_would_cut_are_refused() {
    let Some(context) = context() else { return };
    let limit = context.loop_limit;
    let (scene, size) = (crowd(55_000), 32);
    let views = [TrainView { camera: camera(size, size), photo: photo(size, size) }];
    let mut run = on_device(context, &scene, &views).unwrap();
    let done = run.step(0, 1, 1.0).and_then(|()| run.losses());
    match limit {
        Some(limit) => {
            let reason = format!("ends loops after {limit} iterations, too few for 55000");
            one_line(&done.unwrap_err(), &reason);
        }
        None => {
            let loss = gradients_at(&views, Loss::L1_SSIM).run(&scene, 0);
            assert!((done.unwrap()[0].psnr() - loss.psnr()).abs() < 1e-3);
        }
    }
}

/// A view of more tiles than the loops over one Gaussian's tiles may count.
#[test]
fn views_whose_loops_the_driver_would_cut_are_refused() {
    let view = |size| {
        let camera = camera(size, size);
        StepUniform::of_view(&RenderView::new(&camera, &RenderOptions::default()))
    };
    assert!(loops::check_view(65_535, &view(3200)).is_ok());
    let error = loops::check_view(65_535, &view(4096)).unwrap_err().to_string();
    assert!(error.contains("4096x4096"), "{error}");
}
