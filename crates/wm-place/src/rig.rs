//! Rigs: cameras, lidars and radars on one car, drone or mast, each with its pose, its rate and its
//! phase.
//!
//! ```
//! use wm_place::rig::Rig;
//!
//! let rig = Rig::parse(
//!     r#"
//!     [[sensor]]
//!     name = "front"
//!     kind = "camera"
//!     position = [1.2, 0.0, 0.3]     # m from the origin of the rig: forward, left, up
//!     rotation = [0.0, 0.0, 5.0]     # degrees: roll, pitch, yaw
//!     rate = 20.0                    # pictures a second
//!     size = [640, 360]              # px
//!     fov = 60.0                     # degrees, vertical
//!     readout = 0.02                 # s
//!
//!     [[sensor]]
//!     name = "top"
//!     kind = "lidar"
//!     model = "vlp-16"
//!     position = [0.0, 0.0, 0.4]
//!     "#,
//!     "rig.toml",
//! )?;
//! assert_eq!(rig.sensors.len(), 2);
//! assert_eq!(rig.sensors[0].times(0.0, 1.0).count(), 20);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use crate::motion::{CameraMotion, Mount};
use crate::sensor::{EntryFault, SENSOR_KINDS, Sensor, SensorEntry, SensorKind};
use crate::{Error, Result};
use glam::{DMat3, DVec3};
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

/// Longest file that is read, bytes.
const MAX_BYTES: u64 = 1 << 20;
/// Most sensors: lidars have so many random numbers of their own.
const MAX_SENSORS: usize = 64;
/// Most pictures or sweeps a second.
const MAX_RATE_HZ: f64 = 10_000.0;
/// Farthest that a sensor may be from the origin of its rig, m.
const MAX_OFFSET_M: f64 = 1000.0;
/// Tolerance of rates that are said twice.
const RATE_TOLERANCE: f64 = 1e-6;

/// Sensors that move together.
#[derive(Clone, Debug)]
pub struct Rig {
    /// The sensors, in the order of the file.
    pub sensors: Vec<RigSensor>,
}

/// One sensor of a rig.
#[derive(Clone, Debug)]
pub struct RigSensor {
    /// The name: letters, digits, `-` and `_`.
    pub name: String,
    /// The pose on the rig.
    pub mount: Mount,
    /// Pictures or sweeps a second.
    pub rate: f64,
    /// The time of its first picture or sweep after the start, s.
    pub phase: f64,
    /// The device.
    pub device: Arc<dyn Sensor>,
}

impl RigSensor {
    /// The numbers and the times of its pictures or sweeps from a start, for so many seconds.
    pub fn times(&self, start: f64, seconds: f64) -> impl Iterator<Item = (u32, f64)> + use<> {
        let (rate, phase) = (self.rate, self.phase);
        let time = move |index: u32| (index, start + phase + f64::from(index) / rate);
        // What begins at the end is not of the interval, in spite of rounding.
        let end = start + seconds - 1e-9;
        (0..u32::MAX).map(time).take_while(move |(_, time)| *time < end)
    }

    /// The motion of the sensor on a rig that moves as `base` does.
    #[must_use]
    pub fn motion(&self, base: &CameraMotion, metres_per_unit: f64) -> CameraMotion {
        let intrinsics = self.device.intrinsics().map_or_else(|| base.camera(0.0), |own| *own);
        CameraMotion::Mounted {
            base: Box::new(base.clone()),
            mount: self.mount,
            intrinsics: Box::new(intrinsics),
            metres_per_unit,
        }
    }
}

/// A rig file.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct RigFile {
    #[serde(default)]
    sensor: Vec<toml::Spanned<BTreeMap<String, toml::Spanned<toml::Value>>>>,
}

/// The keys that every kind of sensor has.
const COMMON_KEYS: [&str; 7] = ["name", "kind", "position", "rotation", "quaternion", "rate", "phase"];

