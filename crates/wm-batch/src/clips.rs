//! The clips, frames and blocks of a plan, each found by its number.
//!
//! Clips are in the order of scenes, then of weathers, then of paths, so that what a weather needs
//! of a place is made once. Frames are in the order of clips. A block is a run of frames of one
//! scene.

use super::condition::condition_of;
use super::plan::{BatchPlan, MAX_FRAMES, PlanPathKind, PlanRig, slug};
use super::splits::split_of;
use super::weathers::{PlannedWeather, SamplePlace, seeded};
use std::ops::Range;
use wm_place::{Error, Result};
use wm_scene::{Camera, SceneView};

/// Seconds between the end of a clip and the start of the next.
const CLIP_GAP_S: f64 = 10.0;
/// Most cameras with intrinsics of their own that a set of photos' cameras may have.
const MAX_CAMERAS: usize = 64;

/// The clips of a plan, once the photos of its scenes are counted.
#[derive(Clone, Debug)]
pub struct BatchClips {
    scenes: Vec<SceneClips>,
    /// Weathers of each path.
    weathers: u64,
    /// The intrinsics of photos' cameras, one for each sensor; empty with a rig.
    pub(super) cameras: Vec<Camera>,
    frames: u64,
    block: u64,
}

/// The clips of one scene.
#[derive(Clone, Debug)]
struct SceneClips {
    ways: Vec<ClipWay>,
    /// The number of its first clip.
    first: u64,
    /// The number of its first block.
    first_block: u64,
}

/// The way of the rig in a clip.
#[derive(Clone, Debug)]
pub(super) struct ClipWay {
    /// Index into the paths of the plan.
    pub(crate) path: usize,
    /// The photo in whose place the rig stands.
    pub(crate) photo: Option<usize>,
    /// The name of the way.
    pub(crate) name: String,
    /// The only sensor; `None` for all.
    pub(crate) sensor: Option<usize>,
}

/// A clip of a plan.
#[derive(Clone, Debug)]
pub struct PlannedClip {
    /// The number of the clip.
    pub number: u64,
    /// The name of the clip, unique in the set.
    pub name: String,
    /// Index into the scenes of the plan.
    pub(crate) scene: usize,
    /// The number of its way in its scene.
    pub(crate) way: usize,
    /// The part of the set that it belongs to.
    pub split: String,
    /// Nanoseconds since 1970.
    pub start: i64,
    /// The weather, with seeds of its own.
    pub weather: PlannedWeather,
}

/// A run of frames of one scene, made in one go.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PlannedBlock {
    /// The number of the block.
    pub number: u64,
    /// Index into the scenes of the plan.
    pub scene: usize,
    /// The frames of the block.
    pub frames: Range<u64>,
}

/// The frames of one clip in a block.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct BlockPart {
    /// The clip.
    pub(crate) clip: u64,
    /// The frames of the clip.
    pub(crate) frames: Range<u32>,
    /// The number of the block among those of the clip.
    pub(crate) number: u32,
}

