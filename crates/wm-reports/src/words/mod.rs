//! Weather in plain words: `heavy rain, wind 40 km/h from the west, visibility 300 m, -2 C`.
//!
//! Commas, `and` and `with` part what is said. A word that is not known is an error with the
//! nearest one: nothing is understood by guessing. Words for strength have rates of their own,
//! which are marked as guesses.

mod tokens;
mod units;
mod vocabulary;

use crate::conditions::{
    Carrier, Conditions, DRIZZLE_RATES_MM_H, FLASHES_PER_MINUTE, HAIL_RATES_MM_H, RAIN_RATES_MM_H,
    SHOWER_RATES_MM_H, SNOW_RATES_MM_H, STORM_DISTANCE_M, SnowRate, Sun,
};
use crate::draft::{Basis, Datum, Draft, WrittenWeather};
use crate::error::{ReportError, meant};
use tokens::{Token, clauses, fault};
use units::{Quantity, unit};
use vocabulary::{CALM_WORDS, Daytime, Falling, Meaning, WORDS, compass, meaning};

/// Weather in words, in SI units and degrees Celsius. `None` is not stated.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct WordsReport {
    /// Rain, mm/h.
    pub rain: Option<f64>,
    /// True if snow falls; its rate follows from the visibility if one is stated.
    pub snows: bool,
    /// Hail, mm/h of water.
    pub hail: Option<f64>,
    /// Visibility, m.
    pub visibility: Option<f64>,
    /// Wind, m/s.
    pub wind_speed: Option<f64>,
    /// Direction that the wind comes from, degrees.
    pub wind_from: Option<f64>,
    /// Cloud cover, 0-1.
    pub clouds: Option<f64>,
    /// Temperature, degrees Celsius.
    pub temperature: Option<f64>,
    /// Depth of lying snow, m.
    pub snow_depth: Option<f64>,
}

/// Speeds of light, moderate, strong and violent winds.
const WIND_SPEEDS_M_S: [f64; 4] = [3.0, 7.0, 14.0, 25.0];

pub(crate) fn read(text: &str) -> Result<(WordsReport, WrittenWeather), ReportError> {
    let clauses = clauses(text);
    if clauses.is_empty() {
        let problem = "nothing is said: words as in \"heavy rain, wind 40 km/h from the west\" are expected";
        return Err(ReportError::Whole { file: "words".into(), problem: problem.into() });
    }
    let mut reader = Reader::default();
    for clause in &clauses {
        reader.clause(clause)?;
    }
    let now = reader.finish();
    let line = text.split_whitespace().collect::<Vec<_>>().join(" ");
    let mut draft = Draft::new(&line, &now.summary(), vec![format!("In words: {line}")]);
    now.write(&mut draft);
    let value = |known: &Option<Datum>| known.as_ref().map(|known| known.value);
    let report = WordsReport {
        rain: value(&now.rain),
        snows: now.snow.is_some(),
        hail: value(&now.hail),
        visibility: value(&now.visibility),
        wind_speed: value(&now.wind.speed),
        wind_from: value(&now.wind.from),
        clouds: value(&now.clouds),
        temperature: value(&now.temperature),
        snow_depth: value(&now.snow_depth),
    };
    Ok((report, draft.finish()?))
}

#[derive(Default)]
struct Reader {
    now: Conditions,
    gust: Option<f64>,
    /// Usual visibility of a word such as fog, where none is stated.
    usual_visibility: Option<Datum>,
}

/// The subjects of a clause, found before its numbers are read.
struct Subject {
    sees: bool,
    snow: bool,
    rain: bool,
    hail: bool,
    air: bool,
    clouds: bool,
    humidity: bool,
    /// Snow lies and does not fall.
    lies: bool,
}

impl Subject {
    fn of(clause: &[Token]) -> Self {
        let has = |wanted: &dyn Fn(Meaning) -> bool| {
            clause.iter().filter_map(|token| meaning(&token.text)).any(wanted)
        };
        let snow = has(&|word| matches!(word, Meaning::Falls(Falling::Snow | Falling::Flurries)));
        let sees = has(&|word| word == Meaning::Visibility);
        let has_depth = has_number_of(Quantity::Length, clause);
        Self {
            sees,
            snow,
            rain: has(&|word| {
                matches!(word, Meaning::Falls(Falling::Rain | Falling::Showers | Falling::Drizzle))
            }),
            hail: has(&|word| matches!(word, Meaning::Falls(Falling::Hail))),
            air: has(&|word| matches!(word, Meaning::Air(..))),
            clouds: has(&|word| matches!(word, Meaning::Cloud(_))),
            humidity: has(&|word| word == Meaning::Humidity),
            lies: snow
                && !sees
                && (has_depth || has(&|word| matches!(word, Meaning::Lies | Meaning::Ground))),
        }
    }
}

