//! Tables as CSV: Open-Meteo's two blocks, Meteostat's and any other with names in its first line.

use super::raw::{Cell, RawTable};
use super::table::WeatherTable;
use super::time;
use crate::error::{ReportError, quoted};

/// Most columns of a table.
const MAX_COLUMNS: usize = 500;

/// The columns of Meteostat's files of whole stations, which have no line of names.
const METEOSTAT_COLUMNS: [&str; 13] =
    ["date", "hour", "temp", "dwpt", "rhum", "prcp", "snow", "wdir", "wspd", "wpgt", "pres", "tsun", "coco"];

/// A line with its number, from 1.
type Line<'a> = (usize, &'a str);

pub(super) fn parse(text: &str, file: &str) -> Result<WeatherTable, ReportError> {
    let fault = |line: usize, problem: String| ReportError::Line { file: file.into(), line, problem };
    let whole = |problem: String| ReportError::Whole { file: file.into(), problem };
    let lines = (1..).zip(text.lines().map(str::trim_end));
    let mut lines: Vec<Line<'_>> = lines.filter(|(_, line)| !line.starts_with('#')).collect();
    drop_empty(&mut lines);
    let separator = separator(lines.first().map_or("", |(_, line)| line));
    let (place, utc_offset) = read_place(&mut lines, separator, &fault)?;
    let Some(((_, header), mut body)) = lines.split_first() else {
        return Err(whole("has no table: a line of names and a line an hour are expected".into()));
    };
    let mut columns: Vec<(String, String)> =
        cells(header, separator).iter().map(|cell| name_and_unit(cell)).collect();
    // Meteostat's files of whole stations have no names.
    if time::parse(&columns[0].0).is_some() && (12..=13).contains(&columns.len()) {
        columns = METEOSTAT_COLUMNS
            .iter()
            .take(columns.len())
            .map(|name| ((*name).into(), String::new()))
            .collect();
        body = &lines;
    }
    if columns.len() > MAX_COLUMNS {
        return Err(whole(format!("has {} columns: at most {MAX_COLUMNS} are read", columns.len())));
    }
    // A table ends at an empty line; one of days may follow.
    let body: Vec<Line<'_>> = body.iter().copied().take_while(|(_, line)| !line.trim().is_empty()).collect();
    let mut rows = Vec::with_capacity(body.len());
    for (number, line) in &body {
        let found = cells(line, separator);
        if found.len() != columns.len() {
            return Err(fault(
                *number,
                format!("has {} cells: {} are expected, as in the line of names", found.len(), columns.len()),
            ));
        }
        let decimal = |cell: &String| if separator == ';' { cell.replace(',', ".") } else { cell.clone() };
        rows.push(found.iter().map(|cell| Cell::of_text(&decimal(cell))).collect());
    }
    let line_of = |row: usize| body.get(row).map_or(1, |(line, _)| *line);
    RawTable {
        place,
        utc_offset,
        columns,
        rows,
        fault: &|row, column, problem| fault(line_of(row), format!("{column} {problem}")),
        whole: &whole,
    }
    .read()
}

/// Reads and drops the first block of Open-Meteo, which says where the place is: latitude and
/// longitude, degrees, and the offset of its time from UTC, s. Other tables have none.
fn read_place(
    lines: &mut Vec<Line<'_>>,
    separator: char,
    fault: &dyn Fn(usize, String) -> ReportError,
) -> Result<(Option<[f64; 2]>, i64), ReportError> {
    if !lines.first().is_some_and(|(_, line)| line.starts_with("latitude") || line.starts_with("location_id"))
    {
        return Ok((None, 0));
    }
    let end = lines.iter().position(|(_, line)| line.trim().is_empty()).unwrap_or(lines.len());
    if end != 2 {
        let line = lines.get(2).map_or(1, |(line, _)| *line);
        let problem =
            "has more than one place: a line of names and one of values are expected, then an empty line";
        return Err(fault(line, problem.into()));
    }
    let names = cells(lines[0].1, separator);
    let values = cells(lines[1].1, separator);
    let value = |name: &str| -> Result<Option<f64>, ReportError> {
        let Some(index) = names.iter().position(|known| known == name) else { return Ok(None) };
        let text = values.get(index).map_or("", |value| value.trim());
        let number = text.parse::<f64>().ok().filter(|number| number.is_finite());
        number
            .map(Some)
            .ok_or_else(|| fault(lines[1].0, format!("{name} is {}: a number is expected", quoted(text))))
    };
    let place =
        value("latitude")?.zip(value("longitude")?).map(|(latitude, longitude)| [latitude, longitude]);
    if let Some([latitude, longitude]) = place
        && !(latitude.abs() <= 90.0 && longitude.abs() <= 360.0)
    {
        return Err(fault(lines[1].0, format!("the place is {latitude}, {longitude}: degrees are expected")));
    }
    let offset = value("utc_offset_seconds")?.unwrap_or(0.0);
    if offset.abs() > 100_000.0 {
        return Err(fault(lines[1].0, format!("utc_offset_seconds is {offset}: at most a day is expected")));
    }
    lines.drain(..end);
    drop_empty(lines);
    Ok((place, offset as i64))
}

/// Drops empty lines at the beginning.
fn drop_empty(lines: &mut Vec<Line<'_>>) {
    let empty = lines.iter().take_while(|(_, line)| line.trim().is_empty()).count();
    lines.drain(..empty);
}

/// The character between cells.
fn separator(line: &str) -> char {
    let count = |wanted: char| line.chars().filter(|c| *c == wanted).count();
    [',', ';', '\t'].into_iter().rev().max_by_key(|c| count(*c)).unwrap_or(',')
}

/// The cells of a line; in quotes a separator is a part of a cell.
fn cells(line: &str, separator: char) -> Vec<String> {
    let (mut found, mut is_quoted) = (vec![String::new()], false);
    for c in line.chars() {
        if c == '"' {
            is_quoted = !is_quoted;
        } else if c == separator && !is_quoted {
            found.push(String::new());
        } else if let Some(last) = found.last_mut() {
            last.push(c);
        }
    }
    found
}

/// `temperature_2m (°C)` as name and unit.
fn name_and_unit(cell: &str) -> (String, String) {
    let (name, unit) = cell.split_once('(').unwrap_or((cell, ""));
    (name.trim().to_lowercase(), unit_or_none(unit.trim().trim_end_matches(')').trim()).into())
}

/// A unit, or nothing for words that are no units.
pub(super) fn unit_or_none(unit: &str) -> &str {
    if matches!(unit, "wmo code" | "iso8601" | "unixtime" | "\u{b0}" | "undefined") { "" } else { unit }
}
