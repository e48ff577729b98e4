//! The groups of a METAR as they are stated.

/// The kind of an airport's report.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum MetarKind {
    /// A routine report.
    #[default]
    Metar,
    /// A special report.
    Speci,
}

/// The time of a report, UTC. It has no month.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MetarTime {
    /// Day of the month, 1-31.
    pub day: u32,
    /// Hour, 0-23.
    pub hour: u32,
    /// Minute, 0-59.
    pub minute: u32,
}

/// The wind of a report.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MetarWind {
    /// Direction it comes from, degrees from true north; `None` if it is variable or was not
    /// measured.
    pub from: Option<f64>,
    /// Mean speed, m/s; `None` if it was not measured.
    pub speed: Option<f64>,
    /// Speed of the gusts, m/s.
    pub gust: Option<f64>,
    /// The direction varies (`VRB`).
    pub is_variable: bool,
    /// The two extremes of a direction that varies by 60 degrees or more.
    pub between: Option<[f64; 2]>,
}

/// The meaning of a visibility at the end of a scale.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum VisibilityBound {
    /// The stated value itself.
    Exact,
    /// As far or farther: `9999`, `P6SM`.
    OrMore,
    /// Less far: `M1/4SM`, `0000`.
    Less,
}

/// A visibility.
#[derive(Clone, Debug, PartialEq)]
pub struct MetarVisibility {
    /// Distance, m; a statute mile is 1609.344 m.
    pub metres: f64,
    /// The meaning of the distance.
    pub bound: VisibilityBound,
    /// The side that it holds for: `NE`.
    pub direction: Option<String>,
}

/// A runway visual range.
#[derive(Clone, Debug, PartialEq)]
pub struct RunwayRange {
    /// The runway: `04L`.
    pub runway: String,
    /// Least and greatest distance, m; the same where it does not vary. `None` if it was not
    /// measured.
    pub metres: Option<[f64; 2]>,
}

/// The strength of present weather.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WeatherIntensity {
    /// `-`.
    Light,
    /// Without a sign.
    Moderate,
    /// `+`.
    Heavy,
}

macro_rules! codes {
    ($(#[doc = $about:literal])* $name:ident { $($(#[doc = $meaning:literal])* $variant:ident = $code:literal,)* }) => {
        $(#[doc = $about])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum $name { $($(#[doc = $meaning])* $variant,)* }

        impl $name {
            /// All of them.
            pub const ALL: &'static [Self] = &[$(Self::$variant),*];

            /// The code in reports, two letters.
            #[must_use]
            pub fn code(self) -> &'static str {
                match self { $(Self::$variant => $code,)* }
            }
        }
    };
}

codes! {
    /// The descriptor of present weather.
    WeatherDescriptor {
        /// Shallow.
        Shallow = "MI",
        /// Patches.
        Patches = "BC",
        /// Over a part of the aerodrome.
        Partial = "PR",
        /// Drifting below 2 m.
        Drifting = "DR",
        /// Blowing.
        Blowing = "BL",
        /// Showers.
        Showers = "SH",
        /// Thunderstorm.
        Thunderstorm = "TS",
        /// Freezing.
        Freezing = "FZ",
    }
}

codes! {
    /// A phenomenon of present weather.
    WeatherPhenomenon {
        /// Drizzle.
        Drizzle = "DZ",
        /// Rain.
        Rain = "RA",
        /// Snow.
        Snow = "SN",
        /// Snow grains.
        SnowGrains = "SG",
        /// Ice crystals.
        IceCrystals = "IC",
        /// Ice pellets.
        IcePellets = "PL",
        /// Hail.
        Hail = "GR",
        /// Small hail, snow pellets.
        SmallHail = "GS",
        /// Precipitation that the station cannot tell.
        Unknown = "UP",
        /// Mist.
        Mist = "BR",
        /// Fog.
        Fog = "FG",
        /// Smoke.
        Smoke = "FU",
        /// Volcanic ash.
        Ash = "VA",
        /// Widespread dust.
        Dust = "DU",
        /// Sand.
        Sand = "SA",
        /// Haze.
        Haze = "HZ",
        /// Spray.
        Spray = "PY",
        /// Dust whirls.
        Whirls = "PO",
        /// Squalls.
        Squalls = "SQ",
        /// A funnel cloud, with `+` a tornado.
        Funnel = "FC",
        /// Sandstorm.
        Sandstorm = "SS",
        /// Duststorm.
        Duststorm = "DS",
    }
}

/// A group of present or recent weather.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct WeatherGroup {
    /// The strength of what falls.
    pub intensity: WeatherIntensity,
    /// It is in the vicinity and not at the station (`VC`).
    pub is_nearby: bool,
    /// Descriptors, in the order of the report.
    pub descriptors: Vec<WeatherDescriptor>,
    /// Phenomena, the one of most water first.
    pub phenomena: Vec<WeatherPhenomenon>,
}

impl WeatherGroup {
    /// Returns true if it has a descriptor.
    #[must_use]
    pub fn is(&self, descriptor: WeatherDescriptor) -> bool {
        self.descriptors.contains(&descriptor)
    }

