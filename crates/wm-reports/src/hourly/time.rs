//! Times of tables.

use wm_base::calendar::{date_and_time, days};

/// Day of the year, from 1, of a number of days since 1970-01-01.
pub(super) fn day_of_year(days_since: i64) -> i64 {
    days_since - days(date_and_time(86_400 * days_since)[0], 1, 1) + 1
}

/// Seconds since 1970 of `2024-01-15T06:00`, with seconds and zone or without; true if it has a
/// zone and so is UTC. A number is seconds since 1970, UTC.
pub(super) fn parse(text: &str) -> Option<(i64, bool)> {
    let text = text.trim();
    if text.len() > 8 && text.bytes().all(|b| b.is_ascii_digit()) {
        return Some((text.parse().ok().filter(|time| *time < 100_000_000_000)?, true));
    }
    let (date, rest) = text.split_at_checked(10)?;
    let digits = |text: &str| -> Option<i64> {
        (!text.is_empty() && text.len() <= 4 && text.bytes().all(|b| b.is_ascii_digit()))
            .then(|| text.parse().ok())?
    };
    let mut parts = date.split('-');
    let [year, month, day] = [parts.next()?, parts.next()?, parts.next()?];
    let midnight = midnight(digits(year)?, digits(month)?, digits(day)?)?;
    if rest.is_empty() {
        return Some((midnight, false));
    }
    let rest = rest.strip_prefix('T').or_else(|| rest.strip_prefix(' '))?;
    let (clock, zone) = match rest.find(['Z', '+', '-']) {
        Some(place) => rest.split_at(place),
        None => (rest, ""),
    };
    let mut parts = clock.trim().split(':');
    let (hour, minute) = (digits(parts.next()?)?, digits(parts.next().unwrap_or("0"))?);
    let second = digits(parts.next().unwrap_or("0").split('.').next()?)?;
    if hour > 24 || minute > 59 || second > 60 {
        return None;
    }
    let local = midnight + 3600 * hour + 60 * minute + second;
    let zone = match zone {
        "" => return Some((local, false)),
        "Z" => 0,
        zone => {
            let sign = if zone.starts_with('-') { -1 } else { 1 };
            let plain: String = zone[1..].chars().filter(|c| *c != ':').collect();
            let (hours, minutes) = plain.split_at_checked(2)?;
            sign * (3600 * digits(hours)? + 60 * if minutes.is_empty() { 0 } else { digits(minutes)? })
        }
    };
    Some((local - zone, true))
}

/// Seconds since 1970 of the beginning of a day; `None` if there is no such day.
pub(super) fn midnight(year: i64, month: i64, day: i64) -> Option<i64> {
    let good = (1800..=2500).contains(&year) && (1..=12).contains(&month) && (1..=31).contains(&day);
    let time = good.then(|| 86_400 * days(year, month, day))?;
    (date_and_time(time)[..3] == [year, month, day]).then_some(time)
}

/// `2024-01-15 06:00` of seconds since 1970.
pub(super) fn written(time: i64) -> String {
    let [year, month, day, hour, minute, _] = date_and_time(time);
    format!("{year}-{month:02}-{day:02} {hour:02}:{minute:02}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_those_of_the_calendar() {
        // By `date -u -d ... +%s`.
        for (text, seconds) in [
            ("1970-01-01T00:00", 0),
            ("2024-02-29 23:30:15", 1_709_249_415),
            ("2024-03-01T00:30+01:00", 1_709_249_400),
            ("2000-12-31T24:00Z", 978_307_200),
            ("1709249415", 1_709_249_415),
        ] {
            assert_eq!(parse(text).map(|(time, _)| time), Some(seconds), "{text}");
        }
        for text in [
            "",
            "2023-02-29T00:00",
            "2024-13-01",
            "2024-01-15T25:00",
            "15.01.2024 06:00",
            "2024-01-15T06:00+",
            "2024-01-1\u{e9}",
        ] {
            assert_eq!(parse(text), None, "{text}");
        }
        assert_eq!(written(1_709_249_415), "2024-02-29 23:30");
        assert_eq!(day_of_year(days(2024, 12, 31)), 366);
    }
}
