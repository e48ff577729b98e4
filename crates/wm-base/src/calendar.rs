//! Days of the Gregorian calendar, and times of day, UTC without leap seconds.
//!
//! Years begin in March here, so that the day of leap years is their last (Hinnant's algorithms):
//! 719,468 days before 1970 is the first of March of year 0, and 400 years have 146,097 days.

/// Days from 1 January 1970 to a date.
#[must_use]
pub fn days(year: i64, month: i64, day: i64) -> i64 {
    let (year, month) = if month > 2 { (year, month - 3) } else { (year - 1, month + 9) };
    let leap_days = year.div_euclid(4) - year.div_euclid(100) + year.div_euclid(400);
    365 * year + leap_days + (153 * month + 2) / 5 + day - 1 - 719_468
}

/// Year, month, day, hour, minute and second of seconds since 1970.
#[must_use]
pub fn date_and_time(seconds: i64) -> [i64; 6] {
    let days = seconds.div_euclid(86_400) + 719_468;
    let (era, day) = (days.div_euclid(146_097), days.rem_euclid(146_097));
    let year = (day - day / 1460 + day / 36_524 - day / 146_096) / 365;
    let of_year = day - (365 * year + year / 4 - year / 100);
    let shifted = (5 * of_year + 2) / 153;
    let month = if shifted < 10 { shifted + 3 } else { shifted - 9 };
    let (year, day) = (year + era * 400 + i64::from(month <= 2), of_year - (153 * shifted + 2) / 5 + 1);
    let second = seconds.rem_euclid(86_400);
    [year, month, day, second / 3600, second / 60 % 60, second % 60]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn days_are_those_of_the_calendar() {
        for (seconds, date) in [
            (0, [1970, 1, 1, 0, 0, 0]),
            (951_782_400, [2000, 2, 29, 0, 0, 0]),
            (1_717_059_369, [2024, 5, 30, 8, 56, 9]),
        ] {
            assert_eq!(date_and_time(seconds), date);
            assert_eq!(days(date[0], date[1], date[2]), seconds / 86_400);
        }
        for since in -800..30_000 {
            let [year, month, day, ..] = date_and_time(86_400 * since);
            assert_eq!(days(year, month, day), since);
        }
    }
}
