//! Counts on real scenes what the pipeline skips, and names for each skip the test which proves that
//! the result is the same.

use std::fmt::Write as _;
use std::num::NonZeroUsize;
use std::path::Path;

use anyhow::{Context, Result, ensure};
use finetune::probe::{Probe, TileTest, Variant, VariantPass};
use finetune::{RenderOptions, render};
use gs_model::{Camera, Scene, ply};
use gsvx::{DecodeOptions, EncodeOptions, Kind, Reader, Seen};
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
    &["crates/gsvx/tests/round_trip.rs::fewer_sh_degrees_are_a_prefix"],
    "decoded with these bytes erased in this run, same floats",
);
const LEVELS: Proof = Proof::new(
    &["crates/gsvx/tests/lod.rs::each_level_decodes_alone_from_the_front"],
    "decoded with these bytes erased in this run, same floats",
);
const CHUNKS: Proof = Proof::new(
    &["crates/gsvx/tests/reader.rs::one_chunk_is_read_with_its_base_layer_and_nothing_else"],
    "each chunk decoded without these bytes in this run, same floats",
);
const PROOFS: [Proof; 10] =
    [PRUNED, COPIED, DROPPED, UNSEEN, TILES, CULLED, LANES, DEGREES, LEVELS, CHUNKS];

fn count(found: &scenes::SceneFiles) -> Result<Vec<Counted>> {
    let (mut scene, _) = ply::read(&found.dataset.model_path)?;
    scene.drop_invalid();
    let cameras: Vec<Camera> = found.dataset.held_out().map(|v| small(&v.camera)).collect();
    let mut out: Vec<Counted> = Vec::new();

    let guessed = gsvx::importance::without_cameras(&scene);
    let strategy = gsvx::default_strategy(gsvx::DEFAULT_QUALITY, &guessed, Seen::Guessed)?;
    if let Strategy::RateDistortion(options) = &strategy {
        let cube = voxel::cube_of(&scene.means)?;
        let (_, report) = voxel::rate_distortion(&scene, &cube, options)?;
        out.push((
            "voxel, rate-distortion",
            "subtrees of cells that no division can pay for",
            [report.skipped, report.decided],
            PRUNED,
        ));
    }
    let prepared = gsvx::prepare(&scene, &EncodeOptions::default())?;
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
    drop(prepared);
    streams(&found.name, &scene, &mut out)?;
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
    let mut options = EncodeOptions::default();
    options.importance = Some(seen.squared.clone());
    options.drop_unseen = true;
    let prepared = gsvx::prepare(scene, &options)?;
    out.push((
        "voxel, with cameras",
        "Gaussians that cost more than they show",
        [prepared.voxels.dropped().len() as u64, n],
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
fn streams(name: &str, scene: &Scene, out: &mut Vec<Counted>) -> Result<()> {
    let bytes = gsvx::encode(scene, &EncodeOptions::default())?.bytes;
    let mut base = DecodeOptions::default();
    base.max_sh_degree = 0;
    let skipped = unread(&bytes, &base, |_, layer| layer > 0)
        .with_context(|| format!("{name}: degree 0 depends on higher degrees"))?;
    out.push((
        "gsvx, decoder",
        "bytes of SH degrees that were not asked for (degree 0 of 3)",
        [skipped, bytes.len() as u64],
        DEGREES,
    ));
    let mut options = EncodeOptions::default();
    options.lod = true;
    // Small enough for several chunks in every scene.
    options.chunk_leaves = CHUNK_LEAVES;
    let bytes = gsvx::encode(scene, &options)?.bytes;
    let mut coarse = DecodeOptions::default();
    coarse.lod = u8::MAX;
    let coarsest = gsvx::decode_with(&bytes, &coarse)?.index.coarsest_lod();
    let skipped =
        unread(&bytes, &coarse, |chunk, _| chunk.kind == Kind::Leaves && chunk.lod < coarsest)
            .with_context(|| format!("{name}: the coarsest level depends on finer ones"))?;
    out.push((
        "gsvx, decoder",
        "bytes of finer levels of detail (the coarsest was asked for)",
        [skipped, bytes.len() as u64],
        LEVELS,
    ));
    let skipped =
        other_chunks(&bytes).with_context(|| format!("{name}: a chunk depends on others"))?;
    out.push((
        "gsvx, reader",
        "bytes that a reader of one chunk does not ask for, mean of all chunks",
        [skipped, bytes.len() as u64],
        CHUNKS,
    ));
    Ok(())
}

/// Leaves of a chunk where chunks are read one by one.
const CHUNK_LEAVES: NonZeroUsize = NonZeroUsize::MIN.saturating_add((1 << 12) - 1);

/// Erases the layers that `erased` names by chunk and number, and returns how many bytes they are.
///
/// # Errors
/// If the stream is decoded to other floats after that.
fn unread(
    bytes: &[u8],
    options: &DecodeOptions,
    erased: impl Fn(&gsvx::Chunk, usize) -> bool,
) -> Result<u64> {
    let whole = gsvx::decode_with(bytes, options)?;
    let (mut rest, mut count) = (bytes.to_vec(), 0);
    for chunk in &whole.index.chunks {
        for (number, layer) in chunk.layers.iter().enumerate() {
            if erased(chunk, number) {
                let range = layer.range();
                rest[range.start as usize..range.end as usize].fill(0);
                count += layer.len;
            }
        }
    }
    let decoded = gsvx::decode_with(&rest, options)?;
    ensure!(decoded.scene == whole.scene, "other floats");
    Ok(count)
}

/// Reads each chunk of the finest level alone; returns how many bytes of the stream the reader did not
/// ask for, on average.
///
/// # Errors
/// If a chunk is decoded to other floats than in the whole stream.
fn other_chunks(bytes: &[u8]) -> Result<u64> {
    let whole = gsvx::decode_with(bytes, &DecodeOptions::default())?;
    let (mut first, mut given, mut chunks) = (0, 0, 0);
    for number in whole.index.chunks_of_lod(0) {
        let chunk = &whole.index.chunks[number];
        let mut reader = Reader::new();
        let mut give = |reader: &mut Reader, range: std::ops::Range<u64>| -> Result<()> {
            let end = range.end.min(bytes.len() as u64);
            given += end - range.start;
            Ok(reader.give(range.start, &bytes[range.start as usize..end as usize])?)
        };
        while let Some(range) = reader.head_needs() {
            give(&mut reader, range)?;
        }
        for range in reader.needs(number, chunk.layers.len()) {
            give(&mut reader, range)?;
        }
        let scene = reader.decode(number, chunk.layers.len())?;
        let range: Vec<usize> = (first..first + scene.len()).collect();
        ensure!(scene == whole.scene.select(&range), "chunk {number} has other floats");
        first += scene.len();
        chunks += 1;
    }
    Ok(bytes.len() as u64 - given / chunks.max(1))
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
