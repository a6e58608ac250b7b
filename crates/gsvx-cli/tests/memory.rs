//! Memory of the command as a whole process.
#![cfg(target_os = "linux")]

mod common;
#[allow(dead_code, reason = "a part is used")]
#[path = "../../gsvx/tests/common/forge.rs"]
mod forge;

use std::process::{Command, Stdio};

use common::{Folder, gsvx, model};
use gs_model::Scene;

/// Floats of a Gaussian of SH degree 3.
const FLOATS: u64 = 59;
/// The process itself, before it reads anything, without the pages of its program file: 1 MB; and some for stacks
/// and what the allocator keeps.
const PROCESS: u64 = 3_000_000;

/// As many Gaussians of the fixture, side by side, every coefficient there.
fn replicated(len: usize) -> Scene {
    let (room, _) = gs_model::ply::read(model()).unwrap();
    let mut scene = Scene { sh_degree: 3, ..Scene::default() };
    let mut copies = 0.0;
    while scene.len() < len {
        let first = scene.len();
        scene.append_range(&room, 0..room.len().min(len - first));
        for mean in &mut scene.means[first..] {
            mean[0] += 40.0 * copies;
        }
        copies += 1.0;
    }
    for (i, sh) in scene.sh.iter_mut().enumerate().filter(|(i, _)| i % 16 > 3) {
        *sh = [0, 1, 2].map(|c| ((i * 37 + c * 11) % 199) as f32 * 2e-3 - 0.2);
    }
    scene
}

/// Greatest resident memory of a child, which is looked at until it ends, without the pages of its program file:
/// how many of these are resident depends on the build, 7 to 10 MB.
fn peak_bytes(command: &mut Command) -> u64 {
    // On a busy machine a short run may end before anything was read of it.
    (0..20).find_map(|_| peak_of_a_run(command)).expect("memory of one of 20 runs")
}

/// See [`peak_bytes`]; `None` if the run ended before.
fn peak_of_a_run(command: &mut Command) -> Option<u64> {
    let mut child = command.stdout(Stdio::null()).spawn().unwrap();
    let status = format!("/proc/{}/status", child.id());
    let (mut peak, mut program) = (0, 0);
    while child.try_wait().unwrap().is_none() {
        let text = std::fs::read_to_string(&status).unwrap_or_default();
        let bytes = |name: &str| {
            let line = text.lines().find_map(|l| l.strip_prefix(name));
            let kib = line.and_then(|l| l.split_whitespace().next()?.parse::<u64>().ok());
            kib.unwrap_or(0) * 1024
        };
        peak = peak.max(bytes("VmHWM:"));
        program = program.max(bytes("RssFile:"));
        std::thread::sleep(std::time::Duration::from_millis(1));
    }
    assert!(child.wait().unwrap().success());
    (program > 0).then(|| peak - program)
}

/// A file that is 5 GB long and has these bytes at its start; the others take no room on the disk.
fn sparse(path: &std::path::Path, start: &[u8]) {
    std::fs::write(path, start).unwrap();
    let file = std::fs::OpenOptions::new().write(true).open(path).unwrap();
    file.set_len(5_000_000_000).unwrap();
}

#[test]
fn info_of_a_large_file_reads_its_head() {
    let folder = tempfile::tempdir().unwrap();
    let [behind, claimed, cut, ply] = ["behind.gsvx", "claimed.gsvx", "cut.gsvx", "large.ply"]
        .map(|name| folder.path().join(name));
    let golden = std::fs::read(common::room().join("../streams/default.gsvx")).unwrap();
    sparse(&behind, &golden);
    let (mut index, _) = forge::take_apart(&golden);
    index.chunks[0].layers[0].len = 4_900_000_000;
    sparse(&claimed, &forge::head(&index));
    std::fs::write(&cut, forge::head(&index)).unwrap();
    let (room, _) = gs_model::ply::read(model()).unwrap();
    gs_model::ply::write(&ply, &room).unwrap();
    let text = std::fs::read(&ply).unwrap();
    let end = text.windows(10).position(|w| w == b"end_header").unwrap() + 11;
    let many = format!("element vertex {}", 4_900_000_000 / ((text.len() - end) / room.len()));
    let head = String::from_utf8(text[..end].to_vec()).unwrap();
    let head = head.replace(&format!("element vertex {}", room.len()), &many);
    sparse(&ply, head.as_bytes());
    for (file, said) in [
        (&behind, "bytes after the last chunk are not part of it"),
        (&claimed, "Only the head was read"),
        (&cut, "stream truncated in a chunk: 0 of 4900000000 bytes"),
        (&ply, "Only the head was read"),
    ] {
        let text = common::ok("info @", &[file]);
        assert!(text.contains(said), "{text}");
        let peak = peak_bytes(gsvx().arg("info").arg(file));
        assert!(peak < PROCESS + 20_000_000, "{}: {peak} bytes", file.display());
    }
}

/// Two chunks, and four.
#[test]
fn encoding_takes_twice_the_memory_of_the_floats() {
    let dir = Folder::new();
    let (input, output) = (dir.join("model.ply"), dir.join("model.gsvx"));
    for len in [60_000, 100_000] {
        gs_model::ply::write(&input, &replicated(len)).unwrap();
        for mode in [None, Some("--lod")] {
            let run = || {
                let mut command = gsvx();
                command.arg("encode").arg(&input).arg("-o").arg(&output);
                // Higher qualities have more symbols in memory: 2 MB more at quality 75.
                command.args(["--force", "--threads", "2", "--quality", "60", "--no-estimate"]);
                peak_bytes(command.args(mode))
            };
            // How the threads meet makes half a megabyte.
            let peak = (0..3).map(|_| run()).min().unwrap();
            let most = 2 * 4 * FLOATS * len as u64 + PROCESS;
            println!("{len} Gaussians {mode:?}: {peak} bytes");
            assert!(peak > 4 * FLOATS * len as u64, "{peak}: not the process that was meant");
            assert!(peak <= most, "{len} Gaussians, {mode:?}: {peak} bytes, at most {most}");
        }
    }
}

/// A scene of several tiles takes less memory within a bound than in memory, and no more than the bound.
#[test]
fn a_bound_on_memory_holds() {
    let dir = Folder::new();
    let (input, output) = (dir.join("model.ply"), dir.join("model.gsvx"));
    let len = 1_000_000;
    gs_model::ply::write(&input, &replicated(len)).unwrap();
    let most = 300_000_000;
    let mut command = gsvx();
    command.arg("encode").arg(&input).arg("-o").arg(&output).args(["--threads", "2"]);
    let peak = peak_bytes(command.args(["--memory", &most.to_string()]));
    println!("{len} Gaussians: {peak} bytes");
    assert!(peak > 50_000_000, "{peak}: not the process that was meant");
    assert!(peak <= most && most < 2 * 4 * FLOATS * len as u64, "{peak} bytes, at most {most}");
}
