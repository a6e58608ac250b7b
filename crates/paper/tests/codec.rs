//! The codec as its users see it: round trips, recorded streams, hostile input.

use paper::{
    CovarianceCoding, Error, Limits, PaperOptions, PaperStream, PaperVoxels, Qp, Strategy,
};
use proptest::prelude::*;
use testing::{Rng, sha256, trained_like};

const QP: Qp = Qp { ac: 28, dc: 4, opacity: 16 };
const LOSSY: CovarianceCoding = CovarianceCoding::Lossy { codebook_bits: 7 };

fn voxelized(n: usize, sh_degree: u8, strategy: &Strategy) -> PaperVoxels {
    paper::voxelize(&trained_like(n, sh_degree, &mut Rng::seeded(7)), strategy).unwrap()
}

fn encode(of: &PaperVoxels, covariance: CovarianceCoding) -> paper::PaperStream {
    paper::encode(&of.scene, of.voxels.octree(), None, &PaperOptions { qp: QP, covariance })
        .unwrap()
}

#[test]
fn positions_and_integers_of_covariances_come_back() {
    let of = voxelized(2000, 3, &Strategy::paper(4, 8));
    assert!(
        of.scene.len() < 2000 && of.voxels.octree().depth_histogram()[5..].iter().all(|&n| n > 0)
    );
    let encoded = encode(&of, CovarianceCoding::Lossless);
    let sum: u64 = encoded.parts.iter().map(|p| p.1).sum();
    assert_eq!(sum, encoded.bytes.len() as u64);
    let names: Vec<&str> = encoded.parts.iter().map(|p| p.0).collect();
    assert_eq!(names[..4], ["head", "geometry", "opacity", "DC"]);
    assert_eq!(names[4..], ["SH degree 1", "SH degree 2", "SH degree 3", "covariance"]);
    let back = paper::decode(&encoded.bytes).unwrap();
    back.validate().unwrap();
    assert_eq!(back.means, of.scene.means);
    // At most half an integer of the range of all components off.
    let check = |was: &[f32], is: &[f32]| {
        let end = |pick: fn(f32, f32) -> f32| was.iter().copied().reduce(pick).unwrap();
        let bound = 0.51 * (end(f32::max) - end(f32::min)) / 65535.0;
        assert!(was.iter().zip(is).all(|(a, b)| (a - b).abs() <= bound));
    };
    check(of.scene.log_scales.as_flattened(), back.log_scales.as_flattened());
    check(of.scene.rotations.as_flattened(), back.rotations.as_flattened());
}

#[test]
fn an_antialiased_model_comes_back_antialiased() {
    for antialiased in [true, false] {
        let mut of = voxelized(200, 1, &Strategy::Uniform { depth: 6 });
        of.scene.antialiased = antialiased;
        let back = paper::decode(&encode(&of, LOSSY).bytes).unwrap();
        assert_eq!((back.antialiased, back.sh_degree), (antialiased, 1));
    }
}

#[test]
fn covariances_are_the_nearest_codewords() {
    let of = voxelized(2000, 0, &Strategy::Uniform { depth: 8 });
    let (scene, n) = (&of.scene, of.scene.len());
    let sensitivities: Vec<f32> = (0..n).map(|i| (i % 10) as f32).collect();
    let options = PaperOptions { qp: QP, covariance: LOSSY };
    let bytes =
        paper::encode(scene, of.voxels.octree(), Some(&sensitivities), &options).unwrap().bytes;
    let back = paper::decode(&bytes).unwrap();
    let split = |i: usize| vq::Covariance::split(scene.rotations[i], scene.log_scales[i]).unwrap();
    let (covariances, factors): (Vec<_>, Vec<f32>) = (0..n).map(split).unzip();
    let book = vq::Codebook::train(&covariances, &sensitivities, 128).unwrap();
    let mut square = 0.0;
    for (i, index) in book.assign(&covariances).into_iter().enumerate() {
        let (rotation, log_scales) = book.decode(index).unwrap();
        assert_eq!(back.rotations[i], rotation, "Gaussian {i}");
        // Beside the codeword's log-scales there is the same factor on all axes.
        let factor: [f32; 3] = std::array::from_fn(|k| back.log_scales[i][k] - log_scales[k]);
        assert!((0..3).all(|k| (factor[k] - factor[0]).abs() < 1e-4), "Gaussian {i}: {factor:?}");
        let off = f64::from(factor[0] - factors[i]);
        square += off * off;
    }
    assert!((square / n as f64).sqrt() < 0.667 * 0.145);
}

