//! A device with a place on it: pictures as arrays, sweeps, videos, bakes and measurements.

mod inputs;

use crate::arrays::{intrinsics, matrices, matrix, moved, numbers, shape_fault};
use crate::camera::PyCamera;
use crate::error::{Error, Failure, Outcome, line_of, value_of};
use crate::picture::{PictureOutputs, PyPicture};
use crate::process::{CallbackProgress, PerProcess, StopFlag, detached, device_of, pool_of};
use crate::scene::PyScene;
use crate::weather::PyWeather;
use glam::{DAffine3, DMat4};
use inputs::{CameraInput, finite, times_of, view_options};
use pyo3::exceptions::{PyTypeError, PyUserWarning, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList, PyTuple};
use rayon::ThreadPool;
use std::ffi::CString;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use weather_magician::assets::AssetCache;
use weather_magician::levels::{LevelBudget, parse_memory};
use weather_magician::lidar::{LidarModel, PointFrame, ReturnMode, ScanOptions, SubRays};
use weather_magician::measure::{INSTRUMENTS, InstrumentRenderer, MeasureRequest, PlaceRenderer};
use weather_magician::video::{FrameRate, VideoSettings};
use weather_magician::view::{ViewOptions, spec};
use weather_magician::{
    CameraMotion, CpuConfig, FrameRequest, MotionSpec, MovingCamera, PictureSize, PlaceOptions,
    PreparedPlace, Progress, VideoFile, picture_tags,
};
use wm_scene::SceneView;

#[doc = docs!("Renderer")]
#[pyclass(frozen, name = "Renderer", module = "weather_magician")]
pub(crate) struct PyRenderer {
    source: PlaceSource,
    device: String,
    threads: Option<usize>,
    assets: Option<PathBuf>,
    open: PerProcess<OpenPlace>,
    /// Warnings that were not given to Python yet.
    warnings: Mutex<Vec<String>>,
}

/// The scene of a renderer.
#[derive(Clone)]
enum PlaceSource {
    Scene(Box<PyScene>),
    /// A file in levels of detail that is drawn under a budget.
    Levels {
        path: PathBuf,
        budget: LevelBudget,
        /// The memory as it was asked for.
        memory: Option<String>,
    },
}

impl PlaceSource {
    /// Reads a scene, unless it is in levels and does not fit the budget.
    fn open(path: PathBuf, budget: LevelBudget, memory: Option<&str>) -> Outcome<Self> {
        match budget.levels_of(&path)? {
            Some(_) => Ok(Self::Levels { path, budget, memory: memory.map(str::to_owned) }),
            None => Ok(Self::Scene(Box::new(PyScene::read(&path, false, None)?))),
        }
    }

    /// The file.
    fn path(&self) -> Option<&Path> {
        match self {
            Self::Scene(scene) => scene.origin.as_ref().map(|origin| origin.path.as_path()),
            Self::Levels { path, .. } => Some(path),
        }
    }

    /// The name in messages and in the words of pictures.
    fn name(&self) -> String {
        self.path().map_or_else(String::new, |path| path.display().to_string())
    }
}

/// A renderer and a place in it.
struct OpenPlace {
    renderer: weather_magician::Renderer,
    place: PreparedPlace,
    /// Memory of a frame.
    picture: weather_magician::Picture,
    /// Threads of what is not the renderer's own work.
    pool: Arc<ThreadPool>,
}

impl PyRenderer {
    /// Does `work` with the place of this process, without the interpreter.
    fn with<R: Send>(
        &self,
        py: Python<'_>,
        work: impl FnOnce(&mut OpenPlace, &StopFlag) -> Outcome<R> + Send,
    ) -> PyResult<R> {
        let result = detached(py, |stop| {
            let make = || self.load();
            self.open.with(make, |open| {
                let result = Arc::clone(&open.pool).install(|| work(open, stop));
                self.keep(open.place.take_warnings());
                result
            })
        });
        self.warn(py)?;
        result
    }

    fn load(&self) -> Outcome<OpenPlace> {
        let cpu = CpuConfig { threads: self.threads, ..CpuConfig::default() };
        let device = device_of(&self.device)?;
        let pool = pool_of(self.threads)?;
        let (renderer, place) = pool.install(|| -> Outcome<_> {
            let mut renderer = weather_magician::Renderer::new(&device, cpu, |_| {})?;
            let options = PlaceOptions { assets: self.assets.clone(), ..PlaceOptions::default() };
            let mut place = match &self.source {
                PlaceSource::Scene(scene) => renderer.load_with((*scene.scene).clone(), &options)?,
                PlaceSource::Levels { path, budget, .. } => renderer.open(path, &options, budget)?,
            };
            self.keep(place.take_warnings());
            Ok((renderer, place))
        })?;
        Ok(OpenPlace { renderer, place, picture: weather_magician::Picture::default(), pool })
    }

