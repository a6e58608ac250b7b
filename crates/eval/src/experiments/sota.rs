//! Fig. 9: this codec against others, recorded, published, and run here.

use anyhow::Result;

use super::{Inputs, Results, page, points};
use crate::bd;
use crate::peers;
use crate::published::NO_INIT;
use crate::rd_curve::plan::{Coding, Voxels};
use crate::rd_curve::record::{Bd, Curve};
use crate::report::sections::{self, BD_TEXT};
use crate::report::{Block, Section, run};

pub(super) fn run(inputs: &Inputs<'_>) -> Result<Results> {
    let each: Vec<(Voxels, Vec<Coding>)> =
        inputs.qualities.iter().map(|&q| (inputs.default(q), vec![Coding::Quality(q)])).collect();
    let mut curves = Vec::new();
    let what = format!("gsvx, default, fine-tuned for {} steps", inputs.steps);
    curves.push(inputs.curve(
        "gsvx, fine-tuned",
        what,
        &inputs.tuned_parts(),
        inputs.tuning(true),
    )?);
    curves.push(inputs.curve("gsvx", "gsvx, default, no fine-tune".into(), &each, None)?);
    let adaptive = inputs.adaptive(inputs.depth);
    let what = format!("{}, fine-tuned, paper's coding", adaptive.what);
    let codings = inputs.paper_lossy().into_iter().chain(inputs.paper_lossless()).collect();
    let parts = [(adaptive, codings)];
    curves.push(inputs.curve("paper's criteria and coding", what, &parts, inputs.tuning(true))?);

    let tools = inputs.study.peers(&inputs.options.peers, inputs.depth)?;
    // Of the paper's own lists, Fig. 9 has the adaptive ones.
    let mut others =
        inputs.others(|o| !o.name.starts_with(NO_INIT) && !o.name.starts_with("paper, uniform"))?;
    others.extend(peers::curves(&tools));
    let mut bd = Vec::new();
    for other in others.iter().filter(|o| o.points.len() >= 4 && !o.is_published()) {
        for curve in &curves {
            bd.push(sections::compare(
                (&curve.name, &points(curve)),
                (&other.name, &other.rates()),
            ));
        }
    }
    bd.push(sections::compare(
        (&curves[0].name, &points(&curves[0])),
        (&curves[1].name, &points(&curves[1])),
    ));
    let chart = page::chart(inputs, "against other codecs (Fig. 9)", &curves, &others);
    let lead = format!(
        "The paper's Fig. 9: this codec, with {} steps of fine-tune and without any, the paper's way of coding on \
         its adaptive voxelization (fine-tuned alike), and other codecs on the same model: recorded beside the \
         scene, run here where their tools are at hand, published where the scene is the paper's.",
        inputs.steps
    );
    let parts = vec![
        Section::open("Curves", vec![Block::Chart(chart, "sota".into())]),
        equal_quality(&curves, &others),
        Section::open(
            "Bjontegaard differences",
            vec![Block::Text(BD_TEXT.into()), Block::Table(sections::bd_table(&bd))],
        ),
        if tools.is_empty() {
            Section::open("Peers in this run", Vec::new())
        } else {
            run::peers(&tools)
        },
        page::tunes(inputs, page::tunes_of(&curves)),
        page::points(inputs, &curves),
        page::others(&others),
    ];
    let highlights = highlights(&bd);
    let document = page::document(inputs, "State of the art (Fig. 9)", lead, highlights, parts);
    Ok(Results { document, curves, bd, others, tools })
}

fn highlights(bd: &[Bd]) -> Vec<(String, String)> {
    let own = bd.iter().filter(|b| b.test == "gsvx" || b.test == "gsvx, fine-tuned");
    let figure = |b: &Bd| b.rate_pchip.or(b.rate_cubic);
    own.filter_map(|b| figure(b).map(|x| (b, x)))
        .map(|(b, x)| {
            (
                format!("{x:+.0} %"),
                format!("bytes of `{}` at equal PSNR, against {}", b.test, b.anchor),
            )
        })
        .collect()
}

/// For each point of another codec on the same model, our bytes at its PSNR (linear between the
/// points of the hull).
fn equal_quality(curves: &[Curve], others: &[crate::published::Other]) -> Section {
    let mut header = vec!["codec", "settings", "bytes", "PSNR dB"];
    let names: Vec<String> =
        curves.iter().take(2).map(|c| format!("{}: bytes at that PSNR", c.name)).collect();
    header.extend(names.iter().map(String::as_str));
    let mut table = crate::report::Table::new(&header);
    let same = others.iter().filter(|o| !o.is_published());
    for other in same.filter(|o| o.name != crate::published::PAPER_CHAIN) {
        for p in &other.points {
            let mut row = vec![
                other.name.clone(),
                p.label.clone(),
                p.bytes.to_string(),
                format!("{:.3}", p.psnr_db),
            ];
            for curve in curves.iter().take(2) {
                let bytes = bd::rate_at(&points(curve), p.psnr_db);
                row.push(bytes.map_or("-".into(), |b| {
                    format!("{b:.0} ({:.0} %)", 100.0 * b / p.bytes.max(1) as f64)
                }));
            }
            table.rows.push(row);
        }
    }
    if table.rows.is_empty() {
        return Section::open("Bytes at equal PSNR", Vec::new());
    }
    let text = "Our bytes are read off the hull of our points, linearly between them. A dash: our points do not \
                reach that PSNR, or begin above it.";
    Section::open("Bytes at equal PSNR", vec![Block::Text(text.into()), Block::Table(table)])
}
