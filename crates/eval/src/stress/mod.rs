//! Pathological scenes through the whole chain in every mode, each in a process of its own. Errors
//! are checked against the bounds of docs/accuracy.md.

mod chain;
mod inputs;
mod levels;

use std::fmt::Write as _;
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};
use chain::{MODES, Outcome};
use inputs::{HUGE, INPUTS, Input};

/// What [`run`] runs.
#[derive(Clone, Debug)]
pub struct Options {
    /// Only this input.
    pub input: Option<String>,
    /// Only this mode.
    pub mode: Option<String>,
    /// Gaussians of inputs that do not fix their number.
    pub size: usize,
    /// Also the input of ten million Gaussians: minutes per mode, several GB.
    pub all: bool,
    /// Seconds after which a run counts as hanging.
    pub timeout: u64,
    /// How to start a process that calls [`child`] with this input, mode and size.
    pub child: fn(&str, &str, usize) -> std::io::Result<Command>,
    /// Where the table goes, relative to the root of the workspace.
    pub out: PathBuf,
}

/// Gaussians of the huge input.
const TEN_MILLION: usize = 10_000_000;

fn size_of(input: &Input, args: &Options) -> usize {
    if input.name == HUGE { TEN_MILLION } else { args.size }
}

/// Runs every input in every mode, or what was asked for, and writes or prints the table.
///
/// # Errors
/// If a run fails, hangs or breaks a bound.
pub fn run(args: &Options) -> Result<()> {
    let wanted = |given: &Option<String>, name: &str| given.as_ref().is_none_or(|g| g == name);
    let inputs: Vec<&Input> = INPUTS
        .iter()
        .filter(|i| wanted(&args.input, i.name))
        .filter(|i| i.name != HUGE || args.all || args.input.is_some())
        .collect();
    let modes: Vec<&str> = MODES.into_iter().filter(|m| wanted(&args.mode, m)).collect();
    if inputs.is_empty() || modes.is_empty() {
        let names: Vec<_> = INPUTS.iter().map(|i| i.name).collect();
        bail!("no such input or mode; inputs: {}; modes: {}", names.join(", "), MODES.join(", "));
    }
    let started = Instant::now();
    let mut table = String::from(
        "| input | mode | outcome | worst error / bound | Gaussians out | bytes | s | CPU s | peak MB |\n\
         |---|---|---|---|---:|---:|---:|---:|---:|\n",
    );
    let (mut accepted, mut refused, mut failures) = (0, 0, Vec::new());
    for input in &inputs {
        for mode in &modes {
            match apart(input, mode, args) {
                Ok(outcome) => {
                    match outcome.refused {
                        Some(_) => refused += 1,
                        None => accepted += 1,
                    }
                    if outcome.worst.iter().any(|w| w.1 > 1.0 || w.1.is_nan()) {
                        failures.push(format!("{}, {mode}: {:?}", input.name, outcome.worst));
                    }
                    table += &row(input, mode, &outcome);
                }
                Err(e) => {
                    let e = format!("{e:#}").replace(['\n', '|'], " ");
                    let _ = writeln!(
                        table,
                        "| {} | {mode} | FAILED: {e} | - | - | - | - | - | - |",
                        input.name
                    );
                    failures.push(format!("{}, {mode}: {e}", input.name));
                }
            }
            eprint!("\r{accepted} accepted, {refused} refused, {} failed ", failures.len());
        }
    }
    eprintln!();
    if args.input.is_none() && args.mode.is_none() {
        let out = crate::scenes::root().join(&args.out);
        let text = report(args, &table, [accepted, refused, failures.len()], started.elapsed());
        std::fs::write(&out, text).with_context(|| format!("write {}", out.display()))?;
        println!("written: {}", out.display());
    } else {
        print!("{table}");
    }
    match failures.first() {
        None => Ok(()),
        Some(first) => bail!("{} of the runs broke a promise; the first: {first}", failures.len()),
    }
}

fn report(args: &Options, table: &str, counts: [usize; 3], elapsed: Duration) -> String {
    let [accepted, refused, failed] = counts;
    format!(
        "# Stress\n\n\
         `cargo xtask stress{}`: pathological scenes of {} Gaussians (where the input does not fix \
         the number) through PLY writer, strict reader, voxelization, encoder, decoder and writer, \
         default quality, each run in a process of its own. {accepted} runs accepted, {refused} \
         refused with an error, {failed} failed, in {:.0} s ({} threads, {}).\n\n\
         Errors are those of what was decoded against what was put in (means: the input's \
         Gaussians against the centres of their voxels; attributes: the merged Gaussians), \
         divided by the bounds of [accuracy.md](../accuracy.md): above 1 the command fails. \
         Refusals name the part that refused. `--lossless` skips the reader, and must give \
         back every bit, valid or not. Peak is the process's resident memory, the input and two \
         PLY files in memory included.\n\n{table}",
        if args.all { " --all" } else { "" },
        args.size,
        elapsed.as_secs_f64(),
        rayon::current_num_threads(),
        crate::manifest::processor(),
    )
}

