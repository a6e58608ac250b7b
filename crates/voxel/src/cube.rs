//! [`cube_of`]: the cube that the octree of a scene divides (the paper's section 3.1).

use gpcc_lite::Cube;

use crate::error::{Error, Result};

/// The smallest cube of the form of [`Cube::spanning`] that holds all means. Without any, it is that of one mean at
/// the origin.
///
/// # Errors
/// [`Error::NonFiniteMean`].
pub fn cube_of(means: &[[f32; 3]]) -> Result<Cube> {
    let first = means.first().copied().unwrap_or_default();
    let (mut low, mut high) = (first, first);
    for (index, mean) in means.iter().enumerate() {
        if !mean.iter().all(|x| x.is_finite()) {
            return Err(Error::NonFiniteMean { index });
        }
        for k in 0..3 {
            low[k] = low[k].min(mean[k]);
            high[k] = high[k].max(mean[k]);
        }
    }
    Ok(Cube::spanning(low, high))
}
