//! METAR and SPECI: reports of airports, WMO FM 15 and FM 16, with the forms of the United States.
//!
//! [`Metar::parse`] decodes one report group by group. Damage to the wind, the visibility, the
//! weather, the clouds or the temperature is an error that says what was expected. What no weather
//! has, such as trends, runway states and words after the report, is kept as it is, damaged or not
//! ([`Metar::ignored`]); remarks too ([`Metar::remarks`]). What was not measured is told by
//! [`Metar::missing`].
//!
//! `weather.rs` has the weather of each group.

mod decoded;
mod forms;
mod groups;
mod weather;

use crate::draft::WrittenWeather;
use crate::error::ReportError;
use crate::options::ReportOptions;
pub use decoded::*;
pub(crate) use groups::begins;

impl Metar {
    /// Decodes a report. `METAR` or `SPECI` may be left out, and `=` at its end.
    ///
    /// ```
    /// use wm_reports::Metar;
    ///
    /// let metar = Metar::parse("METAR KJFK 291851Z 04014G22KT 1/2SM SN FZFG VV008 M02/M03 A2979")?;
    /// assert_eq!(metar.wind.unwrap().from, Some(40.0));
    /// assert_eq!(metar.visibility.unwrap().metres.round(), 805.0);
    /// let error = Metar::parse("METAR KJFK 291851Z 0401GKT").unwrap_err().to_string();
    /// assert!(error.starts_with("METAR, character 20: `0401GKT` is damaged: a wind, as in"), "{error}");
    /// # Ok::<(), wm_reports::ReportError>(())
    /// ```
    ///
    /// # Errors
    /// [`ReportError::Text`] with the group, its place and what was expected.
    pub fn parse(text: &str) -> Result<Self, ReportError> {
        groups::parse(text)
    }
}

/// Reads a report as a weather.
pub(crate) fn read(text: &str, options: &ReportOptions) -> Result<(Metar, WrittenWeather), ReportError> {
    // Typed by hand it is often in small letters.
    let text = text.to_ascii_uppercase();
    let metar = Metar::parse(&text)?;
    let written = weather::weather(&text, &metar, options)?;
    Ok((metar, written))
}

#[cfg(test)]
mod tests;
