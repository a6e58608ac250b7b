//! Models whose columns differ from the Inria layout, and what a Gaussian's numbers are then.
//!
//! - *2D Gaussian splatting* has two scales: its Gaussians are discs. A disc becomes a Gaussian whose third
//!   axis is a thousandth of the shorter of the others.
//! - *Mip-Splatting* has the column `filter_3D`, the standard deviation of a smoothing kernel. It is added
//!   to the variances, and the opacity is lowered so that the Gaussian keeps its integral: what
//!   Mip-Splatting itself does for viewers that do not know the column.
//! - *Colours* (`red`, `green`, `blue`) stand for the SH coefficients of degree 0: 0 to 65535 as `ushort`, 0 to 1
//!   as `float` or `double`, 0 to 255 as other integers.

use std::collections::BTreeMap;

use super::header::{PlyElement, Scalar};
use crate::limits::LOG_THICKNESS;
use crate::rows::SH;
use crate::scene::SH_C0;

/// First log-scale, and opacity, of a row in scene order.
const LOG_SCALE: usize = 7;
const OPACITY: usize = 10;
const COLOURS: [&str; 3] = ["red", "green", "blue"];

/// How a model differs from the Inria layout.
#[derive(Debug, Default)]
pub(super) struct Variants {
    discs: bool,
    /// What stands for full colour, where the model has `red`, `green` and `blue`.
    colours: Option<f32>,
    /// The property `filter_3D`.
    pub(super) filter_3d: Option<usize>,
}

impl Variants {
    pub(super) fn of(vertex: &PlyElement, index: &BTreeMap<&str, usize>) -> Self {
        let has = |name: &str| index.contains_key(name);
        let scalar = |name: &str| index.get(name).map(|&at| vertex.properties[at].scalar);
        let has_dc = ["f_dc_0", "f_dc_1", "f_dc_2"].into_iter().any(has);
        Self {
            discs: has("scale_0") && has("scale_1") && !has("scale_2"),
            colours: full_colour(COLOURS.map(scalar)).filter(|_| !has_dc),
            filter_3d: index.get("filter_3D").copied(),
        }
    }

    /// The name of the property that is read for one that the model does not have.
    pub(super) fn stand_in<'n>(&self, name: &'n str) -> &'n str {
        match name {
            "scale_2" if self.discs => "scale_1",
            "f_dc_0" if self.colours.is_some() => COLOURS[0],
            "f_dc_1" if self.colours.is_some() => COLOURS[1],
            "f_dc_2" if self.colours.is_some() => COLOURS[2],
            _ => name,
        }
    }

    pub(super) fn any(&self) -> bool {
        self.discs || self.colours.is_some() || self.filter_3d.is_some()
    }

    /// What was done, in words.
    pub(super) fn notes(&self) -> Vec<String> {
        let discs =
            "two scales (2D Gaussian splatting): each disc is a thousandth of its width thick";
        let filter = "filter_3D (Mip-Splatting) is part of the scales and opacities now, and the model is antialiased";
        let colours = self.colours.map(|full| {
            format!("red, green and blue, 0 to {full}, are the SH coefficients of degree 0")
        });
        let all = [
            self.discs.then(|| discs.into()),
            colours,
            self.filter_3d.is_some().then(|| filter.into()),
        ];
        all.into_iter().flatten().collect()
    }

    /// Number `c` in scene order. `raw` gives the numbers of the properties in scene order, stand-ins
    /// included; `property` those of any property.
    pub(super) fn number(
        &self,
        c: usize,
        raw: impl Fn(usize) -> f32,
        property: impl Fn(usize) -> f32,
    ) -> f32 {
        let log_scale = |k: usize| match k {
            2 if self.discs => raw(LOG_SCALE).min(raw(LOG_SCALE + 1)) + LOG_THICKNESS,
            _ => raw(LOG_SCALE + k),
        };
        let filter = self.filter_3d.map_or(0.0, property);
        match c {
            LOG_SCALE..OPACITY if filter != 0.0 => smoothed(log_scale(c - LOG_SCALE), filter),
            LOG_SCALE..OPACITY => log_scale(c - LOG_SCALE),
            OPACITY if filter != 0.0 => {
                let log_scales = [0, 1, 2].map(log_scale);
                let lost: f64 =
                    log_scales.iter().map(|&s| f64::from(s) - f64::from(smoothed(s, filter))).sum();
                dimmed(raw(OPACITY), lost)
            }
            11..14 => self.colours.map_or(raw(c), |full| (raw(c) / full - 0.5) / SH_C0),
            _ => raw(c),
        }
    }
}

const _: () = assert!(SH == 11);

/// What stands for full colour in three properties of these types; `None` unless all are there and alike.
fn full_colour(scalars: [Option<Scalar>; 3]) -> Option<f32> {
    let first = scalars[0].filter(|_| scalars.iter().all(|s| *s == scalars[0]))?;
    Some(match first {
        Scalar::U16 => 65535.0,
        Scalar::F32 | Scalar::F64 => 1.0,
        _ => 255.0,
    })
}

/// The log-scale after a kernel of standard deviation `filter` is added.
fn smoothed(log_scale: f32, filter: f32) -> f32 {
    let variance = libm::exp(2.0 * f64::from(log_scale)) + f64::from(filter) * f64::from(filter);
    (0.5 * libm::log(variance)) as f32
}

/// The logit of an opacity that is multiplied by `exp(log_factor)`, at most 1.
pub(super) fn dimmed(logit: f32, log_factor: f64) -> f32 {
    // o = f / (1 + exp(-l)), so o / (1 - o) = f / (1 - f + exp(-l)).
    let rest = -libm::expm1(log_factor.min(0.0)) + libm::exp(-f64::from(logit));
    (log_factor - libm::log(rest)) as f32
}
