//! What the tests of this crate share: compilers, programs, golden streams.
#![allow(dead_code, reason = "each test binary uses a part")]

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// A path in this crate.
pub(crate) fn here(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(path)
}

/// The shared library that was built for the tests.
pub(crate) fn library() -> PathBuf {
    let test = std::env::current_exe().expect("the test has a path");
    let name = format!("{}gsvx_c{}", std::env::consts::DLL_PREFIX, std::env::consts::DLL_SUFFIX);
    test.parent().expect("a folder").join(name)
}

/// True if a tool is installed; otherwise a loud line.
pub(crate) fn found(tool: &str) -> bool {
    let found = Command::new(tool).arg("--version").output().is_ok_and(|o| o.status.success());
    if !found {
        eprintln!("SKIPPED: {tool} is not installed; a part of the C interface is not tested");
    }
    found
}

/// Runs a command that must succeed.
pub(crate) fn run(command: &mut Command) -> Output {
    let out = command.output().unwrap_or_else(|e| panic!("{command:?}: {e}"));
    let text = |bytes: &[u8]| String::from_utf8_lossy(&bytes[..bytes.len().min(4000)]).into_owned();
    assert!(
        out.status.success(),
        "{command:?}: {}\n{}\n{}",
        out.status,
        text(&out.stdout),
        text(&out.stderr)
    );
    out
}

/// Compiles a program against header and library; without a compiler there is none.
pub(crate) fn compiled(source: &Path, folder: &Path) -> Option<PathBuf> {
    let is_c = source.extension().is_some_and(|e| e == "c");
    let (compiler, standard) = if is_c { ("cc", "-std=c99") } else { ("c++", "-std=c++17") };
    if !found(compiler) {
        return None;
    }
    let (program, library) = (folder.join("program"), library());
    let deps = library.parent().expect("a folder");
    let mut command = Command::new(compiler);
    command.args([standard, "-g", "-Wall", "-Wextra", "-Werror", "-pedantic", "-pthread", "-I"]);
    command.arg(here("include")).arg("-I").arg(here("tests/c")).arg(source).arg("-o").arg(&program);
    command.arg(&library).arg(format!("-Wl,-rpath,{}", deps.display()));
    run(&mut command);
    Some(program)
}

/// A program under valgrind, which fails on any error and on memory that is lost; without valgrind the program alone.
pub(crate) fn guarded(program: &Path) -> Command {
    if !found("valgrind") {
        return Command::new(program);
    }
    let mut command = Command::new("valgrind");
    command.args([
        "--quiet",
        "--error-exitcode=9",
        "--leak-check=full",
        "--errors-for-leak-kinds=definite",
    ]);
    command.arg(program);
    command
}

/// The golden streams: name, path.
pub(crate) fn goldens() -> Vec<(String, PathBuf)> {
    let folder = here("../../fixtures/streams");
    let list = std::fs::read_to_string(folder.join("hashes.txt")).expect("hashes.txt is there");
    let names = list.lines().filter(|l| !l.starts_with('#')).filter_map(|l| l.split("  ").nth(1));
    let all: Vec<_> = names.map(|name| (name.to_owned(), folder.join(name))).collect();
    assert!(!all.is_empty());
    all
}
