//! Decoders of payloads.

use std::sync::OnceLock;

use gpcc_lite::predict::{Lifting, Neighbours, decode_lifting, decode_lossless};
use gpcc_lite::raht::Plan;
use gpcc_lite::{Leaf, Limits, attribute as raht, coeffs as group, geometry as octree};
use gpcc_lite::{morton, rlgr as golomb};

use crate::{choice, number};

/// Sets of leaves: none, one, a dense block, a sparse tree of mixed depth.
pub(crate) fn leaves() -> Vec<(Vec<Leaf>, u8)> {
    let block = (0..27u32)
        .map(|i| Leaf { morton: morton::encode([i % 3, i / 3 % 3, i / 9]), depth: 2 })
        .collect();
    let mixed = (0..40u64)
        .map(|i| {
            let depth = 5 + (i % 3) as u8;
            let cut = 3 * (7 - depth);
            Leaf { morton: (i * i * 531 % (1 << 21)) >> cut << cut, depth }
        })
        .collect();
    let one = vec![Leaf { morton: 0, depth: 0 }];
    let mut sets: Vec<(Vec<Leaf>, u8)> = vec![(Vec::new(), 4), (one, 0), (block, 2), (mixed, 7)];
    for (leaves, j_high) in &mut sets {
        leaves.sort();
        let mut end = 0;
        leaves.retain(|l| {
            let keep = l.morton >= end;
            if keep {
                end = l.morton + (1 << (3 * (*j_high - l.depth)));
            }
            keep
        });
    }
    sets
}

/// Unweighted and weighted transforms of every set.
pub(crate) fn plans() -> &'static [Plan] {
    static PLANS: OnceLock<Vec<Plan>> = OnceLock::new();
    PLANS.get_or_init(|| {
        let mut plans = Vec::new();
        for (leaves, j_high) in leaves() {
            let weights: Vec<u32> = (0..leaves.len()).map(|i| 1 << (2 * (i % 11))).collect();
            plans.push(Plan::new(&leaves, j_high).expect("valid leaves"));
            plans.push(Plan::with_weights(&leaves, j_high, &weights).expect("valid weights"));
        }
        plans
    })
}

/// Octree geometry: depth of the level of detail (22 and up: all), then the payload. With the top
/// bit of the depth set, what is accepted codes and decodes to itself.
pub fn geometry(data: &[u8]) -> bool {
    let (depth, bytes) = choice(data);
    let limits = Limits { max_points: 128 };
    let Ok(g) = octree::decode_lod(bytes, depth & 127, &limits) else { return false };
    assert!(g.leaves.len() <= limits.max_points);
    gpcc_lite::leaf::check_leaves(&g.leaves, g.j_high).expect("decoded leaves are not valid");
    if depth < 128 {
        return true;
    }
    let again = octree::encode(&g.leaves, g.j_high).expect("decoded leaves were refused");
    assert!(octree::decode(&again, &limits).expect("own stream was refused") == g);
    true
}

/// RAHT attributes: which transform, how many channels, then the payload.
pub fn attribute(data: &[u8]) -> bool {
    let (byte, bytes) = choice(data);
    let plan = &plans()[usize::from(byte) % 8];
    let channels = 1 + usize::from(byte / 8) % 6;
    let Ok(values) = raht::decode(plan, bytes, channels) else { return false };
    assert!(values.len() <= channels && values.iter().all(|v| v.len() == plan.len()));
    true
}

