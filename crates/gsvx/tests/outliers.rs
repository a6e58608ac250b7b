//! Gaussians far outside the scene: coded exactly, so that they cost the others no precision.
#![cfg(feature = "encode")]

mod common;

use common::{bits, decoding, encode, encode_voxels, encoding, scene, voxelized, with_floaters};
use gs_model::Scene;
use gsvx::{EncodeOptions, Error, Kind, decode, decode_with};
use voxel::Strategy;

#[test]
fn floaters_come_back_bit_for_bit_in_their_order() {
    for degree in [0, 3] {
        let (scene, at) = with_floaters(scene(3000, degree, 8));
        let encoded = encode(&scene, &EncodeOptions::default()).unwrap();
        let last = encoded.index.chunks.last().unwrap();
        assert_eq!((last.kind, last.count, encoded.exact()), (Kind::Exact, 3, 3));
        let back = decode(&encoded.bytes).unwrap();
        let leaves = back.len() - 3;
        for (k, &i) in at.iter().enumerate() {
            assert_eq!(bits(&back, leaves + k), bits(&scene, i));
        }
        // The others are what they are without the floaters.
        let inside: Vec<usize> = (0..scene.len()).filter(|i| !at.contains(i)).collect();
        let inliers = scene.select(&inside);
        let alone = decode(&encode(&inliers, &EncodeOptions::default()).unwrap().bytes).unwrap();
        assert_eq!(alone, back.select(&(0..leaves).collect::<Vec<_>>()));
        // In an octree around all, the finest cell is a thousand times as wide.
        let header = &encoded.index.header;
        let whole = voxel::cube_of(&scene.means).unwrap().side / f64::from(1u32 << 21);
        assert!(header.cube.side / f64::from(1u32 << header.j_high) < 1e-3 * whole);
    }
}

#[test]
fn a_scene_without_floaters_is_not_trimmed() {
    for n in [0, 1, 500] {
        let encoded = encode(&scene(n, 1, 8), &EncodeOptions::default()).unwrap();
        assert_eq!(encoded.exact(), 0, "{n}");
    }
    // One floater within reach of 21 levels is cheaper in the octree.
    let mut near = scene(500, 1, 8);
    near.means[3] = [1000.0, 0.0, 0.0];
    assert_eq!(encode(&near, &EncodeOptions::default()).unwrap().exact(), 0);
    // No outliers, no chunk of them.
    let (merged, voxels) = voxelized(&scene(80, 1, 3), &Strategy::Uniform { depth: 9 });
    let options = EncodeOptions::default();
    let plain = encode_voxels(&merged, voxels.octree(), None, &options).unwrap();
    let none = encode_voxels(&merged, voxels.octree(), Some(&scene(0, 1, 3)), &options).unwrap();
    assert_eq!(plain, none);
}

#[test]
fn importances_of_outliers_are_left_out() {
    let (scene, at) = with_floaters(scene(500, 1, 8));
    let importance: Vec<f32> = (0..scene.len()).map(|i| 1.0 + (i % 7) as f32).collect();
    let inside: Vec<usize> = (0..scene.len()).filter(|i| !at.contains(i)).collect();
    let rest: Vec<f32> = inside.iter().map(|&i| importance[i]).collect();
    let encode = |scene: &Scene, importance: &[f32]| {
        gsvx::encode(scene, Some(importance), 80.0, &EncodeOptions::default()).unwrap()
    };
    let (all, alone) = (encode(&scene, &importance), encode(&scene.select(&inside), &rest));
    let n = alone.index.chunks.len();
    let layers = |e: &gsvx::EncodedStream| {
        e.index.chunks[..n].iter().map(|c| c.layers[0].crc).collect::<Vec<_>>()
    };
    assert_eq!(layers(&all), layers(&alone));
}

