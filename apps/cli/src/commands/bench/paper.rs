//! `bench --paper`: measures the paper's Table I, frames a second by weather, beside the paper's
//! own numbers.
//!
//! The paper (Sang et al., Table I) renders scenes of Mip-NeRF 360 at 1200x800 px on an RTX 4090:
//! clear 83.30, fog, smog and haze 31.27, rain and snowfall 10.42, snow cover 58.24 frames a
//! second. Here the same four columns are measured for each scene on each device, with this
//! program's weather and with the paper's own formulas (fidelity `paper`), and for the clear
//! picture the growth of time with pixels and splats. Numbers of different machines do not compare
//! programs: the table names the machine.

use super::args::BenchArgs;
use super::measure::{BenchCase, BenchTarget, INCOMPLETE, turns};
use super::scene_cases::{cases, in_turns};
use super::scenes::each;
use crate::interrupt;
use crate::output::{json_text, make_folder, print_json, write_text};
use crate::report::plot::{Axis, Plot, Series};
use crate::scene::{OpenScene, RunArgs};
use anyhow::Result;
use serde::Serialize;
use std::fmt::Write;
use std::path::Path;
use weather_magician::Camera;

/// The columns, with their keys in CSV.
const COLUMNS: [(&str, &str); 4] = [
    ("clear", "Clear weather"),
    ("fog", "Fog / smog / haze"),
    ("fall", "Rain / snowfall"),
    ("cover", "Snow cover"),
];

/// Frame rates that the paper states; `None` where it has none.
const PAPER: [(&str, [Option<f64>; 4]); 4] = [
    ("ClimateGAN, in the paper (RTX 4090)", [None, Some(0.11), None, None]),
    ("Stable Diffusion, in the paper (RTX 4090)", [Some(0.12), Some(0.12), Some(0.12), Some(0.12)]),
    ("ClimateNeRF, in the paper (RTX 4090)", [Some(2.26), Some(1.33), None, Some(0.09)]),
    ("the paper's own (RTX 4090)", [Some(83.30), Some(31.27), Some(10.42), Some(58.24)]),
];

/// Rows that are measured: this program's weather, then the paper's formulas. A cell with several
/// cases is the mean of their times.
const ROWS: [(&str, [&[&str]; 4]); 2] = [
    (
        "physical",
        [&["rgb"], &["rgb, fog"], &["rgb, rain 25 mm/h", "rgb, snow 2.5 mm/h"], &["rgb, snow cover 10 cm"]],
    ),
    (
        "paper's formulas",
        [&["rgb"], &["rgb, fog, paper"], &["rgb, rain, paper, k = 4"], &["rgb, snow cover, paper"]],
    ),
];

/// Shares of the picture's sides at which the clear scene is measured.
const SIDE_SHARES: [f64; 4] = [0.35, 0.5, 0.7, 1.0];

/// A row of the table.
#[derive(Serialize)]
struct SpeedRow {
    method: String,
    scene: Option<String>,
    device: Option<String>,
    splats: Option<usize>,
    /// Frames a second, in the order of [`COLUMNS`].
    fps: [Option<f64>; 4],
}

/// Times of clear frames by picture size.
#[derive(Serialize)]
struct BySize {
    scene: String,
    device: String,
    /// Megapixels and milliseconds of a frame.
    points: Vec<[f64; 2]>,
}

/// The table and its plots.
#[derive(Serialize)]
pub(crate) struct SpeedTable {
    size: [u32; 2],
    /// Names of the columns of [`SpeedRow::fps`].
    columns: [&'static str; COLUMNS.len()],
    rows: Vec<SpeedRow>,
    by_pixels: Vec<BySize>,
}

/// Returns true if the table has a case of this name.
fn is_in_table(name: &str) -> bool {
    ROWS.iter().any(|(_, columns)| columns.iter().any(|cases| cases.contains(&name)))
}

/// Measures all scenes on all devices, prints the table and writes it with its plots.
pub(crate) fn run(args: &BenchArgs) -> Result<()> {
    if let Some(folder) = &args.report {
        args.overwrite.check_report(&folder.join(TABLE), &[])?;
    }
    let mut table = SpeedTable::new(args.size);
    let devices =
        if args.devices.is_empty() { std::slice::from_ref(&args.run.device) } else { &args.devices };
    for device in devices {
        let run = RunArgs { device: device.clone(), ..args.run.clone() };
        let args = BenchArgs { run, ..args.clone() };
        each(&args, |name, loaded, camera| table.add(name, loaded, &camera, &args.run, args.frames))?;
    }
    if args.json {
        print_json(&table)?;
    } else {
        print!("{}", table.markdown());
    }
    args.report.as_deref().map_or(Ok(()), |folder| write(&table, folder))
}

impl SpeedTable {
    /// Returns a table with the paper's rows, for pictures of `size`, px.
    pub(crate) fn new(size: (u32, u32)) -> Self {
        let row = |(method, fps): (&str, _)| SpeedRow {
            method: method.into(),
            scene: None,
            device: None,
            splats: None,
            fps,
        };
        let columns = COLUMNS.map(|(key, _)| key);
        Self { size: [size.0, size.1], columns, rows: PAPER.map(row).into(), by_pixels: Vec::new() }
    }

