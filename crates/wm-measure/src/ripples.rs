//! Ripples: how steep the rings of rain are on water, and how fast their waves go.
//!
//! Black water lies under a level board, seen from straight above. The red of the board grows along
//! one level axis, its green along the other, and its blue is even: the light of the first two over
//! that of the third tells which point of the board each pixel of the water shows, and so the
//! direction into which it reflects, whatever its reflectance. The light of the air before the
//! water, which a black board shows, is taken away first. The water's normal lies halfway between
//! that direction and the view's. A picture of still water says how bright the board is where.
//!
//! The slopes must be those at which waves lose by viscosity what drops bring: 1 % of the energy of
//! the drops that fall, an integral over Marshall and Palmer's spectrum at Gunn and Kinzer's
//! speeds, in waves of 200 rad/m. Their frequency, by what is left of waves of that length a
//! quarter of a period later, must be that of the dispersion law of waves with gravity and surface
//! tension.
//!
//! Tolerance 4 % of the slopes and 5 % of the frequency. Rings are few: N a m^2 and second of one
//! height, each of which fades as `exp(-t / 0.3 s)` and brings a share s of the variance, differ on
//! an area A at n instants that are independent by `s sqrt(4 / (N A n))` of the variance (shot
//! noise; the integral of the fourth power of the fading over the square of that of its second is 4
//! a second), half of that of the rms: at 5 mm/h (N 49, s 0.45) 0.7 % of 3.2 m^2 at 24 instants, at
//! 20 mm/h (297, 0.68) 0.4 %. On a quarter of the area at 8 instants it would be 2.5 %. The
//! readings have the standard error that their own instants show. Two laws of fall speeds differ by
//! 1 % in the slopes.

use super::fresnel::{BLACK_WATER, still};
use super::lit::LightPicture;
use super::plot::Series;
use super::{Bench, Instrument, LevelFrame, Tolerance, changed, expected};
use glam::DVec3;
use wm_base::color::srgb_encode;
use wm_place::Result;
use wm_scene::card::Card;
use wm_scene::{Camera, Splats};
use wm_weather::Weather;

/// The instrument.
pub(crate) const INSTRUMENT: Instrument = Instrument {
    name: "ripples",
    title: "Ripples",
    about: "Black water in the rain under a board whose colours change across it, from straight above: each pixel shows the slope of the water. \
            The slopes' rms against 1 % of the drops' energy over the viscous decay of waves of 31 mm, and their frequency against the \
            dispersion law.",
    applies: |weather, time| expected::is_flooded(weather, time) && rate(weather, time) > 0.0,
    measure,
    sweep: &["flood.level=1, rain.rate=5", "flood.level=1, rain.rate=10", "flood.level=1, rain.rate=20"],
};

/// Heights of the eye and of the board over the water, m; half the side of the board.
const EYE_HEIGHT_M: f64 = 2.0;
const BOARD_HEIGHT_M: f64 = 2.0;
const BOARD_HALF_SIDE_M: f64 = 4.8;
/// Strips of a board along each axis, and the light at its ends.
const STRIP_COUNT: usize = 96;
const BOARD_LIGHT: [f64; 2] = [0.1, 0.9];
/// Side of the pictures, px, their field of view, degrees: what slopes of 0.5 show is in the
/// picture; half the side of the water that is looked at, m, and of that whose waves are followed.
const PICTURE_SIDE_PX: u32 = 780;
const FIELD_OF_VIEW_DEGREES: f64 = 90.0;
const PATCH_HALF_SIDE_M: f64 = 0.9;
const FOLLOWED_HALF_SIDE_M: f64 = 0.45;
/// Instants, those of them at which waves are followed, and the time between them, s: longer than
/// rings live.
const INSTANT_COUNT: u32 = 24;
const FOLLOWED_INSTANTS: u32 = 8;
const INSTANT_INTERVAL_S: f64 = 0.73;
/// Wave number of rings, rad/m; gravity, m/s^2; surface tension over density, m^3/s^2; viscosity,
/// m^2/s; the share of the drops' energy that waves get; and the density of water, kg/m^3.
const RING_WAVE_NUMBER: f64 = 200.0;
const GRAVITY: f64 = 9.81;
const SURFACE_TENSION: f64 = 7.28e-5;
const VISCOSITY: f64 = 1e-6;
const WAVE_ENERGY_SHARE: f64 = 0.01;
const WATER_DENSITY: f64 = 1000.0;
/// Largest drops of the integral, mm, and its steps.
const MAX_DROP_MM: f64 = 8.0;
const INTEGRAL_STEPS: usize = 800;

