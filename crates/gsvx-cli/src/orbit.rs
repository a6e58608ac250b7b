//! Generated cameras: a circle around what matters in a model, or the part of a circle from which it
//! was photographed.

use crate::exit::note;
use crate::size::{list, number, positive};
use anyhow::{Context, Result};
use finetune::framing::{self, Constraints};
use gs_model::{Camera, Scene};

/// Options for cameras on a circle.
#[derive(clap::Args, Clone, Debug)]
pub(crate) struct Orbit {
    /// Generate this many cameras around what the model shows: on a circle (to tune: at several heights), or
    /// where the model is seen from one side only, on an arc. The first is the one that sees most.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=3600))]
    pub(crate) orbit: Option<u32>,
    /// With --orbit: distance from the centre in world units [default: what sees most].
    #[arg(long, value_name = "UNITS", requires = "orbit", value_parser = positive)]
    orbit_radius: Option<f64>,
    /// With --orbit: height of the circle, degrees above the horizon [default: 8, or higher where
    /// more is seen from there].
    #[arg(long, value_name = "DEGREES", requires = "orbit", allow_negative_numbers = true,
          value_parser = elevation)]
    elevation: Option<f64>,
    /// With --orbit: direction that is up: x, -y, ... or X,Y,Z [default: that of the cameras in the
    /// model's folder, else -y, leaning where clearly more is seen then].
    #[arg(long, value_name = "AXIS", requires = "orbit", allow_hyphen_values = true,
          value_parser = up)]
    up: Option<Up>,
    /// With --orbit: the whole circle, even if the model is seen well from a part of it only.
    #[arg(long, requires = "orbit")]
    full_circle: bool,
    /// With --orbit: image size.
    #[arg(long, value_name = "WxH", default_value_t = Size(framing::SIZE), requires = "orbit", value_parser = size)]
    size: Size,
    /// With --orbit: horizontal field of view, degrees.
    #[arg(long, value_name = "DEGREES", default_value_t = framing::FIELD_OF_VIEW, requires = "orbit",
          value_parser = field_of_view)]
    fov: f64,
}

/// A direction of length 1.
#[derive(Clone, Copy, Debug)]
struct Up([f64; 3]);

fn up(text: &str) -> Result<Up, String> {
    let (sign, axis) = match text.strip_prefix('-') {
        Some(axis) => (-1.0, axis),
        None => (1.0, text),
    };
    if let Some(k) = ["x", "y", "z"].iter().position(|&a| a == axis) {
        let mut direction = [0.0; 3];
        direction[k] = sign;
        return Ok(Up(direction));
    }
    let direction: Option<[f64; 3]> = list(text, ',');
    let usable = |d: &[f64; 3]| d.iter().all(|v| v.is_finite()) && *d != [0.0; 3];
    let direction = direction.filter(usable).map(|d| Up(framing::unit(d)));
    direction.ok_or_else(|| "use x, -x, y, -y, z, -z or X,Y,Z".into())
}

fn elevation(text: &str) -> Result<f64, String> {
    number(text, |v| v.abs() < 90.0, "use a number between -90 and 90")
}

fn field_of_view(text: &str) -> Result<f64, String> {
    number(text, |v| (1.0..=170.0).contains(v), "use 1 to 170 degrees")
}

/// Of an image, in pixels.
#[derive(Clone, Copy, Debug)]
struct Size([u32; 2]);

impl std::fmt::Display for Size {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}x{}", self.0[0], self.0[1])
    }
}

fn size(text: &str) -> Result<Size, String> {
    let within = |size: &[u32; 2]| size.iter().all(|edge| (1..=8192).contains(edge));
    let size = list(text, 'x').filter(within).map(Size);
    size.ok_or_else(|| "use WIDTHxHEIGHT, 1 to 8192 each".into())
}

impl Orbit {
    /// `n` cameras on a circle around what matters in `scene`; `up` is what its own cameras say is up.
    pub(crate) fn cameras(
        &self,
        scene: &Scene,
        n: u32,
        up: Option<[f64; 3]>,
    ) -> Result<Vec<Camera>> {
        let constraints = self.constraints(up);
        let mut found = framing::find(scene, &constraints).context(NOTHING)?;
        if self.full_circle {
            found.arc = None;
        }
        let focal = 0.5 * f64::from(self.size.0[0]) / constraints.tangents[0];
        Ok(found.cameras(n, "orbit", self.size.0, focal))
    }

    /// `n` cameras that show what matters in `scene` from wherever it can be seen. Says where they stand.
    pub(crate) fn covering(
        &self,
        scene: &Scene,
        n: u32,
        up: Option<[f64; 3]>,
    ) -> Result<Vec<Camera>> {
        let constraints = self.constraints(up);
        let covered = framing::cover(scene, &constraints, n, self.size.0, self.full_circle);
        let framing::Coverage { cameras, placement, empty } = covered.context(NOTHING)?;
        let place = match placement.arc {
            None => "all around what the model shows".into(),
            Some([first, last]) => format!(
                "on {:.0} degrees around what the model shows; from the other side next to nothing is seen \
                 (--full-circle goes there)",
                360.0 * (last - first)
            ),
        };
        let passed = match empty {
            0 => String::new(),
            n => format!("; {n} other places see next to nothing"),
        };
        note(format_args!("{} cameras {place}{passed}", cameras.len()));
        Ok(cameras)
    }

    fn constraints(&self, up: Option<[f64; 3]>) -> Constraints {
        Constraints {
            up: self.up.map(|u| u.0).or(up),
            radius: self.orbit_radius,
            elevation: self.elevation,
            ..Constraints::of_camera(self.size.0, self.fov)
        }
    }
}

const NOTHING: &str = "the model holds no Gaussian to look at";
