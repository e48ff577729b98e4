//! Tables of a log, and the points of a sweep in one.

use crate::feather::FeatherTable;
use crate::logs::files::fault;
use std::path::Path;
use wm_base::{FormatError, Location, Problem};

pub(super) fn table_of(path: &Path, bytes: &[u8], names: &[&str]) -> Result<FeatherTable, FormatError> {
    FeatherTable::read(bytes, names).map_err(|fault| {
        let problem = Problem::Value(format!("{}; copy the file again", fault.what));
        FormatError::at(path, Location::Byte(fault.byte), problem)
    })
}

/// The points of a sweep: positions in the vehicle's axes, and intensities, 0-1.
pub(in crate::logs) fn read_points(path: &Path, bytes: &[u8]) -> Result<Vec<([f32; 3], f32)>, FormatError> {
    let mut table = table_of(path, bytes, &["x", "y", "z", "intensity"])?;
    let mut column = |name: &str| table.floats(name).map_err(|what| fault(path, what));
    let (x, y, z, intensity) = (column("x")?, column("y")?, column("z")?, column("intensity")?);
    let points = x.iter().zip(&y).zip(&z).zip(&intensity);
    Ok(points.map(|(((x, y), z), i)| ([*x as f32, *y as f32, *z as f32], (*i / 255.0) as f32)).collect())
}
