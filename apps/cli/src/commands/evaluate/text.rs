//! The table on the terminal.

use super::scores::{EvaluationReport, Placement, ScoreColumn};

/// Prints a line per photo, and the means.
pub(crate) fn print(report: &EvaluationReport) {
    for note in report.notes() {
        println!("{note}");
    }
    println!();
    let columns: Vec<&ScoreColumn> = report.columns(Some(Placement::Table)).collect();
    let names = report.views.iter().map(|view| view.name.chars().count());
    let first = names.chain([5]).max().unwrap_or(5);
    let width = |column: &ScoreColumn| column.head.map(str::len).into_iter().max().unwrap_or(0).max(6);
    let line = |name: &str, of: &dyn Fn(&ScoreColumn) -> String| {
        let cells = columns.iter().map(|column| format!("  {:>1$}", of(column), width(column)));
        // Names are padded by characters, as they were counted.
        let blanks = " ".repeat(first.saturating_sub(name.chars().count()));
        println!("{}", format!("{name}{blanks}{}", cells.collect::<String>()).trim_end());
    };
    line("", &|column| column.head[0].into());
    line("photo", &|column| column.head[1].into());
    for view in &report.views {
        line(&shown(&view.name), &|column| column.text(column.of(&view.scores)));
    }
    line("mean", &|column| column.text(report.mean(column)));
    let more = |column: &ScoreColumn| format!("{} {} %", column.name, column.text(report.mean(column)));
    let more: Vec<String> = report.columns(Some(Placement::Means)).map(more).collect();
    if !more.is_empty() {
        println!("\nmeans: {}", more.join(", "));
    }
    if let Some(floaters) = report.floaters() {
        println!("floaters: {floaters}");
    }
}

/// Returns a name on one line: file names may contain any character.
fn shown(name: &str) -> String {
    name.chars().map(|c| if c.is_control() { '?' } else { c }).collect()
}