/// Returns true if a clause has a number with a unit of a quantity.
fn has_number_of(quantity: Quantity, clause: &[Token]) -> bool {
    clause.windows(2).any(|pair| {
        pair[0].number.is_some() && unit(&pair[1].text).is_some_and(|(known, _)| known == quantity)
    })
}

impl Reader {
    fn clause(&mut self, clause: &[Token]) -> Result<(), ReportError> {
        let subject = Subject::of(clause);
        let mut strength: Option<(usize, &Token)> = None;
        let (mut is_freezing, mut is_shallow, mut is_gust, mut share, mut share_of) =
            (false, false, false, None, None);
        let mut index = 0;
        while let Some(token) = clause.get(index) {
            index += 1;
            let next = clause.get(index);
            if token.number.is_some() {
                let before = clause.get(index.wrapping_sub(2));
                index += self.number(token, &clause[index..], before, &subject, is_gust)?;
                continue;
            }
            let Some(word) = meaning(&token.text) else {
                if let Some((from, words)) = direction(&clause[index - 1..]) {
                    index += words.len() - 1;
                    let known = Datum::told(from, format!("from {}", words.join(" ")));
                    set(&mut self.now.wind.from, known, token)?;
                    continue;
                }
                return Err(unknown(token));
            };
            let taken = strength.map(|(strength, _)| strength);
            match word {
                Meaning::Filler | Meaning::Visibility | Meaning::Humidity | Meaning::Lies => {}
                Meaning::Very => {
                    let mut level = 2;
                    if let Some(Meaning::Strength(next)) = next.and_then(|next| meaning(&next.text)) {
                        // Light is lighter and not stronger; there is no step below.
                        level = if next == 0 { 0 } else { (next + 1).min(3) };
                        index += 1;
                    }
                    strength = Some((level, token));
                }
                Meaning::Strength(level) => strength = Some((level, token)),
                Meaning::Freezing => is_freezing = true,
                Meaning::Ground => {
                    is_shallow =
                        next.is_some_and(|next| matches!(meaning(&next.text), Some(Meaning::Air(..))));
                }
                Meaning::Share(value) => (share, share_of) = (Some(value), Some(token)),
                Meaning::No => {
                    self.none_of(next.and_then(|next| meaning(&next.text)), token)?;
                    index += 1;
                }
                Meaning::Falls(what) => {
                    (strength, share) = (None, None);
                    self.falls(what, taken, &token.text, &subject, clause);
                }
                Meaning::Air(carrier, usual) => {
                    strength = None;
                    self.air(carrier, usual, taken, &token.text, is_shallow);
                }
                Meaning::Thunder => {
                    strength = None;
                    self.thunder(taken.unwrap_or(1), &token.text);
                }
                Meaning::Cloud(usual) => {
                    strength = None;
                    self.cloud(usual, &mut share, &token.text);
                }
                Meaning::Wind(usual) => {
                    strength = None;
                    if !clause.iter().any(|token| token.number.is_some()) {
                        self.wind(usual, taken, &token.text);
                    }
                }
                Meaning::Gusts => {
                    strength = None;
                    is_gust = true;
                    guess_once(&mut self.now.wind.gusts, 0.35, format!("\"{}\"", token.text));
                }
                Meaning::From | Meaning::To => {
                    index += self.direction(word == Meaning::To, &clause[index..])?;
                }
                Meaning::Force => {}
                Meaning::Time(time) => {
                    self.time(time, token)?;
                    // Golden and blue hour.
                    if next.is_some_and(|next| next.text == "hour") {
                        index += 1;
                    }
                }
                Meaning::Wet => {
                    strength = None;
                    let wet = Datum::guess(0.6, format!("\"{}\"", token.text));
                    if token.text.starts_with("puddle") {
                        self.now.puddles = Some(wet.clone());
                    }
                    self.now.wetness = Some(wet);
                }
                Meaning::Warmth(degrees) => {
                    strength = None;
                    // Very warm and very cold are ten degrees from there.
                    let more = match taken {
                        Some(2..) if degrees > 10.0 => 10.0,
                        Some(2..) => -10.0,
                        _ => 0.0,
                    };
                    guess_once(&mut self.now.temperature, degrees + more, format!("\"{}\"", token.text));
                }
            }
        }
        if let Some((_, token)) = strength {
            let problem =
                "says how strong and not what: rain, snow, fog, wind and the like are expected after it";
            return Err(fault(token, problem));
        }
        if let (Some(_), Some(token)) = (share, share_of) {
            return Err(fault(token, "says how much and not of what: cloudy or clear is expected after it"));
        }
        if is_freezing {
            guess_once(&mut self.now.temperature, -2.0, "\"freezing\"");
        }
        Ok(())
    }

