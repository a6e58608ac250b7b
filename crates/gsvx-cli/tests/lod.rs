//! `gsvx lod`: the folders that PlayCanvas and CesiumJS stream.

mod common;

use common::{Folder, failed, json, ok, one_line, report, run, wrong_usage};
use gs_model::{Format, ReadOptions, Scene};
use serde_json::Value;
use std::num::NonZeroUsize;
use std::path::Path;

/// The room with an outlier far away, in many small chunks.
fn stream(path: &Path, lod: bool) {
    chunked(path, 300, lod);
}

fn chunked(path: &Path, leaves: usize, lod: bool) {
    let (mut scene, _) = gs_model::ply::read(common::model()).unwrap();
    let far = Scene { means: vec![[3e9, 0.0, 0.0]], ..scene.select(&[0]) };
    scene.append(&far);
    let mut options = gsvx::EncodeOptions::default();
    options.code.chunk_leaves = NonZeroUsize::new(leaves).unwrap();
    options.code.lod = lod;
    std::fs::write(path, gsvx::encode(&scene, None, 50.0, &options).unwrap().bytes).unwrap();
}

fn at_level(stream: &[u8], lod: u8) -> Scene {
    let mut options = gsvx::DecodeOptions::default();
    options.lod = lod;
    gsvx::decode_with(stream, &options).unwrap().scene
}

/// The places in a tree, whose nodes have two children or none, within their bounds.
fn places(node: &Value) -> Vec<&Value> {
    let Some(children) = node["children"].as_array() else { return vec![node] };
    let corner = |node: &Value, end: &str, k: usize| node["bound"][end][k].as_f64().unwrap();
    for child in children {
        for k in 0..3 {
            assert!(corner(node, "min", k) <= corner(child, "min", k));
            assert!(corner(node, "max", k) >= corner(child, "max", k));
        }
    }
    assert_eq!(children.len(), 2);
    children.iter().flat_map(places).collect()
}

/// The file and the range of its Gaussians that show a place at a level; none if nothing does.
fn shown<'a>(list: &'a Value, place: &'a Value, lod: u8) -> (&'a str, usize, usize) {
    let entry = &place["lods"][lod.to_string()];
    let number = |key: &str| entry[key].as_u64().unwrap() as usize;
    (list["filenames"][number("file")].as_str().unwrap(), number("offset"), number("count"))
}

