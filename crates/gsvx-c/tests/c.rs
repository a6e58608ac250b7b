//! Programs in C and C++ against the shared library, under valgrind.
#![cfg(unix)]
#![allow(missing_docs, reason = "a test")]

mod common;
#[allow(dead_code, reason = "these tests use a part")]
#[path = "../../gsvx/tests/common/forge.rs"]
mod forge;

use common::{compiled, goldens, guarded, here, run};
use gs_model::math::{axes_product, rotation};
use gs_model::{Axes, SH_C0, Scene, sh_len};
use std::process::Command;

const AXES: [Axes; 4] = [Axes::Stored, Axes::YUp, Axes::Unity, Axes::Unreal];

/// Numbers of four bytes for each Gaussian, of the arrays in order.
fn widths(degree: u8) -> [usize; 18] {
    let has = |least: u8, width| if degree >= least { width } else { 0 };
    let sh = 3 * sh_len(degree);
    let bytes = [has(1, 3), has(2, 4), has(3, 6)];
    let packed = [4, 4, has(1, 4), has(2, 4), has(3, 4), has(3, 4)];
    let mut all = [3, 4, 3, 1, sh, 3, 4, 6, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0];
    all[9..12].copy_from_slice(&bytes);
    all[12..].copy_from_slice(&packed);
    all
}

/// The arrays of a chunk, taken off the front of what the program wrote.
fn take(words: &mut &[u32], count: usize, degree: u8) -> Vec<Vec<u32>> {
    let part = |width| {
        let (part, rest) = words.split_at(count * width);
        *words = rest;
        part.to_vec()
    };
    widths(degree).into_iter().map(part).collect()
}

fn bits(floats: &[f32]) -> Vec<u32> {
    floats.iter().map(|v| v.to_bits()).collect()
}

fn near(words: &[u32], expected: impl IntoIterator<Item = f64>, what: &str) {
    for (word, expected) in words.iter().zip(expected) {
        let v = f64::from(f32::from_bits(*word));
        assert!(
            (v - expected).abs() <= 1e-5 * (1.0 + expected.abs()),
            "{what}: {v}, not {expected}"
        );
    }
}

/// Compares the arrays of a chunk with its Gaussians: those that are stored bit for bit, those that are computed with
/// another computation.
fn compare(arrays: &[Vec<u32>], scene: &Scene, name: &str) {
    assert_eq!(arrays[0], bits(scene.means.as_flattened()), "{name}");
    assert_eq!(arrays[1], bits(scene.rotations.as_flattened()), "{name}");
    assert_eq!(arrays[2], bits(scene.log_scales.as_flattened()), "{name}");
    assert_eq!(arrays[3], bits(&scene.opacity_logits), "{name}");
    assert_eq!(arrays[4], bits(scene.sh.as_flattened()), "{name}");
    near(
        &arrays[5],
        scene.log_scales.as_flattened().iter().map(|s| libm::exp(f64::from(*s))),
        name,
    );
    for i in 0..scene.len() {
        let opacity = 1.0 / (1.0 + libm::exp(-f64::from(scene.opacity_logits[i])));
        let [r, g, b] = scene.sh_of(i)[0].map(|v| 0.5 + f64::from(SH_C0 * v));
        near(&arrays[6][4 * i..], [r, g, b, opacity], name);
        let variances = scene.log_scales[i].map(|s| libm::exp(2.0 * f64::from(s)));
        let [xx, yy, zz, xy, xz, yz] = axes_product(&rotation(scene.rotations[i]), variances);
        near(&arrays[7][6 * i..], [xx, xy, xz, yy, yz, zz], name);
        let bytes = [r, g, b, opacity].map(|v| (255.0 * v + 0.5).clamp(0.0, 255.0) as u8);
        for (got, want) in arrays[8][i].to_ne_bytes().into_iter().zip(bytes) {
            assert!(got.abs_diff(want) <= 1, "{name}: {got}, not {want}");
        }
        assert_eq!(arrays[12][4 * i..][..3], bits(&scene.means[i]), "{name}");
    }
}

#[test]
fn parts_of_the_goldens_decode_to_the_floats_of_the_rust_decoder() {
    let folder = tempfile::tempdir().expect("a folder");
    let Some(program) = compiled(&here("tests/c/parts.c"), folder.path()) else { return };
    for (number, (name, path)) in goldens().into_iter().enumerate() {
        let whole = gsvx::decode(&std::fs::read(&path).expect("a golden")).expect("a golden");
        for (axes, turned) in AXES.into_iter().enumerate() {
            // valgrind takes a second for each run: one for each golden.
            let is_guarded = axes == number % AXES.len();
            let mut command = if is_guarded { guarded(&program) } else { Command::new(&program) };
            let out = run(command.arg(&path).arg(axes.to_string())).stdout;
            let words: Vec<u32> =
                out.as_chunks().0.iter().map(|&b| u32::from_ne_bytes(b)).collect();
            let (mut rest, mut at) = (&words[..], 0);
            for chunk in chunks(&path) {
                let mut scene = Scene { sh_degree: whole.sh_degree, ..Scene::default() };
                scene.append_range(&whole, at..at + chunk);
                at += chunk;
                turned.turn(&mut scene);
                let name = format!("{name}, {turned:?}");
                compare(&take(&mut rest, chunk, whole.sh_degree), &scene, &name);
            }
            assert!(rest.is_empty() && at == whole.len(), "{name}");
        }
    }
}

