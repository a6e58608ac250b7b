//! `gsvx decode --box`.

mod common;

use common::{Folder, one_line, run, said, wrong_usage};
use std::num::NonZeroUsize;
use std::path::Path;

/// The room in many small chunks.
fn stream(dir: &Path) -> std::path::PathBuf {
    let (scene, _) = gs_model::ply::read(common::model()).unwrap();
    let mut options = gsvx::EncodeOptions::default();
    options.code.chunk_leaves = NonZeroUsize::new(128).unwrap();
    options.code.lod = true;
    let path = dir.join("room.gsvx");
    std::fs::write(&path, gsvx::encode(&scene, None, 50.0, &options).unwrap().bytes).unwrap();
    path
}

#[test]
fn a_box_is_the_part_of_the_scene_and_little_else_is_read() {
    let dir = Folder::new();
    let (stream, back) = (stream(&dir), dir.join("part.ply"));
    let bytes = std::fs::read(&stream).unwrap();
    let whole = gsvx::decode(&bytes).unwrap();
    let at = whole.means[whole.len() / 2];
    let corners: Vec<String> = at.iter().map(|v| (v - 0.2).to_string()).collect();
    let others: Vec<String> = at.iter().map(|v| (v + 0.2).to_string()).collect();
    let region = format!("{},{}", corners.join(","), others.join(","));
    let decode = |more: &str| {
        let words = format!("decode @ -o @ --force --box {region}{more}");
        let said = common::json(&words, &[&stream, &back]);
        (said, gs_model::ply::read(&back).unwrap().0)
    };
    let (said, part) = decode("");
    let inside = |i: &usize| (0..3).all(|k| (whole.means[*i][k] - at[k]).abs() <= 0.2);
    let wanted: Vec<usize> = (0..whole.len()).filter(inside).collect();
    assert!(!wanted.is_empty() && wanted.len() < whole.len() / 10);
    assert_eq!(part, whole.select(&wanted));
    let read = said["bytes_read"].as_u64().unwrap();
    assert!(read < bytes.len() as u64 / 3, "{said} of {}", bytes.len());
    // Less is read for base colours, and less again of a coarser level.
    let (base, part) = decode(" --max-sh-degree 0");
    assert_eq!((part.sh_degree, part.means), (0, whole.select(&wanted).means));
    assert!(base["bytes_read"].as_u64().unwrap() < read);
    let (coarse, part) = decode(" --lod 1");
    assert!(part.len() < wanted.len() && coarse["bytes_read"].as_u64().unwrap() < read);
}

#[test]
fn a_box_without_gaussians_and_wrong_boxes() {
    let dir = Folder::new();
    let (stream, back) = (stream(&dir), dir.join("part.ply"));
    let words = "decode @ -o @ --force --box";
    let with = |region: &str| run(&format!("{words} {region}"), &[&stream, &back]);
    assert!(said(&with("900,900,900,901,901,901")).contains("0 Gaussians in the box"));
    wrong_usage(&with("1,2,3"), "six numbers");
    std::fs::write(&stream, &std::fs::read(&stream).unwrap()[..9]).unwrap();
    one_line(&with("-1,-1,-1,1,1,1"), "room.gsvx");
}
