//! `weather from` and reports in the place of a weather file, by the program.

use crate::common::{Workshop, binary, run};
use weather_magician::Weather;

const METAR: &str = "METAR KJFK 291851Z 04014G22KT 1/2SM SN OVC008 M02/M03 A2979";

fn arguments(words: &[&str]) -> Vec<String> {
    words.iter().map(ToString::to_string).collect()
}

#[test]
fn a_report_becomes_a_weather_file() {
    let workshop = Workshop::new();
    let out = workshop.path("ny.toml");
    let printed = run(&arguments(&["weather", "from", METAR]));
    run(&arguments(&["weather", "from", METAR, "-o", out.to_str().unwrap()]));
    let text = std::fs::read_to_string(&out).unwrap();
    assert_eq!(String::from_utf8(printed.stdout).unwrap(), text);
    assert!(Weather::read(&out).unwrap().effects().any(|(effect, _)| effect.name == "snowfall"));
    // What exists is not replaced unasked.
    let again = binary().args(["weather", "from", METAR, "-o"]).arg(&out).output().unwrap();
    assert!(!again.status.success());

    let table = workshop.path("day.csv");
    std::fs::write(&table, "time,rain,temperature_2m\n2024-01-15T06:00,2,5\n2024-01-15T07:00,1,4\n").unwrap();
    let shorter = ["weather", "from", table.to_str().unwrap(), "--seconds-per-hour", "0.5"];
    let day = String::from_utf8(run(&arguments(&shorter)).stdout).unwrap();
    assert!(day.contains("[0.5, 1, \"hold\"]") && day.contains("lapse = 7200"), "{day}");
}

#[test]
fn errors_are_one_line() {
    let said = |words: &[&str]| {
        let output = binary().args(words).output().unwrap();
        assert!(!output.status.success(), "{words:?}");
        String::from_utf8(output.stderr).unwrap()
    };
    let near = said(&["weather", "from", "hevy rain"]);
    assert!(
        near.starts_with("error: words, character 1: `hevy` is no word for weather")
            && near.contains("`heavy`"),
        "{near}"
    );
    assert_eq!(near.lines().count(), 1);
    assert!(
        said(&["weather", "from", "day.json"])
            .starts_with("error: day.json: cannot read the weather report: no such file")
    );
    assert!(
        said(&["weather", "from", "ww 63", "--place", "north"])
            .contains("latitude and longitude are expected")
    );
}
