//! `render`: renders a scene under a weather as a picture, a video or a folder of frames.

pub(crate) mod camera;
mod device;
mod manifest;
mod pairs;
mod range;
mod rig;
mod sequence;
mod stages;

use crate::choices::{DITHERS, ENCODERS, one_of};
use crate::level_args::LevelArgs;
use crate::names::stem_of;
use crate::overwrite::OverwriteArgs;
use crate::progress::Reporter;
use crate::scene::{OpenScene, OwnSkyArgs, RunArgs, SceneArgs, print_warnings};
use crate::weather::WeatherArgs;
use anyhow::{Context, Result, bail};
use camera::{CameraArgs, CameraPlan};
use clap::{Args, ValueEnum};
use device::DeviceArgs;
use range::FrameRange;
use std::num::NonZeroU32;
use std::path::{Path, PathBuf};
use weather_magician::camera_model::{CameraModel, SensorCamera};
use weather_magician::output::{LayerFile, LayerPlacement, PictureFormat, PictureStyle, layers_of};
use weather_magician::video::VideoEncoder;
use weather_magician::view::moves::PathSpec;
use weather_magician::view::spec::CameraSpec;
use weather_magician::{
    Camera, FrameRequest, Layers, NextFrame, Picture, PictureLayer, PreparedPlace, Renderer, Weather,
    picture_tags,
};
use wm_base::files::check_writable;
use wm_image::color::Dither;
use wm_image::png::DepthScale;
use wm_render::{Background, Stats};
use wm_scene::Rasterization;

/// Options of `render`.
#[derive(Args, Debug)]
#[command(after_long_help = wm_weather::reference_page::help())]
pub(crate) struct RenderArgs {
    #[command(flatten)]
    scene: SceneArgs,
    #[command(flatten)]
    sky: OwnSkyArgs,
    #[command(flatten)]
    levels: LevelArgs,
    /// Levels of detail that a sequence is drawn at: shot (those that suit all of its frames, so
    /// that nothing changes its level on the way) or frame (those of each frame, which are finer)
    #[arg(long, value_name = "HOW", default_value = "shot", help_heading = "Scene")]
    lod: LodChoice,
    #[command(flatten)]
    weather: WeatherArgs,
    #[command(flatten)]
    camera: CameraArgs,
    #[command(flatten)]
    device: DeviceArgs,
    /// Make the pictures and lidar sweeps of all sensors of a rig (TOML), a folder each in the
    /// folder --out
    #[arg(long, value_name = "FILE", help_heading = "Camera")]
    rig: Option<PathBuf>,
    #[command(flatten)]
    output: OutputArgs,
    #[command(flatten)]
    pairs: pairs::PairsArgs,
    #[command(flatten)]
    run: RunArgs,
}

/// Options of the output.
#[derive(Args, Debug)]
#[command(next_help_heading = "Output")]
struct OutputArgs {
    /// Output: a .png, .exr or .npy picture, an .mp4 video, or a folder of frames
    /// [default: named after scene and weather, in this folder]
    #[arg(short, long, value_name = "PATH")]
    out: Option<PathBuf>,
    #[command(flatten)]
    overwrite: OverwriteArgs,
    #[arg(long, value_name = "LIST", value_delimiter = ',', help = also_help())]
    also: Vec<LayerFile>,
    /// Write the steps of the paper's rain and snow beside the picture, as PNG: noise, overlay,
    /// filtered and final; with --set fidelity=paper
    #[arg(long)]
    stages: bool,
    /// Write the pictures of --also that have no format of their own as layers of the colour's .exr
    #[arg(long, requires = "also")]
    layers: bool,
    /// Format of the frames in a folder: png, exr or npy
    #[arg(long, value_name = "FORMAT", default_value = "png")]
    frame_format: PictureFormat,
    /// Frame rate, frames a second, such as 30, 29.97 or 30000/1001
    #[arg(long, value_name = "RATE", allow_negative_numbers = true, default_value = "30")]
    fps: weather_magician::video::FrameRate,
    /// Length of a video, seconds [default: length of the camera's path, else 5]
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    seconds: Option<f64>,
    /// Render only these frames of the sequence, counted from 0: 300..420 (without 420), 300..=420
    /// or 300..; they keep the numbers and times that they have in the whole sequence
    #[arg(long, value_name = "RANGE", allow_hyphen_values = true)]
    frames: Option<FrameRange>,
    /// Render only every N-th frame, from the first on; a video of them plays N times as fast
    #[arg(long, value_name = "N", default_value = "1")]
    frame_step: NonZeroU32,
    /// Time of a picture, and of a video's first frame, seconds [default: 0]
    #[arg(long, value_name = "S", allow_hyphen_values = true)]
    time: Option<f64>,
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
    dither: Dither,
    /// Encoder of videos
    #[arg(long, value_parser = one_of(ENCODERS), default_value = "builtin")]
    encoder: VideoEncoder,
    /// Bit rate of a video, bits a second [default: constant quality]
    #[arg(long, value_name = "BITS", value_parser = clap::value_parser!(u32).range(1..))]
    bitrate: Option<u32>,
}

