//! What each attribute is coded as, shared by encoder and decoder.

pub mod colour;
pub mod group;
pub mod opacity;
pub mod prediction;
