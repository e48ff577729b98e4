//! Driving logs: what the cameras and lidars of a vehicle recorded, from the formats in which such
//! recordings are published.
//!
//! [`DrivingLog::open`] recognises a folder and reads calibrations, poses and boxes; photos and
//! sweeps are opened when they are needed. [`DrivingLog::write_capture`] makes a folder of it that
//! is reconstructed like any other capture. To add a format: a module with a `FORMAT`, and its name
//! in the list.

mod capture;
mod files;
#[cfg(test)]
mod gap_tests;
mod log;
#[cfg(any(test, feature = "testing"))]
pub mod mini;
mod records;
mod sweep;
#[cfg(test)]
mod tests;
mod track;

use std::path::Path;
use wm_base::FormatError;

pub use capture::{LogCaptureOptions, LogCaptureStep, LogCaptureSummary};
pub(crate) use files::read_json;
use log::LogFormat;
pub use log::{DrivingLog, LogCamera, LogPicture, LogPictureMasks};
pub use records::LogOptions;
pub use sweep::{LogPoint, LogSweep};
pub use track::{LogBox, LogTrack};

macro_rules! logs {
    ($($name:ident),+ $(,)?) => {
        $(mod $name;)+

        /// Every format of driving logs, in the order in which they are tried.
        const LOG_FORMATS: &[LogFormat] = &[$($name::FORMAT),+];
    };
}

logs! { kitti_raw, kitti_odometry, nuscenes, argoverse, drivestudio }

mod kitti;
mod kitti_tracklets;

impl DrivingLog {
    /// Opens a log; `None` if the folder is none of a known format.
    ///
    /// # Errors
    /// [`FormatError`] if it is one, and a file of it is missing or wrong.
    pub fn open(path: &Path, options: &LogOptions) -> Result<Option<Self>, FormatError> {
        if !path.is_dir() {
            return Ok(None);
        }
        for format in LOG_FORMATS {
            if let Some(log) = (format.read)(path, options)? {
                return Ok(Some(log.finished(format.name, options)?));
            }
        }
        Ok(None)
    }
}
