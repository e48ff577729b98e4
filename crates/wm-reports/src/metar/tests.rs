use super::*;
use crate::draft::ReportNoteKind;
use crate::hourly::tests::value;
use crate::report::{DecodedReport, WeatherReport};
use wm_weather::Weather;

fn weather(text: &str) -> WeatherReport {
    WeatherReport::read(text, "metar", &ReportOptions::default())
        .unwrap_or_else(|error| panic!("{text}: {error}"))
}

/// Single groups and their parameters, worked out by hand from the mapping.
#[test]
fn groups_become_parameters() {
    let close = |text: &str, key: &str, want: f64| {
        let report = weather(&format!("METAR KJFK 291851Z {text}"));
        let got = value(report.weather(), key).unwrap_or(f64::NAN);
        assert!(
            (got - want).abs() <= 2e-3 * want.abs(),
            "{text}: {key} is {got}, not {want}\n{}",
            report.to_toml()
        );
    };
    // From 40 degrees at 14 kt.
    close("04014KT 9999", "wind.direction", 220.0);
    close("04014KT 9999", "wind.speed", 7.202);
    close("04010G25KT 9999", "wind.gusts", 0.5);
    close("27007MPS 9999", "wind.speed", 7.0);
    close("00000KT 9999", "wind.speed", 0.0);
    close("00000KT 0400 FG", "fog.mor", 400.0);
    close("00000KT 3000 HZ", "haze.mor", 3000.0);
    close("00000KT 3000 FU", "smog.mor", 3000.0);
    close("00000KT 0200 +DS", "smog.mor", 200.0);
    close("00000KT 3/4SM FG", "fog.mor", 1207.0);
    close("00000KT 1 1/2SM BR", "fog.mor", 2414.0);
    // 2.996 / 2000 less the 1.006e-3 of 5 mm/h: MOR 6097 m.
    close("00000KT 2000 RA BR", "rain.rate", 5.0);
    close("00000KT 2000 RA BR", "fog.mor", 6097.0);
    close("00000KT 9999 -SHRA", "rain.rate", 2.0);
    close("00000KT 9999 +DZ", "rain.rate", 0.8);
    close("00000KT 5000 MIFG", "fog.scale_height", 2.0);
    close("00000KT 5000 MIFG", "haze.mor", 5000.0);
    close("00000KT 9999 TSRAGR", "hail.rate", 20.0);
    close("00000KT 9999 TSRAGR", "lightning.rate", 6.0);
    close("00000KT 9999 VCTS", "lightning.distance", 12_000.0);
    close("00000KT 9999 FEW010 BKN030CB", "light.clouds", 0.75);
    close("00000KT 0100 FZFG VV001", "light.clouds", 1.0);
    close("02004KT 0800 BLSN M05/M07", "wind.speed", 8.0);
    close("00000KT 9999 RA 20/09", "wetness.humidity", 0.4910);
    close("00000KT 9999 RERA", "wetness.stopped", 15.0);
}

#[test]
fn snow_falls_as_the_visibility_says_within_its_intensity() {
    let rate = |text: &str| {
        value(weather(&format!("METAR KJFK 291851Z {text}")).weather(), "snowfall.rate").unwrap()
    };
    let seen = |rate: f64| crate::optics::visibility(crate::optics::extinction("snowfall", rate));
    // Where the law and the intensity agree, the visibility comes back.
    let moderate = rate("00000KT 0500 SN M02/M03");
    assert!((1.0..2.5).contains(&moderate) && (seen(moderate) / 500.0 - 1.0).abs() < 2e-3, "{moderate}");
    // Else the range has the last word.
    assert!((rate("00000KT 0100 -SN M02/M03") - 1.0).abs() < 1e-9);
    assert!((rate("00000KT 5000 SN M02/M03") - 1.0).abs() < 1e-9);
    assert!(rate("00000KT 0050 +SN M02/M03") > 7.99);
    // And the air has the rest.
    let report = weather("METAR KJFK 291851Z 00000KT 0100 -SN M02/M03");
    let air = crate::optics::visibility(2.995_732 / 100.0 - 2.995_732 / seen(1.0));
    assert!((value(report.weather(), "fog.mor").unwrap() / air - 1.0).abs() < 2e-3);
    assert!(
        report
            .notes()
            .iter()
            .any(|note| note.kind == ReportNoteKind::Guess && note.text.contains("snow_cover.depth"))
    );
    let wet = weather("METAR KJFK 291851Z 00000KT 2000 SN 01/00");
    assert!(!wet.weather().has(wm_weather::EffectRole::Lies), "{}", wet.to_toml());
}

#[test]
fn the_place_gives_the_sun() {
    let options = ReportOptions { place: Some([40.6, -73.8]), day: Some(33), ..ReportOptions::default() };
    let report = WeatherReport::read("KJFK 021200Z 00000KT CAVOK 05/M02 Q1013", "metar", &options).unwrap();
    assert!((value(report.weather(), "light.hour").unwrap() - 7.08).abs() < 1e-9);
    assert_eq!(value(report.weather(), "light.day"), Some(33.0));
}

