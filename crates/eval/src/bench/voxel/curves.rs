//! Rate-distortion curves of the strategies at real bytes.

use std::fmt::Write;
use std::path::Path;

use anyhow::{Result, ensure};
use gs_model::Scene;
use voxel::{Importance, Merge, Merging, RateDistortion, Strategy, Voxelization, voxelize};

use super::Options;
use super::models::Study;
use crate::bd::{self, Method, Point};
use crate::chart::{Axis, Chart, Kind, Series};

/// The strategies on one scene.
pub(super) struct Rates {
    pub(super) scene: String,
    /// Name of each strategy, and its BD-rate against [`ANCHOR`], per cent.
    pub(super) strategies: Vec<(String, Option<f64>)>,
    /// All points, as tables.
    pub(super) details: String,
}

/// The curve that the others are compared with on the page.
pub(super) const ANCHOR: &str = "Uniform, Moments merging";

/// One strategy with the points of all its settings. Curves are compared by the hulls of their points.
struct Curve {
    name: String,
    points: Vec<(Point, String)>,
}

/// Voxelizes, merges, encodes, decodes and renders one operating point.
fn point(
    study: &Study,
    strategy: &Strategy,
    merging: Merge,
    quality: f32,
) -> Result<(Point, usize)> {
    let v = voxelize(&study.scene, &study.cube, strategy)?;
    let seen = Importance::Given(study.seen.clone());
    let merged = Merging::new(&study.scene, &v, merging, &seen)?.scene();
    Ok((coded(study, &merged, &v, quality)?, v.len()))
}

/// Encodes a merged scene, decodes the bytes and renders what comes out.
pub(super) fn coded(
    study: &Study,
    merged: &Scene,
    v: &Voxelization,
    quality: f32,
) -> Result<Point> {
    let mut options = gsvx::EncodeOptions::from_quality(quality)?;
    options.importance = Some(v.sums(&study.seen));
    let bytes = gsvx::encode_voxels(merged, v, None, &options)?.bytes;
    let decoded = gsvx::decode(&bytes)?;
    ensure!(decoded.means == merged.means, "decoded means are not the voxelized ones");
    Ok(Point { rate: bytes.len() as f64, psnr_db: study.psnr(&decoded) })
}

fn curve(
    study: &Study,
    name: &str,
    merging: Merge,
    settings: impl IntoIterator<Item = (Strategy, f32, String)>,
) -> Result<Curve> {
    let mut points = Vec::new();
    for (strategy, quality, what) in settings {
        let (p, leaves) = point(study, &strategy, merging, quality)?;
        let what = format!("{what}, quality {quality:.0}, {leaves} Gaussians");
        eprintln!("{name}: {what}: {:.0} bytes, {:.2} dB", p.rate, p.psnr_db);
        points.push((p, what));
    }
    Ok(Curve { name: name.to_owned(), points })
}

/// The lambda of a quality. It follows the square of the attribute steps, which halve every 15
/// points of quality.
pub(super) fn lambda(at_50: f64, quality: f32) -> f64 {
    at_50 * (-2.0 * (f64::from(quality) - 50.0) / 15.0).exp2()
}

/// lambdas at quality 50. There are three per quality, as there are three depths per quality for the
/// other strategies.
pub(super) const AT_50: [f64; 3] = [4e-3, 8e-3, 1.6e-2];
/// Attribute bits per Gaussian, as measured in streams of pruned scenes.
pub(super) fn bits(quality: f32) -> f64 {
    30.0 * ((f64::from(quality) - 50.0) / 20.5).exp2()
}

const QUALITIES: [f32; 5] = [26.0, 40.0, 54.0, 68.0, 82.0];

pub(super) fn measure(study: &Study, args: &Options) -> Result<Rates> {
    let d = study.depth;
    // Each quality is measured at the depths that can be on the hull.
    let around = |i: usize| -> Vec<u8> {
        match i {
            0 | 1 => vec![d - 2, d - 1, d],
            2 => vec![d - 1, d, d + 1],
            _ => vec![d, d + 1, d + 2],
        }
    };
    let grid: Vec<(u8, f32)> = QUALITIES
        .iter()
        .enumerate()
        .flat_map(|(i, &q)| around(i).into_iter().map(move |depth| (depth, q)))
        .collect();
    let uniform = |merging| {
        let settings =
            grid.iter().map(|&(depth, q)| (Strategy::Uniform { depth }, q, format!("J = {depth}")));
        curve(study, &format!("Uniform, {merging:?} merging"), merging, settings)
    };
    let paper = |merging| {
        let settings = grid.iter().map(|&(depth, q)| {
            let (low, high) = (depth - 1, depth + 3);
            (Strategy::paper(low, high), q, format!("J = {low} to {high}"))
        });
        curve(study, &format!("Paper, {merging:?} merging"), merging, settings)
    };
    let pruned = |name: &str, at_50: &[f64], options: &dyn Fn(f64) -> RateDistortion| {
        let grid = QUALITIES.iter().flat_map(|&q| at_50.iter().map(move |&l| (q, lambda(l, q))));
        let settings = grid.map(|(q, l)| {
            let mut o = options(l);
            o.cost.gaussian = bits(q);
            (Strategy::RateDistortion(o), q, format!("lambda {l:.1e}"))
        });
        curve(study, name, Merge::Moments, settings)
    };
    let seen = |l: f64| RateDistortion::seen(l, study.seen.clone());
    let mut curves = vec![
        uniform(Merge::Paper)?,
        uniform(Merge::Moments)?,
        paper(Merge::Paper)?,
        paper(Merge::Moments)?,
        pruned("RateDistortion, no cameras", &AT_50, &RateDistortion::unseen)?,
        pruned("RateDistortion, nothing dropped", &AT_50[1..2], &|l| RateDistortion {
            drop: None,
            ..seen(l)
        })?,
        pruned("RateDistortion", &AT_50, &seen)?,
    ];
    if args.variants {
        curves.extend(variants(study)?);
    }
    let folder = args.out.parent().unwrap_or(Path::new(""));
    let file = folder.join(format!("voxel-{}.svg", study.name));
    crate::page::write(&file, &chart(study, &curves).svg(), None)?;
    let anchor = bd::hull(&plain(&curves[1]));
    let rate = |c: &Curve| bd::bd_rate(&anchor, &bd::hull(&plain(c)), Method::Pchip);
    Ok(Rates {
        scene: study.name.clone(),
        strategies: curves.iter().map(|c| (c.name.clone(), rate(c))).collect(),
        details: details(study, &curves)?,
    })
}

