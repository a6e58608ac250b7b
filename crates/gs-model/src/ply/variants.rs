//! Models whose columns differ from the Inria layout, and what a Gaussian's numbers are then.
//!
//! - *2D Gaussian splatting* has two scales: its Gaussians are discs. A disc becomes a Gaussian whose third
//!   axis is a thousandth of the shorter of the others.
//! - *Mip-Splatting* has the column `filter_3D`, the standard deviation of a smoothing kernel. It is added
//!   to the variances, and the opacity is lowered so that the Gaussian keeps its integral: what
//!   Mip-Splatting itself does for viewers that do not know the column.
//! - *Colours as bytes* (`red`, `green`, `blue`, `uchar`) stand for the SH coefficients of degree 0.

use std::collections::BTreeMap;

use super::header::{PlyElement, Scalar};
use crate::rows::SH;
use crate::scene::SH_C0;

/// Natural logarithm of a disc's thickness, relative to the shorter of its axes.
const LOG_THICKNESS: f32 = -6.907_755_4;
/// First log-scale, and opacity, of a row in scene order.
const LOG_SCALE: usize = 7;
const OPACITY: usize = 10;
const COLOURS: [&str; 3] = ["red", "green", "blue"];

/// In what a model differs from the Inria layout.
#[derive(Debug, Default)]
pub(super) struct Variants {
    discs: bool,
    colours: bool,
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
            colours: !has_dc && COLOURS.iter().all(|c| scalar(c) == Some(Scalar::U8)),
            filter_3d: index.get("filter_3D").copied(),
        }
    }

    /// The name of the property that is read for one that the model does not have.
    pub(super) fn stand_in<'n>(&self, name: &'n str) -> &'n str {
        match name {
            "scale_2" if self.discs => "scale_1",
            "f_dc_0" if self.colours => COLOURS[0],
            "f_dc_1" if self.colours => COLOURS[1],
            "f_dc_2" if self.colours => COLOURS[2],
            _ => name,
        }
    }

    pub(super) fn any(&self) -> bool {
        self.discs || self.colours || self.filter_3d.is_some()
    }

    /// What was done, in words.
    pub(super) fn notes(&self) -> Vec<&'static str> {
        let discs =
            "two scales (2D Gaussian splatting): each disc is a thousandth of its width thick";
        let colours = "colours as bytes: they are the SH coefficients of degree 0";
        let filter = "filter_3D (Mip-Splatting) is part of the scales and opacities now";
        let all =
            [(self.discs, discs), (self.colours, colours), (self.filter_3d.is_some(), filter)];
        all.into_iter().filter(|(is, _)| *is).map(|(_, note)| note).collect()
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
            11..14 if self.colours => (raw(c) / 255.0 - 0.5) / SH_C0,
            _ => raw(c),
        }
    }
}

const _: () = assert!(SH == 11);

/// The log-scale after a kernel of standard deviation `filter` is added.
fn smoothed(log_scale: f32, filter: f32) -> f32 {
    let variance = libm::exp(2.0 * f64::from(log_scale)) + f64::from(filter) * f64::from(filter);
    (0.5 * libm::log(variance)) as f32
}

/// The logit of an opacity that is multiplied by `exp(log_factor)`, at most 1.
fn dimmed(logit: f32, log_factor: f64) -> f32 {
    // o = f / (1 + exp(-l)), so o / (1 - o) = f / (1 - f + exp(-l)).
    let rest = -libm::expm1(log_factor.min(0.0)) + libm::exp(-f64::from(logit));
    (log_factor - libm::log(rest)) as f32
}
