//! `render`: renders a scene under a weather as a picture, a video or a folder of frames.

mod args;
pub(crate) mod camera;
mod device;
mod job;
mod manifest;
mod output_args;
mod pairs;
mod range;
mod rig;
mod sequence;
mod stages;
mod target;

pub(crate) use args::RenderArgs;
pub(crate) use output_args::parse_rasterization;

use crate::scene::{OpenScene, print_warnings};
use anyhow::{Context, Result, bail};
use args::LodChoice;
use camera::CameraPlan;
use job::RenderJob;
use output_args::check_labels;
use std::path::{Path, PathBuf};
use target::OutputTarget;
use weather_magician::output::{LayerPlacement, PictureFormat, PictureStyle, layers_of};
use weather_magician::view::moves::PathSpec;
use weather_magician::view::spec::CameraSpec;
use weather_magician::{Layers, PictureLayer};

/// The parts of a picture that the air changes.
const AIR_LAYERS: Layers = Layers::TRANSMITTANCE.with(Layers::CLEAN).with(Layers::AIRLIGHT);

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
    let target = OutputTarget::of(args, &weather)?;
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
