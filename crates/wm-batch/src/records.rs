//! The contents of a data set, in no layout's terms.
//!
//! Axes: the world's z is up, in metres; a rig, a lidar and a radar have x forward, y left and z
//! up; a camera has OpenCV's axes, x right, y down and z forward.

use crate::RigidPose;
use glam::{DQuat, DVec3};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use wm_scene::LensModel;

/// A data set: its sensors and what all of its clips share.
#[derive(Clone, Debug)]
pub struct SetInfo {
    /// The name: letters, digits, `-` and `_`.
    pub name: String,
    /// A description in one line.
    pub about: String,
    /// The program that made it, with its version.
    pub program: String,
    /// The sensors of the rig; readings name them by index.
    pub sensors: Vec<SensorInfo>,
    /// Frames a second: the rate of key frames.
    pub frame_rate: f64,
    /// The names of the labels of splats, by number from 1; empty if the scenes have none.
    pub labels: Vec<String>,
}

/// A sensor of the rig.
#[derive(Clone, Debug)]
pub struct SensorInfo {
    /// The name: letters, digits, `-` and `_`.
    pub name: String,
    /// `rig_from_sensor`, in the sensor's own axes.
    pub rig_from_sensor: RigidPose,
    /// Readings a second.
    pub rate: f64,
    /// The device.
    pub kind: SensorInfoKind,
}

impl SensorInfo {
    /// The camera, if it is one.
    pub(crate) fn camera(&self) -> Option<&CameraInfo> {
        match &self.kind {
            SensorInfoKind::Camera(camera) => Some(camera),
            _ => None,
        }
    }

    /// Returns true if it is a lidar.
    pub(crate) fn is_lidar(&self) -> bool {
        matches!(self.kind, SensorInfoKind::Lidar { .. })
    }
}

/// The device of a [`SensorInfo`].
#[derive(Clone, Debug)]
pub enum SensorInfoKind {
    /// A camera.
    Camera(CameraInfo),
    /// A lidar.
    Lidar {
        /// The name of its model.
        model: String,
        /// The rows; the highest is 0.
        rings: u16,
    },
    /// A radar.
    Radar {
        /// The name of its model.
        model: String,
    },
    /// A sensor that no layout has room for, but the program's own.
    Other {
        /// The kind in rig files.
        kind: &'static str,
    },
}

impl SensorInfoKind {
    /// The name of the kind in rig files.
    pub(crate) fn name(&self) -> &'static str {
        match self {
            Self::Camera(_) => "camera",
            Self::Lidar { .. } => "lidar",
            Self::Radar { .. } => "radar",
            Self::Other { kind } => kind,
        }
    }
}

/// The intrinsics of a camera; the centre of the first pixel is at (0.5, 0.5).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraInfo {
    /// Picture width and height, px.
    pub size: (u32, u32),
    /// Focal lengths, px.
    pub focal: [f64; 2],
    /// Principal point from the corner of the first pixel, px. Layouts whose readers have the first
    /// pixel's centre at (0, 0) subtract 0.5; each says so.
    pub center: [f64; 2],
    /// The lens; `None` for a pinhole.
    pub lens: Option<LensModel>,
}

/// A clip: one drive through one scene in one weather.
#[derive(Clone, Debug)]
pub struct ClipInfo {
    /// The number in the plan.
    pub number: u64,
    /// The name, unique in the set: letters, digits, `-` and `_`.
    pub name: String,
    /// `train`, `val` or another name of a part of the set.
    pub split: String,
    /// The first instant, nanoseconds since 1970 (UTC). Clips do not overlap.
    pub start: i64,
    /// Seconds from the first frame to the end of the last.
    pub seconds: f64,
    /// The place.
    pub place: PlaceInfo,
    /// The weather.
    pub weather: WeatherInfo,
}

impl ClipInfo {
    /// The folder of its own, in that of its split.
    pub(crate) fn folder(&self) -> String {
        format!("{}/{}", self.split, self.name)
    }
}

