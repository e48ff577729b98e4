//! The weathers of a plan: lists, grids, instants of one weather, and samples of distributions with
//! rules.

use super::distribution::Distribution;
use super::hypercube::LatinHypercube;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::Path;
use toml::Value;
use wm_scene::nearest;
use wm_scene::random::bits;
use wm_weather::{EFFECTS, Weather};

/// The variables and rules of samples that give none of their own.
const NATURAL: &str = include_str!("natural.toml");
/// Most weathers of one entry.
const MOST: u64 = 1_000_000_000;
/// Seeds are whole numbers that a float holds.
const SEEDS: u64 = 1 << 53;

/// Entry `[[weather]]` of a plan, as it is written.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WeatherEntry {
    /// Presets, weather files and reports.
    #[serde(default)]
    from: Vec<String>,
    /// The weather that a grid or samples change.
    base: Option<String>,
    /// Number of samples for each path.
    samples: Option<u64>,
    #[serde(default)]
    grid: BTreeMap<String, Vec<Value>>,
    #[serde(default)]
    vary: BTreeMap<String, SpreadEntry>,
    #[serde(default)]
    rules: Vec<RuleEntry>,
    /// Parameters that take the value of a variable, if their effect is on.
    #[serde(default)]
    copy: BTreeMap<String, Vec<String>>,
    /// Parameters that all of its weathers have.
    #[serde(default)]
    set: BTreeMap<String, Value>,
    /// Times of the weather at which clips begin, s.
    #[serde(default)]
    at: Vec<f64>,
}

/// A distribution, as it is written.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct SpreadEntry {
    distribution: String,
    min: Option<f64>,
    max: Option<f64>,
    mean: Option<f64>,
    median: Option<f64>,
    deviation: Option<f64>,
    shape: Option<f64>,
    scale: Option<f64>,
    values: Option<Vec<Value>>,
    chance: Option<f64>,
}

#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct RuleEntry {
    when: String,
    #[serde(default)]
    off: Vec<String>,
    #[serde(default)]
    set: BTreeMap<String, Value>,
}

/// A variable of samples.
#[derive(Clone, Debug)]
struct Variable {
    /// `effect.parameter`, or a name of its own.
    name: String,
    values: VariableValues,
    /// The share of the samples that have it.
    chance: f64,
}

#[derive(Clone, Debug)]
enum VariableValues {
    Numbers(Distribution),
    OneOf(Vec<Value>),
}

#[derive(Clone, Debug)]
struct Rule {
    when: Vec<Condition>,
    off: Vec<String>,
    set: Vec<(String, Value)>,
}

