#![doc = include_str!("../README.md")]

mod error;
mod head;
mod layout;
#[cfg(feature = "models")]
mod model;
mod stream;

#[cfg(feature = "models")]
pub use model::WholeModel;
pub use stream::Stream;
