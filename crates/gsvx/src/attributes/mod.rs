//! What each attribute is coded as, shared by encoder and decoder.

pub(crate) mod colour;
pub(crate) mod opacity;
pub(crate) mod prediction;
pub(crate) mod side;