impl OutputArgs {
    /// Returns the time of a picture, and of a video's first frame, seconds.
    fn time(&self) -> f64 {
        self.time.unwrap_or(0.0)
    }

    /// Checks the time, and the duration if it is given.
    fn check_times(&self) -> Result<()> {
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
    fn folder(&self, name: String, why: &str) -> Result<PathBuf> {
        let folder = self.out.clone().unwrap_or_else(|| name.into());
        let is_file = PictureFormat::of(&folder).is_some() || folder.extension().is_some_and(|e| e == "mp4");
        if !folder.is_dir() && (folder.exists() || is_file) {
            bail!("--out {}: is not a folder; {why}", folder.display());
        }
        Ok(folder)
    }

    /// Returns true if frames of a sequence are selected.
    fn asks_for_frames(&self) -> bool {
        self.frames.is_some() || self.frame_step.get() > 1
    }
}

/// The background behind all splats.
#[derive(Clone, Copy, Debug, PartialEq)]
enum BackgroundChoice {
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

/// The frames that share one cut of the levels of detail.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum LodChoice {
    /// All of a sequence.
    Shot,
    /// None: each has its own.
    Frame,
}

/// Destination of the frames.
enum OutputTarget {
    Picture(PathBuf),
    Video(PathBuf),
    Folder(PathBuf),
}

impl OutputTarget {
    /// Checks that the output can be written, as far as possible before rendering.
    fn check(&self) -> Result<()> {
        match self {
            Self::Picture(path) | Self::Video(path) => check_writable(path)?,
            Self::Folder(path) if path.exists() && !path.is_dir() => bail!(
                "--out {}: is not a folder; give a folder, or a name that ends in .png, .exr, .npy or .mp4",
                path.display()
            ),
            Self::Folder(_) => {}
        }
        Ok(())
    }
}

/// The parts of a picture that the air changes.
const AIR_LAYERS: Layers = Layers::TRANSMITTANCE.with(Layers::CLEAN).with(Layers::AIRLIGHT);

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

/// Runs the command.
pub(crate) fn run(args: &RenderArgs) -> Result<()> {
    // Cheap checks come before the scene is read.
    let (weather, weather_files) = args.weather.read_with_files()?;
    if let Some(file) = &args.rig {
        return rig::run(args, &weather, file);
    }
    let asks_for_pairs = args.pairs.is_asked_for()?;
    if let Some(option) = args.device.given().filter(|_| asks_for_pairs) {
        bail!("{option}: pairs are pictures of instants; leave one of the two out");
    }
    if args.camera.lens.is_some() {
        if asks_for_pairs {
            bail!("--lens: pairs have the cameras of the photos; leave one of the two out");
        }
        if weather.fidelity == wm_weather::Fidelity::Paper {
            bail!(
                "--lens: rain and snow of fidelity paper lie on the picture, not in the place; use --set fidelity=physical"
            );
        }
    }
    if asks_for_pairs {
        return pairs::run(args, &weather);
    }
    let target = target_of(args, &weather)?;
    target.check()?;
    check_inputs(args, &target, &weather_files)?;
    if matches!(target, OutputTarget::Picture(_)) && args.output.asks_for_frames() {
        bail!("--frames and --frame-step are for videos and folders of frames: give --out one of these");
    }
    if let Some(option) = args.device.given().filter(|_| args.output.stages) {
        bail!("{option}: --stages are steps of one instant; leave one of the two out");
    }
    if args.output.stages {
        stages::check(&weather, &target)?;
    }
    let is_exr = match &target {
        OutputTarget::Picture(path) => PictureFormat::of(path) == Some(PictureFormat::Exr),
        _ => args.output.frame_format == PictureFormat::Exr,
    };
    if args.output.layers && !is_exr {
        bail!("--layers are those of an .exr: give --out a name that ends in .exr, or --frame-format exr");
    }
    let mut layers = layers_of(&args.output.also);
    let asks_for_air = layers.without(AIR_LAYERS) != layers;
    if asks_for_air && weather.fidelity == wm_weather::Fidelity::Paper {
        bail!("--also transmittance, clean or airlight: {}", pairs::NO_AIR);
    }
    args.camera.check()?;
    let lens = args.camera.lens.as_ref().map(|lens| lens.view(args.camera.viewpoint.size)).transpose()?;
    let model = args.device.model(lens, &weather)?;
    layers.check(&model, &weather).context("--also")?;
    if args.output.stages {
        if layers.iter().any(PictureLayer::is_of_instant) {
            bail!("--stages: shows neither flow nor labels; leave one of the two out");
        }
        layers |= Layers::PAPER_STAGES;
    }
    if let OutputTarget::Picture(path) = &target
        && args.camera.path.is_some()
        && args.output.time.is_none()
    {
        bail!(
            "--path moves the camera, and {} is one picture: give --out a name that ends in .mp4 or a folder, or --time S for \
             the picture at that time",
            path.display()
        );
    }

    let views = args.camera.viewpoint.views.as_ref();
    let mut loaded = OpenScene::in_levels(&args.scene, &args.run, views, args.sky, args.levels)?;
    let plan = CameraPlan::plan(
        &args.camera,
        &args.output,
        &mut loaded,
        matches!(target, OutputTarget::Picture(_)),
    )?;
    if args.lod == LodChoice::Shot {
        loaded.place.set_shot(&plan.shot(args.camera.lens.is_some()));
    }
    let wanted = range::wanted(args.output.frames, args.output.frame_step, plan.frames)?;
    args.output.set_drawing(&mut loaded.place);
    if weather.effects().any(|(effect, _)| effect.precipitation.is_some()) {
        // Before anything is made: a path may be too fast at any of its frames.
        let metres = loaded.place.site().metres_per_unit;
        wanted.iter().try_for_each(|index| plan.motion.at(plan.time(*index), metres).check_speed())?;
    }
    let mut job = RenderJob::new(loaded, weather, plan, model, layers)?;
    check_labels(layers, &job.place, &args.scene.scene)?;
    let rendered = match target {
        OutputTarget::Picture(path) => job.picture(&path, args),
        OutputTarget::Video(path) => sequence::video(&mut job, &wanted, &path, args),
        OutputTarget::Folder(path) => sequence::folder(&mut job, &wanted, &path, args),
    };
    // Drawing has warnings of its own; those of loading and preparing are printed already.
    print_warnings(&mut job.place);
    rendered
}

/// Checks that no output is one of the files that are read, or replaces another without
/// `--overwrite`.
fn check_inputs(args: &RenderArgs, target: &OutputTarget, weather_files: &[PathBuf]) -> Result<()> {
    let camera_file = match &args.camera.viewpoint.camera {
        Some(CameraSpec::File(file)) => Some(file),
        _ => None,
    };
    let path_file = match &args.camera.path {
        Some(PathSpec::File(file)) => Some(file),
        _ => None,
    };
    let inputs = [Some(&args.scene.scene), camera_file, path_file].into_iter().flatten().chain(weather_files);
    let inputs: Vec<&Path> = inputs.map(PathBuf::as_path).collect();
    let mut outputs: Vec<PathBuf> = args.camera.save_path.iter().cloned().collect();
    if let OutputTarget::Picture(path) | OutputTarget::Video(path) = target {
        outputs.push(path.clone());
    }
    if let OutputTarget::Picture(path) = target {
        let format = PictureFormat::of(path).unwrap_or(PictureFormat::Png);
        let place = if args.output.layers { LayerPlacement::Layers } else { LayerPlacement::Beside };
        let also = args.output.also.iter().filter(|also| !place.is_layer(**also, format));
        outputs.extend(also.map(|also| PictureStyle::path_of(*also, format, path)));
        if args.output.stages {
            outputs.extend(stages::paths(path));
        }
    }
    outputs.iter().try_for_each(|file| args.output.overwrite.check_report(file, &inputs))
}

/// The scene, the weather and the camera of the frames to render.
struct RenderJob {
    renderer: Renderer,
    place: PreparedPlace,
    weather: Weather,
    plan: CameraPlan,
    /// The camera that takes the pictures.
    camera: SensorCamera,
    layers: Layers,
}

impl RenderJob {
    /// Prepares the scene for the weather.
    fn new(
        mut loaded: OpenScene,
        weather: Weather,
        plan: CameraPlan,
        model: CameraModel,
        layers: Layers,
    ) -> Result<Self> {
        let weather = loaded.place.weather_of_shot(&weather, &plan.motion.camera(plan.time(0)));
        loaded.prepare(&weather)?;
        let OpenScene { renderer, place } = loaded;
        let camera = SensorCamera::new(model, plan.motion.clone());
        Ok(Self { renderer, place, weather, plan, camera, layers })
    }

