//! Sequences: frames in, frames out, and what is said of frames that do not fit.

mod common;

use common::{Folder, failed, json, ok, one_line, run, wrong_usage};
use gs_model::{Scene, ply};
use std::path::{Path, PathBuf};

/// So many frames in a folder of their own, in which a tenth of the Gaussians moves.
fn frames(dir: &Folder, count: usize) -> PathBuf {
    let folder = dir.join("frames");
    std::fs::create_dir_all(&folder).unwrap();
    for t in 0..count {
        let mut scene = common::scene();
        scene.means.iter_mut().step_by(10).for_each(|mean| mean[1] += 0.01 * t as f32);
        ply::write(name(&folder, t), &scene).unwrap();
    }
    folder
}

fn name(folder: &Path, number: usize) -> PathBuf {
    folder.join(format!("frame_{number}.ply"))
}

fn read(path: &Path) -> Scene {
    ply::read(path).unwrap().0
}

#[test]
fn frames_become_a_sequence_and_come_back() {
    let dir = Folder::new();
    let (folder, clip) = (frames(&dir, 12), dir.join("clip.gsvx"));
    let said = json("encode @ -o @ --fps 24 --group 8", &[&folder, &clip]);
    assert_eq!((&said["frames"], &said["groups"]), (&12.into(), &2.into()));
    assert_eq!(said["fps"], 24.0);
    let said = json("info @", &[&clip]);
    assert_eq!((&said["frames"], &said["fps"]), (&12.into(), &24.0.into()));
    assert_eq!(said["groups"][1]["frames"], serde_json::json!([8, 12]));
    assert!(said["bytes_per_second"].as_u64() == Some(2 * said["bytes"].as_u64().unwrap()));
    assert!(said["faults"].as_array().unwrap().is_empty());
    assert!(ok("info @", &[&clip]).contains("frames         12, 24 per second"));
    // Frame 10 is a group's third, after frame 9 by number, not by name.
    let (one, some) = (dir.join("one.ply"), dir.join("some"));
    ok("decode @ -o @ --frame 10", &[&clip, &one]);
    ok("decode @ -o @ --frames 6..11", &[&clip, &some]);
    assert_eq!(std::fs::read_dir(&some).unwrap().count(), 5);
    assert_eq!(read(&some.join("frame_0010.ply")), read(&one));
    let mean = |scene: &Scene| scene.means.iter().map(|m| f64::from(m[1])).sum::<f64>();
    let moved = |scene: Scene| mean(&scene) / scene.len() as f64;
    let first = moved(read(&some.join("frame_0006.ply")));
    let fourth = moved(read(&one));
    assert!((fourth - first - 0.004).abs() < 0.001, "{first} {fourth}");
}

#[test]
fn what_does_not_fit_is_one_line() {
    let dir = Folder::new();
    let (folder, clip) = (frames(&dir, 3), dir.join("clip.gsvx"));
    let encode = |folder: &Path| run("encode @ -o @ --fps 30 --force", &[folder, &clip]);
    // Two frames are a sequence; one is a static stream, which is said.
    std::fs::remove_file(name(&folder, 2)).unwrap();
    assert!(encode(&folder).status.success());
    one_line(&run("decode @ -o @", &[&clip, &dir.join("a.ply")]), "sequence of 2 frames");
    one_line(&run("decode @ -o @ --frame 2", &[&clip, &dir.join("a.ply")]), "no frame 2");
    failed(&run("convert @ @", &[&clip, &dir.join("a.ply")]), "gsvx decode --frame");
    wrong_usage(&run("decode @ -o @ --frames 2..2", &[&clip, &dir.join("a")]), "10..20");
    std::fs::remove_file(name(&folder, 1)).unwrap();
    assert!(common::heard(&encode(&folder)).contains("a static stream"));
    ok("decode @ -o @", &[&clip, &dir.join("a.ply")]);

    let folder = frames(&dir, 4);
    std::fs::remove_file(name(&folder, 2)).unwrap();
    one_line(&encode(&folder), "frame 2 is missing");
    // Without a rate, models are one scene, which is said of those that could be frames.
    let both = |a: &Path, b: &Path| common::heard(&run("encode @ @ -o @ --force", &[a, b, &clip]));
    let said = both(&name(&folder, 0), &name(&folder, 1));
    assert!(said.contains("2 numbered models become one scene; pass --fps"), "{said}");
    assert!(!both(&name(&folder, 0), &name(&folder, 3)).contains("--fps"));
    one_line(&run("encode @ -o @ --force", &[&folder, &clip]), "--fps");
    let mut scene = common::scene();
    scene.means[7][0] = f32::NAN;
    ply::write(name(&folder, 2), &scene).unwrap();
    one_line(&encode(&folder), "frame_2.ply");
    let mut scene = common::scene();
    let degree = scene.sh_degree;
    scene.cut_sh(0);
    assert!(degree > 0);
    ply::write(name(&folder, 2), &scene).unwrap();
    one_line(&encode(&folder), "--max-sh-degree 0 makes all alike");
    let alike = "encode @ -o @ --fps 30 --force --max-sh-degree 0";
    assert!(run(alike, &[&folder, &clip]).status.success());
    std::fs::rename(name(&folder, 2), folder.join("frame_2.spz")).unwrap();
    one_line(&encode(&folder), "different formats");
    let empty = dir.join("empty");
    std::fs::create_dir(&empty).unwrap();
    one_line(&encode(&empty), "holds no model");
}

