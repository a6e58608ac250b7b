//! Lossless octree geometry of leaves of any depth.
//!
//! The tree is coded breadth first. At each node a decision says whether a *single* leaf lies below
//! it.
//!
//! For a single leaf, the stream holds the number of levels between node and leaf, and the path to it in plain
//! bits: it is as good as random. Below any other node, the stream says which of the eight children are
//! occupied. The context of a child is the number of occupied cells around the node that touch it, and what is
//! known of the children before it.
//!
//! Points of some clouds lie in planes of the octree. [`encode`] tries a sample of them with *slabs*, which learn
//! such planes, and uses them where they pay. Scenes of Gaussians do not gain by them, so [`encode_leaves`] does
//! without.
//!
//! Invariant: encoder and decoder see the same nodes, in the same order, with the same contexts.
//! Normative description: `docs/format.md`, "Geometry".

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

/// Leaves that are coded as a sample, with slabs and without.
const SAMPLE: usize = 2048;
/// Slabs are used if they save one byte in this many. Decoding with slabs takes longer.
const LEAST_GAIN: usize = 50;

/// Whether slabs pay, tried on the first leaves.
fn slabs_pay(leaves: &[Leaf], j_high: u8) -> Result<bool> {
    let sample = &leaves[..leaves.len().min(SAMPLE)];
    let cost = |slabs| -> Result<usize> {
        let mut coder = Encoder::default();
        code(&mut coder, Some(sample), sample.len(), j_high, slabs)?;
        Ok(coder.finish().len())
    };
    let (without, with) = (cost(false)?, cost(true)?);
    Ok(with + without / LEAST_GAIN < without)
}

/// Codes `leaves` (sorted, disjoint, not deeper than `j_high`) as a stream of its own.
///
/// # Errors
/// If the leaves are not valid, or there are 2^32 - 1 of them or more.
pub fn encode(leaves: &[Leaf], j_high: u8) -> Result<Vec<u8>> {
    check_leaves(leaves, j_high)?;
    let slabs = slabs_pay(leaves, j_high)?;
    let mut out = vec![j_high, u8::from(slabs)];
    put_varint(&mut out, leaves.len() as u64);
    let mut coder = Encoder::default();
    code(&mut coder, Some(leaves), leaves.len(), j_high, slabs)?;
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
    let slabs = match r.u8("slabs")? {
        byte @ 0..2 => byte == 1,
        _ => return Err(Error::Corrupt { what: "slabs", offset }),
    };
    let points = r.varint("point count")?;
    if points > limits.max_points as u64 {
        return Err(Error::TooManyPoints { points, limit: limits.max_points });
    }
    let mut coder = Decoder::new(&bytes[r.pos()..])?;
    let leaves = decode_counted(&mut coder, points as usize, j_high, slabs)?;
    coder.finish()?;
    Ok(Geometry { leaves, j_high })
}

/// Codes leaves into a stream that holds other things too.
///
/// # Errors
/// If the leaves are not valid, or there are 2^32 - 1 of them or more.
pub fn encode_leaves(coder: &mut Encoder, leaves: &[Leaf], j_high: u8) -> Result<()> {
    check_leaves(leaves, j_high)?;
    code(coder, Some(leaves), leaves.len(), j_high, false).map(|_| ())
}

/// Decodes what [`encode_leaves`] coded.
///
/// Time and memory are bounded by the bytes of the stream as well as by `count`: a stream that
/// claims more leaves than it holds ends early.
///
/// # Errors
/// If the stream is truncated or does not hold `count` leaves, or `j_high` exceeds
/// [`MAX_DEPTH`].
pub fn decode_leaves(coder: &mut Decoder<'_>, count: usize, j_high: u8) -> Result<Vec<Leaf>> {
    if j_high > MAX_DEPTH {
        return Err(Error::Depth { depth: j_high, max: MAX_DEPTH });
    }
    decode_counted(coder, count, j_high, false)
}

fn decode_counted(
    coder: &mut Decoder<'_>,
    count: usize,
    j_high: u8,
    slabs: bool,
) -> Result<Vec<Leaf>> {
    check_count(count as u64)?;
    let leaves = code(coder, None, count, j_high, slabs)?;
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
    slabs: bool,
) -> Result<Vec<Leaf>> {
    if count == 0 {
        return Ok(Vec::new());
    }
    let mut models = Models::new(slabs, j_high);
    let mut tree = Tree::new(leaves, j_high, count);
    for depth in 0..j_high {
        tree.level(depth, &mut models, coder)?;
    }
    Ok(tree.finish())
}
