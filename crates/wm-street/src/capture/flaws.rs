//! Flaws of the photos of a capture, and how light becomes a picture.

use crate::display_of;
use glam::{DVec2, DVec3};
use rayon::prelude::*;
use std::f64::consts::TAU;
use wm_base::random::RandomStream;

/// Flaws of the photos of a capture; none by default. They combine.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CaptureFlaws {
    /// Most motion blur of a photo, px; each draws its own.
    pub blur: f64,
    /// Largest error of the exposure of a photo, EV; each draws its own.
    pub exposure_jitter: f64,
    /// Tone curve from light to the values of the file.
    pub tone: ToneCurve,
    /// Lies of EXIF.
    pub exif: Vec<ExifFault>,
    /// Rain in front of the camera, mm/h.
    pub rain: Option<f64>,
    /// Snow in front of the camera, mm/h of water.
    pub snow: Option<f64>,
    /// Haze: its meteorological optical range, m.
    pub haze: Option<f64>,
    /// Keeps this many of the photos, evenly spread.
    pub few: Option<u32>,
}

/// A tone curve, as cameras and editors apply it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ToneCurve {
    /// [`display_of`]: a straight line with a soft shoulder.
    #[default]
    Standard,
    /// A steep curve that crushes shadows, clips lights and saturates colours.
    Hard,
    /// A flat profile: grey shadows, dull lights, pale colours.
    Flat,
}

impl ToneCurve {
    /// The name in files and options.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Standard => "standard",
            Self::Hard => "hard",
            Self::Flat => "flat",
        }
    }

    fn of(self, light: DVec3) -> DVec3 {
        let shown = DVec3::from_array(display_of(light.to_array()));
        let around = |mean: f64, share: f64| DVec3::splat(mean).lerp(shown, share);
        let grey = shown.dot(DVec3::new(0.2126, 0.7152, 0.0722));
        match self {
            Self::Standard => shown,
            Self::Hard => around(grey, 1.35).map(|v| {
                let steep = ((v - 0.10) / 0.76).clamp(0.0, 1.0);
                0.35 * steep + 0.65 * steep * steep * (3.0 - 2.0 * steep)
            }),
            Self::Flat => around(grey, 0.65) * 0.62 + 0.17,
        }
    }
}

/// A lie of EXIF.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum ExifFault {
    /// A focal length that is 2.7 times too long.
    Focal,
    /// Positions on another continent.
    Continent,
    /// The latitude 0 and the longitude 0, as receivers without reception write.
    Zero,
    /// Positions that are none: latitudes above 90 degrees, altitudes of the moon.
    Nonsense,
    /// A clock that was never set.
    Time,
}

/// Purposes of random numbers.
const EXPOSURE_LANE: u64 = 45;
const MOTION_LANE: u64 = 46;

impl CaptureFlaws {
    /// Checks the numbers.
    ///
    /// # Errors
    /// A line that names the flaw, its value and what it may be.
    pub fn check(&self) -> Result<(), String> {
        let numbers = [
            ("blur", Some(self.blur), 0.0..=50.0, "px"),
            ("exposure jitter", Some(self.exposure_jitter), 0.0..=6.0, "EV"),
            ("rain", self.rain, 0.1..=200.0, "mm/h"),
            ("snow", self.snow, 0.1..=20.0, "mm/h"),
            ("haze", self.haze, 10.0..=100_000.0, "m"),
        ];
        for (name, value, range, unit) in numbers {
            if let Some(value) = value.filter(|value| !range.contains(value)) {
                return Err(format!("{name} {value} {unit}: must be {} to {}", range.start(), range.end()));
            }
        }
        if self.few.is_some_and(|few| few < 3) {
            return Err(format!("few {}: must be 3 and above", self.few.unwrap_or_default()));
        }
        Ok(())
    }

    /// Exposure of photo `index`, EV.
    pub(super) fn exposure(&self, seed: u64, index: usize) -> f64 {
        let random = RandomStream::new(seed, EXPOSURE_LANE, 0);
        self.exposure_jitter * (2.0 * random.uniform(index as u64) - 1.0)
    }

    /// Motion of photo `index` while it is exposed, px.
    pub(super) fn motion(&self, seed: u64, index: usize) -> DVec2 {
        let random = RandomStream::new(seed, MOTION_LANE, index as u32);
        let length = self.blur * (0.25 + 0.75 * random.uniform(0));
        DVec2::from_angle(TAU * random.uniform(1)) * length
    }
}

/// A picture that moved by `motion` px while it was exposed: the mean along that line.
pub(super) fn moved(light: &[DVec3], width: usize, height: usize, motion: DVec2) -> Vec<DVec3> {
    let length = motion.length();
    if length < 0.05 {
        return light.to_vec();
    }
    let steps = (2.0 * length).ceil() as i32 + 1;
    let at = |x: f64, y: f64| {
        let (x, y) = (x.clamp(0.0, (width - 1) as f64), y.clamp(0.0, (height - 1) as f64));
        let (left, top) = (x as usize, y as usize);
        let (right, below) = ((left + 1).min(width - 1), (top + 1).min(height - 1));
        let (fx, fy) = (x - left as f64, y - top as f64);
        let row = |row: usize| light[row * width + left].lerp(light[row * width + right], fx);
        row(top).lerp(row(below), fy)
    };
    let pixel = |index: usize| {
        let (x, y) = ((index % width) as f64, (index / width) as f64);
        let mut sum = DVec3::ZERO;
        for step in 0..steps {
            let off = motion * (f64::from(step) / f64::from(steps - 1) - 0.5);
            sum += at(x + off.x, y + off.y);
        }
        sum / f64::from(steps)
    };
    (0..light.len()).into_par_iter().map(pixel).collect()
}

/// The bytes of a picture, sRGB, `[H, W, 3]`.
pub(super) fn developed(light: &[DVec3], exposure: f64, tone: ToneCurve) -> Vec<u8> {
    let gain = exposure.exp2();
    let pixel = |light: &DVec3| {
        tone.of(*light * gain).to_array().map(|v| (255.0 * v).round().clamp(0.0, 255.0) as u8)
    };
    light.iter().flat_map(pixel).collect()
}
