//! The whole chain on the embedded scene, as a user runs it.
#![allow(unused_crate_dependencies, reason = "an integration test of the binary")]

use std::collections::BTreeSet;
use std::fs;
use std::process::{Command, Output};

fn xtask(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_xtask")).args(args).output().unwrap()
}

fn stdout(output: &Output) -> String {
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout.clone()).unwrap()
}

#[test]
fn the_room_gives_a_report_and_a_second_run_skips_it() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().to_str().unwrap();
    let args = ["rd-curve", "--quick", "--out", out];
    let output = xtask(&args);
    let first = stdout(&output);
    assert!(!first.contains("skipped"), "{first}");
    // The log has what took a while, once.
    let log = String::from_utf8(output.stderr).unwrap();
    let lines: BTreeSet<&str> = log.lines().collect();
    assert!(lines.len() == log.lines().count() && !log.contains(": 0."), "{log}");

    let run: serde_json::Value =
        serde_json::from_slice(&fs::read(dir.path().join("rd.json")).unwrap()).unwrap();
    let original = run["original"]["score"]["psnr_db"].as_f64().unwrap();
    assert!(original > 26.0, "{original}");
    let curves = run["curves"].as_array().unwrap();
    assert_eq!(curves.len(), 4);
    for curve in curves {
        let points = curve["points"].as_array().unwrap();
        assert!(points.len() >= 5);
        for point in points {
            let stream = dir.path().join(point["stream"].as_str().unwrap());
            assert_eq!(fs::metadata(stream).unwrap().len(), point["bytes"].as_u64().unwrap());
        }
        let db = |i: usize| points[i]["score"]["psnr_db"].as_f64().unwrap();
        let best = (0..points.len()).map(db).fold(0.0, f64::max);
        assert!(best > db(0) + 1.0 && best > original - 0.5, "{} {best} {original}", db(0));
    }
    // A stream of the paper's codec opens.
    let streams = fs::read_dir(dir.path().join("streams")).unwrap().map(|e| e.unwrap().path());
    let [stream, ply] = [
        streams.filter(|p| p.extension().is_some_and(|e| e == "paper")).min().unwrap(),
        dir.path().join("a.ply"),
    ];
    stdout(&xtask(&["paper-decode", stream.to_str().unwrap(), ply.to_str().unwrap()]));
    assert!(fs::metadata(ply).unwrap().len() > fs::metadata(stream).unwrap().len());
    let page = fs::read_to_string(dir.path().join("report.html")).unwrap();
    assert!(
        page.contains("<svg") && page.contains("data:image/png") && !page.contains("src=\"http")
    );

    let second = stdout(&xtask(&args));
    let all = second.lines().find(|l| l.contains("skipped")).unwrap();
    let mut numbers = all.split(' ').filter_map(|w| w.parse::<usize>().ok());
    let (skipped, stages) = (numbers.next().unwrap(), numbers.next().unwrap());
    assert!(skipped == stages && stages > 15, "{all}");

    // A stream that is gone is made again, and only that.
    fs::remove_file(dir.path().join("streams/uniform-q20.gsvx")).unwrap();
    let third = stdout(&xtask(&args));
    assert!(third.contains(&format!("{} of {stages} stages", stages - 1)), "{third}");
}

#[test]
fn the_room_shows_the_tuned_curve_first() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().to_str().unwrap();
    let args = ["rd-curve", "--rates", "2", "--views", "1", "--finetune", "4", "--out", out];
    let printed = stdout(&xtask(&args));
    assert!(printed.contains("room: for the same picture quality, gsvx tune needs"), "{printed}");
    let json = fs::read(dir.path().join("rd.json")).unwrap();
    let run: serde_json::Value = serde_json::from_slice(&json).unwrap();
    let tuned = run["curves"].as_array().unwrap().last().unwrap();
    assert_eq!(tuned["name"], "gsvx, tuned");
    assert_eq!(tuned["points"].as_array().unwrap().len(), 2);
}

#[test]
fn the_page_of_the_paper_answers_each_claim() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("paper.md");
    let printed =
        xtask(&["paper", "room", "--quick", "--steps", "4", "--out", out.to_str().unwrap()]);
    stdout(&printed);
    let page = fs::read_to_string(out).unwrap();
    for claim in ["Table 1", "fig. 6", "fig. 7", "equation 4", "about 15", "-13.42 %", "SPZ"] {
        assert!(page.contains(claim), "{claim}: {page}");
    }
    let here = |claim: &str| -> f64 {
        let row = page.lines().find(|l| l.contains(claim)).unwrap();
        let cell = row.rsplit('|').nth(1).unwrap().trim();
        cell.split(' ').next().unwrap().parse().unwrap_or_else(|_| panic!("{row}"))
    };
    // The initialisation is worth more than a few steps can make up for.
    assert!(here("initialised, after 4 steps") > here("from nothing, after 15 steps") + 3.0);
    // The hull of both octrees is what gsvx is compared with.
    assert!(here("gsvx against the paper, neither tuned") < -30.0);
}

#[test]
fn this_build_conforms() {
    let printed = stdout(&xtask(&["conformance", "--no-gpu", "--broken", "20"]));
    assert!(printed.lines().filter(|l| l.starts_with("ok ")).count() >= 15, "{printed}");
    assert!(!printed.contains("FAIL") && printed.contains("0 fail"), "{printed}");
}

#[test]
fn bad_input_is_one_line_and_exit_code_1() {
    let dir = tempfile::tempdir().unwrap();
    let cut = dir.path().join("cut");
    testing::copy_room(&cut);
    let model = fs::File::options().write(true).open(cut.join("point_cloud.ply"));
    model.unwrap().set_len(100_000).unwrap();
    let bare = dir.path().join("bare");
    testing::copy_room(&bare);
    fs::remove_file(bare.join("images/view_008.png")).unwrap();
    let garbled = dir.path().join("garbled");
    testing::copy_room(&garbled);
    fs::write(garbled.join("images/view_008.png"), "no picture").unwrap();
    let empty = dir.path().join("empty");
    fs::create_dir(&empty).unwrap();
    let out = dir.path().join("out");
    for (scene, says) in [
        (cut.to_str().unwrap(), "point_cloud.ply"),
        (bare.to_str().unwrap(), "view_008.png"),
        (garbled.to_str().unwrap(), "view_008.png"),
        (empty.to_str().unwrap(), "point_cloud.ply"),
        ("no-such-scene", "playroom"),
    ] {
        let output = xtask(&["rd-curve", scene, "--out", out.to_str().unwrap()]);
        let error = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(1), "{scene}: {error}");
        assert!(error.starts_with("error: ") && error.contains(says), "{scene}: {error}");
        assert_eq!(error.trim_end().lines().count(), 1, "{scene}: {error}");
    }
}
