//! Instruments that measure from rendered pictures whether weather is as strong as its parameters
//! say.
//!
//! An [`Instrument`] sets up targets at a place and in its air: boards at known distances, a thin
//! slab of air before a black board, a yard with a roof. An [`InstrumentRenderer`] renders them
//! with the same code as all other pictures. The measured value comes from pixels alone; the
//! expected value comes from the weather's parameters and published laws, implemented a second time
//! here, so that neither side shares code with the other. Some instruments look at the place
//! itself: rays, shadows, consistency and controls.
//!
//! [`INSTRUMENTS`] lists all of them, [`PlaceRenderer`] renders for them at a
//! [`PreparedPlace`](wm_place::PreparedPlace):
//!
//! ```no_run
//! use wm_measure::{INSTRUMENTS, MeasureRequest, PlaceRenderer};
//! use wm_place::{Camera, Renderer, Result, Scene, Weather};
//!
//! # fn example(scene: Scene, camera: Camera) -> Result<()> {
//! let mut renderer = Renderer::cpu()?;
//! let place = renderer.load(scene)?;
//! let mut place = PlaceRenderer::new(renderer, place, camera);
//! let mut weather = Weather::clear();
//! weather.set_text("fog.mor=100")?;
//! let request = MeasureRequest { weather: &weather, time: 0.0, setting: "fog" };
//! for instrument in INSTRUMENTS.iter().filter(|instrument| (instrument.applies)(&weather, 0.0)) {
//!     for reading in instrument.read(&mut place, &request)?.readings {
//!         println!("{}: {} {}", reading.quantity, reading.measured, reading.unit);
//!     }
//! }
//! # Ok(())
//! # }
//! ```
//!
//! A new instrument is one file and one line of [`INSTRUMENTS`]. A test replaces the renderer by
//! one that draws each effect wrongly by a tenth, and checks that each instrument finds its own
//! error and no other.

mod allard;
mod bench;
mod blobs;
mod boards;
mod budget;
mod consistency;
mod controls;
mod drops;
mod expected;
mod flash;
mod fresnel;
mod gauge;
mod halo;
mod lamp_streak;
mod lidar;
mod lidar_air;
mod lidar_board;
mod lidar_drops;
mod lidar_road;
mod lit;
mod lux;
mod mirror;
mod painted;
mod place_renderer;
pub mod plot;
mod rays;
mod ripples;
mod secchi;
mod shadows;
mod stake;
mod streaks;
mod sundial;
#[cfg(test)]
mod tests;
mod water_budget;
mod wet_card;

pub use place_renderer::PlaceRenderer;

use bench::Bench;
use glam::DVec3;
use plot::Plot;
use serde::Serialize;
use wm_base::statistics;
use wm_place::lidar::{LidarModel, LidarSweep};
use wm_place::{CameraMotion, FrameRequest, Layers, Picture, Result};
use wm_render::Frame;
use wm_scene::{Camera, Lamp, Splats};
use wm_weather::dome::level_axes;
use wm_weather::wetness::WaterState;
use wm_weather::{Site, Weather};

/// A measuring method: what it applies to, and how it measures.
pub struct Instrument {
    /// One word, for `--instruments` and JSON.
    pub name: &'static str,
    /// The title in reports, a few words.
    pub title: &'static str,
    /// The method in two or three sentences.
    pub about: &'static str,
    /// Returns true if the instrument can measure something in a weather at a time, s.
    pub applies: fn(&Weather, f64) -> bool,
    measure: fn(&mut Bench<'_>) -> Result<()>,
    /// The weathers that are measured if none is given, as changes of clear weather: see
    /// [`changed`].
    pub sweep: &'static [&'static str],
}

impl Instrument {
    /// Renders, measures and compares. Targets that it sets up stay until
    /// [`InstrumentRenderer::clear_away`].
    ///
    /// # Errors
    /// [`wm_place::Error`] if a picture cannot be rendered.
    pub fn read(&self, rig: &mut dyn InstrumentRenderer, request: &MeasureRequest<'_>) -> Result<Finding> {
        let mut bench = Bench::new(rig, request);
        (self.measure)(&mut bench)?;
        Ok(bench.finding)
    }
}

