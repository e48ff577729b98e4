//! Dates and times of day in files, of nanoseconds since 1970, UTC without leap seconds.

use wm_base::calendar::date_and_time;

const NANOSECONDS_A_SECOND: i64 = 1_000_000_000;

/// The date with a character between its parts: `2011-09-26` or `2011_09_26`.
pub(crate) fn date(nanoseconds: i64, between: char) -> String {
    let [year, month, day, ..] = date_and_time(nanoseconds.div_euclid(NANOSECONDS_A_SECOND));
    format!("{year:04}{between}{month:02}{between}{day:02}")
}

/// The date and the time of day: `2011-09-26 13:02:25.964389445`.
pub(crate) fn text(nanoseconds: i64) -> String {
    let [.., hour, minute, second] = date_and_time(nanoseconds.div_euclid(NANOSECONDS_A_SECOND));
    let (date, part) = (date(nanoseconds, '-'), nanoseconds.rem_euclid(NANOSECONDS_A_SECOND));
    format!("{date} {hour:02}:{minute:02}:{second:02}.{part:09}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_instants() {
        for (nanoseconds, expected) in [
            (0, "1970-01-01 00:00:00.000000000"),
            (-1, "1969-12-31 23:59:59.999999999"),
            (951_782_400_000_000_000, "2000-02-29 00:00:00.000000000"),
            (1_317_042_145_964_389_445, "2011-09-26 13:02:25.964389445"),
            (1_700_000_000_000_000_000, "2023-11-14 22:13:20.000000000"),
            (4_107_542_399_000_000_000, "2100-02-28 23:59:59.000000000"),
            (4_107_542_400_000_000_000, "2100-03-01 00:00:00.000000000"),
        ] {
            assert_eq!(text(nanoseconds), expected);
        }
    }
}
