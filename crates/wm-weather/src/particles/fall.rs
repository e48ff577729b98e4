//! What falls at one instant before one camera.
//!
//! Photometry: a drop is a lens over 165 degrees, so that it shows the mean of what is around it, almost whatever lies
//! behind (Garg and Nayar 2007); a flake scatters it. That radiance belongs to the site and the time, never to
//! the frame. A drop hides a pixel for a part of the exposure: its Gaussian is as long as its way in it
//! (`V T`, as a standard deviation over sqrt 12), and covers its area in all.

use super::field::{Cells, Cone, Draws, wave};
use super::residual::{FADE, NEAREST, Residual, fade};
use super::spectrum::{Class, Kind};
use crate::dome::{from_level, level_axes, to_level};
use crate::optics::{Atmosphere, Layer, Site};
use crate::shelter::Shelter;
use std::f64::consts::{PI, TAU};
use wm_render::hooks::{Particle, ParticleView, Particles};

/// Width at which drops end, px; and below which flakes are drawn fewer and larger.
const CUT: f64 = 0.3;
const MERGE: f64 = 1.0;
/// Width from which a flake shows its three arms, px.
const ARMS: f64 = 4.0;
/// Width of thresholds over which drops fade, as a share.
const SOFT: f64 = 0.1;
/// Share of the airlight that surroundings shine with: half of them sky, half ground of half its light.
const SURROUNDINGS: f64 = 0.75;
/// Share of its light that a flake throws back.
const FLAKE: f64 = 0.95;
/// Standard deviation of a disc and of a line of length 1.
const DISC: f64 = 0.25;
const LINE: f64 = 0.288_675_134_594_812_9;
/// Thickness of a flake's arm, as a share of its length.
const ARM: f64 = 0.1;
/// Swaying of flakes: speed sideways, m/s, and frequency, Hz, from and to.
const SWAY: [f64; 2] = [0.15, 0.5];
const SWAY_RATE: [f64; 2] = [0.5, 1.5];

/// A wave in which flakes near each other sway together.
struct Eddy {
    /// How far, m.
    reach: f64,
    /// Wavelength, m, along `from`.
    length: f64,
    /// s.
    period: f64,
    from: [f64; 2],
    /// Direction of the swaying.
    to: [f64; 2],
}

/// Waves of some metres, in all directions.
const EDDIES: [Eddy; 4] = [
    Eddy { reach: 0.12, length: 2.3, period: 2.9, from: [1.0, 0.0], to: [1.0, 0.0] },
    Eddy { reach: 0.2, length: 4.1, period: 4.3, from: [-0.13, 0.99], to: [-0.97, -0.26] },
    Eddy { reach: 0.3, length: 7.7, period: 6.7, from: [-0.97, -0.26], to: [0.87, 0.49] },
    Eddy { reach: 0.4, length: 13.0, period: 9.1, from: [0.38, -0.93], to: [-0.71, -0.70] },
];

/// Work is cut in parts of about so many slices.
const SLICES: i64 = 6;

/// How precipitation looks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Look {
    /// Which of the equally likely falls.
    pub seed: u64,
    /// How long the shutter is open, s.
    pub exposure: f64,
    /// Factor on diameters as drawn.
    pub size: f64,
    /// Factor on cover as drawn.
    pub opacity: f64,
    /// Factor on radiance.
    pub brightness: f64,
    /// Radiance, linear RGB, where it is not that of the surroundings.
    pub radiance: Option<[f64; 3]>,
}

impl Default for Look {
    /// As in nature, in a video's exposure.
    fn default() -> Self {
        Self { seed: 0, exposure: 1.0 / 60.0, size: 1.0, opacity: 1.0, brightness: 1.0, radiance: None }
    }
}

/// One kind of precipitation at one instant.
#[derive(Clone, Debug, PartialEq)]
pub struct Precipitation {
    /// What falls.
    pub kind: Kind,
    /// Water, mm/h.
    pub rate: f64,
    /// How it looks.
    pub look: Look,
    /// Radiance of an endless path through it, linear RGB.
    pub airlight: [f64; 3],
    classes: Vec<Class>,
    /// Drops a m^3 now, and at a threshold of 1.
    numbers: Vec<f64>,
    reference: Vec<f64>,
}

