//! The sun over a scene, from the place and the time at which its photos were taken.

use super::sourced::{Confidence, Sourced};
use crate::sun::SunPosition;
use crate::{Metadata, PhotoSun};
use glam::DVec3;
use std::f64::consts::TAU;
use thiserror::Error;

/// The direction of the sun when the photos were taken.
#[derive(Clone, Debug, PartialEq)]
pub struct SurveyedSun {
    /// The direction towards it, world axes, length 1.
    pub direction: DVec3,
    /// Azimuth, radians clockwise from north, 0 to 2 pi, where north is known.
    pub azimuth: Option<f64>,
    /// Elevation above the horizon, radians, 0 to pi/2.
    pub elevation: f64,
    /// The source, such as "from the time and the GPS of 24 photos, met within 1.1 m".
    pub source: String,
    /// Confidence in the direction: no more than in up, and likely if the photos took more than ten
    /// minutes.
    pub confidence: Confidence,
}

/// The reason why place and time give no sun.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum SunFault {
    /// The photos took so long that the sun moved, s.
    #[error("the photos were taken over {:.1} hours, in which it moved", .0 / 3600.0)]
    Long(f64),
    /// It was below the horizon, at an elevation in degrees.
    #[error("it was {:.1} degrees below the horizon at the time and place of the photos; one of them may be wrong", -.0)]
    Below(f64),
    /// The stated direction lies below the horizon, at an elevation in degrees.
    #[error("the stated one is {:.1} degrees below the horizon; it or up is wrong", -.0)]
    Under(f64),
}

/// Longest capture whose sun has one direction, s: it moves by up to 7.5 degrees in this time.
const MAX_SPAN_S: f64 = 1800.0;
/// Longest capture whose sun is sure, s: its ends are within 1.25 degrees of the middle.
const SURE_SPAN_S: f64 = 600.0;

/// The position of the sun at the place and the time of the photos; `None` if either is not known.
fn position(facts: &Metadata) -> Result<Option<SunPosition>, SunFault> {
    let (Some([latitude, longitude]), Some(time)) = (facts.location, facts.captured) else { return Ok(None) };
    let span = facts.captured_span.unwrap_or(0.0);
    if span > MAX_SPAN_S {
        return Err(SunFault::Long(span));
    }
    // Metadata have places and times for which it is defined.
    let Ok(position) = SunPosition::at(latitude, longitude, time) else { return Ok(None) };
    if position.elevation <= 0.0 {
        return Err(SunFault::Below(position.elevation.to_degrees()));
    }
    Ok(Some(position))
}

/// The elevation of the sun above the horizon when the photos were taken, radians, 0 to pi/2. It
/// needs no north. `None` if place or time is not known, the photos took too long, or the sun was
/// below the horizon.
pub(super) fn elevation(facts: &Metadata) -> Option<f64> {
    Some(position(facts).ok()??.elevation)
}

impl SurveyedSun {
    /// `None` if north, place or time are not known; `north` is level.
    pub(super) fn of(
        up: &Sourced<DVec3>,
        north: Option<DVec3>,
        facts: &Metadata,
    ) -> Result<Option<Self>, SunFault> {
        match facts.sun {
            Some(PhotoSun::Diffuse) => return Ok(None),
            Some(PhotoSun::Towards(sun)) => return Self::given(sun.normalize(), up.value, north).map(Some),
            None => {}
        }
        let Some(north) = north else { return Ok(None) };
        let Some(position) = position(facts)? else { return Ok(None) };
        let span = facts.captured_span.unwrap_or(0.0);
        let [along_east, along_north, along_up] = position.east_north_up();
        let east = north.cross(up.value);
        let own = if span > SURE_SPAN_S { Confidence::Likely } else { Confidence::Sure };
        let places = facts.north_source.as_deref().map(|text| format!("the time and {text}"));
        Ok(Some(Self {
            direction: (east * along_east + north * along_north + up.value * along_up).normalize(),
            azimuth: Some(position.azimuth),
            elevation: position.elevation,
            source: format!(
                "from {}",
                places.as_deref().unwrap_or("the time, place and north in the metadata")
            ),
            confidence: own.max(up.confidence),
        }))
    }

    /// Makes the sun of a direction that the metadata state.
    fn given(direction: DVec3, up: DVec3, north: Option<DVec3>) -> Result<Self, SunFault> {
        let elevation = direction.dot(up).clamp(-1.0, 1.0).asin();
        if elevation <= 0.0 {
            return Err(SunFault::Under(elevation.to_degrees()));
        }
        let azimuth = north.map(|north| direction.dot(north.cross(up)).atan2(direction.dot(north)));
        Ok(Self {
            direction,
            azimuth: azimuth.map(|azimuth| azimuth.rem_euclid(TAU)),
            elevation,
            source: "from the scene's metadata".into(),
            confidence: Confidence::Sure,
        })
    }

