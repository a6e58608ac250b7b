//! What adaptive voxelization brings: rate-distortion curves of the strategies at real bytes.

use std::path::PathBuf;

use anyhow::{Result, ensure};
use voxel::{Cube, Importance, Merge, Merging, RateDistortion, Strategy, voxelize};

use crate::bd::{self, Method, Point};
use crate::cells;
use crate::chart::{Axis, Chart, Series};
use crate::measure;
use crate::page::{Page, Table, signed};
use crate::scenes::TestScene;

/// Flags of `cargo xtask bench-voxel`.
#[derive(Clone, Debug, clap::Args)]
pub struct VoxelOptions {
    /// Scenes: names of crates/eval/scenes.toml, or folders
    #[arg(default_values_t = ["fox", "bonsai", "room"].map(String::from))]
    scenes: Vec<String>,
    /// Qualities of the curves
    #[arg(long, value_delimiter = ',', default_values_t = [26.0, 40.0, 54.0, 68.0, 82.0])]
    qualities: Vec<f32>,
    /// Where the page goes; the pictures lie beside it
    #[arg(long, default_value = "docs/results/voxel.md")]
    out: PathBuf,
}

/// The curve that the others are compared with.
const ANCHOR: &str = "Uniform, Moments merging";

/// lambdas at quality 50. There are three per quality, as there are three depths per quality for the
/// other strategies.
const AT_50: [f64; 3] = [4e-3, 8e-3, 1.6e-2];

/// The lambda of a quality. It follows the square of the attribute steps, which halve every 15
/// points of quality.
fn lambda(at_50: f64, quality: f32) -> f64 {
    at_50 * (-2.0 * (f64::from(quality) - 50.0) / 15.0).exp2()
}

/// Attribute bits per Gaussian, as measured in streams of pruned scenes.
fn bits(quality: f32) -> f64 {
    30.0 * ((f64::from(quality) - 50.0) / 20.5).exp2()
}

/// A scene with what the strategies need of it.
struct Study<'a> {
    test: &'a TestScene,
    cube: Cube,
    /// Sum of squared blending weights of each Gaussian over the training views.
    seen: Vec<f32>,
    /// The uniform depth that all strategies are compared around.
    depth: u8,
}

/// The points of one strategy at all its settings.
struct Curve {
    name: String,
    points: Vec<Point>,
}

/// Measures and writes the page.
///
/// # Errors
/// If a scene cannot be read, or a stage fails.
pub fn run(options: &VoxelOptions) -> Result<()> {
    let mut page = Page::new(&options.out, "What does adaptive voxelization bring?");
    introduction(&mut page, options);
    let mut table = Table::new(&format!("strategy | {}", options.scenes.join(" | ")));
    let mut charts = Vec::new();
    for name in &options.scenes {
        let test = TestScene::open(name, usize::MAX)?;
        let curves = curves(&Study::of(&test)?, &options.qualities)?;
        let hulls: Vec<Vec<Point>> = curves.iter().map(|c| bd::hull(&c.points)).collect();
        let anchor = curves.iter().position(|c| c.name == ANCHOR).map(|i| hulls[i].clone());
        for (i, (curve, hull)) in curves.iter().zip(&hulls).enumerate() {
            let rate = bd::bd_rate(anchor.as_deref().unwrap_or_default(), hull, Method::Pchip);
            if table.rows.len() == i {
                table.row(cells![curve.name]);
            }
            table.rows[i].push(signed(rate, 1, " %"));
        }
        let line = |(c, hull): (&Curve, &Vec<Point>)| {
            Series::ours(&c.name, hull.iter().map(|p| (p.rate / 1e6, p.psnr_db)).collect())
        };
        let axes = ["size, MB (10⁶ bytes)", "PSNR, dB"].map(Axis::linear);
        let title = format!("{}: held-out PSNR, no fine-tune", test.files.name);
        let chart = Chart::new(title, axes, curves.iter().zip(&hulls).map(line), None);
        charts.push((format!("-{}", test.files.name), chart));
    }
    page.table(&table);
    charts.into_iter().for_each(|(suffix, chart)| page.chart(&suffix, chart));
    page.write()
}

impl<'a> Study<'a> {
    fn of(test: &'a TestScene) -> Result<Self> {
        let cube = voxel::cube_of(&test.model.means)?;
        let seen = finetune::saliency(&test.model, &test.training).squared;
        // The shallowest depth that keeps nine Gaussians in ten apart.
        let mut depth = 4;
        while depth < 20 {
            let leaves = voxelize(&test.model, &cube, &Strategy::Uniform { depth })?.len();
            if leaves * 10 >= test.model.len() * 9 {
                break;
            }
            depth += 1;
        }
        Ok(Self { test, cube, seen, depth })
    }