/// Every instrument, in the order of the report.
#[rustfmt::skip]
pub const INSTRUMENTS: [Instrument; 25] = [
    boards::INSTRUMENT,
    rays::INSTRUMENT,
    gauge::INSTRUMENT,
    streaks::INSTRUMENT,
    stake::INSTRUMENT,
    budget::INSTRUMENT,
    wet_card::INSTRUMENT,
    water_budget::INSTRUMENT,
    lux::INSTRUMENT,
    sundial::INSTRUMENT,
    shadows::INSTRUMENT,
    allard::INSTRUMENT,
    halo::INSTRUMENT,
    flash::INSTRUMENT,
    fresnel::INSTRUMENT,
    mirror::INSTRUMENT,
    secchi::INSTRUMENT,
    ripples::INSTRUMENT,
    lamp_streak::INSTRUMENT,
    lidar_board::INSTRUMENT,
    lidar_air::INSTRUMENT,
    lidar_drops::INSTRUMENT,
    lidar_road::INSTRUMENT,
    consistency::INSTRUMENT,
    controls::INSTRUMENT,
];

/// The weather to measure.
pub struct MeasureRequest<'a> {
    /// The weather.
    pub weather: &'a Weather,
    /// The time, s.
    pub time: f64,
    /// The weather in words, for reports.
    pub setting: &'a str,
}

/// Returns a weather with changes of the form `effect.parameter=value`, separated by `", "`.
///
/// # Errors
/// [`wm_place::Error::Weather`] if a change is of another form.
pub fn changed(weather: &Weather, changes: &str) -> Result<Weather> {
    let mut weather = weather.clone();
    changes
        .split(", ")
        .filter(|change| !change.is_empty())
        .try_for_each(|change| weather.set_text(change))?;
    Ok(weather)
}

/// The allowed difference between a measured and an expected value.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Tolerance {
    /// A share of the expected value.
    Relative(f64),
    /// A number in the unit of the reading.
    Absolute(f64),
    /// In the unit of the reading; only larger values are wrong.
    Above(f64),
    /// None: the reading is given for comparison.
    None,
}

/// An expected and a measured value.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Reading {
    /// The quantity in words.
    pub quantity: String,
    /// The weather in words.
    pub setting: String,
    /// The unit; empty for a plain number.
    pub unit: &'static str,
    /// The expected value, by the weather's parameters and published laws.
    pub asked: f64,
    /// The value measured from pictures; NaN if too little could be measured.
    pub measured: f64,
    /// The standard error of the measured value, in the same unit, where it comes from counting.
    pub standard_error: Option<f64>,
    /// The allowed difference.
    pub tolerance: Tolerance,
}

impl Reading {
    /// Returns the error: as a share of the expected value for [`Tolerance::Relative`], else in the
    /// unit.
    #[must_use]
    pub fn error(&self) -> f64 {
        match self.tolerance {
            Tolerance::Relative(_) => self.measured / self.asked - 1.0,
            Tolerance::Absolute(_) | Tolerance::Above(_) | Tolerance::None => self.measured - self.asked,
        }
    }

    /// Returns true if the error is within the tolerance.
    #[must_use]
    pub fn passes(&self) -> bool {
        match self.tolerance {
            Tolerance::Relative(most) | Tolerance::Absolute(most) => self.error().abs() <= most,
            Tolerance::Above(most) => self.error() <= most,
            Tolerance::None => true,
        }
    }
}

/// A picture for the report.
#[derive(Clone, Debug)]
pub struct MeasuredPicture {
    /// The caption.
    pub caption: String,
    /// The colours, `[H, W, 3]`, sRGB, 0-1.
    pub rgb: Vec<f32>,
    /// Width and height, px.
    pub size: (u32, u32),
}

