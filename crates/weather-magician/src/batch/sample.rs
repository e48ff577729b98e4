//! One reading of a plan in memory: what its files would hold, without files.

use super::plan::{BatchPlan, PictureNeeds};
use super::run::BatchRun;
use super::shots::{ReadingBuffer, Shots};
use super::weathers::meant;
use crate::output::{ExtraPicture, PictureLayer, outputs, parts};
use crate::rig::RigDevice;
use crate::{Error, LaterLayers, Result};
use std::collections::BTreeMap;
use std::fmt;
use std::str::FromStr;
use wm_datasets::{ClipInfo, DatasetDetection, DatasetPoint, LayerNeeds, ReadingInfo, SensorInfo};
use wm_weather::Weather;

/// A layer of a picture in a [`BatchSample`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SampleLayer {
    /// `rgb`: the colour, 8 bits, sRGB.
    Rgb,
    /// `clear`: the same view without any weather, 8 bits, sRGB; the `NAME.clear.png` of `pairs`.
    Clear,
    /// `surface-depth`: depth of surfaces in m, as layouts with depth have it; 0 in the sky.
    SurfaceDepth,
    /// A layer of the plan's `also`, by its name there.
    Picture(PictureLayer),
}

impl SampleLayer {
    /// Those that are no layers of `also`.
    const OWN: [(Self, &'static str); 3] =
        [(Self::Rgb, "rgb"), (Self::Clear, "clear"), (Self::SurfaceDepth, "surface-depth")];

    /// Returns its name.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Picture(layer) => layer.name(),
            own => Self::OWN.iter().find(|(known, _)| *known == own).map_or("", |(_, name)| name),
        }
    }
}

impl fmt::Display for SampleLayer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for SampleLayer {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if let Some((own, _)) = Self::OWN.iter().find(|(_, name)| *name == text) {
            return Ok(*own);
        }
        match text.parse::<ExtraPicture>() {
            Ok(ExtraPicture { kind, format: None }) => Ok(Self::Picture(kind)),
            Ok(_) => Err(format!("`{text}`: a layer in memory has no format; leave out the extension")),
            Err(says) => Err(format!("{says}; or rgb, clear or surface-depth")),
        }
    }
}

/// The reading that is wanted of a frame.
#[derive(Clone, Copy, Debug)]
pub struct SampleOptions<'a> {
    /// The name of the sensor; `None` for the first camera.
    pub sensor: Option<&'a str>,
    /// The layers of a picture; `None` for those that the plan's files have. Lidars and radars have
    /// none.
    pub layers: Option<&'a [SampleLayer]>,
    /// Most scenes that stay open, at least 1: frames of a scene that is open need not wait for it.
    pub places: usize,
}

impl Default for SampleOptions<'_> {
    /// The first camera with the plan's layers, and two scenes.
    fn default() -> Self {
        Self { sensor: None, layers: None, places: 2 }
    }
}

/// The reading of one sensor at one frame of a plan.
#[derive(Clone, Debug)]
pub struct BatchSample {
    /// The clip: its name, split, place, times and weather.
    pub clip: ClipInfo,
    /// The time of the weather at which the clip begins, s.
    pub at: f64,
    /// The values of what is varied.
    pub variables: BTreeMap<String, f64>,
    /// The reading: its number, its time in the clip and the pose of the rig.
    pub reading: ReadingInfo,
    /// The sensor: its name, its place on the rig and its intrinsics.
    pub sensor: SensorInfo,
    /// The layers, points or detections.
    pub data: SampleData,
}

/// The data of a [`BatchSample`].
#[derive(Clone, Debug)]
pub enum SampleData {
    /// The layers of a picture.
    Picture(Vec<SampleArray>),
    /// The points of a lidar's sweep in the order of time, in the sensor's axes at the start of the
    /// sweep.
    Points(Vec<DatasetPoint>),
    /// The detections of a radar, in the sensor's axes.
    Detections(Vec<DatasetDetection>),
}

