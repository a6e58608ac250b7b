//! Broken streams: an error or a smaller scene, never a panic, never unbounded memory or time.
#![cfg(feature = "encode")]

mod common;

use common::forge::{assemble, damage, head, take_apart, with_checksum};
use common::with_related_degrees;
use common::{
    Rng, decoding, encode, encode_voxels, encoding, leaves, scene, voxelized, with_floaters,
};
use gsvx::{
    DecodeOutcome, EncodeOptions, EncodedStream, Error, Index, Kind, Reader, decode, decode_leaves,
    decode_with, default_max_gaussians, encode_lossless,
};
use std::time::{Duration, Instant};
use voxel::Strategy;

/// A small stream of several chunks.
fn small(n: usize) -> EncodedStream {
    let options = encoding(|o| o.chunk_leaves = leaves(n.div_ceil(3)));
    let (merged, voxels) = voxelized(&scene(n, 3, 9), &Strategy::paper(3, 9));
    encode_voxels(&merged, voxels.octree(), Some(&scene(2, 3, 1)), &options).unwrap()
}

fn salvage(bytes: &[u8]) -> Result<DecodeOutcome, Error> {
    decode_with(bytes, &decoding(|o| o.salvage = true))
}

/// Decodes in all ways that there are; none may panic.
fn decode_all_ways(bytes: &[u8]) {
    let _ = decode(bytes);
    let _ = salvage(bytes);
    let _ = decode_with(bytes, &decoding(|o| (o.lod, o.max_sh_degree) = (9, 1)));
    let _ = decode_leaves(bytes);
    let mut reader = Reader::new();
    if reader.give(0, bytes).is_ok() {
        let chunks = reader.index().map_or(0, |i| i.chunks.len());
        (0..chunks.min(20)).for_each(|chunk| drop(reader.decode(chunk, 4)));
    }
}

#[test]
fn truncated_at_every_byte() {
    let EncodedStream { bytes, index, .. } = small(60);
    assert_eq!(index.chunks.len(), 4);
    let whole = decode(&bytes).unwrap();
    for end in 0..bytes.len() {
        assert!(decode(&bytes[..end]).is_err(), "cut at {end}");
        let part = salvage(&bytes[..end]);
        if (end as u64) < index.head_len {
            assert!(part.is_err(), "cut at {end}");
            continue;
        }
        // All that is complete is shown: whole base layers, and the degrees behind them.
        let part = part.unwrap();
        assert!(!part.skipped.is_empty(), "cut at {end}");
        let (mut at, mut from) = (0, 0);
        for chunk in &index.chunks {
            let n = chunk.count as usize;
            let there = chunk.layers.iter().take_while(|l| l.range().end <= end as u64).count();
            if there > 0 {
                assert_eq!(part.scene.means[at..at + n], whole.means[from..from + n]);
                let known = if chunk.kind == Kind::Exact { 16 } else { there * there };
                for i in 0..n {
                    let (part, whole) = (part.scene.sh_of(at + i), whole.sh_of(from + i));
                    assert_eq!(part[..known], whole[..known], "cut at {end}");
                    assert!(part[known..].iter().all(|v| *v == [0.0; 3]), "cut at {end}");
                }
                at += n;
            }
            from += n;
        }
        assert_eq!(part.scene.len(), at, "cut at {end}");
    }
}

#[test]
fn every_flipped_bit_is_noticed() {
    let bytes = small(40).bytes;
    for at in 0..bytes.len() {
        for bit in 0..8 {
            let mut broken = bytes.clone();
            broken[at] ^= 1 << bit;
            assert!(decode(&broken).is_err(), "byte {at} bit {bit}");
        }
    }
}

#[test]
fn damage_of_the_head_shows() {
    let EncodedStream { bytes, index, .. } = small(40);
    for at in 13..index.head_len as usize {
        let mut broken = bytes.clone();
        broken[at] ^= 4;
        assert!(matches!(decode(&broken), Err(Error::HeadChecksum { .. })), "byte {at}");
        assert!(matches!(salvage(&broken), Err(Error::HeadChecksum { .. })), "byte {at}");
        let mut reader = Reader::new();
        assert!(matches!(reader.give(0, &broken), Err(Error::HeadChecksum { .. })), "byte {at}");
    }
}

