//! Data flows one way: no files of a crate import each other in a circle.
//!
//! An arrow leads from a file to the file that defines what it names, in a `use` or where it needs it. Re-exports are
//! followed. What a file names of the modules that it is part of does not count, nor what only tests compile.
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

/// The source without comments and without the items that only tests compile.
fn code(path: &Path) -> String {
    let text = std::fs::read_to_string(path).expect("a source file");
    let mut lines = text.lines().map(|line| line.split("//").next().unwrap_or_default());
    let mut code = String::new();
    while let Some(line) = lines.next() {
        if line.trim_start().starts_with("#[cfg(test)]") {
            let indent = &line[..line.len() - line.trim_start().len()];
            let is_outer = |l: &str| l.strip_prefix(indent).is_some_and(|l| !l.starts_with(' '));
            lines.find(|l| is_outer(l) && l.ends_with([';', '}', ',']));
        } else {
            code.extend([line, " "]);
        }
    }
    code
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

/// A path from the root of the crate which a file names.
struct NamedPath {
    path: Module,
    /// The name that the file gives it with `use`.
    alias: Option<String>,
    is_export: bool,
}

/// The path from the root of the crate of one that a file writes.
fn from_root(path: &str, module: &Module, known: &BTreeMap<Module, PathBuf>) -> Option<Module> {
    let mut names = path.split("::").map(|n| n.trim().to_owned()).peekable();
    let mut base = module.clone();
    match names.peek()?.as_str() {
        "crate" => base.clear(),
        "self" => {}
        "super" => {
            while names.next_if(|n| n == "super").is_some() {
                base.pop();
            }
            return Some(base.into_iter().chain(names).collect());
        }
        child => {
            base.push(child.to_owned());
            known.get(&base)?;
        }
    }
    Some(base.into_iter().chain(names.skip(1)).collect())
}

/// What a file names, in a `use` or where it needs it.
fn named(module: &Module, text: &str, known: &BTreeMap<Module, PathBuf>) -> Vec<NamedPath> {
    let mut out = Vec::new();
    let mut rest = String::new();
    let mut end = 0;
    for (at, _) in text.match_indices("use ") {
        let before = text[..at].trim_end();
        if !before.is_empty()
            && !before.ends_with([';', '}', ']', '{', ')'])
            && !before.ends_with("pub")
        {
            continue;
        }
        let tree = text[at + 4..].split(';').next().unwrap_or_default();
        rest.push_str(text.get(end..at).unwrap_or_default());
        end = at + 4 + tree.len();
        for path in paths(tree) {
            let (path, alias) = path.split_once(" as ").unwrap_or((&path, ""));
            let Some(path) = from_root(path, module, known) else { continue };
            let alias = if alias.is_empty() { path.last().cloned() } else { Some(alias.into()) };
            out.push(NamedPath {
                path,
                alias,
                is_export: before.ends_with("pub") || before.ends_with(')'),
            });
        }
    }
    rest.push_str(&text[end..]);
    let words = rest.split(|c: char| !c.is_alphanumeric() && c != '_' && c != ':');
    let inline =
        words.filter(|w| ["crate::", "super::", "self::"].iter().any(|s| w.starts_with(s)));
    let inline = inline.filter_map(|path| from_root(path, module, known));
    out.extend(inline.map(|path| NamedPath { path, alias: None, is_export: false }));
    out
}

/// The file that defines a path, through the names that files give with `use`.
fn defining(
    path: &[String],
    known: &BTreeMap<Module, PathBuf>,
    aliases: &BTreeMap<Module, Module>,
) -> Option<Module> {
    (0..=path.len()).rev().find_map(|n| {
        let front = &path[..n];
        if known.contains_key(front) {
            return Some(front.to_vec());
        }
        // A module within a file names what is beside it with `super`.
        let other = aliases.get(front).filter(|&o| aliases.get(o).is_none_or(|o| o != front))?;
        defining(&[other, &path[n..]].concat(), known, aliases)
    })
}

/// Arrows between the files of a crate.
fn arrows(source: &Path) -> BTreeMap<Module, BTreeSet<Module>> {
    let mut known = BTreeMap::new();
    files(source, &Vec::new(), &mut known);
    let all: Vec<_> =
        known.iter().map(|(module, path)| (module, named(module, &code(path), &known))).collect();
    let mut aliases = BTreeMap::new();
    for (module, names) in &all {
        for (path, alias) in names.iter().filter_map(|n| Some((&n.path, n.alias.clone()?))) {
            aliases.insert(module.iter().cloned().chain([alias]).collect(), path.clone());
        }
    }
    let of = |(module, names): &(&Module, Vec<NamedPath>)| {
        let used = names.iter().filter(|name| !name.is_export);
        let to = used.filter_map(|name| defining(&name.path, &known, &aliases));
        ((*module).clone(), to.filter(|to| !module.starts_with(to)).collect())
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
fn a_circle_is_found_through_a_re_export_and_a_path_in_the_code() {
    let folder = tempfile::tempdir().expect("a folder");
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    write("lib.rs", "mod a;\nmod b;\npub use b::B;\n");
    write("a.rs", "use crate::{B};\npub struct A;\n");
    write("b.rs", "pub struct B;\n");
    let from = vec!["a".to_owned()];
    assert_eq!(circle(&from, &arrows(folder.path())), None);
    write("b.rs", "use super::a::A;\npub struct B;\n");
    let both = Some(vec!["a".into(), "b".into()]);
    assert_eq!(circle(&from, &arrows(folder.path())), both);
    write("b.rs", "pub struct B;\nfn f() {\n    let a = super::a::A;\n}\n");
    assert_eq!(circle(&from, &arrows(folder.path())), both);
    write("b.rs", "pub struct B;\n#[cfg(test)]\nfn f() {\n    let a = super::a::A;\n}\n");
    assert_eq!(circle(&from, &arrows(folder.path())), None);
}