impl Precipitation {
    /// A kind at a rate, mm/h of water, under an airlight (linear RGB).
    #[must_use]
    pub fn new(kind: Kind, rate: f64, airlight: [f64; 3], look: Look) -> Self {
        let classes = kind.classes();
        Self {
            kind,
            rate,
            look,
            airlight,
            numbers: kind.densities(&classes, rate),
            reference: kind.reference(&classes),
            classes,
        }
    }

    /// The classes, with the drops a m^3 of each.
    pub fn classes(&self) -> impl Iterator<Item = (&Class, f64)> {
        self.classes.iter().zip(self.numbers.iter().copied())
    }

    /// Extinction of all of it, 1/m.
    #[must_use]
    pub fn sigma_t(&self) -> f64 {
        self.kind.sigma_t(&self.classes, self.rate)
    }

    /// The air that all of it together is.
    #[must_use]
    pub fn layer(&self) -> Layer {
        Layer {
            sigma_t: [self.sigma_t(); 3],
            airlight: self.airlight,
            scale_height: f64::INFINITY,
            base_height: 0.0,
        }
    }

    /// Mean fall speed by water, m/s; not a number where nothing falls.
    #[must_use]
    pub fn mean_speed(&self) -> f64 {
        let water = |(class, number): (&Class, f64)| class.water * number;
        let all: f64 = self.classes().map(water).sum();
        self.classes().map(|pair| pair.0.fall_speed * water(pair)).sum::<f64>() / all
    }

    /// Up to where a class is drawn in a view, m.
    fn range(&self, class: &Class, pixels: f64) -> f64 {
        class.width * self.look.size * pixels / CUT
    }

    /// What of it a view with `pixels` to a length of 1 at distance 1 draws and the air must not do again.
    #[must_use]
    pub fn residual(&self, pixels: f64) -> Residual {
        let drawn = self.classes().map(|(class, number)| [number * class.area, self.range(class, pixels)]);
        Residual::new(drawn.collect(), self.airlight)
    }
}

/// Precipitation before a camera.
pub struct Fall<'a> {
    precipitation: &'a Precipitation,
    air: &'a Atmosphere,
    shelter: Option<&'a Shelter>,
    /// Level axes: two level, and up.
    axes: [[f64; 3]; 3],
    metres_per_unit: f64,
    blow: Blow,
    /// The camera's velocity, m/s along the level axes and up.
    camera: [f64; 3],
    time: f64,
    radiance: [f32; 3],
}

/// The wind at an instant: how far the air has come since time 0, and how fast it goes, m and m/s along level axes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Blow {
    /// m.
    pub drift: [f64; 2],
    /// m/s.
    pub wind: [f64; 2],
    /// m/s, without gusts.
    pub mean: [f64; 2],
}

impl<'a> Fall<'a> {
    /// At the instant `time`, s, before a camera that moves with `velocity` (m/s, world axes).
    #[must_use]
    pub fn new(
        precipitation: &'a Precipitation,
        site: &Site,
        air: &'a Atmosphere,
        shelter: Option<&'a Shelter>,
        (blow, velocity): (Blow, [f64; 3]),
        time: f64,
    ) -> Self {
        let axes = level_axes(site.up);
        let natural = || {
            let share = if precipitation.kind == Kind::Snow { SURROUNDINGS * FLAKE } else { SURROUNDINGS };
            precipitation.airlight.map(|v| v * share)
        };
        let radiance = precipitation.look.radiance.unwrap_or_else(natural);
        Self {
            precipitation,
            air,
            shelter,
            metres_per_unit: site.metres_per_unit,
            blow,
            camera: to_level(&axes, velocity),
            axes,
            time,
            radiance: radiance.map(|v| (v * precipitation.look.brightness) as f32),
        }
    }

    /// A level vector in world axes.
    fn world(&self, v: [f64; 3]) -> [f64; 3] {
        from_level(&self.axes, v)
    }

    fn cells(&self, class: usize) -> Cells {
        let kind = if self.precipitation.kind == Kind::Snow { 0x5110_0000 } else { 0x4a11_0000 };
        let mut draws = Draws::new(self.precipitation.look.seed ^ kind ^ (class as u64) << 40);
        Cells::new(draws.bits(), self.precipitation.reference[class])
    }

