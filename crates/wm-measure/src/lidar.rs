//! The lidar of the instruments, and what its echoes must be by the lidar equation.
//!
//! A surface of reflectance `rho` that fills the beam at the range `r` sends back
//! `rho exp(-2 sigma r) / r^2`; what is detected in half of the pulses sends back as much as a
//! surface of 10 % at the reference range in clear air.

use super::expected::{self, ExpectedAir};
use super::{Bench, InstrumentScan, ShotSubject};
use wm_place::lidar::{LidarModel, LidarSweep};
use wm_place::{CameraMotion, Error, Result};
use wm_weather::Weather;

/// Height of the lidar over the ground, m.
pub(crate) const EYE_HEIGHT_M: f64 = 1.8;
/// Range at which a surface of 10 % is detected in half of the pulses, m.
pub(crate) const REFERENCE_RANGE_M: f64 = 120.0;
/// Reflectance of that surface.
pub(crate) const REFERENCE_REFLECTANCE: f64 = 0.1;
/// Full divergence of the beam, rad, and half of the length of a pulse of 5 ns, m.
pub(crate) const DIVERGENCE_RAD: f64 = 3e-3;
pub(crate) const PULSE_HALF_LENGTH_M: f64 = 0.5 * 299_792_458.0 * 5e-9;
/// Range noise of strong echoes, m.
pub(crate) const RANGE_NOISE_M: f64 = 0.02;
/// Standard deviation of the receiver's noise, of the least power that is detected.
pub(crate) const RECEIVER_NOISE: f64 = 0.2;
/// Least range, m.
pub(crate) const MIN_RANGE_M: f64 = 0.5;
/// Ranges between which the receiver begins to see the beam, m.
pub(crate) const OVERLAP_RANGES_M: [f64; 2] = [0.9, 1.0];
/// Extinction at 905 nm over that of green light (Mie theory).
const INFRARED_EXTINCTION_RATIOS: [(&str, f64); 3] = [("fog", 1.02), ("haze", 0.523), ("smog", 0.61)];
/// Changes that take away all but the air and what falls.
pub(crate) const AIR_ALONE: &str = "snow_cover=off, dust_cover=off, wetness=off, flood=off, light=off, \
    sky=off, look=off, lightning=off, lens=off";

/// A lidar whose receiver sees its beam between two ranges, m, of so many columns and rows within
/// angles, degrees.
pub(crate) fn model(
    overlap: [f64; 2],
    columns: u32,
    azimuths: [f64; 2],
    rows: u32,
    elevations: [f64; 2],
) -> Result<LidarModel> {
    let ([least, most], [right, left], [low, high]) = (overlap, azimuths, elevations);
    let text = format!(
        "wavelength = 905\ndivergence = {}\npulse = 5\nrange = [{MIN_RANGE_M}, 250]\nreference_range = {REFERENCE_RANGE_M}\n\
         range_noise = {RANGE_NOISE_M}\noverlap = [{least}, {most}]\n[rows]\nrate = 10\nbetween = [{low}, {high}]\ncount = {rows}\n\
         columns = {columns}\nazimuths = [{right}, {left}]\n",
        1e3 * DIVERGENCE_RAD,
    );
    LidarModel::parse(&text, "instrument").map_err(Error::from)
}

/// A lidar of a square of so many pulses a side, within half an angle of the way ahead, degrees.
pub(crate) fn square_model(overlap: [f64; 2], pulses: u32, half: f64) -> Result<LidarModel> {
    model(overlap, pulses, [half, -half], pulses, [-half, half])
}

/// Sweeps a target from [`EYE_HEIGHT_M`] over its middle, ahead along the second axis, with one ray
/// per pulse and all returns.
pub(crate) fn sweep(
    bench: &mut Bench<'_>,
    subject: ShotSubject,
    lidar: &LidarModel,
    weather: &Weather,
) -> Result<LidarSweep> {
    let eye = [0.0, 0.0, EYE_HEIGHT_M];
    let camera = bench.level.camera((8, 8), 60.0, eye, [0.0, 10.0, EYE_HEIGHT_M])?;
    let motion = CameraMotion::from(camera);
    bench.rig.scan(&InstrumentScan { subject, lidar, motion: &motion, weather, time: bench.time })
}

/// Extinction of the air and of what falls at 905 nm, 1/m, at the lidar's height.
pub(crate) fn extinction(weather: &Weather, time: f64) -> f64 {
    let of = |(effect, factor): &(&str, f64)| {
        ExpectedAir::of(weather, time, effect)
            .map_or(0.0, |air| factor * air.sigma_t[1] * air.share(EYE_HEIGHT_M))
    };
    INFRARED_EXTINCTION_RATIOS.iter().map(of).sum::<f64>() + expected::fall_extinction(weather, time)
}

/// The share of a beam that the receiver sees at a range, m.
pub(crate) fn overlap(range: f64) -> f64 {
    ((range - OVERLAP_RANGES_M[0]) / (OVERLAP_RANGES_M[1] - OVERLAP_RANGES_M[0])).clamp(0.0, 1.0).powi(2)
}

/// Signal, of the least power that is detected, of what sends back `echo / range^2` from a range,
/// m.
pub(crate) fn signal(echo: f64, extinction: f64, range: f64) -> f64 {
    echo * overlap(range) * (-2.0 * extinction * range).exp() * (REFERENCE_RANGE_M / range).powi(2)
        / REFERENCE_REFLECTANCE
}

/// The farthest range, m, at which [`signal`] is 1 or more.
pub(crate) fn reach(echo: f64, extinction: f64) -> f64 {
    let (mut near, mut far) = (OVERLAP_RANGES_M[1], 1000.0);
    for _ in 0..60 {
        let middle = 0.5 * (near + far);
        if signal(echo, extinction, middle) >= 1.0 { near = middle } else { far = middle }
    }
    near
}

/// The normal distribution.
pub(crate) fn normal(x: f64) -> f64 {
    let steps = 400;
    let (from, to) = (-6.0, x.clamp(-6.0, 6.0));
    let step = (to - from) / f64::from(steps);
    let density = |v: f64| (-0.5 * v * v).exp() / std::f64::consts::TAU.sqrt();
    (0..steps).map(|i| density(from + step * (f64::from(i) + 0.5))).sum::<f64>() * step
}

/// The place of a share between two points of a falling curve.
pub(crate) fn crossing(points: &[[f64; 2]], share: f64) -> f64 {
    let pair = points.windows(2).rev().find(|pair| pair[0][1] >= share && pair[1][1] < share);
    pair.map_or(f64::NAN, |pair| {
        let [[a, from], [b, to]] = [pair[0], pair[1]];
        a + (b - a) * (from - share) / (from - to)
    })
}
