//! glTF as other tools write it: nodes, files beside it, SPZ.

mod common;

use base64::Engine;
use base64::prelude::BASE64_STANDARD;
use common::{assert_within, read, says};
use gs_model::spz::ShBits;
use gs_model::{Format, ReadOptions, Scene, gltf, model};

/// A scene that all formats hold well.
fn scene(n: usize) -> Scene {
    let mut scene = common::scene(n, 3);
    scene.means.iter_mut().flatten().for_each(|v| *v = v.clamp(-9.0, 9.0));
    scene.rotations.iter_mut().flatten().for_each(|v| *v = v.clamp(-2.0, 2.0));
    scene.log_scales.iter_mut().flatten().for_each(|v| *v = v.clamp(-6.0, 2.0));
    scene.opacity_logits.iter_mut().for_each(|v| *v = v.clamp(-4.0, 4.0));
    scene.sh.iter_mut().flatten().for_each(|v| *v = v.clamp(-0.9, 0.9));
    scene
}

/// The JSON and the data of a scene's `.glb`.
fn parts(scene: &Scene) -> (serde_json::Value, Vec<u8>) {
    let mut glb = Vec::new();
    Format::named("glb").unwrap().write_to("a.glb", &mut glb, scene).unwrap();
    let len = u32::from_le_bytes(glb[12..16].try_into().unwrap()) as usize;
    (serde_json::from_slice(&glb[20..20 + len]).unwrap(), glb[28 + len..].to_vec())
}

/// A `.gltf` whose data are in a URI, with these nodes.
fn gltf_of(scene: &Scene, nodes: serde_json::Value, roots: serde_json::Value) -> Vec<u8> {
    let (mut json, data) = parts(scene);
    let text = BASE64_STANDARD.encode(&data);
    json["buffers"][0]["uri"] = format!("data:application/octet-stream;base64,{text}").into();
    json["nodes"] = nodes;
    json["scenes"] = serde_json::json!([{ "nodes": roots }]);
    json.to_string().into_bytes()
}

const CLOSE: [f32; 6] = [2e-6, 2e-6, 2e-5, 1e-6, 2e-6, 2e-6];

#[test]
fn data_in_a_uri_and_in_a_file_beside_it_are_read() {
    let dir = tempfile::tempdir().unwrap();
    let (mut json, data) = parts(&scene(20));
    let embedded = gltf_of(&scene(20), serde_json::json!([{ "mesh": 0 }]), serde_json::json!([0]));
    let (embedded, report) = read("a.gltf", &embedded).unwrap();
    assert_within("embedded", &scene(20), &embedded, CLOSE);
    assert!(report.notes.is_empty(), "{report:?}");
    std::fs::create_dir(dir.path().join("data")).unwrap();
    std::fs::write(dir.path().join("data/the model.bin"), &data).unwrap();
    let path = dir.path().join("model.gltf");
    json["buffers"][0]["uri"] = "data/the%20model.bin".into();
    std::fs::write(&path, json.to_string()).unwrap();
    let (beside, report) = model::read(&path, &ReadOptions::default()).unwrap();
    assert_eq!((beside, report.bytes_beside), (embedded, data.len() as u64));
    for uri in ["../model.bin", "/etc/passwd", "http://a/b.bin", "data/..%2f..%2fa", "c:\\a", ""] {
        json["buffers"][0]["uri"] = uri.into();
        says(read("a.gltf", json.to_string().as_bytes()), "do not lie beside the model");
    }
    json["buffers"][0]["uri"] = "gone.bin".into();
    says(read("a.gltf", json.to_string().as_bytes()), "gone.bin");
    json["buffers"][0]["uri"] = "data:;base64,!".into();
    says(read("a.gltf", json.to_string().as_bytes()), "broken base64");
}

