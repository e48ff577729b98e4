//! Cameras as devices: a lens, a shutter, an exposure and the noise of a sensor.
//!
//! ```
//! use wm_place::camera_model::{CameraModel, ReadoutSide, SensorCamera, SensorNoise, Shutter};
//! use wm_place::{Camera, CameraMotion, FrameCamera, FrameRequest, Renderer, Weather};
//!
//! # let scene = wm_street::Street::builtin().sampling(0.1).scene(&|_| true).unwrap();
//! let mut renderer = Renderer::cpu()?;
//! let mut place = renderer.load(scene)?;
//! let look = Camera::look_at([4.0, -20.0, 1.8], [4.0, -30.0, 1.8]).size(96, 64);
//! let view = FrameCamera::from(look).at(0.0, &place)?;
//! // A car at 50 km/h, and a camera that reads its lines in 10 ms.
//! let motion = CameraMotion::Still { camera: Box::new(view.camera), speed: 13.9 };
//! let shutter = Shutter { exposure: 0.002, readout: 0.01, first: ReadoutSide::Top };
//! let model = CameraModel { shutter, noise: Some(SensorNoise::default()), ..CameraModel::default() };
//! let camera = SensorCamera::new(model, motion);
//! let weather = Weather::preset("heavy-rain")?;
//! let picture = renderer.render(&mut place, &FrameRequest::new(&weather, &camera, 1.0))?;
//! assert_eq!(picture.frame.rgb.len(), 3 * 96 * 64);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod exposure;
mod noise;
mod shutter;
#[cfg(test)]
mod tests;

pub use exposure::CameraExposure;
pub use noise::SensorNoise;
pub use shutter::{ReadoutSide, Shutter};

use crate::drawing::Drawing;
use crate::lens_view::{LensView, PictureRect};
use crate::motion::CameraMotion;
use crate::shot::{MovingCamera, Patience, PinholeShot};
use crate::{Error, Picture, Result};
use exposure::LightMeter;
use rayon::prelude::*;
use std::f64::consts::TAU;
use std::sync::{LazyLock, Mutex, PoisonError};
use wm_base::color::{srgb_decode, srgb_encode};
use wm_render::frame::ColorEncoding;
use wm_render::{Outputs, Stats};
use wm_scene::{Camera, LensModel};
use wm_weather::{Fidelity, Weather};

/// Distance at which the motion of the picture is measured, m: the blur of nearer things may show
/// its steps.
const MOTION_DISTANCE_M: f64 = 4.0;
/// Width of the pictures that an automatic exposure goes by, px.
const METERING_WIDTH_PX: u32 = 96;

/// A camera as a device.
#[derive(Clone, Debug, Default)]
pub struct CameraModel {
    /// The lens; `None` for a pinhole.
    pub lens: Option<LensView>,
    /// The exposure time and the readout.
    pub shutter: Shutter,
    /// The brightness of its pictures.
    pub exposure: CameraExposure,
    /// The noise; `None` for none.
    pub noise: Option<SensorNoise>,
}

impl CameraModel {
    /// Checks its numbers, and that it can take pictures of a weather.
    ///
    /// # Errors
    /// [`Error::Unsupported`] with the value; or that rain and snow of the paper's fidelity have no
    /// motion, or that drops on the lens or glare cannot be drawn with the shutter or the lens.
    pub fn check(&self, weather: &Weather) -> Result<()> {
        let fault = self.shutter.check().and_then(|()| self.noise.iter().try_for_each(SensorNoise::check));
        fault.map_err(Error::Unsupported)?;
        let has = |name: &str| weather.effects().any(|(effect, _)| effect.name == name);
        let refused = if !self.shutter.is_instant() && weather.fidelity == Fidelity::Paper {
            "an exposure time and a readout need rain and snow that move: use fidelity `physical`"
        } else if self.shutter.readout > 0.0 && has("lens") {
            "drops on the lens need the whole picture at once: turn the effect `lens` off, or give no readout"
        } else if self.lens.is_some() && has("lens") {
            "drops on the lens are drawn for pinholes only: turn the effect `lens` off, or use no other lens"
        } else if self.lens.as_ref().is_some_and(LensView::is_composed) && has("glare") {
            // Glare is drawn about the axis of a picture: each of the pinhole pictures has its own.
            "glare is drawn for lenses below 112 degrees only: turn the effect `glare` off, or use another lens"
        } else {
            return Ok(());
        };
        Err(Error::Unsupported(refused.into()))
    }

