//! Drops and flakes one by one: a probe camera looks through a thin slab of air.
//!
//! The slab lies between the camera's near plane and a black board, so that each drop in a picture
//! is at a known depth, and the air of each pixel has a known volume. The shutter is open for 10
//! us: drops stand still. What one hides, the sum of its coverage, is its area and so its diameter;
//! a second picture a moment later tells how fast it goes. Nothing is taken from the lists of drops
//! of the renderer.

use super::blobs::{BlobSplit, ParticleBlob, blobs};
use super::expected::{self, effect, falling};
use super::{Bench, LevelFrame, MeasuredPicture, PARTICLES};
use std::f64::consts::PI;
use wm_place::Result;
use wm_place::{FrameRequest, Picture};
use wm_scene::splats::{Splat, logit};
use wm_scene::{Camera, Group, Splats};
use wm_weather::Weather;
use wm_weather::particles::PrecipitationKind;

/// The kind that falls at the highest rate at an instant.
pub(crate) fn main_kind(weather: &Weather, time: f64) -> Option<&'static PrecipitationKind> {
    let most =
        falling(weather, time).into_iter().reduce(|most, next| if next.1 > most.1 { next } else { most });
    most.map(|(kind, _)| kind)
}

/// Picture of a slab of air.
#[derive(Clone, Copy, Debug)]
pub(crate) struct AirSlab {
    /// Side of the picture, px.
    pub(crate) size: u32,
    /// Depth of its middle and its thickness, m.
    pub(crate) depth: f64,
    pub(crate) thickness: f64,
    /// Pixels to a metre in its middle.
    pub(crate) scale: f64,
    /// Pixels at each border in which nothing is counted: left and right, bottom.
    pub(crate) margin: [f64; 2],
    /// Time between two pictures, s.
    pub(crate) apart: f64,
    /// Faster than any falls, m/s.
    pub(crate) fastest: f64,
    /// Every `pairs`-th picture has a second one, a moment later.
    pub(crate) pairs: usize,
    /// The rule that divides a picture into drops.
    pub(crate) split: BlobSplit,
}

impl AirSlab {
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

    /// The camera that stands at a place, level coordinates, its right along a heading.
    fn camera(&self, level: &LevelFrame, eye: [f64; 3], heading: f64) -> Result<Camera> {
        let (sin, cos) = heading.to_radians().sin_cos();
        let hand = level.hand();
        let target = [eye[0] - hand * sin, eye[1] + hand * cos, eye[2]];
        let fov = 2.0 * (0.5 * f64::from(self.size) / (self.scale * self.depth)).atan().to_degrees();
        let camera = level.camera((self.size, self.size), fov, eye, target)?;
        Ok(Camera { near: level.units(self.ends()[0]), ..camera })
    }

    /// A black board: splats so wide that none ends in the picture, at one depth.
    fn board(&self, level: &LevelFrame, camera: &Camera) -> Splats {
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

    /// Returns true if a blob is counted.
    fn holds(&self, blob: &ParticleBlob) -> bool {
        let (side, [x, y]) = (f64::from(self.size), blob.at);
        let beside = self.margin[0]..side - self.margin[0];
        beside.contains(&x) && y > self.margin[0] && y < side - self.margin[1]
    }
}

/// Side of the part of a picture that is shown, px.
const SHOWN_SIDE_PX: u32 = 240;

/// A measured drop or flake.
#[derive(Clone, Copy, Debug)]
pub(crate) struct MeasuredDrop {
    /// The visible diameter, mm.
    pub(crate) diameter: f64,
    /// The velocity with the wind and down, m/s; `None` if it was not found in the second picture.
    pub(crate) velocity: Option<[f64; 2]>,
    /// The blob in the first picture.
    pub(crate) blob: ParticleBlob,
    /// The index of the picture.
    pub(crate) picture: usize,
}

/// The drops of several pictures.
#[derive(Clone, Debug, Default)]
pub(crate) struct DropSample {
    pub(crate) drops: Vec<MeasuredDrop>,
    /// Volume of the air, m^3.
    pub(crate) volume: f64,
    /// Number of pictures, without second ones.
    pub(crate) pictures: usize,
    /// The last picture.
    pub(crate) shown: Option<MeasuredPicture>,
}

/// The weather, direction and places of pictures of a slab.
#[derive(Clone, Debug)]
pub(crate) struct SlabView {
    pub(crate) slab: AirSlab,
    weather: Weather,
    /// Factor on what a drop hides.
    opacity: f64,
    /// Direction of the right of a picture, as that of the wind, degrees.
    heading: f64,
    /// The wind along it, m/s.
    pub(crate) across: f64,
    /// The first of the places to look from.
    first: usize,
}

impl SlabView {
    /// Across the wind, in a weather as it is but for gusts, other kinds that fall and the size and
    /// opacity of what falls.
    pub(crate) fn new(
        weather: &Weather,
        time: f64,
        kind: &PrecipitationKind,
        slab: AirSlab,
        opacity: f64,
    ) -> Result<Self> {
        let mut weather = weather.clone();
        for (other, _) in falling(&weather, time).into_iter().filter(|(other, _)| *other != kind) {
            weather.set_text(&format!("{}=off", effect(other)))?;
        }
        weather.set_text(&format!("{}.size=1", effect(kind)))?;
        weather.set_text(&format!("{}.opacity={opacity}", effect(kind)))?;
        let number = |param: &str| expected::number(&weather, time, "wind", param);
        let (across, heading) = (number("speed").unwrap_or(0.0), number("direction").unwrap_or(0.0));
        if across > 0.0 {
            weather.set_text("wind.gusts=0")?;
        }
        Ok(Self { slab, weather, opacity, heading, across, first: 0 })
    }

