//! Remarks of a reader: lines for people on what it guessed, ignored or passed over.

use serde::Serialize;
use std::fmt;

/// A line for people on how a file was read, although it could be read.
///
/// Readers attach remarks to what they return, such as [`crate::Scene::remarks`]. Programs print
/// each once; `inspect --strict` fails if any is a doubt.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Remark {
    /// The weight of the remark.
    pub severity: Severity,
    /// A fixed name for programs: lower case words and hyphens, such as `unknown-property`.
    pub code: &'static str,
    /// One line without a full stop: what was read and how; after a semicolon, what to do.
    pub text: String,
}

/// The weight of a remark.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Severity {
    /// The file was read as its author meant it. Nothing needs to be done.
    Note,
    /// The result may differ from what the author meant. Somebody should look.
    Doubt,
}

impl Remark {
    /// Makes a note: the file was read as its author meant it.
    #[must_use]
    pub fn note(code: &'static str, text: impl Into<String>) -> Self {
        Self { severity: Severity::Note, code, text: text.into() }
    }

    /// Makes a doubt: the result may differ from what the author meant.
    #[must_use]
    pub fn doubt(code: &'static str, text: impl Into<String>) -> Self {
        Self { severity: Severity::Doubt, code, text: text.into() }
    }
}

/// Adds the remarks that are not in `all` yet: a scene of many files says a thing once.
pub(crate) fn add_new(all: &mut Vec<Remark>, more: &[Remark]) {
    for remark in more {
        if !all.contains(remark) {
            all.push(remark.clone());
        }
    }
}

/// Prints the text as a line of a program's error stream: `note: ...` or `warning: ...`.
impl fmt::Display for Remark {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let word = match self.severity {
            Severity::Note => "note",
            Severity::Doubt => "warning",
        };
        write!(f, "{word}: {}", self.text)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn remarks_print_by_their_weight_and_are_ordered_by_it() {
        let note = Remark::note("dialect", "read as 2DGS");
        let doubt = Remark::doubt("unknown-property", "the property heat is not understood");
        assert_eq!(note.to_string(), "note: read as 2DGS");
        assert_eq!(doubt.to_string(), "warning: the property heat is not understood");
        assert!(note.severity < doubt.severity);
        assert_eq!(
            serde_json::to_string(&note).unwrap(),
            r#"{"severity":"note","code":"dialect","text":"read as 2DGS"}"#
        );
    }
}
