//! Damaged and hostile streams: an error or a bounded wrong result, never a panic.

mod common;

use common::{channel, rows_of};
use gpcc_lite::attribute::{self, Quantisation};
use gpcc_lite::coder::{Coder, RansDecoder, RansEncoder};
use gpcc_lite::paper::predict::{Neighbours, decode_lossless, encode_lossless};
use gpcc_lite::paper::rlgr;
use gpcc_lite::raht::{RahtPlan, Rows};
use gpcc_lite::{Cube, Error, Leaf, Limits, Octree, geometry};
use proptest::prelude::*;

/// Any cube: leaves do not depend on it.
const CUBE: Cube = Cube { origin: [0.0; 3], side: 1.0 };

/// Calls `decode` with every truncation and every single-bit flip of `bytes`.
fn damage(bytes: &[u8], mut decode: impl FnMut(&[u8])) {
    for end in 0..bytes.len() {
        decode(&bytes[..end]);
    }
    let mut copy = bytes.to_vec();
    for bit in 0..bytes.len() * 8 {
        copy[bit / 8] ^= 1 << (bit % 8);
        decode(&copy);
        copy[bit / 8] ^= 1 << (bit % 8);
    }
}

/// A small tree of mixed depth.
fn tree() -> Octree {
    let codes: Vec<(u64, u8)> =
        (0..150u64).map(|i| (i * i * 31 % (1 << 21), 5 + (i % 3) as u8)).collect();
    common::octree_from(&codes, 7)
}

fn decode_attributes(plan: &RahtPlan, bytes: &[u8], channels: usize) -> Result<(), Error> {
    let mut rows = Rows::new(plan.len(), channels);
    attribute::decode(&mut RansDecoder::new(bytes)?, plan, &vec![1.0; channels], &mut rows)
}

#[test]
fn geometry() {
    let tree = tree();
    let uniform = tree.leaves().iter().map(|l| Leaf { depth: 7, ..*l }).collect();
    for tree in [tree, Octree::of_points(7, uniform).unwrap()] {
        let bytes = geometry::encode(&tree).unwrap();
        let limits = Limits { max_points: 2 * tree.len() };
        damage(&bytes, |b| {
            if let Ok(g) = geometry::decode(b, &limits) {
                assert!(g.len() <= limits.max_points);
            }
        });
        // The entropy coder notices every truncation.
        for end in 0..bytes.len() {
            assert!(geometry::decode(&bytes[..end], &limits).is_err(), "{end}");
        }
    }
}

#[test]
fn attributes() {
    let tree = tree();
    let plan = RahtPlan::new(tree.clone());
    for channels in [1, 3, 7, 9] {
        let mut rows = rows_of(tree.len(), channels, 3, 1);
        let mut coder = RansEncoder::default();
        let steps = vec![30.0; channels];
        attribute::encode(&mut coder, &plan, &Quantisation::new(&steps), &mut rows).unwrap();
        let bytes = coder.finish();
        damage(&bytes, |b| drop(decode_attributes(&plan, b, channels)));
        assert!(decode_attributes(&plan, &bytes, channels).is_ok());
        assert!(decode_attributes(&plan, &bytes[..bytes.len() / 2], channels).is_err());
    }
}

#[test]
fn lossless_and_rlgr() {
    let tree = tree();
    let near = Neighbours::new(&tree);
    for kind in 0..4 {
        let c = channel(tree.len(), 3, kind);
        damage(&encode_lossless(&near, &[&c]).unwrap(), |b| drop(decode_lossless(&near, b, 1)));
        damage(&rlgr::encode(&c), |b| drop(rlgr::decode(b, c.len())));
    }
}

/// A coder of plain bits alone, as an attacker writes them: magnitudes near 2^31 and beyond.
#[test]
fn the_greatest_values_wrap_or_saturate() {
    let tree = tree();
    for weights in [vec![1; tree.len()], (0..tree.len()).map(|i| 1 << (i % 23)).collect()] {
        let plan = RahtPlan::new(tree.clone()).weighted(&weights).unwrap();
        for channels in [1, 3, 6, 7, 21] {
            let mut coder = RansEncoder::default();
            // Certain decisions and the escape symbol, as far as a stream of this length goes.
            for i in 0..4000 {
                coder.decision(1 + (i * 7919) % 32_766, i % 3 == 0);
                coder.bits(u32::MAX >> (i % 32), 32);
                coder.bits(0, 31);
            }
            drop(decode_attributes(&plan, &coder.finish(), channels));
        }
        let mut rows = Rows::new(tree.len(), 3);
        for i in 0..tree.len() {
            let v = [f32::MAX, f32::NAN, f32::NEG_INFINITY];
            rows.row_mut(i).copy_from_slice(&[v[i % 3], v[(i + 1) % 3], 1e30]);
        }
        let mut coder = RansEncoder::default();
        let steps = [f32::MIN_POSITIVE, 1.0, f32::MAX];
        attribute::encode(&mut coder, &plan, &Quantisation::new(&steps), &mut rows).unwrap();
        let (bytes, mut read) = (coder.finish(), Rows::new(tree.len(), 3));
        let mut decoder = RansDecoder::new(&bytes).unwrap();
        attribute::decode(&mut decoder, &plan, &steps, &mut read).unwrap();
        decoder.finish().unwrap();
    }
}

