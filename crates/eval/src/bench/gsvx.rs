//! `cargo xtask bench-gsvx`: pages on the codec as a user has it.

use std::path::Path;

use anyhow::Result;

pub use super::gsvx_flags::GsvxOptions;
use super::{importance, scale, speed, sweep};
use crate::process::GsvxCommand;

/// Measures and writes the page that is asked for.
///
/// # Errors
/// If the command is not there or fails, or a scene cannot be read.
pub fn run(options: &GsvxOptions) -> Result<()> {
    let out = |page: &'static str| options.out.as_deref().unwrap_or(Path::new(page));
    if !options.importance.is_empty() {
        return importance::run(&options.importance, out("docs/results/importance.md"));
    }
    if !options.sweep.is_empty() {
        return sweep::run(&options.sweep, out("docs/results/sweep.md"));
    }
    let gsvx = GsvxCommand::find()?;
    if !options.millions.is_empty() {
        return scale::run(options, &gsvx, out("docs/results/scale.md"));
    }
    speed::run(options, &gsvx, out("docs/results/speed.md"))
}
