//! Echoes of fog before a lidar: the range up to which it sees the air itself.
//!
//! Droplets send `sigma / S` of the light straight back, with the lidar ratio `S` of 18 sr, so that
//! half a pulse's length of fog is a surface of `pi sigma / S c tau / 2`. The light of many
//! droplets interferes: powers of a bin vary as a Gamma variate of four degrees. Where the mean
//! power is the least that is detected, the share of pulses with an echo in a bin is that of
//! speckle and the receiver's noise together, which is computed here; the bin at which the share
//! falls below it is looked for.
//!
//! A receiver whose lens looks far ahead gets as much from all of the air that is nearer than the
//! range of its full overlap, but for what the air takes. That range is set to the reach, so that
//! powers are near the least that is detected, and the echoes of a pulse are counted.
//!
//! Tolerance 2 %: shares of 4,000 pulses are within 0.8 %, of which the reach has a tenth; some
//! 20,000 echoes are within 0.7 %. A tenth more backscatter is 2.5 to 5 % of the reach, and 3 to
//! 14 % of the echoes.

use super::lidar::{
    AIR_ALONE, EYE_HEIGHT_M, MIN_RANGE_M, OVERLAP_RANGES_M, PULSE_HALF_LENGTH_M, RECEIVER_NOISE, crossing,
    extinction, normal, reach, square_model, sweep,
};
use super::lit::level_square;
use super::plot::Series;
use super::{Bench, Instrument, Tolerance, expected};
use std::f64::consts::PI;
use wm_place::Result;
use wm_place::lidar::{EchoClass, LidarPoint};

/// The instrument.
pub(crate) const INSTRUMENT: Instrument = Instrument {
    name: "lidar-air",
    title: "Echoes of fog before a lidar",
    about: "A lidar looks into open fog. The farthest half pulse in which as many pulses have an echo as speckle and noise let through at the \
            least power that is detected, against the lidar equation with a lidar ratio of 18 sr.",
    applies: |weather, time| {
        let has = |effect: &str| expected::is_on(weather, effect);
        expected::number(weather, time, "fog", "mor").is_some() && !has("haze") && !has("smog")
    },
    measure,
    sweep: &["fog.mor=50", "fog.mor=100", "fog.mor=500"],
};

/// Lidar ratio of droplets, sr.
const LIDAR_RATIO_SR: f64 = 18.0;
/// Bins that are looked at.
const BIN_COUNT: usize = 60;
/// Pulses in a row and in a column, within so many degrees.
const PULSES_PER_SIDE: u32 = 64;
const HALF_ANGLE_DEGREES: f64 = 2.0;

/// The share of pulses with an echo of a mean power, of the least that is detected: speckle of mean
/// 1 and noise are above it together.
fn share_at(power: f64) -> f64 {
    let step = 0.01;
    let gamma = |g: f64| 256.0 / 6.0 * g.powi(3) * (-4.0 * g).exp();
    let at = |i: i32| step * (f64::from(i) + 0.5);
    (0..600).map(|i| step * gamma(at(i)) * normal((power * at(i) - 1.0) / RECEIVER_NOISE)).sum()
}

/// Echoes of a pulse from air whose mean power is the least that is detected at the range of full
/// overlap, m, and beyond which nothing is counted.
fn echoes_within(overlap: f64, extinction: f64) -> f64 {
    let steps = 100;
    let step = (overlap - MIN_RANGE_M) / f64::from(steps);
    let at =
        |i: i32| share_at((2.0 * extinction * (overlap - MIN_RANGE_M - step * (f64::from(i) + 0.5))).exp());
    (0..steps).map(|i| step / PULSE_HALF_LENGTH_M * at(i)).sum()
}

fn measure(bench: &mut Bench<'_>) -> Result<()> {
    let weather = bench.with(&format!("{AIR_ALONE}, rain=off, snowfall=off, hail=off"))?;
    let lidar = square_model(OVERLAP_RANGES_M, PULSES_PER_SIDE, HALF_ANGLE_DEGREES)?;
    // Behind the lidar, since a place has ground somewhere.
    let subject = bench.card([0.0, -30.0, EYE_HEIGHT_M - 1.8], level_square(2.0), 0.25, 0.25)?;
    let seen = sweep(bench, subject, &lidar, &weather)?;
    let mut shares = [0.0; BIN_COUNT];
    for point in seen.points.iter().filter(|point| point.class == EchoClass::Air) {
        // Each pulse has one bin of air in each length of a bin.
        let bin = (f64::from(point.range) / PULSE_HALF_LENGTH_M) as usize;
        shares[bin.min(BIN_COUNT - 1)] += 1.0 / seen.pulses as f64;
    }
    let points: Vec<[f64; 2]> =
        (0..BIN_COUNT).map(|bin| [PULSE_HALF_LENGTH_M * (bin as f64 + 0.5), shares[bin]]).collect();
    let sigma = extinction(&weather, bench.time);
    let asked = reach(PI * sigma / LIDAR_RATIO_SR * PULSE_HALF_LENGTH_M, sigma);
    let values = [asked, crossing(&points, share_at(1.0))];
    let tolerance = Tolerance::Relative(0.02);
    bench.add("reach of echoes of the air", "m", values, tolerance);
    let defocused = square_model([0.0, asked], PULSES_PER_SIDE, HALF_ANGLE_DEGREES)?;
    let seen = sweep(bench, subject, &defocused, &weather)?;
    let is_near = |point: &&LidarPoint| point.class == EchoClass::Air && f64::from(point.range) < asked;
    let near = seen.points.iter().filter(is_near).count() as f64 / seen.pulses as f64;
    let values = [echoes_within(asked, sigma), near];
    bench.add("echoes of a pulse before full overlap", "", values, tolerance);
    bench.plot(
        "Echoes of the air",
        "range, m",
        "share of pulses with an echo",
        vec![Series::line("open air", points)],
    );
    Ok(())
}
