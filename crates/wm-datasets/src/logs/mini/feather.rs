//! Small Feather files, plain or in LZ4 frames.

use lz4_flex::frame::FrameEncoder;
use std::io::{self, Write};

/// A column of a small Feather file.
#[derive(Clone)]
pub enum MiniColumn {
    /// 16-bit floats.
    F16(Vec<f64>),
    /// 64-bit floats.
    F64(Vec<f64>),
    /// Bytes.
    U8(Vec<u8>),
    /// 16 bits.
    U16(Vec<u16>),
    /// 64 bits.
    I64(Vec<i64>),
    /// Texts.
    Text(Vec<String>),
}

impl MiniColumn {
    fn len(&self) -> usize {
        match self {
            Self::F16(v) | Self::F64(v) => v.len(),
            Self::U8(v) => v.len(),
            Self::U16(v) => v.len(),
            Self::I64(v) => v.len(),
            Self::Text(v) => v.len(),
        }
    }

    /// The number of its type, and the fields of the type's table.
    fn kind(&self) -> (u8, Vec<Part>) {
        let int = |bits: i32, is_signed: bool| {
            (2, vec![Part::Bytes(bits.to_le_bytes().into()), Part::Bytes(vec![u8::from(is_signed)])])
        };
        match self {
            Self::F16(_) => (3, vec![Part::Bytes(vec![0, 0])]),
            Self::F64(_) => (3, vec![Part::Bytes(vec![2, 0])]),
            Self::U8(_) => int(8, false),
            Self::U16(_) => int(16, false),
            Self::I64(_) => int(64, true),
            Self::Text(_) => (5, vec![]),
        }
    }

    /// Its buffers: validity, which is left out, and values; of texts offsets and bytes.
    fn buffers(&self) -> Vec<Vec<u8>> {
        let values = match self {
            Self::F16(v) => v.iter().flat_map(|v| half::f16::from_f64(*v).to_le_bytes()).collect(),
            Self::F64(v) => v.iter().flat_map(|v| v.to_le_bytes()).collect(),
            Self::U8(v) => v.clone(),
            Self::U16(v) => v.iter().flat_map(|v| v.to_le_bytes()).collect(),
            Self::I64(v) => v.iter().flat_map(|v| v.to_le_bytes()).collect(),
            Self::Text(v) => {
                let ends = v.iter().scan(0u32, |end, text| {
                    *end += text.len() as u32;
                    Some(*end)
                });
                let offsets = std::iter::once(0).chain(ends).flat_map(u32::to_le_bytes).collect();
                return vec![Vec::new(), offsets, v.concat().into_bytes()];
            }
        };
        vec![Vec::new(), values]
    }
}

/// A field of a table of FlatBuffers.
enum Part {
    /// Left out.
    Nothing,
    /// Stored in the table.
    Bytes(Vec<u8>),
    /// A table of its own.
    Table(Vec<Part>),
    /// A list of tables.
    Tables(Vec<Vec<Part>>),
    /// A list of so many structs, or a text.
    List(usize, Vec<u8>),
}

/// Appends a table: its vtable, itself, then what it points to, since offsets point ahead. Returns the place of the table.
fn table(out: &mut Vec<u8>, parts: &[Part]) -> usize {
    let vtable = out.len();
    let at = vtable + 4 + 2 * parts.len();
    let mut places = Vec::new();
    let mut body = Vec::new();
    for part in parts {
        places.push(4 + body.len());
        match part {
            Part::Nothing => {}
            Part::Bytes(bytes) => body.extend(bytes),
            _ => body.extend([0; 4]),
        }
    }
    out.extend(((4 + 2 * parts.len()) as u16).to_le_bytes());
    out.extend(((4 + body.len()) as u16).to_le_bytes());
    for (part, place) in parts.iter().zip(&places) {
        let place = if matches!(part, Part::Nothing) { 0 } else { *place as u16 };
        out.extend(place.to_le_bytes());
    }
    out.extend(((at - vtable) as i32).to_le_bytes());
    out.extend(body);
    let patch = |out: &mut Vec<u8>, from: usize, to: usize| {
        out[from..from + 4].copy_from_slice(&((to - from) as u32).to_le_bytes());
    };
    for (part, place) in parts.iter().zip(places) {
        let from = at + place;
        match part {
            Part::Nothing | Part::Bytes(_) => {}
            Part::Table(parts) => {
                let to = table(out, parts);
                patch(out, from, to);
            }
            Part::List(count, bytes) => {
                let to = out.len();
                out.extend((*count as u32).to_le_bytes());
                out.extend(bytes);
                patch(out, from, to);
            }
            Part::Tables(tables) => {
                let list = out.len();
                out.extend((tables.len() as u32).to_le_bytes());
                out.resize(out.len() + 4 * tables.len(), 0);
                patch(out, from, list);
                for (index, parts) in tables.iter().enumerate() {
                    let to = table(out, parts);
                    patch(out, list + 4 + 4 * index, to);
                }
            }
        }
    }
    at
}

