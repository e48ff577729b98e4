//! Marks, limits, faults and types of columns, for reading and for writing.

pub(super) const MAGIC: &[u8] = b"ARROW1";

/// The version of the metadata that is written, V5.
pub(super) const VERSION: i16 = 4;

/// Most columns of a table that is read.
pub(super) const MAX_COLUMNS: usize = 1000;

/// A fault of a file: a byte, and what is wrong there.
#[derive(Clone, Debug, PartialEq)]
pub struct FeatherFault {
    /// The byte, from the start of the file.
    pub byte: u64,
    /// The fault.
    pub what: String,
}

pub(super) fn fault<T>(byte: usize, what: impl Into<String>) -> Result<T, FeatherFault> {
    Err(FeatherFault { byte: byte as u64, what: what.into() })
}

/// The type of a column.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ColumnType {
    /// Whole numbers.
    Int {
        /// Bytes of a number.
        bytes: usize,
        /// Numbers below 0 are possible.
        is_signed: bool,
    },
    /// Floats.
    Float {
        /// Bytes of a number.
        bytes: usize,
    },
    /// Bits, the lowest of a byte first.
    Bool,
    /// UTF-8.
    Text,
    /// Not read; the number of its buffers.
    Other(usize),
}
