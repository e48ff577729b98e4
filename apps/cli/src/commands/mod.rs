//! The commands, one file each.

pub(crate) mod align;
mod bake;
mod batch;
mod bench;
mod convert;
mod demo;
mod devices;
mod evaluate;
#[cfg(feature = "viewer")]
mod export_web;
mod inspect;
mod label;
mod measure;
pub(crate) mod priors;
pub(crate) mod reconstruct;
pub(crate) mod render;
pub(crate) mod scan;
mod sky;
#[cfg(feature = "viewer")]
pub(crate) mod view;
pub(crate) mod weather;

use anyhow::Result;
use clap::{Parser, Subcommand};

/// The exit codes of all commands.
const EXIT_CODES: &str = "Exit codes: 0 done; 1 failed, with one line of error; 2 wrong options; 130 stopped by Ctrl-C, 143 by SIGTERM, 129 by \
     SIGHUP: work that can go on is kept, partial files are removed.";

/// Real weather on real places: scenes of 3D Gaussian splatting in fog, haze, smog, rain and snow.
#[derive(Parser, Debug)]
// The name in usage texts is not that of whatever started the process, which may be a script.
#[command(name = "weather-magician", bin_name = "weather-magician")]
#[command(version, about, arg_required_else_help = true, max_term_width = 110, after_help = EXIT_CODES)]
pub(crate) struct Cli {
    #[command(subcommand)]
    command: CliCommand,
}

#[derive(Subcommand, Debug)]
enum CliCommand {
    /// Reconstruct a scene from photos
    Reconstruct(Box<reconstruct::ReconstructArgs>),
    /// Compute depth, normals and sky of photos before a training: from the photos, with a network,
    /// or from maps
    Priors(Box<priors::PriorsArgs>),
    /// Render a scene under a weather: a picture, a video or a folder of frames
    Render(Box<render::RenderArgs>),
    /// Scan a scene with a lidar or a radar under a weather: points with range, intensity and class
    Scan(Box<scan::ScanArgs>),
    /// Show a scene in a browser: fly through it, change the weather, save pictures and videos
    #[cfg(feature = "viewer")]
    View(Box<view::ViewArgs>),
    /// Write a scene as a static web page that renders it in weather in the browser, without a
    /// server
    #[cfg(feature = "viewer")]
    ExportWeb(Box<export_web::ExportWebArgs>),
    /// Make a data set by a plan: scenes in many weathers, as nuScenes, KITTI and other layouts
    Batch(batch::BatchArgs),
    /// Turn weather reports (METAR, hourly tables, WMO codes, CARLA, words) into weather files
    Weather(weather::WeatherCommandArgs),
    /// Write a scene with its snow or dust cover as an ordinary scene file
    Bake(Box<bake::BakeArgs>),
    /// Convert scenes to another format; rotate, scale, crop or reduce them
    Convert(convert::ConvertArgs),
    /// Compare a scene with photos, and with true depth, normals and sky if there are maps; or
    /// pictures with photographs of real weather
    Evaluate(Box<evaluate::EvaluateArgs>),
    /// Measure a weather in rendered pictures: visibility, mm/h, drops, streaks, snow depth, mass
    /// and consistency
    Measure(Box<measure::MeasureArgs>),
    /// Make a panorama of the sky from photos, for the sky of a weather
    Sky(sky::SkyArgs),
    /// Set up, ground and scale of a scene by hand
    Align(align::AlignArgs),
    /// Give splats labels or instances by masks of the photos
    Label(label::LabelArgs),
    /// Print what a scene contains, and its faults
    Inspect(inspect::InspectArgs),
    /// Measure rendering speed
    Bench(bench::BenchArgs),
    /// List the processor and the GPUs, and the device that would render
    Devices(devices::DevicesArgs),
    /// Make a scene, pictures and a film of the built-in street: no input, no download
    Demo(demo::DemoArgs),
}

/// Runs the command.
pub(crate) fn run(cli: Cli) -> Result<()> {
    crate::interrupt::listen();
    match cli.command {
        CliCommand::Reconstruct(args) => reconstruct::run(&args),
        CliCommand::Priors(args) => priors::run(&args),
        CliCommand::Render(args) => render::run(&args),
        CliCommand::Scan(args) => scan::run(&args),
        #[cfg(feature = "viewer")]
        CliCommand::View(args) => view::run(&args),
        #[cfg(feature = "viewer")]
        CliCommand::ExportWeb(args) => export_web::run(&args),
        CliCommand::Batch(args) => batch::run(&args),
        CliCommand::Weather(args) => weather::run(&args),
        CliCommand::Bake(args) => bake::run(&args),
        CliCommand::Convert(args) => convert::run(&args),
        CliCommand::Evaluate(args) => evaluate::run(&args),
        CliCommand::Measure(args) => measure::run(&args),
        CliCommand::Sky(args) => sky::run(&args),
        CliCommand::Align(args) => align::run(&args),
        CliCommand::Label(args) => label::run(&args),
        CliCommand::Inspect(args) => inspect::run(&args),
        CliCommand::Bench(args) => bench::run(&args),
        CliCommand::Devices(args) => devices::run(&args),
        CliCommand::Demo(args) => demo::run(&args),
    }
}
