//! Metadata beside a scene file: `<scene file>.wm.toml`.
//!
//! For formats that have no room for it, and for corrections by hand. The keys are the fields of
//! [`Metadata`]; unknown ones are errors.

use crate::{
    Metadata,
    formats::{beside::places, folder::scene_file},
};
use std::path::{Path, PathBuf};
use wm_base::{
    error::{FormatError, Location, Problem, one_line},
    files::{self, write_atomically},
};

/// The path of the metadata beside a scene file.
#[must_use]
pub fn sidecar_path(scene_file: &Path) -> PathBuf {
    let mut name = scene_file.as_os_str().to_owned();
    name.push(".wm.toml");
    name.into()
}

/// Reads the metadata beside a scene file, or, if there is none, beside the file that it leads to
/// as a symbolic link; `None` if there is none there either.
///
/// # Errors
/// [`FormatError`] with line and column, if it is not TOML, has unknown keys or values that cannot
/// be used.
pub fn read(scene_file: &Path) -> Result<Option<Metadata>, FormatError> {
    for place in places(scene_file) {
        let path = sidecar_path(&place);
        let reading = |error| FormatError::reading(&path, error);
        let Some(text) = files::read_if_there(&path).map_err(reading)? else { continue };
        let text = files::text_of(text).map_err(reading)?;
        return parse(&text).map(Some).map_err(|(place, message)| {
            FormatError::at(&path, place, Problem::Value(format!("{message}; correct or remove it")))
        });
    }
    Ok(None)
}

fn parse(text: &str) -> Result<Metadata, (Location, String)> {
    let metadata: Metadata = parse_toml(text)?;
    // A value of the right type that cannot be used: found again by its key to name the place.
    if let Some(fault) = metadata.fault() {
        let key = fault.split(' ').next().unwrap_or_default();
        let at = text.lines().enumerate().find(|(_, line)| line.trim_start().starts_with(key));
        let place = at.map_or(Location::Whole, |(index, line)| {
            let indent = line.len() - line.trim_start().len();
            Location::LineColumn(index as u64 + 1, indent as u64 + 1)
        });
        return Err((place, fault));
    }
    Ok(metadata)
}

/// Reads a value from TOML; its errors have a place.
pub(crate) fn parse_toml<T: serde::de::DeserializeOwned>(text: &str) -> Result<T, (Location, String)> {
    toml::from_str(text).map_err(|error| {
        let place = error.span().map_or(Location::Whole, |span| line_column(text, span.start));
        (place, one_line(error.message()))
    })
}

/// Line and column (in characters) of a byte of `text`.
fn line_column(text: &str, byte: usize) -> Location {
    let before = &text[..text.floor_char_boundary(byte)];
    let line = before.matches('\n').count() + 1;
    let column = before.rsplit('\n').next().unwrap_or_default().chars().count() + 1;
    Location::LineColumn(line as u64, column as u64)
}

/// Writes the metadata beside a scene, whole or not at all. For the folder of a training it lies
/// beside the scene file that is read from it.
///
/// # Errors
/// [`FormatError`] if a value cannot be used or the file cannot be written.
pub fn write_sidecar(scene: &Path, metadata: &Metadata) -> Result<(), FormatError> {
    let file = if scene.is_dir() { scene_file(scene)? } else { scene.into() };
    let path = sidecar_path(&file);
    let value = |message| FormatError::value(&path, format!("not written: {message}"));
    let entries = metadata.entries().map_err(value)?;
    let text: String = entries.iter().map(|(key, value)| format!("{key} = {value}\n")).collect();
    write_atomically(&path, |out| Ok(out.write_all(text.as_bytes())?))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    fn say(text: &str) -> String {
        let (place, message) = parse(text).unwrap_err();
        format!("{place}: {message}")
    }

    #[test]
    fn errors_have_line_and_column() {
        assert_eq!(
            say("ground = 1.0\nmeters_per_unit = 2.0\n"),
            ", line 2, column 1: unknown field `meters_per_unit`, expected one of `origin`, `metres_per_unit`, \
             `scale_source`, `scale_confidence`, `up`, `up_source`, `up_confidence`, `north`, \
             `north_source`, `location`, `captured`, `captured_span`, `sun`, `ground`, `ground_confidence`, \
             `camera_height`, `airlight`, `white_card`, `haze_extinction`, `haze_extinction_error`, `haze_shown_extinction`, \
             `haze_airlight`, `water`, `water_labels`, `lamps`, `windows`, `reflectances`, `rasterization`, `provenance`"
        );
        assert_eq!(
            say("# ä\n  up = [0, 0, 3]"),
            ", line 2, column 3: up is [0, 0, 3]: it must have length 1"
        );
        assert!(say("ground = \"low\"").starts_with(", line 1, column 10: "));
        assert!(say("ground = 1.0 2.0").starts_with(", line 1, column 1"));
    }

    #[test]
    fn what_is_written_is_read() {
        let folder = tempfile::tempdir().unwrap();
        let scene = folder.path().join("a.ply");
        assert_eq!(read(&scene).unwrap(), None);
        let metadata = Metadata { up: Some(DVec3::NEG_Y), ground: Some(0.25), ..Metadata::default() };
        write_sidecar(&scene, &metadata).unwrap();
        assert_eq!(read(&scene).unwrap(), Some(metadata));
        assert!(folder.path().join("a.ply.wm.toml").is_file());
        let error = write_sidecar(&scene, &Metadata { ground: Some(f64::NAN), ..Metadata::default() });
        let expected = format!(
            "{}.wm.toml: not written: ground is NaN: it must be finite and within 10^10 units of zero",
            scene.display()
        );
        assert_eq!(error.unwrap_err().to_string(), expected);
    }
}
