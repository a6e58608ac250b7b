//! What a reader copies from a README builds.
#![allow(unused_crate_dependencies, reason = "an integration test of documents")]

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::Command;

const GIT: &str = "git = \"https://github.com/gsvx/gsvx\"";

/// The folder of a package of the workspace: what cargo looks for in the repository.
fn folder_of(root: &Path, package: &str) -> String {
    let folders = fs::read_dir(root.join("crates")).unwrap().map(|e| e.unwrap().path());
    let name = format!("name = \"{package}\"");
    let is_it = |folder: &std::path::PathBuf| {
        let text = fs::read_to_string(folder.join("Cargo.toml")).unwrap_or_default();
        text.lines().find(|l| l.starts_with("name = ")) == Some(&name)
    };
    let found: Vec<_> = folders.filter(is_it).collect();
    assert!(found.len() == 1, "no matching package named `{package}` found");
    found[0].display().to_string()
}

/// A scratch crate of the dependency lines of all READMEs, with the repository's folders instead of its address.
#[test]
fn the_dependency_lines_of_the_readmes_build() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().nth(2).unwrap();
    let mut readmes = vec![root.join("README.md")];
    let crates = fs::read_dir(root.join("crates")).unwrap();
    readmes.extend(crates.map(|e| e.unwrap().path().join("README.md")));
    let mut lines: BTreeMap<String, String> = BTreeMap::new();
    for readme in &readmes {
        let text = fs::read_to_string(readme).unwrap_or_default();
        for line in text.lines().filter(|l| l.contains(GIT)) {
            let end = line.find(GIT).unwrap();
            let start = line[..end].rfind('`').map_or(0, |at| at + 1);
            let spec = line[start..].split(['`', '#']).next().unwrap().trim();
            let key = spec.split(' ').next().unwrap();
            let package = spec.split("package = \"").nth(1).and_then(|rest| rest.split('"').next());
            let folder = folder_of(root, package.unwrap_or(key));
            let spec = spec.replace(GIT, &format!("path = {folder:?}"));
            lines.entry(key.to_owned()).or_insert(spec);
        }
    }
    let keys: Vec<&str> = lines.keys().map(String::as_str).collect();
    let manifest = fs::read_to_string(root.join("Cargo.toml")).unwrap();
    let published = |l: &&str| l.contains("path = \"crates/") && l.contains("version = ");
    for library in manifest.lines().filter(published).map(|l| l.split(' ').next().unwrap()) {
        assert!(keys.contains(&library), "no README says how to depend on {library}");
    }
    let scratch = Path::new(env!("CARGO_TARGET_TMPDIR")).join("readmes");
    fs::create_dir_all(scratch.join("src")).unwrap();
    let specs: String = lines.values().map(|spec| format!("{spec}\n")).collect();
    let head = "[package]\nname = \"scratch\"\nedition = \"2024\"\n[workspace]\n[dependencies]\n";
    fs::write(scratch.join("Cargo.toml"), format!("{head}{specs}")).unwrap();
    fs::copy(root.join("Cargo.lock"), scratch.join("Cargo.lock")).unwrap();
    let uses = keys.iter().map(|key| format!("pub use {};\n", key.replace('-', "_")));
    fs::write(scratch.join("src/lib.rs"), uses.collect::<String>()).unwrap();
    let cargo = Command::new(env!("CARGO"))
        .args(["check", "--offline", "--quiet", "--target-dir", "target"])
        .current_dir(&scratch)
        .output()
        .unwrap();
    assert!(cargo.status.success(), "{}", String::from_utf8_lossy(&cargo.stderr));
}
