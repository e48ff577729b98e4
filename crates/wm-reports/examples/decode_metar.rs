//! Prints the decoded fields of METARs, one JSON object a line:
//! `cargo run -p wm-reports --example decode_metar -- FILE`.

use serde_json::{Value, json};
use wm_reports::Metar;
use wm_reports::metar::{MetarVisibility, VisibilityBound};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let path = std::env::args().nth(1).ok_or("give a file of METARs, one a line")?;
    for line in
        std::fs::read_to_string(path)?.lines().filter(|line| !line.is_empty() && !line.starts_with('#'))
    {
        match Metar::parse(line) {
            Ok(metar) => println!("{}", fields(line, &metar)),
            Err(error) => println!("{}", json!({"text": line, "error": error.to_string()})),
        }
    }
    Ok(())
}

fn fields(text: &str, metar: &Metar) -> Value {
    let seen = |seen: &Option<MetarVisibility>| {
        seen.as_ref().map(|seen| {
            let bound = match seen.bound {
                VisibilityBound::Exact => "",
                VisibilityBound::OrMore => ">",
                VisibilityBound::Less => "<",
            };
            json!({"metres": seen.metres, "bound": bound, "direction": seen.direction})
        })
    };
    let clouds = metar.clouds.iter().map(|cloud| json!([cloud.code, cloud.height, cloud.kind]));
    let ranges = metar.runway_ranges.iter().map(|range| json!([range.runway, range.metres]));
    json!({
        "text": text,
        "kind": format!("{:?}", metar.kind).to_uppercase(),
        "station": metar.station,
        "time": metar.time.map(|time| [time.day, time.hour, time.minute]),
        "auto": metar.is_automatic,
        "correction": metar.is_correction,
        "wind_from": metar.wind.and_then(|wind| wind.from),
        "wind_speed": metar.wind.and_then(|wind| wind.speed),
        "wind_gust": metar.wind.and_then(|wind| wind.gust),
        "wind_between": metar.wind.and_then(|wind| wind.between),
        "cavok": metar.is_cavok,
        "visibility": seen(&metar.visibility),
        "minimum_visibility": seen(&metar.minimum_visibility),
        "runway_ranges": ranges.collect::<Vec<_>>(),
        "weather": metar.weather.iter().map(wm_reports::metar::WeatherGroup::code).collect::<Vec<_>>(),
        "clouds": clouds.collect::<Vec<_>>(),
        "temperature": metar.temperature,
        "dew_point": metar.dew_point,
        "pressure": metar.pressure,
        "recent": metar.recent.iter().map(wm_reports::metar::WeatherGroup::code).collect::<Vec<_>>(),
        "missing": metar.missing(),
        "ignored": metar.ignored.iter().map(|group| &group.text).collect::<Vec<_>>(),
        "remarks": metar.remarks,
    })
}
