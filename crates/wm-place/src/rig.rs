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

use crate::camera_model::{CameraExposure, CameraModel, ReadoutSide, SensorNoise, Shutter};
use crate::lens_view::{LensSpec, LensView};
use crate::motion::{CameraMotion, Mount};
use crate::{Error, Result};
use glam::{DMat3, DMat4, DVec3};
use serde::Deserialize;
use std::path::Path;
use wm_scene::Camera;
use wm_scene::camera::FOV;
use wm_sensors::radar::RadarModel;
use wm_sensors::{LidarModel, PointFormat, ReturnMode, SubRays};

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
    pub device: RigDevice,
}

/// A device on a rig.
#[derive(Clone, Debug)]
pub enum RigDevice {
    /// A camera.
    Camera {
        /// The size, the focal lengths and the principal point of its pictures.
        intrinsics: Box<Camera>,
        /// Lens, shutter, exposure and noise.
        model: Box<CameraModel>,
    },
    /// A lidar.
    Lidar {
        /// The model.
        model: Box<LidarModel>,
        /// Rays of a pulse.
        sub_rays: SubRays,
        /// The returns that become points.
        returns: ReturnMode,
        /// The format of the files of points.
        format: PointFormat,
    },
    /// A radar.
    Radar {
        /// The model.
        model: Box<RadarModel>,
        /// The format of the files of detections.
        format: PointFormat,
    },
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
        let intrinsics = match &self.device {
            RigDevice::Camera { intrinsics, .. } => **intrinsics,
            RigDevice::Lidar { .. } | RigDevice::Radar { .. } => base.camera(0.0),
        };
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
    sensor: Vec<toml::Spanned<SensorEntry>>,
}

/// A sensor of a rig file.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct SensorEntry {
    name: String,
    kind: Kind,
    /// m: forward, left, up.
    #[serde(default)]
    position: [f64; 3],
    /// Degrees: roll, pitch, yaw.
    rotation: Option<[f64; 3]>,
    /// `rig_from_sensor`: w, x, y, z.
    quaternion: Option<[f64; 4]>,
    rate: Option<f64>,
    #[serde(default)]
    phase: f64,
    size: Option<[u32; 2]>,
    fov: Option<f64>,
    lens: Option<String>,
    exposure_time: Option<f64>,
    readout: Option<f64>,
    readout_from: Option<String>,
    exposure: Option<toml::Value>,
    iso: Option<f64>,
    noise_seed: Option<u64>,
    model: Option<String>,
    sub_rays: Option<u32>,
    returns: Option<String>,
    format: Option<String>,
}

#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Eq)]
#[serde(rename_all = "lowercase")]
enum Kind {
    Camera,
    Lidar,
    Radar,
}

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
        for entry in &file.sensor {
            let at = Some(entry.span().start);
            let entry = entry.get_ref();
            let sensor = entry
                .sensor(folder)
                .map_err(|says| fault(at, format!("sensor \"{}\": {says}", entry.name)))?;
            if sensors.iter().any(|other| other.name.eq_ignore_ascii_case(&sensor.name)) {
                return Err(fault(
                    at,
                    format!("there are two sensors \"{}\": each needs a name of its own", sensor.name),
                ));
            }
            sensors.push(sensor);
        }
        Ok(Self { sensors })
    }
}

impl SensorEntry {
    fn sensor(&self, folder: &Path) -> Result<RigSensor, String> {
        let is_word = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
        if self.name.is_empty() || self.name.len() > 64 || !self.name.chars().all(is_word) {
            return Err("its name becomes a folder: use letters, digits, - and _".into());
        }
        let device = match self.kind {
            Kind::Camera => self.camera(folder)?,
            Kind::Lidar => self.lidar(folder)?,
            Kind::Radar => self.radar(folder)?,
        };
        let own_rate = match &device {
            RigDevice::Camera { .. } => None,
            RigDevice::Lidar { model, .. } => Some(1.0 / model.period()),
            RigDevice::Radar { model, .. } => Some(model.rate),
        };
        let rate = match (self.rate, own_rate) {
            (Some(rate), Some(own)) if (rate / own - 1.0).abs() > RATE_TOLERANCE => {
                return Err(format!("rate is {rate}, and that of its model is {own} Hz: leave it out"));
            }
            (Some(rate), _) if rate > 0.0 && rate <= MAX_RATE_HZ => rate,
            (Some(rate), _) => {
                return Err(format!("rate is {rate}: it must be above 0 and up to {MAX_RATE_HZ} Hz"));
            }
            (None, Some(own)) => own,
            (None, None) => return Err("rate is missing: pictures a second".into()),
        };
        if !(0.0..=3600.0).contains(&self.phase) {
            return Err(format!("phase is {}: it must be from 0 to 3600 s", self.phase));
        }
        Ok(RigSensor { name: self.name.clone(), mount: self.mount()?, rate, phase: self.phase, device })
    }

