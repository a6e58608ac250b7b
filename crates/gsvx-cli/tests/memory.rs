//! Memory of the command as a whole process.
#![cfg(target_os = "linux")]

mod common;

use std::process::{Command, Stdio};

use common::{gsvx, model};
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
    assert!(program > 0, "RssFile was not read");
    peak - program
}

/// Two chunks, and four.
#[test]
fn encoding_takes_twice_the_memory_of_the_floats() {
    let dir = tempfile::tempdir().unwrap();
    let (input, output) = (dir.path().join("model.ply"), dir.path().join("model.gsvx"));
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
    let dir = tempfile::tempdir().unwrap();
    let (input, output) = (dir.path().join("model.ply"), dir.path().join("model.gsvx"));
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
