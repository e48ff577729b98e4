//! Reading the files of logs: whole, within limits, with errors of one line.

use glam::{DMat3, DQuat, DVec3};
use serde::de::{DeserializeOwned, DeserializeSeed, Error as _, SeqAccess, Visitor};
use std::fmt;
use std::fs::{self, File};
use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};
use wm_base::error::{json_fault, one_line};
use wm_base::{FormatError, Location, Problem, files};
use wm_scene::camera::rotation_of;

use crate::RigidPose;

/// Longest text file, bytes: 100 hours of poses.
const MAX_TEXT_BYTES: u64 = 64 << 20;
/// Longest sweep or picture, bytes.
pub(super) const MAX_BINARY_BYTES: u64 = 512 << 20;
/// Longest table in JSON, bytes; it is read record by record.
const MAX_TABLE_BYTES: u64 = 16 << 30;
/// Most files of a folder that are listed.
const MAX_FILES: usize = 1_000_000;
/// The advice for a file of a log that is damaged.
pub(super) const COPY_ADVICE: &str = "copy the file again";
/// Farthest that anything may be from the origin of a map, m: once around the world.
const MAX_DISTANCE_M: f64 = 5e7;

/// A fault of a file as a whole.
pub(super) fn fault(path: &Path, what: impl Into<String>) -> FormatError {
    FormatError::value(path, one_line(&what.into()))
}

/// A fault in a line of a file, from 1.
pub(super) fn fault_in_line(path: &Path, line: usize, what: impl Into<String>) -> FormatError {
    FormatError::at(path, Location::Line(line as u64), Problem::Value(one_line(&what.into())))
}

/// A part of a text for a message.
pub(super) fn excerpt(text: &str) -> String {
    let cut: String = text.chars().take(32).collect();
    let more = if cut.len() < text.len() { "..." } else { "" };
    format!("{}{more}", cut.escape_debug())
}

/// Names for a message: at most a dozen.
pub(super) fn shown(names: impl Iterator<Item = String>) -> String {
    const MAX_NAMES: usize = 12;
    let mut names: Vec<String> = names.take(MAX_NAMES + 1).collect();
    if names.len() > MAX_NAMES {
        names[MAX_NAMES] = "...".into();
    }
    names.join(", ")
}

/// Reads a file of at most `most` bytes.
///
/// # Errors
/// It is missing, cannot be read, or is longer.
pub(super) fn read_bytes(path: &Path, most: u64) -> Result<Vec<u8>, FormatError> {
    let (file, length) = opened(path, most)?;
    let mut bytes = Vec::with_capacity(length as usize);
    // Files may grow while they are read.
    file.take(most).read_to_end(&mut bytes).map_err(|e| FormatError::reading(path, e))?;
    Ok(bytes)
}

/// Opens a file of at most `most` bytes, and tells how many it has.
fn opened(path: &Path, most: u64) -> Result<(File, u64), FormatError> {
    let reading = |e| FormatError::reading(path, e);
    let file = File::open(path).map_err(reading)?;
    let length = file.metadata().map_err(reading)?.len();
    if length > most {
        return Err(fault(path, format!("{length} bytes are too many: {most} are read at most")));
    }
    Ok((file, length))
}

/// Reads a text file, without a byte order mark.
///
/// # Errors
/// As [`read_bytes`], and if it is no UTF-8.
pub(super) fn read_text(path: &Path) -> Result<String, FormatError> {
    let bytes = read_bytes(path, MAX_TEXT_BYTES)?;
    files::text_of(bytes).map_err(|error| FormatError::reading(path, error))
}

/// The records of a file with one line each, whose number is that of the line: `None` where the
/// line is empty, since the record is missing there. Empty lines at the end are none.
///
/// # Errors
/// As [`read_text`]; each record has its own.
pub(super) fn line_records<T>(
    path: &Path,
    mut read: impl FnMut(usize, &str) -> Result<T, FormatError>,
) -> Result<Vec<Option<Result<T, FormatError>>>, FormatError> {
    let text = read_text(path)?;
    let mut records = Vec::new();
    for (index, line) in text.trim_end().lines().map(str::trim).enumerate() {
        records.push((!line.is_empty()).then(|| read(index + 1, line)));
    }
    Ok(records)
}

/// The numbers of one line, separated by blanks.
///
/// # Errors
/// A word is no finite number.
pub(super) fn numbers(path: &Path, line: usize, text: &str) -> Result<Vec<f64>, FormatError> {
    let number = |word: &str| match word.parse::<f64>() {
        Ok(value) if value.is_finite() => Ok(value),
        _ => Err(fault_in_line(path, line, format!("\"{}\" is not a finite number", excerpt(word)))),
    };
    text.split_whitespace().map(number).collect()
}

