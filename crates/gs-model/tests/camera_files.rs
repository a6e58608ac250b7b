//! Cameras as tools leave them: where they lie, and in which forms.

mod common;

use std::path::Path;

use common::{image_rows, put, put_colmap, says};
use gs_model::dataset::{cameras_in, open_cameras};
use gs_model::{CameraSet, Result};
use serde_json::{Value, json};

fn names(set: &CameraSet) -> Vec<&str> {
    set.views.iter().map(|v| &v.camera.name[..]).collect()
}

const IDENTITY: [[f64; 4]; 4] =
    [[1.0, 0.0, 0.0, 0.5], [0.0, 1.0, 0.0, 0.25], [0.0, 0.0, 1.0, -2.0], [0.0, 0.0, 0.0, 1.0]];

fn frame(path: &str) -> Value {
    json!({"file_path": path, "transform_matrix": IDENTITY})
}

fn transforms(frames: Vec<Value>) -> Value {
    json!({"fl_x": 10.0, "w": 8, "h": 6, "frames": frames})
}

/// The cameras of a transforms.json with this content.
fn of_text(text: impl AsRef<[u8]>) -> Result<CameraSet> {
    let dir = tempfile::tempdir().unwrap();
    put(&dir, "transforms.json", text);
    open_cameras(dir.path())
}

#[test]
fn images_are_read_with_and_without_lines_of_points() {
    let images = ["a.png", "0002", "b c.png", "x 1 2 3.jpg"];
    let read = |text: String| {
        let dir = tempfile::tempdir().unwrap();
        put(&dir, "sparse/0/cameras.txt", "\u{feff}# Cameras\r\n1 PINHOLE 8 6 10 10 4 3\r\n");
        put(&dir, "sparse/0/images.txt", text);
        open_cameras(dir.path())
    };
    let mut sorted = images.to_vec();
    sorted.sort_unstable();
    for between in ["", "\n", "1.5 2.5 -1 3 4 17 5 6 -1 7 8 9\n", "1.5 2.5 -1\n"] {
        for text in
            [image_rows(&images, between), image_rows(&images, between).replace('\n', "\r\n")]
        {
            assert_eq!(
                names(&read(format!("\u{feff}# Images\n{text}")).unwrap()),
                sorted,
                "{between:?}"
            );
        }
    }
    // A line that is neither an image nor a list of points.
    says(read(image_rows(&images, "1.5 2.5\n")), "images.txt: line 2: bad ");
}

#[test]
fn the_largest_of_several_models_is_read_and_said() {
    let dir = tempfile::tempdir().unwrap();
    put_colmap(&dir, "sparse/0", &["a.png", "b.png"]);
    put_colmap(&dir, "sparse/1", &["a.png", "c.png", "d.png"]);
    put_colmap(&dir, "sparse/10", &["a.png", "c.png", "d.png"]);
    let set = open_cameras(dir.path()).unwrap();
    assert_eq!((set.views.len(), &set.source), (3, &dir.path().join("sparse/1")));
    assert!(
        set.notes[0].contains("the largest of 3 models, with 3 images; 0 has 2, 10 has 3"),
        "{set:?}"
    );
    // One that is broken does not stand in the way, and is named.
    put(&dir, "sparse/2/cameras.txt", "1 PINHOLE");
    put(&dir, "sparse/2/images.txt", "");
    let set = open_cameras(dir.path()).unwrap();
    assert!(set.views.len() == 3 && set.notes.iter().any(|n| n.contains("sparse/2")), "{set:?}");
}

