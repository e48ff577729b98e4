//! Names and language of the source: public types are unique, doc comments say what they describe.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

/// Beginnings of doc comments that paraphrase a thing instead of naming it, or only point elsewhere.
const BEGINNINGS: [&str; 12] = [
    "What ",
    "Whether ",
    "Where ",
    "Who ",
    "Which ",
    "Those ",
    "Its ",
    "Of ",
    "As there.",
    "As above.",
    "See above.",
    "See there.",
];

/// Most doc comments in the workspace that may begin so.
const MOST_BEGINNINGS: usize = 10;

/// The paths of every Rust file of the workspace, from its root, and their texts.
fn sources() -> BTreeMap<String, String> {
    let root = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."));
    let mut found = BTreeMap::new();
    let mut open: Vec<_> = ["crates", "apps", "examples", "tests"].map(|name| root.join(name)).into();
    while let Some(folder) = open.pop() {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() && path.file_name().is_some_and(|name| name != "target") {
                open.push(path);
            } else if path.extension().is_some_and(|extension| extension == "rs") {
                let text = fs::read_to_string(&path).unwrap();
                found.insert(path.strip_prefix(root).unwrap().display().to_string(), text);
            }
        }
    }
    assert!(found.contains_key("crates/wm-scene/src/lib.rs"), "the sources are read");
    found
}

/// The name of the public type that a line defines, if it does: not of one that is visible inside
/// its crate alone.
fn public_type(line: &str) -> Option<&str> {
    let rest = line.trim_start().strip_prefix("pub ")?;
    let kinds = ["struct ", "enum ", "trait ", "type ", "union "];
    let name = kinds.iter().find_map(|kind| rest.strip_prefix(kind))?;
    let end = name.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(name.len());
    // In a macro the name is a variable.
    Some(&name[..end]).filter(|name| !name.is_empty())
}

/// The part of a file before its module of tests, which ends it.
fn production(text: &str) -> &str {
    let is_module = |at: &usize| {
        text[*at..].lines().nth(2).is_some_and(|line| line.contains("mod ") && line.ends_with('{'))
    };
    let end = text.match_indices("\n#[cfg(test)]\n").map(|(at, _)| at).find(is_module);
    &text[..end.unwrap_or(text.len())]
}

#[test]
fn no_two_public_types_share_a_name() {
    let mut places: BTreeMap<&str, BTreeMap<String, &str>> = BTreeMap::new();
    let sources = sources();
    let is_library = |path: &str| {
        let mut parts = Path::new(path).iter().skip(2);
        parts.next().is_some_and(|part| part == "src")
            && !parts.any(|part| part == "tests" || part == "tests.rs")
    };
    for (path, text) in sources.iter().filter(|(path, _)| is_library(path)) {
        // Of types with and without a feature, in one file or in a pair of files, only one is
        // compiled.
        let file = path.replace("/without_", "/with_");
        for name in production(text).lines().filter_map(public_type) {
            places.entry(name).or_default().insert(file.clone(), path);
        }
    }
    places.retain(|_, places| places.len() > 1);
    assert!(places.is_empty(), "names of public types that are used more than once: {places:#?}");
}

#[test]
fn doc_comments_name_what_they_describe() {
    let mut found = Vec::new();
    for (path, text) in sources() {
        let mut before = None;
        for (index, line) in text.lines().enumerate() {
            let line = line.trim_start();
            let mark = ["/// ", "//! ", "///", "//!"].into_iter().find(|mark| line.starts_with(mark));
            let content = line.strip_prefix(mark.unwrap_or_default()).unwrap_or_default();
            let is_first = mark.is_some() && mark.map(str::trim) != before;
            if is_first && BEGINNINGS.iter().any(|beginning| content.starts_with(beginning)) {
                found.push(format!("{path}:{}: {content}", index + 1));
            }
            before = mark.map(str::trim);
        }
    }
    assert!(
        found.len() <= MOST_BEGINNINGS,
        "doc comments that do not begin with a verb or the thing (\"Returns ...\", \"The number of ...\"): {found:#?}"
    );
}
