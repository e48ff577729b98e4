//! The groups of a METAR, one function each.

use super::{
    CloudCover, CloudGroup, IgnoredGroup, Metar, MetarKind, MetarTime, MetarVisibility, MetarWind,
    RunwayRange, VisibilityBound, WeatherDescriptor, WeatherGroup, WeatherIntensity, WeatherPhenomenon,
};
use crate::error::{ReportError, meant, quoted};
use wm_scene::nearest;

/// Metres in a statute mile and a foot, m/s in a knot, hPa in an inch of mercury.
const MILE: f64 = 1609.344;
const FOOT: f64 = 0.3048;
const KNOT: f64 = 0.514_444;
const INCH: f64 = 33.863_886;

/// The forms of groups, with examples that say what each looks like.
const FORMS: &[(&str, &[&str])] = &[
    ("a wind, as in 24015G25KT, VRB03KT or 04007MPS", &["24015KT", "24015G25KT", "04007MPS", "VRB03KT"]),
    ("a visibility, as in 0800, 9999, 1200NE or 3/4SM", &["0800", "1200NE", "3/4SM", "10SM"]),
    ("clouds, as in BKN012, FEW030CB or VV002", &["BKN012", "FEW030CB", "VV002"]),
    ("temperature and dew point, as in 03/M01", &["03/M01", "M03/M05", "13/11"]),
    ("a pressure, as in Q1013 or A2992", &["Q1013", "A2992"]),
    ("a runway visual range, as in R04L/0600", &["R04L/0600", "R27/P2000", "R04R/1200FT"]),
    ("a time, as in 291851Z", &["291851Z"]),
];
/// Words that end the report itself: what follows is a forecast.
const TRENDS: [&str; 7] = ["TEMPO", "BECMG", "NOSIG", "INTER", "PROB30", "PROB40", "FCST"];
/// Colour states of military aerodromes.
const COLORS: [&str; 9] = ["BLU", "BLU+", "WHT", "GRN", "YLO", "YLO1", "YLO2", "AMB", "RED"];
const SIDES: [&str; 8] = ["N", "NE", "E", "SE", "S", "SW", "W", "NW"];

/// A group and its place in the text, characters from 1.
#[derive(Clone, Copy)]
struct Group<'a> {
    text: &'a str,
    at: usize,
}

fn groups(text: &str) -> Vec<Group<'_>> {
    let mut found = Vec::new();
    let mut start = None;
    let mut position = 0;
    for (index, c) in text.char_indices() {
        position += 1;
        // The end of a report, in bulletins.
        let is_gap = c.is_whitespace() || c == '=';
        match (is_gap, start) {
            (true, Some((from, at))) => {
                found.push(Group { text: &text[from..index], at });
                start = None;
            }
            (false, None) => start = Some((index, position)),
            _ => {}
        }
    }
    if let Some((from, at)) = start {
        found.push(Group { text: &text[from..], at });
    }
    found
}

fn fault(group: Group<'_>, problem: impl std::fmt::Display) -> ReportError {
    ReportError::Text {
        kind: "METAR",
        position: group.at,
        problem: format!("{} {problem}", quoted(group.text)),
    }
}

fn damaged(group: Group<'_>, form: usize) -> ReportError {
    fault(group, format!("is damaged: {} is expected", FORMS[form].0))
}

pub(super) fn parse(text: &str) -> Result<Metar, ReportError> {
    let all = groups(text);
    let mut rest = &all[..];
    let mut metar = Metar {
        kind: MetarKind::Metar,
        station: String::new(),
        time: None,
        is_automatic: false,
        is_correction: false,
        wind: None,
        is_cavok: false,
        visibility: None,
        minimum_visibility: None,
        runway_ranges: Vec::new(),
        weather: Vec::new(),
        clouds: Vec::new(),
        temperature: None,
        dew_point: None,
        pressure: None,
        recent: Vec::new(),
        ignored: Vec::new(),
        remarks: String::new(),
    };
    let mut take = |wanted: &[&str]| -> Option<&str> {
        let (first, others) = rest.split_first()?;
        let found = wanted.contains(&first.text).then_some(first.text)?;
        rest = others;
        Some(found)
    };
    if take(&["METAR", "SPECI"]) == Some("SPECI") {
        metar.kind = MetarKind::Speci;
    }
    metar.is_correction = take(&["COR"]).is_some();
    let whole = |problem: &str| ReportError::Whole { file: "METAR".into(), problem: problem.into() };
    let Some((station, others)) = rest.split_first() else {
        return Err(whole("ends before the station: a report begins as in METAR KJFK 291851Z"));
    };
    if station.text == "TAF" {
        return Err(fault(*station, "begins a forecast, which is not read: give a METAR or SPECI"));
    }
    let bytes = station.text.as_bytes();
    let is_station = bytes.len() == 4
        && bytes[0].is_ascii_uppercase()
        && bytes.iter().all(|b| b.is_ascii_uppercase() || b.is_ascii_digit());
    if !is_station {
        return Err(fault(
            *station,
            "is no station: four capital letters or digits are expected, as in KJFK",
        ));
    }
    metar.station = station.text.into();
    rest = others;
    if let Some((group, others)) = rest.split_first()
        && group.text.ends_with('Z')
    {
        metar.time = Some(time(*group)?);
        rest = others;
    }
    let mut seen = 0;
    while let Some((group, others)) = rest.split_first() {
        let taken = metar.take(*group, others, text)?;
        seen += 1;
        rest = others.get(taken..).unwrap_or_default();
    }
    if seen == 0 {
        return Err(whole("has no groups after the station and the time"));
    }
    Ok(metar)
}

