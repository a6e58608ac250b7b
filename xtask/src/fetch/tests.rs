use std::io::{BufRead, BufReader, Cursor, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};

use super::*;

/// A ZIP of these entries, uncompressed.
fn zip_of(entries: &[(&str, &str)]) -> Vec<u8> {
    let mut zip = zip::ZipWriter::new(Cursor::new(Vec::new()));
    let options =
        zip::write::SimpleFileOptions::default().compression_method(zip::CompressionMethod::Stored);
    for (name, text) in entries {
        zip.start_file(*name, options).unwrap();
        zip.write_all(text.as_bytes()).unwrap();
    }
    zip.finish().unwrap().into_inner()
}

fn photos() -> Vec<u8> {
    zip_of(&[
        ("db/playroom/sparse/0/cameras.bin", "cameras"),
        ("db/playroom/sparse/0/points3D.bin", "points"),
        ("db/playroom/images/a.JPG", "a photo"),
        ("db/playroom/images/._a.JPG", "what macOS adds"),
        ("tandt/truck/images/b.jpg", "another scene"),
    ])
}

fn models() -> Vec<u8> {
    zip_of(&[
        ("playroom/point_cloud/iteration_7000/point_cloud.ply", "early"),
        ("playroom/point_cloud/iteration_30000/point_cloud.ply", "the model"),
        ("playroom/cameras.json", "[]"),
    ])
}

/// Serves both archives. The first `busy` requests are answered with status 503; without `ranges`, the rest with
/// whole files.
fn serve(busy: u32, ranges: bool) -> String {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = format!("http://{}", listener.local_addr().unwrap());
    let left = Arc::new(AtomicU32::new(busy));
    std::thread::spawn(move || {
        for stream in listener.incoming().map_while(io::Result::ok) {
            let left = left.clone();
            std::thread::spawn(move || while answer(&stream, &left, ranges).is_some() {});
        }
    });
    address
}

/// Answers one request; `None` when the connection ends.
fn answer(mut stream: &TcpStream, busy: &AtomicU32, ranges: bool) -> Option<()> {
    let mut lines = BufReader::new(stream).lines().map_while(io::Result::ok);
    let bytes = if lines.next()?.contains("models") { models() } else { photos() };
    let lines: Vec<String> = lines.take_while(|l| !l.is_empty()).collect();
    let range = lines
        .iter()
        .find_map(|l| l.to_lowercase().strip_prefix("range: bytes=").map(str::to_owned))?;
    let (from, to) = range.split_once('-')?;
    let (from, to): (usize, usize) = (from.parse().ok()?, to.parse().ok()?);
    let part = &bytes[from..=to];
    let is_busy =
        busy.fetch_update(Ordering::SeqCst, Ordering::SeqCst, |n| n.checked_sub(1)).is_ok();
    let (status, body) = match (is_busy, ranges) {
        (true, _) => ("503 Busy", &[][..]),
        (_, true) => ("206 Partial Content", part),
        (_, false) => ("200 OK", &bytes[..]),
    };
    let size = bytes.len();
    let length = body.len();
    write!(stream, "HTTP/1.1 {status}\r\nContent-Range: bytes {from}-{to}/{size}\r\nContent-Length: {length}\r\n\r\n").ok()?;
    stream.write_all(body).ok()
}

fn files(dir: &Path) -> Vec<String> {
    let mut found = Vec::new();
    for entry in fs::read_dir(dir).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(files(&path));
        } else {
            found.push(format!(
                "{}: {}",
                path.file_name().unwrap().display(),
                fs::read_to_string(&path).unwrap()
            ));
        }
    }
    found.sort();
    found
}

const WHOLE: [&str; 4] =
    ["a.JPG: a photo", "cameras.bin: cameras", "cameras.json: []", "point_cloud.ply: the model"];

#[test]
fn a_scene_comes_from_a_busy_server_and_goes_on_where_it_was_cut() {
    let dir = tempfile::tempdir().unwrap();
    let url = serve(2, true);
    fetch("playroom", &url, dir.path()).unwrap();
    assert_eq!(files(dir.path()), WHOLE);
    fs::remove_file(dir.path().join("cameras.json")).unwrap();
    fs::write(dir.path().join("images/a.JPG"), "kept").unwrap();
    fetch("playroom", &url, dir.path()).unwrap();
    assert_eq!(files(dir.path())[0], "a.JPG: kept");
    assert_eq!(files(dir.path())[1..], WHOLE[1..]);
}

#[test]
fn a_scene_comes_from_a_folder_and_damage_gets_no_name() {
    let (mirror, dir) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    for folder in ["input", "pretrained"] {
        fs::create_dir(mirror.path().join(folder)).unwrap();
    }
    let mut broken = photos();
    let at = broken.windows(7).position(|w| w == b"a photo").unwrap();
    broken[at] = b'A';
    fs::write(mirror.path().join("input/tandt_db.zip"), broken).unwrap();
    fs::write(mirror.path().join("pretrained/models.zip"), models()).unwrap();
    let from = mirror.path().display().to_string();
    let error = format!("{:#}", fetch("playroom", &from, dir.path()).unwrap_err());
    assert!(error.contains("images/a.JPG") && error.contains("checksum"), "{error}");
    assert!(!dir.path().join("images/a.JPG").exists());
    fs::write(mirror.path().join("input/tandt_db.zip"), photos()).unwrap();
    fetch("playroom", &from, dir.path()).unwrap();
    assert!(WHOLE.iter().all(|file| files(dir.path()).iter().any(|f| f == file)));
}

#[test]
fn a_server_without_ranges_and_one_that_is_not_there_are_named_with_a_remedy() {
    let dir = tempfile::tempdir().unwrap();
    for url in [serve(0, false), "folder/that/is/not/there".to_owned()] {
        let error = format!("{:#}", fetch("playroom", &url, dir.path()).unwrap_err());
        assert!(error.starts_with(&url) && error.contains("--mirror DIR"), "{error}");
        assert!(!error.contains('\n') && files(dir.path()).is_empty(), "{error}");
    }
}
