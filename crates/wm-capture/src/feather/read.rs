//! The reader: columns of a file, plain or in LZ4 frames.
//!
//! Written here, since damaged files must be errors and nothing else: every offset of the
//! FlatBuffers is checked before it is followed, and nothing is taken in advance that a header
//! promises. Types: integers of 8 to 64 bits, floats of 16 to 64 bits, booleans, UTF-8.

use super::flatbuffer::{FlatTable, le_u32, le_u64};
use super::format::{ColumnType, FeatherFault, MAGIC, MAX_COLUMNS, fault};
use half::f16;
use lz4_flex::frame::FrameDecoder;
use std::io::Read;

/// Most rows of a table, and record batches.
const MAX_ROWS: u64 = 50_000_000;
const MAX_BATCHES: usize = 100_000;
/// Most bytes of a column of texts in one batch.
const MAX_TEXT_BYTES: u64 = 1 << 30;

/// The values of a column.
#[derive(Clone, Debug, PartialEq)]
pub enum ColumnValues {
    /// Integers; those above the largest i64 are that. Booleans are 0 and 1.
    Ints(Vec<i64>),
    /// Floats.
    Floats(Vec<f64>),
    /// Texts.
    Texts(Vec<String>),
}

/// A table.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FeatherTable {
    columns: Vec<(String, ColumnValues)>,
}

impl FeatherTable {
    /// Reads the columns of these names; others are stepped over. Those that the file does not have
    /// are not in the table.
    pub fn read(bytes: &[u8], names: &[&str]) -> Result<Self, FeatherFault> {
        let end = bytes.len();
        if bytes.get(..6) != Some(MAGIC) || end < 24 || bytes.get(end - 6..) != Some(MAGIC) {
            return fault(0, "no Feather file of version 2, or cut off: it must begin and end with ARROW1");
        }
        let length = le_u32(bytes, end - 10)? as usize;
        let Some(start) = (end - 10).checked_sub(length).filter(|start| *start >= 8) else {
            return fault(end - 10, format!("a footer of {length} bytes in a file of {end}"));
        };
        let footer = FlatTable::root(&bytes[..end - 10], start)?;
        let schema = footer.table(1)?.ok_or(FeatherFault { byte: start as u64, what: "no schema".into() })?;
        if schema.number::<2>(0)?.is_some_and(|endianness| endianness != [0, 0]) {
            return fault(start, "big endian, which is not read");
        }
        let fields = fields(&schema)?;
        let mut table = Self::default();
        for (name, kind) in &fields {
            let empty = match kind {
                ColumnType::Int { .. } | ColumnType::Bool => ColumnValues::Ints(Vec::new()),
                ColumnType::Float { .. } => ColumnValues::Floats(Vec::new()),
                ColumnType::Text => ColumnValues::Texts(Vec::new()),
                ColumnType::Other(_) => continue,
            };
            if names.contains(&name.as_str()) && table.get(name).is_none() {
                table.columns.push((name.clone(), empty));
            }
        }
        let (blocks, count) = footer.structs(3, 24)?;
        if count > MAX_BATCHES {
            return fault(blocks, format!("{count} record batches are too many"));
        }
        let mut rows = 0;
        for index in 0..count {
            let at = blocks + 24 * index;
            let place = le_u64(bytes, at)?;
            let meta = le_u32(bytes, at + 8)?;
            let Some(body) = place.checked_add(meta.into()).and_then(|body| usize::try_from(body).ok())
            else {
                return fault(at, "a record batch outside of the file");
            };
            rows += table.append(bytes, &fields, place as usize, body)?;
            if rows > MAX_ROWS {
                return fault(at, format!("more than {MAX_ROWS} rows"));
            }
        }
        Ok(table)
    }

