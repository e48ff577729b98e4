//! Points of drops in a lidar's sweep through rain.
//!
//! A drop of diameter `D` in a beam as wide as `theta r` sends back
//! `0.023 min(1, (D / (theta r))^2)` of its light. Drops are a Poisson process: by Marshall and
//! Palmer's sizes (1948), as many as bring the rate at Gunn and Kinzer's fall speeds, and the
//! volume of the beam at each range, so many are detected in a pulse on average.
//!
//! Tolerance 4 %, of some 8,000 points and more: one beam's drops are in part the next one's, so
//! that their number scatters by twice the square root. A tenth more rain is 6 % more points.

use super::lidar::{
    AIR_ALONE, DIVERGENCE_RAD, EYE_HEIGHT_M, OVERLAP_RANGES_M, PULSE_HALF_LENGTH_M, RECEIVER_NOISE,
    extinction, model, normal, signal, sweep,
};
use super::lit::level_square;
use super::{Bench, Instrument, Tolerance, expected};
use std::f64::consts::{FRAC_PI_4, FRAC_PI_6};
use wm_place::Result;
use wm_place::lidar::EchoClass;

/// The instrument.
pub(crate) const INSTRUMENT: Instrument = Instrument {
    name: "lidar-drops",
    title: "Drops before a lidar",
    about: "A lidar looks all around into open rain. The points of drops are counted, against a count by Marshall and Palmer's sizes and Gunn and Kinzer's fall speeds, the volume \
            of the beams and the echo of a ball of water.",
    applies: |weather, time| expected::number(weather, time, "rain", "rate").is_some_and(|rate| rate > 0.0),
    measure,
    sweep: &["rain.rate=5", "rain.rate=25", "rain.rate=100"],
};

/// Reflectance of a drop that fills the beam, at 905 nm.
const DROP_REFLECTANCE: f64 = 0.023;
/// Diameters of rain, mm.
const DIAMETERS_MM: [f64; 2] = [0.5, 6.0];
/// Half lengths of a pulse within which drops are looked for.
const BIN_COUNT: i32 = 19;
/// Columns and rows.
const COLUMNS: u32 = 1500;
const ROWS: u32 = 64;

/// Points of drops that a pulse has on average.
fn a_pulse(rate: f64, sigma: f64) -> f64 {
    let slope = expected::rain_slope(rate);
    let steps = 110;
    let size = (DIAMETERS_MM[1] - DIAMETERS_MM[0]) / f64::from(steps);
    let number = |diameter: f64| 8000.0 * (-slope * diameter).exp() * size;
    // As many as bring the rate at their fall speeds: mm^3 a m^2 and second are 3.6e-3 mm/h.
    let diameters = || (0..steps).map(|i| DIAMETERS_MM[0] + size * (f64::from(i) + 0.5));
    let water = |d: f64| 3.6e-3 * number(d) * expected::gunn_kinzer(d) * FRAC_PI_6 * d.powi(3);
    let scale = rate / diameters().map(water).sum::<f64>();
    // Drops detected on average in a metre of the beam.
    let a_metre = |range: f64| -> f64 {
        let beam = DIVERGENCE_RAD * range;
        let of = |diameter: f64| {
            let wide = 1e-3 * diameter;
            let signal = signal(DROP_REFLECTANCE * (wide / beam).powi(2).min(1.0), sigma, range);
            // What is fainter than 4.5 standard deviations below the least power is none.
            let seen = if signal < 0.1 { 0.0 } else { normal((signal - 1.0) / RECEIVER_NOISE) };
            scale * number(diameter) * FRAC_PI_4 * beam.max(wide).powi(2) * seen
        };
        diameters().map(of).sum()
    };
    // Those in half of a pulse's length are one point.
    let parts = 15;
    let bin = |k: i32| {
        let at = |part: i32| {
            OVERLAP_RANGES_M[0]
                + PULSE_HALF_LENGTH_M * (f64::from(k) + (f64::from(part) + 0.5) / f64::from(parts))
        };
        let drops =
            (0..parts).map(|part| PULSE_HALF_LENGTH_M / f64::from(parts) * a_metre(at(part))).sum::<f64>();
        1.0 - (-drops).exp()
    };
    (0..BIN_COUNT).map(bin).sum()
}

fn measure(bench: &mut Bench<'_>) -> Result<()> {
    let weather = bench
        .with(&format!("{AIR_ALONE}, fog=off, haze=off, smog=off, snowfall=off, hail=off, splash=off"))?;
    let lidar = model(OVERLAP_RANGES_M, COLUMNS, [180.0, -180.0], ROWS, [-40.0, 50.0])?;
    // Below the lidar's beams.
    let subject = bench.card([0.0, 0.0, EYE_HEIGHT_M - 1.8], level_square(0.5), 0.25, 0.25)?;
    let seen = sweep(bench, subject, &lidar, &weather)?;
    let rate = bench.number("rain", "rate").unwrap_or(0.0);
    let found = seen.points.iter().filter(|point| point.class == EchoClass::Drop).count() as f64;
    let asked = seen.pulses as f64 * a_pulse(rate, extinction(&weather, bench.time));
    let quantity = format!("drops in {} pulses", seen.pulses);
    let counted = bench.add(quantity, "", [asked, found], Tolerance::Relative(0.04));
    counted.standard_error = Some(found.sqrt());
    Ok(())
}
