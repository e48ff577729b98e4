//! The groups of a METAR in their order.
//!
//! Nobody types a METAR by the book everywhere. So damage is an error only where it could be the
//! wind, the visibility, the weather, the clouds or the temperature: in a group that begins as one
//! of these, or that is of no known form and stands before the temperature. Anything else is noted
//! and left out.

use super::decoded::{
    IgnoredGroup, Metar, MetarKind, MetarTime, MetarVisibility, RunwayRange, VisibilityBound,
    WeatherPhenomenon,
};
use super::forms::{
    clouds, degrees, is_digits, is_strokes, metres, miles, pressure, runway, runway_range, weather, wind,
};
use crate::error::{ReportError, meant, quoted};
use wm_base::nearest;

/// The forms of groups, with examples that say what each looks like.
const FORMS: &[(&str, &[&str])] = &[
    ("a wind, as in 24015G25KT, VRB03KT or 04007MPS", &["24015KT", "24015G25KT", "04007MPS", "VRB03KT"]),
    ("a visibility, as in 0800, 9999, 1200NE or 3/4SM", &["0800", "1200NE", "3/4SM", "10SM"]),
    ("clouds, as in BKN012, FEW030CB or VV002", &["BKN012", "FEW030CB", "VV002"]),
    ("temperature and dew point, as in 03/M01", &["03/M01", "M03/M05", "13/11"]),
    ("a time, as in 291851Z", &["291851Z"]),
];
/// Words that end the report itself: what follows is a forecast.
const TRENDS: [&str; 9] = ["TEMPO", "BECMG", "NOSIG", "INTER", "PROB30", "PROB40", "FCST", "TREND", "TAF"];
/// Colour states of military aerodromes; several may be in one group.
const COLORS: [&str; 9] = ["BLU+", "BLU", "WHT", "GRN", "YLO1", "YLO2", "YLO", "AMB", "RED"];

/// A group and its place in the text, in bytes, and in characters from 1.
#[derive(Clone, Copy)]
struct Group<'a> {
    text: &'a str,
    byte: usize,
    at: usize,
    /// It is the first of its line.
    is_first: bool,
}

