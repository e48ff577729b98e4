//! The HTML report.

use super::report::{InstrumentSection, MeasureReport};
use super::tables::{error, measured, number, tolerance, unit, verdict};
use crate::commands::bench::paper::{self, SpeedTable};
use crate::report::plot::{Axis, Plot, Series};
use crate::report::{escaped, foot, head, picture};
use anyhow::Result;
use std::fmt::Write;
use weather_magician::measure::{Finding, Reading, Tolerance};

const STYLE: &str = include_str!("page.css");

/// Number of plots and pictures of an instrument that are shown; the others are collapsed.
const SHOWN_FIGURES: usize = 3;
/// Width of the page: wider pictures are reduced to it and share it with no other.
const FULL_WIDTH_PX: u32 = 1300;

/// Returns the page.
pub(crate) fn page(report: &MeasureReport) -> Result<String> {
    let [right, off] = report.verdict();
    let mut out = head(&format!("Weather measured: {}", report.place), STYLE);
    let verdict = if off == 0 {
        format!(
            "<p class=\"verdict\"><b class=\"pass\">{right} of {right}</b> readings are within their tolerance.</p>"
        )
    } else {
        format!(
            "<p class=\"verdict\"><b class=\"fail\">{off} of {}</b> readings are outside of their tolerance.</p>",
            right + off
        )
    };
    let _ = write!(
        out,
        "{verdict}\n<p>What a weather asks for, in metres, millimetres an hour and metres a second, measured from rendered \
         pictures: instruments look at targets of their own in this place's air, and at the place. Asked values come from the \
         weather's parameters and published laws, measured ones from pixels.</p>\n\
         <ul class=\"notes\"><li>{}</li><li>{}</li><li>measured in {:.0} s</li></ul>\n",
        escaped(&report.about),
        escaped(&report.renderer),
        report.seconds
    );
    summary(&mut out, report);
    for section in &report.sections {
        write_section(&mut out, section)?;
    }
    if let Some(table) = &report.speed {
        write_speed(&mut out, table);
    }
    out.push_str(&foot());
    Ok(out)
}

/// Writes a line per instrument.
fn summary(out: &mut String, report: &MeasureReport) {
    out.push_str(
        "<div class=\"scroll\"><table class=\"means\">\n<thead><tr><th>instrument</th><th>readings</th><th>within tolerance</th>\
         <th>worst, of what is allowed</th></tr></thead>\n<tbody>\n",
    );
    for section in &report.sections {
        let readings: Vec<&Reading> =
            section.readings().filter(|reading| reading.tolerance != Tolerance::None).collect();
        let right = readings.iter().filter(|reading| reading.passes()).count();
        let worst = readings.iter().map(|reading| share(reading)).fold(0.0, f64::max);
        let class = if right == readings.len() { "pass" } else { "fail" };
        let _ = writeln!(
            out,
            "<tr><th scope=\"row\"><a href=\"#{}\">{}</a></th><td>{}</td><td class=\"{class}\">{right}</td>\
             <td class=\"meter\"><span><i class=\"{class}\" style=\"width:{:.0}%\"></i></span>{:.0}\u{a0}%</td></tr>",
            section.instrument.name,
            section.instrument.title,
            readings.len(),
            100.0 * worst.min(1.0),
            100.0 * worst
        );
    }
    out.push_str("</tbody>\n</table></div>\n");
}

/// Returns the error of a reading as a fraction of its tolerance.
fn share(reading: &Reading) -> f64 {
    let share = match reading.tolerance {
        Tolerance::Relative(most) | Tolerance::Absolute(most) => reading.error().abs() / most,
        Tolerance::Above(most) => reading.error().max(0.0) / most,
        Tolerance::None => 0.0,
    };
    match reading.passes() {
        // No error is within a tolerance of zero.
        true if share.is_nan() => 0.0,
        _ if share.is_finite() => share,
        _ => 99.0,
    }
}

