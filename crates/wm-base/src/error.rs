//! Errors of files, printed in one line: the place, the problem and the remedy.

use std::{
    borrow::Cow,
    fmt,
    io::{self, ErrorKind},
    path::{Path, PathBuf},
    str::FromStr,
};
use thiserror::Error;

/// The error of reading or writing a scene, a sidecar or a capture.
///
/// Prints as one line: path, location, what is wrong, what to do.
#[derive(Debug, Error)]
#[error("{}{location}: {problem}", escaped(&path.display().to_string()))]
pub struct FormatError {
    /// The file or folder.
    pub path: PathBuf,
    /// The place in the file.
    pub location: Location,
    /// The problem at that place.
    pub problem: Problem,
}

/// A place in a file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Location {
    /// The file as a whole.
    #[default]
    Whole,
    /// Byte offset from the start, 0-based.
    Byte(u64),
    /// Line, 1-based.
    Line(u64),
    /// Line and column, both 1-based.
    LineColumn(u64, u64),
}

impl fmt::Display for Location {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Whole => Ok(()),
            Self::Byte(byte) => write!(f, ", byte {byte}"),
            Self::Line(line) => write!(f, ", line {line}"),
            Self::LineColumn(line, column) => write!(f, ", line {line}, column {column}"),
        }
    }
}

/// A problem with a file, and its remedy.
#[derive(Debug, Error)]
pub enum Problem {
    /// There is nothing at the path.
    #[error("no such file or folder; check the path")]
    Missing,
    /// The folder is not one that a 3DGS training wrote.
    #[error(
        "a folder with no point_cloud/iteration_*/point_cloud.ply, meta.json or lod-meta.json in it; give a scene \
         file, the folder that a 3DGS training wrote, or one of SOG"
    )]
    NotASceneFolder,
    /// The file has no byte.
    #[error("the file is empty; copy or export it again")]
    Empty,
    /// The content is of no known format.
    #[error("{found}; {advice}")]
    UnknownFormat {
        /// The formats that it does not have, and its first bytes, escaped.
        found: String,
        /// The remedy.
        advice: &'static str,
    },
    /// No format that can be written has the extension.
    #[error("no scene format is written to a name that ends in \"{extension}\"; use {known}")]
    UnknownExtension {
        /// The extension with its dot, or nothing.
        extension: String,
        /// The extensions that can be written.
        known: String,
    },
    /// The operating system refused to read.
    #[error("cannot be read: {0}")]
    Read(io::Error),
    /// The operating system refused to write.
    #[error(transparent)]
    Write(#[from] WriteFault),
    /// The file ends inside its header.
    #[error("cut off in the header: there is no end_header line; copy or download the file again")]
    HeaderTruncated,
    /// The header never ends.
    #[error("the header has no end_header line in its first {0} bytes; this is not a PLY that can be read")]
    HeaderTooLong(u64),
    /// A line of the header cannot be understood.
    #[error("{0}; export the file again")]
    Header(String),
    /// The file ends too early.
    #[error("cut off in {0}; copy or download the file again")]
    Cut(String),
    /// The file ends before its last splat.
    #[error(
        "cut off: the header promises {promised} splats, at least {missing} bytes are missing; copy or \
         download the file again"
    )]
    Truncated {
        /// Splats in the header.
        promised: u64,
        /// Bytes that are not there.
        missing: u128,
    },
    /// A text file ends before its last splat.
    #[error(
        "cut off: the header promises {promised} splats, the file ends after {found}; copy or download the \
         file again"
    )]
    TruncatedText {
        /// Splats in the header.
        promised: u64,
        /// Splats in the file.
        found: u64,
    },
    /// A property that every splat needs is not there.
    #[error("{reason}; a 3DGS file has x y z f_dc_0..2 opacity scale_0..2 rot_0..3")]
    Property {
        /// The name of the property, and what is wrong with it.
        reason: String,
    },
    /// The number of SH coefficients belongs to no degree.
    #[error("{0} f_rest properties fit no SH degree: 0, 9, 24, 45 or 72 do; export the file again")]
    ShCount(usize),
    /// Splats hold numbers that are not finite.
    #[error("{0}; export the scene again, or repair it, which leaves them out")]
    NonFinite(String),
    /// There is no splat.
    #[error("there are no splats in it; nothing can be shown")]
    NoSplats,
    /// A number cannot be read.
    #[error("\"{text}\" is not a number for {what}; correct it or export the file again")]
    Number {
        /// The text, escaped and shortened.
        text: String,
        /// The name of the number.
        what: String,
    },
    /// A value has a form or size that cannot be used.
    #[error("{0}")]
    Value(String),
    /// The arrays of a scene to be written do not fit each other.
    #[error("not written: {0}")]
    Splats(String),
    /// The folder has no capture.
    #[error(
        "no COLMAP model, transforms.json, reconstruction.json (OpenSfM) or bundle.out here: of COLMAP cameras.bin and images.bin (or both as .txt) are needed \
         in the folder itself, in sparse/0, sparse, 0, colmap/sparse/0 or sparse_txt"
    )]
    NoCapture,
    /// A photo cannot be used.
    #[error("{0}")]
    Photo(String),
    /// A camera model with distortion.
    #[error("camera {camera} has the model {model}, {advice}")]
    CameraModel {
        /// Number of the camera in the file.
        camera: u32,
        /// COLMAP's name of the model.
        model: String,
        /// The reason why it cannot be used, and the remedy.
        advice: &'static str,
    },
    /// A capture file ends too early.
    #[error("cut off in {what}; copy the file or export the model again")]
    CaptureTruncated {
        /// The camera, image or line.
        what: String,
    },
}

