//! Arrays of f32 for NumPy, format version 1.0: `numpy.load("depth.npy")`.
//!
//! Written here, since it is a header of one line: the crate for it brings twenty others, among
//! them a parser generator, a big-integer library and assembly code.

use crate::{FormatError, Problem, files::write_atomically};
use std::{
    fs::File,
    io::{BufReader, Read},
    path::Path,
};

/// Longest header that is read, bytes.
const MAX_HEADER_BYTES: usize = 4096;
/// Values that are written at once.
const PART_VALUES: usize = 4096;

/// Writes `values` as little-endian f32 of `shape`, such as `[H, W]` or `[H, W, 3]`, the last axis
/// fastest; whole or not at all.
///
/// # Errors
/// [`FormatError`] if the file cannot be written.
///
/// # Panics
/// If there are more or fewer values than the shape has.
pub fn write(path: &Path, values: &[f32], shape: &[usize]) -> Result<(), FormatError> {
    assert_eq!(values.len(), shape.iter().product::<usize>(), "an array of shape {shape:?}");
    write_atomically(path, |out| {
        out.write_all(&header("<f4", shape))?;
        // Part by part: a copy of a part, not of the array.
        let mut bytes = Vec::with_capacity(4 * PART_VALUES.min(values.len()));
        for part in values.chunks(PART_VALUES) {
            bytes.clear();
            bytes.extend(part.iter().flat_map(|value| value.to_le_bytes()));
            out.write_all(&bytes)?;
        }
        Ok(())
    })
}

/// The bytes before the values of an array: magic, version, length and a Python dictionary padded
/// to a multiple of 64 bytes. `kind` is NumPy's text of a type, such as `<f4` for little-endian
/// f32, or a list of fields, such as `[('t', '<i8'), ('x', '<u2')]`.
#[must_use]
pub fn header(kind: &str, shape: &[usize]) -> Vec<u8> {
    const PREAMBLE_BYTES: usize = 10;
    let sides: Vec<String> = shape.iter().map(usize::to_string).collect();
    // As Python writes tuples: (2, 5), but (5,).
    let comma = if shape.len() == 1 { "," } else { "" };
    let sides = sides.join(", ");
    let kind = if kind.starts_with('[') { kind.to_owned() } else { format!("'{kind}'") };
    let mut text = format!("{{'descr': {kind}, 'fortran_order': False, 'shape': ({sides}{comma}), }}");
    let length = (PREAMBLE_BYTES + text.len() + 1).next_multiple_of(64);
    text.extend(std::iter::repeat_n(' ', length - PREAMBLE_BYTES - text.len() - 1));
    text.push('\n');
    let mut out = b"\x93NUMPY\x01\x00".to_vec();
    out.extend(((length - PREAMBLE_BYTES) as u16).to_le_bytes());
    out.extend(text.into_bytes());
    out
}

/// Reads an array of little-endian f32 in C order: its values and its shape.
///
/// # Errors
/// [`FormatError`] if the file is not such an array, or is cut off.
pub fn read(path: &Path) -> Result<(Vec<f32>, Vec<usize>), FormatError> {
    let file = File::open(path).map_err(|e| FormatError::reading(path, e))?;
    let length = file.metadata().map_err(|e| FormatError::reading(path, e))?.len();
    read_from(BufReader::new(file), length).map_err(|problem| FormatError::whole(path, problem))
}

