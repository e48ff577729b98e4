//! Records of points and detections behind the header of a PLY or PCD file.

use crate::error::SensorError;
use std::path::Path;
use wm_base::files::write_atomically;

/// Records that are written at once.
const PART_ITEMS: usize = 4096;

/// The header of a PLY of records of `fields`, their types and names.
pub(crate) fn ply_header(comments: &str, fields: &str, count: usize) -> Vec<u8> {
    let fields: String = fields.split(", ").map(|field| format!("property {field}\n")).collect();
    format!("ply\nformat binary_little_endian 1.0\n{comments}element vertex {count}\n{fields}end_header\n")
        .into()
}

/// The header of a PCD of records of `fields`, their types and names.
pub(crate) fn pcd_header(comments: &str, fields: &str, count: usize) -> Vec<u8> {
    let mut lines = ["FIELDS", "SIZE", "TYPE", "COUNT"].map(String::from);
    for (kind, name) in fields.split(", ").filter_map(|field| field.split_once(' ')) {
        let (size, kind) = match kind {
            "float" => ("4", "F"),
            "uint" => ("4", "U"),
            "ushort" => ("2", "U"),
            _ => ("1", "U"),
        };
        for (line, word) in lines.iter_mut().zip([name, size, kind, "1"]) {
            *line += " ";
            *line += word;
        }
    }
    format!(
        "# .PCD v0.7 - Point Cloud Data file format\n{comments}VERSION 0.7\n{}\n\
         WIDTH {count}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {count}\nDATA binary\n",
        lines.join("\n")
    )
    .into()
}

/// Writes a header and a record of each item, part by part.
pub(crate) fn write_records<T>(
    path: &Path,
    header: &[u8],
    items: &[T],
    record: impl Fn(&T, &mut Vec<u8>),
) -> Result<(), SensorError> {
    write_atomically(path, |out| {
        out.write_all(header)?;
        let mut bytes = Vec::new();
        for part in items.chunks(PART_ITEMS) {
            bytes.clear();
            part.iter().for_each(|item| record(item, &mut bytes));
            out.write_all(&bytes)?;
        }
        Ok(())
    })?;
    Ok(())
}
