//! Work with what the readers accepted, at 64x48 px: frames, sweeps, assets, links, states of
//! pages, evaluations, and trainings that go on.

use crate::damage::Draws;
use crate::edges::weather_at_edges;
use crate::outcome::{Outcome, SeedPath, done, put};
use glam::DVec3;
use std::cell::Cell;
use std::fs;
use std::hash::{DefaultHasher, Hasher};
use std::ops::ControlFlow;
use std::path::Path;
use std::rc::Rc;
use tempfile::TempDir;
use weather_magician::camera_model::{CameraModel, SensorCamera};
use weather_magician::lidar::ScanOptions;
use weather_magician::view::{ViewOptions, path::CameraPath};
use weather_magician::{
    Camera, CameraMotion, FrameRequest, LensSpec, Metadata, MovingCamera, Patience, PlaceOptions,
    PreparedPlace, Renderer, Scene, Weather,
};
use wm_image::color::Dither;
use wm_scene::formats::{ReadOptions, read_scene, write_scene};
use wm_scene::synthetic::Builder;
use wm_sensors::LidarModel;
use wm_street::Street;
use wm_street::dataset::{self, DatasetOptions, GroundTruth};
use wm_train::evaluation::{EvaluationOptions, ExposureFit, TruthMaps, TruthOptions, evaluate};
use wm_train::photos::Check;
use wm_train::session::{Resume, Session, SessionError, StepProgress, TrainObserver};
use wm_train::{Dataset, DatasetReadOptions};
use wm_viewer::catalog::Catalog;
use wm_viewer::paint::PaintOptions;
use wm_viewer::{View, ViewPainter, ViewState, link};

const SIZE: (u32, u32) = (64, 48);
/// Runs on one place, and with one folder of assets: what is kept for old weathers must not count
/// against new ones.
const RUNS_ON_A_PLACE: u32 = 256;
const RUNS_ON_A_FOLDER: u32 = 2048;
/// Weathers that a damaged scene is drawn in.
const WEATHERS: [&str; 6] = ["heavy-rain", "snow", "fog", "night-rain", "flood", "after-rain"];

thread_local! {
    static STAGE: Cell<Option<Stage>> = const { Cell::new(None) };
    static PREPARING_S: Cell<f64> = const { Cell::new(0.0) };
}

/// Returns the processor time, s, that this thread's runs have spent on making assets since the
/// last call. They are made once for a scene and a weather, and have a budget of their own.
pub fn take_preparing_seconds() -> f64 {
    PREPARING_S.take()
}

/// A renderer with a small place: paving, a wall, a roof and a sky.
struct Stage {
    renderer: Renderer,
    place: PreparedPlace,
    assets: Rc<TempDir>,
    runs: u32,
}

impl Stage {
    /// Loads the place, with the assets that another one has left.
    fn new(old: Option<Self>) -> Result<Self, String> {
        let runs = old.as_ref().map_or(0, |old| old.runs);
        let kept = old.filter(|old| old.runs < RUNS_ON_A_FOLDER).map(|old| old.assets);
        let (assets, runs) = match kept {
            Some(assets) => (assets, runs),
            None => (Rc::new(crate::fast_temporary_folder().map_err(text)?), 0),
        };
        let mut renderer = Renderer::cpu().map_err(text)?;
        let options = PlaceOptions { assets: Some(assets.path().into()), ..PlaceOptions::default() };
        let place = renderer.load_with(court(), &options).map_err(text)?;
        Ok(Self { renderer, place, assets, runs })
    }

    /// Makes what a weather needs of the place, and counts the time.
    fn prepare(&mut self, weather: &Weather) -> Outcome {
        let before = crate::processor_seconds();
        let prepared = self.renderer.prepare(&mut self.place, weather, &mut ()).map_err(text);
        PREPARING_S.set(PREPARING_S.get() + crate::processor_seconds() - before);
        prepared
    }

