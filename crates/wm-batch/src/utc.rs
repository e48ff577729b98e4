//! Dates and times of day in files.

use std::fmt;

const NANOSECONDS_A_DAY: i64 = 86_400_000_000_000;

/// An instant as a date of the Gregorian calendar and a time of day, UTC without leap seconds;
/// displayed as `2011-09-26 13:02:25.964389445`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct UtcTime {
    year: i64,
    month: i64,
    day: i64,
    nanosecond_of_day: i64,
}

impl UtcTime {
    /// Converts nanoseconds since 1970.
    pub(crate) fn new(nanoseconds: i64) -> Self {
        // Years begin in March here, so that the day of leap years is their last; 719,468 days
        // before 1970 is the first of March of year 0, and 400 years have 146,097 days.
        let days = nanoseconds.div_euclid(NANOSECONDS_A_DAY) + 719_468;
        let (era, day_of_era) = (days.div_euclid(146_097), days.rem_euclid(146_097));
        let year_of_era =
            (day_of_era - day_of_era / 1_460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
        let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
        let month_from_march = (5 * day_of_year + 2) / 153;
        let month = if month_from_march < 10 { month_from_march + 3 } else { month_from_march - 9 };
        Self {
            year: 400 * era + year_of_era + i64::from(month <= 2),
            month,
            day: day_of_year - (153 * month_from_march + 2) / 5 + 1,
            nanosecond_of_day: nanoseconds.rem_euclid(NANOSECONDS_A_DAY),
        }
    }

    /// The date with a character between its parts: `2011-09-26` or `2011_09_26`.
    pub(crate) fn date(&self, between: char) -> String {
        format!("{:04}{between}{:02}{between}{:02}", self.year, self.month, self.day)
    }
}

impl fmt::Display for UtcTime {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (second, nanosecond) =
            (self.nanosecond_of_day / 1_000_000_000, self.nanosecond_of_day % 1_000_000_000);
        let (hour, minute) = (second / 3600, second / 60 % 60);
        write!(f, "{} {hour:02}:{minute:02}:{:02}.{nanosecond:09}", self.date('-'), second % 60)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_instants() {
        for (nanoseconds, text) in [
            (0, "1970-01-01 00:00:00.000000000"),
            (-1, "1969-12-31 23:59:59.999999999"),
            (951_782_400_000_000_000, "2000-02-29 00:00:00.000000000"),
            (1_317_042_145_964_389_445, "2011-09-26 13:02:25.964389445"),
            (1_700_000_000_000_000_000, "2023-11-14 22:13:20.000000000"),
            (4_107_542_399_000_000_000, "2100-02-28 23:59:59.000000000"),
            (4_107_542_400_000_000_000, "2100-03-01 00:00:00.000000000"),
        ] {
            assert_eq!(UtcTime::new(nanoseconds).to_string(), text);
        }
    }
}