    /// Appends the record batch whose message is at `place` and body at `body`; returns its rows.
    fn append(
        &mut self,
        bytes: &[u8],
        fields: &[(String, ColumnType)],
        place: usize,
        body: usize,
    ) -> Result<u64, FeatherFault> {
        // Since Arrow 0.15 the length is behind a mark.
        let start = if le_u32(bytes, place)? == u32::MAX { place + 8 } else { place + 4 };
        let Some(metadata) = bytes.get(..body.min(bytes.len())).filter(|metadata| start < metadata.len())
        else {
            return fault(place, "a record batch outside of the file");
        };
        let message = FlatTable::root(metadata, start)?;
        if message.number::<1>(1)? != Some([3]) {
            return fault(place, "a message that is no record batch");
        }
        let Some(batch) = message.table(2)? else { return fault(place, "a record batch without a header") };
        let rows = batch.number::<8>(0)?.map_or(0, u64::from_le_bytes);
        if rows > MAX_ROWS {
            return fault(place, format!("a record batch of {rows} rows; {MAX_ROWS} are read at most"));
        }
        let (nodes, node_count) = batch.structs(1, 16)?;
        let (buffers, buffer_count) = batch.structs(2, 16)?;
        let is_packed = match batch.table(3)? {
            None => false,
            Some(compression) => match compression.number::<1>(0)?.unwrap_or([0]) {
                [0] => true,
                _ => {
                    return fault(
                        place,
                        "compressed with Zstandard, which is not read; write it with LZ4 or uncompressed",
                    );
                }
            },
        };
        let mut next = 0;
        for (index, (name, kind)) in fields.iter().enumerate() {
            let count = match kind {
                ColumnType::Text => 3,
                ColumnType::Other(buffers) => *buffers,
                _ => 2,
            };
            let first = next;
            next += count;
            if next > buffer_count || index >= node_count {
                return fault(place, format!("a record batch without the column {name:?}"));
            }
            let Some((_, column)) = self.columns.iter_mut().find(|(own, _)| own == name) else { continue };
            let node = nodes + 16 * index;
            if le_u64(bytes, node)? != rows {
                return fault(node, format!("the column {name:?} has another number of rows than the batch"));
            }
            if le_u64(bytes, node + 8)? != 0 {
                return fault(node, format!("the column {name:?} has missing values"));
            }
            let buffer = |which: usize, most: u64| {
                let at = buffers + 16 * (first + which);
                let (offset, length) = (le_u64(bytes, at)?, le_u64(bytes, at + 8)?);
                let start = offset.checked_add(body as u64).and_then(|start| usize::try_from(start).ok());
                let stored = start
                    .zip(usize::try_from(length).ok())
                    .and_then(|(start, length)| bytes.get(start..start.checked_add(length)?));
                let Some(stored) = stored else {
                    return fault(at, format!("the column {name:?} lies outside of the file"));
                };
                unpacked(stored, is_packed, most)
                    .or_else(|what| fault(at, format!("the column {name:?}: {what}")))
            };
            let rows = rows as usize;
            column.extend(*kind, rows, &buffer).map_err(|e| match e.byte {
                0 => FeatherFault { byte: node as u64, what: format!("the column {name:?}: {}", e.what) },
                _ => e,
            })?;
        }
        Ok(rows)
    }

    fn get(&self, name: &str) -> Option<&ColumnValues> {
        self.columns.iter().find(|(own, _)| own == name).map(|(_, column)| column)
    }

    /// Takes a column of floats; integers become floats.
    pub fn floats(&mut self, name: &str) -> Result<Vec<f64>, String> {
        match self.take(name)? {
            ColumnValues::Floats(values) => Ok(values),
            ColumnValues::Ints(values) => Ok(values.into_iter().map(|v| v as f64).collect()),
            ColumnValues::Texts(_) => Err(format!("the column {name:?} holds texts, not numbers")),
        }
    }

    /// Takes a column of integers.
    pub fn ints(&mut self, name: &str) -> Result<Vec<i64>, String> {
        match self.take(name)? {
            ColumnValues::Ints(values) => Ok(values),
            _ => Err(format!("the column {name:?} does not hold whole numbers")),
        }
    }

    /// Takes a column of texts.
    pub fn texts(&mut self, name: &str) -> Result<Vec<String>, String> {
        match self.take(name)? {
            ColumnValues::Texts(values) => Ok(values),
            _ => Err(format!("the column {name:?} does not hold texts")),
        }
    }

    fn take(&mut self, name: &str) -> Result<ColumnValues, String> {
        let place = self.columns.iter().position(|(own, _)| own == name);
        let place = place.ok_or_else(|| format!("there is no column {name:?} of a type that is read"))?;
        Ok(self.columns.swap_remove(place).1)
    }
}

const SHORT: &str = "it has fewer bytes than rows";

