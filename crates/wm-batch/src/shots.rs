//! Readings of the sensors of a plan: pictures, sweeps and detections.

use super::clips::{BlockPart, PlannedClip};
use super::set::{detections_of, points_of};
use super::weathers::PlannedWeather;
use crate::{ClipInfo, DatasetDetection, DatasetPoint, ReadingInfo};
use std::collections::VecDeque;
use wm_base::random::bits;
use wm_image::PictureSize;
use wm_image::color::{Dither, quantize_rgb8};
use wm_place::rig::Rig;
use wm_place::sensor::{SensorData, SensorInstant, SensorRun};
use wm_place::{CameraMotion, Error, Layers, Picture, PictureLayer, PreparedPlace, Renderer, Result};
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
    /// The reading.
    pub(crate) reading: SensorData,
    /// The picture, `[H, W, 3]`, sRGB.
    pub(crate) rgb: Vec<u8>,
    /// The view without weather, `[H, W, 3]`, sRGB; empty unless it is needed.
    pub(crate) clear: Vec<u8>,
    /// `[H, W]`, m, if it is needed.
    pub(crate) depth: Vec<f32>,
    /// The points of a lidar's sweep in the order of time, for data sets.
    pub(crate) points: Vec<DatasetPoint>,
    /// The detections of a radar's sweep.
    pub(crate) detections: Vec<DatasetDetection>,
}

impl ReadingBuffer {
    /// The picture that was read.
    pub(crate) fn picture(&self) -> Option<&Picture> {
        match &self.reading {
            SensorData::Picture(picture) => Some(picture),
            _ => None,
        }
    }

    /// Makes what data sets have of the reading.
    fn convert(&mut self) {
        match &self.reading {
            SensorData::Picture(picture) => {
                let size = PictureSize::new(picture.frame.width, picture.frame.height);
                let bytes = |rgb: &[f32]| match rgb {
                    [] => Vec::new(),
                    rgb => quantize_rgb8(rgb, size, Dither::default()),
                };
                (self.rgb, self.clear) = (bytes(&picture.frame.rgb), bytes(&picture.clear));
                self.depth = picture.layer(PictureLayer::SurfaceDepth).into_owned();
            }
            SensorData::Points(sweep) => self.points = points_of(sweep),
            SensorData::Detections(sweep) => self.detections = detections_of(sweep),
            _ => {}
        }
    }
}

/// The run of a sensor, and the readings that it made ahead.
type SensorReadings = (Box<dyn SensorRun>, VecDeque<SensorData>);

/// The runs of the sensors of [`Shots`], kept from one reading of a part to the next.
pub(crate) struct ShotMemory {
    /// The part whose readings these are.
    part: usize,
    runs: Vec<Option<SensorReadings>>,
}

impl Default for ShotMemory {
    fn default() -> Self {
        Self { part: usize::MAX, runs: Vec::new() }
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
        memory.runs.resize_with(rig.sensors.len(), || None);
        Self { rig, layers, seed, memory }
    }

    /// Takes reading `index` of a part.
    ///
    /// # Errors
    /// The errors of [`SensorRun::read_ahead`].
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
            self.memory.runs.fill_with(|| None);
        }
        place.set_shot(&active.shot);
        let info = active.readings[index];
        let sensor = &self.rig.sensors[info.sensor];
        let at = active.clip.weather.at;
        let instant = SensorInstant {
            weather: &active.weather(place),
            start: at + sensor.phase,
            time: at + info.time,
            index: info.index,
            rate: sensor.rate,
            // All that are left of the part: one sweep alone would sort the splats again.
            ahead: active.readings[index..].iter().filter(|other| other.sensor == info.sensor).count() as u32,
            seed: bits(self.seed, active.clip.number),
            layers: self.layers,
        };
        let metres = place.site().metres_per_unit;
        let begin = || {
            let motion = sensor.motion(&active.base, metres);
            (sensor.device.begin(motion, info.sensor as u32), VecDeque::new())
        };
        let (run, made) = self.memory.runs[info.sensor].get_or_insert_with(begin);
        if made.is_empty() {
            let mut keep = |reading: &mut SensorData| {
                made.push_back(std::mem::take(reading));
                Ok(())
            };
            run.read_ahead(renderer, place, &instant, &mut buffer.reading, &mut keep, &mut ())?;
        }
        buffer.reading = made.pop_front().ok_or(Error::Stopped)?;
        buffer.convert();
        Ok(())
    }
}
