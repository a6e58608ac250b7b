//! Fig. 7: what the initialisation by merged Gaussians is worth, and how near a fine-tune brings a
//! voxelized model to the original.

use anyhow::Result;

use super::{Inputs, Results, compare, page};
use crate::published::NO_INIT;
use crate::rd_curve::record::VoxelizedRecord;
use crate::rd_curve::stages::Branch;
use crate::report::{Block, Section, sections, tunes};

/// A tuned model counts as recovered if it is within this many dB of the original.
const RECOVERED_DB: f64 = 0.1;

pub(super) fn run(inputs: &Inputs<'_>) -> Result<Results> {
    let depth = inputs.depth;
    let mut curves = Vec::new();
    for (initialised, name) in [(true, "initialised"), (false, "from nothing")] {
        let what = format!("uniform, J = {depth}, {name}, paper's coding");
        let parts = [(inputs.uniform(depth), inputs.paper())];
        curves.push(inputs.curve(name, what, &parts, inputs.tuning(initialised))?);
    }
    let mut models: Vec<VoxelizedRecord> = Vec::new();
    for depth in inputs.depths() {
        for voxels in [inputs.uniform(depth), inputs.adaptive(depth)] {
            for initialised in [true, false] {
                let branch = Branch::new(inputs.study, &voxels, inputs.tuning(initialised));
                models.push(branch.voxelized()?);
            }
        }
    }
    let bd = vec![compare(&curves[0], &curves[1])];
    let others = inputs.others(|o| {
        // The paper shows the smaller of its depths here.
        let own = o.name.ends_with("J=11") || o.name.ends_with("J=15");
        own && (o.name.starts_with(NO_INIT) || o.name.starts_with("paper, uniform"))
    })?;
    let over_steps = |title: &str, stem: &str, all: bool| {
        let shown = tunes::of(&models).filter(|(_, t)| all || t.initialised);
        let title = format!("{}: {title}", inputs.scene());
        Block::Chart(tunes::chart(title, shown, &inputs.original), stem.into())
    };
    let lead = format!(
        "The paper's Fig. 7: voxelized models fine-tuned for {} steps, beginning with the attributes of the \
         merged Gaussians (averages weighted by what the training cameras see, covariances by matched moments) \
         or with none, at equal steps; uniform and adaptive at two depths. The original model reaches \
         {:.3} dB.",
        inputs.steps, inputs.original.score.psnr_db,
    );
    let steps = vec![
        over_steps("PSNR over steps of the fine-tune", "init-steps", true),
        over_steps("the same, initialised models only", "init-steps-near", false),
    ];
    let sections = vec![
        Section::open("PSNR over steps", steps),
        page::tunes(inputs, &models),
        page::curves(inputs, "with and without initialisation (Fig. 7)", &curves, &others, "init"),
        sections::differences("Bjontegaard difference", &bd),
    ];
    let (title, highlights) = ("Initialisation (Fig. 7)", vec![highlight(inputs, &models)]);
    Ok(Results { title, lead, highlights, sections, curves, bd, others })
}

/// The smallest model that the fine-tune brought back.
fn highlight(inputs: &Inputs<'_>, models: &[VoxelizedRecord]) -> (String, String) {
    let original = inputs.original.score.psnr_db;
    let back = tunes::of(models)
        .filter(|(_, t)| t.initialised && t.last_db() >= original - RECOVERED_DB)
        .min_by_key(|(m, _)| m.gaussians);
    match back {
        Some((m, t)) => (
            format!("{:+.2} dB", t.last_db() - original),
            format!(
                "from the original after {} steps: `{}`, {} Gaussians, {:.0} s",
                t.steps, m.what, m.gaussians, t.seconds
            ),
        ),
        None => (
            "not recovered".into(),
            format!(
                "no model came within {RECOVERED_DB} dB of the original in {} steps",
                inputs.steps
            ),
        ),
    }
}
