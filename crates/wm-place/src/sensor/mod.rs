//! Sensors of a rig behind one trait: a kind of sensor is a file here and a line of
//! [`SENSOR_KINDS`], and says what it is called in rig files, what it needs, and what it reads.

mod camera;
mod device;
mod entry;
mod events;
mod lidar;
mod radar;

pub use device::{RigCamera, Sensor, SensorData, SensorInstant, SensorKind, SensorRun};
pub use entry::{EntryFault, SensorEntry};
pub use events::RigEventCamera;
pub use lidar::RigLidar;
pub use radar::RigRadar;

/// Every kind of sensor.
pub const SENSOR_KINDS: &[SensorKind] = &[camera::KIND, lidar::KIND, radar::KIND, events::KIND];
