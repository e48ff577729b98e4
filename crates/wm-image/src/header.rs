//! The headers of photos: size, orientation, position and time, read without decoding the picture.
//!
//! JPEG and PNG, with the few tags of EXIF that matter here. Nothing is decoded: a block or two of
//! the file are read, whatever its size.
//!
//! The segments and chunks are walked here, not by the crates imagesize and kamadak-exif: one walk
//! finds both size and EXIF. imagesize takes a PNG's size from a fixed place, be it cut off or no
//! picture, refuses JPEGs with padded markers, and goes on into the data of a picture without a
//! frame header; kamadak-exif reads a whole PNG in search of EXIF. Neither has a limit.

pub use crate::exif::Orientation;
use crate::exif::Tags;
use std::{
    fs::File,
    io::{BufReader, Read, Seek, SeekFrom},
    path::Path,
};
use wm_base::{
    FormatError, Problem,
    error::excerpt,
    files::{LFS_REFUSED, MARK_BYTES, is_lfs_pointer},
};
use wm_scene::Gps;

/// The facts about a photo that its first bytes tell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PhotoHeader {
    /// The format of the file.
    pub kind: PhotoKind,
    /// Width as stored, px.
    pub width: u32,
    /// Height as stored, px.
    pub height: u32,
    /// The turn that makes it upright.
    pub orientation: Orientation,
    /// The position that it states; [`Gps::checked`] tells if photos are taken there.
    pub gps: Option<Gps>,
    /// The time at which it was taken, seconds since 1970, UTC, years 1990 to 2099; `None` without
    /// a time zone.
    pub taken: Option<f64>,
}

/// Formats of photos that are read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PhotoKind {
    /// ISO 10918.
    Jpeg,
    /// ISO 15948.
    Png,
}

/// Bytes read at once; most headers lie within.
const BLOCK_BYTES: usize = 16 << 10;

/// Most segments or chunks before the picture: more is no photo.
const MAX_PARTS: usize = 4096;

/// Reads the header of a photo.
///
/// # Errors
/// [`FormatError`] if it cannot be read or is not a JPEG or PNG.
pub fn read_header(path: &Path) -> Result<PhotoHeader, FormatError> {
    let file = File::open(path).map_err(|e| FormatError::reading(path, e))?;
    if file.metadata().is_ok_and(|about| about.is_dir()) {
        return Err(FormatError::whole(path, Problem::Photo("it is a folder, no photo".into())));
    }
    parse(&mut BufReader::with_capacity(BLOCK_BYTES, file))
        .map_err(|problem| FormatError::whole(path, problem))
}

/// The header of a photo in memory.
///
/// # Errors
/// [`Problem`] as [`read_header`] has it.
pub fn parse(input: &mut (impl Read + Seek)) -> Result<PhotoHeader, Problem> {
    let mut start = Vec::new();
    input.by_ref().take(MARK_BYTES as u64).read_to_end(&mut start).map_err(Problem::Read)?;
    let (kind, mark) = match &start[..] {
        [] => return Err(Problem::Empty),
        [0xff, 0xd8, ..] => (PhotoKind::Jpeg, 2),
        [0x89, b'P', b'N', b'G', 0x0d, 0x0a, 0x1a, 0x0a, ..] => (PhotoKind::Png, 8),
        start => return Err(Problem::Photo(unknown(start))),
    };
    input.seek(SeekFrom::Start(mark)).map_err(Problem::Read)?;
    let (width, height, tags) = match kind {
        PhotoKind::Jpeg => jpeg(input)?,
        PhotoKind::Png => png(input)?,
    };
    if width == 0 || height == 0 {
        return Err(Problem::Photo("its header gives it no width or no height; export it again".into()));
    }
    let Tags { orientation, gps, taken } = tags;
    Ok(PhotoHeader { kind, width, height, orientation, gps, taken })
}

fn unknown(start: &[u8]) -> String {
    let known = match start {
        _ if is_lfs_pointer(start) => return LFS_REFUSED.into(),
        [b'R', b'I', b'F', b'F', _, _, _, _, b'W', b'E', b'B', b'P', ..] => "it is a WebP picture",
        [_, _, _, _, b'f', b't', b'y', b'p', ..] => "it is a HEIC, AVIF or video file",
        [b'I', b'I', 42, 0, ..] | [b'M', b'M', 0, 42, ..] => "it is a TIFF or raw picture",
        [b'G', b'I', b'F', ..] => "it is a GIF",
        _ => return format!("no JPEG or PNG: it begins with \"{}\"", excerpt(&start[..start.len().min(12)])),
    };
    format!("{known}; photos must be JPEG or PNG, convert it")
}

