//! Random and damaged reports: nothing panics, and whatever is read is a weather.

use proptest::prelude::*;
use wm_reports::{ReportOptions, WeatherReport};
use wm_weather::Weather;

const METARS: &str = include_str!("../fixtures/metar.txt");
const CARLA: &str = include_str!("../fixtures/carla.txt");
const JSON: &str = include_str!("../fixtures/open-meteo-day.json");
const CSV: &str = include_str!("../fixtures/open-meteo-day.csv");
const WORDS: &str = "heavy rain, wind 40 km/h from the west, visibility 300 m, -2 C
very dense ground fog at dawn, calm and 5 cm of snow on the ground
light snow 2 mm/h with gusts of 60 mph to the north east, humidity 90 %, golden hour";

/// Reports to be damaged.
fn reports() -> Vec<String> {
    let lines =
        METARS.lines().chain(CARLA.lines()).chain(WORDS.lines()).filter(|line| !line.starts_with('#'));
    lines.map(String::from).chain([JSON.into(), CSV.into(), "ww 63".into()]).collect()
}

/// Reads a text, and holds the weather against its own file.
fn read(text: &str) -> bool {
    let options = ReportOptions { place: Some([47.0, 8.0]), ..ReportOptions::default() };
    match WeatherReport::read(text, "text", &options) {
        Ok(report) => {
            let again = Weather::parse(report.to_toml(), "again");
            assert_eq!(again.as_ref(), Ok(report.weather()), "{text}\n{}", report.to_toml());
            true
        }
        Err(error) => {
            assert_eq!(error.to_string().lines().count(), 1, "{text}: {error}");
            false
        }
    }
}

/// A damage: where, what is done, and the character.
type Damage = (prop::sample::Index, u8, char);

fn damage(text: &str, damages: &[Damage]) -> String {
    let mut chars: Vec<char> = text.chars().collect();
    for (place, kind, c) in damages {
        let place = place.index(chars.len().max(1));
        match kind % 4 {
            0 if place < chars.len() => chars[place] = *c,
            1 if place < chars.len() => _ = chars.remove(place),
            2 => chars.insert(place.min(chars.len()), *c),
            _ => chars.truncate(place.max(1)),
        }
    }
    chars.into_iter().collect()
}

fn damages() -> impl Strategy<Value = Vec<Damage>> {
    let c = prop_oneof![prop::char::range(' ', '~'), prop::char::range('0', '9'), Just('\n'), any::<char>()];
    // Cutting is rarer than the others, so that texts stay long.
    prop::collection::vec((any::<prop::sample::Index>(), prop_oneof![12 => 0u8..3, 1 => Just(3u8)], c), 0..5)
}

/// Twice the usual cases, as texts are damaged in many ways.
fn config() -> ProptestConfig {
    let usual = ProptestConfig::default();
    ProptestConfig { cases: 2 * usual.cases, failure_persistence: None, ..usual }
}

proptest! {
    #![proptest_config(config())]

    #[test]
    fn damaged_reports_are_errors_or_weathers(which in any::<prop::sample::Index>(), damages in damages()) {
        let reports = reports();
        read(&damage(&reports[which.index(reports.len())], &damages));
    }

    #[test]
    fn random_text_is_an_error_or_a_weather(text in "\\PC{0,60}", kind in 0usize..6) {
        let head = ["", "METAR KJFK ", "CARLA ", "ww ", "time,rain\n", "{\"hourly\":"][kind];
        read(&format!("{head}{text}"));
    }
}

#[test]
fn the_fixtures_are_weathers() {
    for report in reports() {
        assert!(read(&report), "{report}");
    }
}

/// Long texts are refused at once, or read in time that goes with their length.
#[test]
fn long_texts_end() {
    for part in ["wind ", "\n", "#\n", "METAR ", "5 m/s ", "{", "a=1 ", "time,rain\n", "\"time\","] {
        read(&part.repeat(50_000));
    }
}
