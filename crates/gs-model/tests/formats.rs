//! The formats beside PLY: files of other tools, files made by hand, and what is written.

mod common;

use std::io::{Cursor, Write};

use common::{assert_within, fixture, read, says, shared};
use gs_model::spz::{self, ShBits};
use gs_model::{FileAxes, Format, Invalid, ReadOptions, Scene, model, ply};

/// A scene as a file of a format, in memory.
fn written(format: &str, scene: &Scene) -> Vec<u8> {
    let mut file = Vec::new();
    Format::named(format).unwrap().write_to("<file>", &mut file, scene).unwrap();
    file
}

fn sigmoid(logit: f32) -> f64 {
    1.0 / (1.0 + libm::exp(-f64::from(logit)))
}

#[test]
fn the_table_names_every_format_once() {
    let readme = std::fs::read_to_string(fixture("../README.md")).unwrap().to_lowercase();
    for format in Format::all() {
        assert_eq!(Format::named(format.name), Some(*format));
        for extension in format.extensions {
            assert_eq!(Format::of_name(format!("a.{extension}")), Some(*format));
        }
        assert!(readme.contains(format.extensions[0]), "{format:?} is not in the README");
        assert!(Format::all().iter().filter(|f| f.name == format.name).count() == 1);
    }
    assert_eq!(Format::of_name("a.gsvx"), None);
    // The bytes decide where they can.
    assert_eq!(Format::of("a.spz", b"ply\n").unwrap().name, "ply");
    assert_eq!(Format::of("a.splat", b"ply\n").unwrap().name, "ply");
    assert_eq!(Format::of("a", b"hello"), None);
    says(read("a", b"hello"), "a: not a model of a known format: it starts with \"hello\"");
    says(read("a", b""), "a: is empty");
    let sog = Format::named("sog").unwrap();
    says(
        sog.write_to("a.sog", Vec::new(), &Scene::default()),
        "cannot be written: sog is read only",
    );
}

/// The model that `fixtures/formats` holds in several formats.
fn small() -> Scene {
    let (room, _) = ply::read(fixture("room/point_cloud.ply")).unwrap();
    let mut scene = room.select(&(0..300).map(|i| 36 * i).collect::<Vec<_>>());
    scene.cut_sh(1);
    scene
}

/// The Gaussians of `a` that are most like those of `b`, in the order of `b`.
fn paired(a: &Scene, b: &Scene) -> Scene {
    let opacity = |s: &Scene, i: usize| 1.0 / (1.0 + libm::expf(-s.opacity_logits[i]));
    let unlike = |i: usize, j: usize| {
        let square = |d: f32| d * d;
        let squares = |x: [f32; 3], y: [f32; 3]| (0..3).map(|k| square(x[k] - y[k])).sum::<f32>();
        1e3 * squares(a.means[i], b.means[j])
            + squares(a.log_scales[i], b.log_scales[j])
            + 10.0 * square(opacity(a, i) - opacity(b, j))
    };
    let nearest =
        |j: usize| (0..a.len()).min_by(|&i, &k| unlike(i, j).total_cmp(&unlike(k, j))).unwrap();
    let order: Vec<usize> = (0..b.len()).map(nearest).collect();
    let mut seen = order.clone();
    seen.sort_unstable();
    seen.dedup();
    assert_eq!(seen.len(), b.len(), "two Gaussians have the same nearest one");
    a.select(&order)
}

/// GaussianSplats3D 0.4.7 moves 28 of these 300 Gaussians when it writes. So what counts is where it reads
/// them itself.
#[test]
fn a_ksplat_is_read_as_by_its_own_library() {
    let path = fixture("formats/small.ksplat");
    let (read, report) = model::read(path, &ReadOptions::default()).unwrap();
    assert_eq!((report.format, report.gaussians_in_file), ("ksplat", 300));
    let by_itself = [
        (272, [1.950_025_9, 2.058_855, 2.699_972_6]),
        (285, [2.250_023, 0.294_122_1, 2.699_972_6]),
        (299, [2.550_02, 2.5, 1.349_986_3]),
    ];
    for (i, mean) in by_itself {
        for (a, b) in read.means[i].into_iter().zip(mean) {
            assert!((a - b).abs() < 1e-6, "{i}: {:?}", read.means[i]);
        }
    }
}

#[test]
fn files_of_other_tools_hold_the_model_that_was_written() {
    let scene = small();
    for (name, format, bounds) in [
        // A chunk of 256 Gaussians is as large as the room here.
        ("compressed.ply", "PlayCanvas compressed.ply", [6e-3, 1e-5, 6e-3, 2e-3, 6e-3, 0.033]),
        // The palette is approximate.
        ("sog", "SOG, version 2", [3e-4, 3e-4, 0.04, 4e-3, 0.02, 0.3]),
        ("glb", "glTF, KHR_gaussian_splatting", [1e-6, 1e-6, 1e-5, 1e-6, 0.0, 0.0]),
    ] {
        let path = fixture(&format!("formats/small.{name}"));
        let (read, report) = model::read(path, &ReadOptions::default()).unwrap();
        assert_eq!((&report.form[..], report.gaussians_in_file), (format, 300));
        assert_within(name, &paired(&scene, &read), &read, bounds);
    }
}

