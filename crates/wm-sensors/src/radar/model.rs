//! A radar: its cells, its beam and its range.

use super::rain::BAND_GHZ;
use crate::error::SensorError;
use crate::presets::RADAR_PRESETS;
use crate::sensor_text::{SensorKind, SensorText};
use serde::Deserialize;

/// Longest file that is read, bytes.
const MAX_FILE_BYTES: u64 = 1 << 20;
/// Most cells of a sweep: their powers are 256 MiB.
const MAX_CELLS: f64 = (1u64 << 26) as f64;
/// Most rays of a sweep.
const MAX_RAYS: f64 = 4e6;
/// RCS of the target for which the range is stated, m^2: about a car.
pub(crate) const REFERENCE_RCS_M2: f64 = 10.0;
/// Largest distance between rays, radians, and least number of rays across a cell.
const MAX_RAY_STEP_RAD: f64 = 0.2 * std::f64::consts::PI / 180.0;
const MIN_RAYS_PER_CELL: f64 = 4.0;

/// Radars.
const KIND: SensorKind = SensorKind { name: "radar", presets: RADAR_PRESETS, most_bytes: MAX_FILE_BYTES };

/// A kind of radar: an array of antennas whose beams are made by computing, with chirps that give
/// range and velocity at once.
#[derive(Clone, Debug, Deserialize, PartialEq)]
#[serde(deny_unknown_fields)]
pub struct RadarModel {
    /// The name.
    #[serde(default)]
    pub name: String,
    /// GHz.
    pub frequency: f64,
    /// Least and greatest range, m.
    pub range: [f64; 2],
    /// Length of a cell, m.
    pub range_cell: f64,
    /// Field of view: azimuths from x forward towards y left, radians, the lower one first.
    pub azimuth: [f64; 2],
    /// Width of a cell, radians.
    pub azimuth_cell: f64,
    /// Width of the beam in elevation at half of its gain, one way, radians.
    pub elevation_beam: f64,
    /// Greatest speed, m/s: what is faster is folded.
    pub velocity: f64,
    /// Width of a cell, m/s.
    pub velocity_cell: f64,
    /// Range at which a target of 10 m^2 in the middle of a cell and of the beam in clear air has
    /// the power that detection asks for in noise, m.
    pub reference_range: f64,
    /// Share of the cells of nothing but noise that are above the threshold.
    #[serde(default = "usual_false_alarms")]
    pub false_alarms: f64,
    /// Sweeps a second, Hz.
    pub rate: f64,
}

impl RadarModel {
    /// The model of a preset's name, or of the TOML file of that path.
    ///
    /// ```
    /// use wm_sensors::radar::RadarModel;
    ///
    /// let radar = RadarModel::find("mid-range-77")?;
    /// assert_eq!(radar.cells(), [334, 48, 666]);
    /// # Ok::<(), wm_sensors::SensorError>(())
    /// ```
    ///
    /// # Errors
    /// [`SensorError`] if there is neither, or the file makes no radar.
    pub fn find(name: &str) -> Result<Self, SensorError> {
        Self::of(&KIND.find(name)?)
    }

    /// The model of a text in TOML; `name` is its name where the text has none, and stands in
    /// errors.
    ///
    /// # Errors
    /// [`SensorError::Model`] if it makes no radar.
    pub fn parse(text: &str, name: &str) -> Result<Self, SensorError> {
        Self::of(&SensorText::new(text, name))
    }