    /// What of a class a view may see.
    fn cone(&self, class: usize, view: &ParticleView) -> Cone {
        let kind = &self.precipitation.classes[class];
        let range = FADE[1] * self.precipitation.range(kind, f64::from(view.pixels()));
        let level = to_level(&self.axes, view.center.map(|v| v * self.metres_per_unit));
        let [x, y] = self.blow.drift;
        let come = [x, y, -kind.fall_speed * self.time];
        let speed = self.relative(kind.fall_speed).iter().map(|v| v * v).sum::<f64>().sqrt();
        let sway = match self.precipitation.kind {
            Kind::Rain => 0.0,
            Kind::Snow => EDDIES.iter().map(|eddy| eddy.reach).sum::<f64>() + SWAY[1] / (TAU * SWAY_RATE[0]),
        };
        // As far as its Gaussian reaches: three standard deviations of a streak are less than its length.
        let margin =
            speed * self.precipitation.look.exposure + 3.0 * kind.width * self.precipitation.look.size + sway;
        Cone {
            planes: Cone::planes(view, &self.axes),
            center: std::array::from_fn(|k| level[k] - come[k]),
            range,
            margin,
        }
    }

    /// Velocity of what falls at `speed` as the camera sees it, level axes, m/s.
    fn relative(&self, speed: f64) -> [f64; 3] {
        let [x, y] = self.blow.wind;
        [x - self.camera[0], y - self.camera[1], -speed - self.camera[2]]
    }
}

impl Particles for Fall<'_> {
    fn parts(&self, view: &ParticleView) -> Vec<[i32; 4]> {
        let mut parts = Vec::new();
        for class in 0..self.precipitation.classes.len() {
            if self.precipitation.numbers[class] <= 0.0 {
                continue;
            }
            // From the first slice, so that numbers stay small far from the origin.
            let slices = self.cone(class, view).slices(self.cells(class).edge);
            let count = slices.end - slices.start;
            let mut first = 0;
            while first < count {
                parts.push([class as i32, first as i32, (first + SLICES).min(count) as i32, 0]);
                first += SLICES;
            }
        }
        parts
    }

    fn gather(&self, view: &ParticleView, [class, first, last, _]: [i32; 4], out: &mut Vec<Particle>) {
        let index = class as usize;
        let (cells, cone) = (self.cells(index), self.cone(index, view));
        let this = self.precipitation;
        let class = &this.classes[index];
        let share = this.numbers[index] / this.reference[index];
        let pixels = f64::from(view.pixels());
        let range = this.range(class, pixels);
        let merge = match this.kind {
            Kind::Rain => f64::INFINITY,
            Kind::Snow => range * CUT / MERGE,
        };
        let wanted = |distance: f64| {
            let keep = if distance > merge { (merge / distance).powi(2) } else { 1.0 };
            (share * keep * fade(distance / range), keep)
        };
        let half = 0.5 * cells.edge;
        let relative = self.relative(class.fall_speed);
        let shade = Shade { fall: self, view, pixels, relative };
        let begin = cone.slices(cells.edge).start;
        for slice in begin + i64::from(first)..begin + i64::from(last) {
            cone.each_cell(cells.edge, slice, |cell, corner| {
                let middle = corner.map(|v| v + half);
                let off = middle.iter().map(|v| v * v).sum::<f64>().sqrt() - half * 3f64.sqrt();
                let most = wanted((off - cone.margin).max(0.0)).0 * (1.0 + 0.5 * SOFT);
                for mut point in cells.points(cell) {
                    if point.threshold >= most {
                        break;
                    }
                    let at: [f64; 3] = std::array::from_fn(|k| corner[k] + cells.edge * point.place[k]);
                    // Of those outside most can be told before they sway.
                    if !cone.holds(&at) {
                        continue;
                    }
                    let width = class.seen(point.draws.uniform());
                    let (at, velocity) = shade.moved(at, &cone.center, &mut point.draws);
                    let distance = at.iter().map(|v| v * v).sum::<f64>().sqrt();
                    let (wanted, keep) = wanted(distance);
                    let there = ((wanted * (1.0 + 0.5 * SOFT) - point.threshold) / (SOFT * wanted)).min(1.0);
                    if there > 0.0 && distance > NEAREST {
                        shade.draw(at, velocity, (width, distance), (there, keep), &mut point.draws, out);
                    }
                }
            });
        }
    }
}

/// What the drops of one class share.
struct Shade<'a> {
    fall: &'a Fall<'a>,
    view: &'a ParticleView,
    pixels: f64,
    relative: [f64; 3],
}

