//! Streams that arrive in parts: what is read, in which order, and that the Gaussians are the same.
#![cfg(feature = "encode")]

mod common;

use common::{Rng, decoding, encode, encoding, leaves, scene, trained_scene, with_floaters};
use gs_model::Scene;
use gsvx::{
    CodeOptions, Decoder, EncodeOptions, EncodedStream, Error, Reader, decode, decode_with,
};
use std::ops::Range;
use std::sync::Mutex;

/// A remote file that counts what is read.
struct Source<'a> {
    bytes: &'a [u8],
    requests: Vec<Range<u64>>,
}

impl<'a> Source<'a> {
    fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, requests: Vec::new() }
    }

    /// Gives a range of the file to a reader, as far as there is any.
    fn serve(&mut self, range: Range<u64>, reader: &mut Reader) {
        let end = range.end.min(self.bytes.len() as u64);
        assert!(range.start < end, "{range:?} of {}", self.bytes.len());
        self.requests.push(range.start..end);
        reader.give(range.start, &self.bytes[range.start as usize..end as usize]).unwrap();
    }

    fn open(&mut self) -> Reader {
        let mut reader = Reader::new();
        while let Some(range) = reader.head_needs() {
            self.serve(range, &mut reader);
        }
        reader
    }

    fn read(&self) -> u64 {
        self.requests.iter().map(|r| r.end - r.start).sum()
    }
}

fn many_chunks() -> EncodedStream {
    let (scene, _) = with_floaters(scene(8000, 2, 4));
    encode(&scene, &encoding(|o| o.chunk_leaves = leaves(50))).unwrap()
}

/// All chunks of a level at all layers, put together as `decode` does.
fn put_together(reader: &mut Reader, lod: u8) -> Scene {
    let index = reader.index().unwrap().clone();
    let mut scene = Scene { sh_degree: index.header.sh_degree, ..Scene::default() };
    for chunk in index.chunks_of_lod(lod) {
        scene.append(&reader.decode(chunk, 4).unwrap());
    }
    scene
}

#[test]
fn one_chunk_is_read_with_its_base_layer_and_nothing_else() {
    let EncodedStream { bytes, index, .. } = many_chunks();
    assert!(index.chunks.len() > 100 && index.head_len > 4096);
    let whole = decode(&bytes).unwrap();
    let mut first = 0;
    for (number, chunk) in index.chunks.iter().enumerate() {
        let n = chunk.count as usize;
        if number % 37 == 0 || number + 1 == index.chunks.len() {
            let mut source = Source::new(&bytes);
            let mut reader = source.open();
            assert_eq!(source.requests, [0..4096, 4096..index.head_len]);
            assert_eq!(reader.index(), Some(&index));
            assert_eq!(reader.whole_layers(number), 0);
            let needs = reader.needs(number, 1);
            assert_eq!(needs, [chunk.layers[0].range()]);
            source.serve(needs[0].clone(), &mut reader);
            assert_eq!(source.read(), index.head_len + chunk.layers[0].len);
            assert_eq!(reader.whole_layers(number), 1);
            let part = reader.decode(number, 1).unwrap();
            assert_eq!(part.means, whole.means[first..first + n]);
            assert_eq!(part.rotations, whole.rotations[first..first + n]);
            assert!((0..n).all(|i| part.sh_of(i)[0] == whole.sh_of(first + i)[0]));
            // The other layers of a chunk are one range.
            if chunk.layers.len() > 1 {
                // The base layer is held: its bytes are not needed for more.
                reader.forget(number);
                let rest = chunk.layers[1].offset..chunk.range(9).end;
                assert_eq!(reader.needs(number, 9), std::slice::from_ref(&rest));
                source.serve(rest, &mut reader);
                let part = reader.decode(number, 9).unwrap();
                let range: Vec<usize> = (first..first + n).collect();
                assert_eq!(part, whole.select(&range));
                // Layers that are held cannot be taken back.
                reader.forget(number);
                assert_eq!(reader.needs(number, 1), [chunk.layers[0].range()]);
            }
            assert!(reader.needs(number, 9).is_empty());
        }
        first += n;
    }
}