#[test]
fn cameras_are_found_where_tools_put_them() {
    for (place, photos, named) in [
        ("sparse/0", "images", ""),
        ("sparse", "images", ""),
        ("sparse/1", "images", ""),
        ("colmap/sparse/0", "images", ""),
        ("dense/0/sparse", "dense/0/images", ""),
        ("dense/sparse", "dense/images", ""),
        ("distorted/sparse/0", "input", ""),
        ("", "images", ""),
        ("scene/sparse/0", "scene/images", ""),
        ("sparse/0", "images", "sparse/0"),
        ("sparse/0", "images", "sparse"),
        ("sparse/0", "images_4", "sparse/0/images.txt"),
        ("sparse/0", "images", "sparse/0/cameras.txt"),
        ("colmap/sparse/0", "images", "colmap/sparse/0"),
        ("dense/0/sparse", "dense/0/images", "dense/0"),
    ] {
        let dir = tempfile::tempdir().unwrap();
        put_colmap(&dir, place, &["b/a.png"]);
        put(&dir, &format!("{photos}/b/a.JPG"), "photo");
        let set = open_cameras(dir.path().join(named)).unwrap();
        let photo = dir.path().join(photos).join("b/a.JPG");
        assert_eq!(
            (set.form, set.views[0].image_path.as_path()),
            ("COLMAP", &*photo),
            "{place} {named}"
        );
        assert!(set.notes.is_empty(), "{set:?}");
    }
    // Newer files beside them, which are not needed.
    let dir = tempfile::tempdir().unwrap();
    put_colmap(&dir, "sparse/0", &["a.png"]);
    put(&dir, "sparse/0/rigs.bin", "x");
    put(&dir, "sparse/0/frames.bin", "x");
    assert_eq!(open_cameras(dir.path()).unwrap().views.len(), 1);
}

#[test]
fn camera_files_of_nerfs_are_found() {
    let dir = tempfile::tempdir().unwrap();
    let split = |name: &str| transforms(vec![frame(&format!("./{name}/r_0"))]).to_string();
    put(&dir, "transforms_train.json", split("train"));
    put(&dir, "transforms_test.json", split("test"));
    let set = open_cameras(dir.path()).unwrap();
    assert_eq!((names(&set), set.form), (vec!["test/r_0", "train/r_0"], "NeRF"));
    assert!(set.notes[0].contains("read together with transforms_test.json"), "{set:?}");
    let named = open_cameras(dir.path().join("transforms_train.json")).unwrap();
    assert_eq!((named.views.len(), named.notes.len()), (1, 0));
    // transforms.json comes before the COLMAP model that it was made of.
    put(&dir, "transforms.json", transforms(vec![frame("a.png")]).to_string());
    put_colmap(&dir, "colmap/sparse/0", &["b.png"]);
    assert_eq!(names(&open_cameras(dir.path()).unwrap()), ["a.png"]);

    let dir = tempfile::tempdir().unwrap();
    put(&dir, "scene/transforms.json", transforms(vec![frame("a.png")]).to_string());
    assert_eq!(names(&open_cameras(dir.path()).unwrap()), ["a.png"]);
    assert!(cameras_in(dir.path()).is_err());
    put(&dir, "other/cameras.json", "[]");
    says(open_cameras(dir.path()), "cameras in several folders: other, scene; name one of them");
}

#[test]
fn a_folder_without_cameras_says_what_it_has() {
    let dir = tempfile::tempdir().unwrap();
    says(open_cameras(dir.path()), "the folder is empty; expected sparse/0/images.bin");
    put(&dir, "database.db", "");
    put(&dir, "photos/a.png", "");
    says(open_cameras(dir.path()), "found database.db, photos; expected");
    put(&dir, "run/dataparser_transforms.json", "{}");
    says(
        open_cameras(dir.path().join("run")),
        "a run of nerfstudio; copy its dataparser_transforms.json",
    );
    put(&dir, "sparse/0/cameras.bin", "");
    says(open_cameras(dir.path()), "sparse/0: it has cameras, but no images.bin");
    says(open_cameras(dir.path().join("database.db")), "is empty");
    put(&dir, "a.ply", "ply\n");
    says(open_cameras(dir.path().join("a.ply")), "not a camera file");
}

