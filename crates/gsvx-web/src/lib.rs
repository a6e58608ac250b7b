#![doc = include_str!("../README.md")]

#[cfg(feature = "sequence")]
mod clip;
mod error;
mod head;
mod layout;
#[cfg(feature = "page")]
mod model;
#[cfg(feature = "page")]
mod outlook;
mod stream;

#[cfg(feature = "sequence")]
pub use clip::Clip;
#[cfg(feature = "page")]
pub use model::WholeModel;
#[cfg(feature = "page")]
pub use outlook::outlook;
pub use stream::Stream;