    /// Describes shutter, exposure and noise in a text that differs between models; `None` if all
    /// three are neutral.
    #[must_use]
    pub fn settings(&self) -> Option<String> {
        let Self { shutter, exposure, noise, .. } = self;
        let is_plain = shutter.is_instant() && *exposure == CameraExposure::default() && noise.is_none();
        (!is_plain).then(|| format!("{shutter:?} {exposure:?} {noise:?}"))
    }
}

/// A camera on its way, for one place.
#[derive(Clone, Debug)]
pub struct SensorCamera {
    /// The device.
    pub model: CameraModel,
    /// The number among the sensors of a rig: seeds the noise.
    pub number: u32,
    motion: CameraMotion,
    meters: MeterMemory,
}

/// Brightness that was metered before, by weather: memory alone, since it follows from the camera,
/// the place, the weather and the time.
#[derive(Debug, Default)]
struct MeterMemory(Mutex<Vec<(Weather, LightMeter)>>);

/// Weathers that a camera remembers the brightness of: a picture, and the same without weather.
const MAX_METERS: usize = 2;

impl Clone for MeterMemory {
    /// The copy may become another camera, so it remembers nothing.
    fn clone(&self) -> Self {
        Self::default()
    }
}

impl MeterMemory {
    /// Takes the meter of a weather out of the memory, or a new one.
    fn take(&self, weather: &Weather) -> LightMeter {
        let mut meters = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let known = meters.iter().position(|(metered, _)| metered == weather);
        known.map(|index| meters.remove(index).1).unwrap_or_default()
    }

    fn put(&self, weather: &Weather, meter: LightMeter) {
        let mut meters = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        meters.truncate(MAX_METERS - 1);
        meters.insert(0, (weather.clone(), meter));
    }
}

impl SensorCamera {
    /// A camera that is the first of its rig. One that stays with a speed is where `motion` says at
    /// the time of each frame, and drives while it is exposed.
    #[must_use]
    pub fn new(model: CameraModel, motion: CameraMotion) -> Self {
        Self { model, number: 0, motion, meters: MeterMemory::default() }
    }

    /// Returns the motion.
    #[must_use]
    pub fn motion(&self) -> &CameraMotion {
        &self.motion
    }

    /// The camera `after` seconds after the time of a frame.
    fn at(&self, time: f64, after: f64, metres_per_unit: f64) -> MovingCamera {
        self.motion.driven_since(time, time + after, metres_per_unit)
    }

    /// The size of its pictures, px.
    fn size(&self, camera: &Camera) -> [u32; 2] {
        let of = self.model.lens.as_ref().map_or(camera, LensView::intrinsics);
        [of.width, of.height]
    }

    /// The most that its picture moves about a time, px/s, where things are [`MOTION_DISTANCE_M`].
    fn speed(&self, time: f64, metres_per_unit: f64) -> f64 {
        let span = self.model.shutter.span();
        let [first, last] = [span.start, span.end].map(|after| self.at(time, after, metres_per_unit).camera);
        let lens = self.model.lens.as_ref();
        let intrinsics = lens.map_or(&first, LensView::intrinsics);
        let focal = match lens.map(LensView::lens) {
            Some(LensModel::Equirectangular) => f64::from(intrinsics.width) / TAU,
            _ => intrinsics.fx.max(intrinsics.fy),
        };
        let mut most = 0.0f64;
        for x in [-0.7, 0.0, 0.7] {
            for y in [-0.7, 0.0, 0.7] {
                let seen = glam::DVec3::new(x, y, 1.0).normalize();
                let point = first.center()
                    + first.rotation().transpose() * seen * (MOTION_DISTANCE_M / metres_per_unit);
                let after = last.viewmat.transform_point3(point).normalize();
                most = most.max(after.angle_between(seen) * focal);
            }
        }
        most / (span.end - span.start)
    }
}

