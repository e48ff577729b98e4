//! Instruments: what a weather asks for, measured from rendered pictures.
//!
//! Each brings targets of its own, at the place and in its air: boards at known distances, a thin slab of air before a
//! black board, a yard with a roof. They are drawn by the renderer, through the hooks that draw everybody's pictures,
//! and what is measured comes from pixels alone; what is asked ([`asked`]) comes from the parameters and from published laws,
//! typed anew. So neither side knows the code that it judges. Two instruments look at the place itself: rays and consistency.
//!
//! An instrument is one file and one line of [`INSTRUMENTS`]. It draws by a [`Rig`], which a test replaces by one that draws
//! wrongly: each instrument is seen to find its own error, and no other.

pub mod asked;
pub mod blobs;
pub mod boards;
pub mod budget;
pub mod consistency;
pub mod controls;
pub mod drops;
pub mod field;
pub mod gauge;
pub mod painted;
pub mod rays;
pub mod stake;
pub mod streaks;
#[cfg(test)]
mod tests;

use crate::report::plot::Plot;
use anyhow::Result;
use glam::DVec3;
use serde::Serialize;
use wm_render::parts::PicturePart;
use wm_render::{Frame, Geometry, MedianDepth, Outputs, ParticlePass};
use wm_scene::{Camera, Splats};
use wm_weather::dome::level_axes;
use wm_weather::{Site, Weather};

use weather_magician::Picture;

/// An instrument.
pub struct Instrument {
    /// A word, for `--instruments` and JSON.
    pub name: &'static str,
    /// A few words.
    pub title: &'static str,
    /// How it measures, in two or three sentences.
    pub about: &'static str,
    /// Whether a weather has anything for it to measure at an instant.
    pub applies: fn(&Weather, f64) -> bool,
    /// Measures.
    pub read: fn(&mut dyn Rig, &Probe<'_>) -> Result<Finding>,
    /// What is swept where no weather is given: changes of clear weather.
    pub sweep: &'static [&'static [&'static str]],
}

/// Every instrument, in the order of the report.
#[rustfmt::skip]
pub const INSTRUMENTS: [Instrument; 8] = [
    boards::INSTRUMENT,
    rays::INSTRUMENT,
    gauge::INSTRUMENT,
    streaks::INSTRUMENT,
    stake::INSTRUMENT,
    budget::INSTRUMENT,
    consistency::INSTRUMENT,
    controls::INSTRUMENT,
];

/// What is measured.
pub struct Probe<'a> {
    /// The weather that is asked for.
    pub weather: &'a Weather,
    /// The instant, s.
    pub time: f64,
    /// It in words.
    pub setting: &'a str,
}

impl Probe<'_> {
    /// The weather with changes.
    pub fn with(&self, changes: &[&str]) -> Result<Weather> {
        let mut weather = self.weather.clone();
        changes.iter().try_for_each(|change| weather.set_text(change))?;
        Ok(weather)
    }
}

/// How far a number may be off.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Tolerance {
    /// As a share of what is asked.
    Relative(f64),
    /// In its own unit.
    Absolute(f64),
    /// In its own unit, upwards; less is as good.
    Above(f64),
    /// It is there to compare with.
    None,
}

/// What was asked and what was measured.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Reading {
    /// What.
    pub quantity: String,
    /// Under which weather.
    pub setting: String,
    /// Its unit; empty for a plain number.
    pub unit: &'static str,
    /// By the weather's parameters and the laws.
    pub asked: f64,
    /// From pictures.
    pub measured: f64,
    /// Chance in it, in its own unit, where it is told by counting.
    pub standard_error: Option<f64>,
    /// How far they may be apart.
    pub tolerance: Tolerance,
}

impl Reading {
    /// How far it is off: as a share of what is asked, or in its own unit.
    pub fn error(&self) -> f64 {
        match self.tolerance {
            Tolerance::Relative(_) => self.measured / self.asked - 1.0,
            Tolerance::Absolute(_) | Tolerance::Above(_) | Tolerance::None => self.measured - self.asked,
        }
    }

    /// Whether it is as asked.
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
pub struct Shown {
    /// What it shows.
    pub caption: String,
    /// `[H, W, 3]`, sRGB, 0-1.
    pub rgb: Vec<f32>,
    /// Width and height, px.
    pub size: (u32, u32),
}

impl Shown {
    /// The colours of a frame.
    pub fn of(caption: impl Into<String>, frame: &Frame) -> Self {
        Self { caption: caption.into(), rgb: frame.rgb.clone(), size: (frame.width, frame.height) }
    }

