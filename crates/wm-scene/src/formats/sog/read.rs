//! Reading: `meta.json` and the pictures that it names.

use super::{palette::ENTRIES_PER_ROW, rotation::from_bytes, zip};
use crate::{
    Metadata, Rasterization, Remark, Scene, Splats,
    formats::{
        beside::beside,
        bytes::{check_unpacked, unpacked_limit},
        pack::logit_of_byte,
    },
    sh,
};
use image_webp::WebPDecoder;
use serde::Deserialize;
use std::{
    io::Cursor,
    ops::Range,
    path::{Component, Path, PathBuf},
};
use wm_base::{
    error::{Problem, excerpt, one_line},
    files,
};

/// The content of the file with a name, `None` if there is none.
type Files<'a> = &'a dyn Fn(&str) -> Result<Option<Vec<u8>>, Problem>;

#[derive(Deserialize)]
struct Meta {
    version: Option<u32>,
    count: Option<u64>,
    #[serde(default)]
    antialias: bool,
    means: Ranged,
    scales: Coded,
    quats: Plain,
    sh0: Coded,
    #[serde(rename = "shN", default)]
    sh_n: Option<Palette>,
    /// The metadata of this program.
    #[serde(rename = "wm", default)]
    metadata: Metadata,
}

#[derive(Deserialize)]
struct Ranged {
    mins: [f32; 3],
    maxs: [f32; 3],
    files: [String; 2],
    /// Version 1: splats and channels.
    #[serde(default)]
    shape: Vec<u64>,
}

#[derive(Deserialize)]
struct Coded {
    #[serde(default)]
    codebook: Vec<Option<f32>>,
    #[serde(default)]
    mins: Vec<f32>,
    #[serde(default)]
    maxs: Vec<f32>,
    files: [String; 1],
}

#[derive(Deserialize)]
struct Plain {
    files: [String; 1],
}

#[derive(Deserialize)]
struct Palette {
    /// Entries of the palette.
    count: Option<f64>,
    /// Highest degree of the SH in it.
    bands: Option<f64>,
    #[serde(default)]
    codebook: Vec<Option<f32>>,
    #[serde(default)]
    mins: f32,
    #[serde(default)]
    maxs: f32,
    files: [String; 2],
}

pub(crate) fn fault(what: impl Into<String>) -> Problem {
    Problem::Header(format!("SOG: {}", what.into()))
}

pub(crate) fn parse<'a, T: Deserialize<'a>>(text: &'a [u8], name: &str) -> Result<T, Problem> {
    serde_json::from_slice(files::without_byte_order_mark(text))
        .map_err(|error| fault(format!("{name}: {}", one_line(&error.to_string()))))
}

/// The values that the bytes of a channel stand for.
struct Table([f32; 256]);

impl Coded {
    /// The table of `channel`: that of the file, or of version 1, made of a range.
    fn table(&self, channel: usize) -> Result<Table, Problem> {
        let range = self.mins.get(channel).zip(self.maxs.get(channel));
        Table::of(&self.codebook, range.map(|(a, b)| (*a, *b)))
    }
}

impl Table {
    fn of(codebook: &[Option<f32>], range: Option<(f32, f32)>) -> Result<Self, Problem> {
        match range {
            _ if !codebook.is_empty() => {
                let values = continued(codebook)?;
                // Of fewer values the last stands for all that is missing.
                let last = values.len() - 1;
                Ok(Self(std::array::from_fn(|i| values[i.min(last)])))
            }
            Some((low, high)) => Ok(Self(std::array::from_fn(|i| low + (high - low) * i as f32 / 255.0))),
            None => Err(fault("meta.json has neither a codebook nor a range")),
        }
    }

    fn get(&self, byte: u8) -> f32 {
        self.0[usize::from(byte)]
    }
}

