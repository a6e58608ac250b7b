//! The naive oracle: f64, no tiles, textbook formulas (covariance, conic, determinant), every
//! Gaussian against every pixel.

use finetune::{Image, Loss};
use gs_model::{Camera, Scene};

/// Parameters of a scene in f64.
#[derive(Clone)]
pub struct Parameters {
    pub means: Vec<[f64; 3]>,
    pub rotations: Vec<[f64; 4]>,
    pub log_scales: Vec<[f64; 3]>,
    pub opacity_logits: Vec<f64>,
    pub sh: Vec<[f64; 3]>,
    pub degree: u8,
    pub antialiased: bool,
}

impl Parameters {
    pub fn of(s: &Scene) -> Self {
        Self {
            means: s.means.iter().map(|v| v.map(f64::from)).collect(),
            rotations: s.rotations.iter().map(|v| v.map(f64::from)).collect(),
            log_scales: s.log_scales.iter().map(|v| v.map(f64::from)).collect(),
            opacity_logits: s.opacity_logits.iter().map(|&v| f64::from(v)).collect(),
            sh: s.sh.iter().map(|v| v.map(f64::from)).collect(),
            degree: s.sh_degree,
            antialiased: s.antialiased,
        }
    }
}

struct OracleSplat {
    i: usize,
    z: f32,
    x: f64,
    y: f64,
    conic: [f64; 3],
    opacity: f64,
    colour: [f64; 3],
}

/// Which (pixel, Gaussian) pairs are blended, so that finite differences do not jump.
pub type Gates = Vec<bool>;

/// What the oracle renders.
pub struct Render {
    pub rgb: Vec<f64>,
    pub gates: Gates,
    /// Pixels where a gate is so close that f32 may decide otherwise.
    pub doubtful: Vec<bool>,
}

fn matrix(q: [f64; 4]) -> [[f64; 3]; 3] {
    let n = q.iter().map(|c| c * c).sum::<f64>().sqrt();
    let [w, x, y, z] = q.map(|c| c / n);
    [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ]
}

fn basis(d: [f64; 3]) -> [f64; 16] {
    let [x, y, z] = d;
    let (xx, yy, zz) = (x * x, y * y, z * z);
    [
        0.28209479177387814,
        -0.4886025119029199 * y,
        0.4886025119029199 * z,
        -0.4886025119029199 * x,
        1.0925484305920792 * x * y,
        -1.0925484305920792 * y * z,
        0.31539156525252005 * (2.0 * zz - xx - yy),
        -1.0925484305920792 * x * z,
        0.5462742152960396 * (xx - yy),
        -0.5900435899266435 * y * (3.0 * xx - yy),
        2.890611442640554 * x * y * z,
        -0.4570457994644658 * y * (4.0 * zz - xx - yy),
        0.3731763325901154 * z * (2.0 * zz - 3.0 * xx - 3.0 * yy),
        -0.4570457994644658 * x * (4.0 * zz - xx - yy),
        1.445305721320277 * z * (xx - yy),
        -0.5900435899266435 * x * (xx - 3.0 * yy),
    ]
}

fn project(p: &Parameters, camera: &Camera, i: usize) -> Option<OracleSplat> {
    let mu = glam::DVec3::from(p.means[i]);
    let m = camera.rotation * mu + camera.translation;
    // The executor's comparison: 0.2 itself is not the same number in f32 and f64.
    if m.z as f32 <= 0.2f32 {
        return None;
    }
    let r = matrix(p.rotations[i]);
    let s = p.log_scales[i].map(f64::exp);
    let mut cov = [[0.0; 3]; 3];
    for a in 0..3 {
        for b in 0..3 {
            cov[a][b] = (0..3).map(|k| r[a][k] * s[k] * s[k] * r[b][k]).sum();
        }
    }
    let (w, h) = (f64::from(camera.width), f64::from(camera.height));
    let u =
        (m.x / m.z).clamp((-0.15 * w - camera.cx) / camera.fx, (1.15 * w - camera.cx) / camera.fx);
    let v =
        (m.y / m.z).clamp((-0.15 * h - camera.cy) / camera.fy, (1.15 * h - camera.cy) / camera.fy);
    let j = [
        glam::DVec3::new(camera.fx / m.z, 0.0, -camera.fx * u / m.z),
        glam::DVec3::new(0.0, camera.fy / m.z, -camera.fy * v / m.z),
    ];
    let t = j.map(|row| camera.rotation.transpose() * row);
    let s2 = |a: glam::DVec3, b: glam::DVec3| -> f64 {
        (0..3).map(|k| (0..3).map(|l| a[k] * cov[k][l] * b[l]).sum::<f64>()).sum()
    };
    let (a, b, c) = (s2(t[0], t[0]) + 0.3, s2(t[0], t[1]), s2(t[1], t[1]) + 0.3);
    let det = a * c - b * b;
    let before = (a - 0.3) * (c - 0.3) - b * b;
    let compensation = if p.antialiased { (before / det).sqrt() } else { 1.0 };
    let d = mu - camera.position();
    let d = d / d.length();
    let k = (p.degree as usize + 1).pow(2);
    let basis = basis([d.x, d.y, d.z]);
    let mut colour = [0.5; 3];
    for (n, coefficient) in p.sh[i * k..(i + 1) * k].iter().enumerate() {
        for ch in 0..3 {
            colour[ch] += basis[n] * coefficient[ch];
        }
    }
    Some(OracleSplat {
        i,
        // The executor sorts by f32 depth; ties by index.
        z: m.z as f32,
        x: camera.fx * m.x / m.z + camera.cx,
        y: camera.fy * m.y / m.z + camera.cy,
        conic: [c / det, -b / det, a / det],
        opacity: compensation / (1.0 + (-p.opacity_logits[i]).exp()),
        colour: colour.map(|c| c.max(0.0)),
    })
}

