//! The demo's film: a walk down the street while fog closes in and begins to lift.

use weather_magician::Weather;
use wm_street::{Street, Viewpoint};
use wm_weather::WeatherError;

/// Speed of the camera as a multiple of walking speed, so that a short film covers some distance.
const SPEED_RATIO: f64 = 1.6;
/// Intervals between the keyframes of the fog, linear in each; enough that no kink is visible.
const KEYFRAME_INTERVAL_COUNT: u32 = 240;
/// Visibility before the fog: that of a clear day.
const CLEAR_VISIBILITY_M: f64 = 30_000.0;
/// Visibility in the thickest fog, which hides the end of the street, but not the next houses.
const FOG_VISIBILITY_M: f64 = 60.0;

/// Height over which the fog thins to 1/e, as in sea fog. Without a limit it would hide the sky from
/// the first frame on.
const FOG_SCALE_HEIGHT_M: f64 = 150.0;

/// The demo's film.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FogFilm {
    /// Length, seconds.
    pub(crate) seconds: f64,
}

impl FogFilm {
    /// Returns the camera's position and target at `time`, seconds.
    pub(crate) fn view(&self, time: f64) -> Viewpoint {
        // A long film covers the whole street, at a lower speed.
        let share = (self.seconds * SPEED_RATIO / Street::WALK_SECONDS).min(1.0);
        Street::dolly(share * time / self.seconds)
    }

    /// Returns the weather of the film.
    ///
    /// # Errors
    /// The film is so short that keyframes coincide.
    pub(crate) fn weather(&self) -> Result<Weather, WeatherError> {
        let keys: Vec<String> = (0..=KEYFRAME_INTERVAL_COUNT)
            .map(|key| f64::from(key) / f64::from(KEYFRAME_INTERVAL_COUNT))
            .map(|share| format!("[{}, {:.1}]", share * self.seconds, mor(share)))
            .collect();
        let text = format!(
            "name = \"fog closing in\"\nabout = \"From a clear day to thick fog, which begins to lift\"\n\
             [fog]\nscale_height = {FOG_SCALE_HEIGHT_M}\nmor = {{ keys = [{}] }}\n",
            keys.join(", ")
        );
        Weather::parse(&text, "the demo's weather")
    }
}

/// Returns the visibility, m, at a fraction of the film. It is interpolated in logarithms, since
/// equal ratios look alike.
fn mor(share: f64) -> f64 {
    let smooth = |from: f64, to: f64| {
        let t = ((share - from) / (to - from)).clamp(0.0, 1.0);
        t * t * (3.0 - 2.0 * t)
    };
    let closed = smooth(-0.15, 0.72) - 0.24 * smooth(0.80, 1.05);
    CLEAR_VISIBILITY_M * (FOG_VISIBILITY_M / CLEAR_VISIBILITY_M).powf(closed)
}

#[cfg(test)]
mod tests {
    use super::*;
    use wm_weather::ParamValue;

    fn mor_at(weather: &Weather, time: f64) -> f64 {
        let instant = weather.at(time);
        let (effect, values) = instant.effects().next().unwrap();
        match &values[effect.param("mor").unwrap()] {
            ParamValue::Number(mor) => *mor,
            other => panic!("{other}"),
        }
    }

    #[test]
    fn fog_closes_in_on_a_clear_day_and_begins_to_lift() {
        for seconds in [0.1, 8.0, 600.0] {
            let weather = FogFilm { seconds }.weather().unwrap();
            let at = |share: f64| mor_at(&weather, share * seconds);
            assert!(
                at(0.0) > 15_000.0 && at(1.0) > 3.0 * FOG_VISIBILITY_M && at(1.0) < 10.0 * FOG_VISIBILITY_M
            );
            assert!((at(0.76) - FOG_VISIBILITY_M).abs() < 0.1);
            let shares: Vec<f64> = (0..=60).map(|k| 0.72 * f64::from(k) / 60.0).collect();
            assert!(shares.windows(2).all(|pair| at(pair[1]) < at(pair[0])));
            // Nothing jumps: a fortieth of the film changes it by no more than half again.
            let steps: Vec<f64> = (0..=40).map(|k| at(f64::from(k) / 40.0)).collect();
            assert!(steps.windows(2).all(|pair| (0.66..1.5).contains(&(pair[1] / pair[0]))), "{steps:?}");
        }
    }

    #[test]
    fn short_films_go_part_of_the_way_and_long_ones_all_of_it() {
        let film = FogFilm { seconds: 8.0 };
        assert_eq!(film.view(0.0), Street::dolly(0.0));
        assert_eq!(film.view(8.0), Street::dolly(8.0 * SPEED_RATIO / Street::WALK_SECONDS));
        assert_eq!(FogFilm { seconds: 100.0 }.view(100.0), Street::dolly(1.0));
    }
}
