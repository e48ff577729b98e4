//! A lidar: its beams, its pulse and its range.

use crate::error::SensorError;
use crate::pattern::{BeamPattern, RisleyPattern, RowPattern, TablePattern};
use crate::presets::PRESETS;
use crate::sensor_text::{SensorKind, SensorText};
use serde::Deserialize;

/// Longest file that is read, bytes: tables of beams are long.
const MAX_FILE_BYTES: u64 = 64 << 20;
/// Speed of light, m/s.
const SPEED_OF_LIGHT_M_S: f64 = 299_792_458.0;
/// Reflectance of the target for which data sheets state the range.
const TARGET_REFLECTANCE: f64 = 0.1;

/// A kind of lidar.
#[derive(Clone, Debug, PartialEq)]
pub struct LidarModel {
    /// The name.
    pub name: String,
    /// Wavelength, nm.
    pub wavelength: f64,
    /// Full angle of the beam at 1/e^2 of its middle, mrad.
    pub divergence: f64,
    /// Length of the pulse, ns.
    pub pulse: f64,
    /// Least and greatest range, m.
    pub range: [f64; 2],
    /// Range of a target of 10 % in clear air that is detected by a half of all pulses, m.
    pub reference_range: f64,
    /// Least standard deviation of ranges, m.
    pub range_noise: f64,
    /// Ranges at which the receiver begins to see the beam and sees all of it, m; the share between
    /// grows with the square of the range.
    pub overlap: [f64; 2],
    /// The beams.
    pub pattern: BeamPattern,
}

/// A model as its file has it.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ModelFile {
    name: Option<String>,
    wavelength: f64,
    divergence: f64,
    pulse: Option<f64>,
    range: [f64; 2],
    reference_range: f64,
    range_noise: Option<f64>,
    overlap: Option<[f64; 2]>,
    rows: Option<RowPattern>,
    table: Option<TablePattern>,
    risley: Option<RisleyPattern>,
}

/// Width of a receiver's lens, mm, whose field is as wide as the beam. Guessed: data sheets say
/// neither.
const LENS_WIDTH_MM: f64 = 35.0;
/// Farthest range at which a receiver is believed to see all of its beam where nothing is said, m.
const MAX_OVERLAP_RANGE_M: f64 = 20.0;

/// Lidars.
const KIND: SensorKind = SensorKind { name: "lidar", presets: PRESETS, most_bytes: MAX_FILE_BYTES };

impl LidarModel {
    /// The model of a preset's name, or of the TOML file of that path.
    ///
    /// ```
    /// use wm_sensors::LidarModel;
    ///
    /// let lidar = LidarModel::find("vlp-16")?;
    /// assert_eq!(lidar.pattern.grid(), Some([16, 1808]));
    /// # Ok::<(), wm_sensors::SensorError>(())
    /// ```
    ///
    /// # Errors
    /// [`SensorError`] if there is neither, or the file makes no lidar.
    pub fn find(name: &str) -> Result<Self, SensorError> {
        Self::of(&KIND.find(name)?)
    }

    /// The model of a preset's name; no file is read.
    ///
    /// # Errors
    /// [`SensorError::Unknown`] if there is no such preset.
    pub fn preset(name: &str) -> Result<Self, SensorError> {
        Self::of(&KIND.preset(name, "")?)
    }

    /// The model of a text in TOML; `name` is its name where the text has none, and stands in
    /// errors.
    ///
    /// # Errors
    /// [`SensorError::Model`] if it makes no lidar.
    pub fn parse(text: &str, name: &str) -> Result<Self, SensorError> {
        Self::of(&SensorText::new(text, name))
    }

    fn of(text: &SensorText<'_>) -> Result<Self, SensorError> {
        let file: ModelFile = text.parse()?;
        let wrong = |problem: String| text.fault(problem);
        let mut patterns = [
            file.rows.map(BeamPattern::Rows),
            file.table.map(BeamPattern::Table),
            file.risley.map(BeamPattern::Risley),
        ]
        .into_iter()
        .flatten();
        let pattern = patterns
            .next()
            .ok_or_else(|| wrong("there are no beams: give [rows], [table] or [risley]".into()))?;
        if patterns.next().is_some() {
            return Err(wrong("it has several patterns: give one of [rows], [table] and [risley]".into()));
        }
        if let Some(problem) = pattern.fault() {
            return Err(wrong(problem));
        }
        let usual = [0.0, (LENS_WIDTH_MM / file.divergence).min(MAX_OVERLAP_RANGE_M)];
        let model = Self {
            name: file.name.unwrap_or_else(|| text.name.clone()),
            wavelength: file.wavelength,
            divergence: file.divergence,
            pulse: file.pulse.unwrap_or(5.0),
            range: file.range,
            reference_range: file.reference_range,
            range_noise: file.range_noise.unwrap_or(0.01),
            overlap: file.overlap.unwrap_or(usual),
            pattern,
        };
        text.check(&[
            ("wavelength", model.wavelength, [500.0, 2000.0], "nm"),
            ("divergence", model.divergence, [0.01, 200.0], "mrad"),
            ("pulse", model.pulse, [0.1, 1000.0], "ns"),
            ("reference_range", model.reference_range, [0.1, 5e3], "m"),
            ("range_noise", model.range_noise, [0.0, 10.0], "m"),
            ("range[0]", model.range[0], [0.0, 1e4], "m"),
            ("range[1]", model.range[1], [0.1, 1e5], "m"),
            ("overlap[0]", model.overlap[0], [0.0, 1e4], "m"),
            ("overlap[1]", model.overlap[1], [0.0, 1e4], "m"),
        ])?;
        if model.range[0] >= model.range[1] || model.overlap[0] > model.overlap[1] {
            return Err(wrong("range and overlap must have their lower number first".into()));
        }
        Ok(model)
    }

