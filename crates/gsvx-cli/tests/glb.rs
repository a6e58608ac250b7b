//! `gsvx convert --compress`: a stream inside a `.glb`.

mod common;

use common::{Folder, heard, json, ok, one_line, run, scene, wrong_usage};
use gs_model::{ReadOptions, Scene, model};
use serde_json::Value;
use std::path::Path;

const EXTENSION: &str = "GSVX_gaussian_splatting_compression";

/// The JSON of a `.glb`, and its data.
fn parts(glb: &[u8]) -> (Value, &[u8]) {
    let len = u32::from_le_bytes(glb[12..16].try_into().unwrap()) as usize;
    (serde_json::from_slice(&glb[20..20 + len]).unwrap(), &glb[20 + len + 8..])
}

/// A `.glb` of this JSON and data.
fn joined(json: &Value, data: &[u8]) -> Vec<u8> {
    let mut json = json.to_string().into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let word = |n: usize| (n as u32).to_le_bytes();
    let total = 28 + json.len() + data.len();
    let mut out = [b"glTF\x02\0\0\0", &word(total)[..], &word(json.len()), b"JSON"].concat();
    out.extend(json);
    out.extend(word(data.len()));
    out.extend(b"BIN\0");
    out.extend(data);
    out
}

fn read(path: &Path) -> Scene {
    model::read(path, &ReadOptions::default()).unwrap().0
}

/// A stream of [`small`], and the same in a `.glb`.
fn stream_and_glb(dir: &Folder) -> [std::path::PathBuf; 2] {
    let [stream, glb] = ["a.gsvx", "a.glb"].map(|name| dir.join(name));
    ok("encode @ -o @ --web", &[&dir.small(), &stream]);
    ok("convert @ @ --compress", &[&stream, &glb]);
    [stream, glb]
}

#[test]
fn a_stream_goes_in_as_it_is_and_comes_back_as_its_decode() {
    let dir = Folder::new();
    let [stream, glb] = stream_and_glb(&dir);
    let (bytes, file) = (std::fs::read(&stream).unwrap(), std::fs::read(&glb).unwrap());
    let (said, data) = parts(&file);
    assert_eq!(&data[..bytes.len()], &bytes[..]);
    assert_eq!(said["extensionsRequired"], said["extensionsUsed"]);
    let primitive = &said["meshes"][0]["primitives"][0];
    let splats = &primitive["extensions"]["KHR_gaussian_splatting"];
    assert_eq!(splats["extensions"][EXTENSION], serde_json::json!({ "bufferView": 0 }));

    ok("convert @ @", &[&glb, &dir.join("a.ply")]);
    ok("decode @ -o @", &[&stream, &dir.join("b.ply")]);
    let decoded = read(&dir.join("b.ply"));
    assert_eq!(read(&dir.join("a.ply")), decoded);

    // glTF's axes: x and y of the means change sign.
    let position =
        &said["accessors"][primitive["attributes"]["POSITION"].as_u64().unwrap() as usize];
    let [low, high] = decoded.bounds();
    assert_eq!(position["min"], serde_json::json!([-high[0], -high[1], low[2]]));
    assert_eq!(position["max"], serde_json::json!([-low[0], -low[1], high[2]]));
    assert_eq!(position["count"], decoded.len());
}

#[test]
fn a_model_is_encoded_at_the_quality_asked_for() {
    let dir = Folder::new();
    let input = dir.small();
    for (name, flags) in [("80", ""), ("40", " --quality 40")] {
        let (glb, stream) = (dir.join(format!("{name}.glb")), dir.join(format!("{name}.gsvx")));
        ok(&format!("convert @ @ --compress{flags}"), &[&input, &glb]);
        ok(&format!("encode @ -o @{flags}"), &[&input, &stream]);
        let bytes = std::fs::read(&stream).unwrap();
        assert_eq!(parts(&std::fs::read(&glb).unwrap()).1[..bytes.len()], bytes);
    }
    let compress =
        |more: &str, paths: &[&Path]| run(&format!("convert @ @ --compress{more}"), paths);
    wrong_usage(&compress("", &[&input, &dir.join("a.spz")]), "only a .glb holds a stream");
    let out = compress(" -q 3", &[&dir.join("80.gsvx"), &dir.join("b.glb")]);
    wrong_usage(&out, "is a stream, which goes in as it is");
    // A model with the axes of another tool.
    ok("convert @ @", &[&input, &dir.join("a.spz")]);
    let out = compress(" --axes keep", &[&dir.join("a.spz"), &dir.join("kept.glb")]);
    assert!(out.status.success(), "{}", heard(&out));
    ok("convert @ @", &[&dir.join("kept.glb"), &dir.join("kept.ply")]);
    let middle = |scene: &Scene| scene.means.iter().map(|m| f64::from(m[1])).sum::<f64>();
    let (kept, upright) = (middle(&read(&dir.join("kept.ply"))), middle(&scene()));
    assert!((kept + upright).abs() < 0.1 * upright.abs(), "{kept} {upright}");
}