#[test]
fn the_head_takes_two_requests_at_most() {
    let coded =
        |n: usize| encode(&scene(n, 0, 4), &encoding(|o| o.chunk_leaves = leaves(20))).unwrap();
    for n in [0, 1, 300, 3000] {
        let encoded = coded(n);
        let mut source = Source::new(&encoded.bytes);
        let reader = source.open();
        assert_eq!(reader.index(), Some(&encoded.index));
        assert_eq!(source.requests.len(), if encoded.index.head_len > 4096 { 2 } else { 1 });
    }
}

#[test]
fn a_damaged_head_can_be_given_again() {
    let EncodedStream { bytes, index, .. } = many_chunks();
    let mut broken = bytes.clone();
    broken[100] ^= 1;
    let mut reader = Reader::new();
    for wrong in [&broken[..], b"a text that is no stream"] {
        assert!(reader.give(0, wrong).is_err());
        assert_eq!(reader.head_needs(), Some(0..4096));
    }
    reader.give(0, &bytes).unwrap();
    assert_eq!(reader.index(), Some(&index));
}

#[test]
fn pieces_in_any_order_and_size_give_the_same_gaussians() {
    let EncodedStream { bytes, .. } = many_chunks();
    let whole = decode(&bytes).unwrap();
    let mut rng = Rng::seeded(7);
    for round in 0..12 {
        let most = [1000, 20_000, 300][round % 3];
        let mut pieces = Vec::new();
        let mut at = 0;
        while at < bytes.len() {
            let end = bytes.len().min(at + 1 + (rng.bits() % most) as usize);
            // Pieces may overlap, and may come twice.
            let start = at.saturating_sub((rng.bits() % 50) as usize);
            (0..1 + rng.bits() % 2).for_each(|_| pieces.push(start..end));
            at = end;
        }
        for i in (1..pieces.len()).rev() {
            pieces.swap(i, (rng.bits() % (i as u64 + 1)) as usize);
        }
        let mut reader = Reader::new();
        for piece in pieces {
            reader.give(piece.start as u64, &bytes[piece]).unwrap();
        }
        assert_eq!(reader.head_needs(), None);
        assert!(put_together(&mut reader, 0) == whole, "round {round}");
    }
}

#[test]
fn what_is_missing_or_damaged_is_said() {
    let EncodedStream { bytes, index, .. } = many_chunks();
    let mut reader = Reader::new();
    assert!(matches!(reader.decode(0, 1), Err(Error::Truncated { .. })));
    reader.give(0, &bytes[..index.head_len as usize]).unwrap();
    assert!(matches!(reader.decode(0, 1), Err(Error::Truncated { .. })));
    assert!(matches!(reader.decode(index.chunks.len(), 1), Err(Error::Corrupt { .. })));
    assert!(reader.needs(index.chunks.len(), 1).is_empty());
    assert_eq!(reader.whole_layers(index.chunks.len()), 0);
    reader.forget(index.chunks.len());
    let range = index.chunks[2].range(3);
    let mut broken = bytes[range.start as usize..range.end as usize].to_vec();
    *broken.last_mut().unwrap() ^= 1;
    reader.give(range.start, &broken).unwrap();
    assert!(reader.decode(2, 2).is_ok());
    assert!(matches!(reader.decode(2, 3), Err(Error::Checksum { chunk: 2, layer: 2, .. })));
    // The right bytes replace the wrong ones.
    reader.give(range.start, &bytes[range.start as usize..range.end as usize]).unwrap();
    assert!(reader.decode(2, 3).is_ok());
    // Bytes of another place, and beyond the end, are of no use and no harm.
    reader.give(u64::MAX - 3, &[1; 20]).unwrap();
    reader.give(bytes.len() as u64, &[1; 20]).unwrap();
    let range = index.chunks[3].range(1);
    let mut gap = bytes[range.start as usize..range.end as usize].to_vec();
    reader.give(range.start, &gap[..3]).unwrap();
    reader.give(range.start + 5, &gap.split_off(5)).unwrap();
    let missing = range.start + 3..range.start + 5;
    assert_eq!(reader.needs(3, 1), std::slice::from_ref(&missing));
}

/// A piece of the end that came first took memory up to its offset.
#[test]
fn a_piece_far_from_the_start_takes_its_own_length() {
    let EncodedStream { bytes, .. } = many_chunks();
    let mut reader = Reader::new();
    reader.give(1 << 50, &[1; 20]).unwrap();
    reader.give(0, &bytes).unwrap();
    assert!(put_together(&mut reader, 0) == decode(&bytes).unwrap());
}

