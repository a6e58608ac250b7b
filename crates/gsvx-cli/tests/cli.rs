//! The command as a person runs it.

mod common;

use common::{Folder, heard, json, model, ok, one_line, piped, room, run, wrong_usage};
use gs_model::{Scene, ply};
use std::path::Path;

fn read(path: &Path) -> Scene {
    ply::read(path).unwrap().0
}

#[test]
fn encode_info_decode() {
    let dir = Folder::new();
    let (stream, back) = (dir.join("a.gsvx"), dir.join("b.ply"));
    let said = ok("encode @ -o @", &[&model(), &stream]);
    assert!(said.contains("bits per Gaussian"), "{said}");
    let said = ok("info @", &[&stream]);
    for part in ["head", "base layers", "SH degree 1", "SH degree 2", "SH degree 3"] {
        assert!(said.contains(part), "{said}");
    }
    ok("decode @ -o @", &[&stream, &back]);
    let (scene, report) = ply::read(&back).unwrap();
    assert!(scene.len() > 1000 && report.notes.is_empty());
    // Replacing needs --force, and a failed run leaves the old file.
    let before = std::fs::read(&back).unwrap();
    one_line(&run("decode @ -o @", &[&stream, &back]), "--force");
    assert_eq!(before, std::fs::read(&back).unwrap());
    ok("decode @ -o @ --force --max-sh-degree 0", &[&stream, &back]);
    assert_eq!(read(&back).sh_degree, 0);
    assert_eq!(common::names(&dir).len(), 2, "no temporary files left");
}

#[test]
fn targets_are_hit() {
    let dir = Folder::new();
    let (room, stream) = (room(), dir.join("a.gsvx"));
    for target in ["40000", "90000"] {
        let line = format!("encode @ -o @ --force --target-bytes {target}");
        ok(&line, &[&model(), &stream]);
        let size = std::fs::metadata(&stream).unwrap().len() as f64;
        let share = size / target.parse::<f64>().unwrap();
        assert!((0.99..=1.0).contains(&share), "{target}: {share}");
    }
    let line = "encode @ -o @ --force --target-psnr 34 --cameras @";
    ok(line, &[&model(), &stream, &room]);
    let line = "encode --force --target-ssimulacra2 60 --cameras";
    let (said, _) = common::report(&format!("{line} @ @ -o @"), &[&room, &model(), &stream]);
    let reached = said["ssimulacra2"].as_f64().unwrap();
    assert!((60.0..61.0).contains(&reached) && said["psnr"].is_null(), "{reached}");
}

#[test]
fn lossless_returns_every_bit() {
    let dir = Folder::new();
    let (stream, back) = (dir.join("a.gsvx"), dir.join("b.ply"));
    ok("encode @ -o @ --lossless", &[&model(), &stream]);
    ok("decode @ -o @", &[&stream, &back]);
    let rows = |p: &Path| {
        let s = read(p);
        let mut rows: Vec<Vec<u32>> = (0..s.len()).map(|i| row(&s, i)).collect();
        rows.sort();
        rows
    };
    assert!(rows(&model()) == rows(&back), "some float changed");
}

fn row(s: &Scene, i: usize) -> Vec<u32> {
    let sh = s.sh_of(i).as_flattened();
    let parts: [&[f32]; 5] =
        [&s.means[i], &s.rotations[i], &s.log_scales[i], &s.opacity_logits[i..=i], sh];
    parts.concat().iter().map(|v| v.to_bits()).collect()
}