/// Coefficients alone: which transform, how many channels, then the payload. With the
/// top bits set, what is accepted codes and decodes to itself in one of the three modes.
pub fn coeffs(data: &[u8]) -> bool {
    let (byte, bytes) = choice(data);
    let plan = &plans()[usize::from(byte) % 8];
    let channels = 1 + usize::from(byte / 8) % 8;
    let Ok(values) = group::decode(plan, bytes, channels) else { return false };
    let planes: Vec<&[i32]> = values.iter().map(Vec::as_slice).collect();
    let mode = match byte >> 6 {
        0 => return true,
        1 => group::Mode::Range,
        2 => group::Mode::Rlgr,
        _ => group::Mode::Symbols,
    };
    let again = group::encode(plan, &planes, mode).expect("decoded values were refused");
    let back = group::decode(plan, &again, channels).expect("own stream was refused");
    assert!(back == values, "{mode:?}");
    true
}

/// RLGR: parameters and direction, then the number of values and a payload, or the values.
pub fn rlgr(data: &[u8]) -> bool {
    let (byte, bytes) = choice(data);
    let params = if byte & 1 == 0 { golomb::Params::REMOTE_FX } else { golomb::Params::MALVAR };
    if byte & 2 == 0 {
        let (count, bytes) = number(bytes);
        let Ok(values) = golomb::decode(bytes, count % 1024, &params) else { return false };
        assert_eq!(values.len(), count % 1024);
    } else {
        let (words, _) = bytes.as_chunks::<4>();
        let values: Vec<i32> = words.iter().map(|&w| i32::from_le_bytes(w)).collect();
        let coded = golomb::encode(&values, &params);
        let back = golomb::decode(&coded, values.len(), &params).expect("own stream was refused");
        assert!(back == values);
    }
    true
}

/// Lossless prediction and lifting: which set and which of the two, then the payload.
pub fn predict(data: &[u8]) -> bool {
    static NEAR: OnceLock<Vec<[Neighbours; 2]>> = OnceLock::new();
    let near = NEAR.get_or_init(|| {
        let of = |(l, j): (Vec<Leaf>, u8)| {
            [Neighbours::new(&l, j), Neighbours::coarser(&l, j)].map(|n| n.expect("valid leaves"))
        };
        leaves().into_iter().map(of).collect()
    });
    let (byte, bytes) = choice(data);
    let [all, coarser] = &near[usize::from(byte) % 4];
    let channels = 1 + usize::from(byte / 8) % 7;
    let values = if byte & 4 == 0 {
        decode_lossless(all, bytes, channels)
    } else {
        decode_lifting(&Lifting::new(coarser), bytes, channels)
    };
    let Ok(values) = values else { return false };
    assert!(values.len() <= channels && values.iter().all(|v| v.len() == all.len()));
    true
}

/// Covariance codebooks and their indices.
pub fn codebook(data: &[u8]) -> bool {
    let (byte, bytes) = choice(data);
    if byte & 1 == 0 {
        let Ok(book) = vq::Codebook::from_bytes_within(bytes, 512) else { return false };
        if book.len() <= 256 {
            let again = book.to_bytes();
            let back = vq::Codebook::from_bytes(&again).expect("own codebook was refused");
            assert!(back.to_bytes() == again, "a codebook changed");
        }
        for index in 0..book.len().min(64) {
            let (q, s) = book.decode(index as u32).expect("an index below the length");
            assert!(q.iter().chain(&s).all(|v| v.is_finite()));
        }
    } else {
        let (count, rest) = number(bytes);
        let (codewords, rest) = number(rest);
        let (count, codewords) = (count % 1024, codewords % 4096);
        let Ok(indices) = vq::index::decode(rest, count, codewords) else { return false };
        assert!(indices.len() == count && indices.iter().all(|&i| (i as usize) < codewords));
    }
    true
}

/// The lossless section: SH degree, number of Gaussians, then the payload.
pub fn lossless(data: &[u8]) -> bool {
    let (degree, bytes) = choice(data);
    let (count, bytes) = number(bytes);
    let decode = gsvx::lossless::decode_payload;
    let Ok(scene) = decode(bytes, (count % 16) as u64, degree & 3) else { return false };
    assert_eq!(scene.len(), count % 16);
    assert_eq!(scene.sh.len(), scene.len() * scene.sh_len());
    true
}
