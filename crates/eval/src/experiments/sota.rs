//! Fig. 9: this codec against others, recorded, published, and run here.

use anyhow::Result;

use super::{Inputs, Results, compare, page};
use crate::bd;
use crate::cells;
use crate::measure::Metric;
use crate::page::Table;
use crate::published::{NO_INIT, Other, PAPER_CHAIN};
use crate::rd_curve::plan::{Coding, Voxels};
use crate::rd_curve::record::{Bd, Curve};
use crate::report::{Block, Section, sections};

pub(super) fn run(inputs: &Inputs<'_>) -> Result<Results> {
    let each: Vec<(Voxels, Vec<Coding>)> =
        inputs.qualities.iter().map(|&q| (inputs.default(q), vec![Coding::Quality(q)])).collect();
    let (tuning, steps) = (inputs.tuning(true), inputs.steps);
    let what = format!("gsvx, default, fine-tuned for {steps} steps");
    let tuned = inputs.curve("gsvx, fine-tuned", what, &inputs.tuned_parts(), tuning)?;
    let plain = inputs.curve("gsvx", "gsvx, default, no fine-tune".into(), &each, None)?;
    let adaptive = inputs.adaptive(inputs.depth);
    let what = format!("{}, fine-tuned, paper's coding", adaptive.what);
    let parts = [(adaptive, inputs.paper())];
    let paper = inputs.curve("paper's criteria and coding", what, &parts, tuning)?;
    let curves = vec![tuned, plain, paper];

    // Of the paper's own lists, Fig. 9 has the adaptive ones.
    let others =
        inputs.others(|o| !o.name.starts_with(NO_INIT) && !o.name.starts_with("paper, uniform"))?;
    let mut bd: Vec<Bd> = Vec::new();
    for other in others.iter().filter(|o| o.is_comparable()) {
        bd.extend(
            curves.iter().map(|c| sections::compare(c, &other.name, |metric| other.rates(metric))),
        );
    }
    bd.push(compare(&curves[0], &curves[1]));
    let lead = format!(
        "The paper's Fig. 9: this codec, with {steps} steps of fine-tune and without any, the paper's way of coding on \
         its adaptive voxelization (fine-tuned alike), and other codecs on the same model: recorded beside the \
         scene, written here, published where the scene is the paper's."
    );
    let sections = vec![
        page::curves(inputs, "against other codecs (Fig. 9)", &curves, &others, "sota"),
        equal_quality(&curves[..2], &others),
        sections::differences("Bjontegaard differences", &bd),
        page::tunes(inputs, curves.iter().flat_map(|c| &c.voxelized)),
    ];
    let (title, highlights) = ("State of the art (Fig. 9)", highlights(&bd));
    Ok(Results { title, lead, highlights, sections, curves, bd, others })
}

fn highlights(bd: &[Bd]) -> Vec<(String, String)> {
    let own = bd.iter().filter(|b| b.test == "gsvx" || b.test == "gsvx, fine-tuned");
    let figure = |b: &Bd| {
        let says = format!("bytes of `{}` at equal PSNR, against {}", b.test, b.anchor);
        b.rates[0].map(|rate| (format!("{rate:+.0} %"), says))
    };
    own.filter_map(figure).collect()
}

/// For each point of another codec on the same model, our bytes at its PSNR (linear between the
/// points of the hull).
fn equal_quality(curves: &[Curve], others: &[Other]) -> Section {
    let names = curves.iter().map(|c| format!(" | {}: bytes at that PSNR", c.name));
    let mut table =
        Table::new(&format!("codec | settings | bytes | PSNR dB{}", names.collect::<String>()));
    let same = others.iter().filter(|o| !o.is_published() && o.name != PAPER_CHAIN);
    for (other, p) in same.flat_map(|o| o.points.iter().map(move |p| (o, p))) {
        let mut row = cells![other.name, p.label, p.bytes, format!("{:.3}", p.psnr_db)];
        row.extend(curves.iter().map(|curve| {
            let bytes = bd::rate_at(&curve.rates(Metric::Psnr), p.psnr_db);
            let share = |b: f64| 100.0 * b / p.bytes.max(1) as f64;
            bytes.map_or("-".into(), |b| format!("{b:.0} ({:.0} %)", share(b)))
        }));
        table.row(row);
    }
    let text = "Our bytes are read off the hull of our points, linearly between them. A dash: our points do not \
                reach that PSNR, or begin above it.";
    let blocks = match table.rows.is_empty() {
        true => Vec::new(),
        false => vec![Block::Text(text.into()), Block::Table(table)],
    };
    Section::open("Bytes at equal PSNR", blocks)
}
