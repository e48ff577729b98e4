//! `.ksplat` of GaussianSplats3D: sections of splats, at level 0 as floats, at 1 and 2 in buckets
//! about a centre.
//!
//! # Layout
//! A header of 4096 bytes, a header of 1024 bytes for each section, then the sections. A section
//! has the lengths of its buckets that are not full, the centres of all its buckets, and its
//! splats.
//!
//! | level | mean | scales | quaternion wxyz | rgb and opacity | SH to degree 2 |
//! |---|---|---|---|---|---|
//! | 0 | 3 floats | 3 floats | 4 floats | 4 bytes | floats |
//! | 1 | 3 16-bit steps from the bucket's centre | 3 halves | 4 halves | 4 bytes | halves |
//! | 2 | as 1 | as 1 | as 1 | 4 bytes | bytes over a range in the header |
//!
//! SH are degree by degree, in each all of red, then green, then blue. Level 1 is written, in a
//! section for each power of two in the widths of its buckets, so that a sky does not coarsen what
//! is near.

use super::axes::Axes;
use super::bytes::{Bytes, floats, rows};
use super::format::{SceneFormat, Writer, has_ending};
use super::loss::{FormatLosses, Retention};
use super::pack::{byte_of_dc, byte_of_logit, dc_of_byte, logit_of_byte, unit};
use crate::values::{ends, finite};
use crate::{Scene, Splats, morton, sh};
use half::f16;
use std::io::Write;
use wm_base::error::Problem;

/// The entry of [`FORMATS`](super::FORMATS).
pub(super) const FORMAT: SceneFormat = SceneFormat {
    name: "ksplat",
    extensions: &["ksplat"],
    about: "GaussianSplats3D's .ksplat, levels 0 to 2, SH degree 0 to 2",
    axes: Axes::Ply,
    loses: FormatLosses {
        sh_degree: 2,
        rounding: "positions 1/65534 of the range of 256 neighbours, scales and SH 1/2048 of their value, rotations 0.05 \
                   degrees, colours and opacities 1/510 of 0-1",
        order: Retention::Not,
        log_scales: [-16.635_532, 11.09],
        ..FormatLosses::SPLATS_ALONE
    },
    sniff: |start| has_ending(start.path, "ksplat"),
    read: |source, _| source.parsed(|bytes, _| read(bytes)),
    write: Writer::Stream(|out, scene, _| write(out, scene)),
};

const HEADER_BYTES: u64 = 4096;
const SECTION_HEADER_BYTES: u64 = 1024;
/// Half the range of SH at level 2 where the header has none.
const SH_RANGE: f32 = 1.5;
/// Steps from the centre of a bucket to its side.
const STEPS_PER_HALF_BUCKET: u32 = 32767;
/// The smallest half above 0.
const MIN_HALF: f32 = 5.960_464_5e-8;
/// Splats of a full bucket that is written.
const BUCKET_SPLATS: usize = 256;

/// A number of a header.
fn word(bytes: &[u8], at: usize) -> u32 {
    bytes[at..].first_chunk().map_or(0, |b| u32::from_le_bytes(*b))
}

/// Sizes of what a splat has.
#[derive(Clone, Copy)]
enum Packing {
    Floats,
    Halves,
    Bytes { low: f32, high: f32 },
}

impl Packing {
    fn splat_size(self, degree: u8) -> u64 {
        let sh = (sh::coefficients(degree) as u64 - 1) * 3;
        match self {
            Self::Floats => 44 + 4 * sh,
            Self::Halves => 24 + 2 * sh,
            Self::Bytes { .. } => 24 + sh,
        }
    }
}

fn read(file: &[u8]) -> Result<Scene, Problem> {
    let mut bytes = Bytes::new(file, "the .ksplat");
    let header = bytes.take(HEADER_BYTES)?;
    let ([major, minor], level) = ([header[0], header[1]], word(header, 20) & 0xffff);
    if major != 0 || minor == 0 {
        return Err(Problem::Header(format!(".ksplat version {major}.{minor} is not read, 0.1 is")));
    }
    let [low, high] = floats(&header[36..44]);
    let or = |value: f32, otherwise| if value == 0.0 { otherwise } else { value };
    let level = match level {
        0 => Packing::Floats,
        1 => Packing::Halves,
        2 => Packing::Bytes { low: or(low, -SH_RANGE), high: or(high, SH_RANGE) },
        _ => return Err(Problem::Header(format!(".ksplat level {level} is not read, 0 to 2 are"))),
    };
    let sections: Vec<&[u8]> = bytes
        .take(u64::from(word(header, 4)) * SECTION_HEADER_BYTES)?
        .chunks_exact(SECTION_HEADER_BYTES as usize)
        .collect();
    let degrees = sections.iter().map(|s| word(s, 40) & 0xffff);
    let degree = match degrees.max().unwrap_or(0) {
        degree @ 0..=2 => degree as u8,
        degree => return Err(Problem::Header(format!("a section has SH degree {degree}, the highest is 2"))),
    };
    let mut splats = Splats::with_capacity(0, degree);
    for section in sections {
        read_section(&mut bytes, section, level, &mut splats)?;
    }
    Ok(Scene { splats, ..Scene::default() })
}

