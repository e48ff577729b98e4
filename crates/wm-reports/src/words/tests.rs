use super::*;

fn words(text: &str) -> WordsReport {
    read(text).unwrap_or_else(|error| panic!("{error}")).0
}

#[test]
fn words_and_units_are_understood() {
    let told = words("heavy rain, wind 40 km/h from the west, visibility 300 m, -2 C");
    assert_eq!((told.rain, told.visibility, told.temperature), (Some(20.0), Some(300.0), Some(-2.0)));
    assert_eq!((told.wind_speed.map(f64::round), told.wind_from), (Some(11.0), Some(270.0)));

    let close = |value: Option<f64>, want: f64| {
        assert!((value.unwrap() - want).abs() < 0.006 * want.abs(), "{value:?} {want}");
    };
    close(words("wind 20 kt").wind_speed, 10.29);
    close(words("wind 20mph to the NE").wind_speed, 8.94);
    assert_eq!(words("wind 20mph to the NE").wind_from, Some(225.0));
    assert_eq!(words("wind 10 m/s from 30 degrees").wind_from, Some(30.0));
    close(words("wind force 6").wind_speed, 12.29);
    close(words("wind 6 Bft").wind_speed, 12.29);
    close(words("rain 0.5 in/h").rain, 12.7);
    close(words("visibility 2 miles").visibility, 3219.0);
    close(words("28.4 F").temperature, -2.0);
    close(words("fog, visibility 500 ft").visibility, 152.4);
    close(words("dense fog").visibility, 100.0);
    close(words("5 cm of snow").snow_depth, 0.05);
    assert!(!words("5 cm of snow").snows && words("light snow at night").snows);
    assert!(!words("snow on the ground").snows);
    assert_eq!(words("partly cloudy").clouds, Some(0.5));
    assert_eq!(words("clouds 30 %").clouds, Some(0.3));
    assert_eq!(words("mostly clear, no wind and no rain").clouds, Some(0.25));
    assert_eq!((words("no rain, no wind").rain, words("no wind").wind_speed), (None, Some(0.0)));
    assert_eq!(words("northwesterly gale").wind_from, Some(315.0));
    assert_eq!(words("calm and very cold at the blue hour").wind_speed, Some(0.0));
}

#[test]
fn what_is_not_understood_is_said_with_its_place() {
    for (text, error) in [
        (
            "heavy rian",
            "words, character 7: `rian` is no word for weather that is known here, did you mean `rain`?",
        ),
        ("wind 40", "words, character 6: `40` has no unit after it"),
        ("heavy, 3 C", "words, character 1: `heavy` says how strong and not what"),
        ("rain, 300 m", "words, character 7: `300` is a length of what"),
        ("rain, mostly", "words, character 7: `mostly` says how much and not of what"),
        ("5 C, 6 C", "words, character 6: `6` is told a second time"),
        ("wind 900 km/h", "words, character 6: `900` is no speed of the wind in m/s: 0 to 120 are expected"),
        ("dusk at noon", "words, character 9: `noon` is a second time of day"),
        ("humidity 130 %", "words, character 10: `130` is no share"),
        ("...", "words: nothing is said"),
    ] {
        let got = read(text).unwrap_err().to_string();
        assert!(got.starts_with(error), "{text}: {got}");
    }
}
