//! Compares each stage with the Rust executor on the same inputs, on lavapipe where it is installed, else on a GPU.
//! Without an adapter the tests are skipped with a message.

mod faults;
mod pages;

use gs_model::{Camera, Scene};

use super::device::Context;
use super::executor::DeviceOptimiser;
use super::passes::{GpuStage, LISTS, fold, packed};
use super::removal::{steps_of, whole};
use super::sizes::Sizes;
use super::uniform::StepUniform;
use super::workspace::Workspace;
use crate::backward::{Backward, planes_of};
use crate::forward::Forward;

use crate::image::{Image, Photo};
use crate::optimiser::{SceneOptimiser, rows_of};
use crate::options::{LearningRates, Loss, RenderOptions};
use crate::shaders::TILE_LANES;
use crate::stages::blend_adjoint::{MOVING, TileGradient};
use crate::stages::loss::ViewLoss;
use crate::stages::project::{CULLED, RenderView};
use crate::train_view::TrainView;
use crate::view_gradients::{PreparedView, ViewGradients};
use testing::Rng;

fn context() -> Option<Context> {
    match Context::software() {
        Ok(context) => Some(context),
        Err(e) => {
            println!("SKIPPED: {e}; install mesa-vulkan-drivers to run the conformance tests");
            None
        }
    }
}

/// Gaussians of all sizes on a lattice (so that depths tie), some behind the camera, some
/// transparent.
fn scene(n: usize, degree: u8, seed: u64) -> Scene {
    let mut r = Rng::seeded(seed);
    let mut s = Scene { sh_degree: degree, ..Scene::default() };
    for _ in 0..n {
        let cell = |r: &mut Rng, low, high| (r.range_f32(low, high) * 8.0).round() / 8.0;
        s.means.push([cell(&mut r, -3.0, 3.0), cell(&mut r, -2.0, 2.0), cell(&mut r, -1.0, 8.0)]);
        s.rotations.push([0; 4].map(|_| r.range_f32(-1.0, 1.0)));
        s.log_scales.push([0; 3].map(|_| r.range_f32(-5.0, 0.0)));
        s.opacity_logits.push(r.range_f32(-7.0, 6.0));
        for k in 0..s.sh_len() {
            let a = if k == 0 { 1.5 } else { 0.3 };
            s.sh.push([0; 3].map(|_| r.range_f32(-a, a)));
        }
    }
    s
}

fn camera(width: u32, height: u32) -> Camera {
    Camera {
        name: "test".into(),
        width,
        height,
        fx: f64::from(width),
        fy: f64::from(width),
        cx: f64::from(width) / 2.0,
        cy: f64::from(height) / 2.0,
        rotation: glam::DMat3::IDENTITY,
        translation: glam::DVec3::new(0.0, 0.0, 0.5),
        lens: None,
        near: gs_model::NEAR,
    }
}

fn photo(width: u32, height: u32) -> Photo {
    let mut r = Rng::seeded(3);
    let mut image = Image::new(width, height);
    image.rgb.iter_mut().for_each(|v| *v = r.range_f32(0.0, 1.0));
    Photo::from(&image)
}

/// A step in both executors: the Rust results, and a workspace into which tests write inputs.
struct Pair {
    scene: Scene,
    view: RenderView,
    cpu: Backward<MOVING>,
    loss: ViewLoss,
    photo: Vec<u8>,
    gpu: Workspace,
    u: StepUniform,
}

const BACKGROUND: [f32; 3] = [0.1, 0.7, 0.3];

fn pair(n: usize, size: [u32; 2], loss: Loss) -> Option<Pair> {
    pair_of(scene(n, 3, 11), size, loss)
}