impl ColumnValues {
    /// Appends rows from the buffers of a batch.
    fn extend<'a>(
        &mut self,
        kind: ColumnType,
        rows: usize,
        buffer: &dyn Fn(usize, u64) -> Result<std::borrow::Cow<'a, [u8]>, FeatherFault>,
    ) -> Result<(), FeatherFault> {
        let fixed = |which: usize, width: usize, rows: usize| {
            let data = buffer(which, (width * rows) as u64)?;
            if data.len() < width * rows { fault(0, SHORT) } else { Ok(data) }
        };
        match (self, kind) {
            (Self::Ints(values), ColumnType::Int { bytes, is_signed }) => {
                let data = fixed(1, bytes, rows)?;
                values.extend(data.chunks_exact(bytes).take(rows).map(|value| {
                    let is_negative = is_signed && value[bytes - 1] >> 7 == 1;
                    let mut whole = [if is_negative { 0xff } else { 0 }; 8];
                    whole[..bytes].copy_from_slice(value);
                    let value = i64::from_le_bytes(whole);
                    if is_signed || bytes < 8 || value >= 0 { value } else { i64::MAX }
                }));
            }
            (Self::Ints(values), ColumnType::Bool) => {
                let bits = buffer(1, rows.div_ceil(8) as u64)?;
                if bits.len() < rows.div_ceil(8) {
                    return fault(0, SHORT);
                }
                values.extend((0..rows).map(|row| i64::from(bits[row / 8] >> (row % 8) & 1)));
            }
            (Self::Floats(values), ColumnType::Float { bytes }) => {
                let data = fixed(1, bytes, rows)?;
                let value = |value: &[u8]| match *value {
                    [a, b] => f16::from_le_bytes([a, b]).to_f64(),
                    [a, b, c, d] => f32::from_le_bytes([a, b, c, d]).into(),
                    _ => value.try_into().map_or(f64::NAN, f64::from_le_bytes),
                };
                values.extend(data.chunks_exact(bytes).take(rows).map(value));
            }
            (Self::Texts(values), ColumnType::Text) => {
                let offsets = fixed(1, 4, rows + 1)?;
                let data = buffer(2, MAX_TEXT_BYTES)?;
                for pair in offsets.as_chunks::<4>().0[..=rows].windows(2) {
                    let [start, end] = [pair[0], pair[1]].map(|v| u32::from_le_bytes(v) as usize);
                    let text = data.get(start..end).and_then(|text| std::str::from_utf8(text).ok());
                    let Some(text) = text else {
                        return fault(0, "a text outside of its bytes, or not UTF-8");
                    };
                    values.push(text.to_owned());
                }
            }
            _ => return fault(0, "it changes its type"),
        }
        Ok(())
    }
}

/// A buffer as it was before it was compressed: at most `most` bytes of it.
fn unpacked(stored: &[u8], is_packed: bool, most: u64) -> Result<std::borrow::Cow<'_, [u8]>, String> {
    if !is_packed || stored.is_empty() {
        return Ok(stored.into());
    }
    let (length, rest) = stored.split_first_chunk::<8>().ok_or("a compressed buffer without its length")?;
    let length = i64::from_le_bytes(*length);
    if length == -1 {
        return Ok(rest.into());
    }
    let length = u64::try_from(length).map_err(|_| format!("a compressed buffer of {length} bytes"))?;
    // The length is no reason to take memory: the decoder gives what there is.
    let mut data = Vec::new();
    let read = FrameDecoder::new(rest).take(length.min(most)).read_to_end(&mut data);
    read.map_err(|e| {
        format!("its LZ4 frame is damaged: {}", e.to_string().replace(|c: char| c.is_control(), " "))
    })?;
    Ok(data.into())
}

/// The names and types of the columns.
fn fields(schema: &FlatTable<'_>) -> Result<Vec<(String, ColumnType)>, FeatherFault> {
    let mut fields = Vec::new();
    for field in schema.tables(1)? {
        let name = field.text(0)?.unwrap_or_default().to_owned();
        let kind = field.table(3)?;
        let small = |table: &Option<FlatTable<'_>>, slot: usize| -> Result<Option<i32>, FeatherFault> {
            table.as_ref().map_or(Ok(None), |table| Ok(table.number::<4>(slot)?.map(i32::from_le_bytes)))
        };
        let has_children = field.tables(5)?.next().is_some();
        if has_children || field.table(4)?.is_some() {
            return fault(
                field.at,
                format!("the column {name:?} is nested or a dictionary, which is not read"),
            );
        }
        let of = match field.number::<1>(2)?.map_or(0, |[kind]| kind) {
            // A null column has no buffers.
            1 => ColumnType::Other(0),
            2 => {
                let is_signed = kind.as_ref().map_or(Ok(None), |kind| kind.number::<1>(1))? == Some([1]);
                match small(&kind, 0)?.unwrap_or(0) {
                    bits @ (8 | 16 | 32 | 64) => ColumnType::Int { bytes: bits as usize / 8, is_signed },
                    bits => {
                        return fault(field.at, format!("the column {name:?} has integers of {bits} bits"));
                    }
                }
            }
            3 => match kind.as_ref().map_or(Ok(None), |kind| kind.number::<2>(0))?.unwrap_or([0, 0]) {
                [0, 0] => ColumnType::Float { bytes: 2 },
                [1, 0] => ColumnType::Float { bytes: 4 },
                [2, 0] => ColumnType::Float { bytes: 8 },
                _ => return fault(field.at, format!("the column {name:?} has floats of an unknown size")),
            },
            4 => ColumnType::Other(3),
            5 => ColumnType::Text,
            6 => ColumnType::Bool,
            7..=11 => ColumnType::Other(2),
            kind => {
                return fault(
                    field.at,
                    format!("the column {name:?} has the type {kind}, which is not read"),
                );
            }
        };
        fields.push((name, of));
        if fields.len() > MAX_COLUMNS {
            return fault(schema.at, format!("more than {MAX_COLUMNS} columns"));
        }
    }
    Ok(fields)
}
