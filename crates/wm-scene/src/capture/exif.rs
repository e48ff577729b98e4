//! EXIF of photos: orientation, position and time.
//!
//! Only times of which the time zone is stated are read: the GPS time, which is UTC, else the
//! camera's clock with its offset. Photos from Mapillary have the time, and the position, in their
//! description. A block of EXIF may hold any bytes: all offsets are checked, and what cannot be
//! read is left out.

use super::{Gps, header::Orientation};
use serde::Deserialize;
use std::ops::RangeInclusive;

/// The tags of EXIF that are looked at.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Tags {
    pub orientation: Orientation,
    pub gps: Option<Gps>,
    /// Seconds since 1970, UTC.
    pub taken: Option<f64>,
}

/// A TIFF structure in memory; offsets are from its start and are checked.
struct Tiff<'a> {
    bytes: &'a [u8],
    is_little: bool,
}

/// Years of photos with EXIF; clocks that were never set count from 1970 or 1980.
const YEARS: RangeInclusive<i64> = 1990..=2099;

/// Largest offset of a time zone from UTC, hours.
const MOST_OFFSET: i64 = 14;

const SECONDS_A_DAY: i64 = 86_400;

/// Longest description that is read, bytes.
const DESCRIPTION: usize = 8192;

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
    pub fn parse(bytes: &[u8]) -> Self {
        let is_little = match bytes {
            [b'I', b'I', 42, 0, ..] => true,
            [b'M', b'M', 0, 42, ..] => false,
            _ => return Self::default(),
        };
        let tiff = Tiff { bytes, is_little };
        let mut tags = Self::default();
        let Some(first) = tiff.u32(4) else { return tags };
        if let Some(entry) = tiff.entry(first, 0x0112) {
            tags.orientation = tiff.u16(entry + 8).map_or(Orientation::Upright, Orientation::from_number);
        }
        let directory = |tag| tiff.entry(first, tag).and_then(|entry| tiff.u32(entry + 8));
        let (photo, gps) = (directory(0x8769), directory(0x8825));
        tags.gps = gps.and_then(|directory| tiff.gps(directory));
        let by_gps = gps.and_then(|directory| tiff.gps_time(directory));
        tags.taken = by_gps.or_else(|| tiff.clock_time(photo?));
        if let Some(mapillary) = tiff.text::<DESCRIPTION>(first, 0x010E).and_then(Mapillary::parse) {
            tags.gps = tags.gps.or_else(|| mapillary.gps());
            tags.taken = tags.taken.or_else(|| mapillary.taken());
        }
        tags
    }
}

