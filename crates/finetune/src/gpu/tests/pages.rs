//! Pages and bands: scenes and views that no binding of 128 MiB holds.

use super::*;
use crate::error::Error;

/// Three steps on a device: the scene, the losses, and the bands of the views.
fn steps(context: Context, scene: &Scene, views: &[TrainView]) -> (Scene, Vec<ViewLoss>, Vec<u32>) {
    let mut run = on_device(context, scene, views).unwrap();
    (1..=3).for_each(|step| run.step(step as usize, step, 1.0).unwrap());
    let losses = run.losses().unwrap();
    let mut out = SceneOptimiser::new(scene.clone(), LearningRates::default(), 0.0);
    run.fetch(&mut out).unwrap();
    (out.take_scene(), losses, run.bands())
}

#[test]
fn pages_and_bands_do_not_change_a_bit() {
    // Bands for the sake of the slots, then for the sake of the splats.
    let (crowded, its_views) = large(2000, [120, 80]);
    let (mut many, views) = large(6000, [60, 40]);
    many.log_scales.iter_mut().flatten().for_each(|l| *l = l.min(-6.0));
    for (scene, views, limit) in [(crowded, its_views, 200_000), (many, views, 130_000)] {
        let (Some(whole), Some(mut paged), Some(mut small)) = (context(), context(), context())
        else {
            return;
        };
        let (wanted, losses, bands) = steps(whole, &scene, &views);
        assert_eq!(bands, [1; 3]);
        assert!(wanted != scene && losses.iter().all(|l| l.loss.is_finite()));
        paged.page = 300;
        assert!(steps(paged, &scene, &views) == (wanted.clone(), losses.clone(), bands), "pages");
        (small.page, small.limits.max_storage_buffer_binding_size) = (300, limit);
        let (got, also, bands) = steps(small, &scene, &views);
        println!("bands: {bands:?}");
        assert!(bands.iter().any(|&b| b > 1), "{bands:?}: no bands were tested");
        assert!(got == wanted && also == losses, "bands");
    }
}

/// A million Gaussians of SH degree 3: their SH coefficients alone are 183 MiB.
#[test]
fn a_million_gaussians_need_no_more_than_webgpu_promises() {
    let Some(context) = context() else { return };
    let promised = wgpu::Limits::default();
    assert_eq!(context.device.limits().max_storage_buffer_binding_size, 128 << 20);
    assert_eq!(context.device.limits().max_buffer_size, 256 << 20);
    assert_eq!(context.device.limits().max_storage_buffers_per_shader_stage, 8);
    assert_eq!(context.device.limits().max_compute_invocations_per_workgroup, 256);
    assert_eq!(context.limits, promised);
    let [width, height] = [320, 256];
    let mut scene = scene(1_000_000, 3, 23);
    scene.log_scales.iter_mut().flatten().for_each(|l| *l = l.min(-4.5));
    let views = [TrainView { camera: camera(width, height), photo: photo(width, height) }];
    let mut run = on_device(context, &scene, &views).unwrap();
    run.step(0, 1, 1.0).unwrap();
    let losses = run.losses().unwrap();
    let mut device = SceneOptimiser::new(scene.clone(), LearningRates::default(), 0.0);
    run.fetch(&mut device).unwrap();
    let mut host = SceneOptimiser::new(scene.clone(), LearningRates::default(), 0.0);
    let loss = host.step(&mut gradients_at(&views, Loss::L1_SSIM), 0, 1, 1.0);
    println!("{losses:?}, {loss:?} on the CPU");
    assert!((losses[0].loss / loss.loss - 1.0).abs() < 1e-4);
    assert!((losses[0].mse / loss.mse - 1.0).abs() < 1e-4);
    // Adam's first step is by the sign of a gradient, so that the moments say more than the parameters.
    let ends = 2 * host.moments.first.len() / 3;
    assert!(host.moments.first[ends..].iter().any(|m| *m != 0.0), "the last page has no gradient");
    assert!(relative("moments", &device.moments.first, &host.moments.first) < 1e-4);
    assert!(device.scene().means == scene.means);
}

#[test]
fn what_no_page_or_band_helps_is_refused_before_any_work() {
    let limit = wgpu::Limits::default().max_storage_buffer_binding_size;
    let sizes = |n: usize, pixels: usize| Sizes {
        pages: vec![n],
        moments: true,
        sh_len: 16,
        capacity: 16,
        splats: 1,
        tiles: pixels.div_ceil(256),
        pixels,
    };
    assert!(sizes(30_000_000, 6_000_000).check(limit).is_ok());
    for (sizes, what) in [
        (sizes(40_000_000, 100), "40000000 Gaussians, at most 33554431 fit"),
        (sizes(100, 8_000_000), "a view of 8000000 pixels, at most 6710886 fit"),
    ] {
        let error = sizes.check(limit).unwrap_err();
        assert!(matches!(&error, Error::Gpu { reason } if reason.starts_with(what)), "{error}");
        assert!(error.to_string().contains("use the CPU"), "{error}");
    }
}
