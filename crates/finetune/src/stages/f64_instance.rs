//! The shared mathematics in f64, against central differences: the formulae themselves, without
//! the rounding of f32. The smooth part only: no cut, no stop; the cap is not reached.
#![allow(clippy::disallowed_methods, reason = "a test")]

mod consts {
    pub(super) const T_STOP: f64 = 0.0;
    pub(super) const ALPHA_MAX: f64 = 0.99;
    pub(super) const SIGMA_MAX: f64 = 700.0;
    pub(super) const LOG_SCALE_MAX: f64 = 40.0;
    pub(super) const BLUR: f64 = 0.3;
    pub(super) const MIN_QUATERNION_NORM2: f64 = 1e-30;
    pub(super) const MAX_QUATERNION_NORM2: f64 = 1e30;
}
use consts::*;

type F = f64;
type B = bool;

fn F(x: f64) -> f64 {
    x
}
fn select(otherwise: F, then: F, condition: B) -> F {
    if condition { then } else { otherwise }
}
fn min(a: F, b: F) -> F {
    a.min(b)
}
fn max(a: F, b: F) -> F {
    a.max(b)
}
fn clamp(x: F, low: F, high: F) -> F {
    x.max(low).min(high)
}
fn sqrt(x: F) -> F {
    x.sqrt()
}
fn exp_polynomial(x: F) -> F {
    x.exp()
}
fn sigmoid(l: F) -> F {
    1.0 / (1.0 + exp_polynomial(-l))
}

include!("math/prelude.rs");
include!("math/project.wgsl");
include!("math/project_adjoint.wgsl");
include!("math/sh.wgsl");
include!("math/blend.wgsl");
include!("math/frame.rs");

const DEGREE: u8 = 3;
const N: usize = 4;
const SIZE: (u32, u32) = (12, 9);
/// Per Gaussian: mean 3, rotation 4, log-scale 3, opacity 1, SH 48.
const STRIDE: usize = 59;
const BACKGROUND: [f64; 3] = [0.2, 0.6, 0.4];

fn three(p: &[f64]) -> [f64; 3] {
    [p[0], p[1], p[2]]
}

struct Drawn {
    frame: Frame,
    x: f64,
    y: f64,
    /// As the view shows it.
    opacity: f64,
    /// Without compensation.
    free_opacity: f64,
    basis: [f64; 16],
    raw: [f64; 3],
    colour: [f64; 3],
    sh: Vec<[f64; 3]>,
}

fn draw(lens: &Lens, p: &[f64], antialiased: bool) -> Drawn {
    let rotation = [p[3], p[4], p[5], p[6]];
    let frame = Frame::new(lens, three(p), rotation, three(&p[7..]));
    assert!(frame.in_front);
    let sh: Vec<[f64; 3]> = p[11..].as_chunks::<3>().0.to_vec();
    let basis = sh_basis(DEGREE, direction(frame.from_eye).0);
    let raw = raw_colour(&basis, &sh);
    Drawn {
        x: lens.fx * frame.m.x * frame.inv_z + lens.cx,
        y: lens.fy * frame.m.y * frame.inv_z + lens.cy,
        opacity: sigmoid(p[10]) * if antialiased { compensation_of(frame.shape) } else { 1.0 },
        free_opacity: sigmoid(p[10]),
        colour: raw.map(|c| c.max(0.0)),
        frame,
        basis,
        raw,
        sh,
    }
}

/// The loss, a quadratic of the image, and its gradient with respect to all parameters.
fn evaluate(lens: &Lens, p: &[f64], antialiased: bool) -> (f64, Vec<f64>) {
    // Sorted by depth already.
    let drawn: Vec<Drawn> = p.chunks_exact(STRIDE).map(|p| draw(lens, p, antialiased)).collect();
    let mut records = vec![[0.0; 9]; N];
    let mut loss = 0.0;
    for row in 0..SIZE.1 {
        for column in 0..SIZE.0 {
            let (px, py) = (f64::from(column) + 0.5, f64::from(row) + 0.5);
            let offsets = |d: &Drawn| {
                let (dx, dy) = (d.x - px, d.y - py);
                let s = d.frame.shape;
                (s.p * dx + s.q * dy, s.r * dy)
            };
            let (mut t, mut c) = (1.0, [0.0; 3]);
            for d in &drawn {
                let (e0, e1) = offsets(d);
                let step = gate(e0, e1, f64::INFINITY, d.opacity, T_STOP, t);
                for ch in 0..3 {
                    c[ch] += step.w * d.colour[ch];
                }
                t = step.t;
            }
            let mut g = [0.0; 3];
            let mut rg = 0.0;
            for ch in 0..3 {
                let seen = c[ch] + t * BACKGROUND[ch];
                let wanted = 0.3 + 0.02 * f64::from(column) - 0.03 * f64::from(row);
                loss += (seen - wanted).powi(2);
                g[ch] = 2.0 * (seen - wanted);
                rg += seen * g[ch];
            }
            let mut t = 1.0;
            for (d, r) in drawn.iter().zip(&mut records) {
                let (e0, e1) = offsets(d);
                let cg = d.colour[0] * g[0] + d.colour[1] * g[1] + d.colour[2] * g[2];
                let step = replay(e0, e1, f64::INFINITY, d.opacity, T_STOP, t, rg, cg);
                let v = step.v_sigma;
                let w = step.w;
                let add = [
                    w * g[0],
                    w * g[1],
                    w * g[2],
                    v,
                    v * e0 * e0,
                    v * e0 * e1,
                    v * e1 * e1,
                    v * e0,
                    v * e1,
                ];
                r.iter_mut().zip(add).for_each(|(r, a)| *r += a);
                (t, rg) = (step.t, step.rg);
            }
        }
    }
    let mut gradient = Vec::new();
    for (d, r) in drawn.iter().zip(&records) {
        let shape = shape_adjoint(&d.frame, Sym2(r[4], r[5], r[6]), antialiased.then_some(-r[3]));
        let v_raw = [0, 1, 2].map(|ch| if d.raw[ch] >= 0.0 { r[ch] } else { 0.0 });
        let mean = mean_adjoint(lens, &d.frame, shape.v_s, [r[7], r[8]]);
        let mean = add3(mean, direction_adjoint(&d.frame, &d.sh, v_raw));
        gradient.extend([mean.x, mean.y, mean.z]);
        gradient.extend(shape.d_rotation);
        gradient.extend(shape.d_log_scale);
        gradient.push(-(r[3] * (1.0 - d.free_opacity)));
        gradient.extend(d.basis.iter().flat_map(|b| v_raw.map(|v| b * v)));
    }
    (loss, gradient)
}

