//! EXIF of photos: orientation, position and time.
//!
//! Only times of which the time zone is stated are read: the GPS time, which is UTC, else the
//! camera's clock with its offset. Photos from Mapillary have the time, and the position, in their
//! description. A block of EXIF may hold any bytes: what cannot be read is left out. The crate
//! `exif` (kamadak-exif) reads the block: it checks all offsets and reads each directory once. It
//! is given blocks of at most 64 KB, as its own search in files is without a limit.

use ::exif::{In, Tag, Value};
use serde::Deserialize;
use std::ops::RangeInclusive;
use wm_base::calendar;
use wm_scene::Gps;

/// The tags of EXIF that are looked at.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Tags {
    pub(crate) orientation: Orientation,
    pub(crate) gps: Option<Gps>,
    /// Seconds since 1970, UTC.
    pub(crate) taken: Option<f64>,
}

/// A block of EXIF with the values of its tags.
struct Block(::exif::Exif);

/// Years of photos with EXIF; clocks that were never set count from 1970 or 1980.
const PLAUSIBLE_YEARS: RangeInclusive<i64> = 1990..=2099;

/// Largest offset of a time zone from UTC, hours.
const MAX_OFFSET_H: i64 = 14;

const SECONDS_A_DAY: i64 = 86_400;

/// Longest description that is read, bytes.
const MAX_DESCRIPTION_BYTES: usize = 8192;

/// The JSON object that Mapillary's tools write into the description of a photo. They write numbers
/// as strings.
#[derive(Deserialize)]
struct Mapillary {
    /// UTC, such as `2014_06_07_10_24_05_656`; the last part is milliseconds.
    #[serde(rename = "MAPCaptureTime")]
    time: Option<String>,
    #[serde(rename = "MAPLatitude")]
    latitude: Option<serde_json::Value>,
    #[serde(rename = "MAPLongitude")]
    longitude: Option<serde_json::Value>,
    #[serde(rename = "MAPAltitude")]
    altitude: Option<serde_json::Value>,
}

impl Tags {
    /// Reads an EXIF block; broken blocks give what can be read of them.
    pub(crate) fn parse(block: &[u8]) -> Self {
        let read = ::exif::Reader::new().continue_on_error(true).read_raw(block.to_vec());
        let Ok(exif) = read.or_else(|error| error.distill_partial_result(drop)) else {
            return Self::default();
        };
        let block = Block(exif);
        let orientation = block
            .value(Tag::Orientation)
            .and_then(|value| u16::try_from(value.get_uint(0)?).ok())
            .map_or(Orientation::Upright, Orientation::from_number);
        let mut tags =
            Self { orientation, gps: block.gps(), taken: block.gps_time().or_else(|| block.clock_time()) };
        let description = block.text(Tag::ImageDescription);
        if let Some(mapillary) = description.and_then(Mapillary::parse) {
            tags.gps = tags.gps.or_else(|| mapillary.gps());
            tags.taken = tags.taken.or_else(|| mapillary.unix_time_s());
        }
        tags
    }
}

impl Mapillary {
    /// `None` if the description is any other text.
    fn parse(description: &[u8]) -> Option<Self> {
        if description.len() > MAX_DESCRIPTION_BYTES {
            return None;
        }
        serde_json::from_slice(description).ok()
    }

    fn gps(&self) -> Option<Gps> {
        let number = |value: &Option<serde_json::Value>| match value.as_ref()? {
            serde_json::Value::String(text) => text.trim().parse().ok(),
            value => value.as_f64(),
        };
        let altitude = number(&self.altitude).filter(|metres: &f64| metres.is_finite());
        Gps { latitude: number(&self.latitude)?, longitude: number(&self.longitude)?, altitude }.stated()
    }

    /// Seconds since 1970, UTC.
    fn unix_time_s(&self) -> Option<f64> {
        let (date, time) = self.time.as_ref()?.split_at_checked(10)?;
        let mut parts = time.strip_prefix('_')?.split('_');
        let mut part = || {
            parts.next().filter(|part| part.len() <= 3).and_then(|part| Some(number(part.as_bytes())? as f64))
        };
        let (hour, minute, second) = (part()?, part()?, part()?);
        let seconds = second + part().unwrap_or(0.0) / 1000.0;
        Some(
            (days(date.replace('_', ":").as_bytes())? * SECONDS_A_DAY) as f64
                + of_day(hour, minute, seconds)?,
        )
    }
}

impl Block {
    fn value(&self, tag: Tag) -> Option<&Value> {
        Some(&self.0.get_field(tag, In::PRIMARY)?.value)
    }

    /// The text of a tag up to its first zero.
    fn text(&self, tag: Tag) -> Option<&[u8]> {
        match self.value(tag)? {
            Value::Ascii(texts) => texts.first().map(Vec::as_slice),
            _ => None,
        }
    }

    /// The first `N` rationals of a tag.
    fn rationals<const N: usize>(&self, tag: Tag) -> Option<[f64; N]> {
        match self.value(tag)? {
            Value::Rational(values) => Some(values.first_chunk()?.map(|value| value.to_f64())),
            _ => None,
        }
    }

    /// GPSDateStamp and GPSTimeStamp, seconds since 1970, UTC.
    fn gps_time(&self) -> Option<f64> {
        let day = days(self.text(Tag::GPSDateStamp)?)?;
        let [hour, minute, second] = self.rationals(Tag::GPSTimeStamp)?;
        Some((day * SECONDS_A_DAY) as f64 + of_day(hour, minute, second)?)
    }

