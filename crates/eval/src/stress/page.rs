//! The page of docs/results on exactness.

use std::time::Duration;

use super::precision::Figure;
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
pub(super) fn page(
    args: &StressOptions,
    runs: &[Run],
    figures: &[Figure],
    elapsed: Duration,
) -> Page {
    let refused = runs.iter().filter(|r| r.refused().is_some()).count();
    let mut page = Page::new(&args.out, "How exact?");
    page.text(format!(
        "`cargo xtask stress` takes scenes of {} Gaussians (unless the input fixes it) from PLY to PLY, in {} modes: gsvx (at the default quality where none is named), the paper's codec, W2 barycenters. {} runs were accepted, {refused} refused with an error, \
         none failed, in {:.0} s.",
        args.size,
        super::MODES.len(),
        runs.len() - refused,
        elapsed.as_secs_f64(),
    ));
    page.text(
        "Errors are over their bounds in [accuracy.md](../accuracy.md); the command fails above 1.",
    );
    let mut table = Table::new("attribute | runs | median | greatest | where");
    for Attribute { name, ratios } in attributes(runs) {
        let (median, (worst, input, mode)) = (ratios[ratios.len() / 2].0, ratios[ratios.len() - 1]);
        let place = if worst > 0.0 { format!("{input}, {mode}") } else { "-".into() };
        let [median, worst] = [median, worst].map(|r| format!("{r:.2}"));
        table.row(format!("{name} | {} | {median} | {worst} | {place}", ratios.len()));
    }
    page.table(&table);
    let mut everywhere = 0;
    // Inputs that are refused, by how many modes and what refuses them.
    let mut refused: Vec<(String, Vec<&str>)> = Vec::new();
    for of in runs.chunk_by(|a, b| a.input == b.input) {
        let accepted = of.iter().filter(|r| r.refused().is_none()).count();
        let mut parts: Vec<&str> = of.iter().filter_map(Run::refused).collect();
        parts.dedup();
        if accepted == of.len() {
            everywhere += 1;
            continue;
        }
        let parts = if parts.is_empty() { "-".into() } else { parts.join(", ") };
        let by = format!("{accepted} of {} | {parts}", of.len());
        match refused.iter_mut().find(|(same, _)| *same == by) {
            Some((_, inputs)) => inputs.push(of[0].input),
            None => refused.push((by, vec![of[0].input])),
        }
    }
    let mut table = Table::new("inputs | modes that accept them | refused by");
    for (by, inputs) in refused {
        table.row(format!("{} | {by}", inputs.join(", ")));
    }
    page.text(format!("Every mode accepts {everywhere} inputs. Not these:"));
    page.table(&table);
    single_precision(&mut page, args, figures);
    page
}

/// Each stage, and where it is worst.
fn single_precision(page: &mut Page, args: &StressOptions, figures: &[Figure]) {
    page.text("## Single precision");
    page.text(format!(
        "Stages against the same formulae in double precision, on inputs where precision gives way, sums of {:.0e} terms among them. \
         The greatest error over its bound is {:.2}.",
        args.many as f64,
        figures.iter().map(|f| f.ratio).fold(0.0, f64::max),
    ));
    let mut table = Table::new(
        "what, unit | first input | greatest error | where | greatest error / bound | where",
    );
    for stage in distinct(figures.iter().map(|f| f.stage)) {
        let of: Vec<&Figure> = figures.iter().filter(|f| f.stage == stage).collect();
        let most = |by: fn(&Figure) -> f64| of.iter().max_by(|a, b| by(a).total_cmp(&by(b)));
        let (Some(error), Some(ratio)) = (most(|f| f.error), most(|f| f.ratio)) else { continue };
        table.row(format!(
            "{stage} | {:.1e} | {:.1e} | {} | {:.2} | {}",
            of[0].error, error.error, error.input, ratio.ratio, ratio.input
        ));
    }
    page.data("Each stage:", table);
}

/// Each once, in order.
fn distinct(all: impl Iterator<Item = &'static str>) -> Vec<&'static str> {
    let mut out = Vec::new();
    for one in all {
        if !out.contains(&one) {
            out.push(one);
        }
    }
    out
}
