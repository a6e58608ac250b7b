//! `cargo xtask paper`: each claim of the paper beside what its system, as the crate `paper` has it, does on the scenes
//! here.

use std::path::PathBuf;

use anyhow::{Context, Result};
use finetune::Backend;
use voxel::{Merge, ReleasedRule, Strategy, w2};

use super::distribution;
use crate::bd::{self, Point};
use crate::measure::{self, Metric};
use crate::page::{Page, Table, signed};
use crate::process::timed;
use crate::rd_curve::one_tune;
use crate::rd_curve::options::{CurveOptions, TUNED_QUALITIES, Tuning};
use crate::rd_curve::plan::{
    self, CameraUse, Coding, CurvePlan, GSVX, PAPER_QPS, Voxels, criteria, paper_codings,
};
use crate::rd_curve::stages::{self, Branch};
use crate::record::{Curve, Record};
use crate::study::Study;
use crate::{peers, published, scenes};

/// Flags of `cargo xtask paper`.
#[derive(Clone, Debug, clap::Args)]
pub struct PaperOptions {
    /// Scenes to measure
    #[arg(default_values_t = ["fox", "bonsai", "room"].map(String::from))]
    scenes: Vec<String>,
    /// Steps of a fine-tune from the paper's initialisation, 8000 in the paper; without it, 30/8 as many
    #[arg(long, default_value_t = 100, value_parser = clap::value_parser!(u64).range(1..))]
    steps: u64,
    /// Two held-out views
    #[arg(long)]
    quick: bool,
    /// Where the fine-tunes compute: cpu, gpu, or auto for a GPU if there is one
    #[arg(long, value_name = "WHERE", default_value = "cpu")]
    backend: Backend,
    /// Scenes that gsvx tunes too, at six qualities: about 8 minutes for 180,000 Gaussians on two cores
    #[arg(long, value_delimiter = ',', default_value = scenes::DEFAULT)]
    tune: Vec<String>,
    /// Draw instead how dense and how large the Gaussians of each scene are, as in figure 3: DIR/SCENE.png
    #[arg(long, value_name = "DIR")]
    pictures: Option<PathBuf>,
    /// Where the page goes
    #[arg(long, default_value = "docs/results/paper.md")]
    out: PathBuf,
}

/// What the first table does not say of its rows.
const HOW_TO_READ: &str = "\"From nothing\" are grey, round, translucent Gaussians at the voxels' centres. Rows of the paper against gsvx and SPZ take the better of uniform J and criteria at each quality. Why the figures differ: [crates/paper](../../crates/paper/README.md#which-claims-hold-and-why).";

/// What the page has of one scene.
struct ScenePart {
    depth: u8,
    /// Claims, what the paper says, and what holds here.
    claims: Vec<[String; 3]>,
    rows: Vec<Row>,
}

/// Measures and writes the page.
///
/// # Errors
/// If a scene cannot be read or a file cannot be written.
pub fn run(options: &PaperOptions) -> Result<()> {
    let PaperOptions { scenes, steps, .. } = options;
    if let Some(folder) = &options.pictures {
        return distribution::draw(scenes, folder);
    }
    let parts = scenes.iter().map(|name| part(name, options));
    let parts: Vec<ScenePart> = parts.collect::<Result<_>>()?;
    let depths = scenes.iter().zip(&parts).map(|(name, part)| format!("{name} {}", part.depth));
    let mut page = Page::new(&options.out, "The paper's claims");
    page.text(format!(
        "`cargo xtask paper {} --steps {steps} --tune {}`{}. The paper's system: its voxelization, initialisation (plain means, covariance of the largest), fine-tune (means fixed, loss and rates of the 3DGS code; {steps} steps where the paper \
         takes 8000), coding with both covariance modes and QP triples from its hull. Its scenes, Playroom and Truck, are not measured here (`cargo xtask fetch` gets them). J is the uniform depth at which a merged model renders like the original to 40 dB: {}. The criteria reach from J-3 to J+5, as on Playroom, with v = 20 %, tau1 = 30 (of the authors' code) and tau2 = half a voxel.",
        scenes.join(" "),
        options.tune.join(","),
        if options.quick { " `--quick`" } else { "" },
        depths.collect::<Vec<_>>().join(", "),
    ));
    let mut table = Table::new(format!("claim | the paper | {}", scenes.join(" | ")));
    for (i, [claim, paper, _]) in parts.first().map_or(&[][..], |p| &p.claims).iter().enumerate() {
        let here: Vec<&str> = parts.iter().map(|part| part.claims[i][2].as_str()).collect();
        table.row(format!("{claim} | {paper} | {}", here.join(" | ")));
    }
    page.table(&table);
    page.text(HOW_TO_READ);
    page.data("Voxelizations beside each other:", voxelizations(scenes, &parts));
    page.write()
}

