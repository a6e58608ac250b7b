//! Latents: the codec in the loop of an optimiser.

use gs_model::Scene;
use gsvx::latents::Latents;
use gsvx::{
    CodeOptions, EncodedStream, PrepareOptions, Steps, VoxelScene, decode, encode_voxels, prepare,
};
use std::num::NonZeroUsize;
use testing::{Rng, with_related_degrees};

fn trained_like(n: usize, sh_degree: u8, seed: u64) -> Scene {
    let scene = testing::trained_like(n, sh_degree, &mut Rng::seeded(seed));
    Scene { antialiased: true, origin: [5e5, 0.5, 0.0], ..with_related_degrees(scene) }
}

fn prepared(n: usize, sh_degree: u8) -> VoxelScene {
    let scene = trained_like(n, sh_degree, 7);
    prepare(&scene, None, 55.0, &PrepareOptions::default()).unwrap()
}

fn steps(quality: f32) -> Steps {
    Steps::of_quality(quality).unwrap()
}

fn chunks_of(leaves: usize) -> CodeOptions {
    CodeOptions { chunk_leaves: NonZeroUsize::new(leaves).unwrap(), ..CodeOptions::default() }
}

fn latents(p: &VoxelScene, options: &CodeOptions) -> Latents {
    let VoxelScene { scene, voxels, importance, .. } = p;
    Latents::new(scene, voxels.octree(), importance, steps(50.0), options).unwrap()
}

fn encoded_as(scene: &Scene, p: &VoxelScene, options: &CodeOptions) -> EncodedStream {
    let importance = Some(&p.importance[..]);
    encode_voxels(scene, p.voxels.octree(), None, importance, &steps(50.0), options).unwrap()
}

fn assert_same(a: &Scene, b: &Scene) {
    let bits = |s: &Scene| -> Vec<u32> {
        let floats = s.means.as_flattened().iter().chain(s.rotations.as_flattened());
        let floats = floats.chain(s.log_scales.as_flattened()).chain(&s.opacity_logits);
        floats.chain(s.sh.as_flattened()).map(|v| v.to_bits()).collect()
    };
    assert_eq!((a.len(), a.sh_degree), (b.len(), b.sh_degree));
    assert_eq!((a.antialiased, a.origin), (b.antialiased, b.origin));
    assert!(bits(a) == bits(b));
}

/// A stream leaves out SH degrees that are zero everywhere.
fn as_coded(scene: &Scene, encoded: &EncodedStream) -> Scene {
    let mut out = Scene { sh_degree: encoded.index.header.sh_degree, ..Scene::default() };
    out.append(scene);
    let left_out = |i: usize| scene.sh_of(i)[out.sh_len()..].iter().all(|v| *v == [0.0; 3]);
    assert!((0..scene.len()).all(left_out));
    out
}

/// The bytes that a fit counts, and the stream, which has about as many and decodes to the scene of the fit.
fn counted_and_coded(latents: &mut Latents, scene: &mut Scene) -> (u64, EncodedStream) {
    let counted = latents.reconstruct(true, None, scene).unwrap().unwrap();
    let encoded = latents.encode(None).unwrap();
    assert_same(&decode(&encoded.bytes).unwrap(), &as_coded(scene, &encoded));
    let real = encoded.bytes.len() as f64;
    assert!((counted as f64 - real).abs() < 0.005 * real + 64.0, "{counted} {real}");
    (counted, encoded)
}

#[test]
fn the_stream_decodes_to_the_scene_of_the_loop() {
    for (n, degree, chunk) in [(3000, 3, 1 << 16), (3000, 2, 700), (500, 1, 512), (1, 0, 512)] {
        let p = prepared(n, degree);
        let mut latents = latents(&p, &chunks_of(chunk));
        let mut scene = Scene::default();
        counted_and_coded(&mut latents, &mut scene);
        // Moved values, predictions of the last fit, other steps.
        latents.values_mut().iter_mut().for_each(|v| *v *= 0.97);
        latents.set_steps(steps(40.0)).unwrap();
        assert_eq!(latents.reconstruct(false, None, &mut scene).unwrap(), None);
        let encoded = latents.encode(None).unwrap();
        assert_same(&decode(&encoded.bytes).unwrap(), &as_coded(&scene, &encoded));
    }
}

