//! Knowledge that a report lacks and its reader may have.

use crate::error::ReportError;

/// Knowledge that a report lacks and its reader may have.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReportOptions {
    /// Seconds of the shot in an hour of a table, 0.001 to 3600.
    pub seconds_per_hour: f64,
    /// Latitude and longitude, degrees: with them the sun of a METAR and of a table without a place
    /// is that of its time.
    pub place: Option<[f64; 2]>,
    /// Day of the year, 1 to 366, for a METAR, which has only the day of the month.
    pub day: Option<u32>,
}

impl Default for ReportOptions {
    fn default() -> Self {
        Self { seconds_per_hour: 1.0, place: None, day: None }
    }
}

impl ReportOptions {
    pub(crate) fn check(&self) -> Result<(), ReportError> {
        let wrong = |key: &str, problem: String| {
            Err(ReportError::Value { file: "options".into(), key: key.into(), problem })
        };
        if !(0.001..=3600.0).contains(&self.seconds_per_hour) {
            let problem = format!("is {}: must be 0.001 to 3600", self.seconds_per_hour);
            return wrong("seconds_per_hour", problem);
        }
        if let Some([latitude, longitude]) = self.place
            && !((-90.0..=90.0).contains(&latitude) && (-180.0..=360.0).contains(&longitude))
        {
            let problem = format!("is {latitude}, {longitude}: must be latitude, longitude in degrees");
            return wrong("place", problem);
        }
        if let Some(day) = self.day.filter(|day| !(1..=366).contains(day)) {
            return wrong("day", format!("is {day}: must be 1 to 366"));
        }
        Ok(())
    }
}