    /// Voxelizes, merges, encodes, decodes and renders one operating point.
    fn point(&self, strategy: &Strategy, merging: Merge, quality: f32) -> Result<Point> {
        let model = &self.test.model;
        let v = voxelize(model, &self.cube, strategy)?;
        let seen = Importance::Given(self.seen.clone());
        let merged = Merging::new(model, &v, merging, &seen)?.scene();
        let mut options = gsvx::EncodeOptions::from_quality(quality)?;
        options.importance = Some(v.sums(&self.seen));
        let bytes = gsvx::encode_voxels(&merged, v.octree(), None, &options)?.bytes;
        let decoded = gsvx::decode(&bytes)?;
        ensure!(decoded.means == merged.means, "decoded means are not the voxelized ones");
        let psnr_db = measure::psnr_db(&decoded, &self.test.held_out);
        Ok(Point { rate: bytes.len() as f64, psnr_db })
    }

    fn curve(
        &self,
        name: &str,
        merging: Merge,
        settings: impl IntoIterator<Item = (Strategy, f32)>,
    ) -> Result<Curve> {
        eprintln!("{}: {name} ...", self.test.files.name);
        let points = settings.into_iter().map(|(s, q)| self.point(&s, merging, q));
        Ok(Curve { name: name.to_owned(), points: points.collect::<Result<_>>()? })
    }
}

fn curves(study: &Study<'_>, qualities: &[f32]) -> Result<Vec<Curve>> {
    // Each quality is measured at the depths that can be on the hull.
    let lift = |q: f32| match q {
        q if q < 47.0 => -2,
        q if q < 61.0 => -1,
        _ => 0,
    };
    let depth = |by: i32| (i32::from(study.depth) + by).clamp(2, 18) as u8;
    let grid = || {
        let around = |q: f32| (0..3).map(move |i| (depth(lift(q) + i), q));
        qualities.iter().flat_map(move |&q| around(q))
    };
    let uniform = |merging| {
        let settings = grid().map(|(depth, q)| (Strategy::Uniform { depth }, q));
        study.curve(&format!("Uniform, {merging:?} merging"), merging, settings)
    };
    let paper = |merging| {
        let settings = grid().map(|(depth, q)| (Strategy::paper(depth - 1, depth + 3), q));
        study.curve(&format!("Paper, {merging:?} merging"), merging, settings)
    };
    let pruned = |name: &str, at_50: &[f64], options: &dyn Fn(f64) -> RateDistortion| {
        let grid = qualities.iter().flat_map(|&q| at_50.iter().map(move |&l| (q, lambda(l, q))));
        let settings = grid.map(|(q, l)| {
            let mut o = options(l);
            o.cost.gaussian = bits(q);
            (Strategy::RateDistortion(o), q)
        });
        study.curve(name, Merge::Moments, settings)
    };
    let seen = |l: f64| RateDistortion::seen(l, study.seen.clone());
    let kept = |l: f64| RateDistortion { drop: None, ..seen(l) };
    Ok(vec![
        uniform(Merge::Paper)?,
        uniform(Merge::Moments)?,
        paper(Merge::Paper)?,
        paper(Merge::Moments)?,
        pruned("RateDistortion, no cameras", &AT_50, &RateDistortion::unseen)?,
        pruned("RateDistortion, nothing dropped", &AT_50[1..2], &kept)?,
        pruned("RateDistortion", &AT_50, &seen)?,
    ])
}

fn introduction(page: &mut Page, options: &VoxelOptions) {
    page.text(format!("`cargo xtask bench-voxel {}`.", options.scenes.join(" ")));
    page.text(
        "`Uniform` has all leaves at one depth, `Paper` follows the paper's criteria between two depths, and \
         `RateDistortion`, the default, minimises distortion plus lambda times bits \
         ([voxel](../../crates/voxel/README.md)). `RateDistortion` weighs each Gaussian by what the training cameras \
         see of it, and drops those that show less than their bits cost. \"No cameras\" guesses the weights from \
         opacity and size and drops nothing; \"nothing dropped\" has cameras. \"Paper merging\" averages the Gaussians \
         of a leaf as the paper does; \"Moments merging\" keeps their first two moments.",
    );
    page.text(
        "`Paper` needs more bytes than `Uniform`, because its criteria send the largest 20 % of the Gaussians, and \
         every cell with a mean outside its inscribed ball, to the deepest level, at about three bits a level. A \
         large Gaussian tolerates a larger displacement, not a smaller one.",
    );
    page.text(format!(
        "Streams have importances from the cameras and no fine-tune (with one: `cargo xtask rd-curve SCENE \
         --experiment adaptive`); decoded, they are rendered at the held-out views. Each strategy has {} settings: {} \
         qualities with three depths or lambdas each (\"nothing dropped\" has one). BD-rate between the hulls of all \
         points, by pchip, against \"{ANCHOR}\":",
        3 * options.qualities.len(),
        options.qualities.len(),
    ));
}