#[test]
fn a_ksplat_of_floats_holds_the_model_that_was_written() {
    let (room, _) = ply::read(fixture("room/point_cloud.ply")).unwrap();
    let mut tiny = room.select(&(0..60).map(|i| 180 * i).collect::<Vec<_>>());
    tiny.cut_sh(2);
    let (read, _) = model::read(fixture("formats/tiny.0.ksplat"), &ReadOptions::default()).unwrap();
    // Colours and opacities are bytes, rounded down.
    let paired = paired(&tiny, &read);
    assert_within("tiny.0.ksplat", &paired, &read, [0.0, 1e-6, 1e-6, 3.93e-3, 3.93e-3, 0.0]);
}

#[test]
fn a_sog_is_the_same_in_a_folder_and_in_an_archive() {
    let dir = tempfile::tempdir().unwrap();
    let path = fixture("formats/small.sog");
    let file = std::fs::File::open(&path).unwrap();
    zip::ZipArchive::new(file).unwrap().extract(dir.path()).unwrap();
    let (bundled, _) = model::read(path, &ReadOptions::default()).unwrap();
    let (unbundled, report) =
        model::read(dir.path().join("meta.json"), &ReadOptions::default()).unwrap();
    assert_eq!(report.format, "sog");
    assert_eq!(unbundled, bundled);
    std::fs::remove_file(dir.path().join("quats.webp")).unwrap();
    says(
        model::read(dir.path().join("meta.json"), &ReadOptions::default()),
        "quats.webp: cannot read: ",
    );
}

/// A lossless WebP image.
fn webp(width: u32, height: u32, rgba: &[u8]) -> Vec<u8> {
    let mut file = Vec::new();
    let encoder = image_webp::WebPEncoder::new(&mut file);
    encoder.encode(rgba, width, height, image_webp::ColorType::Rgba8).unwrap();
    file
}

/// A SOG of version 1 with two Gaussians of degree 1; in its `meta.json`, `to` replaces `from`.
fn sog_1(from: &str, to: &str) -> Vec<u8> {
    let meta = r#"{
        "means": {"shape": [2, 3], "dtype": "float32", "mins": [-1, 0, 0], "maxs": [1, 2, 4], "files": ["l", "u"]},
        "scales": {"shape": [2, 3], "mins": [-10, -9, -8], "maxs": [-5, -4, -3], "files": ["s"]},
        "quats": {"shape": [2, 4], "encoding": "quaternion_packed", "files": ["q"]},
        "sh0": {"shape": [2, 1, 4], "mins": [-2, -1, 0, -5], "maxs": [3, 4, 5, 10], "files": ["c"]},
        "shN": {"shape": [2, 9], "mins": -0.5, "maxs": 0.52, "quantization": 8, "files": ["p", "i"]}}"#;
    assert!(meta.contains(from));
    // The second entry of the palette: coefficients 0, 51 and 255 of 255 in red.
    let mut palette = vec![255; 4 * 64 * 3];
    palette[12..24].copy_from_slice(&[0, 0, 0, 255, 51, 0, 0, 255, 255, 0, 0, 255]);
    let images: [(&str, Vec<u8>); 7] = [
        ("l", webp(2, 1, &[255, 0, 0, 255, 255, 255, 255, 255])),
        ("u", webp(2, 1, &[127, 0, 0, 255, 255, 255, 255, 255])),
        ("s", webp(2, 1, &[0, 51, 255, 255, 0, 0, 0, 255])),
        ("q", webp(2, 1, &[255, 128, 128, 253, 128, 128, 128, 252])),
        ("c", webp(2, 1, &[0, 51, 255, 51, 255, 255, 255, 255])),
        ("p", webp(192, 1, &palette)),
        ("i", webp(2, 1, &[1, 0, 0, 255, 0, 0, 0, 255])),
    ];
    let mut zip = zip::ZipWriter::new(Cursor::new(Vec::new()));
    let stored =
        zip::write::SimpleFileOptions::default().compression_method(zip::CompressionMethod::Stored);
    let meta = meta.replace(from, to).into_bytes();
    for (name, bytes) in [("meta.json", meta)].into_iter().chain(images) {
        zip.start_file(name, stored).unwrap();
        zip.write_all(&bytes).unwrap();
    }
    zip.finish().unwrap().into_inner()
}

#[test]
fn bytes_of_a_sog_of_version_1_are_steps_between_bounds() {
    let (scene, report) = read("a.sog", &sog_1("means", "means")).unwrap();
    assert_eq!((&report.form[..], scene.len(), scene.sh_degree), ("SOG, version 1", 2, 1));
    let close = |a: f32, b: f64| assert!((f64::from(a) - b).abs() < 1e-5, "{a} is not {b}");
    // 127 * 256 + 255 of 65535, just below the middle of -1 to 1; sign(v) (exp(|v|) - 1).
    close(scene.means[0][0], -1.0 / 65535.0);
    close(scene.means[1][2], libm::expm1(4.0));
    scene.log_scales[0].into_iter().zip([-10.0, -8.0, -3.0]).for_each(|(a, b)| close(a, b));
    // x was left out; w is 1 / sqrt(2).
    close(scene.rotations[0][0], std::f64::consts::FRAC_1_SQRT_2);
    assert!(scene.rotations[0][1] > 0.7 && scene.rotations[1][0] > 0.99);
    scene.sh_of(0)[0].into_iter().zip([-2.0, 0.0, 5.0]).for_each(|(a, b)| close(a, b));
    assert_eq!(scene.opacity_logits, [-2.0, 10.0]);
    for (rgb, red) in scene.sh_of(0)[1..].iter().zip([-0.5, -0.296, 0.52]) {
        close(rgb[0], red);
        close(rgb[1], -0.5);
    }
    close(scene.sh_of(1)[3][2], 0.52);
}

