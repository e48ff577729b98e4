//! `measure`: whether a place's weather is what was asked for, by instruments that look at its pictures.

mod page;
mod tables;

use crate::commands::bench::paper::Table;
use crate::commands::demo::street;
use crate::interrupt::{self, Interrupted};
use crate::names::stem_of;
use crate::progress;
use crate::scene::{FactArgs, Loaded, RunArgs, SceneArgs};
use crate::weather::WeatherArgs;
use anyhow::{Context, Result, bail};
use clap::Args;
use std::path::{Path, PathBuf};
use std::time::Instant;
use weather_magician::measure::{
    Finding, INSTRUMENTS, Instrument, InstrumentRenderer, MeasureRequest, PlaceRenderer, Reading,
};
use weather_magician::view::spec::{self, CameraSpec};
use weather_magician::view::{self, choose};

use wm_scene::files::{check_writable, write_atomically};
use wm_scene::{Camera, Metadata};
use wm_street::Street;
use wm_weather::{Fidelity, Weather};

/// Options of `measure`.
#[derive(Args, Debug)]
#[command(after_long_help = wm_weather::reference_page::help())]
pub struct MeasureArgs {
    /// The scene to measure at, as for `render` [default: the built-in street]
    scene: Option<PathBuf>,
    #[command(flatten)]
    facts: FactArgs,
    /// Leave out splats that hold NaN or infinite numbers, and go on
    #[arg(long, help_heading = "Scene")]
    repair: bool,
    #[command(flatten)]
    weather: WeatherArgs,
    /// The instant of the weather, s
    #[arg(
        long,
        value_name = "S",
        default_value_t = 0.0,
        allow_negative_numbers = true,
        help_heading = "Weather"
    )]
    time: f64,
    /// Only these instruments: visibility, rays, gauge, streaks, stake, budget, consistency, controls [default: all
    /// that the weather gives something to measure]
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    instruments: Vec<String>,
    /// From where the place itself is looked at: EYE:TARGET as X,Y,Z:X,Y,Z, or a photo's name or number [default: chosen
    /// by looking at the scene]
    #[arg(short, long, value_name = "CAMERA", allow_hyphen_values = true)]
    camera: Option<CameraSpec>,
    /// Size of the pictures of the place, px
    #[arg(long, value_name = "WxH", value_parser = spec::parse_size, default_value = "480x320")]
    size: (u32, u32),
    /// Write a report for a browser, report.html, into this folder, with all numbers as readings.json, .csv and .md, and its
    /// plots as SVG
    #[arg(long, value_name = "FOLDER", help_heading = "Output")]
    report: Option<PathBuf>,
    /// Print the numbers as JSON
    #[arg(long, help_heading = "Output")]
    json: bool,
    #[command(flatten)]
    run: RunArgs,
}

/// What one instrument is to measure.
struct Task {
    instrument: &'static Instrument,
    weather: Weather,
    /// The weather in words.
    setting: String,
}

/// What one instrument found.
struct Section {
    instrument: &'static Instrument,
    findings: Vec<Finding>,
}

impl Section {
    fn readings(&self) -> impl Iterator<Item = &Reading> {
        self.findings.iter().flat_map(|finding| &finding.readings)
    }
}

/// Everything that was measured.
struct Report {
    place: String,
    about: String,
    renderer: String,
    seconds: f64,
    sections: Vec<Section>,
    /// Frames a second, for the page of a whole sweep.
    speed: Option<Table>,
}

impl Report {
    fn readings(&self) -> impl Iterator<Item = &Reading> {
        self.sections.iter().flat_map(Section::readings)
    }

    /// How many readings are as asked, and how many are not.
    fn verdict(&self) -> [usize; 2] {
        self.readings().fold([0; 2], |[right, off], reading| match reading.passes() {
            true => [right + 1, off],
            false => [right, off + 1],
        })
    }
}

/// Runs the command.
///
/// # Errors
/// Where something is not as asked, after all of it was written.
pub fn run(args: &MeasureArgs) -> Result<()> {
    if !args.time.is_finite() {
        bail!("--time {}: give seconds, such as 0 or 12.5", args.time);
    }
    let tasks = tasks(args)?;
    if let Some(folder) = &args.report {
        std::fs::create_dir_all(folder)
            .with_context(|| format!("cannot make the folder {}", folder.display()))?;
        check_writable(&folder.join(PAGE))?;
    }
    let started = Instant::now();
    let mut loaded = open(args)?;
    let camera = camera(args, &mut loaded)?;
    // The page of a whole sweep says how fast it is, too.
    let is_whole = args.report.is_some() && args.instruments.is_empty() && !args.weather.is_given();
    let speed = is_whole.then(|| speed(args, &mut loaded, &camera)).transpose()?;
    let mut field = PlaceRenderer::new(loaded.renderer, loaded.place, camera);
    let report = Report { speed, ..measure(args, &mut field, tasks, started)? };
    if args.json {
        println!("{}", serde_json::to_string_pretty(&tables::json(&report))?);
    } else {
        print!("{}", tables::text(&report));
    }
    if let Some(folder) = &args.report {
        write(&report, folder)?;
    }
    match report.verdict() {
        [_, 0] => Ok(()),
        [right, off] => bail!("{off} of {} readings are not as asked", right + off),
    }
}

const PAGE: &str = "report.html";
/// Size of the paper's pictures, px, and rounds in which speed is measured.
const PAPER_SIZE: (u32, u32) = (1200, 800);
const ROUNDS: u32 = 3;