#[test]
fn what_no_frame_draws_and_what_stands_still_is_said() {
    let dir = Folder::new();
    let folder = frames(&dir, 2);
    for frame in 0..2 {
        let mut scene = read(&name(&folder, frame));
        scene.opacity_logits[..3].fill(-9.0);
        scene.means[5] = [1e9, 0.0, 0.0];
        ply::write(name(&folder, frame), &scene).unwrap();
    }
    let clip = dir.join("clip.gsvx");
    let heard = common::heard(&run("encode @ -o @ --fps 30", &[&folder, &clip]));
    assert!(heard.contains("3 left out that no rasterizer draws"), "{heard}");
    assert!(heard.contains("1 Gaussian far from all others"), "{heard}");
}

#[test]
fn what_is_whole_of_a_cut_sequence_is_salvaged() {
    let dir = Folder::new();
    let (folder, clip) = (frames(&dir, 6), dir.join("clip.gsvx"));
    ok("encode @ -o @ --fps 30 --group 2", &[&folder, &clip]);
    let bytes = std::fs::read(&clip).unwrap();
    std::fs::write(&clip, &bytes[..bytes.len() - 9]).unwrap();
    let out = dir.join("out");
    one_line(&run("decode @ -o @ --frames 0..6", &[&clip, &out]), "--salvage");
    let said = json("decode @ -o @ --frames 0..6 --salvage", &[&clip, &out]);
    assert_eq!(said["frames"], 4);
    assert!(said["skipped"][0].as_str().unwrap().starts_with("frames 4 to 5: stream truncated"));
    let info = json("info @", &[&clip]);
    assert_eq!(info["faults"].as_array().unwrap().len(), 1);
}

#[test]
fn frames_of_sequences_are_compared() {
    let dir = Folder::new();
    let (folder, clip) = (frames(&dir, 4), dir.join("clip.gsvx"));
    ok("encode @ -o @ --fps 30 --group 2 --quality 60", &[&folder, &clip]);
    let views = "--orbit 2 --size 64x48";
    let found = json(&format!("compare @ @ {views}"), &[&folder, &clip]);
    let frames = found["frames"].as_array().unwrap();
    assert_eq!((frames.len(), frames[2]["frame"].as_u64()), (3, Some(2)));
    let of = |what: &str| found[what].as_f64().unwrap();
    let mean = frames.iter().map(|f| f["psnr"].as_f64().unwrap()).sum::<f64>() / 3.0;
    assert!(of("psnr") > 25.0 && (of("psnr") - mean).abs() < 1e-9, "{found}");
    // Most errors of a frame are those of the frame before.
    assert!(of("flicker") > of("psnr") + 3.0, "{found}");
    let human = ok(&format!("compare @ @ {views} --frames 3"), &[&folder, &clip]);
    assert!(human.contains("worst: frame 3") && human.contains("none of these frames"), "{human}");
    // A quoted pattern, and equal frames.
    let pattern = folder.join("*_?.ply");
    let same = json(&format!("compare @ @ {views} --frames 0,2"), &[&folder, &pattern]);
    assert!(same["psnr"].is_null() && same["flicker"].is_null() && same["ssim"] == 1.0, "{same}");

    let compare =
        |model: &Path, flags: &str| run(&format!("compare @ @ {views}{flags}"), &[&folder, model]);
    one_line(&compare(&name(&folder, 0), ""), "has 4 frames");
    wrong_usage(&compare(&clip, " --frames 4"), "no frame 4");
    wrong_usage(&compare(&clip, " -o pictures"), "--output");
    let model = name(&folder, 0);
    let two = run(&format!("compare @ @ {views} --frames 0"), &[&model, &model]);
    wrong_usage(&two, "neither");
}

