//! Fig. 6: uniform voxelization at two depths, fine-tuned from nothing, coded as the paper codes.

use anyhow::Result;

use super::{Bench, Results, page};
use crate::published::NO_INIT;
use crate::report::{Block, Section};

pub(super) fn run(bench: &Bench<'_>) -> Result<Results> {
    let mut curves = Vec::new();
    for depth in bench.depths() {
        let voxels = bench.uniform(depth);
        let codings = bench.paper_lossy().into_iter().chain(bench.paper_lossless()).collect();
        let what = format!("uniform, J = {depth}, no initialisation, paper's coding");
        let parts = [(voxels, codings)];
        curves.push(bench.curve(
            &format!("baseline J={depth}"),
            what,
            &parts,
            bench.tuning(false),
        )?);
    }
    let others = bench.others(|o| o.name.starts_with(NO_INIT))?;
    let [first, second] = bench.depths();
    let lead = format!(
        "The paper's Fig. 6: Gaussian means on a uniform octree of depth {first} or {second}, all other \
         attributes fine-tuned from nothing (grey, round, translucent) for {} steps, coded as the paper \
         codes: QP triples from its published hull, covariances by a codebook with its indices counted, \
         and losslessly. The paper takes 20000 to 60000 steps; what {} steps reach is far from the \
         original, and what the initialisation is worth is the next experiment (`--experiment init`).",
        bench.steps, bench.steps
    );
    let chart = page::chart(bench, "uniform, no initialisation (Fig. 6)", &curves, &others);
    let parts = vec![
        Section::open("Curves", vec![Block::Chart(chart, "baseline".into())]),
        page::tunes(bench, page::tunes_of(&curves)),
        page::points(bench, &curves),
        page::others(&others),
    ];
    let title = "Baseline (Fig. 6)";
    let document = page::document(bench, title, lead, Vec::new(), parts);
    Ok(Results { document, curves, bd: Vec::new(), others, tools: Vec::new() })
}
