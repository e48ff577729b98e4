//! The forms of single groups, one function each: `None` for a text that is damaged.

use super::decoded::{
    CloudCover, CloudGroup, MetarVisibility, MetarWind, VisibilityBound, WeatherDescriptor, WeatherGroup,
    WeatherIntensity, WeatherPhenomenon,
};

/// Metres in a statute mile and a foot, m/s in a knot, hPa in an inch of mercury.
const METRES_PER_MILE: f64 = 1609.344;
const METRES_PER_FOOT: f64 = 0.3048;
const M_S_PER_KNOT: f64 = 0.514_444;
const HPA_PER_INCH: f64 = 33.863_886;
const COMPASS_SIDES: [&str; 8] = ["N", "NE", "E", "SE", "S", "SW", "W", "NW"];
/// Visibility told as 0: less than the least step of either scale, m.
const MIN_VISIBILITY_M: f64 = 50.0;

/// Returns true if a text has exactly `count` characters, all digits.
pub(super) fn is_digits(text: &str, count: usize) -> bool {
    text.len() == count && text.bytes().all(|b| b.is_ascii_digit())
}

/// The number of a text of `count` digits.
fn number(text: &str, count: std::ops::RangeInclusive<usize>) -> Option<f64> {
    let is_number = count.contains(&text.len()) && text.bytes().all(|b| b.is_ascii_digit());
    is_number.then(|| text.parse().ok())?
}

/// Returns true for one or more strokes in place of a value that was not measured.
pub(super) fn is_strokes(text: &str) -> bool {
    !text.is_empty() && text.bytes().all(|b| b == b'/')
}

pub(super) fn wind(text: &str) -> Option<MetarWind> {
    let units = [("KT", M_S_PER_KNOT), ("KTS", M_S_PER_KNOT), ("MPS", 1.0), ("KMH", 1.0 / 3.6)];
    let (text, unit) = units.iter().find_map(|(name, unit)| Some((text.strip_suffix(name)?, *unit)))?;
    if is_strokes(&text.replace('G', "/")) {
        return Some(MetarWind { from: None, speed: None, gust: None, is_variable: false, between: None });
    }
    let (direction, speeds) = text.split_at_checked(3)?;
    let is_variable = direction == "VRB";
    let from = match direction {
        "VRB" | "///" => None,
        digits => Some(number(digits, 3..=3).filter(|degrees| *degrees <= 360.0)?),
    };
    let speed = |text: &str| -> Option<Option<f64>> {
        if is_strokes(text) {
            return Some(None);
        }
        // P: or more.
        number(text.strip_prefix('P').unwrap_or(text), 2..=3).map(|speed| Some(speed * unit))
    };
    let (mean, gust) = match speeds.split_once('G') {
        Some((mean, gust)) => (speed(mean)?, speed(gust)?),
        None => (speed(speeds)?, None),
    };
    Some(MetarWind { from, speed: mean, gust, is_variable, between: None })
}

/// A visibility in statute miles, with a whole number that came before.
pub(super) fn miles(text: &str, whole: f64) -> Option<MetarVisibility> {
    let text = text.strip_suffix("SM")?;
    let (bound, value) = bound(text)?;
    let digits = |text: &str| number(text, 1..=3);
    let fraction = |upper: &str, lower: f64| Some(digits(upper)? / lower);
    let miles = match value.split_once('/') {
        Some((upper, lower)) => {
            let lower = digits(lower).filter(|lower| *lower > 0.0)?;
            match fraction(upper, lower)? {
                share if share < 1.0 => whole + share,
                // A whole number and a fraction without the space between them: 11/2SM.
                _ => {
                    let (first, upper) = upper.split_at_checked(1)?;
                    digits(first)? + fraction(upper, lower).filter(|share| whole == 0.0 && *share < 1.0)?
                }
            }
        }
        None if whole > 0.0 => return None,
        None => digits(value)?,
    };
    let (metres, bound) = match miles {
        0.0 => (MIN_VISIBILITY_M, VisibilityBound::Less),
        _ => (miles * METRES_PER_MILE, bound),
    };
    Some(MetarVisibility { metres, bound, direction: None })
}

