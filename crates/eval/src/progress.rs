//! Progress: a bar on a terminal, a plain line per stage elsewhere.

use std::io::IsTerminal;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

/// Progress of one stage.
pub struct Bar {
    bar: ProgressBar,
    label: String,
    started: Instant,
    quiet: bool,
}

impl Bar {
    /// A stage of `total` steps.
    #[must_use]
    pub fn new(label: &str, total: u64) -> Self {
        let bar = if std::io::stderr().is_terminal() {
            ProgressBar::new(total)
        } else {
            eprintln!("{label} ...");
            ProgressBar::with_draw_target(Some(total), ProgressDrawTarget::hidden())
        };
        // The template is a constant; the default style is a fair fallback all the same.
        let style = ProgressStyle::with_template("{msg:28} [{bar:36}] {pos}/{len}  {eta} left");
        if let Ok(style) = style {
            bar.set_style(style.progress_chars("=> "));
        }
        bar.set_message(label.to_owned());
        bar.enable_steady_tick(Duration::from_millis(200));
        Self { bar, label: label.to_owned(), started: Instant::now(), quiet: false }
    }

    /// A stage of `total` bytes; a step is a byte.
    #[must_use]
    pub fn bytes(label: &str, total: u64) -> Self {
        let bar = Self::new(label, total);
        let template = "{msg:28} [{bar:36}] {decimal_bytes}/{decimal_total_bytes}  {eta} left";
        if let Ok(style) = ProgressStyle::with_template(template) {
            bar.bar.set_style(style.progress_chars("=> "));
        }
        bar
    }

    /// Part of a stage that has its own bar.
    #[must_use]
    pub fn hidden() -> Self {
        let bar = ProgressBar::with_draw_target(None, ProgressDrawTarget::hidden());
        Self { bar, label: String::new(), started: Instant::now(), quiet: true }
    }

    /// Advances by `n` steps.
    pub fn step(&self, n: u64) {
        self.bar.inc(n);
    }

    /// Seconds since the stage began.
    #[must_use]
    pub fn seconds(&self) -> f64 {
        self.started.elapsed().as_secs_f64()
    }

    /// Ends the stage with one line.
    pub fn done(&self) -> f64 {
        let seconds = self.seconds();
        self.bar.finish_and_clear();
        if !self.quiet {
            eprintln!("{}: {seconds:.1} s", self.label);
        }
        seconds
    }
}
