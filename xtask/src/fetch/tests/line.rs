//! Servers, good and bad.

use std::fs;
use std::io::Read;
use std::time::{Duration, Instant};

use super::*;
use crate::fetch::error::Error;
use crate::fetch::http::Http;
use crate::fetch::ranged::Ranged;
use crate::fetch::source::Source;

#[test]
fn a_scene_comes_out_of_zip64_archives_of_5_gib_with_few_requests() {
    let (models, photos) = (archive::models(), archive::photos());
    let bench = Bench::with(&models, &photos, 5 << 30);
    assert!(fs::metadata(bench.models()).unwrap().len() > 5 << 30);
    let server = bench.serve(Manners::default());
    let done = bench.fetch(&from(&server)).unwrap();
    assert_eq!(done, Summary { fetched: 10, kept: 0 });
    bench.assert_complete();
    let (requests, bytes) = server.take_counts();
    // For each archive: the flat name that is not there, the size, the tail. Then one request
    // for all photos with their COLMAP files, and two for model and cameras, which are apart.
    assert_eq!(requests, 9);
    let wanted: usize = bench.expected.iter().map(|(_, bytes)| bytes.len()).sum();
    assert!(bytes < wanted as u64 + 100_000, "{bytes} bytes for {wanted}");

    // Again, and without a network: everything is checked, nothing fetched.
    drop(server);
    let done = bench.fetch(&options(&[])).unwrap();
    assert_eq!(done, Summary { fetched: 0, kept: 10 });
}

#[test]
fn a_fetch_goes_on_where_the_last_one_was_cut() {
    let bench = Bench::new();
    let server = bench.serve(Manners { cut_all: Some(450_000), ..Manners::default() });
    let line = bench.fails(&from(&server));
    assert!(line.contains("broke at byte") && line.contains("run this again to go on"), "{line}");
    assert!(!bench.dir().join("point_cloud.ply").exists());
    let pieces = bench.pieces();
    assert!(pieces > 150_000, "{pieces} bytes kept");
    let (_, first) = server.take_counts();

    server.behave(Manners::default());
    let done = bench.fetch(&from(&server)).unwrap();
    bench.assert_complete();
    assert!(done.kept >= 8 && done.fetched + done.kept == 10, "{done:?}");
    let (_, second) = server.take_counts();
    let wanted: usize = bench.expected.iter().map(|(_, bytes)| bytes.len()).sum();
    // The tails are read again, and what was on the way; not the pieces.
    let overhead = 80_000;
    assert!(first + second < wanted as u64 + overhead, "{first} and {second} bytes for {wanted}");
    assert!(second < wanted as u64 - pieces, "{second} bytes, {pieces} were kept");
}

#[test]
fn an_outage_under_way_is_not_taken_for_no_network() {
    let bench = Bench::new();
    let server = bench.serve(Manners::default());
    let url = server.url("/d/input/tandt_db.zip");
    let source = Box::new(Http::connect(&url, Duration::from_secs(20)).unwrap());
    let patience = Patience { tries: 2, pause: Duration::from_millis(1) };
    let mut reader = Ranged::new(source, patience, 64).unwrap();
    server.behave(Manners { cut_all: Some(0), ..Manners::default() });
    drop(server);
    assert!(reader.read(&mut [0; 10]).is_err());
    assert!(matches!(reader.failure(), Some(Error::Broken { at: 0, .. })));
}

#[test]
fn a_line_that_keeps_breaking_costs_nothing_but_requests() {
    let bench = Bench::new();
    let server = bench.serve(Manners { cut_each: Some(30_000), ..Manners::default() });
    // The directory begins before the tail, and is cut as well.
    bench.fetch(&Options { tail: 64, ..from(&server) }).unwrap();
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
    assert!(line.contains("status 503") && line.contains("check --mirror"), "{line}");
}

#[test]
fn without_ranges_nothing_is_downloaded_and_the_way_by_hand_is_told() {
    let bench = Bench::new();
    let server = bench.serve(Manners { no_ranges: true, ..Manners::default() });
    let public = Options { public: server.url("/d"), ..options(&[]) };
    let line = bench.fails(&public);
    assert!(line.contains("does not serve byte ranges"), "{line}");
    assert!(line.contains("/d/input/tandt_db.zip (650 MB) by hand into"), "{line}");
    assert!(line.contains("/scenes and run this again"), "{line}");
    let (requests, _) = server.take_counts();
    assert_eq!(requests, 1);
}

