//! The compressed PLY of PlayCanvas and SuperSplat: 16 bytes a splat, by chunks of 256.
//!
//! # Layout
//! An element `chunk` with the ranges of 256 splats each: min_x .. max_z, min_scale_x ..
//! max_scale_z (logarithm) and, in newer files, min_r .. max_b; an element `vertex` with four words
//! a splat; an element `sh` with a byte for each coefficient above degree 0, all of red, then
//! green, then blue.
//!
//! | word | bits from the highest | means |
//! |---|---|---|
//! | `packed_position` | 11, 10, 11 | x, y, z in the chunk's range |
//! | `packed_rotation` | 2, 10, 10, 10 | place (wxyz) of the largest component, the others over +-1/sqrt(2) |
//! | `packed_scale` | 11, 10, 11 | as the position |
//! | `packed_color` | 8, 8, 8, 8 | red, green, blue in the chunk's range, else of 0-1; opacity |
//!
//! A byte b of `sh` is 8 ((b + 1/2) / 256 - 1/2); bytes 0 and 255 are -4 and 4.

use super::{
    PlyEncoding,
    binary::check_length,
    header::{Header, Kind, Scalar},
    write::metadata_lines,
};
use crate::{
    Scene, Splats,
    formats::{
        bytes::rows,
        pack::{byte_of_logit, from_smallest_three, logit_of_byte, ranged, smallest_three, unit, unorm},
    },
    morton, sh,
    values::{ends, finite},
};
use std::fmt::Write as _;
use wm_base::{
    error::{FormatError, Problem},
    source::Source,
};

/// Splats of a chunk.
const CHUNK_SPLATS: usize = 256;

/// Ranges of a chunk, in the order of the file: least then largest of each.
#[rustfmt::skip]
const RANGES: [&str; 18] = [
    "min_x", "min_y", "min_z", "max_x", "max_y", "max_z",
    "min_scale_x", "min_scale_y", "min_scale_z", "max_scale_x", "max_scale_y", "max_scale_z",
    "min_r", "min_g", "min_b", "max_r", "max_g", "max_b",
];
/// The words of a splat.
const WORDS: [&str; 4] = ["packed_position", "packed_rotation", "packed_scale", "packed_color"];

/// Largest scale that is written, logarithm: one splat of a broken scene must not coarsen its
/// chunk.
pub(super) const MAX_LOG_SCALE: f32 = 20.0;

/// Returns true if the first bytes name a property that only a compressed PLY has.
pub(super) fn is_named(start: &[u8]) -> bool {
    start.windows(WORDS[0].len()).any(|word| word == WORDS[0].as_bytes())
}

/// Returns true if the header is that of a compressed PLY.
pub(super) fn is_compressed(header: &Header) -> bool {
    header.elements.iter().any(|e| e.name == "vertex" && e.properties.iter().any(|p| p.name == WORDS[0]))
}

/// The ranges of a chunk.
struct Chunk {
    mean: [[f32; 3]; 2],
    scale: [[f32; 3]; 2],
    color: [[f32; 3]; 2],
}

