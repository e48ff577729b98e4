//! A weather file while it is written: each value with the reason for it.

use crate::error::ReportError;
use std::fmt::{self, Write};
use wm_weather::{EFFECTS, Easing, Effect, Weather};

/// The origin of a value.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Basis {
    /// From the report; the words that say so.
    Told(String),
    /// Not in the report; the reason for the choice.
    Guess(String),
}

impl Basis {
    pub(crate) fn told(text: impl Into<String>) -> Self {
        Self::Told(text.into())
    }

    pub(crate) fn guess(text: impl Into<String>) -> Self {
        Self::Guess(text.into())
    }

    /// The words without the mark.
    pub(crate) fn text(&self) -> &str {
        match self {
            Self::Told(text) | Self::Guess(text) => text,
        }
    }

    /// Other words for a value of the same origin.
    pub(crate) fn with_text(&self, text: String) -> Self {
        match self {
            Self::Told(_) => Self::Told(text),
            Self::Guess(_) => Self::Guess(text),
        }
    }
}

struct Entry {
    name: &'static str,
    value: String,
    basis: Basis,
}

/// A weather file that is written, and the remarks about it.
#[derive(Debug)]
pub(crate) struct WrittenWeather {
    pub(crate) name: String,
    pub(crate) toml: String,
    pub(crate) weather: Weather,
    pub(crate) notes: Vec<ReportNote>,
}

/// A weather file in the making.
pub(crate) struct Draft {
    name: String,
    about: String,
    head: Vec<String>,
    tables: Vec<(&'static Effect, Vec<Entry>)>,
    notes: Vec<ReportNote>,
}

impl Draft {
    /// A file with a name, and lines of comment at its head.
    pub(crate) fn new(name: &str, about: &str, head: Vec<String>) -> Self {
        // Outputs are named after a weather.
        let name = slug(name);
        Self { name, about: plain(about), head, tables: Vec::new(), notes: Vec::new() }
    }

    pub(crate) fn note(&mut self, kind: ReportNoteKind, text: impl Into<String>) {
        let note = ReportNote { kind, text: plain(&text.into()) };
        if !self.notes.contains(&note) {
            self.notes.push(note);
        }
    }

    /// Notes a part of the report that a weather file cannot hold, and why.
    pub(crate) fn ignored(&mut self, text: impl Into<String>) {
        self.note(ReportNoteKind::Ignored, text);
    }

    /// Notes quantities that the weather file does not set.
    pub(crate) fn missing(&mut self, names: &[&str]) {
        if !names.is_empty() {
            self.note(ReportNoteKind::Missing, names.join(", "));
        }
    }

    /// A parameter, `effect.parameter`, as a number in the parameter's unit. A number beyond the
    /// parameter's range is clamped, with a note.
    pub(crate) fn number(&mut self, key: &str, value: f64, basis: Basis) {
        let value = self.clamped(key, rounded(value, 4));
        self.entry(key, written(value), basis);
    }

    /// A parameter as a number that may be known.
    pub(crate) fn datum(&mut self, key: &str, known: Option<&Datum>) {
        if let Some(Datum { value, basis }) = known {
            self.number(key, *value, basis.clone());
        }
    }

    /// A parameter as a word or a text.
    pub(crate) fn word(&mut self, key: &str, word: &str, basis: Basis) {
        self.entry(key, format!("\"{word}\""), basis);
    }

    /// A parameter over time: seconds and numbers in the parameter's unit. Keys that change nothing
    /// are left out.
    pub(crate) fn track(&mut self, key: &str, keys: &[(f64, f64)], easing: Easing, basis: Basis) {
        let keys: Vec<(f64, f64)> = keys
            .iter()
            .map(|(time, value)| (rounded(*time, 7), self.clamped(key, rounded(*value, 6))))
            .collect();
        let keys = thinned(&keys, easing);
        match keys[..] {
            [] => {}
            [(_, value)] => self.entry(key, written(value), basis),
            _ => {
                let mut text = String::from("{ keys = [");
                for (index, (time, value)) in keys.iter().enumerate() {
                    let easing = match easing {
                        Easing::Linear => String::new(),
                        other => format!(", \"{}\"", other.name()),
                    };
                    let gap = if index % 6 == 0 { "\n    " } else { " " };
                    // Writing to a string cannot fail.
                    let _ = write!(text, "{gap}[{}, {}{easing}],", written(*time), written(*value));
                }
                text.push_str("\n] }");
                self.entry(key, text, basis);
            }
        }
    }