impl Rig {
    /// Reads a rig from a TOML file; lenses and lidars in files of their own are found beside it.
    ///
    /// # Errors
    /// [`Error::Unsupported`] with the file, the line and the fault.
    pub fn read(path: &Path) -> Result<Self> {
        let fault = |says: String| Error::Unsupported(format!("{}: {says}", path.display()));
        let length =
            std::fs::metadata(path).map_err(|error| fault(format!("cannot be read: {error}")))?.len();
        if length > MAX_BYTES {
            return Err(fault("too long for a rig; give a TOML file".into()));
        }
        let text = wm_base::files::read_text(path, wm_base::files::SMALL_TEXT)
            .map_err(|error| fault(format!("cannot be read: {error}")))?;
        let folder = path.parent().unwrap_or(Path::new(""));
        Self::of_text(&text, &path.display().to_string(), folder)
    }

    /// The rig of a text in TOML; `name` stands in errors. Files that it names are found in the
    /// current folder.
    ///
    /// # Errors
    /// As [`Self::read`].
    pub fn parse(text: &str, name: &str) -> Result<Self> {
        Self::of_text(text, name, Path::new(""))
    }

    fn of_text(text: &str, name: &str, folder: &Path) -> Result<Self> {
        let line_of = |at: usize| 1 + text[..at.min(text.len())].matches('\n').count();
        let fault = |at: Option<usize>, says: String| {
            let line = at.map_or_else(String::new, |at| format!(", line {}", line_of(at)));
            Error::Unsupported(format!("{name}{line}: {says}; correct the rig"))
        };
        let file: RigFile = toml::from_str(text).map_err(|error| {
            let says = error.message().split_whitespace().collect::<Vec<_>>().join(" ");
            fault(error.span().map(|span| span.start), says)
        })?;
        if file.sensor.len() > MAX_SENSORS {
            return Err(fault(
                None,
                format!("it has {} sensors: {MAX_SENSORS} are the most", file.sensor.len()),
            ));
        }
        if file.sensor.is_empty() {
            return Err(fault(None, "it has no sensor: give one or more [[sensor]]".into()));
        }
        let mut sensors: Vec<RigSensor> = Vec::new();
        for table in &file.sensor {
            let entry = SensorEntry::new(table.get_ref(), folder);
            let own = |of: EntryFault| {
                let name = entry.get::<String>("name").ok().flatten().unwrap_or_default();
                let says = if name.is_empty() { of.says } else { format!("sensor \"{name}\": {}", of.says) };
                fault(Some(of.at.unwrap_or(table.span().start)), says)
            };
            let sensor = RigSensor::read(&entry).map_err(&own)?;
            if sensors.iter().any(|other| other.name.eq_ignore_ascii_case(&sensor.name)) {
                let says = format!("there are two sensors \"{}\": each needs a name of its own", sensor.name);
                return Err(fault(Some(table.span().start), says));
            }
            sensors.push(sensor);
        }
        Ok(Self { sensors })
    }
}

/// Checks that a sensor has keys of its kind alone.
fn check_keys(entry: &SensorEntry<'_>, kind: &SensorKind) -> Result<(), EntryFault> {
    let is_its_own = |key: &str| COMMON_KEYS.contains(&key) || kind.keys.contains(&key);
    let Some((key, at)) = entry.keys().find(|(key, _)| !is_its_own(key)) else { return Ok(()) };
    let is_known = SENSOR_KINDS.iter().any(|other| other.keys.contains(&key));
    let says = match is_known {
        true => format!("{key} is not for kind {}", kind.name),
        false => format!("unknown field `{key}`; kind {} has {}", kind.name, kind.keys.join(", ")),
    };
    Err(EntryFault { at: Some(at), says })
}

