//! The example finds the installed library by CMake and by pkg-config, and the README's program compiles.
#![cfg(unix)]
#![allow(missing_docs, reason = "a test")]

mod common;

use common::{compiled, found, guarded, here, library, run};
use std::path::Path;
use std::process::Command;

const GOLDEN: &str = "../../fixtures/streams/lod.gsvx";

/// Puts header, library and CMake's file where `cargo cinstall` puts them.
fn install(prefix: &Path) {
    let name = format!("{}gsvx{}", std::env::consts::DLL_PREFIX, std::env::consts::DLL_SUFFIX);
    let files = [
        (here("include/gsvx.h"), prefix.join("include/gsvx.h")),
        (library(), prefix.join("lib").join(name)),
        (here("cmake/gsvx-config.cmake"), prefix.join("share/gsvx/cmake/gsvx-config.cmake")),
    ];
    for (from, to) in files {
        std::fs::create_dir_all(to.parent().expect("a folder")).expect("a folder");
        std::fs::copy(&from, &to).unwrap_or_else(|e| panic!("{}: {e}", from.display()));
    }
}

/// `GSVX_PREFIX` names what `cargo cinstall` made; without it the files of this build are put in its places.
#[test]
fn cmake_finds_the_library_and_the_example_runs() {
    if !found("cmake") || !found("cc") {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let prefix = std::env::var_os("GSVX_PREFIX")
        .map_or_else(|| folder.path().into(), std::path::PathBuf::from);
    if std::env::var_os("GSVX_PREFIX").is_none() {
        install(&prefix);
    }
    let build = folder.path().join("build");
    let mut configure = Command::new("cmake");
    configure
        .arg("-S")
        .arg(here("example"))
        .arg("-B")
        .arg(&build)
        .arg("-DCMAKE_C_FLAGS=-Wall -Wextra -Werror");
    run(configure.arg(format!("-DCMAKE_PREFIX_PATH={}", prefix.display())));
    run(Command::new("cmake").arg("--build").arg(&build));
    let mut bounds = Command::new(build.join("bounds"));
    let libraries = prefix.join("lib");
    bounds.env("LD_LIBRARY_PATH", &libraries).env("DYLD_LIBRARY_PATH", &libraries);
    let text = String::from_utf8(run(bounds.arg(here(GOLDEN))).stdout).expect("text");
    let index =
        gsvx::Index::parse(&std::fs::read(here(GOLDEN)).expect("a golden")).expect("a golden");
    let start = format!("{} Gaussians in {} chunks, from ", index.header.count, index.chunks.len());
    assert!(text.starts_with(&start), "{text}");
}

#[test]
fn the_program_of_the_readme_decodes_a_stream() {
    let readme = std::fs::read_to_string(here("README.md")).expect("README.md");
    let (_, rest) = readme.split_once("```c decode\n").expect("a program");
    let (program, _) = rest.split_once("```").expect("its end");
    let folder = tempfile::tempdir().expect("a folder");
    let source = folder.path().join("readme.c");
    let golden = here("../../fixtures/streams/chunks.gsvx");
    let main = format!("{program}\n{MAIN}");
    std::fs::write(&source, main).expect("a source");
    let Some(program) = compiled(&source, folder.path()) else { return };
    let out = run(guarded(&program).arg(&golden)).stdout;
    let scene = gsvx::decode(&std::fs::read(&golden).expect("a golden")).expect("a golden");
    let expected: Vec<u8> =
        scene.means.as_flattened().iter().flat_map(|v| v.to_ne_bytes()).collect();
    assert!(out == expected, "{} bytes, not {}", out.len(), expected.len());
}

/// What the README leaves to its reader.
const MAIN: &str = r#"
#include "file.h"
static void write_means(float *means, uint64_t count) { fwrite(means, 12, (size_t)count, stdout); }
int main(int count, char **arguments) {
    size_t size = 0;
    static float means[30000];
    unsigned char *bytes = count == 2 ? read_file(arguments[1], &size) : NULL;
    if (bytes == NULL) return 2;
    gsvx_status status = each_chunk(bytes, size, means, sizeof means, write_means);

    free(bytes);
    return status == GSVX_STATUS_OK ? 0 : 1;
}
"#;
