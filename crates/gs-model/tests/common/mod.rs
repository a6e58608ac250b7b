//! Helpers shared by the integration tests.
#![allow(dead_code, reason = "each test binary uses some of them")]

pub(crate) mod ply;

use std::fs;
use std::io::{Cursor, Write};
use std::path::PathBuf;

use base64::Engine;
use base64::prelude::BASE64_STANDARD;
use gs_model::{
    Error, FileAxes, Format, Invalid, ReadOptions, Report, Result, SH_C0, Scene, model,
};
use serde_json::Value;
use tempfile::TempDir;

const STRICT: ReadOptions =
    ReadOptions { invalid: Invalid::Error, axes: FileAxes::Turn, codec: None, max_gaussians: None };
/// Invalid Gaussians are left out.
pub(crate) const DROP: ReadOptions = ReadOptions { invalid: Invalid::Drop, ..STRICT };
/// Every value stays as it is.
pub(crate) const KEEP: ReadOptions = ReadOptions { invalid: Invalid::Keep, ..STRICT };

/// A path in the shared test data beside the workspace, or `None` with a message if it is absent.
pub(crate) fn shared(path: &str) -> Option<PathBuf> {
    let full = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../shared").join(path);
    if full.exists() {
        Some(full)
    } else {
        eprintln!("SKIPPED: no {}", full.display());
        None
    }
}

/// A file of `fixtures`.
pub(crate) fn fixture(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../fixtures").join(name)
}

/// Reads a model of that name from bytes.
pub(crate) fn read(name: &str, bytes: &[u8]) -> Result<(Scene, Report)> {
    model::read_named(name, bytes, &STRICT)
}

/// A scene as a file of the format of that name.
pub(crate) fn written(format: &str, scene: &Scene) -> Vec<u8> {
    let mut file = Vec::new();
    Format::named(format).unwrap().write_to("<file>", &mut file, scene).unwrap();
    file
}

/// An archive with these members.
pub(crate) fn zipped(members: &[(&str, Vec<u8>)]) -> Vec<u8> {
    let mut zip = zip::ZipWriter::new(Cursor::new(Vec::new()));
    let stored =
        zip::write::SimpleFileOptions::default().compression_method(zip::CompressionMethod::Stored);
    for (name, bytes) in members {
        zip.start_file(*name, stored).unwrap();
        zip.write_all(bytes).unwrap();
    }
    zip.finish().unwrap().into_inner()
}

pub(crate) fn gzip(data: &[u8]) -> Vec<u8> {
    let mut gz = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    gz.write_all(data).unwrap();
    gz.finish().unwrap()
}

/// The JSON and the data of a `.glb`.
pub(crate) fn glb_parts(glb: &[u8]) -> (Value, Vec<u8>) {
    let len = u32::from_le_bytes(glb[12..16].try_into().unwrap()) as usize;
    (serde_json::from_slice(&glb[20..20 + len]).unwrap(), glb[28 + len..].to_vec())
}

/// Data in a URI.
pub(crate) fn data_uri(data: &[u8]) -> String {
    format!("data:application/octet-stream;base64,{}", BASE64_STANDARD.encode(data))
}

/// A `.glb` as a `.gltf` whose data are in a URI.
pub(crate) fn gltf_of(glb: &[u8]) -> Value {
    let (mut json, data) = glb_parts(glb);
    json["buffers"][0]["uri"] = data_uri(&data).into();
    json
}

/// Writes a file in a folder.
pub(crate) fn put(dir: &TempDir, name: &str, contents: impl AsRef<[u8]>) {
    let path = dir.path().join(name);
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    fs::write(path, contents).unwrap();
}

/// Rows of an images.txt; `between` follows each.
pub(crate) fn image_rows(images: &[&str], between: &str) -> String {
    let pose = "0.9 0.1 -0.3 0.2 1.5 -2 0.5 1";
    let row = |(i, name): (usize, &&str)| format!("{} {pose} {name}\n{between}", i + 1);
    images.iter().enumerate().map(row).collect()
}

/// Writes a COLMAP text model with these images, all from one camera.
pub(crate) fn put_colmap(dir: &TempDir, under: &str, images: &[&str]) {
    let file = |name: &str| PathBuf::from(under).join(name).display().to_string();
    put(dir, &file("cameras.txt"), "1 PINHOLE 8 6 10 10 4 3\n");
    put(dir, &file("images.txt"), image_rows(images, "\n"));
}

