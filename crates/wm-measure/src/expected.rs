//! Expected values from a weather's parameters and published laws: implemented a second time, so
//! that no instrument shares code with what it measures.

use wm_weather::particles::PrecipitationKind;
use wm_weather::{Effect, EffectRole, ParamValue, Weather};

/// `-ln 0.05`: optical depth at the meteorological optical range (WMO No. 8).
pub(crate) const MOR_DEPTH: f64 = 2.995_732_273_553_991;
/// `-ln 0.02`: the same at Koschmieder's visual range.
const VISUAL_DEPTH: f64 = 3.912_023_005_428_146;
/// Refractive index of water.
pub(crate) const WATER_INDEX: f64 = 1.333;
/// Wavelengths of red, green and blue.
const WAVELENGTHS_NM: [f64; 3] = [610.0, 550.0, 465.0];

/// A parameter at an instant, if its effect is on and it is a number.
pub(crate) fn number(weather: &Weather, time: f64, effect: &str, param: &str) -> Option<f64> {
    weather.at(time).track(effect, param)?.at(time).number()
}

/// Returns true if a parameter is a word at an instant.
pub(crate) fn says(weather: &Weather, time: f64, effect: &str, param: &str, word: &str) -> bool {
    let instant = weather.at(time);
    instant
        .track(effect, param)
        .is_some_and(|track| matches!(track.at(time), ParamValue::Word(own) if own == word))
}

/// Returns true if a flood stands over the ground at an instant.
pub(crate) fn is_flooded(weather: &Weather, time: f64) -> bool {
    number(weather, time, "flood", "level").is_some_and(|level| level > 0.0)
}

/// Returns true if an effect is on.
pub(crate) fn is_on(weather: &Weather, name: &str) -> bool {
    weather.effects().any(|(effect, _)| effect.name == name)
}

/// Returns the name of the effect of a kind of precipitation.
pub(crate) fn effect(kind: &PrecipitationKind) -> &'static str {
    Effect::of_precipitation(kind).map_or("", |effect| effect.name)
}

/// Returns the kinds of precipitation at an instant with their rates, mm/h, in the order of the
/// effects.
pub(crate) fn falling(weather: &Weather, time: f64) -> Vec<(&'static PrecipitationKind, f64)> {
    let kinds = weather.effects().filter_map(|(effect, _)| effect.precipitation);
    let rated = kinds.map(|kind| (kind, number(weather, time, effect(kind), "rate").unwrap_or(0.0)));
    rated.filter(|(_, rate)| *rate > 0.0).collect()
}

/// One kind of air.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ExpectedAir {
    /// Extinction at the base, 1/m.
    pub(crate) sigma_t: [f64; 3],
    /// Height over which it thins to 1/e, m.
    pub(crate) scale_height: f64,
    /// Height above the ground at which `sigma_t` holds, m.
    pub(crate) base_height: f64,
}

impl ExpectedAir {
    /// Returns the air of fog, haze or smog.
    pub(crate) fn of(weather: &Weather, time: f64, effect: &str) -> Option<Self> {
        let number = |param: &str| number(weather, time, effect, param);
        let green = match number("visual_range") {
            Some(range) => VISUAL_DEPTH / range,
            None => MOR_DEPTH / number("mor")?,
        };
        let angstrom = number("angstrom")?;
        Some(Self {
            sigma_t: WAVELENGTHS_NM.map(|length| green * (length / 550.0).powf(-angstrom)),
            scale_height: number("scale_height")?,
            base_height: number("base_height")?,
        })
    }

    /// Returns the share of [`Self::sigma_t`] at a height above the ground, m.
    pub(crate) fn share(&self, height: f64) -> f64 {
        (-(height - self.base_height) / self.scale_height).exp()
    }

    /// The metres at the base that dim as much as a ray from `height` that rises by `rise` a metre:
    /// Simpson's rule.
    pub(crate) fn length(&self, height: f64, rise: f64, metres: f64) -> f64 {
        if self.scale_height.is_infinite() {
            return metres;
        }
        let pieces = 32;
        let step = metres / f64::from(pieces);
        let at = |i: i32| self.share(height + rise * step * f64::from(i));
        let inner: f64 = (1..pieces).map(|i| if i % 2 == 1 { 4.0 * at(i) } else { 2.0 * at(i) }).sum();
        step / 3.0 * (at(0) + inner + at(pieces))
    }
}

/// The airs that are on.
pub(crate) fn airs(weather: &Weather, time: f64) -> Vec<ExpectedAir> {
    let airs = weather.effects().filter(|(effect, _)| effect.role == EffectRole::Air);
    airs.filter_map(|(effect, _)| ExpectedAir::of(weather, time, effect.name)).collect()
}

/// Extinction of what falls, 1/m: by the published law of its kind, or else by the program's own
/// sum over its particles: published laws of snow are apart by a factor of 3 and more.
pub(crate) fn fall_extinction(weather: &Weather, time: f64) -> f64 {
    let own = |kind: &PrecipitationKind, rate: f64| match FallLaw::of(kind).and_then(|law| law.extinction) {
        Some(extinction) => extinction(rate),
        None => kind.sigma_t(&kind.classes(), rate),
    };
    falling(weather, time).into_iter().map(|(kind, rate)| own(kind, rate)).sum()
}

/// Extinction of the whole air at a height above the ground, 1/m.
pub(crate) fn extinction(weather: &Weather, time: f64, height: f64) -> [f64; 3] {
    let fall = fall_extinction(weather, time);
    let mut sigma = [fall; 3];
    for air in airs(weather, time) {
        let share = air.share(height);
        sigma.iter_mut().zip(air.sigma_t).for_each(|(sigma, own)| *sigma += own * share);
    }
    sigma
}

