//! The command as a person runs it.

mod common;

use common::{model, room};
use gs_model::Scene;
use std::path::Path;
use std::process::{Command, Output};

fn gsvx(args: &[&str]) -> Output {
    common::gsvx().args(args).output().expect("gsvx starts")
}

#[track_caller]
fn ok(args: &[&str]) -> String {
    common::said(&gsvx(args))
}

fn json(text: &str) -> serde_json::Value {
    serde_json::from_str(text).unwrap_or_else(|e| panic!("{e}: {text}"))
}

/// Exit code 1 and exactly one line, which holds `needle`.
fn fails(args: &[&str], needle: &str) {
    println!("{args:?}");
    common::one_line(&gsvx(args), needle);
}

fn path(p: &Path) -> &str {
    p.to_str().expect("test paths are UTF-8")
}

#[test]
fn encode_info_decode() {
    let dir = tempfile::tempdir().unwrap();
    let (model, stream, back) = (model(), dir.path().join("a.gsvx"), dir.path().join("b.ply"));
    let said = ok(&["encode", path(&model), "-o", path(&stream)]);
    assert!(said.contains("bits per Gaussian"), "{said}");
    let said = ok(&["info", path(&stream)]);
    for part in ["head", "base layers", "SH degree 1", "SH degree 2", "SH degree 3"] {
        assert!(said.contains(part), "{said}");
    }
    ok(&["decode", path(&stream), "-o", path(&back)]);
    let (scene, report) = gs_model::ply::read(&back).unwrap();
    assert!(scene.len() > 1000 && report.unknown_properties.is_empty());
    // Replacing needs --force, and a failed run leaves the old file.
    let before = std::fs::read(&back).unwrap();
    fails(&["decode", path(&stream), "-o", path(&back)], "--force");
    assert_eq!(before, std::fs::read(&back).unwrap());
    ok(&["decode", path(&stream), "-o", path(&back), "--force", "--max-sh-degree", "0"]);
    assert_eq!(gs_model::ply::read(&back).unwrap().0.sh_degree, 0);
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 2, "no temporary files left");
}

#[test]
fn targets_are_hit() {
    let dir = tempfile::tempdir().unwrap();
    let (room, stream) = (room(), dir.path().join("a.gsvx"));
    let model = room.join("point_cloud.ply");
    for target in ["40000", "90000"] {
        ok(&["encode", path(&model), "-o", path(&stream), "--force", "--target-bytes", target]);
        let size = std::fs::metadata(&stream).unwrap().len() as f64;
        let share = size / target.parse::<f64>().unwrap();
        assert!((0.99..=1.0).contains(&share), "{target}: {share}");
    }
    ok(&[
        "encode",
        path(&model),
        "-o",
        path(&stream),
        "--force",
        "--target-psnr",
        "34",
        "--cameras",
        path(&room),
    ]);
}

#[test]
fn lossless_returns_every_bit() {
    let dir = tempfile::tempdir().unwrap();
    let (model, stream, back) = (model(), dir.path().join("a.gsvx"), dir.path().join("b.ply"));
    ok(&["encode", path(&model), "-o", path(&stream), "--lossless"]);
    ok(&["decode", path(&stream), "-o", path(&back)]);
    let rows = |p: &Path| {
        let (s, _) = gs_model::ply::read(p).unwrap();
        let mut rows: Vec<Vec<u32>> = (0..s.len()).map(|i| row(&s, i)).collect();
        rows.sort();
        rows
    };
    assert!(rows(&model) == rows(&back), "some float changed");
}

fn row(s: &Scene, i: usize) -> Vec<u32> {
    let sh = s.sh_of(i).as_flattened();
    let parts: [&[f32]; 5] =
        [&s.means[i], &s.rotations[i], &s.log_scales[i], &s.opacity_logits[i..=i], sh];
    parts.concat().iter().map(|v| v.to_bits()).collect()
}

