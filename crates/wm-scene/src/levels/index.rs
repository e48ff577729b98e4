//! `lod-meta.json`: the leaves of a scene in levels, and where their splats are.

use super::{LevelFile, tree::Extent};
use crate::{
    Group, Metadata, Scene, Splats,
    formats::{
        DetailLevel,
        folder::scene_file,
        sidecar,
        sog::read::{below, fault, parse, picture_names},
    },
    remark::add_new,
};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::{
    collections::{BTreeMap, BTreeSet},
    path::{Component, Path, PathBuf},
};
use wm_base::{FormatError, Problem, error::excerpt, files};

/// The name of an index.
pub const INDEX_NAME: &str = "lod-meta.json";
/// Most levels of a scene.
pub const MAX_LEVELS: u32 = 64;

/// The index of a scene in levels of detail. Level 0 is the finest.
#[derive(Clone, Debug)]
pub struct LevelIndex {
    main: PathBuf,
    /// Number of levels, 1 to [`MAX_LEVELS`].
    pub levels: u32,
    /// The names of the files, below the folder of the index: the `meta.json` of one SOG each, or a
    /// SOG bundle.
    pub files: Vec<String>,
    /// The file with the splats that are always drawn, such as the sky.
    pub environment: Option<String>,
    /// The leaves, depth first.
    pub leaves: Vec<LevelLeaf>,
    /// The facts that the index states about the scene.
    pub metadata: Metadata,
}

/// A part of space, and its splats at each level.
#[derive(Clone, Debug, PartialEq)]
pub struct LevelLeaf {
    /// Least coordinates of its box, which holds its splats; infinite where the index has none.
    pub low: [f32; 3],
    /// Greatest coordinates.
    pub high: [f32; 3],
    /// Levels, the finest first, at least one, each of one splat or more. A level that has as
    /// many splats and the same error as the one before is left out.
    pub runs: Vec<LevelRun>,
}

/// The splats of a leaf at a level: a run in a file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LevelRun {
    /// The level.
    pub level: u32,
    /// The index of the file in [`LevelIndex::files`].
    pub file: usize,
    /// The first splat.
    pub offset: u64,
    /// Number of splats.
    pub count: u64,
    /// The error of the leaf's pictures at this level, 0 or more: see [`crate::levels`]. `None`
    /// where the index states none.
    pub error: Option<f32>,
}

impl LevelLeaf {
    pub(super) fn extent(&self) -> Extent {
        Extent { low: self.low, high: self.high }
    }

    /// The run for a level: of a leaf that lacks it, that of the finest coarser level, else of the
    /// coarsest.
    #[must_use]
    pub fn at_level(&self, level: u32) -> Option<&LevelRun> {
        self.runs.get(self.position_at(level)?)
    }

    /// The position of that run in [`Self::runs`].
    #[must_use]
    pub fn position_at(&self, level: u32) -> Option<usize> {
        self.runs.iter().position(|run| run.level >= level).or(self.runs.len().checked_sub(1))
    }
}

#[derive(Deserialize)]
struct RawIndex {
    version: Option<u32>,
    #[serde(rename = "lodLevels")]
    levels: u32,
    /// True if every leaf has errors.
    #[serde(rename = "lodErrors", default)]
    has_errors: Value,
    environment: Option<String>,
    filenames: Vec<String>,
    tree: RawNode,
    #[serde(rename = "wm", default)]
    metadata: Metadata,
}

#[derive(Deserialize)]
struct RawNode {
    #[serde(default)]
    bound: RawBound,
    #[serde(default)]
    children: Vec<RawNode>,
    #[serde(default)]
    lods: BTreeMap<String, RawRun>,
    #[serde(default)]
    errors: Vec<f32>,
}

#[derive(Deserialize, Default)]
struct RawBound {
    min: Option<[f32; 3]>,
    max: Option<[f32; 3]>,
}

/// A run as the file has it.
#[derive(Deserialize, Serialize)]
pub(super) struct RawRun {
    pub(super) file: usize,
    pub(super) offset: u64,
    pub(super) count: u64,
}

