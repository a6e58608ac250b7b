//! Fig. 8 and Table 1: adaptive voxelization against uniform, in the paper's coding and in
//! this codec's.

use anyhow::Result;

use super::{Inputs, Results, compare, page};
use crate::bd::{self, Method, Point};
use crate::cells;
use crate::page::Table;
use crate::published;
use crate::rd_curve::record::{Bd, Curve};
use crate::report::{Block, Section, sections};

const TABLE_1: &str = "By the paper's recipe: a cubic fit of log-rate over all points, both covariance modes \
     together. The paper's rows are recomputed from the points its authors published. Playroom's lossy lists are \
     swapped between the two voxelizations in the authors' files, judging by the rate increments: with the labels put \
     right, adaptive loses 10 % there. Where gain and savings contradict each other, the cubic does not follow the \
     points (two covariance modes do not make one curve); the hulls by pchip, below, are what to believe.";

pub(super) fn run(inputs: &Inputs<'_>) -> Result<Results> {
    let depth = inputs.depth;
    let tuning = inputs.tuning(true);
    let mut curves = Vec::new();
    for (coding, codings) in [("paper's coding", inputs.paper()), ("gsvx's coding", inputs.own())] {
        for (name, voxels) in
            [("uniform", inputs.uniform(depth)), ("paper's criteria", inputs.adaptive(depth))]
        {
            let what = format!("{}, {coding}", voxels.what);
            let parts = [(voxels, codings.clone())];
            curves.push(inputs.curve(&format!("{name}, {coding}"), what, &parts, tuning)?);
        }
    }
    let what = "gsvx: leaves by rate and distortion".into();
    curves.push(inputs.curve("gsvx", what, &inputs.tuned_parts(), tuning)?);

    let [paper_uniform, paper_adaptive, uniform, adaptive, gsvx] = &curves[..] else {
        anyhow::bail!("five curves were made, not {}", curves.len());
    };
    let bd: Vec<Bd> = [
        (paper_adaptive, paper_uniform),
        (adaptive, uniform),
        (gsvx, uniform),
        (uniform, paper_uniform),
        (gsvx, paper_adaptive),
    ]
    .map(|(test, anchor)| compare(test, anchor))
    .into();
    let others = inputs.others(|o| {
        o.name.starts_with("paper, uniform") || o.name.starts_with("paper, adaptive")
    })?;
    let highlight = |bd: &Bd| {
        let says = format!("bytes of {} against {} at equal PSNR", bd.test, bd.anchor);
        bd.rate.map(|rate| (format!("{rate:+.1} %"), says))
    };
    let table = table_1(inputs, paper_uniform, paper_adaptive)?;
    let sections = vec![
        page::curves(inputs, "adaptive against uniform (Fig. 8)", &curves, &others, "adaptive"),
        Section::open("Table 1", vec![Block::Text(TABLE_1.into()), Block::Table(table)]),
        sections::differences("Bjontegaard differences", &bd),
        page::tunes(inputs, curves.iter().flat_map(|c| &c.voxelized)),
    ];
    let lead = format!(
        "The paper's Fig. 8 and Table 1: uniform voxelization at depth {depth} against the paper's adaptive \
         criteria, both initialised by merging and fine-tuned for {} steps, coded as the paper codes (codebook \
         and lossless covariance); the same two models in this codec's own coding; and its own \
         voxelization.",
        inputs.steps
    );
    let title = "Adaptive voxelization (Fig. 8, Table 1)";
    let highlights = [&bd[0], &bd[2]].into_iter().filter_map(highlight).collect();
    Ok(Results { title, lead, highlights, sections, curves, bd, others, ..Results::default() })
}

/// The paper's Table 1 from its published points, and the same of this run.
fn table_1(inputs: &Inputs<'_>, uniform: &Curve, adaptive: &Curve) -> Result<Table> {
    let mut table = Table::new("scene | avg. PSNR gain, dB | bitrate savings, % | in the paper");
    let mut row = |scene: String, anchor: &[Point], test: &[Point], printed: &str| {
        let show = |x: Option<f64>| x.map_or("-".into(), |x| format!("{x:.2}"));
        let rate = bd::bd_rate(anchor, test, Method::Cubic).map(|r| -r);
        let gain = bd::bd_psnr(anchor, test, Method::Cubic);
        table.row(cells![scene, show(gain), show(rate), printed]);
    };
    let published = published::read()?;
    for (scene, printed) in [("playroom", "0.08 dB, 13.42 %"), ("truck", "0.19 dB, 12.64 %")] {
        let Some(lists) = published.get(scene) else { continue };
        let of = |prefix: &str| -> Vec<Point> {
            let chosen = lists.lists.iter().filter(|l| l.name.starts_with(prefix));
            let all = chosen.flat_map(|l| &l.points);
            all.map(|&[rate, psnr_db]| Point { rate, psnr_db }).collect()
        };
        let name = format!("{scene}, published points");
        row(name, &of("paper, uniform"), &of("paper, adaptive"), printed);
    }
    row(format!("{}, this run", inputs.scene()), &uniform.rates(), &adaptive.rates(), "-");
    Ok(table)
}
