//! The weathers of one entry of a plan, each found by its number.

use crate::distribution::Distribution;
use crate::hypercube::LatinHypercube;
use std::collections::BTreeMap;
use toml::Value;
use wm_base::random::bits;
use wm_weather::Weather;

/// Seeds are whole numbers that a float holds.
const SEED_COUNT: u64 = 1 << 53;

/// A variable of samples.
#[derive(Clone, Debug)]
pub(super) struct Variable {
    /// `effect.parameter`, or a name of its own.
    pub(super) name: String,
    pub(super) values: VariableValues,
    /// The share of the samples that have it.
    pub(super) chance: f64,
}

#[derive(Clone, Debug)]
pub(super) enum VariableValues {
    Numbers(Distribution),
    OneOf(Vec<Value>),
}

#[derive(Clone, Debug)]
pub(super) struct Rule {
    pub(super) when: Vec<Condition>,
    pub(super) off: Vec<String>,
    pub(super) set: Vec<(String, Value)>,
}

/// A condition of a rule.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Condition {
    /// An effect is on, or is not.
    Effect(String, bool),
    /// A variable or a parameter against a number.
    Compare(String, Comparison, f64),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Comparison {
    Below,
    AtMost,
    Above,
    AtLeast,
}

/// The weathers of one entry.
#[derive(Clone, Debug)]
pub(crate) struct WeatherSource {
    pub(super) kind: SourceKind,
    pub(super) set: Vec<(String, Value)>,
    pub(super) at: Vec<f64>,
}

#[derive(Clone, Debug)]
pub(super) enum SourceKind {
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
pub(crate) struct SamplePlace {
    /// The seed of the plan.
    pub(crate) seed: u64,
    /// The index among all samples of the entry.
    pub(crate) index: u64,
    /// The number of them.
    pub(crate) count: u64,
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
pub(super) type CopiedVariable = (String, Vec<String>);

/// A value, or the key and the problem.
pub(crate) type KeyedResult<T> = Result<T, (String, String)>;

/// Changes parameters of a weather.
fn changed(weather: &Weather, set: &[(String, Value)]) -> KeyedResult<Weather> {
    set.iter().try_fold(weather.clone(), |weather, (key, value)| {
        set_value(weather, key, value).map_err(|says| (key.clone(), says))
    })
}

/// Changes one parameter of a weather.
fn set_value(weather: Weather, key: &str, value: &Value) -> Result<Weather, String> {
    let text = match value {
        Value::String(text) => text.clone(),
        Value::Integer(number) => number.to_string(),
        Value::Float(number) => number.to_string(),
        other => return Err(format!("{other} is no value: give a number or a text")),
    };
    weather.set(key, text).map_err(|error| error.to_string())
}

impl Condition {
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

/// Returns a parameter of a weather at a time, if its effect is on and it is a number.
pub(crate) fn value_of(weather: &Weather, key: &str, time: f64) -> Option<f64> {
    let (effect, param) = key.split_once('.')?;
    let sample = weather.at(time);
    sample.track(effect, param)?.at(time).number()
}

impl WeatherSource {
    /// The number of weathers for each path.
    pub(crate) fn count(&self) -> u64 {
        let weathers = match &self.kind {
            SourceKind::List(list) => list.len() as u64,
            SourceKind::Grid { axes, .. } => axes.iter().map(|(_, values)| values.len() as u64).product(),
            SourceKind::Samples { count, .. } => *count,
        };
        weathers * self.at.len() as u64
    }

    /// Returns true if every path has weathers of its own.
    pub(crate) fn is_sampled(&self) -> bool {
        matches!(self.kind, SourceKind::Samples { .. })
    }

    /// Returns the number of times at which clips of each weather begin.
    pub(crate) fn times(&self) -> u64 {
        self.at.len() as u64
    }

    /// Checks that every value is one that its parameter takes.
    pub(super) fn check(&self) -> KeyedResult<()> {
        let check_set = |weather: &Weather| {
            changed(weather, &self.set).map(drop).map_err(|(key, says)| (format!("set {key}"), says))
        };
        match &self.kind {
            SourceKind::List(list) => list.iter().try_for_each(check_set)?,
            SourceKind::Grid { base, axes } => {
                check_set(base)?;
                for (key, values) in axes {
                    for value in values {
                        set_value(base.clone(), key, value).map_err(|says| (format!("grid {key}"), says))?;
                    }
                }
            }
            SourceKind::Samples { base, variables, rules, copy, .. } => {
                check_set(base)?;
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
                    changed(base, &rule.set).map_err(|(key, says)| (format!("rules, set {key}"), says))?;
                }
            }
        }
        Ok(())
    }

    /// Weather `number` of a path. Samples are those of `place`, others are the same for all paths.
    ///
    /// # Errors
    /// The key and the problem of a value that a parameter does not take together with others.
    pub(crate) fn weather(&self, number: u64, place: SamplePlace) -> KeyedResult<PlannedWeather> {
        let times = self.at.len() as u64;
        let (weather, at) = (number / times, self.at[(number % times) as usize]);
        let mut planned = PlannedWeather { weather: Weather::clear(), at, variables: BTreeMap::new() };
        match &self.kind {
            SourceKind::List(list) => {
                planned.weather = changed(&list[weather as usize % list.len()], &self.set)?;
            }
            SourceKind::Grid { base, axes } => {
                planned.weather = changed(base, &self.set)?;
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
                planned.weather = changed(base, &self.set)?;
                self.sample(&mut planned, variables, rules, copy, place)?;
            }
        }
        Ok(planned)
    }

    fn sample(
        &self,
        planned: &mut PlannedWeather,
        variables: &[Variable],
        rules: &[Rule],
        copy: &[CopiedVariable],
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

    /// Returns the values that the parameter must accept: the extremes of a distribution, or all of
    /// a list.
    fn extremes(&self) -> Vec<Value> {
        match &self.values {
            VariableValues::Numbers(distribution) => {
                [0.0, 1.0 - f64::EPSILON].map(|x| Value::Float(distribution.value(x))).into()
            }
            VariableValues::OneOf(values) => values.clone(),
        }
    }
}

/// Gives the effects of a weather random seeds of their own for a clip.
///
/// # Errors
/// The key and the problem.
pub(crate) fn seeded(weather: Weather, seed: u64, clip: u64) -> KeyedResult<Weather> {
    let names: Vec<&str> = weather
        .effects()
        .filter(|(effect, _)| effect.param("seed").is_some())
        .map(|(effect, _)| effect.name)
        .collect();
    names.into_iter().try_fold(weather, |weather, name| {
        let key = format!("{name}.seed");
        let number = bits(seed, clip) % SEED_COUNT;
        weather.set(&key, number as f64).map_err(|error| (key, error.to_string()))
    })
}
