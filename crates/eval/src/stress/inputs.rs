//! Pathological scenes: invalid, degenerate and extreme ones, and ordinary ones for comparison.

use gs_model::Scene;
use testing::{Rng, trained_like};

/// One input: its name, its SH degree, and what is done to an ordinary scene to make it.
pub(crate) struct Input {
    pub(crate) name: &'static str,
    pub(crate) sh_degree: u8,
    make: fn(&mut Scene, &mut Rng, usize),
}

/// Every input. `n` is the number of Gaussians of those that do not fix it.
pub(crate) const INPUTS: &[Input] = &[
    input("no Gaussian", 3, |s, _, _| cut(s, 0)),
    input("one Gaussian", 3, |s, _, _| cut(s, 1)),
    input("two Gaussians", 2, |s, _, _| cut(s, 2)),
    input("ordinary, SH degree 0", 0, |_, _, _| {}),
    input("ordinary, SH degree 1", 1, |_, _, _| {}),
    input("ordinary, SH degree 2", 2, |_, _, _| {}),
    input("ordinary, SH degree 3", 3, |_, _, _| {}),
    input("all identical", 1, |s, _, n| *s = s.select(&vec![0; n])),
    input("duplicates by the thousand", 1, |s, _, n| {
        let indices: Vec<usize> = (0..n).map(|i| i % (n / 1000).max(3)).collect();
        *s = s.select(&indices);
    }),
    input("one NaN mean", 0, |s, _, n| s.means[n / 2][1] = f32::NAN),
    input("one infinite mean", 0, |s, _, n| s.means[n / 2][2] = f32::INFINITY),
    input("one NaN opacity", 0, |s, _, n| s.opacity_logits[n / 2] = f32::NAN),
    input("one infinite scale", 0, |s, _, n| s.log_scales[n / 2][0] = f32::INFINITY),
    input("scale of zero (-inf)", 0, |s, _, n| s.log_scales[n / 2][0] = f32::NEG_INFINITY),
    input("one NaN SH coefficient", 1, |s, _, n| s.sh[n][0] = f32::NAN),
    input("a zero quaternion", 0, |s, _, n| s.rotations[n / 2] = [0.0; 4]),
    input("a quaternion of -0", 0, |s, _, n| s.rotations[n / 2] = [-0.0; 4]),
    input("denormals and -0 everywhere", 1, |s, r, _| {
        let mut tiny = || f32::from_bits((r.bits() >> 41) as u32 | (r.bits() as u32 & 1) << 31);
        s.means.as_flattened_mut().iter_mut().for_each(|v| *v = tiny());
        s.sh.as_flattened_mut().iter_mut().for_each(|v| *v = tiny());
        s.opacity_logits.iter_mut().for_each(|v| *v = -0.0);
        s.log_scales.as_flattened_mut().iter_mut().for_each(|v| *v = tiny());
    }),
    input("quaternions of norm 1e-18 to 1e18", 0, |s, r, _| {
        for q in &mut s.rotations {
            let norm = libm::expf(41.0 * r.signed());
            q.iter_mut().for_each(|v| *v *= norm);
        }
    }),
    input("scales 1e-38 to 1e38", 0, |s, r, _| {
        s.log_scales.as_flattened_mut().iter_mut().for_each(|v| *v = 87.4 * r.signed());
    }),
    input("needles", 0, |s, r, _| {
        s.log_scales.iter_mut().for_each(|l| *l = [-12.0, 2.0 + r.signed(), -12.0]);
    }),
    input("pancakes", 0, |s, r, _| {
        s.log_scales.iter_mut().for_each(|l| *l = [1.0 + r.signed(), 1.0, -20.0]);
    }),
    input("opacity logits +-1e4", 0, |s, r, _| {
        s.opacity_logits.iter_mut().for_each(|v| *v = 1e4 * r.signed());
    }),
    input("SH coefficients +-1e4", 3, |s, r, _| {
        s.sh.as_flattened_mut().iter_mut().for_each(|v| *v = 1e4 * r.signed());
    }),
    input("SH coefficients +-3e38", 0, |s, r, _| {
        s.sh.as_flattened_mut().iter_mut().for_each(|v| *v = 3e38 * r.signed());
    }),
    input("coordinates at 1e-30", 0, |s, _, _| scale(s, 1e-30)),
    input("coordinates at 1e7", 0, |s, _, _| {
        s.means.as_flattened_mut().iter_mut().for_each(|v| *v += 1e7);
    }),
    input("coordinates to 1e30", 0, |s, _, _| scale(s, 1e30)),
    input("coordinates to 3e38", 0, |s, _, _| {
        s.means.as_flattened_mut().iter_mut().for_each(|v| *v = v.clamp(-1.0, 1.0) * 3.4e38);
    }),
    input("an outlier a million units away", 0, |s, _, n| s.means[n / 3] = [1e6, -1e6, 1e6]),
    input("a line", 0, |s, r, _| s.means.iter_mut().for_each(|m| *m = [r.signed(), 0.0, 0.0])),
    input("a plane", 0, |s, r, _| {
        s.means.iter_mut().for_each(|m| *m = [r.signed(), r.signed(), 3.0])
    }),
    input("a lattice", 0, |s, _, n| {
        let side = ((n as f64).cbrt() as usize).max(1);
        for (i, m) in s.means.iter_mut().enumerate() {
            *m = [i % side, i / side % side, i / side / side].map(|v| v as f32 * 0.25);
        }
    }),
];

const fn input(name: &'static str, sh_degree: u8, make: fn(&mut Scene, &mut Rng, usize)) -> Input {
    Input { name, sh_degree, make }
}

fn cut(scene: &mut Scene, n: usize) {
    let indices: Vec<usize> = (0..n).collect();
    *scene = scene.select(&indices);
}

fn scale(scene: &mut Scene, by: f32) {
    scene.means.as_flattened_mut().iter_mut().for_each(|v| *v *= by);
}

impl Input {
    /// The scene, of `n` Gaussians where the input does not fix the number; the same every time.
    pub(crate) fn scene(&self, n: usize) -> Scene {
        let mut r = Rng::seeded(7);
        let mut scene = trained_like(n, self.sh_degree, &mut r);
        (self.make)(&mut scene, &mut r, n);
        scene
    }
}
