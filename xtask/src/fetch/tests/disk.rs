//! The scene's folder: what is there already, and what must not change.

use std::fs;

use super::*;
use crate::fetch::record::Record;

fn local(bench: &Bench) -> Options {
    options(&[bench.archives().display().to_string()])
}

#[test]
fn a_file_that_changed_is_an_error_until_it_is_deleted() {
    let bench = Bench::new();
    bench.fetch(&local(&bench)).unwrap();
    let file = bench.dir().join("images/DSC003.jpg");
    let mut bytes = fs::read(&file).unwrap();
    bytes[77] ^= 1;
    fs::write(&file, &bytes).unwrap();
    let line = bench.fails(&local(&bench));
    assert!(line.contains("DSC003.jpg: changed since it was fetched: SHA-256 was"), "{line}");
    assert!(line.ends_with("delete it and run this again"), "{line}");
    fs::remove_file(&file).unwrap();
    assert_eq!(bench.fetch(&local(&bench)).unwrap(), Summary { fetched: 1, kept: 9 });
    bench.assert_complete();
}

#[test]
fn an_archive_with_other_bytes_than_at_first_is_an_error() {
    let bench = Bench::new();
    bench.fetch(&local(&bench)).unwrap();
    let file = bench.dir().join("point_cloud.ply");
    fs::remove_file(&file).unwrap();
    let mut models = archive::models();
    models[4].1 = archive::noise(99, 400_000);
    archive::write_zip(&bench.models(), &models, 0);
    let line = bench.fails(&local(&bench));
    assert!(line.contains("is not what was fetched first: SHA-256 was"), "{line}");
    assert!(line.contains("delete the scene's folder"), "{line}");
    models[4].1.push(0);
    archive::write_zip(&bench.models(), &models, 0);
    let line = bench.fails(&local(&bench));
    assert!(line.contains("size was 400000, is 400001"), "{line}");
    assert!(!file.exists());
}

#[test]
fn files_put_there_by_hand_are_taken_if_they_are_the_archives() {
    let bench = Bench::new();
    let ply = archive::noise(4, 400_000);
    fs::create_dir_all(bench.dir()).unwrap();
    let file = bench.dir().join("point_cloud.ply");
    fs::write(&file, &ply).unwrap();
    assert_eq!(bench.fetch(&local(&bench)).unwrap(), Summary { fetched: 9, kept: 1 });
    bench.assert_complete();

    for (bytes, why) in [(&ply[1..], "399999 bytes"), (&archive::noise(5, 400_000), "CRC-32")] {
        fs::remove_dir_all(bench.dir()).unwrap();
        fs::create_dir_all(bench.dir()).unwrap();
        fs::write(&file, bytes).unwrap();
        let line = bench.fails(&local(&bench));
        assert!(line.contains("is not the file in") && line.contains(why), "{line}");
        assert!(line.contains("move it away"), "{line}");
        assert_eq!(fs::read(&file).unwrap(), bytes, "it is not touched");
    }
}

#[test]
fn a_lost_record_is_made_again_without_fetching() {
    let bench = Bench::new();
    bench.fetch(&local(&bench)).unwrap();
    let record = Record::load(&bench.dir()).unwrap();
    assert!(record.complete && record.files.len() == 10);
    fs::remove_file(bench.dir().join("fetch.toml")).unwrap();
    assert_eq!(bench.fetch(&local(&bench)).unwrap(), Summary { fetched: 0, kept: 10 });
    assert_eq!(Record::load(&bench.dir()).unwrap(), record);
    fs::write(bench.dir().join("fetch.toml"), "complete = maybe").unwrap();
    let line = bench.fails(&local(&bench));
    assert!(line.contains("not a record of fetched files"), "{line}");
}

#[test]
fn a_piece_damaged_by_a_power_cut_is_fetched_again() {
    let bench = Bench::new();
    let server = bench.serve(Manners { cut_all: Some(450_000), ..Manners::default() });
    bench.fails(&from(&server));
    for entry in fs::read_dir(bench.dir().join(".fetch")).unwrap() {
        let path = entry.unwrap().path();
        let size = fs::metadata(&path).unwrap().len();
        fs::write(&path, vec![0; usize::try_from(size).unwrap()]).unwrap();
    }
    server.behave(Manners::default());
    bench.fetch(&from(&server)).unwrap();
    bench.assert_complete();
}

#[test]
fn a_full_disk_is_noticed_before_anything_is_fetched() {
    let bench = Bench::new();
    let full = Options { free: |_| Ok(600_000), ..local(&bench) };
    let line = bench.fails(&full);
    assert!(line.contains("needed, 600.00 kB free"), "{line}");
    assert!(line.contains("--cache"), "{line}");
    assert!(!bench.dir().join("images").exists() && !bench.dir().join("point_cloud.ply").exists());
}

#[test]
fn the_disk_is_measured() {
    let real = Options::new(&[], Duration::from_secs(1));
    let temp = tempfile::tempdir().unwrap();
    assert!((real.free)(temp.path()).unwrap() > 0);
}

#[test]
fn two_fetches_into_one_folder_do_not_meet() {
    let bench = Bench::new();
    fs::create_dir_all(bench.dir().join(".fetch")).unwrap();
    let lock = fs::File::create(bench.dir().join(".fetch/lock")).unwrap();
    lock.lock().unwrap();
    let line = bench.fails(&local(&bench));
    assert!(line.contains("another fetch is at work there"), "{line}");
    drop(lock);
    bench.fetch(&local(&bench)).unwrap();
    bench.assert_complete();
}

#[test]
fn what_was_fetched_is_a_scene_that_rd_curve_finds() {
    let room = crate::scenes::root().join("fixtures/room");
    let mut room_files = Vec::new();
    walk(&room, &room, &mut room_files);
    let (mut models, mut photos) = (Vec::new(), Vec::new());
    for (name, bytes) in room_files {
        match name.as_str() {
            "point_cloud.ply" => {
                let name = "playroom/point_cloud/iteration_30000/point_cloud.ply".to_owned();
                models.push((name, bytes));
            }
            _ => photos.push((format!("db/playroom/{name}"), bytes)),
        }
    }
    models.push(("playroom/cameras.json".to_owned(), b"[]".to_vec()));
    let bench = Bench::with(&models, &photos, 0);
    let cache = bench.temp.path().join("cache");
    crate::fetch::fetch("playroom", Some(&cache), &local(&bench)).unwrap();
    let found = crate::scenes::find(cache.join("playroom").to_str().unwrap()).unwrap();
    assert_eq!(found.name, "playroom");
    let model = gs_model::ply::read(&found.dataset.model_path).unwrap().0;
    assert!(!model.means.is_empty());
    // And without --cache it goes where the registry has it.
    assert!(crate::scenes::dir_of("playroom").unwrap().ends_with("scenes/playroom"));
}