#[test]
fn all_gradients_agree_with_central_differences() {
    gradients_agree(false);
}

#[test]
fn gradients_go_through_the_compensation_of_opacity() {
    gradients_agree(true);
}

fn gradients_agree(antialiased: bool) {
    let camera = gs_model::Camera {
        name: String::new(),
        width: SIZE.0,
        height: SIZE.1,
        fx: 10.0,
        fy: 11.0,
        cx: 6.4,
        cy: 4.2,
        rotation: glam::DMat3::from_quat(glam::DQuat::from_euler(
            glam::EulerRot::XYZ,
            0.1,
            -0.15,
            0.05,
        )),
        translation: glam::DVec3::new(0.1, -0.2, 0.3),
        lens: None,
        near: gs_model::NEAR,
    };
    let lens = Lens::new(&camera);
    let mut rng = testing::Rng::seeded(12);
    let mut r = |low: f64, high: f64| rng.range(low, high);
    let mut p = Vec::new();
    for i in 0..N {
        let z = 2.0 + i as f64;
        // The last one is beyond the clamp of both slopes, and large.
        let (x, y, size) = match i {
            3 => (z * 1.2, z * 0.95, 1.0),
            _ => (z * r(-0.3, 0.3), z * r(-0.3, 0.3), 0.3),
        };
        p.extend([x, y, z]);
        p.extend([r(-2.0, 2.0), r(-2.0, 2.0), r(-2.0, 2.0), r(0.2, 2.0)]);
        let l = |s: f64| (size * z / 3.0).ln() + s;
        p.extend([l(r(-1.0, 1.0)), l(r(-1.0, 1.0)), l(r(-1.0, 1.0))]);
        p.push(r(-1.5, 1.5));
        for k in 0..48 {
            let a = if k < 3 { 1.0 } else { 0.25 };
            p.push(r(-a, a));
        }
    }
    // The factor is that of half the inverse of the covariance.
    for p in p.chunks_exact(STRIDE) {
        let s = draw(&lens, p, antialiased).frame.shape;
        let det = 1.0 / (4.0 * s.p * s.p * s.r * s.r);
        let wanted = [det, 2.0 * det * (s.q * s.q + s.r * s.r), 2.0 * det * s.p * s.p];
        for (got, wanted) in [s.det_over_m * s.m, s.cov_xx, s.cov_yy].iter().zip(wanted) {
            assert!((got / wanted - 1.0).abs() < 1e-9, "{got} {wanted}");
        }
    }
    let frame = draw(&lens, &p[3 * STRIDE..], antialiased).frame;
    assert!(frame.m.x * frame.inv_z > lens.hi_x && frame.m.y * frame.inv_z > lens.hi_y);
    let (_, got) = evaluate(&lens, &p, antialiased);
    let h = 1e-5;
    let wanted: Vec<f64> = (0..p.len())
        .map(|i| {
            let at = |x: f64| {
                let mut q = p.clone();
                q[i] = x;
                evaluate(&lens, &q, antialiased).0
            };
            (at(p[i] + h) - at(p[i] - h)) / (2.0 * h)
        })
        .collect();
    let largest = wanted.iter().fold(0.0f64, |a, b| a.max(b.abs()));
    let mut worst = 0.0f64;
    for (a, b) in got.iter().zip(&wanted) {
        worst = worst.max((a - b).abs() / b.abs().max(1e-4 * largest));
    }
    println!("{} parameters: worst relative error {worst:.1e}, largest {largest:.1e}", p.len());
    assert!(worst < 1e-5, "{worst}");
    // A quaternion's length has no effect.
    for (g, p) in got.chunks_exact(STRIDE).zip(p.chunks_exact(STRIDE)) {
        let along: f64 = g[3..7].iter().zip(&p[3..7]).map(|(g, q)| g * q).sum();
        assert!(along.abs() < 1e-12 * largest, "{along}");
    }
}
