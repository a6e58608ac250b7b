//! What `encode` and `tune` do with cameras and photos that do not fit the model.

mod common;

use common::{Folder, heard, model, one_line, report, room, room_cameras, run};
use finetune::{RenderOptions, metrics, render};
use gs_model::{Camera, Scene, dataset};
use serde_json::Value;
use std::path::Path;

fn cameras() -> Vec<Camera> {
    dataset::open_views(room()).unwrap().into_iter().map(|v| v.camera).collect()
}

/// A cameras.json as Inria's trainer writes it.
fn write_json(path: &Path, cameras: &[Camera]) {
    let entry = |c: &Camera| {
        let (p, r) = (c.position(), c.rotation.transpose());
        let row = |k: usize| [r.row(k).x, r.row(k).y, r.row(k).z];
        serde_json::json!({
            "id": 0, "img_name": c.name, "width": c.width, "height": c.height,
            "position": [p.x, p.y, p.z], "rotation": [row(0), row(1), row(2)],
            "fx": c.fx, "fy": c.fy,
        })
    };
    let all: Vec<_> = cameras.iter().map(entry).collect();
    std::fs::write(path, serde_json::to_string(&all).unwrap()).unwrap();
}

fn looking(from: [f64; 3], at: [f64; 3]) -> Vec<Camera> {
    let camera = |i: i32| {
        let from = [from[0] + 0.01 * f64::from(i), from[1], from[2]];
        Camera::looking_at(format!("{i}.png"), from, at, [0.0, 0.0, 1.0], [120, 80], 100.0)
    };
    (0..3).map(camera).collect()
}

/// Mean PSNR of a decoded stream against the model, over some of the room's cameras.
fn psnr(stream: &Path) -> f64 {
    let (input, _) = gs_model::ply::read(model()).unwrap();
    let decoded: Scene = gsvx::decode(&std::fs::read(stream).unwrap()).unwrap();
    let options = RenderOptions::default();
    let views: Vec<Camera> = cameras().into_iter().step_by(7).collect();
    let of =
        |c: &Camera| metrics::psnr(&render(&decoded, c, &options), &render(&input, c, &options));
    views.iter().map(of).sum::<f64>() / views.len() as f64
}

#[test]
fn cameras_that_see_little_are_named_and_what_they_miss_is_kept() {
    let dir = Folder::new();
    let (json, stream) = (dir.join("cameras.json"), dir.join("a.gsvx"));
    let input = model();
    // Cameras that look into the void beside the room.
    write_json(&json, &looking([90.0, 90.0, 90.0], [180.0, 180.0, 180.0]));
    let words = "encode @ -o @ --cameras @";
    one_line(&run(words, &[&input, &stream, &json]), "see nothing of the model");
    assert!(!stream.exists());
    // Cameras close to a wall: they see a little of it.
    let mut near = cameras().swap_remove(3);
    (near.fx, near.fy) = (20.0 * near.fx, 20.0 * near.fy);
    let second = Camera { name: "second".into(), ..near.clone() };
    write_json(&json, &[near, second]);
    let (kept, said) = report(words, &[&input, &stream, &json]);
    assert!(said.contains("warning") && said.contains("of the model's opacity"), "{said}");
    assert!(kept["seen_opacity_share"].as_f64().unwrap() < 0.5, "{kept}");
    assert!(kept["unseen"].as_u64().unwrap() > 5000, "{kept}");
    assert!(kept["left_out"].as_u64().unwrap() < 1000, "{kept}");
    let all_around = psnr(&stream);
    assert!(all_around > 25.0, "{all_around} dB: no picture");
    // Whoever asks for it gets what the cameras see, and is told what is missing.
    let only = format!("{words} --drop-unseen --force");
    let (dropped, _) = report(&only, &[&input, &stream, &json]);
    assert!(dropped["left_out"].as_u64().unwrap() > 5000, "{dropped}");
    assert!(dropped["bytes"].as_u64() < kept["bytes"].as_u64());
    let out = run(&only, &[&input, &stream, &json]);
    let said = String::from_utf8(out.stdout).unwrap();
    assert!(said.contains("hardly seen are left out"), "{said}");
    assert_eq!(sum(&dropped, ["unseen", "hardly_seen"]), dropped["left_out"].as_u64().unwrap());
    assert!(psnr(&stream) < all_around - 5.0);
}