impl RigSensor {
    fn read(entry: &SensorEntry<'_>) -> Result<Self, EntryFault> {
        let name: String = entry.get("name")?.ok_or("missing field `name`")?;
        let is_word = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
        if name.is_empty() || name.len() > 64 || !name.chars().all(is_word) {
            return Err("its name becomes a folder: use letters, digits, - and _".into());
        }
        let kind: String = entry.get("kind")?.ok_or("missing field `kind`")?;
        let kind = SENSOR_KINDS.iter().find(|known| known.name == kind).ok_or_else(|| {
            let known: Vec<&str> = SENSOR_KINDS.iter().map(|known| known.name).collect();
            format!("kind is `{kind}`: use one of {}", known.join(", "))
        })?;
        check_keys(entry, kind)?;
        let device = (kind.read)(entry)?;
        let rate = match (entry.get::<f64>("rate")?, device.own_rate()) {
            (Some(rate), Some(own)) if (rate / own - 1.0).abs() > RATE_TOLERANCE => {
                return Err(format!("rate is {rate}, and that of its model is {own} Hz: leave it out").into());
            }
            (Some(rate), _) if rate > 0.0 && rate <= MAX_RATE_HZ => rate,
            (Some(rate), _) => {
                return Err(format!("rate is {rate}: it must be above 0 and up to {MAX_RATE_HZ} Hz").into());
            }
            (None, Some(own)) => own,
            (None, None) => return Err("rate is missing: pictures a second".into()),
        };
        let phase = entry.get("phase")?.unwrap_or(0.0);
        if !(0.0..=3600.0).contains(&phase) {
            return Err(format!("phase is {phase}: it must be from 0 to 3600 s").into());
        }
        Ok(Self { name, mount: mount(entry)?, rate, phase, device })
    }
}

/// The pose of a sensor on its rig.
fn mount(entry: &SensorEntry<'_>) -> Result<Mount, EntryFault> {
    let position = entry.get::<[f64; 3]>("position")?.unwrap_or_default();
    let (rotation, quaternion) = (entry.get::<[f64; 3]>("rotation")?, entry.get::<[f64; 4]>("quaternion")?);
    let at = DVec3::from_array(position);
    if !at.is_finite() || at.length() > MAX_OFFSET_M {
        return Err(format!("position is {position:?}: it must be within {MAX_OFFSET_M} m").into());
    }
    let rig_from_sensor = match (rotation, quaternion) {
        (Some(_), Some(_)) => return Err("give rotation or quaternion, not both".into()),
        (Some(angles), None) => {
            if !angles.iter().all(|angle| angle.is_finite()) {
                return Err(format!("rotation is {angles:?}: it must be three angles in degrees").into());
            }
            let [roll, pitch, yaw] = angles.map(f64::to_radians);
            DMat3::from_rotation_z(yaw) * DMat3::from_rotation_y(pitch) * DMat3::from_rotation_x(roll)
        }
        (None, Some([w, x, y, z])) => {
            let turn = glam::DQuat::from_xyzw(x, y, z, w);
            if !turn.is_finite() || (turn.length() - 1.0).abs() > 1e-2 {
                return Err("quaternion must be w, x, y, z of length 1".into());
            }
            DMat3::from_quat(turn.normalize())
        }
        (None, None) => DMat3::IDENTITY,
    };
    Ok(Mount { position: at, rig_from_sensor })
}

#[cfg(test)]
mod tests {
    use super::*;
    use wm_scene::Camera;

    const TEXT: &str = "[[sensor]]\nname = \"front\"\nkind = \"camera\"\nrate = 10\nphase = 0.02\nsize = [64, 48]\n\
                        [[sensor]]\nname = \"top\"\nkind = \"lidar\"\nmodel = \"vlp-16\"\n";

