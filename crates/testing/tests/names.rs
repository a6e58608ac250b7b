//! Types have nouns for names: a lone participle, such as "Made", cannot be searched for and does not tell what it is.
#![allow(missing_docs, reason = "a test")]

use std::path::Path;

/// Participles that do not end in "ed".
const IRREGULAR: [&str; 13] = [
    "Cut", "Done", "Drawn", "Found", "Held", "How", "Kept", "Known", "Made", "Seen", "Shown",
    "Told", "Worn",
];
/// Nouns that end in "ed".
const NOUNS: [&str; 3] = ["Need", "Seed", "Speed"];

fn is_participle(name: &str) -> bool {
    let one_word = name.chars().skip(1).all(|c| c.is_lowercase());
    one_word && (IRREGULAR.contains(&name) || name.ends_with("ed") && !NOUNS.contains(&name))
}

/// The types that a line of source defines.
fn defined(line: &str) -> Option<&str> {
    let words: Vec<&str> = line.split(|c: char| !c.is_alphanumeric() && c != '_').collect();
    let keyword = words.iter().position(|w| ["struct", "enum", "trait"].contains(w))?;
    let starts = line.trim_start().starts_with("pub") || words.first() == words.get(keyword);
    words.get(keyword + 1).copied().filter(|_| starts)
}

fn check(folder: &Path, wrong: &mut Vec<String>, types: &mut usize) {
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        if path.is_dir() && !path.ends_with("target") && !path.ends_with("node_modules") {
            check(&path, wrong, types);
        } else if path.extension().is_some_and(|e| e == "rs") {
            let text = std::fs::read_to_string(&path).expect("a source file");
            for name in text.lines().filter_map(|line| defined(line.trim_start())) {
                *types += 1;
                if is_participle(name) {
                    wrong.push(format!("{}: {name}", path.display()));
                }
            }
        }
    }
}

#[test]
fn types_have_nouns_for_names() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let (mut wrong, mut types) = (Vec::new(), 0);
    ["crates", "xtask"].iter().for_each(|folder| check(&root.join(folder), &mut wrong, &mut types));
    assert!(types > 500, "{types}");
    assert!(wrong.is_empty(), "give these types nouns: {wrong:#?}");
    assert!(is_participle("Made") && is_participle("Encoded") && !is_participle("EncodedStream"));
}
