//! Streams from an enemy: an error or a bounded wrong result, never a panic.

mod common;

use common::channel;
use gpcc_lite::attribute::{self, Options};
use gpcc_lite::coeffs::{self, Mode};
use gpcc_lite::predict::{
    Lifting, Neighbours, decode_lifting, decode_lossless, encode_lifting, encode_lossless,
};
use gpcc_lite::quant::Step;
use gpcc_lite::raht::Plan;
use gpcc_lite::{Error, Leaf, Limits, geometry};
use proptest::prelude::*;

/// Every truncation, and every single-bit flip, of `bytes`.
fn torment(bytes: &[u8], mut decode: impl FnMut(&[u8])) {
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
fn leaves() -> (Vec<Leaf>, u8) {
    let mut l: Vec<Leaf> = (0..150u64)
        .map(|i| {
            let depth = 5 + (i % 3) as u8;
            let cut = 3 * (7 - depth);
            Leaf { morton: (i * i * 31 % (1 << 21)) >> cut << cut, depth }
        })
        .collect();
    l.sort();
    let mut end = 0;
    l.retain(|l| {
        let keep = l.morton >= end;
        if keep {
            end = l.morton + (1 << (3 * (7 - l.depth)));
        }
        keep
    });
    (l, 7)
}

#[test]
fn geometry() {
    let (leaves, j) = leaves();
    let uniform: Vec<Leaf> = leaves.iter().map(|l| Leaf { depth: j, ..*l }).collect();
    let fast = geometry::encode_fast(&uniform, j).unwrap();
    let streams = [leaves, uniform].map(|l| (geometry::encode(&l, j).unwrap(), l.len()));
    let points = streams[1].1;
    for (bytes, points) in streams.into_iter().chain([(fast, points)]) {
        let limits = Limits { max_points: 2 * points };
        torment(&bytes, |b| {
            if let Ok(g) = geometry::decode(b, &limits) {
                assert!(g.leaves.len() <= limits.max_points);
            }
            let _ = geometry::decode_lod(b, 4, &limits);
        });
    }
}

/// Found by fuzzing: the count was compared with the whole tree's leaves only, so that a level of
/// detail of 129 nodes passed where the stream claimed 102 and the caller allowed 128.
#[test]
fn a_level_of_detail_has_no_more_leaves_than_the_stream_claims() {
    let (leaves, j) = leaves();
    let leaves: Vec<Leaf> = leaves.into_iter().take(120).collect();
    let mut stream = geometry::encode(&leaves, j).unwrap();
    assert_eq!(usize::from(stream[2]), leaves.len());
    let mut refused = 0;
    for claimed in 1..leaves.len() {
        stream[2] = claimed as u8;
        for depth in 0..=j {
            match geometry::decode_lod(&stream, depth, &Limits { max_points: 128 }) {
                Ok(g) => assert!(g.leaves.len() <= claimed, "{claimed} at depth {depth}"),
                Err(_) => refused += 1,
            }
        }
    }
    assert!(refused > leaves.len());
}

#[test]
fn attributes() {
    let (leaves, j) = leaves();
    let plan = Plan::new(&leaves, j).unwrap();
    let c = channel(leaves.len(), 3, 1);
    for mode in [Mode::Range, Mode::Symbols, Mode::Rlgr, Mode::RlgrMalvar] {
        for prediction in [true, false] {
            let o = Options { mode, prediction, ..Options::default() };
            let coded = attribute::encode(&plan, &[&c, &c], &[Step::from_qp(10); 2], &o).unwrap();
            let o = Options { by_means: true, ..o };
            let alone = attribute::encode(&plan, &[&c], &[Step::from_qp(10)], &o).unwrap();
            for bytes in [coded.bytes, alone.bytes] {
                torment(&bytes, |b| {
                    if let Ok(v) = attribute::decode(&plan, b, 2) {
                        assert!(v.len() <= 2 && v.iter().all(|v| v.len() == plan.len()));
                    }
                });
            }
        }
    }
}

#[test]
fn lossless_and_lifting() {
    let (leaves, j) = leaves();
    let near = Neighbours::new(&leaves, j).unwrap();
    let coarser = Neighbours::coarser(&leaves, j).unwrap();
    let lift = Lifting::new(&coarser);
    for kind in 0..4 {
        let c = channel(leaves.len(), 3, kind);
        torment(&encode_lossless(&near, &[&c]).unwrap(), |b| {
            let _ = decode_lossless(&near, b, 1);
        });
        torment(&encode_lifting(&lift, &[&c], &[Step::from_qp(10)]).unwrap(), |b| {
            let _ = decode_lifting(&lift, b, 1);
        });
    }
}

/// A header that promises the moon costs nothing.
#[test]
fn promises_are_not_believed() {
    let bytes = [2, 21, 0xff, 0xff, 0xff, 0xff, 0x0e];
    let e = geometry::decode(&bytes, &Limits::for_stream(bytes.len())).unwrap_err();
    assert!(matches!(e, Error::TooManyPoints { .. }), "{e}");
    let (leaves, j) = leaves();
    let plan = Plan::new(&leaves, j).unwrap();
    assert!(attribute::decode(&plan, &[0xff, 0xff, 0xff, 0x7f], 100).is_err());
}

/// Invalid input is refused by name.
#[test]
fn bad_leaves_are_refused() {
    let leaf = |morton, depth| Leaf { morton, depth };
    let e = |l: &[Leaf], j| geometry::encode(l, j).unwrap_err();
    assert_eq!(e(&[leaf(1, 2), leaf(1, 2)], 2), Error::LeafOrder { index: 1 });
    assert_eq!(e(&[leaf(0, 1), leaf(3, 2)], 2), Error::LeafOrder { index: 1 });
    assert_eq!(e(&[leaf(3, 1)], 2), Error::LeafAlign { index: 0, morton: 3, depth: 1 });
    assert_eq!(e(&[leaf(64, 2)], 2), Error::LeafAlign { index: 0, morton: 64, depth: 2 });
    assert_eq!(e(&[leaf(0, 3)], 2), Error::Depth { depth: 3, max: 2 });
    assert_eq!(e(&[], 22), Error::Depth { depth: 22, max: 21 });
}

proptest! {
    #[test]
    fn noise(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        let (leaves, j) = leaves();
        let plan = Plan::new(&leaves, j).unwrap();
        let near = Neighbours::new(&leaves, j).unwrap();
        let _ = geometry::decode(&bytes, &Limits::for_stream(bytes.len()));
        let _ = attribute::decode(&plan, &bytes, 4);
        let _ = coeffs::decode(&plan, &bytes, 3);
        let _ = decode_lossless(&near, &bytes, 4);
    }
}
