//! Encode, decode, compare: every mode, every SH degree, tiny scenes, thread counts.

mod common;

use common::{scene, voxelized};
use gsvx::{
    CovarianceMode, DecodeOptions, EncodeOptions, Entropy, OpacityDomain, PaperQp, decode, encode,
};
use voxel::Strategy;

fn modes() -> Vec<(&'static str, EncodeOptions)> {
    let base = EncodeOptions::from_quality(70.0).unwrap();
    let qp = PaperQp { ac: 28, dc: 16, opacity: 16 };
    vec![
        ("default", base.clone()),
        ("fast", EncodeOptions { entropy: Entropy::Fast, ..base.clone() }),
        ("symbols", EncodeOptions { entropy: Entropy::Symbols, ..base.clone() }),
        ("small", EncodeOptions { entropy: Entropy::Small, ..base.clone() }),
        ("rlgr", EncodeOptions { entropy: Entropy::Rlgr, ..base.clone() }),
        ("uniform precision", EncodeOptions { uniform_precision: true, ..base.clone() }),
        ("logit", EncodeOptions { opacity_domain: OpacityDomain::Logit, ..base.clone() }),
        ("alpha", EncodeOptions { opacity_domain: OpacityDomain::Alpha, ..base.clone() }),
        ("codebook", EncodeOptions { covariance: CovarianceMode::Vq { bits: 8 }, ..base.clone() }),
        ("integers", EncodeOptions { covariance: CovarianceMode::Lossless { bits: 16 }, ..base }),
        ("paper", EncodeOptions::paper(qp, CovarianceMode::Lossless { bits: 16 })),
        ("paper vq", EncodeOptions::paper(qp, CovarianceMode::Vq { bits: 8 })),
    ]
}

#[test]
fn every_mode_keeps_means_and_stays_finite() {
    for n in [0, 1, 2, 3, 700] {
        for degree in 0..=3 {
            for strategy in [Strategy::Uniform { depth: 10 }, Strategy::paper(4, 11)] {
                let (merged, voxels) = voxelized(&scene(n, degree, 7), &strategy);
                for (name, options) in modes() {
                    let what = format!("{name}, {n} Gaussians, SH degree {degree}, {strategy:?}");
                    let encoded = encode(&merged, &voxels, &options).expect(&what);
                    let back = decode(&encoded.bytes, &DecodeOptions::default()).expect(&what);
                    assert_eq!(back.scene.means, merged.means, "{what}");
                    assert_eq!(back.leaves, voxels.leaves, "{what}");
                    assert_eq!(back.scene.sh_degree, degree, "{what}");
                    assert!(back.skipped.is_empty(), "{what}: {:?}", back.skipped);
                    assert!(back.scene.validate().is_ok(), "{what}");
                    let total: usize = encoded.sections.iter().map(|s| s.1).sum();
                    assert!(encoded.bytes.len() > total, "{what}: header is counted");
                }
            }
        }
    }
}

#[test]
fn errors_shrink_with_quality_and_respect_the_step() {
    let (merged, voxels) = voxelized(&scene(2000, 3, 3), &Strategy::Uniform { depth: 12 });
    let mut last = f64::INFINITY;
    for quality in [20.0, 50.0, 80.0, 100.0] {
        let mut options = EncodeOptions::from_quality(quality).unwrap();
        options.uniform_precision = true;
        let encoded = encode(&merged, &voxels, &options).unwrap();
        let back = decode(&encoded.bytes, &DecodeOptions::default()).unwrap();
        let square: f64 = (0..merged.len())
            .flat_map(|i| (0..3).map(move |c| (i, c)))
            .map(|(i, c)| f64::from(back.scene.sh_of(i)[0][c] - merged.sh_of(i)[0][c]))
            .map(|e| e * e)
            .sum();
        let rms = (square / (3 * merged.len()) as f64).sqrt();
        // A uniform quantiser has step / sqrt 12; a dead zone at most doubles that.
        assert!(rms <= f64::from(options.steps.dc) / 12f64.sqrt() * 2.0, "{quality}: {rms}");
        assert!(rms < last, "{quality}: {rms} after {last}");
        last = rms;
    }
}

#[test]
fn any_thread_count_gives_the_same_bytes_and_floats() {
    let (merged, voxels) = voxelized(&scene(3000, 3, 11), &Strategy::paper(5, 13));
    let at = |threads: usize, options: &EncodeOptions| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let bytes = encode(&merged, &voxels, options).unwrap().bytes;
            let scene = decode(&bytes, &DecodeOptions::default()).unwrap().scene;
            (bytes, scene)
        })
    };
    for (name, options) in modes() {
        let one = at(1, &options);
        for threads in [2, 3, 8] {
            assert!(one == at(threads, &options), "{name}: {threads} threads differ from one");
        }
    }
}

