//! The entries `[[weather]]` of a plan as they are written, and their checks.

use super::source::{
    Comparison, Condition, CopiedVariable, KeyedResult, Rule, SourceKind, Variable, VariableValues,
    WeatherSource,
};
use crate::distribution::Distribution;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::Path;
use toml::Value;
use wm_base::nearest;
use wm_weather::{EFFECTS, Weather};

/// The variables and rules of samples that give none of their own.
const NATURAL: &str = include_str!("../natural.toml");
/// Maximum number of weathers of one entry.
const MAX_WEATHERS: u64 = 1_000_000_000;

/// Entry `[[weather]]` of a plan, as it is written.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct WeatherEntry {
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

/// Finds a preset, or a file beside the plan.
pub(crate) type FindWeather<'a> = &'a dyn Fn(&str, &Path) -> Result<Weather, String>;

impl WeatherEntry {
    /// Checks an entry; `folder` is that of the plan.
    ///
    /// # Errors
    /// The key and the problem.
    pub(crate) fn source(&self, folder: &Path, find: FindWeather<'_>) -> KeyedResult<WeatherSource> {
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
            if count.is_none_or(|count| count == 0 || count > MAX_WEATHERS) {
                return Err(fault(
                    "grid",
                    format!("each key needs values, and all together at most {MAX_WEATHERS}"),
                ));
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
        if count == 0 || count > MAX_WEATHERS {
            return Err(("samples".into(), format!("is {count}: it must be from 1 to {MAX_WEATHERS}")));
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
pub(crate) fn meant<'a>(name: &str, known: impl Iterator<Item = &'a str>) -> String {
    nearest(name, known, 1).first().map_or_else(String::new, |near| format!(", did you mean `{near}`?"))
}

fn unknown_variable(name: &str, variables: &[Variable]) -> String {
    let known = variables.iter().map(|variable| variable.name.as_str());
    match nearest(name, known, 1).first() {
        Some(near) => format!("`{name}` is not varied, did you mean `{near}`?"),
        None => format!("`{name}` is not varied: give it in vary"),
    }
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
    /// Parses a condition of a rule.
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
}