#[test]
fn mistakes_get_one_line() {
    let dir = tempfile::tempdir().unwrap();
    let file = |name: &str, bytes: &[u8]| {
        let p = dir.path().join(name);
        std::fs::write(&p, bytes).unwrap();
        p
    };
    let model = std::fs::read(model()).unwrap();
    let (out, back) = (dir.path().join("out.gsvx"), dir.path().join("back.ply"));
    let (out, back) = (path(&out), path(&back));
    let whole = file("whole.ply", &model);
    let encode = |p: &Path, needle: &str| fails(&["encode", path(p), "-o", out], needle);
    encode(&dir.path().join("absent.ply"), "absent.ply");
    encode(&file("empty.ply", b""), "empty.ply");
    encode(&file("text.ply", b"hello"), "text.ply");
    encode(&file("cut.ply", &model[..model.len() / 2]), "cut.ply");
    let header =
        b"ply\nformat binary_little_endian 1.0\nelement vertex 9\nproperty float x\nend_header\n";
    encode(&file("bare.ply", header), "bare.ply");
    // The first float of the first row becomes NaN.
    let start = model.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    let mut nan = model.clone();
    nan[start..start + 4].copy_from_slice(&f32::NAN.to_le_bytes());
    let nan = file("nan.ply", &nan);
    encode(&nan, "--drop-invalid");
    let dropped = dir.path().join("dropped.gsvx");
    ok(&["encode", path(&nan), "-o", path(&dropped), "--drop-invalid"]);
    fails(&["convert", path(&whole), path(dir.path()), "--to", "ply"], "directory");
    fails(&["encode", path(&whole), "-o", "/nonexistent-folder/a.gsvx"], "no such directory");
    fails(&["encode", path(&whole), "-o", out, "--cameras", path(dir.path())], "camera");
    fails(&["decode", path(&whole), "-o", back], "not a gsvx stream");
    let stream = dir.path().join("s.gsvx");
    ok(&["encode", path(&whole), "-o", path(&stream)]);
    let bytes = std::fs::read(&stream).unwrap();
    let cut = file("cut.gsvx", &bytes[..bytes.len() - 10]);
    fails(&["decode", path(&cut), "-o", back], "truncated");
    ok(&["decode", path(&cut), "-o", back, "--allow-truncated"]);
    let mut flipped = bytes.clone();
    let middle = flipped.len() / 2;
    flipped[middle] ^= 4;
    fails(&["decode", path(&file("flip.gsvx", &flipped)), "-o", back, "--force"], "CRC-32C");
}

#[test]
fn a_short_finetune_writes_a_stream_that_decodes() {
    let dir = tempfile::tempdir().unwrap();
    let (room, stream, back) = (room(), dir.path().join("a.gsvx"), dir.path().join("b.ply"));
    let model = room.join("point_cloud.ply");
    let said = ok(&[
        "tune",
        "--profile",
        "paper",
        path(&model),
        "--cameras",
        path(&room),
        "-o",
        path(&stream),
        "--steps",
        "20",
        "--backend",
        "cpu",
    ]);
    assert!(said.contains("20 steps"), "{said}");
    ok(&["decode", path(&stream), "-o", path(&back)]);
    let wrong = dir.path().join("x.txt");
    let out = gsvx(&["tune", path(&model), "--cameras", path(&room), "-o", path(&wrong)]);
    common::wrong_usage(&out, ".gsvx or .ply");
}

#[test]
fn pipes_threads_and_json() {
    let dir = tempfile::tempdir().unwrap();
    let model = model();
    let (one, two) = (dir.path().join("1.gsvx"), dir.path().join("2.gsvx"));
    let said = json(&ok(&["encode", path(&model), "-o", path(&one), "--threads", "1", "--json"]));
    assert_eq!(said["bytes"], std::fs::metadata(&one).unwrap().len());
    assert!(said["parts"]["base layers"].as_u64().unwrap() > 100, "{said}");
    ok(&["--threads", "3", "encode", path(&model), "-o", path(&two)]);
    let stream = std::fs::read(&one).unwrap();
    assert!(stream == std::fs::read(&two).unwrap(), "the bytes depend on the number of threads");
    let piped = common::piped(&["encode", "-", "-o", "-"], &std::fs::read(&model).unwrap());
    assert!(piped.status.success() && piped.stdout == stream);
    // The report goes where the data does not.
    assert!(String::from_utf8_lossy(&piped.stderr).contains("bits per Gaussian"));
    let ply = common::piped(&["decode", "-", "-o", "-"], &stream);
    let (scene, _) = gs_model::ply::read_bytes(&ply.stdout).unwrap();
    let info = json(&ok(&["info", path(&one), "--json"]));
    assert_eq!(info["gaussians"], scene.len());
    assert_eq!(info["expected_bytes"], stream.len());
    let usage = gsvx(&["encode", path(&model)]);
    assert_eq!(usage.status.code(), Some(2), "no output given");
}

