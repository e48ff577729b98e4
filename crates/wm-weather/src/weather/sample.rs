//! The weather at one instant, prepared for a place.

use super::builder::WeatherBuilder;
use super::fidelity::Fidelity;
use super::prepared::PreparedWeather;
use crate::effects::effect::{EffectContext, WeatherSample};
use crate::optics::Site;
use crate::track::Track;

impl WeatherSample {
    /// Prepares this weather for one place: the data that a renderer needs.
    #[must_use]
    pub fn prepare(&self, site: &Site) -> PreparedWeather {
        let mut weather = WeatherBuilder::new(*site, self.time);
        for (effect, values, tracks) in &self.effects {
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