/// A condition of a rule.
#[derive(Clone, Debug, PartialEq)]
enum Condition {
    /// An effect is on, or is not.
    Effect(String, bool),
    /// A variable or a parameter against a number.
    Compare(String, Comparison, f64),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Comparison {
    Below,
    AtMost,
    Above,
    AtLeast,
}

/// The weathers of one entry.
#[derive(Clone, Debug)]
pub struct WeatherSource {
    kind: SourceKind,
    set: Vec<(String, Value)>,
    at: Vec<f64>,
}

#[derive(Clone, Debug)]
enum SourceKind {
    List(Vec<Weather>),
    Grid {
        base: Weather,
        axes: Vec<(String, Vec<Value>)>,
    },
    Samples {
        base: Weather,
        count: u64,
        variables: Vec<Variable>,
        rules: Vec<Rule>,
        copy: Vec<CopiedVariable>,
    },
}

/// The place of one sample among all of its entry.
#[derive(Clone, Copy, Debug)]
pub struct SamplePlace {
    /// The seed of the plan.
    pub seed: u64,
    /// Its number among all samples of the entry.
    pub index: u64,
    /// The number of them.
    pub count: u64,
}

/// A weather of a plan.
#[derive(Clone, Debug)]
pub struct PlannedWeather {
    /// The weather.
    pub weather: Weather,
    /// The time of the weather at which the clip begins, s.
    pub at: f64,
    /// The values of variables, by name.
    pub variables: BTreeMap<String, f64>,
}

/// A variable and the parameters that take its value.
type CopiedVariable = (String, Vec<String>);

/// A value, or the key and the problem.
pub type KeyedResult<T> = Result<T, (String, String)>;

/// Finds a preset, or a file beside the plan.
pub type FindWeather<'a> = &'a dyn Fn(&str, &Path) -> Result<Weather, String>;

impl WeatherEntry {
    /// Checks an entry; `folder` is that of the plan.
    ///
    /// # Errors
    /// The key and the problem.
    pub fn source(&self, folder: &Path, find: FindWeather<'_>) -> KeyedResult<WeatherSource> {
        let fault = |key: &str, says: String| (key.to_string(), says);
        let ways = [!self.from.is_empty(), !self.grid.is_empty(), self.samples.is_some()];
        if ways.iter().filter(|is_given| **is_given).count() != 1 {
            return Err(fault("weather", "give one of from, grid and samples".into()));
        }
        if let Some(bad) = self.at.iter().find(|time| !time.is_finite() || time.abs() > 1e9) {
            return Err(fault("at", format!("{bad} is no time in seconds")));
        }
        let base = |name: &Option<String>| match name {
            // As all presets have it.
            None => Weather::clear().set("light", "auto").map_err(|error| fault("base", error.to_string())),
            Some(name) => find(name, folder).map_err(|says| fault("base", says)),
        };
        let kind = if !self.from.is_empty() {
            for (key, is_given) in [
                ("base", self.base.is_some()),
                ("vary", !self.vary.is_empty()),
                ("rules", !self.rules.is_empty()),
                ("copy", !self.copy.is_empty()),
            ] {
                if is_given {
                    return Err(fault(key, "is for grid and samples: leave it out beside from".into()));
                }
            }
            let found = self.from.iter().map(|name| find(name, folder).map_err(|says| fault("from", says)));
            SourceKind::List(found.collect::<Result<_, _>>()?)
        } else if !self.grid.is_empty() {
            let count =
                self.grid.values().try_fold(1u64, |count, values| count.checked_mul(values.len() as u64));
            if count.is_none_or(|count| count == 0 || count > MOST) {
                return Err(fault("grid", format!("each key needs values, and all together at most {MOST}")));
            }
            let axes = self.grid.iter().map(|(key, values)| (key.clone(), values.clone())).collect();
            SourceKind::Grid { base: base(&self.base)?, axes }
        } else {
            self.samples(&base)?
        };
        let set = self.set.iter().map(|(key, value)| (key.clone(), value.clone())).collect();
        let at = if self.at.is_empty() { vec![0.0] } else { self.at.clone() };
        let source = WeatherSource { kind, set, at };
        source.check()?;
        Ok(source)
    }

    fn samples(&self, base: &dyn Fn(&Option<String>) -> KeyedResult<Weather>) -> KeyedResult<SourceKind> {
        let count = self.samples.unwrap_or_default();
        if count == 0 || count > MOST {
            return Err(("samples".into(), format!("is {count}: it must be from 1 to {MOST}")));
        }
        let natural: Self;
        let own = if self.vary.is_empty() {
            // A file of the program: a fault in it is found by the tests.
            natural = toml::from_str(NATURAL).map_err(|error| ("samples".to_string(), error.to_string()))?;
            &natural
        } else {
            self
        };
        let weather = base(&self.base)?;
        let variables: Vec<Variable> = own
            .vary
            .iter()
            .map(|(name, entry)| entry.variable(name).map_err(|says| (format!("vary {name}"), says)))
            .collect::<Result<_, _>>()?;
        let known = |name: &str| variables.iter().any(|variable| variable.name == name);
        // The rules of the plan come after the natural ones.
        let entries = own.rules.iter().chain(self.rules.iter().filter(|_| self.vary.is_empty()));
        let rules: Vec<Rule> = entries
            .map(|entry| {
                entry.rule(&known).map_err(|says| (format!("rules, when = \"{}\"", entry.when), says))
            })
            .collect::<Result<_, _>>()?;
        let mut copy: Vec<CopiedVariable> =
            own.copy.iter().map(|(name, keys)| (name.clone(), keys.clone())).collect();
        if self.vary.is_empty() {
            copy.extend(self.copy.iter().map(|(name, keys)| (name.clone(), keys.clone())));
        }
        if let Some((name, _)) = copy.iter().find(|(name, _)| !known(name)) {
            return Err((format!("copy {name}"), unknown_variable(name, &variables)));
        }
        for variable in &variables {
            let name = &variable.name;
            let is_used = name.contains('.')
                || copy.iter().any(|(copied, _)| copied == name)
                || rules.iter().flat_map(|rule| &rule.when).any(
                    |condition| matches!(condition, Condition::Compare(compared, _, _) if compared == name),
                );
            if !is_used {
                let says = "nothing uses it: name a parameter, as in fog.mor, or use it in rules or copy";
                return Err((format!("vary {name}"), says.into()));
            }
        }
        Ok(SourceKind::Samples { base: weather, count, variables, rules, copy })
    }
}

/// Words that suggest the nearest name of a misspelt one; none where no name is near.
pub(super) fn meant<'a>(name: &str, known: impl Iterator<Item = &'a str>) -> String {
    nearest(name, known, 1).first().map_or_else(String::new, |near| format!(", did you mean `{near}`?"))
}

