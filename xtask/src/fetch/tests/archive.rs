//! Archives as the public ones are, but small.

use std::fs::File;
use std::io::{Seek, SeekFrom, Write};
use std::path::Path;

use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

/// Bytes that deflate cannot shorten much, different for every seed.
pub(super) fn noise(seed: u64, len: usize) -> Vec<u8> {
    let mut state = seed.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    let mut next = || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 32) as u8
    };
    (0..len).map(|_| next()).collect()
}

/// Name in the archive and bytes.
pub(super) type Entry = (String, Vec<u8>);

/// The model, between files that are not wanted.
pub(super) fn models() -> Vec<Entry> {
    let other = |name: &str, seed| (name.to_owned(), noise(seed, 150_000));
    vec![
        other("bicycle/point_cloud/iteration_30000/point_cloud.ply", 1),
        other("playroom/input.ply", 2),
        ("playroom/cameras.json".to_owned(), b"[]".repeat(300)),
        other("playroom/point_cloud/iteration_7000/point_cloud.ply", 3),
        ("playroom/point_cloud/iteration_30000/point_cloud.ply".to_owned(), noise(4, 400_000)),
        other("train/point_cloud/iteration_30000/point_cloud.ply", 5),
    ]
}

/// Photos of two scenes, with COLMAP data.
pub(super) fn photos() -> Vec<Entry> {
    let mut entries = Vec::new();
    for (scene, seed) in [("db/playroom", 100), ("tandt/truck", 200)] {
        for i in 0..6 {
            let name = format!("{scene}/images/DSC{i:03}.jpg");
            entries.push((name, noise(seed + i, 20_000)));
        }
        for (i, name) in ["cameras.bin", "images.bin", "points3D.bin"].iter().enumerate() {
            let bytes = noise(seed + 50 + i as u64, 30_000);
            entries.push((format!("{scene}/sparse/0/{name}"), bytes));
        }
    }
    entries
}

/// What a fetch of playroom is to leave on disk, by path.
pub(super) fn expected(models: &[Entry], photos: &[Entry]) -> Vec<Entry> {
    let model = models.iter().filter_map(|(name, bytes)| {
        let path = match name.as_str() {
            "playroom/cameras.json" => "cameras.json",
            "playroom/point_cloud/iteration_30000/point_cloud.ply" => "point_cloud.ply",
            _ => return None,
        };
        Some((path.to_owned(), bytes.clone()))
    });
    let photos = photos.iter().filter_map(|(name, bytes)| {
        let path = name.strip_prefix("db/playroom/").filter(|p| !p.contains("points3D"))?;
        Some((path.to_owned(), bytes.clone()))
    });
    let mut all: Vec<Entry> = model.chain(photos).collect();
    all.sort();
    all
}

/// Writes a ZIP: every other entry deflated, all with ZIP64 sizes. `hole` empty bytes come
/// first; beyond 4 GiB, positions need ZIP64 too.
pub(super) fn write_zip(path: &Path, entries: &[Entry], hole: u64) {
    let mut file = File::create(path).unwrap();
    file.seek(SeekFrom::Start(hole)).unwrap();
    let mut zip = ZipWriter::new(file);
    for (i, (name, bytes)) in entries.iter().enumerate() {
        let method = [CompressionMethod::Deflated, CompressionMethod::Stored][i % 2];
        let options = SimpleFileOptions::default().compression_method(method).large_file(true);
        zip.start_file(name.as_str(), options).unwrap();
        zip.write_all(bytes).unwrap();
    }
    zip.finish().unwrap();
}

/// Overwrites the first `old` in the file by `new`, of the same length.
pub(super) fn patch(path: &Path, old: &[u8], new: &[u8]) {
    assert_eq!(old.len(), new.len());
    let mut bytes = std::fs::read(path).unwrap();
    let at = bytes.windows(old.len()).position(|w| w == old).expect("bytes to patch");
    bytes[at..at + old.len()].copy_from_slice(new);
    std::fs::write(path, bytes).unwrap();
}