    fn render(&mut self, weather: &Weather, time: f64, camera: MovingCamera) -> Outcome {
        self.prepare(weather)?;
        done(self.renderer.render(&mut self.place, &FrameRequest::new(weather, camera, time)))
    }
}

/// Works on the place of this thread; a panic drops it.
fn on_stage(work: impl FnOnce(&mut Stage) -> Outcome) -> Outcome {
    let mut stage = match STAGE.take() {
        Some(stage) if !stage.runs.is_multiple_of(RUNS_ON_A_PLACE) => stage,
        old => Stage::new(old)?,
    };
    stage.runs += 1;
    let outcome = work(&mut stage);
    STAGE.set(Some(stage));
    outcome
}

fn text(error: impl std::fmt::Display) -> String {
    error.to_string()
}

fn court() -> Scene {
    let mut place = Builder::new(5);
    place.surface(DVec3::new(-4.0, -4.0, 0.0), DVec3::X * 8.0, DVec3::Y * 8.0, 0.4, |_, _| [0.5; 3]);
    place.block(DVec3::new(0.0, 2.0, 0.0), DVec3::new(3.0, 0.5, 2.0), 0.4, [0.7, 0.6, 0.5]);
    place.sky(DVec3::ZERO, 60.0, 100);
    let metadata =
        Metadata { up: Some(DVec3::Z), ground: Some(0.0), metres_per_unit: Some(1.0), ..Metadata::default() };
    Scene { splats: place.build(), metadata, ..Scene::default() }
}

fn usual_camera() -> Result<Camera, String> {
    Camera::looking(SIZE, 50.0, DVec3::new(0.0, -3.0, 1.6), DVec3::new(0.0, 1.0, 1.0), DVec3::Z).map_err(text)
}

/// Random choices that depend on the bytes of a file, which differ from run to run.
fn draws_of(path: &Path) -> Result<Draws, String> {
    let mut hasher = DefaultHasher::new();
    hasher.write(&fs::read(path).map_err(text)?);
    Ok(Draws::new(hasher.finish()))
}

/// Draws a damaged scene in one of [`WEATHERS`], as `render --repair` does, from a camera that
/// suits it.
pub fn render_scene(path: &Path) -> Outcome {
    let mut draws = draws_of(path)?;
    let scene = read_scene(path, &ReadOptions::default()).map_err(text)?;
    let (scene, _) = scene.repaired();
    let mut renderer = Renderer::cpu().map_err(text)?;
    let mut place = renderer.load_with(scene, &PlaceOptions::default()).map_err(text)?;
    let survey = place.survey();
    let eye = survey.center - survey.up.value * 0.1 * survey.radius;
    let target = survey.center + survey.up.value.any_orthonormal_vector() * survey.radius.max(1e-3);
    let camera = Camera::looking(SIZE, 60.0, eye, target, survey.up.value).map_err(text)?;
    let weather = Weather::preset(draws.pick(&WEATHERS)).map_err(text)?;
    let picture = done(renderer.render(&mut place, &FrameRequest::new(&weather, camera, 2.0)));
    renderer.unload(place).map_err(text)?;
    picture
}

/// The weathers whose assets are damaged: with everything that is prepared.
const ASSET_WEATHERS: [&str; 3] = ["snow-covered", "night-rain", "golden-hour"];

/// Writes the prepared assets of the place into a folder.
pub fn assets_seed(folder: &Path) -> SeedPath {
    for weather in ASSET_WEATHERS {
        render_with_assets(folder, weather)?;
    }
    Ok(folder.to_path_buf())
}

fn render_with_assets(folder: &Path, weather: &str) -> Outcome {
    let mut renderer = Renderer::cpu().map_err(text)?;
    let options = PlaceOptions { assets: Some(folder.to_path_buf()), ..PlaceOptions::default() };
    let mut place = renderer.load_with(court(), &options).map_err(text)?;
    let weather = Weather::preset(weather).map_err(text)?;
    done(renderer.render(&mut place, &FrameRequest::new(&weather, usual_camera()?, 60.0)))
}

