//! Encode, decode, compare: every mode, every SH degree, tiny scenes, thread counts.
#![cfg(feature = "encode")]

mod common;

use common::{
    bits, encode, encode_voxels, encoding, leaves, on_threads, scene, spread, steps, voxelized,
    with_floaters,
};
use gs_model::Scene;
use gsvx::covariance::coordinates;
use gsvx::{
    Aim, DecodeOptions, EncodeOptions, EncodedStream, Encoder, Error, MaxError, Steps, decode,
    decode_leaves, decode_with, importance,
};
use voxel::{Strategy, Voxelization};

fn modes() -> Vec<(&'static str, EncodeOptions)> {
    vec![
        ("default", encoding(|_| ())),
        ("uniform precision", encoding(|o| o.uniform_precision = true)),
        ("chunks", encoding(|o| o.chunk_leaves = leaves(100))),
        ("levels of detail", encoding(|o| (o.lod, o.chunk_leaves) = (true, leaves(100)))),
    ]
}

#[test]
fn every_mode_keeps_leaves_and_stays_finite() {
    for n in [0, 1, 2, 3, 500] {
        for degree in 0..=3 {
            for strategy in [Strategy::Uniform { depth: 10 }, Strategy::paper(4, 11)] {
                let (merged, voxels) = voxelized(&scene(n, degree, 7), &strategy);
                for (name, options) in modes() {
                    let what = format!("{name}, {n} Gaussians, SH degree {degree}, {strategy:?}");
                    let encoded =
                        encode_voxels(&merged, voxels.octree(), None, &options).expect(&what);
                    let back = decode_with(&encoded.bytes, &Default::default()).expect(&what);
                    assert_eq!(back.scene.means, merged.means, "{what}");
                    assert!(back.scene.validate().is_ok(), "{what}");
                    assert!(back.skipped.is_empty(), "{what}: {:?}", back.skipped);
                    assert_eq!(back.index, encoded.index, "{what}");
                    assert_eq!(encoded.index.stream_len(), encoded.bytes.len() as u64, "{what}");
                    let parts: u64 = encoded.parts().iter().map(|p| p.1).sum();
                    assert_eq!(parts, encoded.bytes.len() as u64, "{what}");
                    let (decoded_leaves, classes) = decode_leaves(&encoded.bytes).expect(&what);
                    assert_eq!(&decoded_leaves, voxels.octree(), "{what}");
                    assert_eq!(classes.len(), voxels.len(), "{what}");
                    // Degrees that quantise to zero everywhere are left out.
                    assert!(back.scene.sh_degree <= degree, "{what}");
                    assert!(back.scene.sh_degree == degree || n < 500, "{what}");
                }
            }
        }
    }
}

#[test]
fn what_the_encoder_keeps_is_what_a_decoder_returns() {
    for (n, degree, quality) in [(0, 3, 80.0), (1, 0, 80.0), (3000, 3, 80.0), (3000, 2, 0.0)] {
        let model =
            if n > 1000 { with_floaters(scene(n, degree, 8)).0 } else { scene(n, degree, 8) };
        for (name, options) in modes() {
            let what = format!("{name}, {n} Gaussians, SH degree {degree}, quality {quality}");
            let mut encoder = Encoder::new(Aim::Quality(quality));
            (encoder.options, encoder.keep_decoded) = (options, true);
            let mut made = encoder.encode(&model, None).unwrap().encoded;
            let (kept, back) = (made.decoded.take().unwrap(), made.decode().unwrap());
            assert_eq!((kept.len(), kept.sh_degree), (back.len(), back.sh_degree), "{what}");
            assert!((0..back.len()).all(|i| bits(&kept, i) == bits(&back, i)), "{what}");
            encoder.keep_decoded = false;
            assert_eq!(encoder.encode(&model, None).unwrap().encoded, made, "{what}");
        }
    }
}