/// The rate-distortion strategy with one of its settings changed.
fn variants(study: &Study) -> Result<Vec<Curve>> {
    let with = |name: String, change: &dyn Fn(&mut RateDistortion)| {
        let settings = QUALITIES.iter().map(|&q| {
            let l = lambda(AT_50[1], q);
            let mut o = RateDistortion::seen(l, study.seen.clone());
            change(&mut o);
            o.cost.gaussian = bits(q);
            (Strategy::RateDistortion(o), q, format!("lambda {l:.1e}"))
        });
        curve(study, &name, Merge::Moments, settings)
    };
    let mut out = Vec::new();
    for drop in [5.0, 20.0] {
        out.push(with(format!("... drop {drop}"), &|o| o.drop = Some(drop))?);
    }
    for p in [0.5, 1.0] {
        out.push(with(format!("... p {p}"), &|o| o.size_exponent = p)?);
    }
    for (name, shape, colour) in
        [("shape 0.3", 0.3, 1.0), ("shape 2", 2.0, 1.0), ("colour 0", 1.0, 0.0)]
    {
        out.push(with(format!("... {name}"), &|o| (o.shape, o.colour) = (shape, colour))?);
    }
    Ok(out)
}

/// The hulls of the curves.
fn chart(study: &Study, curves: &[Curve]) -> Chart {
    let line = |c: &Curve| Series {
        name: c.name.clone(),
        kind: Kind::Ours,
        points: bd::hull(&plain(c)).iter().map(|p| (p.rate / 1e6, p.psnr_db)).collect(),
    };
    Chart::new(
        format!("{}: held-out PSNR, no fine-tune", study.name),
        Axis::linear("size, MB (10⁶ bytes)"),
        Axis::linear("PSNR, dB"),
        curves.iter().map(line).collect(),
        None,
    )
}

fn plain(curve: &Curve) -> Vec<Point> {
    curve.points.iter().map(|(p, _)| *p).collect()
}

fn details(study: &Study, curves: &[Curve]) -> Result<String> {
    let anchor = |i: usize| bd::hull(&plain(&curves[i]));
    // The best single depth of uniform voxelization: the one whose hull is nearest to that of all
    // depths.
    let at = |depth: u8| -> Vec<Point> {
        let wanted = format!("J = {depth},");
        let points = curves[1].points.iter().filter(|(_, what)| what.starts_with(&wanted));
        bd::hull(&points.map(|(p, _)| *p).collect::<Vec<_>>())
    };
    let excess = |depth: u8| bd::bd_rate(&anchor(1), &at(depth), Method::Pchip).unwrap_or(f64::MAX);
    let best = (study.depth - 1..=study.depth + 1)
        .filter(|&d| at(d).len() > 1)
        .min_by(|&a, &b| excess(a).total_cmp(&excess(b)))
        .unwrap_or(study.depth);
    let mut out = format!(
        "## Equal bytes on {} (real streams, decoded, held-out views, no fine-tune)\n\n\
         Hull of all settings of each strategy; BD-rate by pchip of hulls, negative is smaller.\n\n\
         The last column is against Uniform (Moments) kept at J = {d}, its best single depth.\n\n\
         | strategy | points on hull | against Uniform, Paper merging | against Uniform, Moments merging | against J = {d} |\n\
         |---|---|---|---|---|\n",
        study.name,
        d = best
    );
    let percent = |a: &[Point], b: &[Point]| {
        bd::bd_rate(a, b, Method::Pchip).map_or("-".into(), |r| format!("{r:+.1} %"))
    };
    for c in curves {
        let hull = bd::hull(&plain(c));
        writeln!(
            out,
            "| {} | {} | {} | {} | {} |",
            c.name,
            hull.len(),
            percent(&anchor(0), &hull),
            percent(&anchor(1), &hull),
            percent(&at(best), &hull)
        )?;
    }
    out += "\nPoints on the hulls:\n\n| strategy | setting | bytes | dB |\n|---|---|---|---|\n";
    for c in curves {
        let hull = bd::hull(&plain(c));
        for (p, what) in c.points.iter().filter(|(p, _)| hull.contains(p)) {
            writeln!(out, "| {} | {what} | {:.0} | {:.2} |", c.name, p.rate, p.psnr_db)?;
        }
    }
    Ok(out)
}
