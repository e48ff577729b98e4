//! The words that are known.

use crate::conditions::Carrier;

/// Visibilities, from slight to dense.
pub(super) const FOG_VISIBILITIES_M: [f64; 4] = [800.0, 300.0, 100.0, 40.0];
pub(super) const MIST_VISIBILITIES_M: [f64; 4] = [4000.0, 2000.0, 1200.0, 1000.0];
pub(super) const HAZE_VISIBILITIES_M: [f64; 4] = [8000.0, 4000.0, 2000.0, 1500.0];
pub(super) const SMOKE_VISIBILITIES_M: [f64; 4] = [4000.0, 1500.0, 800.0, 400.0];
pub(super) const DUST_VISIBILITIES_M: [f64; 4] = [3000.0, 800.0, 250.0, 100.0];

/// Kinds of precipitation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Falling {
    Rain,
    Showers,
    Cloudburst,
    Drizzle,
    Snow,
    Flurries,
    Blizzard,
    Sleet,
    Hail,
}

/// A time of day.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Daytime {
    Day,
    Night,
    Dawn,
    Sunrise,
    Morning,
    Noon,
    Afternoon,
    Golden,
    Evening,
    Sunset,
    Blue,
    Dusk,
}

impl Daytime {
    /// Elevation and azimuth of the sun, degrees, and the turbidity of the air; `None` by night.
    pub(super) fn sun(self) -> Option<(f64, Option<f64>, Option<f64>)> {
        Some(match self {
            Self::Night => return None,
            Self::Day => (45.0, None, None),
            Self::Dawn => (-4.0, Some(80.0), None),
            Self::Sunrise => (2.0, Some(90.0), Some(3.5)),
            Self::Morning => (22.0, Some(115.0), None),
            Self::Noon => (60.0, Some(180.0), None),
            Self::Afternoon => (30.0, Some(240.0), None),
            Self::Golden => (8.0, Some(250.0), Some(3.5)),
            Self::Evening => (10.0, Some(270.0), None),
            Self::Sunset => (2.0, Some(270.0), Some(3.5)),
            Self::Blue => (-5.0, Some(280.0), None),
            Self::Dusk => (-4.0, Some(280.0), None),
        })
    }
}

/// The meaning of a word.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Meaning {
    /// A word without a meaning of its own.
    Filler,
    /// Strength: light, moderate, heavy, violent.
    Strength(usize),
    Very,
    Falls(Falling),
    /// Particles in the air, and their visibilities, m, by strength.
    Air(Carrier, &'static [f64; 4]),
    Freezing,
    /// Shallow, for fog; on the ground, for snow.
    Ground,
    /// It lies.
    Lies,
    Thunder,
    /// Clouds, and their cover, 0-1.
    Cloud(f64),
    /// The share of clouds that a word before them says.
    Share(f64),
    /// None of what follows.
    No,
    /// Wind, and a usual speed, m/s.
    Wind(f64),
    Gusts,
    Force,
    From,
    To,
    Visibility,
    Humidity,
    Time(Daytime),
    Wet,
    /// Warmth, degrees Celsius.
    Warmth(f64),
}

/// Words that say what the wind is and not only how it feels.
pub(super) const CALM_WORDS: [&str; 2] = ["calm", "windless"];

