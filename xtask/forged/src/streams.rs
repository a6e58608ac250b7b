//! The streams: golden ones, changed. Three of four have checksums that are right.

use std::sync::OnceLock;

use gsvx::{Index, Kind};
use testing::Rng;

use crate::forge::{Layers, assemble, damage, head, take_apart};
use crate::seal::{self, PREAMBLE};

macro_rules! golden {
    ($($name:literal),*) => {
        [$(include_bytes!(concat!("../../../fixtures/streams/", $name, ".gsvx")) as &[u8]),*]
    };
}

static GOLDEN: [&[u8]; 12] = golden!(
    "empty",
    "one",
    "default",
    "degree-0",
    "uniform",
    "outliers",
    "predicted",
    "chunks",
    "lossless",
    "lossless-ordered",
    "lod",
    "antialiased"
);

/// So many of them are forged, of which the largest is the last: streams keep their numbers.
const FORGED: usize = 11;

/// A golden stream, taken apart.
struct Golden {
    bytes: &'static [u8],
    index: Index,
    layers: Layers,
}

fn golden() -> &'static [Golden] {
    static ALL: OnceLock<Vec<Golden>> = OnceLock::new();
    ALL.get_or_init(|| {
        let apart = |bytes: &'static [u8]| {
            let (index, layers) = take_apart(bytes);
            Golden { bytes, index, layers }
        };
        GOLDEN.into_iter().map(apart).collect()
    })
}

/// Any but the largest, which is chosen seldom.
fn any(rng: &mut Rng) -> &'static Golden {
    let all = golden();
    let most = if rng.below(50) == 0 { FORGED } else { FORGED - 1 };
    &all[rng.below(most)]
}

/// The last numbers of 32 bits are those of the golden streams, as they are, from this one on.
pub const FIRST_GOLDEN: u64 = (1 << 32) - GOLDEN.len() as u64;

/// The stream of that number: forged, or golden.
#[must_use]
pub fn stream(number: u64) -> Vec<u8> {
    if let Some(own) = number.checked_sub(FIRST_GOLDEN).and_then(|i| golden().get(i as usize)) {
        return own.bytes.to_vec();
    }
    let rng = &mut Rng::keyed(57, &[number]);
    let own = any(rng);
    let mut bytes = own.bytes.to_vec();
    let head = own.index.head_len as usize;
    match number % 8 {
        0 => bytes_changed(&mut bytes, PREAMBLE..head - 4, rng),
        1 => bytes_changed(&mut bytes, head..own.bytes.len(), rng),
        2 => return exchanged(own, rng),
        3 => return claimed(own, rng),
        4 => return damaged(own, rng),
        5 => {
            let body = [u32::MAX, 1 << 26, rng.bits() as u32][rng.below(3)];
            bytes[PREAMBLE - 4..PREAMBLE].copy_from_slice(&(body >> rng.below(3)).to_le_bytes());
            bytes.truncate(PREAMBLE + rng.below(bytes.len() - PREAMBLE + 1));
        }
        6 => {
            bytes_changed(&mut bytes, 0..own.bytes.len(), rng);
            return bytes;
        }
        _ => {
            let (at, other) = (rng.below(bytes.len()), any(rng).bytes);
            bytes.truncate(at);
            bytes.extend(other.get(at..).filter(|_| number & 8 == 0).unwrap_or_default());
            return bytes;
        }
    }
    seal::repair(&mut bytes);
    bytes
}

/// One to four bytes changed.
fn bytes_changed(bytes: &mut [u8], range: std::ops::Range<usize>, rng: &mut Rng) {
    if range.is_empty() {
        return;
    }
    for _ in 0..1 + rng.below(4) {
        let byte = &mut bytes[range.start + rng.below(range.len())];
        match rng.below(3) {
            0 => *byte ^= 1 << rng.below(8),
            1 => *byte = rng.bits() as u8,
            _ => *byte = [0, 0x7f, 0x80, 0xff][rng.below(4)],
        }
    }
}

/// A place of a layer, if there is one.
fn layer_of(layers: &Layers, rng: &mut Rng) -> Option<(usize, usize)> {
    let chunk = (!layers.is_empty()).then(|| rng.below(layers.len()))?;
    Some((chunk, rng.below(layers[chunk].len())))
}

/// A layer of another stream, or of another chunk, in the place of one.
fn exchanged(own: &Golden, rng: &mut Rng) -> Vec<u8> {
    let mut layers = own.layers.clone();
    let other = if rng.below(2) == 0 { own } else { any(rng) };
    if let (Some(to), Some(from)) = (layer_of(&layers, rng), layer_of(&other.layers, rng)) {
        layers[to.0][to.1] = other.layers[from.0][from.1].clone();
    }
    assemble(&own.index, &layers)
}

/// Layers that are damaged, emptied, or anything.
fn damaged(own: &Golden, rng: &mut Rng) -> Vec<u8> {
    let mut layers = own.layers.clone();
    for _ in 0..1 + rng.below(2) {
        let Some((chunk, number)) = layer_of(&layers, rng) else { break };
        let layer = &mut layers[chunk][number];
        match rng.below(4) {
            0 => layer.clear(),
            1 => *layer = (0..rng.below(200)).map(|_| rng.bits() as u8).collect(),
            _ => damage(layer, rng),
        }
    }
    assemble(&own.index, &layers)
}

/// A head that claims something else than its layers hold.
fn claimed(own: &Golden, rng: &mut Rng) -> Vec<u8> {
    let mut index = own.index.clone();
    let great = |rng: &mut Rng| (1u64 << rng.below(64)).wrapping_sub(rng.bits() % 3);
    for _ in 0..1 + rng.below(2) {
        let chunks = index.chunks.len();
        if chunks == 0 {
            index.header.count = great(rng);
            break;
        }
        let (at, total) = (rng.below(chunks), index.header.count);
        let chunk = &mut index.chunks[at];
        match rng.below(7) {
            // The sum is right as well.
            0..3 => {
                let count = great(rng);
                let others = total.wrapping_sub(chunk.count);
                if chunk.lod == 0 {
                    index.header.count = others.wrapping_add(count);
                }
                chunk.count = count;
            }
            3 => chunk.first_cell = great(rng),
            4 => {
                let layer = rng.below(chunk.layers.len());
                chunk.layers[layer].len = great(rng);
            }
            5 => {
                chunk.kind = if chunk.kind == Kind::Exact { Kind::Leaves } else { Kind::Exact };
                let layers = 1 + usize::from(index.header.sh_degree);
                let first = chunk.layers[0];
                chunk.layers.resize(if chunk.kind == Kind::Exact { 1 } else { layers }, first);
            }
            _ => {
                let header = &mut index.header;
                match rng.below(4) {
                    0 => header.sh_degree = rng.below(4) as u8,
                    1 => header.j_high = rng.below(22) as u8,
                    2 => header.cube.side = f64::from_bits(rng.bits()),
                    _ => header.cube.origin[0] = f64::from_bits(rng.bits()),
                }
            }
        }
    }
    let mut out = head(&index);
    own.layers.iter().flatten().for_each(|bytes| out.extend(bytes));
    seal::repair(&mut out);
    out
}