fn pair_of(scene: Scene, [width, height]: [u32; 2], loss: Loss) -> Option<Pair> {
    let context = context()?;
    let n = scene.len();
    let options = RenderOptions { background: BACKGROUND, ..Default::default() };
    let view = RenderView::new(&camera(width, height), &options);
    let photo = photo(width, height);
    let mut cpu = Backward::<MOVING>::default();
    let value = cpu.run(&scene, &view, &planes_of(&photo.image().rgb), loss);
    let sizes = Sizes {
        pages: vec![n],
        moments: true,
        splats: n,
        sh_len: scene.sh_len(),
        capacity: cpu.forward.lists.ids.len() + 100,
        tiles: view.tiles(),
        pixels: (width * height) as usize,
    };
    let gpu = Workspace::new(context, sizes, None).unwrap();
    gpu.upload(&[&rows_of(&scene)]);
    gpu.write("state", 0, &[n as u32, cpu.forward.lists.ids.len() as u32, 0, 0]);
    let mut u = StepUniform::of_view(&view).merge(&StepUniform::of_scene(&scene, loss));
    u.step = 1;
    (u.capacity, u.most_splats) = (gpu.sizes.capacity as u32, n as u32);
    let photo = planes_of(&photo.rgb);
    Some(Pair { scene, view, cpu, loss: value, photo, gpu, u })
}

/// Distance in units in the last place.
fn ulps(a: f32, b: f32) -> u32 {
    let key = |x: f32| {
        let bits = x.to_bits() as i32;
        if bits < 0 { i32::MIN.wrapping_sub(bits) } else { bits }
    };
    key(a).abs_diff(key(b))
}

fn worst_ulps(name: &str, a: &[f32], b: &[f32]) -> u32 {
    assert_eq!(a.len(), b.len());
    let worst = a.iter().zip(b).map(|(&a, &b)| ulps(a, b)).max().unwrap_or(0);
    let unequal = a.iter().zip(b).filter(|(a, b)| a.to_bits() != b.to_bits()).count();
    println!("{name}: {unequal} of {} values differ, worst {worst} ulp", a.len());
    worst
}

/// Largest difference over the largest magnitude.
fn relative(name: &str, a: &[f32], b: &[f32]) -> f32 {
    assert_eq!(a.len(), b.len());
    let scale = b.iter().fold(0.0f32, |m, v| m.max(v.abs()));
    let worst = a.iter().zip(b).fold(0.0f32, |m, (a, b)| m.max((a - b).abs()));
    println!("{name}: worst difference {worst:.2e}, largest value {scale:.2e}");
    assert!(scale > 0.0, "{name}: all zero");
    worst / scale
}

/// Rows of `columns` values are equal to the bit. A GPU's compiler fuses products and sums, and there a column differs by
/// at most `1e-4` of its largest value.
fn assert_equal(on: &Context, name: &str, columns: usize, got: &[f32], wanted: &[f32]) {
    let worst = worst_ulps(name, got, wanted);
    if on.software {
        return assert_eq!(worst, 0, "{name}");
    }
    for k in 0..columns {
        let column = |v: &[f32]| v.iter().skip(k).step_by(columns).copied().collect::<Vec<_>>();
        assert!(relative(name, &column(got), &column(wanted)) < 1e-4, "{name}, column {k}");
    }
}

fn flat<T: bytemuck::NoUninit>(v: &[T]) -> Vec<f32> {
    bytemuck::cast_slice::<T, f32>(v).to_vec()
}

