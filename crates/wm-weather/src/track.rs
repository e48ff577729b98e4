//! A parameter over time: one value, or keyframes.

use crate::easing::Easing;
use crate::image_file::ImageFile;
use crate::param::{Param, ParamKind, ParamValue};
use wm_render::frame::{srgb_decode, srgb_encode};

/// A value at an instant, and the way from there.
#[derive(Clone, Debug, PartialEq)]
pub struct Keyframe {
    /// Seconds from the start of the shot.
    pub time: f64,
    /// The value at that instant.
    pub value: ParamValue,
    /// The way to the next key; without effect at the last.
    pub easing: Easing,
}

/// Times are seconds from the start of the shot.
///
/// Before the first key and after the last the value stays. Between two keys numbers go in the
/// parameter's own unit by the earlier key's easing, colours in linear light (decoded, mixed,
/// encoded), and words hold.
#[derive(Clone, Debug, PartialEq)]
pub struct Track {
    /// At least one, times ascending.
    keys: Vec<Keyframe>,
}

impl Track {
    /// A track of one value at all times.
    #[must_use]
    pub fn constant(value: ParamValue) -> Self {
        Self { keys: vec![Keyframe { time: 0.0, value, easing: Easing::Linear }] }
    }

    /// A value over keyframes. Words hold, whether their easing is `hold` or left at `linear`.
    ///
    /// # Errors
    /// The problem, to be put after the parameter's name.
    pub fn keyframes(param: &Param, mut keys: Vec<Keyframe>) -> Result<Self, String> {
        if keys.is_empty() {
            return Err("has no keyframes: give at least one pair of time and value".into());
        }
        let is_alone = keys.len() == 1;
        for Keyframe { time, value, easing } in &mut keys {
            if !time.is_finite() {
                return Err(format!("has a keyframe at time {time}: must be a number of seconds"));
            }
            let checked = param.check(value.clone()).map_err(|error| format!("at time {time} {error}"))?;
            let steady = match checked {
                ParamValue::Auto | ParamValue::Image(_) => false,
                ParamValue::Number(number) => number.is_finite(),
                ParamValue::Color(_) => true,
                ParamValue::Word(_) => {
                    if !matches!(easing, Easing::Linear | Easing::Hold) {
                        return Err(format!("at time {time} has the easing {}: words hold", easing.name()));
                    }
                    *easing = Easing::Hold;
                    true
                }
            };
            if !is_alone && !steady {
                return Err(format!("at time {time} is {value}: keyframes run between finite values"));
            }
        }
        if let Some(pair) = keys.windows(2).find(|pair| pair[1].time <= pair[0].time) {
            return Err(format!(
                "has a keyframe at time {} after one at {}: times must rise",
                pair[1].time, pair[0].time
            ));
        }
        Ok(Self { keys })
    }

    /// Reads a value, or keyframes `time:value,time:value:easing` as written on the command line.
    ///
    /// # Errors
    /// As [`Self::keyframes`].
    pub fn parse(param: &Param, text: &str) -> Result<Self, String> {
        // A path may have a colon in it.
        if param.kind == ParamKind::ImageOrAuto || !text.contains(':') {
            return Ok(Self::constant(param.parse(text)?));
        }
        let mut keys = Vec::new();
        for part in text.split(',') {
            let Some((time, rest)) = part.split_once(':') else {
                return Err(format!(
                    "has the keyframe `{part}`: must be time:value or time:value:easing, as in 0:2000,5:60"
                ));
            };
            let seconds = time.trim().parse::<f64>();
            let seconds =
                seconds.map_err(|_| format!("has a keyframe at `{time}`: must be a number of seconds"))?;
            let (value, easing) = match rest.split_once(':') {
                Some((value, easing)) => (value, Easing::parse(easing)?),
                None => (rest, Easing::default()),
            };
            keys.push(Keyframe { time: seconds, value: param.parse(value)?, easing });
        }
        Self::keyframes(param, keys)
    }

