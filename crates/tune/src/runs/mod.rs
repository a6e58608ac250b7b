//! The three runs: for a small stream, the paper's fine-tune, and training from photos.

pub(crate) mod fine_tune;
pub(crate) mod train;
pub(crate) mod tune;
