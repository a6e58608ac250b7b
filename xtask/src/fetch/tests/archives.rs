//! Archives, good and bad; from disk, where the line plays no part.

use std::fs;

use zip::ZipWriter;
use zip::write::SimpleFileOptions;

use super::*;

/// The archives' folder as a mirror.
fn local(bench: &Bench) -> Options {
    options(&[format!("file://{}", bench.archives().display())])
}

#[test]
fn a_scene_comes_from_a_file_url_a_path_or_single_archives() {
    let (models, photos) = (archive::models(), archive::photos());
    let bench = Bench::with(&models, &photos, 5 << 30);
    let path = |p: PathBuf| p.display().to_string();
    for mirrors in [
        vec![format!("file://{}", path(bench.archives()))],
        vec![path(bench.archives())],
        vec![path(bench.photos()), format!("file://{}", path(bench.models()))],
    ] {
        assert_eq!(bench.fetch(&options(&mirrors)).unwrap().fetched, 10);
        bench.assert_complete();
        fs::remove_dir_all(bench.dir()).unwrap();
    }
    let line = bench.fails(&options(&["/no/such/folder".to_owned()]));
    assert!(
        line.contains("/no/such/folder/tandt_db.zip") && line.contains("check --mirror"),
        "{line}"
    );
}

#[test]
fn one_archive_of_another_name_may_hold_everything() {
    let bench = Bench::new();
    let mut both = archive::models();
    both.extend(archive::photos());
    for (name, _) in &mut both {
        name.insert_str(0, "backup/");
    }
    let path = bench.archives().join("both.zip");
    archive::write_zip(&path, &both, 0);
    bench.fetch(&options(&[path.display().to_string()])).unwrap();
    bench.assert_complete();
}

#[test]
fn damaged_bytes_never_get_a_name() {
    let bench = Bench::new();
    // The fifth model entry is deflated, of noise: stored blocks, so its bytes can be found.
    let ply = archive::noise(4, 400_000);
    let mut broken = ply[1000..1100].to_vec();
    broken[50] ^= 1;
    archive::patch(&bench.models(), &ply[1000..1100], &broken);
    let line = bench.fails(&local(&bench));
    assert!(line.contains("point_cloud.ply is damaged: Invalid checksum"), "{line}");
    assert!(line.contains("run this again"), "{line}");
    assert!(!bench.dir().join("point_cloud.ply").exists());
    assert_eq!(bench.pieces(), 0, "a damaged piece is not gone on from");
    // The rest is kept, and a good archive completes it.
    archive::patch(&bench.models(), &broken, &ply[1000..1100]);
    assert_eq!(bench.fetch(&local(&bench)).unwrap().fetched, 1);
    bench.assert_complete();
}

#[test]
fn a_wrong_size_in_the_directory_is_noticed() {
    for (grow, want) in [(1_i64, "bytes, not"), (-1, "larger than its declared")] {
        let bench = Bench::new();
        // ZIP64: sizes are 64 bits, in the local header first and then in the directory.
        let size = |n: i64| u64::try_from(n).unwrap().to_le_bytes();
        let packed = fs::read(bench.models()).unwrap();
        let old = size(400_000);
        let places: Vec<usize> =
            (0..packed.len() - 8).filter(|&i| packed[i..i + 8] == old).collect();
        let mut changed = packed;
        for place in places {
            changed[place..place + 8].copy_from_slice(&size(400_000 + grow));
        }
        fs::write(bench.models(), changed).unwrap();
        let line = bench.fails(&local(&bench));
        assert!(line.contains("point_cloud.ply is damaged") && line.contains(want), "{line}");
        assert!(!bench.dir().join("point_cloud.ply").exists());
    }
}

#[test]
fn half_an_archive_and_no_archive_are_refused() {
    let bench = Bench::new();
    let whole = fs::read(bench.photos()).unwrap();
    for bytes in [&whole[..whole.len() / 2], b"<html>not here</html>".repeat(500).as_slice(), b"x"]
    {
        fs::write(bench.photos(), bytes).unwrap();
        let line = bench.fails(&local(&bench));
        assert!(line.contains("not a usable ZIP archive"), "{line}");
        assert!(line.contains("use the original, http://"), "{line}");
    }
}

#[test]
fn an_archive_without_the_scene_is_named() {
    let models: Vec<Entry> = archive::models().into_iter().take(1).collect();
    let bench = Bench::with(&models, &archive::photos(), 0);
    let line = bench.fails(&local(&bench));
    assert!(line.contains("there is no entry playroom/point_cloud/iteration_30000/"), "{line}");
    let photos: Vec<Entry> =
        archive::photos().into_iter().filter(|(n, _)| !n.contains("playroom/images/")).collect();
    let bench = Bench::with(&archive::models(), &photos, 0);
    let line = bench.fails(&local(&bench));
    assert!(line.contains("there is no entry db/playroom/images/*.jpg"), "{line}");
}

#[test]
fn names_that_lead_elsewhere_are_refused() {
    for evil in ["../../../evil.jpg", "/evil.jpg", "a\\..\\..\\evil.jpg", "c:evil.jpg"] {
        let mut photos = archive::photos();
        photos.push((format!("db/playroom/images/{evil}"), b"evil".to_vec()));
        let bench = Bench::with(&archive::models(), &photos, 0);
        let line = bench.fails(&local(&bench));
        assert!(line.contains("leads out of the scene's folder"), "{line}");
        let mut found = Vec::new();
        walk(bench.temp.path(), bench.temp.path(), &mut found);
        assert!(found.iter().all(|(name, _)| !name.contains("evil")), "{evil}");
    }
}

#[test]
fn links_are_refused() {
    let bench = Bench::new();
    let file = fs::File::options().read(true).write(true).open(bench.photos()).unwrap();
    let mut zip = ZipWriter::new_append(file).unwrap();
    let options = SimpleFileOptions::default();
    zip.add_symlink("db/playroom/images/x.jpg", "/etc/passwd", options).unwrap();
    zip.finish().unwrap();
    let line = bench.fails(&local(&bench));
    assert!(line.contains("x.jpg\" is refused: it is not a plain file"), "{line}");
}
