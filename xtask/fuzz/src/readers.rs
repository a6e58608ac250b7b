//! Files: models, cameras, checkpoints.

use std::io::{Cursor, Write as _};
use std::path::PathBuf;
use std::sync::OnceLock;

use finetune::{Photo, TrainView};
use flate2::Compression;
use flate2::write::GzEncoder;
use gs_model::{FileAxes, Format, Invalid, ReadOptions, Scene, colmap as sfm, inria, nerf, ply};

use tune::{FineTune, FineTuneOptions};
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

use crate::{choice, number};

/// Strict or lenient, as the two lowest bits say.
fn options(byte: u8) -> ReadOptions {
    ReadOptions {
        invalid: if byte & 1 == 0 { Invalid::Error } else { Invalid::Drop },
        axes: if byte & 2 == 0 { FileAxes::Turn } else { FileAxes::Keep },
        codec: Some(&::gsvx::gltf::CODEC),
        max_gaussians: None,
    }
}

/// A model that was read is valid, and survives being written.
fn check_model(scene: &Scene) {
    scene.validate().expect("a reader returned an invalid scene");
    let mut file = Vec::new();
    ply::write_to(&mut file, scene).expect("a valid scene was not written");
    let (back, _) = ply::read_bytes(&file).expect("a written scene was not read");
    assert!(back == *scene, "a scene changed by being written and read");
}

/// PLY: options, then the file.
pub fn ply(data: &[u8]) -> bool {
    let (byte, file) = choice(data);
    read("ply", byte, file)
}

/// Reads a file with the options of a byte.
fn read(format: &str, byte: u8, file: &[u8]) -> bool {
    let format = Format::named(format).expect("a format of the table");
    let Ok((scene, report)) = format.read("<bytes>", file, &options(byte)) else { return false };
    assert_eq!(report.gaussians_in_file, scene.len() + report.dropped);
    check_model(&scene);
    true
}

/// Options, then the file.
fn whole(format: &str, data: &[u8]) -> bool {
    let (byte, file) = choice(data);
    read(format, byte, file)
}

/// SPZ: options, then the file; with bit 2, what is inside the gzip file instead.
pub fn spz(data: &[u8]) -> bool {
    let (byte, file) = choice(data);
    let zipped = if byte & 4 != 0 { &gzip(file) } else { file };
    read("spz", byte, zipped)
}

/// A gzip file without compression: deflate is a well-fuzzed library's business.
pub(crate) fn gzip(data: &[u8]) -> Vec<u8> {
    let mut gzip = GzEncoder::new(Vec::new(), Compression::none());
    gzip.write_all(data).expect("written to memory");
    gzip.finish().expect("written to memory")
}

/// `.splat`: options, then the file.
pub fn splat(data: &[u8]) -> bool {
    whole("splat", data)
}

/// `compressed.ply`: options, then the file.
pub fn compressed_ply(data: &[u8]) -> bool {
    whole("compressed-ply", data)
}

/// `.glb`: options, then the file.
pub fn glb(data: &[u8]) -> bool {
    whole("glb", data)
}

/// SOG: options, then the file; with bit 2, the lengths of `meta.json` and of the image `a`, both, and the
/// image `b`, which are packed here. Checksums of zip would let no change through.
pub fn sog(data: &[u8]) -> bool {
    let (byte, rest) = choice(data);
    if byte & 4 == 0 {
        return whole("sog", data);
    }
    let (json, rest) = number(rest);
    let (json, rest) = rest.split_at(json.min(rest.len()));
    let (a, rest) = number(rest);
    let (a, b) = rest.split_at(a.min(rest.len()));
    let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
    for (name, bytes) in [("meta.json", json), ("a", a), ("b", b)] {
        let stored = SimpleFileOptions::default().compression_method(CompressionMethod::Stored);
        zip.start_file(name, stored).expect("a member of an archive in memory");
        zip.write_all(bytes).expect("written to memory");
    }
    let file = zip.finish().expect("written to memory").into_inner();
    read("sog", byte, &file)
}

