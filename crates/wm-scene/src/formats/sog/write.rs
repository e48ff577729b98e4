//! Writing, version 2: what a writer may choose.
//!
//! - **Order**: along a Morton curve through the positions as they are stored, so that pixels
//!   beside each other have the same upper bytes.
//! - **Tables**: of scales, errors count by the scale, since what is large is seen (7 dB of a
//!   street's pictures against equal weights).
//! - **Axes**: an ellipsoid has six quaternions that differ by which axis is called which. The one
//!   is written whose rounding to bytes moves the ellipsoid least (`rotation.rs`; 5 dB).

use super::{
    palette::{Codebook, ENTRIES_PER_ROW, Palette},
    rotation::Rounded,
    webp::{self, MAX_SIDE},
};
use crate::formats::format::{FileSink, NamedFile};
use crate::formats::pack::{byte_of_logit, ranged};
use crate::origin::{coarse_line, float_step};
use crate::values::{FLAT_LOG_SCALE, ends};
use crate::{Rasterization, Scene, Splats, morton};
use serde_json::json;
use wm_base::error::Problem;

/// Most entries of the palette.
const MAX_ENTRIES: usize = 1 << 16;

/// The rounding of means to 16 bits of the range of each coordinate's curve.
pub(in crate::formats) struct Steps {
    mins: [f32; 3],
    maxs: [f32; 3],
}

impl Steps {
    pub(crate) fn for_means(means: &[[f32; 3]]) -> Self {
        let [mins, maxs] = ends(means.iter().map(|mean| mean.map(Self::curved)));
        Self { mins, maxs }
    }

    fn curved(v: f32) -> f32 {
        if v.is_finite() { v.signum() * v.abs().ln_1p() } else { 0.0 }
    }

    /// Width of a step at a position, along the axis where it is widest.
    fn width(&self, mean: [f32; 3]) -> f64 {
        let along = |k: usize| {
            let (least, most) = (f64::from(self.mins[k]), f64::from(self.maxs[k]));
            // The ends of the range are f32.
            let step = ((most - least) / 65_535.0).max(float_step(least.abs().max(most.abs())));
            step * (1.0 + f64::from(mean[k].abs()))
        };
        (0..3).map(along).fold(0.0, f64::max)
    }

    pub(crate) fn of(&self, mean: [f32; 3]) -> [u16; 3] {
        std::array::from_fn(|k| ranged(Self::curved(mean[k]), self.mins[k], self.maxs[k], 65_535) as u16)
    }
}

/// A line on steps of positions that are wider than many of the splats.
pub(super) fn coarse_steps(splats: &Splats) -> Option<String> {
    const ADVICE: &str = "far from the middle SOG is coarse: crop the scene, or use PLY";
    let steps = Steps::for_means(&splats.means);
    coarse_line(splats, |mean| steps.width(mean), ADVICE)
}

/// Indices of splats, of which these are the steps, in the order in which they are written.
pub(in crate::formats) fn order(steps: &[[u16; 3]]) -> Vec<u32> {
    morton::sorted(steps.iter().map(|step| morton::code(step.map(u64::from))))
}

/// The order in which splats are written.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Arrangement {
    /// Along a Morton curve.
    Morton,
    /// As they are.
    AsGiven,
}

/// Gives `file` the files of a scene, `meta.json` last.
pub(super) fn files(scene: &Scene, file: &mut FileSink) -> Result<(), Problem> {
    files_with(scene, Arrangement::Morton, MAX_ENTRIES, &[], file)
}

