//! One decoded chunk of either kind, layer after layer.

use crate::chunk::{ChunkValues, resize};
use crate::error::{Error, Result};
use crate::head::{Index, Kind, Layer};
use crate::lossless;
use gpcc_lite::Leaf;
use gs_model::{Scene, SceneMut};

/// One decoded chunk. Its memory serves one chunk after another.
#[derive(Debug, Default)]
pub(crate) struct DecodedChunk {
    leaves: ChunkValues,
    /// The Gaussians of an exact chunk; `leaves` mean nothing then.
    exact: Option<Scene>,
}

impl DecodedChunk {
    /// Decodes layer `number` of a chunk. The layers before it have been decoded, and stay so if this one cannot be.
    ///
    /// # Errors
    /// [`Error::Chunk`], with the cause.
    pub(crate) fn layer(
        &mut self,
        index: &Index,
        chunk: usize,
        number: usize,
        bytes: &[u8],
    ) -> Result<()> {
        let Self { leaves, exact } = self;
        let count = index.chunks[chunk].count;
        let decoded = match (index.chunks[chunk].kind, number) {
            (Kind::Exact, _) => lossless::decode_payload(bytes, count, index.header.sh_degree)
                .map(|scene| *exact = Some(scene)),
            (Kind::Leaves, number) => {
                *exact = None;
                let count = usize::try_from(count).unwrap_or(usize::MAX);
                let layer = leaves.layer(number as u8, &index.header, count, bytes);
                layer.and_then(|()| check_place(index, chunk, leaves.octree().leaves()))
            }
        };
        decoded.map_err(|source| Error::Chunk { chunk, source: Box::new(source) })
    }

    /// The leaves; `None` for an exact chunk.
    pub(crate) fn leaves(&self) -> Option<&ChunkValues> {
        self.exact.is_none().then_some(&self.leaves)
    }

    /// The number of Gaussians.
    pub(crate) fn len(&self) -> usize {
        self.exact.as_ref().map_or(self.leaves.octree().len(), Scene::len)
    }

    /// Puts the Gaussians from `first` on into `out`. SH degrees that were not decoded become 0.
    pub(crate) fn fill(&self, first: usize, out: &mut SceneMut<'_>) {
        match &self.exact {
            Some(scene) => out.copy_from(scene, first),
            None => self.leaves.fill(first, out),
        }
    }

    /// All Gaussians, in a scene that is like `empty`.
    ///
    /// # Errors
    /// [`Error::Memory`].
    pub(crate) fn scene(&self, empty: Scene) -> Result<Scene> {
        let mut scene = empty;
        resize(&mut scene, self.len())?;
        self.fill(0, &mut SceneMut::of(&mut scene));
        Ok(scene)
    }
}

/// Compares a layer with its checksum.
pub(crate) fn verify(bytes: &[u8], chunk: usize, number: usize, layer: Layer) -> Result<()> {
    check(crc32c::crc32c(bytes), chunk, number, layer)
}

/// Compares the checksum of a layer with that of the index.
pub(crate) fn check(found: u32, chunk: usize, number: usize, layer: Layer) -> Result<()> {
    if found != layer.crc {
        let Layer { offset, crc: expected, .. } = layer;
        return Err(Error::Checksum { chunk, layer: number, offset, expected, found });
    }
    Ok(())
}

/// The leaves begin where the index says, and end before the next chunk begins.
fn check_place(index: &Index, number: usize, leaves: &[Leaf]) -> Result<()> {
    let chunk = &index.chunks[number];
    let (Some(first), Some(last)) = (leaves.first(), leaves.last()) else { return Ok(()) };
    let end = last.morton + (1 << (3 * (index.header.j_high - last.depth)));
    let next = index.chunks.get(number + 1);
    let next = next.filter(|c| c.kind == Kind::Leaves && c.lod == chunk.lod);
    if first.morton != chunk.first_cell || next.is_some_and(|c| c.first_cell < end) {
        return Err(Error::Corrupt { what: "first cell of a chunk", value: first.morton });
    }
    Ok(())
}