/// Of the golden streams.
#[test]
fn info_tells_chunks_and_levels_of_detail() {
    let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures/streams");
    let info = |name: &str| json(&ok(&["info", path(&golden.join(name)), "--json"]));
    assert!(info("chunks.gsvx")["chunks"].as_array().unwrap().len() > 1);
    let levels = info("lod.gsvx")["levels_of_detail"].as_u64().unwrap();
    assert!(levels > 1);
    assert_eq!(info("default.gsvx")["levels_of_detail"], 1);
    let text = ok(&["info", path(&golden.join("lod.gsvx"))]);
    assert!(text.contains("level 1") && text.contains("coarse levels"), "{text}");
}

/// Three floaters a million units away are coded exactly.
#[test]
fn floaters_are_trimmed() {
    let dir = tempfile::tempdir().unwrap();
    let [model, stream, back] = ["m.ply", "a.gsvx", "b.ply"].map(|name| dir.path().join(name));
    let (mut scene, _) = gs_model::ply::read(common::model()).unwrap();
    let at = [5, 700, scene.len() - 1];
    for (axis, &i) in at.iter().enumerate() {
        scene.means[i][axis] = 1e6;
    }
    gs_model::ply::write(&model, &scene).unwrap();
    let said = ok(&["encode", path(&model), "-o", path(&stream)]);
    assert!(said.contains("3 outliers coded exactly, far from all others: "), "{said}");
    assert!(ok(&["info", path(&stream)]).contains("3 of them bit for bit"));
    ok(&["decode", path(&stream), "-o", path(&back)]);
    let (decoded, _) = gs_model::ply::read(&back).unwrap();
    for (k, &i) in at.iter().enumerate() {
        assert_eq!(row(&decoded, decoded.len() - 3 + k), row(&scene, i));
    }
    let info = json(&ok(&["info", path(&stream), "--json"]));
    assert_eq!((&info["exact_gaussians"], &info["gaussians"]), (&3.into(), &decoded.len().into()));
}

