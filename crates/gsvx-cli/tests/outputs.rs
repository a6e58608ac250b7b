//! Where outputs go: links, devices, modes, the input itself, targets out of reach.

mod common;

use common::{Folder, command, failed, gsvx, heard, ok, one_line, run, said, wrong_usage};
use std::path::Path;

#[test]
fn an_unreachable_target_ends_with_exit_code_3() {
    let dir = Folder::new();
    let (input, stream) = (dir.small(), dir.join("a.gsvx"));
    let out = run("encode @ -o @ --target-bytes 100", &[&input, &stream]);
    assert_eq!(out.status.code(), Some(3));
    assert!(heard(&out).contains("below the smallest stream"), "{}", heard(&out));
    // A warning of what is lost, and what was missed.
    let lines = common::lines(&out);
    let warned = lines[0].starts_with("warning: ") && lines[0].contains("the loss is easy to see");
    assert!(lines.len() == 2 && warned, "{lines:?}");
    // The best there is was written.
    let smallest = std::fs::read(&stream).unwrap();
    assert!(!gsvx::decode(&smallest).unwrap().is_empty());
    let words = "encode @ -o @ --force --cameras @ --target-psnr 90";
    let room = common::room();
    let out = run(&format!("{words} --json"), &[&input, &stream, &room]);
    assert_eq!(out.status.code(), Some(3));
    assert!(heard(&out).lines().last().unwrap().contains("not 90.00"), "{}", heard(&out));
    let report: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
    assert_eq!(report["target_reached"], false);
    assert!(std::fs::read(&stream).unwrap().len() > smallest.len());
}

#[test]
fn force_does_not_replace_the_input_itself() {
    let dir = Folder::new();
    let input = dir.small();
    let before = std::fs::read(&input).unwrap();
    let hard = dir.join("hard.bin");
    std::fs::hard_link(&input, &hard).unwrap();
    let mut others = vec![input.clone(), hard, dir.join(".").join("small.ply")];
    #[cfg(unix)]
    {
        let soft = dir.join("soft.bin");
        std::os::unix::fs::symlink(&input, &soft).unwrap();
        others.push(soft);
    }
    for output in others {
        let out = run("convert @ @ --to splat --force", &[&input, &output]);
        one_line(&out, "is the input itself");
    }
    assert!(std::fs::read(&input).unwrap() == before);
}

#[test]
fn the_extension_decides_the_format() {
    let dir = Folder::new();
    let (input, stream) = (dir.small(), dir.join("a.gsvx"));
    ok("encode @ -o @", &[&input, &stream]);
    for (name, start) in [("a.spz", &b"NGSP"[..]), ("a.ply", b"ply\n"), ("a.SPZ2", b"ply\n")] {
        ok("decode @ -o @", &[&stream, &dir.join(name)]);
        assert!(std::fs::read(dir.join(name)).unwrap().starts_with(start), "{name}");
    }
    ok("decode @ -o @", &[&stream, &dir.join("a.splat")]);
    assert_eq!(std::fs::metadata(dir.join("a.splat")).unwrap().len() % 32, 0);
    ok("decode @ -o @ --to spz", &[&stream, &dir.join("b")]);
    assert!(std::fs::read(dir.join("b")).unwrap().starts_with(b"NGSP"));
    wrong_usage(&run("decode @ -o @", &[&stream, &dir.join("b.gsvx")]), "gsvx encode");
    wrong_usage(&run("decode @ -o @", &[&stream, &dir.join("c.usdc")]), "gsvx.to_usd");
    wrong_usage(&run("encode @ -o @", &[&input, &dir.join("c.ply")]), "gsvx convert");
    wrong_usage(&run("render @ --orbit 1 -o @", &[&input, &dir.join("c.jpg")]), ".png");
    assert!(!dir.join("c.ply").exists() && !dir.join("b.gsvx").exists());
}

#[test]
fn coarse_positions_are_warned_of_for_every_form_of_an_output() {
    let dir = Folder::new();
    let input = dir.join("coarse.ply");
    let mut scene = testing::trained_like(400, 0, &mut testing::Rng::seeded(5));
    scene.means[0] = [5000.0, 0.0, 0.0];
    scene.log_scales.as_flattened_mut().iter_mut().for_each(|s| *s -= 9.0);
    gs_model::ply::write(&input, &scene).unwrap();
    for name in ["a.sog", "files/meta.json", "a.spz", "a.compressed.ply"] {
        let done = run("convert @ @", &[&input, &dir.join(name)]);
        assert!(done.status.success() && heard(&done).contains("positions in steps"), "{name}");
    }
}

#[cfg(unix)]
#[test]
fn outputs_have_the_mode_of_the_umask() {
    use std::os::unix::fs::PermissionsExt;
    let dir = Folder::new();
    let (input, output) = (dir.small(), dir.join("a.ply"));
    let mode = || std::fs::metadata(&output).unwrap().permissions().mode() & 0o777;
    for (umask, expected) in [("077", 0o600), ("022", 0o644), ("002", 0o664)] {
        let _ = std::fs::remove_file(&output);
        let script = format!("umask {umask}; exec \"$0\" convert \"$1\" \"$2\"");
        let mut shell = std::process::Command::new("sh");
        shell.args(["-c", &script, env!("CARGO_BIN_EXE_gsvx")]).args([&input, &output]);
        assert!(shell.output().unwrap().status.success());
        assert_eq!(mode(), expected, "umask {umask}");
    }
    // A replaced file keeps its mode.
    std::fs::set_permissions(&output, std::fs::Permissions::from_mode(0o640)).unwrap();
    ok("convert @ @ --force", &[&input, &output]);
    assert_eq!(mode(), 0o640);
}

