//! One sweep of a radar through a scene in rain.
//!
//! Rays fill the field of view and the beam, at random places of a grid, at most 0.2 degrees apart
//! and four or more in the width of a cell. Each that meets a surface is a [`Scatterer`] of the RCS
//! `gamma r^2 dOmega` ([`super::surface::surface_backscatter`]), with the power of the radar equation less
//! the attenuation of the rain, there and back. A surface at a flat angle is spread over the range
//! that the ray's width covers of it. The whole sweep is measured at its start; the sensor's motion
//! is in the velocities alone.
//!
//! Every random number is a function of (seed, sensor, sweep, cell or ray), so that any sweep can
//! be made alone, on any number of threads.

use super::cells::{self, PowerCube, RainClutter, SIDE_CELLS, Scatterer};
use super::model::{REFERENCE_RCS_M2, RadarModel};
use super::rain::{rain_attenuation, rain_reflectivity};
use super::surface::surface_backscatter;
use crate::pose::{SensorMotion, SensorPose, direction};
use crate::sweep::PointFrame;
use glam::DVec3;
use rayon::prelude::*;
use std::f64::consts::FRAC_PI_4;
use wm_base::random::RandomStream;
use wm_render::simd::SimdPath;
use wm_render::{RayOutputs, RayTracer, Rays};
use wm_weather::shelter::Shelter;
use wm_weather::{PreparedWeather, Site};

/// A place in weather, for radars.
#[derive(Clone, Copy)]
pub struct RadarScene<'a> {
    /// The splats.
    pub splats: &'a dyn RayTracer,
    /// The weather at the start of the sweep.
    pub weather: &'a PreparedWeather,
    /// The scale and the up direction.
    pub site: &'a Site,
    /// The map of the places that rain does not reach; `None` to ignore roofs.
    pub shelter: Option<&'a Shelter>,
    /// The processor's instructions.
    pub path: SimdPath,
}

/// Options of the sweeps of a scan by radar.
#[derive(Clone, Copy, Debug, Default)]
pub struct RadarScanOptions {
    /// Start of sweep 0, s: of the weather, and along the path.
    pub time: f64,
    /// The number of the sweep, or of the first: random numbers depend on it.
    pub index: u32,
    /// The seed of noise, speckle and rays.
    pub seed: u64,
    /// The number of the radar on its rig: its noise depends on it.
    pub sensor: u8,
    /// The axes of the detections: [`PointFrame::Raw`] is the same as [`PointFrame::Compensated`].
    pub frame: PointFrame,
}

/// The source of most of a detection's power.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum RadarClass {
    /// A surface of the scene.
    Surface = 0,
    /// Rain.
    Rain = 1,
    /// The receiver's noise: a false alarm.
    Noise = 2,
}

impl RadarClass {
    /// Every class, in the order of their numbers.
    pub const ALL: [Self; 3] = [Self::Surface, Self::Rain, Self::Noise];

    /// The name in reports.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Surface => "surface",
            Self::Rain => "rain",
            Self::Noise => "noise",
        }
    }
}

/// One detection.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RadarDetection {
    /// Position, m, in the sweep's [`PointFrame`].
    pub position: [f32; 3],
    /// Distance from the sensor, m.
    pub range: f32,
    /// Azimuth from x forward towards y left, radians.
    pub azimuth: f32,
    /// Elevation above the plane of x and y, radians: the mean by power of the surfaces in the
    /// cell, 0 of rain and of noise.
    pub elevation: f32,
    /// Radial velocity, m/s, below 0 of what comes nearer; folded into the radar's span.
    pub velocity: f32,
    /// Radial velocity over the ground, m/s: the motion of the sensor is taken out.
    pub ground_velocity: f32,
    /// Radar cross section by the power, dB over 1 m^2; what rain takes on the way is missing in
    /// it.
    pub rcs: f32,
    /// Power over the mean of the cells around it, dB.
    pub snr: f32,
    /// The source of most of its power.
    pub class: RadarClass,
}

/// The detections of a sweep.
#[derive(Clone, Debug, PartialEq)]
pub struct RadarSweep {
    /// The name of the radar.
    pub name: String,
    /// Start and duration, s.
    pub time: [f64; 2],
    /// The pose at the start, in scene units.
    pub pose: SensorPose,
    /// The velocity of the sensor, m/s, world axes.
    pub velocity: DVec3,
    /// Metres a scene unit.
    pub metres_per_unit: f64,
    /// The axes of the detections.
    pub frame: PointFrame,
    /// The greatest range, m.
    pub reach: f64,
    /// The field of view, radians.
    pub azimuth: [f64; 2],
    /// Cells in range, azimuth and velocity.
    pub cells: [usize; 3],
    /// The detections, in the order of azimuths, ranges and velocities of their cells.
    pub detections: Vec<RadarDetection>,
}

