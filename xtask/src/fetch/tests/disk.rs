//! Archives from disk, good and bad, and what is in the scene's folder already.

use super::*;
use crate::fetch::record::Record;

#[test]
fn a_scene_comes_from_a_file_url_a_path_single_archives_or_beside_the_scenes() {
    let setup = Setup::new();
    let path = |p: PathBuf| p.display().to_string();
    for mirrors in [
        vec![format!("file://{}", path(setup.archives()))],
        vec![path(setup.archives())],
        vec![path(setup.photos()), format!("file://{}", path(setup.models()))],
    ] {
        assert_eq!(setup.fetch(&options(&mirrors)).unwrap().fetched, 10);
        setup.assert_complete();
        fs::remove_dir_all(setup.dir()).unwrap();
    }
    let line = setup.fails(&options(&["/no/such/folder".to_owned()]));
    assert!(line.contains("/no/such/folder/tandt_db.zip") && line.contains("--mirror"), "{line}");
    fs::copy(setup.photos(), setup.temp.path().join("scenes/tandt_db.zip")).unwrap();
    fs::copy(setup.models(), setup.temp.path().join("scenes/models.zip")).unwrap();
    setup.fetch(&options(&[])).unwrap();
    setup.assert_complete();
}

#[test]
fn damaged_bytes_never_get_a_name() {
    let setup = Setup::new();
    // The fifth model entry is deflated, of noise: stored blocks, so its bytes can be found.
    let ply = archive::noise(4, 400_000);
    let mut broken = ply[1000..1100].to_vec();
    broken[50] ^= 1;
    archive::patch(&setup.models(), &ply[1000..1100], &broken);
    let line = setup.fails(&local(&setup));
    assert!(
        line.contains("point_cloud.ply is damaged") && line.contains("run this again"),
        "{line}"
    );
    assert!(!setup.dir().join("point_cloud.ply").exists());
    assert!(setup.pieces().is_empty(), "a damaged piece is not gone on from");
    // The rest is kept, and a good archive completes it.
    archive::patch(&setup.models(), &broken, &ply[1000..1100]);
    assert_eq!(setup.fetch(&local(&setup)).unwrap(), Summary { fetched: 1, kept: 9 });
    setup.assert_complete();
}

#[test]
fn a_wrong_size_in_the_directory_is_noticed() {
    for grow in [1, -1] {
        let setup = Setup::new();
        // ZIP64: sizes are 64 bits, in the local header first and then in the directory.
        let size = |n: i64| u64::try_from(n).unwrap().to_le_bytes();
        let mut bytes = fs::read(setup.models()).unwrap();
        let old = size(400_000);
        for place in 0..bytes.len() - 8 {
            if bytes[place..place + 8] == old {
                bytes[place..place + 8].copy_from_slice(&size(400_000 + grow));
            }
        }
        fs::write(setup.models(), bytes).unwrap();
        let line = setup.fails(&local(&setup));
        assert!(line.contains("point_cloud.ply is damaged"), "{line}");
        assert!(!setup.dir().join("point_cloud.ply").exists());
    }
}

#[test]
fn half_an_archive_and_no_archive_are_refused() {
    let setup = Setup::new();
    let whole = fs::read(setup.photos()).unwrap();
    for bytes in [&whole[..whole.len() / 2], b"<html>not here</html>".repeat(500).as_slice(), b"x"]
    {
        fs::write(setup.photos(), bytes).unwrap();
        let line = setup.fails(&local(&setup));
        assert!(line.contains("not a usable ZIP archive"), "{line}");
        assert!(line.contains("another copy of http://"), "{line}");
    }
    let models: Vec<Entry> = archive::models().into_iter().take(1).collect();
    let line = Setup::with(&models, &archive::photos(), 0);
    let line = line.fails(&local(&line));
    assert!(line.contains("there is no entry playroom/point_cloud/iteration_30000/"), "{line}");
}

