//! Readings of the sensors of a plan: pictures, sweeps and detections.

use super::clips::{BlockPart, PlannedClip};
use super::set::{detections_of, points_of};
use super::weathers::PlannedWeather;
use crate::{ClipInfo, DatasetDetection, DatasetPoint, ReadingInfo};
use std::collections::VecDeque;
use wm_base::random::bits;
use wm_image::PictureSize;
use wm_image::color::{Dither, quantize_rgb8};
use wm_place::CameraMotion;
use wm_place::camera_model::{CameraModel, SensorCamera};
use wm_place::lidar::{LidarSweep, ScanOptions};
use wm_place::radar::{RadarScanOptions, RadarSweep};
use wm_place::rig::{Rig, RigDevice, RigSensor};
use wm_place::{
    Error, FrameRequest, Layers, NextFrame, Picture, PictureLayer, PreparedPlace, Renderer, Result,
};
use wm_scene::Camera;
use wm_weather::Weather;

/// A part of a clip while it is made.
pub(crate) struct ActivePart {
    /// The part.
    pub(crate) part: BlockPart,
    /// The clip.
    pub(crate) clip: PlannedClip,
    /// The clip as data sets describe it.
    pub(crate) info: ClipInfo,
    /// The motion of the rig, at times of the weather.
    pub(crate) base: CameraMotion,
    /// The readings of the part.
    pub(crate) readings: Vec<ReadingInfo>,
    /// Cameras over the whole clip, for the cut of a scene in levels of detail; of other scenes
    /// none.
    pub(crate) shot: Vec<Camera>,
}

impl ActivePart {
    /// The weather of the clip, in which what follows the camera by itself is what it is where the
    /// clip starts.
    fn weather(&self, place: &mut PreparedPlace) -> Weather {
        let PlannedWeather { weather, at, .. } = &self.clip.weather;
        place.weather_of_shot(weather, &self.base.camera(*at))
    }
}

/// The data of one reading.
#[derive(Default)]
pub(crate) struct ReadingBuffer {
    /// The picture of a camera.
    pub(crate) picture: Picture,
    /// `[H, W, 3]`, sRGB.
    pub(crate) rgb: Vec<u8>,
    /// The view without weather, `[H, W, 3]`, sRGB; empty unless it is needed.
    pub(crate) clear: Vec<u8>,
    /// `[H, W]`, m, if it is needed.
    pub(crate) depth: Vec<f32>,
    /// The sweep of a lidar, and its points in the order of time.
    pub(crate) sweep: Option<LidarSweep>,
    /// The points of the sweep, for data sets.
    pub(crate) points: Vec<DatasetPoint>,
    /// The sweep of a radar.
    pub(crate) radar: Option<RadarSweep>,
    /// The detections of that sweep.
    pub(crate) detections: Vec<DatasetDetection>,
}

/// Cameras, sweeps and memory of [`Shots`], from one reading of a part to the next.
pub(crate) struct ShotMemory {
    /// The part that the rest is of.
    part: usize,
    cameras: Vec<Option<SensorCamera>>,
    sweeps: Vec<VecDeque<LidarSweep>>,
    radars: Vec<VecDeque<RadarSweep>>,
}

impl Default for ShotMemory {
    fn default() -> Self {
        Self { part: usize::MAX, cameras: Vec::new(), sweeps: Vec::new(), radars: Vec::new() }
    }
}

impl ShotMemory {
    /// Drops the sweeps that were made ahead and never taken.
    pub(crate) fn clear_sweeps(&mut self) {
        self.sweeps.iter_mut().for_each(VecDeque::clear);
        self.radars.iter_mut().for_each(VecDeque::clear);
    }
}

/// Takes the readings of a block one after the other.
pub(crate) struct Shots<'a> {
    rig: &'a Rig,
    layers: Layers,
    seed: u64,
    memory: &'a mut ShotMemory,
}

impl<'a> Shots<'a> {
    /// For a rig, with the seed of the plan.
    pub(crate) fn new(rig: &'a Rig, layers: Layers, seed: u64, memory: &'a mut ShotMemory) -> Self {
        let count = rig.sensors.len();
        memory.cameras.resize(count, None);
        memory.sweeps.resize_with(count, VecDeque::new);
        memory.radars.resize_with(count, VecDeque::new);
        Self { rig, layers, seed, memory }
    }