/// Width, height and tags.
fn jpeg(input: &mut (impl Read + Seek)) -> Result<(u32, u32, Tags), Problem> {
    let mut tags = Tags::default();
    for _ in 0..MAX_PARTS {
        let mut marker = [0];
        // Any number of 0xff may stand before a marker.
        let marker = loop {
            take(input, &mut marker)?;
            if marker[0] != 0xff {
                break marker[0];
            }
        };
        // Markers without a length.
        if matches!(marker, 0x01 | 0xd0..=0xd8) {
            continue;
        }
        if matches!(marker, 0x00 | 0xd9 | 0xda) {
            return Err(Problem::Photo("a JPEG without a frame header; it is damaged".into()));
        }
        let mut length = [0; 2];
        take(input, &mut length)?;
        let Some(length) = u16::from_be_bytes(length).checked_sub(2) else {
            return Err(Problem::Photo("a JPEG with a segment of impossible length; it is damaged".into()));
        };
        let is_frame = matches!(marker, 0xc0..=0xcf) && !matches!(marker, 0xc4 | 0xc8 | 0xcc);
        if is_frame {
            let mut frame = [0; 5];
            take(input, &mut frame)?;
            let [_, h1, h0, w1, w0] = frame;
            let (width, height) = (u16::from_be_bytes([w1, w0]), u16::from_be_bytes([h1, h0]));
            return Ok((width.into(), height.into(), tags));
        }
        if marker == 0xe1 {
            let mut segment = vec![0; usize::from(length)];
            take(input, &mut segment)?;
            if let Some(exif) = segment.strip_prefix(b"Exif\0\0") {
                tags = Tags::parse(exif);
            }
        } else {
            input.seek_relative(i64::from(length)).map_err(Problem::Read)?;
        }
    }
    Err(Problem::Photo("a JPEG without a frame header; it is damaged".into()))
}

/// Width, height and tags.
fn png(input: &mut (impl Read + Seek)) -> Result<(u32, u32, Tags), Problem> {
    let mut size = None;
    let mut tags = Tags::default();
    for _ in 0..MAX_PARTS {
        let mut head = [0; 8];
        take(input, &mut head)?;
        let [a, b, c, d, name @ ..] = head;
        let length = u32::from_be_bytes([a, b, c, d]);
        match (&name, size) {
            (b"IHDR", None) if length >= 8 => {
                let mut sides = [0; 8];
                take(input, &mut sides)?;
                let [a, b, c, d, e, f, g, h] = sides;
                size = Some((u32::from_be_bytes([a, b, c, d]), u32::from_be_bytes([e, f, g, h])));
                input.seek_relative(i64::from(length) - 8 + 4).map_err(Problem::Read)?;
            }
            (b"IDAT" | b"IEND", Some((width, height))) => return Ok((width, height, tags)),
            (b"eXIf", Some(_)) if length <= 1 << 16 => {
                let mut exif = vec![0; length as usize];
                take(input, &mut exif)?;
                tags = Tags::parse(&exif);
                input.seek_relative(4).map_err(Problem::Read)?;
            }
            (_, Some(_)) => input.seek_relative(i64::from(length) + 4).map_err(Problem::Read)?,
            (_, None) => break,
        }
    }
    Err(Problem::Photo("a PNG without a header or a picture; it is damaged".into()))
}