impl RadarSweep {
    /// The number of detections of a class.
    #[must_use]
    pub fn count(&self, class: RadarClass) -> usize {
        self.detections.iter().filter(|one| one.class == class).count()
    }
}

/// Time step of the finite difference for the velocity of the sensor, s.
const VELOCITY_WINDOW_S: f64 = 0.01;
/// First random number that places rays; earlier ones are for the noise of cells.
const RAY_NUMBERS_START: u64 = 1 << 40;
/// Most range cells over which the surface of one ray is spread.
const MAX_RANGE_PARTS: usize = 16;
/// Standard deviation of the velocities of rain in a cell by turbulence, m/s (guessed).
const TURBULENCE_M_S: f64 = 1.0;
/// Standard deviation of the response in velocity, cells.
const VELOCITY_BLUR_CELLS: f64 = 0.6;

/// Makes one sweep of a radar, on the threads of the current pool, in a weather that is prepared
/// for its time. It begins as many periods after the start as its number says.
#[must_use]
pub fn radar_sweep(
    model: &RadarModel,
    motion: &dyn SensorMotion,
    scene: &RadarScene<'_>,
    options: &RadarScanOptions,
) -> RadarSweep {
    let time = options.time + f64::from(options.index) * model.period();
    let pose = motion.pose(time);
    let moved = motion.pose(time + VELOCITY_WINDOW_S).origin - pose.origin;
    let velocity = moved * (scene.site.metres_per_unit / VELOCITY_WINDOW_S);
    let random = RandomStream::new(options.seed, 0xc0 | u64::from(options.sensor & 0x3f), options.index);
    let view = FanView { model, scene, pose, velocity };
    let sectors = view.sectors(&random);
    let azimuths = sectors.len();
    let near = |azimuth: usize| {
        let around = azimuth.saturating_sub(SIDE_CELLS)..(azimuth + SIDE_CELLS + 1).min(azimuths);
        sectors[around].iter().flat_map(|sector| sector.scatterers.iter())
    };
    let rows: Vec<Vec<f32>> = (0..azimuths)
        .into_par_iter()
        .map(|azimuth| cells::powers(model, azimuth, near(azimuth), &sectors[azimuth].clutter, &random))
        .collect();
    let cube = PowerCube::new(model, &rows);
    let of_azimuth = |azimuth: usize| -> Vec<RadarDetection> {
        let found = cube.detections(azimuth);
        let detection = |found: &cells::DetectedCell| {
            let (surfaces, elevation) = cells::surfaces_in(model, found.cell, near(azimuth));
            let rain = sectors[azimuth].clutter.at(found.cell[0], found.cell[2]);
            view.detection(found, surfaces, elevation, rain, options.frame)
        };
        found.iter().map(detection).collect()
    };
    let detections: Vec<Vec<RadarDetection>> = (0..azimuths).into_par_iter().map(of_azimuth).collect();
    RadarSweep {
        name: model.name.clone(),
        time: [time, model.period()],
        pose,
        velocity,
        metres_per_unit: scene.site.metres_per_unit,
        frame: options.frame,
        reach: model.range[1],
        azimuth: model.azimuth,
        cells: model.cells(),
        detections: detections.into_iter().flatten().collect(),
    }
}

/// The surfaces and the rain of one cell of azimuth.
pub(super) struct Sector {
    pub(crate) scatterers: Vec<Scatterer>,
    pub(crate) clutter: RainClutter,
}

/// A radar at a place in weather.
pub(super) struct FanView<'a> {
    pub(crate) model: &'a RadarModel,
    pub(crate) scene: &'a RadarScene<'a>,
    pub(crate) pose: SensorPose,
    /// m/s, world axes.
    pub(crate) velocity: DVec3,
}

/// A ray of the fan, in the sensor's axes.
struct FanRay {
    azimuth: f64,
    elevation: f64,
    /// Unit direction, world axes.
    direction: DVec3,
    /// Gain of the beam, there and back.
    gain: f64,
    /// m; infinite where it meets nothing.
    end: f64,
}

