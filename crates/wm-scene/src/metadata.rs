//! Facts about a scene that weather needs and that splat files have no field for.

mod fault;

use crate::lamps::{Lamp, LitWindow};
use crate::reflectance::LabelReflectance;
use crate::survey::sourced::Confidence;
use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::ops::RangeInclusive;

/// `-ln(0.05)`: optical depth of the meteorological optical range, as the World Meteorological
/// Organization has it.
pub const MOR_DEPTH: f64 = 2.995_732_273_553_991;

/// Facts about a scene that are written with it. A fact that is missing is given by hand, estimated
/// from the splats or assumed; see [`crate::survey`].
///
/// In a PLY it is kept in comment lines `comment wm.<key> <value>`; for formats that have no room
/// in a TOML file beside the scene, `<scene file>.wm.toml`, whose keys are the fields below. If
/// both exist, the TOML file wins key by key.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Metadata {
    /// The point of the world that is zero here, scene units, world axes: positions are relative to
    /// it. Nothing if they are those of the world; see [`crate::origin`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub origin: Option<DVec3>,
    /// Metres per scene unit.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub metres_per_unit: Option<f64>,
    /// The source of `metres_per_unit`, such as "the camera height of 1.6 m above the ground"; free
    /// text, one line, at most 4096 bytes.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub scale_source: Option<String>,
    /// Confidence in the scale; nothing if it is sure.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub scale_confidence: Option<Confidence>,
    /// The direction against gravity, world axes, length 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub up: Option<DVec3>,
    /// The source of `up`, such as "the GPS of 18 photos, met within 0.5 m"; as `scale_source`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub up_source: Option<String>,
    /// Confidence in up; nothing if it is sure.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub up_confidence: Option<Confidence>,
    /// True north, level, world axes, length 1. Used as far as it is level: see
    /// [`Metadata::level_north`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub north: Option<DVec3>,
    /// The source of `north` and `location`, such as "the GPS of 18 photos, met within 0.5 m"; as
    /// `scale_source`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub north_source: Option<String>,
    /// Latitude (-90 to 90, north above 0) and longitude (-180 to 180, east above 0) of the middle
    /// of the photos, degrees, WGS 84.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub location: Option<[f64; 2]>,
    /// The time of the photos, their median, seconds since 1 January 1970, 0:00 UTC, years 1800 to
    /// 3000.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub captured: Option<f64>,
    /// Time between the first photo and the last, seconds, 0 and above; nothing if it is under a
    /// minute or not known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub captured_span: Option<f64>,
    /// The sun of the photos; it goes before the one that place and time give.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sun: Option<PhotoSun>,
    /// Height of the ground along `up`, scene units: a point `p` is on it where `up . p` is this.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ground: Option<f64>,
    /// Confidence in the ground; nothing if it is sure.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ground_confidence: Option<Confidence>,
    /// Height of the photos' cameras above the ground, scene units, where they were carried at one
    /// height over it: the ground is parallel to their path.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub camera_height: Option<f64>,
    /// Mean radiance of the sky near the horizon, linear RGB, 1 = display white: the airlight of
    /// weather that is given no colour of its own.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub airlight: Option<[f64; 3]>,
    /// Brightness of a white card on level ground in the open as the photos would show it, linear,
    /// 1 = display white: what turns colours into reflectances.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub white_card: Option<f64>,
    /// Extinction of the haze in which the photos were taken, a scene unit. The scene is without
    /// it: this says what its photos show and it does not.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub haze_extinction: Option<f64>,
    /// Standard deviation of `haze_extinction`; nothing if that was given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub haze_extinction_error: Option<f64>,
    /// Extinction a scene unit with which even air of `haze_airlight` looks as the photos show the
    /// haze, if it is another: cameras compress what is bright.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub haze_shown_extinction: Option<f64>,
    /// Light of that haze where it is endless, linear RGB, 1 = display white.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub haze_airlight: Option<[f64; 3]>,
    /// Outlines of open water, world axes, scene units, on which neither snow nor sand lies; an
    /// empty list says that there is none. If nothing is said, blue pools are guessed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub water: Option<Vec<Vec<[f64; 3]>>>,
    /// The labels of water ([`Splats::labels`](crate::Splats::labels)): what they show is open
    /// water as well.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub water_labels: Option<Vec<u16>>,
    /// The lamps of the place; an empty list says that there are none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lamps: Option<Vec<Lamp>>,
    /// Windows of the place that are lit by night.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub windows: Option<Vec<LitWindow>>,
    /// Reflectances of its labels for lidars; other splats have that of their colour.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reflectances: Option<Vec<LabelReflectance>>,
    /// The rasterisation with which the scene was trained.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rasterization: Option<Rasterization>,
    /// The origin of the scene: file, program, capture; free text, one line, at most 4096 bytes.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub provenance: Option<String>,
}