/// A codebook whose `null`s, which JSON has for NaN and infinity, continue the other values: on a
/// line between those beside them, at an end by the mean step of all.
///
/// # Errors
/// If it has nothing else.
fn continued(codebook: &[Option<f32>]) -> Result<Vec<f32>, Problem> {
    let known: Vec<(usize, f32)> =
        codebook.iter().enumerate().filter_map(|(i, v)| Some((i, (*v)?))).collect();
    let ([first, ..], [.., last]) = (&known[..], &known[..]) else {
        return Err(fault("a codebook of meta.json has no number"));
    };
    let step = if last.0 > first.0 { (last.1 - first.1) / (last.0 - first.0) as f32 } else { 0.0 };
    let value = |index: usize| {
        let after = known.partition_point(|(place, _)| *place <= index);
        let (before, next) = (known[..after].last(), known.get(after));
        match (before, next) {
            (Some((a, low)), Some((b, high))) => low + (high - low) * (index - a) as f32 / (b - a) as f32,
            (Some((a, low)), None) => low + step * (index - a) as f32,
            (None, Some((b, high))) => high - step * (b - index) as f32,
            (None, None) => first.1,
        }
    };
    Ok((0..codebook.len()).map(value).collect())
}

/// Says what is odd in a codebook.
fn about_codebook(name: &str, codebook: &[Option<f32>], remarks: &mut Vec<Remark>) {
    let nulls = codebook.iter().filter(|value| value.is_none()).count();
    if nulls > 0 {
        let text = format!(
            "SOG: null in {nulls} of {} values of the codebook of {name}: they continue the others",
            codebook.len()
        );
        remarks.push(Remark::note("null-in-codebook", text));
    }
    if !codebook.is_empty() && codebook.len() != 256 {
        let text = format!(
            "SOG: the codebook of {name} has {} values, 256 are needed: the last stands for those that are missing; export \
             the scene again",
            codebook.len()
        );
        remarks.push(Remark::doubt("short-codebook", text));
    }
}

/// A picture of 8-bit RGBA.
struct Picture {
    width: usize,
    rgba: Vec<[u8; 4]>,
}

impl Picture {
    fn read(files: Files, name: &str, least: u64) -> Result<Self, Problem> {
        let Some(bytes) = files(name)? else {
            let name = excerpt(name.as_bytes());
            return Err(Problem::Header(format!(
                "SOG: the picture \"{name}\" that meta.json names is not there"
            )));
        };
        let webp = |error: image_webp::DecodingError| {
            let name = excerpt(name.as_bytes());
            fault(format!(
                "the picture \"{name}\" is not a WebP that can be read ({})",
                one_line(&error.to_string())
            ))
        };
        let mut decoder = WebPDecoder::new(Cursor::new(&bytes)).map_err(webp)?;
        let limit = unpacked_limit(bytes.len() as u64);
        decoder.set_memory_limit(usize::try_from(limit).unwrap_or(usize::MAX));
        let (width, height) = decoder.dimensions();
        let pixels = u64::from(width) * u64::from(height);
        if pixels < least {
            return Err(fault(format!(
                "the picture \"{}\" has {pixels} pixels, {least} are needed",
                excerpt(name.as_bytes())
            )));
        }
        let channels = if decoder.has_alpha() { 4 } else { 3 };
        check_unpacked(pixels * channels, bytes.len() as u64, name)?;
        let mut flat = vec![0; (pixels * channels) as usize];
        decoder.read_image(&mut flat).map_err(webp)?;
        let rgba = if channels == 4 {
            flat.as_chunks().0.to_vec()
        } else {
            flat.as_chunks().0.iter().map(|[r, g, b]| [*r, *g, *b, 255]).collect()
        };
        Ok(Self { width: width as usize, rgba })
    }
}

/// Reads a scene out of a bundle.
pub(super) fn read(archive: &zip::Archive) -> Result<Scene, Problem> {
    read_with(&|name| archive.file(name), &meta_of(archive)?)
}