fn unknown_variable(name: &str, variables: &[Variable]) -> String {
    let known = variables.iter().map(|variable| variable.name.as_str());
    match nearest(name, known, 1).first() {
        Some(near) => format!("`{name}` is not varied, did you mean `{near}`?"),
        None => format!("`{name}` is not varied: give it in vary"),
    }
}

/// A weather with parameters changed.
fn changed<'a>(weather: Weather, set: impl Iterator<Item = (&'a String, &'a Value)>) -> KeyedResult<Weather> {
    let mut weather = weather;
    for (key, value) in set {
        weather = set_value(weather, key, value).map_err(|says| (key.clone(), says))?;
    }
    Ok(weather)
}

/// A weather with one parameter changed.
fn set_value(weather: Weather, key: &str, value: &Value) -> Result<Weather, String> {
    let text = match value {
        Value::String(text) => text.clone(),
        Value::Integer(number) => number.to_string(),
        Value::Float(number) => number.to_string(),
        other => return Err(format!("{other} is no value: give a number or a text")),
    };
    weather.set(key, text).map_err(|error| error.to_string())
}

impl SpreadEntry {
    fn variable(&self, name: &str) -> Result<Variable, String> {
        let chance = self.chance.unwrap_or(1.0);
        if !(0.0..=1.0).contains(&chance) {
            return Err(format!("chance is {chance}: it must be from 0 to 1"));
        }
        let need = |key: &str, value: Option<f64>| value.ok_or_else(|| format!("{key} is missing"));
        let (min, max) = (self.min, self.max);
        let (distribution, takes): (Option<Distribution>, &[&str]) = match self.distribution.as_str() {
            "uniform" => (
                Some(Distribution::Uniform { min: need("min", min)?, max: need("max", max)? }),
                &["min", "max"],
            ),
            "log-uniform" => (
                Some(Distribution::LogUniform { min: need("min", min)?, max: need("max", max)? }),
                &["min", "max"],
            ),
            "normal" => {
                let (mean, deviation) = (need("mean", self.mean)?, need("deviation", self.deviation)?);
                (
                    Some(Distribution::Normal { mean, deviation, min, max }),
                    &["mean", "deviation", "min", "max"],
                )
            }
            "log-normal" => {
                let (median, deviation) = (need("median", self.median)?, need("deviation", self.deviation)?);
                (
                    Some(Distribution::LogNormal { median, deviation, min, max }),
                    &["median", "deviation", "min", "max"],
                )
            }
            "weibull" => {
                let (shape, scale) = (need("shape", self.shape)?, need("scale", self.scale)?);
                (Some(Distribution::Weibull { shape, scale, min, max }), &["shape", "scale", "min", "max"])
            }
            "choice" => (None, &["values"]),
            other => {
                let names = ["uniform", "log-uniform", "normal", "log-normal", "weibull", "choice"];
                let near = meant(other, names.into_iter());
                return Err(format!(
                    "there is no distribution `{other}`{near}; there are {}",
                    names.join(", ")
                ));
            }
        };
        for (key, is_given) in [
            ("min", self.min.is_some()),
            ("max", self.max.is_some()),
            ("mean", self.mean.is_some()),
            ("median", self.median.is_some()),
            ("deviation", self.deviation.is_some()),
            ("shape", self.shape.is_some()),
            ("scale", self.scale.is_some()),
            ("values", self.values.is_some()),
        ] {
            if is_given && !takes.contains(&key) {
                return Err(format!(
                    "{key} is not of `{}`, which has {}",
                    self.distribution,
                    takes.join(", ")
                ));
            }
        }
        let values = match distribution {
            Some(distribution) => {
                distribution.check()?;
                VariableValues::Numbers(distribution)
            }
            None => match &self.values {
                Some(values) if !values.is_empty() => VariableValues::OneOf(values.clone()),
                _ => return Err("values are missing: a list of numbers or words".into()),
            },
        };
        Ok(Variable { name: name.into(), values, chance })
    }
}

