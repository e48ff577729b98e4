//! One reading of a plan in memory: what its files would hold, without files.

use super::run::BatchRun;
use super::shots::{ReadingBuffer, Shots};
use super::weathers::meant;
use crate::{ClipInfo, DatasetDetection, DatasetPoint, ReadingInfo, SensorInfo};
use std::collections::BTreeMap;
use wm_place::sensor::SensorData;
use wm_place::{Error, Layers, Picture, PictureLayer, Result};
use wm_weather::Weather;

/// The reading that is wanted of a frame.
#[derive(Clone, Copy, Debug)]
pub struct SampleOptions<'a> {
    /// The name of the sensor; `None` for the first camera.
    pub sensor: Option<&'a str>,
    /// The layers of a picture; `None` for those that the plan's files have. Lidars and radars have
    /// none.
    pub layers: Option<Layers>,
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
    pub layer: PictureLayer,
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
        let file = self.plan.file.clone();
        let fault = |says: String| Error::Unsupported(format!("{file}: {says}"));
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
        let layers = options.layers.unwrap_or_else(|| self.plan.layers());
        self.rig.sensors[sensor].device.check(&Weather::clear(), layers)?;
        let open = self.places.last_mut().ok_or(Error::Stopped)?;
        let mut shots = Shots::new(&self.rig, layers, self.plan.seed, &mut self.sampled);
        let mut buffer = ReadingBuffer::default();
        shots.take(&mut self.renderer, &mut open.place, part.clip as usize, &active, 0, &mut buffer)?;
        let data = match &mut buffer.reading {
            SensorData::Picture(picture) => {
                let mut layers: Vec<PictureLayer> = layers.iter().collect();
                layers.sort_unstable_by_key(|layer| layer.name());
                let mut bytes = [std::mem::take(&mut buffer.rgb), std::mem::take(&mut buffer.clear)];
                let arrays = layers.into_iter().map(|layer| array_of(layer, picture, &mut bytes));
                SampleData::Picture(arrays.collect::<Result<_>>()?)
            }
            SensorData::Points(_) => SampleData::Points(buffer.points),
            SensorData::Detections(_) => SampleData::Detections(buffer.detections),
            _ => {
                let kind = self.rig.sensors[sensor].device.kind();
                return Err(fault(format!("a sample has no room for the readings of kind {kind}")));
            }
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
            let first = sensors.iter().position(|sensor| sensor.device.camera().is_some());
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
fn array_of(layer: PictureLayer, picture: &mut Picture, bytes: &mut [Vec<u8>; 2]) -> Result<SampleArray> {
    use std::mem::take;
    let (height, width) = (picture.frame.height as usize, picture.frame.width as usize);
    let channels = layer.channels().len();
    let values = match layer {
        PictureLayer::Color => SampleValues::Bytes(take(&mut bytes[0])),
        PictureLayer::Clear => SampleValues::Bytes(take(&mut bytes[1])),
        PictureLayer::Label => SampleValues::Numbers(take(&mut picture.labels.label)),
        PictureLayer::Instance => SampleValues::Numbers(take(&mut picture.labels.instance)),
        PictureLayer::FlowMask => SampleValues::Bytes(take(&mut picture.flow.states)),
        _ => SampleValues::Floats(picture.layer(layer).into_owned()),
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
