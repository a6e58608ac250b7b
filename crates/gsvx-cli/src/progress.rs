//! Progress of long work: a bar on a terminal, and now and then a plain line in a log file.

use crate::exit::note;
use indicatif::{ProgressBar, ProgressStyle};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::thread::JoinHandle;
use std::time::Duration;

/// Time between two lines in a log; work that ends sooner writes none.
const BETWEEN_LINES: Duration = Duration::from_secs(10);

/// How far a piece of work is, until this is dropped.
pub(crate) struct Meter {
    bar: ProgressBar,
    /// Without a terminal: a thread that writes lines until the sender is gone.
    lines: Option<(Sender<()>, JoinHandle<()>)>,
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
        let this = Self::of(ProgressBar::new_spinner().with_message(what));
        if this.lines.is_none() {
            this.bar.enable_steady_tick(Duration::from_millis(120));
        }
        this
    }

    fn of(bar: ProgressBar) -> Self {
        let lines = bar.is_hidden().then(|| {
            let (sender, receiver) = channel();
            let bar = bar.clone();
            let say = move || every(BETWEEN_LINES, &receiver, || note(line(&bar)));
            (sender, std::thread::spawn(say))
        });
        Self { bar, lines }
    }

    /// One more step is done.
    pub(crate) fn inc(&self) {
        self.bar.inc(1);
    }

    /// So many steps are done, and this is to be said of them.
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
        if let Some((sender, thread)) = self.lines.take() {
            drop(sender);
            // It writes lines; a failure to do so does not matter.
            let _ = thread.join();
        }
    }
}

/// Calls `say` after each `pause`, until the sender is gone.
fn every(pause: Duration, gone: &Receiver<()>, say: impl Fn()) {
    while gone.recv_timeout(pause) == Err(RecvTimeoutError::Timeout) {
        say();
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
    fn a_log_showed_no_progress() {
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

    #[test]
    fn a_log_showed_no_sign_of_life() {
        let (sender, receiver) = channel();
        let (said, heard) = channel();
        let thread = std::thread::spawn(move || {
            every(Duration::from_millis(2), &receiver, || {
                let _ = said.send(());
            });
        });
        for _ in 0..2 {
            heard.recv().unwrap();
        }
        drop(sender);
        thread.join().unwrap();
    }
}
