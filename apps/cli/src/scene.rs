//! Options of a scene, and opening it: reading, checking, surveying and loading.

use crate::choices::{SKIES, first_given, one_of, sky_word};
use crate::level_args::LevelArgs;
use crate::progress::Reporter;
use anyhow::{Context, Result, bail};
use clap::Args;
use glam::DVec3;
use std::convert::Infallible;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use weather_magician::assets::AssetCache;
use weather_magician::formats::folder::{cameras_path, write_cameras};
use weather_magician::formats::{
    DetailLevel, ReadOptions, WriteOptions, read_scene, sidecar_path, write_scene_with, write_sidecar,
};
use weather_magician::view::spec::{self, CameraSpec};
use weather_magician::view::{ViewOptions, choose};
use weather_magician::{
    Camera, CpuConfig, Device, Metadata, PlaceOptions, PreparedPlace, Renderer, Scene, Weather,
};
use wm_capture as capture;
use wm_render::simd::SimdChoice;
use wm_render::{AnyDifferentiable, RenderError};
use wm_scene::Remark;
use wm_scene::survey::{OwnSky, known_distance};

/// The scene file and its facts.
#[derive(Args, Clone, Debug, Default)]
pub(crate) struct SceneArgs {
    /// The scene: a PLY, SPZ, SOG, glTF, .splat or .ksplat, or the folder of a 3DGS training or a
    /// SOG
    pub(crate) scene: PathBuf,
    /// Level of a scene with several levels of detail; 0 is the finest
    #[arg(long, value_name = "N", help_heading = "Scene")]
    pub(crate) level: Option<u32>,
    /// Remove splats that cannot be drawn (NaN, infinite or absurd numbers, rows of zeros), and
    /// files of a scene in levels of detail that are missing or damaged, and continue
    #[arg(long, help_heading = "Scene")]
    pub(crate) repair: bool,
    /// Folder that caches what takes long to compute for a scene (surfaces, shelter, snow covers),
    /// or off for no cache; it can be deleted at any time [default: SCENE.assets, beside the scene]
    #[arg(long, value_name = "FOLDER|off", help_heading = "Scene")]
    pub(crate) assets: Option<AssetFolder>,
    #[command(flatten)]
    pub(crate) facts: FactArgs,
}

/// The treatment of the scene's own sky.
#[derive(Args, Clone, Copy, Debug, Default)]
pub(crate) struct OwnSkyArgs {
    /// The scene's own sky: keep it, drop it, or rebuild it from what is far and above the horizon,
    /// where a reconstruction got it wrong
    #[arg(long, value_name = "HOW", value_parser = one_of(SKIES), default_value = "keep", help_heading = "Scene")]
    pub(crate) sky: OwnSky,
}

/// Facts about the scene that the user gives.
#[derive(Args, Clone, Debug, Default)]
pub(crate) struct FactArgs {
    /// Up in the scene's axes, such as 0,-1,0 [default: from the file, the photos or the splats]
    #[arg(long, value_name = "X,Y,Z", value_parser = spec::parse_direction, allow_hyphen_values = true, help_heading = "Scene")]
    pub(crate) up: Option<DVec3>,
    /// Height of the ground along up, scene units [default: from the file or the splats]
    #[arg(long, value_name = "UNITS", allow_hyphen_values = true, help_heading = "Scene")]
    pub(crate) ground: Option<f64>,
    /// Metres per scene unit [default: from the file, else 1 with a warning]
    #[arg(
        long,
        value_name = "METRES",
        allow_negative_numbers = true,
        help_heading = "Scene",
        conflicts_with = "known_distance"
    )]
    pub(crate) metres_per_unit: Option<f64>,
    /// The scale from two points and the metres between them, such as 0,0,0:1.5,0,2=12.5
    #[arg(long, value_name = "X,Y,Z:X,Y,Z=M", value_parser = parse_known_distance, allow_hyphen_values = true, help_heading = "Scene")]
    pub(crate) known_distance: Option<f64>,
}