#[test]
fn the_content_of_a_camera_file_decides() {
    let dir = tempfile::tempdir().unwrap();
    put(&dir, "cameras.json", transforms(vec![frame("a.png")]).to_string());
    let set = open_cameras(dir.path()).unwrap();
    assert_eq!((names(&set), set.form), (vec!["a.png"], "NeRF"));
    let entry = json!({"img_name": 7, "width": "8", "height": 6, "fx": 10, "fy": "10",
        "position": [0, 0, "1"], "rotation": [[2, 0, 0], [0, 2, 0], [0, 0, 2]]});
    let set = of_text(json!([entry]).to_string()).unwrap();
    assert_eq!((names(&set), set.form), (vec!["7"], "Inria"));
    assert!(set.notes[0].contains("a scale of 2.0000"), "{set:?}");
    says(
        of_text("{\"cameras\": []}"),
        "no frames, which list the cameras of a transforms.json; it has cameras",
    );
    says(of_text("[3]"), "camera 0: it has no img_name");
    says(of_text("{\"frames\": []}"), "transforms.json: the list of cameras: it is empty");
}

#[test]
fn transforms_of_all_exporters_say_the_same() {
    let right = of_text(transforms(vec![frame("images/a.png")]).to_string()).unwrap();
    type Change = fn(&mut Value);
    let variants: [(&str, Change); 6] = [
        ("few digits", |all| all["frames"][0]["transform_matrix"][3][3] = json!(0.9999999)),
        ("backslashes", |all| all["frames"][0]["file_path"] = json!(".\\images\\a.png")),
        ("numbers as text", |all| {
            (all["fl_x"], all["w"], all["h"]) = (json!("10.0"), json!("8"), json!("6.0"));
        }),
        ("three rows", |all| {
            all["frames"][0]["transform_matrix"].as_array_mut().unwrap().pop();
        }),
        ("one list", |all| {
            all["frames"][0]["transform_matrix"] = json!(IDENTITY.as_flattened());
        }),
        ("rounded", |all| all["frames"][0]["transform_matrix"][0][0] = json!(0.9999)),
    ];
    for (what, change) in variants {
        let mut variant = transforms(vec![frame("images/a.png")]);
        change(&mut variant);
        let set = of_text(variant.to_string()).unwrap();
        assert_eq!(names(&set), names(&right), "{what}");
        let [a, b] = [&set, &right].map(|set| set.views[0].camera.clone());
        assert!(a.rotation.abs_diff_eq(b.rotation, 1e-3), "{what}");
        assert!((a.position() - b.position()).length() < 1e-3 && a.fx == b.fx, "{what}");
    }
    let mut scaled = transforms(vec![frame("images/a.png")]);
    for i in 0..3 {
        for k in 0..3 {
            scaled["frames"][0]["transform_matrix"][i][k] = json!(2.0 * IDENTITY[i][k]);
        }
    }
    let set = of_text(scaled.to_string()).unwrap();
    assert_eq!(set.views[0].camera, right.views[0].camera);
    assert!(set.notes[0].contains("a scale of 2.0000, which is divided out"), "{set:?}");

    let text = transforms(vec![frame("images/a.png")]).to_string();
    for text in [format!("\u{feff}{text}"), text.replace("\"w\"", "\"sharpness\": NaN, \"w\"")] {
        assert_eq!(of_text(text).unwrap().views[0].camera, right.views[0].camera);
    }
    let mut turned = transforms(vec![frame("a")]);
    turned["frames"][0]["transform_matrix"] =
        json!([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [3, 4, 5, 1]]);
    says(of_text(turned.to_string()), "transform_matrix is transposed");
    says(
        of_text(json!({"frames": [{"file_path": "a"}], "w": 8, "h": 6, "fl_x": 1}).to_string()),
        "no transform_matrix",
    );
    says(of_text(json!({"frames": [{}]}).to_string()), "frame 0: it has no file_path");
}

#[test]
fn photos_are_found_at_the_end_of_a_path_of_another_machine() {
    let dir = tempfile::tempdir().unwrap();
    let path = "C:\\Users\\me\\scene\\images\\a.png";
    put(&dir, "transforms.json", transforms(vec![frame(path)]).to_string());
    put(&dir, "images/a.png", "photo");
    assert_eq!(
        open_cameras(dir.path()).unwrap().views[0].image_path,
        dir.path().join("images/a.png")
    );
}