/// A header that claims far more than the stream holds costs nothing.
#[test]
fn claims_are_not_believed() {
    let bytes = [21, 0, 0xff, 0xff, 0xff, 0xff, 0x0e];
    let e = geometry::decode(&bytes, &Limits::for_stream(bytes.len())).unwrap_err();
    assert!(matches!(e, Error::TooManyPoints { .. }), "{e}");
    let tree = tree();
    let near = Neighbours::new(&tree);
    assert!(decode_lossless(&near, &[0xff, 0xff, 0xff, 0x7f], 100).is_err());
    // One bit of RLGR stands for up to 1024 zeros: the list grows no further than that.
    assert!(rlgr::decode(&[0; 20], usize::MAX).is_err());
    assert!(rlgr::decode(&[], usize::MAX).is_err());
}

/// A stream of 20 bytes that claims nearly 2^32 leaves ends as soon as its bytes are used up. A
/// decision costs at least 2^-11 bits, so a byte stands for 11,000 decisions at most.
#[test]
fn a_short_stream_with_a_great_count_ends_early() {
    let count = u32::MAX as usize - 1;
    let mut seed = 1u64;
    let mut next = || {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (seed >> 33) as u32
    };
    for i in 0..400u32 {
        let mut bytes = vec![(i % 2) as u8];
        for _ in 0..4 {
            // States without low bits decode to what is likely, those full of ones to what is not.
            let low = [0, 0x7fff, next(), next() % 512][i as usize / 2 % 4] & 0x7fff;
            let state = (next() | 1 << 31) & !0x7fff | low;
            bytes.extend(state.to_le_bytes());
        }
        bytes.resize(20, 0);
        for j in [21, 12, 32] {
            let Ok(mut coder) = RansDecoder::new(&bytes) else { continue };
            assert!(geometry::decode_leaves(&mut coder, count, CUBE, j).is_err());
            let head = [j, 1, 0xfe, 0xff, 0xff, 0xff, 0x0f];
            let with_slabs = [&head[..], &bytes].concat();
            assert!(geometry::decode(&with_slabs, &Limits { max_points: count }).is_err());
        }
    }
    let mut coder = RansDecoder::new(&[]).unwrap();
    assert!(geometry::decode_leaves(&mut coder, count, CUBE, 21).is_err());
    assert!(geometry::decode_leaves(&mut coder, u32::MAX as usize, CUBE, 21).is_err());
}

/// Invalid input is refused by name.
#[test]
fn bad_leaves_are_refused() {
    let leaf = |morton, depth| Leaf { morton, depth };
    let e = |l: &[Leaf], j| Octree::of_points(j, l.to_vec()).unwrap_err();
    assert_eq!(e(&[leaf(1, 2), leaf(1, 2)], 2), Error::LeafOrder { index: 1 });
    assert_eq!(e(&[leaf(0, 1), leaf(3, 2)], 2), Error::LeafOrder { index: 1 });
    assert_eq!(e(&[leaf(3, 1)], 2), Error::LeafAlign { index: 0, morton: 3, depth: 1 });
    assert_eq!(e(&[leaf(64, 2)], 2), Error::LeafAlign { index: 0, morton: 64, depth: 2 });
    assert_eq!(e(&[leaf(0, 3)], 2), Error::Depth { depth: 3, max: 2 });
    assert_eq!(e(&[], 22), Error::Depth { depth: 22, max: 21 });
}

#[test]
fn bad_arguments_are_refused() {
    let tree = tree();
    let n = tree.len();
    let plan = RahtPlan::new(tree.clone());
    let encode = |steps: &[f32], rows: &mut Rows| {
        attribute::encode(&mut RansEncoder::default(), &plan, &Quantisation::new(steps), rows).err()
    };
    let mut rows = Rows::new(n, 2);
    assert_eq!(encode(&[1.0], &mut rows), Some(Error::Count { what: "steps", got: 1, want: 2 }));
    for step in [0.0, -1.0, f32::INFINITY, f32::from_bits(1)] {
        assert_eq!(encode(&[1.0, step], &mut rows), Some(Error::Step { channel: 1 }));
    }
    let short = Error::ChannelLength { channel: 0, got: n - 1, want: n };
    let mut rows = Rows::new(n - 1, 1);
    assert_eq!(encode(&[1.0], &mut rows), Some(short.clone()));
    let mut decoder = RansDecoder::new(&[]).unwrap();
    assert_eq!(attribute::decode(&mut decoder, &plan, &[1.0], &mut rows), Err(short));
    let zero = Error::Weight { index: 0, weight: 0 };
    assert_eq!(plan.weighted(&vec![0; n]).unwrap_err(), zero);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    #[test]
    fn noise(bytes in prop::collection::vec(any::<u8>(), 0..400), whole_states: bool, channels in 1usize..10) {
        let tree = tree();
        let plan = RahtPlan::new(tree.clone());
        let near = Neighbours::new(&tree);
        // Without this most streams end at the check of the states.
        let mut bytes = bytes;
        if whole_states && bytes.len() > 20 {
            bytes[0] = ((bytes.len() - 17) / 4).min(127) as u8;
            (1..5).for_each(|i| bytes[4 * i] |= 1);
        }
        let _ = geometry::decode(&bytes, &Limits::for_stream(bytes.len()));
        let _ = decode_attributes(&plan, &bytes, channels);
        let _ = decode_lossless(&near, &bytes, 4);
        let _ = rlgr::decode(&bytes, 5000);
        if let Ok(mut coder) = RansDecoder::new(&bytes) {
            let _ = geometry::decode_leaves(&mut coder, 100_000, CUBE, 7);
        }
    }
}
