//! Makes the blocks of a plan: renders, scans and writes.

use super::clips::{BatchClips, BlockPart, PlannedBlock, PlannedClip};
use super::places::{OpenPlace, OpenPlaces};
use super::plan::{BatchPlan, PlanPathKind, PlanScene};
use super::set::{SetWorld, clip_of, place_of, readings_of, rig_of, set_of};
use super::shots::{ActivePart, ReadingBuffer, ShotMemory, Shots};
use super::store::{BatchStore, BlockFiles, BlockMarker, MarkedClip, scene_digest_of};
use super::writers::{BlockWriters, WriterTarget};
use crate::{SensorInfoKind, SetInfo};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use wm_place::levels::shot_cameras;
use wm_place::rig::Rig;
use wm_place::sequence::render_and_write;
use wm_place::view::ViewOptions;
use wm_place::{CameraMotion, Error, Layers, PlaceOptions, Progress, Renderer, Result};
use wm_scene::formats::{ReadOptions, read_scene};
use wm_scene::{Camera, SceneView};

/// A plan that is being carried out.
pub struct BatchRun {
    /// The plan.
    pub plan: BatchPlan,
    /// The clips of the plan.
    pub clips: BatchClips,
    /// The sensors of the plan.
    pub rig: Rig,
    /// The set as data sets describe it: sensors, rates and labels.
    pub set: SetInfo,
    layers: Layers,
    pub(super) renderer: Renderer,
    /// The folder for prepared assets, by scene; `None` keeps none.
    pub(super) assets: fn(&Path) -> Option<PathBuf>,
    pub(super) places: OpenPlaces,
    /// The cameras of the clip that was sampled last.
    pub(super) sampled: ShotMemory,
    pub(super) warnings: Vec<String>,
    /// The time that was spent with writing, of all.
    pub written: WriteShare,
}

/// The time of writing beside that of rendering.
#[derive(Clone, Copy, Debug, Default)]
pub struct WriteShare {
    /// Wall time of the writer's thread while it worked.
    pub writing: Duration,
    /// Wall time of all.
    pub all: Duration,
    /// Bytes that were written.
    pub bytes: u64,
    /// Frames that were made.
    pub frames: u64,
}

impl BatchRun {
    /// Prepares a plan: counts its clips and checks that its layouts can hold it. `assets` says
    /// where what takes long to find of a scene is kept.
    ///
    /// # Errors
    /// [`Error::Unsupported`] with what a layout cannot hold; the errors of scenes whose photos are
    /// counted.
    pub fn new(plan: BatchPlan, renderer: Renderer, assets: fn(&Path) -> Option<PathBuf>) -> Result<Self> {
        let clips = BatchClips::of(&plan, &mut |scene| views_of(&plan, scene))?;
        let rig = rig_of(&plan, &clips)?;
        let set = set_of(&plan, &rig);
        for layout in &plan.layouts {
            if let Some((sensor, kind)) = set.sensors.iter().find_map(|sensor| match sensor.kind {
                SensorInfoKind::Other { kind } => Some((sensor, kind)),
                _ => None,
            }) {
                return Err(Error::Unsupported(format!(
                    "layout {}: it has no room for sensor \"{}\", of kind {kind}; leave out one of the two",
                    layout.name, sensor.name
                )));
            }
            (layout.check)(&set)?;
            if clips.cameras.len() > 1 && layout.needs_every_sensor {
                return Err(Error::Unsupported(format!(
                    "layout {}: the photos have {} different cameras, and it has one reading per camera and frame: give size and \
                     fov in [rig]",
                    layout.name,
                    clips.cameras.len()
                )));
            }
        }
        let layers = plan.layers();
        for sensor in &rig.sensors {
            sensor.device.check(&wm_weather::Weather::clear(), layers)?;
        }
        Ok(Self {
            plan,
            clips,
            rig,
            set,
            layers,
            renderer,
            assets,
            places: OpenPlaces::default(),
            sampled: ShotMemory::default(),
            warnings: Vec::new(),
            written: WriteShare::default(),
        })
    }

    /// The renderer.
    #[must_use]
    pub fn renderer(&self) -> &Renderer {
        &self.renderer
    }

    /// The warnings since the last call.
    pub fn take_warnings(&mut self) -> Vec<String> {
        for open in self.places.iter_mut() {
            self.warnings.append(&mut open.place.take_warnings());
        }
        std::mem::take(&mut self.warnings)
    }