fn sum(report: &Value, names: [&str; 2]) -> u64 {
    names.map(|name| report[name].as_u64().unwrap()).iter().sum()
}

/// Frames that cameras have and their model has not.
fn misfits() -> [(&'static str, Vec<Camera>); 3] {
    let turn = glam::DMat3::from_cols(glam::DVec3::X, glam::DVec3::Z, -glam::DVec3::Y);
    let moved = |turn: glam::DMat3, scale: f64, shift: [f64; 3]| {
        let one = |c: Camera| {
            let eye = scale * (turn * c.position()) + glam::DVec3::from_array(shift);
            let rotation = c.rotation * turn.transpose();
            Camera { rotation, translation: -(rotation * eye), ..c }
        };
        cameras().into_iter().map(one).collect::<Vec<_>>()
    };
    let upright = glam::DMat3::IDENTITY;
    [
        ("other axes", moved(turn, 1.0, [0.0; 3])),
        ("another unit", moved(upright, 0.3, [0.0; 3])),
        ("another frame", moved(turn, 4.3, [0.1, -0.2, 0.05])),
    ]
}

#[test]
fn cameras_of_another_frame_are_named_and_decide_nothing() {
    let dir = Folder::new();
    let [json, with, without] = ["cameras.json", "with.gsvx", "without.gsvx"].map(|n| dir.join(n));
    let input = model();
    common::ok("encode @ -o @", &[&input, &without]);
    for (name, cameras) in misfits() {
        write_json(&json, &cameras);
        let words = "encode @ -o @ --force --cameras @";
        let (made, said) = report(words, &[&input, &with, &json]);
        assert!(
            said.contains("are they its own?") && said.contains("dataparser_transforms.json"),
            "{name}: {said}"
        );
        assert_eq!(made["cameras_doubted"], true, "{name}");
        // What they see decides nothing.
        assert!(std::fs::read(&with).unwrap() == std::fs::read(&without).unwrap(), "{name}");
        // Nor of a model that is encoded tile by tile.
        let (_, said) = report(&format!("{words} --memory 1G"), &[&input, &with, &json]);
        assert!(said.contains("dataparser_transforms.json"), "{name}: {said}");
        assert!(std::fs::read(&with).unwrap() == std::fs::read(&without).unwrap(), "{name}");
        // Whoever asks for what they see is told what that is at views of the model.
        let (made, _) = report(&format!("{words} --drop-unseen"), &[&input, &with, &json]);
        let (told, truth) = (made["estimated_loss"]["psnr"].as_f64().unwrap(), psnr(&with));
        assert!(told < truth + 3.0, "{name}: told {told} dB, in truth {truth} dB");
        // Tuning to renders refuses.
        let tune = "tune @ -o @ --force --distil --effort quick --cameras @";
        let refused = run(tune, &[&input, &with, &json]);
        assert!(!refused.status.success() && heard(&refused).contains("--orbit 60"), "{name}");
    }
}

#[test]
fn photos_that_show_something_else_keep_their_cameras_from_deciding() {
    let dir = Folder::new();
    room_cameras(&dir, "");
    let images = dir.join("images");
    std::fs::create_dir_all(&images).unwrap();
    let photos = cameras();
    for (i, camera) in photos.iter().enumerate() {
        let other = &photos[(i + photos.len() / 2) % photos.len()];
        std::fs::copy(room().join("images").join(&other.name), images.join(&camera.name)).unwrap();
    }
    let stream = dir.join("a.gsvx");
    let words = "encode @ -o @ --cameras @";
    let (made, said) = report(words, &[&model(), &stream, &dir]);
    assert!(said.contains("the photos do not show this model"), "{said}");
    assert_eq!(made["cameras_doubted"], true);
    // Tile by tile too, and before the cameras decide what is kept.
    let unseeing = std::fs::read(&stream).unwrap();
    let by_tiles = format!("{words} --force --memory 1G");
    let (_, said) = report(&by_tiles, &[&model(), &stream, &dir]);
    assert!(said.contains("the photos do not show this model"), "{said}");
    assert!(std::fs::read(&stream).unwrap() == unseeing);
    for way in ["", " --memory 1G"] {
        let drop = format!("{words} --drop-unseen --force{way}");
        common::failed(&run(&drop, &[&model(), &stream, &dir]), "--drop-unseen");
    }
}

#[test]
fn cameras_stand_where_a_model_far_from_the_origin_does() {
    let dir = Folder::new();
    let [model, json, stream] = ["far.ply", "cameras.json", "a.gsvx"].map(|name| dir.join(name));
    let (mut scene, _) = gs_model::ply::read(common::model()).unwrap();
    let far = [4.5e5, 5.2e6, 120.0];
    scene.origin = far;
    gs_model::ply::write(&model, &scene).unwrap();
    write_json(
        &json,
        &cameras().into_iter().map(|c| c.relative_to(far.map(|x| -x))).collect::<Vec<_>>(),
    );
    let words = "encode @ -o @ --cameras @";
    let (made, said) = report(words, &[&model, &stream, &json]);
    assert!(made["seen_opacity_share"].as_f64().unwrap() > 0.9, "{said}");
    let compare = "compare @ @ --every 8 --cameras @";
    let (judged, _) = report(compare, &[&model, &stream, &json]);
    assert!(judged["psnr"].as_f64().unwrap() > 40.0, "{judged}");
}

#[test]
fn a_model_that_stands_on_its_head_beside_its_photos_is_said_to() {
    let dir = Folder::new();
    let [model, stream] = ["kept.spz", "a.gsvx"].map(|name| dir.join(name));
    // The numbers of a model whose y points down, in a format whose y points up.
    common::ok("convert @ @ --axes keep", &[&common::model(), &model]);
    let words = "encode @ -o @ --force --cameras @";
    let (made, said) = report(words, &[&model, &stream, &room()]);
    assert!(
        said.contains("turned by 180 degrees about x") && said.contains("--axes keep"),
        "{said}"
    );
    assert_eq!(made["cameras_doubted"], true);
    let kept = format!("{words} --axes keep");
    let (made, said) = report(&kept, &[&model, &stream, &room()]);
    assert!(!said.contains("warning") && made["cameras_doubted"] == false, "{said}");
}

#[test]
fn keeping_what_cameras_hardly_see_costs_at_most_a_twenty_fifth_of_the_bytes() {
    let dir = Folder::new();
    let (json, stream) = (dir.join("cameras.json"), dir.join("a.gsvx"));
    // The room's cameras but for those that look one way.
    let mut most = cameras();
    most.retain(|c| c.rotation.row(2).x > -0.8);
    write_json(&json, &most);
    let input = model();
    let words = "encode @ -o @ --force --quality 62 --cameras @";
    let (kept, _) = report(words, &[&input, &stream, &json]);
    assert!(kept["hardly_seen_kept"].as_u64().unwrap() > 0, "{kept}");
    let out = run(words, &[&input, &stream, &json]);
    let said = String::from_utf8(out.stdout).unwrap();
    let both = format!(
        "{} Gaussians that no camera sees and {} hardly seen: {} of them kept",
        kept["unseen"], kept["hardly_seen"], kept["hardly_seen_kept"]
    );
    assert!(said.contains(&both) && said.contains("--drop-unseen"), "{said}");
    let (dropped, _) = report(&format!("{words} --drop-unseen"), &[&input, &stream, &json]);
    let [kept, dropped] = [kept, dropped].map(|report| report["bytes"].as_f64().unwrap());
    assert!(kept < 1.04 * dropped, "{kept} against {dropped}");
}

#[test]
fn a_lens_that_distorts_is_named_where_renders_do_not_show_it() {
    let dir = Folder::new();
    room_cameras(&dir, " -0.05 0.01 0 0");
    let views = dir.join("views");
    let (project, input) = (&dir, model());
    let render = "render @ -o @ --every 8 --cameras @";
    let (_, said) = report(render, &[&input, &views, project]);
    assert!(said.contains("lens distortion (OPENCV)"), "{said}");
    // Importance sees what the photos show.
    let encode = "encode @ -o @ --no-estimate --cameras @";
    let (json, said) = report(encode, &[&input, &dir.join("a.gsvx"), project]);
    assert!(!said.contains("distortion"), "{said}");
    assert!(json["seen_opacity_share"].as_f64().unwrap() > 0.9, "{json}");
}

#[test]
fn a_tune_refuses_photos_of_another_scene() {
    let dir = Folder::new();
    let images = dir.join("images");
    std::fs::create_dir_all(&images).unwrap();
    room_cameras(&dir, "");
    for camera in cameras() {
        let pattern = |x: u32, y: u32| image::Rgb([(x * 40) as u8, (y * 90) as u8, 255]);
        let photo = image::RgbImage::from_fn(camera.width, camera.height, pattern);
        photo.save(images.join(&camera.name)).unwrap();
    }
    let tuned = dir.join("tuned.ply");
    let refused = heard(&run("tune @ -o @ --cameras @", &[&model(), &tuned, &dir]));
    assert!(refused.contains("do not show this model"), "{refused}");
}

/// A transforms.json with the room's first cameras.
fn write_transforms(path: &Path, count: usize, extra: &Value) {
    let frame = |c: &Camera| {
        let (to_world, p) = (c.rotation.transpose(), c.position());
        let row = |k: usize| [to_world.x_axis[k], -to_world.y_axis[k], -to_world.z_axis[k], p[k]];
        serde_json::json!({ "file_path": c.name, "transform_matrix": [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]] })
    };
    let cameras = cameras();
    let frames: Vec<Value> = cameras.iter().take(count).map(frame).collect();
    let mut all = serde_json::json!({
        "w": 240, "h": 160, "fl_x": 195.0, "frames": frames,
    });
    all.as_object_mut().unwrap().append(extra.clone().as_object_mut().unwrap());
    std::fs::write(path, all.to_string()).unwrap();
}

