//! `cargo xtask release --dry-run`: whether everything that is published could be, and has the files that it should.
//!
//! Nothing is published from here: a tag `v0.1.0` starts `.github/workflows/release.yml`.

use std::fs::File;
use std::path::Path;
use std::process::Command;

use anyhow::{Context, Result, bail, ensure};
use zip::ZipArchive;

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
    let mut cargo = Command::new("cargo");
    cargo.current_dir(eval::scenes::root());
    cargo.args(["publish", "--workspace", "--dry-run", "--quiet", "--allow-dirty"]);
    if args.no_verify {
        cargo.arg("--no-verify");
    }
    ensure!(cargo.status().context("start cargo")?.success(), "the crates cannot be published");
    println!("crates: all can be published");
    Ok(())
}

fn npm() -> Result<()> {
    if let Err(lacking) = needs::all(&[Need::Target(WASM), Need::Node]) {
        eprintln!("SKIPPED: the npm package: {lacking}");
        return Ok(());
    }
    let tarball = npm::package()?;
    let listed = Command::new("tar").arg("-tzf").arg(&tarball).output().context("start tar")?;
    ensure!(listed.status.success(), "{}: not a tarball", tarball.display());
    let listed = String::from_utf8(listed.stdout)?;
    let files = listed.lines().filter_map(|line| line.strip_prefix("package/"));
    check("npm package", "npm.txt", NPM, files.map(ToOwned::to_owned).collect())
}

fn wheel() -> Result<()> {
    let root = eval::scenes::root();
    let dir = root.join("out/wheel");
    // Wheels of earlier versions would be looked into as well.
    if dir.exists() {
        std::fs::remove_dir_all(&dir)?;
    }
    let mut maturin = Command::new("maturin");
    maturin.current_dir(root.join("crates/gsvx-py"));
    maturin.args(["build", "--quiet", "--profile", "dev", "--out"]).arg(&dir);
    let Ok(status) = maturin.status() else {
        eprintln!("SKIPPED: the wheel: maturin is missing: run `pip install maturin`");
        return Ok(());
    };
    ensure!(status.success(), "maturin makes no wheel");
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
        let root = eval::scenes::root();
        let mut file = Command::new("file");
        file.args(["--brief", "--mime-type", "-m"]).arg(root.join("docs/mime/magic"));
        let Ok(said) = file.arg(root.join("fixtures/streams/default.gsvx")).output() else {
            eprintln!("SKIPPED: file(1) is not installed");
            return;
        };
        assert_eq!(String::from_utf8_lossy(&said.stdout).trim(), "model/vnd.gsvx");
    }
}
