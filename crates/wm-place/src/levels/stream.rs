//! The leaves of a scene in levels that a renderer holds: those of the last cuts, the least used
//! dropped first.

use super::budget::held_bytes;
use crate::{Error, Patience, Result};
use glam::DVec3;
use rayon::prelude::*;
use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::sync::Arc;
use wm_base::{FormatError, files};
use wm_render::{AnyRenderer, RenderBackend, SetId};
use wm_scene::levels::{LevelIndex, LevelRun};
use wm_scene::survey::SkyRegion;
use wm_scene::{Camera, Group, Metadata, Splats};

/// A leaf at a level: the number of the leaf, and the place of the level in
/// [`wm_scene::levels::LevelLeaf::runs`].
pub(crate) type RunId = (u32, u16);

/// Splats that are read for a draft: some 50 ms.
const DRAFT_SPLATS: u64 = 200_000;

/// The splats of a scene in levels, read and dropped as they are wanted.
pub(crate) struct LevelStream {
    pub(crate) index: Arc<LevelIndex>,
    /// The splats that are sky, where the files do not tell.
    pub(crate) sky: SkyRegion,
    /// Splats that cannot be drawn and files that cannot be read are left out.
    repairs: bool,
    held: BTreeMap<RunId, HeldRun>,
    /// The highest degree of splats that were read.
    pub(crate) sh_degree: u8,
    pub(crate) metadata: Metadata,
    /// Bytes of all that is held, and the most.
    pub(crate) bytes: u64,
    pub(crate) most: u64,
    /// Counts cuts.
    clock: u64,
    /// Files that could not be read.
    missing: BTreeSet<usize>,
    /// Files that have to be fetched first, as the present cut found.
    absent: BTreeSet<usize>,
    /// True once the present frame found that files have to be fetched.
    pub(crate) waits: bool,
    /// The eyes of the present frame.
    eyes: Vec<DVec3>,
    /// Counts frames, and the last in which each file was wanted.
    frame: u64,
    used: BTreeMap<usize, u64>,
    pub(crate) warnings: Vec<String>,
}

/// A run in the renderer.
pub(crate) struct HeldRun {
    /// The splats of the run.
    pub(crate) set: SetId,
    /// Their positions.
    pub(crate) means: Arc<[[f32; 3]]>,
    bytes: u64,
    /// The last cut that it was in.
    used: u64,
}

/// Runs of a file, and what it states of the scene.
struct FileRuns {
    splats: Vec<Splats>,
    metadata: Metadata,
}

impl LevelStream {
    /// Nothing is held yet.
    pub(crate) fn new(index: Arc<LevelIndex>, repairs: bool) -> Self {
        Self {
            index,
            sky: SkyRegion::None,
            repairs,
            held: BTreeMap::new(),
            sh_degree: 0,
            metadata: Metadata::default(),
            bytes: 0,
            most: 0,
            clock: 0,
            missing: BTreeSet::new(),
            absent: BTreeSet::new(),
            waits: false,
            eyes: Vec::new(),
            frame: 0,
            used: BTreeMap::new(),
            warnings: Vec::new(),
        }
    }

    /// Takes the warnings that came up.
    pub(crate) fn take_warnings(&mut self) -> Vec<String> {
        std::mem::take(&mut self.warnings)
    }

    /// A run that is held.
    pub(crate) fn get(&self, id: RunId) -> Option<&HeldRun> {
        self.held.get(&id)
    }

    /// Begins a frame that cameras see: what it has to wait for is noted once, that near them
    /// first.
    pub(crate) fn begin_frame(&mut self, cameras: &[Camera]) {
        self.look_from(cameras);
        self.waits = false;
        self.frame += 1;
    }

    /// Sets the cameras about which files are wanted first.
    pub(crate) fn look_from(&mut self, cameras: &[Camera]) {
        self.eyes = cameras.iter().map(Camera::center).collect();
    }