/// `.ksplat`: options, then the numbers of the header and of the first section's header, four bytes
/// each, then what follows the headers. They are mostly zeros, which would take the room of an input.
pub fn ksplat(data: &[u8]) -> bool {
    let (byte, data) = choice(data);
    let Some((heads, body)) = data.split_at_checked(KSPLAT_HEADS) else { return false };
    let (file, section) = heads.split_at(44);
    let mut whole = vec![0; 4096 + 1024];
    whole[..44].copy_from_slice(file);
    whole[4096..4096 + 44].copy_from_slice(section);
    whole.extend(body);
    read("ksplat", byte, &whole)
}

/// Bytes of the two headers of a `.ksplat` that have a meaning.
pub(crate) const KSPLAT_HEADS: usize = 88;

/// COLMAP: form, the length of a cameras file, that file, and an images file.
pub fn colmap(data: &[u8]) -> bool {
    let (byte, data) = choice(data);
    let form = if byte & 1 == 0 { sfm::Form::Binary } else { sfm::Form::Text };
    let (len, rest) = number(data);
    let (cameras, images) = rest.split_at(len.min(rest.len()));
    let Ok(cameras) = sfm::cameras_from_bytes(cameras, images, form) else { return false };
    cameras.iter().for_each(check_camera);
    true
}

/// `cameras.json` or `transforms.json`.
pub fn cameras(data: &[u8]) -> bool {
    let (byte, file) = choice(data);
    if byte & 1 == 0 {
        let Ok(cameras) = inria::cameras_from_bytes("<bytes>", file) else { return false };
        cameras.iter().for_each(check_camera);
    } else {
        let place = "/nowhere/transforms.json";
        let Ok(views) = nerf::views_from_bytes(place, file) else {
            return false;
        };
        views.iter().for_each(|v| check_camera(&v.camera));
    }
    true
}

fn check_camera(c: &gs_model::Camera) {
    assert!(c.fx.is_finite() && c.fy.is_finite() && c.cx.is_finite() && c.cy.is_finite());
    assert!(c.rotation.is_finite() && c.translation.is_finite());
}

/// The scene whose checkpoints the target `checkpoint` reads.
#[must_use]
pub fn tiny_scene() -> Scene {
    Scene {
        means: vec![[0.0; 3], [1.0; 3]],
        rotations: vec![[1.0, 0.0, 0.0, 0.0]; 2],
        log_scales: vec![[-3.0; 3]; 2],
        opacity_logits: vec![0.5; 2],
        sh_degree: 0,
        sh: vec![[0.1; 3]; 2],
        ..Scene::default()
    }
}

/// A fine-tune of [`tiny_scene`] that makes no step; it goes on from the checkpoint if that exists.
pub(crate) fn fine_tune(checkpoint: PathBuf) -> tune::Result<FineTune> {
    let up = [0.0, -1.0, 0.0];
    let eye = [0.0, 0.0, -2.0];
    let camera = gs_model::Camera::looking_at("front".into(), eye, [0.0; 3], up, [4, 3], 30.0);
    let view = TrainView { camera, photo: Photo::black(4, 3) };
    let options =
        FineTuneOptions { steps: 0, checkpoint: Some(checkpoint), ..FineTuneOptions::default() };
    FineTune::new(tiny_scene(), vec![view; 3], options)
}

/// A fine-tune's checkpoint, its checksum repaired.
pub fn checkpoint(data: &[u8]) -> bool {
    static FOLDER: OnceLock<tempfile::TempDir> = OnceLock::new();
    let mut file = data.to_vec();
    if let Some(body) = file.len().checked_sub(4) {
        let crc = crc32c::crc32c(&file[..body]);
        file[body..].copy_from_slice(&crc.to_le_bytes());
    }
    let folder = FOLDER.get_or_init(|| tempfile::tempdir().expect("a temporary folder"));
    let path = folder.path().join(format!("{:?}", std::thread::current().id()));
    std::fs::write(&path, file).expect("written");
    fine_tune(path).is_ok()
}
