use super::*;
use crate::{ReportOptions, WeatherReport};
use wm_weather::{ParamValue, Track, Weather};

const JSON: &str = include_str!("../../fixtures/open-meteo-day.json");
const CSV: &str = include_str!("../../fixtures/open-meteo-day.csv");

/// The track of a parameter, `effect.parameter`, of an effect that is on.
pub(crate) fn track<'a>(weather: &'a Weather, key: &str) -> Option<&'a Track> {
    let (effect, param) = key.split_once('.')?;
    let (effect, tracks) = weather.effects().find(|(on, _)| on.name == effect)?;
    tracks.get(effect.param(param)?)
}

/// The number of a parameter at the beginning, if its effect is on.
pub(crate) fn value(weather: &Weather, key: &str) -> Option<f64> {
    track(weather, key)?.at(0.0).number()
}

/// Integral of a track over a time by the midpoints of small steps: not by the track's own.
fn integral(track: &Track, seconds: f64) -> f64 {
    let steps = 48_000;
    let length = seconds / f64::from(steps);
    let at = |step: i32| track.at(length * (f64::from(step) + 0.5)).number().unwrap();
    (0..steps).map(at).sum::<f64>() * length
}

#[test]
fn json_and_csv_of_a_day_are_the_same_table() {
    let table = WeatherTable::parse_json(JSON, "day.json").unwrap();
    assert_eq!(table, WeatherTable::parse_csv(CSV, "day.csv").unwrap());
    assert_eq!((table.rows.len(), table.step, table.place), (24, 1.0, Some([47.36, 8.56])));
    // Local midnight is 23 h UTC.
    assert_eq!(time::written(table.rows[0].time), "2024-01-14 23:00");
    let row = &table.rows[9];
    assert_eq!((row.rain, row.temperature, row.code), (2.6, Some(2.4), Some(63)));
    assert_eq!((row.wind_speed, row.wind_from, row.cloud_cover), (Some(5.0), Some(250.0), Some(1.0)));
    assert!((table.snow_sum() - 8.75 / 0.7).abs() < 1e-9, "8.75 cm of snow: {}", table.snow_sum());
}

#[test]
fn the_sums_of_the_table_are_those_of_the_weather() {
    let table = WeatherTable::parse_json(JSON, "day.json").unwrap();
    for seconds_per_hour in [1.0, 0.35, 20.0] {
        let options = ReportOptions { seconds_per_hour, ..ReportOptions::default() };
        let report = table.weather("day", &options).unwrap();
        let weather = report.weather();
        for (key, sum) in [("rain.rate", table.rain_sum()), ("snowfall.rate", table.snow_sum())] {
            let own = integral(track(weather, key).unwrap(), 24.0 * seconds_per_hour) / seconds_per_hour;
            assert!((own / sum - 1.0).abs() < 1e-3, "{key}: {own} for {sum} mm");
        }
        // The hour of 2.6 mm of rain is before the row of 9 h.
        let rain = track(weather, "rain.rate").unwrap();
        assert_eq!(rain.at(9.5 * seconds_per_hour), ParamValue::Number(2.6));
        for lapse in ["wetness.lapse", "snow_cover.lapse"] {
            let number = value(weather, lapse).unwrap();
            assert!((number * seconds_per_hour / 3600.0 - 1.0).abs() < 1e-3, "{lapse}");
        }
    }
}

#[test]
fn the_sun_and_the_wind_go_as_they_do() {
    let report = WeatherTable::parse_json(JSON, "day.json")
        .unwrap()
        .weather("day", &ReportOptions::default())
        .unwrap();
    let weather = report.weather();
    // 22 h UTC at 8.56 degrees east are 22:34 of mean solar time, and 24 h later they are again.
    let hour = track(weather, "light.hour").unwrap();
    for (time, want) in [(0.0, 22.5707), (24.0, 46.5707)] {
        assert!((hour.at(time).number().unwrap() - want).abs() < 1e-3, "{time}: {:?}", hour.at(time));
    }
    // Most of a winter's day is night or overcast.
    let radiation = value(weather, "wetness.radiation").unwrap();
    assert!((-25.0..30.0).contains(&radiation), "{radiation}");
    assert_eq!(value(weather, "light.day"), Some(14.0));
    // 350 to 10 degrees is 20 degrees, not 340.
    let text = "time,wspd,wdir\n2024-01-15 06:00,18,350\n2024-01-15 07:00,18,10\n";
    let report = WeatherTable::parse_csv(text, "t").unwrap().weather("t", &ReportOptions::default()).unwrap();
    let direction = track(report.weather(), "wind.direction").unwrap();
    assert_eq!(direction.at(1.5), ParamValue::Number(180.0));
}