/// The coarse level is the encoder's of the same Gaussians, and its bytes are counted.
#[test]
fn a_coarse_level_comes_first_and_is_counted() {
    let p = prepared(3000, 1);
    let mut plain = latents(&p, &CodeOptions::default());
    let plain = plain.reconstruct(true, None, &mut Scene::default()).unwrap().unwrap();
    let options = CodeOptions { lod: true, ..chunks_of(300) };
    let mut latents = latents(&p, &options);
    let mut scene = Scene::default();
    let (counted, encoded) = counted_and_coded(&mut latents, &mut scene);
    assert!(counted > plain, "{counted}, {plain} without levels");
    // Where chunks begin, and the bytes of the coarse ones, are those of the encoder.
    let coarse = |encoded: &EncodedStream| -> Vec<_> {
        let chunks = encoded.index.chunks.iter();
        chunks.map(|c| (c.lod, c.first_cell, c.layers[0].crc * u32::from(c.lod > 0))).collect()
    };
    let theirs = encoded_as(&scene, &p, &options);
    assert_eq!(coarse(&encoded), coarse(&theirs));
    assert!(coarse(&encoded)[0].0 > 0);
}

#[test]
fn outliers_stay_behind_the_leaves() {
    let p = prepared(400, 2);
    let mut outliers = trained_like(3, 2, 9);
    outliers.means.iter_mut().for_each(|m| m[0] += 1e4);
    let mut latents = latents(&p, &CodeOptions::default());
    let mut scene = p.scene.clone();
    scene.append(&outliers);
    latents.reconstruct(true, None, &mut scene).unwrap();
    assert_same(&decode(&latents.encode(Some(&outliers)).unwrap().bytes).unwrap(), &scene);
}

/// The same transform and steps as the encoder: what comes out is as near as its own reconstruction.
#[test]
fn the_loop_loses_no_more_than_the_encoder() {
    let p = prepared(2000, 3);
    let mut latents = latents(&p, &CodeOptions::default());
    let mut scene = Scene::default();
    latents.reconstruct(true, None, &mut scene).unwrap();
    let encoded = encoded_as(&p.scene, &p, &CodeOptions::default());
    let error = |s: &Scene| -> f64 {
        let pairs = s.sh.as_flattened().iter().zip(p.scene.sh.as_flattened());
        pairs.map(|(a, b)| f64::from(a - b) * f64::from(a - b)).sum()
    };
    let (ours, theirs) = (error(&scene), error(&decode(&encoded.bytes).unwrap()));
    assert!(ours < 1.1 * theirs, "{ours} {theirs}");
}

/// All values a tenth smaller: the bits saved are about those that the prices promise.
#[test]
fn prices_are_the_derivatives_of_the_bits() {
    let p = prepared(3000, 3);
    let mut latents = latents(&p, &CodeOptions::default());
    let mut scene = Scene::default();
    let mut prices = vec![0.0; latents.values().len()];
    let first = latents.reconstruct(true, Some(&mut prices), &mut scene).unwrap().unwrap();
    assert!(prices.iter().all(|v| v.is_finite()));
    let products = prices.iter().zip(latents.values()).map(|(&p, &v)| f64::from(p) * f64::from(v));
    let promised = 0.1 * products.sum::<f64>();
    latents.values_mut().iter_mut().for_each(|v| *v *= 0.9);
    let second = latents.reconstruct(true, None, &mut scene).unwrap().unwrap();
    let saved = 8.0 * (first as f64 - second as f64);
    println!("{first} bytes, then {second}: {saved} bits saved, {promised} promised");
    assert!(saved > 0.5 * promised && saved < 2.0 * promised, "{saved} {promised}");
}

#[test]
fn what_does_not_fit_is_refused() {
    let p = prepared(300, 1);
    let new = |scene: &Scene, importance: &[f32]| {
        let options = CodeOptions::default();
        Latents::new(scene, p.voxels.octree(), importance, steps(50.0), &options)
    };
    assert!(new(&p.scene, &[1.0; 5]).is_err());
    assert!(new(&trained_like(3, 1, 1), &p.importance).is_err());
    let mut broken = p.scene.clone();
    broken.sh[4][1] = f32::NAN;
    assert!(new(&broken, &p.importance).is_err());
    let mut latents = new(&p.scene, &p.importance).unwrap();
    let mut steps = latents.steps();
    steps.dc = 0.0;
    assert!(latents.set_steps(steps).is_err());
}