impl MeasuredPicture {
    /// Returns the colours of a frame.
    pub fn of(caption: impl Into<String>, frame: &Frame) -> Self {
        Self { caption: caption.into(), rgb: frame.rgb.clone(), size: (frame.width, frame.height) }
    }

    /// Returns shares, 0-1, `[H, W]`, as a grey picture.
    #[must_use]
    pub fn grey(caption: impl Into<String>, shares: impl Iterator<Item = f32>, size: (u32, u32)) -> Self {
        Self { caption: caption.into(), rgb: shares.flat_map(|share| [share; 3]).collect(), size }
    }
}

/// The results of one instrument in one weather.
#[derive(Clone, Debug, Default)]
pub struct Finding {
    /// The numbers.
    pub readings: Vec<Reading>,
    /// The curves.
    pub plots: Vec<Plot>,
    /// Pictures of the place and the targets.
    pub pictures: Vec<MeasuredPicture>,
    /// The weather in words.
    setting: String,
}

/// The splats that are rendered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ShotSubject {
    /// The place.
    Place,
    /// A target: its index among those that are set up.
    Target(usize),
}

/// A sweep for an instrument: one ray per pulse, and all returns.
#[derive(Clone, Copy)]
pub struct InstrumentScan<'a> {
    /// A lit target.
    pub subject: ShotSubject,
    /// The lidar.
    pub lidar: &'a LidarModel,
    /// The pose of the lidar over time.
    pub motion: &'a CameraMotion,
    /// The weather.
    pub weather: &'a Weather,
    /// The time, s.
    pub time: f64,
}

/// The shadows of a sun in the photos of a place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ShadowReport {
    /// There are none.
    None,
    /// They cannot be taken away.
    Kept {
        /// Towards their sun, world axes, length 1.
        sun: DVec3,
    },
    /// They can.
    Split {
        /// Towards their sun, world axes, length 1.
        sun: DVec3,
        /// The scene came with the views of its photos.
        is_photographed: bool,
    },
}

/// Renders the place and the targets of instruments.
pub trait InstrumentRenderer {
    /// Returns the facts about the place that weather needs.
    fn site(&self) -> Site;

    /// Returns a camera at the place, and a second one a step to its side.
    ///
    /// # Errors
    /// [`wm_place::Error`] if the place has no such cameras.
    fn views(&mut self) -> Result<[Camera; 2]>;

    /// Sets up a target: splats in the place's axes and units.
    ///
    /// # Errors
    /// [`wm_place::Error::Render`] if the splats cannot be loaded.
    fn set_up(&mut self, splats: Splats) -> Result<ShotSubject>;

    /// Sets up a target that weather lights: splats in the place's axes and units with the colours
    /// that they have in the diffuse light of an overcast sky (a level white card has 1), and
    /// lamps. It is a place of its own, in the same air, and is drawn as any scene is; weathers
    /// that it is drawn in need `light.photos=diffuse` to give it a sun.
    ///
    /// # Errors
    /// As [`Self::set_up`].
    fn set_up_lit(&mut self, splats: Splats, lamps: Vec<Lamp>) -> Result<ShotSubject>;

    /// Returns what the program says of the shadows in the place's own photos.
    ///
    /// # Errors
    /// [`wm_place::Error`] if its light cannot be found.
    fn shadows(&mut self) -> Result<ShadowReport>;

    /// Returns the water on the ground of a lit target at a time of a weather, s; `None` where
    /// nothing is wet.
    ///
    /// # Errors
    /// [`wm_place::Error`] if it cannot be found.
    fn water(&mut self, subject: ShotSubject, weather: &Weather, time: f64) -> Result<Option<WaterState>>;

    /// Removes all targets.
    fn clear_away(&mut self);