impl RuleEntry {
    fn rule(&self, is_variable: &dyn Fn(&str) -> bool) -> Result<Rule, String> {
        let when = self.when.split(" and ").map(|text| Condition::parse(text.trim(), is_variable));
        let when = when.collect::<Result<Vec<_>, _>>()?;
        if self.off.is_empty() && self.set.is_empty() {
            return Err("it changes nothing: give off or set".into());
        }
        for effect in &self.off {
            is_effect(effect)?;
        }
        let set = self.set.iter().map(|(key, value)| (key.clone(), value.clone())).collect();
        Ok(Rule { when, off: self.off.clone(), set })
    }
}

/// Checks the name of an effect.
fn is_effect(name: &str) -> Result<(), String> {
    if EFFECTS.iter().any(|effect| effect.name == name) {
        return Ok(());
    }
    let near = meant(name, EFFECTS.iter().map(|effect| effect.name));
    Err(format!("there is no effect `{name}`{near}"))
}

impl Condition {
    fn parse(text: &str, is_variable: &dyn Fn(&str) -> bool) -> Result<Self, String> {
        for (sign, comparison) in [
            ("<=", Comparison::AtMost),
            (">=", Comparison::AtLeast),
            ("<", Comparison::Below),
            (">", Comparison::Above),
        ] {
            let Some((name, number)) = text.split_once(sign) else { continue };
            let name = name.trim();
            let number: f64 =
                number.trim().parse().map_err(|_| format!("`{}` is no number", number.trim()))?;
            if !is_variable(name) {
                let Some((effect, param)) = name.split_once('.') else {
                    return Err(format!("`{name}` is neither varied nor a parameter, as fog.mor is"));
                };
                is_effect(effect)?;
                let found = EFFECTS.iter().find(|one| one.name == effect);
                if found.and_then(|effect| effect.param(param)).is_none() {
                    return Err(format!("{effect} has no parameter `{param}`"));
                }
            }
            return Ok(Self::Compare(name.into(), comparison, number));
        }
        let (name, is_on) = match text.strip_prefix("not ") {
            Some(name) => (name.trim(), false),
            None => (text, true),
        };
        is_effect(name).map_err(|says| {
            format!("{says}; a condition is an effect, `not` and an effect, or a comparison")
        })?;
        Ok(Self::Effect(name.into(), is_on))
    }

    fn holds(&self, planned: &PlannedWeather) -> bool {
        match self {
            Self::Effect(name, is_on) => {
                planned.weather.effects().any(|(effect, _)| effect.name == name) == *is_on
            }
            Self::Compare(name, comparison, number) => {
                let value = planned.variables.get(name).copied().filter(|_| !name.contains('.'));
                let Some(value) = value.or_else(|| value_of(&planned.weather, name, planned.at)) else {
                    return false;
                };
                match comparison {
                    Comparison::Below => value < *number,
                    Comparison::AtMost => value <= *number,
                    Comparison::Above => value > *number,
                    Comparison::AtLeast => value >= *number,
                }
            }
        }
    }
}

/// A number of a weather at a time, if its effect is on and it is one.
pub fn value_of(weather: &Weather, key: &str, time: f64) -> Option<f64> {
    let (effect, param) = key.split_once('.')?;
    let sample = weather.at(time);
    sample.track(effect, param)?.at(time).number()
}

