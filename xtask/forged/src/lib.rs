//! Forged streams, each by its number, and what a decoder makes of them, as a number that all machines must agree on.

// The generator of the crate `testing` alone: all of it takes a minute to build.
extern crate self as testing;

#[path = "../../../crates/gsvx/tests/common/forge.rs"]
#[allow(dead_code, reason = "a part is used")]
mod forge;
mod outcome;
#[path = "../../../crates/testing/src/rng.rs"]
mod rng;
mod scene;
mod seal;
mod streams;

pub use outcome::outcome;
pub use rng::Rng;
pub use scene::{join, scenes};
pub use streams::{FIRST_GOLDEN, stream};

/// For WebAssembly: what the decoder makes of a stream.
#[unsafe(no_mangle)]
pub extern "C" fn outcome_of(number: u32) -> u32 {
    outcome(&stream(number.into()))
}

/// For WebAssembly: see [`FIRST_GOLDEN`].
#[unsafe(no_mangle)]
pub extern "C" fn first_golden() -> u32 {
    FIRST_GOLDEN as u32
}
