//! Files that splat-transform writes, and what it reads in those of this crate, attribute by attribute.

mod common;

use std::path::{Path, PathBuf};
use std::process::Command;

use common::{assert_within, fixture, shared};
use gs_model::{Format, ReadOptions, Scene, model, ply};

/// The path of the tool, or `None` with a message.
fn splat_transform() -> Option<PathBuf> {
    let path = std::env::var_os("PATH")?;
    let found =
        std::env::split_paths(&path).map(|d| d.join("splat-transform")).find(|p| p.is_file());
    if found.is_none() {
        eprintln!("SKIPPED: no splat-transform: npm install -g @playcanvas/splat-transform@3.7.0");
    }
    found
}

fn convert(tool: &Path, from: &Path, to: &Path) {
    convert_with(tool, from, &[], to);
}

/// `actions` are done between reading and writing.
fn convert_with(tool: &Path, from: &Path, actions: &[&str], to: &Path) {
    let mut command = Command::new(tool);
    command.args(["--quiet", "--overwrite", "--gpu", "cpu"]).arg(from).args(actions).arg(to);
    let out = command.output().unwrap();
    assert!(out.status.success(), "{from:?}: {}", String::from_utf8_lossy(&out.stderr));
}

/// What splat-transform makes of a PLY, a part of whose SH degrees it may leave out.
fn written(tool: &Path, dir: &Path, name: &str, scene: &Scene, sh_degree: u8) -> Vec<PathBuf> {
    let floats = dir.join(format!("{name}.ply"));
    let mut cut = scene.clone();
    cut.cut_sh(sh_degree);
    ply::write(&floats, &cut).unwrap();
    let files = ["compressed.ply", "sog", "spz", "glb"].map(|e| dir.join(format!("{name}.{e}")));
    for file in &files {
        convert(tool, &floats, file);
    }
    // It reads no glTF, so what it writes is compared with what it was given.
    let (back, _) = model::read(&files[3], &ReadOptions::default()).unwrap();
    assert_within(&format!("{name}.glb"), &cut, &back, [1e-6, 1e-6, 2e-5, 1e-6, 0.0, 0.0]);
    let ours =
        ["compressed.ply", "spz", "splat", "sog"].map(|e| dir.join(format!("{name}.ours.{e}")));
    ours.iter().for_each(|path| Format::of_name(path).unwrap().write(path, &cut).unwrap());
    files.into_iter().take(3).chain(ours).collect()
}

/// The same file, read here and by splat-transform.
fn assert_read_alike(tool: &Path, file: &Path, dir: &Path) {
    let theirs = dir.join("theirs.ply");
    // It leaves the axes of SPZ as they are. A turn makes them those of PLY files: biker.spz is then the model of
    // biker.compressed.ply, as it is here.
    let is_spz = file.extension().is_some_and(|e| e == "spz");
    let turn: &[&str] = if is_spz { &["--rotate", "180,0,0"] } else { &[] };
    convert_with(tool, file, turn, &theirs);
    // It writes opacities of 0 and 1 as infinite logits, where the bytes 0 and 255 stand for a quarter of
    // a step inside here.
    let (theirs, _) = ply::read(theirs).unwrap();
    let (ours, _) = model::read(file, &ReadOptions::default()).unwrap();
    // It takes the byte b of a quaternion in a .splat for b / 127.5 - 1, where it is b / 128 - 1.
    let is_splat = file.extension().is_some_and(|e| e == "splat");
    let rotations = if is_splat { 3.2e-5 } else { 1e-6 };
    let bounds = [2e-6, rotations, 2e-6, 1.01e-3, 1e-6, 1e-6];
    assert_within(&file.display().to_string(), &ours, &theirs, bounds);
}

#[test]
fn splat_transform_reads_the_same_values() {
    let Some(tool) = splat_transform() else { return };
    let dir = tempfile::tempdir().unwrap();
    let (room, _) = ply::read(fixture("room/point_cloud.ply")).unwrap();
    let room = room.select(&(0..11_001).step_by(5).collect::<Vec<_>>());
    let mut files = written(&tool, dir.path(), "room", &room, 3);
    if let Some(path) = shared("scenes/fox/point_cloud.ply") {
        let (fox, _) = ply::read(path).unwrap();
        let part = |step: usize| fox.select(&(0..fox.len()).step_by(step).collect::<Vec<_>>());
        files.extend(written(&tool, dir.path(), "fox", &part(20), 3));
        // A palette for each number of degrees, and none.
        for degree in 0..3 {
            files.extend(written(&tool, dir.path(), &format!("fox{degree}"), &part(100), degree));
        }
    }
    if let Some(biker) = shared("models/biker.compressed.ply") {
        let sog = dir.path().join("biker.sog");
        convert(&tool, &biker, &sog);
        files.extend([biker, sog]);
    }
    let ksplats = ["small", "tiny.0", "tiny.1"];
    files.extend(ksplats.map(|name| fixture(&format!("formats/{name}.ksplat"))));
    files.extend(
        ["biker.spz", "flower.spz", "flower.splat"]
            .iter()
            .filter_map(|name| shared(&format!("models/{name}"))),
    );
    for file in files {
        assert_read_alike(&tool, &file, dir.path());
    }
}
