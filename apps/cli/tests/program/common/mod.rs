//! Helpers of the tests of rendered output: scenes of flat cards, the binary, readers of pictures.

use crate::process::{listing, printed, refuses, said, succeeds};
use glam::DVec3;
use serde_json::Value;
use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::ops::Deref;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use tempfile::TempDir;
use weather_magician::{FrameRequest, Picture, PreparedPlace, Renderer, Weather};
use wm_scene::formats::{ReadOptions, read_scene, write_scene};
use wm_scene::synthetic::Builder;
use wm_scene::{Camera, Metadata, Scene, Splats};
use wm_street::Street;
use wm_street::dataset::{self, DatasetOptions};

pub use wm_scene::card::Card;

/// A step of an 8-bit picture.
pub const BYTE_STEP: f64 = 1.0 / 255.0;

/// Display-referred colour of the white cards.
pub const WHITE: [f32; 3] = [1.0; 3];
/// Display-referred colour of the black cards.
pub const BLACK: [f32; 3] = [0.0; 3];

/// `-ln 0.05`: optical depth at the meteorological optical range (WMO No. 8), typed anew so that
/// the tests do not borrow a constant from what they test.
pub const MOR_DEPTH: f64 = 2.995_732_273_553_991;

/// A command of the binary, ready to be given its arguments.
pub fn binary() -> Command {
    Command::new(env!("CARGO_BIN_EXE_weather-magician"))
}

/// Runs the binary.
///
/// # Panics
/// With all that it said, if it fails.
pub fn run(arguments: &[impl AsRef<OsStr>]) -> Output {
    // However long it takes.
    let output = binary().args(arguments).output().expect("the binary starts");
    assert!(output.status.success(), "{:?}: {}", output.status, said(&output));
    output
}

/// A folder for scenes and pictures, in which commands run; it goes away with the value.
pub struct Workshop {
    folder: TempDir,
    /// The words with which [`Self::command`] begins.
    usual: String,
    /// Beginnings of lines that may be printed beside an error.
    remarks: &'static [&'static str],
    /// True if weights that this user has downloaded are not found.
    has_own_weights: bool,
}

impl Workshop {
    /// Makes an empty one.
    pub fn new() -> Self {
        Self::with("", &["warning: "])
    }