#[test]
fn cameras_of_equal_names_are_numbered_and_take_no_photo() {
    let dir = tempfile::tempdir().unwrap();
    put_colmap(&dir, "sparse", &["a.png", "b.png", "a.png", "a (1).png"]);
    put(&dir, "images/a.png", "photo");
    put(&dir, "images/b.png", "photo");
    let set = open_cameras(dir.path()).unwrap();
    assert_eq!(names(&set), ["a (1).png", "a (2).png", "a (3).png", "b.png"]);
    assert_eq!(set.views.iter().filter(|v| v.has_photo()).count(), 1);
    assert!(
        set.notes[0].starts_with("2 cameras have names that others have too (\"a.png\")"),
        "{set:?}"
    );
}

#[test]
fn lenses_are_read_by_name() {
    let lens = |keys: Value| {
        let mut all = transforms(vec![frame("a.png")]);
        all.as_object_mut().unwrap().append(keys.clone().as_object_mut().unwrap());
        let camera = of_text(all.to_string()).unwrap().views.remove(0).camera;
        camera.lens.map(|lens| (lens.model, lens.coefficients))
    };
    let found = |model: &str, k: &[f64]| Some((model.to_owned(), k.to_vec()));
    let k = json!({"is_fisheye": true, "k1": 0.1, "k2": 0.2, "k3": 0.3, "k4": 0.4});
    assert_eq!(lens(k), found("OPENCV_FISHEYE", &[0.1, 0.2, 0.3, 0.4]));
    assert_eq!(lens(json!({"is_fisheye": false})), None);
    assert_eq!(lens(json!({"k2": 0.0, "camera_model": "OPENCV"})), None);
    assert_eq!(lens(json!({"camera_model": "equirectangular"})), found("EQUIRECTANGULAR", &[]));
    assert_eq!(lens(json!({"equirectangular": true})), found("EQUIRECTANGULAR", &[]));
    assert_eq!(lens(json!({"ftheta_p0": 0.1})), found("FTHETA", &[]));
    assert_eq!(lens(json!({"camera_model": "SIMPLE_RADIAL", "k1": 0.1})).unwrap().0, "FULL_OPENCV");
    assert_eq!(lens(json!({"camera_model": "ORTHOPHOTO"})), found("ORTHOPHOTO", &[]));
    // A frame has values of its own beside those of the file.
    let mut all = transforms(vec![frame("a.png")]);
    (all["k2"], all["frames"][0]["k1"]) = (json!(0.2), json!(0.1));
    all["frames"][0]["p2"] = json!(-1e-3);
    let lens = of_text(all.to_string()).unwrap().views.remove(0).camera.lens.unwrap();
    assert_eq!(lens.model, "FULL_OPENCV");
    assert_eq!(lens.coefficients, [0.1, 0.2, 0.0, -1e-3, 0.0, 0.0, 0.0, 0.0]);
    // A panorama needs no focal length.
    let mut all = transforms(vec![frame("a.png")]);
    all.as_object_mut().unwrap().remove("fl_x");
    all["camera_model"] = json!("EQUIRECTANGULAR");
    assert_eq!(of_text(all.to_string()).unwrap().views[0].camera.fx, 4.0);
    // COLMAP's.
    let dir = tempfile::tempdir().unwrap();
    for (row, model) in [
        ("1 EQUIRECTANGULAR 8 4 8 4\n", "EQUIRECTANGULAR"),
        ("1 SIMPLE_FISHEYE 8 6 3 4 3\n", "SIMPLE_FISHEYE"),
        ("1 EUCM 8 6 3 3 4 3 0.5 1\n", "EUCM"),
    ] {
        put(&dir, "sparse/0/cameras.txt", row);
        put(&dir, "sparse/0/images.txt", image_rows(&["a"], "\n"));
        let set = open_cameras(dir.path()).unwrap();
        assert_eq!(set.views[0].camera.lens.as_ref().unwrap().model, model);
    }
}

#[test]
fn a_missing_path_is_named() {
    says(open_cameras(Path::new("/nowhere/at/all")), "/nowhere/at/all: cannot list");
}