    /// Reads what `no`, the token, is said of.
    fn none_of(&mut self, word: Option<Meaning>, token: &Token) -> Result<(), ReportError> {
        match word {
            Some(Meaning::Wind(_)) => set(&mut self.now.wind.speed, Datum::told(0.0, "no wind"), token)?,
            Some(Meaning::Cloud(_)) => self.now.clouds = Some(Datum::told(0.0, "no clouds")),
            Some(Meaning::Falls(_) | Meaning::Air(..) | Meaning::Thunder | Meaning::Gusts) => {}
            _ => {
                let problem =
                    "says that there is none of what: rain, wind, fog and the like are expected after it";
                return Err(fault(token, problem));
            }
        }
        Ok(())
    }

    fn thunder(&mut self, level: usize, word: &str) {
        let flashes = Datum::guess(FLASHES_PER_MINUTE[level], format!("{word}: flashes a minute"));
        self.now.lightning = Some((flashes, STORM_DISTANCE_M));
        if word == "thunderstorm" {
            guess_once(&mut self.now.rain, SHOWER_RATES_MM_H[level], "thunderstorm: a shower of rain");
        }
    }

    /// Sets the cover of clouds to the share that was said before the word, or to the usual one.
    fn cloud(&mut self, usual: f64, share: &mut Option<f64>, word: &str) {
        if self.now.clouds.is_none() || usual > 0.0 || share.is_some() {
            // Mostly clear is hardly cloudy.
            let of_words = share.take().map(|share| if usual > 0.0 { share } else { 1.0 - share });
            self.now.clouds = Some(Datum::told(of_words.unwrap_or(usual), format!("\"{word}\"")));
        }
        if word == "sunny" && self.now.sun == Sun::Auto {
            self.now.sun = sun(Daytime::Day, word);
        }
    }

    /// Sets the speed of a wind without a number, unless it is known.
    fn wind(&mut self, usual: f64, strength: Option<usize>, word: &str) {
        let has_levels = word.starts_with("wind") && word != "windy" || word.starts_with("breez");
        let value = strength.filter(|_| has_levels).map_or(usual, |level| WIND_SPEEDS_M_S[level]);
        let basis = if CALM_WORDS.contains(&word) {
            Basis::told(word)
        } else {
            Basis::guess(format!("\"{word}\", m/s"))
        };
        self.now.wind.speed.get_or_insert(Datum { value, basis });
    }

    fn time(&mut self, time: Daytime, token: &Token) -> Result<(), ReportError> {
        if self.now.sun != Sun::Auto {
            if time == Daytime::Day {
                return Ok(());
            }
            let is_day = matches!(&self.now.sun, Sun::At { basis, .. } if basis.text().contains("sunny"));
            if !is_day && token.text != "hour" {
                return Err(fault(token, "is a second time of day: one is expected"));
            }
        }
        self.now.sun = sun(time, &token.text);
        Ok(())
    }

    fn falls(
        &mut self,
        what: Falling,
        strength: Option<usize>,
        word: &str,
        subject: &Subject,
        clause: &[Token],
    ) {
        let level = strength.unwrap_or(1);
        let has_rate = has_number_of(Quantity::Rate, clause);
        let why = with_strength(strength, ["light", "moderate", "heavy", "violent"], word);
        let now = &mut self.now;
        let mut snow = |level: usize| {
            let (range, usual) = SNOW_RATES_MM_H[level];
            if now.snow.is_none() {
                now.snow = Some(SnowRate::ByVisibility { range, usual, text: why.clone() });
            }
        };
        let rate = |rate: f64| Some(Datum::guess(rate, format!("{why}, mm/h")));
        match what {
            Falling::Snow if subject.lies => {
                guess_once(&mut now.snow_depth, 0.1, format!("\"{word}\" that lies"));
            }
            Falling::Snow if !has_rate => snow(level),
            Falling::Flurries => snow(strength.unwrap_or(0)),
            Falling::Blizzard => {
                snow(strength.unwrap_or(2));
                guess_once(&mut now.wind.speed, 14.0, format!("\"{word}\""));
                guess_once(&mut self.usual_visibility, 200.0, format!("\"{word}\""));
            }
            Falling::Sleet => {
                snow(level.min(1).saturating_sub(usize::from(strength.is_none())));
                now.rain = rate(0.5 * RAIN_RATES_MM_H[level]);
                guess_once(&mut now.temperature, 1.0, format!("\"{word}\""));
            }
            Falling::Rain if !has_rate => now.rain = rate(RAIN_RATES_MM_H[level]),
            Falling::Showers if subject.snow => {}
            Falling::Showers if !has_rate => now.rain = rate(SHOWER_RATES_MM_H[level]),
            Falling::Cloudburst => now.rain = rate(SHOWER_RATES_MM_H[strength.unwrap_or(2)]),
            Falling::Drizzle if !has_rate => now.rain = rate(DRIZZLE_RATES_MM_H[level]),
            Falling::Hail if !has_rate => now.hail = rate(HAIL_RATES_MM_H[level]),
            Falling::Snow | Falling::Rain | Falling::Showers | Falling::Drizzle | Falling::Hail => {}
        }
    }