impl Drawing<'_> {
    /// Takes a picture with a camera: through its lens, over its exposure and readout, as bright as
    /// its exposure says, with its noise. The pose is that of the camera at the time of the shot.
    ///
    /// Colours and falling particles are means over the exposure, in linear light. Depth and the
    /// other layers are those of the step in which the middle of a line's exposure lies, and are
    /// not changed by exposure and noise.
    pub(crate) async fn expose(
        &mut self,
        camera: &SensorCamera,
        index: u32,
        shot: &PinholeShot<'_>,
        picture: &mut Picture,
    ) -> Result<Stats> {
        let SensorCamera { model, number, .. } = camera;
        model.check(shot.weather)?;
        let shot =
            PinholeShot { camera: camera.at(shot.time, 0.0, self.place.site().metres_per_unit), ..*shot };
        let mut stats = if model.shutter.is_instant() {
            self.through(model.lens.as_ref(), &shot, picture).await?
        } else {
            self.expose_steps(camera, &shot, picture).await?
        };
        let started = web_time::Instant::now();
        let gain = match model.exposure {
            CameraExposure::Stops(stops) => stops.exp2(),
            CameraExposure::Auto => self.metered_gain(camera, &shot).await?,
        };
        self.renderer.backend().pool().install(|| {
            if gain != 1.0 {
                brighten(picture, gain as f32);
            }
            if let Some(noise) = &model.noise {
                noise.apply(&mut picture.frame, *number, index, gain);
            }
        });
        stats.wall += started.elapsed().as_secs_f64();
        Ok(stats)
    }

    /// Renders the steps of an exposure, each with the lines that are exposed in it.
    async fn expose_steps(
        &mut self,
        camera: &SensorCamera,
        shot: &PinholeShot<'_>,
        picture: &mut Picture,
    ) -> Result<Stats> {
        let (model, metres) = (&camera.model, self.place.site().metres_per_unit);
        let (shutter, size) = (model.shutter, camera.size(&shot.camera.camera));
        let steps = shutter.steps(camera.speed(shot.time, metres), shutter.lines(size));
        // What falls is streaked over one step: the streaks of all steps follow each other.
        let streaked = (shutter.exposure > 0.0).then(|| shot.weather.exposed_for(steps.length));
        let weather = streaked.as_ref().unwrap_or(shot.weather);
        let mut exposed = ExposedPicture::new(size);
        let (mut stats, mut part) = (Stats::default(), Picture::default());
        for step in 0..steps.count {
            let lines = steps.lines(step);
            if lines.is_empty() {
                continue;
            }
            if self.progress.is_stopped() {
                return Err(Error::Stopped);
            }
            let rect = shutter.rect(size, &lines);
            let moving = camera.at(shot.time, steps.time(step), metres);
            let lens = model.lens.as_ref().map(|lens| lens.cut(&rect));
            let (own, whole) = match lens {
                Some(_) => (moving, None),
                None => (MovingCamera { camera: cut(&moving.camera, &rect), ..moving }, Some(moving.camera)),
            };
            let time = shot.time + steps.time(step);
            let step_shot = PinholeShot { weather, time, camera: own, whole, ..*shot };
            stats += self.through(lens.as_ref(), &step_shot, &mut part).await?;
            let count = lines.end - lines.start;
            let share = |line: u32| steps.share(line, step) as f32;
            // The line of each row or column of the part.
            let line_at = |k: u32| match shutter.first {
                ReadoutSide::Top | ReadoutSide::Left => lines.start + k,
                ReadoutSide::Bottom | ReadoutSide::Right => lines.start + count - 1 - k,
            };
            let shares: Vec<f32> = (0..count).map(|k| share(line_at(k))).collect();
            let is_across = matches!(shutter.first, ReadoutSide::Left | ReadoutSide::Right);
            self.renderer.backend().pool().install(|| exposed.add(&part, &rect, &shares, is_across));
        }
        let started = web_time::Instant::now();
        self.renderer.backend().pool().install(|| exposed.finish(picture));
        picture.metres_per_unit = part.metres_per_unit;
        stats.wall += started.elapsed().as_secs_f64();
        Ok(stats)
    }

    /// The gain of an automatic exposure.
    async fn metered_gain(&mut self, camera: &SensorCamera, shot: &PinholeShot<'_>) -> Result<f64> {
        let mut meter = camera.meters.take(shot.weather);
        let mut picture = Picture::default();
        let is_pinhole = camera.model.lens.is_none();
        let metres = self.place.site().metres_per_unit;
        let measure = async |time: f64| {
            let mut moving = camera.at(time, 0.0, metres);
            let whole = moving.camera;
            let height =
                (METERING_WIDTH_PX * whole.height / whole.width.max(1)).clamp(1, 2 * METERING_WIDTH_PX);
            moving.camera = if is_pinhole {
                whole.resized(METERING_WIDTH_PX, height)
            } else {
                // A lens is metered by what is ahead, 90 degrees wide.
                let focal = f64::from(METERING_WIDTH_PX) / 2.0;
                Camera {
                    fx: focal,
                    fy: focal,
                    cx: focal,
                    cy: focal,
                    width: METERING_WIDTH_PX,
                    height: METERING_WIDTH_PX,
                    ..whole
                }
            };
            let shot = PinholeShot {
                time,
                camera: moving,
                outputs: Outputs::default(),
                parts: &[],
                patience: Patience::Whole,
                ..*shot
            };
            self.pinhole(&shot, &mut picture).await?;
            Ok::<f64, Error>(exposure::log_mean(&picture.frame))
        };
        let gain = meter.gain(shot.time, measure).await;
        camera.meters.put(shot.weather, meter);
        gain
    }
}