impl WeatherSource {
    /// The number of weathers for each path.
    #[must_use]
    pub fn count(&self) -> u64 {
        let weathers = match &self.kind {
            SourceKind::List(list) => list.len() as u64,
            SourceKind::Grid { axes, .. } => axes.iter().map(|(_, values)| values.len() as u64).product(),
            SourceKind::Samples { count, .. } => *count,
        };
        weathers * self.at.len() as u64
    }

    /// Returns true if every path has weathers of its own.
    #[must_use]
    pub fn is_sampled(&self) -> bool {
        matches!(self.kind, SourceKind::Samples { .. })
    }

    /// The number of weathers for each path, whatever the times of their beginning.
    #[must_use]
    pub fn times(&self) -> u64 {
        self.at.len() as u64
    }

    /// Checks that every value is one that its parameter takes.
    fn check(&self) -> KeyedResult<()> {
        match &self.kind {
            SourceKind::List(list) => {
                for weather in list {
                    changed(weather.clone(), self.set())
                        .map_err(|(key, says)| (format!("set {key}"), says))?;
                }
            }
            SourceKind::Grid { base, axes } => {
                changed(base.clone(), self.set()).map_err(|(key, says)| (format!("set {key}"), says))?;
                for (key, values) in axes {
                    for value in values {
                        set_value(base.clone(), key, value).map_err(|says| (format!("grid {key}"), says))?;
                    }
                }
            }
            SourceKind::Samples { base, variables, rules, copy, .. } => {
                changed(base.clone(), self.set()).map_err(|(key, says)| (format!("set {key}"), says))?;
                for variable in variables {
                    for value in variable.extremes() {
                        let keys =
                            copy.iter().filter(|(name, _)| *name == variable.name).flat_map(|(_, keys)| keys);
                        for key in keys.chain([&variable.name].into_iter().filter(|name| name.contains('.')))
                        {
                            set_value(base.clone(), key, &value)
                                .map_err(|says| (format!("vary {}", variable.name), says))?;
                        }
                    }
                }
                for rule in rules {
                    let set = rule.set.iter().map(|(key, value)| (key, value));
                    changed(base.clone(), set).map_err(|(key, says)| (format!("rules, set {key}"), says))?;
                }
            }
        }
        Ok(())
    }

    fn set(&self) -> impl Iterator<Item = (&String, &Value)> {
        self.set.iter().map(|(key, value)| (key, value))
    }

    /// Weather `number` of a path. Samples are those of `place`, others are the same for all paths.
    ///
    /// # Errors
    /// The key and the problem of a value that a parameter does not take together with others.
    pub fn weather(&self, number: u64, place: SamplePlace) -> KeyedResult<PlannedWeather> {
        let times = self.at.len() as u64;
        let (weather, at) = (number / times, self.at[(number % times) as usize]);
        let mut planned = PlannedWeather { weather: Weather::clear(), at, variables: BTreeMap::new() };
        match &self.kind {
            SourceKind::List(list) => {
                planned.weather = changed(list[weather as usize % list.len()].clone(), self.set())?;
            }
            SourceKind::Grid { base, axes } => {
                planned.weather = changed(base.clone(), self.set())?;
                let mut rest = weather;
                // The last key changes fastest.
                for (key, values) in axes.iter().rev() {
                    let value = &values[(rest % values.len() as u64) as usize];
                    rest /= values.len() as u64;
                    planned.weather = set_value(planned.weather, key, value)
                        .map_err(|says| (format!("grid {key}"), says))?;
                    if let Some(number) = number_of(value) {
                        planned.variables.insert(key.clone(), number);
                    }
                }
            }
            SourceKind::Samples { base, variables, rules, copy, .. } => {
                planned.weather = changed(base.clone(), self.set())?;
                self.sample(&mut planned, (variables, rules, copy), place)?;
            }
        }
        Ok(planned)
    }

