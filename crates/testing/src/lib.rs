//! What the tests and benches of several crates share: a random generator, scenes, hashes.
//!
//! Invariant: the same seed gives the same numbers on every machine and in every version of this
//! crate. Recorded hashes and golden streams depend on that.
//!
//! A crate uses it as a dev-dependency. Integration tests and benches of `gs-model` may use it
//! too; unit tests inside `gs-model` may not, because they would see two versions of `Scene`.

mod real;
mod rng;
mod room;
mod scenes;
#[cfg(feature = "wgsl")]
pub mod wgsl;

pub use real::{fixture, leica, shared};
pub use rng::Rng;
pub use room::copy_room;
pub use scenes::{
    SPACETIME, clustered, float_ply, marks, sha256, trained_like, with_floaters,
    with_related_degrees,
};
