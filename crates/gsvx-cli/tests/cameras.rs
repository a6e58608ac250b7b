//! What `encode` and `tune` do with cameras and photos that do not fit the model.

mod common;

use common::{heard, model, one_line, report, room, room_cameras, run};
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
fn cameras_that_do_not_show_the_scene_deleted_it() {
    let dir = tempfile::tempdir().unwrap();
    let (json, stream) = (dir.path().join("cameras.json"), dir.path().join("a.gsvx"));
    let input = model();
    // Cameras that look into the void beside the room.
    write_json(&json, &looking([90.0, 90.0, 90.0], [180.0, 180.0, 180.0]));
    let words = ["encode", "@", "-o", "@", "--cameras", "@"];
    one_line(&run(&words, &[&input, &stream, &json]), "see nothing of the model");
    assert!(!stream.exists());
    // Cameras close to a wall: they see a little of it.
    let mut near = cameras().swap_remove(3);
    (near.fx, near.fy) = (20.0 * near.fx, 20.0 * near.fy);
    let second = Camera { name: "second".into(), ..near.clone() };
    write_json(&json, &[near, second]);
    let (kept, said) = report(&words, &[&input, &stream, &json]);
    assert!(said.contains("warning") && said.contains("of the model's opacity"), "{said}");
    assert!(kept["seen_opacity_share"].as_f64().unwrap() < 0.5, "{kept}");
    assert!(kept["unseen"].as_u64().unwrap() > 5000, "{kept}");
    assert!(kept["left_out"].as_u64().unwrap() < 1000, "{kept}");
    let all_around = psnr(&stream);
    assert!(all_around > 25.0, "{all_around} dB: no picture");
    // Whoever asks for it gets what the cameras see, and is told what is missing.
    let only = [&words[..], &["--drop-unseen", "--force"]].concat();
    let (dropped, _) = report(&only, &[&input, &stream, &json]);
    assert!(dropped["left_out"].as_u64().unwrap() > 5000, "{dropped}");
    assert!(dropped["bytes"].as_u64() < kept["bytes"].as_u64());
    let out = run(&only, &[&input, &stream, &json]);
    let said = String::from_utf8(out.stdout).unwrap();
    assert!(said.contains("hardly seen are left out"), "{said}");
    // What no rasterizer draws is unseen too.
    assert_eq!(
        sum(&dropped, ["unseen", "hardly_seen"]),
        sum(&dropped, ["left_out", "transparent"])
    );
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
    let dir = tempfile::tempdir().unwrap();
    let [json, with, without] =
        ["cameras.json", "with.gsvx", "without.gsvx"].map(|n| dir.path().join(n));
    let input = model();
    common::ok(&["encode", "@", "-o", "@"], &[&input, &without]);
    for (name, cameras) in misfits() {
        write_json(&json, &cameras);
        let words = ["encode", "@", "-o", "@", "--force", "--cameras", "@"];
        let (made, said) = report(&words, &[&input, &with, &json]);
        assert!(
            said.contains("are they its own?") && said.contains("dataparser_transforms.json"),
            "{name}: {said}"
        );
        assert_eq!(made["cameras_doubted"], true, "{name}");
        // What they see decides nothing.
        assert!(std::fs::read(&with).unwrap() == std::fs::read(&without).unwrap(), "{name}");
        // Whoever asks for what they see is told what that is at views of the model.
        let (made, _) = report(&[&words[..], &["--drop-unseen"]].concat(), &[&input, &with, &json]);
        let (told, truth) = (made["estimated_loss"]["psnr"].as_f64().unwrap(), psnr(&with));
        assert!(told < truth + 3.0, "{name}: told {told} dB, in truth {truth} dB");
        // Tuning to renders refuses.
        let tune =
            ["tune", "@", "-o", "@", "--force", "--distil", "--effort", "quick", "--cameras", "@"];
        let refused = run(&tune, &[&input, &with, &json]);
        assert!(!refused.status.success() && heard(&refused).contains("--orbit 60"), "{name}");
    }
}