impl BatchClips {
    /// Counts the clips. `views` gives the photos of a scene, and is called where a path needs
    /// them.
    ///
    /// # Errors
    /// Errors of `views`; [`Error::Unsupported`] if there are no photos, too many cameras or too
    /// many frames.
    pub fn of(plan: &BatchPlan, views: &mut dyn FnMut(usize) -> Result<Vec<SceneView>>) -> Result<Self> {
        let fault = |says: String| Error::Unsupported(format!("{}: {says}", plan.file));
        let weathers: u64 = plan.weathers.iter().map(super::weathers::WeatherSource::count).sum();
        let (mut scenes, mut cameras, mut first, mut first_block) =
            (Vec::new(), Vec::<Camera>::new(), 0u64, 0u64);
        let (frames, block) = (u64::from(plan.frames), u64::from(plan.block));
        for (index, scene) in plan.scenes.iter().enumerate() {
            let mut ways: Vec<ClipWay> = Vec::new();
            let own = |name: &Option<String>| name.as_ref().is_none_or(|name| *name == scene.name);
            for (number, path) in plan.paths.iter().enumerate().filter(|(_, path)| own(&path.scene)) {
                match path.kind {
                    PlanPathKind::Motion(_) => {
                        ways.push(ClipWay {
                            path: number,
                            photo: None,
                            name: path.name.clone(),
                            sensor: None,
                        });
                    }
                    PlanPathKind::Photos { every } => {
                        let views = views(index)?;
                        if views.is_empty() {
                            let says = format!(
                                "path \"{}\": scene \"{}\" has no cameras of photos",
                                path.name, scene.name
                            );
                            return Err(fault(says));
                        }
                        for (photo, view) in views.iter().enumerate().step_by(every as usize) {
                            let stem =
                                view.name.rsplit_once('.').map_or(view.name.as_str(), |(stem, _)| stem);
                            let sensor = match plan.rig {
                                PlanRig::Photos => Some(sensor_of(&mut cameras, &view.camera)),
                                _ => None,
                            };
                            let file = stem.rsplit('/').next().unwrap_or(stem);
                            let name = format!("{}-{}", path.name, slug(file));
                            ways.push(ClipWay { path: number, photo: Some(photo), name, sensor });
                        }
                    }
                }
            }
            let clips = weathers
                .checked_mul(ways.len() as u64)
                .filter(|clips| clips.checked_mul(frames).is_some_and(|frames| frames <= MAX_FRAMES));
            let Some(clips) = clips else {
                return Err(fault(format!("more than {MAX_FRAMES} frames: split the plan")));
            };
            scenes.push(SceneClips { ways, first, first_block });
            first += clips;
            first_block += (clips * frames).div_ceil(block);
        }
        if first * frames > MAX_FRAMES {
            return Err(fault(format!(
                "{} frames: {MAX_FRAMES} are the most; split the plan",
                first * frames
            )));
        }
        if cameras.len() > MAX_CAMERAS {
            let says =
                format!("the photos have {} different cameras: give size and fov in [rig]", cameras.len());
            return Err(fault(says));
        }
        if cameras.len() < 2 {
            // All photos have the one sensor.
            scenes.iter_mut().flat_map(|scene| &mut scene.ways).for_each(|way| way.sensor = None);
        }
        Ok(Self { scenes, weathers, cameras, frames, block })
    }

    /// The number of clips.
    #[must_use]
    pub fn clips(&self) -> u64 {
        self.scenes.iter().map(|scene| scene.ways.len() as u64 * self.weathers).sum()
    }

    /// The number of frames.
    #[must_use]
    pub fn frames(&self) -> u64 {
        self.clips() * self.frames
    }

    /// The number of blocks.
    #[must_use]
    pub fn blocks(&self) -> u64 {
        let last = self.scenes.last();
        last.map_or(0, |scene| {
            scene.first_block + (scene.ways.len() as u64 * self.weathers * self.frames).div_ceil(self.block)
        })
    }

    /// The blocks of shard `index` of `count`: a run of them, so that a shard loads few scenes.
    #[must_use]
    pub fn shard(&self, index: u64, count: u64) -> Range<u64> {
        let at =
            |index: u64| (u128::from(self.blocks()) * u128::from(index) / u128::from(count.max(1))) as u64;
        at(index)..at(index + 1)
    }

    /// The block of a number.
    #[must_use]
    pub fn block(&self, number: u64) -> PlannedBlock {
        let scene = self.scenes.partition_point(|scene| scene.first_block <= number) - 1;
        let own = &self.scenes[scene];
        let first = own.first * self.frames;
        let end = first + own.ways.len() as u64 * self.weathers * self.frames;
        let begin = first + (number - own.first_block) * self.block;
        PlannedBlock { number, scene, frames: begin..(begin + self.block).min(end) }
    }