    /// Duration of a sweep, s.
    #[must_use]
    pub fn period(&self) -> f64 {
        1.0 / self.pattern.rate()
    }

    /// Distance within which two echoes are one, m: half of the pulse's length.
    #[must_use]
    pub fn bin(&self) -> f64 {
        0.5 * SPEED_OF_LIGHT_M_S * 1e-9 * self.pulse
    }

    /// Power of the weakest echo that is detected without noise, as `reflectance / range^2`, 1/m^2.
    pub(crate) fn least_power(&self) -> f64 {
        TARGET_REFLECTANCE / (self.reference_range * self.reference_range)
    }

    /// Share of the beam that the receiver sees at a range, m: it grows with the square of the
    /// range between the two of [`LidarModel::overlap`].
    ///
    /// A receiver's lens looks far ahead. What is near is out of focus: its spot on the detector is
    /// as wide as the lens is over the range, and of a spot that is wider than the detector the
    /// detector has the share by area. So what fills the beam sends the same power from all ranges
    /// below that of full overlap: the "near-distance effect" of laser scanners.
    pub(crate) fn overlap_at(&self, range: f64) -> f64 {
        let [begin, end] = self.overlap;
        if range >= end {
            return 1.0;
        }
        ((range - begin) / (end - begin).max(1e-9)).clamp(0.0, 1.0).powi(2)
    }

    /// Returns true if water absorbs its light within millimetres.
    pub(crate) fn is_absorbed(&self) -> bool {
        self.wavelength > 1380.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "wavelength = 905\ndivergence = 3\nrange = [0.5, 100]\nreference_range = 50\n[rows]\nrate = 10\n\
                        elevations = [0, 1]\ncolumns = 100\n";

    #[test]
    fn a_file_makes_a_lidar() {
        let model = LidarModel::parse(TEXT, "mine").unwrap();
        assert_eq!((model.name.as_str(), model.pulse, model.overlap), ("mine", 5.0, [0.0, 35.0 / 3.0]));
        assert!((model.bin() - 0.7495).abs() < 1e-3);
    }

    #[test]
    fn a_near_target_sends_as_much_from_all_ranges() {
        let model = LidarModel::parse(&TEXT.replace("[rows]", "overlap = [0, 8]\n[rows]"), "mine").unwrap();
        let power = |range: f64| model.overlap_at(range) / (range * range);
        for range in [0.5, 2.0, 7.9] {
            assert!((power(range) * 64.0 - 1.0).abs() < 1e-12, "{range}");
        }
        assert_eq!((model.overlap_at(8.0), model.overlap_at(100.0), model.overlap_at(0.0)), (1.0, 1.0, 0.0));
    }

    #[test]
    fn faults_are_one_clear_line() {
        for (from, to, says) in [
            ("rate = 10", "rate = 0", "mine: rate is 0: it must be 0.01 to"),
            ("rate = 10", "rate = inf", "mine: rate is inf"),
            ("rate = 10", "rat = 10", "mine, line 6: unknown field `rat`"),
            ("elevations = [0, 1]", "elevations = []", "mine: there are no beams"),
            ("elevations = [0, 1]", "elevations = [0, nan]", "mine: an elevation is NaN"),
            ("[rows]", "[[rows]]", "mine, line 5:"),
            ("divergence = 3", "divergence = -1", "mine: divergence is -1: it must be from 0.01 to 200 mrad"),
            ("wavelength = 905\n", "", "missing field `wavelength`"),
            ("[0.5, 100]", "[100, 5]", "lower number first"),
            (
                "[rows]\nrate = 10\nelevations = [0, 1]\ncolumns = 100",
                "",
                "mine: there are no beams: give [rows]",
            ),
        ] {
            let error = LidarModel::parse(&TEXT.replace(from, to), "mine").unwrap_err().to_string();
            assert!(error.contains(says) && !error.contains('\n'), "{error} for {to}");
        }
        let error = LidarModel::find("vlp16").unwrap_err().to_string();
        assert!(error.contains("did you mean vlp-16?"), "{error}");
        // A preset is never a file.
        let error = LidarModel::preset("no/such.toml").unwrap_err().to_string();
        assert!(error.contains("is no lidar; give vlp-16, ") && !error.contains("file"), "{error}");
        assert!(LidarModel::find("no/such.toml").unwrap_err().to_string().starts_with("no/such.toml: "));
    }

    #[test]
    fn every_preset_is_a_lidar() {
        for (name, _) in PRESETS {
            let model = LidarModel::find(name).unwrap();
            let beams = model.pattern.beams(0);
            let period = model.period();
            assert!(
                beams.len() > 1000 && beams.iter().all(|beam| (0.0..1.01 * period).contains(&beam.time)),
                "{name}"
            );
        }
    }
}
