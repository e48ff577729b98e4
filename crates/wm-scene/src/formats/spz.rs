//! SPZ of Niantic: about 20 bytes a splat before it is packed, columns behind a header.
//!
//! # Layout
//! Versions 1 to 3 are one gzip stream (some programs leave it unpacked): a header of 16 bytes,
//! then the columns. Version 4 has a header of 32 bytes, perhaps records of extensions, a table of
//! two 64-bit lengths a stream (packed, unpacked) and a Zstandard stream a column.
//!
//! | column | a splat | means |
//! |---|---|---|
//! | means | 3 x 24 bits signed | steps of `2^-fractional_bits`; version 1: 3 halves |
//! | opacities | 1 byte | of 255 |
//! | colours | 3 bytes | coefficient of degree 0 is (b / 255 - 1/2) / 0.15 |
//! | scales | 3 bytes | logarithm is b / 16 - 10 |
//! | quaternions | 32 bits | place (xyzw) of the largest, then sign and 9 bits of each other over 1/sqrt(2); versions 1 and 2: x, y, z as bytes, 127.5 is 0 |
//! | SH | 1 byte each | (b - 128) / 128, coefficient by coefficient, channels innermost |
//!
//! Written SH are rounded to 7 bits at degree 1 and 6 above, so that they pack better; Niantic's
//! writer rounds to 5 and 4, which shows (36 dB against 41 on a street of SH degree 3). Its fixed
//! 12 fractional bits are too coarse for small scenes and too few before the point for large ones:
//! they are chosen by extent here. The axes are y up, z back (RUB), unless a record of Adobe's
//! extension names others.

use super::axes::Axes;
use super::bytes::{Bytes, Gunzip, check_unpacked, rows, unpack_exact};
use super::format::{SceneFormat, SpzVersion, WriteOptions, Writer};
use super::loss::FormatLosses;
use super::pack::{byte_of_logit, from_smallest_three, logit_of_byte, smallest_three, unit, unorm};
use crate::{Metadata, Rasterization, Remark, Scene, Splats, origin, sh};
use half::f16;
use ruzstd::{
    decoding::StreamingDecoder,
    encoding::{CompressionLevel, FrameCompressor, Matcher, Sequence, compress_to_vec},
};
use sirocco::deflate;
use std::{
    borrow::Cow,
    io::{self, Read, Write},
};
use wm_base::error::Problem;

/// The entry of [`FORMATS`](super::FORMATS).
pub(super) const FORMAT: SceneFormat = SceneFormat {
    name: "SPZ",
    extensions: &["spz"],
    about: "Niantic's SPZ, versions 1 to 4, gzip or Zstandard",
    axes: Axes::YUpZBack,
    loses: FormatLosses {
        rounding: "positions 2^-22 of the largest coordinate (2^-13 units in scenes wider than 1024), scales 3 %, rotations 0.25 degrees, opacities 1/510, colours 0.4 %, \
                   SH 1/128 (degree 1) and 1/64",
        log_scales: [-10.0, 5.937_5],
        coarse: |splats| coarse_steps(splats, fractional_bits(splats)),
        ..FormatLosses::SPLATS_ALONE
    },
    sniff: |start| start.bytes.starts_with(&MAGIC) || start.bytes.starts_with(&[0x1f, 0x8b]),
    read: |source, _| source.parsed(|bytes, _| read(bytes)),
    write: Writer::Stream(write),
};

const MAGIC: [u8; 4] = *b"NGSP";
/// Flag of a scene trained with Mip-Splatting's filter.
const ANTIALIASED_FLAG: u8 = 1;
/// Flag of a file with records of extensions.
const EXTENSIONS_FLAG: u8 = 2;
/// The record `SPZ_ADOBE_coordinate_system`.
const AXES_EXTENSION: u32 = 0xADBE_0003;
/// The scale of the bytes of a colour.
const COLOR_SCALE: f32 = 0.15;
/// Bits kept of SH of degree 1 to 3.
const SH_BITS: [u32; 3] = [7, 6, 6];
/// Fractional bits of Niantic's writer.
const USUAL_BITS: u32 = 12;

