//! Projection, blending and their adjoint.

use finetune::reference::{Footprint, footprints, footprints_f64, gradients_f64, render_f64};
use finetune::{Image, Loss, Photo, RenderOptions, TrainView, ViewGradients, render};
use gs_model::{Camera, Scene};
use testing::Rng;

use super::{Figure, Greatest, U};

const BACKGROUND: [f32; 3] = [0.2, 0.3, 0.4];
/// Standard deviation of the blur of footprints, pixels: no footprint is narrower.
const BLUR: f64 = 0.5477;

/// A scene and a camera that looks at it.
struct Input {
    name: &'static str,
    scene: Scene,
    camera: Camera,
}

/// `n` ordinary Gaussians around `centre`, of log-scales around `size`.
fn cloud(n: usize, degree: u8, centre: [f32; 3], size: f64) -> Scene {
    let mut r = Rng::seeded(3);
    let mut scene = Scene { sh_degree: degree, ..Scene::default() };
    for _ in 0..n {
        scene.means.push(centre.map(|c| c + 2.0 * r.signed()));
        scene.rotations.push([r.signed(), r.signed(), r.signed(), 1.1 + r.signed()]);
        scene.log_scales.push([0; 3].map(|_| (size + r.range(-1.0, 0.5)) as f32));
        scene.opacity_logits.push(3.0 * r.signed());
        for k in 0..scene.sh_len() {
            let most = if k == 0 { 1.5 } else { 0.3 };
            scene.sh.push([0; 3].map(|_| most * r.signed()));
        }
    }
    scene
}

fn camera(eye: [f64; 3], target: [f64; 3], size: [u32; 2], focal: f64) -> Camera {
    Camera::looking_at("stress".into(), eye, target, [0.1, 1.0, 0.2], size, focal)
}

/// 6 units before the origin.
fn front() -> Camera {
    camera([3.1, 1.7, -4.9], [0.0; 3], [64, 48], 60.0)
}

fn inputs() -> Vec<Input> {
    let ordinary = |n| cloud(n, 3, [0.0; 3], -1.5);
    let with = |scene: &Scene, change: &dyn Fn(&mut Scene, usize)| {
        let mut scene = scene.clone();
        (0..scene.len()).for_each(|i| change(&mut scene, i));
        scene
    };
    let few = ordinary(40);
    let ends = [-1e4, -88.0, -5.6, -5.5, 0.0, 17.0, 88.0, 1e4];
    let far = 1e6 * libm::exp(-1.5) as f32;
    let eye = [3.1, 1.7, -4.9].map(|e| f64::from(far) + e);
    let beside = || camera(eye, [f64::from(far); 3], [64, 48], 60.0);
    let distant = cloud(40, 3, [far; 3], -1.5);
    let needle = |scene: &mut Scene, i: usize| scene.log_scales[i] = [1.5, -10.0, -10.0];
    let input = |name, scene| Input { name, scene, camera: front() };
    let mut all = vec![
        input("ordinary", few.clone()),
        Input {
            name: "1e6 Gaussian sizes from the origin",
            scene: distant.clone(),
            camera: beside(),
        },
        Input {
            name: "needles, far from the origin",
            scene: with(&distant, &needle),
            camera: beside(),
        },
        input("needles of 1:1e5", with(&few, &needle)),
        input("pancakes of 1e5:1", with(&few, &|s, i| s.log_scales[i] = [0.0, 0.0, -11.5])),
        input("opacity logits -1e4 to 1e4", with(&few, &|s, i| s.opacity_logits[i] = ends[i % 8])),
        input(
            "SH coefficients to 1e4",
            with(&few, &|s, i| {
                s.sh[16 * i..16 * i + 16].iter_mut().for_each(|v| *v = v.map(|v| 1e4 * v))
            }),
        ),
        input(
            "3000 faint layers",
            with(&ordinary(3000), &|s, i| {
                (s.opacity_logits[i], s.log_scales[i]) = (-5.2, [0.5, 0.0, 0.3]);
            }),
        ),
    ];
    let mut antialiased = with(&few, &|s, i| {
        if i % 2 == 0 {
            s.log_scales[i] = [1.5, -10.0, -10.0];
        }
    });
    antialiased.antialiased = true;
    all.push(input("antialiased, half of them needles of 1:1e5", antialiased));
    all.push(Input {
        name: "one Gaussian over a million pixels",
        scene: with(&few.select(&[0]), &|s, i| s.log_scales[i] = [1.5, 2.0, 1.0]),
        camera: camera([3.1, 1.7, -4.9], [0.0; 3], [1024, 1024], 900.0),
    });
    all
}

pub(super) fn figures() -> Vec<Figure> {
    let of = |input: &Input| {
        let (mut figures, shift) = projection(input);
        figures.extend(pixels(input, shift));
        figures
    };
    inputs().iter().flat_map(of).collect()
}

/// What the errors of the projection of a Gaussian are relative to.
struct Sensitivity {
    /// Pixels that the Gaussian moves if what cancels in its mean changes by as much as it is.
    shift: f64,
    /// Lengths that cancel in the mean as the camera sees it, over its depth.
    cancelled: f64,
    /// Length of the footprint over its least width.
    length: f64,
    /// Sum of the greatest SH coefficients, 1 at least.
    colours: f64,
}

