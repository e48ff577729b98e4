//! Writing a scene in levels, leaf by leaf.

use super::{
    LevelIndex, LevelRun, MAX_LEVELS,
    index::RawRun,
    tree::{BoxTree, Extent},
};
use crate::formats::format::write_files;
use crate::formats::sog::read::below;
use crate::formats::sog::write::{Arrangement, files_with};
use crate::quat::to_matrix;
use crate::{Metadata, Rasterization, Scene, Splats, morton};
use serde::{Serialize, Serializer};
use std::{
    collections::BTreeMap,
    fs,
    io::ErrorKind,
    path::{Path, PathBuf},
};
use wm_base::{FormatError, Problem, files::write_atomically};

/// Options of writing a scene in levels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LevelWriteOptions {
    /// Splats of a level from which on a file is written, at least 1. A file has fewer than this
    /// and the largest leaf together.
    pub splats_per_file: usize,
    /// Levels that every leaf gets, 0 to [`MAX_LEVELS`]: where it has fewer, its coarsest splats
    /// are written again. Other programs draw nothing of a leaf at a level that is coarser than its
    /// own.
    pub levels: usize,
    /// The rasterisation that every file states.
    pub rasterization: Option<Rasterization>,
}

impl Default for LevelWriteOptions {
    fn default() -> Self {
        Self { splats_per_file: 1 << 16, levels: 0, rasterization: None }
    }
}

/// A leaf to be written.
#[derive(Clone, Debug, Default)]
pub struct NewLeaf {
    /// Splats at each level, the finest first, 1 to [`MAX_LEVELS`] of them, in any order. A
    /// level without splats is left out.
    pub levels: Vec<Splats>,
    /// The error of each level, 0 or more and finite; none if they are not known. An error less
    /// than that of a finer level is written as that.
    pub errors: Vec<f32>,
}

/// A writer of a scene in levels: leaves in, jobs out that write files, and the index at the end.
///
/// It holds the splats of files that are not full, at most one a level. The index comes last: a
/// write that was stopped leaves none.
///
/// ```
/// # use wm_scene::{Metadata, Splats, levels::{LevelIndex, LevelWriteOptions, LevelWriter, NewLeaf}};
/// # let folder = tempfile::tempdir()?;
/// # let main = folder.path().join("city/lod-meta.json");
/// # let splats = |count| Splats { quats: vec![[1.0, 0.0, 0.0, 0.0]; count], ..Splats::zeroed(count, 0) };
/// # let leaf = NewLeaf { levels: vec![splats(20), splats(10)], errors: vec![0.0, 0.1] };
/// let mut writer = LevelWriter::create(&main, LevelWriteOptions::default())?;
/// for job in writer.add(leaf)? {
///     job.write()?;
/// }
/// let mut end = writer.finish(None, &Metadata::default())?;
/// for job in end.jobs.drain(..) {
///     job.write()?;
/// }
/// end.write_index()?;
/// assert_eq!(LevelIndex::open(&main)?.count_of_level(1), 10);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct LevelWriter {
    main: PathBuf,
    options: LevelWriteOptions,
    /// The file of each level that is being filled.
    pending: Vec<Pending>,
    names: Vec<String>,
    leaves: Vec<WrittenLeaf>,
    counts: Vec<u64>,
}

/// The file of a level that is being filled.
#[derive(Default)]
struct Pending {
    /// Index in the names; not used while it has no splats.
    file: usize,
    /// Files of the level before it.
    before: usize,
    splats: Splats,
}

struct WrittenLeaf {
    extent: Extent,
    runs: Vec<LevelRun>,
    errors: Vec<f32>,
}

/// The writing of one file: it may run on any thread, and jobs in any order.
#[must_use = "the index names the file"]
pub struct LevelFileJob {
    path: PathBuf,
    scene: Scene,
}

/// The rest of a scene in levels: jobs to be run, then the index.
#[must_use = "there is no scene without the index"]
pub struct LevelEnd {
    /// The last files.
    pub jobs: Vec<LevelFileJob>,
    main: PathBuf,
    index: IndexJson,
}

/// Splats for an entry of the palette of SH. Files are small: a palette as large as that of one
/// file for a whole scene would be most of their bytes, and of the time to read them.
const SPLATS_PER_ENTRY: usize = 8;