/// A layer of a picture as an array.
#[derive(Clone, Debug, PartialEq)]
pub struct SampleArray {
    /// The layer.
    pub layer: SampleLayer,
    /// `[H, W]`, or `[H, W, C]`.
    pub shape: Vec<usize>,
    /// The values, in the order of rows, then columns, then channels.
    pub values: SampleValues,
}

/// The values of a [`SampleArray`].
#[derive(Clone, Debug, PartialEq)]
pub enum SampleValues {
    /// Colours of 8 bits, and the states of optical flow.
    Bytes(Vec<u8>),
    /// Labels.
    Numbers(Vec<u16>),
    /// All else, as in the layer's `.npy`: metres, px, shares and linear light.
    Floats(Vec<f32>),
}

impl BatchPlan {
    /// The layers that the plan's files have of a camera.
    #[must_use]
    pub fn sample_layers(&self) -> Vec<SampleLayer> {
        let mut layers = vec![SampleLayer::Rgb];
        let mut ask = |layer: SampleLayer| {
            if !layers.contains(&layer) {
                layers.push(layer);
            }
        };
        self.also.iter().for_each(|also| ask(SampleLayer::Picture(also.kind)));
        let needs = self.picture_needs().layers;
        let flow = [PictureLayer::Flow, PictureLayer::FlowMask].map(SampleLayer::Picture);
        let asked = [needs.clean, needs.depth, needs.flow, needs.flow];
        for (layer, is_needed) in
            [SampleLayer::Clear, SampleLayer::SurfaceDepth].into_iter().chain(flow).zip(asked)
        {
            if is_needed {
                ask(layer);
            }
        }
        layers
    }
}

/// The passes and pictures that some layers need.
fn needs_of(layers: &[SampleLayer]) -> PictureNeeds {
    let also: Vec<ExtraPicture> = layers
        .iter()
        .filter_map(|layer| match layer {
            SampleLayer::Picture(kind) => Some(ExtraPicture { kind: *kind, format: None }),
            _ => None,
        })
        .collect();
    PictureNeeds {
        outputs: outputs(&also),
        parts: parts(&also),
        later: LaterLayers::of(&also),
        layers: LayerNeeds {
            clean: layers.contains(&SampleLayer::Clear),
            depth: layers.contains(&SampleLayer::SurfaceDepth),
            flow: false,
        },
    }
}

impl BatchRun {
    /// Reads one sensor at one frame: the first reading at or after the frame's time, as the files
    /// of the set have it. Frames may be asked for in any order; each is the same as in a whole
    /// run.
    ///
    /// Neighbours share the scene and the clip, and what weather needs of them: asked for one after
    /// the other they take less time.
    ///
    /// # Errors
    /// [`Error::Unsupported`] if the frame or the sensor is not there, or the camera cannot have a
    /// layer; errors of the scene and the weather.
    pub fn sample(&mut self, frame: u64, options: &SampleOptions<'_>) -> Result<BatchSample> {
        let fault = |says: String| Error::Unsupported(format!("{}: {says}", self.plan.file));
        if frame >= self.clips.frames() {
            return Err(fault(format!("frame {frame}: the set has {}", self.clips.frames())));
        }
        let part = self.clips.parts(&(frame..frame + 1)).remove(0);
        let sensor = self.sensor_of(frame, options.sensor)?;
        let mut active = self.part(&part, options.places)?;
        active.readings.retain(|reading| reading.sensor == sensor && reading.is_key);
        let Some(reading) = active.readings.first().copied() else {
            let own = &self.rig.sensors[sensor];
            let says = format!(
                "{}: frame {frame}: sensor \"{}\" reads nothing in it, since it begins at {} s of a clip",
                self.plan.file, own.name, own.phase
            );
            return Err(Error::Unsupported(says));
        };
        let mut layers = options.layers.map_or_else(|| self.plan.sample_layers(), <[SampleLayer]>::to_vec);
        layers.sort_unstable_by_key(|layer| layer.name());
        layers.dedup();
        let needs = needs_of(&layers);
        if let RigDevice::Camera { model, .. } = &self.rig.sensors[sensor].device {
            needs.later.check(model, &Weather::clear())?;
        }
        let open = self.places.last_mut().ok_or(Error::Stopped)?;
        open.place.config.outputs = needs.outputs;
        self.sampled.clear_sweeps();
        let mut shots = Shots::new(&self.rig, &needs, self.plan.seed, &mut self.sampled);
        let mut buffer = ReadingBuffer::default();
        shots.take(&mut self.renderer, &mut open.place, (part.clip as usize, &active, 0), &mut buffer)?;
        let data = match &self.rig.sensors[sensor].device {
            RigDevice::Camera { .. } => {
                let arrays = layers.iter().map(|layer| array_of(*layer, &mut buffer));
                SampleData::Picture(arrays.collect::<Result<_>>()?)
            }
            RigDevice::Lidar { .. } => SampleData::Points(buffer.points),
            RigDevice::Radar { .. } => SampleData::Detections(buffer.detections),
        };
        let planned = active.clip.weather;
        Ok(BatchSample {
            clip: active.info,
            at: planned.at,
            variables: planned.variables,
            reading,
            sensor: self.set.sensors[sensor].clone(),
            data,
        })
    }