#[test]
fn mistakes_get_one_line() {
    let dir = Folder::new();
    let file = |name: &str, bytes: &[u8]| {
        std::fs::write(dir.join(name), bytes).unwrap();
        dir.join(name)
    };
    let model = std::fs::read(model()).unwrap();
    let (out, back) = (dir.join("out.gsvx"), dir.join("back.ply"));
    let whole = file("whole.ply", &model);
    let encode = |p: &Path, needle| one_line(&run("encode @ -o @", &[p, &out]), needle);
    encode(&dir.join("absent.ply"), "absent.ply");
    encode(&file("empty.ply", b""), "empty.ply: is empty");
    encode(&file("text.ply", b"hello"), "text.ply: not a PLY file");
    encode(&file("cut.ply", &model[..model.len() / 2]), "cut.ply: truncated at byte");
    let header =
        b"ply\nformat binary_little_endian 1.0\nelement vertex 9\nproperty float x\nend_header\n";
    encode(&file("bare.ply", header), "bare.ply");
    // The first float of the first row becomes NaN.
    let start = model.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    let mut nan = model.clone();
    nan[start..start + 4].copy_from_slice(&f32::NAN.to_le_bytes());
    let nan = file("nan.ply", &nan);
    encode(&nan, "--drop-invalid");
    ok("encode @ -o @ --drop-invalid", &[&nan, &dir.join("dropped.gsvx")]);
    one_line(&run("convert @ @ --to ply", &[&whole, &dir]), "directory");
    let nowhere = Path::new("/nonexistent-folder/a.gsvx");
    one_line(&run("encode @ -o @", &[&whole, nowhere]), "no such directory");
    one_line(&run("encode @ -o @ --cameras @", &[&whole, &out, &dir]), "camera");
    let decode = |p: &Path, needle| one_line(&run("decode @ -o @", &[p, &back]), needle);
    decode(&whole, "not a gsvx stream");
    let stream = dir.join("s.gsvx");
    ok("encode @ -o @", &[&whole, &stream]);
    let bytes = std::fs::read(&stream).unwrap();
    let mut flipped = bytes.clone();
    flipped[bytes.len() / 2] ^= 4;
    decode(&file("flip.gsvx", &flipped), "CRC-32C");
    let cut = file("cut.gsvx", &bytes[..bytes.len() - 10]);
    decode(&cut, "truncated");
    ok("decode @ -o @ --salvage", &[&cut, &back]);
}

#[test]
fn pipes_threads_and_json() {
    let dir = Folder::new();
    let (one, two) = (dir.join("1.gsvx"), dir.join("2.gsvx"));
    let said = json("encode @ -o @ --threads 1", &[&model(), &one]);
    assert_eq!(said["bytes"], std::fs::metadata(&one).unwrap().len());
    assert!(said["parts"]["base layers"].as_u64().unwrap() > 100, "{said}");
    ok("--threads 3 encode @ -o @", &[&model(), &two]);
    let stream = std::fs::read(&one).unwrap();
    assert!(stream == std::fs::read(&two).unwrap(), "the bytes depend on the number of threads");
    let encoded = piped("encode - -o -", &std::fs::read(model()).unwrap());
    assert!(encoded.status.success() && encoded.stdout == stream);
    // The report goes where the data does not.
    assert!(heard(&encoded).contains("bits per Gaussian"));
    let decoded = piped("decode - -o -", &stream);
    let (scene, _) = ply::read_bytes(&decoded.stdout).unwrap();
    let info = json("info @", &[&one]);
    assert_eq!(info["gaussians"], scene.len());
    assert_eq!(info["expected_bytes"], stream.len());
    wrong_usage(&run("encode @", &[&model()]), "--output");
}

/// Of the golden streams.
#[test]
fn info_tells_chunks_and_levels_of_detail() {
    let golden = room().join("../streams");
    let info = |name: &str| json("info @", &[&golden.join(name)]);
    assert!(info("chunks.gsvx")["chunks"].as_array().unwrap().len() > 1);
    assert!(info("lod.gsvx")["lods"].as_u64().unwrap() > 1);
    assert_eq!(info("default.gsvx")["lods"], 1);
    let text = ok("info @", &[&golden.join("lod.gsvx")]);
    assert!(text.contains("level 1") && text.contains("coarse levels"), "{text}");
}

/// Three floaters a million units away are coded exactly.
#[test]
fn floaters_are_trimmed() {
    let dir = Folder::new();
    let [input, stream, back] = ["m.ply", "a.gsvx", "b.ply"].map(|name| dir.join(name));
    let mut scene = read(&model());
    let at = [5, 700, scene.len() - 1];
    for (axis, &i) in at.iter().enumerate() {
        scene.means[i][axis] = 1e6;
    }
    ply::write(&input, &scene).unwrap();
    let said = ok("encode @ -o @", &[&input, &stream]);
    assert!(said.contains("3 outliers coded exactly, far from all others: "), "{said}");
    assert!(ok("info @", &[&stream]).contains("3 of them bit for bit"));
    ok("decode @ -o @", &[&stream, &back]);
    let decoded = read(&back);
    for (k, &i) in at.iter().enumerate() {
        assert_eq!(row(&decoded, decoded.len() - 3 + k), row(&scene, i));
    }
    let info = json("info @", &[&stream]);
    assert_eq!((&info["exact_gaussians"], &info["gaussians"]), (&3.into(), &decoded.len().into()));
}

