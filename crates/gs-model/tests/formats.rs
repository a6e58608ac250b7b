//! The formats beside PLY: files of other tools, files made by hand, and what is written. SOG and SPZ have files of
//! their own.

mod common;

use common::{DROP, assert_within, fixture, read, room, says, written};
use gs_model::spz::{self, ShBits};
use gs_model::{Format, ReadOptions, Scene, model};

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
    let ksplat = Format::named("ksplat").unwrap();
    says(
        ksplat.write_to("a.ksplat", Vec::new(), &Scene::default()),
        "cannot be written: ksplat is read only",
    );
}

/// The model that `fixtures/formats` holds in several formats.
fn small() -> Scene {
    room(36, 1).select(&(0..300).collect::<Vec<_>>())
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

#[test]
fn files_of_other_tools_hold_the_model_that_was_written() {
    let (small, tiny) = (small(), room(180, 2).select(&(0..60).collect::<Vec<_>>()));
    for (name, scene, form, bounds) in [
        // A chunk of 256 Gaussians is as large as the room here.
        (
            "small.compressed.ply",
            &small,
            "PlayCanvas compressed.ply",
            [6e-3, 1e-5, 6e-3, 2e-3, 6e-3, 0.033],
        ),
        // The palette is approximate.
        ("small.sog", &small, "SOG, version 2", [3e-4, 3e-4, 0.04, 4e-3, 0.02, 0.3]),
        ("small.glb", &small, "glTF, KHR_gaussian_splatting", [1e-6, 1e-6, 1e-5, 1e-6, 0.0, 0.0]),
        // Colours and opacities are bytes, rounded down.
        ("tiny.0.ksplat", &tiny, ".ksplat", [0.0, 1e-6, 1e-6, 3.93e-3, 3.93e-3, 0.0]),
    ] {
        let path = fixture("formats").join(name);
        let (read, report) = model::read(path, &ReadOptions::default()).unwrap();
        assert_eq!((&report.form[..], report.gaussians_in_file), (form, scene.len()));
        assert_within(name, &paired(scene, &read), &read, bounds);
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
    let (kept, report) = model::read_named("a.splat", &all, &DROP).unwrap();
    assert_eq!((kept, report.dropped), (scene, 2));
}

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
fn spz_and_splat_come_back_within_their_steps() {
    for degree in 0..=3 {
        for n in [0, 1, 700] {
            let scene = common::mild(n, degree);
            let (back, report) = read("a.spz", &written("spz", &scene)).unwrap();
            assert_eq!((&report.form[..], back.sh_degree), ("SPZ, version 4", degree));
            assert_within("spz", &scene, &back, [1.4e-4, 1e-4, 0.0314, 2.1e-3, 3.8e-3, 4e-3]);
            // Values that are already on the lattice stay the same.
            let (again, _) = read("a.spz", &written("spz", &back)).unwrap();
            assert_eq!((&again.means, &again.log_scales), (&back.means, &back.log_scales));
            assert_eq!((&again.sh, &again.opacity_logits), (&back.sh, &back.opacity_logits));
        }
        let mut scene = common::mild(300, degree);
        let (back, _) = read("a.splat", &written("splat", &scene)).unwrap();
        scene.cut_sh(0);
        assert_within("splat", &scene, &back, [0.0, 1e-3, 1e-5, 2.1e-3, 2e-3, 0.0]);
    }
    // What is beyond the range of the bytes is cut.
    let mut scene = common::mild(1, 1);
    (scene.log_scales[0], scene.sh[1]) = ([-30.0, 0.0, 30.0], [-4.0, 0.0, 4.0]);
    let (back, _) = read("a.spz", &written("spz", &scene)).unwrap();
    assert_eq!(
        (back.log_scales[0], back.sh[1]),
        ([-10.0, 0.0, 5.9375], [-127.0 / 128.0, 0.0, 1.0])
    );
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
