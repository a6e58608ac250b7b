//! Ctrl-C and termination: nothing half-written stays behind.

use crate::output;
use anyhow::{Context, Result};
use std::sync::Arc;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};

/// A flag that asks the running work to stop by itself, if it knows how to.
static CANCEL: OnceLock<Arc<AtomicBool>> = OnceLock::new();

/// The exit code of a process that a person interrupted.
const INTERRUPTED: i32 = 130;

/// Installs the handler.
pub(crate) fn install() -> Result<()> {
    ctrlc::set_handler(|| match CANCEL.get() {
        // A second signal does not wait for the work to notice the first.
        Some(flag) if !flag.swap(true, Ordering::Relaxed) => {}
        _ => {
            output::remove_pending();
            eprintln!("error: interrupted; no output was touched");
            std::process::exit(INTERRUPTED);
        }
    })
    .context("Ctrl-C cannot be caught")
}

/// A flag that an interruption sets instead of ending the process.
pub(crate) fn cancel_flag() -> Arc<AtomicBool> {
    Arc::clone(CANCEL.get_or_init(Default::default))
}