#[test]
fn gaussians_lie_where_the_nodes_put_them() {
    // A quarter of a turn about y: x goes to -z. Twice as large, and shifted; in the axes of glTF.
    let half = std::f64::consts::FRAC_1_SQRT_2;
    let turned = serde_json::json!([
        { "children": [1], "translation": [1, 2, 3] },
        { "mesh": 0, "rotation": [0, half, 0, half], "scale": [2, 2, 2] },
    ]);
    let (placed, _) = read("a.gltf", &gltf_of(&scene(20), turned, serde_json::json!([0]))).unwrap();
    for (before, after) in scene(20).means.iter().zip(&placed.means) {
        // glTF has x and y of the other sign.
        let [x, y, z] = [-before[0], -before[1], before[2]];
        let [x, y, z] = [2.0 * z + 1.0, 2.0 * y + 2.0, -2.0 * x + 3.0];
        for (a, b) in after.iter().zip([-x, -y, z]) {
            assert!((a - b).abs() < 1e-5, "{before:?} {after:?}");
        }
    }
    for (before, after) in scene(20).log_scales.iter().zip(&placed.log_scales) {
        assert!((after[1] - before[1] - std::f32::consts::LN_2).abs() < 1e-5);
    }
    // The matrix of the same, column by column.
    let matrix = serde_json::json!([
        { "mesh": 0, "matrix": [0, 0, -2, 0, 0, 2, 0, 0, 2, 0, 0, 0, 1, 2, 3, 1] }]);
    let (same, _) = read("a.gltf", &gltf_of(&scene(20), matrix, serde_json::json!([0]))).unwrap();
    assert_within("matrix", &placed, &same, [1e-5, 1e-5, 1e-5, 0.0, 1e-5, 1e-5]);
    // Two nodes show the same mesh; a third is not in the scene.
    let twice = serde_json::json!([
        { "mesh": 0 }, { "mesh": 0, "translation": [-5, 0, 0] }, { "mesh": 0 }]);
    let (twice, _) =
        read("a.gltf", &gltf_of(&scene(20), twice, serde_json::json!([0, 1]))).unwrap();
    assert_eq!(twice.len(), 40);
    for (a, b) in twice.means[..20].iter().zip(&twice.means[20..]) {
        assert!((b[0] - a[0] - 5.0).abs() < 1e-5 && b[1..] == a[1..]);
    }
    // Far away the means keep their precision.
    let far = serde_json::json!([{ "mesh": 0, "translation": [500000, 0, 0] }]);
    let (far, _) = read("a.gltf", &gltf_of(&scene(20), far, serde_json::json!([0]))).unwrap();
    assert_eq!((far.origin, far.means), ([-5e5, 0.0, 0.0], scene(20).means));
}

#[test]
fn the_origin_of_a_model_is_the_place_of_a_node() {
    let origin = [450_000.25, 5_411_000.0, 120.0];
    let model = Scene { origin, ..scene(20) };
    let (json, _) = parts(&model);
    let place = serde_json::json!([-450_000.25, -5_411_000.0, 120.0]);
    assert_eq!(json["nodes"][0]["translation"], place);
    let mut glb = Vec::new();
    Format::named("glb").unwrap().write_to("a.glb", &mut glb, &model).unwrap();
    let (back, _) = read("a.glb", &glb).unwrap();
    assert_eq!((back.origin, back.means), (origin, model.means.clone()));
    let mut with_spz = Vec::new();
    gltf::write_spz("a.glb", &mut with_spz, &model, ShBits::default()).unwrap();
    let (back, _) = read("a.glb", &with_spz).unwrap();
    assert_eq!(back.origin, origin);
    assert_within("spz", &model, &back, [2e-4, 3e-3, 0.04, 0.02, 0.012, 5e-3]);
}