/// The bound of a visibility by its first letter, and the rest.
fn bound(text: &str) -> Option<(VisibilityBound, &str)> {
    Some(match text.as_bytes().first()? {
        b'M' => (VisibilityBound::Less, &text[1..]),
        b'P' => (VisibilityBound::OrMore, &text[1..]),
        _ => (VisibilityBound::Exact, text),
    })
}

/// A visibility in metres: `0800`, `9999`, `1200NE`, `2000NDV`, `M0400`, `4000M`, `5KM`.
pub(super) fn metres(text: &str) -> Option<MetarVisibility> {
    if let Some(km) = text.strip_suffix("KM").filter(|km| (1..=2).contains(&km.len())) {
        let metres = 1000.0 * f64::from(km.parse::<u8>().ok()?);
        return Some(MetarVisibility { metres, bound: VisibilityBound::Exact, direction: None });
    }
    let (bound, text) = bound(text)?;
    let (digits, side) = text.split_at_checked(4)?;
    // Automatic stations say that they have no direction; others write the unit.
    let has_none = matches!(side, "" | "NDV" | "ND" | "M" | "/" | "//");
    if !is_digits(digits, 4) || !(has_none || COMPASS_SIDES.contains(&side)) {
        return None;
    }
    let direction = (!has_none).then(|| side.to_owned());
    let (metres, bound) = match digits {
        "9999" => (10_000.0, VisibilityBound::OrMore),
        "0000" => (MIN_VISIBILITY_M, VisibilityBound::Less),
        _ => (digits.parse().ok()?, bound),
    };
    Some(MetarVisibility { metres, bound, direction })
}

/// The name of a runway in a group that begins with `R`.
pub(super) fn runway(text: &str) -> Option<&str> {
    let name = text.strip_prefix('R')?;
    let digits = name.bytes().take_while(u8::is_ascii_digit).count();
    (digits == 2 && matches!(&name[2..], "" | "L" | "C" | "R" | "LL" | "RR")).then_some(name)
}

/// A runway and its visual range, m; no range for a state of the runway.
#[allow(clippy::type_complexity)] // A range that was not measured is another thing than none.
pub(super) fn runway_range(text: &str) -> Option<(String, Option<Option<[f64; 2]>>)> {
    let (name, range) = text.split_once('/')?;
    let runway = runway(name)?.to_owned();
    let is_state = range.starts_with("CLRD") || range.starts_with("SNOCLO") || {
        range.len() == 6 && range.bytes().all(|b| b.is_ascii_digit() || b == b'/')
    };
    if is_state {
        return Some((runway, None));
    }
    // The trend: up, down, none.
    let range = range.trim_end_matches(['U', 'D', 'N']).trim_end_matches('/');
    if range.is_empty() {
        return Some((runway, Some(None)));
    }
    let (range, unit) = range.strip_suffix("FT").map_or((range, 1.0), |range| (range, METRES_PER_FOOT));
    let distance = |text: &str| Some(number(text.trim_start_matches(['P', 'M']), 4..=4)? * unit);
    let metres = match range.split_once('V') {
        Some((least, most)) => [distance(least)?, distance(most)?],
        None => [distance(range)?; 2],
    };
    Some((runway, Some(Some(metres))))
}

