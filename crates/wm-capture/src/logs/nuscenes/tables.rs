//! Records of nuScenes' tables, as far as they are read.

use serde::de::Error as _;
use serde::{Deserialize, Deserializer};

#[derive(Deserialize)]
pub(super) struct SceneRecord {
    pub(super) token: String,
    pub(super) name: String,
    pub(super) log_token: String,
}

#[derive(Deserialize)]
pub(super) struct MapLogRecord {
    pub(super) token: String,
    pub(super) location: String,
}

#[derive(Deserialize)]
pub(super) struct SampleRecord {
    pub(super) token: String,
    pub(super) scene_token: String,
    #[serde(deserialize_with = "microseconds")]
    pub(super) timestamp: i64,
}

#[derive(Deserialize)]
pub(super) struct DataRecord {
    pub(super) sample_token: String,
    pub(super) ego_pose_token: String,
    pub(super) calibrated_sensor_token: String,
    #[serde(deserialize_with = "microseconds")]
    pub(super) timestamp: i64,
    pub(super) height: Option<f64>,
    pub(super) width: Option<f64>,
    pub(super) filename: String,
}

/// The part of a record that says whether a scene's files are there.
#[derive(Deserialize)]
pub(super) struct FileRecord {
    pub(super) sample_token: String,
    pub(super) calibrated_sensor_token: String,
    #[serde(default = "always")]
    pub(super) is_key_frame: bool,
    pub(super) filename: String,
}

fn always() -> bool {
    true
}

/// Microseconds, which Lyft's sets have as floating-point numbers.
fn microseconds<'de, D: Deserializer<'de>>(deserializer: D) -> Result<i64, D::Error> {
    #[derive(Deserialize)]
    #[serde(untagged)]
    enum Time {
        Whole(i64),
        Part(f64),
    }
    let told = |what| D::Error::custom(format!("{what} is no time in microseconds"));
    match Time::deserialize(deserializer).map_err(|_| told("a timestamp".to_owned()))? {
        Time::Whole(time) => Ok(time),
        Time::Part(time) if time.abs() < 9e18 => Ok(time.round() as i64),
        Time::Part(time) => Err(told(time.to_string())),
    }
}

#[derive(Deserialize)]
pub(super) struct PoseRecord {
    pub(super) token: String,
    pub(super) translation: [f64; 3],
    pub(super) rotation: [f64; 4],
}

#[derive(Deserialize)]
pub(super) struct CalibratedRecord {
    pub(super) token: String,
    pub(super) sensor_token: String,
    pub(super) translation: [f64; 3],
    pub(super) rotation: [f64; 4],
    pub(super) camera_intrinsic: Vec<Vec<f64>>,
}

#[derive(Deserialize)]
pub(super) struct SensorRecord {
    pub(super) token: String,
    pub(super) channel: String,
    pub(super) modality: String,
}

#[derive(Deserialize)]
pub(super) struct NamedRecord {
    pub(super) token: String,
    pub(super) name: String,
}

#[derive(Deserialize)]
pub(super) struct InstanceRecord {
    pub(super) token: String,
    pub(super) category_token: String,
}

#[derive(Deserialize)]
pub(super) struct AnnotationRecord {
    pub(super) sample_token: String,
    pub(super) instance_token: String,
    #[serde(default)]
    pub(super) attribute_tokens: Vec<String>,
    pub(super) translation: [f64; 3],
    /// Width, length, height.
    pub(super) size: [f64; 3],
    pub(super) rotation: [f64; 4],
}