/// Gaussians all around.
fn write_shell(path: &Path) {
    let n = 4000;
    let direction = |i: usize| {
        let z = 1.0 - 2.0 * (i as f64 + 0.5) / n as f64;
        let (sin, cos) = libm::sincos(i as f64 * 2.399_963);
        let r = (1.0 - z * z).sqrt();
        [r * cos, r * sin, z].map(|v| (4.0 * v) as f32)
    };
    let scene = Scene {
        means: (0..n).map(direction).collect(),
        rotations: vec![[1.0, 0.0, 0.0, 0.0]; n],
        log_scales: vec![[-2.5; 3]; n],
        opacity_logits: vec![3.0; n],
        sh_degree: 0,
        sh: (0..n).map(|i| [0, 1, 2].map(|k| ((i * (k + 3)) % 17) as f32 / 9.0 - 0.9)).collect(),
        ..Scene::default()
    };
    gs_model::ply::write(path, &scene).unwrap();
}

#[test]
fn what_a_panorama_or_a_fisheye_shows_is_kept() {
    let dir = Folder::new();
    let [shell, json, stream] =
        ["shell.ply", "transforms.json", "a.gsvx"].map(|name| dir.join(name));
    write_shell(&shell);
    let words = "encode @ -o @ --force --drop-unseen --no-estimate --cameras @";
    let unit = |k: usize, x: f64| {
        [0, 1, 2, 3].map(|i| if i == 3 { x } else { f64::from(u8::from(i == k)) })
    };
    let frame = |i: usize| {
        serde_json::json!({"file_path": format!("{i}.jpg"),
            "transform_matrix": [unit(0, 0.1 * i as f64), unit(1, 0.0), unit(2, 0.0)]})
    };
    let frames: Vec<Value> = (0..4).map(frame).collect();
    let mut all = serde_json::json!({"camera_model": "EQUIRECTANGULAR", "w": 1024, "h": 512, "frames": frames});
    std::fs::write(&json, all.to_string()).unwrap();
    let (panorama, _) = report(words, &[&shell, &stream, &json]);
    assert_eq!(panorama["left_out"], 0, "{panorama}");
    // 190 degrees across: a half, and more.
    all["camera_model"] = "OPENCV_FISHEYE".into();
    (all["w"], all["h"], all["fl_x"]) = (600.into(), 600.into(), 180.9.into());
    std::fs::write(&json, all.to_string()).unwrap();
    let (fisheye, _) = report(words, &[&shell, &stream, &json]);
    let (of_all, left) = (4000, fisheye["left_out"].as_u64().unwrap());
    assert!((0..of_all * 45 / 100).contains(&left), "{fisheye}");
    // No picture stands for it, and no photo becomes one.
    let render = "render @ -o @ --cameras @";
    one_line(&run(render, &[&shell, &dir.join("out"), &json]), "degrees to a side");
    all["camera_model"] = "ORTHOPHOTO".into();
    std::fs::write(&json, all.to_string()).unwrap();
    one_line(&run(words, &[&shell, &stream, &json]), "the lens model ORTHOPHOTO is not known");
}

