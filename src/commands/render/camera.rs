//! From where: a camera or a path, and the instants of the frames.

use super::OutputArgs;
use crate::scene::Loaded;
use anyhow::{Result, bail};
use clap::Args;
use std::path::PathBuf;
use weather_magician::MovingCamera;
use weather_magician::view::moves::{self, PathSpec};
use weather_magician::view::path::{CameraPath, PathKey};
use weather_magician::view::spec::{self, CameraSpec};
use weather_magician::view::{self, choose};
use wm_media::video::FrameRate;
use wm_scene::files::check_writable;
use wm_scene::{Camera, FormatError};

/// Length of a sequence where nothing says it, seconds.
const DEFAULT_SECONDS: f64 = 5.0;
/// Half the time over which a speed is taken, s: as long as an exposure.
const MOMENT: f64 = 0.01;
/// Longest sequence, frames: keeps names at six digits.
const MAX_FRAMES: u32 = 1_000_000;

/// From where, without a path.
#[derive(Args, Clone, Debug)]
pub struct LookArgs {
    /// From where: EYE:TARGET as X,Y,Z:X,Y,Z, a photo's name or number, or a JSON file of keyframes
    /// [default: chosen by looking at the scene]
    #[arg(short, long, value_name = "CAMERA", allow_hyphen_values = true, help_heading = "Camera")]
    pub camera: Option<CameraSpec>,
    /// A COLMAP model whose photos' cameras --camera may name
    #[arg(long, value_name = "FOLDER", help_heading = "Camera")]
    pub views: Option<PathBuf>,
    /// Picture size, px [default: 1280x720, or the photo's]
    #[arg(long, value_name = "WxH", allow_hyphen_values = true, value_parser = spec::parse_size, help_heading = "Camera")]
    pub size: Option<(u32, u32)>,
    /// Vertical field of view, degrees [default: 50, or the photo's]
    #[arg(long, value_name = "DEGREES", allow_negative_numbers = true, help_heading = "Camera")]
    pub fov: Option<f64>,
    /// Splats nearer than this are not drawn, scene units [default: 0.2, less in small scenes]
    #[arg(long, value_name = "UNITS", allow_negative_numbers = true, help_heading = "Camera")]
    pub near: Option<f64>,
}

/// Which camera.
#[derive(Args, Clone, Debug)]
pub struct CameraArgs {
    #[command(flatten)]
    pub look: LookArgs,
    /// Move the camera: orbit, dolly, capture (along the photos), or a JSON file of keyframes, ours, nerfstudio's or
    /// SuperSplat's
    #[arg(short, long, value_name = "PATH", help_heading = "Camera")]
    pub path: Option<PathSpec>,
    /// How far a dolly goes, metres [default: as far as nothing is in the way]
    #[arg(long, value_name = "METRES", allow_negative_numbers = true, help_heading = "Camera")]
    pub distance: Option<f64>,
    /// Speed of a camera that stands on no path, metres a second ahead, as of a car: rain and snow come towards it
    #[arg(long, value_name = "M/S", allow_negative_numbers = true, help_heading = "Camera")]
    pub camera_speed: Option<f64>,
    /// Write the camera's path to this JSON file: as keyframes, as nerfstudio does in a ...camera_path.json, or as SuperSplat in a ...settings.json
    #[arg(long, value_name = "FILE", help_heading = "Camera")]
    pub save_path: Option<PathBuf>,
}

impl LookArgs {
    /// What can be wrong without a scene.
    pub fn check(&self) -> Result<()> {
        if let Some(fov) = self.fov
            && !(fov > 0.0 && fov < 180.0)
        {
            bail!("--fov {fov}: must be above 0 and below 180 degrees");
        }
        if let Some(near) = self.near
            && !(near.is_finite() && near > 0.0)
        {
            bail!("--near {near}: must be finite and above 0");
        }
        if let Some(CameraSpec::File(file)) = &self.camera {
            std::fs::metadata(file).map_err(|error| FormatError::reading(file, error))?;
        }
        Ok(())
    }

    /// The options that are given by hand.
    pub fn options(&self) -> view::ViewOptions {
        view::ViewOptions { up: None, fov: self.fov, near: self.near, size: self.size }
    }

    /// The camera that is asked for or chosen, said on the error stream if chosen.
    pub fn start(&self, loaded: &mut Loaded) -> Result<Camera> {
        let options = self.options();
        if let Some(spec) = &self.camera {
            return Ok(spec.camera(&loaded.place.scene().views, loaded.place.survey(), &options)?);
        }
        let chosen = choose::choose(&mut loaded.site(options))?;
        eprintln!("camera: {} ({})", spec::text_of(&chosen.camera), chosen.how);
        Ok(chosen.camera)
    }
}

impl CameraArgs {
    /// What can be wrong without a scene.
    pub fn check(&self) -> Result<()> {
        if let Some(distance) = self.distance
            && !(distance.is_finite() && distance > 0.0)
        {
            bail!("--distance {distance}: must be finite and above 0");
        }
        if self.distance.is_some() && self.path != Some(PathSpec::Dolly) {
            bail!("--distance is that of --path dolly");
        }
        if let Some(speed) = self.camera_speed {
            if !speed.is_finite() || speed.abs() > 1000.0 {
                bail!("--camera-speed {speed}: must be a number from -1000 to 1000 m/s");
            }
            if self.path.is_some() {
                bail!("--camera-speed: a camera on a --path has the speed of it; leave one of them out");
            }
        }
        self.look.check()?;
        if let Some(PathSpec::File(file)) = &self.path {
            std::fs::metadata(file).map_err(|error| FormatError::reading(file, error))?;
        }
        if let Some(file) = &self.save_path {
            check_writable(file)?;
        }
        Ok(())
    }
}

