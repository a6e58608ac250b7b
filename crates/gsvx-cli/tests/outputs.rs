//! Where outputs go: links, devices, modes, the input itself, targets out of reach.

mod common;

use common::{failed, gsvx, heard, ok, one_line, run, said, small, wrong_usage};
use std::path::Path;

#[test]
fn an_unreachable_target_ends_with_exit_code_3() {
    let dir = tempfile::tempdir().unwrap();
    let (input, stream) = (small(dir.path()), dir.path().join("a.gsvx"));
    let out = run(&["encode", "@", "-o", "@", "--target-bytes", "100"], &[&input, &stream]);
    assert_eq!(out.status.code(), Some(3));
    assert!(heard(&out).contains("below the smallest stream"), "{}", heard(&out));
    // A warning of what is lost, and what was missed.
    let text = heard(&out);
    let lines: Vec<&str> = text.lines().collect();
    assert!(
        lines.len() == 2
            && lines[0].starts_with("warning: ")
            && lines[0].contains("the loss is easy to see"),
        "{text}"
    );
    // The best there is was written.
    let smallest = std::fs::read(&stream).unwrap();
    assert!(!gsvx::decode(&smallest).unwrap().is_empty());
    let words = ["encode", "@", "-o", "@", "--force", "--cameras", "@", "--target-psnr", "90"];
    let room = common::room();
    let out = run(&[&words[..], &["--json"]].concat(), &[&input, &stream, &room]);
    assert_eq!(out.status.code(), Some(3));
    assert!(heard(&out).lines().last().unwrap().contains("not 90.00"), "{}", heard(&out));
    let report: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
    assert_eq!(report["target_reached"], false);
    assert!(std::fs::read(&stream).unwrap().len() > smallest.len());
}

#[test]
fn force_does_not_replace_the_input_itself() {
    let dir = tempfile::tempdir().unwrap();
    let input = small(dir.path());
    let before = std::fs::read(&input).unwrap();
    let hard = dir.path().join("hard.bin");
    std::fs::hard_link(&input, &hard).unwrap();
    let mut others = vec![input.clone(), hard, dir.path().join(".").join("small.ply")];
    #[cfg(unix)]
    {
        let soft = dir.path().join("soft.bin");
        std::os::unix::fs::symlink(&input, &soft).unwrap();
        others.push(soft);
    }
    for output in others {
        let out = run(&["convert", "@", "@", "--to", "splat", "--force"], &[&input, &output]);
        one_line(&out, "is the input itself");
    }
    assert!(std::fs::read(&input).unwrap() == before);
}

#[test]
fn the_extension_decides_the_format() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    let (input, stream) = (small(dir.path()), at("a.gsvx"));
    ok(&["encode", "@", "-o", "@"], &[&input, &stream]);
    for (name, start) in [("a.spz", &b"NGSP"[..]), ("a.ply", b"ply\n"), ("a.SPZ2", b"ply\n")] {
        ok(&["decode", "@", "-o", "@"], &[&stream, &at(name)]);
        assert!(std::fs::read(at(name)).unwrap().starts_with(start), "{name}");
    }
    ok(&["decode", "@", "-o", "@"], &[&stream, &at("a.splat")]);
    assert_eq!(std::fs::metadata(at("a.splat")).unwrap().len() % 32, 0);
    ok(&["decode", "@", "-o", "@", "--to", "spz"], &[&stream, &at("b")]);
    assert!(std::fs::read(at("b")).unwrap().starts_with(b"NGSP"));
    wrong_usage(&run(&["decode", "@", "-o", "@"], &[&stream, &at("b.gsvx")]), "gsvx encode");
    wrong_usage(&run(&["encode", "@", "-o", "@"], &[&input, &at("c.ply")]), "gsvx convert");
    wrong_usage(&run(&["render", "@", "--orbit", "1", "-o", "@"], &[&input, &at("c.jpg")]), ".png");
    assert!(!at("c.ply").exists() && !at("b.gsvx").exists());
}

