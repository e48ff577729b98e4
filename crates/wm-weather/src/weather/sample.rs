//! A weather at one instant, and what it becomes at a place.

use super::*;

/// The weather at one instant: all that a frame depends on.
#[derive(Clone, Debug, PartialEq)]
pub struct WeatherSample {
    /// Whose formulas are used.
    pub fidelity: Fidelity,
    /// Seconds.
    pub time: f64,
    pub(super) effects: Vec<(usize, Vec<ParamValue>, Vec<Track>)>,
}

impl WeatherSample {
    /// The effects that are on, with their values in the order of their tables.
    pub fn effects(&self) -> impl Iterator<Item = (&'static Effect, &[ParamValue])> {
        self.effects.iter().map(|(effect, values, _)| (&EFFECTS[*effect], &values[..]))
    }

    /// Returns true if an effect is on.
    #[must_use]
    pub fn is_on(&self, effect: &str) -> bool {
        self.effects.iter().any(|(on, _, _)| EFFECTS[*on].name == effect)
    }

    /// A parameter over time, if its effect is on.
    #[must_use]
    pub fn track(&self, effect: &str, param: &str) -> Option<&Track> {
        let (on, _, tracks) = self.effects.iter().find(|(on, _, _)| EFFECTS[*on].name == effect)?;
        tracks.get(EFFECTS[*on].param(param)?)
    }

    /// Returns true if lamps are wanted where the scene states none.
    #[must_use]
    pub fn asks_for_guessed_lamps(&self) -> bool {
        let lamps = self.track("light", "lamps").map(|track| track.at(self.time));
        matches!(lamps, Some(ParamValue::Word("path")))
    }

    /// Prepares this weather for one place: the data that a renderer needs.
    #[must_use]
    pub fn prepare(&self, site: &Site) -> PreparedWeather {
        let mut weather = WeatherBuilder::new(*site, self.time);
        for (effect, values, tracks) in &self.effects {
            let effect = &EFFECTS[*effect];
            let contribute = match self.fidelity {
                Fidelity::Physical => effect.contribute,
                Fidelity::Paper => effect.contribute_as_paper.unwrap_or(effect.contribute),
            };
            contribute(&EffectContext { values, tracks, time: self.time, weather: self }, &mut weather);
        }
        let strongest_wind = self.track("wind", "speed").map_or(0.0, Track::most);
        PreparedWeather { strongest_wind, ..weather.finish() }
    }
}

/// Quantization step of the slope of the fall: the tangent of 3 degrees.
const SLOPE: f64 = 0.052_4;

/// Largest slope by which wind slants the fall in maps of shelter.
const STEEPEST: f64 = 1.0;

/// The sideways drift by a wind, m/s along [`level_axes`], for each metre of fall at `speed`, m/s.
pub(super) fn slant(wind: [f64; 2], speed: f64) -> [f64; 2] {
    let [x, y] = wind;
    let eased = 1f64.min(STEEPEST * speed / x.hypot(y));
    [x, y].map(|v| v * eased / speed)
}

/// The direction, world axes, in which what falls at `speed` comes down in a mean wind, m/s: see
/// [`PreparedWeather::fall`].
pub(crate) fn fall_of(wind: [f64; 2], speed: f64, up: [f64; 3]) -> [f64; 3] {
    let [x, y] = slant(wind, speed).map(|v| (v / SLOPE).round() * SLOPE);
    let way = [x, y, -1.0];
    let length = way.iter().map(|v| v * v).sum::<f64>().sqrt();
    from_level(&level_axes(up), way.map(|v| v / length))
}