#[test]
fn every_command_that_takes_a_model_takes_it() {
    let dir = Folder::new();
    let [stream, glb] = stream_and_glb(&dir);
    let said = json("info @", &[&glb]);
    assert_eq!(said["format"], format!("glTF, KHR_gaussian_splatting, {EXTENSION}"));
    assert_eq!(said["gaussians"], json("info @", &[&stream])["gaussians"]);
    let words = "compare @ @ --orbit 1 --size 64x48";
    assert_eq!(json(words, &[&glb, &stream])["psnr"], Value::Null);
    ok("render @ --orbit 1 --size 64x48 -o @", &[&glb, &dir.join("a.png")]);
    ok("encode @ -o @", &[&glb, &dir.join("b.gsvx")]);
    ok("encode @ @ -o @", &[&glb, &dir.small(), &dir.join("c.gsvx")]);
    one_line(&run("info @ --max-gaussians 5", &[&glb]), "--max-gaussians");
}

#[test]
fn a_glb_whose_stream_is_damaged_says_so() {
    let dir = Folder::new();
    let [_, glb] = stream_and_glb(&dir);
    let file = std::fs::read(&glb).unwrap();
    let (good, data) = parts(&file);
    let path = dir.join("bad.glb");
    let says = |json: &Value, data: &[u8], needle: &str| {
        std::fs::write(&path, joined(json, data)).unwrap();
        one_line(&run("info @", &[&path]), needle);
    };
    let changed = |pointer: &str, value: Value| {
        let mut json = good.clone();
        *json.pointer_mut(pointer).unwrap() = value;
        json
    };
    let extension =
        format!("/meshes/0/primitives/0/extensions/KHR_gaussian_splatting/extensions/{EXTENSION}");
    let view = format!("{extension}/bufferView");
    says(&changed(&view, 7.into()), data, "names a bufferView that is not there");
    says(&changed(&view, "x".into()), data, "has no bufferView");
    says(&changed(&extension, 3.into()), data, "has no bufferView");
    let length = "/bufferViews/0/byteLength";
    says(&changed(length, 1_000_000_000.into()), data, "more than the file holds");
    says(&changed(length, 2000.into()), data, "primitive 0: stream truncated");
    says(&changed(length, 5.into()), data, "primitive 0: stream truncated in head");
    says(&changed("/bufferViews/0/byteOffset", 4.into()), data, "more than the file holds");
    let elsewhere = serde_json::json!({ "uri": "a.bin", "byteLength": 9 });
    says(&changed("/buffers/0", elsewhere), data, "a.bin");
    says(&changed("/accessors/1/count", 3.into()), data, "different lengths");
    let mut fewer = good.clone();
    for accessor in fewer["accessors"].as_array_mut().unwrap() {
        accessor["count"] = 9.into();
    }
    says(&fewer, data, "its accessors promise 9 Gaussians, its stream holds");
    // The same stream a hundred times over.
    let one = good["meshes"][0]["primitives"][0].clone();
    let many = changed("/meshes/0/primitives", vec![one; 100].into());
    says(&many, data, "more Gaussians than the file has data for");
    let mut bad = data.to_vec();
    let middle = bad.len() / 2;
    bad[middle] ^= 1;
    says(&good, &bad, "CRC-32C");
}

#[test]
fn a_reader_without_the_decoder_says_what_is_missing() {
    let dir = Folder::new();
    let [_, glb] = stream_and_glb(&dir);
    let error = model::read(&glb, &ReadOptions::default()).unwrap_err().to_string();
    assert!(
        error.contains(&format!("it is compressed ({EXTENSION}), and there is no decoder")),
        "{error}"
    );
    let options = ReadOptions { codec: Some(&gsvx::gltf::CODEC), ..ReadOptions::default() };
    assert!(model::read(&glb, &options).is_ok());
}
