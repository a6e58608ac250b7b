//! Counts on real scenes what the pipeline skips, and names for each skip the test which proves that
//! the result is the same.

use std::fmt::Write as _;

use std::path::Path;

use anyhow::{Context, Result, ensure};
use finetune::probe::{Probe, TileTest, Variant, VariantPass};
use finetune::{RenderOptions, render};
use gpcc_lite::{Limits, geometry};
use gs_model::{Camera, Scene, ply};
use gsvx::stream::{Container, SectionKind};
use gsvx::{DecodeOptions, EncodeOptions, Prepared, Seen, slices};
use voxel::{Cube, Strategy};

use super::stages::small;
use crate::scenes;

/// One kind of work that is skipped.
struct Skip {
    stage: &'static str,
    condition: &'static str,
    /// Number skipped, and number in all, per scene.
    counts: Vec<[u64; 2]>,
    proof: Proof,
}

/// Why the result is the same: tests as `crates/.../file.rs::name`, and a note on what was checked in
/// this run.
#[derive(Clone, Copy)]
struct Proof {
    tests: &'static [&'static str],
    note: &'static str,
}

impl Proof {
    const fn new(tests: &'static [&'static str], note: &'static str) -> Self {
        Self { tests, note }
    }

    fn text(&self) -> String {
        let tests = self.tests.iter().map(|t| format!("`{}`", t.trim_start_matches("crates/")));
        let parts: Vec<String> = tests.chain([self.note.to_owned()]).collect();
        parts.into_iter().filter(|p| !p.is_empty()).collect::<Vec<_>>().join("; ")
    }
}

/// Fails unless there is a test of that name in that file.
fn check_test(root: &Path, test: &str) -> Result<()> {
    let (file, name) = test.split_once("::").with_context(|| format!("{test}: file::test"))?;
    let text = std::fs::read_to_string(root.join(file)).with_context(|| file.to_owned())?;
    let lines: Vec<&str> = text.lines().map(str::trim_start).collect();
    let head = format!("fn {name}(");
    // Other attributes and comments may stand between `#[test]` and the function.
    let marked = |at: usize| {
        let above =
            lines[..at].iter().rev().take_while(|l| l.starts_with('#') || l.starts_with("//"));
        above.into_iter().any(|l| l.starts_with("#[test]"))
    };
    let found = (0..lines.len()).any(|i| lines[i].starts_with(&head) && marked(i));
    ensure!(found, "{file} has no test {name}: the proof of a skip is gone");
    Ok(())
}

/// Counts all skips on the scenes.
///
/// # Errors
/// If a scene cannot be read, a skip changes a result, or a test named as a proof does not exist.
pub(super) fn report(names: &[String]) -> Result<String> {
    for test in PROOFS.iter().flat_map(|p| p.tests) {
        check_test(&scenes::root(), test)?;
    }
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
         views at up to 640 pixels. Skipped of how many, and the test (`file::test` in `crates`) that \
         shows that the result is the same, or its bound; the command fails if one of these tests \
         does not exist.\n\n| stage | skipped | {} | proof or bound |\n|---|---|{}---|\n",
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
            s.proof.text()
        );
    }
    Ok(text)
}

type Counted = (&'static str, &'static str, [u64; 2], Proof);

const PRUNED: Proof = Proof::new(
    &["crates/voxel/tests/rate_distortion.rs::pruning_is_the_optimum"],
    "same leaves as the exhaustive search",
);
const COPIED: Proof = Proof::new(
    &["crates/voxel/tests/properties.rs::merging_one_member_is_the_identity"],
    "same bits but the mean",
);
const DROPPED: Proof = Proof::new(
    &["crates/voxel/tests/rate_distortion.rs::pruning_is_the_optimum"],
    "part of the minimised cost, distortion counted",
);
const UNSEEN: Proof = Proof::new(
    &["crates/finetune/tests/skips.rs::gaussians_without_weight_can_be_dropped"],
    "the first view was rendered without them in this run, same bits",
);
const TILES: Proof = Proof::new(
    &["crates/finetune/tests/skips.rs::every_tile_test_gives_the_same_image"],
    "the first view was rendered both ways in this run, same bits",
);
const CULLED: Proof = Proof::new(
    &["crates/finetune/tests/oracle.rs::images_agree"],
    "within 1e-5 of a renderer that skips nothing but below 1/255 and behind 1e-4",
);
const LANES: Proof = Proof::new(
    &["crates/finetune/src/stages/reference.rs::the_executor_agrees_with_the_scalar_reference"],
    "same bits as where every pixel of a tile is visited",
);
const DEGREES: Proof = Proof::new(
    &["crates/gsvx/tests/round_trip.rs::sections_can_be_left_out"],
    "decoded without these bytes in this run, same floats",
);
const LEVELS: Proof = Proof::new(
    &["crates/gpcc-lite/tests/roundtrip.rs::level_of_detail_is_the_tree_cut"],
    "decoded from that prefix in this run, same leaves",
);
const PROOFS: [Proof; 9] = [PRUNED, COPIED, DROPPED, UNSEEN, TILES, CULLED, LANES, DEGREES, LEVELS];

fn count(found: &scenes::SceneFiles) -> Result<Vec<Counted>> {
    let (mut scene, _) = ply::read(&found.dataset.model_path)?;
    scene.drop_invalid();
    let cameras: Vec<Camera> = found.dataset.held_out().map(|v| small(&v.camera)).collect();
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
            PRUNED,
        ));
    }
    let choose = |f: &[f32], seen| gsvx::default_strategy(gsvx::DEFAULT_QUALITY, f, seen);
    let prepared = gsvx::prepare(&scene, choose, None)?;
    let voxels = &prepared.voxels;
    let single = (0..voxels.len()).filter(|&i| voxels.members_of(i).len() == 1).count() as u64;
    out.push((
        "voxel, merge",
        "moments of leaves with one member: copied",
        [single, voxels.len() as u64],
        COPIED,
    ));
    with_cameras(&found.name, &scene, &cameras, &mut out)?;
    if let Some(camera) = cameras.first() {
        one_view(&found.name, &scene, camera, &mut out)?;
    }
    streams(&found.name, prepared, &mut out)?;
    Ok(out)
}

