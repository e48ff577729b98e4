//! `demo --photos --capture`: photos as a real capture leaves them, and what is wrong with them.

use crate::choices::{Choice, one_of};
use clap::Args;
use wm_street::capture::{CaptureFlaws, CaptureKind, CaptureSettings, ExifFault, ToneCurve};
use wm_street::dataset::GroundTruth;

/// Ways in which a capture is made.
const KINDS: &[Choice<CaptureKind>] = &[
    ("nadir", "", CaptureKind::Nadir),
    ("oblique", "", CaptureKind::Oblique),
    ("walk", "", CaptureKind::Walk),
    ("drive", "", CaptureKind::Drive),
];
/// Tone curves.
const TONES: &[Choice<ToneCurve>] =
    &[("standard", "", ToneCurve::Standard), ("hard", "", ToneCurve::Hard), ("flat", "", ToneCurve::Flat)];
/// Lies of EXIF.
const LIES: &[Choice<ExifFault>] = &[
    ("focal", "", ExifFault::Focal),
    ("continent", "", ExifFault::Continent),
    ("zero", "", ExifFault::Zero),
    ("nonsense", "", ExifFault::Nonsense),
    ("time", "", ExifFault::Time),
];

/// Options of `demo --photos --capture`.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Captures")]
pub(crate) struct CaptureArgs {
    /// Take the photos as a real capture leaves them, with EXIF and a model in arbitrary axes and
    /// units, and write the truth to truth.json: nadir (a drone looking down), oblique (a drone on
    /// a ring), walk (a phone), drive (a car in traffic)
    #[arg(
        long,
        value_name = "KIND",
        value_parser = one_of(KINDS),
        requires = "photos",
        conflicts_with = "route",
        hide_possible_values = true
    )]
    pub(crate) capture: Option<CaptureKind>,
    /// Seed of all noise, and of the model's axes
    #[arg(long, value_name = "N", default_value_t = 1, requires = "capture")]
    seed: u64,
    /// Motion blur of up to this many pixels
    #[arg(long, value_name = "PX", default_value_t = 0.0, requires = "capture")]
    blur: f64,
    /// Exposures that are off by up to this much
    #[arg(long, value_name = "EV", default_value_t = 0.0, requires = "capture")]
    exposure_jitter: f64,
    /// Tone curve: standard, hard or flat
    #[arg(
        long,
        value_name = "NAME",
        value_parser = one_of(TONES),
        default_value = "standard",
        requires = "capture",
        hide_possible_values = true
    )]
    tone_curve: ToneCurve,
    /// What EXIF lies about: focal, continent, zero, nonsense, time, or several; photos take turns
    /// with wrong positions
    #[arg(
        long,
        value_name = "LIST",
        value_parser = one_of(LIES),
        value_delimiter = ',',
        num_args = 0..=1,
        require_equals = true,
        default_missing_value = "focal,continent,zero,nonsense,time",
        requires = "capture",
        hide_possible_values = true
    )]
    wrong_exif: Vec<ExifFault>,
    /// Rain in front of the camera [default rate: 20]
    #[arg(long, value_name = "MM_H", num_args = 0..=1, require_equals = true, default_missing_value = "20", requires = "capture")]
    rain_on_photos: Option<f64>,
    /// Snow in front of the camera, as water [default rate: 2]
    #[arg(long, value_name = "MM_H", num_args = 0..=1, require_equals = true, default_missing_value = "2", requires = "capture")]
    snow_on_photos: Option<f64>,
    /// Haze of this visibility (MOR), exact for every pixel
    #[arg(long, value_name = "M", requires = "capture")]
    haze_on_photos: Option<f64>,
    /// Keep only this many of the photos, evenly spread
    #[arg(long, value_name = "N", requires = "capture", value_parser = clap::value_parser!(u32).range(3..))]
    few: Option<u32>,
}

impl CaptureArgs {
    fn flaws(&self) -> CaptureFlaws {
        CaptureFlaws {
            blur: self.blur,
            exposure_jitter: self.exposure_jitter,
            tone: self.tone_curve,
            exif: self.wrong_exif.clone(),
            rain: self.rain_on_photos,
            snow: self.snow_on_photos,
            haze: self.haze_on_photos,
            few: self.few,
        }
    }

    /// The settings of the capture that is asked for, if any.
    pub(crate) fn settings(
        &self,
        count: Option<u32>,
        size: (u32, u32),
        truth: GroundTruth,
    ) -> Option<CaptureSettings> {
        let usual = CaptureSettings::new(self.capture?);
        let count = count.unwrap_or(usual.count);
        Some(CaptureSettings { count, size, truth, seed: self.seed, flaws: self.flaws(), ..usual })
    }
}
