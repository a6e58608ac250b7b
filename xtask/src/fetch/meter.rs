//! Bytes that have arrived: a bar on a terminal, a line per tenth elsewhere.

use std::io::IsTerminal;
use std::time::Duration;

use indicatif::{DecimalBytes, ProgressBar, ProgressDrawTarget, ProgressStyle};

/// Progress in bytes.
#[derive(Clone)]
pub(crate) struct Meter {
    bar: ProgressBar,
    /// Prints lines: there is no terminal.
    lines: bool,
}

impl Meter {
    /// Shows nothing.
    pub(crate) fn hidden() -> Self {
        let bar = ProgressBar::with_draw_target(None, ProgressDrawTarget::hidden());
        Self { bar, lines: false }
    }

    /// Counts up to `total` bytes.
    pub(crate) fn new(label: &str, total: u64) -> Self {
        let lines = !std::io::stderr().is_terminal();
        let bar = ProgressBar::new(total);
        if lines {
            bar.set_draw_target(ProgressDrawTarget::hidden());
        }
        let style = ProgressStyle::with_template(
            "{msg:12} [{bar:36}] {decimal_bytes}/{decimal_total_bytes} {decimal_bytes_per_sec} {eta} left",
        );
        // The template is a constant; the default style is a fair fallback all the same.
        if let Ok(style) = style {
            bar.set_style(style.progress_chars("=> "));
        }
        bar.set_message(label.to_owned());
        if !lines {
            bar.enable_steady_tick(Duration::from_millis(200));
        }
        Self { bar, lines }
    }

    /// `n` more bytes.
    pub(crate) fn advance(&self, n: u64) {
        let (old, total) = (self.bar.position(), self.bar.length().unwrap_or(0).max(1));
        self.bar.inc(n);
        let tenth = |bytes: u64| u128::from(bytes) * 10 / u128::from(total);
        let now = tenth(old + n);
        if self.lines && now > tenth(old) && now < 10 {
            let (done, all) = (DecimalBytes(old + n), DecimalBytes(total));
            eprintln!("{}: {done} of {all}", self.bar.message());
        }
    }

    /// Ends the bar.
    pub(crate) fn done(&self) {
        self.bar.finish_and_clear();
    }
}