    fn clamped(&mut self, key: &str, value: f64) -> f64 {
        let Some((effect, param)) = parameter(key) else { return value };
        let (least, most) = effect.params[param].range;
        let within = value.clamp(least, most);
        if within != value {
            let unit = effect.params[param].unit;
            self.note(
                ReportNoteKind::Clamped,
                format!("{key} is {within} {unit} and not {value}: a weather file takes {least} to {most}"),
            );
        }
        within
    }

    fn entry(&mut self, key: &str, value: String, basis: Basis) {
        let Some((effect, param)) = parameter(key) else { return };
        if let Basis::Guess(why) = &basis {
            self.note(ReportNoteKind::Guess, format!("{key}: {why}"));
        }
        let place = self.tables.iter().position(|(known, _)| known.name == effect.name);
        let place = place.unwrap_or_else(|| {
            self.tables.push((effect, Vec::new()));
            self.tables.len() - 1
        });
        let entries = &mut self.tables[place].1;
        let name = effect.params[param].name;
        entries.retain(|entry| entry.name != name);
        entries.push(Entry { name, value, basis });
    }

    /// The file, and the weather that is read from its text.
    ///
    /// # Errors
    /// [`ReportError::Weather`] if the text is no weather.
    pub(crate) fn finish(mut self) -> Result<WrittenWeather, ReportError> {
        let mut text = String::new();
        for line in &self.head {
            let _ = writeln!(text, "# {}", plain(line));
        }
        for note in self.notes.iter().filter(|note| note.kind != ReportNoteKind::Guess) {
            let _ = writeln!(text, "# {note}");
        }
        let quoted = |text: &str| format!("\"{}\"", text.replace('\\', "\\\\").replace('"', "\\\""));
        let _ = writeln!(text, "name = {}", quoted(&self.name));
        if !self.about.is_empty() {
            let _ = writeln!(text, "about = {}", quoted(&self.about));
        }
        self.tables.sort_by_key(|(effect, _)| EFFECTS.iter().position(|known| known.name == effect.name));
        for (effect, entries) in &self.tables {
            let _ = write!(text, "\n[{}]\n", effect.name);
            for Entry { name, value, basis } in entries {
                let mark = if matches!(basis, Basis::Guess(_)) { "guess: " } else { "" };
                let comment = format!("# {mark}{}", plain(basis.text()));
                if basis.text().is_empty() {
                    let _ = writeln!(text, "{name} = {value}");
                } else if value.contains('\n') {
                    let _ = writeln!(text, "{comment}\n{name} = {value}");
                } else {
                    let _ = writeln!(text, "{:<24} {comment}", format!("{name} = {value}"));
                }
            }
        }
        let weather = Weather::parse(&text, &self.name)?;
        Ok(WrittenWeather { name: self.name, toml: text, weather, notes: self.notes })
    }
}

/// The effect of a key `effect.parameter`, and the parameter's place in its table.
fn parameter(key: &str) -> Option<(&'static Effect, usize)> {
    let (effect, param) = key.split_once('.')?;
    let effect = Effect::named(effect)?;
    Some((effect, effect.param(param)?))
}

/// A name for files: letters, digits, `-` and `_`, at most 48 characters.
fn slug(text: &str) -> String {
    let mut name = String::new();
    for c in text.chars().take(200) {
        let c = if c.is_alphanumeric() || c == '_' { c } else { '-' };
        if !(c == '-' && (name.is_empty() || name.ends_with('-'))) {
            name.push(c);
        }
    }
    let short: String = name.chars().take(48).collect();
    let short = short.trim_end_matches('-');
    if short.is_empty() { "report".into() } else { short.into() }
}

/// A text without control characters, at most 300 characters long: comments and names of a weather
/// file are one line.
fn plain(text: &str) -> String {
    let line: String = text.chars().map(|c| if c.is_control() { ' ' } else { c }).take(300).collect();
    line.trim().into()
}

/// Formats `value` with a number of significant digits.
pub(crate) fn rounded(value: f64, digits: i32) -> f64 {
    if value == 0.0 || !value.is_finite() {
        return value;
    }
    let places = digits - 1 - value.abs().log10().floor() as i32;
    // Whole numbers keep all of theirs.
    let factor = 10f64.powi(places.clamp(0, 12));
    (value * factor).round() / factor
}

fn written(value: f64) -> String {
    // The sign of nothing says nothing.
    if value == 0.0 { "0".into() } else { format!("{value}") }
}

/// Without keys between two others that they lie on.
fn thinned(keys: &[(f64, f64)], easing: Easing) -> Vec<(f64, f64)> {
    let mut kept: Vec<(f64, f64)> = Vec::new();
    for (index, key) in keys.iter().enumerate() {
        let is_same = |other: Option<&(f64, f64)>| other.is_some_and(|other| other.1 == key.1);
        let last = kept.last();
        let needless = match easing {
            Easing::Hold => is_same(last),
            _ => is_same(last) && (is_same(keys.get(index + 1)) || index + 1 == keys.len()),
        };
        if !needless {
            kept.push(*key);
        }
    }
    kept
}

/// The kind of a remark about a report.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ReportNoteKind {
    /// A value that the report does not have.
    Guess,
    /// A quantity that was not measured and that the weather file does not set.
    Missing,
    /// A part of the report that a weather file cannot hold.
    Ignored,
    /// A value beyond the range of its parameter.
    Clamped,
}