/// Voxelization and rasterizer, over all cameras.
fn with_cameras(
    name: &str,
    scene: &Scene,
    cameras: &[Camera],
    out: &mut Vec<Counted>,
) -> Result<()> {
    let n = scene.len() as u64;
    let seen = finetune::saliency_per_view(scene, cameras);
    let choose = |f: &[f32], seen| gsvx::default_strategy(gsvx::DEFAULT_QUALITY, f, seen);
    let prepared = gsvx::prepare(scene, choose, Some(&seen.squared))?;
    out.push((
        "voxel, with cameras",
        "Gaussians that cost more than they show",
        [prepared.voxels.dropped.len() as u64, n],
        DROPPED,
    ));
    let shown: Vec<usize> = (0..scene.len()).filter(|&i| seen.total[i] > 0.0).collect();
    let options = RenderOptions::default();
    if let Some(c) = cameras.first() {
        ensure!(
            render(scene, c, &options) == render(&scene.select(&shown), c, &options),
            "{name}: leaving out unseen Gaussians changed a render",
        );
    }
    out.push((
        "finetune, rasterizer",
        "Gaussians without weight in any view",
        [n - shown.len() as u64, n],
        UNSEEN,
    ));
    let pairs: u64 = seen.views.iter().map(|&v| u64::from(v)).sum();
    out.push((
        "finetune, rasterizer",
        "(Gaussian, view) pairs culled, cut at 1/255 or behind a stopped pixel",
        [n * cameras.len() as u64 - pairs, n * cameras.len() as u64],
        CULLED,
    ));
    Ok(())
}

/// Tiles and pixels of one view.
fn one_view(name: &str, scene: &Scene, c: &Camera, out: &mut Vec<Counted>) -> Result<()> {
    let photo = render(scene, c, &RenderOptions::default());
    let pass = |tile_test| {
        let mut pass = VariantPass::new(c, &photo, Variant { tile_test, ..Variant::default() });
        pass.forward(scene);
        (pass.image(), pass.slots() as u64)
    };
    let ((image, slots), (all, most)) = (pass(TileTest::Ellipse), pass(TileTest::Square));
    ensure!(image == all, "{name}: the tile test changed a render");
    out.push((
        "finetune, rasterizer",
        "(Gaussian, tile) pairs of the bounding square that the ellipse does not reach, one view",
        [most - slots, most],
        TILES,
    ));
    let probe = Probe::new(scene, c, &photo);
    let (visited, all) = (probe.visited(), probe.pairs());
    out.push((
        "finetune, blend",
        "(Gaussian, pixel) pairs in rows of a tile that the Gaussian does not reach, one view",
        [all - visited, all],
        LANES,
    ));
    Ok(())
}

/// Bytes that a decoder need not read.
fn streams(name: &str, prepared: Prepared, out: &mut Vec<Counted>) -> Result<()> {
    let Prepared { scene: merged, voxels, importance } = prepared;
    let options = EncodeOptions { importance: Some(importance), ..EncodeOptions::default() };
    let bytes = gsvx::encode(&merged, &voxels, &options)?.bytes;
    let container = Container::parse(&bytes)?;
    let higher =
        |k: SectionKind| matches!(k, SectionKind::Sh1 | SectionKind::Sh2 | SectionKind::Sh3);
    let skipped: u64 = container.toc.iter().filter(|e| higher(e.kind)).map(|e| e.len).sum();
    let base = DecodeOptions { max_sh_degree: 0, ..Default::default() };
    let short = gsvx::decode(&bytes[..bytes.len() - skipped as usize], &base)?;
    ensure!(
        short.scene == gsvx::decode(&bytes, &base)?.scene,
        "{name}: degree 0 depends on higher sections",
    );
    out.push((
        "gsvx, decoder",
        "bytes of SH degrees that were not asked for (degree 0 of 3)",
        [skipped, bytes.len() as u64],
        DEGREES,
    ));
    if let Some(payload) = container.section(SectionKind::Geometry)? {
        let depth = voxels.j_high.saturating_sub(6);
        let limits = Limits { max_points: merged.len() };
        let mut unread = 0;
        // Each slice has an octree of its own.
        for part in slices::split(payload, container.header.slices as usize)? {
            let whole = geometry::decode_lod(part, depth, &limits)?;
            let (mut low, mut high) = (0, part.len());
            while low < high {
                let middle = (low + high) / 2;
                let begun = geometry::decode_lod(&part[..middle], depth, &limits);
                if begun.is_ok_and(|p| p == whole) { high = middle } else { low = middle + 1 }
            }
            unread += part.len() - low;
        }
        out.push((
            "gpcc-lite, geometry",
            "bytes of octree levels below the depth asked for (six levels up)",
            [unread as u64, payload.len() as u64],
            LEVELS,
        ));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_proof_exists() {
        for test in PROOFS.iter().flat_map(|p| p.tests) {
            check_test(&scenes::root(), test).unwrap();
        }
        let gone = "crates/voxel/tests/rate_distortion.rs::no_such_test";
        assert!(check_test(&scenes::root(), gone).is_err());
        // A function, but no test.
        let helper = "crates/gsvx/tests/round_trip.rs::modes";
        assert!(check_test(&scenes::root(), helper).is_err());
    }
}