/// Reads what follows the header.
///
/// # Errors
/// If the elements are others, or cut off.
pub(super) fn read(source: &mut Source, header: Header) -> Result<Scene, FormatError> {
    let fault =
        |source: &Source, what: &str| source.whole(Problem::Header(format!("compressed PLY: {what}")));
    if header.encoding != PlyEncoding::BinaryLittleEndian {
        return Err(fault(source, "only binary_little_endian is read"));
    }
    let promised = header.elements.iter().find(|e| e.name == "vertex").map_or(0, |e| e.count);
    let sh = header.elements.iter().find(|e| e.name == "sh");
    let rest = sh.map_or(0, |e| e.properties.len());
    let degree = rest.is_multiple_of(3).then(|| sh::degree_of(rest / 3 + 1)).flatten();
    let degree = degree.ok_or_else(|| source.whole(Problem::ShCount(rest)))?;
    check_length(source, &header.elements, promised)?;
    let mut chunks: Vec<Chunk> = Vec::new();
    let mut splats = Splats::zeroed(0, degree);
    for element in &header.elements {
        let names: Vec<&str> = element.properties.iter().map(|p| p.name.as_str()).collect();
        let all = |scalar| element.properties.iter().all(|p| p.kind == Kind::Scalar(scalar));
        let size = element.min_size();
        match element.name.as_str() {
            "chunk" if (names[..] == RANGES || names[..] == RANGES[..12]) && all(Scalar::F32) => {
                rows_of(source, element.count, size, promised, |_, row| {
                    let numbers: Vec<f32> = rows(row).map(|b| f32::from_le_bytes(*b)).collect();
                    let pair = |at: usize| {
                        [0, 3].map(|o| {
                            std::array::from_fn(|k| {
                                numbers.get(at + o + k).copied().unwrap_or((o / 3) as f32)
                            })
                        })
                    };
                    chunks.push(Chunk { mean: pair(0), scale: pair(6), color: pair(12) });
                })?;
            }
            "vertex" if names[..] == WORDS && all(Scalar::U32) => {
                if (chunks.len() as u64) < promised.div_ceil(CHUNK_SPLATS as u64) {
                    let what = format!(
                        "{promised} splats need a chunk for each 256 before them, {} are there",
                        chunks.len()
                    );
                    return Err(fault(source, &what));
                }
                rows_of(source, element.count, size, promised, |index, row| {
                    let mut words = rows(row).map(|b| u32::from_le_bytes(*b));
                    let words: [u32; 4] = std::array::from_fn(|_| words.next().unwrap_or_default());
                    if splats.len() <= index {
                        splats.resize((index + 1).max(2 * index).min(promised as usize));
                    }
                    unpack(&mut splats, index, words, &chunks[index / CHUNK_SPLATS]);
                })?;
                splats.resize(promised as usize);
            }
            "sh" if all(Scalar::U8) => {
                if element.count != promised || splats.len() as u64 != promised {
                    return Err(fault(source, "the element sh must have a row per splat, behind them"));
                }
                if element.properties.len() != rest {
                    return Err(fault(source, "there are two elements sh"));
                }
                let stride = splats.sh_stride();
                rows_of(source, element.count, size, promised, |index, row| {
                    let sh = &mut splats.sh[index * stride + 3..][..rest];
                    for (i, byte) in row.iter().enumerate() {
                        let (channel, coefficient) = (i / (rest / 3), i % (rest / 3));
                        sh[coefficient * 3 + channel] = sh_of_byte(*byte);
                    }
                })?;
            }
            name => {
                let what = format!(
                    "the element {} is not the one that is known",
                    wm_base::error::excerpt(name.as_bytes())
                );
                return Err(fault(source, &what));
            }
        }
    }
    Ok(Scene { splats, metadata: header.metadata, ..Scene::default() })
}

/// Calls `each` with every row of an element.
fn rows_of(
    source: &mut Source,
    count: u64,
    size: usize,
    promised: u64,
    mut each: impl FnMut(usize, &[u8]),
) -> Result<(), FormatError> {
    let mut done = 0;
    while done < count && size > 0 {
        if !source.fill(size)? {
            let missing = u128::from(count - done) * size as u128 - source.bytes().len() as u128;
            return Err(source.whole(Problem::Truncated { promised, missing }));
        }
        let there = ((source.bytes().len() / size) as u64).min(count - done);
        for (row, bytes) in source.bytes().chunks_exact(size).take(there as usize).enumerate() {
            each(done as usize + row, bytes);
        }
        source.consume(there as usize * size);
        done += there;
    }
    Ok(())
}

/// Unpacks the four [`WORDS`] of a splat.
fn unpack(splats: &mut Splats, index: usize, words: [u32; 4], chunk: &Chunk) {
    let [position, rotation, scale, color] = words;
    let part = |word: u32, shift: u32, bits: u32| {
        let most = (1 << bits) - 1;
        (word >> shift & most) as f32 / most as f32
    };
    let within = |[low, high]: [[f32; 3]; 2], parts: [f32; 3]| -> [f32; 3] {
        std::array::from_fn(|k| low[k] * (1.0 - parts[k]) + high[k] * parts[k])
    };
    let three = |word| [part(word, 21, 11), part(word, 11, 10), part(word, 0, 11)];
    splats.means[index] = within(chunk.mean, three(position));
    splats.log_scales[index] = within(chunk.scale, three(scale));
    let rest = [20, 10, 0].map(|shift| (part(rotation, shift, 10) - 0.5) * std::f32::consts::SQRT_2);
    splats.quats[index] = from_smallest_three((rotation >> 30) as usize, rest);
    let rgb = within(chunk.color, [part(color, 24, 8), part(color, 16, 8), part(color, 8, 8)]);
    let stride = splats.sh_stride();
    for (value, shown) in splats.sh[index * stride..][..3].iter_mut().zip(rgb) {
        *value = (shown - 0.5) / sh::C0 as f32;
    }
    splats.logit_opacities[index] = logit_of_byte(color as u8);
}

fn sh_of_byte(byte: u8) -> f32 {
    let share = match byte {
        0 => 0.0,
        255 => 1.0,
        _ => (f32::from(byte) + 0.5) / 256.0,
    };
    (share - 0.5) * 8.0
}

