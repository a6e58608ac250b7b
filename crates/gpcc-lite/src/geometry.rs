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
//! Invariant: encoder and decoder see the same nodes, in the same order, with the same contexts.
//! Normative description: `docs/format.md`, "Geometry".

mod density;
mod models;
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

/// Codes `leaves` (sorted, disjoint, not deeper than `j_high`) as a stream of its own.
///
/// # Errors
/// If the leaves are not valid, or there are 2^32 - 1 of them or more.
pub fn encode(leaves: &[Leaf], j_high: u8) -> Result<Vec<u8>> {
    let mixed = has_mixed_depths(leaves, j_high);
    let mut out = vec![j_high | u8::from(mixed) << 7];
    put_varint(&mut out, leaves.len() as u64);
    let mut coder = Encoder::default();
    encode_leaves(&mut coder, leaves, j_high, mixed)?;
    out.extend(coder.finish());
    Ok(out)
}

/// Decodes what [`encode`] wrote.
///
/// # Errors
/// If the stream is truncated, corrupt, or claims more points than `limits` allows.
pub fn decode(bytes: &[u8], limits: &Limits) -> Result<Geometry> {
    let mut r = Reader::new(bytes);
    let head = r.u8("geometry header")?;
    let (j_high, mixed) = (head & 0x7f, head >> 7 == 1);
    if j_high > MAX_DEPTH {
        return Err(Error::Depth { depth: j_high, max: MAX_DEPTH });
    }
    let points = r.varint("point count")?;
    if points > limits.max_points as u64 {
        return Err(Error::TooManyPoints { points, limit: limits.max_points });
    }
    let mut coder = Decoder::new(&bytes[r.pos()..])?;
    let leaves = decode_leaves(&mut coder, points as usize, j_high, mixed)?;
    coder.finish()?;
    Ok(Geometry { leaves, j_high })
}

/// Whether some leaf is not at the finest depth.
#[must_use]
pub fn has_mixed_depths(leaves: &[Leaf], j_high: u8) -> bool {
    leaves.iter().any(|l| l.depth != j_high)
}

/// Codes leaves into a stream that holds other things too. `mixed` must be what
/// [`has_mixed_depths`] says, and the decoder must be told it.
///
/// # Errors
/// If the leaves are not valid, or there are 2^32 - 1 of them or more.
pub fn encode_leaves(coder: &mut Encoder, leaves: &[Leaf], j_high: u8, mixed: bool) -> Result<()> {
    check_leaves(leaves, j_high)?;
    code(coder, Some(leaves), leaves.len(), j_high, mixed).map(|_| ())
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
    mixed: bool,
) -> Result<Vec<Leaf>> {
    if j_high > MAX_DEPTH {
        return Err(Error::Depth { depth: j_high, max: MAX_DEPTH });
    }
    check_count(count as u64)?;
    let leaves = code(coder, None, count, j_high, mixed)?;
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
    mixed: bool,
) -> Result<Vec<Leaf>> {
    if count == 0 {
        return Ok(Vec::new());
    }
    let mut models = Models::new(mixed);
    let mut tree = Tree::new(leaves, j_high, count);
    for depth in 0..j_high {
        tree.level(depth, &mut models, coder)?;
    }
    Ok(tree.finish())
}
