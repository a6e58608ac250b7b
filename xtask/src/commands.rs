//! Commands that tasks run.

use std::path::PathBuf;

use anyhow::{Context, Result};
use eval::scenes;
use xshell::{Shell, cmd};

/// Commands run in a folder of the workspace.
pub(crate) fn shell(folder: &str) -> Result<Shell> {
    let shell = Shell::new()?;
    shell.change_dir(scenes::root().join(folder));
    Ok(shell)
}

/// Builds what `words` name of the package in the shell's folder, which is a workspace of its own; returns the folder of
/// what was made.
pub(crate) fn build(
    sh: &Shell,
    words: &[&str],
    target: Option<&str>,
    profile: &str,
) -> Result<PathBuf> {
    let package = sh.current_dir();
    let name = package.file_name().unwrap_or_default();
    let mut made = scenes::root().join("target").join(name);
    let release = (profile == "release").then_some("--release");
    let of_target = target.map(|target| format!("--target={target}"));
    let cargo =
        cmd!(sh, "cargo build --quiet --target-dir {made} {words...} {release...} {of_target...}");
    let what = || format!("{} does not build for {target:?}", package.display());
    cargo.quiet().run().with_context(what)?;
    made.extend(target);
    Ok(made.join(profile))
}