/// The place of a clip.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct PlaceInfo {
    /// The name: letters, digits, `-` and `_`.
    #[serde(rename = "place")]
    pub name: String,
    /// Latitude and longitude, degrees, of the world's origin, and its height, m; `None` where they
    /// are not known.
    pub origin: Option<[f64; 3]>,
    /// True if the world's x is east and y is north.
    pub is_north_known: bool,
}

/// The weather of a clip.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct WeatherInfo {
    /// The name of the weather: letters, digits, `-` and `_`.
    #[serde(rename = "weather")]
    pub name: String,
    /// The condition that prevails.
    pub condition: Condition,
    /// Visibility, m (5 % of light is left): of fog, haze, smog and what falls together; infinite
    /// in clear air.
    #[serde(deserialize_with = "read_mor")]
    pub mor: f64,
    /// Rain, mm/h.
    pub rain_rate: f64,
    /// Snowfall, mm/h of water.
    pub snow_rate: f64,
    /// True if it is dark without lamps.
    pub is_night: bool,
    /// The weather as a weather file.
    #[serde(rename = "weather_file")]
    pub file: String,
}

/// Reads a visibility: JSON has no infinite number.
fn read_mor<'de, D: Deserializer<'de>>(from: D) -> Result<f64, D::Error> {
    Ok(Option::deserialize(from)?.unwrap_or(f64::INFINITY))
}

/// The condition that prevails in a weather, by which data sets sort their pictures.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Condition {
    /// None of the others.
    Clear,
    /// Fog, haze or smog.
    Fog,
    /// Rain.
    Rain,
    /// Snow that falls or lies.
    Snow,
    /// Dust in the air.
    Dust,
    /// Night without any of the others.
    Night,
}

impl Condition {
    /// All of them.
    pub const ALL: [Self; 6] = [Self::Clear, Self::Fog, Self::Rain, Self::Snow, Self::Dust, Self::Night];

    /// The name in files.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Clear => "clear",
            Self::Fog => "fog",
            Self::Rain => "rain",
            Self::Snow => "snow",
            Self::Dust => "dust",
            Self::Night => "night",
        }
    }
}

/// The place of a reading in its clip, without what was read: known from the plan alone.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct ReadingInfo {
    /// Index into [`SetInfo::sensors`].
    pub sensor: usize,
    /// Index among the readings of the sensor in the clip, from 0.
    pub index: u32,
    /// The frame of the clip that it belongs to.
    pub frame: u32,
    /// True if it is the sensor's reading of that frame: the first at or after the frame's time.
    /// There is one for each sensor and frame.
    #[serde(rename = "key")]
    pub is_key: bool,
    /// The block that its files are made in.
    pub block: u32,
    /// Seconds since the start of the clip.
    pub time: f64,
    /// The pose of the rig then.
    #[serde(rename = "rig", serialize_with = "write_pose", deserialize_with = "read_pose")]
    pub world_from_rig: RigidPose,
}

/// Writes a pose as x y z (m), then the quaternion w x y z.
fn write_pose<S: Serializer>(pose: &RigidPose, out: S) -> Result<S::Ok, S::Error> {
    let (t, q) = (pose.translation, pose.rotation);
    [t.x, t.y, t.z, q.w, q.x, q.y, q.z].serialize(out)
}

fn read_pose<'de, D: Deserializer<'de>>(from: D) -> Result<RigidPose, D::Error> {
    let [x, y, z, w, a, b, c] = <[f64; 7]>::deserialize(from)?;
    Ok(RigidPose { rotation: DQuat::from_xyzw(a, b, c, w), translation: DVec3::new(x, y, z) })
}

impl ReadingInfo {
    /// Nanoseconds since 1970.
    #[must_use]
    pub fn timestamp(&self, clip: &ClipInfo) -> i64 {
        clip.start + (self.time * 1e9).round() as i64
    }

    /// The pose of the sensor.
    #[must_use]
    pub fn world_from_sensor(&self, set: &SetInfo) -> RigidPose {
        self.world_from_rig.then(&set.sensors[self.sensor].rig_from_sensor)
    }
}

