//! Progress of long work: a bar on a terminal, and now and then a plain line in a log file.

use crate::exit::note;
use indicatif::{ProgressBar, ProgressStyle};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// In a log: the time from the start to the first line, and between two lines.
const FIRST_LINE: Duration = Duration::from_millis(1_800);
const BETWEEN_LINES: Duration = Duration::from_secs(5);

/// What is being done, the innermost last.
static DOING: Mutex<Vec<ProgressBar>> = Mutex::new(Vec::new());

/// From now on a log gets lines about what is being done, if it takes long.
pub(crate) fn watch() {
    let bar = ProgressBar::new_spinner();
    if !bar.is_hidden() {
        return;
    }
    let started = Instant::now();
    // The thread ends with the process.
    std::thread::spawn(move || {
        std::thread::sleep(FIRST_LINE);
        loop {
            let doing = DOING.lock().unwrap_or_else(PoisonError::into_inner).last().cloned();
            match doing {
                Some(bar) => note(line(&bar)),
                None => note(format_args!("{} s so far", started.elapsed().as_secs())),
            }
            std::thread::sleep(BETWEEN_LINES);
        }
    });
}

/// How far a piece of work is, until this is dropped.
pub(crate) struct Meter {
    bar: ProgressBar,
}

impl Meter {
    /// Work of `len` steps.
    pub(crate) fn new(what: &'static str, len: usize) -> Self {
        let style = ProgressStyle::with_template("{prefix:<12} [{bar:32}] {pos}/{len} {eta} {msg}")
            .unwrap_or_else(|_| ProgressStyle::default_bar());
        Self::of(ProgressBar::new(len as u64).with_style(style).with_prefix(what))
    }

    /// Work of unknown length.
    pub(crate) fn spinner(what: String) -> Self {
        let this = Self::of(ProgressBar::new_spinner().with_message(gs_model::printable(&what)));
        if !this.bar.is_hidden() {
            this.bar.enable_steady_tick(Duration::from_millis(120));
        }
        this
    }

    fn of(bar: ProgressBar) -> Self {
        DOING.lock().unwrap_or_else(PoisonError::into_inner).push(bar.clone());
        Self { bar }
    }

    /// One more step is done.
    pub(crate) fn inc(&self) {
        self.bar.inc(1);
    }

    /// Sets the number of steps that are done, and the message beside it.
    pub(crate) fn set(&self, done: u64, message: String) {
        self.bar.set_position(done);
        self.bar.set_message(message);
    }

    /// Writes a line without disturbing the bar.
    pub(crate) fn say(&self, text: &str) {
        self.bar.suspend(|| note(text));
    }
}

impl Drop for Meter {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
        let mut doing = DOING.lock().unwrap_or_else(PoisonError::into_inner);
        // Work on other threads may have begun since.
        doing.retain(|bar| !bar.is_finished());
    }
}

/// What a log gets.
fn line(bar: &ProgressBar) -> String {
    let (message, seconds) = (bar.message(), bar.elapsed().as_secs());
    let Some(len) = bar.length() else { return format!("{message}: {seconds} s so far") };
    let comma = if message.is_empty() { "" } else { ", " };
    let (what, done) = (bar.prefix(), bar.position());
    format!("{what}: {done} of {len} after {seconds} s{comma}{message}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_log_gets_lines_of_progress() {
        let at = Duration::from_secs;
        let bar = Meter::new("fine-tune", 500);
        bar.bar.set_position(99);
        bar.inc();
        assert_eq!(line(&bar.bar.clone().with_elapsed(at(11))), "fine-tune: 100 of 500 after 11 s");
        bar.set(200, "31.2 dB".into());
        let later = line(&bar.bar.clone().with_elapsed(at(21)));
        assert_eq!(later, "fine-tune: 200 of 500 after 21 s, 31.2 dB");
        let spinner = Meter::spinner("encoding".into());
        assert_eq!(line(&spinner.bar.clone().with_elapsed(at(10))), "encoding: 10 s so far");
    }
}
