use gsvx::{EncodeOptions, Prepared};

use super::*;
use crate::scenes::TestScene;

const QP: PaperQp = PaperQp { ac: 28, dc: 4, opacity: 16 };

/// The room, voxelized.
fn room() -> Prepared {
    let model = TestScene::open("room", 1).unwrap().model;
    let mut options = EncodeOptions::default();
    options.leaves = gsvx::Leaves::Paper { j_low: 8, j_high: 12 };
    gsvx::prepare(&model, &options).unwrap()
}

fn round_trip(prepared: &Prepared, covariance: Covariance) -> Scene {
    let chain = PaperChain { qp: QP, covariance };
    let Prepared { scene, voxels, importance, .. } = prepared;
    let encoded = chain.encode(scene, voxels, importance).unwrap();
    let sum: u64 = encoded.parts.iter().map(|p| p.1).sum();
    assert_eq!(sum, encoded.bytes.len() as u64);
    let names: Vec<&str> = encoded.parts.iter().map(|p| p.0).collect();
    let degrees = ["SH degree 1", "SH degree 2", "SH degree 3"];
    assert_eq!(names[..4], ["head", "geometry", "opacity", "DC"]);
    assert_eq!((&names[4..7], names[7]), (&degrees[..], "covariance"));
    // What is cut off is an error, wherever.
    for part in 1..20 {
        assert!(decode(&encoded.bytes[..encoded.bytes.len() * part / 20]).is_err(), "{part}");
    }
    decode(&encoded.bytes).unwrap()
}

/// Root of the mean squared difference.
fn rms(a: &[f64], b: &[f64]) -> f64 {
    let sum: f64 = a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum();
    (sum / a.len() as f64).sqrt()
}

#[test]
fn attributes_come_back_within_their_steps() {
    let prepared = room();
    let scene = &prepared.scene;
    let back = round_trip(&prepared, Covariance::Integers { bits: 16 });
    assert_eq!(back.means, scene.means);
    for channel in channels(scene.sh_degree) {
        let values = channel.values(scene);
        let step = f64::from(channel::step(channel.qp(&QP), &values));
        // A coefficient is at most two thirds of a step off, and the transform is orthonormal.
        let error = rms(&values, &channel.values(&back));
        assert!(error <= 0.667 * step && error > 0.0, "{}: {error}, {step}", channel.part());
    }
    // At most half an integer of the range of all components off.
    let check = |was: &[f32], is: &[f32]| {
        let end = |pick: fn(f32, f32) -> f32| was.iter().copied().reduce(pick).unwrap();
        let bound = 0.51 * (end(f32::max) - end(f32::min)) / 65535.0;
        assert!(was.iter().zip(is).all(|(a, b)| (a - b).abs() <= bound));
    };
    check(scene.log_scales.as_flattened(), back.log_scales.as_flattened());
    check(scene.rotations.as_flattened(), back.rotations.as_flattened());
}

#[test]
fn codewords_are_decoded_as_they_were_trained() {
    let prepared = room();
    let scene = &prepared.scene;
    let back = round_trip(&prepared, Covariance::Codebook { bits: 12 });
    let split =
        |s: &Scene, i: usize| vq::Covariance::split(s.rotations[i], s.log_scales[i]).unwrap();
    let (covariances, factors): (Vec<_>, Vec<f32>) =
        (0..scene.len()).map(|i| split(scene, i)).unzip();
    let options = vq::Options::with_codewords(1 << 12);
    let book = vq::Codebook::train(&covariances, &prepared.importance, &options).unwrap();
    let mut errors = (Vec::new(), Vec::new());
    for (i, index) in book.assign(&covariances).into_iter().enumerate() {
        let (rotation, log_scales) = book.decode(index).unwrap();
        assert_eq!(back.rotations[i], rotation, "Gaussian {i}");
        // Behind the codeword's log-scales is the same factor on all axes.
        let factor: [f32; 3] = std::array::from_fn(|k| back.log_scales[i][k] - log_scales[k]);
        assert!((0..3).all(|k| (factor[k] - factor[0]).abs() < 1e-4), "Gaussian {i}: {factor:?}");
        errors.0.push(f64::from(factor[0]));
        errors.1.push(f64::from(factors[i]));
    }
    assert!(rms(&errors.0, &errors.1) < 0.667 * 0.145);
}

#[test]
fn a_scene_without_gaussians_comes_back() {
    let mut prepared = room();
    prepared.scene = Scene { sh_degree: 3, ..Scene::default() };
    prepared.voxels.octree().leaves().clear();
    prepared.importance.clear();
    for covariance in [Covariance::Codebook { bits: 12 }, Covariance::Integers { bits: 16 }] {
        let chain = PaperChain { qp: QP, covariance };
        let Prepared { scene, voxels, importance, .. } = &prepared;
        let bytes = chain.encode(scene, voxels, importance).unwrap().bytes;
        assert_eq!(decode(&bytes).unwrap(), *scene, "{covariance:?}");
    }
}
