//! Drops and flakes one by one: a probe camera looks through a thin slab of air.
//!
//! The slab lies between the camera's near plane and a black board, so that each drop in a picture is at a known depth, and
//! the air of each pixel has a known volume. The shutter is open for 10 us: drops stand still. What one hides, the sum of
//! its coverage, is its area and so its diameter; a second picture a moment later tells how fast it goes. Nothing is taken from the
//! lists of drops of the renderer: two drops that touch in a picture count as one, 1 % of them.

use super::blobs::{Blob, blobs};
use super::{Level, PARTICLES, Probe, Rig, Shot, Shown, asked};
use crate::parts::Picture;
use anyhow::Result;
use std::f64::consts::PI;
use wm_scene::splats::{Splat, logit};
use wm_scene::{Camera, Group, Splats};
use wm_weather::Weather;
use wm_weather::particles::Kind;

/// The name of the effect.
pub fn effect(kind: Kind) -> &'static str {
    match kind {
        Kind::Rain => "rain",
        Kind::Snow => "snowfall",
    }
}

/// What falls more of at an instant.
pub fn main_kind(weather: &Weather, time: f64) -> Option<Kind> {
    let rate = |kind: Kind| asked::number(weather, time, effect(kind), "rate").unwrap_or(0.0);
    let (rain, snow) = (rate(Kind::Rain), rate(Kind::Snow));
    (rain.max(snow) > 0.0).then_some(if rain >= snow { Kind::Rain } else { Kind::Snow })
}

/// Picture of a slab of air.
#[derive(Clone, Copy, Debug)]
pub struct Slab {
    /// px.
    pub size: u32,
    /// Depth of its middle and its thickness, m.
    pub depth: f64,
    pub thickness: f64,
    /// Pixels to a metre in its middle.
    pub scale: f64,
    /// Pixels at each border in which nothing is counted: left and right, bottom.
    pub margin: [f64; 2],
    /// Time between two pictures, s.
    pub apart: f64,
    /// Faster than any falls, m/s.
    pub fastest: f64,
    /// Every so many-th picture has a second one, a moment later.
    pub pairs: usize,
}

impl Slab {
    /// Volume of the air of which drops are counted in one picture, m^3.
    fn volume(&self) -> f64 {
        let side = f64::from(self.size);
        let (across, down) = (side - 2.0 * self.margin[0], side - self.margin[0] - self.margin[1]);
        let focal = self.scale * self.depth;
        let [near, far] = self.ends();
        across * down / (focal * focal) * (far.powi(3) - near.powi(3)) / 3.0
    }

    fn ends(&self) -> [f64; 2] {
        [self.depth - 0.5 * self.thickness, self.depth + 0.5 * self.thickness]
    }

    /// The camera that stands at a place, level coordinates, and looks across the wind, and the board behind the slab.
    fn camera(&self, level: &Level, eye: [f64; 3], heading: f64) -> Result<Camera> {
        let (sin, cos) = heading.to_radians().sin_cos();
        // Its right is where the wind blows to.
        let hand = level.hand();
        let target = [eye[0] - hand * sin, eye[1] + hand * cos, eye[2]];
        let fov = 2.0 * (0.5 * f64::from(self.size) / (self.scale * self.depth)).atan().to_degrees();
        let camera = level.camera((self.size, self.size), fov, eye, target)?;
        Ok(Camera { near: level.units(self.ends()[0]), ..camera })
    }

    /// A black board: splats so wide that none ends in the picture, at one depth.
    fn board(&self, level: &Level, camera: &Camera) -> Splats {
        let mut splats = Splats::default();
        let normal = camera.forward();
        let [x, y, z, w] = glam::DQuat::from_rotation_arc(glam::DVec3::Z, normal).to_array();
        for _ in 0..4 {
            splats.push(&Splat {
                mean: (camera.center() + normal * level.units(self.ends()[1])).to_array().map(|v| v as f32),
                quat: [w, x, y, z].map(|v| v as f32),
                log_scale: [20.0, 20.0, 0.001].map(|metres: f64| level.units(metres).ln() as f32),
                logit_opacity: logit(0.99) as f32,
                rgb: [0.0; 3],
                group: Group::Scene,
            });
        }
        splats
    }

    /// Whether a blob is counted.
    fn holds(&self, blob: &Blob) -> bool {
        let (side, [x, y]) = (f64::from(self.size), blob.at);
        let beside = self.margin[0]..side - self.margin[0];
        beside.contains(&x) && y > self.margin[0] && y < side - self.margin[1]
    }
}