/// Reads the pictures of the folder of a `meta.json`, or those of a bundle.
pub(crate) fn read_pictures(main: &Path) -> Result<SogPictures, Problem> {
    let bytes = read_file(main)?;
    if !is_bundle(&bytes) {
        return SogPictures::read(&|name| Ok(Some(read_file(&below(main, name)?)?)), &bytes);
    }
    let archive = zip::Archive::new(&bytes)?;
    SogPictures::read(&|name| archive.file(name), &meta_of(&archive)?)
}

/// Returns true if a file is a bundle by its first bytes.
pub(crate) fn is_bundle(bytes: &[u8]) -> bool {
    bytes.starts_with(b"PK\x03\x04")
}

fn meta_of(archive: &zip::Archive) -> Result<Vec<u8>, Problem> {
    archive.file("meta.json")?.ok_or_else(|| fault("there is no meta.json in it"))
}

/// The pictures that the content of a `meta.json` names.
///
/// # Errors
/// If it is damaged.
pub(crate) fn picture_names(meta: &[u8]) -> Result<Vec<String>, Problem> {
    let meta = parse::<Meta>(meta, "meta.json")?;
    let shading = meta.sh_n.into_iter().flat_map(|palette| palette.files);
    let Meta { means, scales, quats, sh0, .. } = meta;
    let pictures = means.files.into_iter().chain(scales.files).chain(quats.files).chain(sh0.files);
    Ok(pictures.chain(shading).collect())
}

/// Reads a scene out of the folder of the file `main`, a `meta.json` whose content is `meta`.
pub(super) fn read_folder(main: &Path, meta: &[u8]) -> Result<Scene, Problem> {
    read_with(&|name| Ok(Some(read_file(&below(main, name)?)?)), meta)
}

/// A path below the folder of the file `main`; what leads out of it is refused.
pub(crate) fn below(main: &Path, name: &str) -> Result<PathBuf, Problem> {
    let inside =
        Path::new(name).components().all(|part| matches!(part, Component::Normal(_) | Component::CurDir));
    if !inside || name.is_empty() {
        return Err(fault(format!("\"{}\" is not a file below its folder", excerpt(name.as_bytes()))));
    }
    Ok(beside(main, Path::new(name)))
}

pub(crate) fn read_file(path: &Path) -> Result<Vec<u8>, Problem> {
    let name = excerpt(path.file_name().unwrap_or_default().as_encoded_bytes());
    let refused = |error: std::io::Error| fault(format!("\"{name}\" cannot be read: {error}"));
    if files::is_file(path).is_ok_and(|is_file| !is_file) {
        return Err(fault(format!("\"{name}\" is not a file")));
    }
    files::read(path).map_err(refused)
}

fn read_with(files: Files, meta: &[u8]) -> Result<Scene, Problem> {
    let pictures = SogPictures::read(files, meta)?;
    let splats = pictures.splats(0..pictures.len())?;
    let SogPictures { metadata, remarks, .. } = pictures;
    Ok(Scene { splats, metadata, remarks, ..Scene::default() })
}

/// The decoded pictures of a SOG: 28 bytes a splat and its palette. Splats are made of any part of
/// them.
pub(crate) struct SogPictures {
    count: usize,
    means: Ranged,
    /// Lower and upper bytes of the means.
    places: [Vec<[u8; 4]>; 2],
    scale_tables: [Table; 3],
    scales: Vec<[u8; 4]>,
    quats: Vec<[u8; 4]>,
    color_tables: [Table; 3],
    /// Logits of version 1.
    opacities: Option<Table>,
    colors: Vec<[u8; 4]>,
    sh: Option<Shading>,
    /// The facts that it states about the scene.
    pub(crate) metadata: Metadata,
    /// Lines on what is odd in its `meta.json`.
    pub(crate) remarks: Vec<Remark>,
}