    /// The value at `time`, seconds.
    #[must_use]
    pub fn at(&self, time: f64) -> ParamValue {
        let after = self.keys.partition_point(|key| key.time <= time);
        if after == 0 {
            return self.keys[0].value.clone();
        }
        let first = &self.keys[after - 1];
        let Some(second) = self.keys.get(after) else { return first.value.clone() };
        let share = first.easing.share((time - first.time) / (second.time - first.time));
        let mix = |a: f64, b: f64| a + (b - a) * share;
        // Rounding must not lead beyond a key, nor encoding, which is not exact to the last digit.
        let within = |value: f64, a: f64, b: f64| value.clamp(a.min(b), a.max(b));
        let blend = |a: f64, b: f64| within(srgb_encode(mix(srgb_decode(a), srgb_decode(b))), a, b);
        match (&first.value, &second.value) {
            (ParamValue::Number(a), ParamValue::Number(b)) => ParamValue::Number(within(mix(*a, *b), *a, *b)),
            (ParamValue::Color(a), ParamValue::Color(b)) if share > 0.0 => {
                ParamValue::Color(std::array::from_fn(|k| blend(a[k], b[k])))
            }
            _ => first.value.clone(),
        }
    }

    /// Integral of a track of numbers from the instant `from` to `to`, seconds: the parameter's
    /// unit times seconds, exact but for rounding. Negative where `to` is before `from`. NaN for a
    /// track whose values are not numbers.
    ///
    /// It is the difference of one function at the two instants, so what has gathered until an
    /// instant does not depend on the instants that were asked for before.
    #[must_use]
    pub fn integral(&self, from: f64, to: f64) -> f64 {
        if let [only] = &self.keys[..] {
            let number = only.number();
            // An infinite value over no time is nothing, and not NaN.
            return if number.is_infinite() && from == to { 0.0 } else { number * (to - from) };
        }
        self.integral_to(to) - self.integral_to(from)
    }

    /// Integral from the first key to `time`; negative before it.
    fn integral_to(&self, time: f64) -> f64 {
        let first = &self.keys[0];
        if time <= first.time {
            return first.number() * (time - first.time);
        }
        let mut sum = 0.0;
        for pair in self.keys.windows(2) {
            let [from, to] = [&pair[0], &pair[1]];
            let length = to.time - from.time;
            let (start, rise) = (from.number(), to.number() - from.number());
            if time < to.time {
                let passed = time - from.time;
                return sum + start * passed + rise * length * from.easing.integral(passed / length);
            }
            sum += length * (start + rise * from.easing.integral(1.0));
        }
        let last = &self.keys[self.keys.len() - 1];
        sum + last.number() * (time - last.time)
    }

    /// The greatest number of all times, in the parameter's unit; NaN for a track whose values are
    /// not numbers.
    #[must_use]
    pub fn most(&self) -> f64 {
        // No easing leaves the span of its two keys.
        self.keys.iter().map(Keyframe::number).reduce(f64::max).unwrap_or(f64::NAN)
    }

    /// The least number of all times, in the parameter's unit; NaN for a track whose values are not
    /// numbers.
    #[must_use]
    pub fn least(&self) -> f64 {
        self.keys.iter().map(Keyframe::number).reduce(f64::min).unwrap_or(f64::NAN)
    }

    /// The instants at which the formula of the value changes, seconds, ascending: the times of the
    /// keys, and none for a value that is always the same. Between two of them the value is one
    /// polynomial in time.
    pub fn breaks(&self) -> impl Iterator<Item = f64> {
        let keys = if self.keys.len() == 1 { &[][..] } else { &self.keys[..] };
        keys.iter().map(|key| key.time)
    }

    /// The pictures that it names.
    pub(crate) fn images(&mut self) -> impl Iterator<Item = &mut ImageFile> {
        self.keys.iter_mut().filter_map(|key| match &mut key.value {
            ParamValue::Image(picture) => Some(picture),
            _ => None,
        })
    }

    /// The keys; a single one for a value that is always the same.
    #[must_use]
    pub fn keys(&self) -> &[Keyframe] {
        &self.keys
    }
}

impl Keyframe {
    /// The value if it is a number, else NaN.
    fn number(&self) -> f64 {
        self.value.number().unwrap_or(f64::NAN)
    }
}

#[cfg(test)]
mod tests;
