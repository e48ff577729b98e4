//! The trait of all sensors, the instant of a reading, and the reading.

use super::entry::{EntryFault, SensorEntry};
use crate::camera_model::CameraModel;
use crate::lidar::LidarSweep;
use crate::output::PictureStyle;
use crate::radar::RadarSweep;
use crate::{CameraMotion, Error, Layers, Picture, PreparedPlace, Progress, Renderer, Result};
use std::any::Any;
use std::fmt;
use std::path::Path;
use std::sync::Arc;
use wm_scene::Camera;
use wm_sensors::events::EventSlice;
use wm_weather::Weather;

/// A kind of sensor in rig files.
pub struct SensorKind {
    /// The word for it in `kind`.
    pub name: &'static str,
    /// The keys that only some kinds have.
    pub keys: &'static [&'static str],
    /// Reads a sensor of this kind.
    pub(crate) read: fn(&SensorEntry<'_>) -> Result<Arc<dyn Sensor>, EntryFault>,
}

/// A device that reads a place along its way.
pub trait Sensor: Any + fmt::Debug + Send + Sync {
    /// The name of its kind, see [`SENSOR_KINDS`](super::SENSOR_KINDS).
    fn kind(&self) -> &'static str;

    /// Readings in a second, where the model fixes them; `None` where the rig file states them.
    fn own_rate(&self) -> Option<f64> {
        None
    }

    /// The camera, if it takes pictures.
    fn camera(&self) -> Option<&RigCamera> {
        None
    }

    /// The intrinsics, if it sees as a camera does.
    fn intrinsics(&self) -> Option<&Camera> {
        self.camera().map(|camera| &camera.intrinsics)
    }

    /// The ending of its files, if it is not that of pictures.
    fn extension(&self) -> Option<&'static str>;

    /// More facts about it for manifests: names and values.
    fn facts(&self) -> Vec<(&'static str, serde_json::Value)>;

    /// Checks that it can read a weather, and a camera these layers.
    ///
    /// # Errors
    /// [`crate::Error::Unsupported`] with what it cannot do.
    fn check(&self, weather: &Weather, layers: Layers) -> Result<()>;

    /// Begins its readings along a motion of its own; `number` is its place on the rig, which seeds
    /// its noise.
    fn begin(&self, motion: CameraMotion, number: u32) -> Box<dyn SensorRun>;
}

impl dyn Sensor {
    /// Returns the sensor as one of a kind, if it is of that.
    #[must_use]
    pub fn of_kind<T: Sensor>(&self) -> Option<&T> {
        (self as &dyn Any).downcast_ref()
    }
}

/// The readings of a sensor of one place, in one weather, one after the other. A reading does not
/// depend on those before it.
pub trait SensorRun: Send + Sync {
    /// Makes a reading and, where several are cheaper together, those that follow it: up to
    /// `instant.ahead` in all. Hands each to `take` when it is made, in `reading`, whose memory is
    /// used again. Returns their number: 0 if `progress` asked to stop before the first.
    ///
    /// # Errors
    /// [`Error::Stopped`] if `progress` asked to stop; errors of the place and the weather, and
    /// those of `take`.
    fn read_ahead(
        &mut self,
        renderer: &mut Renderer,
        place: &mut PreparedPlace,
        instant: &SensorInstant<'_>,
        reading: &mut SensorData,
        take: &mut dyn FnMut(&mut SensorData) -> Result<()>,
        progress: &mut dyn Progress,
    ) -> Result<u32>;

    /// Makes one reading. Memory in `reading` is used again.
    ///
    /// # Errors
    /// [`Error::Stopped`] if `progress` asked to stop; errors of the place and the weather.
    fn read(
        &mut self,
        renderer: &mut Renderer,
        place: &mut PreparedPlace,
        instant: &SensorInstant<'_>,
        reading: &mut SensorData,
        progress: &mut dyn Progress,
    ) -> Result<()> {
        let one = SensorInstant { ahead: 1, ..*instant };
        match self.read_ahead(renderer, place, &one, reading, &mut |_| Ok(()), progress)? {
            0 => Err(Error::Stopped),
            _ => Ok(()),
        }
    }
}

/// The instant of a reading.
#[derive(Clone, Copy, Debug)]
pub struct SensorInstant<'a> {
    /// The weather.
    pub weather: &'a Weather,
    /// The time of the weather of reading 0, s. Sweeps and slices count from it by their number and
    /// their own rate, so that each ends where the next begins, to the last bit, and several can be
    /// made at once; `time` may differ from that by rounding.
    pub start: f64,
    /// The time of this reading, s, at which a camera takes its picture.
    pub time: f64,
    /// The number of this reading.
    pub index: u32,
    /// Readings a second.
    pub rate: f64,
    /// Readings from this one on that will be asked for, at least 1: some are cheaper together.
    pub ahead: u32,
    /// The seed of noise.
    pub seed: u64,
    /// The layers of pictures.
    pub layers: Layers,
}

impl<'a> SensorInstant<'a> {
    /// The first reading, at time 0, of a sensor of this rate, readings a second; pictures have
    /// their colour.
    #[must_use]
    pub fn first(weather: &'a Weather, rate: f64) -> Self {
        Self { weather, start: 0.0, time: 0.0, index: 0, rate, ahead: 1, seed: 0, layers: Layers::COLOR }
    }
}

/// A camera as a device.
#[derive(Clone, Debug)]
pub struct RigCamera {
    /// The size, the focal lengths and the principal point of its pictures.
    pub intrinsics: Camera,
    /// Lens, shutter, exposure and noise.
    pub model: CameraModel,
}

/// A reading of a sensor.
#[derive(Default)]
pub enum SensorData {
    /// Nothing yet.
    #[default]
    Nothing,
    /// A picture.
    Picture(Box<Picture>),
    /// The sweep of a lidar.
    Points(LidarSweep),
    /// The sweep of a radar.
    Detections(RadarSweep),
    /// The events of a slice of time.
    Events(EventSlice),
}

impl SensorData {
    /// Writes the reading; `style` is that of pictures.
    ///
    /// # Errors
    /// [`crate::Error`] if the format is unknown or the file cannot be written.
    pub fn save(&self, path: &Path, style: &PictureStyle) -> Result<()> {
        match self {
            Self::Nothing => Ok(()),
            Self::Picture(picture) => style.write(picture, path).map(drop),
            Self::Points(sweep) => Ok(sweep.save(path)?),
            Self::Detections(sweep) => Ok(sweep.save(path)?),
            Self::Events(slice) => Ok(slice.save(path)?),
        }
    }

    /// The picture; an empty one takes the place of another reading.
    pub(crate) fn picture_mut(&mut self) -> &mut Picture {
        if !matches!(self, Self::Picture(_)) {
            *self = Self::Picture(Box::default());
        }
        match self {
            Self::Picture(picture) => picture,
            _ => unreachable!("it was just made"),
        }
    }
}