/// Where the camera is at each instant, and which instants there are.
pub struct Shot {
    path: Way,
    size: (u32, u32),
    start: f64,
    /// m/s ahead, where the camera stands.
    speed: f64,
    /// Frames a second.
    pub rate: FrameRate,
    /// Number of frames.
    pub frames: u32,
}

enum Way {
    Still(Box<Camera>),
    Along(CameraPath),
}

impl Shot {
    /// Plans what the options ask for.
    pub(super) fn plan(
        args: &CameraArgs,
        output: &OutputArgs,
        loaded: &mut Loaded,
        still: bool,
    ) -> Result<Self> {
        let options = args.look.options();
        let length = output.seconds;
        let path = match &args.path {
            None => None,
            Some(PathSpec::File(file)) => Some(CameraPath::read(file, loaded.place.survey(), &options)?),
            Some(PathSpec::Capture) => {
                let seconds = length.unwrap_or(DEFAULT_SECONDS);
                Some(moves::capture(&loaded.place.scene().views, loaded.place.survey(), &options, seconds)?)
            }
            Some(moving) => {
                let start = args.look.start(loaded)?;
                let units = args.distance.map(|metres| metres / loaded.place.survey().metres_per_unit.value);
                let mut site =
                    loaded.site(view::ViewOptions { size: Some((start.width, start.height)), ..options });
                let seconds = length.unwrap_or(DEFAULT_SECONDS);
                Some(match moving {
                    PathSpec::Orbit => moves::orbit(&site, &start, seconds)?,
                    _ => moves::dolly(&mut site, &start, units, seconds)?,
                })
            }
        };
        let (way, size, duration) = match path {
            Some(path) => {
                let duration = path.duration();
                (Way::Along(path), options.size(), duration)
            }
            None => {
                let camera = args.look.start(loaded)?;
                (Way::Still(Box::new(camera)), (camera.width, camera.height), 0.0)
            }
        };
        let fps = 1.0 / output.fps.seconds(1);
        if let (Some(file), Way::Along(path)) = (&args.save_path, &way) {
            path.write(file, fps, size)?;
        } else if let (Some(file), Way::Still(camera)) = (&args.save_path, &way) {
            CameraPath::new(vec![PathKey::of(camera, 0.0)], camera.near)?.write(file, fps, size)?;
        }
        let seconds = length.unwrap_or(if duration > 0.0 { duration } else { DEFAULT_SECONDS });
        let frames = if still { 1 } else { output.fps.frames_within(seconds).max(1) };
        if frames > MAX_FRAMES {
            bail!("{frames} frames are too many for one run: the most is {MAX_FRAMES}");
        }
        let speed = args.camera_speed.unwrap_or(0.0);
        let shot = Self { path: way, size, start: output.time, speed, rate: output.fps, frames };
        shot.camera(shot.start).check()?;
        Ok(shot)
    }

    /// A camera that stands still, at the instant `start` and for no longer.
    #[cfg(feature = "viewer")]
    pub fn still(camera: Camera, start: f64) -> Self {
        let size = (camera.width, camera.height);
        Self {
            path: Way::Still(Box::new(camera)),
            size,
            start,
            speed: 0.0,
            rate: FrameRate::default(),
            frames: 1,
        }
    }

    /// A camera on a path, for pictures of `size`, at the instant `start` and for no longer.
    #[cfg(feature = "viewer")]
    pub fn along(path: CameraPath, size: (u32, u32), start: f64) -> Self {
        Self { path: Way::Along(path), size, start, speed: 0.0, rate: FrameRate::default(), frames: 1 }
    }

    /// The camera at `time`.
    pub fn camera(&self, time: f64) -> Camera {
        match &self.path {
            Way::Still(camera) => **camera,
            Way::Along(path) => path.at(path.start() + time, self.size),
        }
    }

    /// The camera at `time`, and how fast it goes.
    pub fn moving(&self, time: f64, metres_per_unit: f64) -> MovingCamera {
        let camera = self.camera(time);
        let velocity = match &self.path {
            Way::Still(camera) => camera.forward() * self.speed,
            Way::Along(_) => {
                let at = |time: f64| self.camera(time).center() * metres_per_unit;
                (at(time + MOMENT) - at(time - MOMENT)) / (2.0 * MOMENT)
            }
        };
        MovingCamera { camera, velocity: velocity.to_array() }
    }

    /// The instant of frame `index`, seconds.
    pub fn time(&self, index: u32) -> f64 {
        self.start + self.rate.seconds(u64::from(index))
    }

    /// What the cameras depend on, to tell one shot from another.
    pub fn fingerprint(&self) -> String {
        match &self.path {
            Way::Still(camera) => format!("{camera:?}"),
            Way::Along(path) => format!("{:?} {:?} {}", path.keys(), self.size, path.near()),
        }
    }
}
