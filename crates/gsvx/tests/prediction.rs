//! SH degrees 2 and 3 predicted from the degree below.

mod common;

use common::{Rng, scene, voxelized, with_related_degrees};
use gs_model::Scene;
use gsvx::stream::{Container, SectionKind};
use gsvx::{CovarianceMode, DecodeOptions, EncodeOptions, Entropy, Error, PaperQp, decode, encode};
use std::num::NonZeroUsize;
use voxel::{Strategy, Voxelization};

fn related(n: usize, degree: u8) -> (Scene, Voxelization) {
    let scene = with_related_degrees(scene(n, degree, 3));
    voxelized(&scene, &Strategy::Uniform { depth: 12 })
}

fn options(sh_prediction: bool) -> EncodeOptions {
    EncodeOptions { sh_prediction, ..EncodeOptions::from_quality(85.0).unwrap() }
}

fn sections(bytes: &[u8]) -> Vec<(SectionKind, Vec<u8>)> {
    let container = Container::parse(bytes).unwrap();
    let payload = |kind| container.section(kind).unwrap().unwrap().to_vec();
    container.toc.iter().map(|e| (e.kind, payload(e.kind))).collect()
}

/// The first bytes of the sections of degrees 2 and 3, of a stream of one slice.
fn first_bytes(bytes: &[u8]) -> Vec<u8> {
    let degrees = [SectionKind::Sh2, SectionKind::Sh3];
    sections(bytes).iter().filter(|s| degrees.contains(&s.0)).map(|s| s.1[0]).collect()
}

/// Root mean square error of the coefficients of degrees 2 and 3.
fn rms(a: &Scene, b: &Scene) -> f64 {
    let mut sum = 0.0;
    for i in 0..a.len() {
        for (a, b) in a.sh_of(i)[4..].iter().zip(&b.sh_of(i)[4..]) {
            sum += (0..3).map(|k| f64::from(a[k] - b[k]) * f64::from(a[k] - b[k])).sum::<f64>();
        }
    }
    (sum / (3 * a.len() * (a.sh_len() - 4)) as f64).sqrt()
}

fn whole(bytes: &[u8]) -> Scene {
    decode(bytes, &DecodeOptions::default()).unwrap().scene
}

/// The error stays what the steps make it: nothing that the encoder predicts from differs from what
/// a decoder predicts from, in any mode of the coder.
#[test]
fn related_degrees_take_less_room_at_the_same_error() {
    let (merged, voxels) = related(3000, 3);
    for entropy in [Entropy::Range, Entropy::Symbols] {
        for uniform_precision in [false, true] {
            let [plain, small] = [false, true].map(|on| {
                let o = EncodeOptions { entropy, uniform_precision, ..options(on) };
                encode(&merged, &voxels, &o).unwrap().bytes
            });
            assert_eq!(first_bytes(&plain), [0, 0]);
            assert!(first_bytes(&small).iter().all(|&b| b != 0), "{:?}", first_bytes(&small));
            let sh = |bytes: &[u8]| -> usize {
                sections(bytes).iter().filter(|s| s.0 >= SectionKind::Sh2).map(|s| s.1.len()).sum()
            };
            assert!(2 * sh(&small) < sh(&plain), "{} and {}", sh(&small), sh(&plain));
            let error = |bytes: &[u8]| rms(&whole(bytes), &merged);
            let ratio = error(&small) / error(&plain);
            assert!(ratio < 1.05, "{entropy:?}: {ratio}");
        }
    }
}

#[test]
fn what_does_not_pay_is_left_alone() {
    let (merged, voxels) = voxelized(&scene(3000, 3, 3), &Strategy::Uniform { depth: 12 });
    assert_eq!(first_bytes(&encode(&merged, &voxels, &options(true)).unwrap().bytes), [0, 0]);
    let (merged, voxels) = related(3000, 3);
    for entropy in [Entropy::Fast, Entropy::Rlgr] {
        let o = EncodeOptions { entropy, ..options(true) };
        assert_eq!(first_bytes(&encode(&merged, &voxels, &o).unwrap().bytes), [0, 0]);
    }
    let qp = PaperQp { ac: 16, dc: 4, opacity: 4 };
    let o = EncodeOptions::paper(qp, CovarianceMode::Lossless { bits: 16 });
    assert_eq!(first_bytes(&encode(&merged, &voxels, &o).unwrap().bytes), [0, 0]);
}

#[test]
fn degrees_below_do_not_need_what_follows() {
    let (merged, voxels) = related(3000, 3);
    let bytes = encode(&merged, &voxels, &options(true)).unwrap().bytes;
    let full = whole(&bytes);
    for max_sh_degree in 0..3 {
        let o = DecodeOptions { max_sh_degree, ..Default::default() };
        let part = decode(&bytes, &o).unwrap().scene;
        for i in 0..merged.len() {
            assert_eq!(part.sh_of(i), &full.sh_of(i)[..part.sh_len()]);
        }
    }
    // Nor does a stream that ends in the last section.
    let cut = DecodeOptions { allow_truncated: true, ..Default::default() };
    assert_eq!(decode(&bytes[..bytes.len() - 1], &cut).unwrap().scene.sh_degree, 2);
}

#[test]
fn any_thread_count_gives_the_same_bytes_and_floats() {
    let (merged, voxels) = related(9000, 3);
    let o =
        EncodeOptions { slices: NonZeroUsize::new(2), entropy: Entropy::Symbols, ..options(true) };
    let at = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let bytes = encode(&merged, &voxels, &o).unwrap().bytes;
            let scene = whole(&bytes);
            (bytes, scene)
        })
    };
    let one = at(1);
    assert_eq!(Container::parse(&one.0).unwrap().header.slices, 2);
    let plain = EncodeOptions { sh_prediction: false, ..o.clone() };
    let plain = encode(&merged, &voxels, &plain).unwrap().bytes;
    assert!(one.0.len() < plain.len());
    assert!(rms(&one.1, &merged) < 1.05 * rms(&whole(&plain), &merged));
    for threads in [2, 5] {
        assert!(one == at(threads), "{threads} threads differ from one");
    }
}

#[test]
fn damaged_factors_are_refused_or_finite() {
    let (merged, voxels) = related(700, 3);
    let bytes = encode(&merged, &voxels, &options(true)).unwrap().bytes;
    let header = Container::parse(&bytes).unwrap().header;
    let good = sections(&bytes);
    let at = good.iter().position(|s| s.0 == SectionKind::Sh2).unwrap();
    let forged = |change: &dyn Fn(&mut Vec<u8>)| {
        let mut broken = good.clone();
        change(&mut broken[at].1);
        decode(&gsvx::stream::assemble(&header, &broken), &DecodeOptions::default())
    };
    for log_run in [1, 9, 31, 255] {
        let refused = forged(&|payload| payload[0] = log_run);
        assert!(matches!(refused, Err(Error::Corrupt { what: "SH prediction", .. })), "{log_run}");
    }
    for len in [0, 1, 15] {
        let refused = forged(&|payload| payload.truncate(len));
        assert!(matches!(refused, Err(Error::Truncated { what: "SH prediction", .. })), "{len}");
    }
    let mut rng = Rng(4);
    for round in 0..40 {
        let factors: Vec<u8> =
            (0..15).map(|_| if round == 0 { 0x80 } else { rng.next() as u8 }).collect();
        let decoded = forged(&|payload| payload[1..16].copy_from_slice(&factors)).unwrap();
        assert!(decoded.scene.validate().is_ok(), "round {round}: not finite");
    }
}