/// Recorded once: the same bytes and floats on every machine, for any number of threads.
#[test]
fn streams_are_what_they_were() {
    let hashes = |covariance| {
        let of = voxelized(1500, 2, &Strategy::paper(4, 8));
        let bytes = encode(&of, covariance).bytes;
        // FNV-1a.
        let fnv = |h: u64, &b: &u8| (h ^ u64::from(b)).wrapping_mul(0x0100_0000_01b3);
        let hash = bytes.iter().fold(0xcbf2_9ce4_8422_2325, fnv);
        (hash, sha256(&paper::decode(&bytes).unwrap())[..16].to_owned())
    };
    for threads in [1, 3] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let (lossy, lossless) =
            pool.install(|| (hashes(LOSSY), hashes(CovarianceCoding::Lossless)));
        assert_eq!((lossy.0, &*lossy.1), (11_569_795_728_758_046_902, "4578d1dac69f2005"));
        assert_eq!((lossless.0, &*lossless.1), (6_476_668_322_353_165_340, "e0d9b164e6d1ede6"));
    }
}

#[test]
fn a_scene_without_gaussians_comes_back() {
    let of = voxelized(0, 3, &Strategy::Uniform { depth: 4 });
    for covariance in [LOSSY, CovarianceCoding::Lossless] {
        assert_eq!(paper::decode(&encode(&of, covariance).bytes).unwrap(), of.scene);
    }
}

#[test]
fn what_cannot_be_encoded_is_refused() {
    let of = voxelized(50, 1, &Strategy::Uniform { depth: 6 });
    let options = |ac, codebook_bits| PaperOptions {
        qp: Qp { ac, ..QP },
        covariance: CovarianceCoding::Lossy { codebook_bits },
    };
    let result = |scene: &gs_model::Scene, given: Option<&[f32]>, options: PaperOptions| {
        paper::encode(scene, of.voxels.octree(), given, &options)
    };
    assert!(matches!(result(&of.scene, None, options(52, 7)), Err(Error::Option { .. })));
    assert!(matches!(result(&of.scene, None, options(4, 21)), Err(Error::Option { .. })));
    assert!(matches!(result(&of.scene, Some(&[1.0]), options(4, 7)), Err(Error::Codebook(_))));
    let mut moved = of.scene.clone();
    moved.means[3][0] += 0.1;
    let not_voxelized = result(&moved, None, options(4, 7));
    assert!(matches!(not_voxelized, Err(Error::NotVoxelized { index: 3, .. })));
    moved.sh[0][1] = f32::NAN;
    assert!(matches!(result(&moved, None, options(4, 7)), Err(Error::Scene(_))));
}

#[test]
fn what_is_cut_off_or_too_large_is_refused() {
    let of = voxelized(300, 1, &Strategy::paper(3, 6));
    for covariance in [LOSSY, CovarianceCoding::Lossless] {
        let mut bytes = encode(&of, covariance).bytes;
        for len in 0..bytes.len() {
            assert!(paper::decode(&bytes[..len]).is_err(), "{len}");
        }
        let limits = Limits { max_points: of.scene.len() - 1 };
        let refused = paper::decode_within(&bytes, &limits);
        assert!(matches!(refused, Err(Error::Coding { what: "geometry", .. })));
        bytes.push(0);
        assert!(matches!(paper::decode(&bytes), Err(Error::Corrupt { .. })));
    }
    assert!(matches!(paper::decode(b"paper\x02"), Err(Error::Signature)));
}

/// The first codeword count of a stream is behind the codebook's mode.
#[test]
fn a_forged_codebook_is_not_allocated() {
    let of = voxelized(300, 0, &Strategy::Uniform { depth: 6 });
    let PaperStream { bytes, parts } = encode(&of, LOSSY);
    let covariance: u64 = parts.iter().rev().take(2).map(|p| p.1).sum();
    let covariance = covariance as usize;
    // Two bytes of the block's length, one of its mode.
    let at = bytes.len() - covariance + 3;
    let mut forged = bytes.clone();
    forged[at..at + 4].copy_from_slice(&(1u32 << 20).to_le_bytes());
    let error = paper::decode(&forged).unwrap_err();
    assert_eq!(error.to_string(), "corrupt stream: more codewords than Gaussians");
}

proptest! {
    /// Damage gives an error or a valid scene.
    #[test]
    fn damage_gives_an_error_or_a_valid_scene(
        lossless: bool, damage in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..8),
    ) {
        let of = voxelized(60, 1, &Strategy::paper(3, 6));
        let mut bytes = encode(&of, if lossless { CovarianceCoding::Lossless } else { LOSSY }).bytes;
        for (at, value) in damage {
            let at = at.index(bytes.len());
            bytes[at] = value;
        }
        if let Ok(scene) = paper::decode(&bytes) {
            scene.validate().unwrap();
        }
    }
}