/// For writers, where only the output can fail.
impl From<io::Error> for Problem {
    fn from(error: io::Error) -> Self {
        Self::Write(error.into())
    }
}

impl FormatError {
    /// The problem with the file as a whole.
    #[must_use]
    pub fn whole(path: &Path, problem: Problem) -> Self {
        Self { path: path.into(), location: Location::Whole, problem }
    }

    /// An error of a file as a whole, in words.
    #[must_use]
    pub fn value(path: &Path, what: impl Into<String>) -> Self {
        Self::whole(path, Problem::Value(what.into()))
    }

    /// The problem at a place.
    #[must_use]
    pub fn at(path: &Path, location: Location, problem: Problem) -> Self {
        Self { path: path.into(), location, problem }
    }

    /// The error of reading `path`; a missing file has a problem of its own.
    #[must_use]
    pub fn reading(path: &Path, error: io::Error) -> Self {
        let problem = match error.kind() {
            ErrorKind::NotFound => Problem::Missing,
            _ => Problem::Read(error),
        };
        Self::whole(path, problem)
    }
}

/// Bytes of a file as text for a message: escaped, at most 32 of them.
pub fn excerpt(bytes: &[u8]) -> String {
    let cut = &bytes[..bytes.len().min(32)];
    let more = if cut.len() < bytes.len() { "..." } else { "" };
    format!("{}{more}", cut.escape_ascii())
}

/// The error of reading JSON from `path`; `advice` says how to correct its content.
pub fn json_fault(path: &Path, error: &serde_json::Error, advice: &str) -> FormatError {
    if let Some(kind) = error.io_error_kind() {
        return FormatError::reading(path, kind.into());
    }
    let place = Location::LineColumn(error.line() as u64, error.column() as u64);
    let message = one_line(&error.to_string());
    // The place is printed before the message.
    let message = message.rsplit_once(" at line ").map_or(message.as_str(), |(message, _)| message);
    FormatError::at(path, place, Problem::Value(format!("{message}; {advice}")))
}

/// The number that `word` spells; `what` says in the message what it is for.
pub fn number<T: FromStr>(word: &[u8], what: &str) -> Result<T, Problem> {
    let parsed = std::str::from_utf8(word).ok().and_then(|text| text.parse().ok());
    parsed.ok_or_else(|| Problem::Number { text: excerpt(word), what: excerpt(what.as_bytes()) })
}

/// The message of another library on one line, control characters escaped.
pub fn one_line(message: &str) -> String {
    let parts: Vec<&str> =
        message.split(['\n', '\r']).map(str::trim).filter(|part| !part.is_empty()).collect();
    escaped(&parts.join(", "))
}

