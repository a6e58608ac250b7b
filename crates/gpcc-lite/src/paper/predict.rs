//! Prediction of attributes from neighbours that are coded already.
//!
//! [`Neighbours`] orders the points coarse to fine and finds, once for all channels, the nearest
//! points before each one in that order. [`encode_lossless`] predicts every value of an
//! integer channel of any width from them and codes the residual.

mod lossless;
mod neighbours;
mod palette;
mod residual;

pub use lossless::{decode_lossless, encode_lossless};
pub use neighbours::{MAX_NEIGHBOURS, Neighbours};