fn write_section(out: &mut String, section: &InstrumentSection) -> Result<()> {
    let instrument = section.instrument;
    let _ = writeln!(
        out,
        "<section id=\"{}\">\n<h2>{}</h2>\n<p class=\"about\">{}</p>",
        instrument.name,
        instrument.title,
        escaped(instrument.about)
    );
    out.push_str(
        "<div class=\"scroll\"><table class=\"readings\">\n<thead><tr><th>weather</th><th>quantity</th><th>asked</th><th>measured</th>\
         <th>error</th><th>allowed</th><th></th></tr></thead>\n<tbody>\n",
    );
    let mut last = "";
    for reading in section.readings() {
        let (class, verdict) = match verdict(reading) {
            "" => ("aside", "to compare"),
            "pass" => ("pass", "pass"),
            other => ("fail", other),
        };
        let setting = if reading.setting == last { "" } else { &reading.setting };
        last = &reading.setting;
        let _ = writeln!(
            out,
            "<tr class=\"{}\"><th scope=\"row\">{}</th><td>{}</td><td>{}</td><td>{}{}</td><td>{}</td><td>{}</td>\
             <td class=\"{class}\">{verdict}</td></tr>",
            if setting.is_empty() { "more" } else { "" },
            escaped(setting),
            escaped(&reading.quantity),
            number(reading.asked),
            measured(reading),
            escaped(&unit(reading)),
            error(reading),
            tolerance(reading)
        );
    }
    out.push_str("</tbody>\n</table></div>\n");
    let mut figures: Vec<String> = Vec::new();
    figures.extend(
        sweep_plots(section).iter().map(|plot| format!("<figure class=\"plot\">{}</figure>", plot.svg())),
    );
    let first = figures.len();
    let findings = &section.findings;
    let plots = findings.iter().flat_map(|finding| &finding.plots).filter(|plot| !plot.is_empty());
    figures.extend(plots.map(|plot| format!("<figure class=\"plot\">{}</figure>", plot.svg())));
    folded(out, "figures two", &figures, (first + 2).next_multiple_of(2), "plots");
    let mut pictures = Vec::new();
    for shown in findings.iter().flat_map(|Finding { pictures, .. }| pictures) {
        // Sheets have the whole page.
        let is_sheet = shown.size.0 > FULL_WIDTH_PX;
        let source = picture::color(
            &shown.rgb,
            shown.size,
            if is_sheet { FULL_WIDTH_PX } else { picture::MAX_WIDTH_PX },
        )?;
        let caption = escaped(&shown.caption);
        let class = if is_sheet { " class=\"sheet\"" } else { "" };
        pictures.push(format!(
            "<figure{class}><img src=\"{source}\" alt=\"{caption}\"><figcaption>{caption}</figcaption></figure>"
        ));
    }
    folded(out, "figures", &pictures, SHOWN_FIGURES, "pictures");
    out.push_str("</section>\n");
    Ok(())
}

/// Writes the paper's table of speeds.
fn write_speed(out: &mut String, table: &SpeedTable) {
    let (head, rows) = table.cells();
    let cells = |tag: &str, cells: &[String]| -> String {
        cells.iter().map(|cell| format!("<{tag}>{}</{tag}>", escaped(cell))).collect()
    };
    let _ = writeln!(
        out,
        "<section id=\"speed\">\n<h2>Speed</h2>\n<p class=\"about\">The paper's Table I beside this machine. {} In few rounds, while \
         others may have used the machine; <code>weather-magician bench --paper</code> takes more. Figures of other machines are no comparison \
         of programs.</p>\n<div class=\"scroll\"><table class=\"speed\">\n<thead><tr>{}</tr></thead>\n<tbody>",
        escaped(&table.caption()),
        cells("th", &head.map(str::to_owned))
    );
    for row in rows {
        let _ =
            writeln!(out, "<tr><th scope=\"row\">{}</th>{}</tr>", escaped(&row[0]), cells("td", &row[1..]));
    }
    out.push_str("</tbody>\n</table></div>\n");
    let plots: Vec<String> = paper::plots(table)
        .iter()
        .map(|(_, plot)| format!("<figure class=\"plot\">{}</figure>", plot.svg()))
        .collect();
    folded(out, "figures two", &plots, 2, "plots");
    out.push_str("</section>\n");
}

