//! Progress of long work: a bar on a terminal, and now and then a plain line in a log file.

use crate::exit::note;
use indicatif::{ProgressBar, ProgressStyle};
use std::io::IsTerminal;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::sync::{Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Time between two lines in a log; work that ends sooner writes none.
const BETWEEN_LINES: Duration = Duration::from_secs(10);

/// Steps of a piece of work.
pub(crate) struct Steps {
    bar: ProgressBar,
    /// None on a terminal.
    lines: Option<Mutex<Lines>>,
    started: Instant,
}

/// What a log gets.
struct Lines {
    what: &'static str,
    len: u64,
    done: u64,
    message: String,
    last: Duration,
}

impl Lines {
    fn new(what: &'static str, len: u64) -> Self {
        Self { what, len, done: 0, message: String::new(), last: Duration::ZERO }
    }

    /// The line for `elapsed` after the start, if it is time for one.
    fn line(&mut self, elapsed: Duration) -> Option<String> {
        if elapsed < self.last + BETWEEN_LINES {
            return None;
        }
        self.last = elapsed;
        let Self { what, len, done, .. } = self;
        let message =
            if self.message.is_empty() { String::new() } else { format!(", {}", self.message) };
        let seconds = elapsed.as_secs();
        Some(format!("{what}: {done} of {len} after {seconds} s{message}"))
    }
}

impl Steps {
    /// Work of `len` steps.
    pub(crate) fn new(what: &'static str, len: u64) -> Self {
        let style = ProgressStyle::with_template("{prefix:<12} [{bar:32}] {pos}/{len} {eta} {msg}")
            .unwrap_or_else(|_| ProgressStyle::default_bar());
        let bar = ProgressBar::new(len).with_style(style).with_prefix(what);
        let lines = (!std::io::stderr().is_terminal()).then(|| Mutex::new(Lines::new(what, len)));
        Self { bar, lines, started: Instant::now() }
    }

    /// One more step is done.
    pub(crate) fn inc(&self) {
        self.bar.inc(1);
        self.log(|lines| lines.done += 1);
    }

    /// So many steps are done, and this is to be said of them.
    pub(crate) fn set(&self, done: u64, message: &str) {
        self.bar.set_position(done);
        self.bar.set_message(message.to_owned());
        self.log(|lines| {
            lines.done = done;
            lines.message = message.into();
        });
    }

    /// Writes a line without disturbing the bar.
    pub(crate) fn say(&self, text: &str) {
        self.bar.suspend(|| note(text));
    }

    fn log(&self, change: impl FnOnce(&mut Lines)) {
        let Some(lines) = &self.lines else { return };
        let mut lines = lines.lock().unwrap_or_else(PoisonError::into_inner);
        change(&mut lines);
        if let Some(line) = lines.line(self.started.elapsed()) {
            note(line);
        }
    }
}

impl Drop for Steps {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}

/// A sign of life during work of unknown length.
pub(crate) struct Spinner {
    bar: ProgressBar,
    /// Without a terminal: a thread that writes lines until the sender is gone.
    lines: Option<(Sender<()>, JoinHandle<()>)>,
}

impl Drop for Spinner {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
        if let Some((sender, thread)) = self.lines.take() {
            drop(sender);
            // It writes lines; a failure to do so does not matter.
            let _ = thread.join();
        }
    }
}

/// Work of unknown length.
pub(crate) fn spinner(what: String) -> Spinner {
    let bar = ProgressBar::new_spinner();
    let lines = if std::io::stderr().is_terminal() {
        bar.set_message(what);
        bar.enable_steady_tick(Duration::from_millis(120));
        None
    } else {
        let (sender, receiver) = channel();
        let thread = std::thread::spawn(move || every(BETWEEN_LINES, &receiver, &what, note));
        Some((sender, thread))
    };
    Spinner { bar, lines }
}

/// Says `what` is being done after each `pause`, until the sender is gone.
fn every(pause: Duration, gone: &Receiver<()>, what: &str, say: impl Fn(String)) {
    let mut waited = Duration::ZERO;
    while gone.recv_timeout(pause) == Err(RecvTimeoutError::Timeout) {
        waited += pause;
        say(format!("{what}: {} s so far", waited.as_secs()));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_log_showed_no_progress() {
        let mut lines = Lines::new("fine-tune", 500);
        let at = Duration::from_secs;
        lines.done = 100;
        assert_eq!(lines.line(at(9)), None);
        assert_eq!(lines.line(at(11)).as_deref(), Some("fine-tune: 100 of 500 after 11 s"));
        lines.done = 200;
        lines.message = "31.2 dB".into();
        assert_eq!(lines.line(at(20)), None);
        assert_eq!(lines.line(at(21)).unwrap(), "fine-tune: 200 of 500 after 21 s, 31.2 dB");
    }

    #[test]
    fn a_log_showed_no_sign_of_life() {
        let (sender, receiver) = channel();
        let (said, heard) = channel();
        let thread = std::thread::spawn(move || {
            every(Duration::from_millis(2), &receiver, "encoding", |line| {
                let _ = said.send(line);
            });
        });
        for _ in 0..2 {
            assert!(heard.recv().unwrap().starts_with("encoding: "));
        }
        drop(sender);
        thread.join().unwrap();
    }
}