/// Device, threads and SIMD path.
#[derive(Args, Clone, Debug, Default)]
#[command(next_help_heading = "Run")]
pub(crate) struct RunArgs {
    /// Device that renders and trains: auto (a hardware GPU if there is one, else the CPU), cpu,
    /// gpu, or gpu:NAME with part of a GPU's name
    #[arg(long, value_name = "DEVICE", default_value = "auto")]
    pub(crate) device: Device,
    /// Number of threads [default: one per core]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub(crate) threads: Option<u16>,
    /// SIMD path: auto, avx512, avx2, neon or portable
    #[arg(long, value_name = "PATH", default_value = "auto")]
    pub(crate) simd: SimdChoice,
}

impl RunArgs {
    /// Starts the renderer.
    pub(crate) fn renderer(&self) -> Result<Renderer> {
        Ok(Renderer::new(&self.device, self.cpu(), |error| {
            eprintln!("warning: {error}; the CPU renders instead");
        })?)
    }

    /// Starts the back end that gives derivatives.
    pub(crate) fn differentiable(&self) -> Result<Box<AnyDifferentiable>, RenderError> {
        let backend = AnyDifferentiable::new(&self.device, self.cpu(), |error| {
            eprintln!("warning: {error}; training continues on the CPU");
        });
        backend.map(Box::new)
    }

    /// Returns the configuration of the CPU renderer.
    pub(crate) fn cpu(&self) -> CpuConfig {
        CpuConfig { threads: self.threads.map(usize::from), simd: self.simd }
    }
}

impl FactArgs {
    /// Returns the facts as metadata.
    pub(crate) fn metadata(&self) -> Result<Metadata> {
        let metadata = Metadata {
            metres_per_unit: self.metres_per_unit.or(self.known_distance),
            up: self.up,
            ground: self.ground,
            ..Metadata::default()
        };
        if let Some(fault) = metadata.fault() {
            // The keys have the names of the options.
            bail!("--{}", fault.replace('_', "-"));
        }
        Ok(metadata)
    }
}

/// A scene that is ready to render, with the renderer that it is loaded into.
pub(crate) struct OpenScene {
    /// The renderer.
    pub(crate) renderer: Renderer,
    /// The loaded scene.
    pub(crate) place: PreparedPlace,
}

/// Prints the warnings of a place that are pending.
pub(crate) fn print_warnings(place: &mut PreparedPlace) {
    for warning in place.take_warnings() {
        eprintln!("warning: {warning}");
    }
}

impl OpenScene {
    /// Reads, checks, surveys and loads a scene. Prints warnings on the error stream.
    pub(crate) fn new(args: &SceneArgs, run: &RunArgs, views: Option<&PathBuf>) -> Result<Self> {
        Self::with_sky(args, run, views, OwnSkyArgs::default())
    }

    /// Opens a scene as [`Self::new`] does, and treats its sky.
    pub(crate) fn with_sky(
        args: &SceneArgs,
        run: &RunArgs,
        views: Option<&PathBuf>,
        sky: OwnSkyArgs,
    ) -> Result<Self> {
        // Cheap checks come before reading a large file.
        let facts = args.facts.metadata()?;
        let renderer = run.renderer()?;
        let mut scene = read_checked(&args.scene, args.level, views, args.repair)?;
        if let Some(line) = change_sky(&mut scene, &args.scene, sky.sky, &facts)? {
            eprintln!("{line}");
        }
        Self::with(
            scene,
            PlaceOptions {
                facts,
                assets: args.assets.clone().unwrap_or_default().folder(&args.scene),
                ..PlaceOptions::default()
            },
            renderer,
        )
    }

    /// Opens a scene as [`Self::with_sky`] does, or in levels of detail if it has them and does not
    /// fit the budget as a whole.
    pub(crate) fn in_levels(
        args: &SceneArgs,
        run: &RunArgs,
        views: Option<&PathBuf>,
        sky: OwnSkyArgs,
        levels: LevelArgs,
    ) -> Result<Self> {
        let budget = levels.budget();
        let index = if args.level.is_none() { budget.levels_of(&args.scene)? } else { None };
        let Some(index) = index else { return Self::with_sky(args, run, views, sky) };
        let facts = args.facts.metadata()?;
        refuse_for_levels(sky, views)?;
        let assets = args.assets.clone().unwrap_or_default().folder(&args.scene);
        let mut renderer = run.renderer()?;
        let place = renderer.load_levels(
            index,
            &PlaceOptions { facts, assets, ..PlaceOptions::default() },
            &budget,
            args.repair,
        )?;
        let mut loaded = Self { renderer, place };
        loaded.warn();
        Ok(loaded)
    }

