//! The page of docs/results on exactness.

use std::time::Duration;

use super::{Run, StressOptions};
use crate::page::{Page, Table};

/// One attribute over all accepted runs.
struct Attribute {
    name: &'static str,
    /// Error over bound with input and mode, ascending.
    ratios: Vec<(f64, &'static str, &'static str)>,
}

fn attributes(runs: &[Run]) -> Vec<Attribute> {
    let mut out: Vec<Attribute> = Vec::new();
    for run in runs {
        for &(name, ratio) in run.worst() {
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
pub(super) fn page(args: &StressOptions, runs: &[Run], elapsed: Duration) -> Page {
    let refused = runs.iter().filter(|r| r.refused().is_some()).count();
    let mut page = Page::new(&args.out, "How exact?");
    page.text(format!(
        "`cargo xtask stress` takes pathological scenes of {} Gaussians (where the input does not fix the number) \
         from PLY to PLY, in {} modes: gsvx at the default quality unless a mode names another, the paper's codec, and W2 barycenters. {} runs were accepted, {refused} refused with an error, \
         none failed, in {:.0} s.",
        args.size,
        super::MODES.len(),
        runs.len() - refused,
        elapsed.as_secs_f64(),
    ));
    page.text(
        "Each error is divided by its bound in [accuracy.md](../accuracy.md); the command fails above 1. A mean at the edge of its cell reaches 1.",
    );
    let mut table = Table::new("attribute | runs | median error / bound | greatest | where");
    for Attribute { name, ratios } in attributes(runs) {
        let (median, (worst, input, mode)) = (ratios[ratios.len() / 2].0, ratios[ratios.len() - 1]);
        let place = if worst > 0.0 { format!("{input}, {mode}") } else { "-".into() };
        let [median, worst] = [median, worst].map(|r| format!("{r:.2}"));
        table.row(format!("{name} | {} | {median} | {worst} | {place}", ratios.len()));
    }
    page.table(&table);
    let mut everywhere = Vec::new();
    let mut table = Table::new("input | modes that accept it | refused by");
    for of in runs.chunk_by(|a, b| a.input == b.input) {
        let accepted = of.iter().filter(|r| r.refused().is_none()).count();
        let mut parts: Vec<&str> = of.iter().filter_map(Run::refused).collect();
        parts.dedup();
        if accepted == of.len() {
            everywhere.push(of[0].input);
            continue;
        }
        let parts = if parts.is_empty() { "-".into() } else { parts.join(", ") };
        table.row(format!("{} | {accepted} of {} | {parts}", of[0].input, of.len()));
    }
    page.text(format!("Inputs that every mode accepts: {}. Others:", everywhere.join("; ")));
    page.table(&table);
    page
}
