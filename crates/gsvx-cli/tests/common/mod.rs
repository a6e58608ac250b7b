//! The command, the models it is run on, and what is said of a run.
#![allow(dead_code, reason = "each test file uses its own part")]

use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, SystemTime};

pub(crate) fn gsvx() -> Command {
    Command::new(env!("CARGO_BIN_EXE_gsvx"))
}

pub(crate) fn room() -> PathBuf {
    testing::fixture("room")
}

pub(crate) fn model() -> PathBuf {
    room().join("point_cloud.ply")
}

/// The first 400 Gaussians of the room.
pub(crate) fn scene() -> gs_model::Scene {
    let (scene, _) = gs_model::ply::read(model()).unwrap();
    scene.select(&(0..400).collect::<Vec<_>>())
}

/// A folder that is gone when the test ends.
pub(crate) struct Folder(tempfile::TempDir);

impl Folder {
    pub(crate) fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    /// A file of [`scene`].
    pub(crate) fn small(&self) -> PathBuf {
        let path = self.join("small.ply");
        gs_model::ply::write(&path, &scene()).unwrap();
        path
    }
}

impl std::ops::Deref for Folder {
    type Target = Path;

    fn deref(&self) -> &Path {
        self.0.path()
    }
}

/// The command with the words of `line`; each `@` stands for the next of `paths`.
pub(crate) fn command(line: &str, paths: &[&Path]) -> Command {
    let mut paths = paths.iter();
    let word = |word| match word {
        "@" => paths.next().expect("a path per @").as_os_str(),
        word => OsStr::new(word),
    };
    let mut command = gsvx();
    command.args(line.split(' ').map(word));
    command
}

/// Runs [`command`].
pub(crate) fn run(line: &str, paths: &[&Path]) -> Output {
    command(line, paths).output().unwrap()
}

/// What a run that succeeded says on standard output.
#[track_caller]
pub(crate) fn ok(line: &str, paths: &[&Path]) -> String {
    said(&run(line, paths))
}

/// What a run that succeeded has said on standard output.
#[track_caller]
pub(crate) fn said(out: &Output) -> String {
    assert!(out.status.success(), "{}", heard(out));
    String::from_utf8_lossy(&out.stdout).into_owned()
}

/// What a run has said on standard error.
pub(crate) fn heard(out: &Output) -> String {
    String::from_utf8_lossy(&out.stderr).trim_end().to_owned()
}

/// The report of a run that succeeded, and what it said on standard error.
#[track_caller]
pub(crate) fn report(line: &str, paths: &[&Path]) -> (serde_json::Value, String) {
    let out = run(&format!("{line} --json"), paths);
    (serde_json::from_str(&said(&out)).unwrap(), heard(&out))
}

/// The report of a run that succeeded.
#[track_caller]
pub(crate) fn json(line: &str, paths: &[&Path]) -> serde_json::Value {
    report(line, paths).0
}

/// Runs the command with this on standard input.
pub(crate) fn piped(line: &str, input: &[u8]) -> Output {
    use std::io::Write;
    let mut child = command(line, &[])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let (mut stdin, input) = (child.stdin.take().unwrap(), input.to_vec());
    let feeder = std::thread::spawn(move || stdin.write_all(&input));
    let out = child.wait_with_output().unwrap();
    // A command that refuses its input need not read all of it.
    let _ = feeder.join().unwrap();
    out
}

/// Starts the command and interrupts it once `ready`. It must not end before.
#[cfg(unix)]
#[track_caller]
pub(crate) fn interrupted(line: &str, paths: &[&Path], ready: impl Fn() -> bool) -> Output {
    let mut command = command(line, paths);
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    while !ready() {
        assert!(child.try_wait().unwrap().is_none(), "ended before it was interrupted");
        std::thread::sleep(Duration::from_millis(1));
    }
    let kill = Command::new("kill").args(["-INT", &child.id().to_string()]).status();
    assert!(kill.unwrap().success());
    child.wait_with_output().unwrap()
}

/// The lines of [`heard`] without progress, which a busy machine may show.
pub(crate) fn lines(out: &Output) -> Vec<String> {
    let heard = heard(out);
    heard.lines().filter(|line| !line.ends_with("s so far")).map(ToOwned::to_owned).collect()
}

/// Exit code 1 and exactly one line, which holds `needle`.
#[track_caller]
pub(crate) fn one_line(out: &Output, needle: &str) {
    let error = heard(out);
    assert_eq!(out.status.code(), Some(1), "{error}");
    assert_eq!(lines(out).len(), 1, "{error}");
    assert!(error.contains(needle), "{needle:?} is not in {error:?}");
}

/// Exit code 1, and a last line, which holds `needle`; notes may come before it.
#[track_caller]
pub(crate) fn failed(out: &Output, needle: &str) {
    let error = heard(out);
    assert_eq!(out.status.code(), Some(1), "{error}");
    let last = error.lines().last().unwrap_or_default();
    assert!(last.contains(needle), "{needle:?} is not in {error:?}");
}

/// Exit code 2 and one line, which holds `needle`.
#[track_caller]
pub(crate) fn wrong_usage(out: &Output, needle: &str) {
    let error = heard(out);
    assert_eq!(out.status.code(), Some(2), "{error}");
    assert!(error.contains(needle), "{needle:?} is not in {error:?}");
}

/// The room's cameras in `dir`, as a COLMAP project. With coefficients, each after a space, they have an OPENCV lens.
pub(crate) fn room_cameras(dir: &Path, coefficients: &str) {
    let [from, to] = [room(), dir.to_owned()].map(|dir| dir.join("sparse/0"));
    std::fs::create_dir_all(&to).unwrap();
    for name in ["images.txt", "points3D.txt"] {
        std::fs::copy(from.join(name), to.join(name)).unwrap();
    }
    let mut cameras = std::fs::read_to_string(from.join("cameras.txt")).unwrap();
    if !coefficients.is_empty() {
        cameras = cameras.trim_end().replace(" PINHOLE ", " OPENCV ") + coefficients;
    }
    std::fs::write(to.join("cameras.txt"), cameras).unwrap();
}

/// The names in a folder, sorted.
pub(crate) fn names(dir: &Path) -> Vec<String> {
    let list = std::fs::read_dir(dir).unwrap();
    let mut names: Vec<_> = list.map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

/// Moments to kill a run at: others every time. A failure prints the seed; `GSVX_KILL_SEED` sets it.
pub(crate) struct Moments(u64);

impl Moments {
    pub(crate) fn new() -> Self {
        let given = std::env::var("GSVX_KILL_SEED").ok().and_then(|s| s.parse().ok());
        let now = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap();
        let seed = given.unwrap_or(now.as_nanos() as u64);
        println!("GSVX_KILL_SEED={seed}");
        Self(seed)
    }

    /// Anywhere from the start of a run to the end of one that takes `whole`.
    pub(crate) fn next(&mut self, whole: Duration) -> Duration {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        whole.mul_f64(((z ^ (z >> 27)) >> 11) as f64 / (1u64 << 53) as f64)
    }
}