    fn air(
        &mut self,
        carrier: Carrier,
        usual: &[f64; 4],
        strength: Option<usize>,
        word: &str,
        is_shallow: bool,
    ) {
        if is_shallow {
            self.now.shallow_fog = Some(Basis::told(format!("ground {word}")));
            return;
        }
        self.now.carrier = Some((carrier, Basis::told(format!("\"{word}\""))));
        if self.usual_visibility.is_none() {
            let why = with_strength(strength, ["light", "moderate", "dense", "very dense"], word);
            self.usual_visibility = Some(Datum::guess(usual[strength.unwrap_or(1)], why));
        }
        if word.ends_with("storm") {
            guess_once(&mut self.now.wind.speed, 16.0, format!("\"{word}\""));
        }
    }

    /// A direction after `from` or `to`; returns how many tokens it took.
    fn direction(&mut self, is_to: bool, rest: &[Token]) -> Result<usize, ReportError> {
        let skipped = rest.iter().take_while(|token| meaning(&token.text) == Some(Meaning::Filler)).count();
        let Some(token) = rest.get(skipped) else { return Ok(skipped) };
        let turned = |degrees: f64| if is_to { (degrees + 180.0).rem_euclid(360.0) } else { degrees };
        let word = if is_to { "to" } else { "from" };
        if let Some(degrees) = token.number {
            let unit = rest.get(skipped + 1).map(|unit| &unit.text[..]);
            // Another number: gusts to 60 km/h.
            if !matches!(unit, Some("degrees" | "degree" | "deg" | "\u{b0}")) {
                return Ok(skipped);
            }
            if !(0.0..=360.0).contains(&degrees) {
                return Err(fault(token, "is no direction: 0 to 360 degrees are expected"));
            }
            let known = Datum::told(turned(degrees), format!("{word} {degrees} degrees"));
            set(&mut self.now.wind.from, known, token)?;
            return Ok(skipped + 2);
        }
        let Some((degrees, words)) = direction(&rest[skipped..]) else { return Ok(skipped) };
        let known = Datum::told(turned(degrees), format!("{word} {}", words.join(" ")));
        set(&mut self.now.wind.from, known, token)?;
        Ok(skipped + words.len())
    }

