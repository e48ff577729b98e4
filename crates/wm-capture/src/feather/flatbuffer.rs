//! FlatBuffers, as much of them as Arrow's metadata is made of.
//!
//! A buffer is an offset to its root table. A table begins with the way back to its vtable, which
//! says where its fields lie; fields that are tables, lists and texts are offsets ahead. Source:
//! flatbuffers.dev/internals.

use super::format::{FeatherFault, MAX_COLUMNS, fault};

/// A field of a table that is written; a table has them in the order of their slots.
pub(super) enum FlatField {
    /// Left out.
    Absent,
    Byte(u8),
    Short(i16),
    Int(i32),
    Long(u64),
    Text(String),
    /// A list of structs: the words of each, 8 bytes a word, and the words of all.
    Structs(usize, Vec<u64>),
    Table(Vec<FlatField>),
    Tables(Vec<Vec<FlatField>>),
}

impl FlatField {
    /// The bytes that are stored in the table: a number, or an offset that is set later. They lie
    /// at a multiple of their length.
    fn inline(&self) -> Vec<u8> {
        match self {
            Self::Absent => Vec::new(),
            Self::Byte(value) => vec![*value],
            Self::Short(value) => value.to_le_bytes().into(),
            Self::Int(value) => value.to_le_bytes().into(),
            Self::Long(value) => value.to_le_bytes().into(),
            Self::Text(_) | Self::Structs(..) | Self::Table(_) | Self::Tables(_) => vec![0; 4],
        }
    }
}

/// A buffer with a root table, of a length that is a multiple of 8. Places in it are aligned if it
/// begins at a multiple of 8.
pub(super) fn flatbuffer(root: &[FlatField]) -> Vec<u8> {
    let mut out = vec![0; 4];
    let at = append_table(&mut out, root);
    point(&mut out, 0, at);
    pad(&mut out, 0, 8);
    out
}

/// Appends a vtable, its table, and then what the table points to, since offsets point ahead.
/// Returns the place of the table.
fn append_table(out: &mut Vec<u8>, fields: &[FlatField]) -> usize {
    let mut table = vec![0; 4];
    let mut places = Vec::with_capacity(fields.len());
    for field in fields {
        let bytes = field.inline();
        pad(&mut table, 0, bytes.len().max(1));
        places.push(if bytes.is_empty() { 0 } else { table.len() });
        table.extend(bytes);
    }
    let vtable_length = 4 + 2 * fields.len();
    pad(out, vtable_length, 8);
    let at = out.len() + vtable_length;
    for number in [vtable_length, table.len()].iter().chain(&places) {
        out.extend((*number as u16).to_le_bytes());
    }
    table[..4].copy_from_slice(&(vtable_length as u32).to_le_bytes());
    out.extend(table);
    for (field, place) in fields.iter().zip(places) {
        let to = match field {
            FlatField::Text(text) => {
                let to = append_count(out, text.len(), 4);
                out.extend(text.as_bytes());
                // The text's end for readers in C.
                out.push(0);
                to
            }
            FlatField::Structs(each, words) => {
                let to = append_count(out, words.len() / each, 8);
                out.extend(words.iter().flat_map(|word| word.to_le_bytes()));
                to
            }
            FlatField::Table(fields) => append_table(out, fields),
            FlatField::Tables(tables) => {
                let to = append_count(out, tables.len(), 4);
                out.resize(out.len() + 4 * tables.len(), 0);
                for (index, fields) in tables.iter().enumerate() {
                    let table = append_table(out, fields);
                    point(out, to + 4 + 4 * index, table);
                }
                to
            }
            // Nothing or a number, which the table itself has.
            _ => continue,
        };
        point(out, at + place, to);
    }
    at
}

/// Appends the number of a list's elements, whose first is to lie at a multiple of `align`. Returns
/// the place of the list.
fn append_count(out: &mut Vec<u8>, count: usize, align: usize) -> usize {
    pad(out, 4, align);
    let at = out.len();
    out.extend((count as u32).to_le_bytes());
    at
}

/// Appends zeros until what comes `ahead` bytes later lies at a multiple of `align`.
pub(super) fn pad(out: &mut Vec<u8>, ahead: usize, align: usize) {
    out.resize((out.len() + ahead).next_multiple_of(align) - ahead, 0);
}