/// Errors of a decoded scene, by attribute, in quantisation steps.
fn errors_in_steps(a: &Scene, b: &Scene, steps: &Steps) -> Vec<(String, Vec<f64>)> {
    let n = a.len();
    let log_alpha = |l: f32| -libm::log1p(libm::exp(-f64::from(l)));
    let opacity = (0..n).map(|i| log_alpha(a.opacity_logits[i]) - log_alpha(b.opacity_logits[i]));
    let mut out = vec![("opacity".to_string(), steps.opacity, opacity.collect::<Vec<_>>())];
    let covariance = (0..n).flat_map(|i| {
        let a = coordinates(a.rotations[i], a.log_scales[i]);
        let b = coordinates(b.rotations[i], b.log_scales[i]);
        (0..6).map(move |k| f64::from(a[k] - b[k]))
    });
    out.push(("covariance".to_string(), steps.covariance, covariance.collect()));
    for degree in 0..=usize::from(a.sh_degree) {
        let step = if degree == 0 { steps.dc } else { steps.sh[degree - 1] };
        let range = degree * degree..(degree + 1) * (degree + 1);
        let of = |s: &Scene, i: usize| s.sh_of(i)[range.clone()].as_flattened().to_vec();
        let each = (0..n).flat_map(|i| of(a, i).into_iter().zip(of(b, i)));
        let each = each.map(|(a, b)| f64::from(a) - f64::from(b)).collect();
        out.push((format!("SH degree {degree}"), step, each));
    }
    let scaled = |(name, step, errors): (String, f32, Vec<f64>)| {
        (name, errors.into_iter().map(|e| e / f64::from(step)).collect())
    };
    out.into_iter().map(scaled).collect()
}

/// A uniform quantiser has an error of `step / sqrt 12`, 0.29 steps; the dead zone and
/// rate-distortion optimisation at most double it. The transform is orthonormal.
#[test]
fn errors_shrink_with_quality_and_respect_the_steps() {
    let (merged, voxels) = voxelized(&scene(2000, 3, 3), &Strategy::Uniform { depth: 12 });
    for predicted in [false, true] {
        let merged =
            if predicted { common::with_related_degrees(merged.clone()) } else { merged.clone() };
        let mut last = vec![f64::INFINITY; 6];
        for quality in [20.0, 50.0, 80.0, 100.0] {
            let (steps, options) = (steps(quality), encoding(|o| o.uniform_precision = true));
            let coded =
                gsvx::encode_voxels(&merged, voxels.octree(), None, None, &steps, &options.code);
            let mut back = decode(&coded.unwrap().bytes).unwrap();
            // Degrees that are left out are zero.
            let missing = merged.sh_len() - back.sh_len();
            if missing > 0 {
                let sh: Vec<_> = (0..back.len())
                    .flat_map(|i| back.sh_of(i).iter().copied().chain(vec![[0.0; 3]; missing]))
                    .collect();
                (back.sh, back.sh_degree) = (sh, 3);
            }
            let errors = errors_in_steps(&merged, &back, &steps);
            for ((name, errors), last) in errors.into_iter().zip(&mut last) {
                let error = spread(errors);
                let what = format!("{name}, quality {quality}: {} {}", error.rms, error.largest);
                assert!(error.rms <= 2.0 / 12f64.sqrt(), "{what}");
                assert!(error.largest <= 4.0, "{what}");
                let absolute = error.rms * f64::from(steps.dc);
                // Equal where both qualities leave the degree out.
                assert!(absolute <= *last * (1.0 + 1e-6), "{what}");
                assert!(absolute < *last || quality < 80.0, "{what}");
                *last = absolute;
            }
        }
    }
}

#[test]
fn any_thread_count_gives_the_same_bytes_and_floats() {
    let (scene, _) = with_floaters(scene(2000, 3, 11));
    for (name, options) in modes() {
        let coded = |threads| {
            on_threads(threads, || {
                let bytes = encode(&scene, &options).unwrap().bytes;
                let back = decode(&bytes).unwrap();
                (bytes, back)
            })
        };
        let one = coded(1);
        for threads in [2, 3, 8] {
            assert!(one == coded(threads), "{name}: {threads} threads differ from one");
        }
    }
}

