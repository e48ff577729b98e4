//! `measure`: compares the weather of rendered pictures with its parameters, using instruments.

mod page;
mod report;
mod tables;

use crate::commands::bench::{INCOMPLETE, paper::SpeedTable};
use crate::commands::demo::street;
use crate::names::stem_of;
use crate::output::{json_text, make_folder, print_json, write_text};
use crate::overwrite::OverwriteArgs;
use crate::progress;
use crate::scene::{FactArgs, OpenScene, RunArgs, SceneArgs};
use crate::weather::WeatherArgs;
use anyhow::{Context, Result, bail};
use clap::Args;
use report::{InstrumentSection, MeasureReport};
use std::path::{Path, PathBuf};
use std::time::Instant;
use weather_magician::measure::{
    INSTRUMENTS, Instrument, InstrumentRenderer, MeasureRequest, PlaceRenderer, changed,
};
use weather_magician::view::ViewOptions;
use weather_magician::view::spec::{self, CameraSpec};
use weather_magician::{Camera, Metadata, Weather};

use wm_base::files::check_writable;
use wm_street::{Lighting, Street};
use wm_weather::Fidelity;

/// Options of `measure`.
#[derive(Args, Debug)]
#[command(after_long_help = wm_weather::reference_page::help())]
pub(crate) struct MeasureArgs {
    /// The scene to measure at, as for `render` [default: the built-in street]
    scene: Option<PathBuf>,
    #[command(flatten)]
    facts: FactArgs,
    /// Remove splats that cannot be drawn (NaN, infinite or absurd numbers, rows of zeros), and
    /// continue
    #[arg(long, help_heading = "Scene")]
    repair: bool,
    #[command(flatten)]
    weather: WeatherArgs,
    /// Time of the weather, seconds
    #[arg(
        long,
        value_name = "S",
        default_value_t = 0.0,
        allow_negative_numbers = true,
        help_heading = "Weather"
    )]
    time: f64,
    /// Use only these instruments: visibility, rays, gauge, streaks, stake, budget, wet-card,
    /// water-budget, lux, sundial, shadows, allard, halo, flash, fresnel, mirror, secchi, ripples,
    /// lamp-streak, lidar-board, lidar-air, lidar-drops, lidar-road, consistency, controls
    /// [default: all that can measure the weather]
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    instruments: Vec<String>,
    /// Camera for views of the scene: EYE:TARGET as X,Y,Z:X,Y,Z, or a photo's name or number
    /// [default: chosen automatically]
    #[arg(short, long, value_name = "CAMERA", allow_hyphen_values = true)]
    camera: Option<CameraSpec>,
    /// Size of the pictures of the scene, px
    #[arg(long, value_name = "WxH", value_parser = spec::parse_size, default_value = "480x320")]
    size: (u32, u32),
    /// Write a report for a browser, report.html, into this folder, with all numbers as
    /// readings.json, .csv and .md, and its plots as SVG
    #[arg(long, value_name = "FOLDER", help_heading = "Output")]
    report: Option<PathBuf>,
    #[command(flatten)]
    overwrite: OverwriteArgs,
    /// Print the numbers as JSON
    #[arg(long, help_heading = "Output")]
    json: bool,
    #[command(flatten)]
    run: RunArgs,
}

/// A measurement to make with one instrument.
struct InstrumentTask {
    instrument: &'static Instrument,
    weather: Weather,
    /// Description of the weather.
    setting: String,
}

/// Runs the command.
///
/// # Errors
/// A reading is outside of its tolerance; everything is written before.
pub(crate) fn run(args: &MeasureArgs) -> Result<()> {
    if !args.time.is_finite() {
        bail!("--time {}: give seconds, such as 0 or 12.5", args.time);
    }
    let tasks = tasks(args)?;
    if let Some(folder) = &args.report {
        make_folder(folder)?;
        check_writable(&folder.join(PAGE))?;
        args.overwrite.check_report(&folder.join(PAGE), &[])?;
    }
    let started = Instant::now();
    let mut loaded = open(args)?;
    let camera = camera(args, &mut loaded)?;
    // The page of a whole sweep includes rendering speed.
    let is_whole = args.report.is_some() && args.instruments.is_empty() && !args.weather.is_given();
    let speed = is_whole.then(|| speed(args, &mut loaded, &camera)).transpose()?;
    let mut field = PlaceRenderer::new(loaded.renderer, loaded.place, camera);
    let report = MeasureReport { speed, ..measure(args, &mut field, tasks, started)? };
    if args.json {
        print_json(&tables::json(&report))?;
    } else {
        print!("{}", tables::text(&report));
    }
    if let Some(folder) = &args.report {
        write(&report, folder)?;
    }
    match report.verdict() {
        [_, 0] => Ok(()),
        [right, off] => bail!("{off} of {} readings are outside of their tolerance", right + off),
    }
}

const PAGE: &str = "report.html";
/// Size of the paper's pictures, px, and rounds in which speed is measured.
const PAPER_SIZE: (u32, u32) = (1200, 800);
const SPEED_ROUNDS: u32 = 3;