#[test]
fn damage_in_one_chunk_costs_that_chunk_alone() {
    let EncodedStream { bytes, index, .. } = small(60);
    let whole = decode(&bytes).unwrap();
    let mut first = 0;
    for (number, chunk) in index.chunks.iter().enumerate() {
        let n = chunk.count as usize;
        for (layer, entry) in chunk.layers.iter().enumerate() {
            let mut broken = bytes.clone();
            broken[entry.offset as usize + entry.len as usize / 2] ^= 1;
            match decode(&broken).unwrap_err() {
                Error::Checksum { chunk, layer: l, .. } => assert_eq!((chunk, l), (number, layer)),
                other => panic!("{other}"),
            }
            let part = salvage(&broken).unwrap();
            let [line] = &part.skipped[..] else { panic!("{:?}", part.skipped) };
            assert!(line.contains(&format!("chunk {number}")), "{line}");
            if layer == 0 {
                let kept: Vec<usize> =
                    (0..whole.len()).filter(|i| !(first..first + n).contains(i)).collect();
                assert_eq!(part.scene, whole.select(&kept), "chunk {number}");
            } else {
                assert!(line.contains(&format!("SH degree {layer}")), "{line}");
                for i in 0..whole.len() {
                    let known = if (first..first + n).contains(&i) { layer * layer } else { 16 };
                    assert_eq!(part.scene.sh_of(i)[..known], whole.sh_of(i)[..known]);
                    assert!(part.scene.sh_of(i)[known..].iter().all(|v| *v == [0.0; 3]));
                }
            }
        }
        first += n;
    }
}

/// Damage behind valid checksums: what an attacker sends.
#[test]
fn damage_behind_valid_checksums_never_panics() {
    let lod = encoding(|o| (o.lod, o.chunk_leaves) = (true, leaves(40)));
    let streams = [
        (small(120).bytes, 2000),
        (
            encode(&with_related_degrees(scene(900, 3, 9)), &EncodeOptions::default())
                .unwrap()
                .bytes,
            200,
        ),
        (encode(&with_floaters(scene(700, 1, 9)).0, &lod).unwrap().bytes, 400),
        (encode_lossless(&scene(60, 1, 9), true).unwrap().bytes, 600),
    ];
    let mut rng = Rng::seeded(1);
    for (bytes, rounds) in &streams {
        let (index, good) = take_apart(bytes);
        let places: Vec<(usize, usize)> = good
            .iter()
            .enumerate()
            .flat_map(|(c, layers)| (0..layers.len()).map(move |l| (c, l)))
            .collect();
        for round in 0..*rounds {
            let mut broken = good.clone();
            let (chunk, layer) = places[round % places.len()];
            damage(&mut broken[chunk][layer], &mut rng);
            let broken = assemble(&index, &broken);
            decode_all_ways(&broken);
            // What decodes is finite, but for Gaussians that are coded bit for bit.
            if let Ok(scene) = decode(&broken)
                && index.chunks.iter().all(|c| c.kind == Kind::Leaves)
            {
                assert!(scene.validate().is_ok(), "round {round}: not finite");
            }
        }
    }
}

#[test]
fn damaged_heads_behind_a_valid_checksum_never_panic() {
    let lod = encoding(|o| (o.lod, o.chunk_leaves) = (true, leaves(100)));
    let streams = [small(60).bytes, encode(&scene(700, 1, 9), &lod).unwrap().bytes];
    let mut rng = Rng::seeded(2);
    for bytes in &streams {
        let index = Index::parse(bytes).unwrap();
        let body = bytes[13..index.head_len as usize - 4].to_vec();
        for _ in 0..1500 {
            let mut broken = body.clone();
            damage(&mut broken, &mut rng);
            let mut stream = with_checksum(broken);
            stream.extend(&bytes[index.head_len as usize..]);
            decode_all_ways(&stream);
        }
    }
}