    fn sample(
        &self,
        planned: &mut PlannedWeather,
        (variables, rules, copy): (&[Variable], &[Rule], &[CopiedVariable]),
        place: SamplePlace,
    ) -> KeyedResult<()> {
        let cube = LatinHypercube::new(place.seed, place.count);
        let set = |planned: &mut PlannedWeather, key: &str, value: &Value| -> KeyedResult<()> {
            let weather = std::mem::take(&mut planned.weather);
            planned.weather = set_value(weather, key, value).map_err(|says| (key.to_string(), says))?;
            Ok(())
        };
        for variable in variables {
            let Some(value) = variable.value(cube.at(place.index, &variable.name)) else { continue };
            if let Some(number) = number_of(&value) {
                planned.variables.insert(variable.name.clone(), number);
            }
            if variable.name.contains('.') {
                set(planned, &variable.name, &value)?;
            }
        }
        for rule in rules {
            if !rule.when.iter().all(|condition| condition.holds(planned)) {
                continue;
            }
            for effect in &rule.off {
                set(planned, effect, &Value::String("off".into()))?;
            }
            for (key, value) in &rule.set {
                set(planned, key, value)?;
            }
        }
        for (name, keys) in copy {
            let Some(number) = planned.variables.get(name).copied() else { continue };
            for key in keys {
                let effect = key.split('.').next().unwrap_or_default();
                if planned.weather.effects().any(|(on, _)| on.name == effect) {
                    set(planned, key, &Value::Float(number))?;
                }
            }
        }
        // What rules turned off has no value.
        let weather = &planned.weather;
        let at = planned.at;
        planned.variables.retain(|name, _| !name.contains('.') || value_of(weather, name, at).is_some());
        Ok(())
    }
}

fn number_of(value: &Value) -> Option<f64> {
    match value {
        Value::Float(number) => Some(*number),
        Value::Integer(number) => Some(*number as f64),
        _ => None,
    }
}

impl Variable {
    /// The value at a coordinate of the hypercube; `None` if the sample does not have it.
    fn value(&self, x: f64) -> Option<Value> {
        if x >= self.chance {
            return None;
        }
        let x = x / self.chance;
        Some(match &self.values {
            VariableValues::Numbers(distribution) => Value::Float(distribution.value(x)),
            VariableValues::OneOf(values) => {
                values[((x * values.len() as f64) as usize).min(values.len() - 1)].clone()
            }
        })
    }

    /// The values that its parameter must take.
    fn extremes(&self) -> Vec<Value> {
        match &self.values {
            VariableValues::Numbers(distribution) => {
                [0.0, 1.0 - f64::EPSILON].map(|x| Value::Float(distribution.value(x))).into()
            }
            VariableValues::OneOf(values) => values.clone(),
        }
    }
}