/// Renders over `background`. With `frozen`, those gates decide instead of the thresholds.
pub fn render(
    p: &Parameters,
    camera: &Camera,
    background: [f64; 3],
    frozen: Option<&Gates>,
) -> Render {
    let n = p.means.len();
    let mut list: Vec<_> = (0..n).filter_map(|i| project(p, camera, i)).collect();
    list.sort_by(|a, b| a.z.total_cmp(&b.z).then(a.i.cmp(&b.i)));
    let pixels = (camera.width * camera.height) as usize;
    let mut out = Render {
        rgb: Vec::with_capacity(3 * pixels),
        gates: vec![false; pixels * n],
        doubtful: vec![false; pixels],
    };
    for pixel in 0..pixels {
        let x = (pixel % camera.width as usize) as f64 + 0.5;
        let y = (pixel / camera.width as usize) as f64 + 0.5;
        let (mut t, mut colour, mut stopped) = (1.0, [0.0; 3], false);
        for s in &list {
            let (dx, dy) = (s.x - x, s.y - y);
            let [a, b, c] = s.conic;
            let sigma = 0.5 * (a * dx * dx + c * dy * dy) + b * dx * dy;
            let og = s.opacity * (-sigma).exp();
            let alpha = og.min(0.99);
            let rest = t * (1.0 - alpha);
            let counts = match frozen {
                Some(gates) => gates[pixel * n + s.i],
                None => {
                    let inside = !stopped && og >= 1.0 / 255.0;
                    if !stopped
                        && ((og * 255.0 - 1.0).abs() < 1e-3 || (rest / 1e-4 - 1.0).abs() < 1e-2)
                    {
                        out.doubtful[pixel] = true;
                    }
                    stopped |= inside && rest < 1e-4;
                    inside && !stopped
                }
            };
            if counts {
                out.gates[pixel * n + s.i] = true;
                for ch in 0..3 {
                    colour[ch] += alpha * t * s.colour[ch];
                }
                t = rest;
            }
        }
        for ch in 0..3 {
            out.rgb.push(colour[ch] + t * background[ch]);
        }
    }
    out
}

/// The loss of a picture, all weights as given.
pub fn loss(rgb: &[f64], photo: &Image, weights: Loss) -> f64 {
    let errors = || rgb.iter().zip(&photo.rgb).map(|(a, &b)| (a - f64::from(b)).abs());
    let n = rgb.len() as f64;
    let [l1, mse, ssim] = [weights.l1, weights.mse, weights.ssim].map(f64::from);
    l1 * errors().sum::<f64>() / n
        + mse * errors().map(|e| e * e).sum::<f64>() / n
        + ssim * (1.0 - self::ssim(rgb, photo))
}

/// SSIM, the window as a plain double sum.
fn ssim(rgb: &[f64], photo: &Image) -> f64 {
    let (w, h) = (photo.width as i64, photo.height as i64);
    let mut window = [[0.0; 11]; 11];
    for (a, row) in window.iter_mut().enumerate() {
        for (b, v) in row.iter_mut().enumerate() {
            let (dx, dy) = (a as f64 - 5.0, b as f64 - 5.0);
            *v = (-(dx * dx + dy * dy) / 4.5).exp();
        }
    }
    let sum: f64 = window.iter().flatten().sum();
    let mut ssim = 0.0;
    for ch in 0..3 {
        for y in 0..h {
            for x in 0..w {
                let [mut mx, mut my, mut xx, mut yy, mut xy] = [0.0; 5];
                for (a, row) in window.iter().enumerate() {
                    for (b, k) in row.iter().enumerate() {
                        let (u, v) = (x + b as i64 - 5, y + a as i64 - 5);
                        if u < 0 || v < 0 || u >= w || v >= h {
                            continue;
                        }
                        let at = (3 * (v * w + u) + ch) as usize;
                        let (p, q, k) = (rgb[at], f64::from(photo.rgb[at]), k / sum);
                        mx += k * p;
                        my += k * q;
                        xx += k * p * p;
                        yy += k * q * q;
                        xy += k * p * q;
                    }
                }
                ssim += (2.0 * mx * my + 1e-4) * (2.0 * (xy - mx * my) + 9e-4)
                    / ((mx * mx + my * my + 1e-4) * (xx - mx * mx + yy - my * my + 9e-4));
            }
        }
    }
    ssim / rgb.len() as f64
}