/// Directions of the waves whose frequency is measured, and their wave numbers, of
/// [`RING_WAVE_NUMBER`].
const DIRECTION_COUNT: usize = 36;
const WAVE_NUMBER_FACTORS: [f64; 7] = [0.85, 0.9, 0.95, 1.0, 1.05, 1.1, 1.15];
/// Distance of the pixels by which they are found, px: a third of the wave.
const PIXEL_STEP: usize = 2;

/// Rain, mm/h.
fn rate(weather: &Weather, time: f64) -> f64 {
    expected::number(weather, time, "rain", "rate").unwrap_or(0.0)
}

/// Rms of slopes, both axes together, on deep water.
fn slopes_of(rate: f64) -> f64 {
    let slope = expected::rain_slope(rate);
    let (mut water, mut power) = (0.0, 0.0);
    for step in 0..INTEGRAL_STEPS {
        let diameter = MAX_DROP_MM * (step as f64 + 0.5) / INTEGRAL_STEPS as f64;
        let speed = expected::gunn_kinzer(diameter).max(0.0);
        let mass = (-slope * diameter).exp() * diameter.powi(3) * speed;
        water += mass;
        power += 0.5 * mass * speed * speed;
    }
    // kg/(m^2 s) times J/kg.
    let flux = rate / 3600.0 * power / water;
    (WAVE_ENERGY_SHARE * flux
        / (4.0
            * VISCOSITY
            * WATER_DENSITY
            * (GRAVITY + SURFACE_TENSION * RING_WAVE_NUMBER * RING_WAVE_NUMBER)))
        .sqrt()
}

/// Frequency of the waves of rings, rad/s.
fn frequency() -> f64 {
    (GRAVITY * RING_WAVE_NUMBER + SURFACE_TENSION * RING_WAVE_NUMBER.powi(3)).sqrt()
}

/// The board over the water; a black one if it has no light.
fn board(level: &LevelFrame, water: f64, has_light: bool) -> Splats {
    let mut splats = Splats::default();
    let place = |strip: usize| (2 * strip + 1) as f64 / STRIP_COUNT as f64 - 1.0;
    let shown = |light: f64| if has_light { srgb_encode(light) as f32 } else { 0.0 };
    let color = |place: f64| shown(BOARD_LIGHT[0] + (BOARD_LIGHT[1] - BOARD_LIGHT[0]) * 0.5 * (place + 1.0));
    let [u, v] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
        .map(|axis| level.units(1.0) * level.vector(axis) * (BOARD_HALF_SIDE_M / STRIP_COUNT as f64));
    let even = shown(0.5);
    for (x, y) in (0..STRIP_COUNT * STRIP_COUNT).map(|at| (place(at % STRIP_COUNT), place(at / STRIP_COUNT)))
    {
        let center = level.point([x * BOARD_HALF_SIDE_M, y * BOARD_HALF_SIDE_M, water + BOARD_HEIGHT_M]);
        Card { center, u, v }.paint(&mut splats, (1, 1), [color(x), color(y), even]);
    }
    splats
}

/// The picture of the board in the water at one instant, and that of a black board in the same air.
struct MirroredBoard<'a>(LightPicture, &'a LightPicture);

impl MirroredBoard<'_> {
    /// The light of the board's patterns at a pixel, along both axes.
    fn pattern(&self, x: usize, y: usize) -> [f64; 2] {
        let (seen, air) = (self.0.rgb(x, y), self.1.rgb(x, y));
        let [along, across, even]: [f64; 3] = std::array::from_fn(|k| seen[k] - air[k]);
        [along, across].map(|light| light / even.max(1e-6))
    }
}

/// The pixels of the water that is looked at, each with the direction to it, along the level axes.
struct Patch {
    pixels: Vec<((usize, usize), DVec3)>,
    columns: usize,
}

impl Patch {
    fn of(level: &LevelFrame, camera: &Camera) -> Self {
        let half = (PATCH_HALF_SIDE_M * camera.fx / EYE_HEIGHT_M) as usize;
        let middle = PICTURE_SIDE_PX as usize / 2;
        let place = |k: usize| middle - half + k;
        let pixels = (0..4 * half * half).map(|at| {
            let (x, y) = (place(at % (2 * half)), place(at / (2 * half)));
            let ray = camera.ray(x as f64 + 0.5, y as f64 + 0.5);
            ((x, y), DVec3::from_array(level.axes.map(|axis| axis.dot(ray))))
        });
        Self { pixels: pixels.collect(), columns: 2 * half }
    }
}