    /// Makes an empty one whose commands begin with words, and whose errors may come with remarks.
    pub fn with(usual: impl Into<String>, remarks: &'static [&'static str]) -> Self {
        let folder = tempfile::tempdir().expect("a folder for the test");
        Self { folder, usual: usual.into(), remarks, has_own_weights: false }
    }

    /// Keeps its commands from finding the network weights that this user has downloaded.
    pub fn with_own_weights(self) -> Self {
        Self { has_own_weights: true, ..self }
    }

    /// Returns the path of the file `name`.
    pub fn path(&self, name: impl AsRef<Path>) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Writes a file, and makes the folders that it lies in.
    pub fn put(&self, name: impl AsRef<Path>, content: impl AsRef<[u8]>) -> PathBuf {
        let path = self.path(name);
        std::fs::create_dir_all(path.parent().expect("it lies in a folder")).expect("the folder is made");
        std::fs::write(&path, content).expect("the file is written");
        path
    }

    /// Writes a player of web pages that does nothing into `player`.
    pub fn put_player(&self) {
        self.put("player/player.js", "export class Player {}\n");
        self.put("player/player_bg.wasm", b"\0asm\x01\0\0\0");
    }

    /// Reads a file.
    pub fn read(&self, name: &str) -> Vec<u8> {
        std::fs::read(self.path(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
    }

    /// Returns what `inspect` tells of a scene.
    pub fn inspected(&self, scene: &str) -> Value {
        let report = succeeds(&mut self.program(["inspect", "--json", scene]));
        serde_json::from_slice(&report.stdout).expect("it is JSON")
    }

    /// Reads a scene.
    pub fn open(&self, name: &str) -> Scene {
        read_scene(&self.path(name), &ReadOptions::default()).expect("the scene is read")
    }

    /// Writes a scene as PLY.
    pub fn scene(&self, name: &str, splats: Splats, metadata: &Metadata) -> PathBuf {
        let path = self.path(format!("{name}.ply"));
        let scene = Scene { splats, metadata: metadata.clone(), ..Scene::default() };
        write_scene(&path, &scene).expect("the scene is written");
        path
    }

    /// Writes photos of the built-in street as a COLMAP data set.
    pub fn photos(&self, name: &str, options: &DatasetOptions) {
        dataset::write(&Street::builtin(), &self.path(name), options, &mut |_| true).unwrap();
    }

    /// Returns the binary with arguments, in this folder, without an input.
    pub fn program<S: AsRef<OsStr>>(&self, arguments: impl IntoIterator<Item = S>) -> Command {
        let mut command = binary();
        command.args(arguments).current_dir(&self.folder).stdin(Stdio::null());
        if self.has_own_weights {
            command.env("XDG_CACHE_HOME", self.path("cache"));
        }
        command
    }

    /// Returns a command with `words` after the usual ones, apart by spaces.
    pub fn command(&self, words: &str) -> Command {
        self.program(self.usual.split_whitespace().chain(words.split_whitespace()))
    }

    /// Runs a command that must succeed, and returns what it prints.
    pub fn run(&self, words: &str) -> String {
        printed(&succeeds(&mut self.command(words)))
    }

    /// Runs a command that must succeed and write `out.json`; returns stdout, stderr and the JSON.
    pub fn run_with_json(&self, words: &str) -> (String, String, Value) {
        let output = succeeds(&mut self.command(&format!("{words} --overwrite --json out.json")));
        let json = serde_json::from_slice(&self.read("out.json")).expect("it is JSON");
        (printed(&output), said(&output), json)
    }

    /// Runs a command that must be refused with one line that holds each of `says`, and leave
    /// everything as it was.
    pub fn refused(&self, words: &str, says: &[&str]) -> String {
        self.refused_by(&mut self.command(words), says)
    }

    /// [`Self::refused`] of a command as it is.
    pub fn refused_by(&self, command: &mut Command, says: &[&str]) -> String {
        refuses(command, self.folder.path(), says, self.remarks)
    }

    /// The arguments that render `scene` to `out` with further `options`, words apart by spaces.
    pub fn words(&self, scene: &Path, view: &ViewArgs, out: &str, options: &str) -> Vec<String> {
        let mut words = vec!["render".to_owned(), scene.display().to_string()];
        words.extend(view.0.iter().cloned());
        words.extend(["--overwrite".to_owned(), "--out".to_owned(), self.path(out).display().to_string()]);
        words.extend(options.split_whitespace().map(str::to_owned));
        words
    }

    /// Renders it and says where the output lies.
    pub fn render(&self, scene: &Path, view: &ViewArgs, out: &str, options: &str) -> PathBuf {
        run(&self.words(scene, view, out, options));
        self.path(out)
    }
}

/// A scene in a folder of its own, with the camera that looks at it.
pub struct Shot {
    workshop: Workshop,
    /// The scene's file.
    pub scene: PathBuf,
    /// The camera on the command line.
    pub view: ViewArgs,
}

impl Deref for Shot {
    type Target = Workshop;

    fn deref(&self) -> &Workshop {
        &self.workshop
    }
}

impl Shot {
    /// The yard with its usual look.
    pub fn yard(size: (u32, u32)) -> Self {
        Self::yard_with(size, &yard_metadata(1.0))
    }

    /// [`Self::yard`] with other metadata.
    pub fn yard_with(size: (u32, u32), metadata: &Metadata) -> Self {
        Self::of("yard", yard().build(), metadata, yard_look(size).1)
    }

    /// Writes a scene.
    pub fn of(name: &str, splats: Splats, metadata: &Metadata, view: ViewArgs) -> Self {
        let workshop = Workshop::new();
        Self { scene: workshop.scene(name, splats, metadata), workshop, view }
    }

    /// Returns a command that renders to `out` with further `options`, parted by spaces.
    pub fn command(&self, out: &str, options: &str) -> Command {
        self.program(self.words(&self.scene, &self.view, out, options))
    }

    /// Renders to `out`, and returns its path.
    pub fn render(&self, out: &str, options: &str) -> PathBuf {
        self.workshop.render(&self.scene, &self.view, out, options)
    }

    /// Renders an 8-bit picture.
    pub fn png(&self, options: &str) -> Image<[u8; 3]> {
        read_png(&self.render("shot.png", options))
    }

    /// Renders a picture in linear light.
    pub fn exr(&self, options: &str) -> Image<[f64; 3]> {
        read_exr(&self.render("shot.exr", options))
    }

    /// Renders four seconds at two frames a second with the weather file `weather` and one thread,
    /// then three of the frames alone with other numbers of threads.
    ///
    /// # Panics
    /// If a frame alone is not that of the sequence, or if two of the three are equal.
    pub fn check_frames_alone(&self, weather: &str) {
        let weather = self.put("weather.toml", weather);
        let shared = format!("--weather {} --assets off", weather.display());
        let folder = self.render("all", &format!("{shared} --seconds 4 --fps 2 --threads 1"));
        let mut different = std::collections::BTreeSet::new();
        for (frame, threads) in [(1, 2), (4, 7), (7, 1)] {
            let options = format!("{shared} --time {} --threads {threads}", f64::from(frame) / 2.0);
            let alone = self.png(&options);
            assert!(alone == read_png(&folder.join(format!("{frame:05}.png"))), "frame {frame}");
            different.insert(format!("{:?}", alone.pixels));
        }
        assert_eq!(different.len(), 3);
    }
}

/// The files below a folder by their paths in it.
pub fn files(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let all = listing(folder).into_iter().filter(|(path, _)| path.is_file());
    all.map(|(path, bytes)| (path.strip_prefix(folder).unwrap().to_owned(), bytes)).collect()
}

/// `words`, then `more`, then options of `usual` that `more` does not say.
pub fn with_usual<'a>(words: &[&'a str], more: &[&'a str], usual: &[(&'a str, &'a str)]) -> Vec<&'a str> {
    let usual =
        usual.iter().filter(|(name, _)| !more.contains(name)).flat_map(|(name, value)| [*name, value]);
    words.iter().chain(more).copied().chain(usual).collect()
}

/// Names in a folder, sorted.
pub fn names(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).unwrap();
    let mut names: Vec<String> =
        entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

/// A camera on the command line.
#[derive(Clone)]
pub struct ViewArgs(Vec<String>);

impl ViewArgs {
    /// Leaves out an option, such as `--fov`.
    pub fn without(self, option: &str) -> Self {
        Self(self.0.into_iter().filter(|word| !word.starts_with(option)).collect())
    }

    /// A path of keyframes in a file.
    pub fn along(path: &Path, size: (u32, u32)) -> Self {
        Self(vec![format!("--path={}", path.display()), format!("--size={}x{}", size.0, size.1)])
    }
}

/// A look from `eye` at `target`, as a camera and as the options that ask for it.
pub fn look(size: (u32, u32), fov: f64, eye: DVec3, target: DVec3, up: DVec3) -> (Camera, ViewArgs) {
    let camera = Camera::looking(size, fov, eye, target, up).expect("a camera");
    let point = |p: DVec3| format!("{},{},{}", p.x, p.y, p.z);
    // Equal signs keep clap from reading a minus as an option.
    let arguments = vec![
        format!("--camera={}:{}", point(eye), point(target)),
        format!("--size={}x{}", size.0, size.1),
        format!("--fov={fov}"),
    ];
    (camera, ViewArgs(arguments))
}

/// A small yard for pictures of a place: ground, a house, trees, things on the ground; 5,000 splats
/// within 20 m of the origin, z up, scene units. Without a sky.
pub fn yard() -> Builder {
    let mut place = Builder::new(11);
    let tiles = |a: f64, b: f64| {
        let odd = ((a * 10.0) as i32 + (b * 10.0) as i32) % 2 == 1;
        if odd { [0.55, 0.53, 0.48] } else { [0.4, 0.42, 0.36] }
    };
    place.surface(DVec3::new(-12.0, -12.0, 0.0), DVec3::X * 24.0, DVec3::Y * 30.0, 0.6, tiles);
    place.block(DVec3::new(4.0, 8.0, 0.0), DVec3::new(7.0, 5.0, 4.0), 0.4, [0.75, 0.68, 0.55]);
    place.block(DVec3::new(-3.0, -2.0, 0.0), DVec3::new(1.2, 1.2, 1.2), 0.2, [0.7, 0.2, 0.15]);
    place.ball(DVec3::new(1.5, -4.0, 0.6), 0.6, 0.12, [0.15, 0.3, 0.6]);
    place.tree(DVec3::new(-6.0, 6.0, 0.0), 7.0, 400);
    place.tree(DVec3::new(0.5, 15.0, 0.0), 6.0, 300);
    place
}

/// Returns the camera of the yard: 12 m before its middle, over the ground and into the open.
pub fn yard_look(size: (u32, u32)) -> (Camera, ViewArgs) {
    look(size, 50.0, DVec3::new(0.5, -12.0, 1.8), DVec3::new(0.0, 4.0, 2.2), DVec3::Z)
}

/// Returns the metadata of the yard at a scale, without a colour of its air.
pub fn yard_metadata(metres_per_unit: f64) -> Metadata {
    Metadata {
        metres_per_unit: Some(metres_per_unit),
        up: Some(DVec3::Z),
        ground: Some(0.0),
        ..Metadata::default()
    }
}

/// A picture in memory, the top row first.
#[derive(Clone, Debug, PartialEq)]
pub struct Image<T> {
    /// Width, px.
    pub width: usize,
    /// Height, px.
    pub height: usize,
    /// Row by row.
    pub pixels: Vec<T>,
}

impl<T: Copy> Image<T> {
    /// The pixel in column `x` of row `y`.
    pub fn at(&self, x: usize, y: usize) -> T {
        self.pixels[y * self.width + x]
    }

    /// Changes every pixel.
    pub fn map<U>(&self, change: impl FnMut(T) -> U) -> Image<U> {
        let pixels = self.pixels.iter().copied().map(change).collect();
        Image { width: self.width, height: self.height, pixels }
    }
}

/// One channel of an EXR: `R`, `G`, `B` in linear light, `A` alpha, `Z` depth in metres.
pub fn read_channel(path: &Path, name: &str) -> Image<f64> {
    let image = exr::prelude::read_first_flat_layer_from_file(path)
        .unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let layer = image.layer_data;
    let channel = layer.channel_data.list.iter().find(|channel| channel.name.eq(name));
    let channel = channel.unwrap_or_else(|| panic!("{} has no channel {name}", path.display()));
    let pixels = channel.sample_data.values_as_f32().map(f64::from).collect();
    Image { width: layer.size.width(), height: layer.size.height(), pixels }
}

/// The colours of an EXR, linear light.
pub fn read_exr(path: &Path) -> Image<[f64; 3]> {
    let [r, g, b] = ["R", "G", "B"].map(|name| read_channel(path, name));
    let pixels = (0..r.pixels.len()).map(|i| [r.pixels[i], g.pixels[i], b.pixels[i]]).collect();
    Image { width: r.width, height: r.height, pixels }
}

/// The bytes of an 8-bit RGB PNG.
pub fn read_png(path: &Path) -> Image<[u8; 3]> {
    let file = std::fs::File::open(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let mut reader = png::Decoder::new(std::io::BufReader::new(file)).read_info().expect("a PNG");
    let mut bytes = vec![0; reader.output_buffer_size().expect("a size")];
    let info = reader.next_frame(&mut bytes).expect("a picture");
    assert_eq!((info.color_type, info.bit_depth), (png::ColorType::Rgb, png::BitDepth::Eight));
    let pixels = bytes.as_chunks::<3>().0.to_vec();
    Image { width: info.width as usize, height: info.height as usize, pixels }
}

/// sRGB, 0-1, to linear light: IEC 61966-2-1, typed anew so that the tests do not borrow the curve
/// from what they test.
pub fn decode(encoded: f64) -> f64 {
    if encoded <= 0.040_45 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) }
}