/// Draws the place with damaged assets whose checksums are right, as a stranger can write them.
pub fn render_assets(folder: &Path) -> Outcome {
    const ASSET_HEADER_BYTES: usize = 44;
    let mut weather = 0;
    for entry in fs::read_dir(folder).map_err(text)? {
        let file = entry.map_err(text)?.path();
        let mut bytes = fs::read(&file).map_err(text)?;
        if bytes.len() > ASSET_HEADER_BYTES {
            let checksum = crc32fast::hash(&bytes[ASSET_HEADER_BYTES..]);
            bytes[ASSET_HEADER_BYTES - 4..ASSET_HEADER_BYTES].copy_from_slice(&checksum.to_le_bytes());
            fs::write(&file, bytes).map_err(text)?;
            weather ^= checksum as usize;
        }
    }
    render_with_assets(folder, ASSET_WEATHERS[weather % ASSET_WEATHERS.len()])
}

/// Draws the place in a damaged weather.
pub fn render_weather(path: &Path) -> Outcome {
    let weather = Weather::read(path).map_err(text)?;
    let time = draws_of(path)?.pick(&[0.0, 0.04, 12.5, 300.0, 1e5]);
    let camera = usual_camera()?;
    on_stage(|stage| stage.render(&weather, time, camera.into()))
}

/// Draws the place in rain along a damaged path.
pub fn render_path(path: &Path) -> Outcome {
    let weather = Weather::preset("heavy-rain").map_err(text)?;
    let time = draws_of(path)?.pick(&[0.0, 1.0, 2.5, 1e4]);
    on_stage(|stage| {
        let survey = stage.place.survey();
        let size = Some(SIZE);
        let path =
            CameraPath::read(path, survey, &ViewOptions { size, ..ViewOptions::default() }).map_err(text)?;
        let moving = CameraMotion::Along { path, size: SIZE }.at(time, stage.place.site().metres_per_unit);
        stage.render(&weather, time, moving)
    })
}

/// Draws the place in fog through a damaged lens.
pub fn render_lens(path: &Path) -> Outcome {
    let weather = Weather::preset("heavy-rain").map_err(text)?;
    let camera = usual_camera()?;
    let lens = LensSpec::File(path.into()).view(Some(SIZE)).map_err(text)?;
    on_stage(|stage| {
        stage.prepare(&weather)?;
        let model = CameraModel { lens: Some(lens), ..CameraModel::default() };
        let device = SensorCamera::new(model, camera.into());
        let request = FrameRequest::new(&weather, &device, 0.0);
        done(stage.renderer.render(&mut stage.place, &request))
    })
}

/// Scans the place in rain with a damaged lidar.
pub fn scan(path: &Path) -> Outcome {
    let lidar = LidarModel::parse(&fs::read_to_string(path).map_err(text)?, "lidar").map_err(text)?;
    if lidar.pattern.beams(0).len() > 100_000 {
        return Err("too many pulses for a test".into());
    }
    let weather = Weather::preset("heavy-rain").map_err(text)?;
    let motion = CameraMotion::Still { camera: Box::new(usual_camera()?), speed: 3.0 };
    on_stage(|stage| {
        stage.prepare(&weather)?;
        let Stage { renderer, place, .. } = stage;
        let mut taken = |_| Ok(());
        let options = ScanOptions::default();
        done(renderer.scan(place, &weather, &lidar, &motion, &options, 1, &mut taken, &mut ()))
    })
}