/// The content of both headers.
struct Header {
    version: u32,
    count: u64,
    /// Degree in the file, which may be 4; what is above 3 is left out.
    sh_degree: u8,
    fractional_bits: u8,
    flags: u8,
}

impl Header {
    fn parse(bytes: &mut Bytes) -> Result<Self, Problem> {
        if bytes.array::<4>()? != MAGIC {
            return Err(Problem::Header("it unpacks to something that is not an SPZ".into()));
        }
        let (version, count) = (bytes.u32()?, u64::from(bytes.u32()?));
        let [sh_degree, fractional_bits, flags, _] = bytes.array()?;
        if !(1..=4).contains(&version) {
            return Err(Problem::Header(format!("SPZ version {version} is not read, 1 to 4 are")));
        }
        if sh_degree > 4 {
            return Err(Problem::Header(format!("SPZ with SH degree {sh_degree}, the highest is 4")));
        }
        if fractional_bits > 23 {
            return Err(Problem::Header(format!(
                "SPZ with {fractional_bits} fractional bits, the most are 23"
            )));
        }
        Ok(Self { version, count, sh_degree, fractional_bits, flags })
    }

    /// Memory for all columns, if so much may be unpacked from a file.
    fn body(&self, file: &[u8]) -> Result<Vec<u8>, Problem> {
        let size = self.count * self.columns().iter().sum::<u64>();
        check_unpacked(size, file.len() as u64, "the SPZ's header")?;
        Ok(vec![0; size as usize])
    }

    /// Bytes per splat of each column.
    fn columns(&self) -> [u64; COLUMN_COUNT] {
        sizes(self.version, self.sh_degree)
    }
}

/// Bytes per splat of each column in a version.
fn sizes(version: u32, sh_degree: u8) -> [u64; COLUMN_COUNT] {
    let means = if version == 1 { 6 } else { 9 };
    let quats = if version < 3 { 3 } else { 4 };
    [means, 1, 3, 3, quats, 3 * (sh::coefficients(sh_degree) as u64 - 1)]
}

/// Reads a file in memory; the scene has the axes of SPZ.
pub(super) fn read(file: &[u8]) -> Result<Scene, Problem> {
    let (header, axes, body) = if file.starts_with(&[0x1f, 0x8b]) {
        let (header, body) = read_gzip(file)?;
        (header, FORMAT.axes, Cow::Owned(body))
    } else {
        let mut bytes = Bytes::new(file, "the SPZ's header");
        let header = Header::parse(&mut bytes)?;
        if header.version < 4 {
            (header, FORMAT.axes, Cow::Borrowed(bytes.rest()))
        } else {
            read_zstd(header, file, bytes)?
        }
    };
    let mut columns = Bytes::new(&body, "the SPZ");
    let mut column = [&body[..0]; COLUMN_COUNT];
    for (slot, size) in column.iter_mut().zip(header.columns()) {
        *slot = columns.take(header.count * size)?;
    }
    let antialiased = header.flags & ANTIALIASED_FLAG != 0;
    let rasterization = antialiased.then_some(Rasterization::Antialiased);
    let splats = unpack(&header, column);
    let metadata = Metadata { rasterization, ..Metadata::default() };
    let mut remarks = Vec::new();
    if header.sh_degree > sh::MAX_DEGREE {
        let text = "SH of degree 4 is cut to degree 3: colours by direction are less sharp";
        remarks.push(Remark::doubt("sh-degree", text));
    }
    if header.version > 1 {
        let coarse = coarse_steps(&splats, header.fractional_bits);
        remarks.extend(coarse.map(|line| Remark::doubt(origin::COARSE, line)));
    }
    let mut scene = Scene { splats, metadata, remarks, ..Scene::default() };
    if axes != FORMAT.axes {
        axes.turn(&mut scene);
        FORMAT.axes.turn(&mut scene);
    }
    Ok(scene)
}

