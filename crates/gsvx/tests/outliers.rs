//! Floaters far outside the scene: coded exactly, so that they cost nobody a level.

mod common;

use common::{Rng, scene, voxelized, with_floaters};
use gs_model::Scene;
use gsvx::stream::{Container, SectionKind, assemble};
use gsvx::{
    DecodeOptions, EncodeOptions, Error, Prepared, decode, default_strategy, encode, prepare,
    split_outliers,
};
use voxel::Strategy;

/// Every bit of Gaussian `i`.
fn bits(s: &Scene, i: usize) -> Vec<u32> {
    let floats = [
        &s.means[i][..],
        &s.rotations[i],
        &s.log_scales[i],
        &[s.opacity_logits[i]],
        s.sh_of(i).as_flattened(),
    ];
    floats.concat().iter().map(|v| v.to_bits()).collect()
}

/// The stream of the default strategy, and its voxelized scene.
fn coded(scene: &Scene, outliers: Option<Scene>) -> (Vec<u8>, Prepared) {
    let strategy = |importance: &[f32], seen| default_strategy(60.0, importance, seen);
    let prepared = prepare(scene, strategy, None).unwrap();
    let importance = Some(prepared.importance.clone());
    let options = EncodeOptions { importance, outliers, ..EncodeOptions::default() };
    (encode(&prepared.scene, &prepared.voxels, &options).unwrap().bytes, prepared)
}

fn trimmed(scene: &Scene) -> (Vec<u8>, Prepared) {
    let split = split_outliers(scene).unwrap().expect("floaters are found");
    coded(&scene.select(&split.inside), Some(scene.select(&split.outliers)))
}

/// Inliers, stored floaters and a stream that holds both.
fn small() -> (Scene, Scene, Vec<u8>) {
    let (merged, voxels) = voxelized(&scene(80, 2, 3), &Strategy::Uniform { depth: 9 });
    let outliers = scene(3, 2, 4);
    let options = EncodeOptions { outliers: Some(outliers.clone()), ..Default::default() };
    let bytes = encode(&merged, &voxels, &options).unwrap().bytes;
    (merged, outliers, bytes)
}

fn sections(bytes: &[u8]) -> Vec<(SectionKind, Vec<u8>)> {
    let container = Container::parse(bytes).unwrap();
    let payload = |kind| container.section(kind).unwrap().unwrap().to_vec();
    container.toc.iter().map(|e| (e.kind, payload(e.kind))).collect()
}

fn forge(bytes: &[u8], change: impl FnOnce(&mut Vec<u8>)) -> Vec<u8> {
    let mut all = sections(bytes);
    change(&mut all.iter_mut().find(|(kind, _)| *kind == SectionKind::Outliers).unwrap().1);
    assemble(&Container::parse(bytes).unwrap().header, &all)
}

#[test]
fn floaters_come_back_bit_for_bit_and_cost_nobody_a_level() {
    for degree in [0, 3] {
        let (scene, at) = with_floaters(scene(3000, degree, 8));
        let split = split_outliers(&scene).unwrap().unwrap();
        assert_eq!(split.outliers, at);
        let (bytes, prepared) = trimmed(&scene);
        let untrimmed = coded(&scene, None).1;
        let inliers = scene.select(&split.inside);
        let (alone, without) = coded(&inliers, None);

        let decoded = decode(&bytes, &DecodeOptions::default()).unwrap();
        let leaves = decoded.leaves.len();
        assert_eq!(decoded.scene.len(), leaves + 3);
        for (k, &i) in at.iter().enumerate() {
            assert_eq!(bits(&decoded.scene, leaves + k), bits(&scene, i));
        }
        // The others are what they are without the floaters.
        assert_eq!(prepared.voxels.cube, without.voxels.cube);
        let plain = decode(&alone, &DecodeOptions::default()).unwrap();
        assert_eq!(plain.scene, decoded.scene.select(&(0..leaves).collect::<Vec<_>>()));
        assert_eq!(Container::parse(&bytes).unwrap().outliers(), 3);
        // In the octree they cost everyone levels: the finest cell is 0.95 units wide.
        let cell = |p: &Prepared| p.voxels.cube.side / f64::from(1u32 << p.voxels.j_high);
        assert_eq!(untrimmed.voxels.j_high, 21);
        assert!(prepared.voxels.j_high < 21 && cell(&prepared) < 1e-3 * cell(&untrimmed));
        assert!(untrimmed.voxels.len() < leaves / 2, "they share cells");
    }
}