#[test]
fn a_hostile_meta_of_a_sog_is_refused() {
    let not_json = "not the JSON of a SOG's meta.json";
    for (from, to, said) in [
        ("[2, 3], \"dtype\"", "[], \"dtype\"", "meta.json: means: its shape is empty"),
        ("[2, 3], \"dtype\"", "[-2, 3], \"dtype\"", not_json),
        ("[2, 3], \"mins\"", "[9, 3], \"mins\"", "different shapes"),
        ("[-1, 0, 0]", "[-1, 0]", not_json),
        ("[-1, 0, 0]", "[1e400, 0, 0]", "number out of range"),
        ("[-5, -4, -3]", "[1e39, -4, -3]", "number out of range"),
        ("[2, ", "[9, ", "l: it has 2 pixels for 9 Gaussians"),
        ("[2, 9]", "[2, 10]", "shN: its shape is not N by 9, 24 or 45"),
        ("[2, 9]", "[2, 24]", "p: it is 192 pixels wide, not 512"),
        ("[\"s\"]", "[\"../s\"]", "not the name of a file beside meta.json"),
        ("[\"s\"]", "[\"gone\"]", "gone: it is not in the archive"),
        ("\"means\"", "\"version\": 3, \"means\"", "SOG version 3: not read (1 and 2 are)"),
        ("\"means\"", "\"version\": 2, \"means\"", not_json),
    ] {
        says(read("a.sog", &sog_1(from, to)), said);
    }
}

#[test]
fn a_compressed_ply_comes_back_within_its_steps() {
    for (n, degree) in [(0, 0), (1, 3), (257, 0), (700, 2)] {
        let mut scene = common::scene(n, degree);
        // A lattice, so that pairs are found again; scales of all sizes.
        let cell = |i: usize| [i % 9, i / 9 % 9, i / 81].map(|v| v as f32);
        scene.means = (0..n).map(cell).collect();
        scene.log_scales.iter_mut().flatten().for_each(|v| *v = v.clamp(-15.0, 5.0));
        scene.sh.iter_mut().flatten().for_each(|v| *v = v.clamp(-2.0, 2.0));
        let (back, report) = read("a.ply", &written("compressed-ply", &scene)).unwrap();
        assert_eq!((report.format, back.len()), ("compressed-ply", n));
        let (back_again, _) = read("a.ply", &written("compressed-ply", &back)).unwrap();
        assert_eq!((back_again.len(), back_again.sh_degree), (n, degree));
        if n > 0 {
            // Half steps of a chunk that spans everything: 0..8, -15..5, colours of 2 x 2 x 0.28.
            let bounds = [0.004, 1e-5, 0.0098, 2e-3, 2.3e-3, 0.0313];
            assert_within(&format!("{n}, degree {degree}"), &scene, &paired(&back, &scene), bounds);
        }
    }
}

/// The element is declared and has no property.
#[test]
fn a_compressed_ply_of_degree_0_may_have_an_empty_element_sh() {
    let scene = common::scene(3, 0);
    let bytes = written("compressed-ply", &scene);
    let (plain, _) = read("a.ply", &bytes).unwrap();
    let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap();
    let with_sh = [&bytes[..end], b"element sh 3\n", &bytes[end..]].concat();
    let (scene, report) = read("a.ply", &with_sh).unwrap();
    assert_eq!((scene, report.notes.len()), (plain, 0));
    let wrong = [&bytes[..end], b"element sh 0\nproperty uchar f_rest_0\n", &bytes[end..]].concat();
    says(read("a.ply", &wrong), "element \"sh\": 1 f_rest properties");
}

/// A SOG of version 2 with one Gaussian of degree 0 and this codebook of scales. Its scales have the bytes 0, 2, 4.
fn sog_2(scales: &str) -> Vec<u8> {
    let meta = format!(
        r#"{{"version": 2, "count": 1, "asset": {{"generator": "a"}}, "origin": "null",
        "means": {{"mins": [-1, 0, 0], "maxs": [1, 2, 4], "files": ["l", "u"]}},
        "scales": {{"codebook": {scales}, "files": ["s"]}},
        "quats": {{"files": ["q"]}},
        "sh0": {{"codebook": [0, 1, 2], "files": ["c"]}}}}"#
    );
    let images: [(&str, [u8; 4]); 5] = [
        ("l", [255; 4]),
        ("u", [127, 0, 0, 255]),
        ("s", [0, 2, 4, 255]),
        ("q", [128, 128, 128, 252]),
        ("c", [0, 1, 2, 51]),
    ];
    let mut zip = zip::ZipWriter::new(Cursor::new(Vec::new()));
    let stored =
        zip::write::SimpleFileOptions::default().compression_method(zip::CompressionMethod::Stored);
    let images = images.map(|(name, pixel)| (name, webp(1, 1, &pixel)));
    for (name, bytes) in [("meta.json", meta.into_bytes())].into_iter().chain(images) {
        zip.start_file(name, stored).unwrap();
        zip.write_all(&bytes).unwrap();
    }
    zip.finish().unwrap().into_inner()
}

