//! COLMAP models and their points: one fixture written as `.bin` and as `.txt`, whole, cut, and wrong.

mod common;

use std::path::Path;

use common::{put, says};
use gs_model::colmap::{self, Point, read_points};
use gs_model::dataset::open_points;
use gs_model::{Camera, Error};
use tempfile::TempDir;

struct CameraRow {
    id: u32,
    model: (u32, &'static str),
    size: (u64, u64),
    params: Vec<f64>,
}

struct ImageRow {
    id: u32,
    rotation: [f64; 4],
    translation: [f64; 3],
    camera: u32,
    name: &'static str,
    observations: usize,
}

struct Model {
    cameras: Vec<CameraRow>,
    images: Vec<ImageRow>,
}

fn model() -> Model {
    let camera = |id, model, params: &[f64]| CameraRow {
        id,
        model,
        size: (640, 480),
        params: params.into(),
    };
    let image = |id, rotation, camera, name, observations| ImageRow {
        id,
        rotation,
        translation: [0.1, -2.5, 1e-3 * f64::from(id)],
        camera,
        name,
        observations,
    };
    Model {
        cameras: vec![
            camera(7, (1, "PINHOLE"), &[500.25, 501.5, 320.5, 239.0]),
            camera(2, (0, "SIMPLE_PINHOLE"), &[450.0, 321.0, 240.0]),
        ],
        images: vec![
            image(1, [1.0, 0.0, 0.0, 0.0], 7, "b.jpg", 2),
            image(9, [0.5, -0.5, 0.5, 0.5], 2, "sub/a photo.png", 0),
            image(4, [0.6, 0.0, 0.8, 0.0], 7, "c.jpg", 1),
        ],
    }
}

impl Model {
    fn binary(&self) -> [(&'static str, Vec<u8>); 2] {
        let mut cameras = (self.cameras.len() as u64).to_le_bytes().to_vec();
        for c in &self.cameras {
            cameras.extend(c.id.to_le_bytes());
            cameras.extend(c.model.0.to_le_bytes());
            cameras.extend(c.size.0.to_le_bytes());
            cameras.extend(c.size.1.to_le_bytes());
            cameras.extend(c.params.iter().flat_map(|p| p.to_le_bytes()));
        }
        let mut images = (self.images.len() as u64).to_le_bytes().to_vec();
        for i in &self.images {
            images.extend(i.id.to_le_bytes());
            images.extend(i.rotation.iter().chain(&i.translation).flat_map(|p| p.to_le_bytes()));
            images.extend(i.camera.to_le_bytes());
            images.extend(i.name.bytes());
            images.push(0);
            images.extend((i.observations as u64).to_le_bytes());
            for o in 0..i.observations {
                images.extend((o as f64).to_le_bytes());
                images.extend((o as f64).to_le_bytes());
                images.extend((-1i64).to_le_bytes());
            }
        }
        [("cameras.bin", cameras), ("images.bin", images)]
    }

    fn text(&self) -> [(&'static str, Vec<u8>); 2] {
        let join = |v: &[f64]| v.iter().map(f64::to_string).collect::<Vec<_>>().join(" ");
        let mut cameras = "# Camera list\n#   CAMERA_ID, MODEL, ...\n\n".to_owned();
        for c in &self.cameras {
            let params = join(&c.params);
            cameras += &format!("{} {} {} {} {params}\n", c.id, c.model.1, c.size.0, c.size.1);
        }
        let mut images = "# Image list with two lines per image\n".to_owned();
        for i in &self.images {
            let pose = join(&[&i.rotation[..], &i.translation[..]].concat());
            images += &format!("{} {pose} {} {}\n", i.id, i.camera, i.name);
            images += &"1.5 2.5 -1 ".repeat(i.observations);
            images += "\n";
        }
        [("cameras.txt", cameras.into_bytes()), ("images.txt", images.into_bytes())]
    }
}

fn folder(files: &[(&str, Vec<u8>)]) -> TempDir {
    let dir = tempfile::tempdir().unwrap();
    files.iter().for_each(|(name, bytes)| put(&dir, name, bytes));
    dir
}

fn read(dir: &Path) -> Result<Vec<Camera>, Error> {
    colmap::read_cameras(dir)
}

#[test]
fn binary_and_text_say_the_same() {
    let model = model();
    let from_binary = read(folder(&model.binary()).path()).unwrap();
    let from_text = read(folder(&model.text()).path()).unwrap();
    assert_eq!(from_binary, from_text);

    let cameras = from_binary;
    let names: Vec<&str> = cameras.iter().map(|c| c.name.as_str()).collect();
    assert_eq!(names, ["b.jpg", "sub/a photo.png", "c.jpg"]);
    assert_eq!(
        (cameras[0].fx, cameras[0].fy, cameras[0].cx, cameras[0].cy),
        (500.25, 501.5, 320.5, 239.0)
    );
    assert_eq!(
        (cameras[1].fx, cameras[1].fy, cameras[1].cx, cameras[1].cy),
        (450.0, 450.0, 321.0, 240.0)
    );
    assert_eq!((cameras[2].width, cameras[2].height), (640, 480));
    assert_eq!(cameras[0].rotation, glam::DMat3::IDENTITY);
    assert_eq!(cameras[0].translation.to_array(), [0.1, -2.5, 1e-3]);
    // (0.6, 0, 0.8, 0) turns by 2 acos(0.6) about y.
    let turned = cameras[2].rotation * glam::DVec3::Z;
    assert!((turned - glam::DVec3::new(0.96, 0.0, -0.28)).length() < 1e-12, "{turned}");
    assert!(
        (cameras[2].rotation * cameras[2].position() + cameras[2].translation).length() < 1e-12
    );
}

#[test]
fn files_cut_at_every_byte_are_errors() {
    for whole in [model().binary(), model().text()] {
        for (file, (name, bytes)) in whole.iter().enumerate() {
            for len in 0..bytes.len() {
                let mut files = whole.clone();
                files[file].1.truncate(len);
                match read(folder(&files).path()) {
                    Err(Error::Truncated { file, len: at, .. }) => {
                        assert!(file.ends_with(name) && at == len);
                    }
                    // Text files do not state their length, so some cut files are still valid.
                    Err(error) if name.ends_with("txt") => assert!(
                        common::is_broken(&error) || matches!(error, Error::BadCamera { .. })
                    ),
                    outcome => assert!(name.ends_with("txt"), "{name} {len}: {outcome:?}"),
                }
            }
        }
    }
}

#[test]
fn promises_beyond_the_file_fail_before_any_allocation() {
    for file in 0..2 {
        let mut files = model().binary();
        files[file].1[..8].copy_from_slice(&u64::MAX.to_le_bytes());
        says(read(folder(&files).path()), &format!("promises {} entries", u64::MAX));
    }
    // The same for the number of observations of the first image.
    let mut files = model().binary();
    let at = 8 + 4 + 7 * 8 + 4 + "b.jpg\0".len();
    for count in [u64::MAX, u64::MAX / 24 + 1] {
        files[1].1[at..at + 8].copy_from_slice(&count.to_le_bytes());
        says(read(folder(&files).path()), "an image's points at byte");
    }
}

/// Reads the changed model in both forms; both must fail in the same way.
fn broken(change: impl Fn(&mut Model), expected: impl Fn(&Error) -> bool) {
    let mut model = model();
    change(&mut model);
    for files in [model.binary(), model.text()] {
        match read(folder(&files).path()) {
            Err(error) if expected(&error) => {
                assert_eq!(error.to_string().lines().count(), 1, "{error}");
            }
            other => panic!("{other:?}"),
        }
    }
}

#[test]
fn distorted_cameras_have_a_lens() {
    // Focal lengths first, then the principal point, then the distortion.
    let models: [(u32, &str, &[f64], [f64; 4]); 4] = [
        (2, "SIMPLE_RADIAL", &[500.0, 321.0, 241.0, 0.1], [500.0, 500.0, 321.0, 241.0]),
        (
            4,
            "OPENCV",
            &[500.0, 490.0, 321.0, 241.0, 0.1, 0.0, 0.0, 0.0],
            [500.0, 490.0, 321.0, 241.0],
        ),
        (7, "FOV", &[500.0, 490.0, 321.0, 241.0, 0.9], [500.0, 490.0, 321.0, 241.0]),
        (9, "RADIAL_FISHEYE", &[500.0, 321.0, 241.0, 0.1, 0.2], [500.0, 500.0, 321.0, 241.0]),
    ];
    let pinhole = read(folder(&model().text()).path()).unwrap();
    for (id, name, params, expected) in models {
        let mut model = model();
        model.cameras[1].model = (id, name);
        model.cameras[1].params = params.into();
        for files in [model.binary(), model.text()] {
            let cameras = read(folder(&files).path()).unwrap();
            for (camera, pinhole) in cameras.iter().zip(&pinhole) {
                let Some(lens) = &camera.lens else {
                    assert_eq!(camera, pinhole);
                    continue;
                };
                assert_eq!(lens.model, name);
                assert!(params.ends_with(&lens.coefficients) && !lens.coefficients.is_empty());
                assert_eq!([camera.fx, camera.fy, camera.cx, camera.cy], expected);
                assert_eq!((camera.width, camera.height), (pinhole.width, pinhole.height));
                assert_eq!(camera.rotation, pinhole.rotation);
            }
            let distorted = cameras.iter().filter(|c| c.lens.is_some()).count();
            assert!((1..3).contains(&distorted), "{distorted}");
        }
    }
    // Coefficients of zero distort nothing.
    let mut straight = model();
    straight.cameras[1].model = (4, "OPENCV");
    straight.cameras[1].params = vec![500.0, 490.0, 321.0, 241.0, 0.0, 0.0, 0.0, 0.0];
    let cameras = read(folder(&straight.text()).path()).unwrap();
    assert!(cameras.iter().all(|c| c.lens.is_none()));
    // A model that is not known cannot be read at all.
    broken(
        |m| m.cameras[1].model = (99, "NEW"),
        |e| e.to_string().contains("camera 2: unknown camera model"),
    );
}

#[test]
fn what_does_not_fit_together_is_named() {
    let named = |part: &'static str| move |e: &Error| e.to_string().contains(part);
    broken(
        |m| m.images[2].camera = 3,
        named("image \"c.jpg\": it names camera 3, which is not in"),
    );
    broken(|m| m.cameras[1].id = 7, named("camera 7: it is there twice"));
    let bad = |part: &'static str| move |e: &Error| matches!(e, Error::BadCamera { reason, .. } if reason.contains(part));
    broken(|m| m.cameras[0].size = (0, 480), bad("size is zero"));
    for size in [(1 << 32, 480), (65_536, 1), (1, 65_536), (100_000, 100_000), (26_756, 26_756)] {
        let (w, h) = size;
        let large = |e: &Error| e.to_string().contains(&format!("{w} x {h} pixels is too large"));
        broken(|m| m.cameras[0].size = size, large);
    }
    broken(|m| m.cameras[0].params[0] = 0.0, bad("not positive"));
    broken(|m| m.cameras[0].params[1] = -5.0, bad("not positive"));
    broken(|m| m.cameras[0].params[2] = f64::NAN, bad("not finite"));
    broken(|m| m.images[0].translation[1] = f64::INFINITY, bad("pose is not finite"));
    broken(|m| m.images[0].rotation = [0.0; 4], bad("no direction"));
    broken(|m| m.images[0].rotation[2] = f64::NAN, bad("no direction"));
}

#[test]
fn text_mistakes_name_the_line() {
    let wrong = |file: usize, from: &str, to: &str, said: &str| {
        let mut files = model().text();
        let text = String::from_utf8(files[file].1.clone()).unwrap();
        assert!(text.contains(from));
        files[file].1 = text.replacen(from, to, 1).into_bytes();
        says(read(folder(&files).path()), said);
    };
    wrong(0, "7 PINHOLE", "seven PINHOLE", "line 4: bad camera id");
    wrong(0, " 239", "", "line 4: bad camera parameter");
    wrong(0, " 239", " 239 1", "line 4: bad number of camera parameters");
    wrong(1, "-2.5", "-2,5", "line 2: bad translation");
    wrong(1, " b.jpg", "", "line 2: bad image name");
    // A list of points with a number too many is neither; the next image is not taken for its points.
    let mut files = model().text();
    let mut text = String::from_utf8(files[1].1.clone()).unwrap();
    text += "12 13 7 8\n";
    let number = text.lines().count();
    files[1].1 = text.into_bytes();
    says(read(folder(&files).path()), &format!("line {number}: bad"));
    says(read(folder(&files).path()), &format!("nor does line {number} list points"));
}

const POINTS: [Point; 2] = [
    Point { position: [0.5, -2.0, 1e-3], colour: [255, 0, 17] },
    Point { position: [3.0, 4.0, -5.0], colour: [1, 2, 3] },
];

fn binary_points(points: &[Point]) -> Vec<u8> {
    let mut out = (points.len() as u64).to_le_bytes().to_vec();
    for (id, p) in (1u64..).zip(points) {
        out.extend(id.to_le_bytes());
        out.extend(p.position.iter().flat_map(|v| v.to_le_bytes()));
        out.extend(p.colour);
        out.extend(0.25f64.to_le_bytes());
        // It shows in as many images as its number says.
        out.extend(id.to_le_bytes());
        out.extend((0..id).flat_map(|_| [7; 8]));
    }
    out
}

fn text_points(points: &[Point]) -> Vec<u8> {
    let mut out = "# 3D point list\n".to_owned();
    for (id, Point { position: [x, y, z], colour: [r, g, b] }) in (1..).zip(points) {
        out += &format!("{id} {x} {y} {z} {r} {g} {b} 0.25 1 7 2 9\n");
    }
    out.into_bytes()
}

fn points(name: &str, bytes: &[u8]) -> Result<Vec<Point>, Error> {
    read_points(folder(&[(name, bytes.to_vec())]).path())
}

#[test]
fn binary_and_text_hold_the_same_points() {
    assert_eq!(points("points3D.bin", &binary_points(&POINTS)).unwrap(), POINTS);
    assert_eq!(points("points3D.txt", &text_points(&POINTS)).unwrap(), POINTS);
}

#[test]
fn points_cut_at_any_byte_are_an_error() {
    let whole = binary_points(&POINTS);
    for len in 0..whole.len() {
        says(points("points3D.bin", &whole[..len]), &format!("truncated at byte {len}"));
    }
    let mut promising = whole;
    promising[..8].copy_from_slice(&u64::MAX.to_le_bytes());
    says(points("points3D.bin", &promising), "promises");
}

#[test]
fn points_that_cannot_be_trained_from_are_named() {
    says(
        points("points3D.bin", &binary_points(&[])),
        "points3D.bin: the list of points: it is empty",
    );
    says(points("points3D.txt", b"1 0 0 0 256 0 0 0.1\n"), "line 1: bad colour");
    let nowhere = Point { position: [0.0, f64::NAN, 0.0], ..POINTS[0] };
    says(points("points3D.bin", &binary_points(&[POINTS[1], nowhere])), "point 1: its position");
    says(open_points(tempfile::tempdir().unwrap().path()), "points3D");
}