/// The sun under which photos were taken. In a file it is a direction, or an empty list if there
/// was none.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Vec<f64>", into = "Vec<f64>")]
pub enum PhotoSun {
    /// No sun: the light was diffuse, as under clouds.
    Diffuse,
    /// Towards it, world axes, length 1.
    Towards(DVec3),
}

impl PhotoSun {
    /// The sun by a point and the end of its shadow, world axes; `None` if they are one point.
    #[must_use]
    pub fn of_shadow(top: DVec3, end: DVec3) -> Option<Self> {
        (top - end).try_normalize().map(Self::Towards)
    }

    /// Changes the direction, if there is a sun.
    #[must_use]
    pub fn map(self, change: impl FnOnce(DVec3) -> DVec3) -> Self {
        match self {
            Self::Diffuse => Self::Diffuse,
            Self::Towards(direction) => Self::Towards(change(direction)),
        }
    }
}

impl TryFrom<Vec<f64>> for PhotoSun {
    type Error = String;

    fn try_from(numbers: Vec<f64>) -> Result<Self, String> {
        match numbers[..] {
            [] => Ok(Self::Diffuse),
            [x, y, z] => Ok(Self::Towards(DVec3::new(x, y, z))),
            _ => Err("sun must be three numbers, or an empty list if there was none".into()),
        }
    }
}

impl From<PhotoSun> for Vec<f64> {
    fn from(sun: PhotoSun) -> Self {
        match sun {
            PhotoSun::Diffuse => Self::new(),
            PhotoSun::Towards(direction) => direction.to_array().to_vec(),
        }
    }
}

/// The treatment of splats smaller than a pixel. It belongs to the scene: mixing modes changes the
/// opacity of thin splats visibly.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Rasterization {
    /// 0.3 px^2 is added to the variance of the 2D Gaussian and its opacity is kept, as in the
    /// reference 3DGS.
    #[default]
    Classic,
    /// 0.3 px^2 is added and the opacity is lowered by the growth in area (Mip-Splatting's 2D
    /// filter as gsplat has it), so that detail finer than a pixel does not swell.
    Antialiased,
}

impl Metadata {
    /// The keys, in the order in which they are written.
    #[rustfmt::skip]
    const KEYS: [&str; 29] = [
        "origin", "metres_per_unit", "scale_source", "scale_confidence", "up", "up_source",
        "up_confidence", "north", "north_source", "location", "captured", "captured_span", "sun",
        "ground", "ground_confidence", "camera_height", "airlight", "white_card", "haze_extinction",
        "haze_extinction_error", "haze_shown_extinction", "haze_airlight", "water", "water_labels",
        "lamps", "windows", "reflectances", "rasterization", "provenance",
    ];

    /// Largest coordinate of an origin, scene units.
    const MAX_ORIGIN_COORDINATE: f64 = 1e12;

    /// Scales that a scene can have, metres per unit.
    pub const SCALE_RANGE: RangeInclusive<f64> = 1e-6..=1e6;

    /// Brightnesses that a white card can have.
    pub const WHITE_CARDS: RangeInclusive<f64> = 0.1..=20.0;

    /// Most points of an outline.
    const MAX_OUTLINE_POINTS: usize = 1000;

    /// Longest provenance, bytes: it must fit into one header line.
    const MAX_PROVENANCE_BYTES: usize = 4096;

    /// Times of photos, since 1970, UTC: the years 1800 to 3000.
    pub const TIME_RANGE_S: RangeInclusive<f64> = -5_364_662_400.0..=32_503_680_000.0;

    /// Each key that has a value, with the value in TOML on one line.
    ///
    /// # Errors
    /// The text of [`Self::fault`]: such values would not be read back.
    pub fn entries(&self) -> Result<Vec<(&'static str, String)>, String> {
        if let Some(fault) = self.fault() {
            return Err(fault);
        }
        let table = toml::Table::try_from(self).map_err(|e| e.to_string())?;
        Ok(Self::KEYS.iter().filter_map(|key| Some((*key, table.get(*key)?.to_string()))).collect())
    }

    /// The metadata with the one value `value`, TOML on one line; `None` if no key is called `key`.
    ///
    /// # Errors
    /// The fault of the value, in one line.
    pub(crate) fn from_entry(key: &str, value: &str) -> Option<Result<Self, String>> {
        Self::KEYS.contains(&key).then(|| {
            let metadata: Self = toml::from_str(&format!("{key} = {value}"))
                .map_err(|e| format!("{key}: {}", wm_base::error::one_line(e.message())))?;
            metadata.fault().map_or(Ok(metadata), Err)
        })
    }