#[cfg(unix)]
#[test]
fn outputs_have_the_mode_of_the_umask() {
    use std::os::unix::fs::PermissionsExt;
    let dir = tempfile::tempdir().unwrap();
    let (input, output) = (small(dir.path()), dir.path().join("a.ply"));
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
    ok(&["convert", "@", "@", "--force"], &[&input, &output]);
    assert_eq!(mode(), 0o640);
}

#[cfg(unix)]
#[test]
fn the_file_that_a_link_names_is_replaced() {
    use std::os::unix::fs::symlink;
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    let input = small(dir.path());
    std::fs::create_dir(at("far")).unwrap();
    symlink("far/file.ply", at("link.ply")).unwrap();
    symlink("link.ply", at("second.ply")).unwrap();
    // First a link to nothing, then one to a file.
    ok(&["convert", "@", "@"], &[&input, &at("second.ply")]);
    assert!(std::fs::read(at("far/file.ply")).unwrap() == std::fs::read(&input).unwrap());
    one_line(&run(&["convert", "@", "@"], &[&input, &at("link.ply")]), "--force");
    std::fs::write(at("far/file.ply"), "old").unwrap();
    ok(&["convert", "@", "@", "--force"], &[&input, &at("link.ply")]);
    assert!(std::fs::read(at("far/file.ply")).unwrap() == std::fs::read(&input).unwrap());
    for link in ["link.ply", "second.ply"] {
        assert!(std::fs::symlink_metadata(at(link)).unwrap().is_symlink());
    }
    symlink("b", at("a")).unwrap();
    symlink("a", at("b")).unwrap();
    one_line(&run(&["convert", "@", "@", "--to", "ply"], &[&input, &at("a")]), "circle");
}

#[cfg(unix)]
#[test]
fn devices_are_written_to_and_a_full_one_is_an_error() {
    let dir = tempfile::tempdir().unwrap();
    let (input, stream) = (small(dir.path()), dir.path().join("a.gsvx"));
    ok(&["encode", "@", "-o", "@"], &[&input, &stream]);
    ok(&["encode", "@", "-o", "/dev/null"], &[&input]);
    ok(&["decode", "@", "-o", "/dev/null"], &[&stream]);
    let piped = run(&["encode", "@", "-o", "/dev/stdout"], &[&input]);
    assert!(piped.status.success() && piped.stdout == std::fs::read(&stream).unwrap());
    if !Path::new("/dev/full").exists() {
        return;
    }
    one_line(&run(&["encode", "@", "-o", "/dev/full"], &[&input]), "the disk is full");
    let full = std::fs::File::options().write(true).open("/dev/full").unwrap();
    let out = gsvx().arg("info").arg(&stream).stdout(full).output().unwrap();
    one_line(&out, "could not be written");
}

/// A report that nobody reads is no error; data that nobody reads is, but a quiet
/// one.
#[cfg(unix)]
#[test]
fn a_closed_pipe_ends_the_command_without_a_word() {
    let dir = tempfile::tempdir().unwrap();
    let (input, stream) = (small(dir.path()), dir.path().join("a.gsvx"));
    ok(&["encode", "@", "-o", "@"], &[&input, &stream]);
    let closed = |words: &[&str], input: &Path| {
        let (reader, writer) = std::io::pipe().unwrap();
        drop(reader);
        gsvx().args(words).arg(input).args(["-o", "-"]).stdout(writer).output().unwrap()
    };
    let out = closed(&["decode"], &stream);
    assert_eq!((out.status.code(), heard(&out).as_str()), (Some(141), ""));
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    let out = gsvx().arg("info").arg(&stream).stdout(writer).output().unwrap();
    assert_eq!((out.status.code(), heard(&out).as_str()), (Some(0), ""));
}

#[test]
fn names_cannot_steer_the_terminal() {
    let dir = tempfile::tempdir().unwrap();
    let input = small(dir.path());
    let absent = run(&["info", "a\x1b[31m\u{9b}2J.gsvx"], &[]);
    one_line(&absent, "a\\u{1b}[31m\\u{9b}2J.gsvx");
    // A column of another name, which is not zero.
    let mut bytes = std::fs::read(&input).unwrap();
    let find = |text: &[u8]| bytes.windows(text.len()).position(|w| w == text).unwrap();
    let (name, rows) = (find(b" nx") + 1, find(b"end_header\n") + 11);
    bytes[name] = 0x1b;
    bytes[rows + 12..rows + 16].copy_from_slice(&1f32.to_le_bytes());
    std::fs::write(&input, bytes).unwrap();
    let out = run(&["info", "@"], &[&input]);
    let text = said(&out) + &heard(&out);
    assert!(!text.contains('\x1b'), "{text}");
}