    /// Renders the frame at `time`, seconds.
    fn render(&mut self, time: f64, picture: &mut Picture) -> Result<Stats> {
        let Self { renderer, place, weather, camera, layers, plan } = self;
        let metres = place.site().metres_per_unit;
        let (after, moving) = plan.next(time, metres);
        let request = FrameRequest {
            index: plan.index(time),
            layers: *layers,
            next: Some(NextFrame { time: after, camera: moving }),
            previous: plan.previous(time, metres),
            ..FrameRequest::new(weather, &*camera, time)
        };
        Ok(renderer.render_into(place, &request, picture, &mut Reporter::default())?)
    }

    /// Returns the camera at `time`, seconds, with the size and the intrinsics of the pictures.
    fn camera(&self, time: f64) -> Camera {
        let camera = self.plan.motion.camera(time);
        match &self.camera.model.lens {
            Some(lens) => Camera { viewmat: camera.viewmat, near: camera.near, ..*lens.intrinsics() },
            None => camera,
        }
    }

    fn picture(&mut self, path: &Path, args: &RenderArgs) -> Result<()> {
        let mut picture = Picture::default();
        let style = self.style(args, DepthScale::Auto, args.output.time());
        let stats = self.render(args.output.time(), &mut picture)?;
        let mut beside = style.write(&picture, path)?;
        if args.output.stages {
            beside.extend(stages::write(&picture, &style, path)?);
        }
        let frame = &picture.frame;
        println!(
            "{}: {}x{}, {}, {:.0} ms ({})",
            path.display(),
            frame.width,
            frame.height,
            self.weather.name,
            stats.wall * 1e3,
            self.renderer.describe()
        );
        for line in beside {
            println!("{line}");
        }
        Ok(())
    }

