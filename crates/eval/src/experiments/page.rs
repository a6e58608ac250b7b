//! What the pages of all experiments have in common.

use super::Inputs;
use crate::chart::{Chart, Kind, Series};
use crate::published::Other;
use crate::rd_curve::record::{Curve, Tuned};
use crate::report::sections::{self, PUBLISHED_NOTE, UNITS};
use crate::report::{Block, Document, Section, Table, run};

/// PSNR over size: our curves, then the others'.
pub(super) fn chart(inputs: &Inputs<'_>, title: &str, curves: &[Curve], others: &[Other]) -> Chart {
    let mut all: Vec<Series> = curves.iter().map(line).collect();
    let largest = all.iter().flat_map(|s| &s.points).map(|p| p.0).fold(0.0, f64::max);
    all.extend(sections::other_series(others, run::WIDEST * largest));
    let title = format!("{}: {title}", inputs.scene());
    run::chart(title, all, inputs.original.score.psnr_db)
}

fn line(curve: &Curve) -> Series {
    let mut points = curve.rates();
    points.sort_by(|a, b| a.rate.total_cmp(&b.rate));
    Series {
        name: curve.what.clone(),
        kind: Kind::Ours,
        points: points.iter().map(|p| (p.rate / 1e6, p.psnr_db)).collect(),
    }
}

/// The table of points.
pub(super) fn points(inputs: &Inputs<'_>, curves: &[Curve]) -> Section {
    let table = run::points(&inputs.original, curves);
    Section::open("Points", vec![Block::Text(UNITS.into()), Block::Table(table)])
}

/// The fine-tunes of the curves, one row each.
pub(super) fn tunes<'a>(
    inputs: &Inputs<'_>,
    models: impl Iterator<Item = (&'a str, usize, &'a Tuned)>,
) -> Section {
    let original = inputs.original.score.psnr_db;
    let mut table = Table::new(&[
        "model",
        "Gaussians",
        "steps",
        "before dB",
        "after dB",
        "to original dB",
        "seconds",
        "processor s",
        "memory MB",
    ]);
    for (name, gaussians, tuned) in models {
        let db = |x: Option<&(u64, f64)>| x.map_or(f64::NAN, |x| x.1);
        let (before, after) = (db(tuned.held_out_db.first()), db(tuned.held_out_db.last()));
        table.rows.push(vec![
            name.to_owned(),
            gaussians.to_string(),
            tuned.steps.to_string(),
            format!("{before:.3}"),
            format!("{after:.3}"),
            format!("{:+.3}", after - original),
            format!("{:.1}", tuned.seconds),
            format!("{:.1}", tuned.user_seconds),
            format!("{:.0}", tuned.peak_bytes as f64 / 1e6),
        ]);
    }
    let text = format!(
        "Mean PSNR at the held-out views, which the fine-tune never sees, before coding; the original model \
         reaches {original:.3} dB. One training view a step, {} of them; means frozen, the reference \
         implementation's loss and learning rates, decaying to a tenth. Seconds are of the steps alone, memory \
         is the process' peak meanwhile.",
        inputs.study.test.training.len()
    );
    Section::open("Fine-tune", vec![Block::Text(text), Block::Table(table)])
}

/// Fine-tunes of curves.
pub(super) fn tunes_of(curves: &[Curve]) -> impl Iterator<Item = (&str, usize, &Tuned)> {
    let mut seen: Vec<&str> = Vec::new();
    let models = curves.iter().flat_map(|c| &c.voxelized);
    models.filter_map(move |v| {
        let tuned = v.tuned.as_ref()?;
        let new = !seen.contains(&v.name.as_str());
        seen.push(&v.name);
        new.then_some((v.name.as_str(), v.gaussians, tuned))
    })
}

/// The others' points.
pub(super) fn others(others: &[Other]) -> Section {
    if others.is_empty() {
        return Section::folded("Others on this scene", Vec::new());
    }
    let mut blocks = Vec::new();
    if others.iter().any(Other::is_published) {
        blocks.push(Block::Text(PUBLISHED_NOTE.into()));
    }
    blocks.push(Block::Table(sections::others_table(others)));
    Section::folded("Others on this scene", blocks)
}

/// The whole page.
pub(super) fn document(
    inputs: &Inputs<'_>,
    title: &str,
    lead: String,
    highlights: Vec<(String, String)>,
    mut parts: Vec<Section>,
) -> Document {
    let (skipped, stages) = inputs.study.tally();
    parts.push(sections::provenance(&inputs.study.manifest(), skipped, stages));
    parts.retain(|s| !s.blocks.is_empty());
    Document { title: format!("{title}: {}", inputs.scene()), lead, highlights, sections: parts }
}

/// Prints the tables of a page.
pub(super) fn print(document: &Document) {
    println!("{}", document.title);
    for (figure, what) in &document.highlights {
        println!("  {figure}  {what}");
    }
    for section in &document.sections {
        let tables: Vec<&Table> = section
            .blocks
            .iter()
            .filter_map(|b| if let Block::Table(t) = b { Some(t) } else { None })
            .collect();
        for table in tables {
            println!("\n{}", section.title);
            print!("{}", table.plain());
        }
    }
}
