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
//! # What else there is
//! | task | call |
//! |---|---|
//! | a video | [`Renderer::render_video`] with a [`CameraMotion`] |
//! | a camera that suits the scene | [`view::choose`] |
//! | snow in an ordinary scene file | [`Renderer::bake`] |
//! | another format, fewer splats | [`SceneChange`], [`Scene::save`] |
//! | photos to a scene | [`train::Session`] |
//! | assets that take seconds, on another thread | [`PreparedPlace::missing_assets`], [`assets`] |
//! | up, ground and scale set by hand | [`Renderer::align`], [`Renderer::surface_at`] |
//! | depth, normals, flow, labels | [`FrameRequest::layers`] |
//! | a lens, a shutter, noise | [`camera_model::SensorCamera`] |
//! | frames from your own splats | [`frame::FrameInputs`] |
//! | sweeps of a lidar in weather | [`Renderer::scan`], [`lidar`] |
//! | sweeps of a radar in rain | [`Renderer::scan_radar`], [`radar`] |
//! | data sets of many weathers, in the layouts of nuScenes, KITTI and others | [`batch`] |
//! | weathers by METAR, hourly tables and words | [`reports`] |
//! | checks of visibility, rain rate, snow depth in pictures | [`measure`] |
//!
//! Frames are pure functions of (scene, weather, camera, time): the same inputs give the same bytes
//! on the CPU, on any number of threads. The library prints nothing. Warnings come back as values
//! ([`PreparedPlace::take_warnings`]), and long work reports to a [`Progress`].

mod convert;

pub use convert::{CropBox, LengthScale, SceneChange};
pub use wm_batch as batch;
pub use wm_capture as capture;
pub use wm_image::{PictureSize, video};
pub use wm_measure as measure;
pub use wm_place::*;
pub use wm_reports as reports;
pub use wm_scene::formats;
pub use wm_train as train;
pub use wm_weather::EFFECTS;
pub use {wm_image, wm_place, wm_render, wm_scene, wm_sensors, wm_weather};