    fn keep(&self, warnings: Vec<impl ToString>) {
        if let Ok(mut kept) = self.warnings.lock() {
            kept.extend(warnings.iter().map(ToString::to_string));
        }
    }

    fn warn(&self, py: Python<'_>) -> PyResult<()> {
        let pending = self.warnings.lock().map(|mut kept| std::mem::take(&mut *kept)).unwrap_or_default();
        for text in pending {
            let text = CString::new(text.replace('\0', "")).unwrap_or_default();
            PyErr::warn(py, &py.get_type::<PyUserWarning>(), &text, 1)?;
        }
        Ok(())
    }
}

impl OpenPlace {
    /// The camera of what Python gave.
    fn camera(&mut self, given: &CameraInput, options: &ViewOptions) -> Outcome<wm_scene::Camera> {
        let Self { renderer, place, .. } = self;
        let spec = match given {
            CameraInput::Camera(camera) => {
                let view = SceneView { name: String::new(), camera: *camera };
                let options = ViewOptions { near: Some(camera.near), ..*options };
                return Ok(spec::of_view(&view, place.survey(), &options)?);
            }
            CameraInput::Spec(spec) => Some(spec.parse()?),
            CameraInput::Chosen => None,
        };
        let spec = MotionSpec { camera: spec, ..MotionSpec::default() };
        Ok(spec.start(renderer, place, options, &mut |_| {})?)
    }
}