/// The camera of a part of a picture.
fn cut(camera: &Camera, rect: &PictureRect) -> Camera {
    let [left, top] = rect.at.map(f64::from);
    let [width, height] = rect.size;
    Camera { width, height, cx: camera.cx - left, cy: camera.cy - top, ..*camera }
}

/// sRGB to linear light at 4096 steps up to 1.
static DECODE_TABLE: LazyLock<Vec<f32>> = LazyLock::new(|| {
    (0..=DECODE_TABLE_STEPS + 1)
        .map(|i| srgb_decode(f64::from(i) / f64::from(DECODE_TABLE_STEPS)) as f32)
        .collect()
});
const DECODE_TABLE_STEPS: u32 = 4096;

/// sRGB to linear light, within 1e-7 up to 1.
#[inline]
fn light_of(value: f32) -> f32 {
    if value > 1.0 {
        return srgb_decode(f64::from(value)) as f32;
    }
    let at = value.max(0.0) * DECODE_TABLE_STEPS as f32;
    let (low, share) = (at as usize, at - at.floor());
    DECODE_TABLE[low] + share * (DECODE_TABLE[low + 1] - DECODE_TABLE[low])
}

/// Makes a picture so many times as bright, in linear light.
fn brighten(picture: &mut Picture, gain: f32) {
    let is_srgb = picture.frame.encoding == ColorEncoding::Srgb;
    picture.frame.rgb.par_chunks_mut(1 << 12).flatten().for_each(|value| {
        *value = if is_srgb { srgb_encode(f64::from(light_of(*value) * gain)) as f32 } else { *value * gain };
    });
}

/// A picture that is being exposed.
struct ExposedPicture {
    size: [u32; 2],
    /// Sums of light, and then the finished picture.
    picture: Picture,
    /// The greatest share of each row or column so far.
    most: Vec<f32>,
}

impl ExposedPicture {
    fn new(size: [u32; 2]) -> Self {
        let [width, height] = size;
        let mut picture = Picture::default();
        (picture.frame.width, picture.frame.height) = (width, height);
        Self { size, picture, most: vec![0.0; width.max(height) as usize] }
    }

