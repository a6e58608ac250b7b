//! Fine-tunes of voxelized models: as a table, and over their steps.

use crate::cells;
use crate::chart::{Axis, Chart, LineKind, Series};
use crate::page::Table;
use crate::rd_curve::record::{Original, Tuned, VoxelizedRecord};

/// The models that were tuned, each once.
pub(crate) fn of<'a>(
    models: impl IntoIterator<Item = &'a VoxelizedRecord>,
) -> impl Iterator<Item = (&'a VoxelizedRecord, &'a Tuned)> {
    let mut seen: Vec<&str> = Vec::new();
    models.into_iter().filter_map(move |model| {
        let new = !seen.contains(&model.name.as_str());
        seen.push(&model.name);
        Some((model, model.tuned.as_ref().filter(|_| new)?))
    })
}

/// One row each.
pub(crate) fn table<'a>(
    models: impl Iterator<Item = (&'a VoxelizedRecord, &'a Tuned)>,
    original: &Original,
) -> Table {
    let mut table = Table::new(
        "model | Gaussians | steps | before dB | after dB | to original dB | seconds | processor s | memory MB",
    );
    for (model, tuned) in models {
        let before = tuned.held_out_db.first().map_or(f64::NAN, |x| x.1);
        let after = tuned.last_db();
        table.row(cells![
            model.name,
            model.gaussians,
            tuned.steps,
            format!("{before:.3}"),
            format!("{after:.3}"),
            format!("{:+.3}", after - original.score.psnr_db),
            format!("{:.1}", tuned.seconds),
            format!("{:.1}", tuned.user_seconds),
            format!("{:.0}", tuned.peak_bytes as f64 / 1e6),
        ]);
    }
    table
}

/// PSNR at the held-out views over steps; runs without initialisation are thin lines.
pub(crate) fn chart<'a>(
    title: String,
    models: impl Iterator<Item = (&'a VoxelizedRecord, &'a Tuned)>,
    original: &Original,
) -> Chart {
    let line = |(m, t): (&VoxelizedRecord, &Tuned)| Series {
        name: format!("{}, {}", m.what, if t.initialised { "initialised" } else { "from nothing" }),
        kind: if t.initialised { LineKind::Ours } else { LineKind::Theirs },
        points: t.held_out_db.iter().map(|&(step, db)| (step as f64, db)).collect(),
    };
    let axes = ["steps, one training view each", "PSNR at held-out views, dB"].map(Axis::linear);
    let db = original.score.psnr_db;
    Chart::new(title, axes, models.map(line), Some((db, format!("original model, {db:.2} dB"))))
}