#[test]
fn tables_of_meteostat_and_of_units_are_read() {
    let text = "date;hour;temp;rhum;prcp;snow;wspd;coco\n2024-01-15;6;-1,5;90;1,2;40;18,0;15\n2024-01-15;7;3,0;90;2,0;;36,0;8\n";
    let table = WeatherTable::parse_csv(text, "m.csv").unwrap();
    assert_eq!(
        (table.rows[0].snow, table.rows[0].snow_depth, table.rows[0].code),
        (1.2, Some(0.04), Some(73))
    );
    assert_eq!(
        (table.rows[1].rain, table.rows[1].wind_speed, table.rows[1].snow_depth),
        (2.0, Some(10.0), None)
    );
    let newer = "time,temp,snow,snwd,cldc,wspd\n2024-01-15 06:00:00,0,7,12,6,\n";
    let row = WeatherTable::parse_csv(newer, "m.csv").unwrap().rows[0].clone();
    assert!((row.snow - 10.0).abs() < 1e-9 && row.snow_depth == Some(0.12) && row.cloud_cover == Some(0.75));
    let units = "time,temperature_2m (\u{b0}F),rain (inch),wind_speed_10m (mp/h),visibility (ft)\n1705298400,32,0.1,10,3000\n";
    let row = WeatherTable::parse_csv(units, "u.csv").unwrap().rows[0].clone();
    assert_eq!(
        (row.time, row.temperature, row.visibility.map(f64::round)),
        (1_705_298_400, Some(0.0), Some(914.0))
    );
    assert!((row.rain - 2.54).abs() < 1e-9 && (row.wind_speed.unwrap() - 4.4704).abs() < 1e-9);
}

#[test]
fn what_is_wrong_is_said_with_line_and_column() {
    for (text, error) in [
        ("time,rain\n2024-01-15T06:00,wet\n", "t.csv:2: rain is `wet`: a number is expected"),
        ("time,rain\n2024-01-15T06:00\n", "t.csv:2: has 1 cells: 2 are expected"),
        ("time,rain\n2024-01-35T06:00,1\n", "t.csv:2: time is `2024-01-35T06:00`: a time is expected"),
        (
            "time,rain\n2024-01-15T06:00,-1\n",
            "t.csv:2: rain is -1, -1 in the unit used here: must be 0 to 500",
        ),
        (
            "time,rain\n2024-01-15T06:00,1\n2024-01-15T06:00,1\n",
            "t.csv:3: time is 2024-01-15 06:00 after 2024-01-15 06:00",
        ),
        (
            "time,rian\n2024-01-15T06:00,1\n",
            "t.csv: is no table of a known service (it has no column of weather, did you mean `rain`?)",
        ),
        (
            "tine,rain\n2024-01-15T06:00,1\n",
            "t.csv: is no table of a known service (it has no column `time`; `tine` is none, did you mean `time`?)",
        ),
        ("time,rain (buckets)\n2024-01-15T06:00,1\n", "t.csv: column rain has the unit `buckets`"),
        ("time,rain\n", "t.csv: has no rows"),
    ] {
        let got = WeatherTable::parse_csv(text, "t.csv").unwrap_err().to_string();
        assert!(got.starts_with(error), "{text}: {got}");
    }
    for (text, error) in [
        (
            "{\"hourly\": {\"time\": [\"2024-01-15T06:00\"], \"rain\": [\"x\"]}}",
            "t.json: hourly.rain[0] is `x`",
        ),
        (
            "{\"hourly\": {\"time\": [\"2024-01-15T06:00\"], \"rain\": [1, 2]}}",
            "t.json: hourly.time has 1 values: 2 are",
        ),
        ("{\"hourly\": 3}", "t.json: is no table of a known service (it has hourly); known are Open-Meteo"),
        ("{\"error\": true, \"reason\": \"Cannot\"}", "t.json: is an error of the service: `Cannot`"),
        ("{\n\"hourly\": ", "t.json:2: is no JSON"),
    ] {
        let got = WeatherTable::parse_json(text, "t.json").unwrap_err().to_string();
        assert!(got.starts_with(error), "{text}: {got}");
    }
}

