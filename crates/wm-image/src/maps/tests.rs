//! Files of every format: what comes back, and what is refused.

use super::*;
use ::exr::prelude::{
    AnyChannel, AnyChannels, Encoding, FlatSamples, Image, Layer, LayerAttributes, WritableImage,
};
use ::png::{BitDepth, ColorType, Encoder};
use ::tiff::encoder::{Compression, DeflateLevel, TiffEncoder, colortype};
use proptest::prelude::*;
use std::io::Cursor;
use tempfile::TempDir;

const SIZE: (u32, u32) = (37, 21);

fn floats(channels: usize) -> Vec<f32> {
    (0..37 * 21 * channels).map(|i| (i as f32 * 0.37).sin() * 9.0).collect()
}

fn png(color: ColorType, depth: BitDepth, size: (u32, u32), bytes: &[u8]) -> Vec<u8> {
    let (width, height) = size;
    let mut out = Vec::new();
    let mut encoder = Encoder::new(&mut out, width, height);
    encoder.set_color(color);
    encoder.set_depth(depth);
    encoder.add_text_chunk("depth_metres_per_count".into(), "0.01".into()).unwrap();
    let mut writer = encoder.write_header().unwrap();
    writer.write_image_data(bytes).unwrap();
    drop(writer);
    out
}

fn tiff(compression: Compression, channels: usize, values: &[f32]) -> Vec<u8> {
    let mut out = Cursor::new(Vec::new());
    let mut encoder = TiffEncoder::new(&mut out).unwrap().with_compression(compression);
    match channels {
        1 => encoder.write_image::<colortype::Gray32Float>(SIZE.0, SIZE.1, values).unwrap(),
        _ => encoder.write_image::<colortype::RGB32Float>(SIZE.0, SIZE.1, values).unwrap(),
    }
    out.into_inner()
}

fn exr(names: &[&str], values: &[f32]) -> Vec<u8> {
    let count = names.len();
    let plane = |at: usize| FlatSamples::F32(values.iter().skip(at).step_by(count).copied().collect());
    let list = names.iter().enumerate().map(|(at, name)| AnyChannel::new(*name, plane(at)));
    let size = (SIZE.0 as usize, SIZE.1 as usize);
    let channels = AnyChannels::sort(list.collect());
    let layer = Layer::new(size, LayerAttributes::default(), Encoding::FAST_LOSSLESS, channels);
    let mut out = Cursor::new(Vec::new());
    Image::from_layer(layer).write().to_buffered(&mut out).unwrap();
    out.into_inner()
}

fn npy(shape: &[usize], values: &[f32]) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.npy");
    wm_base::npy::write(&path, values, shape).unwrap();
    std::fs::read(path).unwrap()
}

/// A folder with a map in it.
struct Shelf(TempDir);

impl Shelf {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn read(&self, bytes: &[u8]) -> Result<Map, MapError> {
        let path = self.0.path().join("map");
        std::fs::write(&path, bytes).unwrap();
        read_map(&path)
    }

    fn refused(&self, bytes: &[u8]) -> String {
        let said = self.read(bytes).unwrap_err().to_string();
        assert!(!said.contains('\n') && said.contains("map: "), "{said}");
        said
    }
}

#[test]
fn floats_come_back_from_every_format() {
    let shelf = Shelf::new();
    let (one, three) = (floats(1), floats(3));
    let (w, h) = (SIZE.0 as usize, SIZE.1 as usize);
    let deflate = Compression::Deflate(DeflateLevel::Fast);
    for (bytes, channels) in [
        (npy(&[h, w], &one), 1),
        (npy(&[h, w, 1], &one), 1),
        (npy(&[h, w, 3], &three), 3),
        (tiff(Compression::Uncompressed, 1, &one), 1),
        (tiff(deflate, 1, &one), 1),
        (tiff(Compression::Lzw, 1, &one), 1),
        (tiff(deflate, 3, &three), 3),
        (exr(&["Z"], &one), 1),
        (exr(&["Y"], &one), 1),
        (exr(&["anything"], &one), 1),
        (exr(&["R", "G", "B"], &three), 3),
        (exr(&["N.X", "N.Y", "N.Z"], &three), 3),
    ] {
        let map = shelf.read(&bytes).unwrap();
        assert_eq!((map.width, map.height, map.channels), (SIZE.0, SIZE.1, channels));
        assert_eq!(map.values, if channels == 1 { &one[..] } else { &three });
        assert_eq!((map.stored, map.metres_per_step), (Stored::Floats, None));
    }
}