/// Side of the part of a picture that is shown, px.
const PART: u32 = 240;

/// One drop.
#[derive(Clone, Copy, Debug)]
pub struct Drop {
    /// As it is seen, mm.
    pub diameter: f64,
    /// With the wind and down, m/s; `None` where it was not found again.
    pub velocity: Option<[f64; 2]>,
    /// In the first picture.
    pub blob: Blob,
}

/// The drops of several pictures.
#[derive(Clone, Debug, Default)]
pub struct Catch {
    pub drops: Vec<Drop>,
    /// Air that was looked at, m^3.
    pub volume: f64,
    /// The last picture.
    pub shown: Option<Shown>,
}

/// Looks at a slab from `pictures` places, in the weather as it is but for gusts and `changes`, among them the opacity of what
/// falls.
pub fn catch(
    rig: &mut dyn Rig,
    probe: &Probe<'_>,
    kind: Kind,
    (slab, pictures, changes, opacity): (&Slab, usize, &[&str], f64),
) -> Result<Catch> {
    let other = match kind {
        Kind::Rain => "snowfall=off",
        Kind::Snow => "rain=off",
    };
    let mut weather = probe.with(changes)?;
    weather.set(other)?;
    let number = |param: &str| asked::number(&weather, probe.time, "wind", param);
    let (wind, heading) = (number("speed").unwrap_or(0.0), number("direction").unwrap_or(0.0));
    if wind > 0.0 {
        weather.set("wind.gusts=0")?;
    }
    let level = Level::of(&rig.site());
    let (mut caught, mut picture) = (Catch::default(), Picture::default());
    for index in 0..pictures {
        // Places so far apart that none shows a drop of another.
        let eye = [40.0 * (index % 8) as f64, 40.0 * (index / 8) as f64, 2.0];
        let camera = slab.camera(&level, eye, heading)?;
        let board = rig.set_up(slab.board(&level, &camera))?;
        let mut seen = |time: f64, picture: &mut Picture| {
            let outputs = PARTICLES;
            rig.draw(
                &Shot { subject: board, camera: &camera, weather: &weather, time, outputs, passes: &[] },
                picture,
            )?;
            anyhow::Ok(blobs(&picture.frame.particles, slab.size as usize))
        };
        let is_pair = index % slab.pairs == 0;
        let second = if is_pair { seen(probe.time + slab.apart, &mut picture)? } else { Vec::new() };
        let first = seen(probe.time, &mut picture)?;
        for blob in first.into_iter().filter(|blob| slab.holds(blob)) {
            let diameter = 2e3 * (blob.cover / opacity / PI).sqrt() / slab.scale;
            caught.drops.push(Drop { diameter, velocity: again(slab, wind, &blob, &second), blob });
        }
        caught.volume += slab.volume();
    }
    // A part of the last picture, with faint drops to be seen.
    let (side, first) = (slab.size as usize, (slab.size.saturating_sub(PART) / 2) as usize);
    let part = PART.min(slab.size);
    let pixel =
        |x: usize, y: usize| picture.frame.particles[4 * ((first + y) * side + first + x) + 3].powf(0.45);
    let pixels = (0..part as usize).flat_map(|y| (0..part as usize).map(move |x| (x, y)));
    caught.shown = Some(Shown::grey(String::new(), pixels.map(|(x, y)| pixel(x, y)), (part, part)));
    Ok(caught)
}

/// How fast a drop goes, with the wind and down, m/s: the only one of its size in the second picture where it can be.
fn again(slab: &Slab, wind: f64, blob: &Blob, second: &[Blob]) -> Option<[f64; 2]> {
    /// How much faster or slower than the wind one may sway, m/s.
    const ASIDE: f64 = 1.5;
    let pixels = slab.scale * slab.apart;
    let is_it = |other: &&Blob| {
        let [dx, dy] = [0, 1].map(|k| (other.at[k] - blob.at[k]) / pixels);
        (0.0..slab.fastest).contains(&dy)
            && (dx - wind).abs() < ASIDE + 0.3 * wind
            && (other.cover / blob.cover - 1.0).abs() < 0.03
    };
    let mut found = second.iter().filter(is_it);
    match (found.next(), found.next()) {
        (Some(other), None) => Some([0, 1].map(|k| (other.at[k] - blob.at[k]) / pixels)),
        _ => None,
    }
}