#[pymethods]
impl PyRenderer {
    #[new]
    #[pyo3(signature = (scene, *, device="auto", threads=None, assets=None, memory=None, splats=None))]
    fn new(
        py: Python<'_>,
        scene: &Bound<'_, PyAny>,
        device: &str,
        threads: Option<usize>,
        assets: Option<&Bound<'_, PyAny>>,
        memory: Option<&str>,
        splats: Option<u64>,
    ) -> PyResult<Self> {
        let wrong = |says: String| PyValueError::new_err(format!("memory: {says}"));
        let default = LevelBudget::default().memory;
        let bytes = memory.map_or(Ok(default), |text| parse_memory(text).map_err(wrong))?;
        if splats == Some(0) {
            return Err(PyValueError::new_err("splats 0: must be 1 or more"));
        }
        let budget = LevelBudget { memory: bytes, splats };
        let source = match (scene.cast::<PyScene>(), scene.extract::<PathBuf>()) {
            (Ok(_), _) if memory.is_some() || splats.is_some() => {
                let says = "memory and splats: this scene was read as a whole; give its path";
                return Err(PyValueError::new_err(says));
            }
            (Ok(scene), _) => PlaceSource::Scene(Box::new(scene.get().clone())),
            (_, Ok(path)) => detached(py, |_| PlaceSource::open(path, budget, memory))?,
            _ => return Err(PyTypeError::new_err("scene: must be a Scene or the path of one")),
        };
        let beside = || source.path().map(AssetCache::folder_of);
        let assets = match assets {
            None => beside(),
            Some(assets) => match (assets.extract::<bool>(), assets.extract::<PathBuf>()) {
                (Ok(false), _) => None,
                (Ok(true), _) => beside(),
                (_, Ok(folder)) => Some(folder),
                _ => return Err(PyTypeError::new_err("assets: must be a folder, or False for none")),
            },
        };
        let made = Self {
            source,
            device: device.to_owned(),
            threads,
            assets,
            open: PerProcess::new(),
            warnings: Mutex::default(),
        };
        made.with(py, |_, _| Ok(()))?;
        Ok(made)
    }

    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        Ok(format!("Renderer({:?}, {})", self.source.name(), self.describe(py)?))
    }

    fn __getnewargs_ex__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyTuple>, Bound<'py, PyDict>)> {
        let options = PyDict::new(py);
        options.set_item("device", &self.device)?;
        options.set_item("threads", self.threads)?;
        match &self.assets {
            Some(folder) => options.set_item("assets", folder)?,
            None => options.set_item("assets", false)?,
        }
        let source = match &self.source {
            PlaceSource::Scene(scene) => PyScene::clone(scene).into_pyobject(py)?.into_any(),
            PlaceSource::Levels { path, budget, memory } => {
                options.set_item("memory", memory)?;
                options.set_item("splats", budget.splats)?;
                path.into_pyobject(py)?.into_any()
            }
        };
        Ok(((source,).into_pyobject(py)?, options))
    }

    #[doc = docs!("Renderer.scene")]
    #[getter]
    fn scene(&self) -> Option<PyScene> {
        match &self.source {
            PlaceSource::Scene(scene) => Some(PyScene::clone(scene)),
            PlaceSource::Levels { .. } => None,
        }
    }

    #[doc = docs!("Renderer.describe")]
    fn describe(&self, py: Python<'_>) -> PyResult<String> {
        self.with(py, |open, _| Ok(open.renderer.describe()))
    }

    #[doc = docs!("Renderer.metres_per_unit")]
    #[getter]
    fn metres_per_unit(&self, py: Python<'_>) -> PyResult<f64> {
        self.with(py, |open, _| Ok(open.place.site().metres_per_unit))
    }

    #[doc = docs!("Renderer.up")]
    #[getter]
    fn up(&self, py: Python<'_>) -> PyResult<(f64, f64, f64)> {
        self.with(py, |open, _| Ok(open.place.site().up.into()))
    }

    #[doc = docs!("Renderer.ground")]
    #[getter]
    fn ground(&self, py: Python<'_>) -> PyResult<f64> {
        self.with(py, |open, _| Ok(open.place.site().ground))
    }

    #[doc = docs!("Renderer.camera")]
    #[pyo3(signature = (camera=None, *, size=None, fov=None))]
    fn camera(
        &self,
        py: Python<'_>,
        camera: Option<&Bound<'_, PyAny>>,
        size: Option<(u32, u32)>,
        fov: Option<f64>,
    ) -> PyResult<PyCamera> {
        let (given, options) = (CameraInput::of(camera)?, view_options(size, fov)?);
        self.with(py, |open, _| Ok(PyCamera { camera: open.camera(&given, &options)? }))
    }

    #[doc = docs!("Renderer.render")]
    #[pyo3(signature = (weather, viewmats, Ks, width, height, *, time=None, outputs=None, near=None, velocities=None, progress=None))]
    #[allow(non_snake_case, clippy::too_many_arguments)] // As gsplat has it.
    fn render<'py>(
        &self,
        py: Python<'py>,
        weather: &Bound<'py, PyAny>,
        viewmats: &Bound<'py, PyAny>,
        Ks: &Bound<'py, PyAny>,
        width: u32,
        height: u32,
        time: Option<&Bound<'py, PyAny>>,
        outputs: Option<Vec<String>>,
        near: Option<f64>,
        velocities: Option<&Bound<'py, PyAny>>,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let weather = PyWeather::given(Some(weather))?;
        let (viewmats, ks) = (matrices(viewmats, "viewmats")?, intrinsics(Ks, "Ks")?);
        let count = viewmats.len();
        if ks.len() != count {
            return Err(PyValueError::new_err(format!("Ks: there are {} for {count} viewmats", ks.len())));
        }
        let times = times_of(time, count)?;
        let wanted = PictureOutputs::of(&outputs.unwrap_or_else(|| vec!["rgb".into()]))?;
        let velocities = match velocities {
            None => vec![[0.0; 3]; count],
            Some(velocities) => {
                let (values, shape) = numbers::<f64>(velocities, "velocities")?;
                if shape != [count, 3] {
                    return Err(shape_fault("velocities", &format!("[{count}, 3]"), &shape));
                }
                values.as_chunks().0.to_vec()
            }
        };
        let made = self.with(py, |open, stop| {
            let near = near.unwrap_or_else(|| ViewOptions::default().near(open.place.survey()));
            let mut reporter = CallbackProgress::new(stop, progress.as_ref());
            let mut stack = wanted.stack(count, width, height)?;
            for index in 0..count {
                reporter.reached("frames", index as u64, count as u64);
                if reporter.is_stopped() {
                    return reporter.outcome(Err(Failure::Stopped));
                }
                let [fx, fy, cx, cy] = ks[index];
                let camera =
                    wm_scene::Camera { width, height, fx, fy, cx, cy, viewmat: viewmats[index], near };
                camera.check()?;
                let moving = MovingCamera { camera, velocity: velocities[index] };
                let request = FrameRequest::new(&weather, moving, times[index]);
                open.draw(&FrameRequest { layers: wanted.request(), ..request }, &mut reporter)?;
                stack.add(&open.picture);
            }
            reporter.reached("frames", count as u64, count as u64);
            reporter.outcome(Ok::<_, Failure>(stack))
        })?;
        made.into_dict(py)
    }

    #[doc = docs!("Renderer.picture")]
    #[pyo3(signature = (weather=None, camera=None, *, size=None, fov=None, time=0.0, outputs=None, speed=0.0))]
    #[allow(clippy::too_many_arguments)] // As many as Python's.
    fn picture(
        &self,
        py: Python<'_>,
        weather: Option<&Bound<'_, PyAny>>,
        camera: Option<&Bound<'_, PyAny>>,
        size: Option<(u32, u32)>,
        fov: Option<f64>,
        time: f64,
        outputs: Option<Vec<String>>,
        speed: f64,
    ) -> PyResult<PyPicture> {
        let weather = PyWeather::given(weather)?;
        let (given, options) = (CameraInput::of(camera)?, view_options(size, fov)?);
        let (time, speed) = (finite("time", time)?, finite("speed", speed)?);
        let wanted = PictureOutputs::of(&outputs.unwrap_or_default())?;
        let name = self.source.name();
        self.with(py, |open, stop| {
            let camera = open.camera(&given, &options)?;
            let moving = CameraMotion::Still { camera: Box::new(camera), speed };
            let moving = moving.at(time, open.place.site().metres_per_unit);
            let mut reporter = CallbackProgress::new(stop, None);
            // As the program's pictures: the best cut for it alone.
            open.place.set_shot(&[camera]);
            let request =
                FrameRequest { layers: wanted.request(), ..FrameRequest::new(&weather, moving, time) };
            let drawn = open.draw(&request, &mut reporter);
            open.place.set_shot(&[]);
            drawn?;
            let mut picture = std::mem::take(&mut open.picture);
            let site = open.place.site();
            picture.tags = picture_tags(&name, site, open.renderer.backend(), &weather, time, &camera);
            Ok(PyPicture { picture, outputs: wanted, camera })
        })
    }

    #[doc = docs!("Renderer.video")]
    #[pyo3(signature = (path, weather=None, camera=None, *, r#move=None, seconds=5.0, fps=30.0, size=None, fov=None, speed=None, distance=None, progress=None))]
    #[allow(clippy::too_many_arguments)] // As many as Python's.
    fn video(
        &self,
        py: Python<'_>,
        path: PathBuf,
        weather: Option<&Bound<'_, PyAny>>,
        camera: Option<&Bound<'_, PyAny>>,
        r#move: Option<String>,
        seconds: f64,
        fps: f64,
        size: Option<(u32, u32)>,
        fov: Option<f64>,
        speed: Option<f64>,
        distance: Option<f64>,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<()> {
        let weather = PyWeather::given(weather)?;
        let (given, options) = (CameraInput::of(camera)?, view_options(size, fov)?);
        if !(seconds > 0.0 && seconds.is_finite()) {
            return Err(PyValueError::new_err(format!("seconds {seconds}: must be above 0")));
        }
        let wrong = |error: wm_image::MediaError| PyValueError::new_err(format!("fps {fps}: {error}"));
        let rate: FrameRate = fps.to_string().parse().map_err(wrong)?;
        let name = self.source.name();
        self.with(py, |open, stop| {
            let mut reporter = CallbackProgress::new(stop, progress.as_ref());
            let mut options = options;
            let start = match &given {
                CameraInput::Camera(_) => {
                    let camera = open.camera(&given, &options)?;
                    let (size, fov) = ((camera.width, camera.height), camera.fov_y());
                    // Its path has its lens and its size.
                    options =
                        ViewOptions { size: Some(size), fov: Some(fov), near: Some(camera.near), ..options };
                    Some(camera)
                }
                _ => None,
            };
            let motion = match (&r#move, start) {
                (None, Some(camera)) => {
                    CameraMotion::Still { camera: Box::new(camera), speed: speed.unwrap_or(0.0) }
                }
                (path, start) => {
                    let camera = match (&given, start) {
                        (_, Some(camera)) => {
                            Some(spec::text_of(&camera, open.place.survey().origin).parse()?)
                        }
                        (CameraInput::Spec(spec), None) => Some(spec.parse()?),
                        _ => None,
                    };
                    let path = path.as_ref().map(|path| path.parse()).transpose()?;
                    let spec = MotionSpec { camera, path, distance, speed, seconds };
                    let OpenPlace { renderer, place, .. } = open;
                    spec.motion(renderer, place, &options, &mut |_| {})?
                }
            };
            let first = motion.camera(0.0);
            let mut settings = VideoSettings::new(PictureSize::new(first.width, first.height), rate);
            let OpenPlace { renderer, place, .. } = open;
            settings.tags = picture_tags(&name, place.site(), renderer.backend(), &weather, 0.0, &first);
            let video = VideoFile { path: path.as_ref(), seconds, settings };
            let made = renderer.render_video(place, &weather, &motion, video, &mut reporter);
            reporter.outcome(made).map(drop)
        })
    }

    #[doc = docs!("Renderer.scan")]
    #[pyo3(signature = (weather=None, lidar="os1-64", camera=None, *, time=0.0, speed=0.0, returns="strongest", rays=7, frame="compensated", seed=0, sweep=0))]
    #[allow(clippy::too_many_arguments)] // As many as Python's.
    fn scan<'py>(
        &self,
        py: Python<'py>,
        weather: Option<&Bound<'py, PyAny>>,
        lidar: &str,
        camera: Option<&Bound<'py, PyAny>>,
        time: f64,
        speed: f64,
        returns: &str,
        rays: u8,
        frame: &str,
        seed: u64,
        sweep: u32,
    ) -> PyResult<Bound<'py, PyDict>> {
        let weather = PyWeather::given(weather)?;
        let given = CameraInput::of(camera)?;
        let (time, speed) = (finite("time", time)?, finite("speed", speed)?);
        let frames = [
            ("compensated", PointFrame::Compensated),
            ("raw", PointFrame::Raw),
            ("world", PointFrame::World),
        ];
        let options = ScanOptions {
            time,
            index: sweep,
            seed,
            sub_rays: SubRays::of_count(rays.into())
                .ok_or_else(|| PyValueError::new_err(format!("rays \"{rays}\": must be 1 or 7")))?,
            returns: value_of("returns", returns, &ReturnMode::ALL.map(|(mode, name)| (name, mode)))?,
            frame: value_of("frame", frame, &frames)?,
            ..ScanOptions::default()
        };
        let made = self.with(py, |open, _| {
            let model = LidarModel::find(lidar)?;
            let camera = Box::new(open.camera(&given, &ViewOptions::default())?);
            let motion = CameraMotion::Still { camera, speed };
            let OpenPlace { renderer, place, .. } = open;
            Ok(renderer.scan_once(place, &weather, &model, &motion, &options)?)
        })?;
        let (count, points) = (made.points.len(), &made.points);
        let dict = PyDict::new(py);
        let flat: Vec<f32> = points.iter().flat_map(|point| point.position).collect();
        dict.set_item("position", moved(py, flat, &[count, 3])?)?;
        let floats = |of: &dyn Fn(&weather_magician::lidar::LidarPoint) -> f32| {
            moved(py, points.iter().map(of).collect(), &[count])
        };
        dict.set_item("range", floats(&|point| point.range)?)?;
        dict.set_item("intensity", floats(&|point| point.intensity)?)?;
        dict.set_item("time", floats(&|point| point.time)?)?;
        dict.set_item("ring", moved(py, points.iter().map(|point| point.ring).collect(), &[count])?)?;
        dict.set_item("column", moved(py, points.iter().map(|point| point.column).collect(), &[count])?)?;
        let classes = points.iter().map(|point| point.class as u8).collect();
        dict.set_item("class", moved::<u8>(py, classes, &[count])?)?;
        dict.set_item("label", moved(py, points.iter().map(|point| point.label).collect(), &[count])?)?;
        let origin = made.pose.origin * made.metres_per_unit;
        let pose = DMat4::from(DAffine3::from_mat3_translation(made.pose.world_from_sensor, origin));
        dict.set_item("world_from_sensor", matrix(py, &pose)?)?;
        dict.set_item("pulses", made.pulses)?;
        Ok(dict)
    }

    #[doc = docs!("Renderer.bake")]
    #[pyo3(signature = (weather, *, time=0.0, progress=None))]
    fn bake(
        &self,
        py: Python<'_>,
        weather: &Bound<'_, PyAny>,
        time: f64,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<PyScene> {
        let (weather, time) = (PyWeather::given(Some(weather))?, finite("time", time)?);
        self.with(py, |open, stop| {
            let mut reporter = CallbackProgress::new(stop, progress.as_ref());
            let OpenPlace { renderer, place, .. } = open;
            let baked = renderer.bake(place, &weather, time, &mut reporter);
            let baked = reporter.outcome(baked)?.ok_or_else(|| {
                let says = "nothing lies under the weather";
                Failure::Library(format!(
                    "{says} {} at {time} s: ask for it, such as {{\"snow_cover.depth\": 0.1}}",
                    weather.name
                ))
            })?;
            Ok(PyScene::made(baked.scene))
        })
    }

    #[doc = docs!("Renderer.measure")]
    #[pyo3(signature = (weather, *, time=0.0, camera=None, instruments=None, size=None, progress=None))]
    #[allow(clippy::too_many_arguments)] // As many as Python's.
    fn measure<'py>(
        &self,
        py: Python<'py>,
        weather: &Bound<'py, PyAny>,
        time: f64,
        camera: Option<&Bound<'py, PyAny>>,
        instruments: Option<Vec<String>>,
        size: Option<(u32, u32)>,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<Bound<'py, PyList>> {
        let (weather, time) = (PyWeather::given(Some(weather))?, finite("time", time)?);
        let (given, options) =
            (CameraInput::of(camera)?, view_options(Some(size.unwrap_or((480, 320))), None)?);
        let names: Vec<&str> = INSTRUMENTS.iter().map(|instrument| instrument.name).collect();
        if let Some(wrong) = instruments.iter().flatten().find(|name| !names.contains(&name.as_str())) {
            let says = format!("instruments {wrong:?}: unknown; the instruments are {}", names.join(", "));
            return Err(PyValueError::new_err(says));
        }
        let asked = |name: &str| instruments.as_ref().is_none_or(|asked| asked.iter().any(|own| own == name));
        let chosen: Vec<_> = INSTRUMENTS
            .iter()
            .filter(|instrument| asked(instrument.name) && (instrument.applies)(&weather, time))
            .collect();
        if weather.fidelity == wm_weather::Fidelity::Paper {
            return Err(Error::new_err(
                "fidelity `paper` has no physical units to be measured: use physical",
            ));
        }
        let readings = detached(py, |stop| {
            let mut reporter = CallbackProgress::new(stop, progress.as_ref());
            // Instruments take the place for themselves; after an error it is loaded again.
            let mut lent = self.open.lock();
            let mut open = match lent.take() {
                Some(open) => open,
                None => self.load()?,
            };
            let pool = Arc::clone(&open.pool);
            let (open, readings) = Arc::clone(&pool).install(|| {
                let camera = open.camera(&given, &options)?;
                let mut field = PlaceRenderer::new(open.renderer, open.place, camera);
                let request = MeasureRequest { weather: &weather, time, setting: &weather.name };
                let mut readings = Vec::new();
                reporter.begin("readings", Some(chosen.len() as u64));
                for instrument in chosen {
                    if reporter.is_stopped() {
                        return reporter.outcome(Err(Failure::Stopped));
                    }
                    let found = instrument.read(&mut field, &request).map_err(|error| {
                        Failure::Library(format!("{}: {}", instrument.name, line_of(&error)))
                    })?;
                    field.clear_away();
                    readings.extend(found.readings.into_iter().map(|reading| (instrument.name, reading)));
                    reporter.advance(1);
                }
                let PlaceRenderer { renderer, place, .. } = field;
                Ok((OpenPlace { renderer, place, picture: open.picture, pool }, readings))
            })?;
            *lent = Some(open);
            reporter.outcome(Ok::<_, Failure>(readings))
        })?;
        let list = PyList::empty(py);
        for (instrument, reading) in readings {
            let dict = PyDict::new(py);
            dict.set_item("instrument", instrument)?;
            dict.set_item("passes", reading.passes())?;
            dict.set_item("error", reading.error())?;
            dict.set_item("quantity", reading.quantity)?;
            dict.set_item("unit", reading.unit)?;
            dict.set_item("expected", reading.asked)?;
            dict.set_item("measured", reading.measured)?;
            dict.set_item("standard_error", reading.standard_error)?;
            list.append(dict)?;
        }
        Ok(list)
    }
}

impl OpenPlace {
    /// Draws a frame into its memory.
    fn draw(&mut self, request: &FrameRequest<'_>, reporter: &mut CallbackProgress<'_>) -> Outcome<()> {
        let Self { renderer, place, picture, .. } = self;
        let drawn = renderer.render_into(place, request, picture, reporter);
        reporter.outcome(drawn).map(drop)
    }
}