#[cfg(unix)]
#[test]
fn the_file_that_a_link_names_is_replaced() {
    use std::os::unix::fs::symlink;
    let dir = Folder::new();
    let input = dir.small();
    std::fs::create_dir(dir.join("far")).unwrap();
    symlink("far/file.ply", dir.join("link.ply")).unwrap();
    symlink("link.ply", dir.join("second.ply")).unwrap();
    // First a link to nothing, then one to a file.
    ok("convert @ @", &[&input, &dir.join("second.ply")]);
    assert!(std::fs::read(dir.join("far/file.ply")).unwrap() == std::fs::read(&input).unwrap());
    one_line(&run("convert @ @", &[&input, &dir.join("link.ply")]), "--force");
    std::fs::write(dir.join("far/file.ply"), "old").unwrap();
    ok("convert @ @ --force", &[&input, &dir.join("link.ply")]);
    assert!(std::fs::read(dir.join("far/file.ply")).unwrap() == std::fs::read(&input).unwrap());
    for link in ["link.ply", "second.ply"] {
        assert!(std::fs::symlink_metadata(dir.join(link)).unwrap().is_symlink());
    }
    symlink("b", dir.join("a")).unwrap();
    symlink("a", dir.join("b")).unwrap();
    one_line(&run("convert @ @ --to ply", &[&input, &dir.join("a")]), "circle");
}

#[cfg(unix)]
#[test]
fn devices_are_written_to_and_a_full_one_is_an_error() {
    let dir = Folder::new();
    let (input, stream) = (dir.small(), dir.join("a.gsvx"));
    ok("encode @ -o @", &[&input, &stream]);
    ok("encode @ -o /dev/null", &[&input]);
    ok("decode @ -o /dev/null", &[&stream]);
    let piped = run("encode @ -o /dev/stdout", &[&input]);
    assert!(piped.status.success() && piped.stdout == std::fs::read(&stream).unwrap());
    if !Path::new("/dev/full").exists() {
        return;
    }
    one_line(&run("encode @ -o /dev/full", &[&input]), "the disk is full");
    let full = std::fs::File::options().write(true).open("/dev/full").unwrap();
    let out = gsvx().arg("info").arg(&stream).stdout(full).output().unwrap();
    one_line(&out, "could not be written");
}

/// A report that nobody reads is no error; data that nobody reads is, but a quiet
/// one.
#[cfg(unix)]
#[test]
fn a_closed_pipe_ends_the_command_without_a_word() {
    let dir = Folder::new();
    let (input, stream) = (dir.small(), dir.join("a.gsvx"));
    ok("encode @ -o @", &[&input, &stream]);
    for (line, code) in [("decode @ -o -", 141), ("info @", 0)] {
        let (reader, writer) = std::io::pipe().unwrap();
        drop(reader);
        let out = command(line, &[&stream]).stdout(writer).output().unwrap();
        assert_eq!((out.status.code(), heard(&out).as_str()), (Some(code), ""));
    }
}

#[test]
fn names_cannot_steer_the_terminal() {
    let dir = Folder::new();
    let input = dir.small();
    let absent = run("info a\x1b[31m\u{9b}2J.gsvx", &[]);
    one_line(&absent, "a\\u{1b}[31m\\u{9b}2J.gsvx");
    // A column of another name, which is not zero.
    let mut bytes = std::fs::read(&input).unwrap();
    let find = |text: &[u8]| bytes.windows(text.len()).position(|w| w == text).unwrap();
    let (name, rows) = (find(b" nx") + 1, find(b"end_header\n") + 11);
    bytes[name] = 0x1b;
    bytes[rows + 12..rows + 16].copy_from_slice(&1f32.to_le_bytes());
    std::fs::write(&input, bytes).unwrap();
    let out = run("info @", &[&input]);
    let text = said(&out) + &heard(&out);
    assert!(!text.contains('\x1b'), "{text}");
}

#[test]
fn what_lossy_coding_cannot_hold_is_named_as_the_file_counts() {
    let dir = Folder::new();
    let (input, stream) = (dir.join("a.ply"), dir.join("a.gsvx"));
    let mut scene = common::scene();
    // Sorting moves it.
    let at = 7 * scene.sh_len();
    scene.sh[at][1] = 1e6;
    gs_model::ply::write(&input, &scene).unwrap();
    let encode = "encode @ -o @";
    for more in ["", " --memory 1G"] {
        let out = run(&format!("{encode}{more}"), &[&input, &stream]);
        failed(&out, "Gaussian 7 has a value of 1e6 (SH coefficient)");
        assert!(
            heard(&out).ends_with("pass --lossless, or --drop-invalid to leave it out"),
            "{}",
            heard(&out)
        );
    }
    ok(&format!("{encode} --lossless"), &[&input, &stream]);
}

#[test]
fn wrong_values_are_wrong_usage() {
    let dir = Folder::new();
    let (input, out) = (dir.small(), dir.join("a.gsvx"));
    let encode = "quality 101,quality nan,prune 1,target-mbit 0,target-bytes 0,target-bytes 1XB,preset huge,qp 28;4;4,\
                  target-psnr inf --cameras x,preset web --quality 60";
    let render = "scale 0,fov 200,elevation 90,orbit-radius 0,up w,background 1;2;3,background 1;0";
    for (line, wrong) in [("encode @ -o @", encode), ("render @ --orbit 1 -o @", render)] {
        for wrong in wrong.split(',') {
            let out = run(&format!("{line} --{}", wrong.replace(';', ",")), &[&input, &out]);
            wrong_usage(&out, wrong.split(' ').next().unwrap());
        }
    }
}