/// Draws the place with numbers from the edges of their ranges: three parameters of effects, the
/// camera, its speed and the time. `WM_SHOW_RUN=1` with `--child` prints them.
pub fn render_edges(path: &Path) -> Outcome {
    let mut draws = draws_of(path)?;
    let weather = weather_at_edges(&mut draws)?;
    let far = draws.pick(&[1e-3, 1.0, 3.0, 1e3, 1e6, 1e10]);
    let fov = draws.pick(&[0.1, 1.0, 50.0, 120.0, 170.0]);
    let (eye, target) = (DVec3::new(0.0, -3.0, 1.6) * far, DVec3::new(0.0, 1.0, 1.0));
    let camera = Camera::looking(SIZE, fov, eye, target, DVec3::Z).map_err(text)?;
    let speed = draws.pick(&[0.0, 3.0, 50.0, 1000.0, 1e6]);
    let moving = MovingCamera { camera, velocity: (camera.forward() * speed).to_array() };
    let time = draws.pick(&[0.0, -5.0, 0.02, 7.3, 3600.0, 1e9, 1e300]);
    if std::env::var_os("WM_SHOW_RUN").is_some() {
        eprintln!("{}{far} units away, fov {fov}, {speed} m/s, at {time} s", weather.to_toml());
    }
    on_stage(|stage| stage.render(&weather, time, moving))
}

/// The catalog of a viewer that shows the place.
fn catalog(place: &PreparedPlace) -> Catalog {
    Catalog { survey: place.survey().clone(), ..wm_viewer::testing::catalog() }
}

/// States of pages: a still camera in rain, a path by night, a lidar in snow.
pub const STATES: [&str; 3] = [
    include_str!("seeds/state.json"),
    include_str!("seeds/state_path.json"),
    include_str!("seeds/state_lidar.json"),
];

fn state(patch: &str, place: &PreparedPlace) -> Result<ViewState, String> {
    let patch = serde_json::from_str(patch).map_err(text)?;
    catalog(place).initial_state(&usual_camera()?).patched(patch)
}

/// Writes a link to one of [`STATES`].
pub fn link_seed<const NUMBER: usize>(folder: &Path) -> SeedPath {
    let stage = Stage::new(None)?;
    put(folder, "link.txt", link::encode(&state(STATES[NUMBER], &stage.place)?)?)
}

/// Opens a damaged link, as the viewer and an exported page do, and draws its view.
pub fn open_link(path: &Path) -> Outcome {
    let fragment = fs::read_to_string(path).map_err(text)?;
    on_stage(|stage| {
        let catalog = catalog(&stage.place);
        let base = catalog.initial_state(&usual_camera()?);
        show(stage, &link::open(&fragment, &catalog, &base)?)
    })
}

/// Draws a damaged state of a page, and the view of a link to it, which is the same state.
pub fn open_state(path: &Path) -> Outcome {
    let patch = fs::read_to_string(path).map_err(text)?;
    on_stage(|stage| {
        let catalog = catalog(&stage.place);
        let view = View::new(state(&patch, &stage.place)?, &catalog, None)?;
        if let Ok(fragment) = link::encode(&view.state) {
            let opened = link::open(&fragment, &catalog, &view.state)?;
            assert!(opened.state == view.state, "the link opens another state");
        }
        show(stage, &view)
    })
}

/// Draws a view as a page shows it, and makes the sweep of its lidar.
fn show(stage: &mut Stage, view: &View) -> Outcome {
    stage.prepare(&view.weather)?;
    let Stage { renderer, place, .. } = stage;
    if let (Some(lidar), Some(motion)) = (&view.lidar, view.sensor_motion()) {
        let options = lidar.options(view.state.time);
        renderer.scan_once(place, &view.weather, &lidar.model, &motion, &options).map_err(text)?;
    }
    let options = PaintOptions { size: SIZE, patience: Patience::Whole, dither: Dither::Ordered };
    let mut painter = ViewPainter::default();
    done(wm_render::at_once(painter.draw(renderer, place, view, None, options)))
}

/// Photos of the street with true depth and a scene of it, as `evaluate` compares them.
pub fn evaluation_seed(folder: &Path) -> SeedPath {
    photos(&folder.join("set"), GroundTruth::Write)?;
    write_scene(&folder.join("scene.ply"), &court())?;
    Ok(folder.to_path_buf())
}

fn photos(folder: &Path, truth: GroundTruth) -> Outcome {
    let options = DatasetOptions { size: SIZE, truth, ..DatasetOptions::TINY };
    done(dataset::write(&Street::builtin(), folder, &options, &mut |_| true))
}