#[test]
fn frames_of_the_golden_sequences_have_the_floats_of_the_rust_decoder() {
    let folder = tempfile::tempdir().expect("a folder");
    let Some(program) = compiled(&here("tests/c/frames.c"), folder.path()) else { return };
    for name in ["tracked.gsvx", "births.gsvx"] {
        let path = here("../../fixtures/sequences").join(name);
        let bytes = std::fs::read(&path).expect("a golden");
        let sequence = gsvx::sequence::Sequence::parse(&bytes).expect("a golden");
        let mut expected = Vec::new();
        for number in 0..sequence.groups.len() {
            let group = sequence.group(&bytes, number, None).expect("a golden");
            for s in (0..group.len()).map(|t| group.frame(t)) {
                expected.extend(s.means.as_flattened().iter().chain(s.rotations.as_flattened()));
                expected.extend(s.log_scales.as_flattened().iter().chain(&s.opacity_logits));
                expected.extend(s.sh.as_flattened());
            }
        }
        let out = run(guarded(&program).arg(&path)).stdout;
        let floats: Vec<u32> = out.as_chunks().0.iter().map(|&b| u32::from_ne_bytes(b)).collect();
        assert!(floats == bits(&expected), "{name}");
    }
}

/// The numbers of Gaussians of the chunks of the finest level.
fn chunks(path: &std::path::Path) -> Vec<usize> {
    let index = gsvx::Index::parse(&std::fs::read(path).expect("a golden")).expect("a golden");
    index.chunks_of_lod(0).map(|i| index.chunks[i].count as usize).collect()
}

/// Broken streams, each behind its length: bits flipped, cut, and damaged behind valid checksums.
fn hostile(count: usize) -> Vec<u8> {
    let mut rng = testing::Rng::seeded(3);
    let streams: Vec<_> =
        goldens().iter().map(|(_, p)| std::fs::read(p).expect("a golden")).collect();
    let mut out = Vec::new();
    for number in 0..count {
        let good = &streams[number % streams.len()];
        let mut broken = good.clone();
        match number % 4 {
            0 => forge::damage(&mut broken, &mut rng),
            1 => broken.truncate((rng.bits() % good.len() as u64) as usize),
            2 => {
                let index = gsvx::Index::parse(good).expect("a golden");
                let body = 13..index.head_len as usize - 4;
                let mut head = good[body].to_vec();
                forge::damage(&mut head, &mut rng);
                broken = forge::with_checksum(head);
                broken.extend(&good[index.head_len as usize..]);
            }
            _ => {
                let (index, mut layers) = forge::take_apart(good);
                if let Some(chunk) = layers.first_mut() {
                    let layer = (rng.bits() % chunk.len() as u64) as usize;
                    forge::damage(&mut chunk[layer], &mut rng);
                }
                broken = forge::assemble(&index, &layers);
            }
        }
        out.extend((broken.len() as u32).to_le_bytes());
        out.extend(broken);
    }
    out
}

#[test]
fn broken_streams_and_wrong_arguments_are_errors() {
    let folder = tempfile::tempdir().expect("a folder");
    let Some(program) = compiled(&here("tests/c/hostile.c"), folder.path()) else { return };
    let streams = folder.path().join("streams");
    std::fs::write(&streams, hostile(400)).expect("streams");
    let input = std::fs::File::open(&streams).expect("streams");
    let out = run(guarded(&program).stdin(input)).stdout;
    let text = String::from_utf8(out).expect("text");
    eprintln!("{text}");
    let (_, accepted) =
        text.split_once(r#""failed": [], "streams": 400, "accepted": "#).expect("none fails");
    let accepted: u32 = accepted.split_once(',').expect("a number").0.parse().expect("a number");
    assert!(accepted < 150, "{text}");
}

#[test]
fn two_threads_decode_the_same_floats() {
    let folder = tempfile::tempdir().expect("a folder");
    let Some(program) = compiled(&here("tests/c/threads.cpp"), folder.path()) else { return };
    run(guarded(&program).arg(here("../../fixtures/streams/chunks.gsvx")));
}

#[cfg(feature = "encode")]
#[test]
fn models_are_encoded_or_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let Some(program) = compiled(&here("tests/c/encode.cpp"), folder.path()) else { return };
    run(guarded(&program).arg(here("../../fixtures/streams/chunks.gsvx")));
}
