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
        let (mut site, mut dome, mut light) = (*site, None, None);
        let (mut layers, mut floating) = (Vec::new(), Vec::new());
        let mut paper = Vec::new();
        let (mut falling, mut wind_now, mut grade) = (Vec::new(), WindSample::default(), None);
        let (mut paper_falls, mut cover, mut paper_cover) = (Vec::new(), Vec::new(), None);
        let mut carried = f64::INFINITY;
        let (mut flash, mut has_lightning) = (None, false);
        let mut wetness = None;
        let mut flood = None;
        let mut splash = None;
        let mut glass = None;
        let strongest_wind = self.track("wind", "speed").map_or(0.0, Track::most);
        for (effect, values, tracks) in &self.effects {
            let effect = &EFFECTS[*effect];
            let act = match self.fidelity {
                Fidelity::Physical => effect.act,
                Fidelity::Paper => effect.act_as_paper.unwrap_or(effect.act),
            };
            match act(&EffectContext { values, tracks, time: self.time, weather: self }, &site) {
                // First of all effects: the light of the others is its.
                Action::Sky(sky) => {
                    let is_its = site.daylight == Daylight::Guessed || sky.scenes_sky() == SkySplats::LeftOut;
                    site.airlight = sky.airlight().filter(|_| is_its).unwrap_or(site.airlight);
                    dome = Some(sky);
                }
                Action::Light(change) if change.is_nothing() => {}
                Action::Light(change) => {
                    // A sky that the weather names stays.
                    if let (None, Some(sky)) = (&dome, change.dome(&site)) {
                        site.airlight = sky.airlight().unwrap_or(site.airlight);
                        dome = Some(sky);
                    }
                    site.light = SiteLight::OfWeather;
                    light = Some(change);
                }
                Action::Lightning(now) => {
                    (flash, has_lightning) = (now, true);
                    site.light = SiteLight::OfWeather;
                    light.get_or_insert(LightChange::CAPTURED);
                }
                Action::Layer(layer) => {
                    layers.push(layer);
                    floating.push(layer);
                }
                Action::PaperFog(fog) => paper.push(fog),
                Action::Wind(wind) => {
                    wind_now = WindSample {
                        drift: wind.drift(self.time),
                        wind: wind.at(self.time),
                        mean: wind.mean(self.time),
                    };
                }
                Action::Precipitation(kind) if kind.rate < LEAST_RATE => {}
                Action::Precipitation(kind) => {
                    layers.push(kind.layer());
                    falling.push(*kind);
                }
                Action::PaperFall(fall) => paper_falls.push(*fall),
                Action::Cover(asked) => {
                    carried = carried.min(asked.threshold);
                    // At a depth of 0 nothing lies.
                    cover.extend((!asked.is_nothing()).then_some(asked));
                }
                Action::Wetness(asked) => wetness = Some(*asked),
                Action::Flood(water) => flood = Some(water),
                Action::Splash(asked) => splash = Some(asked).filter(|splash| splash.amount > 0.0),
                Action::PaperCover(snow) => paper_cover = Some(*snow),
                Action::Grade(change) => grade = (!change.is_neutral()).then_some(change),
                Action::Lens(before) => glass = Some(before).filter(|glass| !glass.is_clear()),
            }
        }
        let air = Atmosphere::new(layers, site);
        let flash = flash.zip(light.as_ref()).map(|(flash, light): (Flash, &LightChange)| {
            FlashLight::new(&flash, light.display(&site), &level_axes(site.up))
        });
        let dome = dome.map(|dome: Dome| dome.lit_by(flash));
        PreparedWeather {
            air,
            flash,
            has_lightning,
            site,
            time: self.time,
            paper,
            paper_falls,
            dome,
            light,
            falling,
            floating,
            wind_now,
            grade,
            cover,
            carried,
            paper_cover,
            wetness,
            flood,
            splash,
            glass,
            strongest_wind,
        }
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
