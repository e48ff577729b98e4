//! PNG pictures: colour, depth, normals, alpha.
//!
//! Colour carries the chunks sRGB and gAMA; the others are data and carry neither, so that nothing
//! "corrects" them. Tags become tEXt chunks, or iTXt where Latin-1 does not do.

use std::io::Write;
use std::path::Path;

pub(super) use png::ColorType;
pub use png::EncodingError;
use png::{BitDepth, Compression, Encoder, ScaledFloat, SrgbRenderingIntent};

use super::color::{self, Dither};
use super::{MediaError, PictureSize, Tags, write_file};

/// Name of the tag that holds the scale of a depth picture.
pub(crate) const DEPTH_SCALE_KEY: &str = "depth_metres_per_count";
/// Name of the tag that says how normals are stored.
const NORMAL_KEY: &str = "normal_encoding";

/// Bits of one channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ChannelBits {
    /// 0-255.
    Eight,
    /// 0-65535.
    Sixteen,
}

/// The scale of 16-bit depth.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum DepthScale {
    /// The finest of 1 mm, 1 cm, 1 dm and 1 m that reaches the largest finite depth of this
    /// picture. Frames of one sequence may then differ; for them, choose once by
    /// [`DepthScale::reaching`].
    #[default]
    Auto,
    /// Metres a count, or scene units where the depth is in those. Above 0.
    MetresPerCount(f64),
}

impl DepthScale {
    /// The finest scale of 1 mm (up to 65.535 m), 1 cm (655.35 m), 1 dm (6553.5 m) and 1 m that
    /// reaches `depth`; 1 m for all that is farther.
    #[must_use]
    pub fn reaching(depth: f64) -> Self {
        let scales = [0.001, 0.01, 0.1];
        let reaches = |scale: &f64| depth <= scale * f64::from(u16::MAX);
        Self::MetresPerCount(scales.into_iter().find(reaches).unwrap_or(1.0))
    }

    fn metres_per_count(self, depth: &[f32]) -> f64 {
        match self {
            Self::MetresPerCount(scale) => {
                assert!(scale > 0.0 && scale.is_finite(), "a depth scale of {scale} m per count");
                scale
            }
            Self::Auto => {
                let farthest = depth.iter().copied().filter(|depth| depth.is_finite()).fold(0.0, f32::max);
                Self::reaching(f64::from(farthest)).metres_per_count(depth)
            }
        }
    }
}

/// Writes `rgb [H, W, 3]`, sRGB-encoded, as 8-bit RGB.
///
/// # Errors
/// The file cannot be written, or a tag does not fit.
pub fn write_rgb(
    path: &Path,
    rgb: &[f32],
    size: PictureSize,
    dither: Dither,
    tags: &Tags,
) -> Result<(), MediaError> {
    write_rgb8(path, &color::quantize_rgb8(rgb, size, dither), size, tags)
}

/// Writes `rgb [H, W, 3]`, sRGB bytes, as 8-bit RGB.
///
/// # Errors
/// The file cannot be written, or a tag does not fit.
pub fn write_rgb8(path: &Path, rgb: &[u8], size: PictureSize, tags: &Tags) -> Result<(), MediaError> {
    size.expect("rgb", rgb, 3);
    write(path, rgb, size, ColorType::Rgb, ChannelBits::Eight, Meaning::Color, tags)
}

/// Encodes `rgb [H, W, 3]`, sRGB, in memory as 8-bit RGB without tags, for files that others write.
///
/// # Errors
/// [`EncodingError`] if the size makes no picture.
///
/// # Panics
/// If `rgb` is not of this size.
pub fn encode_rgb8(rgb: &[u8], size: PictureSize) -> Result<Vec<u8>, EncodingError> {
    size.expect("rgb", rgb, 3);
    let mut out = Vec::with_capacity(rgb.len() / 2);
    let mut encoder = Encoder::new(&mut out, size.width, size.height);
    set_up(&mut encoder, ColorType::Rgb, ChannelBits::Eight, Meaning::Color);
    let mut writer = encoder.write_header()?;
    writer.write_image_data(rgb)?;
    writer.finish()?;
    Ok(out)
}

