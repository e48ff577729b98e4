//! `weather from` and reports in the place of a weather file, by the program.

use crate::common::{Workshop, binary, run};
use crate::process::{fails, printed};
use weather_magician::Weather;

const METAR: &str = "METAR KJFK 291851Z 04014G22KT 1/2SM SN OVC008 M02/M03 A2979";

#[test]
fn a_report_becomes_a_weather_file() {
    let workshop = Workshop::new();
    let out = workshop.path("ny.toml");
    let told = printed(&run(&["weather", "from", METAR]));
    let into = ["weather", "from", METAR, "-o", out.to_str().unwrap()];
    run(&into);
    assert_eq!(told.as_bytes(), workshop.read("ny.toml"));
    assert!(Weather::read(&out).unwrap().effects().any(|(effect, _)| effect.name == "snowfall"));
    // What exists is not replaced unasked.
    assert!(!binary().args(into).output().unwrap().status.success());

    workshop.put("day.csv", "time,rain,temperature_2m\n2024-01-15T06:00,2,5\n2024-01-15T07:00,1,4\n");
    let day = workshop.run("weather from day.csv --seconds-per-hour 0.5");
    assert!(day.contains("[0.5, 1, \"hold\"]") && day.contains("lapse = 7200"), "{day}");
}

#[test]
fn errors_are_one_line() {
    for (words, says) in [
        (&["hevy rain"][..], &["error: words, character 1: `hevy` is no word for weather", "`heavy`"][..]),
        (&["day.json"], &["error: day.json: cannot read the weather report: no such file"]),
        (&["ww 63", "--place", "north"], &["latitude and longitude are expected"]),
    ] {
        fails(binary().args(["weather", "from"]).args(words), says, &[]);
    }
}
