//! Does a greater quality ever look worse? Streams of many qualities with cameras, whose renders at held-out
//! views are compared with renders of the input.
//!
//! Where Gaussians lie at equal depth, as on a wall that faces the camera, their order in the file decides which is
//! in front, and the least change of a mean decides anew. How much that alone changes is measured by the input in
//! reverse order. An error below that one says nothing about quality, so no PSNR above it counts.

use std::path::Path;

use anyhow::Result;
use finetune::{Image, RenderOptions, metrics, render};
use gs_model::Scene;
use gsvx::EncodeOptions;

use crate::cells;
use crate::chart::{Axis, Chart, Series};
use crate::page::{Page, Table};
use crate::progress::Bar;
use crate::scenes::ModelAndCameras;

/// Held-out views that are rendered.
const VIEWS: usize = 4;

/// The largest drop of the mean that is allowed, dB.
pub const ALLOWED_DB: f64 = 0.3;

/// Qualities from 5 to 100, `per_point` for each point.
#[must_use]
pub fn all_qualities(per_point: u32) -> Vec<f32> {
    (5 * per_point..=100 * per_point).map(|q| q as f32 / per_point as f32).collect()
}

/// PSNR at each quality.
pub struct Sweep {
    /// What was asked for, ascending.
    qualities: Vec<f32>,
    /// PSNR against renders of the input, dB, at most `order`: for each quality, that of each view.
    views: Vec<Vec<f64>>,
    /// The same of the merged Gaussians before their attributes are coded.
    merged: Vec<Vec<f64>>,
    /// PSNR of the input in reverse order against the input, dB, of each view.
    order: Vec<f64>,
}

/// By how much a quality lies below a lower one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Drop {
    /// The lower quality, which looks better.
    pub from: f32,
    /// The greater quality, which looks worse.
    pub to: f32,
    /// The difference, dB; 0 if no quality lies below a lower one.
    pub db: f64,
}

impl Sweep {
    /// Encodes, decodes and renders a scene at each quality, which must ascend. Importances come from the
    /// training cameras, and nothing is left out, as the command does with `--cameras`.
    ///
    /// # Errors
    /// If the scene cannot be read or coded.
    pub fn of(name: &str, qualities: &[f32]) -> Result<Self> {
        let scene = ModelAndCameras::open(name, VIEWS)?;
        let settings = RenderOptions::default();
        let seen = finetune::saliency(&scene.model, &scene.training).squared;
        let draw = |model: &Scene| -> Vec<Image> {
            scene.held_out.iter().map(|c| render(model, c, &settings)).collect()
        };
        let references = draw(&scene.model);
        let psnrs = |model: &Scene| -> Vec<f64> {
            draw(model).iter().zip(&references).map(|(a, b)| metrics::psnr(a, b)).collect()
        };
        let reversed: Vec<usize> = (0..scene.model.len()).rev().collect();
        let order = psnrs(&scene.model.select(&reversed));
        let capped =
            |model: &Scene| psnrs(model).iter().zip(&order).map(|(a, b)| a.min(*b)).collect();
        let (mut views, mut merged) = (Vec::new(), Vec::new());
        let bar = Bar::new(&format!("qualities of {name}"), qualities.len() as u64);
        for &quality in qualities {
            let mut options = EncodeOptions::from_quality(quality)?;
            options.importance = Some(seen.clone());
            let decoded = gsvx::decode(&gsvx::encode(&scene.model, &options)?.bytes)?;
            views.push(capped(&decoded));
            merged.push(capped(&gsvx::prepare(&scene.model, &options)?.scene));
            bar.step(1);
        }
        bar.done();
        Ok(Self { qualities: qualities.to_vec(), views, merged, order })
    }

    /// The largest drop of the mean over the views.
    #[must_use]
    pub fn of_mean(&self) -> Drop {
        largest(&self.qualities, &means(&self.views))
    }