#[test]
fn the_index_of_a_real_scene_is_small() {
    let Some(fox) = trained_scene("scenes/fox/point_cloud.ply") else {
        return check_index(&common::room());
    };
    check_index(&fox);
}

fn check_index(scene: &Scene) {
    let encoded = encode(scene, &EncodeOptions::default()).unwrap();
    let (head, total) = (encoded.index.head_len, encoded.bytes.len() as u64);
    eprintln!("{} chunks, head {head} of {total} bytes", encoded.index.chunks.len());
    assert!(head <= total / 1000 + 4096, "{head} of {total}");
}

/// What [`Decoder::blocks`] visits, put together.
fn by_blocks(bytes: &[u8], options: &gsvx::DecodeOptions) -> Scene {
    let decoder = Decoder::new(bytes, options).unwrap();
    let seen: Mutex<Vec<(usize, Scene)>> = Mutex::default();
    let visit = |visits: &mut usize, first: usize, block: &Scene| -> Result<(), Error> {
        *visits += 1;
        seen.lock().unwrap().push((first, block.clone()));
        Ok(())
    };
    decoder.blocks(visit).unwrap();
    let mut blocks = seen.into_inner().unwrap();
    blocks.sort_by_key(|(first, _)| *first);
    let mut scene = Scene { sh_degree: decoder.sh_degree(), ..Scene::default() };
    for (first, block) in blocks {
        assert_eq!(first, scene.len());
        scene.append(&block);
    }
    assert_eq!(scene.len(), decoder.len());
    scene
}

#[test]
fn blocks_are_the_scene() {
    let (floaters, _) = with_floaters(scene(3000, 2, 4));
    let coded =
        |change: &dyn Fn(&mut CodeOptions)| encode(&floaters, &encoding(change)).unwrap().bytes;
    let streams = [
        coded(&|_| ()),
        coded(&|o| o.chunk_leaves = leaves(700)),
        coded(&|o| o.lod = true),
        gsvx::encode_lossless(&floaters, true).unwrap().bytes,
    ];
    for bytes in &streams {
        for (max_sh_degree, lod) in [(0, 0), (3, 0), (3, 1)] {
            let o = decoding(|o| (o.max_sh_degree, o.lod) = (max_sh_degree, lod));
            let whole = decode_with(bytes, &o).unwrap().scene;
            for threads in [1, 3] {
                let same = common::on_threads(threads, || by_blocks(bytes, &o)) == whole;
                assert!(same, "{threads} threads");
            }
        }
        let decoder = Decoder::new(bytes, &Default::default()).unwrap();
        let stop = decoder.blocks(|(), _, _: &Scene| Err(Error::NotGsvx));
        assert!(matches!(stop, Err(Error::NotGsvx)));
    }
}

#[test]
fn a_damaged_layer_leaves_what_is_held() {
    let EncodedStream { bytes, index, .. } = many_chunks();
    let whole = decode(&bytes).unwrap();
    let mut damaged = bytes.clone();
    let layer = index.chunks[0].layers[1];
    damaged[layer.offset as usize + 1] ^= 1;
    let mut source = Source::new(&damaged);
    let mut reader = source.open();
    assert_eq!((reader.held_len(), reader.held_leaves().len()), (0, 0));
    for range in reader.needs(0, 9) {
        source.serve(range, &mut reader);
    }
    let n = reader.hold(0, 1).unwrap();
    assert!(matches!(reader.hold(0, 9), Err(Error::Checksum { chunk: 0, layer: 1, .. })));
    assert_eq!((reader.held_len(), reader.held_leaves().len()), (n, n));
    // In blocks, the last of which is cut.
    let mut block = Scene { sh_degree: 2, ..Scene::default() };
    for first in (0..n).step_by(16) {
        reader.held_block(first..first + 16, &mut block).unwrap();
        for i in 0..block.len() {
            assert_eq!(block.means[i], whole.means[first + i]);
            assert_eq!(block.sh_of(i)[0], whole.sh_of(first + i)[0]);
            assert!(block.sh_of(i)[1..].iter().all(|c| *c == [0.0; 3]));
        }
    }
    // Another chunk takes its place.
    assert!(matches!(reader.hold(1, 1), Err(Error::Truncated { .. })));
    assert_eq!(reader.held_len(), 0);
}