/// A buffer with a root table.
fn root(parts: &[Part]) -> Vec<u8> {
    let mut out = vec![0; 4];
    let at = table(&mut out, parts);
    out[..4].copy_from_slice(&(at as u32).to_le_bytes());
    out
}

/// A Feather file of columns, plain or in LZ4 frames.
///
/// # Errors
/// None but of the LZ4 encoder.
pub fn feather(columns: &[(&str, MiniColumn)], is_packed: bool) -> io::Result<Vec<u8>> {
    let rows = columns.first().map_or(0, |(_, column)| column.len()) as u64;
    let (mut body, mut buffers, mut nodes) = (Vec::new(), Vec::new(), Vec::new());
    for (_, column) in columns {
        nodes.extend(rows.to_le_bytes());
        nodes.extend(0u64.to_le_bytes());
        for bytes in column.buffers() {
            let stored = if is_packed && !bytes.is_empty() {
                let mut encoder = FrameEncoder::new((bytes.len() as u64).to_le_bytes().to_vec());
                encoder.write_all(&bytes)?;
                encoder.finish().map_err(io::Error::other)?
            } else {
                bytes
            };
            buffers.extend((body.len() as u64).to_le_bytes());
            buffers.extend((stored.len() as u64).to_le_bytes());
            body.extend(stored);
            body.resize(body.len().next_multiple_of(8), 0);
        }
    }
    let compression =
        if is_packed { Part::Table(vec![Part::Bytes(vec![0]), Part::Bytes(vec![0])]) } else { Part::Nothing };
    let batch = vec![
        Part::Bytes(rows.to_le_bytes().into()),
        Part::List(columns.len(), nodes),
        Part::List(buffers.len() / 16, buffers),
        compression,
    ];
    let message = root(&[
        Part::Bytes(vec![4, 0]),
        Part::Bytes(vec![3]),
        Part::Table(batch),
        Part::Bytes((body.len() as u64).to_le_bytes().into()),
    ]);
    let fields = columns.iter().map(|(name, column)| {
        let (kind, parts) = column.kind();
        vec![
            Part::List(name.len(), name.as_bytes().into()),
            Part::Bytes(vec![1]),
            Part::Bytes(vec![kind]),
            Part::Table(parts),
            Part::Nothing,
            Part::List(0, Vec::new()),
        ]
    });
    let schema = vec![Part::Bytes(vec![0, 0]), Part::Tables(fields.collect())];
    let mut out = b"ARROW1\0\0".to_vec();
    let place = out.len() as u64;
    let length = (message.len() + 8).next_multiple_of(8);
    out.extend([0xff; 4]);
    out.extend(((length - 8) as u32).to_le_bytes());
    out.extend(message);
    out.resize(place as usize + length, 0);
    out.extend(&body);
    let mut block = place.to_le_bytes().to_vec();
    block.extend((length as u64).to_le_bytes());
    block.extend((body.len() as u64).to_le_bytes());
    let footer = root(&[Part::Bytes(vec![4, 0]), Part::Table(schema), Part::Nothing, Part::List(1, block)]);
    out.extend([0xff, 0xff, 0xff, 0xff, 0, 0, 0, 0]);
    let length = footer.len() as u32;
    out.extend(footer);
    out.extend(length.to_le_bytes());
    out.extend(b"ARROW1");
    Ok(out)
}
