//! Boards before a lidar: how far away they are, how bright, how much the air dims them, and how
//! far a dark one is seen.
//!
//! A board of 50 % stands at 20 m, and in clear air its mean range and its mean intensity are
//! known. The same kind of board stands where a pulse comes back with `exp(-1.2)` of its power; the
//! ratio of its mean intensities in the weather and in clear air is the extinction. Boards of 10 %
//! stand about the range at which the lidar equation has half of the pulses detected; that range is
//! found between two of them.
//!
//! Tolerances: 15 mm of range (splats lie up to 1 cm off the board's plane), 3 % of intensity, of
//! extinction and of the range of the dark board. Systematic: light that the air sends back from
//! within half a pulse of a board adds to its echo, 1 % at an MOR of 50 m.

use super::expected;
use super::lidar::{
    AIR_ALONE, EYE_HEIGHT_M, OVERLAP_RANGES_M, REFERENCE_REFLECTANCE, crossing, extinction, reach,
    square_model, sweep,
};
use super::plot::Series;
use super::{Bench, Instrument, ShotSubject, Tolerance, mean};
use wm_place::Result;
use wm_place::lidar::{EchoClass, LidarSweep};
use wm_weather::Weather;

/// The instrument.
pub(crate) const INSTRUMENT: Instrument = Instrument {
    name: "lidar-board",
    title: "Boards before a lidar",
    about: "A board at 20 m in clear air: its mean range and intensity. A board in the weather against the same in clear air: the extinction \
            at 905 nm. Boards of 10 % about the range at which half of the pulses should come back: where they do.",
    applies: |weather, time| {
        !expected::airs(weather, time).is_empty() || expected::fall_extinction(weather, time) > 0.0
    },
    measure,
    sweep: &["fog.mor=50", "fog.mor=100", "fog.mor=500", "haze.mor=800", "rain.rate=25", "snowfall.rate=1"],
};

/// Distance of the board in clear air, m.
const CLEAR_DISTANCE_M: f64 = 20.0;
/// Reflectance of bright boards, and the linear grey that has it: `0.05 + 0.8 grey`.
const BRIGHT_REFLECTANCE: f64 = 0.5;
/// Optical depth there and back of the board in the weather, and limits of its distance, m.
const OPTICAL_DEPTH: f64 = 1.2;
const DISTANCES_M: [f64; 2] = [6.0, 100.0];
/// Steps between dark boards, of their range, and boards to each side.
const BOARD_STEP_SHARE: f64 = 0.025;
const BOARDS_PER_SIDE: i32 = 3;
/// Pulses in a row and in a column, within so many degrees.
const PULSES_PER_SIDE: u32 = 40;
const HALF_ANGLE_DEGREES: f64 = 1.5;

/// A board of a reflectance across the way at a distance, m.
fn board(bench: &mut Bench<'_>, metres: f64, reflectance: f64) -> Result<ShotSubject> {
    let half = 0.05 * metres + 0.5;
    let halves = [[half, 0.0, 0.0], [0.0, 0.0, half]];
    let grain = 0.02 * metres.clamp(5.0, 20.0);
    bench.card([0.0, metres, EYE_HEIGHT_M], halves, grain, (reflectance - 0.05) / 0.8)
}

/// The points of a board in a sweep.
fn on_board(sweep: &LidarSweep) -> impl Iterator<Item = &wm_place::lidar::LidarPoint> {
    sweep.points.iter().filter(|point| point.class == EchoClass::Surface)
}

fn measure(bench: &mut Bench<'_>) -> Result<()> {
    let weather = bench.with(AIR_ALONE)?;
    let clear = Weather::clear();
    let lidar = square_model(OVERLAP_RANGES_M, PULSES_PER_SIDE, HALF_ANGLE_DEGREES)?;

    let near = board(bench, CLEAR_DISTANCE_M, BRIGHT_REFLECTANCE)?;
    let seen = sweep(bench, near, &lidar, &clear)?;
    // Across the board: ranges to its sides are longer.
    let range = mean(
        on_board(&seen)
            .map(|point| f64::from(point.range) * f64::from(point.angles[0].cos() * point.angles[1].cos())),
    );
    let intensity = mean(on_board(&seen).map(|point| f64::from(point.intensity)));
    bench.add("range of a board", "m", [CLEAR_DISTANCE_M, range], Tolerance::Absolute(0.015));
    let asked = 255.0 * BRIGHT_REFLECTANCE;
    bench.add("intensity of a board of 50 %", "", [asked, intensity], Tolerance::Relative(0.03));

    let sigma = extinction(&weather, bench.time);
    let metres = (0.5 * OPTICAL_DEPTH / sigma).clamp(DISTANCES_M[0], DISTANCES_M[1]);
    let far = board(bench, metres, BRIGHT_REFLECTANCE)?;
    let [dimmed, bright] = [&weather, &clear].map(|weather| -> Result<f64> {
        let seen = sweep(bench, far, &lidar, weather)?;
        Ok(mean(on_board(&seen).map(|point| f64::from(point.intensity))))
    });
    let depth = (bright? / dimmed?).ln();
    let values = [1e3 * sigma, 1e3 * 0.5 * depth / metres];
    bench.add("extinction at 905 nm", "1/km", values, Tolerance::Relative(0.03));

    let asked = reach(REFERENCE_REFLECTANCE, sigma);
    let mut shares = Vec::new();
    for step in -BOARDS_PER_SIDE..=BOARDS_PER_SIDE {
        let metres = asked * (1.0 + BOARD_STEP_SHARE * f64::from(step));
        let subject = board(bench, metres, REFERENCE_REFLECTANCE)?;
        let seen = sweep(bench, subject, &lidar, &weather)?;
        shares.push([metres, on_board(&seen).count() as f64 / seen.pulses as f64]);
    }
    let measured = crossing(&shares, 0.5);
    bench.add("range of a board of 10 %", "m", [asked, measured], Tolerance::Relative(0.03));
    bench.plot(
        "Boards of 10 %",
        "range, m",
        "share of pulses that come back",
        vec![Series::line("boards", shares)],
    );
    Ok(())
}
