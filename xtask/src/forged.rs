//! `cargo xtask forged`: forged streams, each by its number, through every border: none may panic, trap or abort, and all
//! borders must make the same of each.
//!
//! The streams, and what Rust makes of them, are in `xtask/forged`, a package that also builds for 32 bits and WebAssembly.
//! There the golden streams follow, and on 32 bits the seeds of all fuzz targets, with mutations of each.
//! What cannot be had is skipped, and said.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Instant;

use anyhow::{Context, Result, bail, ensure};
use eval::cells;
use eval::page::{Page, Table};
use serde_json::Value;

use crate::needs::{Need, WASM};
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
    /// Write the figures as a page [of the results: docs/results/forged.md]
    #[arg(long, value_name = "FILE")]
    page: Option<PathBuf>,
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

    /// Mebibytes, where the program knows.
    fn peak(&self) -> String {
        let peak = self.figures["peak"].as_f64();
        peak.map_or("-".into(), |bytes| format!("{:.0}", bytes / f64::from(1 << 20)))
    }
}

/// Decodes the streams at every border that there is, and compares.
pub(crate) fn run(args: &ForgedArgs) -> Result<()> {
    let own = build(None, args.quick)?.join("gsvx-forged");
    let mut outcomes: Vec<Outcome> = Vec::new();
    let mut skipped = 0;
    let borders: [(&'static str, &dyn Fn() -> Result<Command>); 6] = [
        ("Rust, 64 bits", &|| Ok(numbered(Command::new(&own), args))),
        ("Rust, i686", &|| {
            Need::Target(I686).get()?;
            Ok(numbered(Command::new(build(Some(I686), args.quick)?.join("gsvx-forged")), args))
        }),
        ("Rust, wasm32 in Node", &|| {
            Need::Target(WASM).get()?;
            Need::Node.get()?;
            let mut node = Command::new("node");
            node.arg(package().join("run.mjs"));
            node.arg(build(Some(WASM), args.quick)?.join("gsvx_forged.wasm"));
            Ok(numbered(node, args))
        }),
        (C, &|| c_program(args)),
        (PYTHON, &|| python(args)),
        (NPM, &node),
    ];
    for (border, command) in borders {
        match command() {
            Ok(command) => {
                let is_fed = [C, PYTHON, NPM].contains(&border);
                let writer = is_fed.then(|| numbered(writer(&own), args));
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
    if let Err(why) = seeds(args.quick)? {
        eprintln!("SKIPPED: seeds of the fuzz targets on 32 bits: {why:#}");
        skipped += 1;
    }
    let differing = differing(&outcomes);
    ensure!(differing.is_empty(), "forged streams: {}", differing.join("; "));
    println!("{} streams, {} borders agree, {skipped} skipped", args.count, outcomes.len());
    match &args.page {
        Some(_) if skipped > 0 => bail!("the page needs every border"),
        Some(out) => write(out, args, &outcomes),
        None => Ok(()),
    }
}

fn package() -> PathBuf {
    eval::scenes::root().join("xtask/forged")
}

fn numbered(mut command: Command, args: &ForgedArgs) -> Command {
    command.args([args.first, args.count].map(|n| n.to_string()));
    command
}

fn writer(own: &Path) -> Command {
    let mut command = Command::new(own);
    command.arg("write");
    command
}

/// Mutations of each seed of a fuzz target.
const MUTATIONS: &str = "300";

/// Runs the seeds of the fuzz targets and mutations of them on 32 bits: none may fail, and unless it is to be quick, as many
/// are accepted as on this machine. The inner error says why nothing runs.
fn seeds(quick: bool) -> Result<Result<()>> {
    if let Err(why) = Need::Target(I686).get() {
        return Ok(Err(why));
    }
    let fuzz = eval::scenes::root().join("xtask/fuzz");
    let accepted = |target: Option<&str>| {
        let made = built(&fuzz, &["--example", "seeds"], target, true)?;
        let mut seeds = Command::new(made.join("examples/seeds"));
        let out = seeds.arg(made.join("seeds")).arg(MUTATIONS).stderr(Stdio::inherit()).output()?;
        ensure!(out.status.success(), "seeds of the fuzz targets, {target:?}: {}", out.status);
        Ok(String::from_utf8(out.stdout)?)
    };
    let on_32_bits = accepted(Some(I686))?;
    if !quick {
        let here = accepted(None)?;
        ensure!(here == on_32_bits, "fuzz targets accept\n{here}and on 32 bits\n{on_32_bits}");
    }
    println!("Seeds of {} fuzz targets, i686: none failed", on_32_bits.lines().count());
    Ok(Ok(()))
}

/// Builds the package; returns the folder of what was made.
fn build(target: Option<&str>, quick: bool) -> Result<PathBuf> {
    // The library alone is what WebAssembly has.
    let what = if target == Some(WASM) { "--lib" } else { "--bins" };
    built(&package(), &[what], target, quick)
}

/// Builds what the words name of a package; returns the folder of what was made.
fn built(package: &Path, what: &[&str], target: Option<&str>, quick: bool) -> Result<PathBuf> {
    let mut made = eval::scenes::root().join("target/forged");
    let mut cargo = Command::new("cargo");
    cargo.current_dir(package).args(["build", "--quiet", "--target-dir"]).arg(&made).args(what);
    if let Some(target) = target {
        cargo.args(["--target", target]);
        made.push(target);
    }
    if !quick {
        cargo.arg("--release");
    }
    let status = cargo.status().context("start cargo")?;
    ensure!(status.success(), "{}: does not build for {target:?}", package.display());
    Ok(made.join(if quick { "debug" } else { "release" }))
}

/// A program in C against the library.
fn c_program(args: &ForgedArgs) -> Result<Command> {
    let root = eval::scenes::root();
    let made = root.join("target/forged");
    let library = match &args.library {
        Some(library) => library.canonicalize().with_context(|| library.display().to_string())?,
        None => {
            let mut cargo = Command::new("cargo");
            cargo.current_dir(&root).args(["build", "--quiet", "-p", "gsvx-c", "--target-dir"]);
            ensure!(cargo.arg(&made).status()?.success(), "gsvx-c does not build");
            let [before, after] = [std::env::consts::DLL_PREFIX, std::env::consts::DLL_SUFFIX];
            made.join(format!("debug/{before}gsvx_c{after}"))
        }
    };
    let (source, program) = (root.join("crates/gsvx-c"), made.join("hostile"));
    let folder = library.parent().context("a library is in a folder")?;
    let mut cc = Command::new("cc");
    cc.args(["-std=c99", "-O1", "-I"]).arg(source.join("include")).arg("-o").arg(&program);
    cc.arg(source.join("tests/c/hostile.c")).arg(&library);
    cc.arg(format!("-Wl,-rpath,{}", folder.display()));
    ensure!(cc.status().context("a C compiler (cc) is missing")?.success(), "cc failed");
    Ok(Command::new(program))
}

fn python(args: &ForgedArgs) -> Result<Command> {
    let mut has = Command::new(&args.python);
    has.args(["-c", "import gsvx"]).stderr(Stdio::null());
    let python = args.python.display();
    let install =
        "install it with `pip install ./crates/gsvx-py` and name the interpreter with --python";
    ensure!(has.status().is_ok_and(|s| s.success()), "{python} has no package gsvx: {install}");
    let mut command = Command::new(&args.python);
    command.arg(package().join("decode.py"));
    Ok(command)
}

fn node() -> Result<Command> {
    Need::Node.get()?;
    let folder = npm::folder();
    ensure!(folder.join("wasm").is_dir(), "the npm package is not built: run `cargo xtask web`");
    let mut command = Command::new("node");
    command.arg(package().join("decode.mjs")).arg(folder);
    Ok(command)
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

fn write(out: &Path, args: &ForgedArgs, outcomes: &[Outcome]) -> Result<()> {
    let mut page = Page::new(out, "Forged streams");
    let count = args.count;
    page.text(format!(
        "`cargo xtask forged --page {}`: {count} streams that no encoder writes, most with right checksums, some with \
         claims of up to 2^63 Gaussians, decoded at every border: whole, with salvage, in Rust also in parts, at another \
         level of detail, and on after errors. None may panic, trap or abort.",
        out.display(),
    ));
    let mut table = Table::new("border | streams | a scene came out | failures | memory, MiB");
    for o in outcomes {
        table.row(cells![o.border, count, o.figures["accepted"], o.failed(), o.peak()]);
    }
    page.table(&table);
    page.text(
        "The first three agree on every float and on every word of every error, of the golden streams too, and the first two and the last three on \
         every scene. Memory is the most that the process had; in WebAssembly, that of the instance.",
    );
    page.write()
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