fn read_gzip(file: &[u8]) -> Result<(Header, Vec<u8>), Problem> {
    let mut reader = Gunzip::new(file);
    let mut start = [0; 16];
    unpack_exact(&mut reader, &mut start, "the SPZ's header")?;
    let header = Header::parse(&mut Bytes::new(&start, "the SPZ's header"))?;
    let mut body = header.body(file)?;
    unpack_exact(&mut reader, &mut body, "the SPZ")?;
    Ok((header, body))
}

/// Reads a file of version 4, of which `bytes` are behind the fields that all headers have.
fn read_zstd<'a>(
    header: Header,
    file: &[u8],
    mut bytes: Bytes,
) -> Result<(Header, Axes, Cow<'a, [u8]>), Problem> {
    // The reserved byte of older headers is the number of streams.
    let streams = file[15];
    let table = u64::from(bytes.u32()?);
    let mut bytes = Bytes::new(file, "the SPZ's table of streams");
    let records = bytes.take(table)?.get(HEADER_BYTES as usize..).unwrap_or_default();
    let axes = if header.flags & EXTENSIONS_FLAG == 0 { FORMAT.axes } else { axes_of(records)? };
    let table = bytes.take(16 * u64::from(streams))?;
    let mut body = header.body(file)?;
    let mut out = &mut body[..];
    let mut entries = table.as_chunks::<8>().0.iter().map(|b| u64::from_le_bytes(*b));
    for size in header.columns() {
        let (column, left) = out.split_at_mut((header.count * size) as usize);
        out = left;
        let (packed, unpacked) = (entries.next().unwrap_or(0), entries.next().unwrap_or(0));
        if unpacked != column.len() as u64 {
            let what =
                format!("a stream of the SPZ unpacks to {unpacked} bytes, {} are needed", column.len());
            return Err(Problem::Header(what));
        }
        let packed = bytes.take(packed)?;
        if !column.is_empty() {
            let decoder = StreamingDecoder::new_with_max_window_size(packed, MAX_WINDOW_BYTES.max(unpacked));
            let mut decoder = decoder.map_err(|e| {
                Problem::Header(format!("the SPZ's Zstandard stream cannot be unpacked ({e})"))
            })?;
            unpack_exact(&mut decoder, column, "the SPZ's stream")?;
        }
    }
    Ok((header, axes, Cow::Owned(body)))
}

/// The axes that a record of Adobe's extension names, else the usual ones.
fn axes_of(records: &[u8]) -> Result<Axes, Problem> {
    let mut bytes = Bytes::new(records, "the SPZ's extensions");
    while !bytes.rest().is_empty() {
        let (kind, length) = (bytes.u32()?, bytes.u32()?);
        let record = bytes.take(u64::from(length))?;
        if kind == AXES_EXTENSION {
            return match record.first_chunk().map_or(0, |b| u32::from_le_bytes(*b)) {
                0 | 4 => Ok(Axes::YUpZBack),
                6 => Ok(Axes::Ply),
                7 => Ok(Axes::YUpZForward),
                other => {
                    let what = format!("SPZ with the coordinate system {other}; RUB, RDF and LUF are read");
                    Err(Problem::Header(what))
                }
            };
        }
    }
    Ok(FORMAT.axes)
}

/// Largest window of a Zstandard stream, bytes: that of the highest common level.
const MAX_WINDOW_BYTES: u64 = 128 << 20;

