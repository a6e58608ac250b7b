//! Levels of detail: what they cost, what they cover, and that they leave the finest level alone.
#![cfg(feature = "encode")]

mod common;

use common::{decoding, encode, encoding, leaves, room, scene, trained_scene, with_floaters};
use gs_model::Scene;
use gsvx::{EncodedStream, Kind, decode, decode_leaves, decode_with};

/// The last byte of the coarsest level.
fn end_of_coarsest(encoded: &EncodedStream) -> usize {
    let coarsest = encoded.index.coarsest_lod();
    let chunks = encoded.index.chunks.iter().filter(|c| c.lod == coarsest);
    chunks.map(|c| c.range(4).end).max().unwrap() as usize
}

fn tree() -> (Scene, EncodedStream) {
    let scene = scene(20_000, 1, 4);
    let options = encoding(|o| (o.lod, o.chunk_leaves) = (true, leaves(100)));
    let encoded = encode(&scene, &options).unwrap();
    assert!(encoded.index.coarsest_lod() >= 2, "a tree");
    (scene, encoded)
}

#[test]
fn each_level_decodes_alone_from_the_front() {
    let EncodedStream { bytes, index, .. } = tree().1;
    let mut last = 0;
    for lod in (0..=index.coarsest_lod()).rev() {
        let chunks = index.chunks.iter().filter(|c| c.lod == lod);
        let end = chunks.map(|c| c.range(4).end).max().unwrap() as usize;
        let options = decoding(|o| o.lod = lod);
        let part = decode_with(&bytes[..end], &options).unwrap().scene;
        assert!(part.validate().is_ok());
        assert_eq!(part, decode_with(&bytes, &options).unwrap().scene);
        assert!(part.len() > 4 * last, "level {lod}: {} after {last}", part.len());
        assert!(decode_with(&bytes[..end - 1], &options).is_err());
        last = part.len();
    }
    let coarsest = decode_with(&bytes, &decoding(|o| o.lod = index.coarsest_lod())).unwrap();
    let beyond = decode_with(&bytes, &decoding(|o| o.lod = 255)).unwrap();
    assert_eq!(coarsest.scene, beyond.scene);
}

#[test]
fn finer_chunks_cover_each_chunk_exactly_once() {
    let (floaters, _) = with_floaters(scene(20_000, 0, 4));
    let options = encoding(|o| (o.lod, o.chunk_leaves) = (true, leaves(100)));
    for index in [tree().1.index, encode(&floaters, &options).unwrap().index] {
        let mut seen = vec![0; index.chunks.len()];
        for (i, chunk) in index.chunks.iter().enumerate() {
            let finer = index.finer(i);
            assert_eq!(finer.is_empty(), chunk.lod == 0, "chunk {i}");
            for f in finer.clone() {
                assert_eq!(index.chunks[f].lod + 1, chunk.lod);
                seen[f] += 1;
            }
            // The cells of the coarse chunk begin where its first finer chunk begins, or before.
            if !finer.is_empty() {
                assert!(index.chunks[finer.start].first_cell >= chunk.first_cell);
            }
        }
        for (i, chunk) in index.chunks.iter().enumerate() {
            let once = chunk.kind == Kind::Leaves && chunk.lod < index.coarsest_lod();
            assert_eq!(seen[i], usize::from(once), "chunk {i}");
        }
        let finest = index.chunks.iter().filter(|c| c.lod == 0).map(|c| c.count).sum::<u64>();
        assert_eq!(finest, index.header.count);
    }
}

#[test]
fn the_finest_level_is_the_same_without_others() {
    let scene = scene(20_000, 2, 4);
    // Where the coarsest level is one chunk, the finest has the cuts of a stream without levels.
    let plain = encode(&scene, &encoding(|_| ())).unwrap();
    let with = encode(&scene, &encoding(|o| o.lod = true)).unwrap();
    assert_eq!((plain.index.coarsest_lod(), with.index.coarsest_lod()), (0, 1));
    assert!(plain.bytes.len() < with.bytes.len());
    let layers = |e: &EncodedStream| -> Vec<Vec<u8>> {
        let fine = e.index.chunks.iter().filter(|c| c.lod == 0);
        fine.map(|c| e.bytes[c.range(4).start as usize..c.range(4).end as usize].to_vec()).collect()
    };
    assert!(layers(&plain) == layers(&with));
    assert_eq!(decode(&plain.bytes).unwrap(), decode(&with.bytes).unwrap());
    assert_eq!(decode_leaves(&plain.bytes).unwrap(), decode_leaves(&with.bytes).unwrap());
}

#[test]
fn a_coarse_gaussian_lies_among_those_it_stands_for() {
    let (_, encoded) = tree();
    let index = &encoded.index;
    for chunk in &index.chunks {
        assert!((0..3).all(|k| chunk.bounds[0][k] <= chunk.bounds[1][k]));
    }
    let fine = decode(&encoded.bytes).unwrap();
    let coarse = decode_with(&encoded.bytes, &decoding(|o| o.lod = 1)).unwrap().scene;
    // A coarse Gaussian is at the centre of its cell, which holds a fine one.
    let cube = index.header.cube;
    let h = index.header.j_high;
    let fine_leaves = decode_leaves(&encoded.bytes).unwrap().0;
    assert_eq!(fine_leaves.len(), fine.len());
    let width = |mean: &[f32; 3]| {
        let mut widths = fine
            .means
            .iter()
            .map(|f| (0..3).map(|k| f64::from((f[k] - mean[k]).abs())).fold(0.0, f64::max));
        widths.by_ref().fold(f64::INFINITY, f64::min)
    };
    let farthest = coarse.means.iter().step_by(17).map(width).fold(0.0, f64::max);
    let smallest_coarse_cell = cube.side / f64::from(1u32 << h);
    assert!(farthest < cube.side / 8.0, "{farthest} with cells from {smallest_coarse_cell}");
}

/// Levels cost at most 8 % of the stream, and the coarsest is at most 8 % of it.
#[test]
fn levels_of_real_scenes_are_cheap() {
    check_cost("room", &room());
    if let Some(fox) = trained_scene("scenes/fox/point_cloud.ply") {
        check_cost("fox", &fox);
    }
}

fn check_cost(name: &str, scene: &Scene) {
    let plain = encode(scene, &encoding(|_| ())).unwrap().bytes.len();
    let with = encode(scene, &encoding(|o| o.lod = true)).unwrap();
    let overhead = with.bytes.len() as f64 / plain as f64 - 1.0;
    let front = end_of_coarsest(&with) as f64 / with.bytes.len() as f64;
    eprintln!("{name}: {plain} bytes, levels +{overhead:.4}, coarsest within {front:.4}");
    assert!(with.index.coarsest_lod() > 0, "{name}");
    assert!(overhead <= 0.08, "{name}: {overhead}");
    assert!(front <= 0.08, "{name}: {front}");
    assert!(decode_with(&with.bytes, &decoding(|o| o.lod = 9)).unwrap().scene.validate().is_ok());
}
