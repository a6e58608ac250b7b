//! Fig. 6: uniform voxelization at two depths, fine-tuned without initialisation, in the paper's coding.

use anyhow::Result;

use super::{Inputs, Results, page};
use crate::published::NO_INIT;
use crate::report::{Block, Section};

pub(super) fn run(inputs: &Inputs<'_>) -> Result<Results> {
    let mut curves = Vec::new();
    for depth in inputs.depths() {
        let voxels = inputs.uniform(depth);
        let codings = inputs.paper_lossy().into_iter().chain(inputs.paper_lossless()).collect();
        let what = format!("uniform, J = {depth}, no initialisation, paper's coding");
        let parts = [(voxels, codings)];
        curves.push(inputs.curve(
            &format!("baseline J={depth}"),
            what,
            &parts,
            inputs.tuning(false),
        )?);
    }
    let others = inputs.others(|o| o.name.starts_with(NO_INIT))?;
    let [first, second] = inputs.depths();
    let lead = format!(
        "The paper's Fig. 6: Gaussian means on a uniform octree of depth {first} or {second}, all other \
         attributes fine-tuned from nothing (grey, round, translucent) for {} steps, coded as the paper \
         codes: QP triples from its published hull, covariances by a codebook with its indices counted, \
         and losslessly. The paper takes 20000 to 60000 steps; what {} steps reach is far from the \
         original, and what the initialisation is worth is the next experiment (`--experiment init`).",
        inputs.steps, inputs.steps
    );
    let chart = page::chart(inputs, "uniform, no initialisation (Fig. 6)", &curves, &others);
    let parts = vec![
        Section::open("Curves", vec![Block::Chart(chart, "baseline".into())]),
        page::tunes(inputs, page::tunes_of(&curves)),
        page::points(inputs, &curves),
        page::others(&others),
    ];
    let title = "Baseline (Fig. 6)";
    let document = page::document(inputs, title, lead, Vec::new(), parts);
    Ok(Results { document, curves, bd: Vec::new(), others, tools: Vec::new() })
}