/// A reading: the data of one sensor at one time.
#[derive(Clone, Copy, Debug)]
pub struct SensorReading<'a> {
    /// The place in the clip: time and pose.
    pub info: ReadingInfo,
    /// The data.
    pub data: ReadingData<'a>,
}

/// The data of a [`SensorReading`].
#[derive(Clone, Copy, Debug)]
pub enum ReadingData<'a> {
    /// A picture.
    Picture(PictureReading<'a>),
    /// The points of a lidar's sweep in the order of time, in the sensor's axes at the start of the
    /// sweep.
    Points(&'a [DatasetPoint]),
    /// The detections of a radar, in the sensor's axes.
    Detections(&'a [DatasetDetection]),
}

/// A picture of size `[H, W]`.
#[derive(Clone, Copy, Debug)]
pub struct PictureReading<'a> {
    /// `[H, W, 3]`, sRGB.
    pub rgb: &'a [u8],
    /// The view without weather, `[H, W, 3]`, sRGB; given if the layout needs it.
    pub clean: Option<&'a [u8]>,
    /// `[H, W]`, m along the view axis, of the surface that the flow follows; 0 in the sky; given
    /// if the layout needs it.
    pub depth: Option<&'a [f32]>,
    /// `[H, W, 2]`, px: the way to where the point is seen in the sensor's next picture, x right
    /// and y down; given if the layout needs it.
    pub flow: Option<&'a [f32]>,
    /// `[H, W]`: what becomes of each point there, given with the flow: 0 is seen, 1 hidden, 2 out
    /// of the picture, 3 not known.
    pub flow_states: Option<&'a [u8]>,
}

/// A point of a lidar.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DatasetPoint {
    /// m, axes of the sensor at the start of the sweep.
    pub position: [f32; 3],
    /// m from the sensor.
    pub range: f32,
    /// 0 to 255.
    pub intensity: f32,
    /// Seconds since the start of the sweep.
    pub time: f32,
    /// Azimuth from x forward towards y left, and elevation, radians.
    pub angles: [f32; 2],
    /// Row, the highest is 0.
    pub ring: u16,
    /// The number of the return, from 0.
    pub rank: u8,
    /// The source of its light.
    pub source: PointSource,
    /// The label of the surface, from 1; 0 if it has none.
    pub label: u16,
}

/// The source of light that comes back to a lidar.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PointSource {
    /// A surface of the scene, or snow that lies on it.
    Surface,
    /// A drop of rain, or a hailstone.
    Rain,
    /// A snowflake.
    Snow,
    /// Fog, haze, smog or dust.
    Air,
    /// A surface that wet ground mirrors: it is not where the point is.
    Ghost,
}

impl PointSource {
    /// Returns true if the weather made the point.
    #[must_use]
    pub fn is_weather(self) -> bool {
        self != Self::Surface
    }
}

/// A detection of a radar.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DatasetDetection {
    /// m, axes of the sensor.
    pub position: [f32; 3],
    /// Radial velocity, m/s, below 0 of what comes nearer.
    pub velocity: f32,
    /// Radial velocity over the ground, m/s: the motion of the sensor is taken out.
    pub ground_velocity: f32,
    /// dB over 1 m^2.
    pub rcs: f32,
    /// Power over what is around it, dB.
    pub snr: f32,
    /// True if rain made it.
    pub is_rain: bool,
}

/// A part of a clip whose files are written together.
#[derive(Clone, Copy, Debug)]
pub struct BlockInfo<'a> {
    /// The set.
    pub set: &'a SetInfo,
    /// The clip.
    pub clip: &'a ClipInfo,
    /// The number of the block in its clip.
    pub number: u32,
    /// Readings of the block, in the order of time, then of sensors.
    pub readings: &'a [ReadingInfo],
}

/// A clip with all of its readings.
#[derive(Clone, Debug)]
pub struct ClipRecord {
    /// The clip.
    pub clip: ClipInfo,
    /// All of its readings, in the order of time, then of sensors.
    pub readings: Vec<ReadingInfo>,
}