/// Writes the first figures, and the others in a collapsed section.
fn folded(out: &mut String, class: &str, figures: &[String], first: usize, what: &str) {
    let first = first.min(figures.len());
    if first == 0 {
        return;
    }
    let _ = writeln!(out, "<div class=\"{class}\">\n{}\n</div>", figures[..first].join("\n"));
    let others = &figures[first..];
    if !others.is_empty() {
        let _ = writeln!(
            out,
            "<details><summary>{} more {what}</summary>\n<div class=\"{class}\">\n{}\n</div></details>",
            others.len(),
            others.join("\n")
        );
    }
}

/// Returns plots of measured over given values for the quantities of a sweep.
fn sweep_plots(section: &InstrumentSection) -> Vec<Plot> {
    let mut groups: Vec<(&str, &str, Vec<[f64; 2]>)> = Vec::new();
    for reading in section.readings() {
        // Fractions always have the expected value 1: there is nothing to plot.
        let is_swept = matches!(reading.tolerance, Tolerance::Relative(_)) || reading.unit == "mm";
        if !is_swept || reading.unit.is_empty() || !reading.measured.is_finite() {
            continue;
        }
        let name = reading.quantity.split(", of").next().unwrap_or_default();
        let point = [reading.asked, reading.measured];
        match groups.iter_mut().find(|(known, _, _)| *known == name) {
            Some((_, _, points)) => points.push(point),
            None => groups.push((name, reading.unit, vec![point])),
        }
    }
    groups.retain(|(_, _, points)| points.len() >= 3);
    let mut units: Vec<&str> = Vec::new();
    for (_, unit, _) in &groups {
        if !units.contains(unit) {
            units.push(unit);
        }
    }
    let plot = |unit: &&str| {
        let own = groups.iter().filter(|(_, other, _)| other == unit);
        let all: Vec<f64> = own.clone().flat_map(|(_, _, points)| points.iter().map(|p| p[0])).collect();
        let (low, high) = all.iter().fold((f64::INFINITY, 0.0f64), |(a, b), v| (a.min(*v), b.max(*v)));
        let axis = |what: &str| {
            let label = if unit.is_empty() { what.to_owned() } else { format!("{what}, {unit}") };
            if low > 0.0 && high / low > 8.0 { Axis::log(label) } else { Axis::linear(label) }
        };
        let mut series = vec![Series::line("exact", vec![[low, low], [high, high]])];
        series.extend(own.map(|(name, _, points)| Series::points(*name, points.clone())));
        Plot {
            title: format!("{}: asked and measured", section.instrument.title),
            x: axis("asked"),
            y: axis("measured"),
            series,
        }
    };
    units.iter().map(plot).collect()
}

/// Returns all plots as files: name and content.
pub(crate) fn plots(report: &MeasureReport) -> Vec<(String, String)> {
    let of = |section: &InstrumentSection| {
        let own = section.findings.iter().flat_map(|finding| finding.plots.clone());
        let all: Vec<Plot> =
            sweep_plots(section).into_iter().chain(own).filter(|plot| !plot.is_empty()).collect();
        let named = |(index, plot): (usize, &Plot)| {
            (format!("{}-{:02}.svg", section.instrument.name, index + 1), plot.svg())
        };
        all.iter().enumerate().map(named).collect::<Vec<_>>()
    };
    let speed = report.speed.iter().flat_map(paper::plots).map(|(name, plot)| (name.to_owned(), plot.svg()));
    report.sections.iter().flat_map(of).chain(speed).collect()
}
