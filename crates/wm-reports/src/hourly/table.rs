//! Rows of weather by the hour.

use crate::draft::ReportNote;
use crate::present_weather::PresentWeather;

/// The weather at an hour, and what fell until then since the row before.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct WeatherRow {
    /// Seconds since 1970, UTC.
    pub time: i64,
    /// Rain since the row before, mm.
    pub rain: f64,
    /// Snow since the row before, mm of water.
    pub snow: f64,
    /// Lying snow, m.
    pub snow_depth: Option<f64>,
    /// Visibility, m.
    pub visibility: Option<f64>,
    /// Mean wind, m/s.
    pub wind_speed: Option<f64>,
    /// Direction that it comes from, degrees from north.
    pub wind_from: Option<f64>,
    /// Gusts, m/s.
    pub wind_gust: Option<f64>,
    /// Cloud cover, 0-1.
    pub cloud_cover: Option<f64>,
    /// Temperature, degrees Celsius.
    pub temperature: Option<f64>,
    /// Relative humidity, 0-1.
    pub humidity: Option<f64>,
    /// Present weather, WMO table 4677.
    pub code: Option<u8>,
}

impl WeatherRow {
    /// The row of its code in the WMO's table.
    pub(super) fn present_weather(&self) -> Option<&'static PresentWeather> {
        PresentWeather::of(self.code?.into())
    }
}

/// A table of weather, its rows a step apart.
#[derive(Clone, Debug, PartialEq)]
pub struct WeatherTable {
    /// Latitude and longitude, degrees.
    pub place: Option<[f64; 2]>,
    /// Local time less UTC, seconds.
    pub utc_offset: i64,
    /// Hours between two rows: 1 in hourly tables.
    pub step: f64,
    /// The rows, at least one.
    pub rows: Vec<WeatherRow>,
    pub(super) notes: Vec<ReportNote>,
}
