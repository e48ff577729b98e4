//! Readings of a plan as arrays, and lists of its frames.

use crate::arrays::{matrix, moved};
use crate::error::{Failure, Outcome};
use pyo3::exceptions::{PyIndexError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use weather_magician::batch::{BatchSample, RandomPermutation, SampleData, SampleValues, SplitClips};
use weather_magician::batch::{Condition, DatasetPoint, SensorInfoKind, SetInfo};
use weather_magician::{Layers, PictureLayer};
use wm_base::random::bits;

/// The conditions of clips, by their numbers.
pub(crate) fn conditions() -> [&'static str; 6] {
    Condition::ALL.map(Condition::name)
}

/// The layers of their names, with `_` or `-` between words.
pub(crate) fn layers_of(names: Option<Vec<String>>) -> PyResult<Option<Layers>> {
    let layer = |name: &String| {
        let layer = name.replace('_', "-").parse::<PictureLayer>();
        layer.map_err(|says| PyValueError::new_err(format!("layers: {}", says.replace('-', "_"))))
    };
    names.map(|names| names.iter().map(layer).collect()).transpose()
}

/// The place of an index of Python in a sequence of so many values; `what` they are, for the error.
fn place_of(index: isize, count: u64, what: &str) -> PyResult<u64> {
    let place = if index < 0 { count.checked_add_signed(index as i64) } else { Some(index as u64) };
    place
        .filter(|place| *place < count)
        .ok_or_else(|| PyIndexError::new_err(format!("{what} {index}: there are {count}")))
}

#[doc = docs!("SplitFrames")]
#[pyclass(frozen, sequence, module = "weather_magician")]
pub(crate) struct SplitFrames {
    pub(crate) name: String,
    pub(crate) clips: SplitClips,
    /// Frames of a clip.
    pub(crate) frames: u64,
}

impl SplitFrames {
    fn count(&self) -> u64 {
        self.clips.len() * self.frames
    }
}

#[pymethods]
impl SplitFrames {
    fn __len__(&self) -> usize {
        self.count() as usize
    }

    fn __getitem__(&self, index: isize) -> PyResult<u64> {
        let place = place_of(index, self.count(), "index")?;
        let clip = self.clips.get(place / self.frames);
        let clip = clip.ok_or_else(|| PyIndexError::new_err(format!("index {index}")))?;
        Ok(clip * self.frames + place % self.frames)
    }

    fn __repr__(&self) -> String {
        format!("SplitFrames({:?}): {} frames of {} clips", self.name, self.count(), self.clips.len())
    }
}

#[doc = docs!("Permutation")]
#[pyclass(frozen, sequence, module = "weather_magician")]
pub(crate) struct Permutation {
    count: u64,
    order: RandomPermutation,
}

#[pymethods]
impl Permutation {
    #[new]
    #[pyo3(signature = (count, seed=0, stream=0))]
    fn new(count: u64, seed: u64, stream: u64) -> PyResult<Self> {
        if count > 1 << 62 {
            return Err(PyValueError::new_err(format!("count: {count} is above 2^62")));
        }
        Ok(Self { count, order: RandomPermutation::new(bits(seed, stream), count.max(1)) })
    }

    fn __len__(&self) -> usize {
        self.count as usize
    }

    fn __getitem__(&self, index: isize) -> PyResult<u64> {
        Ok(self.order.at(place_of(index, self.count, "index")?))
    }
}

/// A reading as a dictionary.
pub(crate) fn dict_of<'py>(
    py: Python<'py>,
    frame: u64,
    sample: BatchSample,
    set: &SetInfo,
) -> PyResult<Bound<'py, PyDict>> {
    let BatchSample { clip, at, variables, reading, sensor, data } = sample;
    let dict = PyDict::new(py);
    match data {
        SampleData::Picture(arrays) => {
            for array in arrays {
                let shape = &array.shape;
                let values = match array.values {
                    SampleValues::Bytes(values) => moved(py, values, shape)?.into_any(),
                    SampleValues::Numbers(values) => moved(py, values, shape)?.into_any(),
                    SampleValues::Floats(values) => moved(py, values, shape)?.into_any(),
                };
                dict.set_item(array.layer.name().replace('-', "_"), values)?;
            }
        }
        SampleData::Points(points) => points_into(py, &dict, &points)?,
        SampleData::Detections(detections) => {
            let rows = detections.iter().flat_map(|one| {
                let [x, y, z] = one.position;
                [x, y, z, one.velocity, one.ground_velocity, one.rcs, one.snr]
            });
            dict.set_item("detections", moved(py, rows.collect(), &[detections.len(), 7])?)?;
            let is_rain = detections.iter().map(|one| one.is_rain).collect();
            dict.set_item("is_rain", moved(py, is_rain, &[detections.len()])?)?;
        }
    }
    dict.set_item("frame", frame)?;
    dict.set_item("sensor", &sensor.name)?;
    dict.set_item("index", reading.index)?;
    dict.set_item("clip", &clip.name)?;
    dict.set_item("split", &clip.split)?;
    dict.set_item("place", &clip.place.name)?;
    dict.set_item("time", reading.time)?;
    dict.set_item("timestamp", reading.timestamp(&clip))?;
    dict.set_item("condition", clip.weather.condition.name())?;
    let weather = PyDict::new(py);
    weather.set_item("mor", clip.weather.mor)?;
    weather.set_item("rain_rate", clip.weather.rain_rate)?;
    weather.set_item("snow_rate", clip.weather.snow_rate)?;
    weather.set_item("is_night", clip.weather.is_night)?;
    weather.set_item("at", at)?;
    weather.set_item("variables", variables)?;
    dict.set_item("weather", weather)?;
    dict.set_item("weather_name", &clip.weather.name)?;
    dict.set_item("weather_file", &clip.weather.file)?;
    let world_from_sensor = reading.world_from_sensor(set);
    dict.set_item("world_from_rig", matrix(py, &reading.world_from_rig.matrix())?)?;
    dict.set_item("world_from_sensor", matrix(py, &world_from_sensor.matrix())?)?;
    if let SensorInfoKind::Camera(camera) = &sensor.kind {
        let ([fx, fy], [cx, cy]) = (camera.focal, camera.center);
        dict.set_item("K", moved(py, vec![fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0], &[3, 3])?)?;
        dict.set_item("viewmat", matrix(py, &world_from_sensor.inverse().matrix())?)?;
    }
    Ok(dict)
}