impl RawNode {
    /// Adds the leaves of this node, with `around` the box of the node above it.
    fn leaves(&self, around: Extent, index: &RawIndex, out: &mut Vec<LevelLeaf>) -> Result<(), Problem> {
        let (low, high) = (self.bound.min.unwrap_or(around.low), self.bound.max.unwrap_or(around.high));
        if (0..3).any(|k| low[k] > high[k]) {
            return Err(fault(format!("a box of lod-meta.json ends before it begins: {low:?} to {high:?}")));
        }
        self.children.iter().try_for_each(|child| child.leaves(Extent { low, high }, index, out))?;
        let errors = if index.has_errors == Value::Bool(true) { &self.errors[..] } else { &[] };
        let mut runs = Vec::new();
        // What has no splats is as good as missing.
        for (key, run) in self.lods.iter().filter(|(_, run)| run.count > 0) {
            let level = key.parse().ok().filter(|level| *level < index.levels).ok_or_else(|| {
                let (key, coarsest) = (excerpt(key.as_bytes()), index.levels - 1);
                fault(format!("a leaf of lod-meta.json has a level \"{key}\": there are 0 to {coarsest}"))
            })?;
            let error = errors.get(level as usize).copied();
            let error = error.filter(|error| error.is_finite() && *error >= 0.0);
            runs.push(LevelRun { level, file: run.file, offset: run.offset, count: run.count, error });
        }
        runs.sort_by_key(|run| run.level);
        if let Some(pair) = runs.windows(2).find(|pair| pair[0].level == pair[1].level) {
            return Err(fault(format!("a leaf of lod-meta.json has level {} twice", pair[0].level)));
        }
        // A level that is the one before again stands there for programs that draw nothing of a
        // leaf at levels that it lacks.
        runs.dedup_by(|run, finer| {
            run.count == finer.count && run.error.is_some() && run.error == finer.error
        });
        if !runs.is_empty() {
            out.push(LevelLeaf { low, high, runs });
        }
        Ok(())
    }
}

impl LevelIndex {
    /// Reads a `lod-meta.json`, and the TOML file of metadata beside it, whose values win. The
    /// files that it names are not opened.
    ///
    /// # Errors
    /// [`FormatError`] if it cannot be read, or contradicts itself.
    pub fn open(main: &Path) -> Result<Self, FormatError> {
        let sidecar = sidecar::read(main)?;
        let text = files::read(main).map_err(|error| FormatError::reading(main, error))?;
        let index = Self::parse(main, &text).map_err(|problem| FormatError::whole(main, problem))?;
        Ok(Self { metadata: sidecar.unwrap_or_default().or(index.metadata), ..index })
    }

    /// Reads the index of a scene, a file or a folder; `None` if the scene is not in levels.
    ///
    /// # Errors
    /// [`FormatError`] if there is no scene, or its index cannot be read.
    pub fn of_scene(path: &Path) -> Result<Option<Self>, FormatError> {
        let file = scene_file(path)?;
        let is_index = file.file_name().is_some_and(|name| name == INDEX_NAME);
        is_index.then(|| Self::open(&file)).transpose()
    }

    /// Reads the content of the file `main`.
    pub(crate) fn parse(main: &Path, text: &[u8]) -> Result<Self, Problem> {
        let raw: RawIndex = parse(text, "lod-meta.json")?;
        if let Some(version) = raw.version.filter(|version| *version != 1) {
            return Err(fault(format!("lod-meta.json of version {version} is not read, 1 is")));
        }
        if let Some(fault_of) = raw.metadata.fault() {
            return Err(fault(format!("lod-meta.json: {fault_of}")));
        }
        if !(1..=MAX_LEVELS).contains(&raw.levels) {
            return Err(fault(format!(
                "lod-meta.json has {} levels; 1 to {MAX_LEVELS} are read",
                raw.levels
            )));
        }
        let mut leaves = Vec::new();
        raw.tree.leaves(Extent::ALL, &raw, &mut leaves)?;
        let index = Self {
            main: main.into(),
            levels: raw.levels,
            files: raw.filenames,
            environment: raw.environment,
            leaves,
            metadata: raw.metadata,
        };
        index.check()?;
        Ok(index)
    }

    /// Checks that files are there once, and that no splat is in two runs.
    fn check(&self) -> Result<(), Problem> {
        let mut names = BTreeSet::new();
        // A file that has several names would be read as often.
        let mut plain = |name: &String| {
            names.insert(
                Path::new(name).components().filter(|part| *part != Component::CurDir).collect::<PathBuf>(),
            )
        };
        if let Some(name) = self.files.iter().chain(&self.environment).find(|name| !plain(name)) {
            return Err(fault(format!("lod-meta.json names \"{}\" twice", excerpt(name.as_bytes()))));
        }
        let mut runs: Vec<&LevelRun> = self.leaves.iter().flat_map(|leaf| &leaf.runs).collect();
        runs.sort_by_key(|run| (run.file, run.offset));
        if let Some(run) = runs.last().filter(|run| run.file >= self.files.len()) {
            return Err(fault(format!("lod-meta.json has no file {}", run.file)));
        }
        let end = |run: &LevelRun| run.offset.checked_add(run.count);
        let is_apart = |pair: &[&LevelRun]| {
            pair[0].file != pair[1].file || end(pair[0]).is_some_and(|end| end <= pair[1].offset)
        };
        if !runs.windows(2).all(is_apart) || runs.iter().any(|run| end(run).is_none()) {
            return Err(fault("a leaf of lod-meta.json has splats that another has too"));
        }
        Ok(())
    }

