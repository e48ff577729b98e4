//! OpenEXR pictures: f32, linear light, lossless.
//!
//! | kind | channels | values |
//! |---|---|---|
//! | rgb | R, G, B | linear light of the sRGB-encoded input, 1 = display white, Rec. 709 primaries |
//! | alpha | A | as given; rgb is not multiplied by it |
//! | depth | Z | as given, metres or scene units, 0 = nothing there |
//! | normals | N.X, N.Y, N.Z | as given, world axes, (0, 0, 0) = nothing there |
//!
//! | others | as named | as given |
//!
//! One function writes any of them: one kind per file, or all in one. Tags become string attributes
//! of the same name.

use std::io::{Cursor, Write};
use std::path::Path;

use exr::compression::Compression;
use exr::image::write::WritableImage;
use exr::image::{AnyChannel, AnyChannels, Blocks, Encoding, FlatSamples, Image, Layer};
use exr::math::Vec2;
use exr::meta::attribute::{AttributeValue, Chromaticities, LineOrder, Text};
use exr::meta::header::{LayerAttributes, standard_names};
use wm_base::color::srgb_decode;

use super::{MediaError, PictureSize, Tags, write_file};

/// The channels to write, at least one; shapes and values as in [`media`](super).
#[derive(Clone, Copy, Debug, Default)]
pub struct ExrPlanes<'a> {
    /// `[H, W, 3]`, sRGB-encoded.
    pub rgb: Option<&'a [f32]>,
    /// `[H, W]`.
    pub alpha: Option<&'a [f32]>,
    /// `[H, W]`.
    pub depth: Option<&'a [f32]>,
    /// `[H, W, 3]`.
    pub normals: Option<&'a [f32]>,
    /// Further channels by name, `[H, W]` each, as given; `layer.R` is the channel R of a layer.
    pub channels: &'a [(String, Vec<f32>)],
}

/// Writes `planes` as one file with ZIP compression.
///
/// # Errors
/// The file cannot be written, or a tag has the name of an attribute that EXR defines itself.
pub fn write_exr(
    path: &Path,
    planes: ExrPlanes<'_>,
    size: PictureSize,
    tags: &Tags,
) -> Result<(), MediaError> {
    let mut attributes = LayerAttributes::default();
    for (key, text) in tags {
        let refused =
            |reason: &str| MediaError::Tag { path: path.into(), key: key.clone(), reason: reason.into() };
        if key.is_empty() || key.len() > 255 || key.contains('\0') {
            return Err(refused("an EXR attribute name has 1 to 255 bytes and no zeros"));
        }
        if standard_names::ALL.contains(&key.as_bytes()) {
            return Err(refused("EXR defines an attribute of this name itself"));
        }
        let value = AttributeValue::Text(Text::from_slice_unchecked(text.as_bytes()));
        attributes.other.insert(Text::from_slice_unchecked(key.as_bytes()), value);
    }

    let channels = AnyChannels::sort(channels(planes, size).into());
    assert!(!channels.list.is_empty(), "an EXR without channels");
    let dimensions = Vec2(size.width as usize, size.height as usize);
    let layer = Layer::new(dimensions, attributes, ENCODING, channels);
    let mut image = Image::from_layer(layer);
    if planes.rgb.is_some() {
        image.attributes.chromaticities = Some(REC_709);
    }
    // In memory first: the attributes are put in order there.
    let mut bytes = Vec::new();
    image.write().to_buffered(Cursor::new(&mut bytes)).map_err(|error| MediaError::Format {
        path: path.to_path_buf(),
        format: "EXR",
        reason: error.to_string(),
    })?;
    sort_attributes(&mut bytes);
    write_file(path, |out| out.write_all(&bytes).map_err(|source| MediaError::write(path, source)))
}

/// ZIP by single rows ("ZIPS"): a seventh larger than by 16 rows, but written in a third of the
/// time. Rows in order, since otherwise threads decide about it.
const ENCODING: Encoding =
    Encoding { compression: Compression::ZIP1, blocks: Blocks::ScanLines, line_order: LineOrder::Increasing };

/// The default of EXR, said aloud.
const REC_709: Chromaticities = Chromaticities {
    red: Vec2(0.64, 0.33),
    green: Vec2(0.30, 0.60),
    blue: Vec2(0.15, 0.06),
    white: Vec2(0.3127, 0.3290),
};

fn channels(planes: ExrPlanes<'_>, size: PictureSize) -> Vec<AnyChannel<FlatSamples>> {
    let channel = |name: &str, samples: Vec<f32>| AnyChannel::new(name, FlatSamples::F32(samples));
    let mut channels = Vec::new();
    if let Some(rgb) = planes.rgb {
        size.expect("rgb", rgb, 3);
        for (at, name) in ["R", "G", "B"].into_iter().enumerate() {
            let values = rgb.iter().skip(at).step_by(3);
            channels.push(channel(name, values.map(|&value| srgb_decode(f64::from(value)) as f32).collect()));
        }
    }
    if let Some(normals) = planes.normals {
        size.expect("normals", normals, 3);
        for (at, name) in ["N.X", "N.Y", "N.Z"].into_iter().enumerate() {
            channels.push(channel(name, normals.iter().skip(at).step_by(3).copied().collect()));
        }
    }
    for (name, what, plane) in [("A", "alpha", planes.alpha), ("Z", "depth", planes.depth)] {
        if let Some(plane) = plane {
            size.expect(what, plane, 1);
            channels.push(channel(name, plane.to_vec()));
        }
    }
    for (name, plane) in planes.channels {
        size.expect(name, plane, 1);
        channels.push(channel(name, plane.clone()));
    }
    channels
}