impl SogPictures {
    fn read(files: Files, meta: &[u8]) -> Result<Self, Problem> {
        let meta: Meta = parse(meta, "meta.json")?;
        if let Some(version) = meta.version.filter(|version| !(1..=2).contains(version)) {
            return Err(fault(format!("version {version} is not read, 1 and 2 are")));
        }
        if let Some(fault_of) = meta.metadata.fault() {
            return Err(fault(format!("meta.json: {fault_of}")));
        }
        let count = meta.count.or_else(|| meta.means.shape.first().copied());
        let count = count.ok_or_else(|| fault("meta.json has no count of splats"))?;
        // The pictures bound it: nothing is allocated before one of that size is there.
        let [low, high] = [0, 1].map(|i| Picture::read(files, &meta.means.files[i], count));
        let places = [low?.rgba, high?.rgba];
        let antialiased = meta.antialias.then_some(Rasterization::Antialiased);
        let sh = meta.sh_n.as_ref().map(|palette| Shading::read(files, palette, count)).transpose()?;
        let mut remarks = Vec::new();
        about_codebook("scales", &meta.scales.codebook, &mut remarks);
        about_codebook("sh0", &meta.sh0.codebook, &mut remarks);
        if let (Some(sh), Some(palette)) = (&sh, &meta.sh_n) {
            about_codebook("shN", &palette.codebook, &mut remarks);
            sh.compare(palette, count as usize, &mut remarks);
        }
        Ok(Self {
            count: count as usize,
            places,
            remarks,
            scales: Picture::read(files, &meta.scales.files[0], count)?.rgba,
            quats: Picture::read(files, &meta.quats.files[0], count)?.rgba,
            colors: Picture::read(files, &meta.sh0.files[0], count)?.rgba,
            sh,
            scale_tables: [meta.scales.table(0)?, meta.scales.table(1)?, meta.scales.table(2)?],
            color_tables: [meta.sh0.table(0)?, meta.sh0.table(1)?, meta.sh0.table(2)?],
            opacities: if meta.sh0.codebook.is_empty() { Some(meta.sh0.table(3)?) } else { None },
            means: meta.means,
            metadata: Metadata {
                rasterization: meta.metadata.rasterization.or(antialiased),
                ..meta.metadata
            },
        })
    }

    /// Number of splats.
    pub(crate) fn len(&self) -> usize {
        self.count
    }

    /// The splats of a part.
    ///
    /// # Errors
    /// If it is not there, or one of its splats has a rotation or an entry of the palette that is
    /// not known.
    pub(crate) fn splats(&self, part: Range<usize>) -> Result<Splats, Problem> {
        if part.start > part.end || part.end > self.count {
            return Err(fault("a part of it has splats that it lacks"));
        }
        let degree = self.sh.as_ref().map_or(0, |sh| sh.degree);
        let mut splats = Splats::zeroed(part.len(), degree);
        let Ranged { mins, maxs, .. } = self.means;
        let place = |k: usize, step: u16| {
            let curved = mins[k] + (maxs[k] - mins[k]) * (f32::from(step) / 65535.0);
            curved.signum() * curved.abs().exp_m1()
        };
        // Each step once, where there are more splats than steps.
        let places: Option<[Vec<f32>; 3]> = (part.len() > 1 << 16)
            .then(|| std::array::from_fn(|k| (0..=u16::MAX).map(|step| place(k, step)).collect()));
        let [low, high] = self.places.each_ref().map(|bytes| &bytes[part.clone()]);
        for ((mean, low), high) in splats.means.iter_mut().zip(low).zip(high) {
            *mean = std::array::from_fn(|k| {
                let step = u16::from_le_bytes([low[k], high[k]]);
                places.as_ref().map_or_else(|| place(k, step), |places| places[k][usize::from(step)])
            });
        }
        for (log_scale, bytes) in splats.log_scales.iter_mut().zip(&self.scales[part.clone()]) {
            *log_scale = std::array::from_fn(|k| self.scale_tables[k].get(bytes[k]));
        }
        for (quat, [a, b, c, mode]) in splats.quats.iter_mut().zip(&self.quats[part.clone()]) {
            let largest = usize::from(mode.checked_sub(252).ok_or_else(|| {
                fault(format!("a pixel of the rotations has alpha {mode}, 252 to 255 are known"))
            })?);
            *quat = from_bytes(largest, [*a, *b, *c]);
        }
        let stride = splats.sh_stride();
        for (index, bytes) in self.colors[part.clone()].iter().enumerate() {
            let color = &mut splats.sh[index * stride..][..3];
            for ((value, table), byte) in color.iter_mut().zip(&self.color_tables).zip(bytes) {
                *value = table.get(*byte);
            }
            splats.logit_opacities[index] = match &self.opacities {
                Some(logits) => logits.get(bytes[3]),
                None => logit_of_byte(bytes[3]),
            };
        }
        if let Some(sh) = &self.sh {
            for (index, out) in part.zip(splats.sh.chunks_exact_mut(stride)) {
                sh.write(index, &mut out[3..])?;
            }
        }
        Ok(splats)
    }
}