#[test]
fn project_agrees() {
    let Some(p) = pair(3000, [200, 130], Loss::MSE) else { return };
    p.gpu.run(&[GpuStage::Project], &p.u, &[]);
    let keys: Vec<u32> = p.gpu.read("keys", 0, 3000).unwrap();
    let f = &p.cpu.forward.projected;
    let visible = f.seen.keys.len();
    assert!(visible > 500 && visible < 2800, "{visible}");
    assert_eq!(keys, f.spread(&f.seen.keys, CULLED));
    let splats: Vec<[f32; 12]> = p.gpu.read("page_splats", 0, 3000).unwrap();
    let (mut ours, mut theirs) = (Vec::new(), Vec::new());
    let wanted = f.spread(&packed(f), [0; 12]);
    for i in (0..3000).filter(|&i| keys[i] != CULLED) {
        ours.extend_from_slice(&splats[i]);
        theirs.extend_from_slice(bytemuck::cast_slice::<_, f32>(&[wanted[i]]));
    }
    const FIELDS: [&str; 12] =
        ["x", "y", "p", "q", "r", "cut", "opacity", "columns", "red", "green", "blue", "rows"];
    const WORDS: [&str; 2] = ["columns", "rows"];
    // Mesa reassociates the products of the rotation and the sums of the colour.
    const INEXACT: [&str; 6] = ["p", "q", "r", "red", "green", "blue"];
    for (k, field) in FIELDS.iter().enumerate() {
        let column = |v: &[f32]| v.iter().skip(k).step_by(12).copied().collect::<Vec<_>>();
        let (a, b) = (column(&ours), column(&theirs));
        let ulps = worst_ulps(field, &a, &b);
        if INEXACT.contains(field) || !(p.gpu.context.software || WORDS.contains(field)) {
            assert!(relative(field, &a, &b) < 2e-6, "{field}");
        } else {
            assert_eq!(ulps, 0, "{field}");
        }
    }
}

#[test]
fn lists_are_equal() {
    let Some(p) = pair(3000, [200, 130], Loss::MSE) else { return };
    // Counts come from `project`; everything else from the Rust executor.
    p.gpu.run(&[GpuStage::Project], &p.u, &[]);
    let f = &p.cpu.forward;
    let (projected, seen) = (&f.projected, &f.projected.seen);
    p.gpu.write("keys", 0, &projected.spread(&seen.keys, CULLED));
    p.gpu.write("page_splats", 0, &projected.spread(&packed(projected), [0; 12]));
    p.gpu.run(&LISTS[1..], &p.u, &[]);
    let order: Vec<u32> = p.gpu.read("order", 0, f.order.len()).unwrap();
    let gaussians: Vec<u32> = projected.gaussians().map(|i| i as u32).collect();
    let numbers = |places: &[u32]| -> Vec<u32> {
        places.iter().map(|&place| gaussians[place as usize]).collect()
    };
    assert_eq!(order, numbers(&f.order));
    let key = |place: u32| seen.keys[place as usize];
    let ties = f.order.windows(2).filter(|w| key(w[0]) == key(w[1]));
    assert!(ties.count() > 500, "the scene has no depth ties");
    let offsets: Vec<u32> = p.gpu.read("offsets", 0, f.lists.offsets.len()).unwrap();
    assert_eq!(offsets, f.lists.offsets);
    let ids: Vec<u32> = p.gpu.read("ids", 0, f.lists.ids.len()).unwrap();
    let ids: Vec<u32> = ids.iter().map(|&rank| order[rank as usize]).collect();
    assert_eq!(ids, numbers(&f.lists.ids));
    assert!(ids.len() > 3000);
}

fn upload_lists(p: &Pair) {
    p.gpu.upload_lists(&p.cpu.forward, &p.u);
}

/// A block that a splat does not reach is skipped: every reached pixel is in a reached block.
#[test]
fn skipped_blocks_have_no_pixel_that_counts() {
    let Some(p) = pair(3000, [200, 130], Loss::MSE) else { return };
    upload_lists(&p);
    let f = &p.cpu.forward;
    let words: Vec<u32> = p.gpu.read("hits", 0, f.lists.ids.len().div_ceil(4)).unwrap();
    let (mut reached, mut skipped) = (0, 0);
    for tile in 0..p.view.tiles() {
        let (tx, ty) = p.view.tile_at(tile);
        let first = f.lists.offsets[tile] as usize;
        for (k, &i) in f.lists.of(tile).iter().enumerate() {
            let s = &f.projected.seen.splats[i as usize];
            let byte = words[(first + k) / 4] >> (8 * ((first + k) % 4));
            for pixel in 0..256u32 {
                let (lx, ly) = (pixel % 16, pixel / 16);
                let dx = s.x - ((tx * 16 + lx) as f32 + 0.5);
                let dy = s.y - ((ty * 16 + ly) as f32 + 0.5);
                let (e0, e1) = (s.p * dx + s.q * dy, s.r * dy);
                let hit = byte >> (lx / 8 * 4 + ly / 4) & 1 == 1;
                assert!(hit || e0 * e0 + e1 * e1 > s.cut, "tile {tile}, splat {i}, {lx} {ly}");
                reached += u32::from(hit);
                skipped += u32::from(!hit);
            }
        }
    }
    println!("{skipped} of {} pairs skipped", reached + skipped);
    assert!(4 * skipped > reached, "{skipped} skipped, {reached} not");
}