    /// Notes the files that have to be fetched for runs, coarse ones first and then near ones.
    fn want(&self, runs: &[RunId]) {
        let mut wanted: BTreeMap<usize, (Reverse<u32>, f64)> = BTreeMap::new();
        for id in runs.iter().filter(|id| !self.held.contains_key(id)) {
            let Some(run) = self.run(*id).filter(|run| self.absent.contains(&run.file)) else { continue };
            let leaf = &self.index.leaves[id.0 as usize];
            let [low, high] = [leaf.low, leaf.high].map(|corner| DVec3::from_array(corner.map(f64::from)));
            let far = self.eyes.iter().map(|eye| eye.distance(eye.max(low).min(high)));
            let far = far.fold(f64::INFINITY, f64::min);
            let known = wanted.entry(run.file).or_insert((Reverse(run.level), far));
            *known = (known.0.min(Reverse(run.level)), known.1.min(far));
        }
        let mut wanted: Vec<_> = wanted.into_iter().collect();
        wanted.sort_by(|(_, a), (_, b)| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
        for path in wanted.iter().flat_map(|(file, _)| self.index.lacking(*file)) {
            files::want(&path);
        }
    }

    /// Finds which files have to be fetched before runs can be read, or what stands for them.
    fn find_absent(&mut self, runs: &[RunId]) {
        self.absent.clear();
        let mut present = BTreeSet::new();
        for (leaf, place) in runs {
            let coarser = self.index.leaves[*leaf as usize].runs.iter().enumerate();
            for (place, run) in coarser.skip(usize::from(*place)) {
                if self.held.contains_key(&(*leaf, place as u16)) || present.contains(&run.file) {
                    break;
                }
                if self.missing.contains(&run.file) || self.absent.contains(&run.file) {
                    continue;
                }
                if self.index.lacking(run.file).is_empty() {
                    present.insert(run.file);
                    break;
                }
                self.absent.insert(run.file);
            }
        }
    }

    /// Notes what has to be fetched before runs can be read; returns false if anything has to be.
    pub(crate) fn are_there(&mut self, runs: &[RunId]) -> bool {
        self.find_absent(runs);
        // Weather comes before the frame that it is for.
        self.mark_used(runs, self.frame + 1);
        self.want(runs);
        let is_absent = |run: &LevelRun| self.absent.contains(&run.file);
        let all = !runs.iter().filter_map(|id| self.run(*id)).any(is_absent);
        self.absent.clear();
        all
    }

    fn mark_used(&mut self, runs: &[RunId], frame: u64) {
        let files: BTreeSet<usize> = runs.iter().filter_map(|id| Some(self.run(*id)?.file)).collect();
        self.used.extend(files.into_iter().map(|file| (file, frame)));
    }

    /// The fetched files that the last frame did not want, those longest ago first. Files of
    /// coarsest levels stay: they are drawn while finer ones are fetched.
    pub(crate) fn spare_files(&self) -> Vec<PathBuf> {
        let leaves = self.index.leaves.iter();
        let coarsest: BTreeSet<usize> = leaves.filter_map(|leaf| Some(leaf.runs.last()?.file)).collect();
        let spare = |file: &usize| {
            !coarsest.contains(file) && self.used.get(file).is_none_or(|used| *used < self.frame)
        };
        let mut files: Vec<usize> = (0..self.index.files.len()).filter(spare).collect();
        files.sort_by_key(|file| self.used.get(file).copied());
        files.into_iter().flat_map(|file| self.index.paths(file)).collect()
    }

    fn run(&self, id: RunId) -> Option<&LevelRun> {
        let (leaf, place) = id;
        self.index.leaves[leaf as usize].runs.get(usize::from(place))
    }

    /// Makes the renderer hold `wanted`, and returns what of it can be drawn: of a leaf whose file
    /// cannot be read, the next coarser level that can. With [`Patience::Draft`] few splats are
    /// read at a time, and leaves that wait are drawn at a level that is held.
    ///
    /// # Errors
    /// [`Error::Format`] if a file cannot be read and damage is not left out; an error of the
    /// renderer.
    pub(crate) fn hold(
        &mut self,
        backend: &mut AnyRenderer,
        wanted: &[RunId],
        patience: Patience,
    ) -> Result<Vec<RunId>> {
        self.clock += 1;
        self.find_absent(wanted);
        self.mark_used(wanted, self.frame);
        // Drafts want less: a camera that moves passes most of it. Nor do later looks, which are at
        // what stands for what is wanted.
        if !self.waits && patience == Patience::Whole {
            self.want(wanted);
        }
        self.waits |= !self.absent.is_empty();
        let mut drawn: Vec<RunId> = wanted.to_vec();
        if patience == Patience::Draft {
            self.wait_for_some(&mut drawn);
        }
        loop {
            self.replace_missing(&mut drawn);
            let new: Vec<RunId> = drawn.iter().copied().filter(|id| !self.held.contains_key(id)).collect();
            for id in &drawn {
                if let Some(held) = self.held.get_mut(id) {
                    held.used = self.clock;
                }
            }
            if new.is_empty() {
                return Ok(drawn);
            }
            self.make_room(backend, &new);
            if self.load(backend, &new)? {
                return Ok(drawn);
            }
        }
    }

    /// Takes a level that is held for leaves that are not and would be too many to read now.
    fn wait_for_some(&self, runs: &mut [RunId]) {
        let mut read = 0;
        for id in runs {
            if self.held.contains_key(id) {
                continue;
            }
            let count = self.run(*id).map_or(0, |run| run.count);
            let levels = self.held.range((id.0, 0)..=(id.0, u16::MAX)).map(|(held, _)| *held);
            let held = levels.min_by_key(|held| held.1.abs_diff(id.1));
            match held.filter(|_| read + count > DRAFT_SPLATS) {
                Some(held) => *id = held,
                None => read += count,
            }
        }
    }

    /// Takes a coarser level for leaves of which a file is missing, and leaves out those that have
    /// none.
    fn replace_missing(&self, runs: &mut Vec<RunId>) {
        if self.missing.is_empty() && self.absent.is_empty() {
            return;
        }
        let readable = |(leaf, place): RunId| {
            let runs = &self.index.leaves[leaf as usize].runs;
            let is_there = |place: &usize| {
                let file = runs[*place].file;
                let waits = self.absent.contains(&file) && !self.held.contains_key(&(leaf, *place as u16));
                !self.missing.contains(&file) && !waits
            };
            let found = (usize::from(place)..runs.len()).find(is_there);
            found.map(|place| (leaf, place as u16))
        };
        *runs = runs.iter().filter_map(|id| readable(*id)).collect();
    }

    /// Drops runs of earlier cuts, those of the oldest first, until `new` fits.
    fn make_room(&mut self, backend: &mut AnyRenderer, new: &[RunId]) {
        let wanted: u64 =
            new.iter().filter_map(|id| self.run(*id)).map(|run| held_bytes(run.count, self.sh_degree)).sum();
        let mut old: Vec<(u64, RunId)> = self
            .held
            .iter()
            .filter(|(_, held)| held.used < self.clock)
            .map(|(id, held)| (held.used, *id))
            .collect();
        old.sort_unstable();
        for (_, id) in old {
            if self.bytes + wanted <= self.most {
                break;
            }
            self.drop_run(backend, id);
        }
    }

    fn drop_run(&mut self, backend: &mut AnyRenderer, id: RunId) {
        if let Some(held) = self.held.remove(&id) {
            self.bytes -= held.bytes;
            backend.unload(held.set);
        }
    }

    /// Reads runs and loads them. Returns false if a file turned out to be missing: its runs are
    /// not loaded.
    fn load(&mut self, backend: &mut AnyRenderer, new: &[RunId]) -> Result<bool> {
        let mut is_whole = true;
        // As many files at a time as are decoded at once.
        for some in self.by_file(new).chunks(backend.threads().max(1)) {
            let read: Vec<_> =
                backend.pool().install(|| some.par_iter().map(|(file, ids)| self.read(*file, ids)).collect());
            for ((file, ids), read) in some.iter().zip(read) {
                match self.or_missing(*file, read)? {
                    Some(runs) => {
                        for (id, splats) in ids.iter().zip(runs) {
                            self.insert(backend, *id, &splats)?;
                        }
                    }
                    None => is_whole = false,
                }
            }
        }
        Ok(is_whole)
    }

    /// Reads runs in their order: of a leaf whose file cannot be read, the next coarser level that
    /// can.
    ///
    /// # Errors
    /// [`Error::Format`] if a file cannot be read and damage is not left out.
    pub(crate) fn read_runs(&mut self, runs: &[RunId]) -> Result<Vec<(RunId, Splats)>> {
        let mut wanted = runs.to_vec();
        let mut read = BTreeMap::new();
        loop {
            self.replace_missing(&mut wanted);
            let new: Vec<RunId> = wanted.iter().copied().filter(|id| !read.contains_key(id)).collect();
            if new.is_empty() {
                return Ok(wanted.into_iter().filter_map(|id| Some((id, read.remove(&id)?))).collect());
            }
            for (file, ids) in self.by_file(&new) {
                let found = self.read(file, &ids);
                if let Some(runs) = self.or_missing(file, found)? {
                    read.extend(ids.into_iter().zip(runs));
                }
            }
        }
    }

    /// The runs of each file.
    fn by_file(&self, ids: &[RunId]) -> Vec<(usize, Vec<RunId>)> {
        let mut by_file: BTreeMap<usize, Vec<RunId>> = BTreeMap::new();
        for id in ids {
            if let Some(run) = self.run(*id) {
                by_file.entry(run.file).or_default().push(*id);
            }
        }
        by_file.into_iter().collect()
    }

    /// The splats that were read of a file; `None` where it cannot be read and damage is left out.
    fn or_missing(
        &mut self,
        file: usize,
        read: Result<FileRuns, FormatError>,
    ) -> Result<Option<Vec<Splats>>> {
        match read {
            Ok(FileRuns { splats, metadata }) => {
                let degrees = splats.iter().map(|splats| splats.sh_degree);
                self.sh_degree = degrees.fold(self.sh_degree, u8::max);
                self.metadata = std::mem::take(&mut self.metadata).or(metadata);
                Ok(Some(splats))
            }
            Err(error) if self.repairs => {
                self.missing.insert(file);
                self.warnings.push(format!(
                    "{error}; its splats are drawn at a coarser level, or left out where there is none"
                ));
                Ok(None)
            }
            Err(error) => Err(Error::from(error)),
        }
    }

    /// Reads runs of a file.
    fn read(&self, file: usize, ids: &[RunId]) -> Result<FileRuns, FormatError> {
        let opened = self.index.read_file(file)?;
        let runs = ids.iter().filter_map(|id| self.run(*id));
        let splats = runs.map(|run| Ok(self.ready(opened.splats(run.offset, run.count)?)));
        Ok(FileRuns {
            splats: splats.collect::<Result<_, FormatError>>()?,
            metadata: opened.metadata().clone(),
        })
    }

    /// Labels the sky, and removes what cannot be drawn.
    pub(crate) fn ready(&self, splats: Splats) -> Splats {
        let mut splats = if self.repairs { splats.repaired().0 } else { splats };
        for index in self.sky.indices(&splats) {
            splats.groups[index] = Group::Sky;
        }
        splats
    }

    fn insert(&mut self, backend: &mut AnyRenderer, id: RunId, splats: &Splats) -> Result<()> {
        let set = backend.load(splats)?;
        let bytes = held_bytes(splats.len() as u64, splats.sh_degree);
        self.bytes += bytes;
        let held = HeldRun { set, means: splats.means.as_slice().into(), bytes, used: self.clock };
        self.held.insert(id, held);
        Ok(())
    }

    /// Takes all splats out of the renderer.
    pub(crate) fn clear(&mut self, backend: &mut AnyRenderer) {
        for (_, held) in std::mem::take(&mut self.held) {
            backend.unload(held.set);
        }
        self.bytes = 0;
    }
}