impl Mapillary {
    /// `None` if the description is any other text.
    fn parse(description: &[u8]) -> Option<Self> {
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
    fn taken(&self) -> Option<f64> {
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

impl Tiff<'_> {
    fn at<const N: usize>(&self, offset: usize) -> Option<[u8; N]> {
        self.bytes.get(offset..)?.first_chunk().copied()
    }

    fn u16(&self, offset: usize) -> Option<u16> {
        let bytes = self.at(offset)?;
        Some(if self.is_little { u16::from_le_bytes(bytes) } else { u16::from_be_bytes(bytes) })
    }

    fn u32(&self, offset: usize) -> Option<u32> {
        let bytes = self.at(offset)?;
        Some(if self.is_little { u32::from_le_bytes(bytes) } else { u32::from_be_bytes(bytes) })
    }

    /// The offset of the entry of a tag in a directory.
    fn entry(&self, directory: u32, tag: u16) -> Option<usize> {
        let start = directory as usize;
        let count = usize::from(self.u16(start)?);
        (0..count).map(|index| start + 2 + 12 * index).find(|at| self.u16(*at) == Some(tag))
    }

    /// The `N` rationals of a tag.
    fn rationals<const N: usize>(&self, directory: u32, tag: u16) -> Option<[f64; N]> {
        const RATIONAL: u16 = 5;
        let entry = self.entry(directory, tag)?;
        if self.u16(entry + 2)? != RATIONAL || (self.u32(entry + 4)? as usize) < N {
            return None;
        }
        let place = self.u32(entry + 8)? as usize;
        let mut values = [0.0; N];
        for (index, value) in values.iter_mut().enumerate() {
            let at = place.saturating_add(8 * index);
            let (above, below) = (self.u32(at)?, self.u32(at.saturating_add(4))?);
            *value = f64::from(above) / f64::from(below);
        }
        Some(values)
    }

    /// The text of a tag, at most `N` bytes, up to its first zero.
    fn text<const N: usize>(&self, directory: u32, tag: u16) -> Option<&[u8]> {
        const TEXT: u16 = 2;
        let entry = self.entry(directory, tag)?;
        if self.u16(entry + 2)? != TEXT {
            return None;
        }
        let count = self.u32(entry + 4)? as usize;
        let place = if count <= 4 { entry + 8 } else { self.u32(entry + 8)? as usize };
        let text = self.bytes.get(place..)?;
        let text = &text[..text.len().min(count).min(N)];
        text.split(|byte| *byte == 0).next()
    }

    /// GPSDateStamp and GPSTimeStamp, seconds since 1970, UTC.
    fn gps_time(&self, directory: u32) -> Option<f64> {
        let day = days(self.text::<11>(directory, 0x001D)?)?;
        let [hour, minute, second] = self.rationals::<3>(directory, 7)?;
        Some((day * SECONDS_A_DAY) as f64 + of_day(hour, minute, second)?)
    }

    /// DateTimeOriginal and OffsetTimeOriginal, seconds since 1970, UTC.
    fn clock_time(&self, directory: u32) -> Option<f64> {
        let text = self.text::<20>(directory, 0x9003)?;
        let (date, time) = text.split_at_checked(10)?;
        let [b' ', h1, h0, b':', m1, m0, b':', s1, s0] = *time else { return None };
        let [hour, minute, second] = [[h1, h0], [m1, m0], [s1, s0]].map(|two| number(&two));
        let local = of_day(hour? as f64, minute? as f64, second? as f64)?;
        let offset = offset(self.text::<7>(directory, 0x9011)?)?;
        Some((days(date)? * SECONDS_A_DAY - offset) as f64 + local)
    }

    fn gps(&self, directory: u32) -> Option<Gps> {
        let first_byte = |tag| self.entry(directory, tag).and_then(|entry| self.at::<1>(entry + 8));
        let angle = |reference, tag, negative| {
            let [degrees, minutes, seconds] = self.rationals::<3>(directory, tag)?;
            // Some writers leave the seconds 0/0 and put everything into the minutes.
            let seconds = if seconds.is_nan() { 0.0 } else { seconds };
            let angle = degrees + minutes / 60.0 + seconds / 3600.0;
            Some(if first_byte(reference) == Some([negative]) { -angle } else { angle })
        };
        let altitude = self
            .rationals::<1>(directory, 6)
            .map(|[metres]| if first_byte(5) == Some([1]) { -metres } else { metres });
        Gps {
            latitude: angle(1, 2, b'S')?,
            longitude: angle(3, 4, b'W')?,
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
    let is_leap = year % 4 == 0 && (year % 100 != 0 || year % 400 == 0);
    let length = match month {
        2 => 28 + i64::from(is_leap),
        4 | 6 | 9 | 11 => 30,
        1..=12 => 31,
        _ => return None,
    };
    if !YEARS.contains(&year) || !(1..=length).contains(&day) {
        return None;
    }
    // Years that begin with March end with the leap day (Hinnant's algorithm).
    let (year, month) = if month > 2 { (year, month - 3) } else { (year - 1, month + 9) };
    Some(365 * year + year / 4 - year / 100 + year / 400 + (153 * month + 2) / 5 + day - 1 - 719_468)
}

/// Seconds by which a clock is ahead of UTC, of a text such as `+02:00`.
fn offset(text: &[u8]) -> Option<i64> {
    let [sign @ (b'+' | b'-'), h1, h0, b':', m1, m0] = *text else { return None };
    let (hours, minutes) = (number(&[h1, h0])?, number(&[m1, m0])?);
    let seconds = 3600 * hours + 60 * minutes;
    let is_zone = minutes < 60 && seconds <= 3600 * MOST_OFFSET;
    is_zone.then_some(if sign == b'-' { -seconds } else { seconds })
}

#[cfg(test)]
mod tests;
