//! The two stages of a run, how each begins, and what a checkpoint keeps of it.

use gpcc_lite::{Cube, Leaf, Octree};
use gs_model::Scene;
use gsvx::VoxelScene;
use gsvx::latents::Latents;

use crate::checkpoint::{StateReader, StateWriter};
use crate::codec_loop::{CodecLoop, LoopLeaves};
use crate::error::{Error, Result};
use crate::options::{Goal, Layout};
use crate::plan::{self, TunePlan};
use crate::scene_loop::{SceneLoop, mean_rate};
use crate::steering;
use crate::views::Views;

/// What a run is doing.
pub(crate) enum Stage {
    /// Round number `round`, counted from 1.
    Round { round: u64, recovery: Box<SceneLoop> },
    /// The codec in the loop.
    Loop(Box<CodecLoop>),
}

/// A round of no steps, which keeps all Gaussians.
pub(crate) fn before_pruning(scene: Scene) -> Stage {
    Stage::Round { round: 0, recovery: Box::new(SceneLoop::new(scene, 0.0, 0)) }
}

/// Starts the recovery of round `round` from the scene that it keeps.
pub(crate) fn round(plan: &TunePlan, views: &mut Views, kept: Scene, round: u64) -> Stage {
    views.gradients.move_means(true);
    let recovery = SceneLoop::new(kept, mean_rate(&views.cameras), plan.round_steps);
    Stage::Round { round, recovery: steady(recovery) }
}

/// Rates that do not fall: the next round or the loop goes on from here.
fn steady(mut recovery: SceneLoop) -> Box<SceneLoop> {
    recovery.held = recovery.steps;
    Box::new(recovery)
}

/// Voxelizes and puts the codec into the loop.
pub(crate) fn codec_loop(
    plan: &TunePlan,
    goal: Goal,
    views: &mut Views,
    scene: &Scene,
) -> Result<Box<CodecLoop>> {
    views.gradients.move_means(false);
    let (importance, drop_unseen) = (views.importance(scene)?, views.drop_unseen());
    let VoxelScene { scene, voxels, importance, outliers } =
        plan::prepare(scene, &importance, plan.quality, drop_unseen)?;
    if scene.is_empty() {
        return Err(Error::NothingSeen);
    }
    let (octree, steps) = (voxels.octree().clone(), plan::steps(plan.quality)?);
    let latents = Latents::new(&scene, &octree, &importance, steps, &goal.layout.code())?;
    let outliers = outliers.map(|o| at_degree(&o, latents.sh_degree()));
    let leaves = LoopLeaves { octree, importance, outliers };
    let mut state = CodecLoop::new(plan, views.pixels(), leaves, latents);
    steering::begin(&mut state, goal.target)?;
    Ok(Box::new(state))
}

/// A scene cut or filled up to an SH degree.
pub(crate) fn at_degree(scene: &Scene, degree: u8) -> Scene {
    let mut out = scene.emptied(degree);
    out.append(scene);
    out
}

impl Stage {
    /// The scene as it is.
    pub(crate) fn scene(&self) -> &Scene {
        match self {
            Self::Round { recovery, .. } => recovery.optimiser.scene(),
            Self::Loop(state) => &state.scene,
        }
    }

    /// Adds what a run needs to go on from here.
    pub(crate) fn write(&self, out: &mut StateWriter) {
        match self {
            Self::Round { round, recovery } => {
                out.integers(&[0, *round]);
                recovery.write(out);
            }
            Self::Loop(state) => {
                let LoopLeaves { octree, importance, outliers } = &state.leaves;
                let empty = state.latents.empty_scene();
                out.integers(&[1, state.done]);
                out.scene(&empty);
                out.numbers(&[state.quality.into()]);
                write_leaves(out, octree);
                out.floats(importance);
                out.floats(state.latents.values());
                out.moments(&state.moments);
                out.scene(outliers.as_ref().unwrap_or(&empty));
            }
        }
    }

    /// Undoes [`Stage::write`].
    pub(crate) fn read(
        input: &mut StateReader<'_>,
        plan: &TunePlan,
        layout: Layout,
        views: &Views,
    ) -> Result<Self> {
        match input.integers()?[..] {
            [0, round] => {
                let recovery = SceneLoop::read(input, mean_rate(&views.cameras), plan.round_steps)?;
                Ok(Self::Round { round, recovery: steady(recovery) })
            }
            [1, done] => {
                let empty = input.scene()?;
                let latents = read_latents(input, layout, &empty)?;
                let mut state = read_loop(input, views, plan, latents)?;
                state.done = done;
                Ok(Self::Loop(Box::new(state)))
            }
            _ => Err(input.error("unknown stage")),
        }
    }
}

fn write_leaves(out: &mut StateWriter, octree: &Octree) {
    let Cube { origin, side } = octree.cube();
    out.numbers(&[origin[0], origin[1], origin[2], side, octree.depth().into()]);
    out.integers(&octree.leaves().iter().map(|l| l.morton).collect::<Vec<_>>());
    out.integers(&octree.leaves().iter().map(|l| l.depth.into()).collect::<Vec<_>>());
}

fn read_leaves(input: &mut StateReader<'_>) -> Result<Octree> {
    let [x, y, z, side, depth] = input.numbers()?[..] else {
        return Err(input.error("octree"));
    };
    let (cells, depths) = (input.integers()?, input.integers()?);
    if cells.len() != depths.len() {
        return Err(input.error("leaves differ in number"));
    }
    let leaf = |(morton, depth): (u64, u64)| Leaf { morton, depth: depth as u8 };
    let leaves = cells.into_iter().zip(depths).map(leaf).collect();
    let cube = Cube { origin: [x, y, z], side };
    Octree::new(cube, depth as u8, leaves).map_err(|e| input.refused("leaves", e))
}

/// The quality, the latents and their leaves, without outliers.
fn read_latents(
    input: &mut StateReader<'_>,
    layout: Layout,
    empty: &Scene,
) -> Result<(f32, LoopLeaves, Latents)> {
    let [quality] = input.numbers()?[..] else { return Err(input.error("quality")) };
    let (octree, quality) = (read_leaves(input)?, quality as f32);
    let importance = input.floats()?;
    let values = input.floats()?;
    let (steps, options) = (plan::steps(quality)?, layout.code());
    let latents = Latents::with_values(&octree, &importance, steps, &options, empty, values)?;
    Ok((quality, LoopLeaves { octree, importance, outliers: None }, latents))
}

fn read_loop(
    input: &mut StateReader<'_>,
    views: &Views,
    plan: &TunePlan,
    (quality, mut leaves, latents): (f32, LoopLeaves, Latents),
) -> Result<CodecLoop> {
    let moments = input.moments(latents.values().len())?;
    leaves.outliers = Some(input.scene()?).filter(|outliers| !outliers.is_empty());
    let plan = TunePlan { quality, ..*plan };
    let mut state = CodecLoop::new(&plan, views.pixels(), leaves, latents);
    state.moments = moments;
    Ok(state)
}
