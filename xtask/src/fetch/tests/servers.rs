//! Servers, good and bad.

use std::time::Instant;

use super::*;

#[test]
fn a_scene_comes_out_of_zip64_archives_of_5_gib_with_few_requests() {
    let bench = Bench::with(&archive::models(), &archive::photos(), 5 << 30);
    assert!(fs::metadata(bench.models()).unwrap().len() > 5 << 30);
    let server = bench.serve(Manners::default());
    assert_eq!(bench.fetch(&from(&server)).unwrap(), Summary { fetched: 10, kept: 0 });
    bench.assert_complete();
    let (requests, bytes) = server.take_counts();
    // For each archive: its size, and its end with the directory. Then one request for all photos
    // with their COLMAP files, and two for model and cameras, which are apart.
    assert_eq!(requests, 7);
    let wanted: usize = bench.expected.iter().map(|(_, bytes)| bytes.len()).sum();
    assert!(bytes < wanted as u64 + (2 << 20) + 10_000, "{bytes} bytes for {wanted}");
    // Again, and without a network: everything is checked, nothing fetched.
    drop(server);
    assert_eq!(bench.fetch(&options(&[])).unwrap(), Summary { fetched: 0, kept: 10 });
}

#[test]
fn a_fetch_goes_on_where_the_last_one_was_cut() {
    for spoil in [false, true] {
        let bench = Bench::new();
        let server = bench.serve(Manners::default());
        bench.fetch(&from(&server)).unwrap();
        let (_, whole) = server.take_counts();
        fs::remove_dir_all(bench.dir()).unwrap();

        server.behave(Manners { cut_all: Some(whole - 100_000), ..Manners::default() });
        let line = bench.fails(&from(&server));
        assert!(line.contains("broke at byte") && line.contains("run this again"), "{line}");
        let held: u64 = bench.pieces().iter().map(|p| fs::metadata(p).unwrap().len()).sum();
        assert!(held > 200_000 && !bench.dir().join("point_cloud.ply").exists());
        if spoil {
            // As a power cut can: then the piece is fetched anew.
            bench.pieces().iter().for_each(|p| fs::write(p, vec![0; held as usize]).unwrap());
        }
        server.take_counts();
        server.behave(Manners::default());
        bench.fetch(&from(&server)).unwrap();
        bench.assert_complete();
        let (_, second) = server.take_counts();
        assert_eq!(second < whole - held, !spoil, "{second} of {whole} bytes, {held} were kept");
    }
}

#[test]
fn a_connection_that_keeps_breaking_costs_nothing_but_requests() {
    let bench = Bench::new();
    let server = bench.serve(Manners { cut_each: Some(30_000), ..Manners::default() });
    bench.fetch(&from(&server)).unwrap();
    bench.assert_complete();
}

#[test]
fn a_server_that_is_busy_is_asked_again() {
    let bench = Bench::new();
    let server = bench.serve(Manners { unavailable: 2, ..Manners::default() });
    bench.fetch(&from(&server)).unwrap();
    bench.assert_complete();
    server.behave(Manners { status: Some(503), ..Manners::default() });
    fs::remove_file(bench.dir().join("cameras.json")).unwrap();
    let line = bench.fails(&from(&server));
    assert!(line.contains("status 503") && line.contains("run this again"), "{line}");
}

#[test]
fn what_cannot_be_read_in_ranges_is_to_be_downloaded_by_hand() {
    let bench = Bench::new();
    let server = bench.serve(Manners { no_ranges: true, ..Manners::default() });
    let line = bench.fails(&from(&server));
    assert!(line.contains("does not serve byte ranges") && line.contains("--mirror"), "{line}");
    assert_eq!(server.take_counts().0, 1);
    let line = bench.fails(&options(&[server.url("/elsewhere")]));
    assert!(line.contains("/elsewhere/tandt_db.zip") && line.contains("status 404"), "{line}");
    let line = bench.fails(&options(&[]));
    assert!(line.contains("cannot reach the server"), "{line}");
    let scenes = bench.temp.path().join("scenes");
    let by_hand = format!(
        "download http://127.0.0.1:1/d/input/tandt_db.zip (650 MB) by hand into {}",
        scenes.display()
    );
    assert!(line.contains(&by_hand), "{line}");
}

#[test]
fn a_silent_server_is_not_waited_for() {
    let bench = Bench::new();
    let server = bench.serve(Manners { silent: true, ..Manners::default() });
    let silent = Options { timeout: Duration::from_millis(100), ..from(&server) };
    let start = Instant::now();
    let line = bench.fails(&silent);
    assert!(line.contains("broke at byte 0") && line.contains("timeout"), "{line}");
    assert!(start.elapsed() < Duration::from_secs(3));
}