#[test]
fn missing_entries_of_a_codebook_are_read_from_their_neighbours() {
    let scales =
        |codebook| read("a.sog", &sog_2(codebook)).map(|(s, r)| (s.log_scales[0], r.notes));
    let (plain, notes) = scales("[-9, -8, -7, -6, -5]").unwrap();
    assert_eq!(plain, [-9.0, -7.0, -5.0]);
    assert_eq!(notes, ["\"origin\" of meta.json is not used"]);
    // The first as PlayCanvas has it: the second less a 4th of the range of the others.
    for codebook in
        ["[null, -8, -7, -6, -4]", "[NaN, -8, -7, -6, -4]", "[-Infinity, -8, -7, -6, -4]"]
    {
        let (first, notes) = scales(codebook).unwrap();
        assert_eq!(first, [-9.0, -7.0, -4.0]);
        assert!(
            notes.join("; ").contains("1 entry of the codebook of scales missing"),
            "{notes:?}"
        );
    }
    let (others, _) = scales("[-9, -8, null, null, null]").unwrap();
    assert_eq!(others, [-9.0, -7.75, -7.25]);
    let (inner, _) = scales("[-9, null, null, -6, -5]").unwrap();
    assert_eq!(inner, [-9.0, -7.0, -5.0]);
    says(scales("[null, null, null]"), "meta.json: scales: its codebook has no number");
    says(scales("[]"), "its codebook has no number");
}

fn gzip(data: &[u8]) -> Vec<u8> {
    let mut gz = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    gz.write_all(data).unwrap();
    gz.finish().unwrap()
}

fn spz_header(version: u32, n: u32, degree: u8) -> Vec<u8> {
    let mut data = b"NGSP".to_vec();
    data.extend(version.to_le_bytes());
    data.extend(n.to_le_bytes());
    data.extend([degree, 12, 0, 0]);
    data
}

/// Two Gaussians of degree 1.
fn spz_file(version: u32) -> Vec<u8> {
    let mut data = spz_header(version, 2, 1);
    for v in [4096i32, -8192, 1, -4096 * 100, 0, 2048] {
        data.extend(&v.to_le_bytes()[..3]);
    }
    data.extend([51, 255]);
    data.extend([0, 255, 51, 204, 102, 153]);
    data.extend([0, 160, 255, 96, 112, 128]);
    if version == 2 {
        data.extend([255, 128, 128, 0, 255, 0]);
    } else {
        data.extend((3u32 << 30 | (512 + 511) << 20 | 511).to_le_bytes());
        data.extend(0u32.to_le_bytes());
    }
    data.extend([0, 128, 255, 64, 192, 1, 129, 130, 131]);
    data.extend([128; 9]);
    data
}

#[test]
fn spz_is_decoded_and_turned_to_ply_axes() {
    for version in [2, 3] {
        let (scene, report) = read("a.spz", &gzip(&spz_file(version))).unwrap();
        assert_eq!(report.form, format!("SPZ, version {version}"));
        assert_eq!((report.gaussians_in_file, scene.len(), scene.sh_degree), (2, 2, 1));
        assert_eq!(scene.means, [[1.0, 2.0, -1.0 / 4096.0], [-100.0, 0.0, -0.5]]);
        assert_eq!(scene.log_scales, [[-10.0, 0.0, 5.9375], [-4.0, -3.0, -2.0]]);
        // 51 / 255 = 1/5: ln(1/4). 255 is the middle of its half step.
        assert!((scene.opacity_logits[0] + 1.386_294_4).abs() < 1e-6);
        assert!((scene.opacity_logits[1] - 6.926_577).abs() < 1e-5, "{}", scene.opacity_logits[1]);
        let close = |a: f32, b: f32| (a - b).abs() < 1e-6;
        assert!(close(scene.sh[0][0], -0.5 / 0.15) && close(scene.sh[0][1], 0.5 / 0.15));
        assert!(close(scene.sh[0][2], -0.3 / 0.15), "{:?}", scene.sh[0]);
        // Degree 1 is y, z, x: the first two change sign.
        assert_eq!(scene.sh_of(0)[1], [1.0, 0.0, -127.0 / 128.0]);
        assert_eq!(scene.sh_of(0)[2], [0.5, -0.5, 127.0 / 128.0]);
        assert_eq!(scene.sh_of(0)[3], [1.0 / 128.0, 2.0 / 128.0, 3.0 / 128.0]);
        let q = scene.rotations;
        let half = std::f32::consts::FRAC_1_SQRT_2;
        let expected = if version == 2 {
            // x = 1, y and z half a step above 0; then x = -1, y = 1, z = -1, too long.
            [[0.0, 1.0, -1.0 / 255.0, -1.0 / 255.0], [0.0, -1.0, -1.0, 1.0]]
        } else {
            [[0.0, -half, 0.0, -half], [0.0, 1.0, 0.0, 0.0]]
        };
        for (a, b) in q.as_flattened().iter().zip(expected.as_flattened()) {
            assert!((a - b).abs() < 1e-3, "{q:?}");
        }
    }
}

