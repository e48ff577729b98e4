//! One sweep of a lidar through a scene in weather.
//!
//! Each pulse is one ray or seven: one in its middle and six on a hexagon of 0.764 of the radius at
//! 1/e^2, so that seven equal weights have the second moment of a Gaussian beam. A ray's hit is the
//! distance where half of its coverage is reached. All that comes back (surfaces, what they mirror,
//! particles, air) is light at a distance; [`crate::echo`] makes points of it.
//!
//! Every random number is a function of (seed, sensor, sweep, pulse, echo), so that any sweep can
//! be made alone, on any number of threads.

use crate::air::{self, AirPath};
use crate::drops::{self, Pulse};
use crate::echo::{self, DetectedEcho, Echo, EchoClass, MIN_ECHO_POWER, ReturnMode, ReturnRank};
use crate::model::LidarModel;
use crate::pose::{SensorMotion, SensorPose, direction};
use crate::scene::LidarScene;
use crate::surface::{self, SurfaceState};
use glam::DVec3;
use rayon::prelude::*;
use std::f64::consts::TAU;
use wm_base::random::RandomStream;
use wm_render::{RayHits, RayOutputs, RayTracer, Rays};
use wm_weather::InfraredAir;

/// Rays of a pulse.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SubRays {
    /// One, in the middle.
    One,
    /// Seven over the divergence of the beam: edges give two echoes, or one in between.
    #[default]
    Seven,
}

impl SubRays {
    /// The number of rays.
    #[must_use]
    pub fn count(self) -> usize {
        match self {
            Self::One => 1,
            Self::Seven => 7,
        }
    }

    /// Finds the sub-rays of a count; `None` if no pattern has it.
    #[must_use]
    pub fn of_count(count: usize) -> Option<Self> {
        [Self::One, Self::Seven].into_iter().find(|rays| rays.count() == count)
    }
}

/// The axes of the points.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PointFrame {
    /// Sensor axes at the start of the sweep: motion is compensated.
    #[default]
    Compensated,
    /// Sensor axes at the time of each pulse, as measured.
    Raw,
    /// Scene axes, in metres.
    World,
}

impl PointFrame {
    /// A point of a sweep in these axes, m, in those of the sensor at its `start`; what is raw
    /// stays as it is.
    #[must_use]
    pub fn in_sensor(self, point: [f32; 3], start: &SensorPose, metres_per_unit: f64) -> DVec3 {
        let point = DVec3::from_array(point.map(f64::from));
        match self {
            Self::World => start.to_sensor(point - start.origin * metres_per_unit),
            Self::Compensated | Self::Raw => point,
        }
    }
}

/// Options of the sweeps of a scan.
#[derive(Clone, Copy, Debug, Default)]
pub struct ScanOptions {
    /// Start of sweep 0, s: of the weather, and along the path.
    pub time: f64,
    /// The number of the sweep, or of the first: random numbers and patterns that do not repeat
    /// depend on it.
    pub index: u32,
    /// The seed of noise. What falls has the seed of its weather.
    pub seed: u64,
    /// The number of the sensor on its rig: its noise depends on it.
    pub sensor: u8,
    /// Rays of a pulse.
    pub sub_rays: SubRays,
    /// The returns that become points.
    pub returns: ReturnMode,
    /// The axes of the points.
    pub frame: PointFrame,
    /// Lidar ratio (extinction over backscatter) of fog, haze and smog, sr; `None` for the usual
    /// ratio of each.
    pub lidar_ratio: Option<f64>,
}

/// One point of a sweep.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LidarPoint {
    /// Position, m, in the sweep's [`PointFrame`].
    pub position: [f32; 3],
    /// Distance from the sensor, m.
    pub range: f32,
    /// Power without the loss by distance and overlap, 0-255: `255 min(1, P r^2 / xi)`.
    pub intensity: f32,
    /// Time after the start of the sweep, s.
    pub time: f32,
    /// Azimuth and elevation in the sensor's axes, radians.
    pub angles: [f32; 2],
    /// Row, the highest first.
    pub ring: u16,
    /// Column, in the order of time.
    pub column: u32,
    /// The place among the returns of its pulse.
    pub rank: ReturnRank,
    /// The source.
    pub class: EchoClass,
    /// The label of the surface, 0 for none.
    pub label: u16,
}

/// The points of a sweep.
#[derive(Clone, Debug, PartialEq)]
pub struct LidarSweep {
    /// The name of the lidar.
    pub name: String,
    /// Start and duration, s.
    pub time: [f64; 2],
    /// The pose at the start, in scene units.
    pub pose: SensorPose,
    /// Metres a scene unit.
    pub metres_per_unit: f64,
    /// The axes of the points.
    pub frame: PointFrame,
    /// The place of the points' origin in the world, m: of points in the axes of a scene with a
    /// local origin; else zero.
    pub origin: DVec3,
    /// Number of pulses.
    pub pulses: usize,
    /// Rows and columns, if it has rows.
    pub grid: Option<[u32; 2]>,
    /// The points, in the order of pulses and ranges.
    pub points: Vec<LidarPoint>,
}

