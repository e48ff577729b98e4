//! Takes the docstrings of the stub file, so that `help()` and editors show the same text.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::{env, fs, path::Path};

const STUB: &str = "python/weather_magician/_native.pyi";

fn main() {
    println!("cargo::rerun-if-changed={STUB}");
    println!("cargo::rerun-if-changed=build.rs");
    let stub = fs::read_to_string(STUB).expect("the stub file is part of the crate");
    let mut arms = String::from("macro_rules! docs {\n");
    let docs = docstrings(&stub);
    for (name, text) in &docs {
        // Python shows the constructor with its class.
        let new = docs.get(&format!("{name}.__new__")).map_or_else(String::new, |new| format!("\n\n{new}"));
        let text = format!("{text}{new}");
        let _ = writeln!(arms, "    ({name:?}) => {{ {text:?} }};");
    }
    arms.push_str("}\n");
    let out = env::var("OUT_DIR").expect("Cargo sets it");
    fs::write(Path::new(&out).join("docs.rs"), arms).expect("the output folder can be written");
}

/// The docstrings of classes, methods and functions: `Class`, `Class.method` and `function`.
fn docstrings(stub: &str) -> BTreeMap<String, String> {
    let mut found = BTreeMap::new();
    let (mut class, mut owner) = (String::new(), None);
    let mut lines = stub.lines();
    while let Some(line) = lines.next() {
        let text = line.trim_start();
        let indent = line.len() - text.len();
        let word = |start: &str| {
            text.strip_prefix(start).map(|rest| rest.split([':', '(']).next().unwrap_or_default().to_owned())
        };
        if let Some(name) = word("class ").filter(|_| indent == 0) {
            class.clone_from(&name);
            owner = Some(name);
        } else if let Some(name) = word("def ") {
            owner = Some(if indent == 0 { name } else { format!("{class}.{name}") });
        } else if let Some(first) = text.strip_prefix("\"\"\"").filter(|_| indent > 0) {
            let Some(owner) = owner.take() else { continue };
            let mut doc = first.to_owned();
            while !doc.ends_with("\"\"\"") {
                let Some(line) = lines.next() else { break };
                doc.push('\n');
                doc.push_str(line.get(indent..).unwrap_or_default());
            }
            found.insert(owner, doc.trim_end_matches("\"\"\"").trim_end().to_owned());
        }
    }
    found
}
