//! The command as a person runs it.

use gs_model::Scene;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn gsvx(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_gsvx")).args(args).output().expect("gsvx starts")
}

fn ok(args: &[&str]) -> String {
    let out = gsvx(args);
    let error = String::from_utf8_lossy(&out.stderr).into_owned();
    assert!(out.status.success(), "{args:?}: {error}");
    String::from_utf8_lossy(&out.stdout).into_owned()
}

/// Exit code 1 and exactly one line, which holds `needle`.
fn fails(args: &[&str], needle: &str) {
    let out = gsvx(args);
    let error = String::from_utf8_lossy(&out.stderr).into_owned();
    assert_eq!(out.status.code(), Some(1), "{args:?}: {error}");
    assert_eq!(error.trim_end().lines().count(), 1, "{args:?}: {error}");
    assert!(error.contains(needle), "{args:?}: {error}");
}

fn room() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures/room")
}

fn path(p: &Path) -> &str {
    p.to_str().expect("test paths are UTF-8")
}

#[test]
fn encode_info_decode() {
    let dir = tempfile::tempdir().unwrap();
    let (model, stream, back) =
        (room().join("point_cloud.ply"), dir.path().join("a.gsvx"), dir.path().join("b.ply"));
    let said = ok(&["encode", path(&model), "-o", path(&stream)]);
    assert!(said.contains("bits per Gaussian"), "{said}");
    let said = ok(&["info", path(&stream)]);
    for part in ["geometry", "opacity", "DC", "covariance", "importance", "header"] {
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
    fails(
        &["encode", path(&model), "-o", path(&stream), "--force", "--target-bytes", "100"],
        "smallest stream",
    );
}

#[test]
fn lossless_returns_every_bit() {
    let dir = tempfile::tempdir().unwrap();
    let (model, stream, back) =
        (room().join("point_cloud.ply"), dir.path().join("a.gsvx"), dir.path().join("b.ply"));
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
    let model = std::fs::read(room().join("point_cloud.ply")).unwrap();
    let out = dir.path().join("out.gsvx");
    let out = path(&out);
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
    #[cfg(unix)]
    fails(&["encode", path(&whole), "-o", "/dev/null", "--force"], "regular file");
    fails(&["encode", path(&whole), "-o", path(dir.path())], "directory");
    fails(&["encode", path(&whole), "-o", "/nonexistent-folder/a.gsvx"], "no such directory");
    fails(&["encode", path(&whole), "-o", out, "--quality", "101"], "quality");
    fails(&["encode", path(&whole), "-o", out, "--cameras", path(dir.path())], "camera");
    fails(&["decode", path(&whole), "-o", out], "not a gsvx stream");
    fails(&["info", path(&whole)], "not a gsvx stream");
    let stream = dir.path().join("s.gsvx");
    ok(&["encode", path(&whole), "-o", path(&stream)]);
    let bytes = std::fs::read(&stream).unwrap();
    let cut = file("cut.gsvx", &bytes[..bytes.len() - 10]);
    fails(&["decode", path(&cut), "-o", out], "truncated");
    ok(&["decode", path(&cut), "-o", out, "--allow-truncated"]);
    let mut flipped = bytes.clone();
    let middle = flipped.len() / 2;
    flipped[middle] ^= 4;
    fails(&["decode", path(&file("flip.gsvx", &flipped)), "-o", out, "--force"], "CRC-32C");
}

#[test]
fn a_short_finetune_writes_a_stream_that_decodes() {
    let dir = tempfile::tempdir().unwrap();
    let (room, stream, back) = (room(), dir.path().join("a.gsvx"), dir.path().join("b.ply"));
    let model = room.join("point_cloud.ply");
    let said = ok(&[
        "finetune",
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
    fails(
        &[
            "finetune",
            path(&model),
            "--cameras",
            path(&room),
            "-o",
            path(&dir.path().join("x.txt")),
        ],
        ".gsvx or .ply",
    );
}
