//! Names and language of the source: public types are unique, doc comments say what they describe.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

/// Most doc comments in the workspace that may begin with one of [`QUESTION_WORDS`].
const MOST_QUESTIONS: usize = 100;

/// First words of doc comments that paraphrase a thing instead of naming it.
const QUESTION_WORDS: [&str; 6] = ["What", "Whether", "Where", "Who", "Which", "How"];

/// Doc comments that only point elsewhere.
const POINTERS: [&str; 4] = ["As there.", "See above.", "As above.", "See there."];

/// Every Rust file below a folder of the workspace, in the order of their paths.
fn sources(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    let mut open = vec![folder.to_path_buf()];
    while let Some(folder) = open.pop() {
        let Ok(entries) = fs::read_dir(&folder) else { continue };
        for entry in entries {
            let path = entry.unwrap().path();
            if path.is_dir() && path.file_name().is_some_and(|name| name != "target") {
                open.push(path);
            } else if path.extension().is_some_and(|extension| extension == "rs") {
                found.push(path);
            }
        }
    }
    found.sort();
    found
}

fn root() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."))
}

/// A path as messages show it.
fn shown(path: &Path) -> String {
    path.strip_prefix(root()).unwrap_or(path).display().to_string()
}

/// Files of `src` folders that are compiled for tests only: `tests.rs`, or anything below `tests/`.
fn is_test_file(path: &Path) -> bool {
    let below = path.strip_prefix(root()).unwrap_or(path);
    below.iter().any(|part| part == "tests" || part == "tests.rs")
}

/// The name of the public type that a line defines, if it does: not of an associated type, which is
/// never `pub`, and not of one that is visible inside its crate alone.
fn public_type(line: &str) -> Option<&str> {
    let rest = line.trim_start().strip_prefix("pub ")?;
    let rest = rest.strip_prefix("unsafe ").unwrap_or(rest);
    let kinds = ["struct ", "enum ", "trait ", "type ", "union "];
    let name = kinds.iter().find_map(|kind| rest.strip_prefix(kind))?;
    let end = name.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(name.len());
    // In a macro the name is a variable.
    Some(&name[..end]).filter(|name| !name.is_empty())
}

/// The lines of a file outside of its `#[cfg(test)]` modules, numbered from 1.
///
/// Files are formatted by rustfmt: a module ends at the first closing brace that is indented as its
/// attribute is.
fn production_lines(text: &str) -> Vec<(usize, &str)> {
    let mut lines = Vec::new();
    let mut all = text.lines().enumerate().peekable();
    while let Some((index, line)) = all.next() {
        if line.trim() == "#[cfg(test)]" {
            let indent = &line[..line.len() - line.trim_start().len()];
            let is_module = |line: &str| {
                let line = line.trim_start();
                line.ends_with('{') && (line.starts_with("mod ") || line.contains(" mod "))
            };
            if all.peek().is_some_and(|(_, next)| is_module(next)) {
                let end = format!("{indent}}}");
                all.by_ref().find(|(_, line)| *line == end);
            }
            continue;
        }
        lines.push((index + 1, line));
    }
    lines
}

#[test]
fn no_two_public_types_share_a_name() {
    let mut folders = vec![root().join("src")];
    let crates = fs::read_dir(root().join("crates")).unwrap();
    folders.extend(crates.map(|entry| entry.unwrap().path().join("src")));
    let mut places: BTreeMap<String, BTreeMap<String, String>> = BTreeMap::new();
    for path in folders.iter().flat_map(|folder| sources(folder)).filter(|path| !is_test_file(path)) {
        let text = fs::read_to_string(&path).unwrap();
        // Of types with and without a feature, in one file or in a pair of files, only one is
        // compiled.
        let file = shown(&path).replace("/without_", "/with_");
        for (number, line) in production_lines(&text) {
            if let Some(name) = public_type(line) {
                let place = format!("{}:{number}", shown(&path));
                places.entry(name.into()).or_default().insert(file.clone(), place);
            }
        }
    }
    assert!(places.contains_key("Splats") && places.contains_key("Camera"), "the sources are read");
    let shared: Vec<String> = places
        .iter()
        .filter(|(_, places)| places.len() > 1)
        .map(|(name, places)| {
            let places: Vec<&str> = places.values().map(String::as_str).collect();
            format!("  {name}: {}", places.join(", "))
        })
        .collect();
    assert!(
        shared.is_empty(),
        "{} names of public types are used more than once; rename all but one of each:\n{}",
        shared.len(),
        shared.join("\n")
    );
}

/// Every line of a doc comment of the workspace, without its mark, with its place; true for first
/// lines.
fn doc_lines() -> Vec<(String, String, bool)> {
    let mut found = Vec::new();
    for path in
        ["crates", "src", "examples", "benches", "tests"].map(|folder| sources(&root().join(folder))).concat()
    {
        let text = fs::read_to_string(&path).unwrap();
        let mut is_inside = [false; 2];
        for (index, line) in text.lines().enumerate() {
            for (mark, is_inside) in ["///", "//!"].into_iter().zip(&mut is_inside) {
                // Four slashes are an ordinary comment.
                let content =
                    line.trim_start().strip_prefix(mark).filter(|content| !content.starts_with('/'));
                if let Some(content) = content {
                    found.push((
                        content.trim().into(),
                        format!("{}:{}", shown(&path), index + 1),
                        !*is_inside,
                    ));
                }
                *is_inside = content.is_some();
            }
        }
    }
    found
}

#[test]
fn doc_comments_name_what_they_describe() {
    let asks = |text: &str| {
        let first = text.split(|c: char| !c.is_alphanumeric()).next().unwrap_or_default();
        QUESTION_WORDS.contains(&first)
    };
    let questions: Vec<String> = doc_lines()
        .iter()
        .filter(|(text, _, is_first)| *is_first && asks(text))
        .map(|(text, place, _)| format!("  {place}: {text}"))
        .collect();
    assert!(
        questions.len() < MOST_QUESTIONS,
        "{} doc comments begin with {}, {MOST_QUESTIONS} or more are too many; begin with a verb or a noun \
         (\"Returns ...\", \"The number of ...\"):\n{}",
        questions.len(),
        QUESTION_WORDS.join(", "),
        questions.join("\n")
    );
}

/// The pointers themselves stand in this file as strings, not as comments.
#[test]
fn no_doc_comment_only_points_elsewhere() {
    let found: Vec<String> = doc_lines()
        .iter()
        .filter(|(text, ..)| POINTERS.contains(&text.as_str()))
        .map(|(text, place, _)| format!("  {place}: {text}"))
        .collect();
    assert!(found.is_empty(), "doc comments that only point elsewhere:\n{}", found.join("\n"));
}
