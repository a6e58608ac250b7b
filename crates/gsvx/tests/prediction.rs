//! SH degrees 2 and 3 predicted from the degree below.
#![cfg(feature = "encode")]

mod common;

use common::forge::{assemble, take_apart};
use common::{Rng, decoding, leaves, on_threads, scene, steps, voxelized, with_related_degrees};
use gs_model::Scene;
use gsvx::{CodeOptions, EncodedStream, Error, decode, decode_with, encode_voxels};
use voxel::{Strategy, Voxelization};

fn related(n: usize) -> (Scene, Voxelization) {
    voxelized(&with_related_degrees(scene(n, 3, 3)), &Strategy::Uniform { depth: 12 })
}

/// A stream of quality 85.
fn encoded(scene: &Scene, voxels: &Voxelization, options: &CodeOptions) -> EncodedStream {
    encode_voxels(scene, voxels.octree(), None, None, &steps(85.0), options).unwrap()
}

/// The first bytes of the layers of degrees 2 and 3: 0 where nothing is predicted.
fn run_lengths(bytes: &[u8]) -> Vec<u8> {
    let layers = take_apart(bytes).1;
    layers.iter().flat_map(|c| c[2..].iter().map(|l| l[0])).collect()
}

/// Root mean square error of the coefficients of degrees 2 and 3.
fn rms(a: &Scene, b: &Scene) -> f64 {
    let each = (0..a.len()).flat_map(|i| {
        let of = |s: &Scene| s.sh_of(i)[4..].as_flattened().to_vec();
        of(a).into_iter().zip(of(b))
    });
    common::spread(each.map(|(a, b)| f64::from(a - b))).rms
}

#[test]
fn degrees_that_follow_from_others_are_smaller_at_the_same_error() {
    let (merged, voxels) = related(3000);
    // The same amplitudes, but coefficients of one Gaussian have those of another below them.
    let mut shuffled = merged.clone();
    for i in 0..merged.len() {
        let from = (i * 7 + 13) % merged.len();
        shuffled.sh[16 * i + 4..16 * i + 9].copy_from_slice(&merged.sh_of(from)[4..9]);
        let from = (i * 11 + 5) % merged.len();
        shuffled.sh[16 * i + 9..16 * i + 16].copy_from_slice(&merged.sh_of(from)[9..]);
    }
    for uniform_precision in [false, true] {
        let options = CodeOptions { uniform_precision, ..CodeOptions::default() };
        let coded = |scene: &Scene| {
            let encoded = encoded(scene, &voxels, &options);
            let layers = &encoded.index.chunks[0].layers[2..];
            let size: u64 = layers.iter().map(|l| l.len).sum();
            let error = rms(&decode(&encoded.bytes).unwrap(), scene);
            (run_lengths(&encoded.bytes), size, error)
        };
        let (predicted, small, error) = coded(&merged);
        let (plain, large, error_plain) = coded(&shuffled);
        assert_eq!(plain, [0, 0]);
        assert!(predicted.iter().all(|&b| b != 0), "{predicted:?}");
        assert!(2 * small < large, "{small} and {large}");
        assert!(error < 1.05 * error_plain, "{error} and {error_plain}");
    }
}

#[test]
fn nothing_is_predicted_where_it_does_not_pay() {
    let (merged, voxels) = voxelized(&scene(3000, 3, 3), &Strategy::Uniform { depth: 12 });
    let bytes = encoded(&merged, &voxels, &CodeOptions::default()).bytes;
    assert_eq!(run_lengths(&bytes), [0, 0]);
}

#[test]
fn degrees_below_do_not_need_what_follows() {
    let (merged, voxels) = related(3000);
    let bytes = encoded(&merged, &voxels, &CodeOptions::default()).bytes;
    let full = decode(&bytes).unwrap();
    for max_sh_degree in 0..3 {
        let part = decode_with(&bytes, &decoding(|o| o.max_sh_degree = max_sh_degree)).unwrap();
        for i in 0..merged.len() {
            assert_eq!(part.scene.sh_of(i), &full.sh_of(i)[..part.scene.sh_len()]);
        }
    }
    // Nor does a stream that ends in the last layer.
    let cut = decode_with(&bytes[..bytes.len() - 1], &decoding(|o| o.salvage = true)).unwrap();
    for i in 0..merged.len() {
        assert_eq!(cut.scene.sh_of(i)[..9], full.sh_of(i)[..9]);
        assert_eq!(cut.scene.sh_of(i)[9..], [[0.0; 3]; 7]);
    }
}

#[test]
fn any_thread_count_gives_the_same_bytes_and_floats() {
    let (merged, voxels) = related(9000);
    let options = CodeOptions { chunk_leaves: leaves(4600), ..CodeOptions::default() };
    let at = |threads: usize| {
        on_threads(threads, || {
            let bytes = encoded(&merged, &voxels, &options).bytes;
            let scene = decode(&bytes).unwrap();
            (bytes, scene)
        })
    };
    let one = at(1);
    assert_eq!(run_lengths(&one.0).len(), 4);
    assert!(run_lengths(&one.0).iter().all(|&b| b != 0));
    for threads in [2, 5] {
        assert!(one == at(threads), "{threads} threads differ from one");
    }
}

#[test]
fn damaged_factors_are_refused_or_finite() {
    let (merged, voxels) = related(900);
    let bytes = encoded(&merged, &voxels, &CodeOptions::default()).bytes;
    assert!(run_lengths(&bytes).iter().all(|&b| b != 0));
    let (index, good) = take_apart(&bytes);
    let forged = |change: &dyn Fn(&mut Vec<u8>)| {
        let mut broken = good.clone();
        change(&mut broken[0][2]);
        decode(&assemble(&index, &broken))
    };
    let inner = |result: gsvx::Result<Scene>| match result {
        Err(Error::Chunk { chunk: 0, source }) => *source,
        other => panic!("{other:?}"),
    };
    for log_run in [1, 9, 31, 255] {
        let refused = inner(forged(&|layer| layer[0] = log_run));
        assert!(matches!(refused, Error::Corrupt { what: "SH prediction", .. }), "{log_run}");
    }
    for len in [1, 15] {
        let refused = inner(forged(&|layer| layer.truncate(len)));
        assert!(matches!(refused, Error::Truncated { what: "SH prediction", .. }), "{len}");
    }
    let mut rng = Rng::seeded(4);
    for round in 0..40 {
        let factors: Vec<u8> =
            (0..15).map(|_| if round == 0 { 0x80 } else { rng.bits() as u8 }).collect();
        let decoded = forged(&|layer| layer[1..16].copy_from_slice(&factors)).unwrap();
        assert!(decoded.validate().is_ok(), "round {round}: not finite");
    }
}