#[test]
fn blend_is_equal_to_the_bit() {
    let Some(p) = pair(3000, [200, 130], Loss::MSE) else { return };
    upload_lists(&p);
    p.gpu.run(&[GpuStage::Blend], &p.u, &[]);
    let f = &p.cpu.forward;
    let wanted = flat(&f.tiles);
    assert!(f.tiles.iter().any(|t| t.t[3][3] < 0.0), "no pixel stops early");
    let got: Vec<f32> = p.gpu.read("pixels", 0, wanted.len()).unwrap();
    assert_equal(&p.gpu.context, "blend", 1, &got, &wanted);
    let blocks: Vec<u32> = p.gpu.read("last", 0, TILE_LANES as usize * f.last.len()).unwrap();
    let last: Vec<u32> =
        blocks.chunks(TILE_LANES as usize).map(|b| b.iter().copied().max().unwrap()).collect();
    assert_eq!(last, f.last);
    assert!(blocks.iter().zip(0..).any(|(&b, i)| b < last[i / TILE_LANES as usize]));
}

#[test]
fn blend_adjoint_and_gather_are_equal_to_the_bit() {
    let Some(p) = pair(3000, [200, 130], Loss::MSE) else { return };
    upload_lists(&p);
    let f = &p.cpu.forward;
    p.gpu.write("pixels", 0, &flat(&f.tiles));
    let last: Vec<u32> = f.last.iter().flat_map(|&l| [l; TILE_LANES as usize]).collect();
    p.gpu.write("last", 0, &last);
    p.gpu.write("gradient", 0, &flat(&p.cpu.tiles));
    p.gpu.run(&[GpuStage::BlendAdjoint], &p.u, &[]);
    let wanted = flat(&p.cpu.records);
    assert!(wanted.iter().filter(|&&v| v != 0.0).count() > wanted.len() / 4);
    let got: Vec<f32> = p.gpu.read("records", 0, wanted.len()).unwrap();
    assert_equal(&p.gpu.context, "blend_adjoint", 9, &got, &wanted);
    p.gpu.write("records", 0, &wanted);
    p.gpu.run(&[GpuStage::Gather], &p.u, &[]);
    let sums: Vec<f32> = p.gpu.read("sums", 0, 9 * 3000).unwrap();
    assert_equal(&p.gpu.context, "sums", 9, &sums, &flat(&p.cpu.all_sums()));
    let clamped = |s: &[f32; 9]| s[..3].contains(&0.0) && s[3] != 0.0;
    assert!(p.cpu.sums.iter().any(clamped), "no colour is clamped");
}

#[test]
fn losses_agree() {
    for loss in [Loss::MSE, Loss::L1_SSIM, Loss::mse_ssim(0.02)] {
        let Some(p) = pair(500, [90, 61], loss) else { return };
        let f = &p.cpu.forward;
        p.gpu.write("pixels", 0, &flat(&f.tiles));
        // Old values that the stage must overwrite.
        p.gpu.write("gradient", 0, &vec![9.0f32; 768 * p.view.tiles()]);
        let photo = p.gpu.photo(&p.photo).unwrap();
        p.gpu.run(&[GpuStage::Loss], &p.u, &p.gpu.bind_photo(&photo));
        let wanted = flat(&p.cpu.tiles);
        let got: Vec<f32> = p.gpu.read("gradient", 0, wanted.len()).unwrap();
        assert!(relative("gradient", &got, &wanted) < 1e-5);
        let value: Vec<f32> = p.gpu.read("losses", 0, 2).unwrap();
        println!("{loss:?}: {value:?} on the device, {:?}", p.loss);
        assert!((f64::from(value[0]) / p.loss.loss - 1.0).abs() < 1e-5);
        assert!((f64::from(value[1]) / p.loss.mse - 1.0).abs() < 1e-5);
    }
}

