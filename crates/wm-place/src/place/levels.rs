//! Places in levels of detail: what frames draw of them, and what their weather is prepared with.
//!
//! Frames draw a cut of the levels, which depends on the camera and the budget alone. Weather is
//! prepared with fewer splats that are finest about where the cameras are, [`WeatherFocus`]: they
//! are the splats of [`crate::PreparedPlace::scene`]. A splat that is drawn has the attributes of
//! the nearest of those in its leaf.

use crate::levels::{
    BudgetShares, CoarseLeaves, CutBudget, DrawnPart, HeldLeaf, LevelBudget, LevelCut, LevelLooks,
    LevelStream, RunId, WeatherFocus, WeatherScene, nearest_of,
};
use crate::{Patience, Result};
use rayon::prelude::*;
use std::collections::{BTreeMap, HashMap};
use std::ops::Range;
use std::sync::Arc;
use wm_base::{FormatError, Problem, files};
use wm_render::{AnyRenderer, RenderBackend, SetId, bytes_of_set};
use wm_scene::levels::{LevelIndex, LevelLeaf};
use wm_scene::survey::{CapturedSky, SkyRegion, label_sky};
use wm_scene::{Camera, Rasterization, Scene, Splats};

/// Cameras of a shot by which is told what is hidden, at most.
const MOST_LOOKS: usize = 24;

/// The levels of a place.
pub(crate) struct PlaceLevels {
    pub(super) stream: LevelStream,
    shares: BudgetShares,
    /// The splats that are always drawn, and they in the renderer.
    pub(super) environment: Option<(Splats, SetId)>,
    /// The camera of the last cut.
    pub(super) camera: Option<Camera>,
    /// The runs of the cut of the shot; `None` where it is not known.
    pub(super) shot_cut: Option<Vec<RunId>>,
    /// The shot that all frames are of; else each frame has a cut of its own.
    pub(super) shot: Option<Shot>,
    /// All of it coarse, to tell what a camera sees.
    coarse: CoarseLeaves,
    rasterization: Rasterization,
    /// The place that the weather is prepared about; `None` for all of it alike.
    pub(super) focus: Option<WeatherFocus>,
    /// True while the splats for another focus have to be fetched.
    pub(super) weather_waits: bool,
    /// The sky of the capture as the survey of all of it found it: the light about a focus may tell
    /// another, for that focus alone.
    pub(super) captured_sky: CapturedSky,
    /// The leaves of the weather's splats, by number, and where they are in them.
    parts: HashMap<u32, (RunId, Range<usize>)>,
    /// Positions of the weather's splats.
    points: Arc<[[f32; 3]]>,
    /// The runs that are held for the picture, by leaf, and what is drawn of each.
    pub(super) drawn: Vec<(RunId, DrawnPart)>,
    /// The weather's splats for those of runs.
    choices: BTreeMap<RunId, Arc<[u32]>>,
}

/// Cameras whose frames share one cut of the levels.
pub(super) struct Shot {
    pub cameras: Vec<Camera>,
    pub focus: WeatherFocus,
}

/// A set that a frame draws of a place in levels, and the weather's splat for each of its own.
pub(super) struct DrawnSet {
    pub set: SetId,
    /// Empty where nobody asked.
    pub chosen: Arc<[u32]>,
    /// The splats of it that the picture shows.
    pub part: DrawnPart,
}

/// The splats of a picture of a scene in levels, without those that are always drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LevelCounts {
    /// The splats that are drawn.
    pub drawn: u64,
    /// The splats that the renderer holds for the picture.
    pub held: u64,
}

