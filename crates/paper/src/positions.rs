//! Section 2.3, positions: "losslessly compressed [...] octree coding followed by an octree-designed
//! entropy coder". The octree ends at the leaves, whose depths differ after adaptive voxelization.

use gpcc_lite::{Cube, Limits, Octree, geometry};

use crate::container::{ContainerReader, ContainerWriter};
use crate::error::{Error, Result, coding};

const NAME: &str = "geometry";

/// Writes the cube and the leaves.
pub(crate) fn encode(octree: &Octree, out: &mut ContainerWriter) -> Result<()> {
    let Cube { origin, side } = octree.cube();
    for number in origin.into_iter().chain([side]) {
        out.raw("head", &number.to_le_bytes());
    }
    let coded = geometry::encode(octree).map_err(coding(NAME))?;
    out.block(NAME, &coded);
    Ok(())
}

/// Reads what [`encode`] wrote.
pub(crate) fn decode(input: &mut ContainerReader<'_>, limits: &Limits) -> Result<Octree> {
    let mut number = || Ok::<_, Error>(f64::from_le_bytes(input.array("cube")?));
    let cube = Cube { origin: [number()?, number()?, number()?], side: number()? };
    let octree = geometry::decode(input.block(NAME)?, limits).map_err(coding(NAME))?;
    let octree = octree.in_cube(cube);
    let is_finite = |i| octree.centre(i).iter().all(|x| x.is_finite());
    if cube.side > 0.0 && (0..octree.len()).all(is_finite) {
        Ok(octree)
    } else {
        Err(Error::Corrupt { what: "the cube is not finite" })
    }
}