impl LevelWriter {
    /// Starts the scene whose index is `main`, a path that ends in `lod-meta.json`. Makes its
    /// folder, and removes an index that is there with the files that it names.
    ///
    /// # Errors
    /// [`FormatError`] if the name is another, the folder cannot be made or an old file cannot be
    /// removed.
    pub fn create(main: &Path, options: LevelWriteOptions) -> Result<Self, FormatError> {
        let fault = |problem| FormatError::whole(main, problem);
        if main.file_name().is_none_or(|name| name != "lod-meta.json") {
            let what = "levels of detail are written to a file called lod-meta.json; name it so";
            return Err(fault(Problem::Value(what.into())));
        }
        if let Some(folder) = main.parent().filter(|folder| !folder.as_os_str().is_empty()) {
            fs::create_dir_all(folder).map_err(|error| fault(error.into()))?;
        }
        remove(main)?;
        Ok(Self {
            main: main.into(),
            options,
            pending: Vec::new(),
            names: Vec::new(),
            leaves: Vec::new(),
            counts: Vec::new(),
        })
    }

    /// Adds a leaf; gives the files that became full. A leaf without splats is left out.
    ///
    /// # Errors
    /// [`FormatError`] if there are too many levels, arrays do not fit each other, a splat has a
    /// number that is not finite, or an error is not a number of 0 or more; nothing is added then.
    pub fn add(&mut self, mut leaf: NewLeaf) -> Result<Vec<LevelFileJob>, FormatError> {
        let number = self.leaves.len();
        let extent = extent_of(&leaf).map_err(|problem| {
            FormatError::value(&self.main, format!("not written: leaf {number}: {problem}"))
        })?;
        if let Some(coarsest) = leaf.levels.iter().rposition(|splats| !splats.is_empty()) {
            let coarsest = leaf.levels[coarsest].clone();
            let most = self.options.levels.min(MAX_LEVELS as usize);
            leaf.levels.resize(leaf.levels.len().max(most), coarsest);
            if let Some(error) = leaf.errors.last() {
                leaf.errors.resize(leaf.levels.len(), *error);
            }
        }
        let mut jobs = Vec::new();
        let mut runs = Vec::new();
        if self.pending.len() < leaf.levels.len() {
            self.pending.resize_with(leaf.levels.len(), Pending::default);
            self.counts.resize(leaf.levels.len(), 0);
        }
        for (level, splats) in leaf.levels.into_iter().enumerate().filter(|(_, splats)| !splats.is_empty()) {
            let pending = &mut self.pending[level];
            if pending.splats.is_empty() {
                pending.file = self.names.len();
                self.names.push(format!("{level}_{}/meta.json", pending.before));
                pending.before += 1;
            }
            let (offset, count) = (pending.splats.len() as u64, splats.len() as u64);
            pending.splats = Splats::joined(std::mem::take(&mut pending.splats), ordered(&splats));
            self.counts[level] += count;
            runs.push(LevelRun { level: level as u32, file: pending.file, offset, count, error: None });
            if pending.splats.len() >= self.options.splats_per_file {
                jobs.push(self.job(level));
            }
        }
        if !runs.is_empty() {
            let worst = |worst: &mut f32, error: f32| {
                *worst = worst.max(error);
                Some(*worst)
            };
            let errors = leaf.errors.into_iter().scan(0.0, worst).collect();
            self.leaves.push(WrittenLeaf { extent, runs, errors });
        }
        Ok(jobs)
    }

    /// The job of a level's file, which is begun anew.
    fn job(&mut self, level: usize) -> LevelFileJob {
        let pending = &mut self.pending[level];
        let name = self.names[pending.file].clone();
        let splats = std::mem::take(&mut pending.splats);
        self.job_of(&name, splats)
    }

    fn job_of(&self, name: &str, splats: Splats) -> LevelFileJob {
        let metadata = Metadata { rasterization: self.options.rasterization, ..Metadata::default() };
        let scene = Scene { splats, metadata, ..Scene::default() };
        LevelFileJob { path: self.main.with_file_name(name), scene }
    }

    /// Ends the scene: `environment` has the splats that are always drawn, such as the sky,
    /// `metadata` is what the index states.
    ///
    /// # Errors
    /// [`FormatError`] if there is no leaf, a value of the metadata is out of range, or the
    /// environment cannot be stored.
    pub fn finish(
        mut self,
        environment: Option<Splats>,
        metadata: &Metadata,
    ) -> Result<LevelEnd, FormatError> {
        let fault = |problem| FormatError::whole(&self.main, problem);
        let refused = |what: String| fault(Problem::Value(format!("not written: {what}")));
        if let Some(fault_of) = metadata.fault() {
            return Err(refused(fault_of));
        }
        let environment = environment.filter(|splats| !splats.is_empty());
        if let Some(splats) = &environment {
            splats.check().map_err(|error| fault(error.into()))?;
        }
        let boxes: Vec<Extent> = self.leaves.iter().map(|leaf| leaf.extent).collect();
        let tree = BoxTree::of(&boxes).ok_or_else(|| fault(Problem::NoSplats))?;
        let is_begun = |level: &usize| !self.pending[*level].splats.is_empty();
        let begun: Vec<usize> = (0..self.pending.len()).filter(is_begun).collect();
        let mut jobs: Vec<LevelFileJob> = begun.into_iter().map(|level| self.job(level)).collect();
        let name = environment.is_some().then(|| "env/meta.json".to_owned());
        jobs.extend(environment.map(|splats| self.job_of("env/meta.json", ordered(&splats))));
        let mut metadata = metadata.clone();
        metadata.rasterization = self.options.rasterization.or(metadata.rasterization);
        let levels = self.counts.len();
        let has_errors = self.leaves.iter().all(|leaf| !leaf.errors.is_empty());
        let node = |leaf: usize| self.leaves[leaf].node(levels, has_errors);
        let index = IndexJson {
            version: 1,
            asset: Asset { generator: concat!("weather-magician ", env!("CARGO_PKG_VERSION")) },
            count: self.counts.iter().sum(),
            tree: NodeJson::of(&tree, &node),
            counts: self.counts,
            levels,
            has_errors,
            environment: name,
            files: self.names,
            metadata: (metadata != Metadata::default()).then_some(metadata),
        };
        Ok(LevelEnd { jobs, main: self.main, index })
    }
}