    /// Returns the style in which the frame at `time` is written.
    fn style(&self, args: &RenderArgs, depth_scale: DepthScale, time: f64) -> PictureStyle {
        let (scene, site) = (args.scene.scene.display().to_string(), self.place.site());
        let camera = self.camera(time);
        let mut tags = picture_tags(&scene, site, self.renderer.backend(), &self.weather, time, &camera);
        let model = &self.camera.model;
        if let Some(lens) = &model.lens {
            tags.push(("lens".into(), format!("{:?}", lens.lens())));
        }
        if let Some(settings) = model.settings() {
            tags.push(("camera".into(), settings));
        }
        PictureStyle {
            also: args.output.also.clone(),
            place: if args.output.layers { LayerPlacement::Layers } else { LayerPlacement::Beside },
            dither: args.output.dither,
            depth_scale,
            tags,
        }
    }
}

impl OutputArgs {
    /// Gives a place the background and the rasterization that are asked for.
    fn set_drawing(&self, place: &mut PreparedPlace) {
        place.background = match self.background {
            BackgroundChoice::Color(color) => Background::Color(color),
            BackgroundChoice::Auto => place.auto_background(),
            BackgroundChoice::Sky => Background::Sky(place.plain_sky()),
        };
        place.rasterization = self.rasterization.unwrap_or(place.rasterization);
    }
}

/// Returns what frames depend on beside weather and camera, as text for a manifest.
fn drawing_facts(place: &PreparedPlace, layers: Layers) -> String {
    format!("{layers:?} {:?} {:?}", place.background, place.rasterization)
}

/// Returns an error if the splats of a place lack labels that are asked for.
fn check_labels(layers: Layers, place: &PreparedPlace, scene: &Path) -> Result<()> {
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

fn target_of(args: &RenderArgs, weather: &Weather) -> Result<OutputTarget> {
    let moves = args.camera.path.is_some() || args.output.seconds.is_some() || args.output.asks_for_frames();
    let name = || {
        let weather = if weather.name == "clear" { String::new() } else { format!("-{}", weather.name) };
        format!("{}{weather}", stem_of(&args.scene.scene))
    };
    let path = match &args.output.out {
        Some(path) => path.clone(),
        None => PathBuf::from(format!("{}.{}", name(), if moves { "mp4" } else { "png" })),
    };
    args.output.check_times()?;
    let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
    match extension.as_deref() {
        _ if path.is_dir() || path.as_os_str().to_string_lossy().ends_with(['/', '\\']) => {
            Ok(OutputTarget::Folder(path))
        }
        Some("mp4") => Ok(OutputTarget::Video(path)),
        Some(_) if PictureFormat::of(&path).is_some() => Ok(OutputTarget::Picture(path)),
        None => Ok(OutputTarget::Folder(path)),
        Some(other) => bail!(
            "--out {}: a name that ends in .{other} cannot be written; use .png, .exr, .npy, .mp4 or a folder",
            path.display()
        ),
    }
}