fn take(input: &mut impl Read, out: &mut [u8]) -> Result<(), Problem> {
    input.read_exact(out).map_err(|error| match error.kind() {
        std::io::ErrorKind::UnexpectedEof => Problem::Photo("cut off in its header; copy it again".into()),
        _ => Problem::Read(error),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::io::Cursor;

    /// An EXIF block with an orientation and a place.
    fn exif(is_little: bool, orientation: u16, place: Option<[[u32; 6]; 2]>) -> Vec<u8> {
        let two = |v: u16| if is_little { v.to_le_bytes() } else { v.to_be_bytes() };
        let four = |v: u32| if is_little { v.to_le_bytes() } else { v.to_be_bytes() };
        let mut out = if is_little { b"II".to_vec() } else { b"MM".to_vec() };
        out.extend(two(42));
        out.extend(four(8));
        out.extend(two(2));
        let entry = |out: &mut Vec<u8>, tag: u16, kind: u16, count: u32, value: [u8; 4]| {
            out.extend(two(tag));
            out.extend(two(kind));
            out.extend(four(count));
            out.extend(value);
        };
        let [a, b] = two(orientation);
        entry(&mut out, 0x0112, 3, 1, [a, b, 0, 0]);
        let directory = out.len() as u32 + 12 + 4;
        entry(&mut out, 0x8825, 4, 1, four(directory));
        out.extend(four(0));
        if let Some(place) = place {
            let values = directory + 2 + 5 * 12 + 4;
            out.extend(two(5));
            entry(&mut out, 1, 2, 2, *b"S\0\0\0");
            entry(&mut out, 2, 5, 3, four(values));
            entry(&mut out, 3, 2, 2, *b"E\0\0\0");
            entry(&mut out, 4, 5, 3, four(values + 24));
            entry(&mut out, 6, 5, 1, four(values + 48));
            out.extend(four(0));
            place.iter().flatten().for_each(|v| out.extend(four(*v)));
            out.extend(four(1234));
            out.extend(four(10));
        }
        out
    }

    fn jpeg_with(exif: &[u8]) -> Vec<u8> {
        let mut out = vec![0xff, 0xd8, 0xff, 0xe0, 0, 4, 1, 2, 0xff, 0xff, 0xe1];
        out.extend((exif.len() as u16 + 8).to_be_bytes());
        out.extend(b"Exif\0\0");
        out.extend(exif);
        out.extend([0xff, 0xc4, 0, 3, 9, 0xff, 0xc2, 0, 17, 8, 0x03, 0x77, 0x04, 0xb0, 3]);
        out
    }

    fn png_with(exif: &[u8]) -> Vec<u8> {
        let mut out = b"\x89PNG\r\n\x1a\n\0\0\0\x0dIHDR\0\0\x04\xb0\0\0\x03\x77\x08\x02\0\0\0CRC_".to_vec();
        out.extend((exif.len() as u32).to_be_bytes());
        out.extend(b"eXIf");
        out.extend(exif);
        out.extend(b"CRC_\0\0\0\x09IDAT");
        out
    }

    const GPS_RATIONALS: [[u32; 6]; 2] = [[33, 1, 30, 1, 3600, 100], [151, 1, 126, 10, 0, 0]];

    #[test]
    fn size_orientation_and_place_are_found() {
        for is_little in [false, true] {
            let block = exif(is_little, 6, Some(GPS_RATIONALS));
            for (kind, bytes) in [(PhotoKind::Jpeg, jpeg_with(&block)), (PhotoKind::Png, png_with(&block))] {
                let header = parse(&mut Cursor::new(&bytes)).unwrap();
                assert_eq!((header.kind, header.width, header.height), (kind, 1200, 887));
                assert_eq!(header.orientation, Orientation::Turned90);
                let gps = header.gps.unwrap();
                assert!((gps.latitude + 33.51).abs() < 1e-12 && (gps.longitude - 151.21).abs() < 1e-12);
                assert_eq!(gps.altitude, Some(123.4));
            }
        }
    }

    #[test]
    fn photos_that_are_none_are_named() {
        let say = |bytes: &[u8]| parse(&mut Cursor::new(bytes)).unwrap_err().to_string();
        assert_eq!(say(b""), "the file is empty; copy or export it again");
        assert_eq!(say(b"version https://git-lfs.github.com/spec/v1\noid sha256:d1bb"), LFS_REFUSED);
        assert_eq!(say(b"hello"), "no JPEG or PNG: it begins with \"hello\"");
        assert_eq!(say(b"RIFF\0\0\0\0WEBP"), "it is a WebP picture; photos must be JPEG or PNG, convert it");
        assert_eq!(say(&[0xff, 0xd8, 0xff, 0xda]), "a JPEG without a frame header; it is damaged");
        assert_eq!(say(&[0xff, 0xd8, 0xff]), "cut off in its header; copy it again");
    }

    #[test]
    fn orientations_turn_as_exif_says() {
        // 3 x 2 stored; EXIF 6: the stored first row is the right column of the upright picture.
        assert_eq!(Orientation::Turned90.stored_from_upright(1, 0, 3, 2), (0, 0));
        assert_eq!(Orientation::Turned90.stored_from_upright(1, 2, 3, 2), (2, 0));
        // EXIF 8: the stored first row is the left column, upwards.
        assert_eq!(Orientation::Turned270.stored_from_upright(0, 2, 3, 2), (0, 0));
        assert_eq!(Orientation::Turned270.stored_from_upright(0, 0, 3, 2), (2, 0));
        for number in 1..=8 {
            let turn = Orientation::from_number(number);
            let (w, h) = if turn.swaps_sides() { (2, 3) } else { (3, 2) };
            let mut seen: Vec<_> =
                (0..h).flat_map(|y| (0..w).map(move |x| turn.stored_from_upright(x, y, 3, 2))).collect();
            seen.sort_unstable();
            seen.dedup();
            assert!(seen.len() == 6 && seen.iter().all(|(x, y)| *x < 3 && *y < 2), "{number}");
        }
    }

    #[test]
    fn headers_cut_at_any_byte_are_errors() {
        let block = exif(true, 3, Some(GPS_RATIONALS));
        for bytes in [jpeg_with(&block), png_with(&block)] {
            let needed = bytes.len() - if bytes[0] == 0xff { 1 } else { 0 };
            for end in 0..needed {
                let error = parse(&mut Cursor::new(&bytes[..end])).unwrap_err().to_string();
                assert!(!error.contains('\n'), "{error}");
            }
            assert!(parse(&mut Cursor::new(&bytes)).is_ok());
        }
        for end in 0..block.len() {
            Tags::parse(&block[..end]);
        }
    }

    proptest! {
        #[test]
        fn mutated_headers_never_panic(
            is_png: bool,
            edits in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..8),
        ) {
            let block = exif(true, 3, Some(GPS_RATIONALS));
            let mut bytes = if is_png { png_with(&block) } else { jpeg_with(&block) };
            for (at, byte) in edits {
                let at = at.index(bytes.len());
                bytes[at] = byte;
            }
            let _ = parse(&mut Cursor::new(&bytes));
        }

        #[test]
        fn random_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..200), is_little: bool) {
            let _ = parse(&mut Cursor::new(&bytes));
            let mut block = exif(is_little, 1, None)[..8].to_vec();
            block.extend(&bytes);
            Tags::parse(&block);
        }
    }
}
