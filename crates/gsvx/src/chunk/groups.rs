//! The table of what a chunk of leaves holds: the groups of channels, in the order of the stream.
//!
//! Encoder, decoder, prices and latents walk this table. A new attribute is an entry of [`GROUPS`] with
//! what [`Group`] says of it, a step in [`Steps`], and a paragraph of `docs/format.md`.

use super::Skeleton;
use crate::attributes::prediction::Predictor;
use crate::attributes::side::Factors;
use crate::attributes::{colour, opacity};
use crate::bytes::SliceReader;
use crate::covariance;
use crate::error::Result;
use crate::head::Steps;
use gpcc_lite::raht::Rows;
use gs_model::SceneMut;
use std::ops::Range;

/// What the channels of a group are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Attribute {
    /// ln(alpha).
    Opacity,
    /// Y, Co, Cg of each SH coefficient of a degree.
    Colour {
        /// The SH degree.
        degree: u8,
    },
    /// Six log-Euclidean coordinates.
    Covariance,
    /// The mean; it is coded where it moves only.
    Position,
}

/// What a group is predicted from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PredictFrom {
    /// Nothing.
    Not,
    /// Its first channel from the depth and class of each leaf.
    FromLeaf,
    /// All channels from the SH degree below.
    FromBelow,
}

/// Channels that are transformed and coded together, with one step.
#[derive(Clone, Copy, Debug)]
pub struct Group {
    /// What the channels are.
    pub attribute: Attribute,
    /// Number of channels.
    pub channels: usize,
    /// What they are predicted from.
    pub predicted: PredictFrom,
}

/// All groups: those of the base layer, then those of one SH degree and layer each.
pub const GROUPS: [Group; 6] = [
    Group { attribute: Attribute::Opacity, channels: 1, predicted: PredictFrom::FromLeaf },
    Group::of_degree(0, PredictFrom::Not),
    Group { attribute: Attribute::Covariance, channels: 6, predicted: PredictFrom::FromLeaf },
    Group::of_degree(1, PredictFrom::Not),
    Group::of_degree(2, PredictFrom::FromBelow),
    Group::of_degree(3, PredictFrom::FromBelow),
];
/// Positions, which leave the centres of their leaves in sequences.
const POSITION: Group =
    Group { attribute: Attribute::Position, channels: 3, predicted: PredictFrom::Not };
/// All groups that can move.
pub(crate) const MOVING: [Group; 7] =
    [POSITION, GROUPS[0], GROUPS[1], GROUPS[2], GROUPS[3], GROUPS[4], GROUPS[5]];
/// Groups of the base layer.
pub(crate) const BASE: usize = 3;

/// The groups of a chunk of this SH degree.
pub(crate) fn coded(sh_degree: u8) -> &'static [Group] {
    &GROUPS[..BASE + usize::from(sh_degree)]
}

/// Gaussians taken apart at a time.
const RUN: usize = 64;

impl Group {
    const fn of_degree(degree: u8, predicted: PredictFrom) -> Self {
        let channels = 3 * (2 * degree as usize + 1);
        Self { attribute: Attribute::Colour { degree }, channels, predicted }
    }

    /// The step for a leaf of the mean class.
    pub(crate) fn step(&self, steps: &Steps) -> f32 {
        match self.attribute {
            Attribute::Opacity => steps.opacity,
            Attribute::Colour { degree: 0 } => steps.dc,
            Attribute::Colour { degree } => steps.sh[usize::from(degree) - 1],
            Attribute::Covariance => steps.covariance,
            // In sizes of a typical Gaussian: a shift by its size counts as much as twice its size.
            Attribute::Position => steps.covariance,
        }
    }