    /// A number with its unit; returns how many tokens the unit took.
    fn number(
        &mut self,
        token: &Token,
        rest: &[Token],
        before: Option<&Token>,
        subject: &Subject,
        is_gust: bool,
    ) -> Result<usize, ReportError> {
        let value = token.number.unwrap_or(f64::NAN);
        let words =
            |count: usize| rest.iter().take(count).map(|token| &token.text[..]).collect::<Vec<_>>().join(" ");
        // "Force 6", and units of two or three words first: "degrees C", "km per hour".
        let is_force = before.is_some_and(|before| meaning(&before.text) == Some(Meaning::Force));
        let found = if is_force {
            unit("bft").map(|unit| (unit, 0))
        } else {
            [3, 2, 1]
                .into_iter()
                .filter(|count| rest.len() >= *count)
                .find_map(|count| Some((unit(&words(count))?, count)))
        };
        let Some(((quantity, scale), count)) = found else {
            let near =
                rest.first().map_or_else(String::new, |next| meant(&next.text, units::NAMES.iter().copied()));
            let units = "km/h, m/s, mph, kt, Bft, m, km, mi, ft, cm, C, F, mm/h or %";
            return Err(fault(token, format!("has no unit after it{near}: {units} is expected")));
        };
        let si = scale(value);
        let unit: Vec<&str> = rest.iter().take(count).map(|token| &token.raw[..]).collect();
        let text = format!("{} {}", token.raw, unit.join(" "));
        let within = |[least, most]: [f64; 2], what: &str| match si {
            _ if (least..=most).contains(&si) => Ok(()),
            _ => Err(fault(token, format!("is no {what}: {least} to {most} are expected"))),
        };
        let now = &mut self.now;
        match quantity {
            Quantity::Speed => {
                within([0.0, 120.0], "speed of the wind in m/s")?;
                if is_gust {
                    self.gust = Some(si);
                } else {
                    set(&mut now.wind.speed, Datum::told(si, text), token)?;
                }
            }
            Quantity::Length if subject.sees || (subject.air && !subject.lies) => {
                within([1.0, 1e6], "visibility in m")?;
                set(&mut now.visibility, Datum::told(si, text), token)?;
            }
            Quantity::Length if subject.snow => {
                within([0.0, 50.0], "depth of snow in m")?;
                now.snow_depth = Some(Datum::told(si, text));
            }
            Quantity::Length => {
                return Err(fault(token, "is a length of what: write visibility, fog or snow beside it"));
            }
            Quantity::Rate => {
                within([0.0, 2000.0], "rate in mm/h")?;
                let known = Datum::told(si, text);
                if subject.snow {
                    now.snow = Some(SnowRate::Told(known));
                } else if subject.hail {
                    now.hail = Some(known);
                } else if subject.rain {
                    now.rain = Some(known);
                } else {
                    return Err(fault(token, "is a rate of what: write rain, snow or hail beside it"));
                }
            }
            Quantity::Temperature => {
                within([-90.0, 60.0], "temperature of the air in degrees Celsius")?;
                set(&mut now.temperature, Datum::told(si, text), token)?;
            }
            Quantity::Percent => {
                within([0.0, 1.0], "share, of which there are 100 %")?;
                if subject.humidity {
                    now.humidity = Some(Datum::told(si, text));
                } else if subject.clouds {
                    now.clouds = Some(Datum::told(si, text));
                } else {
                    return Err(fault(token, "is a share of what: write humidity or clouds beside it"));
                }
            }
        }
        Ok(count)
    }

    fn finish(mut self) -> Conditions {
        if let (Some(gust), Some(speed)) = (self.gust, &self.now.wind.speed) {
            self.now.wind.gusts = Some(Datum::of_gusts(gust, speed.value));
        } else if let Some(gust) = self.gust {
            self.now.wind.speed =
                Some(Datum::guess(gust / 1.6, format!("gusts of {gust:.1} m/s and no mean")));
        }
        if self.now.visibility.is_none() {
            self.now.visibility = self.usual_visibility.take();
        }
        self.now
    }
}

/// A direction at the beginning of some tokens, degrees, and its words: `north`, `north east`.
fn direction(tokens: &[Token]) -> Option<(f64, Vec<&str>)> {
    if let [first, second, ..] = tokens
        && let Some(degrees) = compass(&format!("{}{}", first.text, second.text))
    {
        return Some((degrees, vec![&first.raw, &second.raw]));
    }
    let first = tokens.first()?;
    Some((compass(&first.text)?, vec![&first.raw]))
}

/// A word in quotation marks, with that for its strength.
fn with_strength(strength: Option<usize>, levels: [&str; 4], word: &str) -> String {
    strength.map_or_else(|| format!("\"{word}\""), |level| format!("\"{} {word}\"", levels[level]))
}

/// Sets what may be stated once; a guess gives way.
fn set(place: &mut Option<Datum>, known: Datum, token: &Token) -> Result<(), ReportError> {
    if matches!(place, Some(Datum { basis: Basis::Told(_), .. })) {
        return Err(fault(token, "is told a second time: one value is expected"));
    }
    *place = Some(known);
    Ok(())
}

/// Sets what is not known yet to a guess.
fn guess_once(place: &mut Option<Datum>, value: f64, text: impl Into<String>) {
    place.get_or_insert_with(|| Datum::guess(value, text));
}

fn sun(time: Daytime, word: &str) -> Sun {
    let basis = Basis::guess(format!("\"{word}\""));
    match time.sun() {
        None => Sun::Night(Basis::told(format!("\"{word}\""))),
        Some((elevation, azimuth, turbidity)) => Sun::At { elevation, azimuth, turbidity, basis },
    }
}

fn unknown(token: &Token) -> ReportError {
    let known = WORDS.iter().flat_map(|(words, _)| words.split(' '));
    let known = known.chain(vocabulary::COMPASS.iter().copied()).chain(units::NAMES.iter().copied());
    let near = meant(&token.text, known);
    fault(
        token,
        format!("is no word for weather that is known here{near}; see docs/guide/weather-reports.md"),
    )
}

#[cfg(test)]
mod tests;
