//! What only the paper's codec and measuring use; no stream of gsvx needs it.
//!
//! * [`predict`]: lossless integers by prediction from the nearest coded neighbours.
//! * [`rlgr`]: adaptive run-length and Golomb-Rice coding, the entropy coder of the paper.

pub mod predict;
pub mod rlgr;
