//! What a task needs is there, or installed, or named before anything is compiled.
#![allow(unused_crate_dependencies, reason = "an integration test of the binary")]
#![cfg(unix)]

use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;
use std::process::Command;

/// Runs `xtask web` where there are only these programs; what it says.
fn web(programs: &Path) -> String {
    let mut xtask = Command::new(env!("CARGO_BIN_EXE_xtask"));
    let out = xtask.arg("web").env("PATH", programs).output().unwrap();
    assert_eq!(out.status.code(), Some(1));
    String::from_utf8(out.stderr).unwrap()
}

fn program(folder: &Path, name: &str, script: &str) {
    let path = folder.join(name);
    fs::write(&path, format!("#!/bin/sh\n{script}\n")).unwrap();
    fs::set_permissions(&path, fs::Permissions::from_mode(0o755)).unwrap();
}

#[test]
fn all_that_is_missing_is_named_at_once_with_its_remedy() {
    let nothing = tempfile::tempdir().unwrap();
    let said = web(nothing.path());
    assert_eq!(said.trim_end().lines().count(), 1, "{said}");
    assert!(said.contains("`rustup target add wasm32-unknown-unknown`"), "{said}");
    assert!(said.contains("Node 20 or later") && said.contains("https://nodejs.org"), "{said}");
    // An old Node is none.
    program(nothing.path(), "npm", "echo 9.2.0");
    program(nothing.path(), "node", "echo v18.20.4");
    assert!(web(nothing.path()).contains("Node 20 or later"));
}

#[test]
fn a_target_that_is_missing_is_installed() {
    let dir = tempfile::tempdir().unwrap();
    let target = dir.path().join("target");
    let shown = target.display();
    program(dir.path(), "rustc", &format!("echo {shown}"));
    program(dir.path(), "rustup", &format!("/bin/mkdir {shown} && echo > {shown}/\"$*\""));
    program(dir.path(), "node", "echo v20.11.0");
    program(dir.path(), "npm", "echo 10.2.4");
    program(dir.path(), "cargo", "exit 1");
    let said = web(dir.path());
    assert!(target.join("target add wasm32-unknown-unknown").is_file(), "{said}");
    assert!(said.starts_with("installing: rustup target add"), "{said}");
    assert!(said.contains("gsvx-web does not build"), "{said}");
}
