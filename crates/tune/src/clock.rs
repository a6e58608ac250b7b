//! Time, where there is some.

use std::time::Instant;

/// Since when. WebAssembly without a host has no clock, and everything takes 0 s there.
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