/// A remark about a report: a value that was guessed, a part that was ignored, and why.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ReportNote {
    /// The kind.
    pub kind: ReportNoteKind,
    /// One line.
    pub text: String,
}

impl fmt::Display for ReportNote {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let kind = match self.kind {
            ReportNoteKind::Guess => "guess",
            ReportNoteKind::Missing => "not measured",
            ReportNoteKind::Ignored => "ignored",
            ReportNoteKind::Clamped => "clamped",
        };
        write!(f, "{kind}: {}", self.text)
    }
}

/// A value and its origin.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Datum {
    pub(crate) value: f64,
    pub(crate) basis: Basis,
}

impl Datum {
    pub(crate) fn told(value: f64, text: impl Into<String>) -> Self {
        Self { value, basis: Basis::told(text) }
    }

    pub(crate) fn guess(value: f64, text: impl Into<String>) -> Self {
        Self { value, basis: Basis::guess(text) }
    }

    /// The standard deviation of a wind with gusts, m/s, as a share of its speed.
    pub(crate) fn of_gusts(gust: f64, speed: f64) -> Self {
        let share = if speed > 0.0 { (gust / speed - 1.0) / 3.0 } else { 1.0 };
        let why = format!("gusts of {gust:.1} m/s are taken for three standard deviations");
        Self::told(share.clamp(0.0, 1.0), why)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_keep_the_digits_that_count() {
        assert_eq!(
            [12.3456, 0.001_234_56, 12_345.67, 0.0].map(|v| rounded(v, 4)),
            [12.35, 0.001_235, 12_346.0, 0.0]
        );
        assert_eq!([written(-0.0), written(f64::INFINITY), written(5.0)], ["0", "inf", "5"]);
    }

    #[test]
    fn names_are_names_of_files() {
        assert_eq!(slug("heavy rain, wind 40 km/h (../x)"), "heavy-rain-wind-40-km-h-x");
        assert_eq!(slug("../"), "report");
        assert_eq!(slug(&"ab ".repeat(50)).len(), 47);
    }

    #[test]
    fn keys_between_equal_ones_are_left_out() {
        let keys = [(0.0, 1.0), (1.0, 1.0), (2.0, 1.0), (3.0, 4.0), (4.0, 4.0)];
        assert_eq!(thinned(&keys, Easing::Hold), [(0.0, 1.0), (3.0, 4.0)]);
        assert_eq!(thinned(&keys, Easing::Linear), [(0.0, 1.0), (2.0, 1.0), (3.0, 4.0)]);
        assert_eq!(thinned(&keys[..3], Easing::Linear), [(0.0, 1.0)]);
    }
}