#[test]
fn fewer_sh_degrees_are_a_prefix() {
    let (merged, voxels) = voxelized(&scene(500, 3, 5), &Strategy::Uniform { depth: 9 });
    let options = encoding(|o| o.chunk_leaves = leaves(150));
    let bytes = encode_voxels(&merged, voxels.octree(), None, &options).unwrap().bytes;
    let full = decode(&bytes).unwrap();
    assert_eq!(full.sh_degree, 3);
    for degree in 0..3u8 {
        let part = decode_with(&bytes, &common::decoding(|o| o.max_sh_degree = degree)).unwrap();
        assert_eq!((part.scene.sh_degree, part.skipped.len()), (degree, 1));
        assert_eq!(part.scene.rotations, full.rotations);
        for i in 0..merged.len() {
            assert_eq!(part.scene.sh_of(i), &full.sh_of(i)[..part.scene.sh_len()]);
        }
    }
    let options = encoding(|o| o.max_sh_degree = 1);
    let bytes = encode_voxels(&merged, voxels.octree(), None, &options).unwrap().bytes;
    assert_eq!(decode(&bytes).unwrap().sh_degree, 1);
}

/// Degrees that carry nothing cost nothing: the header's degree falls, the scene is the same.
#[test]
fn degrees_that_are_zero_are_left_out() {
    let (mut merged, voxels) = voxelized(&scene(500, 3, 5), &Strategy::Uniform { depth: 11 });
    let k = merged.sh_len();
    merged.sh.chunks_exact_mut(k).for_each(|sh| sh[9..].fill([0.0; 3]));
    let degree = |sh: [f32; 3]| {
        let options = encoding(|o| o.chunk_leaves = leaves(200)).code;
        let steps = Steps { sh, ..steps(70.0) };
        let coded = gsvx::encode_voxels(&merged, voxels.octree(), None, None, &steps, &options);
        decode(&coded.unwrap().bytes).unwrap().sh_degree
    };
    let sh = steps(70.0).sh;
    assert_eq!(degree(sh), 2);
    // A degree that quantises to zero is left out too, unless a higher one does not.
    assert_eq!(degree([sh[0], 1e6, 1e6]), 1);
    assert_eq!(degree([1e6, sh[1], 1e6]), 2);
}

fn by_importance(
    scene: &Scene,
    voxels: &Voxelization,
    given: &[f32],
) -> gsvx::Result<EncodedStream> {
    let options = EncodeOptions::default().code;
    gsvx::encode_voxels(scene, voxels.octree(), None, Some(given), &steps(80.0), &options)
}

#[test]
fn importance_makes_a_gaussian_more_precise() {
    let (merged, voxels) = voxelized(&scene(2000, 1, 3), &Strategy::Uniform { depth: 12 });
    // Every other Gaussian is 4096 times as important.
    let given: Vec<f32> =
        (0..merged.len()).map(|i| if i % 2 == 0 { 4096.0 } else { 1.0 }).collect();
    let back = decode(&by_importance(&merged, &voxels, &given).unwrap().bytes).unwrap();
    let error = |odd: usize| {
        let of = (odd..merged.len()).step_by(2);
        spread(
            of.flat_map(|i| (0..3).map(move |c| (i, c)))
                .map(|(i, c)| f64::from(back.sh_of(i)[0][c] - merged.sh_of(i)[0][c])),
        )
        .rms
    };
    assert!(4.0 * error(0) < error(1), "{} {}", error(0), error(1));
}

#[test]
fn importance_is_guessed_where_none_is_given() {
    let (merged, voxels) = voxelized(&scene(600, 1, 3), &Strategy::Uniform { depth: 12 });
    let guess = importance::without_cameras(&merged);
    let options = EncodeOptions::default();
    let guessed = encode_voxels(&merged, voxels.octree(), None, &options).unwrap();
    assert!(by_importance(&merged, &voxels, &guess).unwrap() == guessed);
    // Values that are no importance count as 0.
    let broken = vec![f32::NAN; merged.len()];
    assert!(decode(&by_importance(&merged, &voxels, &broken).unwrap().bytes).is_ok());
}

