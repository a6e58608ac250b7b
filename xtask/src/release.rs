//! `cargo xtask release --dry-run`: whether everything that is published could be, and has the files that it should.
//!
//! Nothing is published from here: a tag `v0.1.0` starts `.github/workflows/release.yml`.

use std::fs::File;
use std::path::Path;

use anyhow::{Context, Result, bail};
use xshell::cmd;
use zip::ZipArchive;

use crate::commands::shell;
use crate::needs::{self, Need, WASM};
use crate::npm;

/// Files of the npm package and of the wheel.
const NPM: &str = include_str!("release/npm.txt");
const WHEEL: &str = include_str!("release/wheel.txt");

/// Arguments of `release`.
#[derive(clap::Args, Debug)]
pub(crate) struct ReleaseArgs {
    /// Publish nothing; always needed
    #[arg(long, required = true)]
    dry_run: bool,
    /// Do not compile the packed crates
    #[arg(long)]
    no_verify: bool,
}

/// Packs crates, npm package and wheel, and looks into them.
pub(crate) fn run(args: &ReleaseArgs) -> Result<()> {
    crates(args)?;
    npm()?;
    wheel()
}

/// All crates in order, each compiled from its package.
fn crates(args: &ReleaseArgs) -> Result<()> {
    let (sh, no_verify) = (shell("")?, args.no_verify.then_some("--no-verify"));
    cmd!(sh, "cargo publish --workspace --dry-run --quiet --allow-dirty {no_verify...}")
        .run()
        .context("the crates cannot be published")?;
    println!("crates: all can be published");
    Ok(())
}

fn npm() -> Result<()> {
    if let Err(lacking) = needs::all(&[Need::Target(WASM), Need::Node]) {
        eprintln!("SKIPPED: the npm package: {lacking}");
        return Ok(());
    }
    let tarball = npm::package()?;
    let sh = shell("")?;
    let listed = cmd!(sh, "tar -tzf {tarball}").quiet().read()?;
    let files = listed.lines().filter_map(|line| line.strip_prefix("package/"));
    check("npm package", "npm.txt", NPM, files.map(ToOwned::to_owned).collect())
}

fn wheel() -> Result<()> {
    let (sh, dir) = (shell("crates/gsvx-py")?, eval::scenes::root().join("out/wheel"));
    if cmd!(sh, "maturin --version").quiet().ignore_stderr().read().is_err() {
        eprintln!("SKIPPED: the wheel: maturin is missing: run `pip install maturin`");
        return Ok(());
    }
    // Wheels of earlier versions would be looked into as well.
    sh.remove_path(&dir)?;
    cmd!(sh, "maturin build --quiet --profile dev --out {dir}").run()?;
    let made = dir.read_dir()?.next().context("maturin made no wheel")??.path();
    check("wheel", "wheel.txt", WHEEL, wheel_files(&made)?)
}

/// The files of a wheel. What depends on version and system is replaced.
fn wheel_files(wheel: &Path) -> Result<Vec<String>> {
    let archive = ZipArchive::new(File::open(wheel)?)?;
    let version = env!("CARGO_PKG_VERSION");
    let mut files = Vec::new();
    for name in archive.file_names() {
        let name = name?.replace(version, "VERSION");
        match name.rsplit_once('.') {
            Some(("gsvx/_gsvx.abi3", _) | ("gsvx/_gsvx", "pyd")) => files.push("gsvx/_gsvx".into()),
            _ if name.ends_with('/') => {}
            _ => files.push(name),
        }
    }
    Ok(files)
}

/// Compares the files of a package with a list.
fn check(what: &str, list: &str, wanted: &str, mut files: Vec<String>) -> Result<()> {
    files.sort();
    let mut wanted: Vec<&str> = wanted.lines().collect();
    wanted.sort_unstable();
    let missing = wanted.iter().filter(|&&w| !files.iter().any(|f| f == w));
    let more = files.iter().filter(|f| !wanted.contains(&f.as_str()));
    let told: Vec<String> = missing
        .map(|name| format!("{name} is missing"))
        .chain(more.map(|name| format!("{name} is not on the list")))
        .collect();
    if !told.is_empty() {
        bail!("{what}, by xtask/src/release/{list}: {}", told.join(", "));
    }
    println!("{what}: the {} files of the list", files.len());
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_that_are_missing_and_files_too_many_are_named() {
        let files = || vec!["b.js".to_owned(), "a.js".to_owned()];
        check("x", "x.txt", "a.js\nb.js\n", files()).unwrap();
        let error = check("x", "x.txt", "a.js\nc.js", files()).unwrap_err().to_string();
        assert!(error.contains("c.js is missing, b.js is not on the list"), "{error}");
    }

    #[test]
    fn npm_has_the_version_of_the_crates() {
        let file = eval::scenes::root().join("crates/gsvx-web/npm/package.json");
        let package: serde_json::Value =
            serde_json::from_slice(&std::fs::read(file).unwrap()).unwrap();
        assert_eq!(package["version"], env!("CARGO_PKG_VERSION"));
    }
    #[test]
    fn file_knows_a_stream_by_the_entry_of_docs() {
        let stream = "fixtures/streams/default.gsvx";
        if eval::printed("file", &["--version"]).is_none() {
            eprintln!("SKIPPED: file(1) is not installed");
            return;
        }
        let said =
            eval::printed("file", &["--brief", "--mime-type", "-m", "docs/mime/magic", stream]);
        assert_eq!(said.as_deref(), Some("model/vnd.gsvx"));
    }
}
