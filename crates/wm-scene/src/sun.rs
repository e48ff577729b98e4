//! The position of the sun for a place and a time.

use solar_positioning::time::JulianDate;
use solar_positioning::{Location, RefractionCorrection, SolarPositions, delta_t};
use thiserror::Error;

/// Julian date of 1 January 1970, 0:00 UTC.
const UNIX_EPOCH: f64 = 2_440_587.5;
const SECONDS_A_DAY: f64 = 86_400.0;
/// Mean year of the Gregorian calendar, s.
const SECONDS_A_YEAR: f64 = 31_556_952.0;

/// The direction of the sun's centre as an observer at sea level sees it, which is the direction
/// that shadows have.
///
/// Refraction is in, for air of 1013 hPa and 15 degrees Celsius: it lifts the sun by 0.1 degree at
/// an elevation of 8 degrees and by 0.5 at the horizon. Where the sun is wholly below the horizon
/// there is none.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SunPosition {
    /// Azimuth, radians clockwise from north, 0 to 2 pi.
    pub azimuth: f64,
    /// Elevation above the horizon, radians, -pi/2 to pi/2.
    pub elevation: f64,
}

/// A place or a time for which the position of the sun is not defined or not known.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum SunPositionError {
    /// The latitude is not in -90 to 90 degrees.
    #[error("latitude {0} is not between -90 and 90 degrees")]
    Latitude(f64),
    /// The longitude is not in -180 to 180 degrees.
    #[error("longitude {0} is not between -180 and 180 degrees")]
    Longitude(f64),
    /// The time is not in the years -500 to 3000, between which the rotation of the Earth is known
    /// well enough.
    #[error("{0} seconds since 1970 is not in the years -500 to 3000")]
    Time(f64),
}

impl SunPosition {
    /// The sun over a place (WGS 84, degrees, north and east positive) at a time (seconds since 1
    /// January 1970, 0:00 UTC, without leap seconds), by the algorithm of Reda and Andreas (2004).
    /// The error is 0.0003 degrees, but for the difference between UTC and the Earth's rotation (up
    /// to 0.004 degrees) and unusual refraction.
    ///
    /// # Errors
    /// Returns an error for a latitude, a longitude or a time outside its range, or NaN.
    pub fn at(
        latitude_degrees: f64,
        longitude_degrees: f64,
        unix_seconds: f64,
    ) -> Result<Self, SunPositionError> {
        if !(-90.0..=90.0).contains(&latitude_degrees) {
            return Err(SunPositionError::Latitude(latitude_degrees));
        }
        if !(-180.0..=180.0).contains(&longitude_degrees) {
            return Err(SunPositionError::Longitude(longitude_degrees));
        }
        let location = Location { latitude: latitude_degrees, longitude: longitude_degrees };
        let position = delta_t::estimate(1970.0 + unix_seconds / SECONDS_A_YEAR)
            .and_then(|delta_t| JulianDate::new(UNIX_EPOCH + unix_seconds / SECONDS_A_DAY, delta_t))
            .and_then(|time| {
                let refraction = RefractionCorrection::standard();
                SolarPositions::new().at_from_julian(time, location, 0.0, Some(refraction))
            })
            .map_err(|_| SunPositionError::Time(unix_seconds))?;
        Ok(Self {
            azimuth: position.azimuth().to_radians(),
            elevation: position.elevation_angle().to_radians(),
        })
    }

    /// Unit vector towards the sun, along east, north and up.
    #[must_use]
    pub(crate) fn east_north_up(&self) -> [f64; 3] {
        let ((sin, cos), (up, level)) = (self.azimuth.sin_cos(), self.elevation.sin_cos());
        [level * sin, level * cos, up]
    }
}

#[cfg(test)]
mod tests;