impl Metar {
    /// Reads a group; returns the number of groups after it that belong to it.
    fn take(&mut self, group: Group<'_>, others: &[Group<'_>], all: &str) -> Result<usize, ReportError> {
        let text = group.text;
        let ignore = |metar: &mut Self, taken: usize, reason: &'static str| {
            let parts = std::iter::once(text).chain(others.iter().take(taken).map(|group| group.text));
            metar.ignored.push(IgnoredGroup { text: parts.collect::<Vec<_>>().join(" "), reason });
            Ok(taken)
        };
        match text {
            "AUTO" => self.is_automatic = true,
            "METAR" | "SPECI" => return Err(fault(group, "begins a second report: one is expected")),
            "NIL" => return Err(fault(group, "says that the report is missing: there is no weather in it")),
            "COR" | "CCA" | "CCB" | "CCC" | "RTD" => self.is_correction |= text != "RTD",
            "CAVOK" => {
                self.is_cavok = true;
                self.visibility = Some(MetarVisibility {
                    metres: 10_000.0,
                    bound: VisibilityBound::OrMore,
                    direction: None,
                });
            }
            "RMK" => {
                // As it stands, from the next group to the end.
                let start = others.first().map_or(all.len(), |next| byte_of(all, next.at));
                self.remarks =
                    all.get(start..).unwrap_or_default().trim_end_matches(['=', '\n', '\r', ' ']).into();
                return Ok(others.len());
            }
            "WS" => {
                let is_part = |text: &str| {
                    matches!(text, "ALL" | "RWY" | "TKOF" | "LDG")
                        || text.starts_with("RWY")
                        || runway(text).is_some()
                };
                let taken = others.iter().take_while(|group| is_part(group.text)).count();
                if taken == 0 {
                    return Err(fault(group, "is damaged: wind shear is WS R24 or WS ALL RWY"));
                }
                return ignore(self, taken, "a weather has no wind shear");
            }
            "$" | "NSW" | "SNOCLO" | "R/SNOCLO" => return ignore(self, 0, "no part of a weather"),
            // Not measured: visibility, weather, temperature.
            "//SM" | "////SM" | "M" => {}
            _ if text.len() != 6 && text.bytes().all(|b| b == b'/') => {}
            // Outside of the remarks, where they belong, in bulletins of some services.
            _ if text.starts_with("SLP") && text.len() == 6 => {
                return ignore(self, 0, "a pressure of the remarks");
            }
            _ if text.starts_with("RF") && text.contains('.') => {
                return ignore(self, 0, "rain so far, in Australia");
            }
            _ if TRENDS.contains(&text) => {
                let taken = others.iter().take_while(|group| group.text != "RMK").count();
                return ignore(self, taken, "a forecast, not what is there");
            }
            _ if COLORS.contains(&text.trim_start_matches("BLACK")) => {
                return ignore(self, 0, "the colour state of an aerodrome");
            }
            _ => return self.take_value(group, others),
        }
        Ok(0)
    }

    fn take_value(&mut self, group: Group<'_>, others: &[Group<'_>]) -> Result<usize, ReportError> {
        let text = group.text;
        let is_digits =
            |text: &str, count: usize| text.len() == count && text.bytes().all(|b| b.is_ascii_digit());
        if ["KT", "MPS", "KMH"].iter().any(|unit| text.ends_with(unit)) {
            self.wind = Some(wind(text).ok_or_else(|| damaged(group, 0))?);
        } else if text.len() == 7
            && text.as_bytes()[3] == b'V'
            && text.bytes().filter(u8::is_ascii_digit).count() == 6
        {
            let between = [&text[..3], &text[4..]].map(|part| part.parse::<f64>().unwrap_or(f64::NAN));
            if !between.iter().all(|degrees| (0.0..=360.0).contains(degrees)) {
                return Err(fault(group, "is damaged: a varying wind is 180V240, in degrees up to 360"));
            }
            let Some(wind) = &mut self.wind else {
                return Err(fault(group, "says how the wind varies, and no wind comes before it"));
            };
            wind.between = Some(between);
        } else if text.ends_with("SM") {
            let metres = miles(text, 0.0).ok_or_else(|| damaged(group, 1))?;
            self.see(metres);
        } else if (is_digits(text, 1) || is_digits(text, 2))
            && others.first().is_some_and(|next| next.text.ends_with("SM"))
        {
            let whole = text.parse::<f64>().unwrap_or_default();
            let metres = miles(others[0].text, whole).ok_or_else(|| damaged(others[0], 1))?;
            self.see(metres);
            return Ok(1);
        } else if let Some(seen) = metres(text) {
            self.see(seen);
        } else if text.len() > 3 && text.starts_with('R') && text.as_bytes()[1].is_ascii_digit() {
            let (runway, range) = runway_range(text).ok_or_else(|| damaged(group, 5))?;
            match range {
                Some(metres) => self.runway_ranges.push(RunwayRange { runway, metres }),
                None => {
                    self.ignored.push(IgnoredGroup { text: text.into(), reason: "the state of a runway" });
                }
            }
        } else if is_digits(text, 8) {
            self.ignored.push(IgnoredGroup { text: text.into(), reason: "the state of a runway" });
        } else if let Some(cloud) = clouds(text) {
            self.clouds.push(cloud.map_err(|()| damaged(group, 2))?);
        } else if text.starts_with(['Q', 'A'])
            && text[1..].starts_with(|c: char| c.is_ascii_digit() || c == '/')
        {
            self.pressure = pressure(text).ok_or_else(|| damaged(group, 4))?.or(self.pressure);
        } else if text.starts_with('W') && text.contains("/S") || text.starts_with('W') && text.contains("/H")
        {
            self.ignored.push(IgnoredGroup { text: text.into(), reason: "the state of the sea" });
        } else if text.contains('/') {
            let degrees = degrees(text).ok_or_else(|| damaged(group, 3))?;
            if !degrees.iter().flatten().all(|t| (-90.0..=60.0).contains(t)) {
                return Err(fault(
                    group,
                    "is no temperature of the air: -90 to 60 degrees Celsius are expected",
                ));
            }
            [self.temperature, self.dew_point] = degrees;
        } else if let Some(recent) = text.strip_prefix("RE").filter(|rest| rest.len() >= 2) {
            self.recent.push(weather(recent).ok_or_else(|| unknown(group))?);
        } else {
            self.weather.push(weather(text).ok_or_else(|| unknown(group))?);
        }
        Ok(0)
    }

    fn see(&mut self, seen: MetarVisibility) {
        if self.visibility.is_none() {
            self.visibility = Some(seen);
        } else if self.minimum_visibility.is_none() {
            self.minimum_visibility = Some(seen);
        } else {
            let text = format!("{} m {}", seen.metres, seen.direction.unwrap_or_default());
            self.ignored.push(IgnoredGroup { text, reason: "a third visibility" });
        }
    }
}

