//! Files of optical flow: Middlebury's `.flo` and KITTI's 16-bit PNG.
//!
//! Vectors are `[H, W, 2]`: pixels to the right and down from a pixel to where what it shows is in
//! the next picture. NaN is no vector.

use super::png::{ChannelBits, ColorType, Meaning, write as write_png};
use super::{MediaError, PictureSize, Tags, write_file};
use std::io::Write;
use std::path::Path;

/// The first number of a `.flo` file: its bytes are `PIEH`.
pub(crate) const FLO_TAG: f32 = 202_021.25;
/// The vector of pixels without one in a `.flo` file: readers take what is above 1e9 px for
/// unknown.
pub(crate) const FLO_UNKNOWN: f32 = 1e10;
/// Counts a pixel in KITTI's PNG, and the count of 0 px.
const KITTI_SCALE: f32 = 64.0;
const KITTI_ZERO: f32 = 32768.0;

/// Writes `vectors [H, W, 2]`, px, as Middlebury's `.flo`, little-endian: `PIEH`, width and height
/// as i32, pairs of f32 row by row. The format has no room for tags.
///
/// # Errors
/// The file cannot be written.
pub fn write_flo(path: &Path, vectors: &[f32], size: PictureSize) -> Result<(), MediaError> {
    size.expect("flow", vectors, 2);
    write_file(path, |out| {
        let mut bytes = Vec::with_capacity(12 + 4 * vectors.len());
        bytes.extend(FLO_TAG.to_le_bytes());
        bytes.extend((size.width as i32).to_le_bytes());
        bytes.extend((size.height as i32).to_le_bytes());
        let known = |value: &f32| if value.is_finite() { *value } else { FLO_UNKNOWN };
        bytes.extend(vectors.iter().flat_map(|value| known(value).to_le_bytes()));
        out.write_all(&bytes).map_err(|source| MediaError::write(path, source))
    })
}

/// Writes `vectors [H, W, 2]`, px, as the 16-bit RGB of KITTI: `64 u + 32768`, `64 v + 32768`,
/// rounded, and 1 where both are known and within 512 px; three zeros elsewhere. Returns the number
/// of vectors that are too long for the format.
///
/// # Errors
/// The file cannot be written, or a tag does not fit.
pub fn write_kitti(
    path: &Path,
    vectors: &[f32],
    size: PictureSize,
    tags: &Tags,
) -> Result<usize, MediaError> {
    size.expect("flow", vectors, 2);
    let mut too_long = 0;
    let mut bytes = Vec::with_capacity(3 * vectors.len());
    for vector in vectors.as_chunks::<2>().0 {
        let counts = vector.map(|v| (KITTI_SCALE * v + KITTI_ZERO).round());
        let is_known = vector.iter().all(|v| v.is_finite());
        let fits = is_known && counts.iter().all(|count| (0.0..=65535.0).contains(count));
        too_long += usize::from(is_known && !fits);
        let pixel = if fits { [counts[0] as u16, counts[1] as u16, 1] } else { [0; 3] };
        bytes.extend(pixel.into_iter().flat_map(u16::to_be_bytes));
    }
    write_png(path, &bytes, size, ColorType::Rgb, ChannelBits::Sixteen, Meaning::Data, tags)?;
    Ok(too_long)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs::File;
    use std::io::BufReader;

    const SIZE: PictureSize = PictureSize { width: 3, height: 2 };
    const VECTORS: [f32; 12] =
        [0.0, 0.0, 1.5, -2.25, -511.99, 511.98, f32::NAN, f32::NAN, 600.0, 1.0, 0.01, -0.01];

    #[test]
    fn flo_has_the_bytes_of_middlebury() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.flo");
        write_flo(&path, &VECTORS, SIZE).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        assert_eq!(bytes.len(), 12 + 8 * 6);
        assert_eq!(&bytes[..4], b"PIEH");
        assert_eq!(bytes[4..12], [3, 0, 0, 0, 2, 0, 0, 0]);
        let values: Vec<f32> =
            bytes[12..].chunks_exact(4).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect();
        for (found, given) in values.iter().zip(VECTORS) {
            assert!(if given.is_nan() { *found > 1e9 } else { *found == given });
        }
    }

    #[test]
    fn kitti_has_counts_and_validity() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.png");
        assert_eq!(write_kitti(&path, &VECTORS, SIZE, &[]).unwrap(), 1);
        let mut reader = ::png::Decoder::new(BufReader::new(File::open(&path).unwrap())).read_info().unwrap();
        let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
        reader.next_frame(&mut bytes).unwrap();
        assert_eq!(
            (reader.info().color_type, reader.info().bit_depth),
            (ColorType::Rgb, ::png::BitDepth::Sixteen)
        );
        let counts: Vec<[u16; 3]> =
            bytes.chunks_exact(6).map(|b| [0, 2, 4].map(|k| u16::from_be_bytes([b[k], b[k + 1]]))).collect();
        let want = [[32768, 32768, 1], [32864, 32624, 1], [1, 65535, 1], [0; 3], [0; 3], [32769, 32767, 1]];
        assert_eq!(counts, want);
    }
}
