//! A file read in blocks: the one way in which readers of this crate see bytes.

use crate::{
    error::{FormatError, Location, Problem},
    files::{self, BYTE_ORDER_MARK, LFS_REFUSED, MARK_BYTES, is_lfs_pointer, refused_text},
};
use std::{
    io::{self, Read},
    path::{Path, PathBuf},
};

/// Bytes read at once.
const BLOCK_BYTES: usize = 1 << 20;

/// Longest line that is looked at, bytes; longer ones can only be skipped.
pub const MAX_LINE_BYTES: usize = 1 << 20;

/// A byte stream with one block in memory, its position, and its length if that is known.
pub struct Source<'a> {
    path: PathBuf,
    reader: Box<dyn Read + 'a>,
    /// Bytes in all, where the stream is a regular file.
    length: Option<u64>,
    buffer: Vec<u8>,
    start: usize,
    end: usize,
    /// Offset in the file of `buffer[start]`.
    offset: u64,
    /// Lines taken so far.
    lines: u64,
    /// The ending of the line taken last.
    ending: Ending,
}

/// The ending of a line.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Ending {
    Newline,
    EndOfFile,
}

impl<'a> Source<'a> {
    /// Opens a file.
    ///
    /// # Errors
    /// If it cannot be opened, or is a Git LFS pointer.
    pub fn open(path: &Path) -> Result<Self, FormatError> {
        let opened = files::open(path).map_err(|e| FormatError::reading(path, e))?;
        let mut source = Self::new(path, opened.reader, opened.length);
        source.fill(MARK_BYTES)?;
        if is_lfs_pointer(source.bytes()) {
            return Err(source.whole(Problem::Value(LFS_REFUSED.into())));
        }
        Ok(source)
    }

    /// A stream of which `path` is the name in messages.
    pub fn new(path: &Path, reader: Box<dyn Read + 'a>, length: Option<u64>) -> Self {
        let block = length.map_or(BLOCK_BYTES, |l| l.clamp(256, BLOCK_BYTES as u64) as usize);
        let buffer = vec![0; block];
        let path = path.into();
        Self { path, reader, length, buffer, start: 0, end: 0, offset: 0, lines: 0, ending: Ending::Newline }
    }

    /// The name in messages.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Bytes from here to the end, if the length is known.
    pub fn remaining(&self) -> Option<u64> {
        self.length.map(|length| length.saturating_sub(self.offset))
    }

    /// Offset of the next byte.
    pub fn offset(&self) -> u64 {
        self.offset
    }

    /// The bytes in memory from here on; [`Self::fill`] makes more.
    pub fn bytes(&self) -> &[u8] {
        &self.buffer[self.start..self.end]
    }

    /// Makes [`Self::bytes`] at least `wanted` long; `false` if the stream ends before.
    ///
    /// # Errors
    /// If reading fails.
    pub fn fill(&mut self, wanted: usize) -> Result<bool, FormatError> {
        if self.end - self.start >= wanted {
            return Ok(true);
        }
        self.buffer.copy_within(self.start..self.end, 0);
        self.end -= self.start;
        self.start = 0;
        if self.buffer.len() < wanted {
            self.buffer.resize(wanted.next_power_of_two(), 0);
        }
        while self.end < wanted {
            match self.reader.read(&mut self.buffer[self.end..]) {
                Ok(0) => return Ok(false),
                Ok(count) => self.end += count,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(self.whole(Problem::Read(error))),
            }
        }
        Ok(true)
    }

    /// Steps over the byte order mark that a text may begin with, at the beginning of the stream.
    ///
    /// # Errors
    /// If reading fails, or the text is in UTF-16 or a Git LFS pointer.
    pub fn skip_byte_order_mark(&mut self) -> Result<(), FormatError> {
        if self.offset > 0 {
            return Ok(());
        }
        self.fill(MARK_BYTES)?;
        if let Some(refused) = refused_text(self.bytes()) {
            return Err(self.whole(Problem::Value(refused.into())));
        }
        if self.bytes().starts_with(BYTE_ORDER_MARK) {
            self.consume(BYTE_ORDER_MARK.len());
        }
        Ok(())
    }

    /// Steps over `count` bytes of [`Self::bytes`].
    pub fn consume(&mut self, count: usize) {
        assert!(count <= self.end - self.start, "{count} bytes consumed, fewer are there");
        self.start += count;
        self.offset += count as u64;
    }

    /// Steps over `count` bytes; gives how many of them are not there.
    ///
    /// # Errors
    /// If reading fails.
    pub fn skip(&mut self, count: u128) -> Result<u128, FormatError> {
        let mut left = count;
        while left > 0 && self.fill(1)? {
            let step = self.bytes().len().min(usize::try_from(left).unwrap_or(usize::MAX));
            self.consume(step);
            left -= step as u128;
        }
        Ok(left)
    }

