//! Tables as JSON, as Open-Meteo has them: an object `hourly` of lists of the same length,
//! `hourly_units`, and the place.

use super::csv::unit_or_none;
use super::raw::{Cell, KNOWN_SERVICES_ADVICE, RawTable, UNKNOWN_TABLE_PROBLEM};
use super::table::WeatherTable;
use crate::error::ReportError;
use serde_json::{Map, Value};

pub(super) fn parse(text: &str, file: &str) -> Result<WeatherTable, ReportError> {
    let whole = |problem: String| ReportError::Whole { file: file.into(), problem };
    let json: Value = serde_json::from_str(text).map_err(|error| ReportError::Line {
        file: file.into(),
        line: error.line(),
        problem: format!("is no JSON: {error}"),
    })?;
    // Of several places there is a list.
    let json = match &json {
        Value::Array(list) => match &list[..] {
            [only] => only,
            [first, ..] if first.get("hourly").is_some() => {
                return Err(whole(format!("has {} places: one is expected", list.len())));
            }
            _ => return Err(whole(unknown(&json))),
        },
        _ => &json,
    };
    let map = json.as_object().ok_or_else(|| whole(unknown(json)))?;
    if let Some(reason) = map.get("reason").and_then(Value::as_str) {
        return Err(whole(format!("is an error of the service: {}", crate::error::quoted(reason))));
    }
    let is_table = |map: &Map<String, Value>| {
        map.values().any(Value::is_array)
            && !map.values().any(|list| list.as_array().is_some_and(|list| list.iter().any(Value::is_object)))
    };
    let (prefix, hourly) = match map.get("hourly") {
        Some(Value::Object(hourly)) if is_table(hourly) => ("hourly.", hourly),
        None if is_table(map) => ("", map),
        None if ["current", "daily", "minutely_15"]
            .iter()
            .any(|name| map.contains_key(&format!("{name}_units"))) =>
        {
            return Err(whole("has no `hourly`: ask Open-Meteo for hourly values".into()));
        }
        _ => return Err(whole(unknown(json))),
    };
    let number = |name: &str, most: f64| -> Result<Option<f64>, ReportError> {
        let Some(value) = map.get(name).filter(|value| !value.is_null()) else { return Ok(None) };
        let found = value.as_f64().filter(|number| number.abs() <= most);
        let problem = format!("must be a number of at most {most}");
        found.map(Some).ok_or_else(|| ReportError::Value { file: file.into(), key: name.into(), problem })
    };
    let place = number("latitude", 90.0)?.zip(number("longitude", 360.0)?);
    let utc_offset = number("utc_offset_seconds", 100_000.0)?.unwrap_or(0.0) as i64;
    let units = map.get("hourly_units").and_then(Value::as_object);
    let (columns, lists) = columns(hourly, units, prefix.is_empty());
    let length = lists.iter().map(|list| list.len()).max().unwrap_or(0);
    if let Some(at) = lists.iter().position(|list| list.len() != length) {
        let problem = format!("has {} values: {length} are expected, as in the other lists", lists[at].len());
        return Err(ReportError::Value {
            file: file.into(),
            key: format!("{prefix}{}", columns[at].0),
            problem,
        });
    }
    RawTable {
        place: place.map(<[f64; 2]>::from),
        utc_offset,
        columns,
        rows: (0..length).map(|row| lists.iter().map(|list| cell(&list[row])).collect()).collect(),
        fault: &|row, column, problem| ReportError::Value {
            file: file.into(),
            key: format!("{prefix}{column}[{row}]"),
            problem,
        },
        whole: &whole,
    }
    .read()
}

/// The problem of JSON that is no table as it is read, with what it has in its place.
fn unknown(json: &Value) -> String {
    let first = |list: &'_ Value| list.as_array()?.first()?.as_object().cloned();
    let (name, map, is_list) = match json {
        Value::Object(map) => match map.iter().find_map(|(name, list)| Some((name, first(list)?))) {
            Some((name, record)) => (format!(" {}", crate::error::quoted(name)), record, true),
            None => (String::new(), map.clone(), false),
        },
        list => (String::new(), first(list).unwrap_or_default(), true),
    };
    let keys: Vec<&str> = map.keys().take(6).map(String::as_str).collect();
    let keys = crate::error::plain(&keys.join(", "));
    let found = match is_list {
        _ if keys.is_empty() => String::new(),
        true => format!(" (it has a list{name} of objects of {keys})"),
        false => format!(" (it has {keys})"),
    };
    format!("{UNKNOWN_TABLE_PROBLEM}{found}; {KNOWN_SERVICES_ADVICE}")
}

/// Names and units of the columns, and their lists.
#[allow(clippy::type_complexity)] // Two lists of the same length.
fn columns<'a>(
    hourly: &'a Map<String, Value>,
    units: Option<&Map<String, Value>>,
    is_loose: bool,
) -> (Vec<(String, String)>, Vec<&'a Vec<Value>>) {
    hourly
        .iter()
        .filter_map(|(name, list)| {
            // Beside the lists of a table that stands alone there may be anything.
            let list = list.as_array().filter(|list| !is_loose || !list.is_empty())?;
            let unit = units.and_then(|units| units.get(name)).and_then(Value::as_str).unwrap_or_default();
            Some(((name.to_lowercase(), unit_or_none(unit).into()), list))
        })
        .unzip()
}

fn cell(value: &Value) -> Cell {
    match value {
        Value::Null => Cell::Missing,
        Value::Number(number) => number.as_f64().map_or(Cell::Missing, Cell::Number),
        Value::String(text) => Cell::Text(text.clone()),
        other => Cell::Text(other.to_string()),
    }
}