impl FanView<'_> {
    /// The sectors of all cells of azimuth.
    pub(super) fn sectors(&self, random: &RandomStream) -> Vec<Sector> {
        let [across, high] = self.model.rays();
        let azimuths = self.model.cells()[1];
        let of_sector = |azimuth: usize| {
            (0..across * high).map(move |ray| self.ray((azimuth * across * high + ray) as u64, random))
        };
        let mut fan: Vec<FanRay> = (0..azimuths).into_par_iter().flat_map_iter(of_sector).collect();
        let origin = self.pose.origin.as_vec3().to_array();
        let directions = fan.iter().map(|ray| ray.direction.as_vec3().normalize().to_array());
        let rays = Rays::from_one(origin, directions.collect());
        let asked = RayOutputs { normal: true, ..RayOutputs::default() };
        let hits = self.scene.splats.trace(&rays, asked, self.scene.path);
        let metres = self.scene.site.metres_per_unit;
        for (ray, distance) in fan.iter_mut().zip(&hits.distance) {
            ray.end = f64::from(*distance) * metres;
        }
        // Attenuation by the rain, dB/m, one way.
        let kept = 1e-3 * rain_attenuation(self.model.frequency, self.scene.weather.rain_rate());
        let make = |(sector, fan): (usize, &[FanRay])| {
            let mut scatterers = Vec::new();
            for (index, ray) in fan.iter().enumerate().filter(|(_, ray)| ray.end.is_finite()) {
                let hit = sector * across * high + index;
                let normal =
                    glam::Vec3::from_array(hits.normal[hit]).as_dvec3() / f64::from(hits.coverage[hit]);
                self.scatter(ray, normal, kept, &mut scatterers);
            }
            Sector { scatterers, clutter: self.clutter(sector, fan, kept) }
        };
        fan.par_chunks(across * high).enumerate().map(make).collect()
    }

    /// Ray `number` of the fan, at a random place of its own part of the grid.
    fn ray(&self, number: u64, random: &RandomStream) -> FanRay {
        let [across, high] = self.model.rays().map(|count| count as u64);
        let place = |k: u64| random.uniform(RAY_NUMBERS_START + 2 * number + k);
        let (column, row) = (number / high, number % high);
        let azimuth =
            self.model.azimuth[0] + self.model.azimuth_cell * (column as f64 + place(0)) / across as f64;
        let share = (row as f64 + place(1)) / high as f64;
        let elevation = self.model.elevation_beam * (2.0 * share - 1.0);
        FanRay {
            azimuth,
            elevation,
            direction: self.pose.to_world(direction(azimuth, elevation)),
            gain: self.model.gain(elevation),
            end: f64::INFINITY,
        }
    }

    /// Adds the scatterers of the surface that a ray meets.
    fn scatter(&self, ray: &FanRay, normal: DVec3, kept: f64, found: &mut Vec<Scatterer>) {
        let model = self.model;
        let [across, high] = model.rays().map(|count| count as f64);
        let widths = [model.azimuth_cell / across, 2.0 * model.elevation_beam / high];
        let solid = widths[0] * widths[1] * ray.elevation.cos();
        let cosine = (-normal.dot(ray.direction)).clamp(0.0, 1.0);
        let upward = normal.normalize_or_zero().dot(DVec3::from_array(self.scene.site.up));
        let rcs = surface_backscatter(cosine, upward) * ray.end * ray.end * solid;
        // What the width of the ray covers of the range.
        let slope = (1.0 - cosine * cosine).sqrt() / cosine.max(0.01);
        let parts = ray.end * widths[0].max(widths[1]) * slope / model.range_cell;
        let parts = parts.min(MAX_RANGE_PARTS as f64);
        let count = (parts.ceil() as usize).max(1);
        let radial = model.folded(-self.velocity.dot(ray.direction));
        for part in 0..count {
            let off = parts * ((part as f64 + 0.5) / count as f64 - 0.5);
            let range = ray.end + off * model.range_cell;
            if !(model.range[0]..=model.range[1]).contains(&range) {
                continue;
            }
            let taken = 10f64.powf(-0.2 * kept * range);
            found.push(Scatterer {
                at: [
                    range / model.range_cell - 0.5,
                    (ray.azimuth - model.azimuth[0]) / model.azimuth_cell - 0.5,
                    radial / model.velocity_step() + 0.5 * model.cells()[2] as f64,
                ],
                elevation: ray.elevation,
                power: model.power(rcs / count as f64, range) * ray.gain * taken,
            });
        }
    }

    /// The rain in a cell of azimuth: `eta (pi/4) r^2 az el dr` in front of what its rays meet, and
    /// under no roof.
    fn clutter(&self, sector: usize, fan: &[FanRay], kept: f64) -> RainClutter {
        let model = self.model;
        let weather = self.scene.weather;
        let density = rain_reflectivity(model.frequency, weather.rain_rate());
        let Some(rain) = weather.rain_velocity().filter(|_| density > 0.0) else {
            return RainClutter::default();
        };
        let metres = self.scene.site.metres_per_unit;
        let [ranges, _, velocities] = model.cells();
        let all: f64 = fan.iter().map(|ray| ray.gain).sum();
        // Gains of the rays by the distance at which they end, the farthest first.
        let mut ends: Vec<[f64; 2]> = fan.iter().map(|ray| [ray.end, ray.gain]).collect();
        ends.sort_by(|a, b| b[0].total_cmp(&a[0]).then(b[1].total_cmp(&a[1])));
        let middle = self.pose.to_world(direction(model.azimuth_of(sector as f64), 0.0));
        let mut powers = vec![0.0; ranges];
        let (mut open, mut next) = (0.0, 0);
        for cell in (0..ranges).rev() {
            let range = model.range_of(cell as f64);
            while let Some([_, gain]) = ends.get(next).filter(|[end, _]| *end > range) {
                open += gain;
                next += 1;
            }
            let at = (self.pose.origin + middle * (range / metres)).as_vec3().to_array();
            let is_wet = self.scene.shelter.is_none_or(|shelter| shelter.is_exposed(at));
            if range < model.range[0] || !is_wet {
                continue;
            }
            let area = FRAC_PI_4 * range * range * model.azimuth_cell * model.elevation_beam;
            let rcs = density * area * model.range_cell;
            powers[cell] = model.power(rcs, range) * (open / all) * 10f64.powf(-0.2 * kept * range);
        }
        // Rain and sensor move; the beam sees it from several sides.
        let relative = DVec3::from_array(rain) - self.velocity;
        let mean = |of: &dyn Fn(f64) -> f64| {
            fan.iter().map(|ray| ray.gain * of(relative.dot(ray.direction))).sum::<f64>() / all
        };
        let radial = mean(&|v| v);
        let spread = mean(&|v| (v - radial) * (v - radial)) + TURBULENCE_M_S * TURBULENCE_M_S;
        let step = model.velocity_step();
        let spread = spread + VELOCITY_BLUR_CELLS * VELOCITY_BLUR_CELLS * step * step;
        let share = |cell: usize| {
            let off = model.folded(model.velocity_of(cell as f64) - radial);
            (-0.5 * off * off / spread).exp()
        };
        let mut shares: Vec<f64> = (0..velocities).map(share).collect();
        let sum: f64 = shares.iter().sum();
        shares.iter_mut().for_each(|share| *share /= sum);
        RainClutter { powers, shares }
    }

    /// The detection of a cell, with the mean power and the elevation of the surfaces in it, and
    /// the mean power of rain.
    fn detection(
        &self,
        found: &cells::DetectedCell,
        surfaces: f64,
        elevation: f64,
        rain: f64,
        frame: PointFrame,
    ) -> RadarDetection {
        let model = self.model;
        let class = if surfaces >= rain.max(1.0) {
            RadarClass::Surface
        } else if rain >= 1.0 {
            RadarClass::Rain
        } else {
            RadarClass::Noise
        };
        let elevation = if class == RadarClass::Surface { elevation } else { 0.0 };
        let [near, far] = model.range;
        let range = model.range_of(found.at[0]).clamp(near, far);
        let azimuth = model.azimuth_of(found.at[1]);
        let velocity = model.folded(model.velocity_of(found.at[2]));
        let way = direction(azimuth, elevation);
        let world = self.pose.to_world(way);
        let position = match frame {
            PointFrame::World => self.pose.origin * self.scene.site.metres_per_unit + world * range,
            PointFrame::Raw | PointFrame::Compensated => way * range,
        };
        let rcs = (found.power - 1.0).max(1e-3) * REFERENCE_RCS_M2 / model.power(REFERENCE_RCS_M2, range);
        RadarDetection {
            position: position.as_vec3().to_array(),
            range: range as f32,
            azimuth: azimuth as f32,
            elevation: elevation as f32,
            velocity: velocity as f32,
            ground_velocity: model.folded(velocity + self.velocity.dot(world)) as f32,
            rcs: (10.0 * rcs.log10()) as f32,
            snr: (10.0 * (found.power / found.mean.max(1e-9)).log10()) as f32,
            class,
        }
    }
}