fn read_section(
    bytes: &mut Bytes,
    header: &[u8],
    level: Packing,
    splats: &mut Splats,
) -> Result<(), Problem> {
    let (count, room) = (word(header, 0), word(header, 4));
    let (bucket_size, bucket_count) = (word(header, 8), word(header, 12));
    let [block] = floats(&header[16..20]);
    let center_size = word(header, 20) & 0xffff;
    let (steps, full, partial) = (word(header, 24), word(header, 32), word(header, 36));
    let degree = (word(header, 40) & 0xffff) as u8;
    if count > room {
        return Err(Problem::Header(format!(
            "a section says that it has {count} splats in the room of {room}"
        )));
    }
    let lengths: Vec<u32> =
        rows(bytes.take(u64::from(partial) * 4)?).map(|b| u32::from_le_bytes(*b)).collect();
    let centers = bytes.take(u64::from(bucket_count) * u64::from(center_size))?;
    let size = level.splat_size(degree);
    let rows = bytes.take(u64::from(room) * size)?.chunks_exact(size as usize).take(count as usize);
    let is_bucketed = !matches!(level, Packing::Floats);
    if is_bucketed && count > 0 && (center_size < 12 || bucket_size == 0) {
        return Err(Problem::Header("a section has splats but no buckets".into()));
    }
    let scale = 0.5 * block / (if steps == 0 { STEPS_PER_HALF_BUCKET } else { steps }) as f32;
    let offset = if steps == 0 { STEPS_PER_HALF_BUCKET } else { steps } as f32;
    // Which bucket, and how many of its splats are left.
    let (mut bucket, mut left) = (0u64, 0u64);
    let length_of = |bucket: u64| {
        let partial =
            bucket.checked_sub(u64::from(full)).map(|i| lengths.get(i as usize).copied().unwrap_or(0));
        u64::from(partial.unwrap_or(bucket_size))
    };
    let mut center = [0.0; 3];
    for row in rows {
        if is_bucketed && left == 0 {
            while bucket < u64::from(bucket_count) && length_of(bucket) == 0 {
                bucket += 1;
            }
            if bucket >= u64::from(bucket_count) {
                return Err(Problem::Header("a section has more splats than its buckets".into()));
            }
            center = floats(&centers[(bucket * u64::from(center_size)) as usize..][..12]);
            left = length_of(bucket);
            bucket += 1;
        }
        left = left.saturating_sub(1);
        let half = |at: usize| f16::from_le_bytes([row[at], row[at + 1]]).to_f32();
        let (color, sh_at) = match level {
            Packing::Floats => {
                let [x, y, z, a, b, c, q @ ..] = floats::<10>(row);
                splats.means.push([x, y, z]);
                splats.log_scales.push([a, b, c].map(f32::ln));
                splats.quats.push(q);
                (&row[40..44], 44)
            }
            Packing::Halves | Packing::Bytes { .. } => {
                let step = |at: usize| f32::from(u16::from_le_bytes([row[at], row[at + 1]])) - offset;
                splats.means.push([0, 1, 2].map(|k| step(2 * k) * scale + center[k]));
                splats.log_scales.push([6, 8, 10].map(|at| half(at).ln()));
                splats.quats.push([12, 14, 16, 18].map(half));
                (&row[20..24], 24)
            }
        };
        splats.logit_opacities.push(logit_of_byte(color[3]));
        splats.sh.extend(color[..3].iter().map(|byte| dc_of_byte(*byte)));
        let number = |i: usize| match level {
            Packing::Floats => floats::<1>(&row[sh_at + 4 * i..])[0],
            Packing::Halves => half(sh_at + 2 * i),
            Packing::Bytes { low, high } => low + (high - low) * f32::from(row[sh_at + i]) / 255.0,
        };
        for d in 1..=usize::from(degree) {
            let (first, width) = ((d * d - 1) * 3, 2 * d + 1);
            splats.sh.extend((0..3 * width).map(|i| number(first + i % 3 * width + i / 3)));
        }
        splats.groups.push(Default::default());
        splats.sh.resize(splats.len() * splats.sh_stride(), 0.0);
    }
    Ok(())
}

/// Splats about a centre.
struct Bucket<'a> {
    indices: &'a [u32],
    center: [f32; 3],
    /// Width of the cube that holds them.
    width: f32,
}

impl<'a> Bucket<'a> {
    fn of(splats: &Splats, indices: &'a [u32]) -> Self {
        let [low, high] = ends(indices.iter().map(|i| finite(splats.means[*i as usize])));
        let center = std::array::from_fn(|k| if low[k] <= high[k] { 0.5 * (low[k] + high[k]) } else { 0.0 });
        let widths = (0..3).map(|k| high[k] - low[k]).filter(|v| v.is_finite());
        Self { indices, center, width: widths.fold(f32::MIN_POSITIVE, f32::max) }
    }

    /// Buckets of one class have steps of one size in the file: at most twice as wide as they need.
    fn class(&self) -> i32 {
        self.width.log2().floor() as i32
    }
}