/// `encode_voxels` panicked on too few importances and took too many.
#[test]
fn importances_of_another_length_are_refused() {
    let (floaters, _) = with_floaters(scene(300, 1, 5));
    let plain = scene(300, 1, 5);
    let (merged, voxels) = voxelized(&plain, &Strategy::Uniform { depth: 12 });
    for n in [0, 1, 299, 301] {
        let given = vec![1.0; n];
        let encode =
            |scene: &Scene| gsvx::encode(scene, Some(&given), 80.0, &EncodeOptions::default());
        for refused in [encode(&plain), encode(&floaters), by_importance(&merged, &voxels, &given)]
        {
            assert!(matches!(refused, Err(Error::Length { .. })), "{n}");
        }
    }
}

#[test]
fn duplicates_are_merged() {
    let one = scene(1, 2, 5);
    let same = one.select(&[0; 300]);
    for scene in [&same, &one] {
        let back = decode(&encode(scene, &EncodeOptions::default()).unwrap().bytes).unwrap();
        assert_eq!(back.len(), 1);
        assert!(back.validate().is_ok());
    }
    // Pairs in the same place.
    let few = common::scene(200, 1, 5);
    let pairs: Vec<usize> = (0..400).map(|i| i / 2).collect();
    let back = decode(&encode(&few.select(&pairs), &EncodeOptions::default()).unwrap().bytes);
    assert!((1..=200).contains(&back.unwrap().len()));
}

#[test]
fn misfits_are_errors() {
    let (merged, voxels) = voxelized(&scene(50, 1, 5), &Strategy::Uniform { depth: 9 });
    let options = EncodeOptions::default();
    let encode = |scene: &Scene| encode_voxels(scene, voxels.octree(), None, &options);
    let mut moved = merged.clone();
    moved.means[3][1] += 1.0;
    assert!(matches!(encode(&moved), Err(Error::OffCentre { index: 3 })));
    let mut nan = merged.clone();
    nan.log_scales[4][0] = f32::NAN;
    assert!(matches!(encode(&nan), Err(Error::NonFinite { index: 4, field: "log-scale" })));
    let short = merged.select(&[0, 1, 2]);
    assert!(matches!(encode(&short), Err(Error::Length { .. })));
    for quality in [f32::NAN, -1.0, 101.0] {
        let refused = gsvx::encode(&merged, None, quality, &options);
        assert!(matches!(refused, Err(Error::Option { .. })), "{quality}");
    }
    for step in [0.0, -1.0, f32::NAN, f32::INFINITY, 1e-40] {
        for k in 0..2 {
            let mut steps = steps(80.0);
            *[&mut steps.dc, &mut steps.sh[2]][k] = step;
            let code = &options.code;
            let refused = gsvx::encode_voxels(&merged, voxels.octree(), None, None, &steps, code);
            assert!(matches!(refused, Err(Error::Option { .. })), "a step of {step}");
        }
    }
}

/// Arrays that were too short panicked.
#[test]
fn arrays_of_different_lengths_are_refused() {
    let plain = scene(50, 1, 5);
    let (merged, voxels) = voxelized(&plain, &Strategy::Uniform { depth: 9 });
    let changes: [fn(&mut Scene); 5] = [
        |s| s.rotations.truncate(1),
        |s| s.log_scales.truncate(1),
        |s| s.opacity_logits.truncate(1),
        |s| s.sh.truncate(1),
        |s| s.sh_degree = 200,
    ];
    let options = EncodeOptions::default();
    for (i, change) in changes.iter().enumerate() {
        let changed = |scene: &Scene| {
            let mut scene = scene.clone();
            change(&mut scene);
            scene
        };
        for refused in [
            encode(&changed(&plain), &options),
            encode_voxels(&changed(&merged), voxels.octree(), None, &options),
            encode_voxels(&merged, voxels.octree(), Some(&changed(&plain)), &options),
        ] {
            assert!(
                matches!(refused, Err(Error::Length { .. } | Error::Option { .. })),
                "change {i}"
            );
        }
    }
}