    /// The clips of a run of frames of one scene.
    pub(crate) fn parts(&self, frames: &Range<u64>) -> Vec<BlockPart> {
        let mut parts = Vec::new();
        let mut at = frames.start;
        while at < frames.end {
            let clip = at / self.frames;
            let first = clip * self.frames;
            let end = (first + self.frames).min(frames.end);
            let scene = self.scenes[self.scene_of(clip)].first * self.frames;
            let number = ((at - scene) / self.block - (first - scene) / self.block) as u32;
            parts.push(BlockPart { clip, frames: (at - first) as u32..(end - first) as u32, number });
            at = end;
        }
        parts
    }

    /// Index of the scene of a frame.
    #[must_use]
    pub fn scene_of_frame(&self, frame: u64) -> usize {
        self.scene_of(frame / self.frames)
    }

    fn scene_of(&self, clip: u64) -> usize {
        self.scenes.partition_point(|scene| scene.first <= clip) - 1
    }

    /// The only sensor of a frame; `None` for all.
    pub(super) fn only_sensor(&self, frame: u64) -> Option<usize> {
        let clip = frame / self.frames;
        let own = &self.scenes[self.scene_of(clip)];
        own.ways[((clip - own.first) % own.ways.len() as u64) as usize].sensor
    }

    pub(super) fn way(&self, clip: &PlannedClip) -> &ClipWay {
        &self.scenes[clip.scene].ways[clip.way]
    }

    /// The clip of a number, which must be below [`Self::clips`].
    ///
    /// # Errors
    /// [`Error::Unsupported`] if a sample gives a parameter a value that it does not take beside
    /// others.
    pub fn clip(&self, plan: &BatchPlan, number: u64) -> Result<PlannedClip> {
        let scene = self.scene_of(number);
        let own = &self.scenes[scene];
        let ways = own.ways.len() as u64;
        let (mut weather, way) = ((number - own.first) / ways, (number - own.first) % ways);
        let fault = |key: String, says: String| {
            Error::Unsupported(format!("{}: clip {number}: {key}: {says}", plan.file))
        };
        let mut entry = 0;
        while weather >= plan.weathers[entry].count() {
            weather -= plan.weathers[entry].count();
            entry += 1;
        }
        let source = &plan.weathers[entry];
        // Samples are counted over all scenes and paths, and not over the times at which their
        // clips begin.
        let own_samples = source.count() / source.times();
        let before: u64 = self.scenes[..scene].iter().map(|scene| scene.ways.len() as u64).sum();
        let all: u64 = self.scenes.iter().map(|scene| scene.ways.len() as u64).sum();
        let place = SamplePlace {
            seed: plan.seed ^ (entry as u64) << 48,
            index: before * own_samples + weather / source.times() * ways + way,
            count: all * own_samples,
        };
        let mut planned = source.weather(weather, place).map_err(|(key, says)| fault(key, says))?;
        planned.weather =
            seeded(planned.weather, plan.seed, number).map_err(|(key, says)| fault(key, says))?;
        if planned.weather.name.is_empty() || planned.weather.name == "clear" || source.is_sampled() {
            planned.weather.name = condition_of(&planned).name().into();
            planned.weather.about = format!("Weather {weather} of the plan {}", plan.name);
        }
        let name = format!(
            "{number:06}-{}-{}-{}",
            plan.scenes[scene].name,
            own.ways[way as usize].name,
            slug(&planned.weather.name)
        );
        let seconds = (self.frames as f64 / plan.frame_rate + CLIP_GAP_S).ceil();
        let start = (plan.start as f64 + number as f64 * seconds) as i64 * 1_000_000_000;
        Ok(PlannedClip {
            number,
            name,
            scene,
            way: way as usize,
            split: plan
                .splits
                .get(split_of(plan, number))
                .map_or_else(|| "train".into(), |(name, _)| name.clone()),
            start,
            weather: planned,
        })
    }
}

/// The number of the sensor with the intrinsics of a camera.
fn sensor_of(cameras: &mut Vec<Camera>, camera: &Camera) -> usize {
    let numbers = |camera: &Camera| (camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy);
    cameras.iter().position(|known| numbers(known) == numbers(camera)).unwrap_or_else(|| {
        cameras.push(*camera);
        cameras.len() - 1
    })
}