/// Waves about [`RING_WAVE_NUMBER`] that slopes are made of.
struct Waves {
    /// Wave vectors, rad/m.
    vectors: Vec<[f64; 2]>,
    /// The points of the water that the pixels show, m, each with a weight that falls to 0 at the
    /// edges.
    places: Vec<[f64; 3]>,
}

impl Waves {
    fn of(patch: &Patch) -> Self {
        let vectors = (0..DIRECTION_COUNT * WAVE_NUMBER_FACTORS.len()).map(|k| {
            let (way, length) =
                (k / WAVE_NUMBER_FACTORS.len(), WAVE_NUMBER_FACTORS[k % WAVE_NUMBER_FACTORS.len()]);
            let (sin, cos) = (std::f64::consts::PI * way as f64 / DIRECTION_COUNT as f64).sin_cos();
            [cos, sin].map(|v| v * length * RING_WAVE_NUMBER)
        });
        let place = |(pixel, way): &((usize, usize), DVec3)| {
            let [x, y] = [way.x, way.y].map(|v| v * EYE_HEIGHT_M / -way.z);
            let weight = |v: f64| match v.abs() < FOLLOWED_HALF_SIDE_M {
                true => (0.5 * std::f64::consts::PI * v / FOLLOWED_HALF_SIDE_M).cos().powi(2),
                false => 0.0,
            };
            let is_taken = pixel.0.is_multiple_of(PIXEL_STEP) && pixel.1.is_multiple_of(PIXEL_STEP);
            [x, y, if is_taken { weight(x) * weight(y) } else { 0.0 }]
        };
        Self { vectors: vectors.collect(), places: patch.pixels.iter().map(place).collect() }
    }

    /// The complex strength of each wave in some slopes.
    fn strengths(&self, slopes: &[[f64; 2]]) -> Vec<[f64; 2]> {
        let strength = |[kx, ky]: &[f64; 2]| {
            let mut sum = [0.0; 2];
            for ([x, y, weight], [a, b]) in self.places.iter().zip(slopes).filter(|(place, _)| place[2] > 0.0)
            {
                let (sin, cos) = (kx * x + ky * y).sin_cos();
                let slope = weight * (kx * a + ky * b);
                sum = [sum[0] + slope * cos, sum[1] - slope * sin];
            }
            sum
        };
        self.vectors.iter().map(strength).collect()
    }
}

/// The point of the board that still water shows along a ray, along a level axis, m.
fn shown_by_still(way: DVec3, axis: usize) -> f64 {
    way[axis] / -way.z * (EYE_HEIGHT_M + BOARD_HEIGHT_M)
}

/// Points of the board by the light of its pattern along an axis, rising.
struct Calibration(Vec<[f64; 2]>);

impl Calibration {
    /// By still water.
    fn of(board: &MirroredBoard<'_>, level: &LevelFrame, camera: &Camera, axis: usize) -> Self {
        let middle = PICTURE_SIDE_PX as usize / 2;
        let mut points: Vec<[f64; 2]> = (0..PICTURE_SIDE_PX as usize)
            .flat_map(|k| [(k, middle), (middle, k)])
            .map(|(x, y)| {
                let ray = camera.ray(x as f64 + 0.5, y as f64 + 0.5);
                let way = DVec3::from_array(level.axes.map(|axis| axis.dot(ray)));
                [board.pattern(x, y)[axis], shown_by_still(way, axis)]
            })
            .filter(|[_, place]| place.abs() < 0.97 * BOARD_HALF_SIDE_M)
            .collect();
        points.sort_by(|a, b| a[1].total_cmp(&b[1]));
        // Of the line across the pattern all points are alike.
        points.dedup_by(|a, b| (a[1] - b[1]).abs() < 1e-4);
        Self(points)
    }

    /// The point of some light.
    fn place(&self, light: f64) -> f64 {
        let above = self.0.partition_point(|point| point[0] < light).clamp(1, self.0.len() - 1);
        let [a, b] = [self.0[above - 1], self.0[above]];
        a[1] + (b[1] - a[1]) * ((light - a[0]) / (b[0] - a[0]).max(1e-9)).clamp(0.0, 1.0)
    }
}

