//! From a trained model to what [`crate::encode`] takes, in one call.

use crate::error::{Error, Result};
use crate::importance;
use crate::options::EncodeOptions;
use gs_model::Scene;
use voxel::{Cube, Importance, Merge, RateDistortion, Strategy, Voxelization};

/// Finest leaf depth the default strategy considers; leaves that deep are rare, and what an
/// unbounded scene needs for its nearest Gaussians.
const J_HIGH: u8 = 17;
/// Lagrangian weight at quality 50, in the units of [`RateDistortion::lambda`]. It follows the
/// square of the attribute steps, so that positions and attributes stay in balance.
const LAMBDA_AT_50: f64 = 3e-3;
/// The same for guessed importances.
const LAMBDA_AT_50_GUESSED: f64 = 4e-3;
const QUALITY_PER_OCTAVE: f64 = 15.0;
/// Exponent on importance for the choice of leaves (measured; 1 merges too eagerly where little
/// is seen, 0.5 too little).
const EXPONENT: f64 = 0.8;
/// Distortion of leaving a Gaussian out per unit of importance.
const DROP: f64 = 5.0;
/// Attribute bits per Gaussian at quality 50, and how they grow per quality point.
const BITS_AT_50: f64 = 60.0;
const BITS_PER_POINT: f64 = 1.2;

/// A voxelized scene with the importance of each leaf.
#[derive(Clone, Debug)]
pub struct Prepared {
    /// One Gaussian per leaf, at its centre.
    pub scene: Scene,
    /// The leaves and their members.
    pub voxels: Voxelization,
    /// Importance per leaf, for [`EncodeOptions::importance`].
    pub importance: Vec<f32>,
}

/// Where importances come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Seen {
    /// The rasterizer's sum of squared blending weights over cameras: it knows what is hidden,
    /// so what is never seen can be left out.
    ByCameras,
    /// [`importance::without_cameras`]: a guess, on which nothing is left out.
    Guessed,
}

/// The default voxelization strategy at a quality of 0 to 100.
///
/// `importance` has one entry per Gaussian of the scene.
///
/// # Errors
/// [`Error::Option`] if `quality` is out of range.
pub fn default_strategy(quality: f32, importance: &[f32], seen: Seen) -> Result<Strategy> {
    EncodeOptions::from_quality(quality)?;
    let (lambda, exponent, drop) = match seen {
        Seen::ByCameras => (LAMBDA_AT_50, EXPONENT, Some(DROP)),
        Seen::Guessed => (LAMBDA_AT_50_GUESSED, 1.0, None),
    };
    let above = f64::from(quality) - 50.0;
    let mut options = RateDistortion::new(lambda * libm::exp2(-2.0 * above / QUALITY_PER_OCTAVE));
    options.j_high = J_HIGH;
    options.cost.gaussian = (BITS_AT_50 + BITS_PER_POINT * above).max(10.0);
    options.drop = drop;
    let given = importance.iter().map(|&v| {
        let v = if v.is_finite() { f64::from(v).max(0.0) } else { 0.0 };
        libm::pow(v, exponent) as f32
    });
    options.importance = Importance::Given(given.collect());
    Ok(Strategy::RateDistortion(options))
}

/// Voxelizes with `strategy` and merges, weighting members by importance.
///
/// `importance` is per Gaussian of `scene`, from cameras; `None` uses
/// [`importance::without_cameras`].
///
/// # Errors
/// [`Error::Voxel`] for what voxelization refuses, [`Error::CountMismatch`] if the importances
/// are not one per Gaussian.
pub fn prepare(
    scene: &Scene,
    strategy: impl FnOnce(&[f32], Seen) -> Result<Strategy>,
    importance: Option<&[f32]>,
) -> Result<Prepared> {
    let own;
    let seen = if importance.is_some() { Seen::ByCameras } else { Seen::Guessed };
    let importance = match importance {
        Some(given) if given.len() == scene.len() => given,
        Some(given) => {
            return Err(Error::CountMismatch { scene: given.len(), leaves: scene.len() });
        }
        None => {
            own = importance::without_cameras(scene);
            &own
        }
    };
    let cube = Cube::of(&scene.means)?;
    let voxels = voxel::voxelize(scene, &cube, &strategy(importance, seen)?)?;
    let weights = Importance::Given(importance.to_vec());
    let merged = voxel::merge_weighted(scene, &voxels, Merge::Moments, &weights)?;
    let importance = (0..voxels.len())
        .map(|i| voxels.members_of(i).iter().map(|&m| importance[m as usize]).sum())
        .collect();
    Ok(Prepared { scene: merged, voxels, importance })
}
