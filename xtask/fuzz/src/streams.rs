//! Streams of gsvx: whole, in pieces, and with one part that is anything under a head that is right.

use std::sync::OnceLock;

use gsvx::{DecodeOptions, EncodeOptions, Index, Kind, Reader};
use testing::sha256;

use crate::common::forge::{Layers, assemble, take_apart};
use crate::{choice, common, number, seal};

/// Gaussians that a stream may have.
const MOST: u64 = 64;

fn options() -> DecodeOptions {
    let mut options = DecodeOptions::default();
    options.max_gaussians = Some(MOST);
    options
}

/// A stream, its checksums repaired: SH degree and salvage, level of detail, then the stream.
pub fn gsvx(data: &[u8]) -> bool {
    let (byte, data) = choice(data);
    let (lod, file) = choice(data);
    let mut file = file.to_vec();
    seal::repair(&mut file);
    let mut options = options();
    options.max_sh_degree = byte & 3;
    options.salvage = byte & 8 != 0;
    options.lod = lod;
    let Ok(decoded) = gsvx::decode_with(&file, &options) else { return false };
    let scene = &decoded.scene;
    assert!(scene.len() as u64 <= MOST);
    assert_eq!(scene.sh.len(), scene.len() * scene.sh_len());
    // Exact Gaussians come back as whatever was put in.
    if decoded.index.chunks.iter().all(|c| c.kind == Kind::Leaves) {
        scene.validate().expect("the decoder returned an invalid scene");
    }
    true
}

/// A stream that arrives in pieces: the number of pieces, where each begins and ends (two small numbers,
/// any order, any overlap), then the stream, its checksums repaired. What comes out chunk by chunk is what the
/// whole stream decodes to. After a layer that fails the reader goes on as one that has seen no failure.
pub fn reader(data: &[u8]) -> bool {
    let (pieces, mut data) = choice(data);
    let mut ranges = Vec::new();
    for _ in 0..pieces % 8 {
        let (a, rest) = number(data);
        let (b, rest) = number(rest);
        ranges.push((a, b));
        data = rest;
    }
    let mut file = data.to_vec();
    seal::repair(&mut file);
    let mut reader = Reader::new();
    for (a, b) in ranges {
        let (start, end) = (a.min(b).min(file.len()), a.max(b).min(file.len()));
        if reader.give(start as u64, &file[start..end]).is_err() {
            return false;
        }
    }
    // What is still missing, as asked for.
    while let Some(range) = reader.head_needs() {
        let end = range.end.min(file.len() as u64);
        if range.start >= end {
            return false;
        }
        let bytes = &file[range.start as usize..end as usize];
        if reader.give(range.start, bytes).is_err() {
            return false;
        }
    }
    let index = reader.index().expect("no head is needed any more").clone();
    if index.chunks.iter().any(|c| c.count > MOST) || index.stream_len() > file.len() as u64 {
        return false;
    }
    let mut joined = gs_model::Scene { sh_degree: index.header.sh_degree, ..Default::default() };
    let mut failed = false;
    for chunk in index.chunks_of_lod(0) {
        let layers = index.chunks[chunk].layers.len();
        for range in reader.needs(chunk, layers) {
            let bytes = &file[range.start as usize..range.end as usize];
            reader.give(range.start, bytes).expect("the head is known");
        }
        assert_eq!(reader.whole_layers(chunk), layers);
        for layers in (1..=layers).rev() {
            let part = reader.decode(chunk, layers).ok();
            let mut other = Reader::new();
            other.give(0, &file).expect("the head is known");
            // Floats that are not numbers are not equal to themselves.
            let anew = other.decode(chunk, layers).ok();
            assert_eq!(part.as_ref().map(sha256), anew.as_ref().map(sha256), "{layers} layers");
            failed |= part.is_none();
            if let Some(part) = part {
                if part.sh_degree == joined.sh_degree {
                    joined.append(&part);
                }
                break;
            }
        }
        reader.forget(chunk);
    }
    let whole = gsvx::decode_with(&file, &options());
    if let (Ok(whole), false) = (whole, failed) {
        assert_eq!(sha256(&whole.scene), sha256(&joined));
    }
    !failed
}

/// Index and layers of a stream of SH degree 1.
fn template() -> &'static (Index, Layers) {
    static TEMPLATE: OnceLock<(Index, Layers)> = OnceLock::new();
    TEMPLATE.get_or_init(|| {
        // So fine that SH degree 1 is there.
        let options = EncodeOptions::default();
        let scene = common::scene(20, 1, 7);
        take_apart(&gsvx::encode(&scene, None, 85.0, &options).expect("encoded").bytes)
    })
}

/// The template with one chunk of `count` Gaussians from a cell on that has these layers.
fn forged(count: usize, cell: u64, layers: &[&[u8]]) -> Vec<u8> {
    let (mut index, _) = template().clone();
    index.chunks.truncate(1);
    index.header.count = count as u64;
    index.header.sh_degree = layers.len() as u8 - 1;
    let cells = 1 << (3 * index.header.j_high);
    let chunk = &mut index.chunks[0];
    (chunk.count, chunk.first_cell) = (count as u64, cell % cells);
    let layer = chunk.layers[0];
    chunk.layers = vec![layer; layers.len()];
    assemble(&index, &vec![layers.iter().map(|l| l.to_vec()).collect()])
}

/// Layers of a chunk: number of Gaussians, first cell, length of the base layer, then
/// the base layer and that of SH degree 1.
pub fn chunk(data: &[u8]) -> bool {
    let (count, data) = number(data);
    let Some((&cell, data)) = data.split_first_chunk() else { return false };
    let cell = u64::from_le_bytes(cell);
    let (len, layers) = number(data);
    let (base, sh) = layers.split_at(len.min(layers.len()));
    let count = 1 + count % MOST as usize;
    let stream = forged(count, cell, &[base, sh]);
    let Ok(decoded) = gsvx::decode_with(&stream, &options()) else { return false };
    assert_eq!(decoded.scene.len(), count);
    decoded.scene.validate().expect("the decoder returned an invalid scene");
    true
}

/// Gaussians bit for bit: SH degree, number of Gaussians, then the only layer of their chunk.
pub fn lossless(data: &[u8]) -> bool {
    let (degree, data) = choice(data);
    let (count, payload) = number(data);
    let count = 1 + count % 16;
    let (mut index, _) = template().clone();
    index.chunks.truncate(1);
    index.header.count = count as u64;
    index.header.sh_degree = degree & 3;
    let chunk = &mut index.chunks[0];
    (chunk.kind, chunk.count, chunk.first_cell) = (Kind::Exact, count as u64, 0);
    chunk.layers.truncate(1);
    let stream = assemble(&index, &vec![vec![payload.to_vec()]]);
    let Ok(decoded) = gsvx::decode_with(&stream, &options()) else { return false };
    let scene = decoded.scene;
    assert_eq!((scene.len(), scene.sh.len()), (count, count * scene.sh_len()));
    true
}
