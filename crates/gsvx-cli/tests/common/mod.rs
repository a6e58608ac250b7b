//! The command, and the model it is run on.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

pub(crate) fn gsvx() -> Command {
    Command::new(env!("CARGO_BIN_EXE_gsvx"))
}

pub(crate) fn room() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures/room")
}

pub(crate) fn model() -> PathBuf {
    room().join("point_cloud.ply")
}

/// The first 400 Gaussians of the room.
#[allow(dead_code, reason = "each test file uses its own part")]
pub(crate) fn scene() -> gs_model::Scene {
    let (scene, _) = gs_model::ply::read(model()).unwrap();
    scene.select(&(0..400).collect::<Vec<_>>())
}

/// A file of [`scene`] in `dir`.
#[allow(dead_code, reason = "each test file uses its own part")]
pub(crate) fn small(dir: &Path) -> PathBuf {
    let path = dir.join("small.ply");
    gs_model::ply::write(&path, &scene()).unwrap();
    path
}

/// Runs the command; each `@` of `words` stands for the next of `paths`.
#[allow(dead_code, reason = "each test file uses its own part")]
pub(crate) fn run(words: &[&str], paths: &[&Path]) -> Output {
    let mut paths = paths.iter();
    let words = words.iter().map(|&w| match w {
        "@" => paths.next().expect("a path per @").as_os_str().to_owned(),
        word => word.into(),
    });
    gsvx().args(words.collect::<Vec<_>>()).output().unwrap()
}

/// Exit code 1 and exactly one line, which holds `needle`.
pub(crate) fn one_line(out: &Output, needle: &str) {
    let error = String::from_utf8_lossy(&out.stderr);
    assert_eq!(out.status.code(), Some(1), "{error}");
    assert_eq!(error.trim_end().lines().count(), 1, "{error}");
    assert!(error.contains(needle), "{error}");
}

/// Exit code 2 and one line, which holds `needle`.
#[allow(dead_code, reason = "each test file uses its own part")]
pub(crate) fn wrong_usage(out: &Output, needle: &str) {
    let error = String::from_utf8_lossy(&out.stderr);
    assert_eq!(out.status.code(), Some(2), "{error}");
    assert!(error.contains(needle), "{error}");
}