    /// Measures a scene and adds its rows.
    pub(crate) fn add(
        &mut self,
        name: &str,
        loaded: &mut OpenScene,
        camera: &Camera,
        run: &RunArgs,
        rounds: u32,
    ) -> Result<()> {
        let cases: Vec<BenchCase> =
            cases(loaded)?.into_iter().filter(|case| is_in_table(case.name)).collect();
        let measured = in_turns(loaded, camera, &cases, run, rounds)?;
        interrupt::check(INCOMPLETE)?;
        let device = loaded.renderer.describe();
        let seconds = |case: &&str| -> Option<f64> {
            let place = cases.iter().position(|known| known.name == *case)?;
            Some(measured[place].median(|sample| sample.wall))
        };
        for (method, columns) in ROWS {
            let fps = columns.map(|cases| {
                let times: Option<Vec<f64>> = cases.iter().map(seconds).collect();
                times.map(|times| times.len() as f64 / times.iter().sum::<f64>())
            });
            self.rows.push(SpeedRow {
                method: format!("this program, {method}"),
                scene: Some(name.to_owned()),
                device: Some(device.clone()),
                splats: Some(loaded.place.scene().splats.len()),
                fps,
            });
        }
        let mut points = Vec::new();
        for share in SIDE_SHARES {
            let side = |side: u32| (f64::from(side) * share).round().max(1.0) as u32;
            let small = camera.resized(side(camera.width), side(camera.height));
            let clear = &cases[BenchCase::position(&cases, "rgb")];
            let stand = BenchTarget::plain(&mut loaded.renderer, loaded.place.set());
            let frames = turns(&mut [stand], &small, &[(0, clear)], rounds.min(8), "rounds")?;
            let pixels = f64::from(small.width) * f64::from(small.height);
            points.push([pixels * 1e-6, 1e3 * frames[0].median(|sample| sample.wall)]);
        }
        self.by_pixels.push(BySize { scene: name.to_owned(), device, points });
        Ok(())
    }

    /// Returns the header and the cells of all rows.
    pub(crate) fn cells(&self) -> ([&'static str; 8], Vec<[String; 8]>) {
        let [clear, fog, fall, cover] = COLUMNS.map(|(_, name)| name);
        let row = |row: &SpeedRow| {
            let text = |text: &Option<String>| text.clone().unwrap_or_default();
            let splats = row.splats.map(|splats| splats.to_string()).unwrap_or_default();
            let [a, b, c, d] = row.fps.map(cell);
            [row.method.clone(), text(&row.scene), splats, text(&row.device), a, b, c, d]
        };
        (
            ["method", "scene", "splats", "device", clear, fog, fall, cover],
            self.rows.iter().map(row).collect(),
        )
    }

    /// Returns the caption of the table.
    pub(crate) fn caption(&self) -> String {
        let [width, height] = self.size;
        format!("Frames a second at {width}x{height} px, by the median time of a frame on the clock.")
    }

    fn markdown(&self) -> String {
        let (head, rows) = self.cells();
        let mut out = format!("{}\n\n| {} |\n", self.caption(), head.join(" | "));
        out.push_str("|---|---|---:|---|---:|---:|---:|---:|\n");
        for row in rows {
            let _ = writeln!(out, "| {} |", row.join(" | "));
        }
        out
    }
}

fn cell(fps: Option<f64>) -> String {
    fps.map_or_else(|| "-".into(), |fps| format!("{fps:.2}"))
}

fn csv(table: &SpeedTable) -> String {
    let mut out =
        format!("method,scene,splats,device,{}\r\n", COLUMNS.map(|(key, _)| format!("{key}_fps")).join(","));
    for row in &table.rows {
        let quoted = |text: &str| format!("\"{}\"", text.replace('"', "\"\""));
        let text = |text: &Option<String>| quoted(text.as_deref().unwrap_or_default());
        let splats = row.splats.map(|splats| splats.to_string()).unwrap_or_default();
        let fps = row.fps.map(|fps| fps.map(|fps| format!("{fps:.3}")).unwrap_or_default()).join(",");
        let _ = write!(
            out,
            "{},{},{splats},{},{fps}\r\n",
            quoted(&row.method),
            text(&row.scene),
            text(&row.device)
        );
    }
    out
}

/// Returns plots of a clear frame's time over pixels, and over splats if there are several scenes.
pub(crate) fn plots(table: &SpeedTable) -> Vec<(&'static str, Plot)> {
    let by_pixels = table
        .by_pixels
        .iter()
        .map(|by| Series::line(format!("{}, {}", by.scene, by.device), by.points.clone()));
    let mut plots = vec![(
        "speed-pixels.svg",
        Plot {
            title: "Clear frame by picture size".into(),
            x: Axis::linear("picture, million pixels"),
            y: Axis::linear("time of a frame, ms"),
            series: by_pixels.collect(),
        },
    )];
    let by_splats: Vec<[f64; 2]> = table
        .rows
        .iter()
        .filter(|row| row.method.ends_with("physical"))
        .filter_map(|row| Some([row.splats? as f64 * 1e-6, 1e3 / row.fps[0]?]))
        .collect();
    if by_splats.len() > 1 {
        plots.push((
            "speed-splats.svg",
            Plot {
                title: "Clear frame by size of the scene".into(),
                x: Axis::linear("splats, millions"),
                y: Axis::linear("time of a frame, ms"),
                series: vec![Series::points("scenes", by_splats)],
            },
        ));
    }
    plots
}

/// The file that a folder with a table is known by.
const TABLE: &str = "speed.md";

fn write(table: &SpeedTable, folder: &Path) -> Result<()> {
    make_folder(folder)?;
    let mut files =
        vec![(TABLE, table.markdown()), ("speed.csv", csv(table)), ("speed.json", json_text(table)?)];
    files.extend(plots(table).into_iter().map(|(name, plot)| (name, plot.svg())));
    for (name, text) in files {
        write_text(&folder.join(name), &text)?;
    }
    eprintln!("{}: speed.md, .csv, .json and plots", folder.display());
    Ok(())
}