/// The buckets in the order of the file, those of a class together.
fn buckets<'a>(splats: &Splats, order: &'a [u32]) -> Vec<Bucket<'a>> {
    let mut buckets: Vec<Bucket> =
        order.chunks(BUCKET_SPLATS).map(|indices| Bucket::of(splats, indices)).collect();
    // The one that is not full was the last and stays the last of its class, as readers expect.
    buckets.sort_by_key(Bucket::class);
    buckets
}

fn write(out: &mut dyn Write, scene: &Scene) -> Result<(), Problem> {
    let splats = &scene.splats;
    let degree = splats.sh_degree.min(2);
    let count =
        u32::try_from(splats.len()).map_err(|_| Problem::Value("too many splats for a .ksplat".into()))?;
    let order = morton::order(&splats.means);
    let buckets = buckets(splats, &order);
    let sections: Vec<&[Bucket]> = buckets.chunk_by(|a, b| a.class() == b.class()).collect();
    let mut header = vec![0; HEADER_BYTES as usize + sections.len() * SECTION_HEADER_BYTES as usize];
    header[1] = 1;
    let mut put = |at: usize, word: u32| header[at..at + 4].copy_from_slice(&word.to_le_bytes());
    let section_count = sections.len() as u32;
    for (at, word) in [(4, section_count), (8, section_count), (12, count), (16, count), (20, 1)] {
        put(at, word);
    }
    put(36, (-SH_RANGE).to_bits());
    put(40, SH_RANGE.to_bits());
    for (number, section) in sections.iter().enumerate() {
        let room: usize = section.iter().map(|bucket| bucket.indices.len()).sum();
        let partial = room % BUCKET_SPLATS;
        let data = room as u64 * Packing::Halves.splat_size(degree);
        let stored = data + section.len() as u64 * 12 + u64::from(partial > 0) * 4;
        let words = [
            room as u32,
            room as u32,
            BUCKET_SPLATS as u32,
            section.len() as u32,
            widest(section).to_bits(),
            12,
            STEPS_PER_HALF_BUCKET,
            stored as u32,
            (room / BUCKET_SPLATS) as u32,
            u32::from(partial > 0),
            u32::from(degree),
        ];
        for (i, word) in words.into_iter().enumerate() {
            put(HEADER_BYTES as usize + number * SECTION_HEADER_BYTES as usize + 4 * i, word);
        }
    }
    out.write_all(&header)?;
    sections.iter().try_for_each(|section| write_section(out, splats, degree, section))
}

fn widest(section: &[Bucket]) -> f32 {
    section.iter().map(|bucket| bucket.width).fold(f32::MIN_POSITIVE, f32::max)
}

fn write_section(
    out: &mut dyn Write,
    splats: &Splats,
    degree: u8,
    section: &[Bucket],
) -> Result<(), Problem> {
    let partial = section.iter().map(|bucket| bucket.indices.len()).sum::<usize>() % BUCKET_SPLATS;
    if partial > 0 {
        out.write_all(&(partial as u32).to_le_bytes())?;
    }
    let mut bytes: Vec<u8> =
        section.iter().flat_map(|bucket| bucket.center).flat_map(f32::to_le_bytes).collect();
    out.write_all(&bytes)?;
    let step = STEPS_PER_HALF_BUCKET as f32 / (0.5 * widest(section));
    for Bucket { indices, center, .. } in section {
        bytes.clear();
        for index in indices.iter().map(|i| *i as usize) {
            let mean = splats.means[index];
            for k in 0..3 {
                let steps = ((mean[k] - center[k]) * step).round() + STEPS_PER_HALF_BUCKET as f32;
                bytes.extend(
                    (steps.clamp(0.0, 2.0 * STEPS_PER_HALF_BUCKET as f32 + 1.0) as u16).to_le_bytes(),
                );
            }
            let mut half = |v: f32| bytes.extend(f16::from_f32(v).to_le_bytes());
            // Of no thickness is only what is flat: one that is too small for a half becomes the
            // least.
            let scale = |v: f32| if v == f32::NEG_INFINITY { 0.0 } else { v.exp().max(MIN_HALF) };
            splats.log_scales[index].iter().for_each(|v| half(scale(*v)));
            unit(splats.quats[index]).into_iter().for_each(&mut half);
            let sh = splats.sh_of(index);
            bytes.extend(sh[..3].iter().map(|v| byte_of_dc(*v)));
            bytes.push(byte_of_logit(splats.logit_opacities[index]));
            for d in 1..=usize::from(degree) {
                let (first, width) = (d * d, 2 * d + 1);
                for i in 0..3 * width {
                    bytes.extend(f16::from_f32(sh[(first + i % width) * 3 + i / width]).to_le_bytes());
                }
            }
        }
        out.write_all(&bytes)?;
    }
    Ok(())
}

/// The order in which splats are written, for tests.
#[cfg(test)]
pub(super) fn order(splats: &Splats) -> Vec<u32> {
    let order = morton::order(&splats.means);
    buckets(splats, &order).iter().flat_map(|bucket| bucket.indices.to_vec()).collect()
}