#[test]
fn render_writes_one_png_per_camera() {
    let dir = Folder::new();
    let (model, room, out) = (model(), room(), dir.join("views"));
    let render = "render @ --cameras @ -o @ --every 8 --scale 0.5";
    let paths: [&Path; 3] = [&model, &room, &out];
    let said = json(render, &paths);
    let images = said["images"].as_array().unwrap();
    assert_eq!(images.len(), common::names(&out).len());
    let first = image::open(images[0].as_str().unwrap()).unwrap().to_rgb8();
    assert!(first.width() > 16);
    let sum: u64 = first.as_raw().iter().map(|&v| u64::from(v)).sum();
    let mean = sum / first.as_raw().len() as u64;
    assert!((20..236).contains(&mean), "{mean}");
    one_line(&run(render, &paths), "--force");
    let orbit = dir.join("orbit.png");
    ok("render @ --orbit 1 --size 80x60 -o @", &[&model, &orbit]);
    assert_eq!(image::image_dimensions(&orbit).unwrap(), (80, 60));
    let two = run("render @ --orbit 2 -o @ --force", &[&model, &orbit]);
    wrong_usage(&two, "folder");
    one_line(&run("render @ --cameras @ -o @ --view none", &paths), "none");
    wrong_usage(&run("render @ -o @", &[&model, &out]), "--orbit");
}

/// A model that is antialiased: from any format to any that can say so; a word where one cannot.
#[test]
fn an_antialiased_model_stays_so() {
    let dir = Folder::new();
    let model = dir.join("model.ply");
    let scene = gs_model::Scene { antialiased: true, ..common::scene() };
    gs_model::ply::write(&model, &scene).unwrap();
    let (spz, stream, back, splat) =
        (dir.join("a.spz"), dir.join("a.gsvx"), dir.join("back.ply"), dir.join("a.splat"));
    ok("convert @ @", &[&model, &spz]);
    assert_eq!(std::fs::read(&spz).unwrap()[14], 1);
    ok("encode @ --no-estimate -o @", &[&spz, &stream]);
    ok("decode @ -o @", &[&stream, &back]);
    let ply = std::fs::read(&back).unwrap();
    assert!(String::from_utf8_lossy(&ply[..100]).contains("\ncomment SplatRenderMode: mip\n"));
    for path in [&model, &spz, &stream, &back] {
        assert_eq!(common::json("info @", &[path])["antialiased"], true, "{path:?}");
        assert!(ok("info @", &[path]).contains("antialiased    yes"), "{path:?}");
    }
    let heard = common::heard(&common::run("convert @ @", &[&stream, &splat]));
    assert!(heard.contains(".splat does not say that the model is antialiased"), "{heard}");
}

