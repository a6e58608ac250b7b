//! The time that a run takes.

use std::time::Instant;

/// When something began. The standard library has no clock on wasm32-unknown-unknown; there everything takes 0 s.
#[derive(Clone, Copy)]
pub(crate) struct Clock(Option<Instant>);

impl Clock {
    pub(crate) fn start() -> Self {
        let there = !cfg!(all(target_family = "wasm", target_os = "unknown"));
        Self(there.then(Instant::now))
    }

    pub(crate) fn seconds(self) -> f64 {
        self.0.map_or(0.0, |started| started.elapsed().as_secs_f64())
    }
}
