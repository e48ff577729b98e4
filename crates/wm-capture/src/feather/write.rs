//! The writer: a file of one record batch without missing values, its buffers at multiples of 64
//! bytes. Equal columns make equal bytes.

use super::flatbuffer::{FlatField, flatbuffer, pad};
use super::format::{ColumnType, MAGIC, VERSION};
use half::f16;
use std::io;

/// The bytes that messages and buffers lie at multiples of: what Arrow recommends.
const ALIGNMENT_BYTES: usize = 64;
/// The mark that messages begin with since Arrow 0.15.
const CONTINUATION_MARK: [u8; 4] = [0xff; 4];
/// Kinds of messages.
const SCHEMA_MESSAGE: u8 = 1;
const RECORD_BATCH: u8 = 3;

/// A column that is written.
#[derive(Clone)]
pub struct FeatherColumn {
    name: String,
    kind: ColumnType,
    rows: usize,
    /// The values; of texts their bytes.
    values: Vec<u8>,
    /// Byte offsets of texts: the first byte of each, and the end of the last.
    offsets: Vec<u8>,
}

/// A value that columns are made of.
pub trait FeatherValue {
    /// The type of its column.
    const TYPE: ColumnType;

    /// Appends the value to a column that has `rows` rows.
    fn append(self, rows: usize, column: &mut FeatherColumn);
}

macro_rules! numbers {
    ($($number:ty => $kind:expr,)*) => {$(
        impl FeatherValue for $number {
            const TYPE: ColumnType = $kind;

            fn append(self, _: usize, column: &mut FeatherColumn) {
                column.values.extend(self.to_le_bytes());
            }
        }
    )*};
}

numbers! {
    i8 => ColumnType::Int { bytes: 1, is_signed: true },
    i16 => ColumnType::Int { bytes: 2, is_signed: true },
    i32 => ColumnType::Int { bytes: 4, is_signed: true },
    i64 => ColumnType::Int { bytes: 8, is_signed: true },
    u8 => ColumnType::Int { bytes: 1, is_signed: false },
    u16 => ColumnType::Int { bytes: 2, is_signed: false },
    u32 => ColumnType::Int { bytes: 4, is_signed: false },
    u64 => ColumnType::Int { bytes: 8, is_signed: false },
    f16 => ColumnType::Float { bytes: 2 },
    f32 => ColumnType::Float { bytes: 4 },
    f64 => ColumnType::Float { bytes: 8 },
}

impl FeatherValue for bool {
    const TYPE: ColumnType = ColumnType::Bool;

    fn append(self, rows: usize, column: &mut FeatherColumn) {
        column.values.resize(rows / 8 + 1, 0);
        column.values[rows / 8] |= u8::from(self) << (rows % 8);
    }
}

impl FeatherValue for &str {
    const TYPE: ColumnType = ColumnType::Text;

    fn append(self, _: usize, column: &mut FeatherColumn) {
        column.values.extend(self.as_bytes());
        // `feather` refuses columns in which this is cut.
        column.offsets.extend((column.values.len() as u32).to_le_bytes());
    }
}

impl FeatherColumn {
    /// A column of a name and of values.
    pub fn new<V: FeatherValue>(name: &str, values: impl IntoIterator<Item = V>) -> Self {
        let offsets = if V::TYPE == ColumnType::Text { vec![0; 4] } else { Vec::new() };
        let mut column = Self { name: name.into(), kind: V::TYPE, rows: 0, values: Vec::new(), offsets };
        for value in values {
            value.append(column.rows, &mut column);
            column.rows += 1;
        }
        column
    }

    /// The buffers. The validity bitmap is empty, since no value is missing.
    fn buffers(&self) -> Vec<&[u8]> {
        match self.kind {
            ColumnType::Text => vec![&[], &self.offsets, &self.values],
            _ => vec![&[], &self.values],
        }
    }

    /// The entry in the schema. Values may be missing as far as readers know, as in files that
    /// pandas writes.
    fn field(&self) -> Vec<FlatField> {
        let (number, kind) = match self.kind {
            ColumnType::Int { bytes, is_signed } => {
                (2, vec![FlatField::Int(8 * bytes as i32), FlatField::Byte(is_signed.into())])
            }
            ColumnType::Float { bytes } => (3, vec![FlatField::Short((bytes / 4) as i16)]),
            ColumnType::Text => (5, Vec::new()),
            ColumnType::Bool => (6, Vec::new()),
            // No value makes one.
            ColumnType::Other(_) => (1, Vec::new()),
        };
        let (is_nullable, dictionary, children) =
            (FlatField::Byte(1), FlatField::Absent, FlatField::Tables(Vec::new()));
        let name = FlatField::Text(self.name.clone());
        vec![name, is_nullable, FlatField::Byte(number), FlatField::Table(kind), dictionary, children]
    }
}

