//! Cameras of a rig.

use super::device::{RigCamera, Sensor, SensorData, SensorInstant, SensorKind, SensorRun};
use super::entry::{EntryFault, SensorEntry};
use crate::camera_model::{CameraExposure, CameraModel, ReadoutSide, SensorCamera, SensorNoise, Shutter};
use crate::lens_view::{LensSpec, LensView};
use crate::{CameraMotion, FrameRequest, Layers, NextFrame, PreparedPlace, Progress, Renderer, Result};
use glam::{DMat4, DVec3};
use serde_json::{Value as Json, json};
use std::sync::Arc;
use wm_scene::Camera;
use wm_scene::camera::FOV_RANGE_DEG;
use wm_weather::Weather;

pub(super) const KIND: SensorKind = SensorKind {
    name: "camera",
    keys: &[
        "size",
        "fov",
        "lens",
        "exposure_time",
        "readout",
        "readout_from",
        "exposure",
        "iso",
        "noise_seed",
    ],
    read: |entry| Ok(Arc::new(RigCamera::read(entry)?)),
};

impl RigCamera {
    pub(super) fn read(entry: &SensorEntry<'_>) -> Result<Self, EntryFault> {
        let fov: Option<f64> = entry.get("fov")?;
        let size = entry.get::<[u32; 2]>("size")?.map(|[width, height]| (width, height));
        let lens: Option<LensView> = match entry.get::<String>("lens")? {
            None => None,
            Some(_) if fov.is_some() => return Err("fov: a lens has its own; give fisheye:DEGREES".into()),
            Some(lens) => {
                let spec = match lens.parse::<LensSpec>()? {
                    LensSpec::File(file) => LensSpec::File(entry.folder.join(file)),
                    other => other,
                };
                Some(spec.view(size).map_err(|error| error.to_string())?)
            }
        };
        let intrinsics = match &lens {
            Some(lens) => *lens.intrinsics(),
            None => {
                let fov = fov.unwrap_or(Camera::DEFAULT_FOV_Y);
                if !FOV_RANGE_DEG.contains(&fov) {
                    return Err(format!("fov is {fov}: it must be 0.1 to 170 degrees").into());
                }
                let size = size.unwrap_or(Camera::DEFAULT_SIZE);
                let camera = Camera::looking(size, fov, DVec3::ZERO, DVec3::X, DVec3::Z);
                let camera = camera.and_then(|camera| camera.check().map(|()| camera));
                Camera { viewmat: DMat4::IDENTITY, ..camera.map_err(|error| error.to_string())? }
            }
        };
        let first = match entry.get::<String>("readout_from")? {
            Some(side) => side.parse()?,
            None => ReadoutSide::default(),
        };
        let exposure = match entry.get::<toml::Value>("exposure")? {
            None => CameraExposure::default(),
            Some(toml::Value::String(text)) => text.parse()?,
            Some(toml::Value::Integer(stops)) => stops.to_string().parse()?,
            Some(toml::Value::Float(stops)) => stops.to_string().parse()?,
            Some(_) => return Err("exposure must be \"auto\" or stops".into()),
        };
        let shutter = Shutter {
            exposure: entry.get("exposure_time")?.unwrap_or(0.0),
            readout: entry.get("readout")?.unwrap_or(0.0),
            first,
        };
        shutter.check()?;
        let seed = entry.get("noise_seed")?.unwrap_or(0);
        let noise = entry.get("iso")?.map(|iso| SensorNoise { iso, seed, ..SensorNoise::default() });
        noise.iter().try_for_each(SensorNoise::check)?;
        Ok(Self { intrinsics, model: CameraModel { lens, shutter, exposure, noise } })
    }
}

impl Sensor for RigCamera {
    fn kind(&self) -> &'static str {
        KIND.name
    }

    fn camera(&self) -> Option<&RigCamera> {
        Some(self)
    }

    fn extension(&self) -> Option<&'static str> {
        None
    }

    fn facts(&self) -> Vec<(&'static str, Json)> {
        let Camera { width, height, fx, fy, cx, cy, .. } = self.intrinsics;
        let CameraModel { lens, shutter, exposure, noise } = &self.model;
        vec![
            (
                "intrinsics",
                json!({ "width": width, "height": height, "fx": fx, "fy": fy, "cx": cx, "cy": cy }),
            ),
            ("lens", lens.as_ref().map(LensView::lens).map(|lens| format!("{lens:?}")).into()),
            (
                "shutter",
                json!({
                    "exposure_time": shutter.exposure,
                    "readout": shutter.readout,
                    "readout_from": format!("{:?}", shutter.first).to_lowercase(),
                }),
            ),
            ("exposure", format!("{exposure:?}").into()),
            ("noise", noise.map(|noise| format!("{noise:?}")).into()),
        ]
    }

    fn check(&self, weather: &Weather, layers: Layers) -> Result<()> {
        layers.check(&self.model, weather)?;
        self.model.check(weather)
    }

    fn begin(&self, motion: CameraMotion, number: u32) -> Box<dyn SensorRun> {
        let mut camera = SensorCamera::new(self.model.clone(), motion);
        camera.number = number;
        Box::new(CameraRun(camera))
    }
}

/// A camera on its way.
struct CameraRun(SensorCamera);

impl SensorRun for CameraRun {
    fn read_ahead(
        &mut self,
        renderer: &mut Renderer,
        place: &mut PreparedPlace,
        instant: &SensorInstant<'_>,
        reading: &mut SensorData,
        take: &mut dyn FnMut(&mut SensorData) -> Result<()>,
        progress: &mut dyn Progress,
    ) -> Result<u32> {
        let SensorInstant { weather, time, index, rate, seed, layers, .. } = *instant;
        let after = time + 1.0 / rate;
        let motion = self.0.motion();
        let camera = motion.at(after, place.site().metres_per_unit);
        let request = FrameRequest {
            // The number of the picture seeds its noise.
            index: index ^ (seed as u32) << 8,
            layers,
            next: Some(NextFrame { time: after, camera }),
            previous: (index > 0).then(|| motion.camera(time - 1.0 / rate)),
            ..FrameRequest::new(weather, &self.0, time)
        };
        renderer.render_into(place, &request, reading.picture_mut(), progress)?;
        take(reading)?;
        Ok(1)
    }
}
