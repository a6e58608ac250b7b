//! The page of docs/results on exactness, and the table of all runs.

use std::time::Duration;

use super::{Run, StressOptions};
use crate::cells;
use crate::chart::{Axis, Chart, Series};
use crate::page::{Page, Table};

/// All runs, a row each.
pub(super) fn table(runs: &[Run]) -> Table {
    let mut table = Table::new(
        "input | mode | outcome | worst error / bound | Gaussians out | bytes | s | peak MB",
    );
    runs.iter().for_each(|run| table.row(row(run)));
    table
}

fn row(run: &Run) -> Vec<String> {
    let o = match &run.outcome {
        Ok(outcome) => outcome,
        Err(why) => {
            return cells![run.input, run.mode, format!("FAILED: {why}"), "-", "-", "-", "-", "-"];
        }
    };
    let outcome = match &o.refused {
        Some(message) => format!("refused by {}", message.replace(['|', '\n'], " ")),
        None => "accepted".into(),
    };
    let worst: Vec<_> = run.worst().iter().map(|(n, r)| format!("{n} {r:.2}")).collect();
    let worst = if worst.is_empty() { "-".into() } else { worst.join(", ") };
    let number = |n: usize| if o.refused.is_some() { "-".into() } else { n.to_string() };
    let (gaussians, bytes) = (number(o.gaussians), number(o.bytes));
    let (seconds, peak) = (format!("{:.2}", o.seconds), format!("{:.0}", o.peak_mb));
    cells![run.input, run.mode, outcome, worst, gaussians, bytes, seconds, peak]
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
pub(super) fn page(args: &StressOptions, runs: &[Run], elapsed: Duration, details: &str) -> Page {
    let count = |of: &dyn Fn(&Run) -> bool| runs.iter().filter(|r| of(r)).count();
    let refused = count(&|r| r.refused().is_some());
    let failed = count(&|r| r.outcome.is_err());
    let mut page = Page::new(&args.out, "How exact?");
    page.text(format!(
        "`cargo xtask stress{}` takes pathological scenes of {} Gaussians (where the input does not fix the number) \
         from PLY to PLY, at the default quality, in {} modes. {} runs were accepted, {refused} refused with an error, \
         {failed} failed, in {:.0} s. All rows are in `{details}` after the run.",
        if args.all { " --all" } else { "" },
        args.size,
        super::MODES.len(),
        runs.len() - refused - failed,
        elapsed.as_secs_f64(),
    ));
    page.text(
        "Each error is divided by its bound in [accuracy.md](../accuracy.md); the command fails above 1. A mean at the \
         edge of its cell reaches 1. `--lossless` takes any floats, valid or not, and returns every bit.",
    );
    page.chart("", chart(runs));
    let mut table = Table::new("attribute | runs | median error / bound | greatest | where");
    for Attribute { name, ratios } in attributes(runs) {
        let (median, (worst, input, mode)) = (ratios[ratios.len() / 2].0, ratios[ratios.len() - 1]);
        let place = if worst > 0.0 { format!("{input}, {mode}") } else { "-".into() };
        let [median, worst] = [median, worst].map(|r| format!("{r:.2}"));
        table.row(cells![name, ratios.len(), median, worst, place]);
    }
    page.table(&table);
    let mut everywhere = Vec::new();
    let mut table = Table::new("input | modes that accept it | refused by");
    for of in runs.chunk_by(|a, b| a.input == b.input) {
        let accepted = of.iter().filter(|r| r.refused().is_none() && r.outcome.is_ok()).count();
        let mut parts: Vec<&str> = of.iter().filter_map(Run::refused).collect();
        parts.dedup();
        if accepted == of.len() {
            everywhere.push(of[0].input);
            continue;
        }
        let parts = if parts.is_empty() { "-".into() } else { parts.join(", ") };
        table.row(cells![of[0].input, format!("{accepted} of {}", of.len()), parts]);
    }
    page.text(format!("Inputs that every mode accepts: {}. Others:", everywhere.join("; ")));
    page.table(&table);
    page
}

/// Error over bound of the accepted runs, sorted, a line for each attribute that has errors.
fn chart(runs: &[Run]) -> Chart {
    let line = |a: Attribute| Series::sorted(&a.name, a.ratios.iter().map(|r| r.0).collect());
    let all = attributes(runs).into_iter().filter(|a| a.ratios.iter().any(|r| r.0 > 0.0));
    let axes = ["accepted runs, sorted, per cent", "error / bound"].map(Axis::linear);
    let title = "Error over bound of every accepted run, sorted";
    Chart::new(title, axes, all.map(line), Some((1.0, "bound".into())))
}