    /// DateTimeOriginal and OffsetTimeOriginal, seconds since 1970, UTC.
    fn clock_time(&self) -> Option<f64> {
        let (date, time) = self.text(Tag::DateTimeOriginal)?.split_at_checked(10)?;
        let [b' ', h1, h0, b':', m1, m0, b':', s1, s0] = *time else { return None };
        let [hour, minute, second] = [[h1, h0], [m1, m0], [s1, s0]].map(|two| number(&two));
        let local = of_day(hour? as f64, minute? as f64, second? as f64)?;
        let offset = offset(self.text(Tag::OffsetTimeOriginal)?)?;
        Some((days(date)? * SECONDS_A_DAY - offset) as f64 + local)
    }

    fn gps(&self) -> Option<Gps> {
        let angle = |reference, tag, negative| {
            let [degrees, minutes, seconds] = self.rationals(tag)?;
            // Some writers leave the seconds 0/0 and put everything into the minutes.
            let seconds = if seconds.is_nan() { 0.0 } else { seconds };
            let angle = degrees + minutes / 60.0 + seconds / 3600.0;
            let is_negative = self.text(reference).is_some_and(|text| text.first() == Some(&negative));
            Some(if is_negative { -angle } else { angle })
        };
        let is_below_sea = self.value(Tag::GPSAltitudeRef).and_then(|value| value.get_uint(0)) == Some(1);
        let altitude =
            self.rationals(Tag::GPSAltitude).map(|[metres]| if is_below_sea { -metres } else { metres });
        Gps {
            latitude: angle(Tag::GPSLatitudeRef, Tag::GPSLatitude, b'S')?,
            longitude: angle(Tag::GPSLongitudeRef, Tag::GPSLongitude, b'W')?,
            altitude: altitude.filter(|metres| metres.is_finite()),
        }
        .stated()
    }
}

/// The number that decimal digits write.
fn number(digits: &[u8]) -> Option<i64> {
    digits
        .iter()
        .try_fold(0, |number, digit| digit.is_ascii_digit().then(|| 10 * number + i64::from(digit - b'0')))
}

/// Seconds after midnight; a leap second is the second after it.
fn of_day(hour: f64, minute: f64, second: f64) -> Option<f64> {
    let is_time =
        (0.0..24.0).contains(&hour) && (0.0..60.0).contains(&minute) && (0.0..61.0).contains(&second);
    is_time.then_some(3600.0 * hour + 60.0 * minute + second)
}

/// Days from 1 January 1970 to a date such as `2024:05:30`; some programs write it with `-`.
fn days(date: &[u8]) -> Option<i64> {
    let [y3, y2, y1, y0, b':' | b'-', m1, m0, b':' | b'-', d1, d0] = *date else { return None };
    let (year, month, day) = (number(&[y3, y2, y1, y0])?, number(&[m1, m0])?, number(&[d1, d0])?);
    let days = calendar::days(year, month, day);
    // A day that the month lacks is another date.
    let is_date = calendar::date_and_time(days * SECONDS_A_DAY)[..3] == [year, month, day];
    (PLAUSIBLE_YEARS.contains(&year) && is_date).then_some(days)
}

/// Seconds by which a clock is ahead of UTC, of a text such as `+02:00`.
fn offset(text: &[u8]) -> Option<i64> {
    let [sign @ (b'+' | b'-'), h1, h0, b':', m1, m0] = *text else { return None };
    let (hours, minutes) = (number(&[h1, h0])?, number(&[m1, m0])?);
    let seconds = 3600 * hours + 60 * minutes;
    let is_zone = minutes < 60 && seconds <= 3600 * MAX_OFFSET_H;
    is_zone.then_some(if sign == b'-' { -seconds } else { seconds })
}

/// EXIF's orientation: what must be done to the stored picture so that it stands upright.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Orientation {
    /// 1: nothing.
    #[default]
    Upright,
    /// 2: mirror left and right.
    Mirrored,
    /// 3: half a turn.
    Turned180,
    /// 4: mirror top and bottom.
    Flipped,
    /// 5: swap x and y.
    Transposed,
    /// 6: a quarter turn clockwise.
    Turned90,
    /// 7: swap x and y, then half a turn.
    Transversed,
    /// 8: a quarter turn anticlockwise.
    Turned270,
}

impl Orientation {
    /// The orientation of EXIF's number; numbers that have none are upright.
    #[must_use]
    pub(crate) fn from_number(number: u16) -> Self {
        match number {
            2 => Self::Mirrored,
            3 => Self::Turned180,
            4 => Self::Flipped,
            5 => Self::Transposed,
            6 => Self::Turned90,
            7 => Self::Transversed,
            8 => Self::Turned270,
            _ => Self::Upright,
        }
    }

    /// Returns true if width and height change places.
    #[must_use]
    pub fn swaps_sides(self) -> bool {
        matches!(self, Self::Transposed | Self::Turned90 | Self::Transversed | Self::Turned270)
    }

    /// The position of the upright pixel `(x, y)` in the stored picture of `width` x `height` px.
    #[must_use]
    pub fn stored_from_upright(self, x: u32, y: u32, width: u32, height: u32) -> (u32, u32) {
        let (right, below) = (width.saturating_sub(1), height.saturating_sub(1));
        match self {
            Self::Upright => (x, y),
            Self::Mirrored => (right - x, y),
            Self::Turned180 => (right - x, below - y),
            Self::Flipped => (x, below - y),
            Self::Transposed => (y, x),
            Self::Turned90 => (y, below - x),
            Self::Transversed => (right - y, below - x),
            Self::Turned270 => (right - y, x),
        }
    }
}

#[cfg(test)]
mod tests;
