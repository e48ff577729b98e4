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
mod format;
mod read;
#[cfg(test)]
mod tests;
mod write;

pub use format::{ColumnType, FeatherFault};
pub use read::FeatherTable;
#[cfg(any(test, feature = "testing"))]
pub(crate) use write::feather_packed;
pub use write::{FeatherColumn, FeatherValue, feather};
