//! Progress: a bar on a terminal, elsewhere a plain line every five seconds. A stage that took a while ends with a line.

use std::cell::Cell;
use std::io::IsTerminal;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

/// Progress of one stage.
pub struct Bar {
    bar: ProgressBar,
    label: String,
    started: Instant,
    /// When something was last said; not on a terminal.
    said: Option<Cell<Instant>>,
}

/// Stages shorter than this say nothing when they end.
const NOTABLE_SECONDS: f64 = 1.0;
/// Without a terminal.
const BETWEEN_LINES: Duration = Duration::from_secs(5);

impl Bar {
    /// A stage of `total` steps.
    #[must_use]
    pub fn new(label: &str, total: u64) -> Self {
        let terminal = std::io::stderr().is_terminal();
        let bar = if terminal {
            ProgressBar::new(total)
        } else {
            ProgressBar::with_draw_target(Some(total), ProgressDrawTarget::hidden())
        };
        // The template is a constant; the default style is a fair fallback all the same.
        let style = ProgressStyle::with_template("{msg:28} [{bar:36}] {pos}/{len}  {eta} left");
        if let Ok(style) = style {
            bar.set_style(style.progress_chars("=> "));
        }
        bar.set_message(label.to_owned());
        bar.enable_steady_tick(Duration::from_millis(200));
        let started = Instant::now();
        let said = (!terminal).then_some(Cell::new(started));
        Self { bar, label: label.to_owned(), started, said }
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

    /// Says what is being done now, in place of the label.
    pub fn note(&self, text: &str) {
        self.bar.set_message(text.to_owned());
    }

    /// Advances by `n` steps.
    pub fn step(&self, n: u64) {
        self.bar.inc(n);
        if let Some(said) = &self.said
            && said.get().elapsed() >= BETWEEN_LINES
        {
            said.set(Instant::now());
            let percent = 100 * self.bar.position() / self.bar.length().unwrap_or(1).max(1);
            eprintln!("{}: {percent} %", self.bar.message());
        }
    }

    /// Ends the stage, with one line if it took a while.
    pub fn done(&self) {
        let seconds = self.started.elapsed().as_secs_f64();
        self.bar.finish_and_clear();
        if seconds >= NOTABLE_SECONDS {
            eprintln!("{}: {seconds:.1} s", self.label);
        }
    }
}
