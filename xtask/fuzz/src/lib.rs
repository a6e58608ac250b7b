//! One function per fuzz target: takes any bytes, checks what must hold of the outcome, and
//! says whether the bytes were accepted.
//!
//! Every target is given limits that keep one execution small: what is looked for are wrong
//! turns, not large scenes.

mod codec;
#[path = "../../../crates/gsvx/tests/common/mod.rs"]
mod common;
pub mod readers;
#[path = "../../forged/src/seal.rs"]
mod seal;
pub mod seeds;
mod streams;

use common::forge;

/// Runs parallel loops on the thread that fuzzes: handing work to a pool costs more than the
/// work.
pub fn init() {
    rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .use_current_thread()
        .build_global()
        .expect("the pool is built once, first");
}

/// The first byte, which chooses what is done with the rest.
fn choice(data: &[u8]) -> (u8, &[u8]) {
    data.split_first().map_or((0, data), |(&first, rest)| (first, rest))
}

/// A small number and the rest.
fn number(data: &[u8]) -> (usize, &[u8]) {
    match data.split_first_chunk::<2>() {
        Some((n, rest)) => (usize::from(u16::from_le_bytes(*n)), rest),
        None => (0, &[]),
    }
}
