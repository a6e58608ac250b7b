//! The npm package of `crates/gsvx-web/npm`, its decoder, and its scripts.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use eval::scenes;
use wasm_bindgen_cli_support::Bindgen;
use xshell::{Shell, cmd};

use crate::commands::shell;
use crate::needs::{self, Need, WASM};

/// The package's folder.
pub(crate) fn folder() -> PathBuf {
    scenes::root().join("crates/gsvx-web/npm")
}

/// Looks for what building the decoder and running the scripts needs.
pub(crate) fn needed() -> Result<()> {
    needs::all(&[Need::Target(WASM), Need::Node])
}

/// Runs a script that makes a page, with the decoder that reads models too.
pub(crate) fn page(name: &str, arguments: &[&Path]) -> Result<()> {
    needed()?;
    decoder(&["--features=page"], "viewer/wasm/gsvx")?;
    script(name, arguments, &[])
}

/// Builds the decoders, of streams and of sequences, and packs the npm package; returns the tarball.
pub(crate) fn package() -> Result<PathBuf> {
    decoder(&[], "wasm/gsvx")?;
    decoder(&["--features=sequence"], "wasm/sequence")?;
    let (sh, out) = (shell("crates/gsvx-web/npm")?, scenes::root().join("out/web"));
    sh.create_dir(&out)?;
    let printed = cmd!(sh, "npm pack --silent --pack-destination {out}").quiet().read()?;
    let tarball = out.join(printed.lines().last().unwrap_or_default().trim());
    ensure!(tarball.is_file(), "npm pack made no file in {}", out.display());
    Ok(tarball)
}

/// Builds the decoder with some features, and its JavaScript: `out` is a folder of the package and a name.
fn decoder(features: &[&str], out: &str) -> Result<()> {
    let (sh, target) = (shell("")?, scenes::root().join("target/web"));
    let words = ["--package=gsvx-web", "--profile=web"];
    let cargo = cmd!(
        sh,
        "cargo build --quiet {words...} --target {WASM} --target-dir {target} {features...}"
    );
    let cargo =
        cargo.env("CARGO_TARGET_WASM32_UNKNOWN_UNKNOWN_RUSTFLAGS", "-C target-feature=+simd128");
    cargo.quiet().run().context("gsvx-web does not build")?;
    let (out, name) = out.rsplit_once('/').context("a folder and a name")?;
    let module = target.join(WASM).join("web/gsvx_web.wasm");
    Bindgen::new()
        .input_path(&module)
        .web(true)?
        // A decoder that has trapped is replaced.
        .reset_state_function(true)
        .out_name(name)
        .remove_name_section(true)
        .remove_producers_section(true)
        .generate(folder().join(out))
        .with_context(|| format!("{}: no bindings", module.display()))
}

/// Installs the engines and tools, at the versions of the lock file.
fn dev_dependencies(sh: &Shell) -> Result<()> {
    let npm = folder();
    let age = |path: &str| npm.join(path).metadata().and_then(|m| m.modified()).ok();
    if age("node_modules/.package-lock.json") < age("package-lock.json") {
        cmd!(sh, "npm ci --no-audit --no-fund --silent").run()?;
    }
    Ok(())
}

/// Runs a script of the package's folder. `tools` are the programs that it starts, by environment variable.
pub(crate) fn script(name: &str, arguments: &[&Path], tools: &[(&str, PathBuf)]) -> Result<()> {
    let sh = shell("crates/gsvx-web/npm")?;
    dev_dependencies(&sh)?;
    Ok(cmd!(sh, "node {name} {arguments...}").envs(tools.iter().map(|(k, v)| (k, v))).run()?)
}
