//! `weather`: weather files from weather reports.

use crate::output::write_text;
use crate::overwrite::OverwriteArgs;
use anyhow::Result;
use clap::{Args, Subcommand};
use std::path::{Path, PathBuf};
use weather_magician::reports::{ReportNoteKind, ReportOptions, WeatherReport, looks_like_path};
use wm_base::files::check_writable;

/// Options of `weather`.
#[derive(Args, Debug)]
pub(crate) struct WeatherCommandArgs {
    #[command(subcommand)]
    action: WeatherAction,
}

#[derive(Subcommand, Debug)]
enum WeatherAction {
    /// Turn a weather report into a weather file, in which each value says where it came from
    From(FromArgs),
}

/// Options of `weather from`.
#[derive(Args, Debug)]
pub(crate) struct FromArgs {
    /// The report: a METAR, a WMO code (ww 63), CARLA's parameters or plain words; or a file with
    /// one, or with a table of hours (JSON or CSV)
    #[arg(value_name = "REPORT|FILE")]
    report: String,
    /// Weather file to write, a .toml [default: printed]
    #[arg(short, long, value_name = "FILE")]
    out: Option<PathBuf>,
    #[command(flatten)]
    overwrite: OverwriteArgs,
    /// Seconds of the shot in an hour of a table
    #[arg(long, value_name = "S", default_value_t = 1.0)]
    seconds_per_hour: f64,
    /// Latitude and longitude, degrees: the sun of a METAR, or of a table without a place, is then
    /// that of its time
    #[arg(long, value_name = "LAT,LON", value_parser = parse_place, allow_hyphen_values = true)]
    place: Option<[f64; 2]>,
    /// Day of the year for --place, 1 to 366: a METAR has only the day of the month
    #[arg(long, value_name = "DAY", value_parser = clap::value_parser!(u32).range(1..=366))]
    day: Option<u32>,
}

fn parse_place(text: &str) -> Result<[f64; 2], String> {
    let wrong = || format!("`{text}` is no place: latitude and longitude are expected, as 47.4,8.5");
    let (latitude, longitude) = text.split_once(',').ok_or_else(wrong)?;
    let number = |text: &str| text.trim().parse::<f64>().map_err(|_| wrong());
    Ok([number(latitude)?, number(longitude)?])
}

/// Runs the command.
pub(crate) fn run(args: &WeatherCommandArgs) -> Result<()> {
    let WeatherAction::From(args) = &args.action;
    let options = ReportOptions { seconds_per_hour: args.seconds_per_hour, place: args.place, day: args.day };
    let path = Path::new(&args.report);
    let is_file = path.is_file();
    if let Some(out) = &args.out {
        check_writable(out)?;
        let inputs: &[&Path] = if is_file { &[path] } else { &[] };
        args.overwrite.check(out, inputs, "give another name with --out")?;
    }
    let report = if is_file || looks_like_path(&args.report) {
        WeatherReport::read_file(path, &options)?
    } else {
        WeatherReport::read(&args.report, "report", &options)?
    };
    let Some(out) = &args.out else {
        println!("{}", report.to_toml().trim_end());
        return Ok(());
    };
    write_text(out, report.to_toml())?;
    println!("{}: {}", out.display(), summary(&report));
    Ok(())
}

/// The weather of a report in a line, how much of it was guessed, and what was not measured.
pub(crate) fn summary(report: &WeatherReport) -> String {
    let count = |kind| report.notes().iter().filter(|note| note.kind == kind).count();
    let (guesses, ignored) = (count(ReportNoteKind::Guess), count(ReportNoteKind::Ignored));
    let about = &report.weather().about;
    let about = if about.is_empty() { &report.name } else { about };
    let missing = report.notes().iter().filter(|note| note.kind == ReportNoteKind::Missing);
    let missing: String = missing.map(|note| format!("; {note}")).collect();
    format!("{about} ({guesses} guesses, {ignored} parts ignored{missing})")
}