/// Clouds; an error if it begins as clouds do and is damaged.
pub(super) fn clouds(text: &str) -> Option<Result<CloudGroup, ()>> {
    let cover = |text: &str| match text {
        "FEW" => Some(CloudCover::Few),
        "SCT" => Some(CloudCover::Scattered),
        "BKN" => Some(CloudCover::Broken),
        "OVC" => Some(CloudCover::Overcast),
        "///" => Some(CloudCover::Unknown),
        _ => None,
    };
    if matches!(text, "SKC" | "CLR" | "NSC" | "NCD") {
        let (cover, code) = (CloudCover::Clear, text.into());
        return Some(Ok(CloudGroup { cover, height: None, kind: None, code }));
    }
    let (cover, rest) = match text.strip_prefix("VV") {
        Some(rest) => (CloudCover::Obscured, rest),
        None => {
            let (head, rest) = text.split_at_checked(3)?;
            let found = cover(head)?;
            // Strokes before a dew point are a temperature.
            let is_cloud = rest.len() >= 3 && !rest.starts_with('M') || rest == "CB" || rest == "TCU";
            if found == CloudCover::Unknown && !is_cloud {
                return None;
            }
            (found, rest)
        }
    };
    let kinds = [("///", None), ("CB", Some("CB")), ("TCU", Some("TCU")), ("ACC", Some("ACC")), ("", None)];
    // The genera of clouds, where a service tells them.
    let genera = ["CI", "CC", "CS", "AC", "AS", "NS", "SC", "ST", "CU"].map(|genus| (genus, None));
    let kinds: Vec<(&str, Option<&'static str>)> = kinds.into_iter().chain(genera).collect();
    let read = || {
        let (height, rest) = match rest.split_at_checked(3) {
            _ if is_strokes(rest) => (None, ""),
            None => (None, rest),
            Some(("///", rest)) => (None, rest),
            Some((digits, after)) => match number(digits, 3..=3) {
                Some(hundreds) => (Some(100.0 * METRES_PER_FOOT * hundreds), after),
                // A kind without a height.
                None => (None, rest),
            },
        };
        // Where they stand may be glued on: `FEW013CB/N`, `BKN016CBNE-W`.
        let rest = ["CB", "TCU"]
            .into_iter()
            .find(|kind| {
                rest.strip_prefix(kind).is_some_and(|side| side.bytes().all(|b| b"NESW/-".contains(&b)))
            })
            .unwrap_or(rest);
        let (_, kind) = kinds.iter().find(|(code, _)| *code == rest)?;
        let has_none = cover == CloudCover::Obscured && text == "VV";
        (!has_none).then(|| CloudGroup { cover, height, kind: *kind, code: text.into() })
    };
    Some(read().ok_or(()))
}

/// A pressure, hPa; none if it was not measured.
pub(super) fn pressure(text: &str) -> Option<Option<f64>> {
    let digits = &text[1..];
    if is_strokes(digits) {
        return Some(None);
    }
    let number = number(digits, 4..=4)?;
    Some(Some(if text.starts_with('A') { number / 100.0 * HPA_PER_INCH } else { number }))
}

/// Temperature and dew point, degrees Celsius; none for what was not measured.
pub(super) fn degrees(text: &str) -> Option<[Option<f64>; 2]> {
    let one = |text: &str| -> Option<Option<f64>> {
        if is_strokes(text) || matches!(text, "" | "M" | "MM" | "X" | "XX") {
            return Some(None);
        }
        let (sign, digits) = text.strip_prefix('M').map_or((1.0, text), |digits| (-1.0, digits));
        number(digits, 2..=2).map(|value| Some(sign * value))
    };
    // The stroke between the two, where the first may be two strokes.
    let (first, second) =
        if let Some(second) = text.strip_prefix("///") { ("//", second) } else { text.split_once('/')? };
    Some([one(first)?, one(second)?])
}

pub(super) fn weather(text: &str) -> Option<WeatherGroup> {
    let (intensity, rest) = match text.as_bytes().first()? {
        b'-' => (WeatherIntensity::Light, &text[1..]),
        b'+' => (WeatherIntensity::Heavy, &text[1..]),
        _ => (WeatherIntensity::Moderate, text),
    };
    let (is_nearby, mut rest) = rest.strip_prefix("VC").map_or((false, rest), |rest| (true, rest));
    let mut group = WeatherGroup { intensity, is_nearby, descriptors: Vec::new(), phenomena: Vec::new() };
    while !rest.is_empty() {
        let (code, others) = rest.split_at_checked(2)?;
        rest = others;
        if let Some(phenomenon) = WeatherPhenomenon::ALL.iter().find(|one| one.code() == code) {
            group.phenomena.push(*phenomenon);
        } else {
            let descriptor = WeatherDescriptor::ALL.iter().find(|one| one.code() == code)?;
            // Descriptors come first.
            if !group.phenomena.is_empty() {
                return None;
            }
            group.descriptors.push(*descriptor);
        }
    }
    // A thunderstorm needs nothing that falls, and neither do showers nearby.
    let alone = group.is(WeatherDescriptor::Thunderstorm) || group.is(WeatherDescriptor::Showers);
    (!group.phenomena.is_empty() || alone).then_some(group)
}
