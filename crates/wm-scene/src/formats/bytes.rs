//! A file in memory, read from front to back, and what may be unpacked from it.

use sirocco::inflate;
use std::io::{self, Read};
use wm_base::error::Problem;

/// Bytes that are taken from the front.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Bytes<'a> {
    left: &'a [u8],
    /// The name of the part of the file, for messages.
    what: &'static str,
}

impl<'a> Bytes<'a> {
    /// `what` names the part in messages about its end.
    pub(crate) fn new(bytes: &'a [u8], what: &'static str) -> Self {
        Self { left: bytes, what }
    }

    /// The next `count` bytes.
    ///
    /// # Errors
    /// If there are fewer.
    pub(crate) fn take(&mut self, count: u64) -> Result<&'a [u8], Problem> {
        let split = usize::try_from(count).ok().and_then(|count| self.left.split_at_checked(count));
        let (taken, left) = split.ok_or_else(|| {
            let missing = count - self.left.len() as u64;
            Problem::Cut(format!("{}: at least {missing} bytes are missing", self.what))
        })?;
        self.left = left;
        Ok(taken)
    }

    /// The next `N` bytes.
    ///
    /// # Errors
    /// If there are fewer.
    pub(crate) fn array<const N: usize>(&mut self) -> Result<[u8; N], Problem> {
        let mut array = [0; N];
        array.copy_from_slice(self.take(N as u64)?);
        Ok(array)
    }

    /// The next little-endian number.
    ///
    /// # Errors
    /// If there are too few bytes.
    pub(crate) fn u32(&mut self) -> Result<u32, Problem> {
        self.array().map(u32::from_le_bytes)
    }

    /// The bytes not taken.
    pub(crate) fn rest(&self) -> &'a [u8] {
        self.left
    }
}

/// Rows of `N` bytes.
pub(crate) fn rows<const N: usize>(bytes: &[u8]) -> impl ExactSizeIterator<Item = &[u8; N]> {
    bytes.as_chunks::<N>().0.iter()
}

/// The 32-bit little-endian floats of a row.
pub(crate) fn floats<const N: usize>(row: &[u8]) -> [f32; N] {
    let mut numbers = row.as_chunks().0.iter().map(|b| f32::from_le_bytes(*b));
    std::array::from_fn(|_| numbers.next().unwrap_or_default())
}

/// A reader of a gzip file, member after member.
pub(crate) struct Gunzip<'a>(inflate::Reader<&'a [u8]>);

impl<'a> Gunzip<'a> {
    /// Reads the first member of `packed`.
    pub(crate) fn new(packed: &'a [u8]) -> Self {
        Self(inflate::Reader::new(sirocco::Format::Gzip, packed))
    }
}

impl Read for Gunzip<'_> {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        loop {
            let (count, rest) = (self.0.read(out)?, *self.0.get_ref());
            if count > 0 || out.is_empty() || rest.is_empty() {
                return Ok(count);
            }
            *self = Self::new(rest);
        }
    }
}

/// Bytes that may be unpacked where `packed` are given: scenes shrink two to twenty times, bombs a
/// thousand times.
pub(crate) fn unpacked_limit(packed: u64) -> u64 {
    (64 << 20) + packed.saturating_mul(100)
}

/// Unpacks `out.len()` bytes.
///
/// # Errors
/// If there are fewer or they cannot be unpacked.
pub(crate) fn unpack_exact(reader: &mut dyn Read, out: &mut [u8], what: &str) -> Result<(), Problem> {
    reader.read_exact(out).map_err(|error| match error.kind() {
        io::ErrorKind::UnexpectedEof => {
            Problem::Cut(format!("{what}: it unpacks to less than its header says"))
        }
        _ => Problem::Header(format!(
            "{what} cannot be unpacked ({})",
            wm_base::error::one_line(&error.to_string())
        )),
    })
}

/// Refuses more than may be unpacked from a file.
///
/// # Errors
/// If `wanted` is above [`unpacked_limit`].
pub(crate) fn check_unpacked(wanted: u64, packed: u64, what: &str) -> Result<(), Problem> {
    if wanted <= unpacked_limit(packed) {
        return Ok(());
    }
    Err(Problem::Header(format!("{what} says that {packed} bytes unpack to {wanted}, which no scene does")))
}