/// A head and layers after changes to the head; lengths and checksums of layers as `change` leaves them.
fn forged(encoded: &EncodedStream, change: impl FnOnce(&mut Index)) -> Vec<u8> {
    let mut index = encoded.index.clone();
    change(&mut index);
    let mut out = head(&index);
    out.extend(&encoded.bytes[encoded.index.head_len as usize..]);
    out
}

#[test]
fn claims_are_refused_before_memory_or_time_is_spent() {
    let start = Instant::now();
    let encoded = small(30);
    let real = encoded.index.header.count;
    for count in [0, real - 1, real + 1, 1 << 20, 1 << 60, u64::MAX] {
        let forged = forged(&encoded, |i| i.header.count = count);
        assert!(matches!(decode(&forged), Err(Error::Corrupt { .. })), "{count}");
    }
    for count in [1, 1 << 17, 1 << 24, (1 << 32) - 2, 1 << 60, u64::MAX] {
        let forged = forged(&encoded, |i| {
            i.header.count = (real - i.chunks[0].count).wrapping_add(count);
            i.chunks[0].count = count;
        });
        let error = decode(&forged).unwrap_err();
        assert!(count < 1 << 24 || matches!(error, Error::Limit { .. } | Error::Corrupt { .. }));
        // Neither an unlimited reader nor an unlimited decoder spends memory on a claim.
        decode_all_ways(&forged);
        // A scene of the claimed size, made before geometry is decoded, ended the process from 2^25 on.
        for salvage in [false, true] {
            let unlimited = decoding(|o| (o.max_gaussians, o.salvage) = (Some(u64::MAX), salvage));
            let decoded = decode_with(&forged, &unlimited);
            assert!(decoded.is_err() || salvage && decoded.unwrap().scene.len() < 30);
        }
    }
    for len in [1 << 20, 1 << 32, 1 << 60, 1 << 62, u64::MAX] {
        let forged = forged(&encoded, |i| i.chunks[0].layers[0].len = len);
        let error = decode(&forged).unwrap_err();
        assert!(matches!(error, Error::Truncated { .. } | Error::Corrupt { .. }), "{len}: {error}");
        decode_all_ways(&forged);
    }
    let strict = decoding(|o| o.max_gaussians = Some(real - 1));
    let error = decode_with(&encoded.bytes, &strict).unwrap_err();
    assert!(matches!(error, Error::Limit { points, limit } if points == real && limit == real - 1));
    assert!(start.elapsed() < Duration::from_secs(60), "{:?}", start.elapsed());
}

#[test]
fn a_head_that_breaks_the_rules_is_refused() {
    let encoded = small(60);
    let refused = |what: &str, change: &dyn Fn(&mut Index)| {
        let error = decode(&forged(&encoded, change)).unwrap_err();
        assert!(matches!(error, Error::Corrupt { .. }), "{what}: {error}");
    };
    refused("SH degree", &|i| i.header.sh_degree = 4);
    refused("octree depth", &|i| i.header.j_high = 22);
    refused("cube side", &|i| i.header.cube.side = 0.0);
    refused("cube side", &|i| i.header.cube.side = f64::NAN);
    refused("cube origin", &|i| i.header.cube.origin[1] = f64::INFINITY);
    for step in [0.0, -1.0, 1e-40, 1e9, f32::NAN] {
        refused("step", &|i| i.header.steps.covariance = step);
    }
    refused("level of detail", &|i| i.chunks[0].lod = 9);
    refused("chunk order", &|i| i.chunks[0].first_cell = i.chunks[1].first_cell);
    refused("coarse behind fine", &|i| i.chunks[1].lod = 1);
    refused("exact before leaves", &|i| {
        i.chunks[0].kind = Kind::Exact;
        i.chunks[0].layers.truncate(1);
    });
    refused("first cell", &|i| i.chunks[0].first_cell = u64::MAX);
    refused("empty chunk", &|i| i.chunks[0].count = 0);
    for other in [0, 3, 255] {
        let mut bytes = encoded.bytes.clone();
        bytes[8] = other;
        let error = decode(&bytes).unwrap_err();
        assert!(matches!(error, Error::Version { version, .. } if version == other), "{error}");
    }
    for bytes in [&b""[..], b"ply\nformat", b"PK\x03\x04", &[0u8; 64]] {
        assert!(matches!(decode(bytes), Err(Error::NotGsvx)));
    }
}

