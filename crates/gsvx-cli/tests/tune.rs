//! `gsvx tune`, on a small model.

mod common;

use common::{Folder, heard, model, one_line, room, said, wrong_usage};
use std::path::{Path, PathBuf};
use std::process::Command;

/// Every 25th Gaussian of the room.
fn small(dir: &Path) -> PathBuf {
    let (scene, _) = gs_model::ply::read(model()).unwrap();
    let path = dir.join("small.ply");
    let some: Vec<usize> = (0..scene.len()).step_by(25).collect();
    gs_model::ply::write(&path, &scene.select(&some)).unwrap();
    path
}

/// A short tune of the small model to its own renders.
fn tune(dir: &Path, output: &str) -> Command {
    common::command("tune @ --orbit 6 --size 64x48 -o @", &[&small(dir), &dir.join(output)])
}

fn quick(dir: &Path, output: &str) -> Command {
    let mut command = tune(dir, output);
    command.args(["--effort", "quick"]);
    command
}

#[test]
fn a_model_is_tuned_to_itself() {
    let dir = Folder::new();
    let out = quick(&dir, "a.gsvx").arg("--json").output().unwrap();
    let json: serde_json::Value = serde_json::from_str(&said(&out)).unwrap();
    let text = heard(&out);
    assert!(
        text.contains("renders of it are the targets") && text.contains("plan: quality 58.0"),
        "{text}"
    );
    let bytes = std::fs::read(dir.join("a.gsvx")).unwrap();
    let decoded = gsvx::decode(&bytes).unwrap();
    assert_eq!(
        (json["bytes"].as_u64().unwrap(), json["gaussians"].as_u64().unwrap()),
        (bytes.len() as u64, decoded.len() as u64)
    );
    assert_eq!((&json["distilled"], &json["steps"]), (&true.into(), &510.into()));
    assert!(text.contains("6 cameras ") && text.contains("6 renders of it"), "{text}");
    assert!(!text.contains("100.00 dB") && json["input_psnr"].is_null(), "{text}");
    assert!(json["elsewhere_psnr"].as_f64().unwrap() > 20.0, "{json}");
    // A PLY holds what a decoder returns.
    let text = said(&quick(&dir, "a.ply").output().unwrap());
    assert!(text.contains("; elsewhere ") && text.contains("all steps are done"), "{text}");
    let (ply, _) = gs_model::ply::read(dir.join("a.ply")).unwrap();
    assert_eq!((ply.means, ply.sh), (decoded.means, decoded.sh));
}

#[test]
fn one_run_makes_a_stream_of_each_quality() {
    let dir = tempfile::tempdir().unwrap();
    let mut command = quick(dir.path(), "a.gsvx");
    let out = command.args(["--qualities", "42,58,50", "--json"]).output().unwrap();
    let streams: Vec<serde_json::Value> =
        said(&out).lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let qualities: Vec<_> = streams.iter().map(|s| s["quality"].as_f64().unwrap()).collect();
    assert_eq!(qualities, [58.0, 50.0, 42.0]);
    let bytes = ["a-q58.gsvx", "a-q50.gsvx", "a-q42.gsvx"]
        .map(|name| std::fs::read(dir.path().join(name)).unwrap().len() as u64);
    assert!(bytes.iter().zip(&streams).all(|(bytes, s)| s["bytes"] == *bytes), "{streams:?}");
    assert!(bytes[0] > bytes[1] && bytes[1] > bytes[2], "{bytes:?}");
    assert!(!dir.path().join("a.gsvx").exists());
    // None of them is replaced.
    let mut command = quick(dir.path(), "a.gsvx");
    one_line(&command.args(["--qualities", "50,30"]).output().unwrap(), "a-q50.gsvx");
}

#[test]
fn a_coarse_scene_comes_first_if_it_is_asked_for() {
    let dir = Folder::new();
    for (name, flag) in [("a", "--lod"), ("b", "--web")] {
        let mut command = quick(&dir, &format!("{name}.gsvx"));
        let json = said(&command.args([flag, "--json"]).output().unwrap());
        let json: serde_json::Value = serde_json::from_str(&json).unwrap();
        let bytes = std::fs::read(dir.join(format!("{name}.gsvx"))).unwrap();
        let index = gsvx::Index::parse(&bytes).unwrap();
        assert_eq!((index.chunks[0].lod, index.chunks.last().unwrap().lod), (1, 0), "{name}");
        assert_eq!(json["bytes"].as_u64(), Some(bytes.len() as u64));
        assert_eq!(json["gaussians"].as_u64(), Some(index.header.count));
    }
    wrong_usage(&quick(&dir, "a.ply").arg("--lod").output().unwrap(), "no coarse level");
}

