//! Sensors in TOML: of files, and of texts with the place of a fault.

use serde::de::DeserializeOwned;
use std::path::Path;
use wm_scene::nearest;

/// A fault of a text: its line as `, line 3`, or nothing where it is not known, and what it is.
pub(crate) type TextFault = (String, String);

/// The value of a text in TOML.
pub(crate) fn parse<T: DeserializeOwned>(text: &str) -> Result<T, TextFault> {
    toml::from_str(text).map_err(|error| {
        let line = error.span().map(|span| 1 + text[..span.start.min(text.len())].matches('\n').count());
        let location = line.map_or_else(String::new, |line| format!(", line {line}"));
        (location, error.message().split_whitespace().collect::<Vec<_>>().join(" "))
    })
}

/// The name of a file without its extension.
pub(crate) fn stem_of(path: &Path) -> String {
    path.file_stem().map_or_else(String::new, |stem| stem.to_string_lossy().into_owned())
}

/// Advice where no preset has a name; `otherwise` is what else may be given.
pub(crate) fn advice(name: &str, presets: &[(&str, &str)], otherwise: &str) -> String {
    let names: Vec<&str> = presets.iter().map(|(name, _)| *name).collect();
    let near = nearest(&name.to_lowercase(), names.iter().copied(), 1);
    match near[..] {
        [near] => format!("did you mean {near}?"),
        _ => format!("give {}{otherwise}", names.join(", ")),
    }
}
