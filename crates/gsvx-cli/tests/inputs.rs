//! What the command reads, and what it says about what it cannot read.

mod common;

use common::{Folder, heard, json, ok, one_line, piped, run, scene, wrong_usage};
use std::path::{Path, PathBuf};
use std::process::Output;

#[test]
fn the_limit_on_gaussians_is_a_flag_of_every_command_that_reads() {
    let dir = Folder::new();
    let (input, stream) = (dir.small(), dir.join("a.gsvx"));
    ok("encode @ -o @", &[&input, &stream]);
    let commands: [(&str, &[&Path]); 5] = [
        ("decode @ -o @", &[&stream, &dir.join("a.ply")]),
        ("render @ --orbit 1 --size 32x24 -o @", &[&stream, &dir.join("a.png")]),
        ("compare @ @ --orbit 1 --size 32x24", &[&stream, &stream]),
        ("convert @ @", &[&stream, &dir.join("b.ply")]),
        ("info @", &[&stream]),
    ];
    for (words, paths) in commands {
        let with = |limit| run(&format!("{words} --max-gaussians {limit}"), paths);
        one_line(&with("5"), "--max-gaussians");
        assert!(with("2M").status.success(), "{words:?}");
    }
    one_line(&run("info @ --max-gaussians 399", &[&input]), "--max-gaussians 400");
}

#[test]
fn normals_that_are_left_out_are_named() {
    let dir = Folder::new();
    let (input, stream) = (dir.small(), dir.join("a.gsvx"));
    let quiet = json("encode @ -o @ --lossless", &[&input, &stream]);
    assert_eq!(quiet["notes"], serde_json::json!([]));
    let mut file = std::fs::read(&input).unwrap();
    let body = file.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    // x y z nx ny nz: the third row's ny.
    let stride = 62 * 4;
    file[body + 2 * stride + 16..][..4].copy_from_slice(&1f32.to_le_bytes());
    let with_normals = dir.join("normals.ply");
    std::fs::write(&with_normals, &file).unwrap();
    let words = "encode @ -o @ --lossless --force";
    let out = run(words, &[&with_normals, &stream]);
    assert!(out.status.success());
    let said = heard(&out);
    assert!(said.contains("are not kept: ny") && said.lines().count() == 1, "{said}");
    let from_pipe = piped("encode - -o /dev/null --lossless", &file);
    if cfg!(unix) {
        assert!(heard(&from_pipe).contains("are not kept: ny"));
    }
}

/// `scene()` with an infinite opacity, a flat Gaussian and a colour that no model has, as a PLY.
fn at_the_limits(dir: &Path) -> (PathBuf, gs_model::Scene) {
    let mut limits = scene();
    limits.opacity_logits[3] = f32::INFINITY;
    limits.log_scales[4][1] = f32::NEG_INFINITY;
    let each = limits.sh_len();
    limits.sh[5 * each] = [1e38, 0.0, 0.0];
    let path = dir.join("limits.ply");
    gs_model::ply::write(&path, &limits).unwrap();
    (path, limits)
}

#[test]
fn lossless_keeps_infinities_bit_for_bit() {
    let dir = Folder::new();
    let (input, limits) = at_the_limits(&dir);
    let [stream, back] = ["a.gsvx", "back.ply"].map(|name| dir.join(name));
    let out = run("encode @ -o @ --lossless", &[&input, &stream]);
    assert!(heard(&out).contains("2 Gaussians have values that are not finite"), "{}", heard(&out));
    ok("decode @ -o @", &[&stream, &back]);
    let keep = gs_model::ReadOptions { invalid: gs_model::Invalid::Keep, ..Default::default() };
    let back = gs_model::model::read(&back, &keep).unwrap().0;
    let sorted = |scene: &gs_model::Scene| {
        let mut order: Vec<usize> = (0..scene.len()).collect();
        order.sort_by_key(|&i| scene.means[i].map(f32::to_bits));
        scene.select(&order)
    };
    assert_eq!(sorted(&back), sorted(&limits));
}