    /// The next `N` bytes; `None` if the stream ends before.
    ///
    /// # Errors
    /// If reading fails.
    pub fn take<const N: usize>(&mut self) -> Result<Option<[u8; N]>, FormatError> {
        if !self.fill(N)? {
            return Ok(None);
        }
        let taken = self.bytes().first_chunk().copied();
        self.consume(N);
        Ok(taken)
    }

    /// All bytes from here on.
    ///
    /// # Errors
    /// If reading fails or they do not fit into memory.
    pub fn rest(&mut self) -> Result<Vec<u8>, FormatError> {
        let mut rest = Vec::new();
        // A length is that of a file: its bytes are there, unless it changes at this moment.
        let length = usize::try_from(self.remaining().unwrap_or(0)).unwrap_or(usize::MAX);
        rest.try_reserve_exact(length)
            .map_err(|_| self.whole(Problem::Value(format!("its {length} bytes do not fit into memory"))))?;
        rest.extend_from_slice(self.bytes());
        self.consume(rest.len());
        let count = self.reader.read_to_end(&mut rest).map_err(|e| self.whole(Problem::Read(e)))?;
        self.offset += count as u64;
        Ok(rest)
    }

    /// Parses all bytes from here on; `parse` gets the path too.
    ///
    /// # Errors
    /// The errors of [`Self::rest`] and of `parse`.
    pub fn parsed<T>(
        &mut self,
        parse: impl FnOnce(&[u8], &Path) -> Result<T, Problem>,
    ) -> Result<T, FormatError> {
        let bytes = self.rest()?;
        parse(&bytes, &self.path).map_err(|problem| self.whole(problem))
    }

    /// The next line without its LF or CRLF; `None` at the end. The last line may lack its ending.
    ///
    /// # Errors
    /// If reading fails or the line is longer than [`MAX_LINE_BYTES`].
    pub fn line(&mut self) -> Result<Option<&[u8]>, FormatError> {
        self.skip_byte_order_mark()?;
        let mut searched = 0;
        let length = loop {
            let bytes = self.bytes();
            if let Some(found) = bytes[searched..].iter().position(|b| *b == b'\n') {
                self.ending = Ending::Newline;
                break searched + found;
            }
            searched = bytes.len();
            if searched > MAX_LINE_BYTES {
                self.lines += 1;
                return Err(
                    self.at_line(Problem::Value(format!("the line is longer than {MAX_LINE_BYTES} bytes")))
                );
            }
            if !self.fill(searched + 1)? {
                if searched == 0 {
                    return Ok(None);
                }
                self.ending = Ending::EndOfFile;
                break searched;
            }
        };
        let from = self.start;
        self.consume(length + usize::from(self.ending == Ending::Newline));
        self.lines += 1;
        let line = &self.buffer[from..from + length];
        Ok(Some(line.strip_suffix(b"\r").unwrap_or(line)))
    }

    /// Returns true if the line taken last has no ending: it may be a part of one.
    pub fn is_cut(&self) -> bool {
        self.ending == Ending::EndOfFile
    }

    /// Steps over a line of any length; gives the number of words in it, `None` at the end.
    ///
    /// # Errors
    /// If reading fails.
    pub fn skip_line(&mut self) -> Result<Option<u64>, FormatError> {
        self.skip_byte_order_mark()?;
        if !self.fill(1)? {
            return Ok(None);
        }
        self.lines += 1;
        let (mut words, mut in_word) = (0, false);
        while self.fill(1)? {
            let bytes = self.bytes();
            let end = bytes.iter().position(|b| *b == b'\n');
            for byte in &bytes[..end.unwrap_or(bytes.len())] {
                let is_word = !byte.is_ascii_whitespace();
                words += u64::from(is_word && !in_word);
                in_word = is_word;
            }
            let step = end.map_or(bytes.len(), |at| at + 1);
            self.consume(step);
            if end.is_some() {
                break;
            }
        }
        Ok(Some(words))
    }

