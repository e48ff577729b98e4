//! Cells of a table on their way to rows.

use super::columns::{Column, Field, METEOSTAT_CODES, names, other_service};
use super::table::{WeatherRow, WeatherTable};
use super::time;
use crate::draft::{ReportNote, ReportNoteKind};
use crate::error::{ReportError, meant, quoted};
use crate::optics::humidity;

/// mm of water in a metre of fresh snow, as Open-Meteo counts: 7 cm are 10 mm.
const WATER_MM_PER_SNOW_M: f64 = 1000.0 / 7.0;
/// The problem of a table with none of the names that are read, and the remedy.
pub(super) const UNKNOWN_TABLE_PROBLEM: &str = "is no table of a known service";
pub(super) const KNOWN_SERVICES_ADVICE: &str = "known are Open-Meteo (JSON with an object `hourly` of lists, or CSV) and Meteostat (CSV): write others as \
                                CSV with a column `time` and columns such as temperature_2m, rain, wind_speed_10m";
/// Least number of repeated rows that is noted.
const MIN_REPEATED_ROWS: usize = 3;
/// Visibilities without a unit that are all below this are hardly metres.
const MIN_VISIBILITY_M: f64 = 100.0;
/// Most hours of a table: a year of `light.hour`.
const MAX_HOURS: f64 = 8700.0;

/// The content of a cell.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Cell {
    Missing,
    Number(f64),
    Text(String),
}

impl Cell {
    /// A cell of CSV.
    pub(super) fn of_text(text: &str) -> Self {
        let text = text.trim();
        if text.is_empty()
            || ["nan", "null", "na", "<na>", "-", "none"].iter().any(|none| text.eq_ignore_ascii_case(none))
        {
            return Self::Missing;
        }
        text.parse().map_or_else(|_| Self::Text(text.into()), Self::Number)
    }
}

/// A table as it is in a file.
pub(super) struct RawTable<'a> {
    pub(crate) place: Option<[f64; 2]>,
    pub(crate) utc_offset: i64,
    /// Names and units; an empty unit for none.
    pub(crate) columns: Vec<(String, String)>,
    pub(crate) rows: Vec<Vec<Cell>>,
    /// An error in a row and column of the table.
    pub(crate) fault: &'a dyn Fn(usize, &str, String) -> ReportError,
    /// An error of the whole.
    pub(crate) whole: &'a dyn Fn(String) -> ReportError,
}