/// One training view of [`photo`], and the gradients of a fine-tune at it.
fn gradients_at(views: &[TrainView], loss: Loss) -> ViewGradients {
    let options = RenderOptions { background: BACKGROUND, ..Default::default() };
    ViewGradients::new(views.to_vec(), loss, &options).unwrap()
}

#[test]
fn an_antialiased_model_is_projected_as_in_rust() {
    let Some(p) = pair_of(antialiased(scene(3000, 1, 11)), [200, 130], Loss::MSE) else { return };
    p.gpu.run(&[GpuStage::Project], &p.u, &[]);
    let keys: Vec<u32> = p.gpu.read("keys", 0, 3000).unwrap();
    let splats: Vec<[f32; 12]> = p.gpu.read("page_splats", 0, 3000).unwrap();
    let f = &p.cpu.forward.projected;
    let shown = |i: &usize| keys[*i] != CULLED && f.place(*i).is_some();
    let both: Vec<usize> = (0..3000).filter(shown).collect();
    // Mesa reassociates sums, so a Gaussian of just 1/255 may be seen by one alone.
    assert!(both.len() > 300 && both.len() + 2 > f.seen.keys.len());
    let ours: Vec<f32> = both.iter().map(|&i| splats[i][6]).collect();
    let place = |&i: &usize| f.seen.splats[f.place(i).expect("seen")].opacity;
    let theirs: Vec<f32> = both.iter().map(place).collect();
    assert!(relative("opacity", &ours, &theirs) < 1e-5);
}

/// The scene, antialiased.
fn antialiased(scene: Scene) -> Scene {
    Scene { antialiased: true, ..scene }
}

#[test]
fn adam_agrees() {
    adam_agrees_on(scene(3000, 3, 11));
}

#[test]
fn adam_agrees_on_an_antialiased_model() {
    adam_agrees_on(antialiased(scene(3000, 3, 11)));
}

fn adam_agrees_on(scene: Scene) {
    let size = [200, 130];
    let Some(p) = pair_of(scene, size, Loss::MSE) else { return };
    let view = TrainView { camera: camera(size[0], size[1]), photo: photo(size[0], size[1]) };
    let mut views = gradients_at(&[view], Loss::MSE);
    views.move_means(true);
    views.weigh(0, 0.5);
    let (rates, mean_rate) = (LearningRates::default(), 1e-3);
    let mut host = SceneOptimiser::new(p.scene.clone(), rates, mean_rate);
    host.step(&mut views, 0, 1, 1.0);
    // The photo of the views has 8 bits per value, so the sums are those of the views.
    p.gpu.write("sums", 0, &flat(&views.sums()));
    let mut u = p.u.with_adam((&rates, mean_rate), 1, 1.0);
    u.view_weight = 0.5;
    p.gpu.run(&[GpuStage::Adam], &u, &[]);
    let [rows, first, second] = [0, 1, 2].map(|which| p.gpu.download(which).unwrap());
    let stride = rows.len() / p.scene.len();
    let means = |v: &[f32]| -> Vec<f32> {
        v.chunks_exact(stride).flat_map(|row| &row[..3]).copied().collect()
    };
    assert!(relative("moments of means", &means(&first), &means(&host.moments.first)) < 1e-5);
    assert!(means(&rows) != p.scene.means.as_flattened());
    assert!(relative("first moments", &first, &host.moments.first) < 1e-5);
    assert!(relative("second moments", &second, &host.moments.second) < 1e-5);
    // Adam divides by the size of the gradient: compare only where that is not noise.
    let at = 3 + 3 * p.scene.sh_len() + 1;
    let scales = |v: &[f32]| -> Vec<f32> {
        v.chunks_exact(stride).flat_map(|row| &row[at..at + 3]).copied().collect()
    };
    let (got, moments) = (scales(&rows), scales(&host.moments.first));
    let wanted = host.scene().log_scales.as_flattened();
    let largest = moments.iter().fold(0.0f32, |a, m| a.max(m.abs()));
    let mut compared = 0;
    for (i, m) in moments.iter().enumerate().filter(|(_, m)| m.abs() > 1e-5 * largest) {
        assert!((got[i] - wanted[i]).abs() <= 1e-5, "{i}: {} {}, {m}", got[i], wanted[i]);
        compared += 1;
    }
    assert!(compared > 100, "{compared}");
}

