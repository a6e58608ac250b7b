//! `cargo xtask determinism`: the same bytes and floats for any number of threads, in debug and
//! release, and on other processors.
//!
//! What is hashed is in `xtask/determinism`, a package that also builds for WebAssembly (run in
//! Node) and 64-bit Arm (run by qemu's user mode). What cannot be had is skipped, and said.

use std::path::PathBuf;
use std::process::Command;

use anyhow::{Context, Result, bail, ensure};

use crate::needs::{self, ARM, ARM_LIBRARY, ARM_LINKER, Need, ON_ARM, QEMU, WASM};

/// Arguments of `determinism`.
#[derive(clap::Args, Debug)]
pub(crate) struct DeterminismArgs {
    /// Install the tools for 64-bit Arm, and fail where something cannot be had instead of skipping it.
    #[arg(long)]
    strict: bool,
    /// Release builds only: what every push is checked with.
    #[arg(long)]
    quick: bool,
}

const THREADS: [&str; 4] = ["1", "2", "3", "8"];

/// Builds, runs and compares.
pub(crate) fn run(args: &DeterminismArgs) -> Result<()> {
    let web = needs::all(&[Need::Target(WASM), Need::Node]).err().map(|e| e.to_string());
    let arm = match args.strict {
        true => needs::all(&ON_ARM).err().map(|e| e.to_string()),
        // They are large.
        false => ON_ARM.iter().find_map(Need::missing),
    };
    let skipped: Vec<&String> = web.iter().chain(&arm).collect();
    for what in &skipped {
        eprintln!("SKIPPED: {what}");
    }
    if args.strict && !skipped.is_empty() {
        bail!("{} targets were skipped", skipped.len());
    }
    let mut runs: Vec<(String, String)> = Vec::new();
    let profiles: &[&str] = if args.quick { &["release"] } else { &["release", "debug"] };
    for profile in profiles.iter().copied() {
        let binary = build(None, profile)?.join("gsvx-determinism");
        for threads in THREADS {
            let text = output(Command::new(&binary).env("RAYON_NUM_THREADS", threads))?;
            println!("{profile}, {threads} threads");
            runs.push((format!("{}, {profile}, {threads} threads", std::env::consts::ARCH), text));
        }
    }
    if web.is_none() {
        let module = build(Some(WASM), "release")?.join("gsvx_determinism.wasm");
        let script = package().join("run.mjs");
        let text = output(Command::new("node").arg(script).arg(module))?;
        println!("{WASM}");
        runs.push((format!("{WASM} in Node, release, no threads"), text));
    }
    if arm.is_none() {
        let binary = build(Some(ARM), "release")?.join("gsvx-determinism");
        for threads in ["1", "3"] {
            let mut qemu = Command::new(QEMU);
            qemu.args(["-L", ARM_LIBRARY]).arg(&binary);
            let text = output(qemu.env("RAYON_NUM_THREADS", threads))?;
            println!("{ARM}, {threads} threads");
            runs.push((format!("{ARM} in qemu, release, {threads} threads"), text));
        }
    }
    let differing = differing(&runs);
    let lines = runs.first().map_or(0, |r| r.1.lines().count());
    println!("{} runs, {lines} lines each, {} differ", runs.len(), differing.len());
    ensure!(differing.is_empty(), "hashes differ: {}", differing.join("; "));
    Ok(())
}

fn package() -> PathBuf {
    eval::scenes::root().join("xtask/determinism")
}

/// Builds the package; returns the folder of what was made.
fn build(target: Option<&str>, profile: &str) -> Result<PathBuf> {
    let dir = eval::scenes::root().join("target/determinism");
    let mut cargo = Command::new("cargo");
    cargo.current_dir(package()).args(["build", "--quiet", "--target-dir"]).arg(&dir);
    if profile == "release" {
        cargo.arg("--release");
    }
    let mut made = dir;
    if let Some(target) = target {
        cargo.args(["--target", target]);
        let name = target.to_uppercase().replace('-', "_");
        if target == ARM {
            cargo.env(format!("CARGO_TARGET_{name}_LINKER"), ARM_LINKER);
        }
        made.push(target);
    }
    let status = cargo.status().context("start cargo")?;
    ensure!(status.success(), "{}: does not build for {target:?}", package().display());
    Ok(made.join(profile))
}

fn output(command: &mut Command) -> Result<String> {
    let out = command.output().with_context(|| format!("start {command:?}"))?;
    let error = String::from_utf8_lossy(&out.stderr);
    ensure!(out.status.success(), "{command:?}: {}: {error}", out.status);
    Ok(String::from_utf8(out.stdout)?)
}

/// The lines in which a run is not the first one.
fn differing(runs: &[(String, String)]) -> Vec<String> {
    let Some((_, first)) = runs.first() else { return Vec::new() };
    let mut out = Vec::new();
    for (name, text) in &runs[1..] {
        if text.lines().count() != first.lines().count() {
            out.push(format!("{name}: another number of lines"));
        }
        let pairs = text.lines().zip(first.lines()).filter(|(a, b)| a != b);
        out.extend(pairs.map(|(a, b)| format!("{name}: {a}, not {b}")));
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_run_that_differs_is_named_with_its_line() {
        let run = |name: &str, text: &str| (name.to_owned(), text.to_owned());
        let runs = [run("a", "x 1 2\ny 3 4\n"), run("b", "x 1 2\ny 3 5\n"), run("c", "x 1 2\n")];
        let found = differing(&runs);
        assert_eq!(found, ["b: y 3 5, not y 3 4", "c: another number of lines"]);
        assert!(differing(&runs[..1]).is_empty());
    }
}