    /// `self` where it says something, `other` elsewhere. The source and the confidence of a fact
    /// go with the fact.
    #[must_use]
    pub fn or(self, mut other: Self) -> Self {
        // The other's word on a fact goes with its fact.
        if self.metres_per_unit.is_some() && other.metres_per_unit.is_some() {
            (other.scale_source, other.scale_confidence) = (None, None);
        }
        if self.up.is_some() && other.up.is_some() {
            (other.up_source, other.up_confidence) = (None, None);
        }
        if self.north.is_some() && other.north.is_some() {
            other.north_source = None;
        }
        if self.captured.is_some() && other.captured.is_some() {
            other.captured_span = None;
        }
        if self.ground.is_some() && other.ground.is_some() {
            other.ground_confidence = None;
        }
        if self.haze_extinction.is_some() && other.haze_extinction.is_some() {
            (other.haze_extinction_error, other.haze_shown_extinction) = (None, None);
        }
        macro_rules! merged {
            ($($field:ident)*) => { Self { $($field: self.$field.or(other.$field)),* } };
        }
        merged! {
            origin metres_per_unit scale_source scale_confidence up up_source up_confidence north
            north_source location captured captured_span sun ground ground_confidence camera_height
            airlight white_card haze_extinction haze_extinction_error haze_shown_extinction
            haze_airlight water water_labels lamps windows reflectances rasterization provenance
        }
    }

    /// The point of the world that is zero here, scene units.
    #[must_use]
    pub fn origin_or_zero(&self) -> DVec3 {
        self.origin.unwrap_or(DVec3::ZERO)
    }

    /// Makes `north` level again after `up` was changed, if both are known: its part along `up`
    /// goes. A north that stands at more than 45 degrees says nothing about the new level, and goes
    /// with its source.
    pub fn level_north(&mut self) {
        if let (Some(north), Some(up)) = (self.north, self.up) {
            self.north = leveled(north, up);
            self.north_source = self.north_source.take().filter(|_| self.north.is_some());
        }
    }

    /// The meteorological optical range of the haze in which the photos were taken, such as "MOR
    /// 148 m +- 9"; `None` if the air was clear.
    #[must_use]
    pub fn haze(&self) -> Option<String> {
        let extinction = self.haze_extinction?;
        let (unit, metres) = self.metres_per_unit.map_or(("units", 1.0), |metres| ("m", metres));
        let mor = MOR_DEPTH / extinction * metres;
        // Two digits of the error, or three of the range.
        let error = self.haze_extinction_error.map(|error| mor * error / extinction);
        let finest = error.map_or(mor / 100.0, |error| error / 10.0);
        let decimals = (-finest.max(1e-9).log10().floor()).clamp(0.0, 9.0) as usize;
        let error = error.map_or_else(String::new, |error| format!(" +- {error:.decimals$}"));
        Some(format!("MOR {mor:.decimals$} {unit}{error}"))
    }
}