/// Linear light to sRGB.
pub fn encode(linear: f64) -> f64 {
    if linear <= 0.003_130_8 { linear * 12.92 } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

/// A PNG's colours in linear light.
pub fn light_of(picture: &Image<[u8; 3]>) -> Image<[f64; 3]> {
    picture.map(|rgb| rgb.map(|byte| decode(f64::from(byte) * BYTE_STEP)))
}

/// The largest of some numbers; 0 if there are none.
pub fn largest(values: impl IntoIterator<Item = f64>) -> f64 {
    values.into_iter().fold(0.0, f64::max)
}

/// Returns the PSNR, dB, of values from 0 to 1 that have these errors.
pub fn psnr(errors: impl IntoIterator<Item = f64>) -> f64 {
    let (sum, count) = errors.into_iter().fold((0.0, 0.0), |(sum, count), e| (sum + e * e, count + 1.0));
    -10.0 * f64::log10(sum / count)
}

/// Column and row of every pixel of a picture.
pub fn pixels(camera: &Camera) -> impl Iterator<Item = (u32, u32)> {
    let (width, height) = (camera.width, camera.height);
    (0..height).flat_map(move |y| (0..width).map(move |x| (x, y)))
}

/// Clear weather with changes, each as `--set` takes it.
pub fn weather(changes: &[impl AsRef<str>]) -> Weather {
    let mut weather = Weather::clear();
    changes.iter().try_for_each(|change| weather.set_text(change.as_ref())).unwrap();
    weather
}

/// The yard in a renderer.
pub fn load_yard(renderer: &mut Renderer, metadata: &Metadata) -> PreparedPlace {
    let scene = Scene { splats: yard().build(), metadata: metadata.clone(), ..Scene::default() };
    renderer.load(scene).unwrap()
}

/// Pictures of a place of one unit a metre, at an instant of clear weather with changes, each a
/// list of settings.
pub fn pictures(splats: Splats, camera: &Camera, time: f64, changes: &[&[&str]]) -> Vec<Picture> {
    let mut renderer = Renderer::cpu().unwrap();
    let scene = Scene { splats, metadata: yard_metadata(1.0), ..Scene::default() };
    let mut place = renderer.load(scene).unwrap();
    let picture =
        |set: &&[&str]| renderer.render(&mut place, &FrameRequest::new(&weather(set), camera, time)).unwrap();
    changes.iter().map(picture).collect()
}