impl RawTable<'_> {
    pub(super) fn read(&self) -> Result<WeatherTable, ReportError> {
        if let Some(service) = other_service(self.columns.iter().map(|(name, _)| name.as_str())) {
            return Err((self.whole)(format!(
                "{UNKNOWN_TABLE_PROBLEM}: it has the columns of {service}, which are not read; {KNOWN_SERVICES_ADVICE}, with units, such as visibility (km)"
            )));
        }
        let has_snow_depth = self.columns.iter().any(|(name, _)| name == "snwd" || name == "cldc");
        let (mut columns, mut unused) = (Vec::new(), Vec::new());
        for (name, unit) in &self.columns {
            match Column::of(name, unit, has_snow_depth) {
                Some(column) => columns
                    .push(Some(column.map_err(|problem| (self.whole)(format!("column {name} {problem}")))?)),
                None => {
                    columns.push(None);
                    // Of what the values came.
                    if !name.ends_with("_source") && name != "station" {
                        unused.push(name.as_str());
                    }
                }
            }
        }
        let has = |field: Field| columns.iter().flatten().any(|column| column.field == field);
        let date_and_hour = has(Field::Date) || (has(Field::Year) && has(Field::Month) && has(Field::Day));
        if !has(Field::Time) && !date_and_hour {
            let near = self.columns.iter().find_map(|(name, _)| {
                let near = meant(name, ["time", "date"].into_iter());
                (!near.is_empty()).then(|| format!("; {} is none{near}", quoted(name)))
            });
            let near = near.unwrap_or_default();
            return Err((self.whole)(format!(
                "{UNKNOWN_TABLE_PROBLEM} (it has no column `time`{near}); {KNOWN_SERVICES_ADVICE}"
            )));
        }
        if columns.iter().flatten().all(|column| is_time(column.field)) {
            let mut near = unused.iter().map(|name| meant(name, names()));
            let near = near.find(|near| !near.is_empty()).unwrap_or_default();
            return Err((self.whole)(format!(
                "{UNKNOWN_TABLE_PROBLEM} (it has no column of weather{near}); {KNOWN_SERVICES_ADVICE}"
            )));
        }
        if self.rows.is_empty() {
            return Err((self.whole)("has no rows: at least one hour is expected".into()));
        }
        self.check_visibility(&columns)?;
        let mut notes = Vec::new();
        let mut note = |kind, text: String| notes.push(ReportNote { kind, text });
        for name in unused {
            note(ReportNoteKind::Ignored, format!("column {}: it is no part of a weather", quoted(name)));
        }
        let mut missing = 0;
        let rows = self.rows.iter().enumerate();
        let rows = rows.map(|(index, cells)| self.row(index, cells, &columns, &mut missing));
        let rows = rows.collect::<Result<Vec<_>, _>>()?;
        if missing > 0 {
            let text = format!("amounts of rain and snow in {missing} of {} rows: nothing fell", rows.len());
            note(ReportNoteKind::Missing, text);
        }
        // At the end of a table there are often hours that nobody has measured or forecast yet.
        let is_empty = |cells: &&Vec<Cell>| {
            let weather = columns.iter().map(|column| column.is_some_and(|one| !is_time(one.field)));
            !weather.zip(*cells).any(|(is_weather, cell)| is_weather && *cell != Cell::Missing)
        };
        let empty = self.rows.iter().rev().take_while(is_empty).count();
        let has_amounts =
            [Field::Rain, Field::Showers, Field::Precipitation, Field::Snowfall].into_iter().any(has);
        for text in not_measured(&rows, empty, has_amounts) {
            note(ReportNoteKind::Missing, text);
        }
        let guesses_phase = has(Field::Precipitation) && !has(Field::Rain) && !has(Field::Snowfall);
        if guesses_phase && rows.iter().any(|row| row.rain > 0.0 || row.snow > 0.0) {
            let text = "rain and snow are parted by the code, else by the temperature: snow up to 0 degrees, rain from 2 degrees on";
            note(ReportNoteKind::Guess, text.into());
        }
        let step = self.step(&rows)?;
        Ok(WeatherTable { place: self.place, utc_offset: self.utc_offset, step, rows, notes })
    }

    /// Refuses kilometres that would be taken for metres: visibilities without a unit that are all
    /// small.
    fn check_visibility(&self, columns: &[Option<Column>]) -> Result<(), ReportError> {
        let is_visibility =
            |column: &Option<Column>| column.is_some_and(|one| one.field == Field::Visibility);
        let Some(at) = columns.iter().position(is_visibility) else { return Ok(()) };
        let (name, unit) = &self.columns[at];
        let numbers = self.rows.iter().filter_map(|cells| match cells.get(at) {
            Some(Cell::Number(number)) => Some(*number),
            _ => None,
        });
        let largest = numbers.fold(f64::NEG_INFINITY, f64::max);
        if !unit.is_empty() || !(0.0..MIN_VISIBILITY_M).contains(&largest) {
            return Ok(());
        }
        Err((self.whole)(format!(
            "column {name} has no unit and no value above {largest}: name it {name} (km), {name} (m) or {name} (mi)"
        )))
    }

    /// Hours between rows.
    fn step(&self, rows: &[WeatherRow]) -> Result<f64, ReportError> {
        let seconds = rows.get(1).map_or(3600, |second| second.time - rows[0].time);
        for (index, pair) in rows.windows(2).enumerate() {
            let gap = pair[1].time - pair[0].time;
            if gap != seconds || gap <= 0 {
                let times = [pair[1].time, pair[0].time].map(time::written);
                let problem =
                    format!("is {} after {}: rows must be the same time apart, and rise", times[0], times[1]);
                return Err((self.fault)(index + 1, "time", problem));
            }
        }
        let hours = seconds as f64 / 3600.0;
        if !(1.0 / 60.0..=24.0).contains(&hours) {
            return Err((self.whole)(format!("has rows {hours} hours apart: a minute to a day is expected")));
        }
        if hours * rows.len() as f64 > MAX_HOURS {
            return Err((self.whole)(format!(
                "has {} rows: at most {MAX_HOURS} hours are read, cut it",
                rows.len()
            )));
        }
        Ok(hours)
    }

    fn row(
        &self,
        index: usize,
        cells: &[Cell],
        columns: &[Option<Column>],
        missing: &mut usize,
    ) -> Result<WeatherRow, ReportError> {
        let mut row = WeatherRow::default();
        let mut time = None;
        let mut date = [None; 4];
        let (mut rain, mut showers, mut all, mut snowfall, mut dew_point) = (None, None, None, None, None);
        let mut has_amounts = false;
        for ((cell, column), (name, _)) in cells.iter().zip(columns).zip(&self.columns) {
            let Some(column) = column else { continue };
            let fault = |problem: String| (self.fault)(index, name, problem);
            has_amounts |= matches!(column.field, Field::Rain | Field::Precipitation | Field::Snowfall);
            if matches!(column.field, Field::Time | Field::Date) {
                let text = match cell {
                    Cell::Missing => {
                        return Err(fault("is empty: a time is expected, as 2024-01-15T06:00".into()));
                    }
                    Cell::Number(number) => format!("{number}"),
                    Cell::Text(text) => text.clone(),
                };
                let (at, is_utc) = time::parse(&text).ok_or_else(|| {
                    fault(format!("is {}: a time is expected, as 2024-01-15T06:00", quoted(&text)))
                })?;
                time = Some(if is_utc { at } else { at - self.utc_offset });
                continue;
            }
            let number = match cell {
                Cell::Missing => continue,
                Cell::Number(number) if number.is_finite() => *number,
                Cell::Number(number) => return Err(fault(format!("is {number}: a number is expected"))),
                Cell::Text(text) => return Err(fault(format!("is {}: a number is expected", quoted(text)))),
            };
            let value = column.value(number).map_err(fault)?;
            match column.field {
                Field::Year => date[0] = Some(value as i64),
                Field::Month => date[1] = Some(value as i64),
                Field::Day => date[2] = Some(value as i64),
                Field::Hour => date[3] = Some((3600.0 * value) as i64),
                Field::Temperature => row.temperature = Some(value),
                Field::DewPoint => dew_point = Some(value),
                Field::Humidity => row.humidity = Some(value.min(1.0)),
                Field::Rain => rain = Some(value),
                Field::Showers => showers = Some(value),
                Field::Precipitation => all = Some(value),
                Field::Snowfall => snowfall = Some(WATER_MM_PER_SNOW_M * value),
                Field::SnowDepth => row.snow_depth = Some(value),
                Field::Visibility => row.visibility = Some(value),
                Field::WindSpeed => row.wind_speed = Some(value),
                Field::WindFrom => row.wind_from = Some(value),
                Field::WindGust => row.wind_gust = Some(value),
                Field::Clouds => row.cloud_cover = Some(value.min(1.0)),
                Field::Code => row.code = Some(value.round() as u8),
                Field::MeteostatCode => {
                    row.code = METEOSTAT_CODES.get((value.round() as usize).wrapping_sub(1)).copied();
                }
                Field::Time | Field::Date => {}
            }
        }
        if time.is_none()
            && let [Some(year), Some(month), Some(day), _] = date
        {
            time = time::midnight(year, month, day).map(|midnight| midnight - self.utc_offset);
        }
        let time =
            time.ok_or_else(|| (self.fault)(index, "time", "is missing or no day of the calendar".into()))?;
        row.time = time + date[3].unwrap_or(0);
        if let (None, Some(temperature), Some(dew_point)) = (row.humidity, row.temperature, dew_point) {
            row.humidity = Some(humidity(temperature, dew_point));
        }
        let liquid = rain.or(showers).map(|_| rain.unwrap_or(0.0) + showers.unwrap_or(0.0));
        (row.rain, row.snow) = match (liquid, snowfall, all) {
            (Some(rain), Some(snow), _) => (rain, snow),
            (Some(rain), None, Some(all)) => (rain, (all - rain).max(0.0)),
            (Some(rain), None, None) => (rain, 0.0),
            (None, Some(snow), Some(all)) => ((all - snow).max(0.0), snow),
            (None, Some(snow), None) => (0.0, snow),
            (None, None, Some(all)) => {
                let share = snow_share(&row);
                (all * (1.0 - share), all * share)
            }
            (None, None, None) => {
                *missing += usize::from(has_amounts);
                (0.0, 0.0)
            }
        };
        Ok(row)
    }
}

