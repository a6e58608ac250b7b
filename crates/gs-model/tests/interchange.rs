//! Files of other tools, and what splat-transform reads in them.

mod common;

use std::path::{Path, PathBuf};
use std::process::Command;

use common::shared;
use gs_model::model::{self, Format};
use gs_model::{ReadOptions, SH_C0, Scene, ply, splat, spz};

fn fixture(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../fixtures").join(name)
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

/// The largest differences of two scenes: means, rotations (1 - |cosine|, half turns about an axis of the
/// Gaussian left out), log-scales, opacities, colours, SH coefficients above degree 0.
fn differences(a: &Scene, b: &Scene) -> [f32; 6] {
    assert_eq!((a.len(), a.sh_degree), (b.len(), b.sh_degree));
    let mut worst = [0.0f32; 6];
    let mut see = |k: usize, v: f32| {
        assert!(v.is_finite());
        worst[k] = worst[k].max(v);
    };
    let opacity = |l: f32| 1.0 / (1.0 + libm::exp(-f64::from(l)));
    for i in 0..a.len() {
        for k in 0..3 {
            see(0, (a.means[i][k] - b.means[i][k]).abs());
            see(2, (a.log_scales[i][k] - b.log_scales[i][k]).abs());
            see(4, SH_C0 * (a.sh_of(i)[0][k] - b.sh_of(i)[0][k]).abs());
            for (p, q) in a.sh_of(i)[1..].iter().zip(&b.sh_of(i)[1..]) {
                see(5, (p[k] - q[k]).abs());
            }
        }
        let [p, q] = [a, b].map(|s| {
            let [w, x, y, z] = s.rotations[i].map(f64::from);
            glam::DQuat::from_xyzw(x, y, z, w).normalize()
        });
        // From one to the other: half a turn about an axis changes nothing of a Gaussian.
        let between = glam::DVec4::from(p.conjugate() * q).abs();
        see(1, 1.0 - between.max_element() as f32);
        see(3, (opacity(a.opacity_logits[i]) - opacity(b.opacity_logits[i])).abs() as f32);
    }
    worst
}

/// GaussianSplats3D 0.4.7 moves 28 of these 300 Gaussians when it writes. So what counts is where it reads
/// them itself.
#[test]
fn a_ksplat_is_read_as_by_its_own_library() {
    let path = fixture("formats/small.ksplat");
    let (read, report) = model::read(path, &ReadOptions::default()).unwrap();
    assert_eq!((report.format, report.gaussians_in_file), (Format::Ksplat, 300));
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

fn assert_within(what: &str, a: &Scene, b: &Scene, bounds: [f32; 6]) {
    let worst = differences(a, b);
    println!("{what}: {worst:?}");
    for (k, (d, bound)) in worst.into_iter().zip(bounds).enumerate() {
        assert!(d <= bound, "{what}, attribute {k}: {worst:?} of {bounds:?}");
    }
}

#[test]
fn files_of_other_tools_hold_the_model_that_was_written() {
    let scene = small();
    let size = scene.log_scales.as_flattened().iter();
    println!("log-scales to {:?}", size.fold(f32::MIN, |m, v| m.max(*v)));
    for (name, format, bounds) in [
        // A chunk of 256 Gaussians is as large as the room here.
        ("compressed.ply", Format::CompressedPly, [6e-3, 1e-5, 6e-3, 2e-3, 6e-3, 0.033]),
        // The palette is approximate.
        ("sog", Format::Sog, [3e-4, 3e-4, 0.04, 4e-3, 0.02, 0.3]),
        ("glb", Format::Gltf, [1e-6, 1e-6, 1e-5, 1e-6, 0.0, 0.0]),
    ] {
        let path = fixture(&format!("formats/small.{name}"));
        let (read, report) = model::read(path, &ReadOptions::default()).unwrap();
        assert_eq!((report.format, report.gaussians_in_file), (format, 300));
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
    assert_eq!(report.format, Format::Sog);
    assert_eq!(unbundled, bundled);
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
        let mut file = Vec::new();
        ply::compressed::write_to(&mut file, &scene).unwrap();
        let (back, report) = model::read_named("a.ply", &file, &ReadOptions::default()).unwrap();
        assert_eq!((report.format, back.len()), (Format::CompressedPly, n));
        let mut again = Vec::new();
        ply::compressed::write_to(&mut again, &back).unwrap();
        let (back_again, _) = model::read_named("a.ply", &again, &ReadOptions::default()).unwrap();
        assert_eq!((back_again.len(), back_again.sh_degree), (n, degree));
        if n > 0 {
            // Half steps of a chunk that spans everything: 0..8, -15..5, colours of 2 x 2 x 0.28.
            let bounds = [0.004, 1e-5, 0.0098, 2e-3, 2.3e-3, 0.0313];
            assert_within(&format!("{n}, degree {degree}"), &scene, &paired(&back, &scene), bounds);
        }
    }
}

/// The path of the tool, or `None` with a message.
fn splat_transform() -> Option<PathBuf> {
    let path = std::env::var_os("PATH")?;
    let found =
        std::env::split_paths(&path).map(|d| d.join("splat-transform")).find(|p| p.is_file());
    if found.is_none() {
        eprintln!("SKIPPED: no splat-transform: npm install -g @playcanvas/splat-transform@3.7.0");
    }
    found
}

fn convert(tool: &Path, from: &Path, to: &Path) {
    convert_with(tool, from, &[], to);
}

/// `actions` are done between reading and writing.
fn convert_with(tool: &Path, from: &Path, actions: &[&str], to: &Path) {
    let mut command = Command::new(tool);
    command.args(["--quiet", "--overwrite", "--gpu", "cpu"]).arg(from).args(actions).arg(to);
    let out = command.output().unwrap();
    assert!(out.status.success(), "{from:?}: {}", String::from_utf8_lossy(&out.stderr));
}

/// What splat-transform makes of a PLY, a part of whose SH degrees it may leave out.
fn written(tool: &Path, dir: &Path, name: &str, scene: &Scene, sh_degree: u8) -> Vec<PathBuf> {
    let floats = dir.join(format!("{name}.ply"));
    let mut cut = scene.clone();
    cut.cut_sh(sh_degree);
    ply::write(&floats, &cut).unwrap();
    let files = ["compressed.ply", "sog", "spz", "glb"].map(|e| dir.join(format!("{name}.{e}")));
    for file in &files {
        convert(tool, &floats, file);
    }
    // It reads no glTF, so what it writes is compared with what it was given.
    let (back, _) = model::read(&files[3], &ReadOptions::default()).unwrap();
    assert_within(&format!("{name}.glb"), &cut, &back, [1e-6, 1e-6, 2e-5, 1e-6, 0.0, 0.0]);
    let ours = ["compressed.ply", "spz", "splat"].map(|e| dir.join(format!("{name}.ours.{e}")));
    ply::compressed::write(&ours[0], &cut).unwrap();
    spz::write(&ours[1], &cut, &spz::WriteOptions::default()).unwrap();
    splat::write(&ours[2], &cut).unwrap();
    files.into_iter().take(3).chain(ours).collect()
}

/// The same file, read here and by splat-transform.
fn assert_read_alike(tool: &Path, file: &Path, dir: &Path) {
    let theirs = dir.join("theirs.ply");
    // It leaves the axes of SPZ as they are. A turn makes them those of PLY files: biker.spz is then the model of
    // biker.compressed.ply, as it is here.
    let is_spz = file.extension().is_some_and(|e| e == "spz");
    let turn: &[&str] = if is_spz { &["--rotate", "180,0,0"] } else { &[] };
    convert_with(tool, file, turn, &theirs);
    // It writes opacities of 0 and 1 as infinite logits, where the bytes 0 and 255 stand for a quarter of
    // a step inside here.
    let options = ReadOptions { clamp_infinite_opacity: Some(7.0), ..ReadOptions::default() };
    let (theirs, _) = ply::read_with(theirs, &options).unwrap();
    let (ours, _) = model::read(file, &ReadOptions::default()).unwrap();
    // It takes the byte b of a quaternion in a .splat for b / 127.5 - 1, where it is b / 128 - 1.
    let is_splat = file.extension().is_some_and(|e| e == "splat");
    let rotations = if is_splat { 3.2e-5 } else { 1e-6 };
    let bounds = [2e-6, rotations, 2e-6, 1.01e-3, 1e-6, 1e-6];
    assert_within(&file.display().to_string(), &ours, &theirs, bounds);
}

#[test]
fn splat_transform_reads_the_same_values() {
    let Some(tool) = splat_transform() else { return };
    let dir = tempfile::tempdir().unwrap();
    let (room, _) = ply::read(fixture("room/point_cloud.ply")).unwrap();
    let room = room.select(&(0..11_001).step_by(5).collect::<Vec<_>>());
    let mut files = written(&tool, dir.path(), "room", &room, 3);
    if let Some(path) = shared("scenes/fox/point_cloud.ply") {
        let (fox, _) = ply::read(path).unwrap();
        let part = |step: usize| fox.select(&(0..fox.len()).step_by(step).collect::<Vec<_>>());
        files.extend(written(&tool, dir.path(), "fox", &part(20), 3));
        // A palette for each number of degrees, and none.
        for degree in 0..3 {
            files.extend(written(&tool, dir.path(), &format!("fox{degree}"), &part(100), degree));
        }
    }
    if let Some(biker) = shared("models/biker.compressed.ply") {
        let sog = dir.path().join("biker.sog");
        convert(&tool, &biker, &sog);
        files.extend([biker, sog]);
    }
    let ksplats = ["small", "tiny.0", "tiny.1"];
    files.extend(ksplats.map(|name| fixture(&format!("formats/{name}.ksplat"))));
    files.extend(
        ["biker.spz", "flower.spz", "flower.splat"]
            .iter()
            .filter_map(|name| shared(&format!("models/{name}"))),
    );
    for file in files {
        assert_read_alike(&tool, &file, dir.path());
    }
}
