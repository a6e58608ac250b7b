//! The C# interface and the Unity package, on Mono.
#![cfg(all(unix, feature = "encode"))]
#![allow(missing_docs, reason = "a test")]

mod common;

use common::{found, goldens, here, library, run};
use gs_model::{Axes, Scene};
use std::path::{Path, PathBuf};
use std::process::Command;

/// Compiles programs of `tests/csharp` and sources of the package, and puts the library beside them.
fn compiled(folder: &Path, programs: &[&str], sources: &[&str]) -> Option<PathBuf> {
    if !found("mcs") || !found("mono") {
        return None;
    }
    let name = format!("{}gsvx{}", std::env::consts::DLL_PREFIX, std::env::consts::DLL_SUFFIX);
    std::fs::copy(library(), folder.join(name)).expect("the library");
    let program = folder.join("program.exe");
    let mut compiler = Command::new("mcs");
    compiler
        .args(["-unsafe", "-langversion:7", "-warnaserror"])
        .arg(format!("-out:{}", program.display()));
    compiler.args(programs.iter().map(|p| here("tests/csharp").join(p)));
    run(compiler.args(sources.iter().map(|s| here("csharp").join(s))));
    Some(program)
}

/// Runs a program on Mono.
fn mono(program: &Path) -> Command {
    let mut command = Command::new("mono");
    command.env("LD_LIBRARY_PATH", program.parent().expect("a folder")).arg(program);
    command
}

fn bytes<'a>(floats: impl IntoIterator<Item = &'a f32>) -> Vec<u8> {
    floats.into_iter().flat_map(|v| v.to_ne_bytes()).collect()
}

/// The chunks of the finest level, decoded in Rust.
fn chunks(stream: &[u8]) -> Vec<Scene> {
    let index = gsvx::Index::parse(stream).expect("a golden");
    let mut rest = gsvx::decode(stream).expect("a golden");
    let counts = index.chunks_of_lod(0).map(|i| index.chunks[i].count as usize);
    let cut = |count| {
        let later = rest.split_off(count);
        std::mem::replace(&mut rest, later)
    };
    counts.map(cut).collect()
}

#[test]
fn floats_in_c_sharp_are_those_of_the_rust_decoder() {
    let folder = tempfile::tempdir().expect("a folder");
    let Some(program) = compiled(folder.path(), &["Floats.cs"], &["Runtime/Gsvx.cs"]) else {
        return;
    };
    for (name, path) in goldens() {
        let out = run(mono(&program).arg(&path)).stdout;
        let scenes = chunks(&std::fs::read(&path).expect("a golden"));
        let expected: Vec<u8> = scenes
            .iter()
            .flat_map(|s| {
                let all = [
                    s.means.as_flattened(),
                    s.rotations.as_flattened(),
                    s.log_scales.as_flattened(),
                    &s.opacity_logits,
                    s.sh.as_flattened(),
                ];
                bytes(all.into_iter().flatten())
            })
            .collect();
        assert!(out == expected, "{name}");
    }
}

/// The importer's floats.
struct ImportedFunction {
    floats: Vec<f32>,
    at: usize,
}

impl ImportedFunction {
    fn take(&mut self, count: usize) -> &[f32] {
        self.at += count;
        &self.floats[self.at - count..self.at]
    }
}

#[test]
fn the_importer_makes_scenes_in_unitys_coordinates() {
    let sources = [
        "Runtime/Gsvx.cs",
        "Runtime/GsvxScene.cs",
        "Runtime/SceneReader.cs",
        "Editor/GsvxImporter.cs",
    ];
    let folder = tempfile::tempdir().expect("a folder");
    let Some(program) = compiled(folder.path(), &["Import.cs", "Unity.cs"], &sources) else {
        return;
    };
    for (name, path) in goldens() {
        let out = run(mono(&program).arg(&path).arg("0")).stdout;
        let floats = out.as_chunks().0.iter().map(|&b| f32::from_ne_bytes(b)).collect();
        let mut imported = ImportedFunction { floats, at: 0 };
        let mut scene = gsvx::decode(&std::fs::read(&path).expect("a golden")).expect("a golden");
        Axes::Unity.turn(&mut scene);
        let n = scene.len();
        assert_eq!(imported.take(3 * n), scene.means.as_flattened(), "{name}");
        let unit = |[w, x, y, z]: [f32; 4]| {
            let length = (w * w + x * x + y * y + z * z).sqrt();
            [x, y, z, w].map(|v| v / length)
        };
        let rotations: Vec<_> = scene.rotations.iter().copied().map(unit).collect();
        near(imported.take(4 * n), rotations.as_flattened(), &name);
        let scales: Vec<_> =
            scene.log_scales.as_flattened().iter().map(|s| libm::expf(*s)).collect();
        near(imported.take(3 * n), &scales, &name);
        imported.take(4 * n);
        let above: Vec<_> = (0..n).flat_map(|i| &scene.sh_of(i)[1..]).copied().collect();
        assert_eq!(imported.take(3 * above.len()), above.as_flattened(), "{name}");
        let [centre, size]: [[f32; 3]; 2] =
            [0, 1].map(|_| imported.take(3).try_into().expect("three"));
        assert_eq!(imported.at, imported.floats.len(), "{name}");
        for mean in &scene.means {
            assert!(
                (0..3).all(|k| (mean[k] - centre[k]).abs() <= 0.5001 * size[k] + 1e-4),
                "{name}"
            );
        }
    }
    let broken = folder.path().join("broken.gsvx");
    std::fs::write(&broken, b"no stream at all").expect("a file");
    let out = mono(&program).arg(&broken).arg("0").output().expect("mono runs");
    let text = String::from_utf8_lossy(&out.stderr);
    assert!(
        out.status.code() == Some(3) && text.contains("broken.gsvx: not a gsvx stream"),
        "{text}"
    );
}

fn near(a: &[f32], b: &[f32], name: &str) {
    let is_near = |(a, b): (&f32, &f32)| (a - b).abs() <= 1e-5 * (1.0 + b.abs());
    assert!(a.len() == b.len() && a.iter().zip(b).all(is_near), "{name}");
}