    /// Renders a picture.
    ///
    /// # Errors
    /// [`wm_place::Error`] if the camera or the splats cannot be rendered.
    fn draw(&mut self, subject: ShotSubject, request: &FrameRequest<'_>, picture: &mut Picture)
    -> Result<()>;

    /// Sweeps a lidar at the place or a lit target.
    ///
    /// # Errors
    /// [`wm_place::Error`] if the splats cannot be swept; plain targets cannot.
    fn scan(&mut self, scan: &InstrumentScan<'_>) -> Result<LidarSweep>;
}

/// Level coordinates at a place: metres along two horizontal axes and above the ground.
#[derive(Clone, Copy, Debug)]
struct LevelFrame {
    axes: [DVec3; 3],
    site: Site,
}

impl LevelFrame {
    /// Returns the coordinates of a place.
    pub(crate) fn of(site: &Site) -> Self {
        Self { axes: level_axes(site.up).map(DVec3::from_array), site: *site }
    }

    /// Returns a point in scene units.
    pub(crate) fn point(&self, level: [f64; 3]) -> DVec3 {
        let ground = self.axes[2] * self.site.ground;
        ground + self.vector(level) / self.site.metres_per_unit
    }

    /// Returns a vector along the scene's axes, in the same unit.
    pub(crate) fn vector(&self, level: [f64; 3]) -> DVec3 {
        let [x, y, z] = level;
        self.axes[0] * x + self.axes[1] * y + self.axes[2] * z
    }

    /// Returns 1 where the second axis is a quarter turn to the left of the first, seen from above;
    /// -1 where it is to the right.
    pub(crate) fn hand(&self) -> f64 {
        self.axes[0].cross(self.axes[1]).dot(self.axes[2]).signum()
    }

    /// Returns the heading of a direction, measured as the wind's, degrees.
    pub(crate) fn heading(&self, direction: DVec3) -> f64 {
        f64::atan2(direction.dot(self.axes[1]), direction.dot(self.axes[0])).to_degrees()
    }

    /// Converts metres to scene units.
    pub(crate) fn units(&self, metres: f64) -> f64 {
        metres / self.site.metres_per_unit
    }

    /// Converts scene units to metres.
    pub(crate) fn metres(&self, units: f64) -> f64 {
        units * self.site.metres_per_unit
    }

    /// Returns a camera that looks from one point at another, level coordinates; upright, or with
    /// the second axis up where it looks straight down.
    pub(crate) fn camera(
        &self,
        size: (u32, u32),
        fov: f64,
        eye: [f64; 3],
        target: [f64; 3],
    ) -> Result<Camera> {
        let is_level = eye[0] != target[0] || eye[1] != target[1];
        let up = if is_level { self.axes[2] } else { self.axes[1] };
        let mut camera = Camera::looking(size, fov, self.point(eye), self.point(target), up)?;
        camera.near = self.units(0.01);
        Ok(camera)
    }
}

/// Returns the field of view, degrees, whose half has this tangent, or the least that a camera has:
/// what is asked for then fills a part of the picture.
fn fov_of(tangent: f64) -> f64 {
    (2.0 * tangent.atan().to_degrees()).max(*wm_scene::camera::FOV_RANGE_DEG.start())
}

/// Returns the clear weather.
fn clear() -> Weather {
    Weather::clear()
}

/// Colour and median depth: that of the surface, whatever little shines through it.
const SURFACES: Layers = Layers::COLOR.with(Layers::MEDIAN_DEPTH);
/// Colour, both depths and the light that the air lets through.
const AIR: Layers = SURFACES.with(Layers::DEPTH).with(Layers::TRANSMITTANCE);
/// Colour and falling particles.
const PARTICLES: Layers = Layers::COLOR.with(Layers::PARTICLES);

/// Returns the median; NaN if there are no values.
fn median(mut values: Vec<f64>) -> f64 {
    statistics::median(&mut values).unwrap_or(f64::NAN)
}

/// Returns the mean; NaN if there are no values.
fn mean(values: impl IntoIterator<Item = f64>) -> f64 {
    let (sum, count) = values.into_iter().fold((0.0, 0usize), |(sum, count), v| (sum + v, count + 1));
    sum / count as f64
}
