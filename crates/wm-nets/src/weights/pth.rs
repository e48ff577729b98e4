//! Reads the files that `torch.save` writes of a `state_dict()` since PyTorch 1.6: a zip archive,
//! uncompressed, with a pickle that says which part of which entry is which tensor.
//!
//! A pickle is a program for a stack machine. Here it can build tuples, dictionaries and names, and
//! nothing that it names is ever called. Values are kept once and meant by their number, so that
//! the memory is bounded by the pickle's length, whatever refers to what.

use super::entry::{Entry, MAX_HEADER_BYTES, WeightsFault, read};
use candle_core::DType;
use std::collections::HashMap;
use std::fs::File;
use zip::result::ZipError;
use zip::{CompressionMethod, ZipArchive};

/// The content of an entry of an archive, as a range within the file, bytes.
struct ZipPart {
    start: u64,
    size: u64,
}

/// Most entries of an archive: networks have some thousands of tensors.
const MAX_ENTRIES: u64 = 100_000;
/// Length of the end of a file in which the directory of an archive ends, bytes: records of fixed
/// length and a comment.
const MAX_DIRECTORY_END_BYTES: u64 = (1 << 16) + 256;

/// Returns an error if a 64-bit archive claims more entries than any network has, since the reader
/// reserves memory for as many as are claimed.
fn check_entry_count(file: &mut File, length: u64) -> Result<(), WeightsFault> {
    let start = length.saturating_sub(MAX_DIRECTORY_END_BYTES);
    let end = read(file, start, length - start)?;
    let number = |bytes: &[u8], at: usize| {
        bytes.get(at..at + 8).and_then(|bytes| bytes.try_into().ok()).map(u64::from_le_bytes)
    };
    let records = |mark: &'static [u8; 4]| {
        end.windows(4).enumerate().filter(move |(_, bytes)| *bytes == mark).map(|(at, _)| &end[at..])
    };
    // The record itself, and where the locator says that it is.
    let mut counts: Vec<u64> = records(b"PK\x06\x06").filter_map(|record| number(record, 32)).collect();
    for at in records(b"PK\x06\x07").filter_map(|locator| number(locator, 8)) {
        if at.checked_add(56).is_some_and(|record_end| record_end <= length) {
            counts.extend(number(&read(file, at, 56)?, 32));
        }
    }
    match counts.into_iter().max() {
        Some(count) if count > MAX_ENTRIES => {
            Err(damaged(format_args!("a zip archive that claims {count} entries")))
        }
        _ => Ok(()),
    }
}

/// Finds the content of the entries of an archive of `length` bytes, by name.
fn parts(file: &mut File, length: u64) -> Result<HashMap<String, ZipPart>, WeightsFault> {
    let broken = |error: ZipError| match error {
        ZipError::Io(error) => error.into(),
        error => damaged(format_args!("a zip archive without its end, or with a broken directory ({error})")),
    };
    check_entry_count(file, length)?;
    let mut archive = ZipArchive::new(file).map_err(broken)?;
    let mut parts = HashMap::new();
    for index in 0..archive.len() {
        let entry = archive.by_index_raw(index).map_err(broken)?;
        let (size, name) = (entry.size(), entry.name().map_err(broken)?.into_owned());
        let is_stored = entry.compression() == CompressionMethod::Stored && entry.compressed_size() == size;
        if entry.encrypted() || !is_stored {
            return Err(WeightsFault::NoTensors(
                "a zip archive that is compressed or locked, so none of PyTorch",
            ));
        }
        let start = entry.data_start().unwrap_or(length);
        if start.checked_add(size).is_none_or(|end| end > length) {
            return Err(damaged("a zip archive's entry that is larger than the file"));
        }
        parts.insert(name, ZipPart { start, size });
    }
    Ok(parts)
}

/// The tensors of a file of `length` bytes.
pub(crate) fn entries(file: &mut File, length: u64) -> Result<HashMap<String, Entry>, WeightsFault> {
    let parts = parts(file, length)?;
    let (table, part) = parts
        .iter()
        .find(|(name, _)| name.ends_with("/data.pkl"))
        .ok_or(WeightsFault::NoTensors("a zip archive without data.pkl, so none of PyTorch"))?;
    let folder = table.trim_end_matches("data.pkl");
    if let Some(order) = parts.get(&format!("{folder}byteorder"))
        && (order.size > 16 || read(file, order.start, order.size)? != b"little")
    {
        return Err(WeightsFault::NoTensors("its numbers have the highest byte first"));
    }
    if part.size > MAX_HEADER_BYTES {
        return Err(WeightsFault::NoTensors("its data.pkl holds more than tensors by name"));
    }
    let pickle = read(file, part.start, part.size)?;
    let mut entries = HashMap::new();
    for (name, stored) in Machine::default().run(&pickle)? {
        let part = parts.get(&format!("{folder}data/{}", stored.storage));
        let size = stored.kind.as_ref().map_or(1, DType::size_in_bytes);
        let place = |part: &ZipPart| {
            let from = stored.offset.checked_mul(size as u64)?;
            let bytes = Entry::bytes_of(&stored.shape, size)?;
            (from.checked_add(bytes)? <= part.size).then_some((part.start + from, bytes))
        };
        let (offset, bytes) = part.and_then(place).ok_or_else(|| {
            WeightsFault::Damaged(format!("tensor {name} is larger than what is stored of it"))
        })?;
        entries.insert(name, Entry { kind: stored.kind, shape: stored.shape, offset, bytes });
    }
    if entries.is_empty() {
        return Err(WeightsFault::NoTensors("its data.pkl holds no tensors by name"));
    }
    Ok(entries)
}

