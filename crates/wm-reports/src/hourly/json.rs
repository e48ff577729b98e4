//! Tables as JSON, as Open-Meteo has them: an object `hourly` of lists of the same length, `hourly_units`, and the place.

use super::WeatherTable;
use super::csv::stem;
use super::raw::{Cell, RawTable};
use crate::error::ReportError;
use crate::report::{ReportOptions, WeatherReport};
use serde_json::{Map, Value};

pub(crate) fn read(text: &str, file: &str, options: &ReportOptions) -> Result<WeatherReport, ReportError> {
    parse(text, file)?.weather(&stem(file), options)
}

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
            _ => return Err(whole(format!("has {} places: one is expected", list.len()))),
        },
        _ => &json,
    };
    let map = json.as_object().ok_or_else(|| whole("must be an object of JSON with `hourly`".into()))?;
    if let Some(reason) = map.get("reason").and_then(Value::as_str) {
        return Err(whole(format!("is an error of the service: {}", crate::error::quoted(reason))));
    }
    let (prefix, hourly) = match map.get("hourly") {
        Some(hourly) => {
            ("hourly.", hourly.as_object().ok_or_else(|| whole("hourly must be an object of lists".into()))?)
        }
        None => ("", map),
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
    let mut rows: Vec<Vec<Cell>> = Vec::with_capacity(length);
    for row in 0..length {
        rows.push(lists.iter().map(|list| cell(&list[row])).collect());
    }
    RawTable {
        place: place.map(|(latitude, longitude)| [latitude, longitude]),
        utc_offset,
        columns,
        rows,
        fault: &|row, column, problem| ReportError::Value {
            file: file.into(),
            key: format!("{prefix}{column}[{row}]"),
            problem,
        },
        whole: &whole,
    }
    .read()
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
            let is_none = matches!(unit, "wmo code" | "iso8601" | "unixtime" | "\u{b0}" | "undefined");
            Some(((name.to_lowercase(), if is_none { String::new() } else { unit.into() }), list))
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
