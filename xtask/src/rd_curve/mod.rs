//! `cargo xtask rd-curve`: rate-distortion curves of a scene, from real streams.

pub(crate) mod plan;
pub(crate) mod record;
mod stages;

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, Result, bail, ensure};
use finetune::TrainView;
use gs_model::Camera;
use gs_model::dataset::{Dataset, View};
use serde::Serialize;

use crate::bd::{self, Method};
use crate::cache::{self, Cache};
use crate::manifest::{self, Manifest};
use crate::measure;
use crate::published::{self, PAPER_CHAIN};
use crate::scenes::{self, Found};
use crate::{pictures, plot, report};
use record::{Bd, Curve, Picture, Run};
use stages::{Branch, PICTURE_VIEWS, Study, Tuning};

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
    depth: Option<u8>,
    /// Depths of the adaptive octree, LOW:HIGH of the paper's criteria [default: about the uniform depth]
    #[arg(long, value_parser = plan::parse_depths)]
    adaptive: Option<(u8, u8)>,
    /// Fine-tune each voxelized model against the training photos for this many steps
    #[arg(long, value_name = "STEPS")]
    finetune: Option<u64>,
    /// Run every stage, done before or not
    #[arg(long)]
    fresh: bool,
}

/// Rates per curve unless told otherwise.
const RATES: usize = 6;
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