/// Fall speed of rain drops in still air, m/s, by diameter, mm: as Gunn and Kinzer (1949) measured
/// it, straight between their sizes.
pub(crate) fn gunn_kinzer(diameter: f64) -> f64 {
    const FALL_SPEEDS_MM_M_S: [[f64; 2]; 14] = [
        [0.4, 1.62],
        [0.6, 2.47],
        [0.8, 3.27],
        [1.0, 4.03],
        [1.2, 4.64],
        [1.4, 5.17],
        [1.6, 5.65],
        [1.8, 6.09],
        [2.0, 6.49],
        [2.4, 7.27],
        [2.8, 7.82],
        [3.2, 8.26],
        [4.0, 8.83],
        [5.8, 9.17],
    ];
    let pair =
        FALL_SPEEDS_MM_M_S.windows(2).find(|pair| diameter < pair[1][0]).unwrap_or(&FALL_SPEEDS_MM_M_S[12..]);
    pair[0][1] + (pair[1][1] - pair[0][1]) * (diameter - pair[0][0]) / (pair[1][0] - pair[0][0])
}

/// Fall speed of flakes, m/s, by their own diameter, mm: aggregates.
pub(crate) fn flake_speed(diameter: f64) -> f64 {
    0.8 * diameter.powf(0.16)
}

/// The published laws of a kind of precipitation, over the diameter that is seen, mm.
pub(crate) struct FallLaw {
    /// The kind, by its name.
    kind: &'static str,
    /// The law of fall speeds in a few words, and its source.
    pub(crate) speed_law: [&'static str; 2],
    /// Fall speed in still air, m/s, by diameter.
    pub(crate) speed: fn(f64) -> f64,
    /// Water of one particle, mm^3, by diameter.
    pub(crate) water: fn(f64) -> f64,
    /// Particles a m^3 that are larger than a diameter, by the rate, mm/h, and that diameter.
    pub(crate) density: fn(f64, f64) -> f64,
    /// Extinction, 1/m, by the rate, mm/h, where one is agreed on.
    extinction: Option<fn(f64) -> f64>,
}

/// Every kind with published laws of its own.
const FALL_LAWS: &[FallLaw] = &[
    // Marshall and Palmer (1948), extinction after Atlas (1953).
    FallLaw {
        kind: "rain",
        speed_law: ["Gunn-Kinzer's", "Gunn and Kinzer 1949"],
        speed: gunn_kinzer,
        water: ball,
        density: |rate, least| beyond(8000.0, rain_slope(rate), least),
        extinction: Some(|rate| 0.365e-3 * rate.powf(0.63)),
    },
    // Sekhon and Srivastava (1970); densities after Fabry and Szyrmer (1999), 0.178 D^-0.922
    // g/cm^3.
    FallLaw {
        kind: "snow",
        speed_law: ["0.8 D^0.16", "aggregates, 0.8 D^0.16"],
        speed: flake_speed,
        water: |diameter| ball(diameter) * 0.178 * diameter.powf(-0.922),
        density: |rate, least| beyond(2500.0 * rate.powf(-0.94), 2.29 * rate.powf(-0.45), melted(least)),
        extinction: None,
    },
    // Cheng and English (1983); balls of ice of 900 kg/m^3 with a drag coefficient of 0.55.
    FallLaw {
        kind: "hail",
        speed_law: ["that of drag", "drag of a ball, C_d 0.55"],
        speed: |diameter| (4.0 * 900.0 * 9.81 * 1e-3 * diameter / (3.0 * 1.2 * 0.55)).sqrt(),
        water: |diameter| 0.9 * ball(diameter),
        density: |rate, least| {
            let slope = (rate / 9.58).powf(-1.0 / 0.87).clamp(0.1, 1.0);
            beyond(115.0 * slope.powf(3.63), slope, least)
        },
        extinction: None,
    },
];

impl FallLaw {
    /// The laws of a kind; `None` where none are typed in here.
    pub(crate) fn of(kind: &PrecipitationKind) -> Option<&'static Self> {
        FALL_LAWS.iter().find(|law| law.kind == kind.name)
    }
}

/// Volume of a ball, mm^3, by its diameter, mm.
fn ball(diameter: f64) -> f64 {
    std::f64::consts::PI / 6.0 * diameter.powi(3)
}

/// Particles a m^3 that are larger than `least` mm, of an exponential spectrum.
fn beyond(most: f64, slope: f64, least: f64) -> f64 {
    most / slope * (-slope * least).exp()
}

/// Diameter when melted, mm, of a flake by the diameter that is seen, mm.
fn melted(diameter: f64) -> f64 {
    (ball(diameter) * 0.178 * diameter.powf(-0.922) * 6.0 / std::f64::consts::PI).cbrt()
}

/// The share that is reflected of unpolarised light that meets water at an angle from its normal,
/// radians: Fresnel's equations by the angles on both sides of the surface (Snell).
pub(crate) fn water_reflectance(outside: f64) -> f64 {
    let inside = (outside.sin() / WATER_INDEX).asin();
    let across = ((outside - inside).sin() / (outside + inside).sin()).powi(2);
    let along = ((outside - inside).tan() / (outside + inside).tan()).powi(2);
    0.5 * (across + along)
}

/// Slope of the spectrum of rain, 1/mm (Marshall and Palmer 1948), by the rate, mm/h.
pub(crate) fn rain_slope(rate: f64) -> f64 {
    4.1 * rate.powf(-0.21)
}
