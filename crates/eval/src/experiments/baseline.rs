//! Fig. 6: uniform voxelization at two depths, fine-tuned without initialisation, in the paper's coding.

use anyhow::Result;

use super::{Inputs, Results, page};
use crate::published::NO_INIT;

pub(super) fn run(inputs: &Inputs<'_>) -> Result<Results> {
    let mut curves = Vec::new();
    for depth in inputs.depths() {
        let what = format!("uniform, J = {depth}, no initialisation, paper's coding");
        let parts = [(inputs.uniform(depth), inputs.paper())];
        let name = format!("baseline J={depth}");
        curves.push(inputs.curve(&name, what, &parts, inputs.tuning(false))?);
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
    let title = "uniform, no initialisation (Fig. 6)";
    let sections = vec![
        page::curves(inputs, title, &curves, &others, "baseline"),
        page::tunes(inputs, curves.iter().flat_map(|c| &c.voxelized)),
    ];
    Ok(Results { title: "Baseline (Fig. 6)", lead, sections, curves, others, ..Results::default() })
}
