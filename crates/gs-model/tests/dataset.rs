//! Folders of every kind: finding cameras, photos and the model.

mod common;

use std::fs;
use std::path::Path;

use common::{put, put_colmap, says, scene, share_in_view, shared, written};
use gs_model::dataset::{Dataset, open_views};
use gs_model::{Camera, Error, Result, View, ply};
use serde_json::json;
use tempfile::TempDir;

/// The start of a PNG file of this size.
fn png(width: u32, height: u32) -> Vec<u8> {
    let start: &[u8] = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR";
    [start, &width.to_be_bytes(), &height.to_be_bytes(), b"\x08\x02\0\0\0"].concat()
}

fn put_model(dir: &TempDir, name: &str) {
    put(dir, name, written("ply", &scene(1, 0)));
}

/// A camera in general position.
fn camera(name: &str) -> Camera {
    let rotation = glam::DMat3::from_quat(glam::DQuat::from_xyzw(0.1, -0.5, 0.3, 0.8).normalize());
    let translation = glam::DVec3::new(0.3, -2.0, 5.0);
    Camera {
        name: name.into(),
        width: 640,
        height: 480,
        fx: 500.5,
        fy: 498.0,
        cx: 320.0,
        cy: 240.0,
        rotation,
        translation,
        lens: None,
        near: gs_model::NEAR,
    }
}

fn assert_same(a: &Camera, b: &Camera) {
    let close = |x: f64, y: f64| (x - y).abs() < 1e-9;
    assert_eq!((&a.name, a.width, a.height), (&b.name, b.width, b.height));
    assert!(
        close(a.fx, b.fx) && close(a.fy, b.fy) && close(a.cx, b.cx) && close(a.cy, b.cy),
        "{a:?} {b:?}"
    );
    assert!(a.rotation.abs_diff_eq(b.rotation, 1e-12), "{a:?} {b:?}");
    assert!(a.translation.abs_diff_eq(b.translation, 1e-12), "{a:?} {b:?}");
}

/// An entry of `cameras.json`, from the definition: centre and camera-to-world rows.
fn inria_entry(c: &Camera) -> serde_json::Value {
    let rows = c.rotation.to_cols_array_2d();
    json!({"id": 0, "img_name": c.name, "width": c.width, "height": c.height,
        "position": c.position().to_array(), "rotation": rows, "fx": c.fx, "fy": c.fy})
}

/// A `transform_matrix`, from the definition: camera-to-world, columns right, up, back, centre.
fn nerf_matrix(c: &Camera) -> serde_json::Value {
    let to_world = c.rotation.transpose();
    let (right, up, back) = (to_world.x_axis, -to_world.y_axis, -to_world.z_axis);
    let centre = c.position();
    let row = |i: usize| json!([right[i], up[i], back[i], centre[i]]);
    json!([row(0), row(1), row(2), [0, 0, 0, 1]])
}

#[test]
fn views_are_sorted_and_every_eighth_is_held_out() {
    let dir = tempfile::tempdir().unwrap();
    let names: Vec<String> = (0..17).map(|i| format!("{:02}.png", 16 - i)).collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    put_colmap(&dir, "sparse/0", &names);
    put_model(&dir, "point_cloud.ply");
    put(&dir, "images/03.png", "photo");
    let dataset = Dataset::open(dir.path()).unwrap();
    let held_out: Vec<&str> = dataset.held_out().map(|v| v.camera.name.as_str()).collect();
    assert_eq!(held_out, ["00.png", "08.png", "16.png"]);
    let training: Vec<&str> = dataset.training().map(|v| v.camera.name.as_str()).collect();
    assert_eq!(training.len(), 14);
    assert_eq!(
        training[..8],
        ["01.png", "02.png", "03.png", "04.png", "05.png", "06.png", "07.png", "09.png"]
    );
    assert_eq!(dataset.views[3].image_path, dir.path().join("images/03.png"));
    assert!(dataset.views[3].has_photo() && !dataset.views[4].has_photo());
}