#[test]
fn fewer_degrees_and_coarser_levels_keep_the_outliers() {
    let (merged, voxels) = voxelized(&scene(600, 2, 3), &Strategy::Uniform { depth: 9 });
    let outliers = scene(3, 2, 4);
    let options = encoding(|o| o.lod = true);
    let encoded = encode_voxels(&merged, voxels.octree(), Some(&outliers), &options).unwrap();
    for degree in 0..3 {
        let options = decoding(|o| o.max_sh_degree = degree);
        let part = decode_with(&encoded.bytes, &options).unwrap().scene;
        let n = merged.len();
        assert_eq!((part.sh_degree, part.len()), (degree, n + 3));
        for i in 0..3 {
            assert_eq!(part.means[n + i], outliers.means[i]);
            assert_eq!(part.sh_of(n + i), &outliers.sh_of(i)[..part.sh_len()]);
        }
    }
    let coarse = decode_with(&encoded.bytes, &decoding(|o| o.lod = 1)).unwrap().scene;
    let n = coarse.len() - 3;
    assert!(n > 0 && n < merged.len() / 8);
    for i in 0..3 {
        assert_eq!(bits(&coarse, n + i), bits(&outliers, i));
    }
    // A stream without its end says that they are missing.
    let cut = &encoded.bytes[..encoded.bytes.len() - 1];
    let part = decode_with(cut, &decoding(|o| o.salvage = true)).unwrap();
    assert_eq!(part.scene.len(), merged.len());
    assert!(part.skipped[0].contains("(3 Gaussians)"), "{:?}", part.skipped);
}

/// The header's degree would fall to what the leaves use, and cut the outliers'.
#[test]
fn degrees_that_only_outliers_use_are_kept() {
    let mut leaves = scene(80, 3, 3);
    leaves.sh.chunks_exact_mut(16).for_each(|sh| sh[1..].fill([0.0; 3]));
    let (merged, voxels) = voxelized(&leaves, &Strategy::Uniform { depth: 9 });
    let outliers = scene(2, 2, 4);
    for (most, degree) in [(3, 2), (1, 1)] {
        let options = encoding(|o| o.max_sh_degree = most);
        let encoded = encode_voxels(&merged, voxels.octree(), Some(&outliers), &options).unwrap();
        let back = decode(&encoded.bytes).unwrap();
        assert_eq!(back.sh_degree, degree);
        assert_eq!(back.sh_of(merged.len() + 1), &outliers.sh_of(1)[..back.sh_len()]);
    }
}

#[test]
fn a_scene_of_nothing_but_outliers() {
    let (merged, voxels) = voxelized(&scene(0, 2, 3), &Strategy::Uniform { depth: 9 });
    let outliers = scene(5, 2, 4);
    let encoded =
        encode_voxels(&merged, voxels.octree(), Some(&outliers), &EncodeOptions::default());
    let back = decode(&encoded.unwrap().bytes).unwrap();
    assert_eq!(back, outliers);
}

#[test]
fn outliers_that_do_not_fit_are_refused() {
    let (merged, voxels) = voxelized(&scene(80, 1, 3), &Strategy::Uniform { depth: 9 });
    let encode = |outliers: Scene| {
        encode_voxels(&merged, voxels.octree(), Some(&outliers), &EncodeOptions::default())
    };
    let mut broken = scene(3, 1, 3);
    broken.rotations[1] = [0.0; 4];
    assert!(matches!(encode(broken), Err(Error::InvalidOutlier { index: 1, .. })));
    let mut broken = scene(3, 1, 3);
    broken.means[2][0] = f32::NAN;
    assert!(matches!(encode(broken), Err(Error::InvalidOutlier { index: 2, .. })));
    assert!(matches!(encode(scene(3, 2, 3)), Err(Error::Option { .. })));
    let mut short = scene(3, 1, 3);
    short.rotations.pop();
    assert!(matches!(encode(short), Err(Error::Length { found: 2, expected: 3, .. })));
}