pub(super) fn write(out: &mut dyn std::io::Write, scene: &Scene) -> Result<(), Problem> {
    let splats = &scene.splats;
    let order = morton::order(&splats.means);
    out.write_all(header(scene)?.as_bytes())?;
    let chunks: Vec<Chunk> = order.chunks(CHUNK_SPLATS).map(|indices| Chunk::of(splats, indices)).collect();
    let mut bytes = Vec::with_capacity(chunks.len() * RANGES.len() * 4);
    for chunk in &chunks {
        let ranges = [chunk.mean, chunk.scale, chunk.color];
        bytes.extend(ranges.as_flattened().as_flattened().iter().flat_map(|v| v.to_le_bytes()));
    }
    out.write_all(&bytes)?;
    for (chunk, indices) in chunks.iter().zip(order.chunks(CHUNK_SPLATS)) {
        bytes.clear();
        for index in indices {
            bytes.extend(pack(splats, *index as usize, chunk).into_iter().flat_map(u32::to_le_bytes));
        }
        out.write_all(&bytes)?;
    }
    let rest = splats.sh_stride() / 3 - 1;
    if rest > 0 {
        for indices in order.chunks(CHUNK_SPLATS) {
            bytes.clear();
            for index in indices {
                let sh = &splats.sh_of(*index as usize)[3..];
                let coefficients = (0..3).flat_map(|channel| (0..rest).map(move |k| sh[k * 3 + channel]));
                bytes.extend(coefficients.map(|v| ((v / 8.0 + 0.5) * 256.0).clamp(0.0, 255.0) as u8));
            }
            out.write_all(&bytes)?;
        }
    }
    Ok(())
}

fn header(scene: &Scene) -> Result<String, Problem> {
    let splats = &scene.splats;
    let mut text = format!("ply\nformat binary_little_endian 1.0\n{}", metadata_lines(&scene.metadata)?);
    // Writing to a string cannot fail.
    let _ = writeln!(text, "element chunk {}", splats.len().div_ceil(CHUNK_SPLATS));
    RANGES.iter().for_each(|name| _ = writeln!(text, "property float {name}"));
    let _ = writeln!(text, "element vertex {}", splats.len());
    WORDS.iter().for_each(|name| _ = writeln!(text, "property uint {name}"));
    if splats.sh_degree > 0 {
        let _ = writeln!(text, "element sh {}", splats.len());
        (0..splats.sh_stride() - 3).for_each(|i| _ = writeln!(text, "property uchar f_rest_{i}"));
    }
    text.push_str("end_header\n");
    Ok(text)
}

/// The colour that a splat's coefficients of degree 0 show.
fn shown(splats: &Splats, index: usize) -> [f32; 3] {
    let sh = splats.sh_of(index);
    [0, 1, 2].map(|k| 0.5 + sh[k] * sh::C0 as f32)
}

impl Chunk {
    fn of(splats: &Splats, indices: &[u32]) -> Self {
        let range = |value: &dyn Fn(usize) -> [f32; 3]| {
            let range = ends(indices.iter().map(|index| finite(value(*index as usize))));
            // Where no number was finite.
            range.map(|ends| ends.map(|v| if v.is_finite() { v } else { 0.0 }))
        };
        Self {
            mean: range(&|i| splats.means[i]),
            scale: range(&|i| splats.log_scales[i].map(|v| v.clamp(-MAX_LOG_SCALE, MAX_LOG_SCALE))),
            color: range(&|i| shown(splats, i)),
        }
    }
}

fn pack(splats: &Splats, index: usize, chunk: &Chunk) -> [u32; 4] {
    let within = |[low, high]: [[f32; 3]; 2], value: [f32; 3], bits: [u32; 3]| {
        (0..3).fold(0, |word, k| word << bits[k] | ranged(value[k], low[k], high[k], (1 << bits[k]) - 1))
    };
    let (largest, rest) = smallest_three(unit(splats.quats[index]));
    let rotation = rest
        .iter()
        .fold(largest as u32, |word, v| word << 10 | unorm(v * std::f32::consts::FRAC_1_SQRT_2 + 0.5, 1023));
    let scale = splats.log_scales[index].map(|v| v.clamp(-MAX_LOG_SCALE, MAX_LOG_SCALE));
    let rgb = within(chunk.color, shown(splats, index), [8, 8, 8]);
    [
        within(chunk.mean, splats.means[index], [11, 10, 11]),
        rotation,
        within(chunk.scale, scale, [11, 10, 11]),
        rgb << 8 | u32::from(byte_of_logit(splats.logit_opacities[index])),
    ]
}