/// The same attributes as `spz_file(3)`, in the container of version 4.
fn spz4() -> Vec<u8> {
    let body = &spz_file(3)[16..];
    let mut rest = body;
    let streams: Vec<(usize, Vec<u8>)> = [9, 1, 3, 3, 4, 9]
        .map(|size| {
            let (part, after) = rest.split_at(2 * size);
            rest = after;
            let level = ruzstd::encoding::CompressionLevel::Uncompressed;
            (part.len(), ruzstd::encoding::compress_to_vec(part, level))
        })
        .into();
    let mut data = spz_header(4, 2, 1);
    // An extension record of one byte before the table of contents.
    data[14] = 2;
    data[15] = streams.len() as u8;
    data.extend(41u32.to_le_bytes());
    data.extend([0; 12]);
    data.extend([7, 0, 0, 0, 1, 0, 0, 0, 99]);
    for (raw, part) in &streams {
        data.extend((part.len() as u64).to_le_bytes());
        data.extend((*raw as u64).to_le_bytes());
    }
    streams.iter().for_each(|(_, part)| data.extend(part));
    data
}

#[test]
fn spz_4_holds_what_spz_3_holds() {
    let (old, _) = read("a.spz", &gzip(&spz_file(3))).unwrap();
    let (new, report) = read("b.spz", &spz4()).unwrap();
    assert_eq!((new, &report.form[..]), (old, "SPZ, version 4"));
}

/// `file` of version 4, or of version 3 before compression, with this extension record instead of others.
fn with_record(mut file: Vec<u8>, kind: u32, contents: &[u8]) -> Vec<u8> {
    let record =
        [&kind.to_le_bytes()[..], &(contents.len() as u32).to_le_bytes(), contents].concat();
    file[14] |= 2;
    if file[4] != 4 {
        return [file, record].concat();
    }
    file[16] = 32 + record.len() as u8;
    file.splice(32..41, record);
    file
}

#[test]
fn the_coordinate_system_that_an_spz_declares_is_honoured() {
    const AXES: u32 = 0xadbe_0003;
    let keep = ReadOptions { axes: FileAxes::Keep, ..ReadOptions::default() };
    let (turned, _) = read("a.spz", &spz4()).unwrap();
    let (kept, _) = model::read_named("a.spz", &spz4(), &keep).unwrap();
    assert_eq!(kept.means[0], turned.means[0].map(|v| if v == 1.0 { v } else { -v }));
    for system in [0u32, 4, 6, 12] {
        let contents = system.to_le_bytes();
        let expected: [f32; 3] = match system {
            // Right, down, forward: as PLY files have it.
            6 => kept.means[0],
            // Right, forward, up.
            12 => [kept.means[0][0], -kept.means[0][2], kept.means[0][1]],
            _ => turned.means[0],
        };
        for bytes in
            [with_record(spz4(), AXES, &contents), gzip(&with_record(spz_file(3), AXES, &contents))]
        {
            let (scene, report) = read("a.spz", &bytes).unwrap();
            assert_eq!((scene.means[0], report.notes.len()), (expected, 0), "{system}");
            let (scene, _) = model::read_named("a.spz", &bytes, &keep).unwrap();
            assert_eq!(scene, kept);
        }
    }
    let unknown = with_record(spz4(), AXES, &17u32.to_le_bytes());
    says(read("a.spz", &unknown), "SPZ_ADOBE_coordinate_system is 17; 1 to 16 are known");
    assert_eq!(model::read_named("a.spz", &unknown, &keep).unwrap().0, kept);
    says(read("a.spz", &with_record(spz4(), AXES, &[6])), "not a number of 4 bytes");
}

#[test]
fn what_an_spz_holds_and_the_model_does_not_is_said() {
    let (_, report) = read("a.spz", &with_record(spz4(), 0xadbe_0002, &[0; 12])).unwrap();
    let said =
        "the extension record 0xadbe0002 (SPZ_ADOBE_safe_orbit_camera) of 12 bytes is not used";
    assert_eq!(report.notes, [said]);
    let mut flags = spz4();
    flags[14] |= 0x40;
    let (_, report) = read("a.spz", &flags).unwrap();
    assert!(report.notes.iter().any(|note| note.contains("not known: 0x40")), "{report:?}");
    // Of degree 4 the first 15 coefficients of each Gaussian are read.
    let mut file = spz_header(3, 1, 4);
    file.extend([0; 9 + 1 + 3 + 3 + 4]);
    file.extend(128..200);
    let (scene, report) = read("a.spz", &gzip(&file)).unwrap();
    assert_eq!((scene.sh_degree, scene.sh_of(0)[15][2]), (3, 44.0 / 128.0));
    assert!(report.notes[0].contains("degree 4"), "{report:?}");
    let mut cut = with_record(spz4(), 7, &[1]);
    cut[36] = 200;
    says(read("a.spz", &cut), "extension records: they are not whole");
}

#[test]
fn broken_spz_files_are_named() {
    let mut short = spz_file(3);
    short.pop();
    let said = format!("{} bytes after decompression", spz_file(3).len());
    says(read("a.spz", &gzip(&short)), &said);
    for n in [u32::MAX, 1 << 24] {
        says(read("a.spz", &gzip(&spz_header(3, n, 3))), &format!("promises {n} Gaussians"));
    }
    for version in [1, 4, 5] {
        let said = format!("SPZ version {version}: not read (2 to 4 are)");
        says(read("a.spz", &gzip(&spz_header(version, 0, 0))), &said);
    }
    says(read("a.spz", &gzip(&spz_header(3, 0, 5))), "an SH degree above 4");
    says(read("a.spz", &gzip(b"not what it should be")), "no SPZ");
    let good = spz4();
    let changed = |at: usize, bytes: &[u8]| {
        let mut file = good.clone();
        file[at..at + bytes.len()].copy_from_slice(bytes);
        read("a.spz", &file)
    };
    says(changed(8, &[255; 4]), "promises 4294967295 Gaussians");
    says(changed(4, &[5]), "SPZ version 5");
    // The magic number of the first stream.
    let at = good.windows(4).position(|w| w == [0x28, 0xb5, 0x2f, 0xfd]).unwrap();
    says(changed(at, &[0]), "its compressed data is broken; get it again");
    let zipped = gzip(&spz_file(3));
    says(read("a.spz", &zipped[..zipped.len() - 9]), "is cut short; get it again");
}

