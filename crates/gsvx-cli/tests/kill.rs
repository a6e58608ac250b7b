//! The command killed at moments that nobody chose, and its inputs changed under its hands. A
//! target is absent, the old file or the new one, whole; a checkpoint is one that can be continued.
#![cfg(unix)]

mod common;

use std::io::{Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use common::{Folder, Moments, command, heard, model, names, ok, one_line, room, run};

/// Starts the command and kills it after `wait`, unless it ended before. True if it was killed.
fn killed(command: &mut Command, wait: Duration) -> bool {
    let started = Instant::now();
    let mut child = command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    loop {
        if let Some(status) = child.try_wait().unwrap() {
            assert!(status.success(), "{status}");
            return false;
        }
        if started.elapsed() >= wait {
            child.kill().unwrap();
            child.wait().unwrap();
            return true;
        }
        std::thread::sleep(Duration::from_micros(200));
    }
}

/// Every command that writes one file, and its input.
fn writers(dir: &Path) -> Vec<(&'static str, PathBuf)> {
    let stream = dir.join("in.gsvx");
    ok("encode @ -o @", &[&model(), &stream]);
    vec![
        ("encode @ -o @", model()),
        ("encode --lossless @ -o @", model()),
        ("decode @ -o @", stream.clone()),
        ("convert --to spz @ @", model()),
        ("convert --to splat @ @", stream),
        ("convert --to ply @ @", model()),
    ]
}

#[test]
fn killed_at_random_the_target_is_absent_or_whole() {
    let dir = Folder::new();
    let mut moments = Moments::new();
    let commands = writers(&dir);
    let (mut kills, mut ends) = (0, 0);
    for (name, input) in &commands {
        let target = dir.join("target");
        let started = Instant::now();
        assert!(!killed(&mut command(name, &[input, &target]), Duration::from_secs(600)), "{name}");
        let whole = started.elapsed();
        let new = std::fs::read(&target).unwrap();
        for round in 0..12 {
            // In turn onto nothing, and onto an old file.
            let old = (round % 2 == 1).then_some(b"what was there before".as_slice());
            std::fs::remove_file(&target).unwrap_or_default();
            if let Some(old) = old {
                std::fs::write(&target, old).unwrap();
            }
            let mut command = command(&format!("{name} --force"), &[input, &target]);
            let killed = killed(&mut command, moments.next(whole.mul_f64(1.1)));
            *(if killed { &mut kills } else { &mut ends }) += 1;
            let found = std::fs::read(&target).ok();
            let is_old = found.as_deref() == old;
            let is_new = found.as_deref() == Some(&new);
            assert!(
                is_new || (killed && is_old),
                "{name}, round {round}: {:?}",
                found.map(|f| f.len())
            );
            for left in names(&dir) {
                let known = ["in.gsvx", "target"].contains(&left.as_str());
                assert!(known || left.starts_with(".gsvx-"), "{name}: {left}");
            }
        }
        std::fs::remove_file(&target).unwrap_or_default();
    }
    println!("{kills} runs killed, {ends} had ended");
    assert!(kills > 8, "the kills came too late");
}

/// A short tune that keeps checkpoints.
fn tune(dir: &Folder, output: &str, checkpoint: &str) -> Command {
    let line = "tune @ --orbit 6 --size 64x48 --effort quick --checkpoint @ -o @";
    command(line, &[&dir.small(), &dir.join(checkpoint), &dir.join(output)])
}

/// Killed again and again, a tune goes on from its checkpoint, to the bytes of a run that
/// nobody disturbed.
#[test]
fn a_tune_killed_at_random_loses_no_checkpoint() {
    let dir = Folder::new();
    let mut moments = Moments::new();
    let started = Instant::now();
    assert!(!killed(&mut tune(&dir, "whole.gsvx", "whole.ckpt"), Duration::MAX));
    let whole = started.elapsed();
    let read = |name: &str| std::fs::read(dir.join(name)).unwrap();
    let (mut kills, mut kept, mut ends) = (0, 0, 0);
    while kills < 6 || ends == 0 || dir.join("b.ckpt").exists() {
        let wait = if kills < 6 { moments.next(whole.mul_f64(1.1)) } else { Duration::MAX };
        if killed(&mut tune(&dir, "b.gsvx", "b.ckpt"), wait) {
            kills += 1;
            kept += usize::from(dir.join("b.ckpt").exists());
            // Killed after the output got its name, or before.
            assert!(!dir.join("b.gsvx").exists() || read("b.gsvx") == read("whole.gsvx"));
        } else {
            ends += 1;
            assert!(read("b.gsvx") == read("whole.gsvx"), "another result after {kills} kills");
            assert!(read("b.ckpt") == read("whole.ckpt"), "another state after {kills} kills");
        }
        if dir.join("b.gsvx").exists() {
            // Another life.
            std::fs::remove_file(dir.join("b.gsvx")).unwrap();
            std::fs::remove_file(dir.join("b.ckpt")).unwrap();
        }
    }
    println!("{kills} kills, {kept} of them with a checkpoint, {ends} runs to the end");
    for name in names(&dir) {
        let known =
            ["small.ply", "whole.gsvx", "whole.ckpt", "b.ckpt.tmp"].contains(&name.as_str());
        assert!(known || name.starts_with(".gsvx-"), "{name}");
    }
}

/// Does something while `change` is done to `input` over and over.
fn while_changing(
    input: &Path,
    change: impl Fn(&mut std::fs::File, usize) + Sync,
    during: impl FnOnce(),
) {
    let stop = AtomicBool::new(false);
    std::thread::scope(|scope| {
        scope.spawn(|| {
            let mut file = std::fs::File::options().write(true).open(input).unwrap();
            for step in 0.. {
                if stop.load(Ordering::Relaxed) {
                    break;
                }
                change(&mut file, step);
                std::thread::sleep(Duration::from_micros(200));
            }
        });
        during();
        stop.store(true, Ordering::Relaxed);
    });
}

/// A stream is overwritten by another, shortened, emptied and lengthened while it is decoded:
/// checksums tell, so what is decoded is one of the two, whole, or nothing.
#[test]
fn a_stream_that_changes_is_decoded_whole_or_not_at_all() {
    let dir = Folder::new();
    for (name, quality) in [("a", "60"), ("b", "40")] {
        let stream = dir.join(format!("{name}.gsvx"));
        ok(&format!("encode @ -o @ -q {quality}"), &[&model(), &stream]);
        ok("decode @ -o @", &[&stream, &dir.join(format!("{name}.ply"))]);
    }
    let streams = ["a", "b"].map(|n| std::fs::read(dir.join(format!("{n}.gsvx"))).unwrap());
    let models = ["a", "b"].map(|n| std::fs::read(dir.join(format!("{n}.ply"))).unwrap());
    let input = dir.join("input.gsvx");
    std::fs::write(&input, &streams[0]).unwrap();
    let change = |file: &mut std::fs::File, step: usize| {
        file.seek(SeekFrom::Start(0)).unwrap();
        match step % 6 {
            0 | 3 => file.write_all(&streams[step / 3 % 2]).unwrap(),
            1 => file.set_len(streams[0].len() as u64).unwrap(),
            2 => file.set_len(1000).unwrap(),
            4 => file.set_len(0).unwrap(),
            _ => file.set_len(3 * streams[0].len() as u64).unwrap(),
        }
    };
    let (mut decoded, mut refused) = (0, 0);
    while_changing(&input, change, || {
        for round in 0..24 {
            let target = dir.join(format!("out-{round}.ply"));
            let out = run("decode @ -o @", &[&input, &target]);
            if out.status.success() {
                decoded += 1;
                let found = std::fs::read(&target).unwrap();
                assert!(models.contains(&found), "round {round}: a scene that nobody encoded");
            } else {
                refused += 1;
                one_line(&out, "input.gsvx");
                assert!(!target.exists());
            }
        }
    });
    println!("{decoded} decoded, {refused} refused");
    assert!(refused > 0, "nothing changed while it was read");
}

/// A PLY has no checksum: a mixture of two models of one length may be taken for a third, but it
/// is whole, or refused with a line that names the file.
#[test]
fn a_model_that_changes_is_converted_or_refused() {
    let dir = Folder::new();
    let bytes = std::fs::read(model()).unwrap();
    let input = dir.join("input.ply");
    std::fs::write(&input, &bytes).unwrap();
    let header = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    // The same model, its Gaussians in reverse.
    let row = 62 * 4;
    assert_eq!((bytes.len() - header) % row, 0, "a model of degree 3");
    let mut other = bytes[..header].to_vec();
    bytes[header..].chunks_exact(row).rev().for_each(|r| other.extend(r));
    let change = |file: &mut std::fs::File, step: usize| {
        file.seek(SeekFrom::Start(0)).unwrap();
        match step % 4 {
            0 => file.write_all(&other).unwrap(),
            1 => file.set_len(bytes.len() as u64 / 3).unwrap(),
            2 => file.write_all(&bytes).unwrap(),
            _ => file.set_len(bytes.len() as u64 + 77).unwrap(),
        }
    };
    let (mut taken, mut refused) = (0, 0);
    while_changing(&input, change, || {
        for round in 0..18 {
            let target = dir.join(format!("out-{round}.gsvx"));
            let lines = ["encode --lossless @ -o @", "encode @ -o @", "convert --to ply @ @"];
            let out = run(lines[round % 3], &[&input, &target]);
            if out.status.success() {
                taken += 1;
                let made = std::fs::read(&target).unwrap();
                let valid = match round % 3 {
                    2 => gs_model::ply::read_bytes(&made).is_ok(),
                    _ => gsvx::decode(&made).is_ok(),
                };
                assert!(valid, "round {round}");
            } else {
                refused += 1;
                one_line(&out, "input.ply");
                assert!(!target.exists());
            }
        }
    });
    println!("{taken} taken, {refused} refused");
    assert!(refused > 0, "nothing changed while it was read");
}

/// Cameras and photos are inputs as well.
#[test]
fn a_file_of_cameras_that_was_cut_short_is_named() {
    let dir = Folder::new();
    let copy = dir.join("room");
    for folder in ["images", "sparse/0"] {
        std::fs::create_dir_all(copy.join(folder)).unwrap();
        for entry in std::fs::read_dir(room().join(folder)).unwrap().flatten() {
            std::fs::copy(entry.path(), copy.join(folder).join(entry.file_name())).unwrap();
        }
    }
    let cut = |name: &str| {
        let path = copy.join(name);
        let whole = std::fs::read(&path).unwrap();
        std::fs::write(&path, &whole[..whole.len() / 2]).unwrap();
        let line = "tune @ --cameras @ -o @";
        let out = run(line, &[&model(), &copy, &dir.join("a.gsvx")]);
        std::fs::write(&path, whole).unwrap();
        let error = heard(&out);
        assert_eq!(out.status.code(), Some(1), "{error}");
        let last = error.lines().last().unwrap_or_default();
        let file = Path::new(name).file_name().unwrap().to_str().unwrap();
        assert!(last.starts_with("error: ") && last.contains(file), "{error}");
        assert_eq!(names(&dir), ["room"]);
    };
    let listed = names(&copy.join("sparse/0"));
    let images = listed.iter().find(|n| n.starts_with("images")).unwrap();
    cut(&format!("sparse/0/{images}"));
}
