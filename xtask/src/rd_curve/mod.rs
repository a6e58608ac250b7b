//! `cargo xtask rd-curve`: rate-distortion curves of a scene, from real streams.

pub(crate) mod plan;
pub(crate) mod record;
pub(crate) mod stages;
pub(crate) mod tune;

use std::fs;
use std::path::PathBuf;
use std::time::Instant;

use anyhow::{Context, Result, bail, ensure};
use gs_model::dataset::{Dataset, View};
use gs_model::{Camera, Scene};
use serde::Serialize;

use crate::cache::{self, Cache};
use crate::experiments::{self, Experiment};
use crate::manifest::{self, Manifest};
use crate::measure::{self, Shot};
use crate::peers;
use crate::pictures;
use crate::published;
use crate::report::{self, sections};
use crate::scenes::{self, Found};
use plan::Coding;
use record::{Bd, Curve, Picture, Run};
use stages::{Branch, PICTURE_VIEWS, Study};
use tune::Tuning;

/// Flags of `cargo xtask rd-curve`.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct RdArgs {
    /// A folder with model, cameras and photos, or a name from xtask/scenes.toml
    #[arg(default_value = scenes::DEFAULT)]
    scene: String,
    /// Folder of the report [default: out/rd/SCENE]
    #[arg(long)]
    out: Option<PathBuf>,
    /// Measure at most this many held-out views
    #[arg(long)]
    views: Option<usize>,
    /// Rates per curve
    #[arg(long)]
    rates: Option<usize>,
    /// Two views, five rates
    #[arg(long)]
    quick: bool,
    /// Depth of the uniform octree [default: chosen by rendering, deeper at higher rates]
    #[arg(long)]
    pub(crate) depth: Option<u8>,
    /// Depths of the adaptive octree, LOW:HIGH of the paper's criteria [default: about the uniform depth]
    #[arg(long, value_parser = plan::parse_depths)]
    pub(crate) adaptive: Option<(u8, u8)>,
    /// Fine-tune each voxelized model against the training photos for this many steps [default:
    /// none; experiments: 400]
    #[arg(long, value_name = "STEPS", value_parser = clap::value_parser!(u64).range(1..))]
    pub(crate) finetune: Option<u64>,
    /// One of the paper's experiments instead of the default curves
    #[arg(long, value_enum)]
    experiment: Option<Experiment>,
    /// Run every stage, done before or not
    #[arg(long)]
    fresh: bool,
    #[command(flatten)]
    pub(crate) peers: peers::Flags,
}

/// Rates per curve unless told otherwise.
pub(crate) const RATES: usize = 6;
/// Training cameras that importances are found from. As good as all: what no camera sees is left
/// out, so on `bonsai` 24 of 129 cameras cost 0.6 dB at the held-out views.
const IMPORTANCE_VIEWS: usize = 1000;
/// `--quick`.
const QUICK_RATES: usize = 5;
/// `--quick`.
const QUICK_VIEWS: usize = 2;

/// What every stage depends on.
#[derive(Serialize)]
struct Inputs<'a> {
    program: &'a str,
    model: &'a str,
    views: &'a str,
}

/// A scene made ready, and where its results go.
pub(crate) struct Setup {
    /// Where its files are.
    pub(crate) found: Found,
    /// Folder of finished stages, streams and renders.
    pub(crate) out: PathBuf,
    /// The valid Gaussians of the model.
    pub(crate) scene: Scene,
    /// Gaussians left out because they are not finite.
    pub(crate) invalid: usize,
    /// Held-out views that are measured.
    pub(crate) shots: Vec<Shot>,
    /// All training cameras.
    pub(crate) training: Vec<Camera>,
    /// Finished stages.
    pub(crate) cache: Cache,
    /// Hashes of program, model, and cameras with photos.
    pub(crate) hashes: [String; 3],
}

impl Setup {
    /// Finds and reads everything.
    pub(crate) fn new(args: &RdArgs) -> Result<Self> {
        let found = scenes::find(&args.scene)?;
        let out = match &args.out {
            Some(out) => out.clone(),
            None => scenes::root().join("out/rd").join(&found.name),
        };
        fs::create_dir_all(&out).with_context(|| format!("create {}", out.display()))?;
        let most = args.views.unwrap_or(if args.quick { QUICK_VIEWS } else { usize::MAX });
        ensure!(most > 0, "--views must be at least 1");
        let views = spread(found.dataset.held_out().collect(), most);
        let shots = measure::load(views.iter().copied())?;

        let program = cache::program_hash()?;
        let model = cache::hash_file(&found.dataset.model_path)?;
        let view_hash = hash_views(&found.dataset, &views)?;
        let inputs = Inputs { program: &program, model: &model, views: &view_hash };
        let cache = Cache::open(&out.join("stages"), &inputs, args.fresh)?;

        let (mut scene, _) = gs_model::ply::read(&found.dataset.model_path)?;
        let before = scene.len();
        scene.drop_invalid();
        let invalid = before - scene.len();
        if scene.is_empty() {
            bail!("{}: no valid Gaussian in it", found.dataset.model_path.display());
        }
        println!(
            "{}: {} Gaussians of SH degree {}, {} of {} held-out views",
            found.name,
            scene.len(),
            scene.sh_degree,
            shots.len(),
            found.dataset.held_out().len()
        );
        let training = found.dataset.training().map(|v| v.camera.clone()).collect();
        let hashes = [program, model, view_hash];
        Ok(Self { found, out, scene, invalid, shots, training, cache, hashes })
    }

