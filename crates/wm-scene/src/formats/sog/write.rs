//! Writing, version 2.

use super::{
    Problem,
    palette::{Codebook, Palette},
};
use crate::{
    Rasterization, Scene,
    formats::{
        NamedFile,
        pack::{byte_of_logit, ranged, smallest_three, unit, unorm},
    },
    morton,
};
use image_webp::{ColorType, WebPEncoder};
use serde_json::json;

/// Most pixels of a side of a WebP.
const MAX_SIDE: usize = 16_383;
/// Entries of a row of the palette of SH.
const ENTRIES: usize = 64;
/// Most entries of the palette.
const MAX_ENTRIES: usize = 1 << 16;

/// The files of a scene, `meta.json` last.
pub(super) fn files(scene: &Scene) -> Result<Vec<NamedFile>, Problem> {
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
    let order = morton::order(&splats.means);
    let mut files = Vec::new();
    // The writer says how each splat's pixel looks.
    let mut picture = |name, pixel: &dyn Fn(usize) -> [u8; 4]| {
        let pixels = order.iter().map(|index| pixel(*index as usize));
        files.push(NamedFile { name, bytes: webp(pixels, count, width)? });
        Ok::<(), Problem>(())
    };

    let curved = |v: f32| if v.is_finite() { v.signum() * v.abs().ln_1p() } else { 0.0 };
    let (mut mins, mut maxs) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    for mean in &splats.means {
        for k in 0..3 {
            mins[k] = mins[k].min(curved(mean[k]));
            maxs[k] = maxs[k].max(curved(mean[k]));
        }
    }
    let position = |index: usize| -> [[u8; 2]; 3] {
        let mean = splats.means[index];
        std::array::from_fn(|k| (ranged(curved(mean[k]), mins[k], maxs[k], 65_535) as u16).to_le_bytes())
    };
    for (name, byte) in [("means_l.webp", 0), ("means_u.webp", 1)] {
        picture(name, &|index| {
            let [x, y, z] = position(index).map(|bytes| bytes[byte]);
            [x, y, z, 255]
        })?;
    }
    let scales = Codebook::of(splats.log_scales.as_flattened().iter().copied());
    picture("scales.webp", &|index| {
        let [x, y, z] = splats.log_scales[index].map(|v| scales.index(v));
        [x, y, z, 255]
    })?;
    picture("quats.webp", &|index| {
        let (largest, rest) = smallest_three(unit(splats.quats[index]));
        let [x, y, z] = rest.map(|v| unorm(v * std::f32::consts::FRAC_1_SQRT_2 + 0.5, 255) as u8);
        [x, y, z, 252 + largest as u8]
    })?;
    let stride = splats.sh_stride();
    let colors = Codebook::of(splats.sh.chunks_exact(stride).flat_map(|sh| sh[..3].iter().copied()));
    picture("sh0.webp", &|index| {
        let [r, g, b] = [0, 1, 2].map(|k| colors.index(splats.sh_of(index)[k]));
        [r, g, b, byte_of_logit(splats.logit_opacities[index])]
    })?;
    let mut meta = json!({
        "version": 2,
        "asset": { "generator": concat!("weather-magician ", env!("CARGO_PKG_VERSION")) },
        "count": count,
        "antialias": scene.metadata.rasterization == Some(Rasterization::Antialiased),
        "means": { "mins": mins, "maxs": maxs, "files": ["means_l.webp", "means_u.webp"] },
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
        let palette = Palette::of(&vectors, size, MAX_ENTRIES);
        picture("shN_labels.webp", &|index| {
            let [low, high] = palette.labels[index].to_le_bytes();
            [low, high, 0, 255]
        })?;
        let values = Codebook::of(palette.entries.iter().copied());
        let pixels = palette.entries.chunks_exact(3).map(|rgb| {
            let [r, g, b] = [rgb[0], rgb[1], rgb[2]].map(|v| values.index(v));
            [r, g, b, 255]
        });
        let (entries, coefficients) = (palette.entries.len() / size, size / 3);
        let bytes = webp(pixels, entries * coefficients, ENTRIES * coefficients)?;
        files.push(NamedFile { name: "shN_centroids.webp", bytes });
        meta["shN"] = json!({
            "count": entries,
            "bands": splats.sh_degree,
            "codebook": &values.values[..],
            "files": ["shN_centroids.webp", "shN_labels.webp"],
        });
    }
    files.push(NamedFile { name: "meta.json", bytes: meta.to_string().into_bytes() });
    Ok(files)
}

/// A lossless picture of `width` for `count` pixels, the rest of its last rows empty.
fn webp(pixels: impl Iterator<Item = [u8; 4]>, count: usize, width: usize) -> Result<Vec<u8>, Problem> {
    let height = count.div_ceil(width).max(1);
    let mut rgba = Vec::with_capacity(width * height * 4);
    rgba.extend(pixels.flatten());
    rgba.resize(width * height * 4, 255);
    let opaque = rgba.as_chunks::<4>().0.iter().all(|pixel| pixel[3] == 255);
    let mut bytes = Vec::new();
    let encoder = WebPEncoder::new(&mut bytes);
    let (data, kind) = if opaque {
        let rgb = rgba.as_chunks::<4>().0.iter().flat_map(|[r, g, b, _]| [*r, *g, *b]).collect();
        (rgb, ColorType::Rgb8)
    } else {
        (rgba, ColorType::Rgba8)
    };
    let encoded = encoder.encode(&data, width as u32, height as u32, kind);
    encoded.map_err(|error| Problem::Value(format!("not written: {error}")))?;
    Ok(bytes)
}