    /// Returns true if it has a phenomenon.
    #[must_use]
    pub fn has(&self, phenomenon: WeatherPhenomenon) -> bool {
        self.phenomena.contains(&phenomenon)
    }

    /// The group as it is written in reports.
    #[must_use]
    pub fn code(&self) -> String {
        let sign = match self.intensity {
            WeatherIntensity::Light => "-",
            WeatherIntensity::Moderate => "",
            WeatherIntensity::Heavy => "+",
        };
        let nearby = if self.is_nearby { "VC" } else { "" };
        let descriptors: String = self.descriptors.iter().map(|one| one.code()).collect();
        let phenomena: String = self.phenomena.iter().map(|one| one.code()).collect();
        format!("{sign}{nearby}{descriptors}{phenomena}")
    }
}

/// The share of the sky that a layer of clouds covers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CloudCover {
    /// `FEW`: 1 to 2 eighths.
    Few,
    /// `SCT`: 3 to 4 eighths.
    Scattered,
    /// `BKN`: 5 to 7 eighths.
    Broken,
    /// `OVC`: 8 eighths.
    Overcast,
    /// `VV`: the sky cannot be seen.
    Obscured,
    /// `SKC`, `CLR`, `NSC` or `NCD`: none, or none that matters.
    Clear,
    /// Not measured.
    Unknown,
}

impl CloudCover {
    /// The middle of its range, 0-1; `None` if it is not known.
    #[must_use]
    pub fn share(self) -> Option<f64> {
        match self {
            Self::Few => Some(1.5 / 8.0),
            Self::Scattered => Some(3.5 / 8.0),
            Self::Broken => Some(6.0 / 8.0),
            Self::Overcast | Self::Obscured => Some(1.0),
            Self::Clear => Some(0.0),
            Self::Unknown => None,
        }
    }
}

/// A layer of clouds.
#[derive(Clone, Debug, PartialEq)]
pub struct CloudGroup {
    /// The cover.
    pub cover: CloudCover,
    /// Height of its base over the aerodrome, or vertical visibility, m.
    pub height: Option<f64>,
    /// `CB` (cumulonimbus), `TCU` (towering cumulus), `ACC`; `None` for others.
    pub kind: Option<&'static str>,
    /// As it is written.
    pub code: String,
}

/// A part of a report that is no part of a weather.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct IgnoredGroup {
    /// As it is written.
    pub text: String,
    /// Why it is ignored.
    pub reason: &'static str,
}

/// A decoded METAR or SPECI, in SI units and degrees Celsius.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Metar {
    /// The kind.
    pub kind: MetarKind,
    /// ICAO code of the station, four letters or digits.
    pub station: String,
    /// The time.
    pub time: Option<MetarTime>,
    /// Made without a person (`AUTO`).
    pub is_automatic: bool,
    /// A correction (`COR`, `CCA`).
    pub is_correction: bool,
    /// Wind.
    pub wind: Option<MetarWind>,
    /// `CAVOK`: 10 km or more, no clouds that matter, no weather.
    pub is_cavok: bool,
    /// Prevailing visibility.
    pub visibility: Option<MetarVisibility>,
    /// The least visibility, with its side.
    pub minimum_visibility: Option<MetarVisibility>,
    /// Runway visual ranges.
    pub runway_ranges: Vec<RunwayRange>,
    /// False if strokes say that nobody knows whether there is present weather.
    pub has_weather: bool,
    /// Present weather.
    pub weather: Vec<WeatherGroup>,
    /// Clouds.
    pub clouds: Vec<CloudGroup>,
    /// Temperature, degrees Celsius.
    pub temperature: Option<f64>,
    /// Dew point, degrees Celsius.
    pub dew_point: Option<f64>,
    /// Pressure at sea level, hPa.
    pub pressure: Option<f64>,
    /// Weather of the last hour that has ended.
    pub recent: Vec<WeatherGroup>,
    /// Trends, runway states, wind shear and the like.
    pub ignored: Vec<IgnoredGroup>,
    /// The remarks, without `RMK`.
    pub remarks: String,
}

impl Metar {
    /// The quantities of a weather that the report does not have: left out, or strokes in their
    /// place.
    #[must_use]
    pub fn missing(&self) -> Vec<&'static str> {
        let speed = self.wind.and_then(|wind| wind.speed);
        let needs_direction = self.wind.is_some_and(|wind| wind.from.is_none() && !wind.is_variable)
            && speed.is_some_and(|speed| speed > 0.0);
        let has_clouds = self.is_cavok || self.clouds.iter().any(|cloud| cloud.cover.share().is_some());
        let parts = [
            ("wind", speed.is_some()),
            ("direction of the wind", !needs_direction),
            ("visibility", self.visibility.is_some()),
            ("weather", self.has_weather || !self.weather.is_empty()),
            ("clouds", has_clouds),
            ("temperature", self.temperature.is_some()),
            ("dew point", self.dew_point.is_some()),
            ("pressure", self.pressure.is_some()),
        ];
        parts.into_iter().filter(|(_, has)| !has).map(|(name, _)| name).collect()
    }
}
