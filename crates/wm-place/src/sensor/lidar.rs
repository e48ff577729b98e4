//! Lidars of a rig.

use super::device::{Sensor, SensorData, SensorInstant, SensorKind, SensorRun};
use super::entry::{EntryFault, SensorEntry};
use crate::error::check_physical;
use crate::lidar::{LidarModel, PointFormat, ReturnMode, ScanOptions, SubRays};
use crate::{CameraMotion, Layers, PreparedPlace, Progress, Renderer, Result};
use serde_json::Value as Json;
use std::path::Path;
use std::sync::Arc;
use wm_weather::Weather;

pub(super) const KIND: SensorKind = SensorKind {
    name: "lidar",
    keys: &["model", "sub_rays", "returns", "format"],
    read: |entry| Ok(Arc::new(RigLidar::read(entry)?)),
};

/// A lidar.
#[derive(Clone, Debug)]
pub struct RigLidar {
    /// The model.
    pub model: LidarModel,
    /// Rays of a pulse.
    pub sub_rays: SubRays,
    /// The returns that become points.
    pub returns: ReturnMode,
    /// The format of the files of points.
    pub format: PointFormat,
}

impl RigLidar {
    fn read(entry: &SensorEntry<'_>) -> Result<Self, EntryFault> {
        let model = LidarModel::find(&entry.model(KIND.name)?).map_err(|error| error.to_string())?;
        let sub_rays = match entry.get::<u32>("sub_rays")? {
            None => SubRays::default(),
            Some(count) => {
                SubRays::of_count(count as usize).ok_or_else(|| format!("sub_rays is {count}: use 1 or 7"))?
            }
        };
        let returns = match entry.get::<String>("returns")? {
            None => ReturnMode::default(),
            Some(name) => name.parse().map_err(|error| format!("returns is {error}"))?,
        };
        let format = entry.get::<String>("format")?.unwrap_or_else(|| "ply".into());
        let format = PointFormat::of(Path::new(&format!("points.{format}")))
            .map_err(|_| format!("format is `{format}`: use ply, pcd, npy, las or bin"))?;
        Ok(Self { model, sub_rays, returns, format })
    }
}

impl Sensor for RigLidar {
    fn kind(&self) -> &'static str {
        KIND.name
    }

    fn own_rate(&self) -> Option<f64> {
        Some(1.0 / self.model.period())
    }

    fn extension(&self) -> Option<&'static str> {
        Some(self.format.extension())
    }

    fn facts(&self) -> Vec<(&'static str, Json)> {
        vec![
            ("model", self.model.name.clone().into()),
            ("sub_rays", self.sub_rays.count().into()),
            ("returns", format!("{:?}", self.returns).to_lowercase().into()),
        ]
    }

    fn check(&self, weather: &Weather, _: Layers) -> Result<()> {
        check_physical(weather, KIND.name)
    }

    fn begin(&self, motion: CameraMotion, number: u32) -> Box<dyn SensorRun> {
        Box::new(LidarRun { lidar: self.clone(), motion, number })
    }
}

/// A lidar on its way.
struct LidarRun {
    lidar: RigLidar,
    motion: CameraMotion,
    number: u32,
}

impl SensorRun for LidarRun {
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
        let RigLidar { model, sub_rays, returns, .. } = &self.lidar;
        let options = ScanOptions {
            time: start,
            index,
            seed,
            sensor: self.number as u8,
            sub_rays: *sub_rays,
            returns: *returns,
            ..ScanOptions::default()
        };
        let mut keep = |sweep| {
            *reading = SensorData::Points(sweep);
            take(reading)
        };
        renderer.scan(place, weather, model, &self.motion, &options, ahead, &mut keep, progress)
    }
}