#[test]
fn the_model_is_found() {
    let open = |models: &[&str]| {
        let dir = tempfile::tempdir().unwrap();
        put_colmap(&dir, "sparse/0", &["a.png"]);
        models.iter().for_each(|m| put_model(&dir, m));
        let model = Dataset::open(dir.path()).map(|d| d.model_path);
        model.map(|m| m.strip_prefix(dir.path()).unwrap().to_str().unwrap().to_owned())
    };
    let iteration = |n: &str| format!("point_cloud/iteration_{n}/point_cloud.ply");
    let (seven, thirty) = (iteration("7000"), iteration("30000"));
    assert_eq!(open(&["scene.PLY"]).unwrap(), "scene.PLY");
    assert_eq!(open(&["scene.ply", "input.ply"]).unwrap(), "scene.ply");
    // By number, not by name: 7000 sorts after 30000.
    assert_eq!(open(&["scene.ply", &seven, &thirty]).unwrap(), thirty);
    assert_eq!(open(&[&seven, &iteration("best")]).unwrap(), seven);
    assert_eq!(open(&["point_cloud.ply", &thirty, "other.ply"]).unwrap(), "point_cloud.ply");
    says(open(&[]), "no model: expected point_cloud.ply");
    says(open(&["b.ply", "a.ply"]), "several models: a.ply, b.ply; rename one");
}

#[test]
fn inria_output_finds_its_photos() {
    let source = tempfile::tempdir().unwrap();
    put(&source, "images_2/b.x.JPG", "photo");
    let dir = tempfile::tempdir().unwrap();
    let cameras = ["c", "b", "a.png", "d"].map(camera);
    let entries: Vec<_> = cameras.iter().map(inria_entry).collect();
    put(&dir, "cameras.json", serde_json::to_vec(&entries).unwrap());
    let source_path = source.path().display();
    put(
        &dir,
        "cfg_args",
        format!("Namespace(eval=True, images='images_2', source_path='{source_path}')"),
    );
    put(&dir, "images/a.png", "photo");
    put(&dir, "images/b.png", "photo, but not the trainer's");
    put(&dir, "images/d.png", "photo");
    put_model(&dir, "point_cloud/iteration_30000/point_cloud.ply");

    let dataset = Dataset::open(dir.path()).unwrap();
    let expected = ["a.png", "b", "c", "d"];
    for (view, name) in dataset.views.iter().zip(expected) {
        assert_same(&view.camera, &camera(name));
    }
    let photos: Vec<_> = dataset.views.iter().map(|v| v.image_path.clone()).collect();
    let images = dir.path().join("images");
    assert_eq!(photos[0], images.join("a.png"));
    assert_eq!(photos[1], source.path().join("images_2/b.x.JPG"));
    assert_eq!((photos[2].clone(), dataset.views[2].has_photo()), (images.join("c"), false));
    assert_eq!(photos[3], images.join("d.png"));
    // Without cfg_args, and with one that names a missing folder, the output folder's photos remain.
    put(&dir, "cfg_args", "Namespace(source_path='/nowhere/at/all')");
    assert_eq!(open_views(dir.path()).unwrap()[1].image_path, images.join("b.png"));
    fs::remove_file(dir.path().join("cfg_args")).unwrap();
    assert_eq!(open_views(dir.path()).unwrap()[1].image_path, images.join("b.png"));
}

#[test]
fn transforms_turn_opengl_cameras_around() {
    let dir = tempfile::tempdir().unwrap();
    let (a, mut b) = (camera("images/a.png"), camera("images/b.png"));
    (b.fx, b.fy, b.cx, b.width) = (400.0, 400.0, 300.0, 600);
    let json = json!({
        "fl_x": a.fx, "fl_y": a.fy, "cx": a.cx, "cy": a.cy, "w": 640.0, "h": 480.0,
        "k1": 0.0, "aabb_scale": 16, "camera_model": "OPENCV",
        "frames": [
            {"file_path": "./images/b.png", "sharpness": 3.5, "transform_matrix": nerf_matrix(&b),
                "fl_x": 400.0, "cx": 300, "w": 600},
            {"file_path": "images/a.png", "transform_matrix": nerf_matrix(&a)},
        ]
    });
    put(&dir, "transforms.json", json.to_string());
    put_model(&dir, "model.ply");
    put(&dir, "images/a.png", "photo");
    let dataset = Dataset::open(dir.path()).unwrap();
    assert_same(&dataset.views[0].camera, &a);
    assert_same(&dataset.views[1].camera, &b);
    assert!(dataset.views[0].has_photo());
}

