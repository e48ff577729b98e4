//! A parameter over time: one value, or linear keyframes.

use crate::param::{Kind, Param, Value};
use crate::picture::Picture;

/// Times are seconds from the start of the shot.
#[derive(Clone, Debug, PartialEq)]
pub struct Track {
    /// At least one, times ascending.
    keys: Vec<(f64, Value)>,
}

impl Track {
    /// The same value at all times.
    #[must_use]
    pub fn constant(value: Value) -> Self {
        Self { keys: vec![(0.0, value)] }
    }

    /// Keyframes: before the first and after the last the value stays, between two it runs linearly,
    /// in the parameter's own unit (colours as they are encoded).
    ///
    /// # Errors
    /// What is wrong, to be put after the parameter's name.
    pub fn keyframes(param: &Param, keys: Vec<(f64, Value)>) -> Result<Self, String> {
        if keys.is_empty() {
            return Err("has no keyframes: give at least one pair of time and value".into());
        }
        for (time, value) in &keys {
            if !time.is_finite() {
                return Err(format!("has a keyframe at time {time}: must be a number of seconds"));
            }
            let checked = param.check(value.clone()).map_err(|error| format!("at time {time} {error}"))?;
            let steady = match checked {
                Value::Auto | Value::Word(_) | Value::Picture(_) => false,
                Value::Number(number) => number.is_finite(),
                Value::Color(_) => true,
            };
            if keys.len() > 1 && !steady {
                return Err(format!("at time {time} is {value}: keyframes run between finite values"));
            }
        }
        if let Some(pair) = keys.windows(2).find(|pair| pair[1].0 <= pair[0].0) {
            return Err(format!(
                "has a keyframe at time {} after one at {}: times must rise",
                pair[1].0, pair[0].0
            ));
        }
        Ok(Self { keys })
    }

    /// Reads a value or keyframes `time:value,time:value` as written on the command line.
    ///
    /// # Errors
    /// As [`Self::keyframes`].
    pub fn parse(param: &Param, text: &str) -> Result<Self, String> {
        // A path may have a colon in it.
        let is_steady = matches!(param.kind, Kind::Word(_) | Kind::PictureOrAuto);
        if is_steady || !text.contains(':') {
            return Ok(Self::constant(param.parse(text)?));
        }
        let mut keys = Vec::new();
        for part in text.split(',') {
            let Some((time, value)) = part.split_once(':') else {
                return Err(format!("has the keyframe `{part}`: must be time:value, as in 0:2000,5:60"));
            };
            let seconds = time.trim().parse::<f64>();
            let seconds =
                seconds.map_err(|_| format!("has a keyframe at `{time}`: must be a number of seconds"))?;
            keys.push((seconds, param.parse(value)?));
        }
        Self::keyframes(param, keys)
    }

    /// The value at `time`.
    #[must_use]
    pub fn at(&self, time: f64) -> Value {
        let after = self.keys.partition_point(|(key, _)| *key <= time);
        if after == 0 {
            return self.keys[0].1.clone();
        }
        let (from, first) = &self.keys[after - 1];
        let Some((to, second)) = self.keys.get(after) else { return first.clone() };
        let share = (time - from) / (to - from);
        let mix = |a: f64, b: f64| a + (b - a) * share;
        match (first, second) {
            (Value::Number(a), Value::Number(b)) => Value::Number(mix(*a, *b)),
            (Value::Color(a), Value::Color(b)) => Value::Color(std::array::from_fn(|k| mix(a[k], b[k]))),
            _ => first.clone(),
        }
    }

    /// The pictures that it names.
    pub(crate) fn pictures(&mut self) -> impl Iterator<Item = &mut Picture> {
        self.keys.iter_mut().filter_map(|(_, value)| match value {
            Value::Picture(picture) => Some(picture),
            _ => None,
        })
    }

    /// Times and values.
    #[must_use]
    pub fn keys(&self) -> &[(f64, Value)] {
        &self.keys
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const PARAM: Param = Param {
        name: "mor",
        kind: Kind::Number,
        default: Value::Number(1.0),
        range: (0.0, 1e9),
        unit: "m",
        meaning: "",
    };

    #[test]
    fn keys_hold_run_and_hold() {
        let track = Track::parse(&PARAM, "1:100, 3:200, 4:50").unwrap();
        for (time, want) in
            [(-5.0, 100.0), (1.0, 100.0), (2.0, 150.0), (3.0, 200.0), (3.5, 125.0), (9.0, 50.0)]
        {
            assert_eq!(track.at(time), Value::Number(want));
        }
    }

    #[test]
    fn bad_keys_are_named() {
        for (text, want) in [
            ("0:1,0:2", "has a keyframe at time 0 after one at 0: times must rise"),
            ("0:1,5", "has the keyframe `5`: must be time:value, as in 0:2000,5:60"),
            ("x:1", "has a keyframe at `x`: must be a number of seconds"),
            ("0:1,1:-2", "is -2: must be a number from 0 to 1000000000 m"),
        ] {
            assert_eq!(Track::parse(&PARAM, text).unwrap_err(), want);
        }
    }

    proptest! {
        /// Linear between keys: never beyond the two that are around.
        #[test]
        fn values_stay_between_their_keys(
            values in prop::collection::vec(0.0..1e6f64, 2..6),
            time in -1.0..7.0f64,
        ) {
            let keys = values.iter().enumerate().map(|(i, v)| (i as f64, Value::Number(*v))).collect();
            let track = Track::keyframes(&PARAM, keys).unwrap();
            let i = (time.max(0.0) as usize).min(values.len() - 1);
            let (a, b) = (values[i], values[(i + 1).min(values.len() - 1)]);
            let Value::Number(value) = track.at(time) else { panic!("a number") };
            prop_assert!(value >= a.min(b) - 1e-6 && value <= a.max(b) + 1e-6);
        }
    }
}