/// The byte at which a character, from 1, begins.
fn byte_of(text: &str, character: usize) -> usize {
    text.char_indices().nth(character - 1).map_or(text.len(), |(byte, _)| byte)
}

/// An error for a group of no form, with the nearest.
fn unknown(group: Group<'_>) -> ReportError {
    let text = group.text;
    let shape = |text: &str| -> String {
        text.chars().map(|c| if c.is_ascii_digit() { '0' } else { c.to_ascii_uppercase() }).collect()
    };
    let shapes: Vec<(String, &str)> = FORMS
        .iter()
        .flat_map(|(form, examples)| examples.iter().map(move |one| (shape(one), *form)))
        .collect();
    let own = shape(text);
    let words =
        ["AUTO", "CAVOK", "NOSIG", "TEMPO", "BECMG", "SKC", "CLR", "NSC", "NCD", "RMK", "SPECI", "METAR"];
    let codes = words.into_iter().chain(WeatherPhenomenon::ALL.iter().map(|one| one.code()));
    let near_form = nearest(&own, shapes.iter().map(|(shape, _)| &shape[..]), 1);
    let problem = if text.bytes().any(|b| b.is_ascii_digit()) && !near_form.is_empty() {
        let form = shapes.iter().find(|(shape, _)| shape == near_form[0]).map_or("", |(_, form)| form);
        format!("is of no known form; the nearest is {form}")
    } else {
        let near = meant(text, codes);
        format!(
            "is of no known form{near}; present weather is one of -RA, +SHSN, FZFG, BR, VCTS and the like"
        )
    };
    fault(group, problem)
}

