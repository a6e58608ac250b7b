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
mod node;
mod slabs;
mod source;
mod tree;

use crate::bytes::{ByteReader, put_varint};
use crate::coder::{Coder, RansDecoder, RansEncoder};
use crate::cube::Cube;
use crate::error::{Error, Result};
use crate::leaf::Leaf;
use crate::limits::Limits;
use crate::octree::{Octree, check_count, check_depth};
use models::GeometryModels;
use multiversion::multiversion;
use tree::CodedTree;

/// Leaves that are coded as a sample, with slabs and without.
const SAMPLE: usize = 2048;
/// Slabs are used if they save one byte in this many. Decoding with slabs takes longer.
const LEAST_GAIN: usize = 50;

/// Whether slabs pay, tried on the first leaves.
fn slabs_pay(tree: &Octree) -> Result<bool> {
    let sample = &tree.leaves()[..tree.len().min(SAMPLE)];
    let cost = |slabs| -> Result<usize> {
        let mut coder = RansEncoder::default();
        code(&mut coder, Some(sample), Shape { count: sample.len(), depth: tree.depth(), slabs })?;
        Ok(coder.finish().len())
    };
    let (without, with) = (cost(false)?, cost(true)?);
    Ok(with + without / LEAST_GAIN < without)
}

/// Codes the leaves of an octree as a stream of its own. It does not hold the cube.
///
/// # Errors
/// None for a valid octree.
pub fn encode(tree: &Octree) -> Result<Vec<u8>> {
    let (count, depth, slabs) = (tree.len(), tree.depth(), slabs_pay(tree)?);
    let mut out = vec![depth, u8::from(slabs)];
    put_varint(&mut out, count as u64);
    let mut coder = RansEncoder::default();
    code(&mut coder, Some(tree.leaves()), Shape { count, depth, slabs })?;
    out.extend(coder.finish());
    Ok(out)
}

/// Decodes what [`encode`] wrote, as an octree with cells of side 1.
///
/// # Errors
/// If the stream is truncated, corrupt, or claims more points than `limits` allows.
pub fn decode(bytes: &[u8], limits: &Limits) -> Result<Octree> {
    let mut r = ByteReader::new(bytes);
    let depth = r.u8("geometry header")?;
    check_depth(depth)?;
    let offset = r.pos();
    let slabs = match r.u8("slabs")? {
        byte @ 0..2 => byte == 1,
        _ => return Err(Error::Corrupt { what: "slabs", offset }),
    };
    let points = r.varint("point count")?;
    if points > limits.max_points as u64 {
        return Err(Error::TooManyPoints { points, limit: limits.max_points });
    }
    let mut coder = RansDecoder::new(&bytes[r.pos()..])?;
    let leaves = decode_counted(&mut coder, Shape { count: points as usize, depth, slabs })?;
    coder.finish()?;
    Octree::of_points(depth, leaves)
}

/// Codes the leaves of an octree into a stream that holds other things too.
///
/// # Errors
/// None for a valid octree.
pub fn encode_leaves(coder: &mut RansEncoder, tree: &Octree) -> Result<()> {
    let shape = Shape { count: tree.len(), depth: tree.depth(), slabs: false };
    code(coder, Some(tree.leaves()), shape).map(|_| ())
}

/// Decodes what [`encode_leaves`] coded: `count` leaves of an octree of this depth.
///
/// Time and memory are bounded by the bytes of the stream as well as by `count`: a stream that
/// claims more leaves than it holds ends early.
///
/// # Errors
/// If the stream is truncated or does not hold `count` leaves, or `depth` exceeds
/// [`MAX_DEPTH`](crate::morton::MAX_DEPTH).
pub fn decode_leaves(
    coder: &mut RansDecoder<'_>,
    count: usize,
    cube: Cube,
    depth: u8,
) -> Result<Octree> {
    check_depth(depth)?;
    let leaves = decode_counted(coder, Shape { count, depth, slabs: false })?;
    Octree::new(cube, depth, leaves)
}

/// What a decoder knows of the leaves before it reads them.
#[derive(Clone, Copy)]
struct Shape {
    count: usize,
    /// Depth of the octree.
    depth: u8,
    slabs: bool,
}

#[multiversion(targets("x86_64+avx2+bmi1+bmi2+lzcnt+popcnt"))]
fn decode_counted(coder: &mut RansDecoder<'_>, shape: Shape) -> Result<Vec<Leaf>> {
    check_count(shape.count as u64)?;
    let leaves = code(coder, None, shape)?;
    if leaves.len() != shape.count {
        return Err(Error::Corrupt { what: "point count", offset: 0 });
    }
    Ok(leaves)
}

/// Codes or decodes the levels of the tree from the root down.
#[inline(always)]
fn code<C: Coder>(coder: &mut C, leaves: Option<&[Leaf]>, shape: Shape) -> Result<Vec<Leaf>> {
    let Shape { count, depth, slabs } = shape;
    if count == 0 {
        return Ok(Vec::new());
    }
    let mut models = GeometryModels::new(slabs, depth);
    let mut tree = CodedTree::new(leaves, depth, count);
    for level in 0..depth {
        tree.level(level, &mut models, coder)?;
    }
    Ok(tree.finish())
}