/// The text with its control characters escaped: a name from a file may hold line breaks and codes
/// that a terminal acts on.
#[must_use]
pub fn escaped(text: &str) -> String {
    let escape = |c: char| if c.is_control() { c.escape_default().to_string() } else { c.to_string() };
    text.chars().map(escape).collect()
}

/// A text of several lines for a terminal: [`escaped`] but for line breaks and tabs.
#[must_use]
pub fn printable(text: &str) -> Cow<'_, str> {
    const KEPT: [char; 2] = ['\n', '\t'];
    if text.chars().all(|c| !c.is_control() || KEPT.contains(&c)) {
        return text.into();
    }
    text.split_inclusive(KEPT)
        .map(|part| {
            let plain = part.trim_end_matches(KEPT);
            escaped(plain) + &part[plain.len()..]
        })
        .collect()
}

/// The reason why a file cannot be written, and the remedy; printed after its path.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum WriteFault {
    /// The folder to write into does not exist.
    #[error("cannot be written: the folder \"{}\" does not exist; create it first", .0.display())]
    NoFolder(PathBuf),
    /// A folder is in the place of the file.
    #[error("cannot be written: it is a folder; name a file in it")]
    IsFolder,
    /// A device, pipe or socket is in the place of the file: it cannot be replaced by renaming.
    #[error("cannot be written: it is not a regular file; choose another name")]
    NotRegular,
    /// There is a file that its owner protected.
    #[error("cannot be written: it is write-protected; choose another name")]
    Protected,
    /// No right to write there.
    #[error("cannot be written: {0}; change the rights of its folder or write elsewhere")]
    Denied(io::Error),
    /// Beyond the largest file that the process or the file system allows.
    #[error(
        "cannot be written: larger than a file may be here; raise the limit (ulimit -f) or write elsewhere"
    )]
    TooLarge,
    /// No room.
    #[error("cannot be written: the disk is full; free some space or write elsewhere")]
    DiskFull,
    /// Anything else that the system refused.
    #[error("cannot be written: {0}; write elsewhere")]
    Other(io::Error),
}

impl From<io::Error> for WriteFault {
    fn from(error: io::Error) -> Self {
        use ErrorKind::{
            FileTooLarge, IsADirectory, PermissionDenied, QuotaExceeded, ReadOnlyFilesystem, StorageFull,
        };
        match error.kind() {
            StorageFull | QuotaExceeded => Self::DiskFull,
            PermissionDenied | ReadOnlyFilesystem => Self::Denied(error),
            IsADirectory => Self::IsFolder,
            FileTooLarge => Self::TooLarge,
            _ => Self::Other(error),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_terminal_is_told_nothing() {
        assert!(matches!(printable("Z\u{fc}rich\t1\n2"), Cow::Borrowed("Z\u{fc}rich\t1\n2")));
        assert_eq!(
            printable("a\u{1b}]0;title\u{7}\n\n\tb\u{9b}2J\u{7f}\r\n"),
            "a\\u{1b}]0;title\\u{7}\n\n\tb\\u{9b}2J\\u{7f}\\r\n"
        );
    }

    #[test]
    fn places_print_in_one_line() {
        let path = Path::new("a.ply");
        for (place, expected) in [
            (Location::Whole, "a.ply: the file is empty; copy or export it again"),
            (Location::Byte(7), "a.ply, byte 7: the file is empty; copy or export it again"),
            (Location::Line(3), "a.ply, line 3: the file is empty; copy or export it again"),
            (
                Location::LineColumn(3, 9),
                "a.ply, line 3, column 9: the file is empty; copy or export it again",
            ),
        ] {
            assert_eq!(FormatError::at(path, place, Problem::Empty).to_string(), expected);
        }
    }

    #[test]
    fn foreign_text_stays_on_one_line() {
        let error = FormatError::whole(Path::new("a\n\u{1b}[2Jb.png"), Problem::Empty);
        assert_eq!(error.to_string(), "a\\n\\u{1b}[2Jb.png: the file is empty; copy or export it again");
        assert_eq!(excerpt(b"a\nb\xff"), "a\\nb\\xff");
        assert_eq!(excerpt(&[b'x'; 40]), format!("{}...", "x".repeat(32)));
        assert_eq!(one_line("first\n  sec\u{7}ond\n"), "first, sec\\u{7}ond");
    }
}
