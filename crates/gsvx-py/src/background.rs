//! Work on threads of its own while the calling thread, with the GIL released, waits for it, looks for
//! Ctrl-C and passes progress on.
//!
//! Each call has its own pool of threads: a process may fork between two calls, and work that an
//! interruption left behind ends without anyone waiting for it.

use crate::error::{Fault, Result};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::time::Duration;

/// Time between two looks for Ctrl-C.
const POLL: Duration = Duration::from_millis(50);

/// Threads of a pool; 0 for one per core.
static THREADS: AtomicUsize = AtomicUsize::new(0);

/// Sets the number of threads of all later calls; 0 for one per core.
#[pyfunction]
pub(crate) fn set_threads(threads: usize) {
    THREADS.store(threads, Ordering::Relaxed);
}

/// How far work has come.
#[derive(Debug, Default)]
pub(crate) struct Event {
    pub(crate) stage: String,
    pub(crate) done: u64,
    /// 0 if it is not known.
    pub(crate) total: u64,
    pub(crate) values: Vec<(&'static str, f64)>,
}

/// What work tells the thread that waits for it, and hears from it.
pub(crate) struct Line {
    sender: Sender<Event>,
    /// Whether anyone listens.
    heard: bool,
    pub(crate) cancel: Arc<AtomicBool>,
}

impl Line {
    pub(crate) fn tell(&self, event: Event) {
        if self.heard {
            // After an interruption the receiver is gone.
            let _ = self.sender.send(event);
        }
    }

    /// Steps of a stage.
    pub(crate) fn step(&self, stage: &str, done: usize, total: usize) -> Result<()> {
        let (done, total) = (done as u64, total as u64);
        self.tell(Event { stage: stage.into(), done, total, values: Vec::new() });
        self.check()
    }

    /// An error if nobody waits any more.
    pub(crate) fn check(&self) -> Result<()> {
        if self.cancel.load(Ordering::Relaxed) { Err(Fault::Stopped) } else { Ok(()) }
    }
}

/// Threads for one call.
pub(crate) fn pool() -> PyResult<ThreadPool> {
    let pool = ThreadPoolBuilder::new().num_threads(THREADS.load(Ordering::Relaxed)).build();
    pool.map_err(|e| Fault::Internal(format!("the threads cannot be started: {e}")).into())
}

/// Does `work` on the pool. `progress` is a Python function that takes stage, steps done, steps in all (0 if
/// not known) and a dict of figures. An exception that it raises ends the work, as Ctrl-C does.
pub(crate) fn run<T: Send + 'static>(
    py: Python<'_>,
    pool: ThreadPool,
    progress: Option<&Bound<'_, PyAny>>,
    work: impl FnOnce(&Line) -> Result<T> + Send + 'static,
) -> PyResult<T> {
    let (sender, receiver) = channel();
    let cancel: Arc<AtomicBool> = Arc::default();
    let line = Line { sender, heard: progress.is_some(), cancel: Arc::clone(&cancel) };
    let worker = std::thread::spawn(move || {
        let line = line;
        pool.install(|| work(&line))
    });
    wait(py, receiver, progress).inspect_err(|_| cancel.store(true, Ordering::Relaxed))?;
    let panic = |_| Err(Fault::Internal("internal error: a panic".into()));
    Ok(worker.join().unwrap_or_else(panic)?)
}

/// Waits until the work is done and its sender gone, or for an exception.
fn wait(
    py: Python<'_>,
    mut receiver: Receiver<Event>,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<()> {
    loop {
        let event;
        (receiver, event) = py.detach(move || {
            let event = receiver.recv_timeout(POLL);
            (receiver, event)
        });
        match (event, progress) {
            (Ok(event), Some(progress)) => pass_on(py, progress, event)?,
            (Err(RecvTimeoutError::Disconnected), _) => return Ok(()),
            _ => {}
        }
        py.check_signals()?;
    }
}

fn pass_on(py: Python<'_>, progress: &Bound<'_, PyAny>, event: Event) -> PyResult<()> {
    let values = PyDict::new(py);
    for (name, value) in event.values {
        values.set_item(name, value)?;
    }
    progress.call1((event.stage, event.done, event.total, values)).map(|_| ())
}