#[test]
fn render_writes_one_png_per_camera() {
    let dir = tempfile::tempdir().unwrap();
    let (model, out) = (model(), dir.path().join("views"));
    let room = room();
    let render = ["render", path(&model), "--cameras", path(&room), "--every", "8"];
    let args = |more: &[&'static str]| [&render[..], &["-o", path(&out)], more].concat();
    let said = json(&ok(&args(&["--json", "--scale", "0.5"])));
    let images = said["images"].as_array().unwrap();
    assert_eq!(images.len(), std::fs::read_dir(&out).unwrap().count());
    let first = image::open(images[0].as_str().unwrap()).unwrap().to_rgb8();
    assert!(first.width() > 16);
    let mean =
        first.as_raw().iter().map(|&v| u64::from(v)).sum::<u64>() / first.as_raw().len() as u64;
    assert!((20..236).contains(&mean), "{mean}");
    fails(&args(&[]), "--force");
    let orbit = dir.path().join("orbit.png");
    ok(&["render", path(&model), "--orbit", "1", "--size", "80x60", "-o", path(&orbit)]);
    assert_eq!(image::image_dimensions(&orbit).unwrap(), (80, 60));
    let two = gsvx(&["render", path(&model), "--orbit", "2", "-o", path(&orbit), "--force"]);
    common::wrong_usage(&two, "folder");
    fails(
        &["render", path(&model), "--cameras", path(&room), "--view", "none", "-o", path(&out)],
        "none",
    );
    assert_eq!(gsvx(&["render", path(&model), "-o", path(&out)]).status.code(), Some(2));
}

#[test]
fn convert_and_compare() {
    let dir = tempfile::tempdir().unwrap();
    let model = model();
    let file = |name: &str| dir.path().join(name);
    let (spz, small, splat) = (file("a.spz"), file("small.spz"), file("a.splat"));
    ok(&["convert", path(&model), path(&spz)]);
    ok(&["convert", path(&model), path(&small), "--spz-sh-bits", "5,4"]);
    ok(&["convert", path(&model), path(&splat)]);
    let len = |p: &Path| std::fs::metadata(p).unwrap().len();
    assert!(len(&small) < len(&spz));
    let compare = |b: &Path| {
        json(&ok(&[
            "compare",
            path(&model),
            path(b),
            "--orbit",
            "3",
            "--size",
            "160x120",
            "--json",
        ]))
    };
    let same = compare(&model);
    assert!(same["psnr"].is_null() && same["ssim"] == 1.0, "{same}");
    assert_eq!(same["attributes"]["mean"], 0.0);
    let psnr = |b: &Path| compare(b)["psnr"].as_f64().unwrap();
    let (fine, coarse, flat) = (psnr(&spz), psnr(&small), psnr(&splat));
    assert!(fine > 40.0 && fine > coarse && coarse > 25.0 && flat > 15.0, "{fine} {coarse} {flat}");
    // A stream is a model too, and its Gaussians are another number in another order.
    let (stream, back) = (file("a.gsvx"), file("b.ply"));
    ok(&["encode", path(&model), "-o", path(&stream), "-q", "90"]);
    let seen = compare(&stream);
    assert_eq!(seen["attributes"]["pairing"], "nearest");
    assert!(seen["psnr"].as_f64().unwrap() > 35.0, "{seen}");
    ok(&["convert", path(&stream), path(&back)]);
    let said = ok(&["compare", path(&stream), path(&back), "--orbit", "1"]);
    assert!(said.contains("row by row") && said.contains("PSNR"), "{said}");
    // PLY to PLY keeps every bit.
    let copy = file("copy.ply");
    ok(&["convert", path(&model), path(&copy)]);
    let read = |p: &Path| gs_model::ply::read(p).unwrap().0;
    assert_eq!(read(&model), read(&copy));
    common::wrong_usage(&gsvx(&["convert", path(&model), path(&file("a.gsvx"))]), "gsvx encode");
    common::wrong_usage(&gsvx(&["convert", path(&model), path(&file("a.xyz"))]), "--to");
    common::wrong_usage(&gsvx(&["convert", path(&model), "-"]), "--to");
    let piped =
        common::piped(&["convert", "-", "-", "--to", "spz"], &std::fs::read(&model).unwrap());
    assert!(piped.stdout == std::fs::read(&spz).unwrap());
}

#[cfg(unix)]
#[test]
fn an_interrupted_encode_leaves_nothing_and_keeps_what_was_there() {
    let dir = tempfile::tempdir().unwrap();
    let (room, stream) = (room(), dir.path().join("a.gsvx"));
    std::fs::write(&stream, b"before").unwrap();
    let model = room.join("point_cloud.ply");
    let mut child = Command::new(env!("CARGO_BIN_EXE_gsvx"))
        .args(["encode", path(&model), "-o", path(&stream), "--force", "--target-bytes", "60000"])
        .stderr(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    // The temporary file is there before the work begins.
    while std::fs::read_dir(dir.path()).unwrap().count() < 2 {
        assert!(child.try_wait().unwrap().is_none(), "ended before it was interrupted");
        std::thread::sleep(std::time::Duration::from_millis(1));
    }
    let killed = Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    assert!(killed.success());
    let out = child.wait_with_output().unwrap();
    assert_eq!(out.status.code(), Some(130));
    assert!(String::from_utf8_lossy(&out.stderr).contains("interrupted"));
    assert_eq!(std::fs::read(&stream).unwrap(), b"before");
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1);
}
