//! `cargo xtask train`: what cannot be trained from is one line.
#![allow(unused_crate_dependencies, reason = "an integration test of the binary")]

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use tempfile::TempDir;

/// A copy of the embedded room, to be damaged.
fn room() -> TempDir {
    let dir = tempfile::tempdir().unwrap();
    testing::copy_room(dir.path());
    dir
}

fn train(scene: &Path, cap: &str) -> Output {
    let out = scene.join("trained.ply");
    let mut xtask = Command::new(env!("CARGO_BIN_EXE_xtask"));
    xtask.arg("train").arg(scene).args(["--steps", "2", "--cap", cap, "--out"]).arg(out);
    xtask.output().unwrap()
}

/// The error of a training, without the word.
fn refused(scene: &Path, cap: &str) -> String {
    let out = train(scene, cap);
    let said = String::from_utf8(out.stderr).unwrap();
    assert_eq!(out.status.code(), Some(1), "{said}");
    let errors: Vec<&str> = said.lines().filter_map(|l| l.strip_prefix("error: ")).collect();
    assert_eq!(errors.len(), 1, "{said}");
    assert!(!scene.join("trained.ply").exists());
    errors[0].to_owned()
}

#[test]
fn one_view_is_held_out_and_nothing_is_left_to_train_on() {
    let scene = room();
    let list = scene.path().join("sparse/0/images.txt");
    let text = fs::read_to_string(&list).unwrap();
    let lines: Vec<&str> = text.lines().filter(|l| !l.starts_with('#')).take(2).collect();
    fs::write(&list, lines.join("\n") + "\n").unwrap();
    let said = refused(scene.path(), "5000");
    assert!(said.contains("none is left"), "{said}");
}

#[test]
fn photos_of_several_sizes_train() {
    let scene = room();
    let cameras = scene.path().join("sparse/0/cameras.txt");
    let images = scene.path().join("sparse/0/images.txt");
    // A second camera, of half the size, takes the second photo.
    let text = fs::read_to_string(&cameras).unwrap();
    let camera = text.lines().find(|l| !l.starts_with('#')).unwrap();
    let words: Vec<&str> = camera.split_whitespace().collect();
    let number = |k: usize| words[k].parse::<f64>().unwrap();
    let [w, h] = [number(2) / 2.0, number(3) / 2.0].map(|v| v as u32);
    let half: Vec<String> = (4..8).map(|k| (number(k) / 2.0).to_string()).collect();
    fs::write(&cameras, format!("{text}\n77 PINHOLE {w} {h} {}\n", half.join(" "))).unwrap();
    let text = fs::read_to_string(&images).unwrap();
    let photo = text.lines().filter(|l| !l.starts_with('#')).nth(2).unwrap();
    let mut words: Vec<&str> = photo.split_whitespace().collect();
    let name = words[9];
    words[8] = "77";
    fs::write(&images, text.replace(photo, &words.join(" "))).unwrap();
    let file = scene.path().join("images").join(name);
    let small = image::open(&file).unwrap();
    let small = small.resize_exact(w, h, image::imageops::FilterType::Triangle);
    small.save(&file).unwrap();
    let out = train(scene.path(), "5000");
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
}