#[test]
fn a_colour_beyond_all_models_is_refused_with_two_ways_on() {
    let dir = Folder::new();
    let (input, _) = at_the_limits(&dir);
    let stream = dir.join("a.gsvx");
    let refused = run("encode @ -o @", &[&input, &stream]);
    let ways = "Gaussian 5 has a value of 1e38 (SH coefficient)";
    let said = heard(&refused);
    // The number is that of the file, whatever is not drawn before it, and however it is read.
    let mut faint = gs_model::ply::read(&input).unwrap().0;
    faint.opacity_logits[..3].fill(-20.0);
    gs_model::ply::write(&input, &faint).unwrap();
    for memory in ["", " --memory 1G"] {
        let refused = run(&format!("encode @ -o @{memory}"), &[&input, &stream]);
        assert!(heard(&refused).contains(ways), "{}", heard(&refused));
    }
    assert!(said.contains(ways) && said.contains("--drop-invalid to leave it out"), "{said}");
    ok("encode @ -o @ --drop-invalid", &[&input, &stream]);
}

#[test]
fn messages_name_the_cause_and_the_remedy() {
    let dir = Folder::new();
    let (input, stream) = (dir.small(), dir.join("a.gsvx"));
    let line = |out: &Output, needle: &str| {
        one_line(out, needle);
        let said = heard(out);
        for wrong in ["disk", "Error", "<", "{"] {
            assert!(!said.contains(wrong), "{said}");
        }
        said
    };
    // A coordinate that SPZ cannot hold.
    let mut far = scene();
    far.means[7][1] = 1e6;
    gs_model::ply::write(dir.join("far.ply"), &far).unwrap();
    line(
        &run("convert @ @", &[&dir.join("far.ply"), &dir.join("far.spz")]),
        "outside the range of SPZ",
    );
    // Compressed data that is damaged, in both containers of SPZ.
    ok("convert @ @", &[&input, &dir.join("a.spz")]);
    let mut spz = std::fs::read(dir.join("a.spz")).unwrap();
    let middle = spz.len() / 2;
    spz[middle..].iter_mut().for_each(|b| *b = !*b);
    std::fs::write(dir.join("bad.spz"), &spz).unwrap();
    line(&run("info @", &[&dir.join("bad.spz")]), "bad.spz");
    std::fs::write(
        dir.join("bad2.spz"),
        [&[0x1f, 0x8b, 8, 0, 0, 0, 0, 0, 0, 0][..], &[7; 50]].concat(),
    )
    .unwrap();
    line(&run("info @", &[&dir.join("bad2.spz")]), "compressed data is broken; get it again");
    // A stream where a model is expected, from a file and from a pipe.
    ok("encode @ -o @", &[&input, &stream]);
    let said = line(&run("encode @ -o @", &[&stream, &dir.join("b.gsvx")]), "gsvx decode");
    assert!(said.contains("is a gsvx stream already"));
    let bytes = std::fs::read(&stream).unwrap();
    line(&piped("encode - -o -", &bytes), "is a gsvx stream already");
    // A stream that was cut, also within its first bytes.
    for kept in 1..20 {
        std::fs::write(dir.join("cut.gsvx"), &bytes[..kept]).unwrap();
        line(&run("info @", &[&dir.join("cut.gsvx")]), "stream truncated in head");
    }
    std::fs::write(dir.join("empty.ply"), b"").unwrap();
    line(&run("info @", &[&dir.join("empty.ply")]), "empty.ply: is empty");
    std::fs::write(dir.join("cut.gsvx"), &bytes[..bytes.len() - 9]).unwrap();
    line(&run("decode @ -o @", &[&dir.join("cut.gsvx"), &dir.join("b.ply")]), "--salvage");
    line(&run("convert @ @", &[&dir.join("cut.gsvx"), &dir.join("b.ply")]), "--salvage");
    // With nothing left, a model of no Gaussians looked like a success.
    std::fs::write(dir.join("start.gsvx"), &bytes[..bytes.len() / 20]).unwrap();
    let words = "decode --salvage @ -o @";
    line(
        &run(words, &[&dir.join("start.gsvx"), &dir.join("b.ply")]),
        "nothing of it can be decoded",
    );
    // The system's reason once.
    let said = line(&run("info @", &[&dir.join("absent.ply")]), "absent.ply");
    assert_eq!(said.matches("os error").count(), 1, "{said}");
    line(&run("encode @ -o @", &[&dir, &dir.join("b.gsvx")]), "is a folder");
}