#[test]
fn what_is_wrong_is_said_with_its_place() {
    for (text, error) in [
        ("METAR", "METAR: ends before the station"),
        ("METAR kjfk 291851Z", "METAR, character 7: `kjfk` is no station"),
        ("METAR KJFK 321851Z CAVOK", "METAR, character 12: `321851Z` is no time"),
        ("METAR KJFK 291851Z", "METAR: has no groups"),
        ("TAF KJFK 291730Z 2918/3024 CAVOK", "METAR, character 1: `TAF` begins a forecast"),
        ("METAR KJFK 291851Z CAVOK= METAR KBUF", "METAR, character 27: `METAR` begins a second report"),
        ("METAR KJFK 291851Z NIL=", "METAR, character 20: `NIL` says that the report is missing"),
        ("METAR KJFK 291851Z 4O014KT", "METAR, character 20: `4O014KT` is damaged: a wind, as in 24015G25KT"),
        (
            "METAR KJFK 291851Z 00000KT 9O99",
            "METAR, character 28: `9O99` is of no known form; the nearest is a visibility",
        ),
        ("METAR KJFK 291851Z 00000KT BKN12", "METAR, character 28: `BKN12` is damaged: clouds, as in BKN012"),
        ("METAR KJFK 291851Z 00000KT 0/0SM", "METAR, character 28: `0/0SM` is damaged: a visibility"),
        (
            "METAR KJFK 291851Z 00000KT 03/M1",
            "METAR, character 28: `03/M1` is damaged: temperature and dew point",
        ),
        ("METAR KJFK 291851Z 00000KT 99O9 FEW020 12/08 Q1013", "METAR, character 28: `99O9` is of no known"),
        (
            "METAR KJFK 291851Z 00000KT 9999 +RRA 12/08 Q1013",
            "METAR, character 33: `+RRA` is of no known form",
        ),
        ("KJFK 291851Z CAVOK\nKBUF 291854Z CAVOK", "METAR, character 20: `KBUF` begins a second report"),
        (
            "METAR KJFK 291851Z 00000KT CAVOC",
            "METAR, character 28: `CAVOC` is of no known form, did you mean `CAVOK`?",
        ),
        ("METAR KJFK 291851Z 00000KT +SNRX", "METAR, character 28: `+SNRX` is of no known form"),
        ("METAR KJFK 291851Z 180V240", "METAR, character 20: `180V240` says how the wind varies"),
    ] {
        let got = Metar::parse(text).unwrap_err().to_string();
        assert!(got.starts_with(error), "{text}:\n{got}\n{error}");
    }
}

/// The fixture's reports, decoded and as weathers; `tests/peers/metar.py` holds the fields against
/// another decoder.
#[test]
fn reports_of_all_kinds_are_weathers() {
    let text = include_str!("../../fixtures/metar.txt");
    let reports: Vec<&str> = text.lines().filter(|line| !line.is_empty() && !line.starts_with('#')).collect();
    assert!(reports.len() >= 30);
    for report in reports {
        let read = weather(report);
        let again = Weather::parse(read.to_toml(), "again").unwrap();
        assert_eq!(&again, read.weather());
    }
}

/// Groups that no weather has, as they are typed, and the report without them.
#[test]
fn what_cannot_change_the_weather_is_noted() {
    let head = "METAR KJFK 291851Z 18010KT 9999 FEW020 12/08 Q1013";
    let plain = weather(head);
    for (groups, noted) in [
        ("FM1830 20010KT 4000 SHRA BKN010 FM1915 18012KT", "FM1830 20010KT 4000 SHRA BKN010 FM1915 18012KT"),
        ("FM221830 20010KT 4000", "FM221830 20010KT 4000"),
        ("TEMPO FM 1300 32030G40KT 1500 SA", "TEMPO FM 1300 32030G40KT 1500 SA"),
        ("BECMG AT0800 3000 TL0900", "BECMG AT0800 3000 TL0900"),
        ("BLU 25008KT 4000 SCT005", "BLU"),
        ("BLU+BLU+", "BLU+BLU+"),
        ("R88/70D NOSIG", "R88/70D"),
        ("R162///94", "R162///94"),
        ("88CLRD95", "88CLRD95"),
        ("3609//70 NOSIG", "3609//70"),
        ("WS IN APCH RWY 36", "WS IN APCH RWY 36"),
        ("TCU ALL HZ", "TCU ALL HZ"),
        ("CB/NE/E/SE", "CB/NE/E/SE"),
        ("RWY WET TEMPO 8000 -TSRA", "RWY WET"),
        ("QFE907.1", "QFE907.1"),
        ("PRESENT WEATHER SENSOR US", "PRESENT WEATHER SENSOR US"),
        ("W///S7", "W///S7"),
        ("RF00.0/000.0", "RF00.0/000.0"),
        ("METAR", "METAR"),
        ("NOSI G", "NOSI G"),
    ] {
        let report = weather(&format!("{head} {groups}"));
        assert_eq!(report.weather(), plain.weather(), "{groups}");
        let DecodedReport::Metar(metar) = &report.decoded else { unreachable!() };
        assert_eq!(metar.ignored[0].text, noted, "{groups}");
        assert!(report.to_toml().contains(&format!("# ignored: {noted}: ")), "{}", report.to_toml());
    }
    for (text, noted) in [
        ("METAR VIPK 130830Z 26004KT 1100 BR SKY OBS 10/07 Q1020 NOSIG", "SKY OBS"),
        ("METAR KJFK 291851Z 18010KT 9999 FEW040 FEW050 CB 36/18 Q1009", "CB"),
        ("METAR KJFK 291851Z 18010KT 9999 FEW020 12/08 Q10X3", "Q10X3"),
        ("METAR KJFK 291851Z 18010KT 9999 FEW020 12/08 3020", "3020"),
    ] {
        assert_eq!(Metar::parse(text).unwrap().ignored[0].text, noted, "{text}");
    }
}

