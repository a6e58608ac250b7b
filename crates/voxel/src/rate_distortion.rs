//! [`RateDistortion`]: parameters of the strategy that minimises distortion plus lambda times bits.
//!
//! It goes beyond the paper, whose criteria (section 3.2.2) are thresholds per voxel. The
//! distortion is an upper bound of the paper's eq. 4 with importances as weights.

use crate::check::{check, check_depths};
use crate::cost::CostModel;
use crate::error::Result;
use crate::importance::Importance;
use crate::merge::Place;

/// Parameters of the rate-distortion strategy.
#[derive(Clone, Debug, PartialEq)]
pub struct RateDistortion {
    /// Distortion that one bit must save. Distortion is in units of the mean importance of a
    /// Gaussian, so a `lambda` has a similar effect in every scene. Useful are 1e-4 (fine) to 1e-1
    /// (coarse).
    pub lambda: f64,
    /// Lowest leaf depth.
    pub j_low: u8,
    /// Highest leaf depth.
    pub j_high: u8,
    /// What leaves and divisions cost.
    pub cost: CostModel,
    /// How much each Gaussian counts.
    pub importance: Importance,
    /// A squared displacement counts `importance / area^size_exponent`.
    pub size_exponent: f64,
    /// Weight of the change of covariance relative to displacement; 1 is the W2 distance.
    pub shape: f64,
    /// Weight of the squared difference of DC colours inside a leaf.
    pub colour: f64,
    /// Distortion of leaving a Gaussian out, per unit of its importance; `None` keeps all. A
    /// Gaussian gets no leaf where that costs less, see [`Voxelization::dropped`](crate::Voxelization::dropped).
    pub drop: Option<f64>,
    /// Where the merged Gaussian of a leaf will be.
    pub place: Place,
}

impl RateDistortion {
    /// Plain settings for depths 0 to 16: importance is opacity times area, and nothing is dropped.
    ///
    /// [`RateDistortion::seen`] and [`RateDistortion::unseen`] give better rates.
    #[must_use]
    pub fn new(lambda: f64) -> Self {
        Self {
            lambda,
            j_low: 0,
            j_high: 16,
            cost: CostModel::default(),
            importance: Importance::OpacityArea,
            size_exponent: 1.0,
            shape: 1.0,
            colour: 1.0,
            drop: None,
            place: Place::LeafCentre,
        }
    }

    /// The best known settings for an encoder that has the training cameras, for depths 0 to 18.
    ///
    /// `importance` has one entry per Gaussian: the rasterizer's sum of squared blending weights
    /// (alpha T) over pixels and training views. Gaussians are dropped where that costs less than
    /// their bits.
    #[must_use]
    pub fn seen(lambda: f64, importance: Vec<f32>) -> Self {
        Self {
            j_high: 18,
            importance: Importance::Given(importance),
            size_exponent: 0.75,
            drop: Some(10.0),
            ..Self::new(lambda)
        }
    }

    /// The best known settings for an encoder that has no cameras, for depths 0 to 18.
    ///
    /// Trained Gaussians are larger the farther they are from the cameras, so a size exponent
    /// above 1 replaces the unknown distance.
    #[must_use]
    pub fn unseen(lambda: f64) -> Self {
        Self { j_high: 18, size_exponent: 1.5, shape: 0.3, ..Self::new(lambda) }
    }

    /// Checks every parameter.
    ///
    /// # Errors
    /// [`Error`](crate::Error) names the first one out of range.
    pub(crate) fn validate(&self) -> Result<()> {
        check_depths(self.j_low, self.j_high)?;
        check("lambda", self.lambda, 0.0, f64::MAX, "0 upwards")?;
        check("size_exponent", self.size_exponent, -2.0, 2.0, "-2 to 2")?;
        check("shape", self.shape, 0.0, f64::MAX, "0 upwards")?;
        check("drop", self.drop.unwrap_or(0.0), 0.0, f64::MAX, "0 upwards")?;
        check("colour", self.colour, 0.0, f64::MAX, "0 upwards")?;
        check("cost.gaussian", self.cost.gaussian, 0.0, f64::MAX, "0 upwards")?;
        check("cost.stop", self.cost.stop, 0.0, f64::MAX, "0 upwards")?;
        check("cost.go_on", self.cost.go_on, 0.0, f64::MAX, "0 upwards")?;
        for bits in self.cost.occupancy {
            check("cost.occupancy", bits, 0.0, f64::MAX, "0 upwards")?;
        }
        Ok(())
    }
}