/// Writes `depth [H, W]`, metres or scene units, as 16-bit grey, and returns the metres (or units)
/// a count, which is also in the tag `depth_metres_per_count`.
///
/// A count is the depth over the scale, rounded, at most 65535; 0 = nothing there, and a depth that
/// would round to it counts 1. What is negative or no number is nothing.
///
/// # Errors
/// The file cannot be written, or a tag does not fit.
pub fn write_depth(
    path: &Path,
    depth: &[f32],
    size: PictureSize,
    scale: DepthScale,
    tags: &Tags,
) -> Result<f64, MediaError> {
    size.expect("depth", depth, 1);
    let metres_per_count = scale.metres_per_count(depth);
    let count = |depth: f32| {
        if depth > 0.0 { (f64::from(depth) / metres_per_count).round().clamp(1.0, 65535.0) as u16 } else { 0 }
    };
    let bytes: Vec<u8> = depth.iter().flat_map(|&depth| count(depth).to_be_bytes()).collect();
    let mut tags = tags.to_vec();
    tags.push((DEPTH_SCALE_KEY.to_owned(), metres_per_count.to_string()));
    write(path, &bytes, size, ColorType::Grayscale, ChannelBits::Sixteen, Meaning::Data, &tags)?;
    Ok(metres_per_count)
}

/// Writes `normals [H, W, 3]`, unit vectors, as RGB: `0.5 + 0.5 n` of full scale, rounded. Nothing,
/// (0, 0, 0), becomes 128 or 32768 three times, which no unit vector does.
///
/// # Errors
/// The file cannot be written, or a tag does not fit.
pub fn write_normals(
    path: &Path,
    normals: &[f32],
    size: PictureSize,
    bits: ChannelBits,
    tags: &Tags,
) -> Result<(), MediaError> {
    size.expect("normals", normals, 3);
    let values = normals.iter().map(|n| 0.5 + 0.5 * n);
    let mut tags = tags.to_vec();
    tags.push((NORMAL_KEY.to_owned(), "0.5 + 0.5 n, world axes".to_owned()));
    write(path, &data_bytes(values, bits), size, ColorType::Rgb, bits, Meaning::Data, &tags)
}

/// Writes `shares [H, W, 3]`, 0-1, as 16-bit RGB, rounded: data, not colours.
///
/// # Errors
/// The file cannot be written, or a tag does not fit.
pub fn write_shares(path: &Path, shares: &[f32], size: PictureSize, tags: &Tags) -> Result<(), MediaError> {
    size.expect("shares", shares, 3);
    let bytes = data_bytes(shares.iter().copied(), ChannelBits::Sixteen);
    write(path, &bytes, size, ColorType::Rgb, ChannelBits::Sixteen, Meaning::Data, tags)
}

/// Writes `alpha [H, W]`, 0-1, as grey, rounded.
///
/// # Errors
/// The file cannot be written, or a tag does not fit.
pub fn write_alpha(
    path: &Path,
    alpha: &[f32],
    size: PictureSize,
    bits: ChannelBits,
    tags: &Tags,
) -> Result<(), MediaError> {
    size.expect("alpha", alpha, 1);
    let bytes = data_bytes(alpha.iter().copied(), bits);
    write(path, &bytes, size, ColorType::Grayscale, bits, Meaning::Data, tags)
}

/// Writes `numbers [H, W]` as grey, each as it is: names of classes, not shares.
///
/// # Errors
/// The file cannot be written, or a tag does not fit.
///
/// # Panics
/// If a number is above 255 with eight bits.
pub fn write_numbers(
    path: &Path,
    numbers: &[u16],
    size: PictureSize,
    bits: ChannelBits,
    tags: &Tags,
) -> Result<(), MediaError> {
    size.expect("numbers", numbers, 1);
    let bytes: Vec<u8> = match bits {
        ChannelBits::Eight => {
            numbers.iter().map(|n| u8::try_from(*n).expect("a number of eight bits")).collect()
        }
        ChannelBits::Sixteen => numbers.iter().flat_map(|n| n.to_be_bytes()).collect(),
    };
    write(path, &bytes, size, ColorType::Grayscale, bits, Meaning::Data, tags)
}

/// 0-1 at full scale, big-endian, to the nearest: data is not dithered.
fn data_bytes(values: impl Iterator<Item = f32>, bits: ChannelBits) -> Vec<u8> {
    let values = values.map(color::unit);
    match bits {
        ChannelBits::Eight => values.map(|value| (value * 255.0).round() as u8).collect(),
        ChannelBits::Sixteen => {
            values.flat_map(|value| ((value * 65535.0).round() as u16).to_be_bytes()).collect()
        }
    }
}

/// The kind of values.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Meaning {
    /// sRGB.
    Color,
    /// Numbers.
    Data,
}