/// Every so many Gaussians of the room, at that SH degree.
pub(crate) fn room(step: usize, sh_degree: u8) -> Scene {
    let (room, _) = gs_model::ply::read(fixture("room/point_cloud.ply")).unwrap();
    let mut scene = room.select(&(0..room.len()).step_by(step).collect::<Vec<_>>());
    scene.cut_sh(sh_degree);
    scene
}

/// The message of an error that is one line of plain words, begins with the file's name and says `needle`.
#[track_caller]
pub(crate) fn says<T: std::fmt::Debug>(outcome: Result<T>, needle: &str) -> String {
    let text = gs_model::chain(&outcome.unwrap_err());
    assert!(text.contains(needle), "{needle:?} is not in {text:?}");
    assert!(text.lines().count() == 1 && !text.contains("{ ") && text.contains(": "), "{text}");
    text
}

/// A part of a file that is missing, or is not as it must be.
pub(crate) fn is_broken(error: &Error) -> bool {
    let known = matches!(
        error,
        Error::Truncated { .. }
            | Error::Malformed { .. }
            | Error::OtherFormat { .. }
            | Error::NoModel { .. }
            | Error::InvalidGaussian { .. }
    );
    known && gs_model::chain(error).lines().count() == 1
}

/// A small scene: every number differs from every other, signs and magnitudes vary.
pub(crate) fn scene(n: usize, sh_degree: u8) -> Scene {
    let mut count = 0u32;
    let mut next = || {
        count += 1;
        let magnitude = [1e-3, 0.5, 1.0, 40.0][count as usize % 4];
        let sign = if count.is_multiple_of(3) { -1.0 } else { 1.0 };
        sign * magnitude * (1.0 + count as f32 / 1024.0)
    };
    let k = usize::from(sh_degree + 1) * usize::from(sh_degree + 1);
    Scene {
        means: (0..n).map(|_| [next(), next(), next()]).collect(),
        rotations: (0..n).map(|_| [next(), next(), next(), next()]).collect(),
        log_scales: (0..n).map(|_| [next(), next(), next()]).collect(),
        opacity_logits: (0..n).map(|_| next()).collect(),
        sh_degree,
        sh: (0..n * k).map(|_| [next(), next(), next()]).collect(),
        ..Scene::default()
    }
}

/// As [`scene`], of numbers that all formats hold well.
pub(crate) fn mild(n: usize, sh_degree: u8) -> Scene {
    let mut scene = scene(n, sh_degree);
    scene.means.iter_mut().flatten().for_each(|v| *v = v.clamp(-9.0, 9.0));
    scene.rotations.iter_mut().flatten().for_each(|v| *v = v.clamp(-2.0, 2.0));
    scene.log_scales.iter_mut().flatten().for_each(|v| *v = v.clamp(-6.0, 2.0));
    scene.opacity_logits.iter_mut().for_each(|v| *v = v.clamp(-4.0, 4.0));
    scene.sh.iter_mut().flatten().for_each(|v| *v = v.clamp(-0.9, 0.9));
    scene
}

/// All numbers of a scene as bits, so that -0 and 0 differ.
pub(crate) fn bits(scene: &Scene) -> Vec<u32> {
    let arrays: [&[f32]; 5] = [
        scene.means.as_flattened(),
        scene.rotations.as_flattened(),
        scene.log_scales.as_flattened(),
        &scene.opacity_logits,
        scene.sh.as_flattened(),
    ];
    arrays.into_iter().flatten().map(|v| v.to_bits()).collect()
}

/// Share of points that a camera sees in front of it and inside its image.
pub(crate) fn share_in_view(camera: &gs_model::Camera, points: &[[f64; 3]]) -> f64 {
    let seen = points.iter().filter(|&&p| {
        let c = camera.rotation * glam::DVec3::from_array(p) + camera.translation;
        let u = camera.fx * c.x / c.z + camera.cx;
        let v = camera.fy * c.y / c.z + camera.cy;
        c.z > 0.0
            && (0.0..f64::from(camera.width)).contains(&u)
            && (0.0..f64::from(camera.height)).contains(&v)
    });
    seen.count() as f64 / points.len() as f64
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

#[track_caller]
pub(crate) fn assert_within(what: &str, a: &Scene, b: &Scene, bounds: [f32; 6]) {
    let worst = differences(a, b);
    println!("{what}: {worst:?}");
    for (k, (d, bound)) in worst.into_iter().zip(bounds).enumerate() {
        assert!(d <= bound, "{what}, attribute {k}: {worst:?} of {bounds:?}");
    }
}
