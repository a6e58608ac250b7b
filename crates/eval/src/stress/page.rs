//! The page of docs/results on exactness, and the table of all runs.

use std::time::Duration;

use super::{Options, Run};
use crate::chart::{Axis, Chart, Series};

/// All runs, a row each.
pub(super) fn table(runs: &[Run]) -> String {
    let mut out = String::from(
        "| input | mode | outcome | worst error / bound | Gaussians out | bytes | s | CPU s | peak MB |\n\
         |---|---|---|---|---:|---:|---:|---:|---:|\n",
    );
    runs.iter().for_each(|run| out += &row(run));
    out
}

fn row(run: &Run) -> String {
    let o = match &run.outcome {
        Ok(outcome) => outcome,
        Err(why) => {
            return format!(
                "| {} | {} | FAILED: {why} | - | - | - | - | - | - |\n",
                run.input, run.mode
            );
        }
    };
    let outcome = match &o.refused {
        Some(message) => format!("refused by {}", message.replace(['|', '\n'], " ")),
        None => "accepted".into(),
    };
    let worst: Vec<_> = run.worst().iter().map(|(n, r)| format!("{n} {r:.2}")).collect();
    let worst = if worst.is_empty() { "-".into() } else { worst.join(", ") };
    let number = |n: usize| if o.refused.is_some() { "-".into() } else { n.to_string() };
    format!(
        "| {} | {} | {outcome} | {worst} | {} | {} | {:.2} | {:.2} | {:.0} |\n",
        run.input,
        run.mode,
        number(o.gaussians),
        number(o.bytes),
        o.seconds,
        o.cpu_seconds,
        o.peak_mb
    )
}

/// One attribute over all accepted runs.
struct Attribute {
    name: String,
    /// Error over bound with input and mode, ascending.
    ratios: Vec<(f64, &'static str, &'static str)>,
}

fn attributes(runs: &[Run]) -> Vec<Attribute> {
    let mut out: Vec<Attribute> = Vec::new();
    for run in runs {
        for (name, ratio) in run.worst() {
            let entry = (ratio, run.input, run.mode);
            match out.iter_mut().find(|a| a.name == name) {
                Some(a) => a.ratios.push(entry),
                None => out.push(Attribute { name, ratios: vec![entry] }),
            }
        }
    }
    out.iter_mut().for_each(|a| a.ratios.sort_by(|a, b| a.0.total_cmp(&b.0)));
    out
}

/// The page.
pub(super) fn page(args: &Options, runs: &[Run], elapsed: Duration, details: &str) -> String {
    let count = |of: &dyn Fn(&Run) -> bool| runs.iter().filter(|r| of(r)).count();
    let refused = count(&|r| r.refused().is_some());
    let failed = count(&|r| r.outcome.is_err());
    let mut out = format!(
        "# How exact?\n\n\
         `cargo xtask stress{}` takes pathological scenes of {} Gaussians (where the input does not \
         fix the number) through PLY writer, strict reader, voxelization, encoder, decoder and \
         writer, at the default quality, in {} modes. {} runs were accepted, {refused} refused with \
         an error, {failed} failed, in {:.0} s. All rows are in `{details}` after the run.\n\n\
         Each error is divided by its bound in [accuracy.md](../accuracy.md); the command fails above \
         1. Means are compared with those of the input, attributes with those of the merged Gaussians \
         that the encoder was given. A mean at the edge of its cell and an integer halfway between two others \
         reach their bounds, 1. \
         `--lossless` takes any floats, valid or not, and returns every bit.\n\n\
         {}\n\n\
         | attribute | runs | median error / bound | greatest | where |\n|---|---:|---:|---:|---|\n",
        if args.all { " --all" } else { "" },
        args.size,
        super::MODES.len(),
        runs.len() - refused - failed,
        elapsed.as_secs_f64(),
        crate::page::picture(&args.out, "Error over bound of every accepted run, sorted"),
    );
    for Attribute { name, ratios } in attributes(runs) {
        let (median, (worst, input, mode)) = (ratios[ratios.len() / 2].0, ratios[ratios.len() - 1]);
        let place = if worst > 0.0 { format!("{input}, {mode}") } else { "-".into() };
        out += &format!("| {name} | {} | {median:.2} | {worst:.2} | {place} |\n", ratios.len());
    }
    out += "\n| input | modes that accept it | refused by | greatest error / bound, but for the \
            two that reach it |\n\
            |---|---:|---|---:|\n";
    for of in runs.chunk_by(|a, b| a.input == b.input) {
        out += &input_row(of);
    }
    out
}

/// Attributes whose errors reach their bounds in any large scene: half a cell, half a unit.
const AT_THE_BOUND: [&str; 2] = ["mean", "covariance (integers)"];

/// The runs of one input.
fn input_row(runs: &[Run]) -> String {
    let accepted = runs.iter().filter(|r| r.refused().is_none() && r.outcome.is_ok()).count();
    let mut parts: Vec<&str> = runs.iter().filter_map(Run::refused).collect();
    parts.dedup();
    let others = runs.iter().flat_map(Run::worst).filter(|w| !AT_THE_BOUND.contains(&&*w.0));
    let worst = others.map(|w| w.1).fold(0.0, f64::max);
    format!(
        "| {} | {accepted} of {} | {} | {worst:.2} |\n",
        runs[0].input,
        runs.len(),
        if parts.is_empty() { "-".into() } else { parts.join(", ") },
    )
}

/// Error over bound of the accepted runs, sorted, a line for each attribute that has errors.
pub(super) fn chart(runs: &[Run]) -> Chart {
    let line = |a: Attribute| Series::sorted(&a.name, a.ratios.iter().map(|r| r.0).collect());
    let all = attributes(runs).into_iter().filter(|a| a.ratios.iter().any(|r| r.0 > 0.0));
    Chart::new(
        "Error over bound, pathological scenes",
        Axis::linear("accepted runs, sorted, per cent"),
        Axis::linear("error / bound"),
        all.map(line).collect(),
        Some((1.0, "bound".into())),
    )
}