/// Gives `file` the files of a scene in an order, with at most `entries` (65,536 at most) in the
/// palette of SH, whose errors count by `weights`, a splat each, or alike if there are none;
/// `meta.json` comes last.
pub(crate) fn files_with(
    scene: &Scene,
    arrangement: Arrangement,
    entries: usize,
    weights: &[f32],
    file: &mut FileSink,
) -> Result<(), Problem> {
    let splats = &scene.splats;
    if let Some(fault) = scene.metadata.fault() {
        return Err(Problem::Value(format!("not written: {fault}")));
    }
    let count = splats.len();
    let width = ((count as f64).sqrt().ceil() as usize).next_multiple_of(4);
    if width > MAX_SIDE {
        return Err(Problem::Value(
            "too many splats for one SOG, whose pictures are at most 16383 pixels wide".into(),
        ));
    }
    let range = Steps::for_means(&splats.means);
    let steps: Vec<[u16; 3]> = splats.means.iter().map(|mean| range.of(*mean)).collect();
    let order = match arrangement {
        Arrangement::Morton => order(&steps),
        Arrangement::AsGiven => (0..count as u32).collect(),
    };
    // Of each splat the writer says how its pixel looks.
    let mut picture = |name, pixel: &dyn Fn(usize) -> [u8; 4]| {
        let pixels = order.iter().map(|index| pixel(*index as usize));
        file(NamedFile { name, bytes: encoded(pixels, width) })
    };

    for (name, byte) in [("means_l.webp", 0), ("means_u.webp", 1)] {
        picture(name, &|index| {
            let [x, y, z] = steps[index].map(|step| step.to_le_bytes()[byte]);
            [x, y, z, 255]
        })?;
    }
    drop(steps);
    let ellipsoids = splats.quats.iter().zip(&splats.log_scales);
    let rotations: Vec<Rounded> =
        ellipsoids.map(|(quat, log_scale)| Rounded::best(*quat, *log_scale)).collect();
    let log_scale = |v: f32| v.max(FLAT_LOG_SCALE);
    let scales = Codebook::of(
        splats.log_scales.as_flattened().iter().filter(|v| !v.is_nan()).map(|v| log_scale(*v)),
        f64::exp,
    );
    picture("scales.webp", &|index| {
        let [x, y, z] =
            rotations[index].axes().map(|axis| scales.index(log_scale(splats.log_scales[index][axis])));
        [x, y, z, 255]
    })?;
    picture("quats.webp", &|index| rotations[index].pixel)?;
    drop(rotations);
    let stride = splats.sh_stride();
    let even = |_| 1.0;
    let colors = Codebook::of(splats.sh.chunks_exact(stride).flat_map(|sh| sh[..3].iter().copied()), even);
    picture("sh0.webp", &|index| {
        let [r, g, b] = [0, 1, 2].map(|k| colors.index(splats.sh_of(index)[k]));
        [r, g, b, byte_of_logit(splats.logit_opacities[index])]
    })?;
    let mut meta = json!({
        "version": 2,
        "asset": { "generator": concat!("weather-magician ", env!("CARGO_PKG_VERSION")) },
        "count": count,
        "antialias": scene.metadata.rasterization == Some(Rasterization::Antialiased),
        "means": { "mins": range.mins, "maxs": range.maxs, "files": ["means_l.webp", "means_u.webp"] },
        "scales": { "codebook": &scales.values[..], "files": ["scales.webp"] },
        "quats": { "files": ["quats.webp"] },
        "sh0": { "codebook": &colors.values[..], "files": ["sh0.webp"] },
    });
    if scene.metadata != Default::default() {
        meta["wm"] = json!(scene.metadata);
    }
    if splats.sh_degree > 0 {
        let size = stride - 3;
        let finite = |v: &f32| if v.is_finite() { *v } else { 0.0 };
        let vectors: Vec<f32> =
            splats.sh.chunks_exact(stride).flat_map(|sh| sh[3..].iter().map(finite)).collect();
        let palette = Palette::of(&vectors, size, entries.clamp(1, MAX_ENTRIES), weights);
        picture("shN_labels.webp", &|index| {
            let [low, high] = palette.labels[index].to_le_bytes();
            [low, high, 0, 255]
        })?;
        let values = Codebook::of(palette.entries.iter().copied(), even);
        let pixels = palette.entries.chunks_exact(3).map(|rgb| {
            let [r, g, b] = [rgb[0], rgb[1], rgb[2]].map(|v| values.index(v));
            [r, g, b, 255]
        });
        let (entries, coefficients) = (palette.entries.len() / size, size / 3);
        file(NamedFile {
            name: "shN_centroids.webp",
            bytes: encoded(pixels, ENTRIES_PER_ROW * coefficients),
        })?;
        meta["shN"] = json!({
            "count": entries,
            "bands": splats.sh_degree,
            "codebook": &values.values[..],
            "files": ["shN_centroids.webp", "shN_labels.webp"],
        });
    }
    file(NamedFile { name: "meta.json", bytes: meta.to_string().into_bytes() })
}

/// A picture of `width`; the last pixel fills its last row.
fn encoded(pixels: impl Iterator<Item = [u8; 4]>, width: usize) -> Vec<u8> {
    let mut pixels: Vec<_> = pixels.collect();
    let last = pixels.last().copied().unwrap_or_default();
    pixels.resize(pixels.len().next_multiple_of(width), last);
    webp::encode(&pixels, width)
}