impl LevelFileJob {
    /// Encodes and writes the file, and makes its folder.
    ///
    /// # Errors
    /// [`FormatError`] if it cannot be written.
    pub fn write(self) -> Result<(), FormatError> {
        let splats = &self.scene.splats;
        let entries = splats.len().div_ceil(SPLATS_PER_ENTRY);
        let weights: Vec<f32> = (0..splats.len()).map(|index| visibility(splats, index)).collect();
        let scene = &self.scene;
        write_files(&self.path, |sink| files_with(scene, Arrangement::AsGiven, entries, &weights, sink))
    }
}

impl LevelEnd {
    /// Writes the index, after all jobs are done.
    ///
    /// # Errors
    /// [`FormatError`] if a file that it names is not there, or it cannot be written.
    pub fn write_index(self) -> Result<(), FormatError> {
        for name in self.index.files.iter().chain(&self.index.environment) {
            let path = self.main.with_file_name(name);
            fs::metadata(&path).map_err(|error| FormatError::reading(&path, error))?;
        }
        write_json(&self.main, &self.index)
    }
}

/// Splats along a Morton curve.
fn ordered(splats: &Splats) -> Splats {
    let order: Vec<usize> = morton::order(&splats.means).into_iter().map(|index| index as usize).collect();
    splats.select(&order)
}

/// Writes a file of JSON on one line.
pub(super) fn write_json(path: &Path, value: &impl Serialize) -> Result<(), FormatError> {
    write_atomically(path, |out| {
        serde_json::to_writer(&mut *out, value)
            .map_err(|error| Problem::from(std::io::Error::from(error)))?;
        Ok(out.write_all(b"\n")?)
    })
}

/// Removes an index, then the files that it names; one that cannot be read only itself.
fn remove(main: &Path) -> Result<(), FormatError> {
    let old = LevelIndex::open(main).ok();
    let gone = |path: &Path| match fs::remove_file(path) {
        Err(error) if error.kind() != ErrorKind::NotFound => Err(FormatError::whole(path, error.into())),
        _ => Ok(()),
    };
    gone(main)?;
    let Some(old) = old else { return Ok(()) };
    for name in old.files.iter().chain(&old.environment) {
        let Ok(meta) = below(main, name) else { continue };
        if !name.ends_with(".json") {
            gone(&meta)?;
            continue;
        }
        for file in ["meta", "means_l", "means_u", "scales", "quats", "sh0", "shN_labels", "shN_centroids"] {
            let ending = if file == "meta" { "json" } else { "webp" };
            gone(&meta.with_file_name(file).with_extension(ending))?;
        }
        // A folder with something else in it stays.
        let _ = meta.parent().map(fs::remove_dir);
    }
    Ok(())
}

/// Checks a leaf, and returns the box that holds the ellipsoids of its splats.
fn extent_of(leaf: &NewLeaf) -> Result<Extent, Problem> {
    let value = |what: String| Problem::Value(what);
    if leaf.levels.len() > MAX_LEVELS as usize {
        return Err(value(format!("{} levels; {MAX_LEVELS} are the most", leaf.levels.len())));
    }
    if !leaf.errors.is_empty() && leaf.errors.len() != leaf.levels.len() {
        return Err(value(format!("{} errors for {} levels", leaf.errors.len(), leaf.levels.len())));
    }
    if let Some(error) = leaf.errors.iter().find(|error| !(error.is_finite() && **error >= 0.0)) {
        return Err(value(format!("the error {error}; it must be 0 or more")));
    }
    for splats in &leaf.levels {
        splats.check()?;
        // A rotation of zeros is none, as in every format.
        if let Some(index) = (0..splats.len()).find(|index| splats.faults(*index).is_fatal()) {
            return Err(value(format!("splat {index} cannot be drawn; repair the scene")));
        }
    }
    Ok(ellipsoids(&leaf.levels))
}

