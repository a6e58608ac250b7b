//! What the pipeline skips, counted on real scenes, with the test that proves it.

use std::fmt::Write as _;

use anyhow::Result;
use finetune::{RenderOptions, render};
use gpcc_lite::{Limits, geometry};
use gs_model::{Camera, ply};
use gsvx::stream::{Container, SectionKind};
use gsvx::{DecodeOptions, EncodeOptions, Prepared, Seen};
use voxel::{Cube, Strategy};

use crate::scenes;

/// One skip: where, when, on what share, and why nothing is lost.
struct Skip {
    stage: &'static str,
    condition: &'static str,
    /// Skipped and of how many, per scene.
    counts: Vec<[u64; 2]>,
    proof: &'static str,
}

/// Measures all skips on the scenes.
pub(super) fn report(names: &[String]) -> Result<String> {
    let mut skips: Vec<Skip> = Vec::new();
    let mut found = Vec::new();
    for name in names {
        let scene = scenes::find(name)?;
        println!("{name}");
        for (at, (stage, condition, count, proof)) in count(&scene)?.into_iter().enumerate() {
            if skips.len() <= at {
                skips.push(Skip { stage, condition, counts: Vec::new(), proof });
            }
            skips[at].counts.push(count);
        }
        found.push(scene.name);
    }
    let mut text = format!(
        "# What is skipped\n\n`cargo xtask skips {}`, default quality; cameras are the held-out \
         views at up to 640 pixels. Skipped of how many, and the test that shows that the result \
         is the same, or its bound.\n\n| stage | skipped | {} | proof or bound |\n|---|---|{}---|\n",
        names.join(" "),
        found.join(" | "),
        "---:|".repeat(found.len())
    );
    for s in &skips {
        let cells: Vec<String> = s
            .counts
            .iter()
            .map(|&[n, of]| {
                format!("{n} of {of} ({:.1} %)", 100.0 * n as f64 / (of as f64).max(1.0))
            })
            .collect();
        let _ = writeln!(
            text,
            "| {} | {} | {} | {} |",
            s.stage,
            s.condition,
            cells.join(" | "),
            s.proof
        );
    }
    Ok(text)
}

type Counted = (&'static str, &'static str, [u64; 2], &'static str);

fn count(found: &scenes::Found) -> Result<Vec<Counted>> {
    let (mut scene, _) = ply::read(&found.dataset.model_path)?;
    scene.drop_invalid();
    let n = scene.len() as u64;
    let cameras: Vec<Camera> = found
        .dataset
        .held_out()
        .map(|v| {
            let factor = (f64::from(v.camera.width) / 640.0).max(1.0);
            let size = |v: u32| (f64::from(v) / factor).round() as u32;
            let small = v.camera.scaled_to(size(v.camera.width), size(v.camera.height));
            small.unwrap_or_else(|| v.camera.clone())
        })
        .collect();
    let mut out: Vec<Counted> = Vec::new();

    let guessed = gsvx::importance::without_cameras(&scene);
    let strategy = gsvx::default_strategy(gsvx::DEFAULT_QUALITY, &guessed, Seen::Guessed)?;
    if let Strategy::RateDistortion(options) = &strategy {
        let cube = Cube::of(&scene.means)?;
        let (_, report) = voxel::rate_distortion(&scene, &cube, options)?;
        out.push((
            "voxel, rate-distortion",
            "subtrees of cells that no division can pay for",
            [report.skipped, report.decided],
            "voxel `pruning_is_the_optimum`: same leaves as the exhaustive search",
        ));
    }
    let choose = |f: &[f32], seen| gsvx::default_strategy(gsvx::DEFAULT_QUALITY, f, seen);
    let Prepared { scene: merged, voxels, importance } = gsvx::prepare(&scene, choose, None)?;
    let single = (0..voxels.len()).filter(|&i| voxels.members_of(i).len() == 1).count() as u64;
    out.push((
        "voxel, merge",
        "moments of leaves with one member: copied",
        [single, voxels.len() as u64],
        "voxel `merging_one_member_is_the_identity`: same bits but the mean",
    ));

    let seen = finetune::saliency_per_view(&scene, &cameras);
    let choose = |f: &[f32], seen| gsvx::default_strategy(gsvx::DEFAULT_QUALITY, f, seen);
    let with_cameras = gsvx::prepare(&scene, choose, Some(&seen.squared))?;
    out.push((
        "voxel, with cameras",
        "Gaussians that cost more than they show",
        [with_cameras.voxels.dropped.len() as u64, n],
        "part of the minimised cost, distortion counted: voxel `pruning_is_the_optimum`",
    ));
    let unseen: Vec<usize> = (0..scene.len()).filter(|&i| seen.total[i] > 0.0).collect();
    let less = scene.select(&unseen);
    let options = RenderOptions::default();
    if let Some(c) = cameras.first() {
        anyhow::ensure!(
            render(&scene, c, &options) == render(&less, c, &options),
            "{}: leaving out unseen Gaussians changed a render",
            found.name
        );
    }
    out.push((
        "finetune, rasterizer",
        "Gaussians without weight in any view",
        [n - unseen.len() as u64, n],
        "finetune `gaussians_without_weight_can_be_dropped`; the first view was rendered \
         without them in this run, same bits",
    ));
    let shown: u64 = seen.views.iter().map(|&v| u64::from(v)).sum();
    out.push((
        "finetune, rasterizer",
        "(Gaussian, view) pairs culled, cut at 1/255 or behind a stopped pixel",
        [n * cameras.len() as u64 - shown, n * cameras.len() as u64],
        "finetune `stability` and `oracle`: against a renderer that skips nothing",
    ));

    let options = EncodeOptions { importance: Some(importance), ..EncodeOptions::default() };
    let bytes = gsvx::encode(&merged, &voxels, &options)?.bytes;
    let container = Container::parse(&bytes)?;
    let higher =
        |k: SectionKind| matches!(k, SectionKind::Sh1 | SectionKind::Sh2 | SectionKind::Sh3);
    let skipped: u64 = container.toc.iter().filter(|e| higher(e.kind)).map(|e| e.len).sum();
    let base = DecodeOptions { max_sh_degree: 0, ..Default::default() };
    let short = gsvx::decode(&bytes[..bytes.len() - skipped as usize], &base)?;
    anyhow::ensure!(
        short.scene == gsvx::decode(&bytes, &base)?.scene,
        "{}: degree 0 depends on higher sections",
        found.name
    );
    out.push((
        "gsvx, decoder",
        "bytes of SH degrees that were not asked for (degree 0 of 3)",
        [skipped, bytes.len() as u64],
        "gsvx `sections_can_be_left_out`; decoded without these bytes in this run, same floats",
    ));
    if let Some(payload) = container.section(SectionKind::Geometry)? {
        let depth = voxels.j_high.saturating_sub(6);
        let limits = Limits { max_points: merged.len() };
        let whole = geometry::decode_lod(payload, depth, &limits)?;
        let (mut low, mut high) = (0, payload.len());
        while low < high {
            let middle = (low + high) / 2;
            let part = geometry::decode_lod(&payload[..middle], depth, &limits);
            if part.is_ok_and(|p| p == whole) { high = middle } else { low = middle + 1 }
        }
        out.push((
            "gpcc-lite, geometry",
            "bytes of octree levels below the depth asked for (six levels up)",
            [(payload.len() - low) as u64, payload.len() as u64],
            "decoded from that prefix in this run, same leaves; gpcc-lite's round-trip tests",
        ));
    }
    Ok(out)
}