impl PlaceLevels {
    /// Opens a scene in levels. Returns the scene that it is surveyed with: all of it at one level.
    pub(super) fn open(
        backend: &mut AnyRenderer,
        index: LevelIndex,
        budget: &LevelBudget,
        repairs: bool,
    ) -> Result<(Self, Scene)> {
        let index = Arc::new(index);
        let mut stream = LevelStream::new(Arc::clone(&index), repairs);
        let base = runs_at(&index, index.level_within(budget.shares(0).weather_splats));
        let coarsest = runs_at(&index, index.levels - 1);
        // All that has to be fetched for it is known at once.
        let always = index.lacking_environment();
        always.iter().for_each(|path| files::want(path));
        let is_there = [always.is_empty(), stream.are_there(&coarsest), stream.are_there(&base)];
        if is_there.contains(&false) {
            let problem = Problem::Value("files of its levels are not fetched yet".into());
            return Err(FormatError::whole(index.path(), problem).into());
        }
        let mut environment = index.read_environment()?.map(|scene| scene.splats);
        if repairs && let Some(splats) = &mut environment {
            *splats = std::mem::take(splats).repaired().0;
        }
        let WeatherScene { mut splats, parts } = stream.weather_scene(&base, environment.as_ref())?;
        let sky = if environment.is_some() { SkyRegion::None } else { SkyRegion::of(&splats) };
        label_sky(&mut splats);
        let WeatherScene { splats: outline, parts: leaves } = stream.weather_scene(&coarsest, None)?;
        let ends = leaves.into_iter().map(|((leaf, _), part)| (leaf as usize, part.end as u64)).collect();
        let coarse = CoarseLeaves { set: backend.load(&outline)?, ends };
        let shares = budget.shares(stream.sh_degree);
        if let Some(least) = budget.exceeded_by(&index, stream.sh_degree) {
            let [given, least] = [budget.memory, least].map(|bytes| bytes >> 20);
            stream.warnings.push(format!(
                "{given} MiB of memory are too little: the coarsest level takes some {least} MiB"
            ));
        }
        let outline = bytes_of_set(outline.len(), outline.sh_degree);
        (stream.sky, stream.most) = (sky, shares.held_bytes.saturating_sub(outline));
        let environment = match environment {
            Some(splats) => {
                let set = backend.load(&splats)?;
                Some((splats, set))
            }
            None => None,
        };
        let metadata = index.metadata.clone().or(stream.metadata.clone());
        let mut levels = Self {
            stream,
            shares,
            environment,
            camera: None,
            shot_cut: None,
            shot: None,
            coarse,
            rasterization: metadata.rasterization.unwrap_or_default(),
            focus: None,
            weather_waits: false,
            captured_sky: CapturedSky::default(),
            parts: HashMap::new(),
            points: Arc::default(),
            drawn: Vec::new(),
            choices: BTreeMap::new(),
        };
        levels.take_parts(parts, &splats);
        Ok((levels, Scene { splats, metadata, ..Scene::default() }))
    }

    /// Takes the leaves of the weather's splats.
    fn take_parts(&mut self, parts: Vec<(RunId, Range<usize>)>, splats: &Splats) {
        self.points = splats.means.as_slice().into();
        self.parts = parts.into_iter().map(|(id, part)| (id.0, (id, part))).collect();
        self.choices.clear();
    }

    /// The weather's splats about a focus; `None` if files have to be fetched first, which are
    /// noted.
    pub(super) fn weather_scene(
        &mut self,
        focus: &WeatherFocus,
        metres_per_unit: f64,
    ) -> Result<Option<Splats>> {
        let budget = CutBudget::of(self.shares.weather_splats);
        let cameras = focus.cameras(metres_per_unit);
        let cut = LevelCut::of(&self.stream.index, &cameras, &budget);
        let always = self.environment.as_ref().map(|(splats, _)| splats);
        let runs = runs_of(&cut);
        self.stream.look_from(&cameras);
        self.weather_waits = !self.stream.are_there(&runs);
        if self.weather_waits {
            return Ok(None);
        }
        let WeatherScene { splats, parts } = self.stream.weather_scene(&runs, always)?;
        self.take_parts(parts, &splats);
        self.focus = Some(*focus);
        Ok(Some(splats))
    }

    /// Makes the renderer hold what a camera sees, and finds what of it is drawn.
    pub(super) fn cut_for(
        &mut self,
        backend: &mut AnyRenderer,
        camera: &Camera,
        patience: Patience,
    ) -> Result<()> {
        if self.camera == Some(*camera) {
            return Ok(());
        }
        let index = Arc::clone(&self.stream.index);
        let cameras = self.shot.as_ref().map_or(std::slice::from_ref(camera), |shot| &shot.cameras).to_vec();
        self.stream.begin_frame(&cameras);
        if patience == Patience::Draft {
            // It may spend splats on what is hidden.
            let cut = LevelCut::of(&index, &cameras, &CutBudget::of(self.shares.frame_splats));
            let held = self.stream.hold(backend, &runs_of(&cut), patience)?;
            self.drawn = held.into_iter().map(|id| (id, DrawnPart::All)).collect();
            self.camera = None;
            return Ok(());
        }
        let looks = LevelLooks {
            index: &index,
            coarse: &self.coarse,
            cameras: &cameras,
            most: MOST_LOOKS,
            tries_several: self.shot.is_some(),
            budget: CutBudget { splats: self.shares.frame_splats, held: self.shares.cut_splats },
            rasterization: self.rasterization,
        };
        let stream = &mut self.stream;
        let known = self.shot_cut.take().filter(|_| self.shot.is_some());
        let wanted = match known {
            Some(runs) => runs,
            None => runs_of(&looks.cut(backend, |backend, cut| {
                let runs = stream.hold(backend, &runs_of(cut), patience)?;
                Ok(held_leaves(stream, &runs))
            })?),
        };
        let runs = stream.hold(backend, &wanted, patience)?;
        let parts = looks.drawn(camera, &held_leaves(stream, &runs), backend)?;
        self.drawn = runs.into_iter().zip(parts).collect();
        // Looks at what was not all there tell another cut.
        let is_whole = !self.stream.waits;
        self.shot_cut = (self.shot.is_some() && is_whole).then_some(wanted);
        self.camera = is_whole.then_some(*camera);
        Ok(())
    }