#[test]
fn the_places_show_the_whole_scene_at_every_level() {
    let dir = Folder::new();
    let (input, web) = (dir.join("room.gsvx"), dir.join("web"));
    stream(&input, true);
    let said = json("lod @ -o @", &[&input, &web]);
    let read = |name: &str| std::fs::read(web.join(name)).unwrap();
    let list: Value = serde_json::from_slice(&read("lod-meta.json")).unwrap();
    let places = places(&list["tree"]);
    let levels = list["lodLevels"].as_u64().unwrap() as u8;
    assert!(levels >= 3 && places.len() > 30, "{levels} levels, {} places", places.len());
    assert_eq!(said["places"], places.len());

    let whole = std::fs::read(&input).unwrap();
    let exact = gsvx::decode(&read(list["environment"].as_str().unwrap())).unwrap();
    assert_eq!(exact.means, [[3e9, 0.0, 0.0]]);
    for lod in 0..levels {
        let mut scene = Scene::default();
        for place in &places {
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
fn streamed_sog_has_the_same_places_and_errors_that_grow() {
    let dir = Folder::new();
    let (input, web, own) = (dir.join("room.gsvx"), dir.join("sog"), dir.join("web"));
    stream(&input, true);
    let said = json("lod @ -o @ --format sog", &[&input, &web]);
    ok("lod @ -o @", &[&input, &own]);
    let read = |folder: &Path| -> Value {
        serde_json::from_slice(&std::fs::read(folder.join("lod-meta.json")).unwrap()).unwrap()
    };
    let (list, streams) = (read(&web), read(&own));
    // Only the names of files differ.
    assert_eq!(list["tree"], streams["tree"]);
    let levels = list["lodLevels"].as_u64().unwrap() as usize;
    let model =
        |name: &str| gs_model::model::read(web.join(name), &ReadOptions::default()).unwrap().0;
    let files: Vec<&str> =
        list["filenames"].as_array().unwrap().iter().map(|name| name.as_str().unwrap()).collect();
    let mut shown = vec![0; files.len()];
    let mut counts = vec![0; levels];
    for place in places(&list["tree"]) {
        let errors: Vec<f64> =
            place["errors"].as_array().unwrap().iter().map(|e| e.as_f64().unwrap()).collect();
        assert!(errors.len() == levels && errors[0] == 0.0 && errors[levels - 1] > 0.01);
        assert!(errors.is_sorted() && errors.iter().all(|e| e.is_finite()), "{errors:?}");
        for (lod, run) in place["lods"].as_object().unwrap() {
            let number = |key: &str| run[key].as_u64().unwrap() as usize;
            // A chunk is the runs that name it, one after the other.
            assert_eq!(number("offset"), shown[number("file")]);
            shown[number("file")] += number("count");
            counts[lod.parse::<usize>().unwrap()] += number("count");
        }
    }
    assert_eq!(list["counts"], serde_json::json!(counts));
    for (name, &count) in files.iter().zip(&shown) {
        let stream = own.join(name.replace("/meta.json", ".gsvx"));
        let coded = gsvx::decode(&std::fs::read(stream).unwrap()).unwrap();
        let (chunk, [low, high]) = (model(name), coded.bounds());
        assert_eq!(chunk.len(), count);
        let side = (0..3).map(|k| high[k] - low[k]).fold(0.0, f32::max);
        for (a, b) in chunk.means.iter().zip(&coded.means) {
            assert!((0..3).all(|k| (a[k] - b[k]).abs() < 0.01 * side), "{a:?} {b:?}");
        }
    }
    let exact = model(list["environment"].as_str().unwrap());
    assert!((exact.means[0][0] / 3e9 - 1.0).abs() < 1e-3);
    let bytes: u64 = bytes_in(&web) - std::fs::metadata(web.join("lod-meta.json")).unwrap().len();
    assert_eq!(said["bytes"], bytes);
}

/// Bytes of all files in a folder and its folders.
fn bytes_in(folder: &Path) -> u64 {
    let entries = std::fs::read_dir(folder).unwrap().map(Result::unwrap);
    let size = |entry: std::fs::DirEntry| match entry.metadata().unwrap() {
        data if data.is_dir() => bytes_in(&entry.path()),
        data => data.len(),
    };
    entries.map(size).sum()
}

#[test]
fn one_gaussian_without_view_dependence_is_a_streamed_sog() {
    let dir = Folder::new();
    let (input, web) = (dir.join("one.gsvx"), dir.join("web"));
    let (scene, _) = gs_model::ply::read(common::model()).unwrap();
    let mut one = Scene { origin: [5e5, 4e6, 100.0], ..scene.select(&[0]) };
    one.cut_sh(0);
    let stream = gsvx::encode(&one, None, 50.0, &gsvx::EncodeOptions::default()).unwrap();
    std::fs::write(&input, stream.bytes).unwrap();
    let (said, heard) = report("lod @ -o @ --format sog", &[&input, &web]);
    assert_eq!((said["places"].as_u64(), said["levels"].as_u64()), (Some(1), Some(1)));
    assert!(heard.contains("relative to the origin (500000, 4000000, 100)"), "{heard}");
    // The folder holds something now, and a file is no folder.
    one_line(&run("lod @ -o @ --format sog", &[&input, &web]), "--force");
    ok("lod @ -o @ --format sog --force", &[&input, &web]);
    one_line(&run("lod @ -o @ --format sog", &[&input, &input]), "is a file; name a folder");
}

/// The SPZ in a `.glb`, and what its accessors say of the number of Gaussians.
fn spz(glb: &[u8]) -> (Scene, u64) {
    let len = u32::from_le_bytes(glb[12..16].try_into().unwrap()) as usize;
    let json: Value = serde_json::from_slice(&glb[20..20 + len]).unwrap();
    let data = &glb[28 + len..];
    let length = json["bufferViews"][0]["byteLength"].as_u64().unwrap() as usize;
    let spz = Format::named("spz").unwrap();
    let (scene, report) = spz.read("tile", &data[..length], &ReadOptions::default()).unwrap();
    assert_eq!(report.form, "SPZ, version 3");
    (scene, json["accessors"][0]["count"].as_u64().unwrap())
}

/// The Gaussians of a tile and of all below it, which must be in its box and have no larger error.
fn tiles(node: &Value, web: &Path, finest: &mut usize) {
    let number = |v: &Value| v.as_f64().unwrap();
    let volume: Vec<f64> =
        node["boundingVolume"]["box"].as_array().unwrap().iter().map(number).collect();
    let half = [volume[3], volume[7], volume[11]];
    if let Some(uri) = node["content"]["uri"].as_str() {
        let (scene, count) = spz(&std::fs::read(web.join(uri)).unwrap());
        assert_eq!(scene.len() as u64, count);
        for [x, y, z] in scene.means.iter().map(|m| m.map(f64::from)) {
            for (k, v) in [x, z, -y].into_iter().enumerate() {
                assert!((v - volume[k]).abs() <= half[k], "{uri}: {x} {y} {z}, {volume:?}");
            }
        }
        if node.get("children").is_none() {
            assert_eq!(number(&node["geometricError"]), 0.0);
            *finest += scene.len();
        }
    }
    for child in node["children"].as_array().into_iter().flatten() {
        assert!(number(&child["geometricError"]) <= number(&node["geometricError"]));
        tiles(child, web, finest);
    }
}

#[test]
fn three_d_tiles_hold_the_scene_within_their_boxes() {
    let dir = Folder::new();
    let (input, web) = (dir.join("room.gsvx"), dir.join("tiles"));
    stream(&input, true);
    let words = "lod @ -o @ --format 3dtiles --at -70.5,12,100";
    let (said, heard) = report(words, &[&input, &web]);
    assert!(heard.contains("left out: 1 Gaussian farther"), "{heard}");
    let list: Value =
        serde_json::from_slice(&std::fs::read(web.join("tileset.json")).unwrap()).unwrap();
    assert_eq!(list["root"]["transform"].as_array().unwrap().len(), 16);
    let mut finest = 0;
    tiles(&list["root"], &web, &mut finest);
    let whole = at_level(&std::fs::read(&input).unwrap(), 0);
    assert_eq!(finest, whole.len() - 1);
    assert!(said["places"].as_u64().unwrap() > 30 && said["levels"].as_u64().unwrap() >= 3);
    wrong_usage(&run("lod @ -o @ --at 1,2,3", &[&input, &web]), "--format 3dtiles");
    wrong_usage(&run("lod @ -o @ --at 1,99,3", &[&input, &web]), "LON,LAT,HEIGHT");
}

#[test]
fn tiles_and_streams_stand_where_a_scene_far_from_the_origin_does() {
    let dir = Folder::new();
    let (input, tiles, web) = (dir.join("utm.gsvx"), dir.join("tiles"), dir.join("web"));
    let (mut scene, _) = gs_model::ply::read(common::model()).unwrap();
    scene.origin = [389_477.25, 5_435_291.5, 120.0];
    let stream = gsvx::encode(&scene, None, 50.0, &gsvx::EncodeOptions::default()).unwrap();
    std::fs::write(&input, stream.bytes).unwrap();
    let words = "lod @ -o @ --force --format 3dtiles --at 8,49,120";
    let root = |words: &str| -> (Value, String) {
        let (_, heard) = report(words, &[&input, &tiles]);
        let list = std::fs::read(tiles.join("tileset.json")).unwrap();
        let list: Value = serde_json::from_slice(&list).unwrap();
        (list["root"].clone(), heard)
    };
    let (here, heard) = root("lod @ -o @ --force --format 3dtiles");
    assert!(!heard.contains("origin"), "{heard}");
    assert_eq!(here["transform"].as_array().unwrap()[12..], [389_477.25, 120.0, -5_435_291.5, 1.0]);
    let content = tiles.join(here["children"][0]["content"]["uri"].as_str().unwrap());
    assert_eq!(json("info @", &[&content])["origin"], serde_json::json!([0.0, 0.0, 0.0]));
    let (there, heard) = root(words);
    assert_ne!(there["transform"], here["transform"]);
    assert!(heard.contains("place of the scene's origin, (389477.25, 5435291.5, 120)"), "{heard}");
    ok("lod @ -o @", &[&input, &web]);
    let list: Value =
        serde_json::from_slice(&std::fs::read(web.join("lod-meta.json")).unwrap()).unwrap();
    let file = web.join(list["filenames"][0].as_str().unwrap());
    assert_eq!(gsvx::decode(&std::fs::read(file).unwrap()).unwrap().origin, scene.origin);
}

#[test]
fn streams_without_an_octree_or_coarse_levels_say_so() {
    let dir = Folder::new();
    let (input, web) = (dir.join("room.gsvx"), dir.join("web"));
    stream(&input, false);
    assert!(ok("lod @ -o @", &[&input, &web]).contains("no coarse levels"));
    // The folder holds something now.
    one_line(&run("lod @ -o @", &[&input, &web]), "--force");
    let lossless = dir.join("lossless.gsvx");
    ok("encode @ -o @ --lossless", &[&common::model(), &lossless]);
    one_line(&run("lod @ -o @ --force", &[&lossless, &web]), "lossless");
    // A stream that was cut: the chunk that is missing is an error.
    let bytes = std::fs::read(&input).unwrap();
    std::fs::write(&input, &bytes[..bytes.len() - 100]).unwrap();
    one_line(&run("lod @ -o @ --force", &[&input, &web]), "chunk");
}

#[test]
fn a_folder_is_whole_or_not_there() {
    let dir = Folder::new();
    let (input, cut, web) = (dir.join("room.gsvx"), dir.join("cut.gsvx"), dir.join("web"));
    chunked(&input, 20, true);
    let bytes = std::fs::read(&input).unwrap();
    std::fs::write(&cut, &bytes[..bytes.len() - 1]).unwrap();
    for format in ["playcanvas", "sog", "3dtiles"] {
        let words = format!("lod @ -o @ --format {format}");
        failed(&run(&words, &[&cut, &web]), "truncated");
        assert!(!web.exists(), "{format}");
        #[cfg(unix)]
        {
            let out = common::interrupted(&words, &[&input, &web], || web.exists());
            let said = common::heard(&out);
            assert_eq!(out.status.code(), Some(130), "{format}: {said}");
            assert!(said.ends_with("interrupted; no output was touched"), "{said}");
            assert!(!web.exists(), "{format}");
        }
    }
    // What is replaced is replaced whole too.
    ok("lod @ -o @", &[&input, &web]);
    let before = common::names(&web);
    failed(&run("lod @ -o @ --force", &[&cut, &web]), "truncated");
    assert_eq!(common::names(&web), before);
}

#[test]
fn several_exact_chunks_are_all_shown() {
    let dir = Folder::new();
    let (input, web) = (dir.join("room.gsvx"), dir.join("web"));
    stream(&input, false);
    let bytes = std::fs::read(&input).unwrap();
    let index = gsvx::Index::parse(&bytes).unwrap();
    let exact = index.chunks.len() - 1;
    // A stream of another encoder: the exact chunk twice.
    let chunks: Vec<usize> = (0..=exact).chain([exact]).collect();
    let mut twice = index.head_of(&chunks);
    for &chunk in &chunks {
        let range = index.chunks[chunk].range(4);
        twice.extend(&bytes[range.start as usize..range.end as usize]);
    }
    std::fs::write(&input, &twice).unwrap();
    ok("lod @ -o @", &[&input, &web]);
    let exact = gsvx::decode(&std::fs::read(web.join("exact.gsvx")).unwrap()).unwrap();
    assert_eq!(exact.means, [[3e9, 0.0, 0.0]; 2]);
    let tiles = dir.join("tiles");
    let (_, heard) = report("lod @ -o @ --format 3dtiles", &[&input, &tiles]);
    assert!(heard.contains("left out: 2 Gaussians farther"), "{heard}");
}