/// A fine-tune of `scene` on the given device.
fn on_device(
    context: Context,
    scene: &Scene,
    views: &[TrainView],
) -> crate::Result<DeviceOptimiser> {
    moving_on_device(context, scene, views, 0.0)
}

/// The same with means that move.
fn moving_on_device(
    context: Context,
    scene: &Scene,
    views: &[TrainView],
    mean_rate: f32,
) -> crate::Result<DeviceOptimiser> {
    let options = RenderOptions { background: BACKGROUND, ..Default::default() };
    let prepared: Vec<_> = views.iter().map(|v| PreparedView::new(v.clone(), &options)).collect();
    let from = SceneOptimiser::new(scene.clone(), LearningRates::default(), mean_rate);
    DeviceOptimiser::new(context, &from, &prepared, Loss::L1_SSIM)
}

/// Three views of a scene with large Gaussians: more than the four slots each that the executor begins with.
fn large(n: usize, [width, height]: [u32; 2]) -> (Scene, Vec<TrainView>) {
    let mut scene = scene(n, 1, 5);
    scene.log_scales.iter_mut().flatten().for_each(|l| *l = l.max(-1.0));
    let view = |i| {
        let mut camera = camera(width, height);
        camera.translation.x += 0.1 * f64::from(i);
        TrainView { camera, photo: photo(width, height) }
    };
    (scene, (0..3).map(view).collect())
}

/// Steps of the executor on lavapipe against those in Rust, with too few slots to begin with.
#[test]
fn whole_steps_agree_and_slots_grow() {
    whole_steps_agree(0.0);
}

#[test]
fn whole_steps_agree_with_means_that_move() {
    whole_steps_agree(1e-4);
}

fn whole_steps_agree(mean_rate: f32) {
    let Some(context) = context() else { return };
    let (scene, views) = large(6000, [120, 80]);
    let start = || SceneOptimiser::new(scene.clone(), LearningRates::default(), mean_rate);
    let decay = |step: u64| 1.0 - 0.1 * step as f32;
    let run = |mut gpu: DeviceOptimiser| {
        let before = gpu.capacity();
        for step in 1..=6u64 {
            gpu.step(step as usize % 3, step, decay(step)).unwrap();
        }
        let losses = gpu.losses().unwrap();
        assert!(gpu.capacity() > before, "the scene fits into {before} slots: nothing was tested");
        let mut out = start();
        gpu.fetch(&mut out).unwrap();
        (out.take_scene(), losses)
    };
    let (on_gpu, gpu_losses) = run(moving_on_device(context, &scene, &views, mean_rate).unwrap());
    let (mut cpu, mut gradients) = (start(), gradients_at(&views, Loss::L1_SSIM));
    gradients.move_means(mean_rate != 0.0);
    let step = |step: u64| cpu.step(&mut gradients, step as usize % 3, step, decay(step));
    let cpu_losses: Vec<_> = (1..=6).map(step).collect();
    assert_eq!(gpu_losses.len(), 6);
    for (a, b) in gpu_losses.iter().zip(&cpu_losses) {
        println!("{a:?} {b:?}");
        assert!((a.loss / b.loss - 1.0).abs() < 1e-4 && (a.mse / b.mse - 1.0).abs() < 1e-4);
    }
    // Means that move change the order of depths that tie.
    let falls = cpu_losses[5].loss < cpu_losses[2].loss;
    assert!(falls || mean_rate != 0.0, "the same view, three steps later");
    let on_cpu = cpu.take_scene();
    assert!(relative("SH", on_gpu.sh.as_flattened(), on_cpu.sh.as_flattened()) < 1e-3);
    if mean_rate == 0.0 {
        assert!(on_gpu.means == scene.means);
    } else {
        let moved = |s: &Scene| -> Vec<f32> {
            let pairs = s.means.as_flattened().iter().zip(scene.means.as_flattened());
            pairs.map(|(a, b)| a - b).collect()
        };
        let (ours, theirs) = (moved(&on_gpu), moved(&on_cpu));
        let far = ours.iter().zip(&theirs).filter(|(a, b)| (*a - *b).abs() > 0.05 * mean_rate);
        let moving = theirs.iter().filter(|m| m.abs() > 0.1 * mean_rate).count();
        println!("{} of {} means differ, {moving} move", far.clone().count(), ours.len());
        assert!(moving > 100 && far.count() < ours.len() / 200);
    }
    // Twice on the device: the same bits.
    let again = moving_on_device(Context::software().unwrap(), &scene, &views, mean_rate).unwrap();
    assert_eq!(run(again).0, on_gpu);
}

