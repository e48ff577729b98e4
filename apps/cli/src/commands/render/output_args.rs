//! Options of the output of `render`.

use super::range::FrameRange;
use crate::choices::{DITHERS, ENCODERS, one_of};
use crate::overwrite::OverwriteArgs;
use anyhow::{Result, bail};
use clap::Args;
use std::num::NonZeroU32;
use std::path::{Path, PathBuf};
use weather_magician::output::{LayerFile, PictureFormat};
use weather_magician::video::{FrameRate, VideoEncoder};
use weather_magician::{Layers, PictureLayer, PreparedPlace};
use wm_image::color::Dither;
use wm_render::Background;
use wm_scene::Rasterization;

/// Options of the output.
#[derive(Args, Debug)]
#[command(next_help_heading = "Output")]
pub(super) struct OutputArgs {
    /// Output: a .png, .exr or .npy picture, an .mp4 video, or a folder of frames
    /// [default: named after scene and weather, in this folder]
    #[arg(short, long, value_name = "PATH")]
    pub(super) out: Option<PathBuf>,
    #[command(flatten)]
    pub(super) overwrite: OverwriteArgs,
    #[arg(long, value_name = "LIST", value_delimiter = ',', help = also_help())]
    pub(super) also: Vec<LayerFile>,
    /// Write the steps of the paper's rain and snow beside the picture, as PNG: noise, overlay,
    /// filtered and final; with --set fidelity=paper
    #[arg(long)]
    pub(super) stages: bool,
    /// Write the pictures of --also that have no format of their own as layers of the colour's .exr
    #[arg(long, requires = "also")]
    pub(super) layers: bool,
    /// Format of the frames in a folder: png, exr or npy
    #[arg(long, value_name = "FORMAT", default_value = "png")]
    pub(super) frame_format: PictureFormat,
    /// Frame rate, frames a second, such as 30, 29.97 or 30000/1001
    #[arg(long, value_name = "RATE", allow_negative_numbers = true, default_value = "30")]
    pub(super) fps: FrameRate,
    /// Length of a video, seconds [default: length of the camera's path, else 5]
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    pub(super) seconds: Option<f64>,
    /// Render only these frames of the sequence, counted from 0: 300..420 (without 420), 300..=420
    /// or 300..; they keep the numbers and times that they have in the whole sequence
    #[arg(long, value_name = "RANGE", allow_hyphen_values = true)]
    pub(super) frames: Option<FrameRange>,
    /// Render only every N-th frame, from the first on; a video of them plays N times as fast
    #[arg(long, value_name = "N", default_value = "1")]
    pub(super) frame_step: NonZeroU32,
    /// Time of a picture, and of a video's first frame, seconds [default: 0]
    #[arg(long, value_name = "S", allow_hyphen_values = true)]
    pub(super) time: Option<f64>,
    /// Background behind all splats: auto, sky, black or #rrggbb; auto is a plain sky if the scene
    /// has none. The sky of a weather (--set sky=overcast) replaces it
    #[arg(long, value_name = "COLOR", default_value = "auto")]
    background: BackgroundChoice,
    /// Rendering of splats smaller than a pixel: classic or antialiased [default: from the file,
    /// else classic]
    #[arg(long, value_name = "MODE", value_parser = parse_rasterization)]
    rasterization: Option<Rasterization>,
    /// Quantisation of 8-bit pictures
    #[arg(long, value_parser = one_of(DITHERS), default_value = "ordered")]
    pub(super) dither: Dither,
    /// Encoder of videos
    #[arg(long, value_parser = one_of(ENCODERS), default_value = "builtin")]
    pub(super) encoder: VideoEncoder,
    /// Bit rate of a video, bits a second [default: constant quality]
    #[arg(long, value_name = "BITS", value_parser = clap::value_parser!(u32).range(1..))]
    pub(super) bitrate: Option<u32>,
}

impl OutputArgs {
    /// Returns the time of a picture, and of a video's first frame, seconds.
    pub(super) fn time(&self) -> f64 {
        self.time.unwrap_or(0.0)
    }

    /// Checks the time, and the duration if it is given.
    pub(super) fn check_times(&self) -> Result<()> {
        if let Some(seconds) = self.seconds.filter(|seconds| !(seconds.is_finite() && *seconds > 0.0)) {
            bail!("--seconds {seconds}: must be above 0");
        }
        if !self.time().is_finite() {
            bail!("--time {}: must be a number of seconds", self.time());
        }
        Ok(())
    }

    /// Returns the output folder, `name` if none is given; `why` ends the error about a path that
    /// is no folder.
    pub(super) fn folder(&self, name: String, why: &str) -> Result<PathBuf> {
        let folder = self.out.clone().unwrap_or_else(|| name.into());
        let is_file = PictureFormat::of(&folder).is_some() || folder.extension().is_some_and(|e| e == "mp4");
        if !folder.is_dir() && (folder.exists() || is_file) {
            bail!("--out {}: is not a folder; {why}", folder.display());
        }
        Ok(folder)
    }

    /// Returns true if frames of a sequence are selected.
    pub(super) fn asks_for_frames(&self) -> bool {
        self.frames.is_some() || self.frame_step.get() > 1
    }

    /// Gives a place the background and the rasterization that are asked for.
    pub(super) fn set_drawing(&self, place: &mut PreparedPlace) {
        place.background = match self.background {
            BackgroundChoice::Color(color) => Background::Color(color),
            BackgroundChoice::Auto => place.auto_background(),
            BackgroundChoice::Sky => Background::Sky(place.plain_sky()),
        };
        place.rasterization = self.rasterization.unwrap_or(place.rasterization);
    }
}

/// The background behind all splats.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum BackgroundChoice {
    Auto,
    Sky,
    Color([f32; 3]),
}

impl std::str::FromStr for BackgroundChoice {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "auto" => Ok(Self::Auto),
            "sky" => Ok(Self::Sky),
            "black" => Ok(Self::Color([0.0; 3])),
            _ => match text.parse() {
                Ok(wm_weather::ParamValue::Color(rgb)) => {
                    Ok(Self::Color(rgb.map(|v| v.clamp(0.0, 1.0) as f32)))
                }
                _ => Err(format!("`{text}` is not a background: use auto, sky, black or #rrggbb")),
            },
        }
    }
}

pub(crate) fn parse_rasterization(text: &str) -> Result<Rasterization, String> {
    match text {
        "classic" => Ok(Rasterization::Classic),
        "antialiased" => Ok(Rasterization::Antialiased),
        _ => Err(format!("`{text}` is not a mode: use classic or antialiased")),
    }
}

/// Returns the help of `--also`: every layer with a few words.
fn also_help() -> String {
    let beside = PictureLayer::all().filter(|layer| *layer != PictureLayer::Color);
    let layers: Vec<String> = beside
        .map(|layer| match layer.note() {
            "" => layer.name().into(),
            note => format!("{layer} ({note})"),
        })
        .collect();
    format!(
        "Further pictures: {}; append .png, .exr or .npy, or .flo for flow, to choose another format than the colour's",
        layers.join(", ")
    )
}

/// Returns an error if the splats of a place lack labels that are asked for.
pub(super) fn check_labels(layers: Layers, place: &PreparedPlace, scene: &Path) -> Result<()> {
    let mut kinds = layers.iter().filter_map(PictureLayer::label_kind);
    if let Some(kind) = kinds.find(|kind| place.labels(*kind).is_empty()) {
        bail!(
            "--also {}: the splats of {} have none; `weather-magician label` gives them by masks of the photos",
            kind.name(),
            scene.display()
        );
    }
    Ok(())
}