impl LidarSweep {
    /// The number of points of a class.
    #[must_use]
    pub fn count(&self, class: EchoClass) -> usize {
        self.points.iter().filter(|point| point.class == class).count()
    }
}

/// Distance of the six outer rays from the middle in beam radii at 1/e^2: 6/7 of its square is
/// 1/2.
const OUTER_RAY_RADIUS: f64 = 0.763_762_615_825_973_3;
/// Rays that are traced at once.
const MAX_RAYS_AT_ONCE: usize = 1 << 20;
/// Least cosine between up and the normal of a mirror: level ground.
const MIN_LEVEL_COSINE: f64 = 0.9;
/// Least distance of a mirrored surface from its mirror, m.
const MIRROR_CLEARANCE_M: f64 = 0.02;
/// Pulses that a thread turns into points at a time.
const CHUNK_PULSES: usize = 1024;

/// Makes one sweep, on the threads of the current pool, in a weather that is prepared for its time.
/// It begins as many periods after the start as its number says.
#[must_use]
pub fn sweep(
    model: &LidarModel,
    motion: &dyn SensorMotion,
    scene: &LidarScene<'_>,
    options: &ScanOptions,
) -> LidarSweep {
    let beams = model.pattern.beams(u64::from(options.index));
    let period = model.period();
    let time = options.time + f64::from(options.index) * period;
    let air = scene.weather.infrared_air(model.wavelength, options.lidar_ratio);
    let start = motion.pose(time);
    let purpose = 0x40 | u64::from(options.sensor & 0x3f);
    let random = RandomStream::new(options.seed, purpose, options.index);
    let speckle = RandomStream::new(options.seed, purpose ^ 0xc0, options.index);
    let mut points = Vec::new();
    for (block, beams) in beams.chunks(MAX_RAYS_AT_ONCE / options.sub_rays.count()).enumerate() {
        let pulses: Vec<Pulse> = beams
            .par_iter()
            .map(|beam| {
                let pose = motion.pose(time + beam.time);
                let direction = pose.to_world(direction(beam.azimuth, beam.elevation));
                Pulse { beam: *beam, pose, direction }
            })
            .collect();
        let tracer = Tracer { scene, model, air: &air, pulses: &pulses, count: options.sub_rays.count() };
        let (ends, mut echoes) = tracer.surfaces();
        echoes.extend(drops::echoes(&pulses, scene, model, &air, period));
        echoes.sort_by_key(|(pulse, _)| *pulse);
        let first = (block * (MAX_RAYS_AT_ONCE / options.sub_rays.count())) as u64;
        let of_chunk =
            |(chunk, own): (usize, &[Pulse])| {
                let mut made = Vec::new();
                let (mut all, mut merged, mut detected) = (Vec::new(), Vec::new(), Vec::new());
                let begin = chunk * CHUNK_PULSES;
                let mut at = echoes.partition_point(|(pulse, _)| (*pulse as usize) < begin);
                for (index, pulse) in own.iter().enumerate() {
                    let local = begin + index;
                    let number = first + local as u64;
                    let path = AirPath {
                        origin: pulse.pose.origin.to_array(),
                        direction: pulse.direction.to_array(),
                        metres_per_unit: scene.site.metres_per_unit,
                        ends: &ends[local * tracer.count..(local + 1) * tracer.count],
                    };
                    all.clear();
                    while let Some((_, echo)) = echoes.get(at).filter(|(pulse, _)| *pulse as usize == local) {
                        let is_particle = matches!(echo.class, EchoClass::Drop | EchoClass::Flake);
                        // What falls behind a surface is not seen.
                        let share = if is_particle { path.share_beyond(echo.range) } else { 1.0 };
                        if share > 0.0 {
                            all.push(Echo { power: share * echo.power, ..*echo });
                        }
                        at += 1;
                    }
                    air::add_echoes(&path, &air, model, &speckle, number, &mut all);
                    echo::merge(&mut all, model.bin(), &mut merged);
                    echo::detect(&merged, model, &random, number, &mut detected);
                    echo::choose(options.returns, &mut detected);
                    made.extend(detected.iter().map(|one| {
                        point(one, model, pulse, &start, scene.site.metres_per_unit, options.frame)
                    }));
                }
                made
            };
        let made: Vec<Vec<LidarPoint>> = pulses.par_chunks(CHUNK_PULSES).enumerate().map(of_chunk).collect();
        points.extend(made.into_iter().flatten());
    }
    LidarSweep {
        name: model.name.clone(),
        time: [time, period],
        pose: start,
        metres_per_unit: scene.site.metres_per_unit,
        frame: options.frame,
        origin: match options.frame {
            PointFrame::World => DVec3::from_array(scene.site.origin) * scene.site.metres_per_unit,
            PointFrame::Raw | PointFrame::Compensated => DVec3::ZERO,
        },
        pulses: beams.len(),
        grid: model.pattern.grid(),
        points,
    }
}

