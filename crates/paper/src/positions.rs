//! Section 2.3, positions: "losslessly compressed [...] octree coding followed by an octree-designed
//! entropy coder". The octree ends at the leaves, whose depths differ after adaptive voxelization.

use gpcc_lite::{Limits, geometry};
use voxel::{Cube, Voxelization};

use crate::container::{Reader, Writer};
use crate::error::{Error, Result, coding};

const NAME: &str = "geometry";

/// Writes the cube and the leaves.
pub(crate) fn encode(voxels: &Voxelization, out: &mut Writer) -> Result<()> {
    for number in voxels.cube.origin.into_iter().chain([voxels.cube.side]) {
        out.raw("head", &number.to_le_bytes());
    }
    let coded = geometry::encode(&voxels.leaves, voxels.j_high).map_err(coding(NAME))?;
    out.block(NAME, &coded);
    Ok(())
}

/// Decoded positions.
pub(crate) struct Positions {
    /// The leaves and the depth of their Morton codes.
    pub(crate) octree: geometry::Geometry,
    /// The centres of the leaves.
    pub(crate) means: Vec<[f32; 3]>,
}

/// Reads what [`encode`] wrote.
pub(crate) fn decode(input: &mut Reader<'_>, limits: &Limits) -> Result<Positions> {
    let mut number = || Ok::<_, Error>(f64::from_le_bytes(input.array("cube")?));
    let cube = Cube { origin: [number()?, number()?, number()?], side: number()? };
    let octree = geometry::decode(input.block(NAME)?, limits).map_err(coding(NAME))?;
    let centres = octree.leaves.iter().map(|&leaf| cube.leaf_centre(leaf, octree.j_high));
    let means: Vec<[f32; 3]> = centres.collect();
    let finite = |mean: &[f32; 3]| mean.iter().all(|x| x.is_finite());
    if cube.side > 0.0 && means.iter().all(finite) {
        Ok(Positions { octree, means })
    } else {
        Err(Error::Corrupt { what: "the cube is not finite" })
    }
}
