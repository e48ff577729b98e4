//! The HTML report: one file without scripts or external resources, light or dark as the browser
//! prefers.

mod panels;

pub(crate) use panels::PhotoPanels;

use super::scores::{EvaluationReport, Placement, ScoreColumn};
use crate::report::{escaped, foot, head, picture};
use std::fmt::Write;

/// Returns the whole page, with the pictures of `shown`.
pub(crate) fn page(report: &EvaluationReport, shown: &[PhotoPanels]) -> String {
    let mut style = String::new();
    for (class, ramp) in panels::RAMPS {
        let _ = writeln!(style, ".{class} {{ background: {}; }}", picture::gradient(ramp));
    }
    let mut out = head(&format!("{} against {}", report.scene, report.dataset), &style);
    out.push_str("<ul class=\"notes\">\n");
    // The first says which scene and data set, which the title does.
    let mut notes = report.notes();
    notes[0] = report.selection.clone();
    for note in notes {
        let _ = writeln!(out, "<li>{}</li>", escaped(&note));
    }
    out.push_str("</ul>\n");
    means(&mut out, report);
    photos(&mut out, report);
    for shown in shown {
        let _ = writeln!(out, "<section>\n<h2>{}</h2>", escaped(&shown.name));
        if let Some(view) = report.views.iter().find(|view| view.name == shown.name) {
            let number = |column: &ScoreColumn| {
                let value = column.of(&view.scores)?;
                Some(escaped(&format!("{} {}", column.name, column.full_text(Some(value)))))
            };
            let numbers: Vec<String> = report.columns(Some(Placement::Table)).filter_map(number).collect();
            let _ = writeln!(out, "<p class=\"numbers\">{}</p>", numbers.join(" · "));
        }
        shown.write(&mut out);
        out.push_str("</section>\n");
    }
    out.push_str(&foot());
    out
}

/// Writes the means, each with its definition.
fn means(out: &mut String, report: &EvaluationReport) {
    out.push_str("<h2>Means over the photos</h2>\n<div class=\"scroll\"><table class=\"means\">\n<tbody>\n");
    let mut row = |name: &str, value: &str, what: &str| {
        let _ =
            writeln!(out, "<tr><th scope=\"row\">{name}</th><td>{value}</td><td>{}</td></tr>", escaped(what));
    };
    for column in report.columns(None) {
        row(&escaped(column.name), &column.full_text(report.mean(column)), column.what);
    }
    if let Some(found) = report.floaters {
        let percent = |share: f64| format!("{:.2}\u{a0}%", 100.0 * share);
        let what = "share of the splats in view that hang more than 5 % in front of the true surface in any photo; \
                    of those with an opacity above 0.1, without the sky's";
        row("floaters", &percent(found.share()), what);
        row(
            "floaters, weighted",
            &percent(found.weighted),
            "the same by opacity times area in the picture, over all photos",
        );
    }
    out.push_str("</tbody>\n</table></div>\n");
}

/// Writes a line per photo.
fn photos(out: &mut String, report: &EvaluationReport) {
    let columns: Vec<&ScoreColumn> = report.columns(Some(Placement::Table)).collect();
    out.push_str("<h2>Photos</h2>\n<div class=\"scroll\"><table>\n<thead><tr><th>photo</th>");
    for column in &columns {
        let _ = write!(out, "<th>{}</th>", escaped(&column.head.join("\n")).replace('\n', "<br>"));
    }
    out.push_str("</tr></thead>\n<tbody>\n");
    for view in &report.views {
        let cells = columns.iter().map(|column| column.text(column.of(&view.scores)));
        row(out, &view.name, cells);
    }
    out.push_str("</tbody>\n<tfoot>\n");
    row(out, "mean", columns.iter().map(|column| column.text(report.mean(column))));
    out.push_str("</tfoot>\n</table></div>\n");
}

fn row(out: &mut String, name: &str, cells: impl Iterator<Item = String>) {
    let _ = write!(out, "<tr><th scope=\"row\">{}</th>", escaped(name));
    cells.for_each(|cell| {
        let _ = write!(out, "<td>{cell}</td>");
    });
    out.push_str("</tr>\n");
}