#[test]
fn convert_and_compare() {
    let dir = Folder::new();
    let model = model();
    let (spz, small, splat) = (dir.join("a.spz"), dir.join("small.spz"), dir.join("a.splat"));
    ok("convert @ @", &[&model, &spz]);
    ok("convert @ @ --spz-sh-bits 5,4", &[&model, &small]);
    ok("convert @ @", &[&model, &splat]);
    let len = |p: &Path| std::fs::metadata(p).unwrap().len();
    assert!(len(&small) < len(&spz));
    let compare = |b: &Path| json("compare @ @ --orbit 3 --size 160x120", &[&model, b]);
    let same = compare(&model);
    assert!(same["psnr"].is_null() && same["ssim"] == 1.0, "{same}");
    assert_eq!(same["attributes"]["mean"], 0.0);
    let psnr = |b: &Path| compare(b)["psnr"].as_f64().unwrap();
    let (fine, coarse, flat) = (psnr(&spz), psnr(&small), psnr(&splat));
    assert!(fine > 40.0 && fine > coarse && coarse > 25.0 && flat > 15.0, "{fine} {coarse} {flat}");
    // A stream is a model too, and its Gaussians are another number in another order.
    let (stream, back) = (dir.join("a.gsvx"), dir.join("b.ply"));
    ok("encode @ -o @ -q 90", &[&model, &stream]);
    let seen = compare(&stream);
    assert_eq!(seen["attributes"]["pairing"], "nearest");
    assert!(seen["psnr"].as_f64().unwrap() > 35.0, "{seen}");
    ok("convert @ @", &[&stream, &back]);
    let said = ok("compare @ @ --orbit 1", &[&stream, &back]);
    assert!(said.contains("row by row") && said.contains("PSNR"), "{said}");
    // SOG in one file, and in the files of a folder.
    let (sog, files) = (dir.join("a.sog"), dir.join("files/meta.json"));
    ok("convert @ @", &[&stream, &sog]);
    ok("decode @ -o @ --force", &[&stream, &sog]);
    ok("convert @ @", &[&stream, &files]);
    assert_eq!(common::names(&dir.join("files")).len(), 8);
    one_line(&run("convert @ @", &[&stream, &files]), "is not empty; pass --force");
    let said = ok("compare @ @ --orbit 1", &[&sog, &files]);
    assert!(said.contains("PSNR inf dB"), "{said}");
    wrong_usage(&run("decode @ -o @", &[&stream, &files]), "gsvx convert writes a SOG of several");
    // PLY to PLY keeps every bit.
    ok("convert @ @", &[&model, &dir.join("copy.ply")]);
    assert_eq!(read(&model), read(&dir.join("copy.ply")));
    wrong_usage(&run("convert @ @", &[&model, &dir.join("b.gsvx")]), "gsvx encode");
    wrong_usage(&run("convert @ @", &[&model, &dir.join("a.xyz")]), "--to");
    wrong_usage(&run("convert @ -", &[&model]), "--to");
    let piped = piped("convert - - --to spz", &std::fs::read(&model).unwrap());
    assert!(piped.stdout == std::fs::read(&spz).unwrap());
}

#[cfg(unix)]
#[test]
fn an_interrupted_command_leaves_nothing_and_keeps_what_was_there() {
    let dir = Folder::new();
    let stream = dir.join("a.gsvx");
    std::fs::write(&stream, b"before").unwrap();
    let (model, room) = (model(), common::room());
    let encode = "encode @ -o @ --force --target-bytes 60000";
    let tune = "tune @ -o @ --force --cameras @ --distil";
    for words in [encode, tune] {
        // The temporary file is there before the work begins.
        let out =
            common::interrupted(words, &[&model, &stream, &room], || common::names(&dir).len() > 1);
        assert_eq!(out.status.code(), Some(130), "{}", heard(&out));
        assert!(heard(&out).contains("interrupted; no output was touched"), "{}", heard(&out));
        assert_eq!(std::fs::read(&stream).unwrap(), b"before");
        assert_eq!(common::names(&dir), ["a.gsvx"]);
    }
}

#[cfg(unix)]
#[test]
fn an_interrupted_batch_says_what_is_complete() {
    let dir = Folder::new();
    let [a, b] = ["a.ply", "b.ply"].map(|name| dir.join(name));
    for copy in [&a, &b] {
        std::fs::copy(model(), copy).unwrap();
    }
    let (to, first) = (dir.join("streams/"), dir.join("streams/a.gsvx"));
    let words = "encode @ @ -o @ --target-bytes 60000";
    let out = common::interrupted(words, &[&a, &b, &to], || first.exists());
    assert_eq!(out.status.code(), Some(130), "{}", heard(&out));
    let last = heard(&out).lines().last().unwrap_or_default().to_owned();
    assert!(
        last.starts_with("error: interrupted; ") && last.ends_with("a.gsvx is complete"),
        "{last}"
    );
    assert_eq!(common::names(&to), ["a.gsvx"]);
    assert!(!gsvx::decode(&std::fs::read(&first).unwrap()).unwrap().is_empty());
}