fn read_from(mut input: impl Read, length: u64) -> Result<(Vec<f32>, Vec<usize>), Problem> {
    let fault = |what: &str| Problem::Value(format!("{what}; save it again with numpy.save as float32"));
    let mut start = [0; 10];
    input.read_exact(&mut start).map_err(|_| fault("no NumPy array"))?;
    let [magic @ .., major, _minor, low, high] = start;
    if magic != *b"\x93NUMPY" || major != 1 {
        return Err(fault("no NumPy array of version 1"));
    }
    let size = usize::from(u16::from_le_bytes([low, high])).min(MAX_HEADER_BYTES);
    let mut text = vec![0; size];
    input.read_exact(&mut text).map_err(|_| fault("cut off in its header"))?;
    let text = String::from_utf8_lossy(&text).replace(' ', "");
    if !text.contains("'descr':'<f4'") || !text.contains("'fortran_order':False") {
        return Err(fault("an array of another type than little-endian float32 in C order"));
    }
    let shape = text.split("'shape':(").nth(1).and_then(|rest| rest.split(')').next());
    let shape = shape.ok_or_else(|| fault("an array without a shape"))?;
    let shape: Option<Vec<usize>> =
        shape.split(',').filter(|side| !side.is_empty()).map(|side| side.parse().ok()).collect();
    let shape = shape.ok_or_else(|| fault("an array whose shape is not understood"))?;
    let count = shape.iter().try_fold(1usize, |product, side| product.checked_mul(*side));
    // The file says how much there is; the header is believed only if it says the same.
    let there = length.saturating_sub(10 + size as u64) / 4;
    let count = count.filter(|count| *count as u64 == there);
    let count = count.ok_or_else(|| fault("its shape and its length do not fit: it may be cut off"))?;
    let mut bytes = Vec::new();
    input.take(4 * count as u64).read_to_end(&mut bytes).map_err(Problem::Read)?;
    let (values, _) = bytes.as_chunks::<4>();
    if values.len() != count {
        return Err(fault("cut off"));
    }
    Ok((values.iter().map(|value| f32::from_le_bytes(*value)).collect(), shape))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn has_the_layout_numpy_describes() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.npy");
        for (shape, text) in [(&[5][..], "(5,)"), (&[2, 5], "(2, 5)"), (&[2, 5, 3], "(2, 5, 3)")] {
            let values: Vec<f32> = (0..shape.iter().product::<usize>()).map(|i| i as f32 - 3.5).collect();
            write(&path, &values, shape).unwrap();
            let bytes = std::fs::read(&path).unwrap();
            assert_eq!(&bytes[..8], b"\x93NUMPY\x01\x00");
            let start = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
            assert_eq!(start % 64, 0);
            let head = std::str::from_utf8(&bytes[10..start]).unwrap();
            assert_eq!(
                head.trim_end(),
                format!("{{'descr': '<f4', 'fortran_order': False, 'shape': {text}, }}")
            );
            assert!(head.ends_with('\n'));
            let stored: Vec<f32> =
                bytes[start..].as_chunks().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect();
            assert_eq!(stored, values);
        }
    }

    #[test]
    fn arrays_come_back() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.npy");
        for shape in [&[2, 3][..], &[6], &[1, 2, 3], &[0, 4]] {
            let values: Vec<f32> = (0..shape.iter().product::<usize>()).map(|v| v as f32 - 0.5).collect();
            write(&path, &values, shape).unwrap();
            assert_eq!(read(&path).unwrap(), (values, shape.to_vec()));
        }
    }

    #[test]
    fn arrays_cut_at_any_byte_are_errors() {
        let mut bytes = header("<f4", &[2, 2]);
        bytes.extend([0; 16]);
        assert!(read_from(&bytes[..], bytes.len() as u64).is_ok());
        for end in 0..bytes.len() {
            assert!(read_from(&bytes[..end], end as u64).is_err(), "{end}");
        }
    }

    proptest! {
        #[test]
        fn mutated_arrays_never_panic(edits in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6)) {
            let mut bytes = header("<f4", &[2, 2]);
            bytes.extend([0; 16]);
            for (at, byte) in edits {
                let at = at.index(bytes.len());
                bytes[at] = byte;
            }
            if let Ok((values, _)) = read_from(&bytes[..], bytes.len() as u64) {
                prop_assert!(values.len() * 4 <= bytes.len());
            }
        }
    }
}
