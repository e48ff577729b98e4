//! Options of `bench`.

use crate::overwrite::OverwriteArgs;
use crate::scene::RunArgs;
use clap::Args;
use std::path::PathBuf;
use weather_magician::Device;
use weather_magician::view::spec::{self, CameraSpec};

/// Options of `bench`.
#[derive(Args, Clone, Debug)]
pub(crate) struct BenchArgs {
    /// Scenes to render, one after the other [default: a synthetic one with --splats]
    pub(super) scenes: Vec<PathBuf>,
    /// Number of splats of the synthetic scene
    #[arg(long, value_name = "N", default_value_t = 1_000_000, value_parser = clap::value_parser!(u32).range(1..=50_000_000))]
    pub(super) splats: u32,
    /// SH degree of the synthetic scene
    #[arg(long, value_name = "DEGREE", default_value_t = 3, value_parser = clap::value_parser!(u8).range(0..=3))]
    pub(super) sh_degree: u8,
    /// Camera: EYE:TARGET as X,Y,Z:X,Y,Z, or a photo's name or number [default: chosen
    /// automatically]
    #[arg(short, long, value_name = "CAMERA", allow_hyphen_values = true)]
    pub(super) camera: Option<CameraSpec>,
    /// Picture size, px
    #[arg(long, value_name = "WxH", value_parser = spec::parse_size, default_value = "1200x800")]
    pub(super) size: (u32, u32),
    /// Vertical field of view, degrees [default: 50, or the photo's]
    #[arg(long, value_name = "DEGREES")]
    pub(super) fov: Option<f64>,
    /// Number of rounds to measure, after two warm-up rounds
    #[arg(long, value_name = "N", default_value_t = 20, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub(super) frames: u32,
    /// Measure only rgb and the cases whose name contains this, such as rain, or one of several;
    /// skips threads and SIMD paths
    #[arg(long, value_name = "TEXT")]
    pub(super) cases: Vec<String>,
    /// Do not render the splats of the sky
    #[arg(long)]
    pub(super) drop_sky: bool,
    /// Measure training steps instead of frames
    #[arg(long)]
    pub(super) training: bool,
    /// Measure lidar sweeps and pictures through a fisheye instead of frames
    #[arg(long, conflicts_with_all = ["training", "cases"])]
    pub(super) sensors: bool,
    /// Measure the paper's Table I (frames a second in clear air, fog, rain or snowfall, and snow
    /// cover) and print it with the paper's numbers as Markdown
    #[arg(long, conflicts_with_all = ["training", "sensors", "cases"])]
    pub(super) paper: bool,
    /// Devices of the table, as for --device, such as cpu,gpu [default: the one of --device]
    #[arg(long, value_name = "LIST", value_delimiter = ',', requires = "paper")]
    pub(super) devices: Vec<Device>,
    /// Write the table as speed.md, .csv and .json into this folder, with plots as SVG
    #[arg(long, value_name = "FOLDER", requires = "paper")]
    pub(super) report: Option<PathBuf>,
    #[command(flatten)]
    pub(super) overwrite: OverwriteArgs,
    /// Print everything as JSON
    #[arg(long)]
    pub(super) json: bool,
    #[command(flatten)]
    pub(super) run: RunArgs,
}