    /// Makes a block and marks it as done. `progress` is told of every frame.
    ///
    /// # Errors
    /// [`Error::Stopped`] if `progress` asked to stop: nothing of the block is in place then.
    /// Errors of the scene, the weather or the disk.
    pub fn make(
        &mut self,
        store: &BatchStore,
        block: &PlannedBlock,
        progress: &mut dyn Progress,
    ) -> Result<()> {
        let started = Instant::now();
        let mut files = store.begin(block.number)?;
        let parts = self.clips.parts(&block.frames);
        let clips = self.draw(&parts, &mut files, progress)?;
        let open = self.places.last().ok_or(Error::Stopped)?;
        let marker = BlockMarker {
            block: block.number,
            plan: self.plan.digest.clone(),
            renderer: self.renderer.backend().arithmetic(),
            scene: self.plan.scenes[block.scene].name.clone(),
            scene_sha256: open.digest.clone(),
            clips,
            files: Vec::new(),
        };
        self.written.bytes += files.bytes();
        store.finish(files, marker)?;
        self.written.all += started.elapsed();
        self.written.frames += block.frames.end - block.frames.start;
        Ok(())
    }

    /// Makes single frames without marking anything: the files of a block that has them alone.
    ///
    /// # Errors
    /// As [`Self::make`].
    pub fn make_frames(
        &mut self,
        store: &BatchStore,
        frames: &Range<u64>,
        progress: &mut dyn Progress,
    ) -> Result<()> {
        let mut files = store.begin(self.clips.blocks())?;
        let parts = self.clips.parts(frames);
        self.draw(&parts, &mut files, progress)?;
        store.place(files).map(drop)
    }

    /// A part of a clip, with its scene open, and at most `places` scenes open then.
    pub(super) fn part(&mut self, part: &BlockPart, places: usize) -> Result<ActivePart> {
        let clip = self.clips.clip(&self.plan, part.clip)?;
        self.open(clip.scene, places)?;
        let motion = self.motion(&clip)?;
        let only = self.clips.way(&clip).sensor;
        let open = self.places.last().ok_or(Error::Stopped)?;
        let world = open.world;
        let readings = readings_of(&self.plan, &self.rig, part, only, &|time| world.pose(&motion, time));
        let place = place_of(&self.plan.scenes[clip.scene].name, &open.place);
        let info = clip_of(&self.plan, &clip, place);
        let base = CameraMotion::Delayed { base: Box::new(motion), by: clip.weather.at };
        let mut active = ActivePart { part: part.clone(), clip, info, base, readings, shot: Vec::new() };
        // A still shares what is prepared with the others of its place.
        if open.place.has_levels() && self.plan.frames > 1 {
            active.shot = self.shot(&active, open.place.site().metres_per_unit);
        }
        Ok(active)
    }

    /// Cameras over the whole clip of a part, whichever of its frames are made: what they see is
    /// drawn from one cut of the levels.
    fn shot(&self, active: &ActivePart, metres_per_unit: f64) -> Vec<Camera> {
        let time = |frame: u32| active.clip.weather.at + f64::from(frame) / self.plan.frame_rate;
        let only = self.clips.way(&active.clip).sensor;
        let shot = |number: usize| {
            let sensor = &self.rig.sensors[number];
            let camera = sensor.device.camera().filter(|_| only.is_none_or(|only| only == number))?;
            let motion = sensor.motion(&active.base, metres_per_unit);
            let has_lens = camera.model.lens.is_some();
            Some(shot_cameras(self.plan.frames, |frame| motion.camera(time(frame)), has_lens))
        };
        (0..self.rig.sensors.len()).filter_map(shot).flatten().collect()
    }

    /// Draws the frames of some parts of clips of one scene.
    fn draw(
        &mut self,
        parts: &[BlockPart],
        files: &mut BlockFiles,
        progress: &mut dyn Progress,
    ) -> Result<Vec<MarkedClip>> {
        let parts: Vec<ActivePart> = parts.iter().map(|part| self.part(part, 1)).collect::<Result<_>>()?;
        let open = self.places.last_mut().ok_or(Error::Stopped)?;
        let steps: Vec<(usize, usize)> = (0..parts.len())
            .flat_map(|part| (0..parts[part].readings.len()).map(move |index| (part, index)))
            .collect();
        let mut memory = ShotMemory::default();
        let mut shots = Shots::new(&self.rig, self.layers, self.plan.seed, &mut memory);
        let target =
            WriterTarget { plan: &self.plan, set: &self.set, rig: &self.rig, clips: self.clips.clips() };
        let mut writers = BlockWriters::new(target, &parts, files);
        let (renderer, place) = (&mut self.renderer, &mut open.place);
        let numbers: Vec<u32> = (0..steps.len() as u32).collect();
        let mut render = |number: u32, buffer: &mut ReadingBuffer| -> Result<()> {
            let (part, index) = steps[number as usize];
            shots.take(renderer, place, part, &parts[part], index, buffer)
        };
        let mut write = |number: u32, buffer: &ReadingBuffer| -> Result<()> {
            let (part, index) = steps[number as usize];
            writers.write(part, index, buffer)
        };
        let frame_of = |number: usize| {
            steps.get(number).map(|(part, index)| (*part, parts[*part].readings[*index].frame))
        };
        let mut counted = CountedFrames { progress, frame_of: &frame_of, done: 0 };
        let made = render_and_write(&numbers, &mut render, &mut write, &mut counted)?;
        if (made as usize) < steps.len() {
            return Err(Error::Stopped);
        }
        self.written.writing += writers.finish()?;
        let marked = |active: ActivePart| {
            let weather = active.clip.weather;
            let (at, variables) = (weather.at, weather.variables);
            MarkedClip::new(active.info, at, variables, active.readings)
        };
        Ok(parts.into_iter().map(marked).collect())
    }
}