#[test]
fn names_that_lead_elsewhere_are_refused() {
    for evil in ["../../../evil.jpg", "/evil.jpg", "a\\..\\..\\evil.jpg", "c:evil.jpg"] {
        let mut photos = archive::photos();
        photos.push((format!("db/playroom/images/{evil}"), b"evil".to_vec()));
        let setup = Setup::with(&archive::models(), &photos, 0);
        let line = setup.fails(&local(&setup));
        assert!(line.contains("leads out of the scene's folder"), "{line}");
        let mut found = Vec::new();
        walk(setup.temp.path(), setup.temp.path(), &mut found);
        assert!(found.iter().all(|(name, _)| !name.contains("evil")), "{evil}");
    }
}

#[test]
fn a_file_that_changed_is_an_error_until_it_is_deleted() {
    let setup = Setup::new();
    setup.fetch(&local(&setup)).unwrap();
    let file = setup.dir().join("images/DSC003.jpg");
    let mut bytes = fs::read(&file).unwrap();
    bytes[77] ^= 1;
    fs::write(&file, &bytes).unwrap();
    let line = setup.fails(&local(&setup));
    assert!(line.contains("DSC003.jpg: changed since it was fetched"), "{line}");
    fs::remove_file(&file).unwrap();
    assert_eq!(setup.fetch(&local(&setup)).unwrap(), Summary { fetched: 1, kept: 9 });
    setup.assert_complete();
}

#[test]
fn files_put_there_by_hand_are_taken_if_they_are_the_archives() {
    let setup = Setup::new();
    let ply = archive::noise(4, 400_000);
    let file = setup.dir().join("point_cloud.ply");
    for bytes in [&ply[1..], &archive::noise(5, 400_000)] {
        fs::create_dir_all(setup.dir()).unwrap();
        fs::write(&file, bytes).unwrap();
        let line = setup.fails(&local(&setup));
        assert!(line.contains("is not the file in") && line.contains("move it away"), "{line}");
        assert_eq!(fs::read(&file).unwrap(), bytes, "it is not touched");
    }
    fs::write(&file, &ply).unwrap();
    setup.fetch(&local(&setup)).unwrap();
    setup.assert_complete();
    // A lost record is made again without fetching.
    let record = Record::load(&setup.dir()).unwrap();
    fs::remove_file(setup.dir().join("fetch.toml")).unwrap();
    assert_eq!(setup.fetch(&local(&setup)).unwrap(), Summary { fetched: 0, kept: 10 });
    assert_eq!(Record::load(&setup.dir()).unwrap(), record);
    for bad in [
        "complete = maybe",
        "complete = true\n[files.\"../x\"]\narchive='a'\nentry='b'\nbytes=1\nsha256='c'\n",
    ] {
        fs::write(setup.dir().join("fetch.toml"), bad).unwrap();
        assert!(setup.fails(&local(&setup)).contains("not a record of fetched files"));
    }
}

#[test]
fn what_was_fetched_is_a_scene_that_rd_curve_finds() {
    let room = eval::scenes::root().join("fixtures/room");
    let mut files = Vec::new();
    walk(&room, &room, &mut files);
    let (model, photos): (Vec<Entry>, Vec<Entry>) =
        files.into_iter().partition(|(name, _)| name == "point_cloud.ply");
    let ply = "playroom/point_cloud/iteration_30000/point_cloud.ply".to_owned();
    let models = [(ply, model[0].1.clone()), ("playroom/cameras.json".to_owned(), b"[]".to_vec())];
    let photos: Vec<Entry> =
        photos.into_iter().map(|(name, bytes)| (format!("db/playroom/{name}"), bytes)).collect();
    let setup = Setup::with(&models, &photos, 0);
    let cache = setup.temp.path().join("cache");
    crate::fetch::fetch("playroom", Some(&cache), &local(&setup)).unwrap();
    let found = eval::scenes::find(cache.join("playroom").to_str().unwrap()).unwrap();
    assert_eq!((found.name.as_str(), found.dataset.views.len()), ("playroom", 32));
}
