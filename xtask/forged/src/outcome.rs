//! What a decoder makes of a stream, in all ways that there are.

use gs_model::Scene;
use gsvx::{DecodeOptions, DecodeOutcome, Error, Reader, decode_leaves, decode_with};

/// Chunks that a reader is asked for.
const CHUNKS: usize = 8;
/// Gaussians that are accepted where more than by default are: so many fit the address space of 32 bits. What is said of
/// more depends on the machine.
const MANY: u64 = 1 << 23;

/// A checksum of what was seen so far.
struct Digest(u32);

impl Digest {
    fn bytes(&mut self, bytes: &[u8]) {
        self.0 = crc32c::crc32c_append(self.0, bytes);
    }

    fn scene(&mut self, scene: &Scene) {
        let floats = scene.means.as_flattened().iter();
        let floats = floats.chain(scene.rotations.as_flattened());
        let floats = floats.chain(scene.log_scales.as_flattened()).chain(&scene.opacity_logits);
        for v in floats.chain(scene.sh.as_flattened()) {
            // Processors differ in the bits of what is not a number.
            let bits = if v.is_nan() { u32::MAX } else { v.to_bits() };
            self.bytes(&bits.to_le_bytes());
        }
    }

    fn error(&mut self, error: &Error) {
        self.bytes(gs_model::chain(error).as_bytes());
    }

    fn decoded(&mut self, decoded: &Result<DecodeOutcome, Error>) {
        match decoded {
            Ok(decoded) => {
                self.scene(&decoded.scene);
                decoded.skipped.iter().for_each(|line| self.bytes(line.as_bytes()));
            }
            Err(e) => self.error(e),
        }
    }
}

/// A number that is the same wherever the decoder does the same. It is odd if the stream was decoded as a whole one.
///
/// # Panics
/// If a reader shows after an error what it should not.
#[must_use]
pub fn outcome(bytes: &[u8]) -> u32 {
    let mut digest = Digest(0);
    let mut options = DecodeOptions::default();
    let whole = decode_with(bytes, &options);
    let accepted = whole.is_ok();
    digest.decoded(&whole);
    if matches!(whole, Err(Error::Limit { .. })) {
        // A claim takes no memory, even where none is refused.
        options.max_gaussians = Some(u64::MAX);
        assert!(decode_with(bytes, &options).is_err(), "a claim without Gaussians");
    }
    (options.salvage, options.max_gaussians) = (true, Some(MANY));
    digest.decoded(&decode_with(bytes, &options));
    (options.lod, options.max_sh_degree) = (9, 1);
    digest.decoded(&decode_with(bytes, &options));
    match decode_leaves(bytes) {
        Ok((octree, classes)) => {
            octree.leaves().iter().for_each(|leaf| digest.bytes(&leaf.morton.to_le_bytes()));
            digest.bytes(&classes);
        }
        Err(e) => digest.error(&e),
    }
    in_parts(bytes, &mut digest);
    digest.0 & !1 | u32::from(accepted)
}

/// A reader that goes from chunk to chunk, and on after errors.
fn in_parts(bytes: &[u8], digest: &mut Digest) {
    let mut reader = Reader::new();
    let middle = bytes.len() / 2;
    for (at, part) in [(middle, &bytes[middle..]), (0, &bytes[..middle])] {
        if let Err(e) = reader.give(at as u64, part) {
            return digest.error(&e);
        }
    }
    let Some(index) = reader.index().cloned() else { return };
    for (chunk, entry) in index.chunks.iter().enumerate().take(CHUNKS) {
        let Err(e) = reader.hold(chunk, entry.layers.len()) else {
            digest.scene(&held(&mut reader));
            continue;
        };
        if entry.count > MANY {
            continue;
        }
        digest.error(&e);
        // What is held now is what fewer layers hold in a reader that has seen no other chunk.
        let after = held(&mut reader);
        let mut fresh = Reader::new();
        if fresh.give(0, bytes).is_err() || matches!(e, Error::Limit { .. }) {
            continue;
        }
        let good = (1..entry.layers.len()).rev().find(|&layers| fresh.hold(chunk, layers).is_ok());
        match good {
            Some(_) => assert!(same(&held(&mut fresh), &after), "chunk {chunk}"),
            None => assert!(after.is_empty(), "chunk {chunk}"),
        }
        digest.scene(&after);
    }
}

/// What a reader holds, with all SH coefficients.
fn held(reader: &mut Reader) -> Scene {
    let mut scene = Scene { sh_degree: 3, ..Scene::default() };
    let held = reader.held_block(0..reader.held_len(), &mut scene);
    held.expect("there is memory");
    scene
}

fn same(a: &Scene, b: &Scene) -> bool {
    let digest = |scene: &Scene| {
        let mut digest = Digest(0);
        digest.scene(scene);
        (scene.len(), digest.0)
    };
    digest(a) == digest(b)
}