#[test]
fn cameras_of_enormous_images_are_refused() {
    let dir = Folder::new();
    let (input, cameras) = (dir.small(), dir.join("cameras.json"));
    let camera = |id: u32| {
        format!(
            r#"{{"id":{id},"img_name":"c{id}","width":26000,"height":26000,"fx":9e4,"fy":9e4,
            "position":[0,0,-3],"rotation":[[1,0,0],[0,1,0],[0,0,1]]}}"#
        )
    };
    std::fs::write(&cameras, format!("[{},{}]", camera(0), camera(1))).unwrap();
    let out = dir.join("out");
    let words = "render @ --cameras @ -o @";
    one_line(&run(words, &[&input, &cameras, &out]), "--scale");
    let words = "encode @ --cameras @ -o @";
    one_line(&run(words, &[&input, &cameras, &out]), "26000x26000 pixels");
    let words = "render @ --cameras @ -o @ --scale 0.002";
    ok(words, &[&input, &cameras, &out]);
}

#[test]
fn from_names_the_format_of_a_pipe() {
    let dir = Folder::new();
    let input = dir.small();
    ok("convert @ @", &[&input, &dir.join("a.splat")]);
    let splat = std::fs::read(dir.join("a.splat")).unwrap();
    one_line(&piped("convert - - --to ply", &splat), "--from splat");
    let out = piped("convert - - --to ply --from splat", &splat);
    assert_eq!(gs_model::ply::read_bytes(&out.stdout).unwrap().0.len(), 400);
    let out = piped("info - --from splat --json", &splat[..320]);
    let said: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
    assert_eq!((&said["format"], &said["gaussians"]), (&".splat".into(), &10.into()));
    // The wrong format is named, with the input's name.
    one_line(&piped("info - --from splat", &splat[..33]), "standard input: truncated at byte 33");
    one_line(&piped("info - --from ply", &splat), "standard input: not a PLY");
    // A file whose name says nothing, too.
    std::fs::write(dir.join("odd"), &splat).unwrap();
    ok("encode @ -o @ --from splat", &[&dir.join("odd"), &dir.join("odd.gsvx")]);
}

#[test]
fn info_reads_every_format() {
    let dir = Folder::new();
    let input = dir.small();
    for (name, format, degree) in [
        ("a.ply", "PLY, binary little-endian", 3),
        ("a.spz", "SPZ, version 4", 3),
        ("a.splat", ".splat", 0),
        ("a.compressed.ply", "PlayCanvas compressed.ply", 3),
        ("a.glb", "glTF, KHR_gaussian_splatting", 3),
    ] {
        ok("convert @ @", &[&input, &dir.join(name)]);
        let said = json("info @", &[&dir.join(name)]);
        assert_eq!((&said["format"], &said["gaussians"]), (&format.into(), &400.into()));
        assert_eq!(said["sh_degree"], degree);
        assert_eq!(said["bytes"], std::fs::metadata(dir.join(name)).unwrap().len());
        assert!(ok("info @", &[&dir.join(name)]).contains(format));
    }
    // Several at once, one of them absent: the others are shown.
    let out = run("info @ @ @", &[&dir.join("a.ply"), &dir.join("absent"), &dir.join("a.spz")]);
    assert_eq!(out.status.code(), Some(1));
    let said = String::from_utf8_lossy(&out.stdout);
    assert!(said.contains("a.ply") && said.contains("a.spz"), "{said}");
    assert!(heard(&out).contains("1 of 3 inputs failed"));
}