fn points_into(py: Python<'_>, dict: &Bound<'_, PyDict>, points: &[DatasetPoint]) -> PyResult<()> {
    let count = points.len();
    let rows = points.iter().flat_map(|point| {
        let [x, y, z] = point.position;
        [x, y, z, point.intensity]
    });
    dict.set_item("points", moved(py, rows.collect(), &[count, 4])?)?;
    let floats = |of: fn(&DatasetPoint) -> f32| moved(py, points.iter().map(of).collect(), &[count]);
    dict.set_item("range", floats(|point| point.range)?)?;
    dict.set_item("point_time", floats(|point| point.time)?)?;
    let angles = points.iter().flat_map(|point| point.angles).collect();
    dict.set_item("angles", moved(py, angles, &[count, 2])?)?;
    let words = |of: fn(&DatasetPoint) -> u16| moved(py, points.iter().map(of).collect(), &[count]);
    dict.set_item("ring", words(|point| point.ring)?)?;
    dict.set_item("label", words(|point| point.label)?)?;
    let bytes = |of: fn(&DatasetPoint) -> u8| moved(py, points.iter().map(of).collect(), &[count]);
    dict.set_item("rank", bytes(|point| point.rank)?)?;
    // The order of the lidar's own classes.
    dict.set_item("class", bytes(|point| point.source as u8)?)
}

/// The index of a split by its name.
pub(crate) fn split_index(splits: &[(String, f64)], name: &str) -> Outcome<usize> {
    splits.iter().position(|(known, _)| known == name).ok_or_else(|| {
        let known: Vec<&str> = splits.iter().map(|(name, _)| name.as_str()).collect();
        Failure::Library(format!("the plan has no split \"{name}\": it has {}", known.join(", ")))
    })
}