    /// Puts the decoded values of the leaves from `first` on into Gaussians.
    pub(crate) fn restore(&self, rows: &Rows, first: usize, out: &mut SceneMut<'_>) {
        match self.attribute {
            Attribute::Position => {
                for (i, mean) in (first..).zip(&mut *out.means) {
                    mean.copy_from_slice(rows.row(i));
                }
            }
            Attribute::Opacity => {
                for (i, logit) in (first..).zip(&mut *out.opacity_logits) {
                    *logit = opacity::logit_of_log_alpha(rows.row(i)[0]);
                }
            }
            Attribute::Colour { degree } => {
                let sh_len = out.sh.len() / out.len().max(1);
                let own = coefficients(degree);
                if own.end > sh_len {
                    return;
                }
                for (i, sh) in (first..).zip(out.sh.chunks_exact_mut(sh_len)) {
                    let (ycc, _) = rows.row(i).as_chunks::<3>();
                    for (rgb, ycc) in sh[own.clone()].iter_mut().zip(ycc) {
                        *rgb = colour::inverse(*ycc);
                    }
                }
            }
            Attribute::Covariance => {
                let mut coordinates = [[0.0; 6]; RUN];
                let runs = out.rotations.chunks_mut(RUN).zip(out.log_scales.chunks_mut(RUN));
                for (run, (rotations, log_scales)) in runs.enumerate() {
                    let coordinates = &mut coordinates[..rotations.len()];
                    for (i, c) in (first + run * RUN..).zip(&mut *coordinates) {
                        c.copy_from_slice(rows.row(i));
                    }
                    covariance::decompose_into(coordinates, rotations, log_scales);
                }
            }
        }
    }

    /// Takes the prediction of the values of so many leaves off the front of a layer.
    ///
    /// # Errors
    /// [`crate::Error::Truncated`] and [`crate::Error::Corrupt`].
    pub(crate) fn read_prediction(
        &self,
        leaves: usize,
        r: &mut SliceReader<'_>,
    ) -> Result<Prediction> {
        Ok(match (self.predicted, self.attribute) {
            (PredictFrom::FromLeaf, _) => {
                Prediction::Leaf(Factors { depth: r.u8()? as i8, class: r.u8()? as i8 })
            }
            (PredictFrom::FromBelow, Attribute::Colour { degree }) => {
                Predictor::read(degree, leaves, r)?.map_or(Prediction::None, Prediction::Below)
            }
            _ => Prediction::None,
        })
    }
}

/// Where a Gaussian's SH coefficients of a degree are among all of its coefficients.
pub(crate) fn coefficients(degree: u8) -> Range<usize> {
    let d = usize::from(degree);
    d * d..(d + 1) * (d + 1)
}

/// A prediction of a group.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) enum Prediction {
    /// Zero.
    #[default]
    None,
    /// Of the first channel, from depth and class.
    Leaf(Factors),
    /// Of all channels, from those of the SH degree below.
    Below(Predictor),
}

impl Prediction {
    /// Adds the prediction to what was decoded; `below` are the decoded values of the group before.
    pub(crate) fn add(&self, skeleton: &Skeleton, below: Option<&Rows>, rows: &mut Rows) {
        match (self, below) {
            (Self::Leaf(factors), _) => skeleton.each(*factors, rows, |v, p| v + p),
            (Self::Below(predictor), Some(below)) => {
                (0..rows.leaves()).for_each(|i| predictor.add(i, below.row(i), rows.row_mut(i)));
            }
            _ => {}
        }
    }
}

#[cfg(feature = "encode")]
mod encode {
    use super::{Attribute, Group, PredictFrom, Prediction, coefficients};
    use crate::attributes::prediction::Predictor;
    use crate::attributes::side::Factors;
    use crate::attributes::{colour, opacity};
    use crate::chunk::GaussianGradient;
    use crate::chunk::Skeleton;
    use crate::covariance;
    use gpcc_lite::raht::Rows;
    use gs_model::Scene;
    use std::ops::Range;

    impl Group {
        /// Lagrangian multiplier of the quantiser, in `step^2` per bit. What rate-distortion optimisation
        /// sets to zero is missing from every pixel that the Gaussian is in, so it is below that of least
        /// squared error; a higher one for SH coefficients saves fewer bytes than it costs at equal
        /// rendered error.
        pub(crate) fn lambda(&self) -> f32 {
            match self.attribute {
                Attribute::Opacity | Attribute::Colour { degree: 0 } | Attribute::Position => {
                    18.0 / 256.0
                }
                Attribute::Colour { .. } => 8.0 / 256.0,
                Attribute::Covariance => 24.0 / 256.0,
            }
        }

