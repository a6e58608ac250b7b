//! Checks of parameters, shared by the strategies.

use gpcc_lite::Cube;
use gpcc_lite::morton::MAX_DEPTH;

use crate::error::{Error, Result};

/// Refuses a cube that cannot be divided.
pub(crate) fn check_cube(cube: &Cube) -> Result<()> {
    let &Cube { origin, side } = cube;
    if cube.is_valid() { Ok(()) } else { Err(Error::InvalidCube { origin, side }) }
}

/// Checks the range of leaf depths.
pub(crate) fn check_depths(j_low: u8, j_high: u8) -> Result<()> {
    if j_high > MAX_DEPTH {
        return Err(Error::DepthTooGreat { depth: j_high, max: MAX_DEPTH });
    }
    if j_low > j_high {
        return Err(Error::DepthRange { j_low, j_high });
    }
    Ok(())
}

/// Checks that a parameter is within `low` to `high`, which also excludes NaN.
pub(crate) fn check(
    name: &'static str,
    value: f64,
    low: f64,
    high: f64,
    range: &'static str,
) -> Result<()> {
    if value >= low && value <= high {
        Ok(())
    } else {
        Err(Error::Parameter { name, value, range })
    }
}
