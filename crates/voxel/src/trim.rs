//! [`trim`]: a cube without the floaters, if it is cheaper to code their positions exactly.
//!
//! A floater is a Gaussian far away from the others. This comes before the voxelization; the
//! paper has no such step.

use gpcc_lite::morton::MAX_DEPTH;

use crate::cube::cube_of;
use crate::error::{Error, Result};
use gpcc_lite::Cube;

/// Bits per octree level of a Gaussian that is alone in its cell.
const BITS_PER_LEVEL: f64 = 3.0;
/// Bits that a small part of a missing octree level is worth, per Gaussian. An octree has at most
/// 21 levels; every further one that the wanted cell needs is missing, and doubles the cells.
/// Squared errors of the positions are then four times as large, so `m` missing levels are worth
/// `(4^m - 1) / ln 4` times as much.
const BITS_PER_MISSING_LEVEL: f64 = 3.0;

/// What [`trim`] is to reach, and what an outlier costs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Trim {
    /// Side of the finest cells wanted, in world units. Positive.
    pub cell: f64,
    /// Bits of the position of a Gaussian that is not in the octree; three `f32` are 96.
    pub bits_per_outlier: f64,
}

impl Trim {
    /// Finest cells of side `cell`, 96 bits per outlier.
    #[must_use]
    pub fn new(cell: f64) -> Self {
        Self { cell, bits_per_outlier: 96.0 }
    }
}

/// The cheapest cube, and the Gaussians outside it.
#[derive(Clone, Debug, PartialEq)]
pub struct TrimOutcome {
    /// Cube of the inliers.
    pub cube: Cube,
    /// Octree depth at which cells are at most as wide as wanted, at most 21.
    pub j_high: u8,
    /// Ascending indices of the Gaussians inside.
    pub inside: Vec<usize>,
    /// Ascending indices of the Gaussians outside, to be coded exactly.
    pub outliers: Vec<usize>,
    /// Estimated bits that the outliers save against the cube of all means.
    pub saved_bits: f64,
}

impl TrimOutcome {
    /// The row of every Gaussian of the scene in an output of which `inside` are the rows of those inside,
    /// and in which the outliers follow from row `first_outlier` on.
    #[must_use]
    pub fn rows(&self, inside: &[u32], first_outlier: u32) -> Vec<u32> {
        let mut rows = vec![0; self.inside.len() + self.outliers.len()];
        self.inside.iter().zip(inside).for_each(|(&i, &row)| rows[i] = row);
        self.outliers.iter().zip(first_outlier..).for_each(|(&i, row)| rows[i] = row);
        rows
    }
}

/// Chooses among boxes around the per-axis median, each half as wide as the last, by cost.
///
/// Empty space costs an octree little: a level that all Gaussians share costs bits once, and an
/// outlier costs a chain of only children, about 3 bits per level. That is less than three floats.
/// So trimming pays only if the whole extent divided by the wanted cell exceeds 2^21; then the
/// smaller cube gives the inliers the missing levels. Otherwise the result is the cube of all
/// means and no outlier.
///
/// # Errors
/// [`Error::NonFiniteMean`]; [`Error::Parameter`] if `cell` is not positive and finite.
pub fn trim(means: &[[f32; 3]], options: &Trim) -> Result<TrimOutcome> {
    if !(options.cell > 0.0 && options.cell.is_finite()) {
        let (name, value, range) = ("cell", options.cell, "above 0, finite");
        return Err(Error::Parameter { name, value, range });
    }
    let all = cube_of(means)?;
    let plain = TrimOutcome {
        cube: all,
        j_high: depth_for(all.side, options.cell).min(MAX_DEPTH),
        inside: (0..means.len()).collect(),
        outliers: Vec::new(),
        saved_bits: 0.0,
    };
    if means.is_empty() {
        return Ok(plain);
    }
    let centre = median(means);
    let cost = |cube: &Cube, outliers: usize| {
        let wanted = depth_for(cube.side, options.cell);
        let missing = f64::from(wanted.saturating_sub(MAX_DEPTH));
        let inside = (means.len() - outliers) as f64;
        let worth = (libm::exp2(2.0 * missing) - 1.0) / (2.0 * std::f64::consts::LN_2);
        outliers as f64 * options.bits_per_outlier + inside * worth * BITS_PER_MISSING_LEVEL
    };
    // The bits of an outlier that is kept in the octree of all means.
    let chain = f64::from(plain.j_high) * BITS_PER_LEVEL;
    let whole = cost(&all, 0);
    let mut best = plain;
    let mut radius = all.side;
    while depth_for(radius, options.cell) > 0 {
        radius *= 0.5;
        let inside = |p: &[f32; 3]| (0..3).all(|k| (f64::from(p[k]) - centre[k]).abs() <= radius);
        let (ins, outs): (Vec<usize>, Vec<usize>) =
            (0..means.len()).partition(|&i| inside(&means[i]));
        // Floaters are few. If more than half is outside, the box has reached the scene.
        if outs.len() > ins.len() {
            break;
        }
        let kept: Vec<[f32; 3]> = ins.iter().map(|&i| means[i]).collect();
        let cube = cube_of(&kept)?;
        let saved = whole + outs.len() as f64 * chain - cost(&cube, outs.len());
        if saved > best.saved_bits {
            let j_high = depth_for(cube.side, options.cell).min(MAX_DEPTH);
            best = TrimOutcome { cube, j_high, inside: ins, outliers: outs, saved_bits: saved };
        }
    }
    Ok(best)
}

/// Depth at which cells of a cube are at most as wide as `cell`; at most 255.
fn depth_for(side: f64, cell: f64) -> u8 {
    let mut n = 0;
    let mut s = side;
    while s > cell && n < u8::MAX {
        s *= 0.5;
        n += 1;
    }
    n
}

fn median(means: &[[f32; 3]]) -> [f64; 3] {
    std::array::from_fn(|k| {
        let mut axis: Vec<f32> = means.iter().map(|p| p[k]).collect();
        let middle = axis.len() / 2;
        f64::from(*axis.select_nth_unstable_by(middle, f32::total_cmp).1)
    })
}