/// Notes of what was not measured.
fn missing(text: &str) -> Vec<String> {
    let table = WeatherTable::parse_csv(text, "t.csv").unwrap();
    let notes = table.notes.iter().filter(|note| note.kind == crate::ReportNoteKind::Missing);
    notes.map(|note| note.text.clone()).collect()
}

#[test]
fn what_is_not_in_a_table_is_told() {
    let rows = |values: &[&str]| -> String {
        let rows = values.iter().enumerate().map(|(hour, row)| format!("2024-01-15T{hour:02}:00,{row}\n"));
        format!("time,temperature_2m,wind_speed_10m,visibility,rain\n{}", rows.collect::<String>())
    };
    let always = "humidity, direction of the wind, clouds, depth of snow";
    // Hours that were not forecast yet.
    assert_eq!(
        missing(&rows(&["1,10,5000,0", "2,11,4000,0.2", ",,,", ",,,"])),
        [
            "amounts of rain and snow in 2 of 4 rows: nothing fell",
            always,
            "the last 2 of 4 rows, which have no values: they repeat the row before",
        ]
    );
    // Dry hours have a value.
    assert_eq!(
        missing(&rows(&["1,10,5000,0", "2,,,0", ",,,0"])),
        [
            always,
            "temperature in 1 of 3 rows: taken from the rows beside",
            "wind in 2 of 3 rows: taken from the rows beside",
            "visibility in 2 of 3 rows: taken from the rows beside",
        ]
    );
    assert_eq!(
        missing(&rows(&["1,10,5000,0", "2,11,4000,0.2", "2,11,4000,0.2", "2,11,4000,0.2", "2,11,4000,0.2"])),
        [always, "perhaps the last 3 of 5 rows: they repeat the row before in all values"]
    );
    assert_eq!(missing(&rows(&["1,10,5000,0", "2,10,5000,0", "2,10,5000,0"])), [always]);
    assert_eq!(missing("time,temperature_2m\n2024-01-15T06:00,\n"), ["anything: no row has a value"]);
    let text = WeatherTable::parse_csv(&rows(&["1,10,5000,0", ",,,"]), "t.csv").unwrap();
    let report = text.weather("t", &ReportOptions::default()).unwrap();
    assert!(report.to_toml().contains("# not measured: the last 1 of 2 rows"), "{}", report.to_toml());
}

