//! Radars of a rig.

use super::device::{Sensor, SensorData, SensorInstant, SensorKind, SensorRun};
use super::entry::{EntryFault, SensorEntry};
use crate::error::check_physical;
use crate::lidar::PointFormat;
use crate::radar::{RadarModel, RadarScanOptions};
use crate::{CameraMotion, Layers, PreparedPlace, Progress, Renderer, Result};
use serde_json::Value as Json;
use std::path::Path;
use std::sync::Arc;
use wm_weather::Weather;

pub(super) const KIND: SensorKind = SensorKind {
    name: "radar",
    keys: &["model", "format"],
    read: |entry| Ok(Arc::new(RigRadar::read(entry)?)),
};

/// A radar.
#[derive(Clone, Debug)]
pub struct RigRadar {
    /// The model.
    pub model: RadarModel,
    /// The format of the files of detections.
    pub format: PointFormat,
}

impl RigRadar {
    fn read(entry: &SensorEntry<'_>) -> Result<Self, EntryFault> {
        let model = RadarModel::find(&entry.model(KIND.name)?).map_err(|error| error.to_string())?;
        let format = entry.get::<String>("format")?.unwrap_or_else(|| "ply".into());
        let format = PointFormat::of_detections(Path::new(&format!("points.{format}")))
            .map_err(|_| format!("format is `{format}`: use ply, pcd or npy"))?;
        Ok(Self { model, format })
    }
}

impl Sensor for RigRadar {
    fn kind(&self) -> &'static str {
        KIND.name
    }

    fn own_rate(&self) -> Option<f64> {
        Some(self.model.rate)
    }

    fn extension(&self) -> Option<&'static str> {
        Some(self.format.extension())
    }

    fn facts(&self) -> Vec<(&'static str, Json)> {
        vec![("model", self.model.name.clone().into())]
    }

    fn check(&self, weather: &Weather, _: Layers) -> Result<()> {
        check_physical(weather, KIND.name)
    }

    fn begin(&self, motion: CameraMotion, number: u32) -> Box<dyn SensorRun> {
        Box::new(RadarRun { model: self.model.clone(), motion, number })
    }
}

/// A radar on its way.
struct RadarRun {
    model: RadarModel,
    motion: CameraMotion,
    number: u32,
}

impl SensorRun for RadarRun {
    fn read_ahead(
        &mut self,
        renderer: &mut Renderer,
        place: &mut PreparedPlace,
        instant: &SensorInstant<'_>,
        reading: &mut SensorData,
        take: &mut dyn FnMut(&mut SensorData) -> Result<()>,
        progress: &mut dyn Progress,
    ) -> Result<u32> {
        let SensorInstant { weather, start, index, ahead, seed, .. } = *instant;
        let sensor = self.number as u8;
        let options = RadarScanOptions { time: start, index, seed, sensor, ..RadarScanOptions::default() };
        let mut keep = |sweep| {
            *reading = SensorData::Detections(sweep);
            take(reading)
        };
        renderer.scan_radar(place, weather, &self.model, &self.motion, &options, ahead, &mut keep, progress)
    }
}