    /// Shares, 0-1, `[H, W]`, in grey.
    pub fn grey(caption: impl Into<String>, shares: impl Iterator<Item = f32>, size: (u32, u32)) -> Self {
        Self { caption: caption.into(), rgb: shares.flat_map(|share| [share; 3]).collect(), size }
    }
}

/// What an instrument says of one weather.
#[derive(Clone, Debug, Default)]
pub struct Finding {
    /// Its numbers.
    pub readings: Vec<Reading>,
    /// Its curves.
    pub plots: Vec<Plot>,
    /// What it looked at.
    pub pictures: Vec<Shown>,
}

/// What is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Subject {
    /// The place.
    Place,
    /// A target: the n-th that was set up.
    Target(usize),
}

/// One picture that is asked for.
#[derive(Clone, Copy)]
pub struct Shot<'a> {
    /// Of what.
    pub subject: Subject,
    /// From where.
    pub camera: &'a Camera,
    /// In which weather.
    pub weather: &'a Weather,
    /// When, s.
    pub time: f64,
    /// What beside the colour.
    pub outputs: Outputs,
    /// Which parts.
    pub parts: &'a [PicturePart],
}

/// What instruments draw with.
pub trait Rig {
    /// What weather knows of the place.
    fn site(&self) -> Site;

    /// A good view of the place, and one a step further.
    fn views(&mut self) -> Result<[Camera; 2]>;

    /// Sets up a target, splats in the place's axes and units.
    fn set_up(&mut self, splats: Splats) -> Result<Subject>;

    /// Takes all targets down.
    fn clear_away(&mut self);

    /// RandomSequence.
    fn draw(&mut self, shot: &Shot<'_>, picture: &mut Picture) -> Result<()>;
}

/// Level coordinates at a place: metres along two level axes and above the ground.
#[derive(Clone, Copy, Debug)]
pub struct Level {
    axes: [DVec3; 3],
    site: Site,
}

impl Level {
    /// Of a place.
    pub fn of(site: &Site) -> Self {
        Self { axes: level_axes(site.up).map(DVec3::from_array), site: *site }
    }

    /// A point, scene units.
    pub fn point(&self, [x, y, z]: [f64; 3]) -> DVec3 {
        let ground = self.axes[2] * self.site.ground;
        ground + self.way([x, y, z]) / self.site.metres_per_unit
    }

    /// A direction or a way, in units of its numbers.
    pub fn way(&self, [x, y, z]: [f64; 3]) -> DVec3 {
        self.axes[0] * x + self.axes[1] * y + self.axes[2] * z
    }

    /// 1 where the second axis is a quarter turn to the left of the first, seen from above; -1 where it is to the right.
    pub fn hand(&self) -> f64 {
        self.axes[0].cross(self.axes[1]).dot(self.axes[2]).signum()
    }

    /// The heading of a direction, as the wind's, degrees.
    pub fn heading(&self, direction: DVec3) -> f64 {
        f64::atan2(direction.dot(self.axes[1]), direction.dot(self.axes[0])).to_degrees()
    }

    /// Metres in scene units.
    pub fn units(&self, metres: f64) -> f64 {
        metres / self.site.metres_per_unit
    }

    /// Metres of a length in scene units.
    pub fn metres(&self, units: f64) -> f64 {
        units * self.site.metres_per_unit
    }

    /// A camera that looks from one point at another, level coordinates; upright, or with the second axis up where it looks
    /// straight down.
    pub fn camera(&self, size: (u32, u32), fov: f64, eye: [f64; 3], target: [f64; 3]) -> Result<Camera> {
        let is_level = eye[0] != target[0] || eye[1] != target[1];
        let up = if is_level { self.axes[2] } else { self.axes[1] };
        let mut camera = Camera::looking(size, fov, self.point(eye), self.point(target), up)?;
        camera.near = self.units(0.01);
        Ok(camera)
    }
}

/// The clear weather.
pub fn clear() -> Weather {
    Weather::clear()
}

/// Colour and median depth: that of the surface, whatever little shines through it.
pub const DEPTH: Outputs =
    Outputs { geometry: Geometry::None, median_depth: MedianDepth::On, particles: ParticlePass::Off };
/// Colour and what falls.
pub const PARTICLES: Outputs =
    Outputs { geometry: Geometry::None, median_depth: MedianDepth::Off, particles: ParticlePass::On };
/// Colour alone.
pub const COLOR: Outputs =
    Outputs { geometry: Geometry::None, median_depth: MedianDepth::Off, particles: ParticlePass::Off };
/// The median; not a number of none.
pub fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

/// The mean; not a number of none.
pub fn mean(values: impl IntoIterator<Item = f64>) -> f64 {
    let (sum, count) = values.into_iter().fold((0.0, 0usize), |(sum, count), v| (sum + v, count + 1));
    sum / count as f64
}
