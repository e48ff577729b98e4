//! Inputs of `inspect` that are no scenes: captures, driving logs, weather files and reports.

use crate::commands::weather::summary;
use crate::scene::count_of;
use anyhow::Result;
use serde_json::{Map, Value, json};
use std::path::Path;
use weather_magician::formats::folder::scene_file;
use weather_magician::reports::{ReportKind, ReportNoteKind, find_weather, recognise};
use weather_magician::train::DatasetReadOptions;
use wm_base::Problem;
use wm_base::files::{LARGE_TEXT, read_text};
use wm_capture::Capture;
use wm_capture::{DrivingLog, LogOptions};
use wm_scene::Remark;

/// An input and what was found about it.
pub(crate) struct InspectedInput {
    /// The kind of input, in a few words.
    pub(crate) kind: String,
    /// Counts and names, each with a key for programs.
    pub(crate) facts: Vec<(&'static str, Value)>,
    /// Doubts and notes.
    pub(crate) findings: Vec<Remark>,
}

impl InspectedInput {
    /// Prints the input for people, without its findings.
    pub(crate) fn print(&self, path: &Path) {
        println!("{}", path.display());
        println!("  kind: {}", self.kind);
        for (key, value) in &self.facts {
            let text = value.as_str().map_or_else(|| value.to_string(), str::to_owned);
            println!("  {}: {text}", key.replace('_', " "));
        }
    }

    /// Returns the input for programs, without its findings.
    pub(crate) fn report(&self, path: &Path) -> Value {
        let mut fields = Map::from_iter([
            ("input".to_owned(), json!(path.display().to_string())),
            ("kind".to_owned(), json!(self.kind)),
        ]);
        fields.extend(self.facts.iter().map(|(key, value)| ((*key).to_owned(), value.clone())));
        Value::Object(fields)
    }
}

/// Reads an input that is no scene; `None` if it is to be read as a scene.
///
/// A folder without a scene is a driving log or a capture. A TOML, CSV or text file is a weather or
/// a report, and so is a JSON file unless it is the file of a capture.
///
/// # Errors
/// The input is damaged.
pub(crate) fn read(path: &Path) -> Result<Option<InspectedInput>> {
    let name = path.file_name().unwrap_or_default().to_string_lossy().to_lowercase();
    let ending = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
    if path.is_dir() {
        if scene_file(path).is_ok() {
            return Ok(None);
        }
        if let Some(log) = DrivingLog::open(path, &LogOptions::default())? {
            return Ok(Some(of_log(&log)));
        }
        return match DatasetReadOptions::default().capture(path) {
            // The error of a scene names what a folder may hold.
            Err(error) if matches!(error.problem, Problem::NoCapture) => Ok(None),
            capture => Ok(Some(of_capture(&capture?))),
        };
    }
    let is_capture = ["transforms.json", "reconstruction.json"].contains(&name.as_str())
        || (ending == "out" && name.starts_with("bundle"));
    if is_capture {
        return Ok(Some(of_capture(&DatasetReadOptions::default().capture(path)?)));
    }
    let is_scene = ending == "json" && (name.ends_with("meta.json") || name == "tileset.json");
    let is_weather = ["toml", "csv", "txt", "metar", "json"].contains(&ending.as_str()) && !is_scene;
    if !is_weather {
        return Ok(None);
    }
    match of_weather(path) {
        // A text that is no report in any form: the error of a scene names what is read.
        Err(_) if is_plain_text(path) => Ok(None),
        input => input.map(Some),
    }
}

/// Returns true if a text file has none of the forms of reports: it may be words for weather, or
/// any text.
fn is_plain_text(path: &Path) -> bool {
    read_text(path, LARGE_TEXT).is_ok_and(|text| recognise(&text) == ReportKind::Words)
}

fn of_capture(capture: &Capture) -> InspectedInput {
    let views = capture.views.len();
    let photos = (0..views).filter(|view| capture.photo(*view).is_some()).count();
    let masks = capture.views.iter().filter(|view| view.mask.is_some()).count();
    let tracked = capture.observations.iter().filter(|seen| !seen.is_empty()).count();
    let mut findings = capture.remarks.clone();
    if photos < views {
        findings.push(Remark::doubt(
            "photos-missing",
            format!(
                "{} of {} not found in {}; copy them there, or give their folder with --images",
                views - photos,
                count_of(views, "photo"),
                capture.images.display()
            ),
        ));
    }
    if let Err(error) = capture.check_trainable() {
        findings.push(Remark::doubt("not-trainable", error.problem.to_string()));
    }
    if let Some(view) = capture.views.iter().find(|view| view.undistorted().is_none()) {
        findings.push(Remark::doubt(
            "lens-folds",
            format!("the distortion of the camera of {:?} folds over within the photo", view.name),
        ));
    }
    let facts = vec![
        ("registered_photos", json!(views)),
        ("photos_found", json!(photos)),
        ("masks_found", json!(masks)),
        ("points", json!(capture.points.len())),
        ("photos_with_tracks", json!(tracked)),
    ];
    InspectedInput { kind: "capture: photos with cameras".into(), facts, findings }
}

fn of_log(log: &DrivingLog) -> InspectedInput {
    let findings = log.warnings.iter().map(|text| Remark::doubt("log", text.as_str())).collect();
    let facts = vec![
        ("name", json!(log.name)),
        ("cameras", json!(log.cameras.len())),
        ("pictures", json!(log.pictures.len())),
        ("sweeps", json!(log.sweeps.len())),
        ("tracks", json!(log.tracks.len())),
    ];
    InspectedInput { kind: format!("driving log: {}", log.format), facts, findings }
}

fn of_weather(path: &Path) -> Result<InspectedInput> {
    let found = find_weather(&path.display().to_string(), Path::new(""))?;
    let Some(report) = &found.report else {
        let effects: Vec<&str> = found.weather.effects().map(|(effect, _)| effect.name).collect();
        let facts = vec![("name", json!(found.weather.name)), ("effects", json!(effects.join(", ")))];
        return Ok(InspectedInput { kind: "weather file".into(), facts, findings: Vec::new() });
    };
    let findings = report.notes().iter().map(|note| match note.kind {
        // Every report leaves much to be guessed: that is its nature and no doubt about the file.
        ReportNoteKind::Guess => Remark::note("guess", format!("guess: {}", note.text)),
        ReportNoteKind::Ignored => Remark::note("ignored", format!("ignored: {}", note.text)),
        ReportNoteKind::Missing => Remark::doubt("not-measured", format!("not measured: {}", note.text)),
        ReportNoteKind::Clamped => Remark::doubt("clamped", format!("clamped: {}", note.text)),
    });
    let facts = vec![("name", json!(report.name)), ("weather", json!(summary(report)))];
    Ok(InspectedInput { kind: "weather report".into(), facts, findings: findings.collect() })
}