    fn mount(&self) -> Result<Mount, String> {
        let position = DVec3::from_array(self.position);
        if !position.is_finite() || position.length() > MAX_OFFSET_M {
            return Err(format!("position is {:?}: it must be within {MAX_OFFSET_M} m", self.position));
        }
        let rotation = match (self.rotation, self.quaternion) {
            (Some(_), Some(_)) => return Err("give rotation or quaternion, not both".into()),
            (Some(angles), None) => {
                if !angles.iter().all(|angle| angle.is_finite()) {
                    return Err(format!("rotation is {angles:?}: it must be three angles in degrees"));
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
        Ok(Mount { position, rig_from_sensor: rotation })
    }

    /// Returns an error if an option of the other kind is given.
    fn refuse(&self, given: &[(&str, bool)], kind: &str) -> Result<(), String> {
        match given.iter().find(|(_, is_given)| *is_given) {
            Some((key, _)) => Err(format!("{key} is not for a {kind}")),
            None => Ok(()),
        }
    }

    fn camera(&self, folder: &Path) -> Result<RigDevice, String> {
        let of_lidars = [
            ("model", self.model.is_some()),
            ("sub_rays", self.sub_rays.is_some()),
            ("returns", self.returns.is_some()),
            ("format", self.format.is_some()),
        ];
        self.refuse(&of_lidars, "camera")?;
        let size = self.size.map(|[width, height]| (width, height));
        let lens: Option<LensView> = match &self.lens {
            None => None,
            Some(_) if self.fov.is_some() => {
                return Err("fov: a lens has its own; give fisheye:DEGREES".into());
            }
            Some(lens) => {
                let spec = match lens.parse::<LensSpec>()? {
                    LensSpec::File(file) => LensSpec::File(folder.join(file)),
                    other => other,
                };
                Some(spec.view(size).map_err(|error| error.to_string())?)
            }
        };
        let intrinsics = match &lens {
            Some(lens) => *lens.intrinsics(),
            None => {
                let fov = self.fov.unwrap_or(Camera::DEFAULT_FOV_Y);
                if !FOV.contains(&fov) {
                    return Err(format!("fov is {fov}: it must be 0.1 to 170 degrees"));
                }
                let size = size.unwrap_or(Camera::DEFAULT_SIZE);
                let camera = Camera::looking(size, fov, DVec3::ZERO, DVec3::X, DVec3::Z);
                let camera = camera.and_then(|camera| camera.check().map(|()| camera));
                Camera { viewmat: DMat4::IDENTITY, ..camera.map_err(|error| error.to_string())? }
            }
        };
        let first = match &self.readout_from {
            Some(side) => side.parse()?,
            None => ReadoutSide::default(),
        };
        let exposure = match &self.exposure {
            None => CameraExposure::default(),
            Some(toml::Value::String(text)) => text.parse()?,
            Some(toml::Value::Integer(stops)) => stops.to_string().parse()?,
            Some(toml::Value::Float(stops)) => stops.to_string().parse()?,
            Some(_) => return Err("exposure must be \"auto\" or stops".into()),
        };
        let shutter = Shutter {
            exposure: self.exposure_time.unwrap_or(0.0),
            readout: self.readout.unwrap_or(0.0),
            first,
        };
        shutter.check()?;
        let noise = self.iso.map(|iso| SensorNoise {
            iso,
            seed: self.noise_seed.unwrap_or(0),
            ..SensorNoise::default()
        });
        noise.iter().try_for_each(SensorNoise::check)?;
        let model = CameraModel { lens, shutter, exposure, noise };
        Ok(RigDevice::Camera { intrinsics: Box::new(intrinsics), model: Box::new(model) })
    }

    /// Returns an error if an option of cameras is given to another kind.
    fn refuse_camera_options(&self, kind: &str) -> Result<(), String> {
        let of_cameras = [
            ("size", self.size.is_some()),
            ("fov", self.fov.is_some()),
            ("lens", self.lens.is_some()),
            ("exposure_time", self.exposure_time.is_some()),
            ("readout", self.readout.is_some()),
            ("readout_from", self.readout_from.is_some()),
            ("exposure", self.exposure.is_some()),
            ("iso", self.iso.is_some()),
            ("noise_seed", self.noise_seed.is_some()),
        ];
        self.refuse(&of_cameras, kind)
    }

    /// The name of the model of a kind, or its file: those are beside the rig's.
    fn model(&self, folder: &Path, kind: &str) -> Result<String, String> {
        let missing = || format!("model is missing: the name of a {kind}, or a TOML file");
        let name = self.model.as_deref().ok_or_else(missing)?;
        let is_file = name.to_lowercase().ends_with(".toml");
        Ok(if is_file { folder.join(name).to_string_lossy().into_owned() } else { name.to_owned() })
    }

    fn radar(&self, folder: &Path) -> Result<RigDevice, String> {
        self.refuse_camera_options("radar")?;
        let of_lidars = [("sub_rays", self.sub_rays.is_some()), ("returns", self.returns.is_some())];
        self.refuse(&of_lidars, "radar")?;
        let model = RadarModel::find(&self.model(folder, "radar")?).map_err(|error| error.to_string())?;
        let format = self.format.as_deref().unwrap_or("ply");
        let format = PointFormat::of_detections(Path::new(&format!("points.{format}")))
            .map_err(|_| format!("format is `{format}`: use ply, pcd or npy"))?;
        Ok(RigDevice::Radar { model: Box::new(model), format })
    }

    fn lidar(&self, folder: &Path) -> Result<RigDevice, String> {
        self.refuse_camera_options("lidar")?;
        let model = LidarModel::find(&self.model(folder, "lidar")?).map_err(|error| error.to_string())?;
        let sub_rays = match self.sub_rays {
            None => SubRays::default(),
            Some(count) => {
                SubRays::of_count(count as usize).ok_or_else(|| format!("sub_rays is {count}: use 1 or 7"))?
            }
        };
        let returns = match &self.returns {
            None => ReturnMode::default(),
            Some(name) => name.parse().map_err(|error| format!("returns is {error}"))?,
        };
        let format = self.format.as_deref().unwrap_or("ply");
        let format = PointFormat::of(Path::new(&format!("points.{format}")))
            .map_err(|_| format!("format is `{format}`: use ply, pcd, npy, las or bin"))?;
        Ok(RigDevice::Lidar { model: Box::new(model), sub_rays, returns, format })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
            ("size = [64, 48]", "sise = [64, 48]", "r, line 6: unknown field `sise`"),
            ("size = [64, 48]", "returns = \"dual\"", "returns is not for a camera"),
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
                "returns is not for a radar",
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
