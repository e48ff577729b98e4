//! `demo --photos --capture`: photos as a real capture leaves them, and what is wrong with them.

use clap::{Args, ValueEnum};
use wm_street::capture::{CaptureFlaws, CaptureKind, CaptureSettings, ExifFault, ToneCurve};
use wm_street::dataset::GroundTruth;

/// The way in which a capture is made.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum CaptureChoice {
    /// A drone that looks straight down.
    Nadir,
    /// A drone that looks inwards from a ring, 45 degrees down.
    Oblique,
    /// Somebody who walks with a phone.
    Walk,
    /// A camera in a car, among traffic and people.
    Drive,
}

impl CaptureChoice {
    /// The library's name for it.
    pub(crate) fn kind(self) -> CaptureKind {
        match self {
            Self::Nadir => CaptureKind::Nadir,
            Self::Oblique => CaptureKind::Oblique,
            Self::Walk => CaptureKind::Walk,
            Self::Drive => CaptureKind::Drive,
        }
    }
}

/// A tone curve.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
enum ToneChoice {
    /// That of the demo's other photos.
    #[default]
    Standard,
    /// Crushed shadows, clipped lights, strong colours.
    Hard,
    /// Grey shadows, dull lights, pale colours.
    Flat,
}

/// A lie of EXIF.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum LieChoice {
    /// A focal length 2.7 times too long.
    Focal,
    /// Positions on another continent.
    Continent,
    /// Positions at latitude 0, longitude 0.
    Zero,
    /// Positions that do not exist.
    Nonsense,
    /// A clock that was never set.
    Time,
}

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
        requires = "photos",
        conflicts_with = "route",
        hide_possible_values = true
    )]
    pub(crate) capture: Option<CaptureChoice>,
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
        default_value = "standard",
        requires = "capture",
        hide_possible_values = true
    )]
    tone_curve: ToneChoice,
    /// What EXIF lies about: focal, continent, zero, nonsense, time, or several; photos take turns
    /// with wrong positions
    #[arg(
        long,
        value_name = "LIST",
        value_delimiter = ',',
        num_args = 0..=1,
        require_equals = true,
        default_missing_value = "focal,continent,zero,nonsense,time",
        requires = "capture",
        hide_possible_values = true
    )]
    wrong_exif: Vec<LieChoice>,
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
        let lie = |choice: &LieChoice| match choice {
            LieChoice::Focal => ExifFault::Focal,
            LieChoice::Continent => ExifFault::Continent,
            LieChoice::Zero => ExifFault::Zero,
            LieChoice::Nonsense => ExifFault::Nonsense,
            LieChoice::Time => ExifFault::Time,
        };
        CaptureFlaws {
            blur: self.blur,
            exposure_jitter: self.exposure_jitter,
            tone: match self.tone_curve {
                ToneChoice::Standard => ToneCurve::Standard,
                ToneChoice::Hard => ToneCurve::Hard,
                ToneChoice::Flat => ToneCurve::Flat,
            },
            exif: self.wrong_exif.iter().map(lie).collect(),
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
        let usual = CaptureSettings::new(self.capture?.kind());
        let count = count.unwrap_or(usual.count);
        Some(CaptureSettings { count, size, truth, seed: self.seed, flaws: self.flaws(), ..usual })
    }
}