#[test]
fn every_command_says_which_cameras_it_uses() {
    let dir = Folder::new();
    let [json, stream, views] = ["transforms.json", "a.gsvx", "views"].map(|name| dir.join(name));
    write_transforms(&json, 9, &serde_json::json!({}));
    let input = model();
    let encode = "encode @ -o @ --force --no-estimate --cameras @";
    let (encoded, _) = report(encode, &[&input, &stream, &json]);
    let path = json.display().to_string();
    let wanted = serde_json::json!({"path": path, "form": "NeRF", "count": 9, "used": 7});
    assert_eq!(encoded["cameras"], wanted);
    let said = String::from_utf8(run(encode, &[&input, &stream, &json]).stdout).unwrap();
    let line = format!("9 cameras from {path} (NeRF): 7 for training, 2 held out for measuring");
    assert!(said.contains(&line), "{said}");
    let render = "render @ -o @ --every 8 --cameras @";
    let said = String::from_utf8(run(render, &[&input, &views, &json]).stdout).unwrap();
    assert!(said.contains("(NeRF): 2 are drawn, the first and every 8th after it"), "{said}");
    let compare = "compare @ @ --view view_003.png --cameras @";
    let (compared, _) = report(compare, &[&input, &stream, &json]);
    assert_eq!(
        (&compared["cameras"]["count"], &compared["cameras"]["used"]),
        (&9.into(), &1.into())
    );
    let tune = "tune @ -o @ --force --distil --effort quick --quality 20 --cameras @";
    let (tuned, said) = report(tune, &[&input, &stream, &json]);
    assert!(said.contains(&line) && said.matches("cameras from").count() == 1, "{said}");
    assert_eq!(tuned["cameras"], wanted);
}

#[test]
fn equal_names_of_cameras_are_no_error_where_no_photo_is_needed() {
    let dir = Folder::new();
    let (json, stream) = (dir.join("cameras.json"), dir.join("a.gsvx"));
    let mut all = cameras();
    all.truncate(10);
    for camera in &mut all[3..6] {
        camera.name = "0001.png".into();
    }
    write_json(&json, &all);
    let input = model();
    let words = "encode @ -o @ --no-estimate --cameras @";
    let (encoded, said) = report(words, &[&input, &stream, &json]);
    assert_eq!(encoded["cameras"]["count"], 10);
    assert!(said.matches("names that others have too").count() == 1, "{said}");
    let views = dir.join("views");
    let render = "render @ -o @ --cameras @";
    common::said(&run(render, &[&input, &views, &json]));
    assert!(views.join("0001 (3).png").is_file());
}
