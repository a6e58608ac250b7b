//! Ctrl-C and termination: nothing half-written stays behind.
//!
//! On Unix SIGINT, SIGTERM and SIGHUP, on Windows Ctrl-C, Ctrl-Break and the closing of the window.

use crate::exit::{INTERRUPTED, note};
use crate::ledger::Ledger;
use anyhow::{Context, Result};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

/// A flag that asks the running work to stop by itself, if it knows how to.
static CANCEL: OnceLock<Arc<AtomicBool>> = OnceLock::new();

/// Set while a page is served: an interruption is then how the command ends.
static SERVING: AtomicBool = AtomicBool::new(false);

/// Signals closer together than this are one: `timeout` signals the command and then its process
/// group, and a shell may pass on what the terminal has sent already.
const TOGETHER: Duration = Duration::from_secs(1);

/// Installs the handler.
pub(crate) fn install() -> Result<()> {
    let mut first: Option<Instant> = None;
    ctrlc::set_handler(move || {
        if SERVING.load(Ordering::Relaxed) {
            // Nothing that is being saved stays behind.
            let _ledger = Ledger::close();
            std::process::exit(0);
        }
        let asked = CANCEL.get().is_some_and(|flag| !flag.swap(true, Ordering::Relaxed));
        if asked {
            first = Some(Instant::now());
            note("interrupted: writing what has been reached; once more ends at once");
        } else if first.is_none_or(|first| first.elapsed() > TOGETHER) {
            let (_ledger, there) = Ledger::close();
            note(format_args!("error: interrupted; {there}"));
            std::process::exit(INTERRUPTED.into());
        }
    })
    .context("Ctrl-C cannot be caught")
}

/// From here on an interruption is the end that a person wants.
pub(crate) fn is_the_end() {
    SERVING.store(true, Ordering::Relaxed);
}

/// From here on an interruption sets this flag, for work that then stops by itself, instead of ending the process.
pub(crate) fn sets(flag: Arc<AtomicBool>) {
    // A command sets the flag once, so `set` cannot fail.
    let _ = CANCEL.set(flag);
}