fn part(name: &str, options: &PaperOptions) -> Result<ScenePart> {
    let mut curve_options = CurveOptions::of(name)?;
    curve_options.quick = options.quick;
    let study = &curve_options.study()?;
    let depth = plan::depth(study, None)?;
    let strategies = strategies(depth);
    let [_, (_, uniform), _, (_, to_far), (_, to_near), .., (_, released)] = &strategies;
    let rows = strategies.iter().map(|(what, strategy)| row(study, what, strategy));
    let rows = rows.collect::<Result<Vec<Row>>>()?;

    let steps = options.steps;
    let tuning = Tuning { steps, initialised: true, backend: options.backend };
    let curve = |name: &'static str, steps, tuning| {
        stages::curve(study, CurvePlan { name, what: String::new(), tuning, steps })
    };
    let paper = |strategy: &Strategy, tuning| {
        curve("paper", vec![(Voxels::given(strategy, Merge::Paper), paper_codings())], tuning)
    };
    let qualities = curve_options.qualities()?;
    let in_gsvx = |name, strategy: &Strategy| {
        let codings = qualities.iter().map(|&q| Coding::own(q)).collect();
        curve(name, vec![(Voxels::given(strategy, Merge::Moments), codings)], None)
    };
    let own = TUNED_QUALITIES
        .map(|q| (Voxels::default(q, CameraUse::DropUnseen), vec![Coding::own(q)]))
        .into();
    let nothing = Tuning { steps: steps * 30 / 8, initialised: false, ..tuning };
    let blank = Voxels::given(uniform, Merge::Paper);
    let from_nothing = Branch::new(study, &blank, Some(nothing)).voxelized()?.score.psnr_db;
    let tuned = [
        paper(uniform, Some(tuning))?,
        paper(to_far, Some(tuning))?,
        paper(to_near, Some(tuning))?,
        paper(released, Some(tuning))?,
    ];
    let untuned = [paper(uniform, None)?, paper(to_far, None)?];
    let in_gsvx =
        [in_gsvx("paper page uniform", uniform)?, in_gsvx("paper page criteria", to_far)?];
    let gsvx = curve(GSVX, own, None)?.rates(Metric::Psnr);
    let is_tuned = options.tune.iter().any(|tuned| tuned == name) && !options.quick;
    let [one_tune, tunes] = match is_tuned {
        true => one_tune(study)?,
        false => [Vec::new(), Vec::new()],
    };
    let original = study.original()?.score.psnr_db;

    let mut claims: Vec<[String; 3]> = Vec::new();
    let mut claim = |what: &str, paper: &str, here: String| {
        claims.push([what.into(), paper.into(), here]);
    };
    let bd = |anchor: &[Point], test: &[Point]| signed(bd::bd_rate(anchor, test), 1, " %");
    let is_lossless = |p: &Record| p.setting.contains("lossless");
    let of = |curve: &Curve, mode: Option<bool>| -> Vec<Point> {
        let points = curve.points.iter().filter(|p| mode.is_none_or(|m| m == is_lossless(p)));
        points.map(|p| p.rate(Metric::Psnr)).collect()
    };
    let rate = |test: &Curve, anchor: &Curve, mode| bd(&of(anchor, mode), &of(test, mode));
    let says = "Playroom -13.42 %, Truck -12.64 %";
    let [of_uniform, of_criteria, of_near, of_released] = &tuned;
    claim(
        "Table 1, fig. 8: criteria against uniform J, fine-tuned",
        says,
        rate(of_criteria, of_uniform, None),
    );
    let [lossy, lossless] = [false, true].map(|mode| rate(of_criteria, of_uniform, Some(mode)));
    claim("the same, covariances by the codebook", "", lossy);
    claim("the same, covariances without loss", "", lossless);
    claim("the same, not fine-tuned", "", rate(&untuned[1], &untuned[0], None));
    let what = "the same, merged and coded as gsvx does";
    claim(what, "", rate(&in_gsvx[1], &in_gsvx[0], None));
    claim("criteria from J-3 to J+1 only, fine-tuned", "", rate(of_near, of_uniform, None));
    let what = "the authors' code instead, fine-tuned";
    claim(what, "(made its figures)", rate(of_released, of_uniform, None));
    let share = |of: fn(&Row) -> f64| format!("{:.2}", of(&rows[3]) / of(&rows[1]));
    let says = "a significant reduction";
    claim("criteria / uniform J: Gaussians", says, share(|r| r.leaves as f64));
    claim(
        "criteria / uniform J: bytes of positions",
        "smaller octrees",
        share(|r| r.geometry as f64),
    );
    let says = "the criteria minimise it";
    claim("criteria / uniform J: equation 4", says, share(|r| r.distortion));
    let factor = factor(study, to_far)?;
    claim("time of barycenters / of the criteria", "about 15", format!("{factor:.0}"));
    let short = |db: f64| format!("{:+.2} dB", db - original);
    let [tuned_uniform, tuned_criteria] =
        [of_uniform, of_criteria].map(|curve| short(curve.voxelized[0].score.psnr_db));
    let what = format!("fig. 7: uniform J, initialised, after {steps} steps, to the original");
    claim(&what, "near 0 after 8000", tuned_uniform);
    let what = format!("fig. 6 and 7: from nothing, after {} steps", nothing.steps);
    claim(&what, "below it after 30000", short(from_nothing));
    let what = "criteria, initialised, fine-tuned, to the original";
    claim(what, "as uniform", tuned_criteria);
    let (ac, dc, opacity, quality) = PAPER_QPS[PAPER_QPS.len() - 2];
    let [book, exact] = [false, true].map(|mode| {
        let is_it = |p: &&Record| p.quality == quality && is_lossless(p) == mode;
        of_uniform.points.iter().find(is_it)
    });
    let more = book.zip(exact).map(|(book, exact)| {
        let more = 100.0 * (exact.bytes as f64 / book.bytes as f64 - 1.0);
        format!("{more:+.0} %, {:+.2} dB", exact.score.psnr_db - book.score.psnr_db)
    });
    let what = format!("covariances without loss against the codebook, QP {ac}/{dc}/{opacity}");
    claim(&what, "a higher bitrate", more.unwrap_or("-".into()));
    let smallest = of_uniform.points.iter().min_by_key(|p| p.bytes);
    let indices = smallest.and_then(|p| {
        let bytes = p.parts.iter().find(|(part, _)| part == "codebook indices")?.1;
        Some(100.0 * bytes as f64 / p.bytes as f64)
    });
    let indices = indices.map_or("-".into(), |share| format!("{share:.0} %"));
    claim("codebook indices in the smallest stream", "not counted", indices);
    // The hull takes the better of the two octrees, which is the paper's side.
    let best = |curves: &[Curve]| -> Vec<Point> {
        curves.iter().flat_map(|curve| curve.rates(Metric::Psnr)).collect()
    };
    let (paper, paper_untuned) = (best(&tuned[..2]), best(&untuned));
    let spz = peers::curves(study)?;
    let spz = spz.iter().find(|o| o.name.starts_with("SPZ") && o.is_comparable());
    let against_spz = spz.map_or("-".into(), |spz| bd(&spz.rates(Metric::Psnr), &paper));
    let what = "section 4.2: the paper, fine-tuned, against SPZ";
    claim(what, "less by large margins", against_spz);
    claim("gsvx against the paper, neither tuned", "", bd(&paper_untuned, &gsvx));
    let what = "`gsvx tune --effort quick --qualities`, six streams, against the paper, fine-tuned";
    claim(what, "its promise", bd(&paper, &one_tune));
    claim("the same against gsvx untuned", "", bd(&gsvx, &one_tune));
    let what = "a run for each rate, against the paper, fine-tuned once";
    claim(what, "a critical limit of peers", bd(&paper, &tunes));
    claim("the same against gsvx untuned", "", bd(&gsvx, &tunes));
    let what = "the authors' published points";
    claim(what, &published_rates()?, String::new());

    Ok(ScenePart { depth, claims, rows })
}