    /// The largest drop of a single view.
    #[must_use]
    pub fn of_worst_view(&self) -> Drop {
        let count = self.views.first().map_or(0, Vec::len);
        let of = |view: usize| {
            let curve: Vec<f64> = self.views.iter().map(|v| v[view]).collect();
            largest(&self.qualities, &curve)
        };
        let none = Drop { from: 0.0, to: 0.0, db: 0.0 };
        (0..count).map(of).fold(none, |a, b| if b.db > a.db { b } else { a })
    }
}

fn means(views: &[Vec<f64>]) -> Vec<f64> {
    views.iter().map(|v| v.iter().sum::<f64>() / v.len() as f64).collect()
}

/// The largest amount by which a value lies below an earlier one.
fn largest(qualities: &[f32], psnr: &[f64]) -> Drop {
    let mut best = 0;
    let mut worst = Drop { from: 0.0, to: 0.0, db: 0.0 };
    for (i, &db) in psnr.iter().enumerate() {
        if db > psnr[best] {
            best = i;
        } else if psnr[best] - db > worst.db {
            worst = Drop { from: qualities[best], to: qualities[i], db: psnr[best] - db };
        }
    }
    worst
}

/// Sweeps every scene over all qualities and writes the page at `out`.
pub(super) fn run(names: &[String], out: &Path) -> Result<()> {
    let qualities = all_qualities(2);
    let mut table = Table::new(
        "scene | order alone, dB | largest drop of the mean, dB | from quality | to | largest drop of a view, dB | \
         from quality | to | merging alone: largest drop of the mean, dB",
    );
    let mut series = Vec::new();
    for name in names {
        let sweep = Sweep::of(name, &qualities)?;
        let (mean, view) = (sweep.of_mean(), sweep.of_worst_view());
        let order = sweep.order.iter().sum::<f64>() / sweep.order.len() as f64;
        let merging = largest(&qualities, &means(&sweep.merged)).db;
        let mut row = cells![name, format!("{order:.1}")];
        for drop in [mean, view] {
            row.extend(cells![format!("{:.2}", drop.db), drop.from, drop.to]);
        }
        row.push(format!("{merging:.2}"));
        table.told(row);
        let points = qualities.iter().map(|&q| f64::from(q)).zip(means(&sweep.views));
        series.push(Series::ours(name, points.collect()));
    }
    let mut page = Page::new(out, "Does a greater quality ever look worse?");
    page.text(format!(
        "`cargo xtask bench-gsvx --sweep {}`: qualities 5 to 100 in steps of 0.5, importances from the training \
         cameras, nothing left out. PSNR is that of held-out views (at most {VIEWS}) against renders of the input. A \
         drop is the amount by which a quality lies below a lower one; up to {ALLOWED_DB} dB of the mean is allowed. \
         `cargo xtask conformance` checks it on the room, in steps of 1.",
        names.join(","),
    ));
    page.text(
        "Where Gaussians lie at equal depth, as on a wall that faces the camera, the least change of a mean decides \
         which is in front. \"Order alone\" measures this: the PSNR of the input in reverse order. PSNRs are cut \
         to it. \"Merging alone\" renders the merged Gaussians before their attributes are coded.",
    );
    page.text(
        "The desk is generated (`testing::desk`): 60,000 Gaussians, of which 300 bright ones are up to ninety times as \
         long as wide. An error of one covariance step moves the end of such a Gaussian by several times its width.",
    );
    let axes = ["quality", "PSNR against renders of the input, dB"].map(Axis::linear);
    page.chart("", Chart::new("Quality and PSNR", axes, series, None));
    page.table(&table);
    page.write()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_drop_is_measured_from_the_best_before() {
        let drop = largest(&[1.0, 2.0, 3.0, 4.0], &[30.0, 33.0, 32.5, 32.0]);
        assert_eq!(drop, Drop { from: 2.0, to: 4.0, db: 1.0 });
        assert_eq!(largest(&[1.0, 2.0], &[30.0, 31.0]).db, 0.0);
    }
}
