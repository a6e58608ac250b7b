//! `cargo xtask forged`: forged streams, each by its number, through every border: none may panic, trap or abort, and all
//! borders must make the same of each.
//!
//! The streams, and what Rust makes of them, are in `xtask/forged`, a package that also builds for 32 bits and WebAssembly.
//! There the golden streams follow, and on 32 bits the seeds of all fuzz targets, with mutations of each.
//! What cannot be had is skipped, and said.

use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::time::Instant;

use anyhow::{Context, Result, ensure};
use eval::scenes;
use serde_json::Value;
use xshell::{Shell, cmd};

use crate::commands::{self, shell};
use crate::needs::{self, Need, WASM};
use crate::npm;

/// A target of 32 bits whose programs run on a PC as they are.
const I686: &str = "i686-unknown-linux-musl";
const C: &str = "C library";
const PYTHON: &str = "Python package";
const NPM: &str = "npm package in Node";

/// Arguments of `forged`.
#[derive(clap::Args, Debug)]
pub(crate) struct ForgedArgs {
    /// Number of the first stream
    #[arg(long, default_value_t = 0)]
    first: u32,
    /// How many streams
    #[arg(long, default_value_t = 100_000)]
    count: u32,
    /// The C library, if it is built already
    #[arg(long, value_name = "FILE")]
    library: Option<PathBuf>,
    /// An interpreter that has the Python package
    #[arg(long, value_name = "FILE", default_value = "python3")]
    python: PathBuf,
    /// Build without optimisation: for few streams
    #[arg(long)]
    quick: bool,
}

/// What became of the streams at one border.
struct Outcome {
    border: &'static str,
    seconds: f64,
    /// As the program of the border prints it.
    figures: Value,
}

impl Outcome {
    fn failed(&self) -> usize {
        self.figures["failed"].as_array().map_or(usize::MAX, Vec::len)
    }
}

