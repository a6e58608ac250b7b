//! What happens to the command: killed, out of space, robbed of its input, without a GPU. In every
//! case the target is the old file or the new one, whole.
#![cfg(unix)]

mod common;

use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use common::{Folder, command, heard, model, names, ok, one_line, run};

/// A stream of the room, and the PLY it decodes to.
fn outputs(dir: &Path) -> (PathBuf, PathBuf) {
    let (stream, ply) = (dir.join("room.gsvx"), dir.join("room.ply"));
    ok("encode @ -o @", &[&model(), &stream]);
    ok("decode @ -o @", &[&stream, &ply]);
    (stream, ply)
}

/// However fresh it is: a run that is still there holds a lock.
#[test]
fn what_a_killed_run_left_is_swept_but_not_what_a_running_one_holds() {
    let dir = Folder::new();
    let part = |name: &str| File::create(dir.join(name)).unwrap();
    drop(part(".gsvx-left.part"));
    drop(part("other.part"));
    let held = part(".gsvx-held.part");
    held.lock().unwrap();
    let target = dir.join("a.gsvx");
    ok("encode @ -o @", &[&model(), &target]);
    assert_eq!(names(&dir), [".gsvx-held.part", "a.gsvx", "other.part"]);
}

/// A limit on the size of files stands for a full disk: the write fails in the same place.
#[test]
fn without_space_the_old_file_stays() {
    let dir = Folder::new();
    let (stream, _) = outputs(&dir);
    std::fs::remove_file(dir.join("room.ply")).unwrap();
    for (words, input) in [("encode --force", model()), ("decode --force", stream.clone())] {
        let target = dir.join("target");
        std::fs::write(&target, b"old").unwrap();
        // The signal that comes with the limit is ignored, so that the write itself fails.
        let script = format!("trap '' XFSZ; ulimit -f 16; exec \"$0\" {words} \"$1\" -o \"$2\"");
        let out = Command::new("sh")
            .args(["-c", &script, env!("CARGO_BIN_EXE_gsvx")])
            .arg(&input)
            .arg(&target)
            .output()
            .unwrap();
        one_line(&out, "larger than the system allows");
        assert_eq!(std::fs::read(&target).unwrap(), b"old");
        assert_eq!(names(&dir), ["room.gsvx", "target"]);
    }
}

/// Runs `gsvx WORDS INPUT -o target` in a file system of its own, 64 kB small or read-only, that holds
/// a file `target`; `None` where this machine gives no such file system. Returns the run, what is in
/// the file system afterwards and what `target` then says.
#[cfg(target_os = "linux")]
fn on_its_own_file_system(
    words: &str,
    input: &Path,
    read_only: bool,
) -> Option<(Output, String, Vec<u8>)> {
    let dir = Folder::new();
    let (disk, after) = (dir.join("disk"), dir.join("after"));
    std::fs::create_dir(&disk).unwrap();
    let remount = if read_only { "mount -o remount,ro \"$1\" || exit 99;" } else { "" };
    // The mount is seen by these processes alone and ends with them.
    let script = format!(
        "mount -t tmpfs -o size=64k gsvx-test \"$1\" || exit 99; printf old > \"$1/target\"; {remount} \
         \"$0\" {words} \"$3\" -o \"$1/target\"; code=$?; \
         cp \"$1/target\" \"$2\"; ls -A \"$1\" > \"$2.names\"; exit $code"
    );
    let out = Command::new("unshare")
        .args(["-rm", "sh", "-c", &script, env!("CARGO_BIN_EXE_gsvx")])
        .args([&disk, &after])
        .arg(input)
        .output()
        .ok()?;
    let names = std::fs::read_to_string(after.with_extension("names")).ok()?;
    Some((out, names.trim_end().to_owned(), std::fs::read(&after).ok()?))
}

#[cfg(target_os = "linux")]
#[test]
fn on_a_full_or_read_only_file_system_the_old_file_stays() {
    let dir = Folder::new();
    let (stream, _) = outputs(&dir);
    // Larger than the disk: the room at the best quality, and its model.
    for (words, input) in
        [("encode --force --quality 100", model()), ("decode --force", stream.clone())]
    {
        for (read_only, needle) in [(false, "the disk is full"), (true, "cannot write here")] {
            let Some((out, names, content)) = on_its_own_file_system(words, &input, read_only)
            else {
                eprintln!("skipped: no mount namespaces here; the limit on file sizes stands in");
                return;
            };
            one_line(&out, needle);
            assert_eq!((names.as_str(), &content[..]), ("target", &b"old"[..]), "{words}");
        }
    }
    // One that fits replaces it.
    let words = "encode --force --quality 0";
    if let Some((out, names, content)) = on_its_own_file_system(words, &model(), false) {
        assert!(out.status.success() && names == "target");
        gsvx::decode(&content).unwrap();
    }
}

#[cfg(target_os = "linux")]
#[test]
fn a_target_that_cannot_be_written_is_named() {
    // No one can create files in /proc, root included.
    one_line(&run("encode @ -o /proc/a.gsvx", &[&model()]), "/proc: cannot write here");
    one_line(&run("encode @ -o /proc/version/a", &[&model()]), "no such directory");
}

/// Without a driver `auto` falls back to the processor and says so; `gpu` fails with one line.
#[test]
fn without_a_gpu_the_finetune_falls_back_or_says_so() {
    let dir = Folder::new();
    let input = dir.small();
    let tune = |backend: &str| {
        let words = "tune @ --orbit 6 --size 64x48 --effort quick -o @ --backend";
        let output = dir.join(format!("{backend}.gsvx"));
        // Where the Vulkan loader looks for drivers, in its old and its new name.
        command(&format!("{words} {backend}"), &[&input, &output])
            .env("VK_ICD_FILENAMES", "/nonexistent.json")
            .env("VK_DRIVER_FILES", "/nonexistent.json")
            .output()
            .unwrap()
    };
    let out = tune("auto");
    assert!(out.status.success() && heard(&out).contains("backend: cpu"), "{}", heard(&out));
    one_line(&tune("gpu"), "adapter");
    assert_eq!(names(&dir), ["auto.gsvx", "small.ply"]);
}
