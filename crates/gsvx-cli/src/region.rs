//! `gsvx decode --box`: the Gaussians of a part of the scene. Only the chunks that reach into it are read.

use crate::input::Limit;
use crate::size;
use crate::stream_file::StreamFile;
use anyhow::Result;
use gs_model::Scene;
use std::path::Path;

/// A box in world units, with its border.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Region {
    low: [f32; 3],
    high: [f32; 3],
}

/// Reads `X0,Y0,Z0,X1,Y1,Z1`.
pub(crate) fn parse(text: &str) -> Result<Region, String> {
    let corners = size::list(text, ',').filter(|c: &[f32; 6]| c.iter().all(|v| v.is_finite()));
    let [a, b, c, x, y, z] = corners.ok_or("use two corners, six numbers: X0,Y0,Z0,X1,Y1,Z1")?;
    Ok(Region { low: [a.min(x), b.min(y), c.min(z)], high: [a.max(x), b.max(y), c.max(z)] })
}

impl Region {
    fn contains(&self, mean: [f32; 3]) -> bool {
        (0..3).all(|k| (self.low[k]..=self.high[k]).contains(&mean[k]))
    }

    /// Whether a box, given by its corners, has a point in common with this one.
    fn meets(&self, [low, high]: [[f32; 3]; 2]) -> bool {
        (0..3).all(|k| low[k] <= self.high[k] && self.low[k] <= high[k])
    }
}

/// What lies in a region.
pub(crate) struct Inside {
    pub(crate) scene: Scene,
    /// Chunks that were decoded, and that the level of detail has.
    pub(crate) chunks: [usize; 2],
    /// Bytes of the stream that were read.
    pub(crate) bytes_read: u64,
}

/// Reads the Gaussians whose means lie in `region`, at a level of detail and up to an SH degree.
pub(crate) fn read(
    path: &Path,
    region: Region,
    lod: u8,
    max_sh_degree: u8,
    limit: Limit,
) -> Result<Inside> {
    let mut file = StreamFile::open_limited(path, limit)?;
    let index = &file.index;
    let sh_degree = index.header.sh_degree.min(max_sh_degree);
    let of_level: Vec<usize> = index.chunks_of_lod(lod.min(index.coarsest_lod())).collect();
    let meets = |&i: &usize| region.meets(index.chunks[i].bounds);
    let wanted: Vec<usize> = of_level.iter().copied().filter(meets).collect();
    limit.check(path, wanted.iter().map(|&i| index.chunks[i].count).sum())?;
    let mut scene = index.header.empty_scene(max_sh_degree);
    for &chunk in &wanted {
        let layers = file.index.chunks[chunk].layers.len().min(1 + usize::from(sh_degree));
        let decoded = file.decode(chunk, layers)?;
        let inside = (0..decoded.len()).filter(|&i| region.contains(decoded.means[i]));
        scene.append(&decoded.select(&inside.collect::<Vec<_>>()));
    }
    Ok(Inside { scene, chunks: [wanted.len(), of_level.len()], bytes_read: file.bytes_read })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn corners_in_any_order_make_a_box() {
        let region = parse("1, 5,-2,0,4,3").unwrap();
        assert_eq!((region.low, region.high), ([0.0, 4.0, -2.0], [1.0, 5.0, 3.0]));
        assert!(region.contains([1.0, 4.5, 0.0]) && !region.contains([1.1, 4.5, 0.0]));
        assert!(region.meets([[1.0; 3], [4.0; 3]]) && !region.meets([[1.1; 3], [4.0; 3]]));
        for wrong in ["", "1,2,3", "1,2,3,4,5,6,7", "1,2,3,4,5,x", "1,2,3,4,5,nan", "inf,0,0,1,1,1"]
        {
            assert!(parse(wrong).is_err(), "{wrong}");
        }
    }
}