#[test]
fn a_sequence_has_a_size_per_second_and_an_estimate_of_its_loss() {
    let dir = Folder::new();
    let (folder, clip) = (frames(&dir, 6), dir.join("clip.gsvx"));
    let encode =
        |flags: &str| json(&format!("encode @ -o @ --fps 3 --force {flags}"), &[&folder, &clip]);
    let [low, high] = ["--quality 20", "--quality 90"].map(encode);
    let psnr = |said: &serde_json::Value| said["estimated_loss"]["psnr"].as_f64().unwrap();
    assert!(psnr(&low) + 5.0 < psnr(&high) && psnr(&high) < 99.0, "{low} {high}");
    assert_eq!(low["estimated_loss"]["views"], 4);
    assert!(encode("--no-estimate")["estimated_loss"].is_null());

    let bytes = |said: &serde_json::Value| said["bytes"].as_u64().unwrap();
    let most = (bytes(&low) + bytes(&high)) / 4;
    let said = encode(&format!("--target-bytes {most}"));
    // Two seconds.
    let share = bytes(&said) as f64 / (2 * most) as f64;
    assert!((0.9..=1.0).contains(&share) && said["target_reached"] == true, "{share} {said}");
    let out = run("encode @ -o @ --fps 3 --force --target-bytes 10", &[&folder, &clip]);
    let heard = common::heard(&out);
    assert!(out.status.code() == Some(3) && heard.contains("at quality 0"), "{heard}");
}

#[test]
fn gaussians_that_move_by_formulas_become_a_sequence() {
    let dir = Folder::new();
    let (model, clip) = (dir.join("spacetime.ply"), dir.join("clip.gsvx"));
    let mut rng = testing::Rng::seeded(2);
    let width = testing::SPACETIME.split_whitespace().count();
    // Half of the Gaussians is there throughout and moves along x, half in the first half of the time.
    let row = |i: usize| {
        let mut row: Vec<f32> = (0..width).map(|_| rng.range_f32(0.1, 1.0)).collect();
        (row[3], row[4]) = if i.is_multiple_of(2) { (0.0, 2.0) } else { (0.0, -2.0) };
        row[8..17].fill(0.0);
        row[8] = 1.0;
        row[20] = 3.0;
        row[21..24].fill(-3.0);
        row[28..].fill(0.0);
        row
    };
    let rows: Vec<Vec<f32>> = (0..400).map(row).collect();
    std::fs::write(&model, testing::float_ply("", testing::SPACETIME, &rows)).unwrap();
    let said = json("encode @ -o @ --fps 20 --frames 10 --group 5 --quality 90", &[&model, &clip]);
    assert_eq!((&said["frames"], &said["groups"]), (&10.into(), &2.into()));
    assert!(said["estimated_loss"]["psnr"].as_f64().unwrap() > 30.0, "{said}");
    ok("decode @ -o @ --frames 0..10", &[&clip, &dir.join("out")]);
    let frame = |t: usize| read(&dir.join("out").join(format!("frame_{t:04}.ply")));
    assert!(frame(0).len() > 350 && frame(9).len() <= 200, "{} {}", frame(0).len(), frame(9).len());
    let mean = |scene: &Scene| {
        scene.means.iter().map(|m| f64::from(m[0])).sum::<f64>() / scene.len() as f64
    };
    let moved = mean(&frame(9)) - mean(&frame(5));
    assert!((moved - 0.4).abs() < 0.01, "{moved}");

    let views = "--orbit 2 --size 64x48";
    let found = json(&format!("compare @ @ {views}"), &[&model, &clip]);
    assert!(found["frame_count"] == 10 && found["psnr"].as_f64().unwrap() > 30.0, "{found}");
    let compare = |other: &Path| run(&format!("compare @ @ {views}"), &[&model, other]);
    one_line(&compare(&model), "state no number of frames");

    let encode = |flags: &str, model: &Path| {
        run(&format!("encode @ -o @ --force --fps 20{flags}"), &[model, &clip])
    };
    wrong_usage(&encode("", &model), "their number as --frames");
    failed(&run("view --no-open @", &[&model]), "gsvx encode --fps");
    wrong_usage(&encode(" --frames 10", &frames(&dir, 3)), "--frames is for");
    failed(&run("convert @ @", &[&model, &dir.join("a.ply")]), "gsvx encode --fps");
}