/// The level part of `north`, length 1; `None` if it stands at more than 45 degrees.
pub(crate) fn leveled(north: DVec3, up: DVec3) -> Option<DVec3> {
    const MIN_LEVEL_LENGTH: f64 = std::f64::consts::FRAC_1_SQRT_2;
    let (north, up) = (north.try_normalize()?, up.try_normalize()?);
    let level = north - up * up.dot(north);
    (level.length() >= MIN_LEVEL_LENGTH).then(|| level.normalize())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::full;
    use proptest::prelude::*;

    #[test]
    fn the_list_of_keys_is_that_of_the_fields() {
        let table = toml::Table::try_from(full()).unwrap();
        assert_eq!(table.len(), Metadata::KEYS.len());
        assert!(Metadata::KEYS.iter().all(|key| table.contains_key(*key)));
    }

    #[test]
    fn entries_with_faults_are_told() {
        let say = |key, value| Metadata::from_entry(key, value).unwrap().unwrap_err();
        assert_eq!(say("metres_per_unit", "-1"), "metres_per_unit is -1: it must be 1e-6 to 1e6");
        let place = say("location", "[91.0, 0.0]");
        assert!(place.starts_with("location is 91, 0: it must be a latitude of -90 to 90"), "{place}");
        for (key, value) in
            [("up", "[0.0, 1.0]"), ("ground", ""), ("sun", "[1.0]"), ("rasterization", "\"soft\"")]
        {
            let message = say(key, value);
            assert!(message.starts_with(&format!("{key}: ")) && !message.contains('\n'), "{message}");
        }
        assert!(Metadata::from_entry("ceiling", "1.0").is_none());
        assert!(Metadata::from_entry("up = 1\nground", "1.0").is_none());
    }

    proptest! {
        #[test]
        fn entries_come_back(
            (scale, ground) in (1e-6..1e6, -1e10..1e10),
            numbers in prop::array::uniform2(prop::num::f64::NORMAL),
            provenance in "\\PC{0,40}",
        ) {
            let metadata = Metadata {
                metres_per_unit: Some(scale),
                ground: Some(ground),
                airlight: Some([numbers[0].abs(), numbers[1].abs(), 0.0]),
                provenance: Some(provenance),
                ..full()
            };
            prop_assume!(metadata.fault().is_none());
            let mut read = Metadata::default();
            for (key, value) in metadata.entries().unwrap() {
                prop_assert!(!value.contains(['\n', '\r']), "{value}");
                read = Metadata::from_entry(key, &value).unwrap().unwrap().or(read);
            }
            prop_assert_eq!(read, metadata);
        }
    }

    #[test]
    fn toml_round_trip_and_unknown_keys() {
        let metadata = full();
        let text = toml::to_string(&metadata).unwrap();
        assert_eq!(toml::from_str::<Metadata>(&text).unwrap(), metadata);
        assert!(toml::from_str::<Metadata>("meters_per_unit = 1.0").is_err());
    }

    #[test]
    fn haze_is_said_in_metres_where_the_scale_is_known() {
        let haze = full();
        assert_eq!(haze.haze().unwrap(), "MOR 122.8 m +- 9.2");
        let given = Metadata { metres_per_unit: None, haze_extinction_error: None, ..haze };
        assert_eq!(given.haze().unwrap(), "MOR 7.49 units");
        assert_eq!(Metadata::default().haze(), None);
    }

    #[test]
    fn what_a_scale_is_from_goes_with_it() {
        let file = full();
        let given = Metadata { metres_per_unit: Some(2.0), ..Metadata::default() };
        assert_eq!(given.clone().or(file.clone()).scale_source, None);
        assert_eq!(Metadata::default().or(file.clone()).scale_source, file.scale_source);
        // Keys are read one at a time, in any order.
        let alone = Metadata { scale_source: file.scale_source.clone(), ..Metadata::default() };
        assert_eq!(alone.clone().or(given.clone()), given.or(alone));
    }

    #[test]
    fn north_is_leveled_where_that_leaves_a_direction() {
        let mut metadata = Metadata { up: Some(DVec3::Z), north: Some(DVec3::new(0.0, 0.8, 0.6)), ..full() };
        metadata.level_north();
        assert_eq!((metadata.north, metadata.north_source.is_some()), (Some(DVec3::Y), true));
        metadata.up = Some(DVec3::NEG_Z);
        metadata.level_north();
        assert_eq!(metadata.north, Some(DVec3::Y));
        metadata.up = Some(DVec3::Y);
        metadata.level_north();
        assert_eq!((metadata.north, metadata.north_source), (None, None));
        assert_eq!(leveled(DVec3::ZERO, DVec3::Z), None);
        assert_eq!(leveled(DVec3::Y, DVec3::NAN), None);
    }

    #[test]
    fn faults_are_found() {
        assert_eq!(Metadata::default().fault(), None);
        for bad in [
            Metadata { origin: Some(DVec3::new(0.0, 1e13, 0.0)), ..Metadata::default() },
            Metadata { origin: Some(DVec3::NAN), ..Metadata::default() },
            Metadata { metres_per_unit: Some(0.0), ..Metadata::default() },
            Metadata { up: Some(DVec3::ZERO), ..Metadata::default() },
            Metadata { north: Some(DVec3::ONE), ..Metadata::default() },
            Metadata { north: Some(DVec3::NAN), ..Metadata::default() },
            Metadata { location: Some([90.5, 0.0]), ..Metadata::default() },
            Metadata { location: Some([0.0, f64::NAN]), ..Metadata::default() },
            Metadata { captured: Some(f64::INFINITY), ..Metadata::default() },
            Metadata { captured: Some(1e12), ..Metadata::default() },
            Metadata { captured_span: Some(-1.0), ..Metadata::default() },
            Metadata { ground: Some(f64::NAN), ..Metadata::default() },
            Metadata { airlight: Some([0.5, -1.0, 0.5]), ..Metadata::default() },
            Metadata { haze_airlight: Some([0.5, -1.0, 0.5]), ..Metadata::default() },
            Metadata { white_card: Some(0.0), ..Metadata::default() },
            Metadata { haze_extinction: Some(0.0), ..Metadata::default() },
            Metadata { haze_extinction_error: Some(f64::NAN), ..Metadata::default() },
            Metadata { lamps: Some(vec![Lamp { beam: 0.0, ..Lamp::new([0.0; 3]) }]), ..Metadata::default() },
            Metadata { provenance: Some("two\nlines".into()), ..Metadata::default() },
            Metadata { scale_source: Some("two\nlines".into()), ..Metadata::default() },
            Metadata { provenance: Some("x".repeat(5000)), ..Metadata::default() },
        ] {
            assert!(bad.fault().is_some());
        }
    }
}