fn damaged(error: impl std::fmt::Display) -> WeightsFault {
    WeightsFault::Damaged(error.to_string())
}

/// A tensor as the pickle tells of it.
struct StoredTensor {
    kind: Result<DType, String>,
    /// Name of the entry with its numbers.
    storage: String,
    /// Numbers before its first one.
    offset: u64,
    shape: Vec<usize>,
}

/// A value's place in [`Machine::values`].
type Id = usize;

enum Value {
    Text(String),
    Number(i64),
    Name {
        module: String,
        name: String,
    },
    Tuple(Vec<Id>),
    Dict(Vec<(Id, Id)>),
    /// An object outside of the pickle.
    Outside(Id),
    /// A call that is not made.
    Call {
        callable: Id,
        args: Id,
    },
    /// Anything that says nothing of tensors.
    Other,
}

/// The stack machine.
#[derive(Default)]
struct Machine {
    values: Vec<Value>,
    stack: Vec<Id>,
    marks: Vec<usize>,
    memo: HashMap<u32, Id>,
}

/// The fault of a pickle that ends early or takes what does not exist.
const BROKEN: &str = "its data.pkl breaks off";

/// The bytes that are left.
struct Bytes<'a>(&'a [u8]);

impl<'a> Bytes<'a> {
    fn take(&mut self, count: usize) -> Option<&'a [u8]> {
        let (taken, left) = self.0.split_at_checked(count)?;
        self.0 = left;
        Some(taken)
    }

    fn fixed<const N: usize>(&mut self) -> Option<[u8; N]> {
        self.take(N)?.try_into().ok()
    }

    fn line(&mut self) -> Option<String> {
        let end = self.0.iter().position(|byte| *byte == b'\n')?;
        let line = self.take(end + 1)?;
        String::from_utf8(line[..end].into()).ok()
    }
}

impl Machine {
    /// Runs a pickle; gives the tensors of the dictionary that it builds.
    fn run(mut self, pickle: &[u8]) -> Result<Vec<(String, StoredTensor)>, WeightsFault> {
        let mut bytes = Bytes(pickle);
        let top = loop {
            let code = bytes.take(1).ok_or_else(|| damaged(BROKEN))?[0];
            if code == b'.' {
                break self.pop().ok_or_else(|| damaged(BROKEN))?;
            }
            let known = self.step(code, &mut bytes).ok_or_else(|| damaged(BROKEN))?;
            if !known {
                return Err(WeightsFault::NoTensors("its data.pkl holds more than tensors by name"));
            }
        };
        let Value::Dict(items) = &self.values[top] else {
            return Err(WeightsFault::NoTensors("its data.pkl holds no tensors by name"));
        };
        let tensor = |key: Id, value: Id| match &self.values[key] {
            Value::Text(name) => Some((name.clone(), self.tensor(value)?)),
            _ => None,
        };
        Ok(items.iter().filter_map(|(key, value)| tensor(*key, *value)).collect())
    }

    /// One instruction; `None` if something that it needs is not there, false if it is none of
    /// those that lists of tensors are made of.
    fn step(&mut self, code: u8, bytes: &mut Bytes<'_>) -> Option<bool> {
        match code {
            // The version.
            0x80 => drop(bytes.take(1)?),
            b'c' => {
                let (module, name) = (bytes.line()?, bytes.line()?);
                self.push(Value::Name { module, name });
            }
            b'X' => {
                let count = u32::from_le_bytes(bytes.fixed()?) as usize;
                let text = String::from_utf8(bytes.take(count)?.into()).ok()?;
                self.push(Value::Text(text));
            }
            b'K' => self.number(bytes.take(1)?[0]),
            b'M' => self.number(u16::from_le_bytes(bytes.fixed()?)),
            b'J' => self.number(i32::from_le_bytes(bytes.fixed()?)),
            0x8a => {
                let count = bytes.take(1)?[0] as usize;
                let (digits, mut number) = (bytes.take(count)?, [0; 8]);
                // Sizes are positive: the missing digits are zeros.
                number.get_mut(..count)?.copy_from_slice(digits);
                self.number(i64::from_le_bytes(number));
            }
            b'G' => {
                bytes.take(8)?;
                self.push(Value::Other);
            }
            b'N' | 0x88 | 0x89 | b']' => self.push(Value::Other),
            b')' => self.push(Value::Tuple(Vec::new())),
            b'}' => self.push(Value::Dict(Vec::new())),
            b'(' => self.marks.push(self.stack.len()),
            b't' => {
                let items = self.pop_to_mark()?;
                self.push(Value::Tuple(items));
            }
            0x85..=0x87 => {
                let count = usize::from(code - 0x84);
                let items = self.stack.split_off(self.stack.len().checked_sub(count)?);
                self.push(Value::Tuple(items));
            }
            b'q' => drop(self.memo.insert(u32::from(bytes.take(1)?[0]), *self.stack.last()?)),
            b'r' => drop(self.memo.insert(u32::from_le_bytes(bytes.fixed()?), *self.stack.last()?)),
            b'h' => self.stack.push(*self.memo.get(&u32::from(bytes.take(1)?[0]))?),
            b'j' => self.stack.push(*self.memo.get(&u32::from_le_bytes(bytes.fixed()?))?),
            b's' => {
                let (value, key) = (self.pop()?, self.pop()?);
                self.set(&[key, value])?;
            }
            b'u' => {
                let items = self.pop_to_mark()?;
                self.set(&items)?;
            }
            // Lists say nothing of tensors.
            b'a' => drop(self.pop()?),
            b'e' => drop(self.pop_to_mark()?),
            b'Q' => {
                let id = self.pop()?;
                self.push(Value::Outside(id));
            }
            b'R' | 0x81 => {
                let (args, callable) = (self.pop()?, self.pop()?);
                let ordered = self.is_named(callable, "collections", "OrderedDict");
                self.push(if ordered { Value::Dict(Vec::new()) } else { Value::Call { callable, args } });
            }
            // Attributes, such as the versions of modules.
            b'b' => drop(self.pop()?),
            _ => return Some(false),
        }
        Some(true)
    }