/// All words with the same meaning, parted by spaces.
pub(super) const WORDS: &[(&str, Meaning)] = &[
    (
        "a an the of in at is are it some on over under during falling blowing weather sky \
         skies temperature air before after about there day's street streets road roads mean \
         speed up rate per",
        Meaning::Filler,
    ),
    ("light slight faint weak gentle thin", Meaning::Strength(0)),
    ("moderate medium", Meaning::Strength(1)),
    ("heavy strong dense thick hard severe intense", Meaning::Strength(2)),
    ("violent extreme torrential", Meaning::Strength(3)),
    ("very", Meaning::Very),
    ("rain raining rainy rains", Meaning::Falls(Falling::Rain)),
    ("shower showers", Meaning::Falls(Falling::Showers)),
    ("downpour cloudburst", Meaning::Falls(Falling::Cloudburst)),
    ("drizzle drizzling", Meaning::Falls(Falling::Drizzle)),
    ("snow snowfall snowing snows snowy", Meaning::Falls(Falling::Snow)),
    ("flurries flurry", Meaning::Falls(Falling::Flurries)),
    ("blizzard snowstorm", Meaning::Falls(Falling::Blizzard)),
    ("sleet", Meaning::Falls(Falling::Sleet)),
    ("hail hailstorm hailstones", Meaning::Falls(Falling::Hail)),
    ("fog foggy", Meaning::Air(Carrier::Droplets, &FOG_VISIBILITIES_M)),
    ("mist misty", Meaning::Air(Carrier::Droplets, &MIST_VISIBILITIES_M)),
    ("haze hazy", Meaning::Air(Carrier::Haze, &HAZE_VISIBILITIES_M)),
    ("smog smoke smoky", Meaning::Air(Carrier::Smoke, &SMOKE_VISIBILITIES_M)),
    ("dust sand dusty sandstorm duststorm", Meaning::Air(Carrier::Dust, &DUST_VISIBILITIES_M)),
    ("freezing", Meaning::Freezing),
    ("ground shallow", Meaning::Ground),
    ("lies lie lying deep cover covered depth", Meaning::Lies),
    ("thunderstorm thunder lightning thunderstorms", Meaning::Thunder),
    ("clear cloudless sunny fair", Meaning::Cloud(0.0)),
    ("cloudy clouds cloud", Meaning::Cloud(0.85)),
    ("overcast", Meaning::Cloud(1.0)),
    ("partly partially broken", Meaning::Share(0.5)),
    ("scattered", Meaning::Share(0.4)),
    ("few", Meaning::Share(0.2)),
    ("mostly mainly", Meaning::Share(0.75)),
    ("no without", Meaning::No),
    ("wind winds", Meaning::Wind(7.0)),
    ("windy", Meaning::Wind(10.0)),
    ("breeze breezy", Meaning::Wind(5.0)),
    ("gale", Meaning::Wind(19.0)),
    ("storm stormy", Meaning::Wind(26.0)),
    ("hurricane", Meaning::Wind(35.0)),
    ("calm windless", Meaning::Wind(0.0)),
    ("gusts gust gusty gusting", Meaning::Gusts),
    ("force beaufort", Meaning::Force),
    ("from", Meaning::From),
    ("to towards toward", Meaning::To),
    ("visibility visible sight", Meaning::Visibility),
    ("humidity humid", Meaning::Humidity),
    ("day daylight", Meaning::Time(Daytime::Day)),
    ("night midnight", Meaning::Time(Daytime::Night)),
    ("dawn", Meaning::Time(Daytime::Dawn)),
    ("sunrise", Meaning::Time(Daytime::Sunrise)),
    ("morning", Meaning::Time(Daytime::Morning)),
    ("noon midday", Meaning::Time(Daytime::Noon)),
    ("afternoon", Meaning::Time(Daytime::Afternoon)),
    ("golden", Meaning::Time(Daytime::Golden)),
    ("evening", Meaning::Time(Daytime::Evening)),
    ("sunset", Meaning::Time(Daytime::Sunset)),
    ("blue", Meaning::Time(Daytime::Blue)),
    ("dusk twilight", Meaning::Time(Daytime::Dusk)),
    ("wet puddle puddles", Meaning::Wet),
    ("hot", Meaning::Warmth(32.0)),
    ("warm", Meaning::Warmth(22.0)),
    ("cool", Meaning::Warmth(8.0)),
    ("cold", Meaning::Warmth(0.0)),
    ("frost icy", Meaning::Warmth(-3.0)),
];

/// The meaning of a word in small letters.
pub(super) fn meaning(word: &str) -> Option<Meaning> {
    WORDS.iter().find(|(words, _)| words.split(' ').any(|known| known == word)).map(|(_, meaning)| *meaning)
}

/// Directions in letters, clockwise from north in steps of 22.5 degrees.
pub(super) const COMPASS: [&str; 16] =
    ["n", "nne", "ne", "ene", "e", "ese", "se", "sse", "s", "ssw", "sw", "wsw", "w", "wnw", "nw", "nnw"];
const DIRECTION_NAMES: [&str; 8] =
    ["north", "northeast", "east", "southeast", "south", "southwest", "west", "northwest"];

/// A direction, degrees clockwise from north: `nw`, `northwest`, `northwesterly`.
pub(super) fn compass(word: &str) -> Option<f64> {
    let short = COMPASS.iter().position(|known| *known == word).map(|index| 22.5 * index as f64);
    let stem = word.strip_suffix("erly").or_else(|| word.strip_suffix("ern")).unwrap_or(word);
    short.or_else(|| DIRECTION_NAMES.iter().position(|known| *known == stem).map(|index| 45.0 * index as f64))
}