#[test]
fn nothing_at_the_address() {
    let bench = Bench::new();
    let server = bench.serve(Manners::default());
    let line = bench.fails(&options(&[server.url("/elsewhere")]));
    assert!(line.contains("/elsewhere/tandt_db.zip") && line.contains("status 404"), "{line}");
    assert!(line.contains("check --mirror"), "{line}");
    let public = Options { public: server.url("/elsewhere"), ..options(&[]) };
    let line = bench.fails(&public);
    assert!(line.contains("status 404") && line.contains("by hand into"), "{line}");
}

#[test]
fn without_a_network_one_line_says_what_to_do() {
    let bench = Bench::new();
    let line = bench.fails(&options(&[]));
    assert!(line.contains("cannot reach the server"), "{line}");
    let public = "http://127.0.0.1:1/d";
    let scenes = bench.temp.path().join("scenes");
    let by_hand = format!(
        "download {public}/input/tandt_db.zip (650 MB) and {public}/pretrained/models.zip (14 GB) \
         by hand into {} and run this again",
        scenes.display()
    );
    assert!(line.contains(&by_hand), "{line}");
    // Doing that helps, up to the other archive.
    fs::copy(bench.photos(), scenes.join("tandt_db.zip")).unwrap();
    let line = bench.fails(&options(&[]));
    assert!(
        line.contains("download http://127.0.0.1:1/d/pretrained/models.zip (14 GB) by hand into"),
        "{line}"
    );
    fs::copy(bench.models(), scenes.join("models.zip")).unwrap();
    bench.fetch(&options(&[])).unwrap();
    bench.assert_complete();
}

#[test]
fn redirects_are_followed_but_not_for_ever() {
    let bench = Bench::new();
    let server = bench.serve(Manners { redirect: true, ..Manners::default() });
    bench.fetch(&from(&server)).unwrap();
    bench.assert_complete();
    fs::remove_dir_all(bench.dir()).unwrap();
    server.behave(Manners { redirect_loop: true, ..Manners::default() });
    let line = bench.fails(&from(&server));
    assert!(line.contains("redirects"), "{line}");
}

#[test]
fn a_slow_server_is_waited_for_but_not_a_silent_one() {
    let bench = Bench::new();
    let dribble = Some((60_000, Duration::from_millis(100)));
    let server = bench.serve(Manners { dribble, ..Manners::default() });
    // The whole takes longer than the longest silence allowed; each piece does not.
    let allowed = Duration::from_millis(700);
    let slow = Options { timeout: allowed, ..from(&server) };
    let start = Instant::now();
    bench.fetch(&slow).unwrap();
    bench.assert_complete();
    assert!(start.elapsed() > allowed);

    fs::remove_dir_all(bench.dir()).unwrap();
    server.behave(Manners { silent: true, ..Manners::default() });
    let silent = Options { timeout: Duration::from_millis(100), ..from(&server) };
    let start = Instant::now();
    let line = bench.fails(&silent);
    assert!(line.contains("sent nothing for 0.1 s") && line.contains("run this again"), "{line}");
    assert!(start.elapsed() < Duration::from_secs(3));
}

#[test]
fn an_archive_that_changes_under_way_is_noticed() {
    let bench = Bench::new();
    let server = bench.serve(Manners { etag: Some("\"one\""), ..Manners::default() });
    let url = server.url("/d/input/tandt_db.zip");
    let mut http = Http::connect(&url, Duration::from_secs(20)).unwrap();
    assert!(http.open(0, 10).is_ok());
    server.behave(Manners { etag: Some("\"two\""), ..Manners::default() });
    let line = http.open(0, 10).err().unwrap().to_string();
    assert!(line.contains("changed while it was read") && line.contains("\"two\""), "{line}");
    server.behave(Manners { etag: Some("\"one\""), ..Manners::default() });
    archive::write_zip(&bench.photos(), &archive::photos()[..9], 0);
    let line = http.open(0, 10).err().unwrap().to_string();
    assert!(line.contains("changed while it was read") && line.contains("bytes were"), "{line}");
}