/// Writes the report, the page last.
fn write(report: &Report, folder: &Path) -> Result<()> {
    let json = serde_json::to_string_pretty(&tables::json(report))? + "\n";
    let mut files = vec![
        ("readings.json".to_owned(), json),
        ("readings.csv".to_owned(), tables::csv(report)),
        ("readings.md".to_owned(), tables::markdown(report)),
    ];
    files.extend(page::plots(report));
    let page = page::page(report)?;
    let size = page.len() as f64 * 1e-6;
    files.push((PAGE.to_owned(), page));
    for (name, text) in &files {
        write_atomically(&folder.join(name), |out| Ok(out.write_all(text.as_bytes())?))?;
    }
    eprintln!("{}: {size:.1} MB, for a browser", folder.join(PAGE).display());
    Ok(())
}

/// The instruments that are asked for.
fn instruments(args: &MeasureArgs) -> Result<Vec<&'static Instrument>> {
    if args.instruments.is_empty() {
        return Ok(INSTRUMENTS.iter().collect());
    }
    let find = |name: &String| {
        INSTRUMENTS.iter().find(|instrument| instrument.name == name).with_context(|| {
            let names: Vec<&str> = INSTRUMENTS.iter().map(|instrument| instrument.name).collect();
            format!("--instruments {name}: there are {}", names.join(", "))
        })
    };
    args.instruments.iter().map(find).collect()
}

/// What is to be measured: one weather, or the sweep of each instrument.
fn tasks(args: &MeasureArgs) -> Result<Vec<Task>> {
    let instruments = instruments(args)?;
    if args.weather.is_given() {
        let weather = args.weather.read()?;
        if weather.fidelity == Fidelity::Paper {
            bail!("fidelity `paper` has no physical units to be measured: --set fidelity=physical");
        }
        let applies = instruments.into_iter().filter(|instrument| (instrument.applies)(&weather, args.time));
        let task = |instrument| Task { instrument, weather: weather.clone(), setting: weather.name.clone() };
        let tasks: Vec<Task> = applies.map(task).collect();
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
            let mut weather = Weather::clear();
            changes.iter().try_for_each(|change| weather.set_text(change))?;
            let setting = if changes.is_empty() { weather.name.clone() } else { changes.join(", ") };
            tasks.push(Task { instrument, weather, setting });
        }
    }
    Ok(tasks)
}

/// Opens the place.
fn open(args: &MeasureArgs) -> Result<Loaded> {
    match &args.scene {
        Some(scene) => {
            let (scene, facts) = (scene.clone(), args.facts.clone());
            Loaded::new(
                &SceneArgs { scene, level: None, repair: args.repair, assets: None, facts },
                &args.run,
                None,
            )
        }
        None => {
            let threads = args.run.threads.map(usize::from);
            Loaded::of(street::scene(1.0, threads)?, &Metadata::default(), &args.run)
        }
    }
}

/// What the place is called.
fn name(args: &MeasureArgs) -> String {
    args.scene.as_ref().map_or_else(|| "built-in street".into(), |scene| stem_of(scene))
}

/// The paper's table of speeds, in few rounds.
fn speed(args: &MeasureArgs, loaded: &mut Loaded, camera: &Camera) -> Result<Table> {
    let mut table = Table::new(PAPER_SIZE);
    let camera = camera.resized(PAPER_SIZE.0, PAPER_SIZE.1);
    table.add(&name(args), loaded, &camera, (&args.run, ROUNDS))?;
    Ok(table)
}

/// From where the place is looked at.
fn camera(args: &MeasureArgs, loaded: &mut Loaded) -> Result<Camera> {
    let options = view::ViewOptions { up: None, fov: None, near: None, size: Some(args.size) };
    Ok(match (&args.camera, &args.scene) {
        (Some(spec), _) => spec.camera(&loaded.place.scene().views, loaded.place.survey(), &options)?,
        (None, Some(_)) => choose::choose(&mut loaded.site(options))?.camera,
        (None, None) => Street::views()[0].camera(args.size)?,
    })
}

/// Measures.
fn measure(
    args: &MeasureArgs,
    field: &mut PlaceRenderer,
    tasks: Vec<Task>,
    started: Instant,
) -> Result<Report> {
    let bar = progress::bar(tasks.len() as u64, "readings");
    let mut sections: Vec<Section> = Vec::new();
    for Task { instrument, weather, setting } in tasks {
        if interrupt::asked() {
            return Err(Interrupted("the measurement is not complete".into()).into());
        }
        bar.set_message(instrument.name);
        let request = MeasureRequest { weather: &weather, time: args.time, setting: &setting };
        let finding = (instrument.read)(field, &request)
            .with_context(|| format!("{} in {setting}", instrument.name))?;
        field.clear_away();
        match sections.last_mut().filter(|section| section.instrument.name == instrument.name) {
            Some(section) => section.findings.push(finding),
            None => sections.push(Section { instrument, findings: vec![finding] }),
        }
        bar.inc(1);
    }
    bar.finish_and_clear();
    let unit = &field.place.survey().metres_per_unit;
    // Four digits of whatever size.
    let metres: f64 = format!("{:.3e}", unit.value).parse()?;
    let about = format!("1 scene unit is {metres} m ({})", unit.source);
    Ok(Report {
        place: name(args),
        about,
        renderer: field.renderer.describe(),
        seconds: started.elapsed().as_secs_f64(),
        sections,
        speed: None,
    })
}