    /// Returns the same view with the right of the pictures along another heading.
    pub(crate) fn turned(self, heading: f64) -> Self {
        let across = self.across * (self.heading - heading).to_radians().cos();
        Self { heading, across, ..self }
    }

    /// Returns the same view, beginning at another place.
    pub(crate) fn beginning_at(self, first: usize) -> Self {
        Self { first, ..self }
    }

    /// Takes `pictures` more pictures, each at another place.
    pub(crate) fn take(&self, bench: &mut Bench<'_>, pictures: usize, caught: &mut DropSample) -> Result<()> {
        let (slab, level, time) = (&self.slab, bench.level, bench.time);
        let mut picture = Picture::default();
        for index in caught.pictures..caught.pictures + pictures {
            // Places so far apart that none shows a drop of another.
            let place = self.first + index;
            let eye = [40.0 * (place % 8) as f64, 40.0 * (place / 8) as f64, 2.0];
            let camera = slab.camera(&level, eye, self.heading)?;
            let board = bench.rig.set_up(slab.board(&level, &camera))?;
            let mut seen = |time: f64, picture: &mut Picture| -> Result<_> {
                let request =
                    FrameRequest { layers: PARTICLES, ..FrameRequest::new(&self.weather, camera, time) };
                bench.rig.draw(board, &request, picture)?;
                Ok(blobs(&picture.frame.particles, slab.size as usize, self.opacity, slab.split))
            };
            let is_pair = index % slab.pairs == 0;
            let second = if is_pair { seen(time + slab.apart, &mut picture)? } else { Vec::new() };
            let first = seen(time, &mut picture)?;
            for blob in first.into_iter().filter(|blob| slab.holds(blob)) {
                let diameter = 2e3 * (blob.cover / self.opacity / PI).sqrt() / slab.scale;
                let velocity = drop_velocity(slab, self.across, &blob, &second);
                caught.drops.push(MeasuredDrop { diameter, velocity, blob, picture: index });
            }
            caught.volume += slab.volume();
            bench.rig.clear_away();
        }
        caught.pictures += pictures;
        caught.shown = Some(self.part(&picture.frame.particles));
        Ok(())
    }

    /// The middle of a picture, with faint drops to be seen.
    fn part(&self, particles: &[f32]) -> MeasuredPicture {
        let (size, part) = (self.slab.size as usize, SHOWN_SIDE_PX.min(self.slab.size));
        let first = (size - part as usize) / 2;
        let whole = self.opacity.min(1.0) as f32;
        let pixel = |x: usize, y: usize| {
            let coverage = particles[4 * ((first + y) * size + first + x) + 3];
            (coverage / whole).min(1.0).powf(0.45)
        };
        let pixels = (0..part as usize).flat_map(|y| (0..part as usize).map(move |x| (x, y)));
        MeasuredPicture::grey(String::new(), pixels.map(|(x, y)| pixel(x, y)), (part, part))
    }
}

/// The velocity of a drop, with the wind and down, m/s: found if only one blob of its size is
/// within reach in the second picture.
fn drop_velocity(
    slab: &AirSlab,
    wind: f64,
    blob: &ParticleBlob,
    second: &[ParticleBlob],
) -> Option<[f64; 2]> {
    /// Largest sideways speed relative to the wind, m/s.
    const MAX_SIDE_SPEED_M_S: f64 = 1.5;
    let pixels = slab.scale * slab.apart;
    let is_it = |other: &&ParticleBlob| {
        let [dx, dy] = [0, 1].map(|k| (other.at[k] - blob.at[k]) / pixels);
        (0.0..slab.fastest).contains(&dy)
            && (dx - wind).abs() < MAX_SIDE_SPEED_M_S + 0.3 * wind
            && (other.cover / blob.cover - 1.0).abs() < 0.03
    };
    let mut found = second.iter().filter(is_it);
    match (found.next(), found.next()) {
        (Some(other), None) => Some([0, 1].map(|k| (other.at[k] - blob.at[k]) / pixels)),
        _ => None,
    }
}
