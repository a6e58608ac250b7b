//! `gsvx plan`.

use crate::content::SceneArgs;
use crate::report::Reporter;
use crate::scale;
use anyhow::Result;
use gsvx::{Aim, Choices};

pub(crate) const EXAMPLES: &str = "\
Examples:
  gsvx plan tiles/*.ply -o city.plan
  gsvx encode city.plan --part 3/16 -o part-3.gsvx         on 16 machines, one each
  gsvx join part-*.gsvx -o city.gsvx";

const INPUTS: &str =
    "The models, which become one scene in this order. Their paths stand in the plan";

#[derive(clap::Args)]
#[command(mut_arg("inputs", |a| a.help(INPUTS)))]
#[command(mut_arg("output", |a| a.help("The plan to write; `-` for standard output")))]
pub(crate) struct PlanArgs {
    #[command(flatten)]
    scene: SceneArgs,
}

/// Makes a plan.
pub(crate) fn run(args: &PlanArgs, report: Reporter) -> Result<()> {
    let content = &args.scene.content;
    let aim = Aim::Quality(content.quality());
    let choices = Choices::of(aim, &content.options(), content.cameras.is_some())?;
    scale::plan(&args.scene, choices, report)
}