    /// The number of the sensor that is asked for in a frame.
    fn sensor_of(&self, frame: u64, name: Option<&str>) -> Result<usize> {
        let fault = |says: String| Err(Error::Unsupported(format!("{}: {says}", self.plan.file)));
        let sensors = &self.rig.sensors;
        // Where every photo has a camera of its own, a clip has that one alone.
        let only = self.clips.only_sensor(frame);
        let Some(name) = name else {
            let first = sensors.iter().position(|sensor| matches!(sensor.device, RigDevice::Camera { .. }));
            return match only.or(first) {
                Some(found) => Ok(found),
                None => {
                    fault(format!("the rig has no camera: name a sensor, such as \"{}\"", sensors[0].name))
                }
            };
        };
        let Some(found) = sensors.iter().position(|sensor| sensor.name == name) else {
            let meant = meant(name, sensors.iter().map(|sensor| sensor.name.as_str()));
            return fault(format!("there is no sensor `{name}`{meant}"));
        };
        match only.filter(|only| *only != found) {
            Some(only) => fault(format!("frame {frame}: its only sensor is \"{}\"", sensors[only].name)),
            None => Ok(found),
        }
    }
}

/// A layer of a reading, with the memory of the buffer where it can be taken.
fn array_of(layer: SampleLayer, buffer: &mut ReadingBuffer) -> Result<SampleArray> {
    use std::mem::take;
    let (height, width) = (buffer.picture.frame.height as usize, buffer.picture.frame.width as usize);
    let picture = &mut buffer.picture;
    let (values, channels) = match layer {
        SampleLayer::Rgb => (SampleValues::Bytes(take(&mut buffer.rgb)), 3),
        SampleLayer::Clear => (SampleValues::Bytes(take(&mut buffer.clean)), 3),
        SampleLayer::SurfaceDepth => (SampleValues::Floats(take(&mut buffer.depth)), 1),
        SampleLayer::Picture(PictureLayer::Label) => {
            (SampleValues::Numbers(take(&mut picture.labels.label)), 1)
        }
        SampleLayer::Picture(PictureLayer::Instance) => {
            (SampleValues::Numbers(take(&mut picture.labels.instance)), 1)
        }
        SampleLayer::Picture(PictureLayer::FlowMask) => {
            (SampleValues::Bytes(take(&mut picture.flow.states)), 1)
        }
        SampleLayer::Picture(kind) => {
            (SampleValues::Floats(picture.layer(kind).into_owned()), kind.channels().len())
        }
    };
    let shape = if channels == 1 { vec![height, width] } else { vec![height, width, channels] };
    let count = match &values {
        SampleValues::Bytes(bytes) => bytes.len(),
        SampleValues::Numbers(numbers) => numbers.len(),
        SampleValues::Floats(floats) => floats.len(),
    };
    if count != shape.iter().product::<usize>() {
        return Err(Error::Unsupported(format!("layer {layer}: this camera has none; leave it out")));
    }
    Ok(SampleArray { layer, shape, values })
}