fn time(group: Group<'_>) -> Result<MetarTime, ReportError> {
    let text = &group.text[..group.text.len() - 1];
    if text.len() != 6 || !text.bytes().all(|b| b.is_ascii_digit()) {
        return Err(damaged(group, 6));
    }
    let part = |from: usize| text[from..from + 2].parse().unwrap_or(99);
    let time = MetarTime { day: part(0), hour: part(2), minute: part(4) };
    if !(1..=31).contains(&time.day) || time.hour > 23 || time.minute > 59 {
        return Err(fault(
            group,
            "is no time: day of the month, hour and minute are expected, as in 291851Z",
        ));
    }
    Ok(time)
}

fn wind(text: &str) -> Option<MetarWind> {
    let units = [("KT", KNOT), ("MPS", 1.0), ("KMH", 1.0 / 3.6)];
    let (text, unit) = units.iter().find_map(|(name, unit)| Some((text.strip_suffix(name)?, *unit)))?;
    let (direction, speeds) = text.split_at_checked(3)?;
    let is_variable = direction == "VRB";
    let from = match direction {
        "VRB" | "///" => None,
        digits if digits.bytes().all(|b| b.is_ascii_digit()) => {
            Some(digits.parse::<f64>().ok().filter(|degrees| *degrees <= 360.0)?)
        }
        _ => return None,
    };
    let speed = |text: &str| -> Option<Option<f64>> {
        if matches!(text, "//" | "///") {
            return Some(None);
        }
        // P: or more.
        let digits = text.strip_prefix('P').unwrap_or(text);
        let good = (2..=3).contains(&digits.len()) && digits.bytes().all(|b| b.is_ascii_digit());
        good.then(|| digits.parse::<f64>().ok().map(|speed| speed * unit))
    };
    let (mean, gust) = match speeds.split_once('G') {
        Some((mean, gust)) => (speed(mean)?, speed(gust)?),
        None => (speed(speeds)?, None),
    };
    Some(MetarWind { from, speed: mean, gust, is_variable, between: None })
}

/// A visibility in statute miles, with a whole number that came before.
fn miles(text: &str, whole: f64) -> Option<MetarVisibility> {
    let text = text.strip_suffix("SM")?;
    let (bound, number) = match text.as_bytes().first()? {
        b'M' => (VisibilityBound::Less, &text[1..]),
        b'P' => (VisibilityBound::OrMore, &text[1..]),
        _ => (VisibilityBound::Exact, text),
    };
    let digits = |text: &str| -> Option<f64> {
        let good = (1..=3).contains(&text.len()) && text.bytes().all(|b| b.is_ascii_digit());
        good.then(|| text.parse().ok())?
    };
    let miles = match number.split_once('/') {
        Some((upper, lower)) => whole + digits(upper)? / digits(lower).filter(|lower| *lower > 0.0)?,
        None if whole > 0.0 => return None,
        None => digits(number)?,
    };
    Some(MetarVisibility { metres: miles * MILE, bound, direction: None })
}

/// A visibility in metres: `0800`, `9999`, `1200NE`, `2000NDV`, `5KM`.
fn metres(text: &str) -> Option<MetarVisibility> {
    if let Some(km) = text.strip_suffix("KM").filter(|km| (1..=2).contains(&km.len())) {
        let metres = 1000.0 * f64::from(km.parse::<u8>().ok()?);
        return Some(MetarVisibility { metres, bound: VisibilityBound::Exact, direction: None });
    }
    let (digits, side) = text.split_at_checked(4)?;
    if !digits.bytes().all(|b| b.is_ascii_digit())
        || !(side.is_empty() || side == "NDV" || SIDES.contains(&side))
    {
        return None;
    }
    let direction = (!side.is_empty() && side != "NDV").then(|| side.to_owned());
    let (metres, bound) = match digits {
        "9999" => (10_000.0, VisibilityBound::OrMore),
        "0000" => (50.0, VisibilityBound::Less),
        _ => (digits.parse().ok()?, VisibilityBound::Exact),
    };
    Some(MetarVisibility { metres, bound, direction })
}

/// The name of a runway in a group that begins with `R`.
fn runway(text: &str) -> Option<&str> {
    let name = text.strip_prefix('R')?;
    let digits = name.bytes().take_while(u8::is_ascii_digit).count();
    (digits == 2 && matches!(&name[2..], "" | "L" | "C" | "R" | "LL" | "RR")).then_some(name)
}