/// Unpacks the columns, in the order of the format.
fn unpack(header: &Header, columns: [&[u8]; COLUMN_COUNT]) -> Splats {
    let [means, opacities, colors, scales, quats, sh] = columns;
    let degree = header.sh_degree.min(sh::MAX_DEGREE);
    let mut splats = Splats::zeroed(header.count as usize, degree);
    if header.version == 1 {
        for (mean, row) in splats.means.iter_mut().zip(rows::<6>(means)) {
            *mean = [0, 2, 4].map(|at| f16::from_le_bytes([row[at], row[at + 1]]).to_f32());
        }
    } else {
        let step = 0.5f32.powi(i32::from(header.fractional_bits));
        for (mean, row) in splats.means.iter_mut().zip(rows::<9>(means)) {
            // The three bytes stand at the top of four, for their sign.
            *mean = [0, 3, 6]
                .map(|at| (i32::from_le_bytes([0, row[at], row[at + 1], row[at + 2]]) >> 8) as f32 * step);
        }
    }
    for (logit, byte) in splats.logit_opacities.iter_mut().zip(opacities) {
        *logit = logit_of_byte(*byte);
    }
    for (log_scale, row) in splats.log_scales.iter_mut().zip(rows::<3>(scales)) {
        *log_scale = row.map(|byte| f32::from(byte) / 16.0 - 10.0);
    }
    if header.version < 3 {
        for (quat, row) in splats.quats.iter_mut().zip(rows::<3>(quats)) {
            let [x, y, z] = row.map(|byte| f32::from(byte) / 127.5 - 1.0);
            *quat = [(1.0 - x * x - y * y - z * z).max(0.0).sqrt(), x, y, z];
        }
    } else {
        for (quat, row) in splats.quats.iter_mut().zip(rows::<4>(quats)) {
            *quat = unpack_quat(u32::from_le_bytes(*row));
        }
    }
    let (stride, size) = (splats.sh_stride(), header.columns()[5] as usize);
    for (index, row) in rows::<3>(colors).enumerate() {
        let splat = &mut splats.sh[index * stride..][..stride];
        for (value, byte) in splat.iter_mut().zip(row) {
            *value = (f32::from(*byte) / 255.0 - 0.5) / COLOR_SCALE;
        }
        for (value, byte) in splat[3..].iter_mut().zip(&sh[index * size..]) {
            *value = (f32::from(*byte) - 128.0) / 128.0;
        }
    }
    splats
}

/// wxyz of xyzw by its smallest three: the last of them stands lowest.
fn unpack_quat(word: u32) -> [f32; 4] {
    let part = |shift: u32| {
        let magnitude = (word >> shift & 511) as f32 * (std::f32::consts::FRAC_1_SQRT_2 / 511.0);
        if word >> shift & 512 == 0 { magnitude } else { -magnitude }
    };
    let [x, y, z, w] = from_smallest_three((word >> 30) as usize, [20, 10, 0].map(part));
    [w, x, y, z]
}

fn pack_quat(quat: [f32; 4]) -> u32 {
    let [w, x, y, z] = unit(quat);
    let (largest, rest) = smallest_three([x, y, z, w]);
    rest.iter().fold(largest as u32, |word, v| {
        let magnitude = unorm(v.abs() * std::f32::consts::SQRT_2, 511);
        word << 10 | u32::from(*v < 0.0) << 9 | magnitude
    })
}

/// A line on the steps of positions with so many fractional bits, if many splats are narrower.
fn coarse_steps(splats: &Splats, fractional_bits: u8) -> Option<String> {
    const ADVICE: &str = "SPZ has one step for all splats, wider the farther one is: move the scene near zero, crop what is far, or use PLY";
    let step = 0.5f64.powi(i32::from(fractional_bits));
    origin::coarse_line(splats, |_| step, ADVICE)
}