/// The point of a detected echo.
fn point(
    detected: &DetectedEcho,
    model: &LidarModel,
    pulse: &Pulse,
    start: &SensorPose,
    metres: f64,
    frame: PointFrame,
) -> LidarPoint {
    let range = detected.measured;
    let world = pulse.pose.origin * metres + pulse.direction * range;
    let position = match frame {
        PointFrame::World => world,
        PointFrame::Raw => pulse.pose.to_sensor(pulse.direction) * range,
        PointFrame::Compensated => start.to_sensor(world - start.origin * metres),
    };
    let echo = detected.echo;
    // Devices calibrate what they report, by the range and by how much of the beam they see there.
    let reflected = echo.power * echo.range * echo.range / model.overlap_at(echo.range).max(1e-9);
    LidarPoint {
        position: position.as_vec3().to_array(),
        range: range as f32,
        intensity: (255.0 * reflected.min(1.0)) as f32,
        time: pulse.beam.time as f32,
        angles: [pulse.beam.azimuth as f32, pulse.beam.elevation as f32],
        ring: pulse.beam.ring,
        column: pulse.beam.column,
        rank: detected.rank,
        class: echo.class,
        label: echo.label,
    }
}

/// Traces the rays of pulses.
struct Tracer<'a> {
    scene: &'a LidarScene<'a>,
    model: &'a LidarModel,
    air: &'a InfraredAir,
    pulses: &'a [Pulse],
    /// Rays of a pulse.
    count: usize,
}

/// A ray that a wet surface mirrors.
struct MirroredRay {
    pulse: u32,
    /// Way to the mirror, scene units.
    before: f64,
    /// Share of the pulse that goes on and comes back.
    share: f64,
    /// Transmittance to the mirror, one way.
    kept: f64,
}

/// A surface that a ray meets.
struct SurfaceReturn {
    /// m.
    range: f64,
    /// Cosine between the ray and the normal, averaged over what it meets.
    cosine: f64,
    normal: DVec3,
    dry: f64,
    state: SurfaceState,
}

