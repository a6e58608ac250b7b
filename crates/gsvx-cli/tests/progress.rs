//! Long work says how far it is.

mod common;

use common::{Folder, gsvx};
use std::io::{BufRead as _, BufReader};
use std::process::Stdio;
use std::sync::mpsc::channel;
use std::time::{Duration, Instant};
use testing::Rng;

/// Time that is listened, and the longest silence before and between two lines: a bit more than what is promised, as
/// other tests run at the same time.
const LISTENED: Duration = Duration::from_secs(14);
const FIRST: Duration = Duration::from_millis(2_500);
const BETWEEN: Duration = Duration::from_millis(5_800);

#[test]
fn a_tune_of_a_million_gaussians_is_never_silent() {
    let dir = Folder::new();
    let model = dir.join("large.ply");
    let scene = testing::trained_like(1_000_000, 0, &mut Rng::seeded(1));
    gs_model::ply::write(&model, &scene).unwrap();
    drop(scene);
    let started = Instant::now();
    let mut child = gsvx()
        .arg("tune")
        .arg(&model)
        .args(["--orbit", "48", "--size", "640x480", "-o"])
        .arg(dir.join("a.gsvx"))
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let (said, heard) = channel();
    let lines = BufReader::new(child.stderr.take().unwrap()).lines();
    std::thread::spawn(move || {
        lines.map_while(Result::ok).for_each(|line| drop(said.send((started.elapsed(), line))));
    });
    let mut last = Duration::ZERO;
    let mut all = Vec::new();
    while let Some(left) = LISTENED.checked_sub(started.elapsed()) {
        let Ok((at, line)) = heard.recv_timeout(left) else { break };
        let most = if last.is_zero() { FIRST } else { BETWEEN };
        all.push(format!("{at:.1?} {line}"));
        assert!(at - last < most, "{all:#?}");
        last = at;
    }
    child.kill().unwrap();
    child.wait().unwrap();
    assert!(LISTENED - last < BETWEEN, "{all:#?}");
    let tells = |line: &String| {
        ["cameras: ", "renders: ", "input model: "].iter().any(|w| line.contains(w))
    };
    assert!(all.iter().any(tells), "{all:#?}");
}