/// Coefficients above degree 0 were not checked: NaN came out as other numbers.
#[test]
fn every_sh_coefficient_is_checked() {
    let plain = scene(50, 3, 5);
    let (merged, voxels) = voxelized(&plain, &Strategy::Uniform { depth: 9 });
    let options = EncodeOptions::default();
    for coefficient in [0, 1, 5, 15] {
        let with = |scene: &Scene, value: f32| {
            let mut scene = scene.clone();
            scene.sh[16 * 7 + coefficient][2] = value;
            scene
        };
        for value in [f32::NAN, f32::INFINITY] {
            let refused = encode_voxels(&with(&merged, value), voxels.octree(), None, &options);
            assert!(
                matches!(refused, Err(Error::NonFinite { index: 7, field: "SH coefficient" })),
                "{coefficient}: {value}"
            );
            // The number is that in the input, not that among the sorted leaves.
            let refused = encode(&with(&plain, value), &options);
            assert!(
                matches!(refused, Err(Error::NonFinite { index: 7, field: "SH coefficient" })),
                "{coefficient}: {value}"
            );
        }
        let refused = encode(&with(&plain, 1e6), &options);
        assert!(matches!(refused, Err(Error::TooLarge { index: 7, .. })), "{coefficient}");
        let refused = encode_voxels(&with(&merged, -2e4), voxels.octree(), None, &options);
        assert!(
            matches!(refused, Err(Error::TooLarge { index: 7, field: "SH coefficient", .. })),
            "{coefficient}"
        );
    }
}

#[test]
fn a_rotation_of_zero_is_called_that() {
    let mut scene = scene(50, 1, 5);
    scene.rotations[9] = [0.0; 4];
    let refused = encode(&scene, &EncodeOptions::default());
    assert!(matches!(refused, Err(Error::ZeroRotation { index: 9 })), "{refused:?}");
}

/// Found by `cargo xtask stress`: values far beyond trained ones have to come back or be refused.
#[test]
fn large_values_come_back() {
    let (mut merged, voxels) = voxelized(&scene(50, 1, 5), &Strategy::Uniform { depth: 9 });
    merged.sh[7][2] = -1.8e4;
    let bytes =
        encode_voxels(&merged, voxels.octree(), None, &EncodeOptions::default()).unwrap().bytes;
    let back = decode(&bytes).unwrap();
    assert!((back.sh[7][2] + 1.8e4).abs() < 10.0, "{}", back.sh[7][2]);
}

#[test]
fn every_stream_says_whether_its_scene_is_antialiased_and_what_its_origin_is() {
    let scene = Scene {
        antialiased: true,
        origin: [448_200.25, 5_411_900.5, -46.125],
        ..with_floaters(scene(300, 1, 3)).0
    };
    let plain = EncodeOptions::default();
    let mut levels = encoding(|o| o.lod = true);
    levels.prepare.prune = 0.1;
    let mut all = [plain, levels].map(|o| encode(&scene, &o).unwrap().bytes).to_vec();
    let bounds = MaxError { mean: 0.01, opacity: 0.01, shape: 0.1, sh: 0.1 };
    all.push(Encoder::new(Aim::MaxError(bounds)).encode(&scene, None).unwrap().encoded.bytes);
    all.push(gsvx::encode_lossless(&scene, true).unwrap().bytes);
    all.push(encode(&scene.emptied(1), &EncodeOptions::default()).unwrap().bytes);
    for (i, stream) in all.iter().enumerate() {
        let told = |s: &Scene| (s.antialiased, s.origin);
        let decoder = gsvx::Decoder::new(stream, &DecodeOptions::default()).unwrap();
        assert_eq!(told(&decode(stream).unwrap()), told(&scene), "{i}");
        decoder
            .chunks::<gsvx::Error>(|part| {
                assert_eq!(told(&part), told(&scene), "{i}");
                Ok(())
            })
            .unwrap();
        decoder
            .blocks(|(): &mut (), _, part| {
                assert_eq!(told(part), told(&scene), "{i}");
                Ok::<_, gsvx::Error>(())
            })
            .unwrap();
        let mut reader = gsvx::Reader::new();
        reader.give(0, stream).unwrap();
        if !reader.index().unwrap().chunks.is_empty() {
            assert_eq!(told(&reader.decode(0, 1).unwrap()), told(&scene), "{i}");
        }
    }
    let nowhere = Scene { origin: [f64::NAN, 0.0, 0.0], ..scene };
    assert!(encode(&nowhere, &EncodeOptions::default()).is_err());
    assert!(gsvx::encode_lossless(&nowhere, false).is_err());
}