    /// Cameras that importances are found from.
    pub(crate) fn cameras(&self) -> Vec<Camera> {
        thin(&self.training, IMPORTANCE_VIEWS)
    }

    /// Stages on this scene.
    pub(crate) fn study<'a>(&'a self, cameras: &'a [Camera]) -> Study<'a> {
        let training = self.found.dataset.training().cloned().collect();
        Study::new(&self.cache, &self.out, &self.scene, &self.shots, cameras, training)
    }

    /// The uncompressed model.
    pub(crate) fn original(&self, study: &Study<'_>) -> Result<record::Original> {
        let bytes = fs::metadata(&self.found.dataset.model_path).map_or(0, |m| m.len());
        study.original(self.invalid, bytes)
    }

    /// Depth of the uniform octree: the given one, or the one that rendering asks for.
    pub(crate) fn depth(&self, given: Option<u8>) -> Result<u8> {
        let choose = || plan::choose_depth(&self.scene, &self.training);
        given.map_or_else(|| self.cache.run("depth", &(), choose), Ok)
    }

    /// Runs the peers whose tools are there.
    pub(crate) fn peers(&self, flags: &peers::Flags, depth: u8) -> Result<Vec<peers::Outcome>> {
        let model = &self.found.dataset.model_path;
        let (cache, scene, shots) = (&self.cache, &self.scene, &self.shots);
        peers::run(flags, &peers::Task { cache, model, scene, shots, depth })
    }

    /// Provenance of a report.
    pub(crate) fn manifest(&self) -> Manifest {
        manifest::of(&self.hashes[0], &self.hashes[1], &self.hashes[2])
    }

    /// Stages found done, and stages in all.
    pub(crate) fn tally(&self) -> (usize, usize) {
        let (skipped, ran) = self.cache.tally();
        (skipped.len(), skipped.len() + ran.len())
    }
}

/// Runs the whole chain, or an experiment, and writes the report.
pub(crate) fn run(args: &RdArgs) -> Result<()> {
    let started = Instant::now();
    // Before anything long: what cannot be right is said at once.
    let qualities =
        plan::qualities(args.rates.unwrap_or(if args.quick { QUICK_RATES } else { RATES }))?;
    let setup = Setup::new(args)?;
    let report = match args.experiment {
        Some(experiment) => experiments::run(experiment, &setup, args, &qualities)?,
        None => curves(&setup, args, &qualities)?,
    };
    let (skipped, stages) = setup.tally();
    if skipped > 0 {
        println!(
            "{skipped} of {stages} stages were already done for the same inputs and were skipped"
        );
    }
    println!("report: {}", report.display());
    println!("{:.1} s in all", started.elapsed().as_secs_f64());
    Ok(())
}

/// The default run: all curves of a scene.
fn curves(setup: &Setup, args: &RdArgs, qualities: &[f32]) -> Result<PathBuf> {
    let cameras = setup.cameras();
    let study = setup.study(&cameras);
    let original = setup.original(&study)?;
    let base = setup.depth(args.depth)?;
    let tuning = args.finetune.map(|steps| Tuning { steps, initialised: true });
    let mut curves = Vec::new();
    for plan in plan::curves(base, args.depth, args.adaptive, qualities) {
        let (mut voxelized, mut points) = (Vec::new(), Vec::new());
        for (voxels, qualities) in &plan.steps {
            let branch = Branch::new(&study, voxels, tuning);
            voxelized.push(branch.voxelized()?);
            for &quality in qualities {
                points.push(branch.coded(plan.name, Coding::of(plan.name, quality))?);
            }
        }
        curves.push(Curve { name: plan.name.into(), what: plan.what, voxelized, points });
    }
    let tools = setup.peers(&args.peers, base)?;

    let found = &setup.found;
    let mut others = published::others(&found.dataset.dir, &found.name)?;
    others.retain(|o| !o.name.starts_with(published::NO_INIT));
    others.extend(peers::curves(&tools));
    let (skipped, stages) = setup.tally();
    let mut run = Run {
        scene: found.name.clone(),
        what: found.what.clone(),
        views: found.dataset.views.len(),
        held_out: found.dataset.held_out().len(),
        measured: setup.shots.len(),
        original,
        bd: compare(&curves, &others),
        curves,
        others,
        tools,
        pictures: Vec::new(),
        skipped,
        stages,
        manifest: setup.manifest(),
    };
    let (files, views) = side_by_sides(&run, &study)?;
    run.pictures = files;
    let json = setup.out.join("rd.json");
    let text = serde_json::to_string_pretty(&run).context("rd.json")? + "\n";
    fs::write(&json, text).with_context(|| format!("write {}", json.display()))?;
    report::run::document(&run, views).write(&setup.out)?;
    report::run::print(&run);
    Ok(setup.out.join("report.html"))
}