/// A Feather file of columns of the same length.
///
/// It is not compressed: where LZ4 makes a buffer no smaller writers keep it as it is, and the data
/// loader in Rust of `av2` takes those for broken.
///
/// # Errors
/// Columns of different lengths, and texts of 2 GiB and more in one column.
pub fn feather(columns: &[FeatherColumn]) -> io::Result<Vec<u8>> {
    file(columns, None)
}

/// A Feather file with buffers in LZ4 frames.
///
/// # Errors
/// Errors of [`feather`].
#[cfg(any(test, feature = "testing"))]
pub fn feather_packed(columns: &[FeatherColumn]) -> io::Result<Vec<u8>> {
    let frame = |bytes: &[u8]| {
        let start = (bytes.len() as u64).to_le_bytes().to_vec();
        let mut encoder = lz4_flex::frame::FrameEncoder::new(start);
        io::Write::write_all(&mut encoder, bytes)?;
        encoder.finish().map_err(io::Error::other)
    };
    file(columns, Some(&frame))
}

/// A compressor of buffers.
type Packer<'a> = &'a dyn Fn(&[u8]) -> io::Result<Vec<u8>>;

fn file(columns: &[FeatherColumn], packer: Option<Packer<'_>>) -> io::Result<Vec<u8>> {
    let rows = columns.first().map_or(0, |column| column.rows);
    for FeatherColumn { name, kind, values, rows: own, .. } in columns {
        if *own != rows {
            return Err(io::Error::other(format!("the column {name:?} has {own} rows and the first {rows}")));
        }
        if *kind == ColumnType::Text && i32::try_from(values.len()).is_err() {
            return Err(io::Error::other(format!("the texts of the column {name:?} have 2 GiB or more")));
        }
    }
    let mut body = Vec::new();
    let (mut nodes, mut buffers) = (Vec::new(), Vec::new());
    for column in columns {
        // Rows, and how many of them are missing.
        nodes.extend([rows as u64, 0]);
        for bytes in column.buffers() {
            let start = body.len();
            match packer {
                Some(packer) if !bytes.is_empty() => body.extend(packer(bytes)?),
                _ => body.extend(bytes),
            }
            buffers.extend([start as u64, (body.len() - start) as u64]);
            pad(&mut body, 0, ALIGNMENT_BYTES);
        }
    }
    let schema = || {
        let fields = columns.iter().map(FeatherColumn::field).collect();
        let is_big_endian = FlatField::Short(0);
        FlatField::Table(vec![is_big_endian, FlatField::Tables(fields)])
    };
    // Codec and method: LZ4 frames, buffer by buffer.
    let compression = match packer {
        Some(_) => FlatField::Table(vec![FlatField::Byte(0), FlatField::Byte(0)]),
        None => FlatField::Absent,
    };
    let batch = FlatField::Table(vec![
        FlatField::Long(rows as u64),
        FlatField::Structs(2, nodes),
        FlatField::Structs(2, buffers),
        compression,
    ]);

    let mut out = MAGIC.to_vec();
    pad(&mut out, 0, 8);
    append_message(&mut out, SCHEMA_MESSAGE, schema(), 0);
    let place = out.len();
    append_message(&mut out, RECORD_BATCH, batch, body.len());
    let block = [place, out.len() - place, body.len()].map(|number| number as u64);
    out.extend(body);
    // The end of the messages.
    out.extend(CONTINUATION_MARK);
    out.extend([0; 4]);
    let dictionaries = FlatField::Structs(3, Vec::new());
    let blocks = FlatField::Structs(3, block.into());
    let footer = flatbuffer(&[FlatField::Short(VERSION), schema(), dictionaries, blocks]);
    out.extend(&footer);
    out.extend((footer.len() as u32).to_le_bytes());
    out.extend(MAGIC);
    Ok(out)
}

/// Appends a message without its body, which follows at a multiple of [`ALIGNMENT_BYTES`].
fn append_message(out: &mut Vec<u8>, kind: u8, header: FlatField, body: usize) {
    let message =
        flatbuffer(&[FlatField::Short(VERSION), FlatField::Byte(kind), header, FlatField::Long(body as u64)]);
    let start = out.len() + 8;
    let end = (start + message.len()).next_multiple_of(ALIGNMENT_BYTES);
    out.extend(CONTINUATION_MARK);
    out.extend(((end - start) as u32).to_le_bytes());
    out.extend(message);
    out.resize(end, 0);
}