        /// Where the values of the group are among all values of a leaf of [`crate::latents::Latents`].
        #[must_use]
        pub fn among(&self, values: usize) -> Range<usize> {
            match self.attribute {
                Attribute::Opacity => 0..1,
                Attribute::Colour { degree } => {
                    let own = coefficients(degree);
                    1 + 3 * own.start..1 + 3 * own.end
                }
                Attribute::Covariance => values - self.channels..values,
                Attribute::Position => 0..0,
            }
        }

        /// The values of Gaussian `i`.
        pub(crate) fn values(&self, scene: &Scene, i: usize, out: &mut [f32]) {
            match self.attribute {
                Attribute::Opacity => {
                    out[0] = opacity::log_alpha_of_logit(scene.opacity_logits[i]) as f32;
                }
                Attribute::Colour { degree } => {
                    colours(&scene.sh_of(i)[coefficients(degree)], out);
                }
                Attribute::Covariance => {
                    let c = covariance::coordinates(scene.rotations[i], scene.log_scales[i]);
                    out.copy_from_slice(&c);
                }
                Attribute::Position => out.copy_from_slice(&scene.means[i]),
            }
        }

        /// The derivatives of a loss by the values of Gaussian `i`, from those by its arrays.
        pub(crate) fn gradient(
            &self,
            scene: &Scene,
            i: usize,
            by: &GaussianGradient<'_>,
            out: &mut [f32],
        ) {
            match self.attribute {
                Attribute::Opacity => {
                    out[0] = opacity::gradient(scene.opacity_logits[i], by.opacity_logit);
                }
                // The transform of colours is orthonormal.
                Attribute::Colour { degree } => colours(&by.sh[coefficients(degree)], out),
                Attribute::Covariance => {
                    let (rotation, log_scales) = (scene.rotations[i], scene.log_scales[i]);
                    let d = covariance::gradient(rotation, log_scales, by.rotation, by.log_scale);
                    out.copy_from_slice(&d);
                }
                Attribute::Position => out.fill(0.0),
            }
        }

        /// The prediction of exact values, where it pays. `below` are the decoded values of the group before.
        pub(crate) fn fit(
            &self,
            skeleton: &Skeleton,
            step: f32,
            below: Option<&Rows>,
            rows: &Rows,
        ) -> Prediction {
            let classes = &skeleton.classes;
            match (self.predicted, self.attribute, below) {
                (PredictFrom::FromLeaf, ..) => {
                    let first = |i: usize| rows.row(i)[0];
                    Prediction::Leaf(Factors::fit(skeleton.plan.leaves(), classes, first))
                }
                (PredictFrom::FromBelow, Attribute::Colour { degree }, Some(below)) => {
                    let exact = |i: usize, row: &mut [f32]| row.copy_from_slice(rows.row(i));
                    let fitted = Predictor::fit(degree, below, classes, [step; 2], exact);
                    fitted.map_or(Prediction::None, Prediction::Below)
                }
                _ => Prediction::None,
            }
        }

        /// Undoes [`Group::read_prediction`].
        pub(crate) fn write_prediction(&self, prediction: &Prediction, out: &mut Vec<u8>) {
            match (self.predicted, prediction) {
                (_, Prediction::Leaf(factors)) => {
                    out.extend([factors.depth as u8, factors.class as u8]);
                }
                (_, Prediction::Below(predictor)) => predictor.write(out),
                (PredictFrom::FromBelow, Prediction::None) => out.push(0),
                (_, Prediction::None) => {}
            }
        }
    }

    impl Prediction {
        /// Undoes [`Prediction::add`] up to rounding.
        pub(crate) fn subtract(&self, skeleton: &Skeleton, below: Option<&Rows>, rows: &mut Rows) {
            match (self, below) {
                (Self::Leaf(factors), _) => skeleton.each(*factors, rows, |v, p| v - p),
                (Self::Below(predictor), Some(below)) => (0..rows.leaves())
                    .for_each(|i| predictor.subtract(i, below.row(i), rows.row_mut(i))),
                _ => {}
            }
        }
    }

    /// Y, Co, Cg of some coefficients.
    pub(crate) fn colours(sh: &[[f32; 3]], out: &mut [f32]) {
        for (out, &rgb) in out.as_chunks_mut::<3>().0.iter_mut().zip(sh) {
            *out = colour::forward(rgb);
        }
    }
}
#[cfg(feature = "encode")]
pub(crate) use encode::colours;