/// A weather whose drops, flakes and flashes are those of a clip.
///
/// # Errors
/// The key and the problem.
pub fn seeded(weather: Weather, seed: u64, clip: u64) -> KeyedResult<Weather> {
    let names: Vec<&str> = weather
        .effects()
        .filter(|(effect, _)| effect.param("seed").is_some())
        .map(|(effect, _)| effect.name)
        .collect();
    names.into_iter().try_fold(weather, |weather, name| {
        let key = format!("{name}.seed");
        let number = bits(seed, clip) % SEEDS;
        weather.set(&key, number as f64).map_err(|error| (key, error.to_string()))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn find(name: &str, _: &Path) -> Result<Weather, String> {
        Weather::find(name).map_err(|error| error.to_string())
    }

    fn source(text: &str) -> KeyedResult<WeatherSource> {
        let entry: WeatherEntry = toml::from_str(text).unwrap();
        entry.source(Path::new(""), &find)
    }

    #[test]
    fn grids_and_lists_have_every_weather_once() {
        let list = source("from = [\"fog\", \"snow\"]\nat = [0, 5, 10]").unwrap();
        assert_eq!((list.count(), list.is_sampled()), (6, false));
        let place = SamplePlace { seed: 1, index: 0, count: 1 };
        let of = |source: &WeatherSource, number| source.weather(number, place).unwrap();
        assert_eq!((of(&list, 1).weather.name.as_str(), of(&list, 1).at), ("fog", 5.0));
        assert_eq!((of(&list, 5).weather.name.as_str(), of(&list, 5).at), ("snow", 10.0));
        let grid = source("[grid]\n\"fog.mor\" = [50, 100, 200]\n\"rain.rate\" = [1, 10.5]").unwrap();
        let all: Vec<(f64, f64)> = (0..grid.count())
            .map(|number| {
                let weather = of(&grid, number).weather;
                (value_of(&weather, "fog.mor", 0.0).unwrap(), value_of(&weather, "rain.rate", 0.0).unwrap())
            })
            .collect();
        assert_eq!(
            all,
            [(50.0, 1.0), (50.0, 10.5), (100.0, 1.0), (100.0, 10.5), (200.0, 1.0), (200.0, 10.5)]
        );
    }

    #[test]
    fn natural_samples_obey_their_rules_and_fill_their_ranges() {
        const COUNT: u64 = 2000;
        let natural = source("samples = 2000").unwrap();
        let [mut rainy, mut snowy, mut foggy] = [0; 3];
        for index in 0..COUNT {
            let planned = natural.weather(0, SamplePlace { seed: 5, index, count: COUNT }).unwrap();
            let on = |name: &str| planned.weather.effects().any(|(effect, _)| effect.name == name);
            let temperature = planned.variables["temperature"];
            assert!(!on("rain") || temperature > 0.0);
            assert!(!on("snowfall") || temperature < 2.0);
            assert!(!on("fog") || value_of(&planned.weather, "wind.speed", 0.0).unwrap() <= 8.0);
            assert_eq!(on("rain"), on("splash"));
            rainy += u32::from(on("rain"));
            snowy += u32::from(on("snowfall"));
            foggy += u32::from(on("fog"));
            let text = planned.weather.to_toml();
            assert_eq!(Weather::parse(&text, "sample").unwrap().to_toml(), text);
        }
        // Half of the 77 % above freezing; half of the 31 % below 2 degrees; 35 % of the 93 % in
        // little wind.
        assert!((700..850).contains(&rainy), "{rainy}");
        assert!((240..380).contains(&snowy), "{snowy}");
        assert!((560..700).contains(&foggy), "{foggy}");
    }

    #[test]
    fn seeds_are_those_of_the_clip() {
        let weather = Weather::preset("sleet").unwrap();
        let of = |clip| {
            let weather = seeded(weather.clone(), 9, clip).unwrap();
            [value_of(&weather, "rain.seed", 0.0), value_of(&weather, "snowfall.seed", 0.0)]
        };
        assert_eq!(of(4), of(4));
        assert_ne!(of(4), of(5));
    }

    #[test]
    fn faults_name_their_key() {
        for (text, key, says) in [
            ("from = [\"fogg\"]", "from", "did you mean `fog`?"),
            ("from = [\"fog\"]\nsamples = 3", "weather", "one of"),
            ("samples = 0", "samples", "from 1"),
            ("from = [\"fog\"]\nset = { \"fog.mor\" = -4 }", "set fog.mor", "must"),
            ("[grid]\n\"fog.moor\" = [3]", "grid fog.moor", "mor"),
            (
                "samples = 3\nvary.\"fog.mor\" = { distribution = \"even\" }",
                "vary fog.mor",
                "no distribution",
            ),
            (
                "samples = 3\nvary.\"fog.mor\" = { distribution = \"uniform\", min = 3 }",
                "vary fog.mor",
                "max is missing",
            ),
            (
                "samples = 3\nvary.\"rain.rate\" = { distribution = \"uniform\", min = 3, max = 999 }",
                "vary rain.rate",
                "300",
            ),
            (
                "samples = 3\nvary.\"rain.rate\" = { distribution = \"uniform\", min = 3, max = 9, mean = 2 }",
                "vary rain.rate",
                "mean is not",
            ),
            (
                "samples = 3\nvary.heat = { distribution = \"uniform\", min = 3, max = 9 }",
                "vary heat",
                "nothing uses",
            ),
            (
                "samples = 3\n[[rules]]\nwhen = \"temperatur < 3\"\noff = [\"fog\"]",
                "rules, when = \"temperatur < 3\"",
                "neither",
            ),
            (
                "samples = 3\n[[rules]]\nwhen = \"fogg\"\noff = [\"fog\"]",
                "rules, when = \"fogg\"",
                "did you mean",
            ),
            ("samples = 3\n[[rules]]\nwhen = \"fog\"", "rules, when = \"fog\"", "changes nothing"),
            ("from = [\"fog\"]\nat = [inf]", "at", "no time"),
        ] {
            let (found, fault) = source(text).unwrap_err();
            assert!(found == key && fault.contains(says), "{text}: {found}: {fault}");
        }
    }
}