    /// One line for people: "47.1 degrees high, azimuth 118.8 degrees (from ...)".
    #[must_use]
    pub fn line(&self) -> String {
        let elevation = self.elevation.to_degrees();
        let azimuth = self
            .azimuth
            .map_or_else(String::new, |azimuth| format!(", azimuth {:.1} degrees", azimuth.to_degrees()));
        format!("{elevation:.1} degrees high{azimuth} ({}; {})", self.source, self.confidence)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::survey::facts::Survey;
    use crate::{Scene, synthetic};
    use std::f64::consts::FRAC_PI_2;

    /// The built-in park on 30 May 2024, 8:56 UTC.
    fn park() -> Metadata {
        Metadata {
            up: Some(DVec3::Z),
            north: Some(DVec3::Y),
            north_source: Some("the GPS of 24 photos".into()),
            location: Some([52.0851, 5.1683]),
            captured: Some(1_717_059_360.0),
            ..Metadata::default()
        }
    }

    fn survey(metadata: Metadata, given: &Metadata) -> Survey {
        Survey::of(&Scene { splats: synthetic::street(1).build(), metadata, ..Scene::default() }, given)
    }

    #[test]
    fn the_sun_follows_from_place_and_time() {
        let found = survey(park(), &Metadata::default());
        let sun = found.sun.clone().unwrap();
        let truth = DVec3::new(0.60, -0.33, 0.73);
        assert!(sun.direction.angle_between(truth).to_degrees() < 0.5, "{sun:?}");
        assert!((sun.direction.length() - 1.0).abs() < 1e-9 && sun.confidence == Confidence::Sure);
        let line = found.lines().into_iter().find(|line| line.starts_with("sun: ")).unwrap();
        let parts = ["sun: 4", " degrees high, azimuth 11", "(from the time and the GPS of 24 photos; sure)"];
        assert!(parts.iter().all(|part| line.contains(part)), "{line}");
        // Written down again, nothing is lost.
        let written = found.metadata().or(park());
        let facts = |of: Metadata| (of.north, of.north_source, of.location, of.captured);
        assert_eq!(facts(written), facts(park()));
    }

    #[test]
    fn the_sun_turns_with_the_axes() {
        let sun = survey(park(), &Metadata::default()).sun.unwrap();
        // x north, y down, z west.
        let other = Metadata { up: Some(DVec3::NEG_Y), north: Some(DVec3::X), ..park() };
        let [east, north, up] = sun.direction.to_array();
        let turned = survey(other, &Metadata::default()).sun.unwrap().direction;
        assert!((turned - DVec3::new(north, -up, -east)).length() < 1e-9, "{turned}");
    }

    #[test]
    fn north_is_leveled_along_another_up() {
        let given = Metadata { up: Some(DVec3::new(0.0, 0.2, 1.0).normalize()), ..Metadata::default() };
        let found = survey(park(), &given);
        let north = found.north.unwrap();
        assert!(north.dot(found.up.value).abs() < 1e-12 && north.y > 0.9);
        let sun = found.sun.unwrap();
        let sine = sun.direction.dot(found.up.value);
        assert!((sine.asin() - sun.elevation).abs() < 1e-9);
        let steep = Metadata { up: Some(DVec3::Y), ..Metadata::default() };
        let found = survey(park(), &steep);
        assert_eq!((found.north, found.sun, found.sun_fault), (None, None, None));
    }

    #[test]
    fn what_is_missing_gives_no_sun() {
        for lacking in [
            Metadata { north: None, ..park() },
            Metadata { location: None, ..park() },
            Metadata { captured: None, ..park() },
        ] {
            let has_north = lacking.north.is_some();
            let found = survey(lacking, &Metadata::default());
            assert_eq!((found.sun.as_ref(), found.sun_fault), (None, None));
            // Place and time tell how high it stood.
            assert_eq!(found.sun_elevation.is_none(), has_north);
            assert_eq!(
                found.lines().iter().any(|line| line.ends_with("they do not tell north)")),
                !has_north
            );
        }
        assert_eq!(survey(park(), &Metadata::default()).sun_elevation, None);
    }

    #[test]
    fn nights_and_long_captures_give_no_sun_and_say_so() {
        let line = |metadata: Metadata| {
            let found = survey(metadata, &Metadata::default());
            assert!(found.sun.is_none());
            found.lines().into_iter().find(|line| line.starts_with("sun: ")).unwrap()
        };
        let night = line(Metadata { captured: Some(1_717_059_360.0 + 12.0 * 3600.0), ..park() });
        assert!(night.contains("degrees below the horizon") && !night.contains('-'), "{night}");
        let long = line(Metadata { captured_span: Some(9000.0), ..park() });
        assert_eq!(long, "sun: not known: the photos were taken over 2.5 hours, in which it moved");
        let twenty = Metadata { captured_span: Some(1200.0), ..park() };
        let sun = survey(twenty, &Metadata::default()).sun.unwrap();
        assert!(sun.confidence == Confidence::Likely && sun.elevation < FRAC_PI_2);
    }
}
