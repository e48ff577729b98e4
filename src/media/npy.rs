//! Arrays of f32 for NumPy, format version 1.0: `numpy.load("depth.npy")`.
//!
//! Written here, since it is a header of one line: the crate for it brings twenty others, among them
//! a parser generator, a big-integer library and assembly code.

use std::io::{self, Write};
use std::path::Path;

use super::{MediaError, Size, write_file};

/// Writes `values` as little-endian f32 of shape `[H, W]` for one channel, else `[H, W, channels]`.
///
/// # Errors
/// The file cannot be written.
pub fn write_npy(path: &Path, values: &[f32], size: Size, channels: usize) -> Result<(), MediaError> {
    size.expect("array", values, channels);
    write_file(path, |out| {
        let bytes = |out: &mut dyn Write| -> io::Result<()> {
            out.write_all(&header(size, channels))?;
            // Row by row: a copy of a row, not of the picture.
            let mut row_bytes = Vec::with_capacity(size.width as usize * channels * 4);
            for row in values.chunks_exact(size.width as usize * channels) {
                row_bytes.clear();
                row_bytes.extend(row.iter().flat_map(|value| value.to_le_bytes()));
                out.write_all(&row_bytes)?;
            }
            Ok(())
        };
        bytes(out).map_err(|source| MediaError::write(path, source))
    })
}

/// Magic, version, length and a Python dictionary padded to a multiple of 64 bytes.
fn header(size: Size, channels: usize) -> Vec<u8> {
    const FIXED: usize = 10;
    let Size { width, height } = size;
    let shape = if channels == 1 {
        format!("({height}, {width})")
    } else {
        format!("({height}, {width}, {channels})")
    };
    let mut text = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': {shape}, }}");
    let length = (FIXED + text.len() + 1).next_multiple_of(64);
    text.extend(std::iter::repeat_n(' ', length - FIXED - text.len() - 1));
    text.push('\n');
    let mut header = b"\x93NUMPY\x01\x00".to_vec();
    header.extend((text.len() as u16).to_le_bytes());
    header.extend(text.as_bytes());
    header
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn has_the_layout_numpy_describes() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.npy");
        for channels in [1, 3] {
            let size = Size::new(5, 2);
            let values: Vec<f32> = (0..size.pixels() * channels).map(|i| i as f32 - 3.5).collect();
            write_npy(&path, &values, size, channels).unwrap();
            let bytes = std::fs::read(&path).unwrap();
            assert_eq!(&bytes[..8], b"\x93NUMPY\x01\x00");
            let start = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
            assert_eq!(start % 64, 0);
            let text = std::str::from_utf8(&bytes[10..start]).unwrap();
            let shape = if channels == 1 { "(2, 5)" } else { "(2, 5, 3)" };
            assert_eq!(
                text.trim_end(),
                format!("{{'descr': '<f4', 'fortran_order': False, 'shape': {shape}, }}")
            );
            assert!(text.ends_with('\n'));
            let read: Vec<f32> =
                bytes[start..].chunks_exact(4).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect();
            assert_eq!(read, values);
        }
    }
}
