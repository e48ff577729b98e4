//! Feather files: flat tables of numbers and texts in Arrow's IPC file format.
//!
//! A file is `ARROW1`, padding to 8 bytes, messages, a footer, the footer's length (i32) and
//! `ARROW1`. The footer has the schema and the places of the record batches; a batch has a message
//! and a body with the buffers of its columns: for numbers validity and values, for texts validity,
//! offsets and bytes. A compressed buffer begins with its length (i64), or -1 if it is stored as it
//! is. Messages and footer are FlatBuffers.
//!
//! Written here, in 650 lines, since `arrow-ipc` 60 brings 16 new crates to the program, 19 s of
//! one core to check them, and other bytes; a negative length in a damaged file makes its reader
//! panic, and a huge one is allocated before it is read (`read_block`).
//!
//! Source: "Arrow Columnar Format" 1.5 (arrow.apache.org/docs/format/Columnar.html) with
//! `Schema.fbs`, `Message.fbs` and `File.fbs`.

mod flatbuffer;
mod read;
#[cfg(test)]
mod tests;
mod write;

pub use read::FeatherTable;
#[cfg(any(test, feature = "testing"))]
pub(crate) use write::feather_packed;
pub use write::{FeatherColumn, FeatherValue, feather};

const MAGIC: &[u8] = b"ARROW1";
/// The version of the metadata that is written, V5.
const VERSION: i16 = 4;
/// Most columns of a table that is read.
const MAX_COLUMNS: usize = 1000;

/// A fault of a file: a byte, and what is wrong there.
#[derive(Clone, Debug, PartialEq)]
pub struct FeatherFault {
    /// The byte, from the start of the file.
    pub byte: u64,
    /// The fault.
    pub what: String,
}

fn fault<T>(byte: usize, what: impl Into<String>) -> Result<T, FeatherFault> {
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