/// Runs the whole chain and writes the report.
pub(crate) fn run(args: &RdArgs) -> Result<()> {
    let started = Instant::now();
    let found = scenes::find(&args.scene)?;
    let out = match &args.out {
        Some(out) => out.clone(),
        None => scenes::root().join("out/rd").join(&found.name),
    };
    fs::create_dir_all(&out).with_context(|| format!("create {}", out.display()))?;
    let qualities =
        plan::qualities(args.rates.unwrap_or(if args.quick { QUICK_RATES } else { RATES }))?;
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

    let training: Vec<Camera> = found.dataset.training().map(|v| v.camera.clone()).collect();
    let cameras = thin(&training, IMPORTANCE_VIEWS);
    let tuning = match args.finetune {
        Some(steps) => Some(Tuning {
            steps,
            views: measure::load(found.dataset.training())?
                .into_iter()
                .map(|shot| TrainView { camera: shot.view.camera, photo: shot.photo })
                .collect(),
        }),
        None => None,
    };
    let study = Study::new(&cache, &out, &scene, &shots, &cameras, tuning);
    let file_bytes = fs::metadata(&found.dataset.model_path).map_or(0, |m| m.len());
    let original = study.original(invalid, file_bytes)?;
    let base = match args.depth {
        Some(depth) => depth,
        None => cache.run("depth", &(), || plan::choose_depth(&scene, &training))?,
    };
    let mut curves = Vec::new();
    for plan in plan::curves(base, args.depth, args.adaptive, &qualities) {
        let (mut voxelized, mut points) = (Vec::new(), Vec::new());
        for (voxels, qualities) in &plan.steps {
            let branch = Branch::new(&study, voxels);
            voxelized.push(branch.voxelized()?);
            for &quality in qualities {
                points.push(branch.coded(plan.name, quality)?);
            }
        }
        curves.push(Curve { name: plan.name.into(), what: plan.what, voxelized, points });
    }

    let others = published::others(&found.dataset.dir, &found.name)?;
    let mut run = Run {
        scene: found.name.clone(),
        what: found.what.clone(),
        views: found.dataset.views.len(),
        held_out: found.dataset.held_out().len(),
        measured: shots.len(),
        original,
        bd: compare(&curves, &others),
        curves,
        others,
        pictures: Vec::new(),
        manifest: provenance(program, model, view_hash),
    };
    run.pictures = side_by_sides(&run, &study)?;
    write_out(&run, &out, &found)?;

    report::print_table(&run);
    let (skipped, ran) = cache.tally();
    if !skipped.is_empty() {
        println!(
            "{} of {} stages were already done for the same inputs and were skipped",
            skipped.len(),
            skipped.len() + ran.len()
        );
    }
    println!("report: {}", out.join("report.md").display());
    println!("{:.1} s in all", started.elapsed().as_secs_f64());
    Ok(())
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

/// Hull against hull, by both methods.
fn compare(curves: &[Curve], others: &[published::Other]) -> Vec<Bd> {
    let pair = |test: (&str, &[bd::Point]), anchor: (&str, &[bd::Point])| {
        let (t, a) = (bd::hull(test.1), bd::hull(anchor.1));
        Bd {
            test: test.0.to_owned(),
            anchor: anchor.0.to_owned(),
            rate_cubic: bd::bd_rate(&a, &t, Method::Cubic),
            rate_pchip: bd::bd_rate(&a, &t, Method::Pchip),
            psnr_cubic: bd::bd_psnr(&a, &t, Method::Cubic),
            psnr_pchip: bd::bd_psnr(&a, &t, Method::Pchip),
        }
    };
    let mut out = Vec::new();
    if let [uniform, adaptives @ ..] = curves {
        for adaptive in adaptives {
            out.push(pair((&adaptive.name, &adaptive.curve()), (&uniform.name, &uniform.curve())));
        }
    }
    for other in others.iter().filter(|o| o.points.len() >= 4) {
        // A published curve is of another model; only the chain recorded on this very model and
        // the peers recorded with it can be compared by rate.
        if other.name == PAPER_CHAIN || other.source.starts_with("peers.json") {
            let anchor = other.curve();
            for curve in curves {
                out.push(pair((&curve.name, &curve.curve()), (&other.name, &anchor)));
            }
        }
    }
    out
}

fn provenance(program: String, model: String, views: String) -> Manifest {
    let args: Vec<String> = std::env::args().skip(1).collect();
    Manifest {
        command: format!("cargo xtask {}", args.join(" ")),
        commit: manifest::commit(),
        program_sha256: program,
        model_sha256: model,
        views_sha256: views,
        threads: rayon::current_num_threads(),
        processor: manifest::processor(),
        target: format!("{}-{}", std::env::consts::ARCH, std::env::consts::OS),
    }
}

/// Pictures of the first views at the lowest, a middle and the highest rate of the last curve.
fn side_by_sides(run: &Run, study: &Study<'_>) -> Result<Vec<Picture>> {
    let Some(curve) = run.curves.last() else { return Ok(Vec::new()) };
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
    let mut out = Vec::new();
    for (v, shot) in study.shots.iter().take(PICTURE_VIEWS).enumerate() {
        let read = |name: &String| measure::read_photo(&study.out.join(name));
        let original = read(&originals[v])?;
        for point in chosen.iter().filter_map(|&i| curve.points.get(i)) {
            let view = &shot.view.camera.name;
            let stem = pictures::stem(view);
            let file = format!("pictures/{stem}-{}-q{:.0}.png", curve.name, point.quality);
            let decoded = read(&point.renders[v])?;
            let panel = pictures::side_by_side(&[&shot.photo, &original, &decoded]);
            pictures::write(&study.out.join(&file), &panel)?;
            let db = |s: &measure::Score| s.views.get(v).map_or(f64::NAN, |x| x.psnr_db);
            let caption = format!(
                "photo | original model, {} MB, {:.2} dB | decoded from {} MB ({}, quality {:.0}), {:.2} dB",
                report::megabytes(run.original.file_bytes),
                db(&run.original.score),
                report::megabytes(point.bytes),
                curve.name,
                point.quality,
                db(&point.score)
            );
            out.push(Picture { file, view: view.clone(), caption });
        }
    }
    Ok(out)
}

fn write_out(run: &Run, out: &Path, found: &Found) -> Result<()> {
    let put = |name: &str, text: String| {
        fs::write(out.join(name), text)
            .with_context(|| format!("write {}", out.join(name).display()))
    };
    put("rd.json", serde_json::to_string_pretty(run).context("rd.json")? + "\n")?;
    put("rd.svg", plot::svg(run).with_context(|| format!("plot {}", found.name))?)?;
    put("report.md", report::markdown(run))
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
