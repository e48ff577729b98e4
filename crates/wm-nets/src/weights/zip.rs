//! The directory of a zip archive whose entries are uncompressed and that is below 4 GiB, as
//! PyTorch's are.
//!
//! Read here since the crate `zip` allocates what the archive's end claims.

use super::{MAX_HEADER, WeightsFault};
use std::collections::HashMap;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};

/// Bytes of the directory's end, without the comment behind it.
const END: usize = 22;
/// Bytes of an entry of the directory, without its name.
const ENTRY: usize = 46;
/// Bytes of the header before an entry's content, without its name.
const LOCAL: usize = 30;

/// The bytes of an entry's content, from the start of the file; the end is within the file.
#[derive(Clone, Copy, Debug)]
pub struct ZipPart {
    pub start: u64,
    pub size: u64,
}

/// The entries of an archive of `length` bytes by name.
pub fn directory(file: &mut File, length: u64) -> Result<HashMap<String, ZipPart>, WeightsFault> {
    // A comment of at most 65535 bytes stands behind the end.
    let tail = read(file, length.saturating_sub(END as u64 + 0xffff), length.min(END as u64 + 0xffff))?;
    let is_end = |at: &usize| {
        let end = &tail[*at..];
        end.starts_with(b"PK\x05\x06") && usize::from(u16_at(end, 20)) == end.len() - END
    };
    let last = tail.len().checked_sub(END).and_then(|last| (0..=last).rev().find(is_end));
    let end = &tail[last.ok_or_else(|| damaged("a zip archive without its end"))?..];
    let (size, start) = (u64::from(u32_at(end, 12)), u64::from(u32_at(end, 16)));
    if size == u64::from(u32::MAX) || start == u64::from(u32::MAX) {
        return Err(WeightsFault::NoTensors("a zip archive beyond 4 GiB"));
    }
    if start + size > length || size > MAX_HEADER {
        return Err(damaged("a zip archive's directory that is larger than the file"));
    }
    let directory = read(file, start, size)?;
    let (mut left, mut parts) = (&directory[..], HashMap::new());
    while !left.is_empty() {
        let sound = left.len() >= ENTRY && left.starts_with(b"PK\x01\x02");
        let lengths = if sound { [28, 30, 32].map(|at| usize::from(u16_at(left, at))) } else { [0; 3] };
        let whole = ENTRY + lengths.iter().sum::<usize>();
        if !sound || whole > left.len() {
            return Err(damaged("a zip archive's directory that breaks off"));
        }
        let (entry, rest) = left.split_at(whole);
        left = rest;
        let name = String::from_utf8_lossy(&entry[ENTRY..ENTRY + lengths[0]]).into_owned();
        let (flags, method) = (u16_at(entry, 8), u16_at(entry, 10));
        let (packed, size) = (u64::from(u32_at(entry, 20)), u64::from(u32_at(entry, 24)));
        if flags & 1 != 0 || method != 0 || packed != size {
            return Err(WeightsFault::NoTensors(
                "a zip archive that is compressed or locked, so none of PyTorch",
            ));
        }
        let at = u64::from(u32_at(entry, 42));
        let local = read(file, at, LOCAL as u64)?;
        if !local.starts_with(b"PK\x03\x04") {
            return Err(damaged("a zip archive whose entries are not where its directory says"));
        }
        let start = at + LOCAL as u64 + u64::from(u16_at(&local, 26)) + u64::from(u16_at(&local, 28));
        if start + size > length {
            return Err(damaged("a zip archive's entry that is larger than the file"));
        }
        parts.insert(name, ZipPart { start, size });
    }
    Ok(parts)
}

/// A part of a file; the caller has compared `size` with the file's or with a limit.
pub fn read(file: &mut File, start: u64, size: u64) -> Result<Vec<u8>, WeightsFault> {
    let mut bytes = Vec::new();
    file.seek(SeekFrom::Start(start))?;
    file.take(size).read_to_end(&mut bytes)?;
    if bytes.len() as u64 != size {
        return Err(damaged("it ends early"));
    }
    Ok(bytes)
}

fn damaged(what: &str) -> WeightsFault {
    WeightsFault::Damaged(what.into())
}

fn u16_at(bytes: &[u8], at: usize) -> u16 {
    u16::from_le_bytes([bytes[at], bytes[at + 1]])
}

fn u32_at(bytes: &[u8], at: usize) -> u32 {
    u32::from(u16_at(bytes, at)) | u32::from(u16_at(bytes, at + 2)) << 16
}