#[test]
fn many_inputs_become_one_output_each() {
    let dir = Folder::new();
    let input = dir.small();
    for name in ["a.ply", "b.ply"] {
        std::fs::copy(&input, dir.join(name)).unwrap();
    }
    let (out, back) = (dir.join("out"), dir.join("back"));
    ok("encode @ @ -o @", &[&dir.join("a.ply"), &dir.join("b.ply"), &out]);
    let streams = [out.join("a.gsvx"), out.join("b.gsvx")];
    assert!(std::fs::read(&streams[0]).unwrap() == std::fs::read(&streams[1]).unwrap());
    ok("decode @ @ -o @ --to spz", &[&streams[0], &streams[1], &back]);
    assert!(std::fs::read(back.join("b.spz")).unwrap().starts_with(b"NGSP"));
    // A single one into a folder, too.
    std::fs::create_dir(dir.join("one")).unwrap();
    ok("encode @ -o @", &[&dir.join("a.ply"), &dir.join("one")]);
    assert!(dir.join("one/a.gsvx").exists());
    // Conflicts are found before any work.
    let again = run("encode @ @ -o @", &[&input, &dir.join("b.ply"), &out]);
    one_line(&again, "--force");
    assert!(!out.join("small.gsvx").exists());
    let copy = out.join("a.ply");
    std::fs::copy(&input, &copy).unwrap();
    let words = "encode @ @ -o @";
    wrong_usage(&run(words, &[&dir.join("a.ply"), &copy, &dir.join("two")]), "would both become");
    wrong_usage(&run(words, &[&dir.join("a.ply"), &input, &dir.join("b.ply")]), "gsvx convert");
    wrong_usage(&run("encode @ @ -o -", &[&dir.join("a.ply"), &input]), "FOLDER");
    // One that fails does not stop the others.
    std::fs::write(dir.join("bad.ply"), "no model").unwrap();
    let out = run(words, &[&dir.join("bad.ply"), &dir.join("b.ply"), &dir.join("three")]);
    assert_eq!(out.status.code(), Some(1));
    assert!(dir.join("three/b.gsvx").exists());
}

#[test]
fn sizes_have_units_and_presets_have_names() {
    let dir = Folder::new();
    let (input, stream) = (dir.small(), dir.join("a.gsvx"));
    let words = "encode @ -o @ --force --target-bytes 8.5k";
    let size = json(words, &[&input, &stream])["bytes"].as_u64().unwrap();
    assert!(size <= 8500, "{size}");
    let mut last = 0;
    for (name, quality) in [("tiny", 30.0), ("web", 50.0), ("high", 80.0), ("archive", 90.0)] {
        let words = format!("encode @ -o @ --force --preset {name}");
        let said = json(&words, &[&input, &stream]);
        assert_eq!(said["quality"], quality);
        assert!(said["bytes"].as_u64().unwrap() > last, "{said}");
        last = said["bytes"].as_u64().unwrap();
    }
}

#[test]
fn an_spz_is_turned_unless_its_axes_are_kept() {
    let dir = Folder::new();
    let input = dir.small();
    let read = |name: &str| gs_model::model::read(dir.join(name), &Default::default()).unwrap().0;
    ok("convert @ @", &[&input, &dir.join("turned.spz")]);
    ok("convert @ @ --axes keep", &[&input, &dir.join("kept.spz")]);
    let (turned, kept) = (read("turned.spz"), read("kept.spz"));
    for (a, b) in turned.means.iter().zip(&kept.means) {
        assert_eq!(*a, [b[0], -b[1], -b[2]]);
    }
    // Back again the same way: the model as it was.
    ok("convert @ @ --axes keep", &[&dir.join("kept.spz"), &dir.join("back.ply")]);
    ok("convert @ @", &[&dir.join("turned.spz"), &dir.join("back2.ply")]);
    let (a, b) = (read("back.ply"), read("back2.ply"));
    assert_eq!(a.means, b.means);
    let words = "compare @ @ --orbit 2 --size 80x60";
    let said = json(words, &[&input, &dir.join("back.ply")]);
    assert!(said["psnr"].as_f64().unwrap() > 35.0, "{said}");
    // SPZ to SPZ turns nothing, whichever way.
    ok("convert @ @ --axes keep", &[&dir.join("kept.spz"), &dir.join("same.spz")]);
    assert_eq!(read("same.spz").means, kept.means);
    let help = ok("convert --help", &[]);
    assert!(help.contains("ply_to_spz") && help.contains("--axes keep"), "{help}");
}