    fn push(&mut self, value: Value) {
        self.stack.push(self.values.len());
        self.values.push(value);
    }

    fn number(&mut self, number: impl Into<i64>) {
        self.push(Value::Number(number.into()));
    }

    fn pop(&mut self) -> Option<Id> {
        self.stack.pop()
    }

    fn pop_to_mark(&mut self) -> Option<Vec<Id>> {
        let mark = self.marks.pop()?;
        (mark <= self.stack.len()).then(|| self.stack.split_off(mark))
    }

    /// Puts keys and values into the dictionary on the stack.
    fn set(&mut self, items: &[Id]) -> Option<()> {
        let Value::Dict(dict) = &mut self.values[*self.stack.last()?] else { return None };
        let pairs = items.chunks_exact(2);
        pairs.remainder().is_empty().then(|| dict.extend(pairs.map(|pair| (pair[0], pair[1]))))
    }

    fn is_named(&self, id: Id, module: &str, name: &str) -> bool {
        matches!(&self.values[id], Value::Name { module: m, name: n } if m == module && n == name)
    }

    fn tuple(&self, id: Id) -> Option<&[Id]> {
        match &self.values[id] {
            Value::Tuple(items) => Some(items),
            _ => None,
        }
    }

    fn unsigned(&self, id: Id) -> Option<u64> {
        match self.values[id] {
            Value::Number(number) => u64::try_from(number).ok(),
            _ => None,
        }
    }

    fn sides(&self, id: Id) -> Option<Vec<usize>> {
        self.tuple(id)?.iter().map(|id| usize::try_from(self.unsigned(*id)?).ok()).collect()
    }

    /// A tensor, or a parameter, which has one; `None` of anything else.
    fn tensor(&self, id: Id) -> Option<StoredTensor> {
        let Value::Call { mut callable, mut args } = self.values[id] else { return None };
        if self.is_named(callable, "torch._utils", "_rebuild_parameter") {
            let Value::Call { callable: c, args: a } = self.values[*self.tuple(args)?.first()?] else {
                return None;
            };
            (callable, args) = (c, a);
        }
        if !self.is_named(callable, "torch._utils", "_rebuild_tensor_v2") {
            return None;
        }
        let [storage, offset, shape, strides, ..] = *self.tuple(args)? else { return None };
        let Value::Outside(storage) = self.values[storage] else { return None };
        let [_, kind, storage, ..] = *self.tuple(storage)? else { return None };
        let (Value::Text(storage), Value::Name { name: kind, .. }) =
            (&self.values[storage], &self.values[kind])
        else {
            return None;
        };
        let (shape, strides) = (self.sides(shape)?, self.sides(strides)?);
        let kind = match kind.as_str() {
            _ if !is_contiguous(&shape, &strides) => Err("not contiguous".into()),
            "FloatStorage" => Ok(DType::F32),
            "HalfStorage" => Ok(DType::F16),
            "BFloat16Storage" => Ok(DType::BF16),
            "DoubleStorage" => Ok(DType::F64),
            other => Err(other.to_owned()),
        };
        Some(StoredTensor { kind, storage: storage.clone(), offset: self.unsigned(offset)?, shape })
    }
}

/// Returns true if the last side runs fastest, without gaps.
fn is_contiguous(shape: &[usize], strides: &[usize]) -> bool {
    let mut expected = 1usize;
    let mut sides = shape.iter().zip(strides).rev();
    shape.len() == strides.len()
        && sides.all(|(side, stride)| {
            let fits = *side == 1 || *stride == expected;
            expected = expected.saturating_mul(*side);
            fits
        })
}
