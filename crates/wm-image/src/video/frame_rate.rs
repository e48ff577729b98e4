//! Frames per second as a fraction, since 29.97 is 30000/1001 and not 29.97.

use std::fmt;
use std::str::FromStr;

use crate::MediaError;

/// Smallest rate of the MP4 clock: coarse clocks make some players round.
#[cfg(any(feature = "h264", test))]
const MIN_TICKS_PER_S: u32 = 10_000;

/// Frames per second: `numerator / denominator`, lowest terms, both above 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrameRate {
    numerator: u32,
    denominator: u32,
}

impl FrameRate {
    /// A fraction; `None` for 0, or outside 1/1000 to 1000 frames per second.
    #[must_use]
    pub fn new(numerator: u32, denominator: u32) -> Option<Self> {
        let (mut a, mut b) = (numerator, denominator);
        while b != 0 {
            (a, b) = (b, a % b);
        }
        if a == 0 {
            return None;
        }
        let rate = Self { numerator: numerator / a, denominator: denominator / a };
        // The numerator becomes the MP4 clock, which some players read into few bits.
        (rate.denominator > 0 && (0.001..=1000.0).contains(&rate.hz()) && rate.numerator < 1 << 24)
            .then_some(rate)
    }

    /// The fraction meant by a decimal number: a whole number, n * 1000/1001 as in television
    /// (23.976, 29.97, 59.94) if it is one above 9 within 0.005, else thousandths. `None` as in
    /// [`FrameRate::new`].
    #[must_use]
    pub fn from_hz(hz: f64) -> Option<Self> {
        if !(0.001..=1000.0).contains(&hz) {
            return None;
        }
        let whole = hz.round();
        let television = (hz * 1.001).round();
        if (hz - whole).abs() < 1e-9 {
            Self::new(whole as u32, 1)
        } else if television >= 10.0 && (hz - television / 1.001).abs() < 5e-3 {
            Self::new(television as u32 * 1000, 1001)
        } else {
            Self::new((hz * 1000.0).round() as u32, 1000)
        }
    }

    /// Frames per second.
    pub(crate) fn hz(self) -> f64 {
        f64::from(self.numerator) / f64::from(self.denominator)
    }

    /// Seconds of `frames` frames.
    #[must_use]
    pub fn seconds(self, frames: u64) -> f64 {
        frames as f64 * f64::from(self.denominator) / f64::from(self.numerator)
    }

    /// The most frames that fit into `seconds`, at least 1.
    #[must_use]
    pub fn frames_within(self, seconds: f64) -> u32 {
        // The margin keeps a product such as 2 * 30000/1001 on its side of a whole number.
        ((seconds * self.hz() + 1e-9).floor() as u32).max(1)
    }

    /// Ticks a second and ticks a frame of a clock that both divide without remainder.
    #[cfg(any(feature = "h264", test))]
    #[must_use]
    pub fn clock(self) -> (u32, u32) {
        let factor = MIN_TICKS_PER_S.div_ceil(self.numerator);
        (self.numerator * factor, self.denominator * factor)
    }
}

impl Default for FrameRate {
    /// 30 frames per second.
    fn default() -> Self {
        Self { numerator: 30, denominator: 1 }
    }
}

impl fmt::Display for FrameRate {
    /// `30` or `30000/1001`, which [`FrameRate::from_str`] reads again.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.denominator {
            1 => write!(f, "{}", self.numerator),
            denominator => write!(f, "{}/{denominator}", self.numerator),
        }
    }
}

impl FromStr for FrameRate {
    type Err = MediaError;

    /// Reads `30`, `29.97` or `30000/1001`.
    fn from_str(text: &str) -> Result<Self, MediaError> {
        let rate = match text.split_once('/') {
            Some((numerator, denominator)) => match (numerator.trim().parse(), denominator.trim().parse()) {
                (Ok(numerator), Ok(denominator)) => Self::new(numerator, denominator),
                _ => None,
            },
            None => text.trim().parse().ok().and_then(Self::from_hz),
        };
        rate.ok_or_else(|| MediaError::FrameRate(text.to_owned()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decimals_become_the_fraction_that_is_meant() {
        let fraction = |text: &str| text.parse::<FrameRate>().map(|rate| rate.to_string()).ok();
        for (text, expected) in [
            ("30", "30"),
            ("24.0", "24"),
            ("23.976", "24000/1001"),
            ("23.98", "24000/1001"),
            ("29.97", "30000/1001"),
            ("59.94", "60000/1001"),
            ("59.9401", "60000/1001"),
            ("12.5", "25/2"),
            ("0.5", "1/2"),
            ("60/2", "30"),
            ("30000/1001", "30000/1001"),
            ("1000", "1000"),
        ] {
            assert_eq!(fraction(text).as_deref(), Some(expected), "{text}");
        }
        for text in ["0", "-1", "nan", "inf", "30 fps", "1/0", "0/1", "0/0", "", "2000", "0.0001"] {
            let error = text.parse::<FrameRate>().unwrap_err().to_string();
            assert!(error.contains(text) && !error.contains('\n'), "{error}");
        }
    }

    #[test]
    fn clocks_are_exact_and_fine() {
        for text in ["30", "29.97", "23.976", "0.001", "1000", "12.345"] {
            let rate: FrameRate = text.parse().unwrap();
            let (second, frame) = rate.clock();
            assert!(second >= MIN_TICKS_PER_S);
            assert_eq!(
                u64::from(second) * u64::from(rate.denominator),
                u64::from(frame) * u64::from(rate.numerator)
            );
        }
        assert_eq!(FrameRate::default().frames_within(2.0), 60);
        assert_eq!("29.97".parse::<FrameRate>().unwrap().frames_within(2.0), 59);
        assert_eq!("0.1".parse::<FrameRate>().unwrap().frames_within(2.0), 1);
    }
}