/// Quantities that no row has, or some do not have, and rows at the end that only repeat others, of
/// which `empty` have nothing.
fn not_measured(rows: &[WeatherRow], empty: usize, has_amounts: bool) -> Vec<String> {
    type ReadQuantity = fn(&WeatherRow) -> Option<f64>;
    const QUANTITIES: [(&str, ReadQuantity); 7] = [
        ("temperature", |row| row.temperature),
        ("humidity", |row| row.humidity),
        ("wind", |row| row.wind_speed),
        ("direction of the wind", |row| row.wind_from),
        ("visibility", |row| row.visibility),
        ("clouds", |row| row.cloud_cover),
        ("depth of snow", |row| row.snow_depth),
    ];
    let told = &rows[..rows.len() - empty];
    if told.is_empty() {
        return vec!["anything: no row has a value".into()];
    }
    let (mut notes, mut missing) = (Vec::new(), Vec::new());
    if !has_amounts {
        missing.push("rain and snow");
    }
    for (name, value) in QUANTITIES {
        match told.iter().filter(|row| value(row).is_none()).count() {
            0 => {}
            lacking if lacking == told.len() => missing.push(name),
            lacking => {
                let of = told.len();
                notes.push(format!("{name} in {lacking} of {of} rows: taken from the rows beside"));
            }
        }
    }
    if !missing.is_empty() {
        notes.insert(0, missing.join(", "));
    }
    if empty > 0 {
        let which = format!("the last {empty} of {} rows", rows.len());
        notes.push(format!("{which}, which have no values: they repeat the row before"));
    }
    let same = |pair: &&[WeatherRow]| WeatherRow { time: pair[0].time, ..pair[1].clone() } == pair[0];
    let repeated = told.windows(2).rev().take_while(same).count();
    if repeated >= MIN_REPEATED_ROWS && QUANTITIES.len() > missing.len() + 1 {
        let which = format!("perhaps the last {repeated} of {} rows", told.len());
        notes.push(format!("{which}: they repeat the row before in all values"));
    }
    notes
}

fn is_time(field: Field) -> bool {
    matches!(field, Field::Time | Field::Date | Field::Year | Field::Month | Field::Day | Field::Hour)
}

/// The share of precipitation that is snow.
fn snow_share(row: &WeatherRow) -> f64 {
    if let Some(code) = row.present_weather().filter(|code| code.rain + code.snow > 0.0) {
        return code.snow / (code.rain + code.snow);
    }
    row.temperature.map_or(0.0, |temperature| (1.0 - temperature / 2.0).clamp(0.0, 1.0))
}