    /// Loads a valid scene from memory.
    pub(crate) fn of(scene: Scene, given: &Metadata, run: &RunArgs) -> Result<Self> {
        Self::with(
            scene,
            PlaceOptions { facts: given.clone(), assets: None, ..PlaceOptions::default() },
            run.renderer()?,
        )
    }

    fn with(scene: Scene, options: PlaceOptions, mut renderer: Renderer) -> Result<Self> {
        let place = renderer.load_with(scene, &options)?;
        let mut loaded = Self { renderer, place };
        loaded.warn();
        Ok(loaded)
    }

    /// Prints the warnings that are pending.
    pub(crate) fn warn(&mut self) {
        print_warnings(&mut self.place);
    }

    /// Makes the assets that a weather needs, and frees the splats as read from the file: the
    /// renderer has a copy.
    pub(crate) fn prepare(&mut self, weather: &Weather) -> Result<()> {
        self.renderer.prepare(&mut self.place, weather, &mut Reporter::default())?;
        self.warn();
        self.place.release_splats();
        Ok(())
    }

    /// Returns the camera that is given, or chooses one.
    pub(crate) fn camera(&mut self, given: Option<&CameraSpec>, options: &ViewOptions) -> Result<Camera> {
        let Self { renderer, place } = self;
        Ok(match given {
            Some(spec) => spec.camera(&place.scene().views, place.survey(), options)?,
            None => choose::choose(&mut renderer.view_search(place, *options))?.camera,
        })
    }
}

/// Location of the asset cache.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) enum AssetFolder {
    /// A folder beside the scene.
    #[default]
    Beside,
    /// No cache.
    Off,
    /// This folder.
    At(PathBuf),
}

impl AssetFolder {
    /// Returns the folder for a scene.
    pub(crate) fn folder(&self, scene: &Path) -> Option<PathBuf> {
        match self {
            Self::Beside => Some(AssetCache::folder_of(scene)),
            Self::Off => None,
            Self::At(folder) => Some(folder.clone()),
        }
    }
}

impl FromStr for AssetFolder {
    type Err = Infallible;

    fn from_str(text: &str) -> Result<Self, Infallible> {
        Ok(if text == "off" { Self::Off } else { Self::At(text.into()) })
    }
}

/// Returns the options for reading a scene at a level of detail.
pub(crate) fn read_options(level: Option<u32>) -> ReadOptions {
    ReadOptions { level: level.map_or(DetailLevel::Finest, DetailLevel::Number), ..ReadOptions::default() }
}

/// Prints what a reader remarked, each remark on a line of the error stream.
pub(crate) fn print_remarks(remarks: &[Remark]) {
    for remark in remarks {
        eprintln!("{remark}");
    }
}

/// Starts threads for a command; `None` for one per core.
pub(crate) fn threads(count: Option<u16>) -> Result<rayon::ThreadPool> {
    let threads = rayon::ThreadPoolBuilder::new().num_threads(count.map_or(0, usize::from)).build();
    threads.context("cannot start threads")
}

/// Reads a scene, and prints what its reader remarked.
pub(crate) fn read_saying_remarks(path: &Path, options: &ReadOptions) -> Result<Scene> {
    let mut scene = read_scene(path, options)?;
    print_remarks(&std::mem::take(&mut scene.remarks));
    Ok(scene)
}

/// Reads a level of a scene with the cameras of a folder of `views`, if one is given, and checks
/// its splats, see [`check`].
pub(crate) fn read_checked(
    path: &Path,
    level: Option<u32>,
    views: Option<&PathBuf>,
    repair: bool,
) -> Result<Scene> {
    let views = views.map(|folder| capture::read_views(folder)).transpose()?;
    let mut scene = read_saying_remarks(path, &read_options(level))?;
    views.into_iter().for_each(|views| scene.set_world_views(views));
    check(&mut scene, path, repair)?;
    Ok(scene)
}