/// A runway and its visual range, m; no range for a state of the runway.
#[allow(clippy::type_complexity)] // A range that was not measured is another thing than none.
fn runway_range(text: &str) -> Option<(String, Option<Option<[f64; 2]>>)> {
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
    let (range, unit) = range.strip_suffix("FT").map_or((range, 1.0), |range| (range, FOOT));
    let distance = |text: &str| -> Option<f64> {
        let digits = text.trim_start_matches(['P', 'M']);
        let good = digits.len() == 4 && digits.bytes().all(|b| b.is_ascii_digit());
        good.then(|| digits.parse::<f64>().ok().map(|v| v * unit))?
    };
    let metres = match range.split_once('V') {
        Some((least, most)) => [distance(least)?, distance(most)?],
        None => [distance(range)?; 2],
    };
    Some((runway, Some(Some(metres))))
}

/// Clouds; an error if it begins as clouds do.
fn clouds(text: &str) -> Option<Result<CloudGroup, ()>> {
    let cover = |text: &str| match text {
        "FEW" => Some(CloudCover::Few),
        "SCT" => Some(CloudCover::Scattered),
        "BKN" => Some(CloudCover::Broken),
        "OVC" => Some(CloudCover::Overcast),
        "///" => Some(CloudCover::Unknown),
        _ => None,
    };
    if matches!(text, "SKC" | "CLR" | "NSC" | "NCD") {
        return Some(Ok(CloudGroup {
            cover: CloudCover::Clear,
            height: None,
            kind: None,
            code: text.into(),
        }));
    }
    let (cover, rest) = match text.strip_prefix("VV") {
        Some(rest) => (CloudCover::Obscured, rest),
        None => {
            let (head, rest) = text.split_at_checked(3)?;
            let found = cover(head)?;
            // Five slashes are a temperature.
            (
                found,
                if found == CloudCover::Unknown && (rest.len() < 3 || rest.starts_with('M')) {
                    return None;
                } else {
                    rest
                },
            )
        }
    };
    let kinds = [("///", None), ("CB", Some("CB")), ("TCU", Some("TCU")), ("ACC", Some("ACC")), ("", None)];
    // The genera of clouds, where a service tells them.
    let genera = ["CI", "CC", "CS", "AC", "AS", "NS", "SC", "ST", "CU"].map(|genus| (genus, None));
    let kinds: Vec<(&str, Option<&'static str>)> = kinds.into_iter().chain(genera).collect();
    let read = || {
        let (height, rest) = match rest.split_at_checked(3) {
            None => (None, rest),
            Some(("///", rest)) => (None, rest),
            Some((digits, rest)) if digits.bytes().all(|b| b.is_ascii_digit()) => {
                (digits.parse::<f64>().ok().map(|hundreds| 100.0 * FOOT * hundreds), rest)
            }
            // A kind without a height.
            Some(_) => (None, rest),
        };
        let (_, kind) = kinds.iter().find(|(code, _)| *code == rest)?;
        let has_none = cover == CloudCover::Obscured && text == "VV";
        (!has_none).then(|| CloudGroup { cover, height, kind: *kind, code: text.into() })
    };
    Some(read().ok_or(()))
}

/// A pressure, hPa; none if it was not measured.
fn pressure(text: &str) -> Option<Option<f64>> {
    let digits = &text[1..];
    if digits == "////" {
        return Some(None);
    }
    if digits.len() != 4 || !digits.bytes().all(|b| b.is_ascii_digit()) {
        return None;
    }
    let number = digits.parse::<f64>().ok()?;
    Some(Some(if text.starts_with('A') { number / 100.0 * INCH } else { number }))
}

/// Temperature and dew point, degrees Celsius; none for what was not measured.
fn degrees(text: &str) -> Option<[Option<f64>; 2]> {
    let one = |text: &str| -> Option<Option<f64>> {
        if matches!(text, "//" | "XX" | "") {
            return Some(None);
        }
        let (sign, digits) = text.strip_prefix('M').map_or((1.0, text), |digits| (-1.0, digits));
        let good = digits.len() == 2 && digits.bytes().all(|b| b.is_ascii_digit());
        good.then(|| digits.parse::<f64>().ok().map(|value| sign * value))
    };
    // The stroke between the two, where the first may be two strokes.
    let (first, second) =
        if let Some(second) = text.strip_prefix("///") { ("//", second) } else { text.split_once('/')? };
    Some([one(first)?, one(second)?])
}

fn weather(text: &str) -> Option<WeatherGroup> {
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