#[test]
fn what_lossy_coding_cannot_hold_is_named_as_the_file_counts() {
    let dir = tempfile::tempdir().unwrap();
    let (input, stream) = (dir.path().join("a.ply"), dir.path().join("a.gsvx"));
    let mut scene = common::scene();
    // Sorting moves it.
    let at = 7 * scene.sh_len();
    scene.sh[at][1] = 1e6;
    gs_model::ply::write(&input, &scene).unwrap();
    let encode = ["encode", "@", "-o", "@"];
    for more in [&[][..], &["--memory", "1G"]] {
        let out = run(&[&encode[..], more].concat(), &[&input, &stream]);
        failed(&out, "Gaussian 7 has a value of 1e6 (SH coefficient)");
        assert!(
            heard(&out).ends_with("pass --lossless, or --drop-invalid to leave it out"),
            "{}",
            heard(&out)
        );
    }
    ok(&[&encode[..], &["--lossless"]].concat(), &[&input, &stream]);
}

#[test]
fn wrong_values_are_wrong_usage() {
    let dir = tempfile::tempdir().unwrap();
    let (input, out) = (small(dir.path()), dir.path().join("a.gsvx"));
    for wrong in [
        &["--quality", "101"][..],
        &["--quality", "nan"],
        &["--prune", "1"],
        &["--target-mbit", "0"],
        &["--target-bytes", "0"],
        &["--target-bytes", "1XB"],
        &["--preset", "huge"],
        &["--qp", "28,4,4"],
        &["--target-psnr", "inf", "--cameras", "x"],
        &["--preset", "web", "--quality", "60"],
    ] {
        wrong_usage(
            &run(&[&["encode", "@", "-o", "@"], wrong].concat(), &[&input, &out]),
            wrong[0],
        );
    }
    for wrong in [
        &["--scale", "0"][..],
        &["--fov", "200"],
        &["--elevation", "90"],
        &["--orbit-radius", "0"],
        &["--up", "w"],
        &["--background", "1,2,3"],
        &["--background", "1,0"],
    ] {
        let words = [&["render", "@", "--orbit", "1", "-o", "@"], wrong].concat();
        wrong_usage(&run(&words, &[&input, &dir.path().join("a.png")]), wrong[0]);
    }
}

/// `timeout` and service managers send SIGTERM, some to the process and to its
/// group.
#[cfg(unix)]
#[test]
fn a_terminated_finetune_writes_what_it_has_reached() {
    use std::process::{Command, Stdio};
    for signals in [&["-TERM"][..], &["-INT"], &["-TERM", "-TERM"]] {
        let dir = tempfile::tempdir().unwrap();
        let output = dir.path().join("tuned.ply");
        let mut child = gsvx()
            .args(["tune", "--profile", "paper"])
            .arg(small(dir.path()))
            .arg("--cameras")
            .arg(common::room())
            .args(["--steps", "1000000", "--patience", "0", "--past-input", "--backend", "cpu"])
            .args(["--force-photos", "--checkpoint"])
            .arg(dir.path().join("c.ckpt"))
            .args(["--checkpoint-every", "1", "-o"])
            .arg(&output)
            .stderr(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        // A checkpoint shows that the tuning has begun.
        while !dir.path().join("c.ckpt").exists() {
            assert!(child.try_wait().unwrap().is_none(), "ended before it was interrupted");
            std::thread::sleep(std::time::Duration::from_millis(5));
        }
        for signal in signals {
            Command::new("kill").args([signal, child.id().to_string().as_str()]).status().unwrap();
        }
        let out = child.wait_with_output().unwrap();
        assert!(said(&out).contains("interrupted"), "{signals:?}: {}", heard(&out));
        assert!(!gs_model::ply::read(&output).unwrap().0.is_empty());
    }
}