impl BatchRun {
    /// Makes a scene the last of the open ones. At most `most` stay open: the scenes that have been
    /// unused for longest are closed.
    fn open(&mut self, scene: usize, most: usize) -> Result<()> {
        let is_open = self.places.touch(scene);
        // Closed first: two scenes at once may not fit.
        let kept = most.max(1) - usize::from(!is_open);
        while let Some(mut closed) = self.places.pop_beyond(kept) {
            self.warnings.append(&mut closed.place.take_warnings());
            self.renderer.unload(closed.place)?;
        }
        if is_open {
            return Ok(());
        }
        let planned = &self.plan.scenes[scene];
        let digest = scene_digest_of(&planned.file)?;
        let options = PlaceOptions {
            facts: planned.facts.clone(),
            assets: (self.assets)(&planned.file),
            ..PlaceOptions::default()
        };
        let mut place = self.renderer.open(&planned.file, &options, &planned.budget)?;
        let world = SetWorld::of(&place);
        let warnings = place.take_warnings();
        self.warnings.extend(warnings.into_iter().map(|warning| format!("{}: {warning}", planned.name)));
        self.places.push(OpenPlace { scene, digest, place, world, motions: Vec::new() });
        Ok(())
    }

    /// Returns the motion of the rig along the way of a clip, from time 0 on.
    fn motion(&mut self, clip: &PlannedClip) -> Result<CameraMotion> {
        let way = self.clips.way(clip).clone();
        let open = self.places.last_mut().ok_or(Error::Stopped)?;
        if let Some(Some(motion)) = open.motions.get(clip.way) {
            return Ok(motion.clone());
        }
        let camera = self.rig.sensors.iter().find_map(|sensor| sensor.device.camera());
        let size = camera.map(|camera| (camera.intrinsics.width, camera.intrinsics.height));
        let options = ViewOptions { size, ..ViewOptions::default() };
        let OpenPlace { place, .. } = open;
        let seconds = f64::from(self.plan.frames) / self.plan.frame_rate;
        let motion = match (&self.plan.paths[way.path].kind, way.photo) {
            (PlanPathKind::Motion(spec), _) => {
                let mut chosen = Vec::new();
                let mut say = |text: String| chosen.push(format!("path \"{}\" begins at {text}", way.name));
                let motion = spec.motion(&mut self.renderer, place, &options, &mut say)?;
                self.warnings.append(&mut chosen);
                motion
            }
            (PlanPathKind::Photos { .. }, photo) => {
                let view = photo.and_then(|photo| place.scene().views.get(photo)).map(|view| view.camera);
                let view =
                    view.ok_or_else(|| Error::Unsupported(format!("{}: a photo is gone", self.plan.file)))?;
                CameraMotion::from(view)
            }
        };
        let motion = motion.driven(seconds, place.site().metres_per_unit)?;
        if open.motions.len() <= clip.way {
            open.motions.resize(clip.way + 1, None);
        }
        open.motions[clip.way] = Some(motion.clone());
        Ok(motion)
    }
}

/// The photos of a scene of a plan.
fn views_of(plan: &BatchPlan, scene: usize) -> Result<Vec<SceneView>> {
    let PlanScene { file, budget, .. } = &plan.scenes[scene];
    // Scenes in levels have none, and may be larger than the memory.
    match budget.levels_of(file)? {
        Some(_) => Ok(Vec::new()),
        None => Ok(read_scene(file, &ReadOptions::default())?.views),
    }
}

/// Progress of readings as progress of frames.
struct CountedFrames<'a> {
    progress: &'a mut dyn Progress,
    frame_of: &'a dyn Fn(usize) -> Option<(usize, u32)>,
    done: usize,
}

impl Progress for CountedFrames<'_> {
    fn advance(&mut self, steps: u64) {
        for _ in 0..steps {
            let own = (self.frame_of)(self.done);
            self.done += 1;
            if own != (self.frame_of)(self.done) {
                self.progress.advance(1);
            }
        }
    }

    fn is_stopped(&mut self) -> bool {
        self.progress.is_stopped()
    }
}