fn splat_row(mean: [f32; 3], scale: [f32; 3], rgba: [u8; 4], rotation: [u8; 4]) -> Vec<u8> {
    let mut row: Vec<u8> = mean.iter().chain(&scale).flat_map(|v| v.to_le_bytes()).collect();
    row.extend(rgba);
    row.extend(rotation);
    row
}

#[test]
fn splat_is_decoded() {
    let good = splat_row([1.0, -2.0, 3.5], [1.0, 0.5, 2.0], [255, 0, 51, 51], [255, 128, 0, 64]);
    let (scene, report) = read("a.SPLAT", &good).unwrap();
    assert_eq!(report.form, ".splat");
    assert_eq!(scene.means, [[1.0, -2.0, 3.5]]);
    assert_eq!(scene.rotations, [[127.0 / 128.0, 0.0, -1.0, -0.5]]);
    let ln2 = std::f32::consts::LN_2;
    assert_eq!(scene.log_scales, [[0.0, -ln2, ln2]]);
    assert!((scene.opacity_logits[0] + 2.0 * ln2).abs() < 1e-6);
    let colour = scene.sh[0].map(|c| 0.5 + gs_model::SH_C0 * c);
    for (a, b) in colour.iter().zip([1.0, 0.0, 0.2]) {
        assert!((a - b).abs() < 1e-6, "{colour:?}");
    }
    says(read("a.splat", &good[..31]), "truncated at byte 31: the rows of a .splat are 32 bytes");
    assert!(read("a.splat", b"").unwrap().0.is_empty());

    // A scale of 0 is that of a disc. A negative one and a quaternion of 0 are invalid, and dropped on request.
    let flat = splat_row([0.0; 3], [1.0, 0.0, 1.0], [9; 4], [255; 4]);
    let thin = read("a.splat", &flat).unwrap().0.log_scales[0];
    assert_eq!(thin, [0.0, -libm::logf(1000.0), 0.0]);
    let negative = splat_row([0.0; 3], [1.0, -1.0, 1.0], [9; 4], [255; 4]);
    let unturned = splat_row([0.0; 3], [1.0; 3], [9; 4], [128; 4]);
    let all = [negative, unturned, good].concat();
    says(read("a.splat", &all), "Gaussian 0: log-scale is NaN (2 invalid Gaussians in all)");
    let drop = ReadOptions { invalid: Invalid::Drop, ..ReadOptions::default() };
    let (kept, report) = model::read_named("a.splat", &all, &drop).unwrap();
    assert_eq!((kept, report.dropped), (scene, 2));
}

/// The command blamed a full disk.
#[test]
fn what_a_format_cannot_hold_is_named() {
    let mut scene = common::scene(3, 0);
    scene.means[1][2] = -600_000.0;
    let said = "a.spz: cannot be written: Gaussian 1: coordinate -600000 is outside the range of SPZ, -524287 \
                to 524287";
    says(spz::pack("a.spz", &scene, ShBits::default()), said);
    scene.means[1][2] = -524_287.0;
    assert_eq!(read("a.spz", &written("spz", &scene)).unwrap().0.means[1][2], -524_287.0);
    let glb = Format::named("glb").unwrap();
    says(glb.write_to("a.glb", Vec::new(), &Scene::default()), "the model is empty");
}

#[test]
fn a_real_spz_4_is_read() {
    let Some(path) = shared("models/biker.spz") else { return };
    let (scene, report) = model::read(path, &ReadOptions::default()).unwrap();
    assert_eq!(report.form, "SPZ, version 4");
    assert_eq!((scene.len(), scene.sh_degree), (152_746, 0));
    // A wrong order or width of the streams would leave no plausible scales and opacities.
    let sane = scene.log_scales.as_flattened().iter().filter(|l| (-9.9..3.0).contains(*l)).count();
    assert!(sane * 10 > 3 * 9 * scene.len(), "{sane}");
    let norms = scene.rotations.iter().map(|q| q.iter().map(|v| v * v).sum::<f32>());
    assert!(norms.into_iter().all(|n| (0.99..1.51).contains(&n)));
}

