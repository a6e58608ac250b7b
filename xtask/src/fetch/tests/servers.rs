//! Servers, good and bad.

use std::time::Instant;

use super::*;

#[test]
fn a_scene_comes_out_of_zip64_archives_of_5_gib_with_few_requests() {
    let setup = Setup::with(&archive::models(), &archive::photos(), 5 << 30);
    assert!(fs::metadata(setup.models()).unwrap().len() > 5 << 30);
    let server = setup.serve(Behaviour::default());
    assert_eq!(setup.fetch(&from(&server)).unwrap(), Summary { fetched: 10, kept: 0 });
    setup.assert_complete();
    let (requests, bytes) = server.take_counts();
    // For each archive: its size, and its end with the directory. Then one request for all photos
    // with their COLMAP files, and two for model and cameras, which are apart.
    assert_eq!(requests, 7);
    let wanted: usize = setup.expected.iter().map(|(_, bytes)| bytes.len()).sum();
    assert!(bytes < wanted as u64 + (2 << 20) + 10_000, "{bytes} bytes for {wanted}");
    // Again, and without a network: everything is checked, nothing fetched.
    drop(server);
    assert_eq!(setup.fetch(&options(&[])).unwrap(), Summary { fetched: 0, kept: 10 });
}

#[test]
fn a_fetch_goes_on_where_the_last_one_was_cut() {
    for spoil in [false, true] {
        let setup = Setup::new();
        let server = setup.serve(Behaviour::default());
        setup.fetch(&from(&server)).unwrap();
        let (_, whole) = server.take_counts();
        fs::remove_dir_all(setup.dir()).unwrap();

        server.behave(Behaviour { cut_all: Some(whole - 100_000), ..Behaviour::default() });
        let line = setup.fails(&from(&server));
        assert!(line.contains("broke at byte") && line.contains("run this again"), "{line}");
        let held: u64 = setup.pieces().iter().map(|p| fs::metadata(p).unwrap().len()).sum();
        assert!(held > 200_000 && !setup.dir().join("point_cloud.ply").exists());
        if spoil {
            // As a power cut can: then the piece is fetched anew.
            setup.pieces().iter().for_each(|p| fs::write(p, vec![0; held as usize]).unwrap());
        }
        server.take_counts();
        server.behave(Behaviour::default());
        setup.fetch(&from(&server)).unwrap();
        setup.assert_complete();
        let (_, second) = server.take_counts();
        assert_eq!(second < whole - held, !spoil, "{second} of {whole} bytes, {held} were kept");
    }
}

#[test]
fn a_connection_that_keeps_breaking_costs_nothing_but_requests() {
    let setup = Setup::new();
    let server = setup.serve(Behaviour { cut_each: Some(30_000), ..Behaviour::default() });
    setup.fetch(&from(&server)).unwrap();
    setup.assert_complete();
}

#[test]
fn a_server_that_is_busy_is_asked_again() {
    let setup = Setup::new();
    let server = setup.serve(Behaviour { unavailable: 2, ..Behaviour::default() });
    setup.fetch(&from(&server)).unwrap();
    setup.assert_complete();
    server.behave(Behaviour { status: Some(503), ..Behaviour::default() });
    fs::remove_file(setup.dir().join("cameras.json")).unwrap();
    let line = setup.fails(&from(&server));
    assert!(line.contains("status 503") && line.contains("run this again"), "{line}");
}

#[test]
fn what_cannot_be_read_in_ranges_is_to_be_downloaded_by_hand() {
    let setup = Setup::new();
    let server = setup.serve(Behaviour { no_ranges: true, ..Behaviour::default() });
    let line = setup.fails(&from(&server));
    assert!(line.contains("does not serve byte ranges") && line.contains("--mirror"), "{line}");
    assert_eq!(server.take_counts().0, 1);
    let line = setup.fails(&options(&[server.url("/elsewhere")]));
    assert!(line.contains("/elsewhere/tandt_db.zip") && line.contains("status 404"), "{line}");
    let line = setup.fails(&options(&[]));
    assert!(line.contains("cannot reach the server"), "{line}");
    let scenes = setup.temp.path().join("scenes");
    let by_hand = format!(
        "download http://127.0.0.1:1/d/input/tandt_db.zip (650 MB) by hand into {}",
        scenes.display()
    );
    assert!(line.contains(&by_hand), "{line}");
}

#[test]
fn a_silent_server_is_not_waited_for() {
    let setup = Setup::new();
    let server = setup.serve(Behaviour { silent: true, ..Behaviour::default() });
    let silent = Options { timeout: Duration::from_millis(100), ..from(&server) };
    let start = Instant::now();
    let line = setup.fails(&silent);
    assert!(line.contains("broke at byte 0") && line.contains("timeout"), "{line}");
    assert!(start.elapsed() < Duration::from_secs(3));
}