impl Shade<'_> {
    /// Where a drop is that would be `at` without swaying (level axes, m from the camera), and its velocity as the
    /// camera sees it, m/s.
    #[inline]
    fn moved(&self, mut at: [f64; 3], center: &[f64; 3], draws: &mut Draws) -> ([f64; 3], [f64; 3]) {
        let mut velocity = self.relative;
        if self.fall.precipitation.kind == Kind::Snow {
            let time = self.fall.time;
            let between = |range: [f64; 2], share: f64| range[0] + (range[1] - range[0]) * share;
            let (speed, rate) = (between(SWAY, draws.uniform()), between(SWAY_RATE, draws.uniform()));
            let [sin, cos] = wave(rate * time + draws.uniform());
            let rate = TAU * rate;
            // Where it stands still, so that it goes by nothing but itself.
            let own: [f64; 2] = [at[0] + center[0], at[1] + center[1]];
            let height = at[2] + center[2];
            at[0] += speed / rate * sin;
            at[1] -= speed / rate * cos;
            velocity[0] += speed * cos;
            velocity[1] += speed * sin;
            for Eddy { reach, length, period, from: [x, y], to: [dx, dy] } in EDDIES {
                let along = own[0] * x + own[1] * y + 0.6 * height;
                let [sin, cos] = wave(along / length + time / period);
                at[0] += reach * sin * dx;
                at[1] += reach * sin * dy;
                velocity[0] += TAU / period * reach * cos * dx;
                velocity[1] += TAU / period * reach * cos * dy;
            }
        }
        (at, velocity)
    }

    /// Adds a drop that is `there` (0-1) and stands for `1 / keep` like it.
    #[inline]
    fn draw(
        &self,
        at: [f64; 3],
        velocity: [f64; 3],
        (width, distance): (f64, f64),
        (there, keep): (f64, f64),
        draws: &mut Draws,
        out: &mut Vec<Particle>,
    ) {
        let this = self.fall.precipitation;
        let units = 1.0 / self.fall.metres_per_unit;
        let offset = self.fall.world(at).map(|v| v * units);
        let world: [f32; 3] = std::array::from_fn(|k| (self.view.center[k] + offset[k]) as f32);
        if self.fall.shelter.is_some_and(|shelter| !shelter.is_exposed(world)) {
            return;
        }
        let width = width * this.look.size;
        let area = PI / 4.0 * width * width * this.look.opacity * there / keep;
        // Those that stand for several are as wide as all of them together.
        let sigma = DISC * width / keep.sqrt();
        let offset = offset.map(|v| v as f32);
        // Half its way in the exposure, and its own width.
        let way = velocity.iter().map(|v| v * v).sum::<f64>().sqrt() * this.look.exposure;
        if !self.view.may_see(offset, ((4.0 * sigma + way) * units) as f32) {
            return;
        }
        let streak = self.fall.world(velocity).map(|v| (v * this.look.exposure * LINE * units) as f32);
        let direction = offset.map(|v| v / (distance * units) as f32);
        let origin = self.view.center.map(|v| v as f32);
        let rgb = self.fall.air.through(origin, direction, distance as f32, self.fall.radiance);
        let one = Particle {
            offset,
            sigma: (sigma * units) as f32,
            reach: [streak, [0.0; 3]],
            area: (area * units * units) as f32,
            rgb,
        };
        if this.kind == Kind::Rain || width * self.pixels / distance < ARMS {
            out.push(one);
            return;
        }
        // Three arms in a plane that tumbles.
        let time = self.fall.time;
        let (tilt, turn) = (draws.uniform(), TAU * (draws.uniform() + (draws.uniform() - 0.5) * time));
        let (z, spin) = (2.0 * tilt - 1.0, TAU * (draws.uniform() + (draws.uniform() - 0.5) * time));
        let r = (1.0 - z * z).max(0.0).sqrt();
        let (sin, cos) = turn.sin_cos();
        let (a, b) = ([-sin, cos, 0.0], [-z * cos, -z * sin, r]);
        for arm in 0..3 {
            let (sin, cos) = (spin + PI / 3.0 * f64::from(arm)).sin_cos();
            let along: [f64; 3] = std::array::from_fn(|k| (a[k] * cos + b[k] * sin) * width * LINE * units);
            out.push(Particle {
                sigma: (DISC * ARM * 2.0 * width * units) as f32,
                reach: [streak, along.map(|v| v as f32)],
                area: one.area / 3.0,
                ..one
            });
        }
    }
}

#[cfg(test)]
mod tests;
