//! Broken streams: an error or a smaller scene, never a panic, never unbounded memory.

mod common;

use common::{Rng, scene, voxelized, with_related_degrees};
use gsvx::{DecodeOptions, EncodeOptions, Error, decode, encode};
use voxel::Strategy;

fn stream(n: usize) -> Vec<u8> {
    let (merged, voxels) = voxelized(&scene(n, 3, 9), &Strategy::paper(3, 9));
    encode(&merged, &voxels, &EncodeOptions::from_quality(40.0).unwrap()).unwrap().bytes
}

#[test]
fn truncated_at_every_byte() {
    let bytes = stream(60);
    let lenient = DecodeOptions { allow_truncated: true, ..Default::default() };
    let mut shown = 0;
    for end in 0..bytes.len() {
        assert!(decode(&bytes[..end], &DecodeOptions::default()).is_err(), "cut at {end}");
        if let Ok(part) = decode(&bytes[..end], &lenient) {
            shown += 1;
            assert!(!part.skipped.is_empty(), "cut at {end}: something is missing");
            assert!(part.scene.validate().is_ok(), "cut at {end}");
        }
    }
    assert!(shown > 50, "a prefix with opacity and DC decodes: {shown}");
}

#[test]
fn every_flipped_bit_is_noticed() {
    let bytes = stream(40);
    for at in 0..bytes.len() {
        for bit in 0..8 {
            let mut broken = bytes.clone();
            broken[at] ^= 1 << bit;
            assert!(decode(&broken, &DecodeOptions::default()).is_err(), "byte {at} bit {bit}");
        }
    }
}

/// Damage behind valid checksums: what an attacker sends.
#[test]
fn payload_damage_with_repaired_checksums_never_panics() {
    let related = with_related_degrees(scene(700, 3, 9));
    let (merged, voxels) = voxelized(&related, &Strategy::paper(3, 9));
    let predicted = encode(&merged, &voxels, &EncodeOptions::from_quality(85.0).unwrap()).unwrap();
    for (bytes, rounds) in [(stream(120), 3000), (predicted.bytes, 400)] {
        damage_payloads(&bytes, rounds);
    }
}

fn damage_payloads(bytes: &[u8], rounds: usize) {
    let container = gsvx::stream::Container::parse(bytes).unwrap();
    let sections: Vec<_> = container
        .toc
        .iter()
        .map(|e| (e.kind, container.section(e.kind).unwrap().unwrap().to_vec()))
        .collect();
    let mut rng = Rng(1);
    for round in 0..rounds {
        let mut broken = sections.clone();
        let (_, payload) = &mut broken[round % sections.len()];
        for _ in 0..1 + rng.next() % 3 {
            let at = (rng.next() % payload.len() as u64) as usize;
            match rng.next() % 4 {
                0 => payload.truncate(at.max(1)),
                1 => payload.push(rng.next() as u8),
                _ => payload[at] = rng.next() as u8,
            }
            if payload.is_empty() {
                payload.push(0);
            }
        }
        let forged = gsvx::stream::assemble(&container.header, &broken);
        if let Ok(decoded) = decode(&forged, &DecodeOptions::default()) {
            assert!(decoded.scene.validate().is_ok(), "round {round}: not finite");
        }
    }
}

#[test]
fn a_forged_count_is_refused_before_memory_is_spent() {
    let bytes = stream(30);
    let container = gsvx::stream::Container::parse(&bytes).unwrap();
    let sections: Vec<_> = container
        .toc
        .iter()
        .map(|e| (e.kind, container.section(e.kind).unwrap().unwrap().to_vec()))
        .collect();
    let real = container.header.count;
    for count in [0, real - 1, real + 1, 1 << 20, u64::MAX] {
        let mut header = container.header.clone();
        header.count = count;
        let forged = gsvx::stream::assemble(&header, &sections);
        let result = decode(&forged, &DecodeOptions::default());
        assert!(result.is_err(), "{count}");
        if count > 1 << 19 {
            assert!(matches!(result, Err(Error::Limit { .. })), "{count}");
        }
    }
    let strict = DecodeOptions { max_gaussians: Some(10), ..Default::default() };
    assert!(matches!(decode(&bytes, &strict), Err(Error::Limit { limit: 10, .. })));
}

#[test]
fn other_files_are_named_as_such() {
    let default = DecodeOptions::default();
    for bytes in [&b""[..], b"ply\nformat", b"PK\x03\x04", &[0u8; 64]] {
        assert!(matches!(decode(bytes, &default), Err(Error::NotGsvx)));
    }
    for other in [gsvx::stream::MAJOR - 1, gsvx::stream::MAJOR + 1] {
        let mut bytes = stream(5);
        bytes[8] = other;
        let error = decode(&bytes, &default).unwrap_err();
        assert!(matches!(error, Error::Version { major, .. } if major == other), "{error}");
    }
}

/// A stream with covariances as integers of `bits`, its covariance section edited and its
/// checksums repaired.
fn with_integers(bits: u8, edit: impl FnOnce(&mut [u8])) -> Vec<u8> {
    let (merged, voxels) = voxelized(&scene(9, 0, 9), &Strategy::paper(3, 9));
    let covariance = gsvx::CovarianceMode::Lossless { bits };
    let options = EncodeOptions { covariance, ..Default::default() };
    let bytes = encode(&merged, &voxels, &options).unwrap().bytes;
    let container = gsvx::stream::Container::parse(&bytes).unwrap();
    let mut sections: Vec<_> = container
        .toc
        .iter()
        .map(|e| (e.kind, container.section(e.kind).unwrap().unwrap().to_vec()))
        .collect();
    edit(&mut sections.iter_mut().find(|s| s.0.code() == 4).unwrap().1);
    gsvx::stream::assemble(&container.header, &sections)
}

/// Found by the fuzz target `gsvx`: quaternions too long to have a direction were returned.
#[test]
fn a_rotation_without_direction_is_damage() {
    let broken = with_integers(8, |covariance| {
        // Mode, width, three ranges of log-scales, then the least and greatest w.
        covariance[2 + 24..2 + 28].copy_from_slice(&1e30f32.to_le_bytes());
        covariance[2 + 28..2 + 32].copy_from_slice(&2e30f32.to_le_bytes());
    });
    assert!(matches!(decode(&broken, &DecodeOptions::default()), Err(Error::Corrupt { .. })));
}

/// Integers wider than their stated width were taken, up to infinite log-scales.
#[test]
fn an_integer_beyond_its_width_is_damage() {
    let broken = with_integers(16, |covariance| {
        assert_eq!(covariance[..2], [1, 16], "mode, width");
        covariance[1] = 8;
    });
    assert!(matches!(
        decode(&broken, &DecodeOptions::default()),
        Err(Error::Corrupt { what: "covariance integer", .. })
    ));
}

/// A cube whose cells lie beyond f32 once decoded to infinite means.
#[test]
fn a_cube_beyond_f32_is_damage() {
    let bytes = stream(20);
    let container = gsvx::stream::Container::parse(&bytes).unwrap();
    let sections: Vec<_> = container
        .toc
        .iter()
        .map(|e| (e.kind, container.section(e.kind).unwrap().unwrap().to_vec()))
        .collect();
    let mut header = container.header.clone();
    header.cube.side = 1e300;
    let broken = gsvx::stream::assemble(&header, &sections);
    for lod in [None, Some(2)] {
        let options = DecodeOptions { lod, ..Default::default() };
        assert!(matches!(decode(&broken, &options), Err(Error::Corrupt { .. })), "{lod:?}");
    }
}
