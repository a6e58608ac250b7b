//! `cargo xtask paper`: each claim of the paper beside what its system, as the crate `paper` has it, does on the scenes
//! here.

use std::path::PathBuf;

use anyhow::{Context, Result};
use finetune::Backend;
use voxel::{Merge, Released, Strategy, w2};

use crate::bd::{self, Point};
use crate::measure::{self, Metric};
use crate::page::{Page, Table, signed};
use crate::process::timed;
use crate::rd_curve::one_tune;
use crate::rd_curve::options::{CurveOptions, TUNED_QUALITIES, Tuning};
use crate::rd_curve::plan::{
    self, Coding, CurvePlan, GSVX, PAPER_QPS, Voxels, criteria, paper_codings,
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
    /// Where the page goes
    #[arg(long, default_value = "docs/results/paper.md")]
    out: PathBuf,
}

/// What is measured on one scene.
struct SceneFigures {
    name: String,
    original: Record,
    depth: u8,
    rows: Vec<Row>,
    /// Fine-tuned: uniform, criteria as far as the paper's, criteria nearer, the released code.
    tuned: [Curve; 4],
    /// Not fine-tuned: uniform, criteria as far as the paper's.
    untuned: [Curve; 2],
    /// The same two octrees in gsvx's merging and coding, not fine-tuned.
    in_gsvx: [Curve; 2],
    /// dB after a fine-tune from nothing, 30/8 as long.
    from_nothing: f64,
    /// Seconds of the barycenters of the final leaves over seconds of the criteria.
    factor: f64,
    /// SPZ, if it was recorded.
    spz: Option<Vec<Point>>,
    /// gsvx, not tuned.
    gsvx: Curve,
    /// `gsvx tune`: one run for all qualities, a run for each.
    one_tune: Option<[Vec<Point>; 2]>,
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

/// Measures and writes the page.
///
/// # Errors
/// If a scene cannot be read or a file cannot be written.
pub fn run(options: &PaperOptions) -> Result<()> {
    let all: Vec<SceneFigures> =
        options.scenes.iter().map(|s| measure_scene(s, options)).collect::<Result<_>>()?;
    let mut page = Page::new(&options.out, "The paper's claims");
    page.text(format!(
        "`cargo xtask paper {} --steps {}`{}. The system is that of the paper, by the crate `paper`: its voxelization, its \
         initialisation (plain means, covariance of the largest), its fine-tune (means fixed, loss and rates of the 3DGS \
         code), its coding with both covariance modes and QP triples from its published hull. Playroom and Truck, the \
         paper's scenes, have never been measured here (`cargo xtask fetch` gets them). J is the uniform depth at which a \
         merged model renders like the original to 40 dB: {}. The paper's criteria reach from J-3 to J+5, as on Playroom \
         (8 to 16 about 11), with v = 20 %, tau1 = 30 and tau2 = half a voxel; v and tau1 are those of the authors' code, \
         the text has none. Fine-tunes take {} steps where the paper takes 8000. BD-rates are by pchip between hulls.",
        options.scenes.join(" "),
        options.steps,
        if options.quick { " `--quick`" } else { "" },
        all.iter().map(|m| format!("{} {}", m.name, m.depth)).collect::<Vec<_>>().join(", "),
        options.steps,
    ));
    page.table(&claims(&all, options.steps)?);
    page.text(include_str!("paper.md").trim());
    for scene in &all {
        page.text(format!("## Voxelizations: {}", scene.name));
        page.table(&voxelizations(scene));
    }
    page.write()
}

fn measure_scene(name: &str, options: &PaperOptions) -> Result<SceneFigures> {
    let mut curve_options = CurveOptions::of(name)?;
    curve_options.quick = options.quick;
    let study = &curve_options.study()?;
    let depth = plan::depth(study, None)?;
    let (low, near) = (depth.saturating_sub(3).max(1), depth + 1);
    let uniform = Strategy::Uniform { depth };
    let far = criteria(depth);
    let released = Strategy::Released(Released::new(depth.saturating_sub(2)));
    let close = Strategy::paper(low, near);
    let without = |large_percent, tau2| Strategy::Paper {
        large_percent,
        j_low: low,
        j_high: near,
        tau1: 30,
        tau2,
    };
    let span = |low: u8, high: u8| {
        format!(
            "J{:+} to J{:+}",
            i32::from(low) - i32::from(depth),
            i32::from(high) - i32::from(depth)
        )
    };
    let near_span = span(low, near);
    let rows = [
        ("uniform, J-1".into(), Strategy::Uniform { depth: depth - 1 }),
        ("uniform, J".into(), uniform.clone()),
        ("uniform, J+1".into(), Strategy::Uniform { depth: near }),
        (format!("criteria, {}", span(low, (depth + 5).min(20))), far.clone()),
        (format!("criteria, {near_span}"), close.clone()),
        ("the same without large ones (v = 0)".into(), without(0.0, 0.5)),
        ("the same without v and tau2".into(), without(0.0, 1.0)),
        ("the authors' code from J-2".into(), released.clone()),
    ];
    let rows = rows.into_iter().map(|(what, strategy)| row(study, what, &strategy));
    let rows = rows.collect::<Result<Vec<Row>>>()?;

    let tuning = Tuning { steps: options.steps, initialised: true, backend: options.backend };
    let curve = |name: &'static str, voxels: Voxels, tuning, codings: Vec<Coding>| {
        let what = voxels.what.clone();
        stages::curve(study, CurvePlan { name, what, tuning, steps: vec![(voxels, codings)] })
    };
    let paper = |strategy: &Strategy, tuning| {
        curve("paper", Voxels::paper(strategy.clone()), tuning, paper_codings())
    };
    let qualities = curve_options.qualities()?;
    let in_gsvx = |name, strategy: &Strategy| {
        let codings = qualities.iter().map(|&q| Coding::Quality(q)).collect();
        curve(name, Voxels::fixed(strategy.clone()), None, codings)
    };
    let own = TUNED_QUALITIES.map(|q| (Voxels::default(q), vec![Coding::Quality(q)])).into();
    let nothing = Tuning { steps: options.steps * 30 / 8, initialised: false, ..tuning };
    let blank = Voxels::paper(uniform.clone());
    let from_nothing = Branch::new(study, &blank, Some(nothing)).voxelized()?.score.psnr_db;
    let tuned = [
        paper(&uniform, Some(tuning))?,
        paper(&far, Some(tuning))?,
        paper(&close, Some(tuning))?,
        paper(&released, Some(tuning))?,
    ];
    let spz =
        peers::curves(study)?.into_iter().find(|o| o.name.starts_with("SPZ") && o.is_comparable());
    Ok(SceneFigures {
        name: name.to_owned(),
        original: study.original()?,
        depth,
        rows,
        untuned: [paper(&uniform, None)?, paper(&far, None)?],
        in_gsvx: [in_gsvx("paper page uniform", &uniform)?, in_gsvx("paper page criteria", &far)?],
        from_nothing,
        factor: factor(study, &far)?,
        spz: spz.map(|spz| spz.rates(Metric::Psnr)),
        gsvx: stages::curve(
            study,
            CurvePlan { name: GSVX, what: String::new(), tuning: None, steps: own },
        )?,
        one_tune: (name == scenes::DEFAULT && !options.quick)
            .then(|| one_tune(study))
            .transpose()?,
        tuned,
    })
}

