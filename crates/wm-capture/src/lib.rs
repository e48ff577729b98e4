//! Driving logs as captures: a [`DrivingLog`] is what a vehicle recorded, read from KITTI, nuScenes,
//! Argoverse 2 or drivestudio; [`DrivingLog::write_capture`] makes a folder of it that is
//! reconstructed like photos of any other kind.

pub mod feather;
pub mod logs;
mod pose;

pub use logs::{DrivingLog, LogCaptureOptions, LogCaptureSummary, LogOptions};
pub use pose::RigidPose;