/// The voxelizations of the page about a uniform depth.
fn strategies(depth: u8) -> [(String, Strategy); 8] {
    let (low, near, far) = (depth.saturating_sub(3).max(1), depth + 1, (depth + 5).min(20));
    let uniform = |depth| Strategy::Uniform { depth };
    let to_near =
        |v, tau2| Strategy::Paper { large_percent: v, j_low: low, j_high: near, tau1: 30, tau2 };
    let span = |high: u8| {
        let [low, high] = [low, high].map(|end| i32::from(end) - i32::from(depth));
        format!("criteria, J{low:+} to J{high:+}")
    };
    [
        ("uniform, J-1".into(), uniform(depth - 1)),
        ("uniform, J".into(), uniform(depth)),
        ("uniform, J+1".into(), uniform(near)),
        (span(far), criteria(depth)),
        (span(near), Strategy::paper(low, near)),
        ("without large ones (v = 0)".into(), to_near(0.0, 0.5)),
        ("without v and tau2".into(), to_near(0.0, 1.0)),
        (
            "the authors' code from J-2".into(),
            Strategy::Released(ReleasedRule::new(depth.saturating_sub(2))),
        ),
    ]
}

/// One voxelization.
struct Row {
    what: String,
    leaves: usize,
    geometry: usize,
    /// Equation 4 over all leaves, at their barycenters.
    distortion: f64,
    /// At the held-out views, as the paper initialises and by moments, dB.
    initialised: f64,
    moments: f64,
}

