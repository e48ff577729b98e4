//! Event cameras of a rig: their pixels ([`wm_sensors::events`]) behind a pinhole or a lens. A
//! reading is a slice of time, for which several pictures are rendered.

use super::device::{RigCamera, Sensor, SensorData, SensorInstant, SensorKind, SensorRun};
use super::entry::{EntryFault, SensorEntry};
use crate::camera_model::{CameraModel, SensorCamera};
use crate::{CameraMotion, FrameRequest, Layers, Picture, PreparedPlace, Progress, Renderer, Result};
use rayon::prelude::*;
use serde_json::Value as Json;
use std::sync::Arc;
use wm_base::color::{luminance, srgb_decode};
use wm_render::ColorEncoding;
use wm_sensors::events::{EventModel, EventSampler};
use wm_weather::Weather;

pub(super) const KIND: SensorKind = SensorKind {
    name: "events",
    keys: &["size", "fov", "lens", "threshold", "mismatch", "refractory", "noise", "pictures", "format"],
    read: |entry| Ok(Arc::new(RigEventCamera::read(entry)?)),
};

/// Most pictures of a slice.
const MAX_PICTURES: u32 = 10_000;

/// An event camera.
#[derive(Clone, Debug)]
pub struct RigEventCamera {
    /// The size, the focal lengths and the lens.
    pub camera: RigCamera,
    /// The pixels.
    pub pixels: EventModel,
    /// Pictures that are rendered for a slice, between which light changes evenly.
    pub pictures: u32,
    /// The ending of the files: `npy` or `h5`.
    pub format: &'static str,
}

impl RigEventCamera {
    fn read(entry: &SensorEntry<'_>) -> Result<Self, EntryFault> {
        let usual = EventModel::default();
        let or = |key: &str, value: f64| Ok::<f64, EntryFault>(entry.get(key)?.unwrap_or(value));
        let pixels = EventModel {
            threshold: or("threshold", usual.threshold)?,
            mismatch: or("mismatch", usual.mismatch)?,
            refractory: or("refractory", usual.refractory)?,
            noise: or("noise", usual.noise)?,
        };
        pixels.check()?;
        let pictures = entry.get("pictures")?.unwrap_or(10);
        if !(1..=MAX_PICTURES).contains(&pictures) {
            return Err(format!("pictures is {pictures}: it must be 1 to {MAX_PICTURES} a slice").into());
        }
        let format = entry.get::<String>("format")?.unwrap_or_else(|| "npy".into());
        let known = ["npy", "h5"].into_iter().find(|known| *known == format);
        let format = known.ok_or_else(|| format!("format is `{format}`: use npy or h5"))?;
        let camera = RigCamera::read(entry)?;
        if u16::try_from(camera.intrinsics.width.max(camera.intrinsics.height)).is_err() {
            return Err("size: events have coordinates below 65536 px".into());
        }
        Ok(Self { camera, pixels, pictures, format })
    }
}

impl Sensor for RigEventCamera {
    fn kind(&self) -> &'static str {
        KIND.name
    }

    fn intrinsics(&self) -> Option<&wm_scene::Camera> {
        self.camera.intrinsics()
    }

    fn extension(&self) -> Option<&'static str> {
        Some(self.format)
    }

    fn facts(&self) -> Vec<(&'static str, Json)> {
        let EventModel { threshold, mismatch, refractory, noise } = self.pixels;
        let mut facts = self.camera.facts();
        facts.retain(|(name, _)| ["intrinsics", "lens"].contains(name));
        facts.extend([
            ("threshold", threshold.into()),
            ("mismatch", mismatch.into()),
            ("refractory", refractory.into()),
            ("noise", noise.into()),
            ("pictures", Json::from(self.pictures)),
        ]);
        facts
    }

    fn check(&self, weather: &Weather, _: Layers) -> Result<()> {
        self.camera.model.check(weather)
    }

    fn begin(&self, motion: CameraMotion, number: u32) -> Box<dyn SensorRun> {
        // Its pixels see light and not exposures.
        let lens = self.camera.model.lens.clone();
        let mut camera = SensorCamera::new(CameraModel { lens, ..CameraModel::default() }, motion);
        camera.number = number;
        let (pixels, pictures) = (self.pixels, self.pictures);
        Box::new(EventRun { camera, pixels, pictures, picture: Picture::default(), last: None })
    }
}

/// An event camera on its way.
struct EventRun {
    camera: SensorCamera,
    pixels: EventModel,
    pictures: u32,
    picture: Picture,
    /// The number of the slice that would come next, and the light at its start.
    last: Option<(u32, Vec<f32>)>,
}

impl EventRun {
    /// The light of each pixel at a time, `[H, W]`, a share of white.
    fn light(
        &mut self,
        renderer: &mut Renderer,
        place: &mut PreparedPlace,
        weather: &Weather,
        time: f64,
        progress: &mut dyn Progress,
    ) -> Result<Vec<f32>> {
        let request =
            FrameRequest { layers: Layers::COLOR, ..FrameRequest::new(weather, &self.camera, time) };
        renderer.render_into(place, &request, &mut self.picture, progress)?;
        let frame = &self.picture.frame;
        let linear = |value: f32| match frame.encoding {
            ColorEncoding::Srgb => srgb_decode(f64::from(value.max(0.0))),
            ColorEncoding::Linear => f64::from(value),
        };
        let of = |rgb: &[f32]| luminance([linear(rgb[0]), linear(rgb[1]), linear(rgb[2])]) as f32;
        Ok(frame.rgb.par_chunks_exact(3).map(of).collect())
    }
}

impl SensorRun for EventRun {
    fn read_ahead(
        &mut self,
        renderer: &mut Renderer,
        place: &mut PreparedPlace,
        instant: &SensorInstant<'_>,
        reading: &mut SensorData,
        take: &mut dyn FnMut(&mut SensorData) -> Result<()>,
        progress: &mut dyn Progress,
    ) -> Result<u32> {
        let SensorInstant { weather, start, index, rate, seed, .. } = *instant;
        // The end of a slice is the start of the next, to the last bit.
        let at =
            |picture: u32| start + (f64::from(index) + f64::from(picture) / f64::from(self.pictures)) / rate;
        let times: Vec<f64> = (0..=self.pictures).map(at).collect();
        let mut light = match self.last.take().filter(|(next, _)| *next == index) {
            Some((_, light)) => light,
            None => self.light(renderer, place, weather, times[0], progress)?,
        };
        let size = [self.picture.frame.width, self.picture.frame.height];
        // Each camera of a rig has other pixels.
        let seed = wm_base::random::bits(seed, u64::from(self.camera.number));
        let mut sampler = EventSampler::new(self.pixels, size, &light, seed, index);
        for time in &times[1..] {
            light = self.light(renderer, place, weather, *time, progress)?;
            sampler.advance(time - times[0], &light);
        }
        *reading = SensorData::Events(sampler.finish(times[0]));
        self.last = Some((index + 1, light));
        take(reading)?;
        Ok(1)
    }
}
