//! glTF as other tools write it: nodes, files beside it, SPZ.

mod common;

use common::{assert_within, glb_parts, gltf_of, put, read, says, written};
use gs_model::spz::ShBits;
use gs_model::{ReadOptions, Report, Result, Scene, gltf, model};
use serde_json::{Value, json};

/// A scene that all formats hold well.
fn scene(n: usize) -> Scene {
    common::mild(n, 3)
}

/// A scene's `.glb` as `.gltf`.
fn json_of(scene: &Scene) -> Value {
    gltf_of(&written("glb", scene))
}

fn read_json(json: &Value) -> Result<(Scene, Report)> {
    read("a.gltf", json.to_string().as_bytes())
}

/// The scene as these nodes place it, which are in the scene if `roots` names them.
fn placed_by(nodes: Value, roots: &[usize]) -> Scene {
    let mut json = json_of(&scene(20));
    json["nodes"] = nodes;
    json["scenes"] = json!([{ "nodes": roots }]);
    read_json(&json).unwrap().0
}

fn with_spz(scene: &Scene) -> Vec<u8> {
    let mut glb = Vec::new();
    gltf::write_spz("a.glb", &mut glb, scene, ShBits::default()).unwrap();
    glb
}

/// As near as SPZ holds a scene.
const OF_SPZ: [f32; 6] = [2e-4, 3e-3, 0.04, 0.02, 0.012, 5e-3];
const CLOSE: [f32; 6] = [2e-6, 2e-6, 2e-5, 1e-6, 2e-6, 2e-6];

#[test]
fn data_in_a_uri_and_in_a_file_beside_it_are_read() {
    let dir = tempfile::tempdir().unwrap();
    let (mut json, data) = glb_parts(&written("glb", &scene(20)));
    let (embedded, report) = read_json(&json_of(&scene(20))).unwrap();
    assert_within("embedded", &scene(20), &embedded, CLOSE);
    assert!(report.notes.is_empty(), "{report:?}");
    put(&dir, "data/the model.bin", &data);
    json["buffers"][0]["uri"] = "data/the%20model.bin".into();
    put(&dir, "model.gltf", json.to_string());
    let (beside, report) =
        model::read(dir.path().join("model.gltf"), &ReadOptions::default()).unwrap();
    assert_eq!((beside, report.bytes_beside), (embedded, data.len() as u64));
    for uri in ["../model.bin", "/etc/passwd", "http://a/b.bin", "data/..%2f..%2fa", "c:\\a", ""] {
        json["buffers"][0]["uri"] = uri.into();
        says(read_json(&json), "do not lie beside the model");
    }
    json["buffers"][0]["uri"] = "gone.bin".into();
    says(read_json(&json), "gone.bin");
    json["buffers"][0]["uri"] = "data:;base64,!".into();
    says(read_json(&json), "broken base64");
}

#[test]
fn gaussians_lie_where_the_nodes_put_them() {
    // A quarter of a turn about y: x goes to -z. Twice as large, and shifted; in the axes of glTF.
    let half = std::f64::consts::FRAC_1_SQRT_2;
    let turned = json!([
        { "children": [1], "translation": [1, 2, 3] },
        { "mesh": 0, "rotation": [0, half, 0, half], "scale": [2, 2, 2] },
    ]);
    let placed = placed_by(turned, &[0]);
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
    let matrix = json!([
        { "mesh": 0, "matrix": [0, 0, -2, 0, 0, 2, 0, 0, 2, 0, 0, 0, 1, 2, 3, 1] }]);
    let same = placed_by(matrix, &[0]);
    assert_within("matrix", &placed, &same, [1e-5, 1e-5, 1e-5, 0.0, 1e-5, 1e-5]);
    // Two nodes show the same mesh; a third is not in the scene.
    let twice = json!([
        { "mesh": 0 }, { "mesh": 0, "translation": [-5, 0, 0] }, { "mesh": 0 }]);
    let twice = placed_by(twice, &[0, 1]);
    assert_eq!(twice.len(), 40);
    for (a, b) in twice.means[..20].iter().zip(&twice.means[20..]) {
        assert!((b[0] - a[0] - 5.0).abs() < 1e-5 && b[1..] == a[1..]);
    }
    // Far away the means keep their precision.
    let far = json!([{ "mesh": 0, "translation": [500000, 0, 0] }]);
    let far = placed_by(far, &[0]);
    assert_eq!((far.origin, far.means), ([-5e5, 0.0, 0.0], scene(20).means));
}

#[test]
fn the_origin_of_a_model_is_the_place_of_a_node() {
    let origin = [450_000.25, 5_411_000.0, 120.0];
    let model = Scene { origin, ..scene(20) };
    let place = json!([-450_000.25, -5_411_000.0, 120.0]);
    assert_eq!(json_of(&model)["nodes"][0]["translation"], place);
    let (back, _) = read("a.glb", &written("glb", &model)).unwrap();
    assert_eq!((back.origin, back.means), (origin, model.means.clone()));
    let (back, _) = read("a.glb", &with_spz(&model)).unwrap();
    assert_eq!(back.origin, origin);
    assert_within("spz", &model, &back, OF_SPZ);
}

#[test]
fn meshes_of_which_some_are_antialiased_are_said_to_be_read_alike() {
    let half = |antialiased: bool| {
        let json = gltf_of(&with_spz(&Scene { antialiased, ..scene(5) }));
        (json.clone(), json["buffers"][0].clone())
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
    root["nodes"] = json!([{ "mesh": 0 }, { "mesh": 1 }]);
    root["scenes"] = json!([{ "nodes": [0, 1] }]);
    root["buffers"] = json!([first, second]);
    let (both, report) = read("a.gltf", root.to_string().as_bytes()).unwrap();
    assert!(both.antialiased && both.len() == 10);
    let said = "some meshes are antialiased and some are not; all are read as antialiased, as the first is";
    assert!(report.notes.iter().any(|note| note == said), "{:?}", report.notes);
}

#[test]
fn a_gltf_with_spz_is_the_model_that_was_written() {
    let mut glb = with_spz(&scene(50));
    let (back, report) = read("a.glb", &glb).unwrap();
    assert_within("spz", &scene(50), &back, OF_SPZ);
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
    let mut json = json_of(&scene(2));
    let attributes = &mut json["meshes"][0]["primitives"][0]["attributes"];
    attributes["_LABEL"] = attributes["POSITION"].clone();
    json["meshes"][0]["primitives"][0]["extensions"]["KHR_gaussian_splatting"]["sortingMethod"] =
        "zDepth".into();
    json["meshes"].as_array_mut().unwrap().push(json!({ "primitives": [{ "attributes": {} }] }));
    json["animations"] = json!([{}]);
    let (_, report) = read_json(&json).unwrap();
    let said = report.notes.join("; ");
    for part in
        ["not kept: _LABEL", "sortingMethod \"zDepth\"", "not read: 1", "animations are not"]
    {
        assert!(said.contains(part), "{part}: {said}");
    }
}