    fn of(text: &SensorText<'_>) -> Result<Self, SensorError> {
        // Angles are in degrees in a text.
        let mut model: Self = text.parse()?;
        text.check(&[
            ("frequency", model.frequency, BAND_GHZ, "GHz"),
            ("range[0]", model.range[0], [0.0, 1e4], "m"),
            ("range[1]", model.range[1], [0.1, 1e4], "m"),
            ("range_cell", model.range_cell, [0.01, 100.0], "m"),
            ("azimuth[0]", model.azimuth[0], [-180.0, 180.0], "degrees"),
            ("azimuth[1]", model.azimuth[1], [-180.0, 180.0], "degrees"),
            ("azimuth_cell", model.azimuth_cell, [0.05, 90.0], "degrees"),
            ("elevation_beam", model.elevation_beam, [0.1, 60.0], "degrees"),
            ("velocity", model.velocity, [0.1, 1000.0], "m/s"),
            ("velocity_cell", model.velocity_cell, [0.001, 100.0], "m/s"),
            ("reference_range", model.reference_range, [0.1, 1e5], "m"),
            ("false_alarms", model.false_alarms, [1e-12, 0.1], ""),
        ])?;
        model.fault().map_or(Ok(()), |problem| Err(text.fault(problem)))?;
        if model.name.is_empty() {
            model.name.clone_from(&text.name);
        }
        model.azimuth = model.azimuth.map(f64::to_radians);
        model.azimuth_cell = model.azimuth_cell.to_radians();
        model.elevation_beam = model.elevation_beam.to_radians();
        model.excess().map_or(Ok(model), |problem| Err(text.fault(problem)))
    }

    /// Duration of a sweep, s.
    #[must_use]
    pub fn period(&self) -> f64 {
        1.0 / self.rate
    }

    /// Cells in range, azimuth and velocity. Those of range begin at 0; of velocity they are an
    /// even number.
    #[must_use]
    pub fn cells(&self) -> [usize; 3] {
        let [low, high] = self.azimuth;
        // A little less, so that rounding adds no cell.
        let count = |length: f64, cell: f64| ((length / cell - 1e-6).ceil() as usize).max(1);
        let velocities = 2 * ((self.velocity / self.velocity_cell).floor() as usize).max(1);
        [count(self.range[1], self.range_cell), count(high - low, self.azimuth_cell), velocities]
    }

    /// Azimuth of the middle of a cell, radians; `cell` may lie between two.
    pub(crate) fn azimuth_of(&self, cell: f64) -> f64 {
        self.azimuth[0] + (cell + 0.5) * self.azimuth_cell
    }

    /// Range of the middle of a cell, m.
    pub(crate) fn range_of(&self, cell: f64) -> f64 {
        (cell + 0.5) * self.range_cell
    }

    /// Velocity of the middle of a cell, m/s.
    pub(crate) fn velocity_of(&self, cell: f64) -> f64 {
        (cell - 0.5 * self.cells()[2] as f64) * self.velocity_step()
    }

    /// The width of its cells of velocity, m/s: they fill twice the greatest speed.
    pub(crate) fn velocity_step(&self) -> f64 {
        2.0 * self.velocity / self.cells()[2] as f64
    }

    /// A velocity as it is measured, m/s: from minus the greatest to just below it.
    pub(crate) fn folded(&self, velocity: f64) -> f64 {
        (velocity + self.velocity).rem_euclid(2.0 * self.velocity) - self.velocity
    }

    /// Power that detection asks for in noise, of that of the noise: `-ln` of the share of false
    /// alarms.
    pub(crate) fn threshold(&self) -> f64 {
        -self.false_alarms.ln()
    }

    /// Power over that of the noise of a target of an RCS (m^2) at a range (m) in clear air, in the
    /// middle of the beam: by the radar equation it falls with the fourth power.
    pub(crate) fn power(&self, rcs: f64, range: f64) -> f64 {
        self.threshold() * rcs / REFERENCE_RCS_M2 * (self.reference_range / range).powi(4)
    }

    /// Gain of the beam at an elevation (radians), there and back, 0-1: Gaussian.
    pub(crate) fn gain(&self, elevation: f64) -> f64 {
        let off = elevation / self.elevation_beam;
        (-8.0 * std::f64::consts::LN_2 * off * off).exp()
    }