#[test]
fn meshes_of_which_some_are_antialiased_are_said_to_be_read_alike() {
    let half = |antialiased: bool| {
        let mut glb = Vec::new();
        let scene = Scene { antialiased, ..scene(5) };
        gltf::write_spz("a.glb", &mut glb, &scene, ShBits::default()).unwrap();
        let len = u32::from_le_bytes(glb[12..16].try_into().unwrap()) as usize;
        let json: serde_json::Value = serde_json::from_slice(&glb[20..20 + len]).unwrap();
        let uri = format!("data:;base64,{}", BASE64_STANDARD.encode(&glb[28 + len..]));
        (json, serde_json::json!({ "byteLength": glb.len() - 28 - len, "uri": uri }))
    };
    let ((mut root, first), (mut other, second)) = (half(true), half(false));
    // One file with both: the second's accessors and view come after the first's.
    let accessors = other["accessors"].as_array().unwrap().clone();
    let shift = root["accessors"].as_array().unwrap().len();
    root["accessors"].as_array_mut().unwrap().extend(accessors);
    let mut view = other["bufferViews"][0].take();
    view["buffer"] = 1.into();
    root["bufferViews"].as_array_mut().unwrap().push(view);
    let mut mesh = other["meshes"][0].take();
    let primitive = &mut mesh["primitives"][0];
    for at in primitive["attributes"].as_object_mut().unwrap().values_mut() {
        *at = (at.as_u64().unwrap() + shift as u64).into();
    }
    let splats = &mut primitive["extensions"]["KHR_gaussian_splatting"]["extensions"];
    splats["KHR_gaussian_splatting_compression_spz_2"]["bufferView"] = 1.into();
    root["meshes"].as_array_mut().unwrap().push(mesh);
    root["nodes"] = serde_json::json!([{ "mesh": 0 }, { "mesh": 1 }]);
    root["scenes"] = serde_json::json!([{ "nodes": [0, 1] }]);
    root["buffers"] = serde_json::json!([first, second]);
    let (both, report) = read("a.gltf", root.to_string().as_bytes()).unwrap();
    assert!(both.antialiased && both.len() == 10);
    let said = "some meshes are antialiased and some are not; all are read as antialiased, as the first is";
    assert!(report.notes.iter().any(|note| note == said), "{:?}", report.notes);
}

#[test]
fn a_gltf_with_spz_is_the_model_that_was_written() {
    let mut glb = Vec::new();
    gltf::write_spz("a.glb", &mut glb, &scene(50), ShBits::default()).unwrap();
    let (back, report) = read("a.glb", &glb).unwrap();
    assert_within("spz", &scene(50), &back, [2e-4, 3e-3, 0.04, 0.02, 0.012, 5e-3]);
    assert_eq!(
        report.form,
        "glTF, KHR_gaussian_splatting, KHR_gaussian_splatting_compression_spz_2"
    );
    let cut = glb.len() - 40;
    glb[cut..].fill(0);
    says(read("a.glb", &glb), "mesh 0, primitive 0: ");
}

#[test]
fn what_of_a_gltf_is_not_read_is_said() {
    let (mut json, _) = parts(&scene(2));
    let attributes = &mut json["meshes"][0]["primitives"][0]["attributes"];
    attributes["_LABEL"] = attributes["POSITION"].clone();
    json["meshes"][0]["primitives"][0]["extensions"]["KHR_gaussian_splatting"]["sortingMethod"] =
        "zDepth".into();
    json["meshes"]
        .as_array_mut()
        .unwrap()
        .push(serde_json::json!({ "primitives": [{ "attributes": {} }] }));
    json["animations"] = serde_json::json!([{}]);
    let data = BASE64_STANDARD.encode(parts(&scene(2)).1);
    json["buffers"][0]["uri"] = format!("data:;base64,{data}").into();
    let (_, report) = read("a.gltf", json.to_string().as_bytes()).unwrap();
    let said = report.notes.join("; ");
    for part in
        ["not kept: _LABEL", "sortingMethod \"zDepth\"", "not read: 1", "animations are not"]
    {
        assert!(said.contains(part), "{part}: {said}");
    }
}
