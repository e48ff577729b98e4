//! Weather reports as weathers: METAR, hourly tables, WMO codes, CARLA's weather parameters and
//! plain words.
//!
//! A report becomes the text of a weather file, in which a comment beside each value says which
//! part of the report it came from, or that it was guessed. The weather is read from that very
//! text, so a user who edits the file changes what is rendered.
//!
//! # Types to know
//! - [`WeatherReport`]: a report that has been read: the weather file, the weather, what was
//!   guessed and ignored.
//! - [`Metar`]: the decoded groups of an airport's report.
//! - [`WeatherTable`]: hours of weather from JSON or CSV (Open-Meteo, Meteostat, own tables).
//! - [`PresentWeather`]: a row of the WMO's table 4677 of present weather.
//! - [`CarlaParameters`]: the weather parameters of the CARLA simulator, and its presets.
//!
//! # Example
//! ```
//! use wm_reports::{ReportOptions, WeatherReport};
//!
//! let options = ReportOptions::default();
//! let report = WeatherReport::read("METAR KJFK 291851Z 04014KT 1/2SM SN OVC008 M02/M03 A2979", "METAR", &options)?;
//! assert!(report.to_toml().contains("[snowfall]"));
//! assert!(report.weather().has(wm_weather::EffectRole::Falls));
//! for note in report.notes() {
//!     println!("{note}"); // guess: snow_cover.depth: the report does not know what lies: what has fallen
//! }
//!
//! let words = WeatherReport::read("heavy rain, wind 40 km/h from the west, visibility 2 km", "words", &options)?;
//! assert!(words.to_toml().contains("speed = 11.11"));
//! # Ok::<(), wm_reports::ReportError>(())
//! ```
//!
//! To add a kind of report, write one module that ends in a weather file and add it to
//! [`ReportKind`] and [`recognise()`].

mod carla;
mod conditions;
mod draft;
mod error;
mod find;
mod hourly;
pub mod metar;
mod optics;
mod options;
mod present_weather;
mod recognise;
mod report;
mod words;

pub use carla::CarlaParameters;
pub use draft::{ReportNote, ReportNoteKind};
pub use error::ReportError;
pub use find::{FoundWeather, find_weather, looks_like_path};
pub use hourly::{WeatherRow, WeatherTable};
pub use metar::Metar;
pub use options::ReportOptions;
pub use present_weather::{PresentAir, PresentWeather};
pub use recognise::{ReportKind, recognise};
pub use report::{DecodedReport, WeatherReport};
pub use words::WordsReport;