/// Fractional bits with which 24 hold every mean, finer than the usual for small scenes: half of
/// all steps to the farthest at most.
fn fractional_bits(splats: &Splats) -> u8 {
    let farthest =
        splats.means.as_flattened().iter().filter(|v| v.is_finite()).fold(0f32, |a, v| a.max(v.abs()));
    let fits = |bits: u32| f64::from(farthest) * 2f64.powi(bits as i32) < f64::from((1 << 23) - 1);
    let fine =
        (0..=20).rev().find(|bits| f64::from(farthest) * 2f64.powi(*bits as i32) <= f64::from(1 << 22));
    let wanted = fine.unwrap_or(0).max(USUAL_BITS);
    (0..=wanted).rev().find(|bits| fits(*bits)).unwrap_or(0) as u8
}

/// A splat's byte of an SH coefficient: on the nearest of `2^bits` levels of which 128 is one.
fn sh_byte(value: f32, bits: u32) -> u8 {
    let step = (1 << (8 - bits)) as f32;
    let level = (value * 128.0 / step).round() * step + 128.0;
    level.clamp(0.0, 255.0) as u8
}

/// The bytes of a column, some splats at a time.
struct Column<'a> {
    splats: &'a Splats,
    /// Index in the order of the format.
    number: usize,
    fractional_bits: u8,
    /// The first splat that is not in `bytes` yet.
    next: usize,
    bytes: Vec<u8>,
    /// Number of `bytes` that are read.
    read: usize,
}

impl<'a> Column<'a> {
    /// Splats at a time.
    const SPLATS_PER_PART: usize = 1 << 14;

    fn new(splats: &'a Splats, number: usize, fractional_bits: u8) -> Self {
        Self { splats, number, fractional_bits, next: 0, bytes: Vec::new(), read: 0 }
    }

    /// Packs the next splats.
    fn fill(&mut self) {
        let (splats, bytes, axes) = (self.splats, &mut self.bytes, FORMAT.axes);
        let part = self.next..splats.len().min(self.next + Self::SPLATS_PER_PART);
        self.next = part.end;
        self.read = 0;
        bytes.clear();
        match self.number {
            0 => {
                let steps = 2f32.powi(i32::from(self.fractional_bits));
                let values = splats.means[part].iter().flat_map(|mean| axes.vector(*mean));
                bytes.extend(values.flat_map(|v| {
                    let [a, b, c, _] =
                        ((v * steps).round().clamp(-8_388_608.0, 8_388_607.0) as i32).to_le_bytes();
                    [a, b, c]
                }));
            }
            1 => bytes.extend(splats.logit_opacities[part].iter().map(|logit| byte_of_logit(*logit))),
            2 => {
                let colors = part.flat_map(|i| splats.sh_of(i)[..3].iter());
                bytes.extend(colors.map(|v| unorm(v * COLOR_SCALE + 0.5, 255) as u8));
            }
            3 => {
                let scales = splats.log_scales[part].as_flattened().iter();
                bytes.extend(scales.map(|v| ((v + 10.0) * 16.0).round().clamp(0.0, 255.0) as u8));
            }
            4 => bytes.extend(splats.quats[part].iter().flat_map(|q| pack_quat(axes.quat(*q)).to_le_bytes())),
            _ => {
                let signs = axes.sh_signs();
                for sh in part.map(|i| splats.sh_of(i)) {
                    let coefficients = sh.chunks_exact(3).zip(signs).enumerate().skip(1);
                    bytes.extend(coefficients.flat_map(|(k, (rgb, sign))| {
                        let degree = (1..3).find(|d| k < sh::coefficients(*d as u8)).unwrap_or(3);
                        [0, 1, 2].map(|c| sh_byte(rgb[c] * sign, SH_BITS[degree - 1]))
                    }));
                }
            }
        }
    }
}

impl Read for Column<'_> {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        if self.read == self.bytes.len() {
            self.fill();
        }
        let count = (&self.bytes[self.read..]).read(out)?;
        self.read += count;
        Ok(count)
    }
}