/// All numbers of a small text file, over all lines.
///
/// # Errors
/// As [`read_text`] and [`numbers`].
pub(super) fn all_numbers(path: &Path) -> Result<Vec<f64>, FormatError> {
    let text = read_text(path)?;
    let mut all = Vec::new();
    for (index, line) in text.lines().enumerate() {
        all.extend(numbers(path, index + 1, line)?);
    }
    Ok(all)
}

/// A pose of a matrix of 3 or 4 rows of 4, row by row.
///
/// # Errors
/// The fault, in words.
pub(super) fn pose_of_rows(numbers: &[f64]) -> Result<RigidPose, String> {
    let ([a, b, c, x, d, e, f, y, g, h, i, z] | [a, b, c, x, d, e, f, y, g, h, i, z, _, _, _, _]) = numbers
    else {
        return Err(format!("a pose has 12 or 16 numbers, not {}", numbers.len()));
    };
    let axes = DMat3::from_cols_array(&[*a, *d, *g, *b, *e, *h, *c, *f, *i]);
    pose_of(&axes, DVec3::new(*x, *y, *z))
}

/// A pose of axes (columns) and a translation.
///
/// # Errors
/// The fault, in words.
pub(super) fn pose_of(axes: &DMat3, translation: DVec3) -> Result<RigidPose, String> {
    let axes = rotation_of(axes).map_err(|e| format!("the matrix is not a rotation: {e}"))?;
    Ok(RigidPose::new(axes, checked(translation)?))
}

/// A pose of a quaternion w, x, y, z and a translation.
///
/// # Errors
/// The fault, in words.
pub(super) fn pose_of_quaternion(wxyz: [f64; 4], translation: DVec3) -> Result<RigidPose, String> {
    let [w, x, y, z] = wxyz;
    let rotation = DQuat::from_xyzw(x, y, z, w);
    let length = rotation.length();
    // Written so that NaN is refused.
    let is_unit = (length - 1.0).abs() < 0.01;
    if !is_unit {
        return Err(format!("the quaternion has the length {length}, not 1"));
    }
    Ok(RigidPose { rotation: rotation.normalize(), translation: checked(translation)? })
}

/// A position that can be one.
fn checked(position: DVec3) -> Result<DVec3, String> {
    let is_near = position.abs().max_element() < MAX_DISTANCE_M;
    if is_near && position.is_finite() {
        Ok(position)
    } else {
        Err(format!("the position {position} is not within {MAX_DISTANCE_M:e} m"))
    }
}

/// The files of a folder with one of the extensions, sorted by their stems: by number where both
/// are numbers.
///
/// # Errors
/// The folder is missing, cannot be read, or has too many files.
pub(super) fn files_in(folder: &Path, extensions: &[&str]) -> Result<Vec<(String, PathBuf)>, FormatError> {
    let reading = |e| FormatError::reading(folder, e);
    let mut files = Vec::new();
    for entry in fs::read_dir(folder).map_err(reading)? {
        let path = entry.map_err(reading)?.path();
        let has_extension = path
            .extension()
            .is_some_and(|extension| extensions.iter().any(|known| extension.eq_ignore_ascii_case(known)));
        let stem = path.file_stem().and_then(|stem| stem.to_str()).map(str::to_owned);
        if let (true, Some(stem)) = (has_extension, stem) {
            files.push((stem, path));
        }
        if files.len() > MAX_FILES {
            return Err(fault(folder, format!("it has more than {MAX_FILES} files")));
        }
    }
    files.sort_by(|(a, _), (b, _)| {
        let by_number = a.parse::<u64>().ok().cmp(&b.parse::<u64>().ok());
        by_number.then_with(|| a.cmp(b))
    });
    Ok(files)
}

/// The files of [`files_in`]; none if there is no such folder.
///
/// # Errors
/// As [`files_in`].
pub(super) fn files_if_there(
    folder: &Path,
    extensions: &[&str],
) -> Result<Vec<(String, PathBuf)>, FormatError> {
    if folder.is_dir() { files_in(folder, extensions) } else { Ok(Vec::new()) }
}

/// Returns true if a folder has a file with one of the extensions.
pub(super) fn has_files(folder: &Path, extensions: &[&str]) -> bool {
    files_in(folder, extensions).is_ok_and(|files| !files.is_empty())
}

/// The folders in a folder, sorted by name; none if it cannot be read.
pub(super) fn folders_in(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten().take(MAX_FILES);
    let mut folders: Vec<PathBuf> = entries.map(|entry| entry.path()).filter(|path| path.is_dir()).collect();
    folders.sort();
    folders
}

