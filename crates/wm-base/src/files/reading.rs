//! The one way in which files of scenes are read: from the disk, or where there is none from those
//! that were fetched.

use super::fetched;
use std::{
    fs::{self, File},
    io::{self, BufRead, ErrorKind, Read},
    path::Path,
    sync::Arc,
};

/// A file that is open, and its length where that is known.
pub struct Opened {
    pub reader: Box<dyn Read>,
    pub length: Option<u64>,
}

/// The disk or the store of fetched files, one of which has a path.
enum Place {
    Disk,
    /// In the store of fetched files, with the content of the file if it is there.
    Store(Option<Arc<[u8]>>),
}

fn place_of(path: &Path) -> Place {
    if fetched::has(path) { Place::Store(fetched::get(path)) } else { Place::Disk }
}

/// Notes that a fetched file is wanted.
fn lacking<T>(path: &Path) -> io::Result<T> {
    fetched::want(path);
    Err(not_fetched())
}

fn not_fetched() -> io::Error {
    io::Error::new(ErrorKind::NotFound, "it is not fetched yet")
}

/// Reads a whole file.
///
/// # Errors
/// Errors of the system; [`ErrorKind::NotFound`] of a file that was not fetched, which is noted as
/// wanted.
pub fn read(path: &Path) -> io::Result<Vec<u8>> {
    match place_of(path) {
        Place::Disk => fs::read(path),
        Place::Store(file) => file.map_or_else(|| lacking(path), |bytes| Ok(bytes.to_vec())),
    }
}

/// The byte order mark of UTF-8, with which some programs begin a text.
pub const BYTE_ORDER_MARK: &[u8] = b"\xef\xbb\xbf";
/// The message for text in UTF-16 where only UTF-8 is read.
pub const UTF_16_REFUSED: &str = "text in UTF-16; save it as UTF-8";
/// The message for a file that was never downloaded.
pub const LFS_REFUSED: &str = "a Git LFS pointer; get the file itself with `git lfs pull`";

/// Bytes from the beginning of a file that tell how its text is encoded and whether it is a Git LFS
/// pointer.
pub const MARK_BYTES: usize = 32;

/// Returns true if a file begins as the text that Git LFS leaves in place of a file.
pub fn is_lfs_pointer(start: &[u8]) -> bool {
    start.starts_with(b"version https://git-lfs")
}

/// The message for a file whose first bytes show that it cannot be read as UTF-8 text.
pub fn refused_text(start: &[u8]) -> Option<&'static str> {
    match start {
        [0xff, 0xfe, ..] | [0xfe, 0xff, ..] => Some(UTF_16_REFUSED),
        _ if is_lfs_pointer(start) => Some(LFS_REFUSED),
        _ => None,
    }
}

/// Bytes of text without the byte order mark that they may begin with.
pub fn without_byte_order_mark(bytes: &[u8]) -> &[u8] {
    bytes.strip_prefix(BYTE_ORDER_MARK).unwrap_or(bytes)
}

/// Steps over the byte order mark with which a text in UTF-8 may begin.
///
/// # Errors
/// Errors of the reader; [`ErrorKind::InvalidData`] if the text is in UTF-16 or a Git LFS pointer.
pub fn skip_byte_order_mark<R: BufRead>(mut reader: R) -> io::Result<R> {
    let bytes = reader.fill_buf()?;
    if let Some(refused) = refused_text(bytes) {
        return Err(io::Error::new(ErrorKind::InvalidData, refused));
    }
    let length = if bytes.starts_with(BYTE_ORDER_MARK) { BYTE_ORDER_MARK.len() } else { 0 };
    reader.consume(length);
    Ok(reader)
}

/// Most bytes of a text that a person writes: a weather, a plan, a rig, a lens.
pub const SMALL_TEXT: u64 = 4 << 20;
/// Most bytes of a text that programs write: hourly tables, camera paths, facts with outlines.
pub const LARGE_TEXT: u64 = 256 << 20;