#[test]
fn compare_writes_pictures_the_worst_first() {
    let dir = Folder::new();
    let input = dir.small();
    ok("encode @ -o @ --preset tiny", &[&input, &dir.join("a.gsvx")]);
    let words = "compare @ @ --orbit 4 --size 60x40 -o @";
    let (stream, pictures) = (dir.join("a.gsvx"), dir.join("pictures"));
    let paths = [&input, &stream, &pictures].map(PathBuf::as_path);
    let said = json(words, &paths);
    let views = said["views"].as_array().unwrap();
    let psnr = |view: &serde_json::Value| view["psnr"].as_f64().unwrap();
    let worst = views.iter().min_by(|a, b| psnr(a).total_cmp(&psnr(b))).unwrap();
    let pictures = said["pictures"].as_array().unwrap();
    assert_eq!(pictures.len(), 4);
    let first = Path::new(pictures[0].as_str().unwrap());
    let name = first.file_name().unwrap().to_str().unwrap();
    assert_eq!(name, format!("1-{}.png", worst["name"].as_str().unwrap()));
    let picture = image::open(first).unwrap().to_rgb8();
    assert_eq!(picture.dimensions(), (3 * 60 + 16, 40));
    // The difference is not black.
    let last = picture.enumerate_pixels().filter(|(x, ..)| *x >= 136);
    assert!(last.map(|(.., p)| u64::from(p[1])).sum::<u64>() > 0);
    one_line(&run(words, &paths), "--force");
    ok(&format!("{words} --force"), &paths);
}

#[test]
fn the_short_help_has_nine_flags_and_the_long_one_all() {
    let short = ok("encode -h", &[]);
    let flags = short.lines().filter(|l| l.trim_start().starts_with('-'));
    // Eight, and -h.
    assert_eq!(flags.count(), 9, "{short}");
    let long = ok("encode --help", &[]);
    for expected in ["--max-sh-degree", "--json", "For experts", "What is kept"] {
        assert!(long.contains(expected), "{long}");
        assert!(!short.contains(expected), "{short}");
    }
}

#[test]
fn files_of_other_tools_are_read_as_they_are() {
    let dir = Folder::new();
    let formats = common::room().join("../formats");
    for (name, format) in [
        ("small.compressed.ply", "PlayCanvas compressed.ply"),
        ("small.sog", "SOG, version 2"),
        ("small.glb", "glTF, KHR_gaussian_splatting"),
        ("small.ksplat", ".ksplat"),
    ] {
        let file = formats.join(name);
        let said = json("info @", &[&file]);
        assert_eq!((&said["format"], &said["gaussians"]), (&format.into(), &300.into()));
        ok("encode @ -o @ --force", &[&file, &dir.join("a.gsvx")]);
        ok("convert @ @ --force", &[&file, &dir.join("a.ply")]);
        let words = "compare @ @ --orbit 2 --size 80x60";
        let same = json(words, &[&file, &dir.join("a.ply")]);
        assert!(same["psnr"].as_f64().is_none_or(|psnr| psnr > 80.0), "{name}: {same}");
        // The content says what it is, but for a .ksplat.
        let from = if name == "small.ksplat" { " --from ksplat" } else { "" };
        let words = format!("info - --json{from}");
        let piped = piped(&words, &std::fs::read(&file).unwrap());
        let said: serde_json::Value = serde_json::from_slice(&piped.stdout).unwrap();
        assert_eq!(said["format"], format);
    }
    // A stream to glTF and back.
    ok("convert @ @", &[&dir.join("a.gsvx"), &dir.join("a.glb")]);
    ok("encode @ -o @ --force", &[&dir.join("a.glb"), &dir.join("b.gsvx")]);
    let glb = dir.join("a.glb");
    let short = std::fs::read(&glb).unwrap();
    std::fs::write(&glb, &short[..9000]).unwrap();
    one_line(&run("info @", &[&glb]), "a.glb: glTF, the file: it promises more");
    wrong_usage(&run("convert @ @", &[&dir.join("a.ply"), &dir.join("a.ksplat")]), "not written");
}