    /// Adds one step of a part of the picture: the share of each of its rows, or columns if they
    /// are read `across`.
    fn add(&mut self, part: &Picture, rect: &PictureRect, shares: &[f32], is_across: bool) {
        let first = rect.at[usize::from(!is_across)] as usize;
        // The other layers are those of the step that has most of a line.
        let news: Vec<bool> = shares
            .iter()
            .enumerate()
            .map(|(k, share)| {
                let most = &mut self.most[first + k];
                let is_more = *share > *most;
                *most = most.max(*share);
                is_more
            })
            .collect();
        let copy = PartCopy { size: self.size, rect: *rect, shares, news: &news, is_across };
        let is_srgb = part.frame.encoding == ColorEncoding::Srgb;
        self.picture.frame.encoding = part.frame.encoding;
        let (to, from) = (&mut self.picture, part);
        let light = |value: f32| if is_srgb { light_of(value) } else { value };
        copy.mean::<3>(&mut to.frame.rgb, &from.frame.rgb, light);
        copy.mean::<4>(&mut to.frame.particles, &from.frame.particles, |v| v);
        copy.newest::<1>(&mut to.frame.alpha, &from.frame.alpha);
        copy.newest::<1>(&mut to.frame.depth, &from.frame.depth);
        copy.newest::<1>(&mut to.frame.median_depth, &from.frame.median_depth);
        copy.newest::<3>(&mut to.frame.normal, &from.frame.normal);
        copy.newest::<3>(&mut to.parts.clean, &from.parts.clean);
        copy.newest::<3>(&mut to.parts.transmittance, &from.parts.transmittance);
        copy.newest::<3>(&mut to.parts.airlight, &from.parts.airlight);
        copy.newest::<1>(&mut to.water.cover, &from.water.cover);
        copy.newest::<1>(&mut to.water.reflected, &from.water.reflected);
        copy.newest::<1>(&mut to.water.depth, &from.water.depth);
    }

    /// Encodes the light, and hands the picture over.
    fn finish(mut self, picture: &mut Picture) {
        if self.picture.frame.encoding == ColorEncoding::Srgb {
            let rgb = self.picture.frame.rgb.par_chunks_mut(1 << 12);
            rgb.flatten().for_each(|value| *value = srgb_encode(f64::from(*value)) as f32);
        }
        picture.frame = self.picture.frame;
        picture.parts = self.picture.parts;
        picture.water = self.picture.water;
    }
}

/// The way of arrays of a part into those of a picture.
struct PartCopy<'a> {
    size: [u32; 2],
    rect: PictureRect,
    shares: &'a [f32],
    /// True for the rows or columns of which this is the greatest share so far.
    news: &'a [bool],
    is_across: bool,
}

impl PartCopy<'_> {
    /// Adds shares of an array of `N` numbers a pixel.
    fn mean<const N: usize>(&self, to: &mut Vec<f32>, from: &[f32], of: impl Fn(f32) -> f32 + Sync) {
        self.each::<N>(to, from, |line, to, from| {
            let share = self.shares[line];
            for (to, from) in to.iter_mut().zip(from) {
                *to += share * of(*from);
            }
        });
    }

    /// Takes an array where this is the greatest share.
    fn newest<const N: usize>(&self, to: &mut Vec<f32>, from: &[f32]) {
        self.each::<N>(to, from, |line, to, from| {
            if self.news[line] {
                to.copy_from_slice(from);
            }
        });
    }

    /// Calls `work` with the line, the pixel of the picture and that of the part, for each pixel of
    /// the part. Without values nothing is done.
    fn each<const N: usize>(
        &self,
        to: &mut Vec<f32>,
        from: &[f32],
        work: impl Fn(usize, &mut [f32], &[f32]) + Sync,
    ) {
        if from.is_empty() {
            return;
        }
        let width = self.size[0] as usize;
        to.resize(N * width * self.size[1] as usize, 0.0);
        let [left, top] = self.rect.at.map(|v| v as usize);
        let [columns, rows] = self.rect.size.map(|v| v as usize);
        let target = &mut to[N * width * top..N * width * (top + rows)];
        target.par_chunks_mut(N * width).zip(from.par_chunks(N * columns)).enumerate().for_each(
            |(y, (to, from))| {
                let to = &mut to[N * left..N * (left + columns)];
                if self.is_across {
                    for (x, (to, from)) in to.chunks_mut(N).zip(from.chunks(N)).enumerate() {
                        work(x, to, from);
                    }
                } else {
                    work(y, to, from);
                }
            },
        );
    }
}
