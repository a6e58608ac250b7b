//! Merging by moments.

use gs_model::Scene;
use gs_model::math::{Symmetric, axes_product, rotation};
use testing::Rng;
use voxel::{Importance, Merge, Merging, Strategy, cube_of, voxelize};

use super::covariances::sizes_off;
use super::{Figure, Greatest, U};

/// A sum that keeps what rounding takes (Neumaier).
#[derive(Clone, Copy, Default)]
struct Sum(f64, f64);

impl Sum {
    fn add(&mut self, x: f64) {
        let sum = self.0 + x;
        let lost = if self.0.abs() >= x.abs() { self.0 - sum + x } else { x - sum + self.0 };
        (self.0, self.1) = (sum, self.1 + lost);
    }

    fn value(self) -> f64 {
        self.0 + self.1
    }
}

/// `n` Gaussians of about one size around `centre`.
fn cluster(n: usize, degree: u8, centre: f32) -> Scene {
    let mut r = Rng::seeded(5);
    let mut scene = Scene { sh_degree: degree, ..Scene::default() };
    for _ in 0..n {
        scene.means.push([0; 3].map(|_| centre + r.signed()));
        scene.rotations.push([1.0, 0.1 * r.signed(), 0.1 * r.signed(), 0.1 * r.signed()]);
        scene.log_scales.push([0.0, -0.5, 0.3].map(|l: f32| l + 0.1 * r.signed()));
        scene.opacity_logits.push(r.signed());
        (0..scene.sh_len()).for_each(|_| scene.sh.push([0; 3].map(|_| 1.0 + 0.1 * r.signed())));
    }
    scene
}

pub(super) fn figures(many: usize) -> Vec<Figure> {
    let few = |change: &dyn Fn(&mut Scene, usize)| {
        let mut scene = cluster(1000, 3, 0.0);
        (0..scene.len()).for_each(|i| change(&mut scene, i));
        scene
    };
    let ends = [-1e4, -88.0, -8.0, 0.0, 17.0, 88.0, 1e4];
    let mut r = Rng::seeded(6);
    let noise: Vec<f32> = (0..1000).map(|_| r.signed()).collect();
    let needle = few(&|s, i| {
        s.log_scales[i] = [2.0, -9.5, -9.5];
        s.means[i] = [noise[i], 0.0, 0.0];
        s.rotations[i] = [1.0, 1e-3 * noise[i], 1e-6, 1e-6 * noise[i]];
    });
    let mut out = Vec::new();
    let mut add = |name, scene: &Scene| out.extend(merged(name, scene));
    add("1e7 Gaussians in one voxel", &cluster(many, 0, 0.0));
    add("1e6 Gaussian sizes from the origin", &cluster(1000, 3, 1e6));
    add("needles of 1:1e5, nearly parallel", &needle);
    add("pancakes of 1e5:1", &few(&|s, i| s.log_scales[i] = [0.0, 0.0, -11.5]));
    add("opacity logits -1e4 to 1e4", &few(&|s, i| s.opacity_logits[i] = ends[i % 7]));
    add(
        "scales 1e-10 to 1e10",
        &few(&|s, i| s.log_scales[i] = s.log_scales[i].map(|l| l + 23.0 * noise[i])),
    );
    add(
        "SH coefficients to 1e4",
        &few(&|s, i| {
            s.sh[16 * i..16 * i + 16].iter_mut().for_each(|v| *v = v.map(|v| 1e4 * noise[i] * v))
        }),
    );
    out
}

