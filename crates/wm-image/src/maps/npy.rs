//! Maps as NumPy arrays.

use super::error::MapFault;
use super::map::{Map, check_size};
use std::path::Path;
use wm_base::npy;

pub(super) fn decode(path: &Path) -> Result<Map, MapFault> {
    // Its size is believed only if the file has it: nothing is compressed.
    let (values, shape) = npy::read(path).map_err(|error| words(&error.problem))?;
    let (height, width, channels) = match shape[..] {
        [height, width] => (height, width, 1),
        [height, width, channels @ 1..=4] => (height, width, channels),
        _ => {
            return Err(MapFault::Unsupported(format!(
                "an array of shape {shape:?}, not [height, width] or [height, width, 1 to 4]"
            )));
        }
    };
    check_size(width as u64, height as u64, channels as u64, 4, 4 * values.len())?;
    Ok(Map::new(width as u32, height as u32, channels as u32, values))
}

/// Returns the error of the reader, without the advice at its end.
fn words(problem: &wm_base::Problem) -> MapFault {
    let text = problem.to_string();
    MapFault::Unsupported(text.split(';').next().unwrap_or_default().to_owned())
}
