//! Hours of weather: tables of Open-Meteo (JSON and CSV), of Meteostat (CSV), and any CSV with the
//! same names of columns.
//!
//! A row says what is there at its time, and what fell in the hour before it. So a table of 24 rows
//! is 24 hours that begin an hour before its first row; with `seconds_per_hour` of 1 it is a shot
//! of 24 seconds. What falls is held over its hour, so that the sums of the table are those of the
//! weather; everything else goes evenly from row to row.
//!
//! Columns, by the names of Open-Meteo and of Meteostat, with the units that count where the file
//! has none:
//!
//! | Open-Meteo | Meteostat | unit | becomes |
//! |---|---|---|---|
//! | `time` | `time`, or `date` and `hour` | ISO 8601 or seconds since 1970 | the time |
//! | `rain` + `showers` | `prcp` | mm of the hour before | `rain.rate` |
//! | `snowfall` | | cm of the hour before, 10/7 mm of water each | `snowfall.rate` |
//! | `precipitation` | `prcp` | mm of the hour before | rain or snow, by the code and the temperature |
//! | `snow_depth` | `snow` (mm), `snwd` (cm) | m | `snow_cover.depth` |
//! | `visibility` | | m | `haze.mor` or `fog.mor`, less what falls |
//! | `wind_speed_10m`, `wind_direction_10m`, `wind_gusts_10m` | `wspd`, `wdir`, `wpgt` | km/h, degrees | `wind` |
//! | `cloud_cover` | `cldc` | %, eighths | `light.clouds` |
//! | `temperature_2m`, `relative_humidity_2m`, `dew_point_2m` | `temp`, `rhum`, `dwpt` | degrees Celsius, % | snow, drying |
//! | `weather_code` | `coco` | WMO code, Meteostat's code | lightning, fog, and what `precipitation` is |

mod columns;
mod csv;
mod json;
mod raw;
mod table;
mod time;
pub(crate) mod weather;

use crate::error::ReportError;
pub use table::{WeatherRow, WeatherTable};

impl WeatherTable {
    /// Reads the text of a table of CSV; `file` is its name in messages.
    ///
    /// ```
    /// use wm_reports::{ReportOptions, WeatherTable};
    ///
    /// let text = "time,temp,prcp,wspd,wdir\n2024-01-15 06:00,1,2.4,18,270\n2024-01-15 07:00,-0.5,1.2,21.6,280\n";
    /// let table = WeatherTable::parse_csv(text, "day.csv")?;
    /// assert_eq!((table.rows[0].rain, table.rows[1].snow), (1.2, 1.2)); // half is snow at 1 degree
    /// let report = table.weather("day", &ReportOptions::default())?;
    /// assert!(report.to_toml().contains("lapse = 3600"));
    /// # Ok::<(), wm_reports::ReportError>(())
    /// ```
    ///
    /// # Errors
    /// [`ReportError`] with file, line and column.
    pub fn parse_csv(text: &str, file: &str) -> Result<Self, ReportError> {
        csv::parse(text, file)
    }

    /// Reads the text of a table of JSON as Open-Meteo has it; `file` is its name in messages.
    ///
    /// # Errors
    /// [`ReportError`] with file and key.
    pub fn parse_json(text: &str, file: &str) -> Result<Self, ReportError> {
        json::parse(text, file)
    }

    /// Hours of the whole table: from a step before its first row to its last.
    #[must_use]
    pub fn hours(&self) -> f64 {
        self.step * self.rows.len() as f64
    }

    /// Rain of all hours, mm.
    #[must_use]
    pub fn rain_sum(&self) -> f64 {
        self.rows.iter().map(|row| row.rain).sum()
    }

    /// Snow of all hours, mm of water.
    #[must_use]
    pub fn snow_sum(&self) -> f64 {
        self.rows.iter().map(|row| row.snow).sum()
    }
}

#[cfg(test)]
pub(crate) mod tests;