/// At most `most` of the views, evenly spread.
fn spread(views: Vec<&View>, most: usize) -> Vec<&View> {
    let n = views.len();
    if n <= most {
        return views;
    }
    (0..most).map(|i| views[i * n / most]).collect()
}

/// At most `most` of the cameras, evenly spread.
fn thin(cameras: &[Camera], most: usize) -> Vec<Camera> {
    let n = cameras.len();
    (0..n.min(most)).map(|i| cameras[i * n / n.min(most)].clone()).collect()
}

/// All cameras, and the photos of the measured views.
fn hash_views(dataset: &Dataset, measured: &[&View]) -> Result<String> {
    let mut all: String = dataset.views.iter().map(|v| format!("{:?}", v.camera)).collect();
    for view in measured {
        all.push_str(&view.camera.name);
        all.push_str(&cache::hash_file(&view.image_path)?);
    }
    Ok(cache::hash_bytes(all.as_bytes()))
}

/// Hull against hull: the adaptive curves against the uniform one, all against the others.
fn compare(curves: &[Curve], others: &[published::Other]) -> Vec<Bd> {
    let mut out = Vec::new();
    if let [uniform, adaptives @ ..] = curves {
        for adaptive in adaptives {
            let (test, anchor) = (adaptive.curve(), uniform.curve());
            out.push(sections::compare((&adaptive.name, &test), (&uniform.name, &anchor)));
        }
    }
    // A published curve is of another model; only what was measured on this very model can be
    // compared by rate.
    for other in others.iter().filter(|o| o.points.len() >= 4 && !o.is_published()) {
        let anchor = other.curve();
        for curve in curves {
            out.push(sections::compare((&curve.name, &curve.curve()), (&other.name, &anchor)));
        }
    }
    out
}

/// Pictures of the first views at the lowest, a middle and the highest rate of the last curve:
/// whole views side by side as files, and crops for the page.
fn side_by_sides(run: &Run, study: &Study<'_>) -> Result<(Vec<Picture>, Vec<report::View>)> {
    let (mut files, mut views) = (Vec::new(), Vec::new());
    let Some(curve) = run.curves.last() else { return Ok((files, views)) };
    // Pictures of earlier settings would stay beside the report and contradict it.
    let dir = study.out.join("pictures");
    if dir.is_dir() {
        fs::remove_dir_all(&dir).with_context(|| format!("clear {}", dir.display()))?;
    }
    fs::create_dir_all(&dir).with_context(|| format!("create {}", dir.display()))?;
    let originals = study.render_names("original");
    let n = curve.points.len();
    let mut chosen = vec![0, n / 2, n - 1];
    chosen.dedup();
    for (v, shot) in study.shots.iter().take(PICTURE_VIEWS).enumerate() {
        let read = |name: &String| measure::read_photo(&study.out.join(name));
        let original = read(&originals[v])?;
        let db = |s: &measure::Score| s.views.get(v).map_or(f64::NAN, |x| x.psnr_db);
        let view = &shot.view.camera.name;
        let stem = pictures::stem(view);
        let original_says = format!(
            "original model, {} MB, {:.2} dB",
            report::megabytes(run.original.file_bytes),
            db(&run.original.score)
        );
        let mut decoded = Vec::new();
        for point in chosen.iter().filter_map(|&i| curve.points.get(i)) {
            let file = format!("pictures/{stem}-{}-q{:.0}.png", curve.name, point.quality);
            let image = read(&point.renders[v])?;
            let panel = pictures::side_by_side(&[&shot.photo, &original, &image]);
            pictures::write(&study.out.join(&file), &panel)?;
            let says = format!(
                "decoded from {} MB ({}, quality {:.0}), {:.2} dB",
                report::megabytes(point.bytes),
                curve.name,
                point.quality,
                db(&point.score)
            );
            let caption = format!("photo | {original_says} | {says}");
            files.push(Picture { file, view: view.clone(), caption });
            decoded.push((image, format!("{} MB", report::megabytes(point.bytes)), says));
        }
        let crops = report::crops(&shot.photo, (&original, &original_says), &decoded)?;
        views.push(report::View { name: view.clone(), crops });
    }
    Ok((files, views))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spread_keeps_the_first_and_reaches_far() {
        let view = |i: usize| View {
            camera: Camera {
                name: i.to_string(),
                width: 1,
                height: 1,
                fx: 1.0,
                fy: 1.0,
                cx: 0.5,
                cy: 0.5,
                rotation: glam::DMat3::IDENTITY,
                translation: glam::DVec3::ZERO,
                ignored_distortion: None,
            },
            image_path: PathBuf::new(),
        };
        let views: Vec<View> = (0..7).map(view).collect();
        let names = |most| -> Vec<String> {
            spread(views.iter().collect(), most).iter().map(|v| v.camera.name.clone()).collect()
        };
        assert_eq!(names(3), ["0", "2", "4"]);
        assert_eq!(names(9).len(), 7);
    }
}
