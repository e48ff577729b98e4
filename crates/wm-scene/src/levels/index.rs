//! `lod-meta.json`: the leaves of a scene in levels, and where their splats are.

use super::{LevelFile, tree::Extent};
use crate::{
    FormatError, Metadata, Problem, Scene, Splats,
    formats::{
        DetailLevel,
        folder::scene_file,
        sidecar,
        sog::read::{below, fault, parse},
    },
};
use serde::Deserialize;
use serde_json::Value;
use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::{Path, PathBuf},
};

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
    /// The names of the files, below the folder of the index: the `meta.json` of one SOG each.
    pub files: Vec<String>,
    /// The file with the splats that are always drawn, such as the sky.
    pub environment: Option<String>,
    /// The leaves, depth first.
    pub leaves: Vec<LevelLeaf>,
    /// What the index states of the scene.
    pub metadata: Metadata,
}

/// A part of space, and its splats at each level.
#[derive(Clone, Debug, PartialEq)]
pub struct LevelLeaf {
    /// Least coordinates of its box, which holds its splats; infinite where the index has none.
    pub low: [f32; 3],
    /// Greatest coordinates.
    pub high: [f32; 3],
    /// Its levels, the finest first, at least one.
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
    /// The error of the leaf's pictures at this level, 0 or more: see [`crate::levels`]. `None` where the index states none.
    pub error: Option<f32>,
}

impl LevelLeaf {
    /// The run for a level: of a leaf that lacks it, that of the finest coarser level, else of the coarsest.
    #[must_use]
    pub fn at_level(&self, level: u32) -> Option<&LevelRun> {
        self.runs.iter().find(|run| run.level >= level).or(self.runs.last())
    }
}

#[derive(Deserialize)]
struct RawIndex {
    #[serde(default)]
    version: Option<u32>,
    #[serde(rename = "lodLevels")]
    levels: u32,
    /// True if every leaf has errors.
    #[serde(rename = "lodErrors", default)]
    has_errors: Value,
    #[serde(default)]
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
    #[serde(default)]
    min: Option<[f32; 3]>,
    #[serde(default)]
    max: Option<[f32; 3]>,
}

#[derive(Deserialize)]
struct RawRun {
    file: usize,
    offset: u64,
    count: u64,
}

impl RawNode {
    /// Adds the leaves of this node, with `around` the box of the node above it.
    fn leaves(&self, around: Extent, has_errors: bool, out: &mut Vec<LevelLeaf>) {
        let (low, high) = (self.bound.min.unwrap_or(around.0), self.bound.max.unwrap_or(around.1));
        self.children.iter().for_each(|child| child.leaves((low, high), has_errors, out));
        let errors = if has_errors { &self.errors[..] } else { &[] };
        let run = |(key, run): (&String, &RawRun)| {
            let level: u32 = key.parse().ok()?;
            let error = errors.get(level as usize).copied().filter(|error| *error >= 0.0);
            Some(LevelRun { level, file: run.file, offset: run.offset, count: run.count, error })
        };
        let mut runs: Vec<LevelRun> = self.lods.iter().filter_map(run).collect();
        if !runs.is_empty() {
            runs.sort_by_key(|run| run.level);
            out.push(LevelLeaf { low, high, runs });
        }
    }
}

impl LevelIndex {
    /// Reads a `lod-meta.json`, and the TOML file of metadata beside it, whose values win. The files that it names are not opened.
    ///
    /// # Errors
    /// [`FormatError`] if it cannot be read, or contradicts itself.
    pub fn open(main: &Path) -> Result<Self, FormatError> {
        let sidecar = sidecar::read(main)?;
        let text = fs::read(main).map_err(|error| FormatError::reading(main, error))?;
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
        let mut leaves = Vec::new();
        raw.tree.leaves(
            ([f32::NEG_INFINITY; 3], [f32::INFINITY; 3]),
            raw.has_errors == Value::Bool(true),
            &mut leaves,
        );
        let index = Self {
            main: main.into(),
            levels: raw.levels.clamp(1, MAX_LEVELS),
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
        if !self.files.iter().chain(&self.environment).all(|name| names.insert(name)) {
            return Err(fault("lod-meta.json names a file twice"));
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

    /// Number of splats of a level, with those of leaves that lack it at another level; without the environment.
    #[must_use]
    pub fn count_of_level(&self, level: u32) -> u64 {
        self.leaves
            .iter()
            .filter_map(|leaf| leaf.at_level(level))
            .fold(0, |sum, run| sum.saturating_add(run.count))
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

    /// Reads the splats that are always drawn; none if there is no such file.
    ///
    /// # Errors
    /// [`FormatError`] if it is not there or damaged.
    pub fn read_environment(&self) -> Result<Option<Scene>, FormatError> {
        let Some(name) = &self.environment else { return Ok(None) };
        let file = self.read_named(name)?;
        let splats = file.splats(0, file.len() as u64)?;
        Ok(Some(Scene { splats, metadata: file.metadata().clone(), views: Vec::new() }))
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
            DetailLevel::Budget(most) => {
                (0..=coarsest).find(|level| self.count_of_level(*level) <= most).unwrap_or(coarsest)
            }
        };
        let mut runs: Vec<LevelRun> =
            self.leaves.iter().filter_map(|leaf| leaf.at_level(level)).copied().collect();
        runs.sort_by_key(|run| (run.file, run.offset));
        let mut splats = Splats::default();
        let mut metadata = self.metadata.clone();
        for runs in runs.chunk_by(|a, b| a.file == b.file) {
            let file = self.read_file(runs[0].file)?;
            for run in runs {
                splats = Splats::joined(splats, file.splats(run.offset, run.count)?);
            }
            metadata = metadata.or(file.metadata().clone());
        }
        if let Some(environment) = self.read_environment()? {
            splats = Splats::joined(splats, environment.splats);
            metadata = metadata.or(environment.metadata);
        }
        if splats.is_empty() {
            return Err(whole(Problem::NoSplats));
        }
        Ok(Scene { splats, metadata, views: Vec::new() })
    }
}