pub(super) fn write(
    path: &Path,
    bytes: &[u8],
    size: PictureSize,
    color_type: ColorType,
    bits: ChannelBits,
    meaning: Meaning,
    tags: &Tags,
) -> Result<(), MediaError> {
    write_file(path, |out| {
        let failed = |error| match error {
            EncodingError::IoError(source) => MediaError::write(path, source),
            other => {
                MediaError::Format { path: path.to_path_buf(), format: "PNG", reason: other.to_string() }
            }
        };
        let mut encoder = Encoder::new(out, size.width, size.height);
        set_up(&mut encoder, color_type, bits, meaning);
        for (key, text) in tags {
            add_tag(&mut encoder, key, text).map_err(|reason| MediaError::Tag {
                path: path.to_path_buf(),
                key: key.clone(),
                reason,
            })?;
        }
        let mut writer = encoder.write_header().map_err(failed)?;
        writer.write_image_data(bytes).map_err(failed)?;
        writer.finish().map_err(failed)
    })
}

/// Sets what a picture is and how hard it is packed.
fn set_up<W: Write>(
    encoder: &mut Encoder<'_, W>,
    color_type: ColorType,
    bits: ChannelBits,
    meaning: Meaning,
) {
    encoder.set_color(color_type);
    encoder.set_depth(match bits {
        ChannelBits::Eight => BitDepth::Eight,
        ChannelBits::Sixteen => BitDepth::Sixteen,
    });
    // A quarter larger than the next better, but written in a twentieth of its 0.3 s for a frame.
    encoder.set_compression(Compression::Fast);
    if meaning == Meaning::Color {
        encoder.set_source_srgb(SrgbRenderingIntent::Perceptual);
        // For readers that know only gamma: 1/2.2, as the PNG standard asks beside sRGB.
        encoder.set_source_gamma(ScaledFloat::from_scaled(45455));
    }
}

/// Adds a chunk, or says why the key or text cannot be one.
fn add_tag<W: Write>(encoder: &mut Encoder<'_, W>, key: &str, text: &str) -> Result<(), String> {
    if key.is_empty() || key.len() > 79 || !key.chars().all(|c| c == ' ' || c.is_ascii_graphic()) {
        return Err("a PNG keyword has 1 to 79 printable ASCII characters".to_owned());
    }
    if text.contains('\0') {
        return Err("a PNG text has no zero characters".to_owned());
    }
    let latin = text.chars().all(|c| u32::from(c) < 256);
    let add = if latin { Encoder::add_text_chunk } else { Encoder::add_itxt_chunk };
    add(encoder, key.to_owned(), text.to_owned()).map_err(|error| error.to_string())
}

#[cfg(test)]
mod tests {
    use std::fs::File;
    use std::io::BufReader;

    use super::*;

    struct Read {
        info: ::png::Info<'static>,
        bytes: Vec<u8>,
    }

    impl Read {
        fn open(path: &Path) -> Self {
            let decoder = ::png::Decoder::new(BufReader::new(File::open(path).unwrap()));
            let mut reader = decoder.read_info().unwrap();
            let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
            reader.next_frame(&mut bytes).unwrap();
            Self { info: reader.info().clone(), bytes }
        }

        fn counts(&self) -> Vec<u16> {
            self.bytes.chunks_exact(2).map(|b| u16::from_be_bytes([b[0], b[1]])).collect()
        }

        fn tag(&self, key: &str) -> Option<String> {
            let plain = self.info.uncompressed_latin1_text.iter().find(|chunk| chunk.keyword == key);
            let utf8 = self.info.utf8_text.iter().find(|chunk| chunk.keyword == key);
            plain.map(|chunk| chunk.text.clone()).or(utf8.map(|chunk| chunk.get_text().unwrap()))
        }
    }

    fn tags(pairs: &[(&str, &str)]) -> Vec<(String, String)> {
        pairs.iter().map(|(key, text)| ((*key).to_owned(), (*text).to_owned())).collect()
    }

    #[test]
    fn a_picture_in_memory_has_the_bytes_of_its_file() {
        let directory = tempfile::tempdir().unwrap();
        let (path, size) = (directory.path().join("a.png"), PictureSize::new(5, 3));
        let rgb: Vec<u8> = (0..45).map(|i| i * 5).collect();
        write_rgb8(&path, &rgb, size, &[]).unwrap();
        assert_eq!(encode_rgb8(&rgb, size).unwrap(), std::fs::read(&path).unwrap());
    }