fn row(study: &Study, what: &str, strategy: &Strategy) -> Result<Row> {
    let scene = &study.test.model;
    let voxels = voxel::voxelize(scene, &voxel::cube_of(&scene.means)?, strategy)?;
    let db = |merge| -> Result<f64> {
        Ok(measure::psnr_db(&voxel::merge(scene, &voxels, merge)?, &study.test.held_out))
    };
    Ok(Row {
        what: what.to_owned(),
        leaves: voxels.len(),
        geometry: gpcc_lite::geometry::encode(voxels.octree())?.len(),
        distortion: w2::total_distortion(scene, &voxels),
        initialised: db(Merge::Paper)?,
        moments: db(Merge::Moments)?,
    })
}

/// How many times longer the barycenters of the final leaves take than the criteria that chose them.
fn factor(study: &Study, strategy: &Strategy) -> Result<f64> {
    let scene = &study.test.model;
    let cube = voxel::cube_of(&scene.means)?;
    let (voxels, criteria) = timed(|| voxel::voxelize(scene, &cube, strategy));
    let voxels = voxels?;
    let (_, barycenters) = timed(|| w2::total_distortion(scene, &voxels));
    Ok(barycenters / criteria)
}

/// The figures of Table 1 from the points that the authors published, by our measure.
fn published_rates() -> Result<String> {
    let rate = |scene: &str| -> Result<String> {
        let [uniform, adaptive] = published::uniform_and_adaptive(scene)?;
        let rate = bd::bd_rate(&uniform, &adaptive).context("published points")?;
        Ok(format!("{scene} {rate:+.2} %"))
    };
    Ok(format!("{}, {}", rate("playroom")?, rate("truck")?))
}

fn voxelizations(scenes: &[String], parts: &[ScenePart]) -> Table {
    let mut table = Table::new(
        "scene | octree | Gaussians | bytes of positions | equation 4, to uniform J | initialised as the paper, dB | by moments, dB",
    );
    let rows = scenes.iter().zip(parts).flat_map(|(name, part)| {
        part.rows.iter().map(move |row| (name, row, row.distortion / part.rows[1].distortion))
    });
    for (name, row, distortion) in rows {
        let Row { what, leaves, geometry, initialised, moments, .. } = row;
        table.row(format!(
            "{name} | {what} | {leaves} | {geometry} | {distortion:.2} | {initialised:.2} | {moments:.2}"
        ));
    }
    table
}