    /// Rays in a cell of azimuth, across and in elevation.
    pub(crate) fn rays(&self) -> [usize; 2] {
        let count = |width: f64, least: f64| (width / MAX_RAY_STEP_RAD).ceil().max(least) as usize;
        // Down to a two-way gain of 1/256, at a whole beam from the middle.
        [
            count(self.azimuth_cell, MIN_RAYS_PER_CELL),
            count(2.0 * self.elevation_beam, 2.0 * MIN_RAYS_PER_CELL),
        ]
    }

    /// The fault of having too much of something.
    fn excess(&self) -> Option<String> {
        let [ranges, azimuths, velocities] = self.cells();
        let cells = ranges as f64 * azimuths as f64 * velocities as f64;
        if cells > MAX_CELLS {
            return Some(format!(
                "{ranges} x {azimuths} x {velocities} cells of range, azimuth and velocity are more than {MAX_CELLS}: make cells larger"
            ));
        }
        let [across, high] = self.rays();
        let rays = azimuths as f64 * across as f64 * high as f64;
        (rays > MAX_RAYS)
            .then(|| format!("its field of view takes {rays} rays, more than {MAX_RAYS}: make it smaller"))
    }

    /// The first fault of its numbers together.
    fn fault(&self) -> Option<String> {
        if !(0.01..=1000.0).contains(&self.rate) {
            return Some(format!("rate is {}: it must be 0.01 to 1000 sweeps a second", self.rate));
        }
        if self.range[0] >= self.range[1] || self.azimuth[0] >= self.azimuth[1] {
            return Some("range and azimuth must have their lower number first".into());
        }
        if self.velocity_cell > self.velocity {
            return Some(format!("velocity_cell is {}: it must be at most velocity", self.velocity_cell));
        }
        None
    }
}

fn usual_false_alarms() -> f64 {
    1e-6
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faults_are_one_clear_line() {
        let (_, text) = RADAR_PRESETS[1];
        for (from, to, says) in [
            ("rate = 14", "rate = 0", "mine: rate is 0: it must be 0.01 to 1000"),
            ("rate = 14", "rate = nan", "mine: rate is NaN"),
            ("rate = 14", "", "missing field `rate`"),
            ("rate = 14", "rat = 14", "unknown field `rat`"),
            ("frequency = 77", "frequency = 5", "mine: frequency is 5: it must be from 24 to 81 GHz"),
            ("azimuth = [-60, 60]", "azimuth = [60, -60]", "lower number first"),
            (
                "azimuth_cell = 2.5",
                "azimuth_cell = 0.1",
                "cells of range, azimuth and velocity are more than",
            ),
            ("velocity_cell = 0.12", "velocity_cell = 50", "at most velocity"),
            ("false_alarms = 1e-6", "false_alarms = 0", "false_alarms is 0: it must be from"),
        ] {
            assert!(text.contains(from), "{from}");
            let error = RadarModel::parse(&text.replace(from, to), "mine").unwrap_err().to_string();
            assert!(error.contains(says) && !error.contains('\n'), "{error} for {to}");
        }
        let error = RadarModel::find("midrange-77").unwrap_err().to_string();
        assert!(error.contains("did you mean mid-range-77?"), "{error}");
        assert!(RadarModel::find("no/such.toml").unwrap_err().to_string().starts_with("no/such.toml: "));
    }

    #[test]
    fn every_preset_is_a_radar() {
        for (name, _) in RADAR_PRESETS {
            let radar = RadarModel::find(name).unwrap();
            assert!((radar.power(10.0, radar.reference_range) / radar.threshold() - 1.0).abs() < 1e-12);
            // Half of the gain of one way at half of the beam's width from the middle.
            assert!((radar.gain(0.5 * radar.elevation_beam) - 0.25).abs() < 1e-12, "{name}");
            assert!((radar.velocity_of(0.5 * radar.cells()[2] as f64)).abs() < 1e-12);
        }
    }
}
