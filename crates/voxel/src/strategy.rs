//! [`Strategy`]: which cells of the octree become leaves (the paper's sections 3.1 and 3.2).

use crate::check::{check, check_depths};
use crate::error::Result;
use crate::rate_distortion::RateDistortion;
use crate::released::ReleasedRule;

/// A rule for which cells become leaves. All strategies prune the same full octree.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Strategy {
    /// Every occupied cell at one depth is a leaf (the paper's section 3.1).
    Uniform {
        /// Depth of all leaves, 0 to 21.
        depth: u8,
    },
    /// The criteria of the paper's text, per voxel (section 3.2.2). A voxel at `j_low` to
    /// `j_high - 1` is divided if it holds one of the largest Gaussians, or more than `tau1`
    /// Gaussians, or one whose mean is farther than `tau2` voxel sides from the voxel's centre.
    Paper {
        /// The paper's v: the percentage of Gaussians that are "large", by volume, and go to
        /// `j_high`; 0 to 100. The authors' code uses 20.
        large_percent: f64,
        /// Lowest leaf depth.
        j_low: u8,
        /// Highest leaf depth.
        j_high: u8,
        /// Greatest number of Gaussians in a leaf above `j_high`. The authors' code uses 30
        /// (and divides at 30).
        tau1: u32,
        /// Greatest distance of a member's mean from the centre of a leaf above `j_high`, in
        /// sides of that leaf; the paper's `W / 2^(J+1)` is 0.5, the inscribed ball.
        tau2: f64,
    },
    /// The authors' released code, per Gaussian, for reproduction. It takes the cube of the scene
    /// and ignores the one given to [`voxelize`](crate::voxelize).
    Released(ReleasedRule),
    /// The pruning that minimises distortion plus lambda times bits.
    RateDistortion(RateDistortion),
}

impl Strategy {
    /// The paper's criteria with the thresholds of its authors' code.
    #[must_use]
    pub fn paper(j_low: u8, j_high: u8) -> Self {
        Self::Paper { large_percent: 20.0, j_low, j_high, tau1: 30, tau2: 0.5 }
    }

    /// Checks every parameter.
    ///
    /// # Errors
    /// [`Error`](crate::Error) names the first one out of range.
    pub(crate) fn validate(&self) -> Result<()> {
        match self {
            &Self::Uniform { depth } => check_depths(depth, depth),
            &Self::Paper { large_percent, j_low, j_high, tau1: _, tau2 } => {
                check_depths(j_low, j_high)?;
                check("large_percent", large_percent, 0.0, 100.0, "0 to 100")?;
                check("tau2", tau2, 0.0, f64::MAX, "0 upwards")
            }
            // `released` checks its options itself.
            Self::Released(_) => Ok(()),
            Self::RateDistortion(options) => options.validate(),
        }
    }
}