    /// The path of the index itself.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.main
    }

    /// Number of splats of a level, with those of leaves that lack it at another level; without the
    /// environment.
    #[must_use]
    pub fn count_of_level(&self, level: u32) -> u64 {
        self.leaves
            .iter()
            .filter_map(|leaf| leaf.at_level(level))
            .fold(0, |sum, run| sum.saturating_add(run.count))
    }

    /// The finest level with no more splats than `most`; the coarsest if all have more.
    #[must_use]
    pub fn level_within(&self, most: u64) -> u32 {
        let coarsest = self.levels - 1;
        (0..coarsest).find(|level| self.count_of_level(*level) <= most).unwrap_or(coarsest)
    }

    /// Reads and decodes file `file` of [`Self::files`].
    ///
    /// # Errors
    /// [`FormatError`] if it is not there or damaged.
    ///
    /// # Panics
    /// If there are fewer files.
    pub fn read_file(&self, file: usize) -> Result<LevelFile, FormatError> {
        self.read_named(&self.files[file])
    }

    /// The files on which file `file` of [`Self::files`] waits, where scenes are made of files that
    /// are fetched; none if it can be read.
    ///
    /// # Panics
    /// If there are fewer files.
    #[must_use]
    pub fn lacking(&self, file: usize) -> Vec<PathBuf> {
        self.lacking_of(&self.files[file])
    }

    /// The files on which [`Self::read_environment`] waits.
    #[must_use]
    pub fn lacking_environment(&self) -> Vec<PathBuf> {
        self.environment.as_ref().map_or_else(Vec::new, |name| self.lacking_of(name))
    }

    fn lacking_of(&self, name: &str) -> Vec<PathBuf> {
        // What leads out of the folder is an error once it is read.
        let Ok(path) = below(&self.main, name) else { return Vec::new() };
        if files::is_lacking(&path) {
            return vec![path];
        }
        self.paths_of(name).into_iter().filter(|path| files::is_lacking(path)).collect()
    }

    /// The paths of file `file` of [`Self::files`] as far as they are known: its bundle, or its
    /// `meta.json` and once that was fetched its pictures.
    ///
    /// # Panics
    /// If there are fewer files.
    #[must_use]
    pub fn paths(&self, file: usize) -> Vec<PathBuf> {
        self.paths_of(&self.files[file])
    }

    fn paths_of(&self, name: &str) -> Vec<PathBuf> {
        let Ok(path) = below(&self.main, name) else { return Vec::new() };
        if !name.ends_with(".json") {
            return vec![path];
        }
        let meta = files::read_if_there(&path).ok().flatten().unwrap_or_default();
        let pictures = picture_names(&meta).unwrap_or_default();
        let pictures: Vec<PathBuf> = pictures.iter().filter_map(|name| below(&path, name).ok()).collect();
        std::iter::once(path).chain(pictures).collect()
    }

    /// Reads the splats that are always drawn, as those of the sky: infinitely far for weather;
    /// none if there is no such file.
    ///
    /// # Errors
    /// [`FormatError`] if it is not there or damaged.
    pub fn read_environment(&self) -> Result<Option<Scene>, FormatError> {
        let Some(name) = &self.environment else { return Ok(None) };
        let file = self.read_named(name)?;
        let mut splats = file.splats(0, file.len() as u64)?;
        splats.groups.fill(Group::Sky);
        Ok(Some(Scene { splats, metadata: file.metadata().clone(), ..Scene::default() }))
    }

    fn read_named(&self, name: &str) -> Result<LevelFile, FormatError> {
        let path = below(&self.main, name).map_err(|problem| FormatError::whole(&self.main, problem))?;
        LevelFile::read(&path)
    }

    /// Reads the whole scene at one level, with its environment.
    ///
    /// # Errors
    /// [`FormatError`] if there is no such level, or a file is not there or damaged.
    pub fn read_level(&self, level: DetailLevel) -> Result<Scene, FormatError> {
        let whole = |problem| FormatError::whole(&self.main, problem);
        let coarsest = self.levels - 1;
        let level = match level {
            DetailLevel::Finest => 0,
            DetailLevel::Number(number) if number > coarsest => {
                let fault = format!("there is no level {number}: it has 0 to {coarsest}");
                return Err(whole(Problem::Value(fault)));
            }
            DetailLevel::Number(number) => number,
            DetailLevel::Budget(most) => self.level_within(most),
        };
        let mut runs: Vec<LevelRun> =
            self.leaves.iter().filter_map(|leaf| leaf.at_level(level)).copied().collect();
        runs.sort_by_key(|run| (run.file, run.offset));
        let mut splats = Splats::default();
        let mut metadata = self.metadata.clone();
        let mut remarks = Vec::new();
        for runs in runs.chunk_by(|a, b| a.file == b.file) {
            let file = self.read_file(runs[0].file)?;
            for run in runs {
                splats = Splats::joined(splats, file.splats(run.offset, run.count)?);
            }
            metadata = metadata.or(file.metadata().clone());
            add_new(&mut remarks, file.remarks());
        }
        if let Some(environment) = self.read_environment()? {
            splats = Splats::joined(splats, environment.splats);
            metadata = metadata.or(environment.metadata);
            add_new(&mut remarks, &environment.remarks);
        }
        if splats.is_empty() {
            return Err(whole(Problem::NoSplats));
        }
        Ok(Scene { splats, metadata, remarks, ..Scene::default() })
    }
}