#[test]
fn a_target_in_bytes_is_met_or_missed_with_exit_code_3() {
    let dir = Folder::new();
    said(&quick(&dir, "a.gsvx").args(["--target-bytes", "4500"]).output().unwrap());
    assert!(std::fs::metadata(dir.join("a.gsvx")).unwrap().len() <= 4500);
    // A poor result says so.
    let out = quick(&dir, "poor.gsvx").args(["--target-bytes", "800"]).output().unwrap();
    assert!(heard(&out).contains("easy to see"), "{out:?}");
    let out = quick(&dir, "b.gsvx").args(["--target-bytes", "100"]).output().unwrap();
    let error = heard(&out);
    let last = error.lines().last().unwrap();
    assert!(last.contains("100 bytes is below"), "{error}");
    let out = quick(&dir, "c.gsvx").args(["--target-psnr", "90"]).output().unwrap();
    assert_eq!(out.status.code(), Some(3), "{}", heard(&out));
    assert!(dir.join("c.gsvx").exists() && !dir.join("b.gsvx").exists());
}

#[test]
fn wrong_words_and_wrong_photos_give_one_line() {
    let dir = Folder::new();
    let run = |line: &str, cameras: &[&Path]| {
        let (input, output) = (small(&dir), dir.join("a.gsvx"));
        common::run(&format!("tune @ -o @{line}"), &[&[&*input, &output], cameras].concat())
    };
    let room = room();
    wrong_usage(&run("", &[]), "--cameras");
    wrong_usage(&quick(&dir, "x.txt").output().unwrap(), ".gsvx or .ply");
    // Every 25th Gaussian shows next to nothing of what the photos show.
    one_line(&run(" --cameras @", &[&room]), "do not show this model");
    let single = dir.join("transforms.json");
    let text = r#"{"w": 64, "h": 48, "fl_x": 60.0, "frames": [{"file_path": "a.png",
        "transform_matrix": [[1,0,0,0],[0,1,0,0],[0,0,1,3],[0,0,0,1]]}]}"#;
    std::fs::write(&single, text).unwrap();
    one_line(&run(" --cameras @", &[&single]), "two or more");
    assert!(!dir.join("a.gsvx").exists());
}

#[cfg(unix)]
#[test]
fn a_terminated_tune_writes_what_it_has_reached() {
    use std::process::Stdio;
    // `timeout` and service managers send SIGTERM, some to the process and to its group.
    for signals in [&["-TERM"][..], &["-INT"], &["-TERM", "-TERM"]] {
        let dir = Folder::new();
        let checkpoint = dir.join("run.ckpt");
        let mut command = tune(&dir, "a.gsvx");
        command.args(["--effort", "long", "--checkpoint"]).arg(&checkpoint);
        let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        // A checkpoint shows that the tuning has begun.
        while !checkpoint.exists() {
            assert!(child.try_wait().unwrap().is_none(), "ended before it was interrupted");
            std::thread::sleep(std::time::Duration::from_millis(5));
        }
        for signal in signals {
            Command::new("kill").args([signal, child.id().to_string().as_str()]).status().unwrap();
        }
        let out = child.wait_with_output().unwrap();
        assert!(said(&out).contains("interrupted"), "{signals:?}: {}", heard(&out));
        let bytes = std::fs::read(dir.join("a.gsvx")).unwrap();
        assert!(!gsvx::decode(&bytes).unwrap().is_empty());
    }
}

/// A limit on the size of files stands for a full disk.
#[cfg(unix)]
#[test]
fn a_checkpoint_that_does_not_fit_does_not_end_the_run() {
    let dir = Folder::new();
    let mut command = quick(&dir, "a.gsvx");
    command.arg("--checkpoint").arg(dir.join("run.ckpt"));
    let out = Command::new("sh")
        .args(["-c", "trap '' XFSZ; ulimit -f 64; exec \"$0\" \"$@\""])
        .arg(command.get_program())
        .args(command.get_args())
        .output()
        .unwrap();
    said(&out);
    let text = heard(&out);
    let warnings = text.lines().filter(|l| l.starts_with("warning: ")).count();
    assert!(warnings == 1 && text.contains("run.ckpt"), "{text}");
    assert!(gsvx::decode(&std::fs::read(dir.join("a.gsvx")).unwrap()).is_ok());
    assert!(!dir.join("run.ckpt").exists());
}