/// All ways of writing that something was not measured.
#[test]
fn what_was_not_measured_is_told() {
    let all = ["wind", "visibility", "weather", "clouds", "temperature", "dew point", "pressure"];
    for text in [
        "METAR LFPG 121430Z AUTO /////KT //// // ////// ///// Q////",
        "METAR LFPG 121430Z AUTO //////MPS ////NDV // ///////// ////// A////",
        "METAR LFPG 121430Z AUTO ////KT //SM // //////CB M/M Q//",
        "METAR LFPG 121430Z AUTO /////G//KT // /// XX/XX RE// Q/////",
        "METAR LFPG 121430Z AUTO ///// // /// MM/MM RMK AO2",
    ] {
        assert_eq!(Metar::parse(text).unwrap().missing(), all, "{text}");
    }
    for (text, missing) in [
        (
            "METAR LGIO 262120Z AUTO VRB02KT //// // ////// 11/08 Q1014 RE//",
            &["visibility", "weather", "clouds"][..],
        ),
        (
            "METAR ENFB 262120Z AUTO ///10KT 9999 BKN030/// 12/// Q1004",
            &["direction of the wind", "dew point"],
        ),
        (
            "METAR EFJY 040720Z AUTO 19007KT -SHRA ///015 ///08 Q1014",
            &["visibility", "clouds", "temperature"],
        ),
        ("METAR KJFK 291851Z 18010KT CAVOK 12/08 Q1013", &[]),
    ] {
        assert_eq!(Metar::parse(text).unwrap().missing(), missing, "{text}");
    }
    let empty = weather("METAR LFPG 121430Z AUTO /////KT //// // ////// ///// Q////");
    let note = "# not measured: wind, visibility, weather, clouds, temperature, dew point, pressure\n";
    assert!(empty.to_toml().contains(note), "{}", empty.to_toml());
}

#[test]
fn forms_that_are_typed_otherwise_are_read() {
    let seen = |text: &str| Metar::parse(&format!("METAR KJFK 291851Z 18010KT {text}")).unwrap().visibility;
    let metres = |text: &str| seen(text).unwrap().metres.round();
    for (text, want) in [
        ("M0400 FG", 400.0),
        ("P5000", 5000.0),
        ("4000M HZ", 4000.0),
        ("9999NDV", 10_000.0),
        ("11/2SM BR", 2414.0),
        ("21/4SM BR", 3621.0),
        ("11/16SM FG", 1106.0),
        ("0SM FG", 50.0),
        ("M1/4SM FG", 402.0),
    ] {
        assert!((metres(text) - want).abs() < 1.0, "{text}: {}", metres(text));
    }
    assert!(
        seen("M0400").unwrap().bound == VisibilityBound::Less
            && seen("P5000").unwrap().bound == VisibilityBound::OrMore
    );
    let metar =
        Metar::parse("MRLB COR 262100Z 00000KTS 9999 VC SH FEW013CB/N BKN016CBNE-W 22/19 Q10 15 RERA")
            .unwrap();
    assert!(metar.is_correction && metar.time.is_some() && metar.missing().is_empty());
    assert_eq!(
        (metar.weather[0].code(), metar.clouds[0].height.map(f64::round)),
        ("VCSH".into(), Some(396.0))
    );
    assert_eq!((metar.pressure, metar.recent[0].code()), (Some(1015.0), "RA".into()));
    // As NOAA has them in its files.
    let report = WeatherReport::read(
        "2024/01/29 18:51\nKJFK 291851Z 04014KT 1/2SM SN OVC008 M02/M03 A2979\n",
        "KJFK.TXT",
        &ReportOptions::default(),
    );
    assert_eq!(report.unwrap().name, "METAR-KJFK-29T1851Z");
}