fn row(input: &Input, mode: &str, o: &Outcome) -> String {
    let outcome = match &o.refused {
        Some(message) => format!("refused by {}", message.replace(['|', '\n'], " ")),
        None => "accepted".into(),
    };
    // The worst of each attribute.
    let mut worst: Vec<(String, f64)> = Vec::new();
    for (name, ratio) in &o.worst {
        match worst.iter_mut().find(|w| w.0 == *name) {
            Some(w) => w.1 = w.1.max(*ratio),
            None => worst.push((name.clone(), *ratio)),
        }
    }
    let worst = if worst.is_empty() {
        "-".into()
    } else {
        let parts: Vec<_> = worst.iter().map(|(n, r)| format!("{n} {r:.2}")).collect();
        parts.join(", ")
    };
    let number = |n: usize| if o.refused.is_some() { "-".into() } else { n.to_string() };
    format!(
        "| {} | {mode} | {outcome} | {worst} | {} | {} | {:.2} | {:.2} | {:.0} |\n",
        input.name,
        number(o.gaussians),
        number(o.bytes),
        o.seconds,
        o.cpu_seconds,
        o.peak_mb
    )
}

/// Runs one input in one mode in this process and prints the outcome as JSON. [`run`] starts it.
///
/// # Errors
/// If there is no such input, or the chain breaks a promise.
pub fn child(input: &str, mode: &str, size: usize) -> Result<()> {
    let input = INPUTS.iter().find(|i| i.name == input).context("no such input")?;
    let scene = input.scene(size);
    let (start, cpu) = (Instant::now(), crate::usage::cpu_seconds());
    let mut outcome = chain::run(&scene, mode)?;
    outcome.seconds = start.elapsed().as_secs_f64();
    outcome.cpu_seconds = crate::usage::cpu_seconds() - cpu;
    outcome.peak_mb = crate::usage::peak_mb();
    println!("{}", serde_json::to_string(&outcome)?);
    Ok(())
}

/// Runs one input in one mode in a process of its own.
fn apart(input: &Input, mode: &str, args: &Options) -> Result<Outcome> {
    let mut process = (args.child)(input.name, mode, size_of(input, args))?
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()?;
    let start = Instant::now();
    // An outcome is far smaller than a pipe's buffer, so the child does not wait for it to be read.
    while process.try_wait()?.is_none() {
        if start.elapsed().as_secs() > args.timeout {
            process.kill()?;
            bail!("no end after {} s", args.timeout);
        }
        std::thread::sleep(Duration::from_millis(2));
    }
    let output = process.wait_with_output()?;
    if !output.status.success() {
        let text = String::from_utf8_lossy(&output.stderr);
        bail!("{}: {}", output.status, text.lines().next().unwrap_or("no message"));
    }
    serde_json::from_slice(&output.stdout).context("the child's outcome")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every input in every mode, small: errors within their bounds, refusals typed, no panic.
    #[test]
    fn every_input_in_every_mode() {
        for input in INPUTS {
            let scene = input.scene(if cfg!(debug_assertions) { 120 } else { 400 });
            for mode in MODES {
                let outcome = chain::run(&scene, mode)
                    .unwrap_or_else(|e| panic!("{}, {mode}: {e:#}", input.name));
                for (attribute, ratio) in &outcome.worst {
                    assert!(*ratio <= 1.0, "{}, {mode}: {attribute} {ratio}", input.name);
                }
            }
        }
    }

    /// Invalid scenes are refused. Valid ones are accepted, except one of SH coefficients beyond the limit.
    #[test]
    fn only_what_is_invalid_or_too_large_is_refused() {
        let refused: Vec<&str> = INPUTS
            .iter()
            .filter(|i| chain::run(&i.scene(100), "default").unwrap().refused.is_some())
            .map(|i| i.name)
            .collect();
        let invalid = [
            "one NaN mean",
            "one infinite mean",
            "one NaN opacity",
            "one infinite scale",
            "scale of zero (-inf)",
            "one NaN SH coefficient",
            "a zero quaternion",
            "a quaternion of -0",
            // Valid, but beyond what lossy coding takes (docs/accuracy.md).
            "SH coefficients +-3e38",
        ];
        assert_eq!(refused, invalid);
    }
}