    /// Takes reading `index` of a part.
    ///
    /// # Errors
    /// Those of [`Renderer::render`], [`Renderer::scan`] and [`Renderer::scan_radar`].
    pub(crate) fn take(
        &mut self,
        renderer: &mut Renderer,
        place: &mut PreparedPlace,
        number: usize,
        active: &ActivePart,
        index: usize,
        buffer: &mut ReadingBuffer,
    ) -> Result<()> {
        if self.memory.part != number {
            self.memory.part = number;
            self.memory.cameras.fill(None);
            self.memory.clear_sweeps();
        }
        place.set_shot(&active.shot);
        let info = active.readings[index];
        let sensor = &self.rig.sensors[info.sensor];
        let metres = place.site().metres_per_unit;
        let weather = &active.weather(place);
        let (time, seed) = (active.clip.weather.at + sensor.phase, bits(self.seed, active.clip.number));
        // All sweeps of the part at once: one alone would sort the splats again.
        let sweeps = active.readings.iter().filter(|other| other.sensor == info.sensor).count() as u32;
        match &sensor.device {
            RigDevice::Camera { .. } => self.picture(renderer, place, active, info, buffer),
            RigDevice::Lidar { model, sub_rays, returns, .. } => {
                let options = ScanOptions {
                    time,
                    first: info.index,
                    sweeps,
                    seed,
                    sensor: info.sensor as u8,
                    sub_rays: *sub_rays,
                    returns: *returns,
                    ..ScanOptions::default()
                };
                let sweep = next_of(&mut self.memory.sweeps[info.sensor], |keep| {
                    let motion = sensor.motion(&active.base, metres);
                    renderer.scan(place, weather, model, &motion, &options, keep, &mut ())
                })?;
                buffer.points = points_of(&sweep);
                buffer.sweep = Some(sweep);
                Ok(())
            }
            RigDevice::Radar { model, .. } => {
                let options = RadarScanOptions {
                    time,
                    first: info.index,
                    sweeps,
                    seed,
                    sensor: info.sensor as u8,
                    ..RadarScanOptions::default()
                };
                let sweep = next_of(&mut self.memory.radars[info.sensor], |keep| {
                    let motion = sensor.motion(&active.base, metres);
                    renderer.scan_radar(place, weather, model, &motion, &options, keep, &mut ())
                })?;
                buffer.detections = detections_of(&sweep);
                buffer.radar = Some(sweep);
                Ok(())
            }
        }
    }

    fn picture(
        &mut self,
        renderer: &mut Renderer,
        place: &mut PreparedPlace,
        active: &ActivePart,
        info: ReadingInfo,
        buffer: &mut ReadingBuffer,
    ) -> Result<()> {
        let sensor = &self.rig.sensors[info.sensor];
        let RigDevice::Camera { model, .. } = &sensor.device else { return Ok(()) };
        let metres = place.site().metres_per_unit;
        let new = || camera_of(sensor, model, active, info, metres);
        let camera = &*self.memory.cameras[info.sensor].get_or_insert_with(new);
        let weather = &active.weather(place);
        let time = active.clip.weather.at + info.time;
        // Noise is another in each clip.
        let index = info.index ^ (bits(self.seed, active.clip.number) as u32) << 8;
        let after = time + 1.0 / sensor.rate;
        let next = NextFrame { time: after, camera: camera.motion().at(after, metres) };
        let request = FrameRequest {
            index,
            layers: self.layers,
            next: Some(next),
            ..FrameRequest::new(weather, camera, time)
        };
        let picture = &mut buffer.picture;
        renderer.render_into(place, &request, picture, &mut ())?;
        let size = PictureSize::new(picture.frame.width, picture.frame.height);
        let bytes = |rgb: &[f32]| match rgb {
            [] => Vec::new(),
            rgb => quantize_rgb8(rgb, size, Dither::default()),
        };
        (buffer.rgb, buffer.clear) = (bytes(&picture.frame.rgb), bytes(&picture.clear));
        buffer.depth = picture.layer(PictureLayer::SurfaceDepth).into_owned();
        Ok(())
    }
}

/// Takes the next of the sweeps that were made ahead; `scan` makes them if there are none.
fn next_of<T>(
    made: &mut VecDeque<T>,
    scan: impl FnOnce(&mut dyn FnMut(T) -> Result<()>) -> Result<u32>,
) -> Result<T> {
    if made.is_empty() {
        scan(&mut |sweep| {
            made.push_back(sweep);
            Ok(())
        })?;
    }
    made.pop_front().ok_or(Error::Stopped)
}

/// The camera of a sensor in a part of a clip.
fn camera_of(
    sensor: &RigSensor,
    model: &CameraModel,
    active: &ActivePart,
    info: ReadingInfo,
    metres_per_unit: f64,
) -> SensorCamera {
    let mut camera = SensorCamera::new(model.clone(), sensor.motion(&active.base, metres_per_unit));
    camera.number = info.sensor as u32;
    camera
}