#[test]
fn a_scene_without_floaters_is_not_trimmed() {
    for n in [0, 1, 500] {
        assert_eq!(split_outliers(&scene(n, 1, 8)).unwrap(), None, "{n}");
    }
    // One floater within reach of 21 levels is cheaper in the octree.
    let mut near = scene(500, 1, 8);
    near.means[3] = [1000.0, 0.0, 0.0];
    assert_eq!(split_outliers(&near).unwrap(), None);
    // No outliers, no section, no later version.
    let (merged, voxels) = voxelized(&scene(80, 1, 3), &Strategy::Uniform { depth: 9 });
    let plain = encode(&merged, &voxels, &EncodeOptions::default()).unwrap().bytes;
    let none = EncodeOptions { outliers: Some(scene(0, 1, 3)), ..Default::default() };
    assert_eq!(encode(&merged, &voxels, &none).unwrap().bytes, plain);
    assert_eq!((plain[8], plain[9], small().2[9]), (gsvx::stream::MAJOR, 0, 1));
}

#[test]
fn the_same_bytes_for_one_thread_and_three() {
    let (scene, _) = with_floaters(scene(3000, 2, 5));
    let on = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let bytes = trimmed(&scene).0;
            let back = decode(&bytes, &DecodeOptions::default()).unwrap().scene;
            (bytes, back)
        })
    };
    assert_eq!(on(1), on(3));
}

#[test]
fn less_of_the_stream_keeps_the_outliers() {
    let (merged, outliers, bytes) = small();
    let n = merged.len();
    for degree in 0..3 {
        let options = DecodeOptions { max_sh_degree: degree, ..Default::default() };
        let part = decode(&bytes, &options).unwrap().scene;
        assert_eq!((part.sh_degree, part.len()), (degree, n + 3));
        for i in 0..3 {
            assert_eq!(part.means[n + i], outliers.means[i]);
            assert_eq!(part.sh_of(n + i), &outliers.sh_of(i)[..part.sh_len()]);
        }
    }
    for depth in [0, 4, 9] {
        let options = DecodeOptions { lod: Some(depth), ..Default::default() };
        let part = decode(&bytes, &options).unwrap();
        let leaves = part.leaves.len();
        assert_eq!(part.scene.len(), leaves + 3);
        for i in 0..3 {
            assert_eq!(bits(&part.scene, leaves + i), bits(&outliers, i));
        }
    }
    // A prefix that ends after the outliers has them, one that ends before says so.
    let container = Container::parse(&bytes).unwrap();
    let mut end = container.body_offset();
    let kinds = container.toc.iter().take_while(|e| e.kind != SectionKind::Sh1);
    end += kinds.map(|e| e.len as usize).sum::<usize>();
    let lenient = DecodeOptions { allow_truncated: true, ..Default::default() };
    assert_eq!(decode(&bytes[..end], &lenient).unwrap().scene.len(), n + 3);
    let part = decode(&bytes[..end - 1], &lenient).unwrap();
    assert_eq!(part.scene.len(), n);
    assert!(part.skipped.iter().any(|s| s.contains("outliers")), "{:?}", part.skipped);
}