#[test]
fn transforms_with_an_angle_take_the_size_from_the_photo() {
    let dir = tempfile::tempdir().unwrap();
    let mut c = camera("train/r_0");
    (c.width, c.height, c.cx, c.cy) = (800, 600, 400.0, 300.0);
    c.fx = 400.0 / libm::tan(0.69 / 2.0);
    c.fy = c.fx;
    let frame =
        json!({"file_path": "./train/r_0", "rotation": 0.1, "transform_matrix": nerf_matrix(&c)});
    put(&dir, "transforms.json", json!({"camera_angle_x": 0.69, "frames": [frame]}).to_string());
    put(&dir, "train/r_0.png", png(800, 600));
    let found = open_views(dir.path()).unwrap();
    assert_same(&found[0].camera, &c);
    assert_eq!(found[0].image_path, dir.path().join("train/r_0.png"));
    // A progressive JPEG under that name.
    let jpeg = b"\xff\xd8\xff\xe0\0\x04ab\xff\xc4\0\x03x\xff\xc2\0\x11\x08\x02\x58\x03\x20\x03";
    put(&dir, "train/r_0.png", jpeg);
    assert_same(&open_views(dir.path()).unwrap()[0].camera, &c);
    // The photo is not an image; then it is missing.
    put(&dir, "train/r_0.png", "GIF89a");
    says(open_views(dir.path()), "image header: not that of a whole PNG, JPEG or WebP");
    fs::remove_file(dir.path().join("train/r_0.png")).unwrap();
    says(
        open_views(dir.path()),
        "no size: w and h are not in the file, and the photo is not there",
    );
}

