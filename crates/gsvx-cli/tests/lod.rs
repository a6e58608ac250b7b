//! `gsvx lod`: the folder that PlayCanvas streams.

mod common;

use common::{json, ok, one_line, run};
use gs_model::Scene;
use serde_json::Value;
use std::num::NonZeroUsize;
use std::path::Path;

/// The room with an outlier far away, in many small chunks.
fn stream(path: &Path, lod: bool) {
    let (mut scene, _) = gs_model::ply::read(common::model()).unwrap();
    let far = Scene { means: vec![[3e9, 0.0, 0.0]], ..scene.select(&[0]) };
    scene.append(&far);
    let mut options = gsvx::EncodeOptions::from_quality(50.0).unwrap();
    options.chunk_leaves = NonZeroUsize::new(300).unwrap();
    options.lod = lod;
    std::fs::write(path, gsvx::encode(&scene, &options).unwrap().bytes).unwrap();
}

fn at_level(stream: &[u8], lod: u8) -> Scene {
    let mut options = gsvx::DecodeOptions::default();
    options.lod = lod;
    gsvx::decode_with(stream, &options).unwrap().scene
}

/// The file and the range of its Gaussians that show a place at a level; none if nothing does.
fn shown<'a>(list: &'a Value, place: &'a Value, lod: u8) -> (&'a str, usize, usize) {
    let entry = &place["lods"][lod.to_string()];
    let number = |key: &str| entry[key].as_u64().unwrap() as usize;
    (list["filenames"][number("file")].as_str().unwrap(), number("offset"), number("count"))
}

#[test]
fn the_places_show_the_whole_scene_at_every_level() {
    let dir = tempfile::tempdir().unwrap();
    let (input, web) = (dir.path().join("room.gsvx"), dir.path().join("web"));
    stream(&input, true);
    let said = json(&["lod", "@", "-o", "@"], &[&input, &web]);
    let read = |name: &str| std::fs::read(web.join(name)).unwrap();
    let list: Value = serde_json::from_slice(&read("lod-meta.json")).unwrap();
    let places = list["tree"]["children"].as_array().unwrap();
    let levels = list["lodLevels"].as_u64().unwrap() as u8;
    assert!(levels >= 3 && places.len() > 30, "{levels} levels, {} places", places.len());
    assert_eq!(said["places"], places.len());

    let whole = std::fs::read(&input).unwrap();
    let exact = gsvx::decode(&read(list["environment"].as_str().unwrap())).unwrap();
    assert_eq!(exact.means, [[3e9, 0.0, 0.0]]);
    for lod in 0..levels {
        let mut scene = Scene::default();
        for place in places {
            let (file, offset, count) = shown(&list, place, lod);
            let part = gsvx::decode(&read(file)).unwrap();
            let indices: Vec<usize> = (offset..offset + count).collect();
            let part = part.select(&indices);
            scene.sh_degree = scene.sh_degree.max(part.sh_degree);
            scene.append(&part);
        }
        let wanted = at_level(&whole, lod);
        let leaves = wanted.len() - exact.len();
        assert_eq!(scene.means, wanted.means[..leaves], "level {lod}");
        assert_eq!(scene.log_scales, wanted.log_scales[..leaves], "level {lod}");
        if lod == 0 {
            assert_eq!(scene.sh, wanted.sh[..leaves * wanted.sh_len()]);
        }
    }
}

#[test]
fn streams_without_an_octree_or_coarse_levels_say_so() {
    let dir = tempfile::tempdir().unwrap();
    let (input, web) = (dir.path().join("room.gsvx"), dir.path().join("web"));
    stream(&input, false);
    assert!(ok(&["lod", "@", "-o", "@"], &[&input, &web]).contains("no coarse levels"));
    // The folder holds something now.
    one_line(&run(&["lod", "@", "-o", "@"], &[&input, &web]), "--force");
    let lossless = dir.path().join("lossless.gsvx");
    ok(&["encode", "@", "-o", "@", "--lossless"], &[&common::model(), &lossless]);
    one_line(&run(&["lod", "@", "-o", "@", "--force"], &[&lossless, &web]), "lossless");
    // A stream that was cut: the chunk that is missing is an error.
    let bytes = std::fs::read(&input).unwrap();
    std::fs::write(&input, &bytes[..bytes.len() - 100]).unwrap();
    one_line(&run(&["lod", "@", "-o", "@", "--force"], &[&input, &web]), "chunk");
}
