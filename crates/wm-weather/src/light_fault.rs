//! Faults of the light of a weather at a place.

use crate::effects::light::LOWEST_SHADOWS;
use crate::optics::Site;
use crate::param::ParamValue;
use crate::weather::Weather;

/// The reason why a weather's light is not defined at a site.
#[must_use]
pub fn light_fault(weather: &Weather, site: &Site) -> Option<String> {
    let (effect, tracks) = weather.effects().find(|(effect, _)| effect.name == "light")?;
    // Every value that a parameter is given.
    let values = |param: &str| {
        let track = effect.param(param).map(|param| &tracks[param]);
        track.into_iter().flat_map(|track| track.keys().iter().map(|key| &key.value))
    };
    let says = |param: &str, word: &'static str| values(param).any(|value| *value == ParamValue::Word(word));
    if !says("model", "clear") {
        return None;
    }
    let highest = values("sun_elevation")
        .map(ParamValue::number)
        .reduce(|a, b| Some(a?.max(b?)))
        .flatten()
        .filter(|elevation| *elevation <= LOWEST_SHADOWS);
    if let Some(elevation) = highest.filter(|_| says("cloud_shadows", "on")) {
        return Some(format!(
            "light.cloud_shadows needs a sun: light.sun_elevation is {elevation} degrees and must be above {LOWEST_SHADOWS}"
        ));
    }
    let is_given = |param: &str| values(param).any(|value| value.number().is_some());
    let asks = is_given("hour") && !is_given("sun_elevation");
    (asks && !is_given("latitude") && site.earth.is_none()).then(|| {
        "light.hour needs a place, and the scene does not say where it is: give light.latitude, or light.sun_elevation".into()
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::SITE;

    #[test]
    fn an_hour_without_a_place_is_a_fault() {
        let fault = |text: &str| {
            let weather = Weather::parse(&format!("[light]\nmodel = 'clear'\n{text}\n"), "test").unwrap();
            light_fault(&weather, &SITE)
        };
        assert!(fault("hour = 12").unwrap().contains("light.latitude"));
        assert_eq!(fault("hour = 12\nlatitude = 10"), None);
        assert_eq!(fault("sun_elevation = 12"), None);
        assert!(fault("sun_elevation = -3\ncloud_shadows = 'on'").unwrap().contains("needs a sun"));
        assert_eq!(fault("sun_elevation = { keys = [[0, 9], [5, -3]] }\ncloud_shadows = 'on'"), None);
    }
}