#[test]
fn tables_of_unknown_services_are_told_as_such() {
    let said = |text: &str| {
        let error = WeatherReport::read(text, "t", &ReportOptions::default()).unwrap_err().to_string();
        assert!(error.lines().count() == 1 && error.contains("known are Open-Meteo"), "{text}: {error}");
        error
    };
    for (text, found) in [
        (
            r#"{"weather": [{"timestamp": "2023-05-23T00:00Z", "precipitation": 0.4, "condition": "rain"}], "sources": []}"#,
            "(it has a list `weather` of objects of ",
        ),
        (
            r#"{"hourly": [{"dt": 1612352237, "temp": 2, "clouds": 100, "wind_deg": 83}]}"#,
            "a list `hourly` of objects of ",
        ),
        (r#"{"hourly": {"summary": "x", "data": [{"time": 1, "cloudCover": 0.2}]}}"#, "(it has hourly)"),
        (r#"[{"dt": 1, "cloudiness": 3}, {"dt": 2}]"#, "(it has a list of objects of "),
        (r#"{"cloudiness": {"all": 3}, "wetness": [1, 2]}"#, "it has no column `time`"),
        ("[]", "is no table of a known service"),
        (
            "STATIONS_ID;MESS_DATUM;QN_9;TT_TU;RF_TU;eor\n44;2025011900;3;-1.9;100.0;eor\n",
            "the columns of Deutscher Wetterdienst",
        ),
        ("station,valid,tmpf,sknt\nJFK,2024-01-15 06:51,32.0,10\n", "it has no column `time`"),
        (
            "STATION,DATE,WND,TMP\n1,2024-01-15T06:51:00,\"290,1,N,0103,1\",\"+0100,1\"\n",
            "no column of weather",
        ),
    ] {
        assert!(said(text).contains(found), "{text}: {}", said(text));
    }
    let daily = r#"{"latitude": 1, "longitude": 2, "daily_units": {}, "daily": {"time": []}}"#;
    let error = WeatherTable::parse_json(daily, "t").unwrap_err().to_string();
    assert_eq!(error, "t: has no `hourly`: ask Open-Meteo for hourly values");
    let page = WeatherReport::read("<!doctype html>", "t", &ReportOptions::default()).unwrap_err();
    assert!(page.to_string().starts_with("t: is XML or HTML"));
    let empty = WeatherReport::read("\n# nothing\n", "t", &ReportOptions::default()).unwrap_err();
    assert_eq!(empty.to_string(), "t: is empty: a report is expected");
}

#[test]
fn files_of_whole_stations_have_no_names() {
    let text =
        "2024-01-15,6,-1.5,-2.5,93,1.2,40,270,18.0,30.1,1013.2,,15\n2024-01-15,7,3.0,2,93,2.0,,,36.0,,,,8\n";
    let table = WeatherTable::parse_csv(text, "10637.csv").unwrap();
    assert_eq!(
        (table.rows.len(), table.rows[0].temperature, table.rows[1].wind_speed),
        (2, Some(-1.5), Some(10.0))
    );
    let read = WeatherReport::read(text, "10637.csv", &ReportOptions::default()).unwrap();
    assert_eq!(read.decoded, crate::DecodedReport::Table(table));
}

#[test]
fn tables_of_services_that_are_not_read_are_named() {
    for (names, row, service) in [
        (
            "name,datetime,temp,precip,precipprob,windspeed,sealevelpressure,visibility",
            "Cairo,2025-03-14T00:00:00,18.5,0,0,2.5,1015,24.1",
            "Visual Crossing",
        ),
        (
            "station,valid,tmpf,drct,sknt,vsby",
            "VTUU,2023-06-01 00:00,82.4,180,10,6.00",
            "the Iowa Environmental Mesonet",
        ),
        ("STATIONS_ID,MESS_DATUM,RF_TU", "44,2024010100,97", "Deutscher Wetterdienst"),
    ] {
        let error = WeatherTable::parse_csv(&format!("{names}\n{row}\n"), "a.csv").unwrap_err().to_string();
        let says = format!("it has the columns of {service}, which are not read");
        assert!(error.contains(&says) && !error.contains('\n'), "{error}");
    }
}

/// 24.1 without a unit is no dense fog.
#[test]
fn small_visibilities_need_a_unit() {
    let read = |name: &str, visibility: &str| {
        WeatherTable::parse_csv(&format!("time,{name}\n2025-03-14T00:00,{visibility}\n"), "a.csv")
    };
    let error = read("visibility", "24.1").unwrap_err().to_string();
    assert!(error.contains("column visibility has no unit and no value above 24.1"), "{error}");
    assert_eq!(read("visibility (km)", "24.1").unwrap().rows[0].visibility, Some(24_100.0));
    assert_eq!(read("visibility (m)", "24.1").unwrap().rows[0].visibility, Some(24.1));
    assert_eq!(read("visibility", "241").unwrap().rows[0].visibility, Some(241.0));
}