/// The slopes of the water at the pixels of a patch, along both level axes.
fn slopes(board: &MirroredBoard<'_>, patch: &Patch, calibrations: &[Calibration; 2]) -> Vec<[f64; 2]> {
    let slope = |((x, y), way): &((usize, usize), DVec3)| {
        let light = board.pattern(*x, *y);
        let there = [0, 1].map(|k| calibrations[k].place(light[k]));
        let water = *way * (EYE_HEIGHT_M / -way.z);
        let mirrored =
            (DVec3::new(there[0], there[1], BOARD_HEIGHT_M) - DVec3::new(water.x, water.y, 0.0)).normalize();
        let normal = mirrored - *way;
        [-normal.x / normal.z, -normal.y / normal.z]
    };
    patch.pixels.iter().map(slope).collect()
}

fn measure(bench: &mut Bench<'_>) -> Result<()> {
    let level = bench.level;
    let water = bench.number("flood", "level").unwrap_or_default();
    let rate = rate(bench.weather, bench.time);
    let calm = still(bench, BLACK_WATER)?;
    // Drops themselves are not looked at.
    let weather = changed(&calm, &format!("rain.rate={rate}, rain.opacity=0"))?;
    let dark = bench.rig.set_up(board(&level, water, false))?;
    let lit = bench.rig.set_up(board(&level, water, true))?;
    let camera = level.camera(
        (PICTURE_SIDE_PX, PICTURE_SIDE_PX),
        FIELD_OF_VIEW_DEGREES,
        [0.0, 0.0, water + EYE_HEIGHT_M],
        [0.0, 0.0, water],
    )?;
    // Water that reflects 2 % is so dark that the light of the air before it, of drops too small to
    // be seen, is a tenth of it.
    let [calm_air, air] = [&calm, &weather].map(|weather| bench.light(dark, &camera, weather));
    let (calm_air, air) = (calm_air?, air?);
    let without = MirroredBoard(bench.light(lit, &camera, &calm)?, &calm_air);
    let calibrations = [0, 1].map(|axis| Calibration::of(&without, &level, &camera, axis));
    let patch = Patch::of(&level, &camera);
    let quarter = 0.5 * std::f64::consts::PI / frequency();
    // Mean squared slopes of each instant.
    let mut squares = Vec::new();
    // Products of waves with themselves and with those a quarter of a period later.
    let mut products = [0.0; 3];
    let waves = Waves::of(&patch);
    let mut curve = Vec::new();
    for instant in 0..INSTANT_COUNT {
        let time = bench.time + INSTANT_INTERVAL_S * f64::from(instant);
        let first = MirroredBoard(bench.light_at(time, lit, &camera, &weather)?, &air);
        let now = slopes(&first, &patch, &calibrations);
        squares.push(now.iter().map(|[x, y]| x * x + y * y).sum::<f64>() / now.len() as f64);
        if instant < FOLLOWED_INSTANTS {
            let later = MirroredBoard(bench.light_at(time + quarter, lit, &camera, &weather)?, &air);
            let later = slopes(&later, &patch, &calibrations);
            for ([a, b], [c, d]) in waves.strengths(&now).into_iter().zip(waves.strengths(&later)) {
                let all = [a * a + b * b, c * c + d * d, a * c + b * d];
                products.iter_mut().zip(all).for_each(|(sum, value)| *sum += value);
            }
        }
        if instant == 0 {
            let middle = patch.columns * (patch.columns / 2);
            let line = patch.pixels[middle..middle + patch.columns].iter().zip(&now[middle..]);
            curve = line.map(|((_, way), slope)| [1e3 * EYE_HEIGHT_M * way.x / -way.z, slope[0]]).collect();
            bench.show("a board in the rings of rain, from above", &first.0.picture);
        }
    }
    let count = f64::from(INSTANT_COUNT);
    let mean = super::mean(squares.iter().copied());
    let scatter = squares.iter().map(|square| (square - mean).powi(2)).sum::<f64>() / (count - 1.0);
    let rms = mean.sqrt();
    let error = 0.5 / rms * (scatter / count).sqrt();
    let alike = products[2] / (products[0] * products[1]).sqrt();
    let slope = bench.add("slopes of rings, rms", "", [slopes_of(rate), rms], Tolerance::Relative(0.04));
    slope.standard_error = Some(error);
    let hertz = std::f64::consts::TAU.recip();
    let measured = alike.clamp(-1.0, 1.0).acos() / quarter;
    let values = [hertz * frequency(), hertz * measured];
    bench.add("frequency of rings", "Hz", values, Tolerance::Relative(0.05));
    bench.plot("Slopes along a line of the water", "mm", "slope", vec![Series::line("measured", curve)]);
    Ok(())
}