/// Every attribute is within the documented steps of the written formats.
fn assert_close(a: &Scene, b: &Scene, spz: bool) {
    assert_eq!(a.len(), b.len());
    let mean_step = if spz { 1.0 / 4096.0 } else { 0.0 };
    for i in 0..a.len() {
        for (x, y) in a.means[i].iter().zip(b.means[i]) {
            assert!((x - y).abs() <= mean_step, "{i}: {:?} {:?}", a.means[i], b.means[i]);
        }
        for (x, y) in a.log_scales[i].iter().zip(b.log_scales[i]) {
            let step = if spz { 1.0 / 32.0 + 1e-5 } else { 1e-5 };
            // What the bytes, and the floats of a .splat, hold at all.
            let (low, high) = if spz { (-10.0, 5.9375) } else { (-87.33, 88.72) };
            let x = x.clamp(low, high);
            assert!((x - y).abs() <= step + if spz { 0.0 } else { 0.01 }, "{i}: {x} {y}");
        }
        assert!((sigmoid(a.opacity_logits[i]) - sigmoid(b.opacity_logits[i])).abs() < 0.0021);
        let [p, q] = [a, b].map(|s| glam::Vec4::from_array(s.rotations[i]).normalize());
        assert!(p.dot(q).abs() > if spz { 0.9999 } else { 0.999 }, "{i}: {p} {q}");
        for (k, (x, y)) in a.sh_of(i).iter().zip(b.sh_of(i)).enumerate() {
            for (x, y) in x.iter().zip(y) {
                let (bound, limit) = match (k, spz) {
                    (0, true) => (0.5 / 255.0 / 0.15, 0.5 / 0.15),
                    (0, false) => (0.5 / 255.0 / gs_model::SH_C0, 0.5 / gs_model::SH_C0),
                    _ => (1.0 / 128.0, 1.0),
                };
                assert!((x.clamp(-limit, limit) - y).abs() <= bound + 1e-5, "{i} {k}: {x} {y}");
            }
        }
    }
}

#[test]
fn spz_and_splat_round_trip() {
    for degree in 0..=3 {
        for n in [0, 1, 700] {
            let scene = common::scene(n, degree);
            let (back, report) = read("a.spz", &written("spz", &scene)).unwrap();
            assert_eq!((&report.form[..], back.sh_degree), ("SPZ, version 4", degree));
            assert_close(&scene, &back, true);
            // Values that are already on the lattice stay the same.
            let (again, _) = read("a.spz", &written("spz", &back)).unwrap();
            assert_eq!((&again.means, &again.log_scales), (&back.means, &back.log_scales));
            assert_eq!((&again.sh, &again.opacity_logits), (&back.sh, &back.opacity_logits));
        }
        let mut scene = common::scene(300, degree);
        let (back, _) = read("a.splat", &written("splat", &scene)).unwrap();
        scene.cut_sh(0);
        assert_eq!(back.sh_degree, 0);
        assert_close(&scene, &back, false);
    }
}

#[test]
fn spz_3_that_is_written_holds_what_spz_4_holds() {
    for (scene, rest) in [(small(), 8), (common::scene(5000, 3), 6), (Scene::default(), 6)] {
        let bits = ShBits { degree_1: 6, rest };
        let packed = spz::pack_version_3("a.spz", &scene, bits).unwrap();
        let (old, report) = read("a.spz", &packed).unwrap();
        assert_eq!(report.form, "SPZ, version 3");
        assert_eq!(old, read("a.spz", &spz::pack("a.spz", &scene, bits).unwrap()).unwrap().0);
    }
}

#[test]
fn a_ply_file_is_read_whatever_its_name() {
    let dir = tempfile::tempdir().unwrap();
    let (scene, path) = (common::scene(3, 1), dir.path().join("model"));
    ply::write(&path, &scene).unwrap();
    let (back, report) = model::read(&path, &ReadOptions::default()).unwrap();
    assert_eq!((back, &report.form[..]), (scene, "PLY, binary little-endian"));
}

/// A row of a `.ksplat` of level 0: one Gaussian of degree 1.
fn ksplat(level: u16, row: &[u8], head: &[(usize, u32)]) -> Vec<u8> {
    let mut file = vec![0; 4096 + 1024];
    file[1] = 1;
    file[4] = 1;
    file[20..22].copy_from_slice(&level.to_le_bytes());
    for (at, word) in [(0, 1), (4, 1), (40, 1)].iter().chain(head) {
        file[4096 + at..4100 + at].copy_from_slice(&u32::to_le_bytes(*word));
    }
    file.extend(row);
    file
}

#[test]
fn a_ksplat_without_compression_is_read() {
    let mut row = Vec::new();
    // Mean, scales, quaternion.
    for v in [1.0f32, -2.0, 3.5, 1.0, 0.5, 2.0, 0.5, -0.5, 0.5, 0.5] {
        row.extend(v.to_le_bytes());
    }
    row.extend([255, 0, 51, 51]);
    // Red of three functions, then green, then blue.
    (0..9).for_each(|i| row.extend((i as f32 / 8.0).to_le_bytes()));
    let scene = read("a.ksplat", &ksplat(0, &row, &[])).unwrap().0;
    assert_eq!((scene.means[0], scene.rotations[0]), ([1.0, -2.0, 3.5], [0.5, -0.5, 0.5, 0.5]));
    let ln2 = std::f32::consts::LN_2;
    assert_eq!(scene.log_scales[0], [0.0, -ln2, ln2]);
    assert!((scene.opacity_logits[0] + 2.0 * ln2).abs() < 1e-6);
    assert_eq!(scene.sh_of(0)[1], [0.0, 3.0 / 8.0, 6.0 / 8.0]);
    assert_eq!(scene.sh_of(0)[3], [2.0 / 8.0, 5.0 / 8.0, 1.0]);
    row[12..16].fill(0);
    let (flat, report) = read("a.ksplat", &ksplat(0, &row, &[])).unwrap();
    assert_eq!(flat.log_scales[0][0], -ln2 - libm::logf(1000.0));
    assert!(report.notes[0].contains("a scale of 0"), "{report:?}");
}