fn psnr(curve: &Curve) -> Vec<Point> {
    curve.rates(Metric::Psnr)
}

fn row(study: &Study, what: String, strategy: &Strategy) -> Result<Row> {
    let scene = &study.test.model;
    let voxels = voxel::voxelize(scene, &voxel::cube_of(&scene.means)?, strategy)?;
    let db = |merge| -> Result<f64> {
        Ok(measure::psnr_db(&voxel::merge(scene, &voxels, merge)?, &study.test.held_out))
    };
    Ok(Row {
        what,
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

/// The claims, one a row; a column for the paper and one for each scene.
fn claims(all: &[SceneFigures], steps: u64) -> Result<Table> {
    let names = all.iter().map(|m| format!(" | {}", m.name)).collect::<String>();
    let mut table = Table::new(format!("claim | the paper{names}"));
    let mut claim = |what: &str, paper: &str, here: &dyn Fn(&SceneFigures) -> String| {
        let here: Vec<String> = all.iter().map(here).collect();
        table.row(format!("{what} | {paper} | {}", here.join(" | ")));
    };
    let bd = |anchor: &[Point], test: &[Point]| signed(bd::bd_rate(anchor, test), 1, " %");
    let rate = |test: &Curve, anchor: &Curve, of: fn(&Record) -> bool| {
        let points = |curve: &Curve| -> Vec<Point> {
            curve.points.iter().filter(|p| of(p)).map(|p| p.rate(Metric::Psnr)).collect()
        };
        bd(&points(anchor), &points(test))
    };
    let is_lossless = |p: &Record| p.setting.contains("lossless");
    let lossy = |p: &Record| !p.setting.contains("lossless");
    let both = |_: &Record| true;
    let says = "Playroom -13.42 %, Truck -12.64 %";
    claim("Table 1, fig. 8: criteria against uniform J, fine-tuned", says, &|m| {
        rate(&m.tuned[1], &m.tuned[0], both)
    });
    claim("the same, covariances by the codebook", "", &|m| rate(&m.tuned[1], &m.tuned[0], lossy));
    claim("the same, covariances without loss", "", &|m| {
        rate(&m.tuned[1], &m.tuned[0], is_lossless)
    });
    claim("the same, not fine-tuned", "", &|m| rate(&m.untuned[1], &m.untuned[0], both));
    claim("the same, merged and coded as gsvx does, not fine-tuned", "", &|m| {
        rate(&m.in_gsvx[1], &m.in_gsvx[0], both)
    });
    claim("criteria from J-3 to J+1 only, fine-tuned", "", &|m| {
        rate(&m.tuned[2], &m.tuned[0], both)
    });
    claim("the authors' code instead, fine-tuned", "(made its figures)", &|m| {
        rate(&m.tuned[3], &m.tuned[0], both)
    });
    let share = |row: fn(&Row) -> f64| {
        move |m: &SceneFigures| format!("{:.2}", row(&m.rows[3]) / row(&m.rows[1]))
    };
    claim(
        "criteria / uniform J: Gaussians",
        "a significant reduction",
        &share(|r| r.leaves as f64),
    );
    claim(
        "criteria / uniform J: bytes of positions",
        "smaller octrees",
        &share(|r| r.geometry as f64),
    );
    claim("criteria / uniform J: equation 4", "the criteria minimise it", &share(|r| r.distortion));
    claim("time of barycenters / of the criteria", "about 15", &|m| format!("{:.0}", m.factor));
    let short = |db: f64, m: &SceneFigures| format!("{:+.2} dB", db - m.original.score.psnr_db);
    let tuned = |i: usize| move |m: &SceneFigures| short(m.tuned[i].voxelized[0].score.psnr_db, m);
    claim(
        &format!("fig. 7: uniform J, initialised, after {steps} steps, to the original"),
        "near 0 after 8000",
        &tuned(0),
    );
    claim(
        &format!("fig. 6 and 7: from nothing, after {} steps", steps * 30 / 8),
        "below it after 30000",
        &|m| short(m.from_nothing, m),
    );
    claim("criteria, initialised, fine-tuned, to the original", "as uniform", &tuned(1));
    let (ac, dc, opacity, quality) = PAPER_QPS[PAPER_QPS.len() - 2];
    let modes = |m: &SceneFigures| -> Option<String> {
        let at = |mode: fn(&Record) -> bool| {
            m.tuned[0].points.iter().find(|p| p.quality == quality && mode(p))
        };
        let (book, exact) = (at(lossy)?, at(is_lossless)?);
        let more = 100.0 * (exact.bytes as f64 / book.bytes as f64 - 1.0);
        Some(format!("{more:+.0} %, {:+.2} dB", exact.score.psnr_db - book.score.psnr_db))
    };
    claim(
        &format!("covariances without loss against the codebook, QP {ac}/{dc}/{opacity}"),
        "a higher bitrate",
        &|m| modes(m).unwrap_or("-".into()),
    );
    claim("codebook indices in the smallest stream", "not counted", &|m| {
        let smallest = m.tuned[0].points.iter().min_by_key(|p| p.bytes);
        let indices = smallest.and_then(|p| {
            let bytes = p.parts.iter().find(|(part, _)| part == "codebook indices")?.1;
            Some(100.0 * bytes as f64 / p.bytes as f64)
        });
        signed(indices, 0, " %").replace('+', "")
    });
    // The hull takes the better of the two octrees, which is the paper's side.
    let best = |curves: &[Curve]| -> Vec<Point> { curves.iter().flat_map(psnr).collect() };
    claim("section 4.2: the paper, fine-tuned, against SPZ", "less by large margins", &|m| {
        m.spz.as_ref().map_or("-".into(), |spz| bd(spz, &best(&m.tuned[..2])))
    });
    claim("gsvx against the paper, neither tuned", "", &|m| bd(&best(&m.untuned), &psnr(&m.gsvx)));
    let tuned = |i: usize, anchor: &dyn Fn(&SceneFigures) -> Vec<Point>, m: &SceneFigures| {
        m.one_tune.as_ref().map_or("-".into(), |tuned| bd(&anchor(m), &tuned[i]))
    };
    let paper = |m: &SceneFigures| best(&m.tuned[..2]);
    let gsvx = |m: &SceneFigures| psnr(&m.gsvx);
    let what = "one encoding, many rates: one run of `gsvx tune --effort quick --qualities`, six streams, against the paper, fine-tuned";
    claim(what, "its promise", &|m| tuned(0, &paper, m));
    claim("the same against gsvx untuned", "", &|m| tuned(0, &gsvx, m));
    let what = "a run for each rate, against the paper, fine-tuned once";
    claim(what, "a critical limit of peers", &|m| tuned(1, &paper, m));
    claim("the same against gsvx untuned", "", &|m| tuned(1, &gsvx, m));
    let printed = published_rates()?;
    claim("for reference, the authors' published points", &printed, &|_| String::new());
    Ok(table)
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

fn voxelizations(scene: &SceneFigures) -> Table {
    let mut table = Table::new(
        "octree | Gaussians | bytes of positions | equation 4, to uniform J | initialised as the paper, dB | by moments, dB",
    );
    for row in &scene.rows {
        let Row { what, leaves, geometry, initialised, moments, .. } = row;
        let distortion = row.distortion / scene.rows[1].distortion;
        table.row(format!(
            "{what} | {leaves} | {geometry} | {distortion:.2} | {initialised:.2} | {moments:.2}"
        ));
    }
    table
}
