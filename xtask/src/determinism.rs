//! `cargo xtask determinism`: the same bytes and floats for any number of threads, in debug and
//! release, and on other processors.
//!
//! What is hashed is in `xtask/determinism`, a package that also builds for WebAssembly (run in
//! Node) and 64-bit Arm (run by qemu's user mode). What cannot be had is skipped, and said.

use anyhow::{Result, bail, ensure};
use xshell::cmd;

use crate::commands::{self, shell};
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
        // The tools for Arm are large, so they are used only if they are there.
        false => ON_ARM.iter().find_map(Need::missing),
    };
    let skipped: Vec<&String> = web.iter().chain(&arm).collect();
    for what in &skipped {
        eprintln!("SKIPPED: {what}");
    }
    if args.strict && !skipped.is_empty() {
        bail!("{} targets were skipped", skipped.len());
    }
    let sh = shell("xtask/determinism")?;
    let build = |target, profile| commands::build(&sh, &[], target, profile);
    let mut runs: Vec<(String, String)> = Vec::new();
    let mut add = |name: String, command: xshell::Cmd<'_>| -> Result<()> {
        let text = command.quiet().read()?;
        println!("{name}");
        runs.push((name, text));
        Ok(())
    };
    let profiles: &[&str] = if args.quick { &["release"] } else { &["release", "debug"] };
    for profile in profiles.iter().copied() {
        let binary = build(None, profile)?.join("gsvx-determinism");
        for threads in THREADS {
            let own = cmd!(sh, "{binary}").env("RAYON_NUM_THREADS", threads);
            add(format!("{}, {profile}, {threads} threads", std::env::consts::ARCH), own)?;
        }
    }
    if web.is_none() {
        let module = build(Some(WASM), "release")?.join("gsvx_determinism.wasm");
        let node = cmd!(sh, "node run.mjs {module}");
        add(format!("{WASM} in Node, release, no threads"), node)?;
    }
    if arm.is_none() {
        let linker = format!("CARGO_TARGET_{}_LINKER", ARM.to_uppercase().replace('-', "_"));
        let _linker = sh.push_env(linker, ARM_LINKER);
        let binary = build(Some(ARM), "release")?.join("gsvx-determinism");
        for threads in ["1", "3"] {
            let qemu = cmd!(sh, "{QEMU} -L {ARM_LIBRARY} {binary}");
            let name = format!("{ARM} in qemu, release, {threads} threads");
            add(name, qemu.env("RAYON_NUM_THREADS", threads))?;
        }
    }
    let differing = differing(&runs);
    let lines = runs.first().map_or(0, |r| r.1.lines().count());
    println!("{} runs, {lines} lines each, {} differ", runs.len(), differing.len());
    ensure!(differing.is_empty(), "hashes differ: {}", differing.join("; "));
    Ok(())
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