    #[test]
    fn colour_comes_back_with_its_space_and_tags() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.png");
        let size = PictureSize::new(70, 9);
        let rgb: Vec<f32> = (0..size.pixels() * 3).map(|i| i as f32 / 1000.0 - 0.2).collect();
        let tags = tags(&[("program", "weather-magician 0.1"), ("scene", "Straße é"), ("note", "霧 °")]);
        write_rgb(&path, &rgb, size, Dither::Ordered, &tags).unwrap();
        let read = Read::open(&path);
        assert_eq!((read.info.width, read.info.height), (70, 9));
        assert_eq!((read.info.color_type, read.info.bit_depth), (ColorType::Rgb, BitDepth::Eight));
        assert_eq!(read.bytes, color::quantize_rgb8(&rgb, size, Dither::Ordered));
        assert_eq!(read.info.srgb, Some(SrgbRenderingIntent::Perceptual));
        assert_eq!(read.info.gama_chunk, Some(ScaledFloat::from_scaled(45455)));
        for (key, text) in &tags {
            assert_eq!(read.tag(key).as_ref(), Some(text));
        }
    }

    #[test]
    fn depth_keeps_its_scale_and_its_holes() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.png");
        let size = PictureSize::new(4, 2);
        let depth = [0.0, 0.0001, 1.2345, 60.0, -1.0, f32::NAN, f32::INFINITY, 0.0015];
        let scale = write_depth(&path, &depth, size, DepthScale::Auto, &[]).unwrap();
        assert_eq!(scale, 0.001);
        let read = Read::open(&path);
        assert_eq!((read.info.color_type, read.info.bit_depth), (ColorType::Grayscale, BitDepth::Sixteen));
        assert_eq!(read.counts(), [0, 1, 1235, 60000, 0, 0, 65535, 2]);
        assert_eq!(read.tag(DEPTH_SCALE_KEY).unwrap().parse::<f64>().unwrap(), scale);
        assert_eq!((read.info.srgb, read.info.gama_chunk), (None, None));
        for (farthest, expected) in [(65.535, 0.001), (65.6, 0.01), (700.0, 0.1), (1e5, 1.0)] {
            assert_eq!(DepthScale::reaching(farthest), DepthScale::MetresPerCount(expected));
        }
        let given = write_depth(&path, &[100.0; 8], size, DepthScale::MetresPerCount(0.001), &[]).unwrap();
        assert_eq!((given, Read::open(&path).counts()), (0.001, vec![65535; 8]));
    }

    #[test]
    fn normals_and_alpha_come_back() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.png");
        let size = PictureSize::new(2, 2);
        let normals = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.6, 0.0, -0.8];
        for (bits, step) in [(ChannelBits::Eight, 1.0 / 255.0), (ChannelBits::Sixteen, 1.0 / 65535.0)] {
            write_normals(&path, &normals, size, bits, &[]).unwrap();
            let read = Read::open(&path);
            let values: Vec<f32> = match bits {
                ChannelBits::Eight => read.bytes.iter().map(|&b| f32::from(b) * step).collect(),
                ChannelBits::Sixteen => read.counts().iter().map(|&c| f32::from(c) * step).collect(),
            };
            assert!(normals.iter().zip(&values).all(|(n, v)| (2.0 * v - 1.0 - n).abs() < 1.1 * step));
            assert_eq!((read.info.srgb, read.info.gama_chunk), (None, None));

            write_alpha(&path, &[0.0, 0.25, 0.5, 1.0], size, bits, &[]).unwrap();
            let read = Read::open(&path);
            match bits {
                ChannelBits::Eight => assert_eq!(read.bytes, [0, 64, 128, 255]),
                ChannelBits::Sixteen => assert_eq!(read.counts(), [0, 16384, 32768, 65535]),
            }
        }
    }

    #[test]
    fn numbers_come_back_as_they_are() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.png");
        let size = PictureSize::new(2, 2);
        write_numbers(&path, &[0, 1, 300, 65535], size, ChannelBits::Sixteen, &[]).unwrap();
        assert_eq!(Read::open(&path).counts(), [0, 1, 300, 65535]);
        write_numbers(&path, &[0, 1, 2, 255], size, ChannelBits::Eight, &[]).unwrap();
        assert_eq!(Read::open(&path).bytes, [0, 1, 2, 255]);
    }

    #[test]
    fn a_tag_that_does_not_fit_is_named_and_leaves_no_file() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.png");
        for (key, text) in [("", "x"), ("schlüssel", "x"), ("key", "a\0b")] {
            let error = write_rgb8(&path, &[0; 3], PictureSize::new(1, 1), &tags(&[(key, text)]))
                .unwrap_err()
                .to_string();
            assert!(error.contains(&format!("{key:?}")) && !error.contains('\n'), "{error}");
        }
        assert_eq!(std::fs::read_dir(&directory).unwrap().count(), 0);
    }
}