#[test]
fn chunks_that_changed_places_are_refused() {
    let encoded = small(60);
    let (index, mut layers) = take_apart(&encoded.bytes);
    layers.swap(0, 1);
    let mut swapped = index.clone();
    (swapped.chunks[0].count, swapped.chunks[1].count) =
        (index.chunks[1].count, index.chunks[0].count);
    match decode(&assemble(&swapped, &layers)).unwrap_err() {
        Error::Chunk { chunk: 0, source } => {
            assert!(matches!(*source, Error::Corrupt { what: "first cell of a chunk", .. }));
        }
        other => panic!("{other}"),
    }
}

/// A cube whose cells lie beyond f32 once decoded to infinite means.
#[test]
fn a_cube_beyond_f32_is_damage() {
    let broken = forged(&small(20), |i| i.header.cube.side = 1e300);
    let Err(Error::Chunk { chunk: 0, source }) = decode(&broken) else { panic!("decoded") };
    assert!(matches!(*source, Error::Corrupt { what: "mean beyond f32", .. }), "{source}");
}

/// A layer that decodes to something else than what its chunk has, under a checksum that is right.
fn with_bad_degree_one() -> (Vec<u8>, usize) {
    let encoded = small(60);
    let (index, mut layers) = take_apart(&encoded.bytes);
    let bad = 1;
    layers[bad][1] = vec![0x55; 40];
    (assemble(&index, &layers), bad)
}

#[test]
fn a_layer_that_cannot_be_decoded_leaves_those_before_it_as_they_were() {
    let (bytes, bad) = with_bad_degree_one();
    let mut fresh = Reader::new();
    fresh.give(0, &bytes).unwrap();
    let base = fresh.decode(bad, 1).unwrap();
    assert_eq!(base.sh_degree, 0);
    let mut reader = Reader::new();
    reader.give(0, &bytes).unwrap();
    for before in [0, 2] {
        // The coefficients of another chunk are what a decoder could show by mistake.
        reader.hold(before, 4).unwrap();
        assert!(matches!(reader.hold(bad, 4), Err(Error::Chunk { .. })));
        assert_eq!(reader.held_len(), base.len());
        let mut held = gs_model::Scene { sh_degree: 3, ..Default::default() };
        reader.held_block(0..base.len(), &mut held).unwrap();
        assert!(held.sh.chunks_exact(16).all(|sh| sh[1..].iter().all(|v| *v == [0.0; 3])));
        held.cut_sh(0);
        assert_eq!(held, base);
        assert_eq!(reader.decode(bad, 1).unwrap(), base);
    }
}

#[test]
fn salvage_leaves_out_what_cannot_be_decoded() {
    let (bytes, bad) = with_bad_degree_one();
    assert!(matches!(decode(&bytes), Err(Error::Chunk { chunk, .. }) if chunk == bad));
    let whole = decode(&small(60).bytes).unwrap();
    let salvaged = salvage(&bytes).unwrap();
    let counts: Vec<usize> = salvaged.index.chunks.iter().map(|c| c.count as usize).collect();
    let (first, end) = (counts[0], counts[0] + counts[1]);
    assert_eq!(salvaged.skipped.len(), 1, "{:?}", salvaged.skipped);
    assert!(salvaged.skipped[0].starts_with("SH degree 1 and above of chunk 1"));
    for i in 0..whole.len() {
        let known = if (first..end).contains(&i) { 1 } else { 16 };
        let (sh, of_whole) = (salvaged.scene.sh_of(i), whole.sh_of(i));
        assert_eq!(sh[..known], of_whole[..known], "{i}");
        assert!(sh[known..].iter().all(|v| *v == [0.0; 3]), "{i}");
    }
    let (index, mut layers) = take_apart(&bytes);
    layers[bad][0] = vec![0x55; 40];
    let salvaged = salvage(&assemble(&index, &layers)).unwrap();
    assert_eq!(salvaged.scene.len(), whole.len() - counts[bad]);
    assert!(salvaged.skipped[0].starts_with(&format!("chunk 1 ({} Gaussians)", counts[bad])));
}