/// The name of a file or folder.
pub(super) fn name_of(path: &Path) -> String {
    path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default()
}

/// Reads a JSON list record by record: memory is needed for what `take` keeps.
///
/// # Errors
/// As [`read_bytes`], and with line and column if it is no list of such records, or `take` refuses
/// one.
pub(super) fn read_table<T: DeserializeOwned>(
    path: &Path,
    mut take: impl FnMut(T) -> Result<(), String>,
) -> Result<(), FormatError> {
    struct Records<'a, T, F>(&'a mut F, std::marker::PhantomData<T>);

    impl<'de, T: DeserializeOwned, F: FnMut(T) -> Result<(), String>> Visitor<'de> for Records<'_, T, F> {
        type Value = ();

        fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            f.write_str("a list of records")
        }

        fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<(), A::Error> {
            while let Some(record) = list.next_element::<T>()? {
                (self.0)(record).map_err(A::Error::custom)?;
            }
            Ok(())
        }
    }

    impl<'de, T: DeserializeOwned, F: FnMut(T) -> Result<(), String>> DeserializeSeed<'de> for Records<'_, T, F> {
        type Value = ();

        fn deserialize<D: serde::Deserializer<'de>>(self, deserializer: D) -> Result<(), D::Error> {
            deserializer.deserialize_seq(self)
        }
    }

    let input = open_table(path)?;
    let mut deserializer = serde_json::Deserializer::from_reader(input);
    Records(&mut take, std::marker::PhantomData)
        .deserialize(&mut deserializer)
        .and_then(|()| deserializer.end())
        .map_err(|error| json_fault(path, &error, COPY_ADVICE))
}

/// Reads one JSON value; `advice` says how to correct its content.
///
/// # Errors
/// As [`read_table`].
pub(crate) fn read_json<T: DeserializeOwned>(path: &Path, advice: &str) -> Result<T, FormatError> {
    serde_json::from_reader(open_table(path)?).map_err(|error| json_fault(path, &error, advice))
}

fn open_table(path: &Path) -> Result<BufReader<File>, FormatError> {
    let (file, _) = opened(path, MAX_TABLE_BYTES)?;
    let reader = BufReader::with_capacity(1 << 18, file);
    files::skip_byte_order_mark(reader).map_err(|e| FormatError::reading(path, e))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_are_read_record_by_record() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.json");
        let say = |text: &str| {
            fs::write(&path, text).unwrap();
            let mut all = Vec::new();
            let done = read_table::<u8>(&path, |v| {
                all.push(v);
                if v == 9 { Err("nine".into()) } else { Ok(()) }
            });
            done.map(|()| all).map_err(|e| e.to_string().replace(&path.display().to_string(), "F"))
        };
        assert_eq!(say("[1, 2,\n3]"), Ok(vec![1, 2, 3]));
        assert_eq!(say("[1,\n9]"), Err("F, line 2, column 2: nine; copy the file again".into()));
        for bad in ["", "[", "[1", "[1]x", "{}", "[300]"] {
            assert!(say(bad).unwrap_err().ends_with("; copy the file again"), "{bad}");
        }
    }

    #[test]
    fn poses_are_checked() {
        let one = [1.0, 0.0, 0.0, 7.0, 0.0, 1.0, 0.0, 8.0, 0.0, 0.0, 1.0, 9.0];
        assert_eq!(pose_of_rows(&one).unwrap().translation, DVec3::new(7.0, 8.0, 9.0));
        assert!(pose_of_rows(&one[..11]).is_err());
        for (index, value) in [(0, 2.0), (3, 1e300), (5, f64::NAN), (10, -1.0)] {
            let mut bad = one;
            bad[index] = value;
            assert!(pose_of_rows(&bad).is_err(), "{index}");
        }
        assert!(pose_of_quaternion([0.0; 4], DVec3::ZERO).is_err());
        assert!(pose_of_quaternion([f64::NAN, 0.0, 0.0, 1.0], DVec3::ZERO).is_err());
        assert!(pose_of_quaternion([0.0, 0.0, 0.0, 1.0], DVec3::ZERO).is_ok());
    }

    #[test]
    fn files_are_in_the_order_of_their_numbers() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["10.bin", "9.bin", "a.bin", "8.txt"] {
            fs::write(folder.path().join(name), "").unwrap();
        }
        let names: Vec<String> =
            files_in(folder.path(), &["bin"]).unwrap().into_iter().map(|f| f.0).collect();
        assert_eq!(names, ["a", "9", "10"]);
        assert!(files_in(&folder.path().join("no"), &[]).is_err());
    }
}
