//! What the pages of all experiments have in common.

use super::{Inputs, Results};
use crate::chart::Chart;
use crate::measure::Metric;
use crate::published::Other;
use crate::rd_curve::record::{Curve, VoxelizedRecord};
use crate::report::{Block, Document, Section, run, sections, tunes};

/// PSNR over size: our curves in words, then the others'.
pub(super) fn curves(
    inputs: &Inputs<'_>,
    title: &str,
    curves: &[Curve],
    others: &[Other],
    stem: &str,
) -> Section {
    let title = format!("{}: {title}", inputs.scene());
    let in_words = |c: &Curve| Curve { name: c.what.clone(), ..c.clone() };
    let curves: Vec<Curve> = curves.iter().rev().map(in_words).collect();
    let original = (Metric::Psnr, inputs.original.score.psnr_db);
    let chart: Chart = run::curves_and_others(title, &curves, others, original);
    Section::open("Curves", vec![Block::Chart(chart, stem.into())])
}

/// The fine-tunes of models, one row each.
pub(super) fn tunes<'a>(
    inputs: &Inputs<'_>,
    models: impl IntoIterator<Item = &'a VoxelizedRecord>,
) -> Section {
    let text = format!(
        "Mean PSNR at the held-out views, which the fine-tune never sees, before coding; the original model \
         reaches {:.3} dB. One training view a step, {} of them; means frozen, the reference \
         implementation's loss and learning rates, decaying to a tenth. Seconds are of the steps alone, memory \
         is the process' peak meanwhile.",
        inputs.original.score.psnr_db,
        inputs.study.test.training.len()
    );
    let table = tunes::table(tunes::of(models), &inputs.original);
    Section::open("Fine-tune", vec![Block::Text(text), Block::Table(table)])
}

/// The whole page.
pub(super) fn document(inputs: &Inputs<'_>, results: Results) -> Document {
    let Results { title, lead, highlights, mut sections, curves, others, .. } = results;
    let (skipped, stages) = inputs.study.tally();
    sections.extend([
        run::points(&inputs.original, &curves),
        sections::others(&others),
        sections::provenance(&inputs.study.manifest(), skipped, stages),
    ]);
    sections.retain(|s| !s.blocks.is_empty());
    Document { title: format!("{title}: {}", inputs.scene()), lead, highlights, sections }
}
