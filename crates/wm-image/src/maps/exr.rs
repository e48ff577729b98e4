//! Maps as OpenEXR: the first layer.

use super::error::MapFault;
use super::map::{MAX_VALUES, Map, check_size, words};
use exr::meta::{MetaData, attribute::SampleType};
use exr::prelude::{ReadChannels, ReadLayers, read};
use std::io::Cursor;

pub(super) fn decode(bytes: &[u8]) -> Result<Map, MapFault> {
    // The header first: reading allocates what it says.
    let head = MetaData::read_from_buffered(Cursor::new(bytes), false).map_err(|e| words(&e))?;
    let mut values = 0;
    for header in &head.headers {
        let size = header.layer_size;
        let channels = &header.channels.list;
        let sample = channels.iter().map(|channel| match channel.sample_type {
            SampleType::F16 => 2,
            _ => 4,
        });
        check_size(
            size.width() as u64,
            size.height() as u64,
            channels.len() as u64,
            sample.max().unwrap_or(4),
            bytes.len(),
        )?;
        values += size.area() as u64 * channels.len() as u64;
    }
    if values > MAX_VALUES {
        return Err(MapFault::Large(format!("{values} numbers in {} layers", head.headers.len())));
    }
    let image = read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .from_buffered(Cursor::new(bytes))
        .map_err(|e| words(&e))?;
    let layer = &image.layer_data;
    let window = image.attributes.display_window;
    if layer.size != window.size || layer.attributes.layer_position != window.position {
        return Err(MapFault::Unsupported("an EXR whose pixels are only a part of its picture".into()));
    }
    let list = &layer.channel_data.list;
    let names: Vec<String> = list.iter().map(|channel| channel.name.to_string()).collect();
    let pixels = layer.size.area();
    let mut planes = Vec::new();
    for index in chosen(&names) {
        let plane: Vec<f32> = list[index].sample_data.values_as_f32().collect();
        if plane.len() != pixels {
            return Err(MapFault::Unsupported(format!(
                "an EXR whose channel {} is subsampled",
                names[index]
            )));
        }
        planes.push(plane);
    }
    let values = (0..pixels).flat_map(|pixel| planes.iter().map(move |plane| plane[pixel])).collect();
    Ok(Map::new(layer.size.width() as u32, layer.size.height() as u32, planes.len() as u32, values))
}

/// Returns the channels that hold the map.
fn chosen(names: &[String]) -> Vec<usize> {
    let place = |wanted: &str| names.iter().position(|name| name.eq_ignore_ascii_case(wanted));
    let all = |wanted: [&str; 3]| -> Option<Vec<usize>> { wanted.into_iter().map(place).collect() };
    let depth = place("Z").filter(|_| place("X").is_none()).map(|index| vec![index]);
    depth
        .or_else(|| all(["N.X", "N.Y", "N.Z"]))
        .or_else(|| all(["X", "Y", "Z"]))
        .or_else(|| all(["R", "G", "B"]))
        .or_else(|| place("Y").map(|index| vec![index]))
        .or_else(|| place("R").map(|index| vec![index]))
        .unwrap_or_else(|| vec![0])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn channels_are_chosen_by_their_names() {
        let chosen =
            |names: &[&str]| chosen(&names.iter().map(|name| (*name).to_owned()).collect::<Vec<_>>());
        assert_eq!(chosen(&["A", "B", "G", "R", "Z"]), [4]);
        assert_eq!(chosen(&["N.X", "N.Y", "N.Z"]), [0, 1, 2]);
        assert_eq!(chosen(&["X", "Y", "Z"]), [0, 1, 2]);
        assert_eq!(chosen(&["A", "B", "G", "R"]), [3, 2, 1]);
        assert_eq!(chosen(&["A", "Y"]), [1]);
        assert_eq!(chosen(&["depth"]), [0]);
    }
}
