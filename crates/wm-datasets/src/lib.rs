//! Data sets for perception: what sensors read, in the layouts that training code reads, and
//! driving logs as captures.
//!
//! A [`SetInfo`] says which sensors there are, a [`ClipInfo`] which drive, and a [`SensorReading`]
//! what one sensor read at one time. A [`Layout`] turns them into files; [`LAYOUTS`] lists all of
//! them. Nothing here renders: readings come from the caller.
//!
//! The other way, a [`DrivingLog`] is what a vehicle recorded, read from KITTI, nuScenes, Argoverse
//! 2 or drivestudio; [`DrivingLog::write_capture`] makes a folder of it that is reconstructed like
//! photos of any other kind.
//!
//! Files of readings are made block by block, on any machine and in any order, and the tables over
//! all of them once, from poses and times alone. So shards of a set need not know each other.

mod array_files;
mod cameras;
mod error;
mod feather;
mod layouts;
pub mod logs;
mod picture_files;
mod pose;
mod set;
mod stills;
#[cfg(any(test, feature = "testing"))]
pub mod testing;
mod utc;

pub use error::SetError;
pub use layouts::{BlockWriter, ClipStream, FileSink, LAYOUTS, LayerNeeds, Layout};
pub use logs::{DrivingLog, LogCaptureOptions, LogCaptureSummary, LogOptions};
pub use pose::RigidPose;
pub use set::{
    BlockInfo, CameraInfo, ClipInfo, ClipRecord, Condition, DatasetDetection, DatasetPoint, PictureReading,
    PlaceInfo, PointSource, ReadingData, ReadingInfo, SensorInfo, SensorInfoKind, SensorReading, SetInfo,
    WeatherInfo,
};
