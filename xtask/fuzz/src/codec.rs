//! Decoders of payloads.

use std::sync::OnceLock;

use gpcc_lite::coder::{Coder, RansDecoder, RansEncoder};
use gpcc_lite::model::{Bit, Symbols};
use gpcc_lite::paper::predict::{Neighbours, decode_lossless};
use gpcc_lite::raht::{RahtPlan, Rows};
use gpcc_lite::{Leaf, Limits, Octree, attribute as rows, geometry as octree};
use gpcc_lite::morton;
use gpcc_lite::paper::rlgr as golomb;

use crate::{choice, number};

/// Sets of leaves: none, one, a dense block, a sparse tree of mixed depth.
pub(crate) fn octrees() -> Vec<Octree> {
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
    let sets: [(Vec<Leaf>, u8); 4] = [(Vec::new(), 4), (one, 0), (block, 2), (mixed, 7)];
    let tree = |(mut leaves, depth): (Vec<Leaf>, u8)| {
        leaves.sort();
        let mut end = 0;
        leaves.retain(|l| {
            let keep = l.morton >= end;
            if keep {
                end = l.morton + (1 << (3 * (depth - l.depth)));
            }
            keep
        });
        Octree::of_points(depth, leaves).expect("valid leaves")
    };
    sets.into_iter().map(tree).collect()
}

/// Unweighted and weighted transforms of every set.
pub(crate) fn plans() -> &'static [RahtPlan] {
    static PLANS: OnceLock<Vec<RahtPlan>> = OnceLock::new();
    PLANS.get_or_init(|| {
        let mut plans = Vec::new();
        for tree in octrees() {
            let weights: Vec<u32> = (0..tree.len()).map(|i| 1 << (2 * (i % 11))).collect();
            plans.push(RahtPlan::new(tree.clone()));
            plans.push(RahtPlan::new(tree).weighted(&weights).expect("valid weights"));
        }
        plans
    })
}

/// Octree geometry: with an odd first byte, what is accepted codes and decodes to itself.
pub fn geometry(data: &[u8]) -> bool {
    let (byte, bytes) = choice(data);
    let limits = Limits { max_points: 128 };
    let Ok(g) = octree::decode(bytes, &limits) else { return false };
    assert!(g.len() <= limits.max_points);
    if byte & 1 == 1 {
        let again = octree::encode(&g).expect("decoded leaves were refused");
        assert!(octree::decode(&again, &limits).expect("own stream was refused") == g);
    }
    true
}

/// RAHT attributes: which transform, how many channels; then, with the top bit clear, a payload to decode,
/// else values to encode, which a decoder must return as the encoder said.
pub fn attribute(data: &[u8]) -> bool {
    let (byte, bytes) = choice(data);
    let plan = &plans()[usize::from(byte) % 8];
    let channels = 1 + usize::from(byte / 8) % 8;
    let steps = vec![0.5; channels];
    let mut values = Rows::new(plan.len(), channels);
    if byte < 128 {
        let Ok(mut decoder) = RansDecoder::new(bytes) else { return false };
        if rows::decode(&mut decoder, plan, &steps, &mut values).is_err() {
            return false;
        }
        let finite = |i| values.row(i).iter().all(|v| v.is_finite());
        assert!((0..plan.len()).all(finite));
        return decoder.finish().is_ok();
    }
    let (words, _) = bytes.as_chunks::<2>();
    let mut words = words.iter().map(|&w| f32::from(i16::from_le_bytes(w)) / 16.0).cycle();
    for i in 0..plan.len() {
        values.row_mut(i).iter_mut().for_each(|v| *v = words.next().unwrap_or(0.0));
    }
    let mut encoder = RansEncoder::default();
    let quantisation = rows::Quantisation::new(&steps);
    rows::encode(&mut encoder, plan, &quantisation, &mut values).expect("values were refused");
    let coded = encoder.finish();
    let mut decoder = RansDecoder::new(&coded).expect("own stream was refused");
    let mut back = Rows::new(plan.len(), channels);
    rows::decode(&mut decoder, plan, &steps, &mut back).expect("own stream was refused");
    decoder.finish().expect("own stream does not end where it should");
    assert!(back == values);
    true
}

/// Symbols, decisions and plain bits as `what` says, with the values of `data`; what was coded.
pub(crate) fn drive<C: Coder>(coder: &mut C, what: &[u8], data: &[u8]) -> Vec<u32> {
    let (mut symbols, mut bit) = (Symbols::geometric(500, 3), Bit::default());
    let mut values = data.iter().copied().map(u32::from).chain(std::iter::repeat(0));
    let mut code = |&op: &u8| {
        let value = values.next().unwrap_or(0);
        match op % 4 {
            0 => coder.symbol(&mut symbols, value as usize % 16) as u32,
            1 => u32::from(bit.code(coder, value & 1 == 1, 4 + u32::from(op))),
            2 => u32::from(coder.decision(1 + u32::from(op) * 127, value & 1 == 1)),
            _ => {
                let n = u32::from(op / 4) % 33;
                let mask = ((1u64 << n) - 1) as u32;
                coder.bits(value.wrapping_mul(0x9e37_79b9) & mask, n)
            }
        }
    };
    what.iter().map(&mut code).collect()
}

/// The entropy coder: what is coded (a length and as many operations), then, with an even first byte, the
/// stream, else the values, which come back.
pub fn coder(data: &[u8]) -> bool {
    let (byte, data) = choice(data);
    let (len, data) = choice(data);
    let (what, rest) = data.split_at(usize::from(len).min(data.len()));
    if byte & 1 == 0 {
        let Ok(mut decoder) = RansDecoder::new(rest) else { return false };
        drive(&mut decoder, what, &[]);
        return decoder.finish().is_ok();
    }
    let mut encoder = RansEncoder::default();
    let coded = drive(&mut encoder, what, rest);
    let bytes = encoder.finish();
    let mut decoder = RansDecoder::new(&bytes).expect("own stream was refused");
    assert_eq!(drive(&mut decoder, what, &[]), coded);
    decoder.finish().expect("own stream does not end where it should");
    true
}

/// RLGR: direction, then the number of values and a payload, or the values.
pub fn rlgr(data: &[u8]) -> bool {
    let (byte, bytes) = choice(data);
    if byte & 1 == 0 {
        let (count, bytes) = number(bytes);
        let Ok(values) = golomb::decode(bytes, count % 1024) else { return false };
        assert_eq!(values.len(), count % 1024);
    } else {
        let (words, _) = bytes.as_chunks::<4>();
        let values: Vec<i32> = words.iter().map(|&w| i32::from_le_bytes(w)).collect();
        let coded = golomb::encode(&values);
        let back = golomb::decode(&coded, values.len()).expect("own stream was refused");
        assert!(back == values);
    }
    true
}

/// Lossless prediction: which set, then the payload.
pub fn predict(data: &[u8]) -> bool {
    static NEAR: OnceLock<Vec<Neighbours>> = OnceLock::new();
    let near = NEAR.get_or_init(|| octrees().iter().map(Neighbours::new).collect());
    let (byte, bytes) = choice(data);
    let near = &near[usize::from(byte) % 4];
    let channels = 1 + usize::from(byte / 8) % 7;
    let Ok(values) = decode_lossless(near, bytes, channels) else { return false };
    assert!(values.len() <= channels && values.iter().all(|v| v.len() == near.len()));
    true
}
