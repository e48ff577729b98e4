//! Options of the camera or its path, and the times of the frames.

use super::output_args::OutputArgs;
use crate::scene::OpenScene;
use anyhow::{Result, bail};
use clap::Args;
use std::path::PathBuf;
use weather_magician::levels::shot_cameras;
use weather_magician::video::FrameRate;
use weather_magician::view;
use weather_magician::view::moves::PathSpec;
use weather_magician::view::path::{CameraPath, PathKey};
use weather_magician::view::spec::{self, CameraSpec};
use weather_magician::{Camera, CameraMotion, LensSpec, MotionSpec, MovingCamera};
use wm_base::FormatError;
use wm_base::files::check_writable;
use wm_scene::camera::FOV_RANGE_DEG;

/// Default length of a sequence, seconds.
pub(crate) const DEFAULT_SECONDS: f64 = 5.0;
/// Longest sequence, frames: file names have six digits.
const MAX_FRAMES: u32 = 1_000_000;

/// Options of a camera that does not move.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Camera")]
pub(crate) struct ViewpointArgs {
    /// Camera: EYE:TARGET as X,Y,Z:X,Y,Z, a photo's name or number, or a JSON file of keyframes
    /// [default: a view chosen automatically]
    #[arg(short, long, value_name = "CAMERA", allow_hyphen_values = true)]
    pub(crate) camera: Option<CameraSpec>,
    /// COLMAP model with the photos' cameras that --camera may name
    #[arg(long, value_name = "FOLDER")]
    pub(crate) views: Option<PathBuf>,
    /// Picture size, px [default: 1280x720, or the photo's]
    #[arg(long, value_name = "WxH", allow_hyphen_values = true, value_parser = spec::parse_size)]
    pub(crate) size: Option<(u32, u32)>,
    /// Vertical field of view, degrees [default: 50, or the photo's]
    #[arg(long, value_name = "DEGREES", allow_negative_numbers = true)]
    pub(crate) fov: Option<f64>,
    /// Splats nearer than this are not drawn, scene units [default: 0.2, less in small scenes]
    #[arg(long, value_name = "UNITS", allow_negative_numbers = true)]
    pub(crate) near: Option<f64>,
}

/// Options of a camera and its motion.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Camera")]
pub(crate) struct CameraArgs {
    #[command(flatten)]
    pub(crate) viewpoint: ViewpointArgs,
    /// Move the camera: orbit, dolly, capture (along the photos), or a JSON file of keyframes,
    /// ours, nerfstudio's or SuperSplat's
    #[arg(short, long, value_name = "PATH")]
    pub(crate) path: Option<PathSpec>,
    /// Length of a dolly, metres [default: as far as the way is free]
    #[arg(long, value_name = "METRES", allow_negative_numbers = true)]
    pub(crate) distance: Option<f64>,
    /// Forward speed of a camera without a path, m/s, as in a car: rain and snow come towards it
    #[arg(long, value_name = "M/S", allow_negative_numbers = true)]
    pub(crate) camera_speed: Option<f64>,
    /// Lens of the camera instead of a pinhole: fisheye or fisheye:DEGREES (equidistant, a circle
    /// of 180 degrees if not given), equirectangular (a 360 degree panorama), or a TOML file of a
    /// calibrated lens. Depths are distances from the eye then
    #[arg(long, value_name = "LENS")]
    pub(crate) lens: Option<LensSpec>,
    /// Write the camera's path to this JSON file: keyframes, or nerfstudio's format for a name that
    /// ends in camera_path.json, or SuperSplat's for settings.json
    #[arg(long, value_name = "FILE")]
    pub(crate) save_path: Option<PathBuf>,
}

impl ViewpointArgs {
    /// Checks the options that do not depend on the scene.
    pub(crate) fn check(&self) -> Result<()> {
        if let Some(fov) = self.fov
            && !FOV_RANGE_DEG.contains(&fov)
        {
            bail!("--fov {fov}: must be 0.1 to 170 degrees");
        }
        if let Some((width, height)) = self.size {
            crate::memory::check_picture(width, height)?;
        }
        if let Some(near) = self.near
            && !(near.is_finite() && near > 0.0)
        {
            bail!("--near {near}: must be finite and above 0");
        }
        check_camera(self.camera.as_ref())
    }

    /// Returns the view options that were given.
    pub(crate) fn options(&self) -> view::ViewOptions {
        view::ViewOptions { up: None, fov: self.fov, near: self.near, size: self.size }
    }

    /// Returns the camera of the options, or chooses one and prints it on the error stream.
    #[cfg(feature = "viewer")]
    pub(crate) fn start(&self, loaded: &mut OpenScene) -> Result<Camera> {
        let spec = MotionSpec { camera: self.camera.clone(), ..MotionSpec::default() };
        let OpenScene { renderer, place } = loaded;
        Ok(spec.start(renderer, place, &self.options(), &mut say_camera)?)
    }
}

/// Checks that the file of a camera can be read.
pub(crate) fn check_camera(camera: Option<&CameraSpec>) -> Result<()> {
    if let Some(CameraSpec::File(file)) = camera {
        std::fs::metadata(file).map_err(|error| FormatError::reading(file, error))?;
    }
    Ok(())
}

/// Prints the camera that was chosen.
fn say_camera(chosen: String) {
    eprintln!("camera: {chosen}");
}