/// Reads a whole file of at most `most` bytes as text, see [`text_of`].
///
/// # Errors
/// As [`read`] and [`text_of`]; [`ErrorKind::InvalidInput`] if it is longer, or no regular file: a
/// pipe may never end, and a device is no text.
pub fn read_text(path: &Path, most: u64) -> io::Result<String> {
    let refused = |what: String| Err(io::Error::new(ErrorKind::InvalidInput, what));
    let Place::Disk = place_of(path) else { return text_of(read(path)?) };
    let about = fs::metadata(path)?;
    if about.is_dir() {
        return Err(ErrorKind::IsADirectory.into());
    }
    if !about.is_file() {
        return refused("no regular file; write the text into a file".into());
    }
    let mut bytes = Vec::new();
    // Files may grow while they are read, and the kernel's say that they are empty.
    File::open(path)?.take(most + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > most {
        return refused(format!(
            "longer than {} MiB, which is no text of this kind; check the name",
            most >> 20
        ));
    }
    text_of(bytes)
}

/// The text of bytes from outside: UTF-8, with or without a byte order mark, or UTF-16 with one, as
/// programs for Windows write both. The mark is no part of the text.
///
/// # Errors
/// [`ErrorKind::InvalidData`] if they are neither, or a Git LFS pointer.
pub fn text_of(bytes: Vec<u8>) -> io::Result<String> {
    let wrong = |text: String| io::Error::new(ErrorKind::InvalidData, text);
    let wide = |unit: fn([u8; 2]) -> u16| {
        let (units, rest) = bytes[2..].as_chunks::<2>();
        let text = String::from_utf16(&units.iter().map(|pair| unit(*pair)).collect::<Vec<_>>());
        text.ok()
            .filter(|_| rest.is_empty())
            .ok_or_else(|| wrong("damaged text in UTF-16; save it as UTF-8".into()))
    };
    match bytes[..] {
        _ if is_lfs_pointer(&bytes) => Err(wrong(LFS_REFUSED.into())),
        [0xff, 0xfe, ..] => wide(u16::from_le_bytes),
        [0xfe, 0xff, ..] => wide(u16::from_be_bytes),
        _ => {
            let mut text = String::from_utf8(bytes).map_err(|error| {
                let at = error.utf8_error().valid_up_to();
                wrong(format!("no text in UTF-8 (byte {at}); save it as UTF-8"))
            })?;
            if text.starts_with('\u{feff}') {
                text.drain(..'\u{feff}'.len_utf8());
            }
            Ok(text)
        }
    }
}

/// Reads a whole file that need not be there: `None` then, and nothing is noted.
///
/// # Errors
/// Errors of the system.
pub fn read_if_there(path: &Path) -> io::Result<Option<Vec<u8>>> {
    match place_of(path) {
        Place::Disk => match fs::read(path) {
            Ok(bytes) => Ok(Some(bytes)),
            Err(error) if error.kind() == ErrorKind::NotFound => Ok(None),
            Err(error) => Err(error),
        },
        Place::Store(file) => Ok(file.map(|bytes| bytes.to_vec())),
    }
}

/// Opens a file.
///
/// # Errors
/// As [`read`].
pub fn open(path: &Path) -> io::Result<Opened> {
    match place_of(path) {
        Place::Disk => {
            let file = File::open(path)?;
            let about = file.metadata()?;
            // Pipes have no length, and files that the kernel makes up say 0.
            let length = (about.is_file() && about.len() > 0).then_some(about.len());
            Ok(Opened { reader: Box::new(file), length })
        }
        Place::Store(None) => lacking(path),
        Place::Store(Some(bytes)) => {
            let length = Some(bytes.len() as u64).filter(|length| *length > 0);
            Ok(Opened { reader: Box::new(io::Cursor::new(bytes)), length })
        }
    }
}

/// Returns true if a path is a folder, false if it is something else.
///
/// # Errors
/// As [`read`] where there is nothing.
pub fn is_folder(path: &Path) -> io::Result<bool> {
    match place_of(path) {
        Place::Disk => Ok(fs::metadata(path)?.is_dir()),
        Place::Store(Some(_)) => Ok(false),
        Place::Store(None) if fetched::is_folder(path) => Ok(true),
        Place::Store(None) => lacking(path),
    }
}

/// Returns true if a path is a regular file, false if it is something else.
///
/// # Errors
/// Errors of the system; [`ErrorKind::NotFound`] of a file that was not fetched. Nothing is noted.
pub fn is_file(path: &Path) -> io::Result<bool> {
    match place_of(path) {
        Place::Disk => Ok(fs::metadata(path)?.is_file()),
        Place::Store(Some(_)) => Ok(true),
        Place::Store(None) if fetched::is_folder(path) => Ok(false),
        Place::Store(None) => Err(not_fetched()),
    }
}

/// Returns true if there is a file or a folder with a path. Nothing is noted.
#[must_use]
pub fn is_there(path: &Path) -> bool {
    match place_of(path) {
        Place::Disk => path.exists(),
        Place::Store(file) => file.is_some() || fetched::is_folder(path),
    }
}

/// Returns true if a file has to be fetched before it can be read. Nothing is noted.
#[must_use]
pub fn is_lacking(path: &Path) -> bool {
    matches!(place_of(path), Place::Store(None))
}

/// Notes that a file has to be fetched, if it does.
pub fn want(path: &Path) {
    if is_lacking(path) {
        fetched::want(path);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn marks_of_byte_order_are_no_part_of_a_text() {
        let wide = |mark: [u8; 2], unit: fn(u16) -> [u8; 2]| {
            mark.into_iter().chain("a \u{b0}\u{1f327}".encode_utf16().flat_map(unit)).collect::<Vec<u8>>()
        };
        let text = "a \u{b0}\u{1f327}";
        for bytes in [
            text.as_bytes().to_vec(),
            format!("\u{feff}{text}").into_bytes(),
            wide([0xff, 0xfe], u16::to_le_bytes),
            wide([0xfe, 0xff], u16::to_be_bytes),
        ] {
            assert_eq!(text_of(bytes).unwrap(), text);
        }
        for (bytes, says) in [
            (&b"version https://git-lfs.github.com/spec/v1\n"[..], LFS_REFUSED),
            (b"ab\xff", "no text in UTF-8 (byte 2); save it as UTF-8"),
            (b"\xff\xfea", "damaged text in UTF-16; save it as UTF-8"),
            (b"\xfe\xff\xd8\x00", "damaged text in UTF-16; save it as UTF-8"),
        ] {
            let error = text_of(bytes.to_vec()).unwrap_err();
            assert_eq!((error.kind(), error.to_string().as_str()), (ErrorKind::InvalidData, says));
        }
    }
}
