//! Lossless octree geometry of leaves of any depth.
//!
//! The tree is coded breadth first. At each node a decision says whether a *single* leaf lies below
//! it.
//!
//! For a single leaf, the stream holds the number of levels between node and leaf (only if the
//! leaves differ in depth), and the path to it. The first step of the path tends towards the node's
//! neighbours and has a model; the other steps are as good as random and are plain bits. Below any
//! other node, the stream says which of the eight children are occupied. The model's context is the
//! density of the cells known around the node.
//!
//! Leaves of some scenes lie in planes of the octree. The encoder tries a sample of the leaves with
//! *slabs*, which learn such planes, and uses them where they pay ([`Layout::planes`]).
//!
//! Invariant: encoder and decoder see the same nodes, in the same order, with the same contexts.
//! Normative description: `docs/format.md`, "Geometry".

mod density;
mod models;
mod slabs;
mod source;
mod tree;

use crate::bytes::{Reader, put_varint};
use crate::coder::{Coder, Decoder, Encoder};
use crate::error::{Error, Result};
use crate::leaf::{Leaf, check_count, check_leaves};
use crate::limits::Limits;
use crate::morton::MAX_DEPTH;
use models::Models;
use tree::Tree;

/// Decoded geometry.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Geometry {
    /// Leaves in Morton order; codes are at depth `j_high`.
    pub leaves: Vec<Leaf>,
    /// Depth of the finest possible leaf.
    pub j_high: u8,
}

/// What a decoder has to know of the leaves before it reads them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Layout {
    /// Some leaf is not at the finest depth.
    pub mixed_depths: bool,
    /// Leaves lie in planes across the axes, so slabs are kept.
    pub planes: bool,
}

/// Leaves that [`Layout::of`] codes as a sample.
const SAMPLE: usize = 2048;
/// Slabs are used if they save one byte in this many. Decoding with slabs takes longer.
const LEAST_GAIN: usize = 50;

impl Layout {
    /// The layout of `leaves`. Whether slabs pay is tried on the first leaves.
    ///
    /// # Errors
    /// If the leaves are not valid.
    pub fn of(leaves: &[Leaf], j_high: u8) -> Result<Self> {
        let mixed_depths = leaves.iter().any(|l| l.depth != j_high);
        let sample = &leaves[..leaves.len().min(SAMPLE)];
        let cost = |planes| -> Result<usize> {
            let mut coder = Encoder::default();
            encode_leaves(&mut coder, sample, j_high, Self { mixed_depths, planes })?;
            Ok(coder.finish().len())
        };
        let (without, with) = (cost(false)?, cost(true)?);
        Ok(Self { mixed_depths, planes: with + without / LEAST_GAIN < without })
    }

    /// The layout as the byte that streams hold.
    #[must_use]
    pub fn to_byte(self) -> u8 {
        u8::from(self.mixed_depths) | u8::from(self.planes) << 1
    }

    /// The inverse of [`Layout::to_byte`]; `None` if the byte is no layout.
    #[must_use]
    pub fn from_byte(byte: u8) -> Option<Self> {
        (byte < 4).then_some(Self { mixed_depths: byte & 1 == 1, planes: byte & 2 == 2 })
    }
}

/// Codes `leaves` (sorted, disjoint, not deeper than `j_high`) as a stream of its own.
///
/// # Errors
/// If the leaves are not valid, or there are 2^32 - 1 of them or more.
pub fn encode(leaves: &[Leaf], j_high: u8) -> Result<Vec<u8>> {
    let layout = Layout::of(leaves, j_high)?;
    let mut out = vec![j_high, layout.to_byte()];
    put_varint(&mut out, leaves.len() as u64);
    let mut coder = Encoder::default();
    encode_leaves(&mut coder, leaves, j_high, layout)?;
    out.extend(coder.finish());
    Ok(out)
}

/// Decodes what [`encode`] wrote.
///
/// # Errors
/// If the stream is truncated, corrupt, or claims more points than `limits` allows.
pub fn decode(bytes: &[u8], limits: &Limits) -> Result<Geometry> {
    let mut r = Reader::new(bytes);
    let j_high = r.u8("geometry header")?;
    if j_high > MAX_DEPTH {
        return Err(Error::Depth { depth: j_high, max: MAX_DEPTH });
    }
    let offset = r.pos();
    let layout =
        Layout::from_byte(r.u8("layout")?).ok_or(Error::Corrupt { what: "layout", offset })?;
    let points = r.varint("point count")?;
    if points > limits.max_points as u64 {
        return Err(Error::TooManyPoints { points, limit: limits.max_points });
    }
    let mut coder = Decoder::new(&bytes[r.pos()..])?;
    let leaves = decode_leaves(&mut coder, points as usize, j_high, layout)?;
    coder.finish()?;
    Ok(Geometry { leaves, j_high })
}

/// Codes leaves into a stream that holds other things too. The decoder must be told `layout`;
/// its `mixed_depths` must be true if some leaf is not at depth `j_high`.
///
/// # Errors
/// If the leaves are not valid, or there are 2^32 - 1 of them or more.
pub fn encode_leaves(
    coder: &mut Encoder,
    leaves: &[Leaf],
    j_high: u8,
    layout: Layout,
) -> Result<()> {
    check_leaves(leaves, j_high)?;
    code(coder, Some(leaves), leaves.len(), j_high, layout).map(|_| ())
}

/// Decodes what [`encode_leaves`] coded.
///
/// Time and memory are bounded by the bytes of the stream as well as by `count`: a stream that
/// claims more leaves than it holds ends early.
///
/// # Errors
/// If the stream is truncated or does not hold `count` leaves, or `j_high` exceeds
/// [`MAX_DEPTH`].
pub fn decode_leaves(
    coder: &mut Decoder<'_>,
    count: usize,
    j_high: u8,
    layout: Layout,
) -> Result<Vec<Leaf>> {
    if j_high > MAX_DEPTH {
        return Err(Error::Depth { depth: j_high, max: MAX_DEPTH });
    }
    check_count(count as u64)?;
    let leaves = code(coder, None, count, j_high, layout)?;
    if leaves.len() != count {
        return Err(Error::Corrupt { what: "point count", offset: 0 });
    }
    Ok(leaves)
}

/// Codes or decodes the levels of the tree from the root down.
fn code<C: Coder>(
    coder: &mut C,
    leaves: Option<&[Leaf]>,
    count: usize,
    j_high: u8,
    layout: Layout,
) -> Result<Vec<Leaf>> {
    if count == 0 {
        return Ok(Vec::new());
    }
    let mut models = Models::new(layout, j_high);
    let mut tree = Tree::new(leaves, j_high, count);
    for depth in 0..j_high {
        tree.level(depth, &mut models, coder)?;
    }
    Ok(tree.finish())
}
