//! The npm package of `crates/gsvx-web/npm`, its decoder, and its scripts.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, bail, ensure};
use wasm_bindgen_cli_support::Bindgen;

use crate::needs::{self, Need, WASM};

/// The package's folder.
pub(crate) fn folder() -> PathBuf {
    eval::scenes::root().join("crates/gsvx-web/npm")
}

/// Looks for what building the decoder and running the scripts needs.
pub(crate) fn needed() -> Result<()> {
    needs::all(&[Need::Target(WASM), Need::Node])
}

/// Runs a script that makes a page, with the decoder that reads models too.
pub(crate) fn page(name: &str, arguments: &[&Path]) -> Result<()> {
    let npm = folder();
    needed()?;
    dev_dependencies(&npm)?;
    decoder(&["page"], &npm.join("viewer/wasm"))?;
    script(&npm, name, arguments, &[])
}

/// Builds the decoder and packs the npm package; returns the tarball.
pub(crate) fn package() -> Result<PathBuf> {
    let npm = folder();
    decoder(&[], &npm.join("wasm"))?;
    pack(&npm)
}

/// Builds the decoder with some features, and its JavaScript, into a folder.
fn decoder(features: &[&str], out: &Path) -> Result<()> {
    let root = eval::scenes::root();
    let target = root.join("target/web");
    let mut cargo = Command::new("cargo");
    cargo.current_dir(&root);
    cargo.args(["build", "--quiet", "--package", "gsvx-web", "--target", WASM]);
    cargo
        .args(["--profile", "web", "--features", &features.join(","), "--target-dir"])
        .arg(&target);
    cargo.env("CARGO_TARGET_WASM32_UNKNOWN_UNKNOWN_RUSTFLAGS", "-C target-feature=+simd128");
    let status = cargo.status().context("start cargo")?;
    ensure!(status.success(), "gsvx-web does not build");
    let module = target.join(WASM).join("web/gsvx_web.wasm");
    Bindgen::new()
        .input_path(&module)
        .web(true)?
        // A decoder that has trapped is replaced.
        .reset_state_function(true)
        .out_name("gsvx")
        .remove_name_section(true)
        .remove_producers_section(true)
        .generate(out)
        .with_context(|| format!("{}: no bindings", module.display()))
}

/// Packs the package; returns the tarball.
fn pack(npm: &Path) -> Result<PathBuf> {
    let out = eval::scenes::root().join("out/web");
    std::fs::create_dir_all(&out)?;
    let mut command = Command::new("npm");
    command.current_dir(npm).args(["pack", "--silent", "--pack-destination"]).arg(&out);
    let made = command.output().context("start npm")?;
    ensure!(made.status.success(), "npm pack: {}", String::from_utf8_lossy(&made.stderr));
    let name = String::from_utf8(made.stdout)?;
    let name = name.lines().last().unwrap_or_default().trim();
    let tarball = out.join(name);
    if name.is_empty() || !tarball.is_file() {
        bail!("npm pack made no file in {}", out.display());
    }
    Ok(tarball)
}

/// Installs the engines and tools, at the versions of the lock file.
pub(crate) fn dev_dependencies(npm: &Path) -> Result<()> {
    let installed = npm.join("node_modules/.package-lock.json");
    let age = |path: &Path| path.metadata().and_then(|m| m.modified()).ok();
    if age(&installed) >= age(&npm.join("package-lock.json")) {
        return Ok(());
    }
    let mut command = Command::new("npm");
    command.current_dir(npm).args(["ci", "--no-audit", "--no-fund", "--silent"]);
    ensure!(command.status().context("start npm")?.success(), "npm ci failed in {}", npm.display());
    Ok(())
}

/// Runs a script of the package's folder. `tools` are the programs that it starts, by environment variable.
pub(crate) fn script(
    npm: &Path,
    name: &str,
    arguments: &[&Path],
    tools: &[(&str, PathBuf)],
) -> Result<()> {
    let mut node = Command::new("node");
    node.current_dir(npm).arg(name).args(arguments).envs(tools.iter().map(|(k, v)| (k, v)));
    let status = node.status();
    ensure!(status.context("start node")?.success(), "node {name} failed");
    Ok(())
}