/// Writes the report, the page last.
fn write(report: &MeasureReport, folder: &Path) -> Result<()> {
    let mut files = vec![
        ("readings.json".to_owned(), json_text(&tables::json(report))?),
        ("readings.csv".to_owned(), tables::csv(report)),
        ("readings.md".to_owned(), tables::markdown(report)),
    ];
    files.extend(page::plots(report));
    let page = page::page(report)?;
    let size = page.len() as f64 * 1e-6;
    files.push((PAGE.to_owned(), page));
    for (name, text) in &files {
        write_text(&folder.join(name), text)?;
    }
    eprintln!("{}: {size:.1} MB, for a browser", folder.join(PAGE).display());
    Ok(())
}

/// Returns the instruments that are requested.
fn instruments(args: &MeasureArgs) -> Result<Vec<&'static Instrument>> {
    if args.instruments.is_empty() {
        return Ok(INSTRUMENTS.iter().collect());
    }
    let find = |name: &String| {
        INSTRUMENTS.iter().find(|instrument| instrument.name == name).with_context(|| {
            let names: Vec<&str> = INSTRUMENTS.iter().map(|instrument| instrument.name).collect();
            format!("--instruments {name}: unknown; the instruments are {}", names.join(", "))
        })
    };
    args.instruments.iter().map(find).collect()
}

/// Returns the measurements to make: one weather, or the sweep of each instrument.
fn tasks(args: &MeasureArgs) -> Result<Vec<InstrumentTask>> {
    let instruments = instruments(args)?;
    if args.weather.is_given() {
        let weather = args.weather.read()?;
        if weather.fidelity == Fidelity::Paper {
            bail!("fidelity `paper` has no physical units to be measured: --set fidelity=physical");
        }
        let applies = instruments.into_iter().filter(|instrument| (instrument.applies)(&weather, args.time));
        let task = |instrument| InstrumentTask {
            instrument,
            weather: weather.clone(),
            setting: weather.name.clone(),
        };
        let tasks: Vec<InstrumentTask> = applies.map(task).collect();
        if tasks.is_empty() {
            bail!(
                "the weather {} at {} s has nothing for these instruments to measure: give another, or none for all",
                weather.name,
                args.time
            );
        }
        return Ok(tasks);
    }
    let mut tasks = Vec::new();
    for instrument in instruments {
        for changes in instrument.sweep {
            let weather = changed(&Weather::clear(), changes)?;
            let setting = if changes.is_empty() { weather.name.clone() } else { (*changes).to_owned() };
            tasks.push(InstrumentTask { instrument, weather, setting });
        }
    }
    Ok(tasks)
}

/// Opens the scene.
fn open(args: &MeasureArgs) -> Result<OpenScene> {
    match &args.scene {
        Some(scene) => {
            let (scene, facts) = (scene.clone(), args.facts.clone());
            let scene = SceneArgs { scene, repair: args.repair, facts, ..SceneArgs::default() };
            OpenScene::new(&scene, &args.run, None)
        }
        None => {
            let scene = street::scene(1.0, Lighting::Sunny, args.run.threads)?;
            OpenScene::of(scene, &Metadata::default(), &args.run)
        }
    }
}

/// Returns the name of the scene.
fn name(args: &MeasureArgs) -> String {
    args.scene.as_ref().map_or_else(|| "built-in street".into(), |scene| stem_of(scene))
}

/// The paper's table of speeds, in few rounds.
fn speed(args: &MeasureArgs, loaded: &mut OpenScene, camera: &Camera) -> Result<SpeedTable> {
    let mut table = SpeedTable::new(PAPER_SIZE);
    let camera = camera.resized(PAPER_SIZE.0, PAPER_SIZE.1);
    table.add(&name(args), loaded, &camera, &args.run, SPEED_ROUNDS)?;
    Ok(table)
}

/// Returns the camera for views of the scene.
fn camera(args: &MeasureArgs, loaded: &mut OpenScene) -> Result<Camera> {
    let options = ViewOptions { size: Some(args.size), ..ViewOptions::default() };
    if args.camera.is_none() && args.scene.is_none() {
        return Ok(Street::views()[0].camera(args.size)?);
    }
    loaded.camera(args.camera.as_ref(), &options)
}

/// Runs the instruments.
fn measure(
    args: &MeasureArgs,
    field: &mut PlaceRenderer,
    tasks: Vec<InstrumentTask>,
    started: Instant,
) -> Result<MeasureReport> {
    let mut sections: Vec<InstrumentSection> = Vec::new();
    progress::for_each(tasks.into_iter(), "readings", INCOMPLETE, |task, bar| {
        let InstrumentTask { instrument, weather, setting } = task;
        bar.set_message(instrument.name);
        let request = MeasureRequest { weather: &weather, time: args.time, setting: &setting };
        let finding =
            instrument.read(field, &request).with_context(|| format!("{} in {setting}", instrument.name))?;
        field.clear_away();
        match sections.last_mut().filter(|section| section.instrument.name == instrument.name) {
            Some(section) => section.findings.push(finding),
            None => sections.push(InstrumentSection { instrument, findings: vec![finding] }),
        }
        Ok(())
    })?;
    let unit = &field.place.survey().metres_per_unit;
    // Four digits of whatever size.
    let metres: f64 = format!("{:.3e}", unit.value).parse()?;
    let about = format!("1 scene unit is {metres} m ({})", unit.source);
    Ok(MeasureReport {
        place: name(args),
        about,
        renderer: field.renderer.describe(),
        seconds: started.elapsed().as_secs_f64(),
        sections,
        speed: None,
    })
}