#[test]
fn counts_keep_their_steps() {
    let shelf = Shelf::new();
    let wide: Vec<u8> = [0u16, 1, 1000, 65535].iter().flat_map(|v| v.to_be_bytes()).collect();
    let map = shelf.read(&png(ColorType::Grayscale, BitDepth::Sixteen, (2, 2), &wide)).unwrap();
    assert_eq!((map.channels, &map.values[..]), (1, &[0.0, 1.0, 1000.0, 65535.0][..]));
    assert_eq!((map.stored, map.metres_per_step), (Stored::Counts(65535.0), Some(0.01)));
    // Eight pixels of one bit.
    let bits = shelf.read(&png(ColorType::Grayscale, BitDepth::One, (8, 1), &[0b1010_0001])).unwrap();
    assert_eq!(bits.to_mask(), [1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0]);
    let normal = png(ColorType::Rgb, BitDepth::Eight, (1, 1), &[128, 128, 255]);
    let camera = wm_scene::Camera::looking((1, 1), 60.0, glam::DVec3::ZERO, glam::DVec3::X, glam::DVec3::Z);
    let found = NormalAxes::World.to_world(&shelf.read(&normal).unwrap(), &camera.unwrap()).unwrap();
    assert!((found[2] - 1.0).abs() < 1e-4 && found[0] < 0.005, "{found:?}");
}

#[test]
fn masks_are_shares() {
    let mask =
        |values: Vec<f32>, stored| Map { stored, ..Map::new(values.len() as u32, 1, 1, values) }.to_mask();
    assert_eq!(mask(vec![0.0, 51.0, 255.0], Stored::Counts(255.0)), [0.0, 0.2, 1.0]);
    assert_eq!(mask(vec![0.0, 1.0], Stored::Counts(255.0)), [0.0, 1.0]);
    assert_eq!(mask(vec![0.5, 7.0, f32::NAN, -1.0], Stored::Floats), [0.5, 1.0, 0.0, 0.0]);
    let red = Map { stored: Stored::Counts(255.0), ..Map::new(1, 1, 3, vec![255.0, 0.0, 0.0]) };
    assert_eq!(red.to_mask(), [1.0]);
}

#[test]
fn colour_is_no_depth_but_grey_colour_is() {
    assert_eq!(Map::new(1, 1, 3, vec![2.0; 3]).grey(), Ok(vec![2.0]));
    assert_eq!(Map::new(1, 1, 2, vec![2.0, 9.0]).grey(), Ok(vec![2.0]));
    let fault = Map::new(1, 1, 3, vec![2.0, 2.0, 3.0]).grey().unwrap_err();
    assert_eq!(
        fault.to_string(),
        "3 different channels, but one number per pixel (grey) expected; choose another file or save it anew"
    );
}

#[test]
fn maps_of_another_shape_than_the_photo_are_refused() {
    let map = || Map::new(60, 40, 1, vec![1.0; 2400]);
    for (width, height) in [(60, 40), (30, 20), (599, 401), (1200, 800)] {
        let fitted = map().fitted(width, height, Filter::Nearest).unwrap();
        assert_eq!((fitted.width, fitted.height), (width, height));
    }
    let said = map().fitted(60, 45, Filter::Nearest).unwrap_err().to_string();
    assert!(
        said.starts_with("the map is 60x40 px, its photo 60x45; make the map of the whole photo"),
        "{said}"
    );
}

#[test]
fn files_cut_anywhere_are_errors() {
    let shelf = Shelf::new();
    let one = floats(1);
    let wide: Vec<u8> = one.iter().flat_map(|v| ((v * 3000.0) as i32 as u16).to_be_bytes()).collect();
    let deflate = Compression::Deflate(DeflateLevel::Fast);
    for (bytes, most) in [
        // What follows the pixels may be missing: a checksum, the end chunk.
        (png(ColorType::Grayscale, BitDepth::Sixteen, SIZE, &wide), 16),
        (tiff(Compression::Uncompressed, 1, &one), 0),
        (tiff(deflate, 1, &one), 0),
        (exr(&["Z"], &one), 0),
        (npy(&[21, 37], &one), 0),
    ] {
        assert!(shelf.read(&bytes).is_ok());
        let last = bytes.len() - most;
        for end in (0..200).chain((200..last).step_by(97)).chain(last - 40..last) {
            shelf.refused(&bytes[..end]);
        }
    }
}

