//! Streams that no encoder writes: heads and layers are changed, checksums are repaired.

use gsvx::{Index, Kind};
use testing::Rng;

/// The layers of each chunk.
pub(crate) type Layers = Vec<Vec<Vec<u8>>>;

/// Takes a stream apart.
pub(crate) fn take_apart(bytes: &[u8]) -> (Index, Layers) {
    let index = Index::parse(bytes).unwrap();
    let layer = |l: &gsvx::Layer| bytes[l.offset as usize..(l.offset + l.len) as usize].to_vec();
    let layers = index.chunks.iter().map(|c| c.layers.iter().map(layer).collect()).collect();
    (index, layers)
}

/// Puts a stream together; lengths and checksums in the head are those of `layers`.
pub(crate) fn assemble(index: &Index, layers: &Layers) -> Vec<u8> {
    let mut index = index.clone();
    for (chunk, layers) in index.chunks.iter_mut().zip(layers) {
        for (entry, bytes) in chunk.layers.iter_mut().zip(layers) {
            entry.len = bytes.len() as u64;
            entry.crc = crc32c::crc32c(bytes);
        }
    }
    let mut out = head(&index);
    layers.iter().flatten().for_each(|bytes| out.extend(bytes));
    out
}

fn varint(out: &mut Vec<u8>, mut v: u64) {
    while v >= 0x80 {
        out.push(v as u8 | 0x80);
        v >>= 7;
    }
    out.push(v as u8);
}

/// The head with these fields, whatever they are.
pub(crate) fn head(index: &Index) -> Vec<u8> {
    let h = &index.header;
    let has_origin = h.origin != [0.0; 3];
    let flags = u8::from(h.antialiased) << 6 | u8::from(has_origin) << 7;
    let mut body = vec![h.sh_degree | flags, h.j_high];
    for v in [h.cube.origin[0], h.cube.origin[1], h.cube.origin[2], h.cube.side] {
        body.extend(v.to_le_bytes());
    }
    let [a, b, c] = h.steps.sh;
    for v in [h.steps.opacity, h.steps.dc, a, b, c, h.steps.covariance] {
        body.extend(v.to_le_bytes());
    }
    let origin = if has_origin { &h.origin[..] } else { &[] };
    origin.iter().for_each(|v| body.extend(v.to_le_bytes()));
    varint(&mut body, h.count);
    varint(&mut body, index.chunks.len() as u64);
    for chunk in &index.chunks {
        body.push(if chunk.kind == Kind::Exact { 255 } else { chunk.lod });
        varint(&mut body, chunk.count);
        varint(&mut body, chunk.first_cell);
        chunk.bounds.as_flattened().iter().for_each(|v| body.extend(v.to_le_bytes()));
        for layer in &chunk.layers {
            varint(&mut body, layer.len);
            body.extend(layer.crc.to_le_bytes());
        }
    }
    with_checksum(body)
}

/// A head with this body.
pub(crate) fn with_checksum(body: Vec<u8>) -> Vec<u8> {
    let mut out = gsvx::SIGNATURE.to_vec();
    out.push(gsvx::VERSION);
    out.extend((body.len() as u32).to_le_bytes());
    out.extend(body);
    let crc = crc32c::crc32c(&out);
    out.extend(crc.to_le_bytes());
    out
}

/// Changes some bytes of a layer.
pub(crate) fn damage(layer: &mut Vec<u8>, rng: &mut Rng) {
    for _ in 0..1 + rng.bits() % 3 {
        let at = (rng.bits() % (layer.len() as u64 + 1)) as usize;
        match rng.bits() % 6 {
            0 => layer.truncate(at),
            1 => layer.push(rng.bits() as u8),
            _ if at < layer.len() => layer[at] ^= 1 << (rng.bits() % 8),
            _ => layer.push(0),
        }
    }
}