/// Compares a scene with photos and maps, one of which is damaged.
pub fn evaluate_scene(folder: &Path) -> Outcome {
    let scene = read_scene(&folder.join("scene.ply"), &ReadOptions::default()).map_err(text)?;
    let (scene, _) = scene.repaired();
    let mut renderer = Renderer::cpu().map_err(text)?;
    let place = renderer.load_with(scene, &PlaceOptions::default()).map_err(text)?;
    let (set, read) = (folder.join("set"), DatasetReadOptions::default());
    let capture = read.capture(&set).map_err(text)?;
    let photos = read.photos(&set, &capture, Check::default()).map_err(text)?;
    let data = Dataset { places: (0..photos.len()).collect(), capture, photos };
    let maps = TruthOptions {
        depth: Some(set.join("truth/depth")),
        normal: Some(set.join("truth/normal")),
        sky: Some(set.join("truth/sky")),
        ..TruthOptions::default()
    };
    let (truth, _) = TruthMaps::open(&maps, &data, place.survey()).map_err(text)?;
    let options = EvaluationOptions { exposure_fit: ExposureFit::Affine, ..EvaluationOptions::default() };
    let set = place.set();
    done(evaluate(renderer.backend_mut(), set, place.scene(), &data, &truth, &options, &mut ()))
}

/// Steps of the training that is gone on with.
const STEPS: u32 = 24;

/// Photos and the folder of a training that was stopped half-way.
pub fn training_seed(folder: &Path) -> SeedPath {
    photos(&folder.join("set"), GroundTruth::Omit)?;
    let mut halves = HalfTheSteps(0);
    match train(folder, &folder.join("run"), Resume::Never).run(&mut halves) {
        Err(SessionError::Stopped { .. }) => Ok(folder.to_path_buf()),
        other => Err(format!("the training did not stop: {:?}", other.map(drop)).into()),
    }
}

fn train(folder: &Path, run: &Path, resume: Resume) -> Session {
    let mut session =
        Session::new(folder.join("set")).steps(STEPS).max_splats(300).hold_out(6).run_folder(run);
    if resume == Resume::Always {
        session = session.resume();
    }
    session.metres_per_unit(1.0)
}

struct HalfTheSteps(u32);

impl TrainObserver for HalfTheSteps {
    fn proceed(&mut self) -> ControlFlow<()> {
        if self.0 < STEPS / 2 { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
    }

    fn on_step(&mut self, progress: &StepProgress) {
        self.0 = progress.step;
    }
}

/// Goes on with a training, of which the photos or the folder are damaged, to its end. Checkpoints
/// have right checksums, as a stranger can write them.
pub fn resume_training(folder: &Path) -> Outcome {
    // The folder of the training changes, and is needed again.
    let work = crate::fast_temporary_folder().map_err(text)?;
    for entry in fs::read_dir(folder.join("run")).map_err(text)? {
        let file = entry.map_err(text)?.path();
        if file.is_dir() {
            continue;
        }
        let name = file.file_name().unwrap_or_default();
        let mut bytes = fs::read(&file).map_err(text)?;
        if let (Some("wmtrain"), Some(end)) =
            (file.extension().and_then(|ending| ending.to_str()), bytes.len().checked_sub(8))
        {
            let sum = fnv1a(&bytes[..end]);
            bytes[end..].copy_from_slice(&sum.to_le_bytes());
        }
        fs::write(work.path().join(name), bytes).map_err(text)?;
    }
    done(train(folder, work.path(), Resume::Always).run(&mut ()))
}

/// The checksum of checkpoints.
fn fnv1a(bytes: &[u8]) -> u64 {
    bytes
        .iter()
        .fold(0xcbf2_9ce4_8422_2325, |sum, byte| (sum ^ u64::from(*byte)).wrapping_mul(0x100_0000_01b3))
}

/// Writes a file whose only use is that its damage differs from run to run.
pub fn edges_seed(folder: &Path) -> SeedPath {
    put(folder, "edges.txt", "0 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16 17 18 19 20")
}
