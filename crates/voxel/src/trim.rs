//! [`trim`]: a cube without the floaters, if coding those exactly is cheaper.

use gpcc_lite::morton::MAX_DEPTH;

use crate::cube::Cube;
use crate::error::{Error, Result};

/// What [`trim`] weighs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Trim {
    /// Side of the finest cells wanted, world units. Positive.
    pub cell: f64,
    /// Bits of an outlier's position outside the octree; three `f32` are 96.
    pub bits_per_outlier: f64,
    /// Bits that a Gaussian alone in its cell pays per level.
    pub bits_per_level: f64,
    /// What a level that cannot be reached costs per Gaussian, in bits: cells come out twice as
    /// wide as wanted once the octree would need more than 21 levels.
    pub bits_per_missing_level: f64,
}

impl Trim {
    /// Finest cells of side `cell`, positions of outliers as `f32`, a missing level worth 3 bits.
    #[must_use]
    pub fn new(cell: f64) -> Self {
        Self { cell, bits_per_outlier: 96.0, bits_per_level: 3.0, bits_per_missing_level: 3.0 }
    }
}

/// The cheapest cube and what lies outside it.
#[derive(Clone, Debug, PartialEq)]
pub struct Trimmed {
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

/// Chooses among boxes around the per-axis median, each half as wide as the last, by cost.
///
/// An octree hardly pays for empty space: a level that all Gaussians share costs bits once,
/// not per Gaussian, so an outlier costs its own chain of single children, about 3 bits per
/// level, which is less than its three floats. Trimming therefore pays only when the whole
/// extent divided by the wanted cell exceeds 2^21; then it gives every inlier levels that a
/// Morton code could not hold. Otherwise the result is the plain cube and no outlier.
///
/// # Errors
/// [`Error::NonFiniteMean`]; [`Error::Parameter`] if `cell` is not positive and finite.
pub fn trim(means: &[[f32; 3]], options: &Trim) -> Result<Trimmed> {
    if !(options.cell > 0.0 && options.cell.is_finite()) {
        return Err(Error::Parameter {
            name: "cell",
            value: options.cell,
            range: "above 0, finite",
        });
    }
    let all = Cube::of(means)?;
    let plain = Trimmed {
        cube: all,
        j_high: levels(all.side, options.cell).min(MAX_DEPTH),
        inside: (0..means.len()).collect(),
        outliers: Vec::new(),
        saved_bits: 0.0,
    };
    if means.is_empty() {
        return Ok(plain);
    }
    let centre = median(means);
    let cost = |cube: &Cube, outliers: usize| {
        let wanted = levels(cube.side, options.cell);
        let missing = f64::from(wanted.saturating_sub(MAX_DEPTH));
        let inside = (means.len() - outliers) as f64;
        outliers as f64 * options.bits_per_outlier
            + inside * missing * options.bits_per_missing_level
    };
    // What the outliers of a candidate cost while they still are in the octree.
    let chain = f64::from(plain.j_high) * options.bits_per_level;
    let whole = cost(&all, 0);
    let mut best = plain;
    let mut radius = all.side;
    while levels(radius, options.cell) > 0 {
        radius *= 0.5;
        let inside = |p: &[f32; 3]| (0..3).all(|k| (f64::from(p[k]) - centre[k]).abs() <= radius);
        let (ins, outs): (Vec<usize>, Vec<usize>) =
            (0..means.len()).partition(|&i| inside(&means[i]));
        // More than half outside: that is the scene, not its floaters.
        if outs.len() > ins.len() {
            break;
        }
        let kept: Vec<[f32; 3]> = ins.iter().map(|&i| means[i]).collect();
        let cube = Cube::of(&kept)?;
        let saved = whole + outs.len() as f64 * chain - cost(&cube, outs.len());
        if saved > best.saved_bits {
            let j_high = levels(cube.side, options.cell).min(MAX_DEPTH);
            best = Trimmed { cube, j_high, inside: ins, outliers: outs, saved_bits: saved };
        }
    }
    Ok(best)
}

/// Halvings of `side` until it is at most `cell`; bounded by the range of the exponent.
fn levels(side: f64, cell: f64) -> u8 {
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