#[test]
fn wrong_transforms_are_named() {
    let good = json!({"fl_x": 500.0, "w": 640, "h": 480,
        "frames": [{"file_path": "a.png", "transform_matrix": nerf_matrix(&camera("a.png"))}]});
    let read = |change: &dyn Fn(&mut serde_json::Value)| {
        let dir = tempfile::tempdir().unwrap();
        let mut json = good.clone();
        change(&mut json);
        put(&dir, "transforms.json", json.to_string());
        open_views(dir.path())
    };
    assert!(read(&|_| {}).is_ok());
    let mirrored = json!([[-1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]);
    type Change<'a> = &'a dyn Fn(&mut serde_json::Value);
    let changes: [(Change, &str); 10] = [
        (&|j| j["fl_x"] = json!(null), "no focal length"),
        (&|j| j["w"] = json!(640.5), "whole number"),
        (&|j| j["h"] = json!(-480), "whole number"),
        (&|j| j["h"] = json!(0), "size is zero"),
        (&|j| j["frames"][0]["transform_matrix"] = json!([[1, 0, 0, 0]]), "4x4"),
        (&|j| j["frames"][0]["transform_matrix"][3][3] = json!(2), "4x4"),
        (&|j| j["frames"][0]["transform_matrix"][0][0] = json!(3), "not a rotation"),
        (&|j| j["frames"][0]["transform_matrix"] = mirrored.clone(), "not a rotation"),
        (&|j| j["frames"] = json!({}), "frames: a list of cameras expected"),
        (&|j| *j = json!([]), "the list of cameras: it is empty"),
    ];
    for (change, said) in changes {
        says(read(change), said);
    }
}

#[test]
fn wrong_inria_cameras_are_named() {
    let dir = tempfile::tempdir().unwrap();
    let read = |json: &str| {
        put(&dir, "cameras.json", json);
        open_views(dir.path())
    };
    says(read("[]"), "cameras.json: the list of cameras: it is empty");
    says(read(""), "cameras.json: is empty");
    says(read("{}"), "no frames");
    says(read("[{\"id\": 0}]"), "camera 0: it has no img_name");
    says(read("["), "line 1, column 1: the JSON ends too early");
    says(read("[[[[[[[["), "the JSON ends too early");
    let deep = "[".repeat(100_000);
    assert!(matches!(read(&deep), Err(Error::Malformed { .. })));
    let mut entry = inria_entry(&camera("a"));
    entry["fx"] = json!(-1.0);
    assert!(matches!(read(&json!([entry]).to_string()), Err(Error::BadCamera { .. })));
}

#[test]
fn images_beyond_the_largest_size_are_refused() {
    let refused = |outcome: Result<Vec<View>>| {
        let at_most =
            "100000 x 100000 pixels is too large: at most 65535 along an edge and 715827882";
        says(outcome, at_most);
    };
    let dir = tempfile::tempdir().unwrap();
    let mut entry = inria_entry(&camera("a"));
    (entry["width"], entry["height"]) = (json!(100_000), json!(100_000));
    put(&dir, "cameras.json", json!([entry]).to_string());
    refused(open_views(dir.path()));

    let dir = tempfile::tempdir().unwrap();
    let frame = json!({"file_path": "a.png", "transform_matrix": nerf_matrix(&camera("a.png"))});
    let size = json!({"fl_x": 500.0, "w": 100_000, "h": 100_000.0, "frames": [frame]});
    put(&dir, "transforms.json", size.to_string());
    refused(open_views(dir.path()));
    // The size may also come from the photo.
    put(&dir, "transforms.json", json!({"fl_x": 500.0, "frames": [frame]}).to_string());
    put(&dir, "a.png", png(100_000, 100_000));
    refused(open_views(dir.path()));

    let dir = tempfile::tempdir().unwrap();
    put_colmap(&dir, "sparse/0", &["a.png"]);
    put(&dir, "sparse/0/cameras.txt", "1 PINHOLE 100000 100000 10 10 4 3\n");
    refused(open_views(dir.path()));
}

#[test]
fn cameras_follow_the_models_of_nerfstudio() {
    let dir = tempfile::tempdir().unwrap();
    let frame = json!({"file_path": "a.png", "transform_matrix": nerf_matrix(&camera("a.png"))});
    let applied = json!([[0, 1, 0, 0.5], [1, 0, 0, -1], [0, 0, -1, 2]]);
    let transforms = json!({"fl_x": 500.0, "w": 640, "h": 480, "frames": [frame],
        "applied_transform": applied, "applied_scale": 4.0});
    put(&dir, "transforms.json", transforms.to_string());
    let before = open_views(dir.path()).unwrap().remove(0).camera;
    // By a third of a turn about (1, 1, 1), a shift and a scale.
    let saved = json!({"transform": [[0, 0, 1, 3], [1, 0, 0, -2], [0, 1, 0, 1]], "scale": 0.5});
    put(&dir, "dataparser_transforms.json", saved.to_string());
    let after = open_views(dir.path()).unwrap().remove(0).camera;
    let first = glam::DVec3::new(0.3, -0.2, 5.0);
    let [x, y, z] = first.to_array();
    // Where the two steps put a point that both files are about.
    let old = glam::DVec3::new(y + 0.5, x - 1.0, 2.0 - z);
    let new = 0.125 * glam::DVec3::new(z + 3.0, x - 2.0, y + 1.0);
    let seen = |c: &Camera, p: glam::DVec3| {
        let p = c.rotation * p + c.translation;
        (p.truncate() / p.z, p.z)
    };
    let ((old, depth), (new, scaled)) = (seen(&before, old), seen(&after, new));
    assert!((old - new).length() < 1e-12 && (0.125 * depth - scaled).abs() < 1e-12);
    for broken in
        [json!({"transform": [], "scale": 1}), json!({"transform": saved["transform"], "scale": 0})]
    {
        put(&dir, "dataparser_transforms.json", broken.to_string());
        says(open_views(dir.path()), "dataparser_transforms.json: transform: 3 rows");
    }
}

#[test]
fn a_message_contains_its_cause_once() {
    let dir = tempfile::tempdir().unwrap();
    let error = ply::read(dir.path().join("gone.ply")).unwrap_err();
    assert!(!error.to_string().contains("os error 2"), "{error}");
    assert_eq!(gs_model::chain(&error).matches("os error 2").count(), 1, "{error}");
}

/// Reads the positions of a binary PLY of SfM points: x y z nx ny nz as floats, then 3 bytes.
fn sfm_points(path: &Path) -> Vec<[f64; 3]> {
    let bytes = fs::read(path).unwrap();
    let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    let number = |b: &[u8]| f64::from(f32::from_le_bytes(b.try_into().unwrap()));
    let rows = bytes[end..].chunks_exact(27);
    rows.map(|r| [number(&r[0..4]), number(&r[4..8]), number(&r[8..12])]).collect()
}

#[test]
fn real_inria_cameras_see_their_points() {
    for (name, views) in [("playroom", 225), ("truck", 251), ("train", 301), ("drjohnson", 263)] {
        let Some(dir) = shared(&format!("scenes/cameras/{name}")) else { return };
        let all = open_views(&dir).unwrap();
        assert_eq!(all.len(), views, "{name}");
        assert!(all.is_sorted_by(|a, b| a.camera.name < b.camera.name), "{name}");
        let file = dir.join("points.ply");
        if !file.exists() {
            continue;
        }
        let points = sfm_points(&file);
        // A reader with a wrong convention would look backwards or use the rows of the rotation as
        // columns: fewer points would be in view.
        let [right, behind, transposed] = [0, 1, 2].map(|mistake| {
            let seen = all.iter().map(|v| {
                let mut c = v.camera.clone();
                c.rotation = match mistake {
                    0 => c.rotation,
                    1 => glam::DMat3::from_diagonal(glam::dvec3(-1.0, 1.0, -1.0)) * c.rotation,
                    _ => c.rotation.transpose(),
                };
                c.translation = -(c.rotation * v.camera.position());
                share_in_view(&c, &points)
            });
            seen.sum::<f64>() / views as f64
        });
        println!("{name}: {right:.3} in view, {behind:.3} behind, {transposed:.3} transposed");
        assert!(right > 1.5 * behind.max(transposed), "{name}");
    }
}