/// The header's degree would fall to what the leaves use, and cut the outliers'.
#[test]
fn degrees_that_only_outliers_use_are_kept() {
    let mut leaves = scene(80, 3, 3);
    leaves.sh.chunks_exact_mut(16).for_each(|sh| sh[1..].fill([0.0; 3]));
    let (merged, voxels) = voxelized(&leaves, &Strategy::Uniform { depth: 9 });
    let outliers = scene(2, 2, 4);
    for (most, degree) in [(3, 2), (1, 1)] {
        let outliers = Some(outliers.clone());
        let options = EncodeOptions { outliers, max_sh_degree: most, ..Default::default() };
        let bytes = encode(&merged, &voxels, &options).unwrap().bytes;
        let back = decode(&bytes, &DecodeOptions::default()).unwrap().scene;
        assert_eq!(back.sh_degree, degree);
        assert_eq!(
            back.sh_of(merged.len() + 1),
            &options.outliers.unwrap().sh_of(1)[..back.sh_len()]
        );
    }
}

#[test]
fn outliers_that_do_not_fit_are_refused() {
    let (merged, voxels) = voxelized(&scene(80, 1, 3), &Strategy::Uniform { depth: 9 });
    let encode = |outliers: Scene| {
        encode(&merged, &voxels, &EncodeOptions { outliers: Some(outliers), ..Default::default() })
    };
    let mut nan = scene(3, 1, 3);
    nan.log_scales[1][2] = f32::NAN;
    assert!(matches!(encode(nan), Err(Error::InvalidOutlier { index: 1, .. })));
    assert!(matches!(encode(scene(3, 2, 3)), Err(Error::Option { .. })));
    let mut short = scene(3, 1, 3);
    short.rotations.pop();
    assert!(matches!(encode(short), Err(Error::CountMismatch { scene: 3, leaves: 2 })));
}

#[test]
fn forged_outliers_are_refused() {
    let (merged, _, bytes) = small();
    let default = DecodeOptions::default();
    let row = 4 * (11 + 27);
    for len in [0, 1, row - 4, row + 1, 3 * row - 1, 3 * row + 4] {
        let forged = forge(&bytes, |payload| payload.resize(len, 0));
        assert!(matches!(decode(&forged, &default), Err(Error::Corrupt { .. })), "{len}");
    }
    // Not a number; a rotation without direction.
    for (at, value) in [(row, f32::NAN), (2 * row + 12, f32::INFINITY)] {
        let forged = forge(&bytes, |p| p[at..at + 4].copy_from_slice(&value.to_le_bytes()));
        assert!(matches!(decode(&forged, &default), Err(Error::Corrupt { .. })), "{at}");
    }
    let forged = forge(&bytes, |p| p[row + 28..row + 44].fill(0));
    assert!(matches!(decode(&forged, &default), Err(Error::Corrupt { value: 1, .. })));
    // They count towards the limit.
    let few = |n| DecodeOptions { max_gaussians: Some(n), ..Default::default() };
    let n = merged.len() as u64;
    assert!(matches!(decode(&bytes, &few(n + 2)), Err(Error::Limit { .. })));
    assert!(decode(&bytes, &few(n + 3)).is_ok());
}

#[test]
fn damage_to_a_stream_with_outliers() {
    let bytes = small().2;
    let default = DecodeOptions::default();
    let lenient = DecodeOptions { allow_truncated: true, ..Default::default() };
    for end in 0..bytes.len() {
        assert!(decode(&bytes[..end], &default).is_err(), "cut at {end}");
        if let Ok(part) = decode(&bytes[..end], &lenient) {
            assert!(!part.skipped.is_empty() && part.scene.validate().is_ok(), "cut at {end}");
        }
    }
    let mut rng = Rng(6);
    for round in 0..2000 {
        let at = (rng.next() % bytes.len() as u64) as usize;
        let mut broken = bytes.clone();
        broken[at] ^= 1 << (rng.next() % 8);
        assert!(decode(&broken, &default).is_err(), "byte {at}");
        // Behind a valid checksum.
        let forged = forge(&bytes, |p| {
            let at = (rng.next() % p.len() as u64) as usize;
            p[at] = rng.next() as u8;
        });
        if let Ok(decoded) = decode(&forged, &default) {
            assert!(decoded.scene.validate().is_ok(), "round {round}");
        }
    }
}
