//! [`Ledger`]: which outputs are begun and which are complete, for an interruption.

use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// What has been written so far, for whoever interrupts the process.
static LEDGER: Mutex<Ledger> = Mutex::new(Ledger::NOTHING);

/// See [`LEDGER`].
pub(crate) struct Ledger {
    /// Temporary files and folders to remove.
    pub(crate) pending: Vec<PathBuf>,
    /// Folders that were made, to remove if they are empty.
    pub(crate) made: Vec<PathBuf>,
    /// Standard output or a device that has some bytes already.
    pub(crate) begun: Option<String>,
    /// Outputs that are complete, and the name of the last.
    complete: usize,
    last: String,
}

impl Ledger {
    const NOTHING: Self = Self {
        pending: Vec::new(),
        made: Vec::new(),
        begun: None,
        complete: 0,
        last: String::new(),
    };

    /// The process is about to end: removes what it has begun to write, and says what is there. No output is put in place
    /// while the guard is held.
    pub(crate) fn close() -> (MutexGuard<'static, Self>, String) {
        let mut ledger = ledger();
        for path in ledger.pending.drain(..) {
            // The process ends, so that an error could not be reported.
            let _ = if path.is_dir() {
                std::fs::remove_dir_all(path)
            } else {
                std::fs::remove_file(path)
            };
        }
        for folder in ledger.made.drain(..) {
            let _ = std::fs::remove_dir(folder);
        }
        let Self { begun, complete, last, .. } = &*ledger;
        let complete = match complete {
            0 => None,
            1 => Some(format!("{last} is complete")),
            n => Some(format!("{n} outputs are complete, the last of them {last}")),
        };
        let begun = begun.as_ref().map(|name| format!("{name} is incomplete"));
        let there = [complete, begun].into_iter().flatten().collect::<Vec<_>>().join("; ");
        let there = if there.is_empty() { "no output was touched".into() } else { there };
        (ledger, there)
    }

    /// Counts an output that is complete.
    pub(crate) fn completed(&mut self, name: &str) {
        self.complete += 1;
        self.last = name.into();
    }
}

/// What has been written so far. No output is put in place while the guard is held.
pub(crate) fn ledger() -> MutexGuard<'static, Ledger> {
    LEDGER.lock().unwrap_or_else(PoisonError::into_inner)
}
