//! The numbers as text, JSON, CSV and Markdown.

use super::report::MeasureReport;
use crate::report::csv_line;
use serde_json::{Value, json};
use std::fmt::Write;
use weather_magician::measure::{Reading, Tolerance};

/// Formats a number with four significant digits.
pub(crate) fn number(value: f64) -> String {
    // A number that is rounded to zero has no sign.
    let (size, value) = (value.abs(), if value.abs() < 5e-4 { 0.0 } else { value });
    match size {
        _ if !value.is_finite() => "-".into(),
        _ if size >= 1000.0 => format!("{value:.0}"),
        _ if size >= 100.0 => format!("{value:.1}"),
        _ if size >= 10.0 => format!("{value:.2}"),
        _ => format!("{value:.3}"),
    }
}

/// Formats a number without trailing zeros.
fn short(value: f64) -> String {
    let text = number(value);
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

/// Formats the error of a reading with its unit.
pub(crate) fn error(reading: &Reading) -> String {
    let error = reading.error();
    match reading.tolerance {
        _ if !error.is_finite() => "-".into(),
        Tolerance::Relative(_) => format!("{:+.2} %", 100.0 * error),
        _ => format!("{error:+.4}"),
    }
}

/// Formats the tolerance of a reading.
pub(crate) fn tolerance(reading: &Reading) -> String {
    match reading.tolerance {
        Tolerance::Relative(most) => format!("{} %", 100.0 * most),
        Tolerance::Absolute(most) => short(most) + &unit(reading),
        Tolerance::Above(most) => format!("{}{} above", short(most), unit(reading)),
        Tolerance::None => String::new(),
    }
}

/// Returns a word for a reading within or outside of its tolerance.
pub(crate) fn verdict(reading: &Reading) -> &'static str {
    match (reading.tolerance, reading.passes()) {
        (Tolerance::None, _) => "",
        (_, true) => "pass",
        (_, false) => "FAIL",
    }
}

/// Formats the measured value with its standard error.
pub(crate) fn measured(reading: &Reading) -> String {
    let error = reading.standard_error.map(|error| format!(" \u{b1} {}", number(error))).unwrap_or_default();
    number(reading.measured) + &error
}

/// Returns a unit to append to a number.
pub(crate) fn unit(reading: &Reading) -> String {
    if reading.unit.is_empty() { String::new() } else { format!(" {}", reading.unit) }
}

/// Returns the readings as text.
pub(crate) fn text(report: &MeasureReport) -> String {
    let mut out = format!("{}, {}\n", report.place, report.renderer);
    for section in &report.sections {
        let _ = writeln!(out, "\n{}", section.instrument.title);
        let cells: Vec<[String; 6]> = section
            .readings()
            .map(|reading| {
                let unit = unit(reading);
                [
                    reading.setting.clone(),
                    reading.quantity.clone(),
                    number(reading.asked),
                    measured(reading) + &unit,
                    error(reading),
                    verdict(reading).to_owned(),
                ]
            })
            .collect();
        let wide = |k: usize| cells.iter().map(|row| row[k].chars().count()).max().unwrap_or(0).max(8);
        let widths: [usize; 5] = std::array::from_fn(wide);
        let [a, b, c, d, e] = widths;
        let _ = writeln!(
            out,
            "  {:<a$}  {:<b$}  {:>c$}  {:>d$}  {:>e$}",
            "weather", "quantity", "asked", "measured", "error"
        );
        for [setting, quantity, asked, measured, error, verdict] in &cells {
            let _ = writeln!(
                out,
                "  {setting:<a$}  {quantity:<b$}  {asked:>c$}  {measured:>d$}  {error:>e$}  {verdict}"
            );
        }
    }
    let [right, off] = report.verdict();
    let _ = writeln!(out, "\n{right} readings within tolerance, {off} not, in {:.0} s", report.seconds);
    out
}

/// Returns the readings as JSON.
pub(crate) fn json(report: &MeasureReport) -> Value {
    let reading = |reading: &Reading| {
        let mut value = json!(reading);
        value["error"] = json!(reading.error());
        value["pass"] = json!(reading.passes());
        value
    };
    let sections: Vec<Value> = report
        .sections
        .iter()
        .map(|section| {
            json!({
                "name": section.instrument.name,
                "title": section.instrument.title,
                "readings": section.readings().map(reading).collect::<Vec<_>>(),
            })
        })
        .collect();
    let [right, off] = report.verdict();
    json!({
        "program": concat!("weather-magician ", env!("CARGO_PKG_VERSION")),
        "place": report.place,
        "about": report.about,
        "renderer": report.renderer,
        "seconds": report.seconds,
        "passed": right,
        "failed": off,
        "instruments": sections,
    })
}

const HEAD: [&str; 10] = [
    "instrument",
    "weather",
    "quantity",
    "unit",
    "asked",
    "measured",
    "standard error",
    "error",
    "tolerance",
    "verdict",
];

fn rows(report: &MeasureReport) -> impl Iterator<Item = [String; 10]> {
    report.sections.iter().flat_map(|section| {
        section.readings().map(|reading| {
            [
                section.instrument.name.to_owned(),
                reading.setting.clone(),
                reading.quantity.clone(),
                reading.unit.to_owned(),
                number(reading.asked),
                number(reading.measured),
                reading.standard_error.map(number).unwrap_or_default(),
                error(reading),
                tolerance(reading),
                verdict(reading).to_owned(),
            ]
        })
    })
}

/// Returns the readings as CSV (RFC 4180).
pub(crate) fn csv(report: &MeasureReport) -> String {
    let lines = rows(report).map(|row| csv_line(&row) + "\r\n");
    [HEAD.join(",") + "\r\n"].into_iter().chain(lines).collect()
}

/// Returns the readings as Markdown.
pub(crate) fn markdown(report: &MeasureReport) -> String {
    let mut out = format!("| {} |\n|{}\n", HEAD.join(" | "), "---|".repeat(HEAD.len()));
    for row in rows(report) {
        let _ = writeln!(out, "| {} |", row.each_ref().map(|cell| cell.replace('|', "\\|")).join(" | "));
    }
    out
}