/// The box that holds the ellipsoids of splats, of 3 standard deviations.
pub(super) fn ellipsoids(sets: &[Splats]) -> Extent {
    let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    for splats in sets {
        for index in 0..splats.len() {
            let (mean, half) = (splats.means[index].map(f64::from), half_extents(splats, index));
            for k in 0..3 {
                low[k] = low[k].min(mean[k] - half[k]);
                high[k] = high[k].max(mean[k] + half[k]);
            }
        }
    }
    Extent { low: low.map(|v| outward(v, -1.0)), high: high.map(|v| outward(v, 1.0)) }
}

/// Share of a splat's squared error in that of pictures: its opacity squared times its area, above
/// 0.
fn visibility(splats: &Splats, index: usize) -> f32 {
    let [x, y, z] = splats.log_scales[index];
    // Without the thinnest axis.
    let area = (x + y + z - x.min(y).min(z)).clamp(-60.0, 60.0).exp();
    (splats.opacity(index) as f32).powi(2).max(1e-4) * area
}

/// Half the sides of the box of a splat's ellipsoid of 3 standard deviations.
fn half_extents(splats: &Splats, index: usize) -> [f64; 3] {
    let scales = splats.scales(index);
    to_matrix(splats.quats[index].map(f64::from))
        .map(|row| 3.0 * row.iter().zip(scales).map(|(r, scale)| (r * scale).powi(2)).sum::<f64>().sqrt())
}

/// A coordinate that stays outside when 7 of its digits are written.
fn outward(v: f64, sign: f64) -> f32 {
    let most = f64::from(f32::MAX) / 1.01;
    (v + sign * 1e-6 * v.abs()).clamp(-most, most) as f32
}

impl WrittenLeaf {
    fn node(&self, levels: usize, has_errors: bool) -> NodeJson {
        let run =
            |run: &LevelRun| (run.level, RawRun { file: run.file, offset: run.offset, count: run.count });
        // Levels that the leaf lacks have its last error.
        let error = |level: usize| Digits(self.errors[level.min(self.errors.len() - 1)]);
        NodeJson {
            bound: self.extent.into(),
            children: None,
            lods: Some(self.runs.iter().map(run).collect()),
            errors: has_errors.then(|| (0..levels).map(error).collect()),
        }
    }
}

/// The content of an index as JSON.
#[derive(Serialize)]
struct IndexJson {
    version: u32,
    asset: Asset,
    count: u64,
    counts: Vec<u64>,
    #[serde(rename = "lodLevels")]
    levels: usize,
    #[serde(rename = "lodErrors", skip_serializing_if = "std::ops::Not::not")]
    has_errors: bool,
    #[serde(skip_serializing_if = "Option::is_none")]
    environment: Option<String>,
    #[serde(rename = "filenames")]
    files: Vec<String>,
    tree: NodeJson,
    #[serde(rename = "wm", skip_serializing_if = "Option::is_none")]
    metadata: Option<Metadata>,
}

#[derive(Serialize)]
struct Asset {
    generator: &'static str,
}

#[derive(Serialize)]
struct NodeJson {
    bound: BoundJson,
    #[serde(skip_serializing_if = "Option::is_none")]
    children: Option<Box<[Self; 2]>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    lods: Option<BTreeMap<u32, RawRun>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    errors: Option<Vec<Digits>>,
}

impl NodeJson {
    fn of(tree: &BoxTree, leaf: &impl Fn(usize) -> Self) -> Self {
        match tree {
            BoxTree::Leaf(index) => leaf(*index),
            BoxTree::Node(extent, children) => Self {
                bound: (*extent).into(),
                children: Some(Box::new(children.each_ref().map(|child| Self::of(child, leaf)))),
                lods: None,
                errors: None,
            },
        }
    }
}

#[derive(Serialize)]
struct BoundJson {
    min: [Digits; 3],
    max: [Digits; 3],
}

impl From<Extent> for BoundJson {
    fn from(extent: Extent) -> Self {
        Self { min: extent.low.map(Digits), max: extent.high.map(Digits) }
    }
}

/// A number that is written with 7 digits.
struct Digits(f32);

impl Serialize for Digits {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        // Rounded in decimal: the nearest double of that prints no more digits.
        let rounded: f64 = format!("{:.6e}", self.0).parse().unwrap_or_default();
        if rounded.fract() == 0.0 && rounded.abs() < 1e15 {
            serializer.serialize_i64(rounded as i64)
        } else {
            serializer.serialize_f64(rounded)
        }
    }
}