#[test]
fn a_head_that_claims_more_than_any_head_has_is_refused_before_it_is_there() {
    let start = |body: u32| {
        let mut out = gsvx::SIGNATURE.to_vec();
        out.push(gsvx::VERSION);
        out.extend(body.to_le_bytes());
        out
    };
    for body in [u32::MAX, u32::MAX - 16, u32::MAX - 13, (1 << 26) + 1] {
        let refused = |e: Error| matches!(e, Error::Corrupt { what: "length of the head", .. });
        assert!(refused(Index::parse(&start(body)).unwrap_err()), "{body}");
        assert!(refused(Reader::new().give(0, &start(body)).unwrap_err()), "{body}");
    }
    let mut reader = Reader::new();
    reader.give(0, &start(1 << 26)).unwrap();
    assert_eq!(reader.head_needs(), Some(13..(1 << 26) + 17));
}

#[test]
fn the_default_limit_is_one_of_decoded_bytes() {
    let [few, many] = [0, 3].map(|degree| default_max_gaussians(0, degree));
    assert_eq!((few, many), ((64 << 20) / 56, (64 << 20) / 236));
    assert_eq!(default_max_gaussians(236 << 10, 3), many + (1 << 20));
    assert_eq!(default_max_gaussians(u64::MAX, 3), u64::MAX / 236);
    let claim = |more: u64| {
        let encoded = small(30);
        let limit = default_max_gaussians(encoded.bytes.len() as u64, 3);
        let others = encoded.index.header.count - encoded.index.chunks[0].count;
        let mut forged = forged(&encoded, |i| {
            i.header.count = limit + more;
            i.chunks[0].count = limit + more - others;
        });
        // A number that is written longer makes the stream longer; what follows it does not.
        forged.extend([0; 1 << 20]);
        decode(&forged).unwrap_err()
    };
    assert!(matches!(claim(1000), Error::Limit { .. }));
    assert!(matches!(claim(0), Error::Chunk { .. }));
    let encoded = small(30);
    let mut reader = Reader::with_max_gaussians(encoded.index.chunks[0].count - 1);
    reader.give(0, &encoded.bytes).unwrap();
    assert!(matches!(reader.hold(0, 1), Err(Error::Limit { .. })));
}

/// A grid of equal Gaussians takes almost no bytes each; the default limit refused it.
#[test]
fn the_default_limit_admits_a_constant_grid() {
    let n = 64usize.pow(3);
    let scene = gs_model::Scene {
        means: (0..n).map(|i| [i % 64, i / 64 % 64, i / 4096].map(|v| v as f32)).collect(),
        rotations: vec![[1.0, 0.0, 0.0, 0.0]; n],
        log_scales: vec![[-1.0; 3]; n],
        opacity_logits: vec![2.0; n],
        sh_degree: 0,
        sh: vec![[0.3; 3]; n],
        ..gs_model::Scene::default()
    };
    let mut options = EncodeOptions::default();
    options.prepare.leaves = gsvx::Leaves::Uniform { depth: 6 };
    let encoded = encode(&scene, &options).unwrap();
    eprintln!("{n} equal Gaussians: {} bytes", encoded.bytes.len());
    assert_eq!(decode(&encoded.bytes).unwrap().len(), n);
    let exact = encode_lossless(&scene, false).unwrap();
    eprintln!("without loss: {} bytes", exact.bytes.len());
    assert_eq!(decode(&exact.bytes).unwrap().len(), n);
}