/// A Zstandard frame. Only SH repeat themselves: in other columns looking for matches saves 3 % and
/// takes two thirds of the time.
fn zstd(column: Column) -> Vec<u8> {
    if column.number == SH_COLUMN {
        return compress_to_vec(column, CompressionLevel::Fastest);
    }
    let mut stream = Vec::new();
    let mut frame = FrameCompressor::new_with_matcher(NoMatches::default(), CompressionLevel::Fastest);
    frame.set_source(column);
    frame.set_drain(&mut stream);
    frame.compress();
    drop(frame);
    stream
}

/// Bytes of a block of Zstandard, the most that it may have.
const BLOCK_BYTES: usize = 128 << 10;

/// Finds no match in its block.
#[derive(Default)]
struct NoMatches(Vec<u8>);

impl Matcher for NoMatches {
    fn get_next_space(&mut self) -> Vec<u8> {
        self.0.resize(BLOCK_BYTES, 0);
        std::mem::take(&mut self.0)
    }

    fn get_last_space(&mut self) -> &[u8] {
        &self.0
    }

    fn commit_space(&mut self, space: Vec<u8>) {
        self.0 = space;
    }

    fn skip_matching(&mut self) {}

    fn start_matching(&mut self, mut handle: impl for<'a> FnMut(Sequence<'a>)) {
        handle(Sequence::Literals { literals: &self.0 });
    }

    fn reset(&mut self, _level: CompressionLevel) {}

    fn window_size(&self) -> u64 {
        BLOCK_BYTES as u64
    }
}

/// Writes a scene.
pub(super) fn write(out: &mut dyn Write, scene: &Scene, options: &WriteOptions) -> Result<(), Problem> {
    let splats = &scene.splats;
    let count =
        u32::try_from(splats.len()).map_err(|_| Problem::Value("too many splats for an SPZ".into()))?;
    let bits = fractional_bits(splats);
    let flags =
        if scene.metadata.rasterization == Some(Rasterization::Antialiased) { ANTIALIASED_FLAG } else { 0 };
    let mut header = MAGIC.to_vec();
    let version = match options.spz {
        SpzVersion::V3 => 3u32,
        SpzVersion::V4 => 4,
    };
    header.extend(version.to_le_bytes());
    header.extend(count.to_le_bytes());
    header.extend([splats.sh_degree, bits, flags, 0]);
    if options.spz == SpzVersion::V3 {
        let mut packed = deflate::Writer::new(sirocco::Format::Gzip, deflate::Level::new(GZIP_LEVEL), out);
        packed.write_all(&header)?;
        for number in 0..COLUMN_COUNT {
            io::copy(&mut Column::new(splats, number, bits), &mut packed)?;
        }
        packed.finish()?;
        return Ok(());
    }
    // Without SH there is no stream of them, not an empty one.
    let columns = if splats.sh_degree > 0 { COLUMN_COUNT } else { COLUMN_COUNT - 1 };
    header[15] = columns as u8;
    header.extend(HEADER_BYTES.to_le_bytes());
    header.resize(HEADER_BYTES as usize, 0);
    let mut streams = Vec::new();
    for (number, size) in (0..columns).zip(sizes(version, splats.sh_degree)) {
        // Their lengths come before them.
        let stream = zstd(Column::new(splats, number, bits));
        header.extend((stream.len() as u64).to_le_bytes());
        header.extend((splats.len() as u64 * size).to_le_bytes());
        streams.push(stream);
    }
    out.write_all(&header)?;
    for stream in streams {
        out.write_all(&stream)?;
    }
    Ok(())
}

/// Level of gzip: the columns are too noisy for more, which takes a third longer and saves 2 %.
const GZIP_LEVEL: u8 = 3;
/// Columns of a file, of which the last is that of SH.
const COLUMN_COUNT: usize = 6;
const SH_COLUMN: usize = COLUMN_COUNT - 1;
/// Bytes of the header of version 4.
const HEADER_BYTES: u32 = 32;
