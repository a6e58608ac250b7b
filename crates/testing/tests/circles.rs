//! Data flows one way: no files of a crate import each other in a circle.
//!
//! An arrow leads from a file to the file that defines what it names in a `use`. Re-exports are followed. A file and
//! the files of its own folder count as parts of one module, so arrows between them do not count.
#![allow(missing_docs, reason = "a test")]

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

type Module = Vec<String>;

/// The files of a crate by module path, without tests.
fn files(folder: &Path, module: &Module, out: &mut BTreeMap<Module, PathBuf>) {
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        if stem == "tests" || stem.ends_with("_tests") {
            continue;
        }
        let mut inner = module.clone();
        let is_root = ["lib", "main", "mod"].contains(&stem.as_str());
        if !is_root {
            inner.push(stem);
        }
        if path.is_dir() {
            files(&path, &inner, out);
        } else if path.extension().is_some_and(|e| e == "rs") {
            out.insert(inner, path);
        }
    }
}

/// The source without comments and without its tests at the end.
fn code(path: &Path) -> String {
    let text = std::fs::read_to_string(path).expect("a source file");
    let lines = text.lines().take_while(|line| !line.starts_with("#[cfg(test)]"));
    lines.map(|line| line.split("//").next().unwrap_or_default()).collect::<Vec<_>>().join(" ")
}

/// The paths of `a::{b, c::{d, e}}`.
fn paths(tree: &str) -> Vec<String> {
    let Some((front, rest)) = tree.split_once('{') else {
        return vec![tree.trim().to_owned()];
    };
    let body = rest.rsplit_once('}').map_or(rest, |(body, _)| body);
    let (mut depth, mut parts) = (0, vec![String::new()]);
    for c in body.chars() {
        depth += i32::from(c == '{') - i32::from(c == '}');
        match c {
            ',' if depth == 0 => parts.push(String::new()),
            _ => parts.last_mut().expect("a part").push(c),
        }
    }
    parts.retain(|part| !part.trim().is_empty());
    parts.iter().flat_map(|part| paths(&format!("{}{}", front.trim(), part.trim()))).collect()
}

/// What a file names: the paths from the root of the crate, and the name under which each is re-exported, if
/// it is.
fn named(
    module: &Module,
    text: &str,
    known: &BTreeMap<Module, PathBuf>,
) -> Vec<(Module, Option<String>)> {
    let mut out = Vec::new();
    for (at, _) in text.match_indices("use ") {
        let before = text[..at].trim_end();
        if !before.is_empty()
            && !before.ends_with([';', '}', ']', '{', ')'])
            && !before.ends_with("pub")
        {
            continue;
        }
        let tree = text[at + 4..].split(';').next().unwrap_or_default();
        let is_export = before.ends_with("pub") || before.ends_with(')');
        for path in paths(tree) {
            let (path, alias) = path.split_once(" as ").unwrap_or((&path, ""));
            let mut names: Module = path.split("::").map(|n| n.trim().to_owned()).collect();
            let mut base = Vec::new();
            match names[0].as_str() {
                "crate" => drop(names.remove(0)),
                "self" => {
                    names.remove(0);
                    base.clone_from(module);
                }
                "super" => {
                    base = module.clone();
                    while names.first().is_some_and(|n| n == "super") {
                        names.remove(0);
                        base.pop();
                    }
                }
                first => {
                    let child = [&module[..], &[first.to_owned()]].concat();
                    if !known.contains_key(&child) {
                        continue;
                    }
                    base = module.clone();
                }
            }
            let own = if alias.is_empty() { names.last().cloned() } else { Some(alias.into()) };
            let exported = own.filter(|_| is_export);
            out.push((base.into_iter().chain(names).collect(), exported));
        }
    }
    out
}

/// The file that defines a path, through re-exports.
fn defining(
    path: &Module,
    known: &BTreeMap<Module, PathBuf>,
    exports: &BTreeMap<Module, Module>,
) -> Option<Module> {
    if let Some(other) = exports.get(path).filter(|&other| other != path) {
        return defining(other, known, exports);
    }
    (0..=path.len()).rev().map(|n| path[..n].to_vec()).find(|module| known.contains_key(module))
}

/// Arrows between the files of a crate.
fn arrows(source: &Path) -> BTreeMap<Module, BTreeSet<Module>> {
    let mut known = BTreeMap::new();
    files(source, &Vec::new(), &mut known);
    let all: Vec<_> =
        known.iter().map(|(module, path)| (module, named(module, &code(path), &known))).collect();
    let mut exports = BTreeMap::new();
    for (module, names) in &all {
        for (path, name) in names.iter().filter_map(|(path, name)| Some((path, name.clone()?))) {
            exports.insert(module.iter().cloned().chain([name]).collect(), path.clone());
        }
    }
    let of = |(module, names): &(&Module, Vec<(Module, Option<String>)>)| {
        let used = names.iter().filter(|(_, exported)| exported.is_none());
        let to = used.filter_map(|(path, _)| defining(path, &known, &exports));
        let is_apart = |to: &Module| !to.starts_with(module) && !module.starts_with(to);
        ((*module).clone(), to.filter(is_apart).collect())
    };
    all.iter().map(of).collect()
}

/// A circle that goes through a file.
fn circle(from: &Module, arrows: &BTreeMap<Module, BTreeSet<Module>>) -> Option<Vec<String>> {
    let mut seen = BTreeSet::new();
    let mut ways = vec![vec![from.clone()]];
    while let Some(way) = ways.pop() {
        for next in arrows.get(way.last()?).into_iter().flatten() {
            if next == from {
                return Some(way.iter().map(|m| m.join("/")).collect());
            }
            if seen.insert(next.clone()) {
                ways.push([&way[..], std::slice::from_ref(next)].concat());
            }
        }
    }
    None
}

#[test]
fn no_files_of_a_crate_import_each_other_in_a_circle() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let crates = std::fs::read_dir(root.join("crates")).expect("crates");
    let mut sources: Vec<_> = crates.flatten().map(|e| e.path().join("src")).collect();
    sources.push(root.join("xtask/src"));
    sources.sort();
    let mut found = 0;
    for source in sources {
        let arrows = arrows(&source);
        found += arrows.values().map(BTreeSet::len).sum::<usize>();
        for from in arrows.keys() {
            let circle = circle(from, &arrows);
            assert!(circle.is_none(), "{}: {}", source.display(), circle.unwrap().join(" -> "));
        }
    }
    assert!(found > 500, "only {found} arrows were found");
}

#[test]
fn a_circle_is_found_through_a_re_export() {
    let folder = tempfile::tempdir().expect("a folder");
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    write("lib.rs", "mod a;\nmod b;\npub use b::B;\n");
    write("a.rs", "use crate::{B};\npub struct A;\n");
    write("b.rs", "pub struct B;\n");
    let from = vec!["a".to_owned()];
    assert_eq!(circle(&from, &arrows(folder.path())), None);
    write("b.rs", "use super::a::A;\npub struct B;\n");
    assert_eq!(circle(&from, &arrows(folder.path())), Some(vec!["a".into(), "b".into()]));
}