#[test]
fn photos_that_show_something_else_keep_their_cameras_from_deciding() {
    let dir = tempfile::tempdir().unwrap();
    room_cameras(dir.path(), "");
    let images = dir.path().join("images");
    std::fs::create_dir_all(&images).unwrap();
    let photos = cameras();
    for (i, camera) in photos.iter().enumerate() {
        let other = &photos[(i + photos.len() / 2) % photos.len()];
        std::fs::copy(room().join("images").join(&other.name), images.join(&camera.name)).unwrap();
    }
    let stream = dir.path().join("a.gsvx");
    let words = ["encode", "@", "-o", "@", "--cameras", "@"];
    let (made, said) = report(&words, &[&model(), &stream, dir.path()]);
    assert!(said.contains("the photos do not show this model"), "{said}");
    assert_eq!(made["cameras_doubted"], true);
    let drop = [&words[..], &["--drop-unseen", "--force"]].concat();
    one_line(&run(&drop, &[&model(), &stream, dir.path()]), "--drop-unseen");
}

#[test]
fn keeping_what_cameras_hardly_see_cost_a_sixth_of_the_bytes() {
    let dir = tempfile::tempdir().unwrap();
    let (json, stream) = (dir.path().join("cameras.json"), dir.path().join("a.gsvx"));
    // The room's cameras but for those that look one way.
    let mut most = cameras();
    most.retain(|c| c.rotation.row(2).x > -0.8);
    write_json(&json, &most);
    let input = model();
    let words = ["encode", "@", "-o", "@", "--force", "--quality", "62", "--cameras", "@"];
    let (kept, _) = report(&words, &[&input, &stream, &json]);
    assert!(kept["hardly_seen_kept"].as_u64().unwrap() > 0, "{kept}");
    let out = run(&words, &[&input, &stream, &json]);
    let said = String::from_utf8(out.stdout).unwrap();
    let both = format!(
        "{} Gaussians that no camera sees and {} hardly seen: {} of them kept",
        kept["unseen"], kept["hardly_seen"], kept["hardly_seen_kept"]
    );
    assert!(said.contains(&both) && said.contains("--drop-unseen"), "{said}");
    let (dropped, _) =
        report(&[&words[..], &["--drop-unseen"]].concat(), &[&input, &stream, &json]);
    let [kept, dropped] = [kept, dropped].map(|report| report["bytes"].as_f64().unwrap());
    assert!(kept < 1.04 * dropped, "{kept} against {dropped}");
}

#[test]
fn a_lens_that_distorts_is_named_where_no_photo_is_compared() {
    let dir = tempfile::tempdir().unwrap();
    room_cameras(dir.path(), " 0.05 0.01 0 0");
    let stream = dir.path().join("a.gsvx");
    let (project, input) = (dir.path(), model());
    let words = ["encode", "@", "-o", "@", "--cameras", "@"];
    let (json, said) = report(&words, &[&input, &stream, project]);
    assert!(said.contains("lens distortion (OPENCV)"), "{said}");
    assert!(json["seen_opacity_share"].as_f64().unwrap() > 0.9, "{json}");
}

#[test]
fn a_tune_took_photos_of_another_scene_without_a_word() {
    let dir = tempfile::tempdir().unwrap();
    let images = dir.path().join("images");
    std::fs::create_dir_all(&images).unwrap();
    room_cameras(dir.path(), "");
    for camera in cameras() {
        let pattern = |x: u32, y: u32| image::Rgb([(x * 40) as u8, (y * 90) as u8, 255]);
        let photo = image::RgbImage::from_fn(camera.width, camera.height, pattern);
        photo.save(images.join(&camera.name)).unwrap();
    }
    let tuned = dir.path().join("tuned.ply");
    let words = "tune @ -o @ --cameras @ --profile paper --steps 1 --backend cpu --past-input";
    let words: Vec<&str> = words.split(' ').collect();
    let refused = heard(&run(&words, &[&model(), &tuned, dir.path()]));
    assert!(refused.contains("do not show this model"), "{refused}");
    let (_, said) = report(&[&words[..], &["--force"]].concat(), &[&model(), &tuned, &room()]);
    assert!(!said.contains("warning"), "{said}");
}
