//! The weathers of a plan: lists, grids, instants of one weather, and samples of distributions with
//! rules.

mod entry;
mod source;

pub(crate) use entry::{FindWeather, WeatherEntry, meant};
#[cfg(test)]
use source::KeyedResult;
pub use source::PlannedWeather;
pub(crate) use source::{SamplePlace, WeatherSource, seeded, value_of};

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;
    use wm_weather::Weather;

    fn find(name: &str, _: &Path) -> Result<Weather, String> {
        Weather::find(name).map_err(|error| error.to_string())
    }

    fn source(text: &str) -> KeyedResult<WeatherSource> {
        let entry: WeatherEntry = toml::from_str(text).unwrap();
        entry.source(Path::new(""), &find)
    }

    #[test]
    fn grids_and_lists_have_every_weather_once() {
        let list = source("from = [\"fog\", \"snow\"]\nat = [0, 5, 10]").unwrap();
        assert_eq!((list.count(), list.is_sampled()), (6, false));
        let place = SamplePlace { seed: 1, index: 0, count: 1 };
        let of = |source: &WeatherSource, number| source.weather(number, place).unwrap();
        assert_eq!((of(&list, 1).weather.name.as_str(), of(&list, 1).at), ("fog", 5.0));
        assert_eq!((of(&list, 5).weather.name.as_str(), of(&list, 5).at), ("snow", 10.0));
        let grid = source("[grid]\n\"fog.mor\" = [50, 100, 200]\n\"rain.rate\" = [1, 10.5]").unwrap();
        let all: Vec<(f64, f64)> = (0..grid.count())
            .map(|number| {
                let weather = of(&grid, number).weather;
                (value_of(&weather, "fog.mor", 0.0).unwrap(), value_of(&weather, "rain.rate", 0.0).unwrap())
            })
            .collect();
        assert_eq!(
            all,
            [(50.0, 1.0), (50.0, 10.5), (100.0, 1.0), (100.0, 10.5), (200.0, 1.0), (200.0, 10.5)]
        );
    }

    #[test]
    fn natural_samples_obey_their_rules_and_fill_their_ranges() {
        const COUNT: u64 = 2000;
        let natural = source("samples = 2000").unwrap();
        let [mut rainy, mut snowy, mut foggy] = [0; 3];
        for index in 0..COUNT {
            let planned = natural.weather(0, SamplePlace { seed: 5, index, count: COUNT }).unwrap();
            let on = |name: &str| planned.weather.effects().any(|(effect, _)| effect.name == name);
            let temperature = planned.variables["temperature"];
            assert!(!on("rain") || temperature > 0.0);
            assert!(!on("snowfall") || temperature < 2.0);
            assert!(!on("fog") || value_of(&planned.weather, "wind.speed", 0.0).unwrap() <= 8.0);
            assert_eq!(on("rain"), on("splash"));
            rainy += u32::from(on("rain"));
            snowy += u32::from(on("snowfall"));
            foggy += u32::from(on("fog"));
            let text = planned.weather.to_toml();
            assert_eq!(Weather::parse(&text, "sample").unwrap().to_toml(), text);
        }
        // Half of the 77 % above freezing; half of the 31 % below 2 degrees; 35 % of the 93 % in
        // little wind.
        assert!((700..850).contains(&rainy), "{rainy}");
        assert!((240..380).contains(&snowy), "{snowy}");
        assert!((560..700).contains(&foggy), "{foggy}");
    }

    #[test]
    fn seeds_are_those_of_the_clip() {
        let weather = Weather::preset("sleet").unwrap();
        let of = |clip| {
            let weather = seeded(weather.clone(), 9, clip).unwrap();
            [value_of(&weather, "rain.seed", 0.0), value_of(&weather, "snowfall.seed", 0.0)]
        };
        assert_eq!(of(4), of(4));
        assert_ne!(of(4), of(5));
    }

    #[test]
    fn faults_name_their_key() {
        for (text, key, says) in [
            ("from = [\"fogg\"]", "from", "did you mean `fog`?"),
            ("from = [\"fog\"]\nsamples = 3", "weather", "one of"),
            ("samples = 0", "samples", "from 1"),
            ("from = [\"fog\"]\nset = { \"fog.mor\" = -4 }", "set fog.mor", "must"),
            ("[grid]\n\"fog.moor\" = [3]", "grid fog.moor", "mor"),
            (
                "samples = 3\nvary.\"fog.mor\" = { distribution = \"even\" }",
                "vary fog.mor",
                "no distribution",
            ),
            (
                "samples = 3\nvary.\"fog.mor\" = { distribution = \"uniform\", min = 3 }",
                "vary fog.mor",
                "max is missing",
            ),
            (
                "samples = 3\nvary.\"rain.rate\" = { distribution = \"uniform\", min = 3, max = 999 }",
                "vary rain.rate",
                "300",
            ),
            (
                "samples = 3\nvary.\"rain.rate\" = { distribution = \"uniform\", min = 3, max = 9, mean = 2 }",
                "vary rain.rate",
                "mean is not",
            ),
            (
                "samples = 3\nvary.heat = { distribution = \"uniform\", min = 3, max = 9 }",
                "vary heat",
                "nothing uses",
            ),
            (
                "samples = 3\n[[rules]]\nwhen = \"temperatur < 3\"\noff = [\"fog\"]",
                "rules, when = \"temperatur < 3\"",
                "neither",
            ),
            (
                "samples = 3\n[[rules]]\nwhen = \"fogg\"\noff = [\"fog\"]",
                "rules, when = \"fogg\"",
                "did you mean",
            ),
            ("samples = 3\n[[rules]]\nwhen = \"fog\"", "rules, when = \"fog\"", "changes nothing"),
            ("from = [\"fog\"]\nat = [inf]", "at", "no time"),
        ] {
            let (found, fault) = source(text).unwrap_err();
            assert!(found == key && fault.contains(says), "{text}: {found}: {fault}");
        }
    }
}