/// Decodes the streams at every border that there is, and compares.
pub(crate) fn run(args: &ForgedArgs) -> Result<()> {
    let sh = &shell("xtask/forged")?;
    let profile = if args.quick { "debug" } else { "release" };
    // The library alone is what WebAssembly has.
    let build = |target: Option<&str>| {
        let what = if target == Some(WASM) { "--lib" } else { "--bins" };
        commands::build(sh, &[what], target, profile)
    };
    let own = build(None)?.join("gsvx-forged");
    let numbers = &[args.first, args.count].map(|n| n.to_string());
    let mut outcomes: Vec<Outcome> = Vec::new();
    let mut skipped = 0;
    let borders: [(&'static str, &dyn Fn() -> Result<Command>); 6] = [
        ("Rust, 64 bits", &|| Ok(cmd!(sh, "{own} {numbers...}").into())),
        ("Rust, i686", &|| {
            Need::Target(I686).get()?;
            let program = build(Some(I686))?.join("gsvx-forged");
            Ok(cmd!(sh, "{program} {numbers...}").into())
        }),
        ("Rust, wasm32 in Node", &|| {
            needs::all(&[Need::Target(WASM), Need::Node])?;
            let module = build(Some(WASM))?.join("gsvx_forged.wasm");
            Ok(cmd!(sh, "node run.mjs {module} {numbers...}").into())
        }),
        (C, &|| c_program(args)),
        (PYTHON, &|| {
            // Its path may be relative to the folder where the task was started.
            let (here, python) = (Shell::new()?, &args.python);
            let has = cmd!(here, "{python} -c 'import gsvx'").quiet().ignore_stderr();
            has.run().with_context(|| {
                let python = python.display();
                format!(
                    "{python} has no package gsvx: install it with `pip install ./crates/gsvx-py` and name the \
                     interpreter with --python"
                )
            })?;
            let script = sh.current_dir().join("decode.py");
            Ok(cmd!(here, "{python} {script}").into())
        }),
        (NPM, &|| {
            Need::Node.get()?;
            let folder = npm::folder();
            let is_built = folder.join("wasm").is_dir();
            ensure!(is_built, "the npm package is not built: run `cargo xtask web`");
            Ok(cmd!(sh, "node decode.mjs {folder}").into())
        }),
    ];
    for (border, command) in borders {
        match command() {
            Ok(command) => {
                let is_fed = [C, PYTHON, NPM].contains(&border);
                let writer = is_fed.then(|| cmd!(sh, "{own} write {numbers...}").into());
                let outcome = decode(border, command, writer)?;
                println!("{border}: {} ({:.0} s)", outcome.figures, outcome.seconds);
                outcomes.push(outcome);
            }
            Err(why) => {
                eprintln!("SKIPPED: {border}: {why:#}");
                skipped += 1;
            }
        }
    }
    match Need::Target(I686).get() {
        Ok(()) => seeds(args.quick)?,
        Err(why) => {
            eprintln!("SKIPPED: seeds of the fuzz targets on 32 bits: {why:#}");
            skipped += 1;
        }
    }
    let differing = differing(&outcomes);
    ensure!(differing.is_empty(), "forged streams: {}", differing.join("; "));
    println!("{} streams, {} borders agree, {skipped} skipped", args.count, outcomes.len());
    Ok(())
}

/// Mutations of each seed of a fuzz target.
const MUTATIONS: &str = "300";

/// Runs the seeds of the fuzz targets and mutations of them on 32 bits: none may fail, and unless it is to be quick, as many
/// are accepted as on this machine.
fn seeds(quick: bool) -> Result<()> {
    let sh = shell("xtask/fuzz")?;
    let accepted = |target: Option<&str>| -> Result<String> {
        let made = commands::build(&sh, &["--example", "seeds"], target, "debug")?;
        let (program, folder) = (made.join("examples/seeds"), made.join("seeds"));
        Ok(cmd!(sh, "{program} {folder} {MUTATIONS}").quiet().read()?)
    };
    let on_32_bits = accepted(Some(I686))?;
    if !quick {
        let here = accepted(None)?;
        ensure!(here == on_32_bits, "fuzz targets accept\n{here}and on 32 bits\n{on_32_bits}");
    }
    println!("Seeds of {} fuzz targets, i686: none failed", on_32_bits.lines().count());
    Ok(())
}

/// A program in C against the library.
fn c_program(args: &ForgedArgs) -> Result<Command> {
    let sh = Shell::new()?;
    let library = match &args.library {
        Some(library) => library.canonicalize().with_context(|| library.display().to_string())?,
        None => {
            sh.change_dir(scenes::root());
            let made = scenes::root().join("target/forged");
            cmd!(sh, "cargo build --quiet -p gsvx-c --target-dir {made}").run()?;
            let [before, after] = [std::env::consts::DLL_PREFIX, std::env::consts::DLL_SUFFIX];
            made.join(format!("debug/{before}gsvx_c{after}"))
        }
    };
    sh.change_dir(scenes::root().join("crates/gsvx-c"));
    let program = scenes::root().join("target/forged/hostile");
    let rpath = format!("-Wl,-rpath,{}", library.parent().unwrap_or(&library).display());
    let cc =
        cmd!(sh, "cc -std=c99 -O1 -I include -o {program} tests/c/hostile.c {library} {rpath}");
    cc.run().context("a C compiler (cc) is missing, or it fails")?;
    Ok(Command::new(program))
}

/// Runs the program of a border, with the streams as its input if they come from a `writer`.
fn decode(border: &'static str, mut command: Command, writer: Option<Command>) -> Result<Outcome> {
    let started = Instant::now();
    let mut feeding = None;
    if let Some(mut writer) = writer {
        let mut child = writer.stdout(Stdio::piped()).spawn().context("start the writer")?;
        command.stdin(child.stdout.take().context("the writer has an output")?);
        feeding = Some(child);
    }
    let out = command.stderr(Stdio::inherit()).output().with_context(|| format!("{command:?}"))?;
    // Its end of the pipe is closed with the command: a writer that is not done ends.
    drop(command);
    if let Some(mut child) = feeding {
        child.wait()?;
    }
    ensure!(out.status.success(), "{border}: {}", out.status);
    let figures =
        serde_json::from_slice(&out.stdout).with_context(|| format!("{border}: no figures"))?;
    Ok(Outcome { border, seconds: started.elapsed().as_secs_f64(), figures })
}

/// What failed, and where a border is not like the first.
fn differing(outcomes: &[Outcome]) -> Vec<String> {
    let mut out = Vec::new();
    for outcome in outcomes {
        let border = outcome.border;
        if outcome.failed() > 0 {
            out.push(format!("{border}: streams {} failed", outcome.figures["failed"]));
        }
        for name in ["accepted", "digest", "scenes"] {
            let (found, first) = (&outcome.figures[name], &outcomes[0].figures[name]);
            if !found.is_null() && found != first {
                out.push(format!("{border}: {name} is {found}, not {first}"));
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_border_that_differs_or_fails_is_named() {
        let outcome = |border, figures: &str| {
            let figures = serde_json::from_str(figures).expect("JSON");
            Outcome { border, seconds: 0.0, figures }
        };
        let rust = outcome("Rust", r#"{"failed": [], "accepted": 1, "digest": 3, "scenes": 4}"#);
        let same = outcome("C", r#"{"failed": [], "accepted": 1, "scenes": 4}"#);
        let other = outcome("Python", r#"{"failed": [7], "accepted": 1, "scenes": 5}"#);
        let found = differing(&[rust, same, other]);
        assert_eq!(found, ["Python: streams [7] failed", "Python: scenes is 5, not 4"]);
    }
}
