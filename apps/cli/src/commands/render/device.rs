//! Options of the camera as a device: shutter, exposure and noise.

use crate::choices::first_given;
use anyhow::{Result, bail};
use clap::Args;
use weather_magician::camera_model::{CameraExposure, CameraModel, ReadoutSide, SensorNoise, Shutter};
use weather_magician::{LensView, Weather};

/// Options of shutter, exposure and noise.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Camera")]
pub(crate) struct DeviceArgs {
    /// Exposure time, seconds, up to 1: the picture of a camera that moves is blurred over it, and
    /// what falls is streaked over it [default: 0, an instant; what falls has the exposure of its
    /// effect]
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    exposure_time: Option<f64>,
    /// Rolling shutter: time from the first line of the picture to the last, seconds, up to 1
    /// [default: 0, all lines at once]
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    readout: Option<f64>,
    /// The side of the picture that a rolling shutter reads first: top, bottom, left or right
    /// [default: top]
    #[arg(long, value_name = "SIDE", requires = "readout")]
    readout_from: Option<ReadoutSide>,
    /// Exposure over that of the photos: stops (1 is twice as bright), or auto (the mean becomes a
    /// middle grey, with a lag of half a second) [default: 0]
    #[arg(long, value_name = "STOPS|auto", allow_negative_numbers = true)]
    exposure: Option<CameraExposure>,
    /// Noise of an image sensor of this sensitivity, 100 is its base [default: no noise]
    #[arg(long, value_name = "ISO", allow_negative_numbers = true)]
    iso: Option<f64>,
    /// Seed of the noise [default: 0]
    #[arg(long, value_name = "N", requires = "iso")]
    noise_seed: Option<u64>,
}

impl DeviceArgs {
    /// The first option that is given.
    pub(crate) fn given(&self) -> Option<&'static str> {
        first_given([
            (self.exposure_time.is_some(), "--exposure-time"),
            (self.readout.is_some(), "--readout"),
            (self.exposure.is_some(), "--exposure"),
            (self.iso.is_some(), "--iso"),
        ])
    }

    /// The camera of the options, for a weather.
    pub(crate) fn model(&self, lens: Option<LensView>, weather: &Weather) -> Result<CameraModel> {
        let shutter = Shutter {
            exposure: self.exposure_time.unwrap_or(0.0),
            readout: self.readout.unwrap_or(0.0),
            first: self.readout_from.unwrap_or_default(),
        };
        if let Err(fault) = shutter.check() {
            bail!("{}: {fault}", self.given().unwrap_or("--readout"));
        }
        let noise = self.iso.map(|iso| SensorNoise {
            iso,
            seed: self.noise_seed.unwrap_or(0),
            ..SensorNoise::default()
        });
        if let Some(Err(fault)) = noise.map(|noise| noise.check()) {
            bail!("--iso: {fault}");
        }
        let model = CameraModel { lens, shutter, exposure: self.exposure.unwrap_or_default(), noise };
        model.check(weather)?;
        Ok(model)
    }
}