    /// The next word of the present line; `None` at its end, which is stepped over. So lines of any
    /// length are read, unlike with [`Self::line`].
    ///
    /// # Errors
    /// If reading fails or the word is longer than 256 bytes.
    pub fn word(&mut self) -> Result<Option<&[u8]>, FormatError> {
        self.skip_byte_order_mark()?;
        const MAX_WORD_BYTES: usize = 256;
        loop {
            if !self.fill(1)? {
                self.ending = Ending::EndOfFile;
                return Ok(None);
            }
            match self.bytes().iter().position(|b| *b == b'\n' || !b.is_ascii_whitespace()) {
                None => self.consume(self.bytes().len()),
                Some(at) => {
                    self.consume(at);
                    break;
                }
            }
        }
        if self.bytes()[0] == b'\n' {
            self.consume(1);
            self.lines += 1;
            self.ending = Ending::Newline;
            return Ok(None);
        }
        let mut searched = 0;
        let length = loop {
            let bytes = self.bytes();
            if let Some(found) = bytes[searched..].iter().position(u8::is_ascii_whitespace) {
                break searched + found;
            }
            searched = bytes.len();
            if searched > MAX_WORD_BYTES {
                break searched;
            }
            if !self.fill(searched + 1)? {
                self.ending = Ending::EndOfFile;
                break searched;
            }
        };
        if length > MAX_WORD_BYTES {
            self.lines += 1;
            return Err(self.at_line(Problem::Value(format!("a word is longer than {MAX_WORD_BYTES} bytes"))));
        }
        let from = self.start;
        self.consume(length);
        Ok(Some(&self.buffer[from..from + length]))
    }

    /// A problem with the whole stream.
    pub fn whole(&self, problem: Problem) -> FormatError {
        FormatError::whole(&self.path, problem)
    }

    /// A problem in the line of which [`Self::word`] gave the last word.
    pub fn in_line(&self, problem: Problem) -> FormatError {
        FormatError::at(&self.path, Location::Line(self.lines + 1), problem)
    }

    /// A problem in the line that was taken last.
    pub fn at_line(&self, problem: Problem) -> FormatError {
        FormatError::at(&self.path, Location::Line(self.lines), problem)
    }

    /// A problem at a byte.
    pub fn at_byte(&self, byte: u64, problem: Problem) -> FormatError {
        FormatError::at(&self.path, Location::Byte(byte), problem)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Gives one byte a call, so that every request straddles.
    struct Drip<'a>(&'a [u8]);

    impl Read for Drip<'_> {
        fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
            let Some((first, rest)) = self.0.split_first() else { return Ok(0) };
            out[0] = *first;
            self.0 = rest;
            Ok(1)
        }
    }

    fn source(bytes: &[u8]) -> Source<'_> {
        Source::new(Path::new("test"), Box::new(Drip(bytes)), Some(bytes.len() as u64))
    }

    #[test]
    fn lines_of_every_ending() {
        let mut source = source(b"one\r\n\ntwo words \nend");
        assert_eq!(source.line().unwrap(), Some(&b"one"[..]));
        assert_eq!(source.line().unwrap(), Some(&b""[..]));
        assert_eq!(source.skip_line().unwrap(), Some(2));
        assert!(!source.is_cut());
        assert_eq!(source.line().unwrap(), Some(&b"end"[..]));
        assert!(source.is_cut());
        assert_eq!(source.line().unwrap(), None);
        assert_eq!(source.skip_line().unwrap(), None);
        assert_eq!(source.remaining(), Some(0));
        assert_eq!(source.at_line(Problem::Empty).location, Location::Line(4));
    }

    #[test]
    fn words_end_with_their_line() {
        let mut words = source(b" one  two\r\n\nthree");
        let expected = [Some("one"), Some("two"), None, None, Some("three"), None, None];
        for (index, word) in expected.into_iter().enumerate() {
            assert_eq!(words.word().unwrap(), word.map(str::as_bytes), "{index}");
        }
        assert!(words.is_cut());
        let long = [b'x'; 300];
        let error = Source::new(Path::new("test"), Box::new(&long[..]), None).word().unwrap_err();
        assert_eq!(error.to_string(), "test, line 1: a word is longer than 256 bytes");
    }

    #[test]
    fn bytes_are_taken_and_skipped() {
        let data: Vec<u8> = (0..=255).cycle().take(1000).collect();
        let mut source = source(&data);
        assert_eq!(source.take::<3>().unwrap(), Some([0, 1, 2]));
        assert_eq!(source.skip(990).unwrap(), 0);
        assert_eq!(source.offset(), 993);
        assert_eq!(source.take::<8>().unwrap(), None);
        assert_eq!(source.skip(u128::MAX).unwrap(), u128::MAX - 7);
    }

    #[test]
    fn a_line_without_end_is_refused_but_can_be_skipped() {
        let data = vec![b'a'; 3 << 20];
        let open = || Source::new(Path::new("test"), Box::new(&data[..]), None);
        let error = open().line().unwrap_err().to_string();
        assert_eq!(error, "test, line 1: the line is longer than 1048576 bytes");
        assert_eq!(open().skip_line().unwrap(), Some(1));
    }
}
