//! Faults of metadata: values that cannot be used.

use super::{Metadata, PhotoSun};
use crate::{lamps, reflectance, values::MAX_SCENE_COORDINATE};
use glam::DVec3;

impl Metadata {
    /// The first fault of a value, in one line; `None` if all can be used.
    #[must_use]
    pub fn fault(&self) -> Option<String> {
        self.direction_fault()
            .or_else(|| self.place_fault())
            .or_else(|| self.light_fault())
            .or_else(|| self.content_fault())
            .or_else(|| self.text_fault())
    }

    /// Faults of origin, scale and directions.
    fn direction_fault(&self) -> Option<String> {
        let most = Self::MAX_ORIGIN_COORDINATE;
        let is_near = |origin: &DVec3| origin.is_finite() && origin.abs().max_element() <= most;
        let origin = self.origin.filter(|origin| !is_near(origin));
        let scale = self.metres_per_unit.filter(|value| !Self::SCALE_RANGE.contains(value));
        origin
            .map(|origin| format!("origin is {origin}: each coordinate must be finite and at most {most:e}"))
            .or_else(|| Some(format!("metres_per_unit is {}: it must be 1e-6 to 1e6", scale?)))
            .or_else(|| unit_fault("up", self.up))
            .or_else(|| unit_fault("north", self.north))
    }

    /// Faults of place, time, sun and ground.
    fn place_fault(&self) -> Option<String> {
        if let Some([latitude, longitude]) = self.location
            && !(latitude.abs() <= 90.0 && longitude.abs() <= 180.0)
        {
            return Some(format!(
                "location is {latitude}, {longitude}: it must be a latitude of -90 to 90 and a longitude of -180 to 180 degrees"
            ));
        }
        let time = self.captured.filter(|time| !Self::TIME_RANGE_S.contains(time));
        let sun = match self.sun {
            Some(PhotoSun::Towards(sun)) => Some(sun),
            _ => None,
        };
        let is_near = |ground: &f64| ground.is_finite() && ground.abs() <= MAX_SCENE_COORDINATE.into();
        let ground = self.ground.filter(|ground| !is_near(ground));
        time.map(|time| {
            format!("captured is {time}: it must be seconds since 1970, in the years 1800 to 3000")
        })
        .or_else(|| negative_fault("captured_span", self.captured_span))
        .or_else(|| unit_fault("sun", sun))
        .or_else(|| Some(format!("ground is {}: it must be finite and within 10^10 units of zero", ground?)))
        .or_else(|| positive_fault("camera_height", self.camera_height))
    }

    /// Faults of the light and the haze.
    fn light_fault(&self) -> Option<String> {
        let light = |key: &str, light: Option<[f64; 3]>| {
            let light = light.filter(|light| light.iter().any(|v| !(v.is_finite() && *v >= 0.0)))?;
            Some(format!("{key} is {light:?}: each value must be finite and not below 0"))
        };
        let card = self.white_card.filter(|card| !Self::WHITE_CARDS.contains(card));
        let (least, most) = (Self::WHITE_CARDS.start(), Self::WHITE_CARDS.end());
        light("airlight", self.airlight)
            .or_else(|| light("haze_airlight", self.haze_airlight))
            .or_else(|| Some(format!("white_card is {}: it must be {least} to {most}", card?)))
            .or_else(|| positive_fault("haze_extinction", self.haze_extinction))
            .or_else(|| positive_fault("haze_shown_extinction", self.haze_shown_extinction))
            .or_else(|| negative_fault("haze_extinction_error", self.haze_extinction_error))
    }

    /// Faults of water, lamps, windows and reflectances.
    fn content_fault(&self) -> Option<String> {
        let most = Self::MAX_OUTLINE_POINTS;
        let is_outline = |outline: &Vec<[f64; 3]>| {
            let is_near = outline.iter().flatten().all(|v| v.abs() <= f64::from(MAX_SCENE_COORDINATE));
            is_near && (3..=most).contains(&outline.len())
        };
        if !self.water.iter().flatten().all(is_outline) {
            return Some(format!("water: an outline must have 3 to {most} points of finite numbers"));
        }
        if self.water_labels.iter().flatten().any(|label| *label == 0) {
            return Some("water_labels: 0 is what has no label; labels are 1 to 65535".into());
        }
        let (lamps, windows) = (self.lamps.as_deref(), self.windows.as_deref());
        lamps::fault(lamps.unwrap_or_default(), windows.unwrap_or_default())
            .or_else(|| reflectance::fault(self.reflectances.as_deref().unwrap_or_default()))
    }

    fn text_fault(&self) -> Option<String> {
        let limit = Self::MAX_PROVENANCE_BYTES;
        let is_bad = |text: &String| text.len() > limit || text.chars().any(char::is_control);
        let texts = [
            ("scale_source", &self.scale_source),
            ("up_source", &self.up_source),
            ("north_source", &self.north_source),
            ("provenance", &self.provenance),
        ];
        let (key, _) = texts.into_iter().find(|(_, text)| text.as_ref().is_some_and(is_bad))?;
        Some(format!("{key} must be one line of at most {limit} bytes, no control characters"))
    }
}

fn unit_fault(key: &str, vector: Option<DVec3>) -> Option<String> {
    let vector = vector.filter(|v| !(v.is_finite() && (v.length() - 1.0).abs() < 1e-3))?;
    Some(format!("{key} is {vector}: it must have length 1"))
}

fn positive_fault(key: &str, value: Option<f64>) -> Option<String> {
    let value = value.filter(|v| !(v.is_finite() && *v > 0.0))?;
    Some(format!("{key} is {value}: it must be finite and above 0"))
}

fn negative_fault(key: &str, value: Option<f64>) -> Option<String> {
    let value = value.filter(|v| !(v.is_finite() && *v >= 0.0))?;
    Some(format!("{key} is {value}: it must be finite and not below 0"))
}
