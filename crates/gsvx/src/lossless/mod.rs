//! Bit-exact coding of every float of a scene.
//!
//! Normative description: `docs/format-lossless.md`. Gaussians come back in Morton order of
//! their means unless the original order is asked for; every value comes back bit for bit,
//! NaN payloads included. Columns are cut into cells whose index is predicted (from the
//! Gaussian's earlier columns by a linear form fitted by the encoder, from what that form leaves
//! at neighbours, and from a covariance of the columns that follows the place in the scene) and
//! coded with mixed adaptive contexts; the bits inside a cell are noise and stored as they are.

#[cfg(feature = "encode")]
mod choice;
mod column;
mod decode;
#[cfg(feature = "encode")]
mod encode;
#[cfg(feature = "encode")]
mod fit;
pub(crate) mod layout;
mod local;
mod means;
mod neighbours;
mod predictor;
mod residual;
mod rows;
mod tail;

pub(crate) use decode::decode_payload;
#[cfg(feature = "encode")]
pub(crate) use encode::encode_payload;

/// The first byte of a payload: floats as they are.
const RAW: u8 = 0;
/// The first byte of a payload: coded, in Morton order.
const MORTON_ORDER: u8 = 1;
/// The first byte of a payload: coded, with the original order.
const OWN_ORDER: u8 = 2;

/// Gaussians per part, at most; parts are coded independently of each other.
const MAX_PART: usize = 1 << 16;

/// How one column is coded; the same in every part.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Column {
    map: column::Map,
    predictor: predictor::ColumnPredictor,
    /// Mean level of the errors.
    centre: u8,
    /// A value frequent enough to have a flag of its own.
    common: Option<u32>,
    /// Some values are escapes.
    escapes: bool,
}

/// What a decoded part is made of.
#[derive(Debug, Default)]
struct PartBits {
    /// Cell indices of the means, by column.
    means: Vec<Vec<i32>>,
    /// Bit patterns, one row of all columns per Gaussian.
    bits: Vec<u32>,
}

/// First row of each part, and the end.
fn part_bounds(n: usize, parts: usize) -> Vec<usize> {
    (0..=parts).map(|k| (n as u64 * k as u64 / parts.max(1) as u64) as usize).collect()
}

/// Bits of an index below `n`.
fn index_bits(n: usize) -> u32 {
    64 - (n.max(1) as u64 - 1).leading_zeros()
}