/// One voxel of all, against its definition.
fn merged(name: &'static str, scene: &Scene) -> Vec<Figure> {
    let [mut shape, mut opacity, mut sh] = [Greatest::default(); 3];
    let weights = scene.opacity_logits.iter().map(|l| 1.0 + l.clamp(-0.9, 9.0)).collect();
    let importance = Importance::Given(weights);
    let one = cube_of(&scene.means).and_then(|cube| {
        let voxels = voxelize(scene, &cube, &Strategy::Uniform { depth: 0 })?;
        Ok(Merging::new(scene, &voxels, Merge::Moments, &importance)?.scene())
    });
    let (Ok(one), Importance::Given(weights)) = (one, &importance) else {
        return vec![Greatest::UNKNOWN.figure("merging", name)];
    };
    let twin = Twin::of(scene, weights);
    let found = axes_product(
        &rotation(one.rotations[0]),
        one.log_scales[0].map(|l| libm::exp(2.0 * f64::from(l))),
    );
    let (off, ratio) = sizes_off(&found, &twin.covariance);
    shape.add(off, 8.0 * U * ratio + 1e-15 * ratio * ratio);
    let alpha = 1.0 / (1.0 + libm::exp(-f64::from(one.opacity_logits[0])));
    opacity.add((alpha - twin.opacity).abs(), U);
    for (found, wanted) in one.sh.as_flattened().iter().zip(&twin.sh) {
        sh.add((f64::from(*found) - wanted).abs() / twin.greatest_sh, 4.0 * U);
    }
    vec![
        shape.figure("merged size, of itself", name),
        opacity.figure("merged opacity", name),
        sh.figure("merged SH, of the greatest coefficient", name),
    ]
}

/// The moments of all Gaussians of a scene.
struct Twin {
    covariance: Symmetric,
    opacity: f64,
    sh: Vec<f64>,
    greatest_sh: f64,
}

impl Twin {
    fn of(scene: &Scene, weights: &[f32]) -> Self {
        let weight = |i: usize| f64::from(weights[i]);
        let n = scene.len();
        let mean_of = |value: &dyn Fn(usize) -> f64| {
            let [mut sum, mut total] = [Sum::default(); 2];
            for i in 0..n {
                sum.add(weight(i) * value(i));
                total.add(weight(i));
            }
            sum.value() / total.value()
        };
        let mean = [0, 1, 2].map(|k| mean_of(&|i| f64::from(scene.means[i][k])));
        let (mut sums, mut total) = ([Sum::default(); 6], Sum::default());
        let [mut density, mut stacked] = [Sum::default(); 2];
        for i in 0..n {
            let scales = scene.log_scales[i].map(|l| libm::exp(f64::from(l)));
            let c = axes_product(&rotation(scene.rotations[i]), scales.map(|s| s * s));
            let d: [f64; 3] = std::array::from_fn(|k| f64::from(scene.means[i][k]) - mean[k]);
            let pairs = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)];
            for (sum, ((a, b), c)) in sums.iter_mut().zip(pairs.into_iter().zip(c)) {
                sum.add(weight(i) * (c + d[a] * d[b]));
            }
            total.add(weight(i));
            let alpha = 1.0 / (1.0 + libm::exp(-f64::from(scene.opacity_logits[i])));
            let depth = -libm::log1p(-alpha.min(0.99));
            density.add(depth * area(scales));
            stacked.add(depth);
        }
        let covariance = sums.map(|sum| sum.value() / total.value());
        let (variances, _) = gs_model::math::eigen_of(&covariance);
        let depth = density.value() / area(variances.map(|v| v.max(0.0).sqrt()));
        let opacity = (-libm::expm1(-depth.min(stacked.value()))).clamp(1e-12, 0.99);
        let per = scene.sh.len() / n;
        let flat = scene.sh.as_flattened();
        let sh = (0..3 * per).map(|c| mean_of(&|i| f64::from(flat[3 * per * i + c]))).collect();
        let greatest_sh = flat.iter().fold(0.0, |m: f64, v| m.max(f64::from(v.abs())));
        Self { covariance, opacity, sh, greatest_sh }
    }
}

/// Root mean square of the principal cross-sections, over pi.
fn area([a, b, c]: [f64; 3]) -> f64 {
    (((b * c).powi(2) + (a * c).powi(2) + (a * b).powi(2)) / 3.0).sqrt()
}