#[test]
fn long_dispatches_are_folded() {
    assert_eq!(fold(0), (0, 1));
    assert_eq!(fold(5), (5, 1));
    let (x, y) = fold(200_000);
    assert!(x <= 65_535 && x * y >= 200_000);
}

#[test]
fn the_forward_pass_has_the_lists_that_the_tests_rely_on() {
    let mut f = Forward::default();
    let view = RenderView::new(&camera(200, 130), &RenderOptions::default());
    f.run(&scene(3000, 3, 11), &view);
    let longest = f.lists.offsets.windows(2).map(|w| w[1] - w[0]).max().unwrap_or(0);
    assert!((200..30_000).contains(&longest), "{longest}");
    assert_eq!(size_of::<TileGradient>(), 768 * 4);
}

/// Sums over views of several sizes, in pages and with too few slots to begin with.
#[test]
fn removal_effects_and_weights_agree() {
    let (Some(context), Some(mut paged)) = (context(), context()) else { return };
    let (scene, views) = large(3000, [120, 80]);
    let mut cameras: Vec<Camera> = views.into_iter().map(|view| view.camera).collect();
    cameras.push(camera(200, 130));
    let mut wanted_images = Vec::new();
    let wanted = crate::removal(&scene, &cameras, |image| wanted_images.push(image));
    paged.page = 1000;
    for context in [context, paged] {
        let mut images = Vec::new();
        let mut see = |image| images.push(image);
        let mut steps = steps_of(context, &scene).unwrap();
        let before = steps.workspace.sizes.capacity;
        let found = steps.removal(cameras.iter().map(whole), Some(&mut see)).unwrap();
        assert!(
            steps.workspace.sizes.capacity > before,
            "the scene fits into {before} slots: nothing was tested"
        );
        assert!(relative("effects", &found.effects, &wanted.effects) < 1e-4);
        assert!(relative("squared weights", &found.squared, &wanted.squared) < 1e-4);
        assert_eq!(images.len(), wanted_images.len());
        for (a, b) in images.iter().zip(&wanted_images) {
            assert!(relative("render", &a.rgb, &b.rgb) < 1e-5);
        }
    }
    // Part of the pixels of a view of 0.3 megapixels. Equal depths have the order of the Morton curve on the processor.
    let scene = scene.select(&gs_model::morton_order(&scene.means));
    let many = [camera(640, 480), camera(120, 80)];
    let wanted = crate::Visibility::of_all(&scene, &many).squared;
    let found = super::Adapter::Software.squared_weights(&scene, &many).unwrap();
    assert!(relative("sampled weights", &found, &wanted) < 1e-4);
}