#[test]
fn sections_can_be_left_out() {
    let (merged, voxels) = voxelized(&scene(500, 3, 5), &Strategy::Uniform { depth: 9 });
    let bytes = encode(&merged, &voxels, &EncodeOptions::default()).unwrap().bytes;
    let full = decode(&bytes, &DecodeOptions::default()).unwrap();
    for degree in 0..3u8 {
        let options = DecodeOptions { max_sh_degree: degree, ..Default::default() };
        let part = decode(&bytes, &options).unwrap();
        assert_eq!(part.scene.sh_degree, degree);
        assert_eq!(part.skipped.len(), usize::from(3 - degree));
        assert_eq!(part.scene.rotations, full.scene.rotations);
        for i in 0..merged.len() {
            assert_eq!(part.scene.sh_of(i), &full.scene.sh_of(i)[..part.scene.sh_len()]);
        }
    }
    let fewer = EncodeOptions { max_sh_degree: 1, ..Default::default() };
    let bytes = encode(&merged, &voxels, &fewer).unwrap().bytes;
    assert_eq!(decode(&bytes, &DecodeOptions::default()).unwrap().scene.sh_degree, 1);
}

#[test]
fn misfits_are_errors() {
    let (merged, voxels) = voxelized(&scene(50, 1, 5), &Strategy::Uniform { depth: 9 });
    let options = EncodeOptions::default();
    let mut moved = merged.clone();
    moved.means[3][1] += 1.0;
    assert!(matches!(encode(&moved, &voxels, &options), Err(gsvx::Error::OffCentre { index: 3 })));
    let mut nan = merged.clone();
    nan.log_scales[4][0] = f32::NAN;
    assert!(matches!(
        encode(&nan, &voxels, &options),
        Err(gsvx::Error::NonFinite { index: 4, field: "log-scale" })
    ));
    let short = merged.select(&[0, 1, 2]);
    assert!(matches!(encode(&short, &voxels, &options), Err(gsvx::Error::CountMismatch { .. })));
    assert!(EncodeOptions::from_quality(f32::NAN).is_err());
    assert!(EncodeOptions::from_quality(101.0).is_err());
}

/// Found by `cargo xtask stress`: the transform's fixed point clamped these without a word.
#[test]
fn values_beyond_the_fixed_point_are_refused() {
    let (merged, voxels) = voxelized(&scene(50, 1, 5), &Strategy::Uniform { depth: 9 });
    let mut huge = merged.clone();
    huge.sh[7][2] = -2e4;
    assert!(matches!(
        encode(&huge, &voxels, &EncodeOptions::default()),
        Err(gsvx::Error::TooLarge { index: 1, field: "SH coefficient", .. })
    ));
    huge.sh[7][2] = -1.8e4;
    let bytes = encode(&huge, &voxels, &EncodeOptions::default()).unwrap().bytes;
    let back = decode(&bytes, &DecodeOptions::default()).unwrap().scene;
    assert!((back.sh[7][2] + 1.8e4).abs() < 10.0, "{}", back.sh[7][2]);
}

#[test]
fn levels_of_detail_shrink_and_keep_the_tree() {
    let (merged, voxels) = voxelized(&scene(1500, 2, 5), &Strategy::paper(4, 12));
    let bytes = encode(&merged, &voxels, &EncodeOptions::default()).unwrap().bytes;
    let mut last = usize::MAX;
    for depth in [12, 8, 5, 2, 0] {
        let options = DecodeOptions { lod: Some(depth), ..Default::default() };
        let part = decode(&bytes, &options).unwrap();
        assert!(part.scene.validate().is_ok() && part.scene.len() == part.leaves.len());
        assert!(part.leaves.iter().all(|l| l.depth <= depth));
        for (leaf, mean) in part.leaves.iter().zip(&part.scene.means) {
            assert_eq!(*mean, voxels.cube.leaf_centre(*leaf, voxels.j_high));
        }
        assert!(part.scene.len() <= last);
        last = part.scene.len();
    }
    assert_eq!(last, 1);
}

/// Degrees that carry nothing cost nothing: the header's degree falls, the scene is the same.
#[test]
fn degrees_that_are_zero_are_left_out() {
    let (mut merged, voxels) = voxelized(&scene(500, 3, 5), &Strategy::Uniform { depth: 11 });
    let k = merged.sh_len();
    merged.sh.chunks_exact_mut(k).for_each(|sh| sh[9..].fill([0.0; 3]));
    let options = EncodeOptions::from_quality(70.0).unwrap();
    let degree = |merged: &gs_model::Scene, options: &EncodeOptions| {
        let encoded = encode(merged, &voxels, options).unwrap();
        decode(&encoded.bytes, &DecodeOptions::default()).unwrap().scene.sh_degree
    };
    assert_eq!(degree(&merged, &options), 2);
    // What quantises to zero is as good as zero, but a degree below one that does not stays.
    let mut coarse = options.clone();
    coarse.steps.sh = [options.steps.sh[0], 1e6, 1e6];
    assert_eq!(degree(&merged, &coarse), 1);
    coarse.steps.sh = [1e6, options.steps.sh[1], 1e6];
    assert_eq!(degree(&merged, &coarse), 2);
}
