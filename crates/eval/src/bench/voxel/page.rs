//! The page of docs/results on voxelization: a summary of each part that ran.

use std::fmt::Write;

use anyhow::Result;

use super::Options;
use super::criteria::Comparison;
use super::curves::{ANCHOR, Rates};
use super::tuned::Tuned;

/// Summaries by part; empty where a part did not run.
#[derive(Default)]
pub(super) struct Page {
    pub(super) rates: Vec<Rates>,
    pub(super) tuned: Vec<Tuned>,
    pub(super) criteria: Vec<Comparison>,
    pub(super) speed: Option<String>,
}

/// A BD-rate as a cell.
fn percent(rate: Option<f64>) -> String {
    rate.map_or("no overlap".into(), |r| format!("{r:+.1} %"))
}

impl Page {
    /// The page; nothing if no part of it ran.
    pub(super) fn text(&self, args: &Options) -> Result<Option<String>> {
        let parts = [self.rates()?, self.tuned(args.steps)?, self.criteria()?, self.speed()];
        if parts.iter().all(String::is_empty) {
            return Ok(None);
        }
        Ok(Some(introduction() + &parts.concat()))
    }

    fn rates(&self) -> Result<String> {
        let Some(first) = self.rates.first() else { return Ok(String::new()) };
        let scenes: Vec<&str> = self.rates.iter().map(|r| r.scene.as_str()).collect();
        let mut out = format!(
            "\n## Equal quality before a fine-tune\n\n\
             Real streams, decoded, rendered at the held-out views. Each strategy has 15 settings: five \
             qualities with three depths or lambdas each (\"nothing dropped\" has five). The table has \
             the BD-rate between the hulls of all points, by pchip, against \"{ANCHOR}\".\n\n\
             | strategy | {} |\n|---|{}\n",
            scenes.join(" | "),
            "---:|".repeat(scenes.len())
        );
        for (i, (name, _)) in first.strategies.iter().enumerate() {
            let cells: Vec<String> =
                self.rates.iter().map(|r| percent(r.strategies[i].1)).collect();
            writeln!(out, "| {name} | {} |", cells.join(" | "))?;
        }
        for scene in scenes {
            writeln!(out, "\n![{scene}: PSNR over size](voxel-{scene}.svg)")?;
        }
        Ok(out)
    }

    fn tuned(&self, steps: u64) -> Result<String> {
        let mut out = match self.tuned.is_empty() {
            true => return Ok(String::new()),
            false => format!(
                "\n## Equal quality after a fine-tune\n\n\
                 The same before and after {steps} steps of fine-tune, three points a curve: BD-rate \
                 against `Uniform`, with the merging by moments everywhere.\n\n\
                 | scene | strategy | before | after |\n|---|---|---:|---:|\n"
            ),
        };
        for tuned in &self.tuned {
            for (name, [before, after]) in &tuned.strategies {
                let (before, after) = (percent(*before), percent(*after));
                writeln!(out, "| {} | {name} | {before} | {after} |", tuned.scene)?;
            }
        }
        Ok(out)
    }

    fn criteria(&self) -> Result<String> {
        let mut out = match self.criteria.is_empty() {
            true => return Ok(String::new()),
            false => String::from(
                "\n## Time and distortion beside the exact criterion\n\n\
                 The exact criterion computes the barycenter of each cell (eq. 5 of the paper). The \
                 others have the same depths and as many leaves. \"Faster\" is the time of the exact \
                 criterion over theirs, \"distortion\" their total of eq. 5 over its total. \
                 `RateDistortion` minimises eq. 5 alone here.\n\n\
                 | model | Gaussians | exact s | Paper: faster | distortion | RateDistortion: faster | \
                 distortion |\n|---|---:|---:|---:|---:|---:|---:|\n",
            ),
        };
        for c in &self.criteria {
            let [[paper, paper_d], [ours, ours_d]] = c.cheap;
            writeln!(
                out,
                "| {} | {} | {:.3} | {paper:.0} | {paper_d:.2} | {ours:.0} | {ours_d:.2} |",
                c.model, c.gaussians, c.seconds
            )?;
        }
        Ok(out)
    }

    fn speed(&self) -> String {
        let table = |t: &String| format!("\n## Time and memory\n\n{t}");
        self.speed.as_ref().map_or(String::new(), table)
    }
}

fn introduction() -> String {
    format!(
        "# What does adaptive voxelization bring?\n\n\
         Written by `{}`, which also prints every point.\n\n\
         | strategy | where the octree stops |\n|---|---|\n\
         | Uniform | all leaves at one depth J |\n\
         | Paper | the paper's criteria (section 3.2), between two depths |\n\
         | RateDistortion | where distortion plus lambda times bits is least, found by dynamic programming; the default |\n\n\
         `RateDistortion` weighs each Gaussian by what the training cameras see of it, and drops those \
         that show less than their bits cost. \"No cameras\" guesses the weights from opacity and size \
         and drops nothing; \"nothing dropped\" has cameras. \"Paper merging\" averages the Gaussians of \
         a leaf as the paper does; \"Moments merging\" keeps their first two moments. All streams are \
         coded with importances from the cameras.\n\n\
         Where `Paper` is larger than `Uniform`, its criteria are the reason: they send the largest \
         20 % of the Gaussians, and every cell with a mean outside its inscribed ball, to the deepest \
         level, at about three bits a level. A large Gaussian tolerates a larger displacement, not a \
         smaller one.\n",
        crate::manifest::command()
    )
}