    #[test]
    fn sensors_have_their_poses_and_times() {
        let rig = Rig::parse(
            &TEXT.replace("[64, 48]", "[64, 48]\nposition = [1, 2, 3]\nrotation = [0, 0, 90]"),
            "r",
        )
        .unwrap();
        let [front, top] = &rig.sensors[..] else { panic!() };
        let times: Vec<f64> = front.times(5.0, 0.3).map(|(_, time)| time).collect();
        assert_eq!(times.len(), 3);
        assert!((times[2] - 5.22).abs() < 1e-12);
        assert_eq!(top.rate, 10.0);
        // The rig looks along y; a yaw of 90 degrees is to its left.
        let base =
            Camera::looking((64, 48), 50.0, DVec3::new(10.0, 0.0, 0.0), DVec3::new(10.0, 5.0, 0.0), DVec3::Z)
                .unwrap();
        let motion = front.motion(&CameraMotion::from(base), 2.0);
        let camera = motion.camera(0.0);
        // 1 m ahead, 2 m to the left and 3 m up, in units of 2 m.
        assert!((camera.center() - DVec3::new(10.0 - 1.0, 0.5, 1.5)).length() < 1e-9, "{}", camera.center());
        assert!(
            (camera.forward() - DVec3::NEG_X).length() < 1e-9 && (camera.up() - DVec3::Z).length() < 1e-9
        );
    }

    #[test]
    fn faults_are_one_clear_line() {
        for (from, to, says) in [
            ("top", "front", "r, line 7: there are two sensors \"front\""),
            ("top", "Front", "there are two sensors \"Front\""),
            ("rate = 10", "rate = 0", "r, line 1: sensor \"front\": rate is 0: it must be above 0"),
            ("rate = 10", "rate = nan", "rate is NaN"),
            ("rate = 10\n", "", "rate is missing"),
            ("\"front\"", "\"../front\"", "its name becomes a folder"),
            ("phase = 0.02", "phase = -1", "phase is -1"),
            ("size = [64, 48]", "size = [0, 48]", "picture size 0x48"),
            (
                "size = [64, 48]",
                "sise = [64, 48]",
                "r, line 6: sensor \"front\": unknown field `sise`; kind camera has size,",
            ),
            ("size = [64, 48]", "returns = \"dual\"", "returns is not for kind camera"),
            (
                "kind = \"camera\"",
                "kind = \"sonar\"",
                "kind is `sonar`: use one of camera, lidar, radar, events",
            ),
            ("size = [64, 48]", "size = \"large\"", "r, line 6: sensor \"front\": size: invalid type"),
            ("size = [64, 48]", "readout = -1", "readout is -1 s"),
            ("size = [64, 48]", "lens = \"fish\"", "`fish` is not a lens"),
            ("size = [64, 48]", "quaternion = [0, 0, 0, 0]", "length 1"),
            ("size = [64, 48]", "position = [nan, 0, 0]", "position is"),
            ("vlp-16", "vlp16", "did you mean vlp-16?"),
            ("model = \"vlp-16\"", "model = \"vlp-16\"\nrate = 3", "leave it out"),
            ("model = \"vlp-16\"", "model = \"vlp-16\"\nformat = \"xyz\"", "format is `xyz`"),
            (
                "\"lidar\"\nmodel = \"vlp-16\"",
                "\"radar\"",
                "sensor \"top\": model is missing: the name of a radar",
            ),
            (
                "\"lidar\"\nmodel = \"vlp-16\"",
                "\"radar\"\nmodel = \"long-range\"",
                "`long-range` is no radar",
            ),
            (
                "\"lidar\"\nmodel = \"vlp-16\"",
                "\"radar\"\nmodel = \"long-range-77\"\nreturns = \"all\"",
                "returns is not for kind radar",
            ),
            (
                "\"lidar\"\nmodel = \"vlp-16\"",
                "\"radar\"\nmodel = \"long-range-77\"\nformat = \"las\"",
                "use ply, pcd or npy",
            ),
        ] {
            let error = Rig::parse(&TEXT.replace(from, to), "r").unwrap_err().to_string();
            assert!(error.contains(says) && !error.contains('\n'), "{error} for {to}");
        }
        assert!(Rig::parse("", "r").unwrap_err().to_string().contains("no sensor"));
        let radar = TEXT.replace("\"lidar\"\nmodel = \"vlp-16\"", "\"radar\"\nmodel = \"long-range-77\"");
        assert_eq!(Rig::parse(&radar, "r").unwrap().sensors[1].rate, 14.0);
        let many = TEXT.repeat(33);
        assert!(Rig::parse(&many, "r").unwrap_err().to_string().contains("66 sensors: 64 are the most"));
    }
}
