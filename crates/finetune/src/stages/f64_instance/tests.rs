//! Gradients against central differences. The smooth part only: splats do not end, pixels do not stop, and the cap is
//! not reached.
#![allow(clippy::disallowed_methods, reason = "a test")]

use super::*;

const N: usize = 4;
const SIZE: (u32, u32) = (12, 9);
/// Per Gaussian: mean 3, rotation 4, log-scale 3, opacity 1, SH 48.
const STRIDE: usize = 59;
const BACKGROUND: [f64; 3] = [0.2, 0.6, 0.4];

fn three(p: &[f64]) -> [f64; 3] {
    [p[0], p[1], p[2]]
}

fn draw(lens: &Lens, p: &[f64], antialiased: bool) -> ViewGaussian {
    let gaussian = Gaussian {
        mean: three(p),
        rotation: [p[3], p[4], p[5], p[6]],
        log_scale: three(&p[7..]),
        opacity_logit: p[10],
        sh: p[11..].as_chunks::<3>().0.to_vec(),
    };
    ViewGaussian::new(lens, &gaussian, antialiased).unwrap()
}

/// The loss, a quadratic of the image, and its gradient with respect to all parameters.
fn evaluate(lens: &Lens, p: &[f64], antialiased: bool) -> (f64, Vec<f64>) {
    // Sorted by depth already.
    let drawn: Vec<ViewGaussian> =
        p.chunks_exact(STRIDE).map(|p| draw(lens, p, antialiased)).collect();
    let (size, background) = (SIZE, BACKGROUND);
    let picture = Picture { lens, size, background, antialiased, ends: false, drawn: &drawn };
    let of = picture.evaluate(|at, seen| {
        let (column, row) = (at / 3 % SIZE.0 as usize, at / 3 / SIZE.0 as usize);
        let off = seen - (0.3 + 0.02 * column as f64 - 0.03 * row as f64);
        (off * off, 2.0 * off)
    });
    let mut gradient = Vec::new();
    for g in &of.gradients {
        gradient.extend(g.mean);
        gradient.extend(g.rotation);
        gradient.extend(g.log_scale);
        gradient.push(g.opacity_logit);
        gradient.extend(g.sh.as_flattened());
    }
    (of.loss, gradient)
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
