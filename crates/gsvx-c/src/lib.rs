#![doc = include_str!("../README.md")]

mod array;
mod border;
mod error;
#[cfg(feature = "encode")]
mod model;
mod plain;
mod stream;

pub use border::*;
pub use plain::*;
pub use stream::Stream;
