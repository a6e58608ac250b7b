//! PSNR of merged scenes before any coding or fine-tuning.

use std::fmt::Write;

use anyhow::Result;
use voxel::{
    Importance, Merge, Merging, RateDistortion, Released, Strategy, Voxelization, released,
    voxelize,
};

use super::models::Study;

pub(super) fn table(study: &Study) -> Result<String> {
    let Study { scene, cube, depth, .. } = study;
    let mut out = format!(
        "## Merging on {}: {} Gaussians, {:.3} dB as trained\n\n\
         Held-out PSNR of the merged scene, nothing coded, no fine-tune. `Moments` weights \
         members by opacity times area, or by the rasterizer's sum of squared blending weights.\n\n\
         | octree | Gaussians | bits per Gaussian of geometry | Paper dB | Moments dB | Moments, seen dB |\n\
         |---|---|---|---|---|---|\n",
        study.name,
        scene.len(),
        study.psnr(scene)
    );
    let seen = Importance::Given(study.seen.clone());
    let mut row = |name: &str, v: &Voxelization| -> Result<()> {
        let bits = gpcc_lite::geometry::encode(&v.leaves, v.j_high)?.len() as f64 * 8.0;
        let psnr = |rule, importance: &Importance| -> Result<f64> {
            Ok(study.psnr(&Merging::new(scene, v, rule, importance)?.scene()))
        };
        let area = Importance::OpacityArea;
        writeln!(
            out,
            "| {name} | {} | {:.2} | {:.2} | {:.2} | {:.2} |",
            v.len(),
            bits / v.len() as f64,
            psnr(Merge::Paper, &area)?,
            psnr(Merge::Moments, &area)?,
            psnr(Merge::Moments, &seen)?
        )?;
        Ok(())
    };
    for d in [depth - 1, *depth, depth + 1] {
        row(
            &format!("Uniform, J = {d}"),
            &voxelize(scene, cube, &Strategy::Uniform { depth: d })?,
        )?;
    }
    row(&format!("Released, J_low = {}", depth - 2), &released(scene, &Released::new(depth - 2))?)?;
    for low in [depth - 2, depth - 1] {
        let high = low + 4;
        let v = voxelize(scene, cube, &Strategy::paper(low, high))?;
        row(&format!("Paper, J = {low} to {high}"), &v)?;
    }
    for lambda in [1e-3, 3e-3, 1e-2, 3e-2] {
        let unseen = Strategy::RateDistortion(RateDistortion::unseen(lambda));
        row(&format!("RateDistortion::unseen, {lambda:e}"), &voxelize(scene, cube, &unseen)?)?;
    }
    for lambda in [1e-3, 3e-3, 1e-2, 3e-2] {
        let kept =
            RateDistortion { drop: None, ..RateDistortion::seen(lambda, study.seen.clone()) };
        let v = voxelize(scene, cube, &Strategy::RateDistortion(kept))?;
        row(&format!("RateDistortion::seen, nothing dropped, {lambda:e}"), &v)?;
        let v = voxelize(
            scene,
            cube,
            &Strategy::RateDistortion(RateDistortion::seen(lambda, study.seen.clone())),
        )?;
        let dropped = v.dropped.len();
        row(&format!("RateDistortion::seen, {dropped} dropped, {lambda:e}"), &v)?;
    }
    Ok(out)
}
