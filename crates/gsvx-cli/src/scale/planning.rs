//! Plans: what `gsvx plan` writes, and how it is found.

use super::cameras::PlanCameras;
use super::inputs::{SceneFile, progress};
use super::plan_file::PlanFile;
use super::rows::TileRows;
use super::scratch::Scratch;
use super::thinned::ThinnedModel;
use crate::content::SceneArgs;
use crate::doubts::PhotoVerdict;
use crate::input::name;
use crate::progress::Meter;
use anyhow::{Context, Error, Result, bail};
use gs_model::Scene;
use gsvx::{Choices, Plan, Survey};
use std::fs::File;
use std::io::{BufWriter, Read, Seek, Write};

/// Name of the file of all means.
const MEANS: &str = "means";
/// Means that are in memory at a time.
const PIECE: usize = 1 << 16;

/// Reads all inputs, and cuts their scene into tiles. The plan lacks what the sample says. It has no cameras if their photos
/// show something else. Also whether photos prove the cameras.
pub(crate) fn survey(
    args: &SceneArgs,
    choices: Choices,
    cameras: Option<&PlanCameras>,
    scratch: &Scratch,
) -> Result<(PlanFile, bool)> {
    let files = args.inputs.iter().map(|path| SceneFile::new(path));
    let mut inputs = files.collect::<Result<Vec<_>>>()?;
    let mut survey = Survey::new(choices.code.max_sh_degree);
    let mut means = BufWriter::with_capacity(1 << 20, scratch.begin(MEANS)?);
    let bar = progress("survey", inputs.iter());
    let mut first: Option<Scene> = None;
    let mut few = ThinnedModel::default();
    for input in &mut inputs {
        let path = input.path.clone();
        // What lossy coding cannot hold is refused by its number in the file.
        let look = |scene: &Scene, first: usize| {
            let most = choices.code.max_sh_degree;
            gsvx::check_values(scene, most, first).with_context(|| name(&path))
        };
        input.survey(&args.reading, &bar, look, |mut scene| {
            let first = first.get_or_insert_with(|| scene.emptied(0));
            if scene.antialiased != first.antialiased {
                let mut both = [&args.inputs[0], &path];
                if scene.antialiased {
                    both.reverse();
                }
                let [with, without] = both.map(|path| name(path));
                bail!(
                    "{with} is antialiased and {without} is not, so they cannot be one scene; encode them as two"
                );
            }
            scene.move_origin(first.origin);
            survey.add(&scene);
            cameras.iter().for_each(|_| few.add(&scene));
            let coordinates = scene.means.as_flattened().iter();
            let bytes: Vec<u8> = coordinates.flat_map(|x| x.to_le_bytes()).collect();
            means.write_all(&bytes).map_err(|e| scratch.full(e))
        })?;
    }
    drop(bar);
    let mut means = means.into_inner().map_err(|e| scratch.full(e.into_error()))?;
    let _bar = Meter::spinner("counting".into());
    let mut plan = Plan::new::<Error>(&survey, choices, |take| {
        means.rewind().map_err(|e| scratch.full(e))?;
        let mut left = survey.count();
        while left > 0 {
            take(&read_means(&mut means, &mut left).map_err(|e| scratch.full(e))?);
        }
        Ok(())
    })?;
    means.rewind().map_err(|e| scratch.full(e))?;
    for input in &mut inputs {
        let mut left = input.gaussians;
        let mut found = vec![false; plan.tile_counts().len()];
        while left > 0 {
            let piece = read_means(&mut means, &mut left).map_err(|e| scratch.full(e))?;
            plan.tiles_of(&piece)?.into_iter().for_each(|t| found[t as usize] = true);
        }
        input.tiles = (0..).zip(found).filter(|(_, f)| *f).map(|(t, _)| t).collect();
    }
    scratch.forget(&format!("{MEANS}.part"));
    let verdict = cameras.map(|cameras| cameras.by_photos(few, choices)).transpose()?;
    let doubted = verdict == Some(PhotoVerdict::Doubted);
    if doubted {
        plan.forget_cameras();
    }
    let (reading, cameras) = (args.reading.clone(), cameras.filter(|_| !doubted));
    let cameras = cameras.map(PlanCameras::file);
    let plan = PlanFile { gsvx: super::VERSION.into(), reading, inputs, cameras, plan };
    Ok((plan, verdict == Some(PhotoVerdict::Proven)))
}

fn read_means(from: &mut File, left: &mut u64) -> std::io::Result<Vec<[f32; 3]>> {
    let count = (*left).min(PIECE as u64);
    let mut bytes = vec![0; 12 * count as usize];
    from.read_exact(&mut bytes)?;
    *left -= count;
    let (floats, _) = bytes.as_chunks::<4>();
    let (means, _) = floats.as_chunks::<3>();
    Ok(means.iter().map(|m| m.map(f32::from_le_bytes)).collect())
}

/// Finishes a plan by the tiles of its sample, of which `rows` has the Gaussians. Cameras that may not be the model's
/// own decide nothing, with a warning; cameras that photos prove are not doubted.
pub(crate) fn measure(
    file: &mut PlanFile,
    rows: &TileRows,
    cameras: Option<&PlanCameras>,
    proven: bool,
) -> Result<()> {
    let mut cameras = cameras.filter(|_| file.cameras.is_some());
    while let Some(best) = measure_by(&mut file.plan, rows, cameras)? {
        let Some(doubtful) = cameras.filter(|_| !proven) else { break };
        if !doubtful.is_doubted(&rows.tile(best)?, file.plan.choices())? {
            break;
        }
        file.plan.forget_cameras();
        (file.cameras, cameras) = (None, None);
    }
    Ok(())
}

/// Measures by cameras, or else by a guess. Returns the tile of the sample of which they see most.
fn measure_by(
    plan: &mut Plan,
    rows: &TileRows,
    cameras: Option<&PlanCameras>,
) -> Result<Option<usize>> {
    let sample = plan.sample();
    let mut shown = Vec::with_capacity(sample.len());
    let bar = cameras.map(|_| Meter::new("importance of a sample", plan.sample().len()));
    let _spinner = cameras.is_none().then(|| Meter::spinner("measuring a sample".into()));
    let mut all = 0.0;
    let see = |tile: &Scene| {
        let found = cameras.map(|s| s.of(tile)).unwrap_or_default();
        shown.push(found.share(tile) * tile.len() as f64);
        all += tile.len() as f64;
        bar.iter().for_each(Meter::inc);
        Ok(found.squared)
    };
    plan.measure::<Error>(|tile| rows.tile(tile), see)?;
    drop(bar);
    let seen: f64 = shown.iter().sum();
    cameras.map_or(Ok(()), |s| s.check(if all > 0.0 { seen / all } else { 1.0 }))?;
    let tiles = sample.into_iter().zip(shown);
    Ok(tiles.max_by(|a, b| a.1.total_cmp(&b.1)).map(|(tile, _)| tile))
}