/// Fails if a scene that is drawn in levels of detail is to have another sky or other views.
pub(crate) fn refuse_for_levels(sky: OwnSkyArgs, views: Option<&PathBuf>) -> Result<()> {
    let given = first_given([(views.is_some(), "--views"), (sky.sky != OwnSky::Keep, "--sky")]);
    given.map_or(Ok(()), |option| {
        bail!(
            "{option}: cannot be used with a scene that is drawn in levels of detail; choose one with --level"
        )
    })
}

/// Treats the sky of a scene; returns a line for people, `None` where the sky is kept.
///
/// # Errors
/// Nothing is left of the scene.
pub(crate) fn change_sky(
    scene: &mut Scene,
    path: &Path,
    choice: OwnSky,
    facts: &Metadata,
) -> Result<Option<String>> {
    let change = choice.apply(scene, facts);
    if scene.splats.is_empty() {
        bail!("{}: --sky {} leaves nothing: all its splats are sky", path.display(), sky_word(choice));
    }
    let nothing = || (choice != OwnSky::Keep).then(|| "sky: nothing to change".into());
    Ok(change.line().or_else(nothing))
}

/// Returns an error with the number of splats that are not finite, or removes them if `repair` is
/// set.
pub(crate) fn check(scene: &mut Scene, path: &Path, repair: bool) -> Result<()> {
    let Err(found) = scene.check_finite() else { return Ok(()) };
    let what = format!("{}: {found}", path.display());
    if !repair {
        bail!("{what}; --repair leaves them out");
    }
    let (repaired, repairs) = std::mem::take(&mut scene.splats).repaired();
    scene.splats = repaired;
    if scene.splats.is_empty() {
        bail!("{what}; nothing is left without them");
    }
    eprintln!("warning: {what}; {} are left out", repairs.dropped);
    Ok(())
}

/// Writes a scene with its metadata and cameras; a scene behind a link is replaced where it lies.
/// The files beside a scene that is replaced are replaced too.
pub(crate) fn save(out: &Path, scene: &Scene, options: &WriteOptions) -> Result<()> {
    let target = if out.is_symlink() { out.canonicalize().ok() } else { None };
    let file = target.unwrap_or_else(|| out.to_path_buf());
    write_scene_with(&file, scene, options)?;
    if sidecar_path(&file).exists() {
        // It wins over the scene file, and is of the scene that was replaced; in both positions are
        // relative to the origin now.
        write_sidecar(&file, &scene.metadata)?;
    }
    if !scene.views.is_empty() {
        write_cameras(&cameras_path(&file), &scene.views)?;
    }
    Ok(())
}

fn parse_known_distance(text: &str) -> Result<f64> {
    let (a, b, metres) = parse_distance(text)?;
    Ok(known_distance(a, b, metres)?)
}

/// Reads two points and the metres between them, such as `0,0,0:1.5,0,2=12.5`.
pub(crate) fn parse_distance(text: &str) -> Result<(DVec3, DVec3, f64)> {
    let form =
        || format!("`{text}` is no known distance: write two points and metres, as in 0,0,0:1.5,0,2=12.5");
    let (points, metres) = text.rsplit_once('=').with_context(form)?;
    let (a, b) = points.split_once(':').with_context(form)?;
    let point = |text: &str| -> Result<DVec3> {
        let numbers: Vec<f64> =
            text.split(',').map(|v| v.trim().parse()).collect::<Result<_, _>>().ok().with_context(form)?;
        let numbers: [f64; 3] = numbers.try_into().ok().with_context(form)?;
        Ok(DVec3::from_array(numbers))
    };
    let metres: f64 = metres.trim().parse().ok().with_context(form)?;
    Ok((point(a)?, point(b)?, metres))
}

/// Returns a number of things in words, such as "1 outline" or "3 outlines".
pub(crate) fn count_of(count: usize, thing: &str) -> String {
    format!("{count} {thing}{}", if count == 1 { "" } else { "s" })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_distances_give_a_scale() {
        assert_eq!(parse_known_distance("0,0,0:0,0,-4 = 10").unwrap(), 2.5);
        for bad in ["", "1", "0,0,0:1,0,0", "0,0:1,0,0=2", "0,0,0:0,0,0=2", "0,0,0:1,0,0=-2"] {
            assert!(parse_known_distance(bad).is_err(), "{bad}");
        }
    }
}