impl Sensitivity {
    fn of(scene: &Scene, i: usize, camera: &Camera) -> Self {
        let (eye, mean) = (camera.position(), scene.means[i].map(f64::from));
        let offset = [0, 1, 2].map(|k| mean[k] - eye[k]);
        let axis = camera.rotation.row(2);
        let depth: f64 = (0..3).map(|k| axis[k] * offset[k]).sum();
        let norm = |v: [f64; 3]| v.iter().map(|v| v * v).sum::<f64>().sqrt();
        let slope = norm(offset) / depth;
        let magnification = camera.fx / depth * slope;
        let scale = scene.log_scales[i].into_iter().fold(f32::MIN, f32::max);
        let greatest = |c: &[f32; 3]| c.iter().fold(0.0, |m: f64, v| m.max(f64::from(v.abs())));
        let cancelled = (norm([eye.x, eye.y, eye.z]) + norm(offset)) / depth;
        Self {
            shift: camera.fx * slope * cancelled,
            cancelled,
            length: 1.0 + libm::exp(f64::from(scale)) * magnification / BLUR,
            colours: 1.0 + scene.sh_of(i).iter().map(greatest).sum::<f64>(),
        }
    }
}

/// Position, widths, opacity and colour of footprints; and the greatest bound of a position, pixels.
fn projection(Input { name, scene, camera }: &Input) -> (Vec<Figure>, f64) {
    let (found, wanted) = (footprints(scene, camera), footprints_f64(scene, camera));
    let [mut position, mut width, mut opacity, mut colour] = [Greatest::default(); 4];
    let mut shift = 0.0f64;
    for (i, (found, wanted)) in found.iter().zip(&wanted).enumerate() {
        let (Some(found), Some(wanted)) = (found, wanted) else { continue };
        let of = Sensitivity::of(scene, i, camera);
        let off = |k: usize| (found.mean[k] - wanted.mean[k]).abs();
        let [x, y] = wanted.mean.map(f64::abs);
        let bound = U * (of.shift + x + y + f64::from(camera.width + camera.height));
        position.add(off(0).max(off(1)), bound);
        shift = shift.max(bound);
        width.add(widths(found, wanted), 2.0 * U * of.cancelled * of.length);
        let compensated = if scene.antialiased { of.cancelled * of.length } else { 1.0 };
        opacity.add((found.opacity - wanted.opacity).abs(), 2.0 * U * compensated);
        for k in 0..3 {
            let off = (found.colour[k] - wanted.colour[k]).abs();
            colour.add(off / of.colours, U * of.cancelled);
        }
    }
    let figures = vec![
        position.figure("position in the image, pixels", name),
        width.figure("width in the image, of itself", name),
        opacity.figure("opacity in the image", name),
        colour.figure("colour, of the SH coefficients", name),
    ];
    (figures, shift)
}

/// By how much the width of a footprint is off, of itself, in the worst direction.
fn widths(found: &Footprint, wanted: &Footprint) -> f64 {
    let ([a, b, c], [p, q, r]) = (found.factor, wanted.factor);
    // found times the inverse of wanted: the identity but for the error.
    let (xx, xy, yy) = (a / p - 1.0, (b - a * q / p) / r, c / r - 1.0);
    xx.abs().max(yy.abs()) + 0.5 * xy.abs()
}

/// The image, and the gradients of a loss, of footprints that may be `shift` pixels off.
fn pixels(Input { name, scene, camera }: &Input, shift: f64) -> Vec<Figure> {
    let options = RenderOptions { background: BACKGROUND, ..RenderOptions::default() };
    let (found, wanted) = (render(scene, camera, &options), render_f64(scene, camera, BACKGROUND));
    let footprints = footprints_f64(scene, camera);
    let brightest = footprints.iter().flatten().flat_map(|f| f.colour).fold(1.0, f64::max);
    let mut image = Greatest::default();
    let mut target = Image::new(camera.width, camera.height);
    for (k, (a, b)) in found.rgb.iter().zip(&wanted.rgb).enumerate() {
        let doubtful = wanted.doubtful[k / 3];
        if !doubtful {
            image.add((f64::from(*a) - b).abs() / brightest, 1e-5 + shift);
        }
        // A doubtful pixel has hardly an error, and so no part in the gradient.
        target.rgb[k] = if doubtful { *b as f32 } else { (k % 7) as f32 / 7.0 };
    }
    let photo = Photo::from(&target);
    let wanted = gradients_f64(scene, camera, BACKGROUND, &photo.image().rgb);
    let view = TrainView { camera: camera.clone(), photo };
    let Ok(mut views) = ViewGradients::new(vec![view], Loss::MSE, &options) else {
        return vec![Greatest::UNKNOWN.figure("adjoint", name)];
    };
    views.move_means(true);
    views.run(scene, 0);
    let mut classes = [const { Vec::new() }; 5];
    for (i, wanted) in wanted.iter().enumerate() {
        let Some(found) = views.of(scene, i) else { continue };
        let mut put = |class: usize, found: &[f32], wanted: &[f64]| {
            classes[class].extend(found.iter().map(|v| f64::from(*v)).zip(wanted.iter().copied()));
        };
        put(0, found.sh[..wanted.sh.len()].as_flattened(), wanted.sh.as_flattened());
        put(1, &[found.opacity_logit], &[wanted.opacity_logit]);
        put(2, &found.log_scale, &wanted.log_scale);
        put(3, &found.rotation, &wanted.rotation);
        put(4, &found.mean, &wanted.mean);
    }
    let mut adjoint = Greatest::default();
    for class in &classes {
        let largest = class.iter().fold(f64::MIN_POSITIVE, |m, (_, wanted)| m.max(wanted.abs()));
        class.iter().for_each(|(a, b)| adjoint.add((a - b).abs() / largest, 4e-4 + 4.0 * shift));
    }
    vec![
        image.figure("image, of the brightest colour", name),
        adjoint.figure("gradient, of the greatest", name),
    ]
}