    /// The sets of the last cut; with the weather's splats for theirs if `is_changed`.
    pub(super) fn sets(&mut self, pool: &rayon::ThreadPool, is_changed: bool) -> Vec<DrawnSet> {
        if is_changed {
            self.find_choices(pool);
        }
        let none: Arc<[u32]> = Arc::default();
        let chosen = |id: &RunId| self.choices.get(id).filter(|_| is_changed).unwrap_or(&none);
        let held = |(id, part): &(RunId, DrawnPart)| {
            let (set, part) = (self.stream.get(*id)?.set, part.clone());
            Some(DrawnSet { set, chosen: Arc::clone(chosen(id)), part })
        };
        let mut sets: Vec<DrawnSet> = self.drawn.iter().filter_map(held).collect();
        if let Some((splats, set)) = &self.environment {
            let (count, all) = (splats.len() as u32, self.points.len() as u32);
            let chosen = if is_changed { (all - count..all).collect() } else { none };
            sets.push(DrawnSet { set: *set, chosen, part: DrawnPart::All });
        }
        sets
    }

    /// Finds the weather's splats for those that are drawn.
    fn find_choices(&mut self, pool: &rayon::ThreadPool) {
        let stream = &self.stream;
        self.choices.retain(|id, _| stream.get(*id).is_some());
        let new: Vec<RunId> =
            self.drawn.iter().map(|(id, _)| *id).filter(|id| !self.choices.contains_key(id)).collect();
        let choice = |id: &RunId| -> Option<(RunId, Arc<[u32]>)> {
            let held = self.stream.get(*id)?;
            let first_of_all = Arc::from(vec![0; held.means.len()]);
            let Some((of, part)) = self.parts.get(&id.0) else { return Some((*id, first_of_all)) };
            let chosen = if of == id && part.len() == held.means.len() {
                part.clone().map(|index| index as u32).collect()
            } else {
                nearest_of(&held.means, &self.points[part.clone()], part.start).into()
            };
            Some((*id, chosen))
        };
        let found: Vec<(RunId, Arc<[u32]>)> = pool.install(|| new.par_iter().filter_map(choice).collect());
        self.choices.extend(found);
    }

    /// Takes all splats out of the renderer.
    pub(super) fn clear(&mut self, backend: &mut AnyRenderer) {
        self.stream.clear(backend);
        backend.unload(self.coarse.set);
        if let Some((_, set)) = self.environment.take() {
            backend.unload(set);
        }
        (self.camera, self.shot_cut, self.drawn) = (None, None, Vec::new());
    }
}

/// The runs of all leaves at one level; of a leaf that lacks it, the finest coarser one, else the
/// coarsest.
pub(super) fn runs_at(index: &LevelIndex, level: u32) -> Vec<RunId> {
    let run = |(leaf, of): (u32, &LevelLeaf)| Some((leaf, of.position_at(level)? as u16));
    (0u32..).zip(&index.leaves).filter_map(run).collect()
}

/// The runs that a stream holds, as looks take them.
fn held_leaves(stream: &LevelStream, runs: &[RunId]) -> Vec<HeldLeaf> {
    let held = |id: &RunId| {
        let run = stream.get(*id)?;
        Some(HeldLeaf { leaf: id.0 as usize, set: run.set, splats: run.means.len() })
    };
    runs.iter().filter_map(held).collect()
}

/// The runs of a cut.
fn runs_of(cut: &LevelCut) -> Vec<RunId> {
    (0u32..).zip(&cut.positions).map(|(leaf, position)| (leaf, *position)).collect()
}