/// SH above degree 0: a palette, and which entry each splat has.
struct Shading {
    degree: u8,
    /// Coefficients of an entry.
    coefficients: usize,
    palette: Picture,
    labels: Vec<[u8; 4]>,
    table: Table,
}

impl Shading {
    fn read(files: Files, meta: &Palette, count: u64) -> Result<Self, Problem> {
        let palette = Picture::read(files, &meta.files[0], 1)?;
        let labels = Picture::read(files, &meta.files[1], count)?.rgba;
        // The width says the degree, in both versions.
        let coefficients = palette.width / ENTRIES_PER_ROW;
        let degree = sh::degree_of(coefficients + 1)
            .filter(|degree| *degree > 0 && palette.width % ENTRIES_PER_ROW == 0);
        let degree = degree.ok_or_else(|| {
            fault(format!(
                "a palette of SH that is {} pixels wide; 192, 512 and 960 are known",
                palette.width
            ))
        })?;
        let table = Table::of(&meta.codebook, Some((meta.mins, meta.maxs)))?;
        Ok(Self { degree, coefficients, palette, labels, table })
    }

    /// Says where `meta.json` and the pictures, which count, differ.
    fn compare(&self, meta: &Palette, splats: usize, remarks: &mut Vec<Remark>) {
        let mut doubt = |text: String| {
            remarks.push(Remark::doubt("palette", format!("SOG: {text}; export the scene again")));
        };
        if let Some(bands) = meta.bands.filter(|bands| *bands != f64::from(self.degree)) {
            doubt(format!(
                "shN.bands is {bands}, but its palette has SH of degree {}, which is read",
                self.degree
            ));
        }
        let room = self.palette.rgba.len() / self.palette.width * ENTRIES_PER_ROW;
        let Some(entries) = meta.count else { return };
        if !(0.0..=room as f64).contains(&entries) {
            return doubt(format!("shN.count is {entries}, but its palette has room for {room} entries"));
        }
        let beyond = self.labels[..splats]
            .iter()
            .filter(|[low, high, ..]| f64::from(u16::from_le_bytes([*low, *high])) >= entries);
        match beyond.count() {
            0 => {}
            count => {
                doubt(format!("{count} splats have an entry of the palette beyond shN.count, {entries}"));
            }
        }
    }

    /// The coefficients of a splat above degree 0.
    fn write(&self, index: usize, out: &mut [f32]) -> Result<(), Problem> {
        let [low, high, ..] = self.labels[index];
        let entry = usize::from(u16::from_le_bytes([low, high]));
        let first =
            entry / ENTRIES_PER_ROW * self.palette.width + entry % ENTRIES_PER_ROW * self.coefficients;
        let pixels = self.palette.rgba.get(first..first + self.coefficients);
        let pixels = pixels.ok_or_else(|| {
            fault(format!("a splat has entry {entry} of the palette of SH, which is shorter"))
        })?;
        for (value, byte) in out.iter_mut().zip(pixels.iter().flat_map(|p| &p[..3])) {
            *value = self.table.get(*byte);
        }
        Ok(())
    }
}