impl CameraArgs {
    /// Checks the options that do not depend on the scene.
    pub(crate) fn check(&self) -> Result<()> {
        if let Some(distance) = self.distance
            && !(distance.is_finite() && distance > 0.0)
        {
            bail!("--distance {distance}: must be finite and above 0");
        }
        if self.distance.is_some() && self.path != Some(PathSpec::Dolly) {
            bail!("--distance needs --path dolly");
        }
        if let Some(speed) = self.camera_speed {
            if !speed.is_finite() || speed.abs() > 1000.0 {
                bail!("--camera-speed {speed}: must be a number from -1000 to 1000 m/s");
            }
            if self.path.is_some() {
                bail!("--camera-speed: cannot be used with --path, which sets the speed");
            }
        }
        if self.lens.is_some() && self.viewpoint.fov.is_some() {
            bail!("--fov: cannot be used with --lens, which has its own; give fisheye:DEGREES");
        }
        self.viewpoint.check()?;
        if let Some(PathSpec::File(file)) = &self.path {
            std::fs::metadata(file).map_err(|error| FormatError::reading(file, error))?;
        }
        if let Some(file) = &self.save_path {
            check_writable(file)?;
        }
        Ok(())
    }

    /// Returns the motion that is asked for, of the duration of the output if the path has none of
    /// its own.
    pub(super) fn spec(&self, output: &OutputArgs) -> MotionSpec {
        MotionSpec {
            camera: self.viewpoint.camera.clone(),
            path: self.path.clone(),
            distance: self.distance,
            speed: self.camera_speed,
            seconds: output.seconds.unwrap_or(DEFAULT_SECONDS),
        }
    }
}

/// Returns the motion that is asked for in a scene. Prints a camera that was chosen.
pub(crate) fn motion(
    spec: &MotionSpec,
    options: &view::ViewOptions,
    loaded: &mut OpenScene,
) -> Result<CameraMotion> {
    let OpenScene { renderer, place } = loaded;
    Ok(spec.motion(renderer, place, options, &mut say_camera)?)
}

/// The camera at each time, and the times of the frames.
pub(crate) struct CameraPlan {
    /// The motion of the camera.
    pub(crate) motion: CameraMotion,
    start: f64,
    /// Frames a second.
    pub(crate) rate: FrameRate,
    /// Number of frames.
    pub(crate) frames: u32,
}

impl CameraPlan {
    /// Builds the plan for the options.
    pub(super) fn plan(
        args: &CameraArgs,
        output: &OutputArgs,
        loaded: &mut OpenScene,
        still: bool,
    ) -> Result<Self> {
        let motion = motion(&args.spec(output), &args.viewpoint.options(), loaded)?;
        let duration = motion.duration();
        let fps = 1.0 / output.fps.seconds(1);
        if let Some(file) = &args.save_path {
            let origin = loaded.place.survey().origin;
            match &motion {
                CameraMotion::Along { path, size } => path.write(file, origin, fps, *size)?,
                _ => {
                    let camera = motion.camera(0.0);
                    let size = (camera.width, camera.height);
                    let path = CameraPath::new(vec![PathKey::of(&camera, 0.0)], camera.near)?;
                    path.write(file, origin, fps, size)?;
                }
            }
        }
        let seconds = output.seconds.unwrap_or(if duration > 0.0 { duration } else { DEFAULT_SECONDS });
        let frames = if still { 1 } else { output.fps.frames_within(seconds).max(1) };
        if frames > MAX_FRAMES {
            bail!("{frames} frames are too many for one run: the maximum is {MAX_FRAMES}");
        }
        let plan = Self { motion, start: output.time(), rate: output.fps, frames };
        plan.motion.camera(plan.start).check()?;
        Ok(plan)
    }

    /// Returns cameras over all frames of the sequence, whichever of them are rendered; with a
    /// lens, cameras that see all about.
    pub(crate) fn shot(&self, has_lens: bool) -> Vec<Camera> {
        shot_cameras(self.frames, |frame| self.motion.camera(self.time(frame)), has_lens)
    }

    /// Returns the number of the frame at `time`, seconds: the same in a picture and in a sequence.
    pub(crate) fn index(&self, time: f64) -> u32 {
        (time / self.rate.seconds(1)).round() as i64 as u32
    }

    /// Returns the time and the camera of the frame after that at `time`, seconds.
    pub(crate) fn next(&self, time: f64, metres_per_unit: f64) -> (f64, MovingCamera) {
        let after = time + self.rate.seconds(1);
        (after, self.beside(time, after, metres_per_unit))
    }

    /// Returns the camera of the frame before that at `time`, seconds; `None` at the start of a path.
    pub(crate) fn previous(&self, time: f64, metres_per_unit: f64) -> Option<Camera> {
        let is_driven = self.frames == 1 && self.motion.duration() == 0.0;
        let is_first = !is_driven && self.index(time) == 0;
        (!is_first).then(|| self.beside(time, time - self.rate.seconds(1), metres_per_unit).camera)
    }

    /// Returns the camera at another time than that of a frame. The camera of a single picture with
    /// a speed moves by it; in a sequence such a camera stays, as its frames show it.
    fn beside(&self, time: f64, other: f64, metres_per_unit: f64) -> MovingCamera {
        let since = if self.frames == 1 { time } else { other };
        self.motion.driven_since(since, other, metres_per_unit)
    }

    /// Returns the time of frame `index`, seconds.
    pub(crate) fn time(&self, index: u32) -> f64 {
        self.start + self.rate.seconds(u64::from(index))
    }
}
