//! Prediction of attributes from neighbours already coded: lossless integers of any width.
//!
//! [`Neighbours`] orders the points coarse to fine and finds, once for all channels, the nearest
//! points that precede each one in that order; [`encode_lossless`] predicts every value from
//! them and codes the residual.

mod lossless;
mod neighbours;

pub use lossless::{decode_lossless, encode_lossless};
pub use neighbours::{MAX_NEIGHBOURS, Neighbours};