fn groups(text: &str) -> Vec<Group<'_>> {
    let mut found = Vec::new();
    let mut start = None;
    let (mut position, mut is_first) = (0, true);
    for (index, c) in text.char_indices() {
        position += 1;
        // The end of a report, in bulletins.
        let is_gap = c.is_whitespace() || c == '=';
        match (is_gap, start) {
            (true, Some((byte, at))) => {
                found.push(Group { text: &text[byte..index], byte, at, is_first });
                (start, is_first) = (None, false);
            }
            (false, None) => start = Some((index, position)),
            _ => {}
        }
        is_first |= c == '\n';
    }
    if let Some((byte, at)) = start {
        found.push(Group { text: &text[byte..], byte, at, is_first });
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

/// Returns true if a line begins a report: by its name, or by a station and a time.
pub(crate) fn begins(line: &str) -> bool {
    let mut words = line.split_whitespace();
    let (first, second) = (words.next().unwrap_or_default(), words.next().unwrap_or_default());
    let is_time = |word: &str| {
        let digits = word.strip_suffix('Z').unwrap_or_default();
        digits.len() >= 4 && digits.bytes().all(|b| b.is_ascii_digit())
    };
    // A TAF is told apart there.
    let is_named = ["METAR", "SPECI", "TAF"].iter().any(|name| first.eq_ignore_ascii_case(name));
    is_named || (is_station(first) && is_time(second))
}

/// Returns true for four capital letters or digits.
fn is_station(text: &str) -> bool {
    text.len() == 4 && text.bytes().all(|b| b.is_ascii_uppercase() || b.is_ascii_digit())
}

pub(super) fn parse(text: &str) -> Result<Metar, ReportError> {
    let all = groups(text);
    let mut rest = &all[..];
    let mut metar = Metar { has_weather: true, ..Metar::default() };
    for pair in all.windows(2).skip(1).filter(|pair| pair[0].is_first) {
        if pair[0].text != "TAF" && begins(&format!("{} {}", pair[0].text, pair[1].text)) {
            return Err(fault(pair[0], "begins a second report: one is expected"));
        }
    }
    if let Some((first, others)) = rest.split_first()
        && matches!(first.text, "METAR" | "SPECI")
    {
        rest = others;
        if first.text == "SPECI" {
            metar.kind = MetarKind::Speci;
        }
    }
    let rest = metar.take_marks(rest);
    let whole = |problem: &str| ReportError::Whole { file: "METAR".into(), problem: problem.into() };
    let Some((station, others)) = rest.split_first() else {
        return Err(whole("ends before the station: a report begins as in METAR KJFK 291851Z"));
    };
    if station.text == "TAF" {
        return Err(fault(*station, "begins a forecast, which is not read: give a METAR or SPECI"));
    }
    if !is_station(station.text) || !station.text.starts_with(|c: char| c.is_ascii_uppercase()) {
        let problem = "is no station: four capital letters or digits are expected, as in KJFK";
        return Err(fault(*station, problem));
    }
    metar.station = station.text.into();
    let mut rest = metar.take_marks(others);
    if let Some((group, others)) = rest.split_first()
        && group.text.ends_with('Z')
    {
        metar.time = Some(time(*group)?);
        rest = others;
    }
    if rest.is_empty() {
        return Err(whole("has no groups after the station and the time"));
    }
    let mut reader = Reader { metar, is_past: false };
    while let Some((group, others)) = rest.split_first() {
        let taken = reader.take(*group, others, text)?;
        rest = others.get(taken..).unwrap_or_default();
    }
    Ok(reader.metar)
}

/// Returns true for words on how a report was made.
fn is_mark(text: &str) -> bool {
    let is_version = text.len() == 3 && text.starts_with("CC") && text.as_bytes()[2].is_ascii_uppercase();
    matches!(text, "AUTO" | "COR" | "RTD") || is_version
}

/// Returns true for the beginning of a forecast: `TEMPO`, `FM1830`, `AT1200`.
fn is_trend(text: &str, next: Option<&Group<'_>>) -> bool {
    let is_hour = |text: &str| is_digits(text, 4) || is_digits(text, 6);
    let time = ["FM", "AT", "TL"].iter().find_map(|word| text.strip_prefix(word));
    TRENDS.contains(&text)
        || time.is_some_and(|time| {
            is_hour(time.trim_end_matches('Z'))
                || (time.is_empty() && next.is_some_and(|next| is_hour(next.text)))
        })
}

/// Returns true for colour states, also several in one: `BLU`, `BLACKAMB`, `BLU+BLU+`.
fn is_color(text: &str) -> bool {
    let mut rest = text.trim_start_matches("BLACK");
    let is_black = rest.is_empty();
    while let Some(color) = COLORS.iter().find(|color| rest.starts_with(**color)) {
        rest = rest[color.len()..].trim_start_matches('/');
    }
    rest.is_empty() && !is_black && !text.is_empty() || text == "BLACK"
}

/// Returns true for the state of a runway without its `R`: `31CLRD80`, `3609//70`, `24290050`.
fn is_runway_state(text: &str) -> bool {
    let bytes = text.as_bytes();
    let is_state = |b: &u8| b.is_ascii_digit() || *b == b'/';
    bytes.len() == 8
        && bytes[..2].iter().all(u8::is_ascii_digit)
        && (text[2..].starts_with("CLRD") || bytes[2..].iter().all(is_state))
}

impl Metar {
    /// Reads the words on how a report was made at the beginning of some groups; returns the
    /// others.
    fn take_marks<'a>(&mut self, mut groups: &'a [Group<'a>]) -> &'a [Group<'a>] {
        while let Some((first, others)) = groups.split_first()
            && is_mark(first.text)
        {
            self.mark(first.text);
            groups = others;
        }
        groups
    }

    fn mark(&mut self, text: &str) {
        self.is_automatic |= text == "AUTO";
        self.is_correction |= !matches!(text, "AUTO" | "RTD");
    }
}

/// A report while it is read.
struct Reader {
    metar: Metar,
    /// The pressure was read, which ends the report itself.
    is_past: bool,
}

impl Reader {
    /// Notes a group and the `taken` groups after it as ignored.
    fn ignore(
        &mut self,
        group: Group<'_>,
        others: &[Group<'_>],
        taken: usize,
        reason: &'static str,
    ) -> usize {
        let parts = std::iter::once(&group).chain(others.iter().take(taken)).map(|group| group.text);
        self.metar.ignored.push(IgnoredGroup { text: parts.collect::<Vec<_>>().join(" "), reason });
        taken
    }

    /// Notes all groups up to the remarks or to a forecast.
    fn ignore_words(&mut self, group: Group<'_>, others: &[Group<'_>]) -> usize {
        let ends = |at: usize| is_remark(others[at].text) || is_trend(others[at].text, others.get(at + 1));
        let taken = (0..others.len()).find(|at| ends(*at)).unwrap_or(others.len());
        self.ignore(group, others, taken, "words after the report")
    }

    /// Reads a group; returns the number of groups after it that belong to it.
    fn take(&mut self, group: Group<'_>, others: &[Group<'_>], all: &str) -> Result<usize, ReportError> {
        let text = group.text;
        let next = others.first();
        Ok(match text {
            _ if is_mark(text) => {
                self.metar.mark(text);
                0
            }
            "METAR" | "SPECI" if next.is_some() => {
                return Err(fault(group, "begins a second report: one is expected"));
            }
            "METAR" | "SPECI" => self.ignore(group, others, 0, "no report follows"),
            "NIL" => return Err(fault(group, "says that the report is missing: there is no weather in it")),
            "CAVOK" => {
                self.metar.is_cavok = true;
                let bound = VisibilityBound::OrMore;
                self.see(MetarVisibility { metres: 10_000.0, bound, direction: None });
                0
            }
            _ if is_remark(text) => {
                // As it stands, from the next group to the end.
                let remarks = next.map_or("", |next| &all[next.byte..]);
                self.metar.remarks = remarks.trim_end_matches(['=', '\n', '\r', ' ']).into();
                others.len()
            }
            "WS" => {
                let is_part = |text: &str| {
                    matches!(text, "ALL" | "RWY" | "TKOF" | "LDG")
                        || text.starts_with("RWY")
                        || runway(text).is_some()
                };
                match others.iter().take_while(|group| is_part(group.text)).count() {
                    0 => self.ignore_words(group, others),
                    taken => self.ignore(group, others, taken, "a weather has no wind shear"),
                }
            }
            "$" | "NSW" | "SNOCLO" | "R/SNOCLO" => self.ignore(group, others, 0, "no part of a weather"),
            // The sky is hidden, and by what and how much is not told.
            "SKY" => {
                let is_word =
                    |group: &&Group<'_>| matches!(group.text, "OBS" | "OBSC" | "OBSCURED" | "INVISIBLE");
                let taken = usize::from(next.filter(is_word).is_some());
                self.ignore(group, others, taken, "no share of clouds")
            }
            "OBS" | "OBSC" | "OBSCURED" => self.ignore(group, others, 0, "no share of clouds"),
            // Not measured: visibility, weather, temperature.
            "M" => 0,
            _ if is_strokes(text) && text.len() != 6 => {
                self.metar.has_weather &= text.len() != 2;
                0
            }
            _ if ["SM", "NDV", "KM", "RE"].iter().any(|unit| is_strokes(&text.replacen(unit, "", 1))) => 0,
            // Outside of the remarks, where they belong, in bulletins of some services.
            _ if text.starts_with("SLP") && text.len() == 6 => {
                self.ignore(group, others, 0, "a pressure of the remarks")
            }
            _ if text.starts_with("RF") && text.contains(['.', '/']) => {
                self.ignore(group, others, 0, "rain so far, in Australia")
            }
            _ if ["QNH", "QFE", "QFF", "QNE"].iter().any(|name| text.starts_with(name)) => {
                self.is_past = true;
                self.ignore(group, others, 0, "a pressure")
            }
            _ if is_trend(text, next) => {
                let taken = others.iter().take_while(|group| !is_remark(group.text)).count();
                self.ignore(group, others, taken, "a forecast, not what is there")
            }
            _ if is_color(text) => {
                self.is_past = true;
                self.ignore(group, others, 0, "the colour state of an aerodrome")
            }
            _ => match self.value(group, others) {
                // After the pressure or the temperature the report has all that it must have.
                Err(_) if self.is_past || self.metar.temperature.is_some() => {
                    self.ignore_words(group, others)
                }
                taken => return taken,
            },
        })
    }

    fn value(&mut self, group: Group<'_>, others: &[Group<'_>]) -> Result<usize, ReportError> {
        let text = group.text;
        let next = others.first().map(|next| next.text);
        if ["KT", "KTS", "MPS", "KMH"].iter().any(|unit| text.ends_with(unit)) {
            let read = wind(text).ok_or_else(|| damaged(group, 0))?;
            match self.metar.wind {
                None => self.metar.wind = Some(read),
                Some(_) if self.is_past => return Ok(self.ignore_words(group, others)),
                Some(_) => return Ok(self.ignore(group, others, 0, "a second wind")),
            }
        } else if text.len() == 7
            && text.as_bytes()[3] == b'V'
            && text.bytes().filter(u8::is_ascii_digit).count() == 6
        {
            let between = [&text[..3], &text[4..]].map(|part| part.parse::<f64>().unwrap_or(f64::NAN));
            if !between.iter().all(|degrees| (0.0..=360.0).contains(degrees)) {
                return Err(fault(group, "is damaged: a varying wind is 180V240, in degrees up to 360"));
            }
            let Some(wind) = &mut self.metar.wind else {
                return Err(fault(group, "says how the wind varies, and no wind comes before it"));
            };
            wind.between = Some(between);
        } else if text.ends_with("SM") {
            let metres = miles(text, 0.0).ok_or_else(|| damaged(group, 1))?;
            self.see(metres);
        } else if (is_digits(text, 1) || is_digits(text, 2)) && next.is_some_and(|next| next.ends_with("SM"))
        {
            let whole = text.parse::<f64>().unwrap_or_default();
            let metres = miles(others[0].text, whole).ok_or_else(|| damaged(others[0], 1))?;
            self.see(metres);
            return Ok(1);
        } else if let Some(seen) = metres(text) {
            if self.metar.temperature.is_some() {
                return Ok(self.ignore(group, others, 0, "no visibility: it comes after the temperature"));
            }
            self.see(seen);
        } else if text.len() > 3 && text.starts_with('R') && matches!(text.as_bytes()[1], b'0'..=b'9' | b'/')
        {
            match runway_range(text) {
                Some((runway, Some(metres))) => {
                    self.metar.runway_ranges.push(RunwayRange { runway, metres });
                }
                Some((_, None)) => return Ok(self.ignore(group, others, 0, "the state of a runway")),
                None => return Ok(self.ignore(group, others, 0, "damaged, of a runway")),
            }
        } else if is_runway_state(text) {
            return Ok(self.ignore(group, others, 0, "the state of a runway"));
        } else if let Some(cloud) = clouds(text) {
            let cloud = cloud.map_err(|()| damaged(group, 2))?;
            if self.is_past && (self.metar.is_cavok || !self.metar.clouds.is_empty()) {
                return Ok(self.ignore_words(group, others));
            }
            self.metar.clouds.push(cloud);
        } else if text.starts_with("CB") || text.starts_with("TCU") {
            // Positions of the clouds, in words.
            return Ok(match self.metar.temperature {
                Some(_) => self.ignore_words(group, others),
                None => self.ignore(group, others, 0, "no share of clouds"),
            });
        } else if text.starts_with(['Q', 'A'])
            && text[1..].starts_with(|c: char| c.is_ascii_digit() || c == '/')
        {
            self.is_past = true;
            // Typed apart: `Q10 13`.
            let joined = next.map(|next| format!("{text}{next}")).filter(|_| pressure(text).is_none());
            match (pressure(text), joined.as_deref().and_then(pressure)) {
                (Some(read), _) => self.metar.pressure = read.or(self.metar.pressure),
                (None, Some(read)) => {
                    self.metar.pressure = read;
                    return Ok(1);
                }
                (None, None) => {
                    return Ok(self.ignore(group, others, 0, "a damaged pressure, which no weather has"));
                }
            }
        } else if text.starts_with('W') && (text.contains("/S") || text.contains("/H")) {
            return Ok(self.ignore(group, others, 0, "the state of the sea"));
        } else if text.contains('/') {
            let degrees = degrees(text).ok_or_else(|| damaged(group, 3))?;
            if !degrees.iter().flatten().all(|t| (-90.0..=60.0).contains(t)) {
                let problem = "is no temperature of the air: -90 to 60 degrees Celsius are expected";
                return Err(fault(group, problem));
            }
            if self.metar.temperature.is_some() {
                return Ok(self.ignore(group, others, 0, "a further temperature"));
            }
            [self.metar.temperature, self.metar.dew_point] = degrees;
        } else if let Some(recent) = text.strip_prefix("RE").filter(|rest| rest.len() >= 2) {
            self.metar.recent.push(weather(recent).ok_or_else(|| unknown(group))?);
        } else if text == "VC" {
            // Typed apart: `VC SH`.
            let near = next.and_then(|next| weather(&format!("VC{next}"))).ok_or_else(|| unknown(group))?;
            self.metar.weather.push(near);
            return Ok(1);
        } else {
            let weather = weather(text).ok_or_else(|| unknown(group))?;
            if self.is_past {
                return Ok(self.ignore_words(group, others));
            }
            self.metar.weather.push(weather);
        }
        Ok(0)
    }

    fn see(&mut self, seen: MetarVisibility) {
        let metar = &mut self.metar;
        if metar.visibility.is_none() {
            metar.visibility = Some(seen);
        } else if metar.minimum_visibility.is_none() && !self.is_past {
            metar.minimum_visibility = Some(seen);
        } else {
            let text = format!("{} m {}", seen.metres, seen.direction.unwrap_or_default());
            metar.ignored.push(IgnoredGroup { text: text.trim().into(), reason: "a further visibility" });
        }
    }
}

/// Returns true for the word that begins the remarks.
fn is_remark(text: &str) -> bool {
    matches!(text, "RMK" | "RMKS" | "REMARK" | "REMARKS")
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
    if !is_digits(text, 6) {
        return Err(damaged(group, 4));
    }
    let part = |from: usize| text[from..from + 2].parse().unwrap_or(99);
    let time = MetarTime { day: part(0), hour: part(2), minute: part(4) };
    if !(1..=31).contains(&time.day) || time.hour > 23 || time.minute > 59 {
        let problem = "is no time: day of the month, hour and minute are expected, as in 291851Z";
        return Err(fault(group, problem));
    }
    Ok(time)
}