#[test]
fn a_ksplat_of_half_floats_is_read() {
    let mut row = Vec::new();
    // Steps 0 and 32,767 and 65,534 of a bucket of 5 units around (1, 2, 3); then half floats.
    for v in [0u16, 32767, 65534, 0x3c00, 0x3800, 0x0000, 0x3c00, 0x8000, 0, 0] {
        row.extend(v.to_le_bytes());
    }
    row.extend([0, 128, 255, 255]);
    row.extend([0x3c00u16; 9].iter().flat_map(|v| v.to_le_bytes()));
    let bucket: Vec<u8> =
        [1.0f32, 2.0, 3.0].iter().flat_map(|v| v.to_le_bytes()).chain(row).collect();
    // One partial bucket of one Gaussian; size, count, side, stored bytes, range, full, partial.
    let head = [(8, 256), (12, 1), (16, 5.0f32.to_bits()), (20, 12), (24, 32767), (36, 1)];
    let rows = [&1u32.to_le_bytes()[..], &bucket].concat();
    let scene = read("a.ksplat", &ksplat(1, &rows, &head)).unwrap().0;
    assert_eq!(scene.means[0], [-1.5, 2.0, 5.5]);
    assert_eq!(scene.log_scales[0][..2], [0.0, -std::f32::consts::LN_2]);
    // A half float of 0 stands for anything below 2^-25.
    assert!((scene.log_scales[0][2] + 25.0 * std::f32::consts::LN_2).abs() < 1e-5);
    assert_eq!(scene.sh_of(0)[1], [1.0; 3]);
    let nowhere = [&0u32.to_le_bytes()[..], &bucket].concat();
    says(read("a.ksplat", &ksplat(1, &nowhere, &head)), "section 0: Gaussians in no bucket");
}

#[test]
fn steps_that_show_are_said_with_the_gaussian_that_causes_them() {
    let warned = |name: &str, scene: &Scene| Format::named(name).unwrap().coarse_steps(scene);
    let mut scene = Scene { log_scales: vec![[-4.0; 3]; 300], ..Scene::zeros(300, 0) };
    for (i, mean) in scene.means.iter_mut().enumerate() {
        *mean = [i % 7, i % 11, i % 13].map(|v| v as f32 / 8.0);
    }
    for format in Format::all() {
        assert_eq!(format.coarse_steps(&scene), None, "{format:?}");
    }
    scene.means[17] = [60_000.0, 0.0, 0.0];
    let said = warned("spz", &scene).unwrap();
    assert!(said.starts_with(".spz holds positions in steps of 0.0078 here"), "{said}");
    assert!(said.contains("Gaussian 17 at (60000, 0, 0) lies far from all others"), "{said}");
    assert!(warned("compressed-ply", &scene).unwrap().contains("Gaussian 17"));
    assert_eq!(warned("ply", &scene), None);
    scene.log_scales.fill([-1.0; 3]);
    assert_eq!(warned("spz", &scene), None);
}

#[test]
fn an_antialiased_model_is_antialiased_in_every_format_that_has_a_place_for_it() {
    for antialiased in [true, false] {
        let scene = Scene { antialiased, ..small() };
        for format in Format::all().iter().filter(|f| f.is_written()) {
            let file = written(format.name, &scene);
            let (back, _) = format.read("a", &file, &ReadOptions::default()).unwrap();
            assert_eq!(back.antialiased, antialiased && format.says_antialiased, "{format:?}");
        }
        let spz_3 = spz::pack_version_3("a.spz", &scene, ShBits::default()).unwrap();
        assert_eq!(read("a.spz", &spz_3).unwrap().0.antialiased, antialiased);
    }
}

#[test]
fn the_comments_of_a_ply_say_whether_a_model_is_antialiased() {
    let ply = written("ply", &small());
    let with = |comments: &str| {
        let mut file = b"ply\nformat binary_little_endian 1.0\n".to_vec();
        let rest = ply[file.len()..].to_vec();
        file.extend(comments.bytes());
        file.extend(rest);
        read("a.ply", &file).unwrap().0.antialiased
    };
    for comments in [
        "comment SplatRenderMode: mip\n",
        "comment  splatrendermode:MIP \n",
        "comment Exported from Brush\ncomment SplatRenderMode: mip\n",
        "comment antialiased 1\n",
        "comment Antialiased: true\n",
        "comment SplatRenderMode: default\ncomment antialiased 1\n",
    ] {
        assert!(with(comments), "{comments}");
    }
    for comments in [
        "",
        "comment SplatRenderMode: default\n",
        "comment SplatRenderMode: 2dgs\n",
        "comment antialiased 0\n",
        "comment antialiased 1\ncomment SplatRenderMode: default\n",
        "comment antialiased pictures 1\n",
    ] {
        assert!(!with(comments), "{comments}");
    }
}

#[test]
fn a_sog_says_whether_a_model_is_antialiased() {
    for (says, antialiased) in [
        ("\"model\": \"antialiased\", ", true),
        ("\"antialias\": true, ", true),
        ("\"model\": \"default\", ", false),
        ("\"antialias\": false, ", false),
        ("", false),
    ] {
        let sog = sog_1("\"means\": {", &format!("{says}\"means\": {{"));
        assert_eq!(read("a.sog", &sog).unwrap().0.antialiased, antialiased, "{says}");
    }
}