impl Tracer<'_> {
    /// The ranges at which the rays end, m, and the echoes of surfaces and of what they mirror,
    /// with their pulse.
    fn surfaces(&self) -> (Vec<f64>, Vec<(u32, Echo)>) {
        let rays = self.rays();
        let hits = self.trace(self.scene.splats, &rays);
        let ends: Vec<f64> =
            hits.distance.iter().map(|t| f64::from(*t) * self.scene.site.metres_per_unit).collect();
        let share = 1.0 / self.count as f64;
        let up = DVec3::from_array(self.scene.site.up);
        let of_ray = |ray: usize| {
            let pulse = (ray / self.count) as u32;
            let met = self.surface_return(&rays, &hits, ray)?;
            let (origin, direction) = ray_of(&rays, ray);
            let units = f64::from(hits.distance[ray]);
            let kept = self.air.transmittance(origin.to_array(), direction.to_array(), units);
            let reflectance = surface::wet_reflectance(met.dry, &met.state, met.cosine);
            let received = share * kept * kept * self.model.overlap_at(met.range) / (met.range * met.range);
            let echo = Echo {
                range: met.range,
                power: reflectance * met.cosine * received,
                class: EchoClass::Surface,
                label: met.state.label,
            };
            // What is mirrored is blurred anyway: the middle of the pulse stands for all of it.
            let is_middle = ray.is_multiple_of(self.count);
            let is_mirror = is_middle && met.state.film > 0.0 && met.normal.dot(up) > MIN_LEVEL_COSINE;
            let mirror = is_mirror.then(|| {
                let mirrored = surface::mirrored(-direction.dot(up));
                let share = met.state.film * mirrored * mirrored;
                let bound = share * kept * kept / (met.range * met.range);
                let ray = MirroredRay { pulse, before: units, share, kept };
                // From the mirrored eye: all rays of level ground begin there, which is quick to
                // trace.
                let way = direction - up * (2.0 * direction.dot(up));
                let at = origin + direction * units - way * units;
                (bound > MIN_ECHO_POWER * self.model.least_power()).then_some((ray, at, way))
            });
            Some((pulse, echo, mirror.flatten()))
        };
        let met: Vec<_> = (0..rays.len()).into_par_iter().filter_map(of_ray).collect();
        let mut echoes: Vec<(u32, Echo)> = met.iter().map(|(pulse, echo, _)| (*pulse, *echo)).collect();
        let mut mirrored = Rays::default();
        let mut mirrors = Vec::new();
        for (ray, at, way) in met.into_iter().filter_map(|(_, _, mirror)| mirror) {
            mirrored.origins.push(at.as_vec3().to_array());
            mirrored.directions.push(way.as_vec3().normalize().to_array());
            mirrors.push(ray);
        }
        if let Some(splats) = self.scene.mirrored.filter(|_| !mirrors.is_empty()) {
            let hits = self.trace(splats, &mirrored);
            let ghost = |(ray, mirror)| self.ghost(mirror, &mirrored, &hits, ray);
            echoes.extend(mirrors.iter().enumerate().filter_map(ghost));
        }
        (ends, echoes)
    }

    /// The echo of what a mirror shows: at the length of the whole way, along the first direction.
    fn ghost(&self, mirror: &MirroredRay, rays: &Rays, hits: &RayHits, ray: usize) -> Option<(u32, Echo)> {
        let met = self.surface_return(rays, hits, ray)?;
        let (origin, direction) = ray_of(rays, ray);
        let after = f64::from(hits.distance[ray]) - mirror.before;
        // Below the mirror there is nothing to see.
        if after < MIRROR_CLEARANCE_M / self.scene.site.metres_per_unit {
            return None;
        }
        let from = origin + direction * mirror.before;
        let kept = mirror.kept * self.air.transmittance(from.to_array(), direction.to_array(), after);
        let range = met.range;
        let reflectance = surface::wet_reflectance(met.dry, &met.state, met.cosine);
        let received = mirror.share * kept * kept * self.model.overlap_at(range) / (range * range);
        let power = reflectance * met.cosine * received;
        Some((mirror.pulse, Echo { range, power, class: EchoClass::Ghost, label: met.state.label }))
    }

    /// The rays of all pulses, pulse by pulse.
    fn rays(&self) -> Rays {
        let radius = OUTER_RAY_RADIUS * 0.5e-3 * self.model.divergence;
        let of_pulse = |pulse: &Pulse| {
            let (across, high) = pulse.direction.any_orthonormal_pair();
            let ray = |index: usize| {
                let (sin, cos) = (TAU * index as f64 / 6.0).sin_cos();
                let off = if index == 0 { DVec3::ZERO } else { (across * cos + high * sin) * radius };
                (pulse.direction + off).as_vec3().normalize().to_array()
            };
            (0..self.count).map(ray).collect::<Vec<_>>()
        };
        let directions = self.pulses.par_iter().flat_map_iter(of_pulse).collect();
        let origin = |pulse: &Pulse| std::iter::repeat_n(pulse.pose.origin.as_vec3().to_array(), self.count);
        Rays { origins: self.pulses.iter().flat_map(origin).collect(), directions }
    }

    fn trace(&self, splats: &dyn RayTracer, rays: &Rays) -> RayHits {
        splats.trace(rays, RayOutputs { normal: true, value: true, ..RayOutputs::default() }, self.scene.path)
    }

    /// The surface that a ray meets, if it does.
    fn surface_return(&self, rays: &Rays, hits: &RayHits, ray: usize) -> Option<SurfaceReturn> {
        let distance = f64::from(hits.distance[ray]);
        if !distance.is_finite() {
            return None;
        }
        let coverage = f64::from(hits.coverage[ray]);
        let (_, direction) = ray_of(rays, ray);
        let normal = glam::Vec3::from_array(hits.normal[ray]).as_dvec3() / coverage;
        let mut state = self.scene.surfaces.state(hits.splat[ray]);
        let dry = if state.is_snow {
            state = SurfaceState { is_snow: true, ..SurfaceState::default() };
            surface::SNOW_REFLECTANCE[usize::from(self.model.is_absorbed())]
        } else {
            f64::from(hits.value[ray]) / coverage
        };
        let range = distance * self.scene.site.metres_per_unit;
        // Not of length 1 where splats turn to all sides: then it is the mean of their cosines.
        let cosine = (-normal.dot(direction)).clamp(0.0, 1.0);
        Some(SurfaceReturn { range, cosine, normal: normal.normalize_or(DVec3::ZERO), dry, state })
    }
}

/// The origin and the direction of a ray.
fn ray_of(rays: &Rays, ray: usize) -> (DVec3, DVec3) {
    let vector = |v: [f32; 3]| glam::Vec3::from_array(v).as_dvec3();
    (vector(rays.origins[ray]), vector(rays.directions[ray]))
}