#[test]
fn sizes_are_not_believed() {
    let shelf = Shelf::new();
    // The sides of a PNG of four pixels.
    let mut bytes = png(ColorType::Grayscale, BitDepth::Sixteen, (2, 2), &[0; 8]);
    for (side, says) in
        [(30_000u32, "more than a map may have"), (1 << 20, "more than"), (11_000, "cannot hold")]
    {
        for at in [16, 20] {
            bytes[at..at + 4].copy_from_slice(&side.to_be_bytes());
        }
        // The checksum of the header, so that the size is what is wrong.
        let sum = crc(&bytes[12..29]).to_be_bytes();
        bytes[29..33].copy_from_slice(&sum);
        let said = shelf.refused(&bytes);
        assert!(said.contains(says), "{said}");
    }
    // Those of a TIFF: entries 256 and 257 of its directory.
    let mut bytes = tiff(Compression::Uncompressed, 1, &floats(1));
    for tag in [256u16, 257] {
        let entry =
            bytes.windows(4).position(|w| w[..2] == tag.to_le_bytes() && [3, 4].contains(&w[2])).unwrap();
        bytes[entry + 8..entry + 12].copy_from_slice(&16_000u32.to_le_bytes());
    }
    let said = shelf.refused(&bytes);
    assert!(said.contains("cannot hold") || said.contains("damaged"), "{said}");
    // The windows of an EXR.
    let bytes = exr(&["Z"], &floats(1));
    let corner: Vec<u8> = [36i32, 20].iter().flat_map(|v| v.to_le_bytes()).collect();
    let far: Vec<u8> = [15_999i32, 15_999].iter().flat_map(|v| v.to_le_bytes()).collect();
    let mut hostile = bytes.clone();
    for at in 0..bytes.len() - 8 {
        if bytes[at..at + 8] == corner {
            hostile[at..at + 8].copy_from_slice(&far);
        }
    }
    assert!(hostile != bytes);
    let said = shelf.refused(&hostile);
    assert!(said.contains("cannot hold"), "{said}");
    // Arrays of no or strange shapes.
    assert!(
        shelf.refused(&npy(&[0, 4], &[])).contains("0 px")
            || shelf.refused(&npy(&[0, 4], &[])).contains("4x0")
    );
    assert!(shelf.refused(&npy(&[4], &[0.0; 4])).contains("an array of shape [4]"));
    assert!(shelf.refused(&npy(&[2, 2, 5], &[0.0; 20])).contains("an array of shape [2, 2, 5]"));
    assert!(shelf.refused(b"hello, I am a map").contains("PNG, TIFF, EXR and NPY are read"));
    let folder = read_map(shelf.0.path()).unwrap_err().to_string();
    assert!(folder.ends_with("cannot be read: it is no regular file"), "{folder}");
}

/// The checksum of PNG's chunks (its standard, annex D), bit by bit.
fn crc(bytes: &[u8]) -> u32 {
    let step = |crc: u32, _| if crc & 1 == 1 { 0xedb8_8320 ^ (crc >> 1) } else { crc >> 1 };
    !bytes.iter().fold(u32::MAX, |crc, byte| (0..8).fold(crc ^ u32::from(*byte), step))
}

proptest! {
    #[test]
    fn damaged_files_never_panic(
        which in 0..4usize,
        edits in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
    ) {
        let mut bytes = match which {
            0 => png(ColorType::Grayscale, BitDepth::Sixteen, (2, 2), &[0; 8]),
            1 => tiff(Compression::Lzw, 1, &floats(1)),
            2 => exr(&["Z"], &floats(1)),
            _ => npy(&[21, 37], &floats(1)),
        };
        for (at, byte) in edits {
            // Headers are where it hurts.
            let at = at.index(bytes.len().min(400));
            bytes[at] = byte;
        }
        let shelf = Shelf::new();
        if let Ok(map) = shelf.read(&bytes) {
            prop_assert_eq!(map.values.len(), map.pixels() * map.channels as usize);
        }
    }
}