/// Sets the offset at `from` so that it leads to `to`.
fn point(out: &mut [u8], from: usize, to: usize) {
    out[from..from + 4].copy_from_slice(&((to - from) as u32).to_le_bytes());
}

pub(super) fn le_u32(bytes: &[u8], at: usize) -> Result<u32, FeatherFault> {
    Ok(u32::from_le_bytes(chunk(bytes, at)?))
}

pub(super) fn le_u64(bytes: &[u8], at: usize) -> Result<u64, FeatherFault> {
    Ok(u64::from_le_bytes(chunk(bytes, at)?))
}

fn chunk<const N: usize>(bytes: &[u8], at: usize) -> Result<[u8; N], FeatherFault> {
    match bytes.get(at..).and_then(|rest| rest.first_chunk()) {
        Some(chunk) => Ok(*chunk),
        None => fault(at, "cut off"),
    }
}

/// A table that is read: an offset back to its vtable, which says where its fields lie.
#[derive(Clone, Copy)]
pub(super) struct FlatTable<'a> {
    bytes: &'a [u8],
    pub(super) at: usize,
}

impl<'a> FlatTable<'a> {
    /// The root table of a buffer that begins at `start`.
    pub(super) fn root(bytes: &'a [u8], start: usize) -> Result<Self, FeatherFault> {
        Ok(Self { bytes, at: followed(bytes, start)? })
    }

    /// The place of a field; `None` if it is left out.
    fn field(&self, slot: usize) -> Result<Option<usize>, FeatherFault> {
        let back = i64::from(le_u32(self.bytes, self.at)? as i32);
        let Some(vtable) = usize::try_from(self.at as i64 - back).ok() else {
            return fault(self.at, "a table without its fields");
        };
        let size = usize::from(u16::from_le_bytes(chunk(self.bytes, vtable)?));
        let entry = 4 + 2 * slot;
        if entry + 2 > size {
            return Ok(None);
        }
        let offset = usize::from(u16::from_le_bytes(chunk(self.bytes, vtable.saturating_add(entry))?));
        Ok((offset != 0).then(|| self.at.saturating_add(offset)))
    }

    pub(super) fn number<const N: usize>(&self, slot: usize) -> Result<Option<[u8; N]>, FeatherFault> {
        self.field(slot)?.map(|at| chunk(self.bytes, at)).transpose()
    }

    pub(super) fn table(&self, slot: usize) -> Result<Option<Self>, FeatherFault> {
        let at = self.field(slot)?.map(|at| followed(self.bytes, at)).transpose()?;
        Ok(at.map(|at| Self { bytes: self.bytes, at }))
    }

    /// The place of the first element of a vector and their number, all within the buffer.
    pub(super) fn structs(&self, slot: usize, size: usize) -> Result<(usize, usize), FeatherFault> {
        let Some(at) = self.field(slot)? else { return Ok((0, 0)) };
        let at = followed(self.bytes, at)?;
        let count = le_u32(self.bytes, at)? as usize;
        let is_within =
            count.checked_mul(size).is_some_and(|length| length <= self.bytes.len().saturating_sub(at + 4));
        if is_within { Ok((at + 4, count)) } else { fault(at, "a list outside of the file") }
    }

    pub(super) fn tables(&self, slot: usize) -> Result<impl Iterator<Item = Self> + use<'a>, FeatherFault> {
        let (first, count) = self.structs(slot, 4)?;
        let bytes = self.bytes;
        let places: Result<Vec<usize>, FeatherFault> =
            (0..count.min(MAX_COLUMNS + 1)).map(|index| followed(bytes, first + 4 * index)).collect();
        Ok(places?.into_iter().map(move |at| Self { bytes, at }))
    }

    pub(super) fn text(&self, slot: usize) -> Result<Option<&'a str>, FeatherFault> {
        let (first, length) = self.structs(slot, 1)?;
        match self.bytes.get(first..first + length).map(std::str::from_utf8) {
            Some(Ok(text)) => Ok((length > 0).then_some(text)),
            _ => fault(first, "a name that is not UTF-8"),
        }
    }
}

/// The place that an offset at `at` leads to.
fn followed(bytes: &[u8], at: usize) -> Result<usize, FeatherFault> {
    let to = at.saturating_add(le_u32(bytes, at)? as usize);
    if to.saturating_add(4) <= bytes.len() { Ok(to) } else { fault(at, "an offset outside of the file") }
}
