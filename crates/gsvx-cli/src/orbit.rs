//! Generated cameras: a circle around what is opaque.

use gs_model::{Camera, Scene};

/// Options for cameras on a circle.
#[derive(clap::Args, Clone, Debug)]
pub(crate) struct Orbit {
    /// Generate this many cameras on a circle around the scene's centre.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=3600))]
    pub(crate) orbit: Option<u32>,
    /// With --orbit: distance from the centre in world units [default: twice the median distance
    /// of the Gaussians].
    #[arg(long, value_name = "UNITS", requires = "orbit")]
    orbit_radius: Option<f64>,
    /// With --orbit: height of the circle, degrees above the horizon.
    #[arg(
        long,
        value_name = "DEGREES",
        default_value_t = 20.0,
        requires = "orbit",
        allow_negative_numbers = true
    )]
    elevation: f64,
    /// With --orbit: direction that is up (COLMAP scenes: -y).
    #[arg(long, default_value = "-y", requires = "orbit", allow_hyphen_values = true,
          value_parser = ["x", "-x", "y", "-y", "z", "-z"])]
    up: String,
    /// With --orbit: image size.
    #[arg(long, value_name = "WxH", default_value = "640x480", requires = "orbit", value_parser = size)]
    size: (u32, u32),
    /// With --orbit: horizontal field of view, degrees.
    #[arg(long, value_name = "DEGREES", default_value_t = 60.0, requires = "orbit")]
    fov: f64,
}

fn size(text: &str) -> Result<(u32, u32), String> {
    let parsed = text.split_once('x').and_then(|(w, h)| Some((w.parse().ok()?, h.parse().ok()?)));
    match parsed {
        Some((w, h)) if (1..=8192).contains(&w) && (1..=8192).contains(&h) => Ok((w, h)),
        _ => Err("use WIDTHxHEIGHT, 1 to 8192 each".into()),
    }
}

impl Orbit {
    /// `n` cameras that look at the centre of `scene`.
    pub(crate) fn cameras(&self, scene: &Scene, n: u32) -> anyhow::Result<Vec<Camera>> {
        anyhow::ensure!(!scene.is_empty(), "the model holds no Gaussian to look at");
        anyhow::ensure!((1.0..=170.0).contains(&self.fov), "--fov {}: 1 to 170 degrees", self.fov);
        anyhow::ensure!(self.elevation.abs() < 90.0, "--elevation: between -90 and 90 degrees");
        let (centre, spread) = centre_and_spread(scene);
        let radius = self.orbit_radius.unwrap_or((2.0 * spread).max(1e-3));
        anyhow::ensure!(radius.is_finite() && radius > 0.0, "--orbit-radius: a positive number");
        let (axis, sign) = match self.up.as_str() {
            "x" => (0, 1.0),
            "-x" => (0, -1.0),
            "y" => (1, 1.0),
            "z" => (2, 1.0),
            "-z" => (2, -1.0),
            _ => (1, -1.0),
        };
        let mut up = [0.0; 3];
        up[axis] = sign;
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        let (sin, cos) = sin_cos(self.elevation.to_radians());
        let [width, height] = [self.size.0, self.size.1];
        let focal = 0.5 * f64::from(width) / libm::tan(0.5 * self.fov.to_radians());
        Ok((0..n)
            .map(|i| {
                let turn = std::f64::consts::TAU * f64::from(i) / f64::from(n);
                let (s, c) = sin_cos(turn);
                let mut eye = centre;
                eye[u] += radius * cos * c;
                eye[v] += radius * cos * s;
                eye[axis] += radius * sin * sign;
                Camera::looking_at(format!("orbit-{i:04}"), eye, centre, up, [width, height], focal)
            })
            .collect())
    }
}

fn sin_cos(angle: f64) -> (f64, f64) {
    (libm::sin(angle), libm::cos(angle))
}

/// Per-axis median of the means that are at least half opaque (of all, if none is), and the median
/// distance from it.
fn centre_and_spread(scene: &Scene) -> ([f64; 3], f64) {
    let opaque: Vec<usize> = (0..scene.len()).filter(|&i| scene.opacity_logits[i] > 0.0).collect();
    let chosen = if opaque.is_empty() { (0..scene.len()).collect() } else { opaque };
    let median = |mut values: Vec<f64>| {
        let middle = values.len() / 2;
        *values.select_nth_unstable_by(middle, f64::total_cmp).1
    };
    let centre: [f64; 3] = std::array::from_fn(|k| {
        median(chosen.iter().map(|&i| f64::from(scene.means[i][k])).collect())
    });
    let distance = |&i: &usize| {
        let d: f64 = (0..3).map(|k| square(f64::from(scene.means[i][k]) - centre[k])).sum();
        d.sqrt()
    };
    (centre, median(chosen.iter().map(distance).collect()))
}

fn square(v: f64) -> f64 {
    v * v
}