/// Puts the attributes of a file with one part in the order of their names.
///
/// The crate keeps custom attributes in a hash map, whose order differs from run to run; the same
/// picture must give the same bytes. The header keeps its length, so that no offset changes.
fn sort_attributes(file: &mut [u8]) {
    // Magic and version.
    const PREAMBLE_BYTES: usize = 8;
    let mut attributes = Vec::new();
    let mut at = PREAMBLE_BYTES;
    while file[at] != 0 {
        // Name and type, each ended by a zero, length, value.
        let zero = |from: usize| from + file[from..].iter().position(|&byte| byte == 0).expect("a zero");
        let length_at = zero(zero(at) + 1) + 1;
        let length = i32::from_le_bytes(file[length_at..length_at + 4].try_into().expect("4 bytes"));
        let end = length_at + 4 + usize::try_from(length).expect("written by the crate");
        attributes.push(file[at..end].to_vec());
        at = end;
    }
    attributes.sort();
    file[PREAMBLE_BYTES..at].copy_from_slice(&attributes.concat());
}

#[cfg(test)]
mod tests {
    use std::fs;

    use exr::prelude::{ReadChannels, ReadLayers, read};

    use super::*;

    type Read = (Image<Layer<AnyChannels<FlatSamples>>>, Vec<(String, Vec<f32>)>);

    fn open(path: &Path) -> Read {
        let image = read()
            .no_deep_data()
            .largest_resolution_level()
            .all_channels()
            .first_valid_layer()
            .all_attributes()
            .from_file(path)
            .unwrap();
        let channels = image.layer_data.channel_data.list.iter();
        let channels = channels
            .map(|channel| (channel.name.to_string(), channel.sample_data.values_as_f32().collect()))
            .collect();
        (image, channels)
    }

    #[test]
    fn all_kinds_come_back_exactly() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.exr");
        let size = PictureSize::new(37, 21);
        let plane = |seed: f32, n: usize| -> Vec<f32> {
            (0..size.pixels() * n).map(|i| (i as f32 * seed).sin() * 3.0).collect()
        };
        let (rgb, alpha, depth, normals) = (plane(0.1, 3), plane(0.2, 1), plane(0.3, 1), plane(0.4, 3));
        let planes = ExrPlanes {
            rgb: Some(&rgb),
            alpha: Some(&alpha),
            depth: Some(&depth),
            normals: Some(&normals),
            channels: &[],
        };
        write_exr(&path, planes, size, &[]).unwrap();
        let (image, read) = open(&path);
        assert_eq!(image.layer_data.size, Vec2(37, 21));
        assert_eq!(image.attributes.chromaticities, Some(REC_709));
        let names: Vec<_> = read.iter().map(|(name, _)| name.as_str()).collect();
        assert_eq!(names, ["A", "B", "G", "N.X", "N.Y", "N.Z", "R", "Z"]);
        let expect = |name: &str, expected: Vec<f32>| {
            let (_, values) = read.iter().find(|(found, _)| found == name).unwrap();
            assert_eq!(*values, expected, "{name}");
        };
        expect("A", alpha.clone());
        expect("Z", depth.clone());
        for (at, (color, normal)) in [("R", "N.X"), ("G", "N.Y"), ("B", "N.Z")].into_iter().enumerate() {
            expect(
                color,
                rgb.iter().skip(at).step_by(3).map(|&v| srgb_decode(f64::from(v)) as f32).collect(),
            );
            expect(normal, normals.iter().skip(at).step_by(3).copied().collect());
        }
    }

    #[test]
    fn one_kind_with_tags_gives_the_same_bytes_each_time() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.exr");
        let size = PictureSize::new(300, 70);
        let depth: Vec<f32> = (0..size.pixels()).map(|i| i as f32).collect();
        let tags: Vec<_> = (0..9).map(|i| (format!("wm.key{i}"), format!("value {i}: 霧"))).collect();
        let planes = ExrPlanes { depth: Some(&depth), ..ExrPlanes::default() };
        write_exr(&path, planes, size, &tags).unwrap();
        let first = fs::read(&path).unwrap();
        for _ in 0..4 {
            write_exr(&path, planes, size, &tags).unwrap();
            assert!(fs::read(&path).unwrap() == first);
        }
        let (image, read) = open(&path);
        assert_eq!(read, [("Z".to_owned(), depth)]);
        let attributes = &image.layer_data.attributes.other;
        for (key, text) in &tags {
            let value = &attributes[&Text::from_slice_unchecked(key.as_bytes())];
            let AttributeValue::Text(value) = value else { panic!("{value:?}") };
            assert_eq!(value.as_slice(), text.as_bytes());
        }
    }

    #[test]
    fn reserved_names_are_refused() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.exr");
        let planes = ExrPlanes { depth: Some(&[1.0]), ..ExrPlanes::default() };
        let tags = [("channels".to_owned(), "x".to_owned())];
        let error = write_exr(&path, planes, PictureSize::new(1, 1), &tags).unwrap_err();
        assert!(matches!(error, MediaError::Tag { .. }), "{error}");
        assert!(!path.exists());
    }
}