#[test]
fn the_origin_of_a_model_is_kept_where_a_file_has_a_place_for_it() {
    let dir = Folder::new();
    let (model, stream, back, spz) =
        (dir.join("utm.ply"), dir.join("utm.gsvx"), dir.join("back.ply"), dir.join("utm.spz"));
    let origin = [389_477.25, 5_435_291.5, 120.0];
    let scene = gs_model::Scene { origin, ..scene() };
    gs_model::ply::write(&model, &scene).unwrap();
    ok("encode @ --lossless -o @", &[&model, &stream]);
    ok("decode @ -o @", &[&stream, &back]);
    for file in [&model, &stream, &back] {
        assert_eq!(json("info @", &[file])["origin"], serde_json::json!(origin));
        assert!(ok("info @", &[file]).contains("origin         (389477.25, 5435291.5, 120)"));
    }
    let (_, heard) = common::report("convert @ @", &[&stream, &spz]);
    assert!(
        heard.contains("origin (389477.25, 5435291.5, 120), which .spz does not hold"),
        "{heard}"
    );
    // The comparison says why nothing is alike.
    let (_, heard) = common::report("compare @ @ --orbit 2", &[&model, &spz]);
    assert!(heard.contains("hint: ") && heard.contains("has lost it"), "{heard}");
    // The same Gaussians about another origin are the same model.
    let moved = dir.join("moved.ply");
    let mut scene = scene;
    scene.move_origin([389_470.0, 5_435_290.0, 120.0]);
    gs_model::ply::write(&moved, &scene).unwrap();
    let same = json("compare @ @ --orbit 2", &[&model, &moved]);
    assert!(same["psnr"].is_null() || same["psnr"].as_f64().unwrap() > 60.0, "{same}");
}

#[test]
fn models_that_differ_by_their_axes_are_said_to() {
    let dir = Folder::new();
    let (turned, other) = (dir.join("turned.spz"), dir.join("turned.ply"));
    let compare = |model: &std::path::Path| {
        let words = "compare @ @ --every 16 --cameras @";
        common::report(words, &[&common::model(), model, &common::room()]).1
    };
    ok("convert @ @ --axes keep", &[&common::model(), &turned]);
    let heard = compare(&turned);
    assert!(heard.contains("(x, y, z) of the second is (x, -y, -z) of the first"), "{heard}");
    // z up.
    let (mut scene, _) = gs_model::ply::read(common::model()).unwrap();
    scene.cut_sh(0);
    let half = std::f32::consts::FRAC_1_SQRT_2;
    for i in 0..scene.len() {
        let [x, y, z] = scene.means[i];
        scene.means[i] = [x, z, -y];
        let [w, a, b, c] = scene.rotations[i];
        scene.rotations[i] = [w + a, a - w, b + c, c - b].map(|v| half * v);
    }
    gs_model::ply::write(&other, &scene).unwrap();
    let heard = compare(&other);
    assert!(heard.contains("(x, y, z) of the second is (x, -z, y) of the first"), "{heard}");
    assert!(!compare(&common::model()).contains("hint"));
}
