//! Real weather on real places: renders 3D Gaussian splatting scenes in fog, haze, smog, rain,
//! hail, snowfall, lying snow and dust, with weather in physical units.
//!
//! ```
//! use weather_magician::{Camera, FrameRequest, Renderer, Scene, Weather};
//!
//! # let folder = tempfile::tempdir()?;
//! # std::env::set_current_dir(&folder)?;
//! # wm_street::Street::builtin().sampling(0.1).scene(&|_| true).unwrap().save("garden.ply")?;
//! let scene = Scene::open("garden.ply")?.metres_per_unit(0.4);
//! let weather = Weather::preset("fog")?.set("fog.mor", 80.0)?;
//! let mut renderer = Renderer::auto()?;                         // a GPU where there is one, else the CPU
//! let mut place = renderer.load(scene)?;                        // splats, survey, what weather must know
//! let camera = Camera::look_at([4.0, -20.0, 1.6], [4.0, -30.0, 1.5]).fov_y(50.0).size(120, 80);
//! let request = FrameRequest::new(&weather, camera, 0.0);               // time in seconds
//! let picture = renderer.render(&mut place, &request)?;
//! picture.save("fog.png")?;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # The types to know
//! - [`Scene`]: splats, photo views and metadata, read from and written to any format of 3DGS
//!   ([`formats`]).
//! - [`Renderer`]: a device. [`Renderer::load`] turns a scene into a [`PreparedPlace`].
//! - [`Weather`]: effects with parameters over time, from a preset, a file or by hand.
//! - [`Picture`]: a rendered frame: colour, depth, normals, and the parts that air and particles
//!   add.
//! - [`train::Session`]: photos to a scene.
//!
//! # A tour
//! `renderer`, `place`, `weather`, `camera` and `folder` are there already. The tests run every block.
//!
//! **Depth, normals, flow, labels** and the parts of a picture are [`Layers`]: values for each
//! pixel in rows, or files.
//! ```
//! # use weather_magician::{Camera, FrameRequest, Renderer, Weather};
//! # let folder = tempfile::tempdir()?;
//! # let scene = wm_street::Street::builtin().sampling(0.05).scene(&|_| true).unwrap();
//! # let (mut renderer, weather) = (Renderer::cpu()?, Weather::preset("fog")?);
//! # let mut place = renderer.load(scene)?;
//! # let camera = Camera::look_at([4.0, -20.0, 1.6], [4.0, -30.0, 1.5]).size(60, 40);
//! use weather_magician::{Layers, PictureLayer, output::PictureStyle};
//!
//! let layers = Layers::COLOR | Layers::DEPTH;
//! let request = FrameRequest { layers, ..FrameRequest::new(&weather, camera, 0.0) };
//! let picture = renderer.render(&mut place, &request)?;
//! let metres = picture.layer(PictureLayer::Depth); // [H, W]
//! let style = PictureStyle { also: vec!["depth.npy".parse()?], ..PictureStyle::default() };
//! style.write(&picture, &folder.path().join("fog.png"))?; // and fog.depth.npy
//! # assert_eq!(metres.len(), 60 * 40);
//! # assert!(folder.path().join("fog.depth.npy").exists());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! **A video** is a weather, a [`CameraMotion`] and a file; [`view`] finds cameras and paths.
//! ```
//! # use weather_magician::{Camera, FrameRequest, Renderer, Weather};
//! # let folder = tempfile::tempdir()?;
//! # let scene = wm_street::Street::builtin().sampling(0.05).scene(&|_| true).unwrap();
//! # let (mut renderer, weather) = (Renderer::cpu()?, Weather::preset("fog")?);
//! # let mut place = renderer.load(scene)?;
//! # let camera = Camera::look_at([4.0, -20.0, 1.6], [4.0, -30.0, 1.5]).size(60, 40);
//! use weather_magician::{CameraMotion, PictureSize, VideoFile, video::{FrameRate, VideoSettings}};
//!
//! let rain = Weather::clear().set("rain.rate", "0:0,0.2:30")?; // mm/h at seconds
//! let settings = VideoSettings::new(PictureSize::new(64, 48), FrameRate::default());
//! let path = folder.path().join("rain.mp4");
//! let file = VideoFile { path: &path, seconds: 0.2, settings };
//! let motion = CameraMotion::from(camera.size(64, 48).camera(place.survey().up.value, 0.1)?);
//! renderer.render_video(&mut place, &rain, &motion, file, &mut ())?;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! **A lidar** and a **radar** stand where a camera would ([`lidar`], [`radar`]).
//! ```
//! # use weather_magician::{Camera, FrameRequest, Renderer, Weather};
//! # let folder = tempfile::tempdir()?;
//! # let scene = wm_street::Street::builtin().sampling(0.05).scene(&|_| true).unwrap();
//! # let (mut renderer, weather) = (Renderer::cpu()?, Weather::preset("fog")?);
//! # let mut place = renderer.load(scene)?;
//! # let camera = Camera::look_at([4.0, -20.0, 1.6], [4.0, -30.0, 1.5]).size(60, 40);
//! use weather_magician::{CameraMotion, FrameCamera, lidar::{LidarModel, ScanOptions}};
//!
//! let view = FrameCamera::from(camera).at(0.0, &place)?;
//! let motion = CameraMotion::from(view.camera);
//! let model = LidarModel::find("vlp-16")?;
//! let sweep = renderer.scan_once(&mut place, &weather, &model, &motion, &ScanOptions::default())?;
//! sweep.save(&folder.path().join("fog.ply"))?; // points with range, intensity, ring, class
//! # assert!(sweep.points.len() > 1000);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! **A rig** is read from TOML: cameras as devices ([`camera_model`]: lens, shutter, exposure, noise),
//! lidars, radars and event cameras behind one trait ([`sensor`]), each with its pose, rate and phase.
//! ```
//! # use weather_magician::{Camera, FrameRequest, Renderer, Weather};
//! # let folder = tempfile::tempdir()?;
//! # let scene = wm_street::Street::builtin().sampling(0.05).scene(&|_| true).unwrap();
//! # let (mut renderer, weather) = (Renderer::cpu()?, Weather::preset("fog")?);
//! # let mut place = renderer.load(scene)?;
//! # let camera = Camera::look_at([4.0, -20.0, 1.6], [4.0, -30.0, 1.5]).size(60, 40);
//! use weather_magician::{CameraMotion, FrameCamera, output::PictureStyle, rig::Rig};
//! use weather_magician::sensor::{SensorData, SensorInstant};
//!
//! let text = "[[sensor]]\nname = 'top'\nkind = 'lidar'\nmodel = 'vlp-16'\nposition = [0, 0, 0.4]";
//! let rig = Rig::parse(text, "rig.toml")?;
//! let car = CameraMotion::from(FrameCamera::from(camera).at(0.0, &place)?.camera);
//! let sensor = &rig.sensors[0];
//! let mut run = sensor.device.begin(sensor.motion(&car, place.site().metres_per_unit), 0);
//! let (instant, mut read) = (SensorInstant::first(&weather, sensor.rate), SensorData::default());
//! run.read(&mut renderer, &mut place, &instant, &mut read, &mut ())?;
//! read.save(&folder.path().join("000000.ply"), &PictureStyle::default())?;
//! # assert!(folder.path().join("000000.ply").exists());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! **A data set** is a plan of scenes, weathers, paths and sensors ([`batch`]): written in the layouts
//! of nuScenes, KITTI and others, or asked for frame by frame.
//! ```
//! # use weather_magician::{Camera, FrameRequest, Renderer, Weather};
//! # let folder = tempfile::tempdir()?;
//! # let scene = wm_street::Street::builtin().sampling(0.05).scene(&|_| true).unwrap();
//! # let (mut renderer, weather) = (Renderer::cpu()?, Weather::preset("fog")?);
//! # let mut place = renderer.load(scene)?;
//! # let camera = Camera::look_at([4.0, -20.0, 1.6], [4.0, -30.0, 1.5]).size(60, 40);
//! use weather_magician::batch::{BatchPlan, BatchRun, SampleOptions};
//!
//! place.scene().save(folder.path().join("street.ply"))?;
//! let text = "[[scene]]\nfile = 'street.ply'\n[[weather]]\nsamples = 100\n[rig]\nsize = [60, 40]";
//! let plan = BatchPlan::parse(text, "plan.toml", folder.path(), "plan")?;
//! let mut run = BatchRun::new(plan, Renderer::cpu()?, |_| None)?;
//! let sample = run.sample(42, &SampleOptions::default())?; // picture, pose, weather, variables
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! **A scene from photos**, with cameras or without ([`train`]; [`capture`] reads them).
//! ```
//! # let folder = tempfile::tempdir()?;
//! # let photos = folder.path().join("photos");
//! # let options = wm_street::dataset::DatasetOptions { count: 6, size: (96, 64), ..Default::default() };
//! # wm_street::dataset::write(&wm_street::Street::builtin(), &photos, &options, &mut |_| true)?;
//! use weather_magician::train::{Preset, Session};
//!
//! let scene = Session::new(photos).preset(Preset::Quick).steps(20).run(&mut ())?;
//! scene.save(folder.path().join("place.ply"))?;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! **Snow in an ordinary scene file** is [`Renderer::bake`]; other changes of a scene are
//! [`SceneChange`] and [`Scene::save`], in any of the [`formats`].
//! ```
//! # use weather_magician::{Camera, FrameRequest, Renderer, Weather};
//! # let folder = tempfile::tempdir()?;
//! # let scene = wm_street::Street::builtin().sampling(0.05).scene(&|_| true).unwrap();
//! # let (mut renderer, weather) = (Renderer::cpu()?, Weather::preset("fog")?);
//! # let mut place = renderer.load(scene)?;
//! # let camera = Camera::look_at([4.0, -20.0, 1.6], [4.0, -30.0, 1.5]).size(60, 40);
//! let snow = Weather::clear().set("snow_cover.depth", 0.1)?; // m
//! let baked = renderer.bake(&mut place, &snow, 0.0, &mut ())?.ok_or("this weather lays nothing")?;
//! baked.scene.save(folder.path().join("snow.spz"))?;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! **Measure** what is drawn: each of the instruments reads pixels and says what it should have read.
//! ```
//! # use weather_magician::{Camera, FrameRequest, Renderer, Weather};
//! # let folder = tempfile::tempdir()?;
//! # let scene = wm_street::Street::builtin().sampling(0.05).scene(&|_| true).unwrap();
//! # let (mut renderer, weather) = (Renderer::cpu()?, Weather::preset("fog")?);
//! # let mut place = renderer.load(scene)?;
//! # let camera = Camera::look_at([4.0, -20.0, 1.6], [4.0, -30.0, 1.5]).size(60, 40);
//! use weather_magician::measure::{INSTRUMENTS, MeasureRequest, PlaceRenderer};
//!
//! let view = weather_magician::FrameCamera::from(camera).at(0.0, &place)?;
//! let mut at = PlaceRenderer::new(renderer, place, view.camera);
//! let request = MeasureRequest { weather: &weather, time: 0.0, setting: "fog" };
//! let visibility = INSTRUMENTS.iter().find(|one| one.name == "visibility").ok_or("no such")?;
//! for reading in visibility.read(&mut at, &request)?.readings {
//!     assert!(reading.passes(), "{}: {} {}", reading.quantity, reading.measured, reading.unit);
//! }
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! **A weather report** is a weather too: METAR, hourly tables, WMO codes, words ([`reports`]).
//! ```
//! # use weather_magician::{Camera, FrameRequest, Renderer, Weather};
//! # let folder = tempfile::tempdir()?;
//! # let scene = wm_street::Street::builtin().sampling(0.05).scene(&|_| true).unwrap();
//! # let (mut renderer, weather) = (Renderer::cpu()?, Weather::preset("fog")?);
//! # let mut place = renderer.load(scene)?;
//! # let camera = Camera::look_at([4.0, -20.0, 1.6], [4.0, -30.0, 1.5]).size(60, 40);
//! use weather_magician::reports::{ReportOptions, WeatherReport};
//!
//! let report = WeatherReport::read("heavy rain, wind 40 km/h from the west", "words", &ReportOptions::default())?;
//! let picture = renderer.render(&mut place, &FrameRequest::new(report.weather(), camera, 0.0))?;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # And more
//! | task | call |
//! |---|---|
//! | a camera that suits the scene | [`view::choose`] |
//! | assets that take seconds, on another thread | [`PreparedPlace::missing_assets`], [`assets`] |
//! | up, ground and scale set by hand | [`Renderer::align`], [`Renderer::surface_at`] |
//! | frames from your own splats | [`frame::FrameInputs`] |
//! | a drive of a dataset as photos | [`capture::DrivingLog`] |
//!
//! Frames are pure functions of (scene, weather, camera, time): the same inputs give the same bytes
//! on the CPU, on any number of threads. The library prints nothing. Warnings come back as values
//! ([`PreparedPlace::take_warnings`]), and long work reports to a [`Progress`].

mod convert;

pub use convert::{CropBox, LengthScale, SceneChange};
#[cfg(feature = "batch")]
pub use wm_batch as batch;
pub use wm_capture as capture;
pub use wm_image::{PictureSize, video};
#[cfg(feature = "measure")]
pub use wm_measure as measure;
pub use wm_place::*;
#[cfg(feature = "reports")]
pub use wm_reports as reports;
pub use wm_scene::formats;
#[cfg(feature = "train")]
pub use wm_train as train;
pub use wm_weather::EFFECTS;
pub use {wm_image, wm_place, wm_render, wm_scene, wm_sensors, wm_weather};
