//! Fig. 7: what the initialisation by merged Gaussians is worth, and how near a fine-tune brings a
//! voxelized model to the original.

use anyhow::Result;

use super::{Inputs, Results, page, points};
use crate::chart::{Axis, Chart, Kind, Series};
use crate::published::NO_INIT;
use crate::rd_curve::record::{Tuned, Voxelized};
use crate::rd_curve::stages::Branch;
use crate::report::sections::{self, BD_TEXT};
use crate::report::{Block, Section};

/// A tuned model counts as recovered if it is within this many dB of the original.
const RECOVERED_DB: f64 = 0.1;

pub(super) fn run(inputs: &Inputs<'_>) -> Result<Results> {
    let depth = inputs.depth;
    let mut curves = Vec::new();
    for (initialised, name) in [(true, "initialised"), (false, "from nothing")] {
        let codings = inputs.paper_lossy().into_iter().chain(inputs.paper_lossless()).collect();
        let what = format!("uniform, J = {depth}, {name}, paper's coding");
        let parts = [(inputs.uniform(depth), codings)];
        curves.push(inputs.curve(name, what, &parts, inputs.tuning(initialised))?);
    }
    let mut models: Vec<Voxelized> = Vec::new();
    for depth in inputs.depths() {
        for voxels in [inputs.uniform(depth), inputs.adaptive(depth)] {
            for initialised in [true, false] {
                let branch = Branch::new(inputs.study, &voxels, inputs.tuning(initialised));
                models.push(branch.voxelized()?);
            }
        }
    }
    let tuned = || models.iter().filter_map(|m| m.tuned.as_ref().map(|t| (m, t)));
    let bd = vec![sections::compare(
        (&curves[0].name, &points(&curves[0])),
        (&curves[1].name, &points(&curves[1])),
    )];
    let others = inputs.others(|o| {
        // The paper shows the smaller of its depths here.
        let own = o.name.ends_with("J=11") || o.name.ends_with("J=15");
        own && (o.name.starts_with(NO_INIT) || o.name.starts_with("paper, uniform"))
    })?;
    let over_size =
        page::chart(inputs, "with and without initialisation (Fig. 7)", &curves, &others);
    let over_steps = steps_chart(inputs, "PSNR over steps of the fine-tune", tuned());
    let near = steps_chart(
        inputs,
        "the same, initialised models only",
        tuned().filter(|(_, t)| t.initialised),
    );
    let original = inputs.original.score.psnr_db;
    let lead = format!(
        "The paper's Fig. 7: voxelized models fine-tuned for {} steps, beginning with the attributes of the \
         merged Gaussians (averages weighted by what the training cameras see, covariances by matched moments) \
         or with none, at equal steps; uniform and adaptive at two depths. The original model reaches \
         {original:.3} dB.",
        inputs.steps
    );
    let parts = vec![
        Section::open(
            "PSNR over steps",
            vec![
                Block::Chart(over_steps, "init-steps".into()),
                Block::Chart(near, "init-steps-near".into()),
            ],
        ),
        page::tunes(inputs, tuned().map(|(m, t)| (m.name.as_str(), m.gaussians, t))),
        Section::open("Curves", vec![Block::Chart(over_size, "init".into())]),
        Section::open(
            "Bjontegaard difference",
            vec![Block::Text(BD_TEXT.into()), Block::Table(sections::bd_table(&bd))],
        ),
        page::points(inputs, &curves),
        page::others(&others),
    ];
    let title = "Initialisation (Fig. 7)";
    let highlights = highlights(inputs, tuned());
    let document = page::document(inputs, title, lead, highlights, parts);
    Ok(Results { document, curves, bd, others, tools: Vec::new() })
}

fn last_db(tuned: &Tuned) -> f64 {
    tuned.held_out_db.last().map_or(f64::NAN, |l| l.1)
}

fn highlights<'a>(
    inputs: &Inputs<'_>,
    models: impl Iterator<Item = (&'a Voxelized, &'a Tuned)>,
) -> Vec<(String, String)> {
    let original = inputs.original.score.psnr_db;
    let mut back: Vec<(&Voxelized, &Tuned)> =
        models.filter(|(_, t)| t.initialised && last_db(t) >= original - RECOVERED_DB).collect();
    // The smallest recovered model is reported.
    back.sort_by_key(|(m, _)| m.gaussians);
    match back.first() {
        Some((m, t)) => vec![(
            format!("{:+.2} dB", last_db(t) - original),
            format!(
                "from the original after {} steps: `{}`, {} Gaussians, {:.0} s",
                t.steps, m.what, m.gaussians, t.seconds
            ),
        )],
        None => vec![(
            "not recovered".into(),
            format!(
                "no model came within {RECOVERED_DB} dB of the original in {} steps",
                inputs.steps
            ),
        )],
    }
}

fn steps_chart<'a>(
    inputs: &Inputs<'_>,
    title: &str,
    models: impl Iterator<Item = (&'a Voxelized, &'a Tuned)>,
) -> Chart {
    let line = |(m, t): (&Voxelized, &Tuned)| Series {
        name: format!("{}, {}", m.what, if t.initialised { "initialised" } else { "from nothing" }),
        kind: if t.initialised { Kind::Ours } else { Kind::Theirs },
        points: t.held_out_db.iter().map(|&(step, db)| (step as f64, db)).collect(),
    };
    let original = inputs.original.score.psnr_db;
    Chart::new(
        format!("{}: {title}", inputs.scene()),
        Axis::linear("steps, one training view each"),
        Axis::linear("PSNR at held-out views, dB"),
        models.map(line).collect(),
        Some((original, format!("original model, {original:.2} dB"))),
    )
}
