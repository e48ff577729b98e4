//! The TOML file of a plan: reading, defaults and checks.

use super::{BatchPlan, FRAMES_LAYOUT, PlanPath, PlanPathKind, PlanRig, PlanScene, slug};
use crate::weathers::{FindWeather, WeatherEntry, WeatherSource, meant};
use crate::{LAYOUTS, Layout};
use glam::DVec3;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use toml::Spanned;
use wm_base::calendar::days;
use wm_place::MotionSpec;
use wm_place::levels::{LevelBudget, parse_memory};
use wm_place::output::{LayerFile, PictureFormat};
use wm_place::panorama_file::read_panorama;
use wm_place::rig::Rig;
use wm_place::view::ViewError;
use wm_place::view::moves::PathSpec;
use wm_place::view::spec::CameraSpec;
use wm_place::{Error, Result};
use wm_scene::Metadata;
use wm_scene::camera::FOV_RANGE_DEG;
use wm_weather::{Fidelity, Weather};

/// Longest plan that is read, bytes.
const MAX_BYTES: u64 = 16 << 20;
/// Readings that a block has if the plan does not say how many frames it has.
const DEFAULT_BLOCK_READINGS: usize = 240;
/// Frames of a clip if the plan does not say, with a rig.
const DEFAULT_RIG_FRAMES: u32 = 20;
/// Frames a second if neither the plan nor the rig says.
const DEFAULT_RATE_HZ: f64 = 10.0;
/// 2026-01-01, 0:00 UTC: the time of the first frame if the plan does not say.
const DEFAULT_START_S: i64 = 1_767_225_600;

/// A plan, as it is written.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct PlanFile {
    name: Option<String>,
    #[serde(default)]
    about: String,
    #[serde(default)]
    seed: u64,
    frames: Option<u32>,
    frame_rate: Option<f64>,
    block: Option<u32>,
    start: Option<toml::value::Datetime>,
    layouts: Option<Vec<String>>,
    picture: Option<String>,
    #[serde(default)]
    also: Vec<String>,
    #[serde(default)]
    pairs: bool,
    #[serde(default)]
    labels: Vec<String>,
    #[serde(default)]
    splits: BTreeMap<String, f64>,
    #[serde(default)]
    scene: Vec<Spanned<SceneEntry>>,
    #[serde(default)]
    path: Vec<Spanned<PathEntry>>,
    rig: Option<Spanned<RigEntry>>,
    #[serde(default)]
    weather: Vec<Spanned<WeatherEntry>>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct SceneEntry {
    file: PathBuf,
    name: Option<String>,
    up: Option<[f64; 3]>,
    ground: Option<f64>,
    metres_per_unit: Option<f64>,
    memory: Option<String>,
    splats: Option<u64>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct PathEntry {
    name: Option<String>,
    scene: Option<String>,
    camera: Option<String>,
    cameras: Option<String>,
    every: Option<u32>,
    path: Option<String>,
    distance: Option<f64>,
    speed: Option<f64>,
    seconds: Option<f64>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct RigEntry {
    file: Option<PathBuf>,
    size: Option<[u32; 2]>,
    fov: Option<f64>,
}

/// A fault of a plan: the offset in its text, the key and the problem.
struct PlanFault {
    at: Option<usize>,
    key: String,
    says: String,
}

impl PlanFault {
    fn new(at: Option<usize>, key: impl Into<String>, says: impl Into<String>) -> Self {
        Self { at, key: key.into(), says: says.into() }
    }
}

/// The fault of a plan as an outcome.
fn fault<T>(at: Option<usize>, key: &str, says: impl Into<String>) -> Result<T, PlanFault> {
    Err(PlanFault::new(at, key, says))
}

impl BatchPlan {
    /// Reads a plan. Files that it names are found beside it.
    ///
    /// # Errors
    /// [`Error::Unsupported`] with the file, the line, the key and the problem.
    pub fn read(path: &Path) -> Result<Self> {
        let fault = |says: String| Error::Unsupported(format!("{}: {says}", path.display()));
        let about = std::fs::metadata(path).map_err(|error| fault(format!("cannot be read: {error}")))?;
        if about.is_dir() {
            return Err(fault("is a folder; give a plan (TOML)".into()));
        }
        if about.len() > MAX_BYTES {
            return Err(fault("too long for a plan; give a TOML file".into()));
        }
        let text = wm_base::files::read_text(path, wm_base::files::SMALL_TEXT)
            .map_err(|error| fault(format!("cannot be read: {error}")))?;
        let folder = path.parent().unwrap_or(Path::new(""));
        let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        Self::parse(&text, &path.display().to_string(), folder, &stem)
    }

    /// The plan of a text; `file` stands in errors, and files are found in the folder.
    ///
    /// # Errors
    /// As [`Self::read`].
    pub fn parse(text: &str, file: &str, folder: &Path, stem: &str) -> Result<Self> {
        let line_of = |at: usize| 1 + text[..at.min(text.len())].matches('\n').count();
        let written: PlanFile = toml::from_str(text).map_err(|error| {
            let says = error.message().split_whitespace().collect::<Vec<_>>().join(" ");
            let line =
                error.span().map_or_else(String::new, |span| format!(", line {}", line_of(span.start)));
            Error::Unsupported(format!("{file}{line}: {says}; correct the plan"))
        })?;
        written.plan(file, folder, stem).map_err(|fault| {
            let from = fault.at.unwrap_or(0).min(text.len());
            // The line of the key itself: alone, below its table, before keys of its own, or dotted
            // as `vary.temperature`.
            let mut words = fault.key.rsplit(' ');
            let last = words.next().unwrap_or_default();
            let dotted = words.next().map_or_else(|| format!(".{last}"), |table| format!("{table}.{last}"));
            let is_key = |line: &str| {
                let Some((key, _)) = line.split_once('=') else { return false };
                let key: String = key.chars().filter(|c| !c.is_whitespace() && !"\"'".contains(*c)).collect();
                let is_dotted =
                    key.strip_suffix(&dotted).is_some_and(|rest| rest.is_empty() || rest.ends_with('.'));
                key == last || is_dotted || key.strip_prefix(last).is_some_and(|rest| rest.starts_with('.'))
            };
            let own = text[from..].lines().position(is_key).map(|lines| line_of(from) + lines);
            let line = own.or_else(|| fault.at.map(line_of));
            let line = line.map_or_else(String::new, |line| format!(", line {line}"));
            Error::Unsupported(format!("{file}{line}: {}: {}; correct the plan", fault.key, fault.says))
        })
    }
}

fn is_name(name: &str) -> bool {
    !name.is_empty()
        && name.len() <= 64
        && name.chars().all(|c| c.is_ascii_alphanumeric() || c == '-' || c == '_')
}

const NAME_ADVICE: &str = "it becomes a folder: use letters, digits, - and _";

impl PlanFile {
    fn plan(&self, file: &str, folder: &Path, stem: &str) -> Result<BatchPlan, PlanFault> {
        let name = self.name.clone().unwrap_or_else(|| slug(stem));
        if !is_name(&name) {
            return fault(None, "name", format!("\"{name}\": {NAME_ADVICE}"));
        }
        let scenes = self.scenes(folder)?;
        let weathers = self.weathers(folder)?;
        let (rig, own_rate) = self.rig(folder)?;
        let frame_rate = self.frame_rate.or(own_rate).unwrap_or(DEFAULT_RATE_HZ);
        if !(frame_rate > 0.0 && frame_rate <= 1000.0) {
            return fault(
                None,
                "frame_rate",
                format!("{frame_rate}: it must be above 0 and at most 1000 Hz"),
            );
        }
        let is_rig = matches!(rig, PlanRig::Rig(_));
        let frames = self.frames.unwrap_or(if is_rig { DEFAULT_RIG_FRAMES } else { 1 });
        if frames == 0 || frames > 1_000_000 {
            return fault(None, "frames", format!("{frames}: it must be from 1 to 1,000,000"));
        }
        let paths = self.paths(folder, &scenes, f64::from(frames) / frame_rate)?;
        let is_of_photos = paths.iter().all(|path| matches!(path.kind, PlanPathKind::Photos { .. }));
        let rig = match rig {
            PlanRig::Photos if !is_of_photos => PlanRig::Camera { size: (1200, 800), fov: 50.0 },
            other => other,
        };
        let sensors = match &rig {
            PlanRig::Rig(rig) => {
                let readings = |rate: f64| (rate / frame_rate).ceil() as usize;
                if let Some(slow) = rig.sensors.iter().find(|sensor| sensor.rate < frame_rate * (1.0 - 1e-9))
                {
                    let says = format!(
                        "{frame_rate} Hz is faster than sensor \"{}\" of {} Hz: give at most its rate",
                        slow.name, slow.rate
                    );
                    return fault(None, "frame_rate", says);
                }
                rig.sensors.iter().map(|sensor| readings(sensor.rate)).sum()
            }
            PlanRig::Camera { .. } | PlanRig::Photos => 1,
        };
        let block = self.block.unwrap_or((DEFAULT_BLOCK_READINGS / sensors.max(1)).max(1) as u32);
        if block == 0 || block > 100_000 {
            return fault(None, "block", format!("{block}: it must be from 1 to 100,000 frames"));
        }
        let start = match &self.start {
            None => DEFAULT_START_S,
            Some(time) => seconds_of(time).map_err(|says| PlanFault::new(None, "start", says))?,
        };
        let picture = match &self.picture {
            None => PictureFormat::Png,
            Some(text) => text.parse().map_err(|says: String| PlanFault::new(None, "picture", says))?,
        };
        let also = self.also.iter().map(|text| text.parse::<LayerFile>());
        let also = also.collect::<Result<Vec<_>, _>>().map_err(|says| PlanFault::new(None, "also", says))?;
        let (layouts, writes_frames) = self.layouts()?;
        if let Some(key) = ["picture", "also", "pairs"]
            .into_iter()
            .zip([self.picture.is_some(), !also.is_empty(), self.pairs])
            .find_map(|(key, is)| is.then_some(key))
            && !writes_frames
        {
            let says = format!("is of the layout {FRAMES_LAYOUT}, which is not among layouts");
            return fault(None, key, says);
        }
        let mut plan = BatchPlan {
            file: file.into(),
            name,
            about: self.about.split_whitespace().collect::<Vec<_>>().join(" "),
            seed: self.seed,
            frames,
            frame_rate,
            block,
            start,
            layouts,
            writes_frames,
            picture,
            also,
            pairs: self.pairs,
            labels: self.labels.clone(),
            splits: self.splits()?,
            scenes,
            paths,
            rig,
            weathers,
            digest: String::new(),
        };
        plan.digest = plan.own_digest(folder);
        Ok(plan)
    }

    fn scenes(&self, folder: &Path) -> Result<Vec<PlanScene>, PlanFault> {
        if self.scene.is_empty() {
            return fault(None, "scene", "the plan has no scene: give one or more [[scene]] with file");
        }
        let mut scenes: Vec<PlanScene> = Vec::new();
        for entry in &self.scene {
            let (at, entry) = (Some(entry.span().start), entry.get_ref());
            let stem = entry.file.file_stem().unwrap_or_default().to_string_lossy();
            let name = entry.name.clone().unwrap_or_else(|| slug(&stem));
            if !is_name(&name) {
                return fault(at, "scene name", format!("\"{name}\": {NAME_ADVICE}"));
            }
            if scenes.iter().any(|other| other.name.eq_ignore_ascii_case(&name)) {
                return fault(
                    at,
                    "scene name",
                    format!("there are two scenes \"{name}\": give each a name of its own"),
                );
            }
            let file = folder.join(&entry.file);
            if !file.exists() {
                return fault(at, "scene file", format!("{}: no such file or folder", file.display()));
            }
            let facts = Metadata {
                metres_per_unit: entry.metres_per_unit,
                up: entry.up.map(DVec3::from_array),
                ground: entry.ground,
                ..Metadata::default()
            };
            if let Some(says) = facts.fault() {
                return fault(at, "scene", says);
            }
            let memory = entry.memory.as_deref().map(parse_memory).transpose();
            let memory = memory.map_err(|says| PlanFault::new(at, "scene memory", says))?;
            if entry.splats == Some(0) {
                return fault(at, "scene splats", "a frame has one splat or more");
            }
            let memory = memory.unwrap_or(LevelBudget::default().memory);
            let budget = LevelBudget { memory, splats: entry.splats };
            scenes.push(PlanScene { name, file, facts, budget });
        }
        Ok(scenes)
    }

    fn weathers(&self, folder: &Path) -> Result<Vec<WeatherSource>, PlanFault> {
        if self.weather.is_empty() {
            let says = "the plan has no weather: give one or more [[weather]] with from, grid or samples";
            return fault(None, "weather", says);
        }
        let find: FindWeather<'_> = &find_weather;
        let sources = self.weather.iter().map(|entry| {
            let at = Some(entry.span().start);
            entry.get_ref().source(folder, find).map_err(|(key, says)| PlanFault::new(at, key, says))
        });
        sources.collect()
    }

    fn rig(&self, folder: &Path) -> Result<(PlanRig, Option<f64>), PlanFault> {
        let Some(entry) = &self.rig else { return Ok((PlanRig::Photos, None)) };
        let (at, entry) = (Some(entry.span().start), entry.get_ref());
        if let Some(file) = &entry.file {
            if entry.size.is_some() || entry.fov.is_some() {
                return fault(at, "rig", "size and fov are those of the sensors in its file: leave them out");
            }
            let rig = Rig::read(&folder.join(file))
                .map_err(|error| PlanFault::new(at, "rig file", error.to_string()))?;
            let slowest = rig.sensors.iter().map(|sensor| sensor.rate).fold(f64::INFINITY, f64::min);
            return Ok((PlanRig::Rig(Box::new(rig)), Some(slowest)));
        }
        let [width, height] = entry.size.unwrap_or([1200, 800]);
        let fov = entry.fov.unwrap_or(50.0);
        let sides = 16..=wm_scene::camera::MAX_SIDE;
        if !sides.contains(&width)
            || !sides.contains(&height)
            || u64::from(width) * u64::from(height) > wm_scene::camera::MAX_PIXELS
        {
            return fault(at, "rig size", format!("{width}x{height}: a side has 16 to {} px", sides.end()));
        }
        if !FOV_RANGE_DEG.contains(&fov) {
            return fault(at, "rig fov", format!("{fov}: it must be 0.1 to 170 degrees"));
        }
        Ok((PlanRig::Camera { size: (width, height), fov }, None))
    }

    fn paths(&self, folder: &Path, scenes: &[PlanScene], seconds: f64) -> Result<Vec<PlanPath>, PlanFault> {
        if self.path.is_empty() {
            let kind = PlanPathKind::Motion(MotionSpec { seconds, ..MotionSpec::default() });
            return Ok(vec![PlanPath { name: "view".into(), scene: None, kind }]);
        }
        let mut paths: Vec<PlanPath> = Vec::new();
        for entry in &self.path {
            let (at, entry) = (Some(entry.span().start), entry.get_ref());
            let path = entry
                .path(folder, paths.len(), seconds)
                .map_err(|(key, says)| PlanFault::new(at, key, says))?;
            if let Some(scene) = &path.scene
                && !scenes.iter().any(|one| one.name == *scene)
            {
                let near = meant(scene, scenes.iter().map(|one| one.name.as_str()));
                return fault(at, "path scene", format!("there is no scene `{scene}`{near}"));
            }
            let is_same = |other: &PlanPath| {
                other.name.eq_ignore_ascii_case(&path.name)
                    && (other.scene.is_none() || path.scene.is_none() || other.scene == path.scene)
            };
            if paths.iter().any(is_same) {
                let says = format!("there are two paths \"{}\": give each a name of its own", path.name);
                return fault(at, "path name", says);
            }
            paths.push(path);
        }
        if let Some(lonely) = scenes.iter().find(|scene| {
            paths.iter().all(|path| path.scene.as_ref().is_some_and(|name| *name != scene.name))
        }) {
            return fault(None, "path", format!("scene \"{}\" has no path", lonely.name));
        }
        Ok(paths)
    }

    fn layouts(&self) -> Result<(Vec<&'static Layout>, bool), PlanFault> {
        let Some(names) = &self.layouts else { return Ok((Vec::new(), true)) };
        let wrong = |says: String| fault(None, "layouts", says);
        if names.is_empty() {
            return wrong("the list is empty: leave it out for the program's own".into());
        }
        let mut found: Vec<&'static Layout> = Vec::new();
        let mut writes_frames = false;
        for name in names {
            if name == FRAMES_LAYOUT {
                writes_frames = true;
                continue;
            }
            let all = || LAYOUTS.iter().map(|layout| layout.name).chain([FRAMES_LAYOUT]);
            let Some(layout) = LAYOUTS.iter().find(|layout| layout.name == name) else {
                let near = meant(name, all());
                let all: Vec<&str> = all().collect();
                return wrong(format!(
                    "there is no layout `{name}`{near}; the layouts are {}",
                    all.join(", ")
                ));
            };
            if found.iter().any(|other| other.name == name) {
                return wrong(format!("`{name}` is there twice"));
            }
            found.push(layout);
        }
        Ok((found, writes_frames))
    }

    fn splits(&self) -> Result<Vec<(String, f64)>, PlanFault> {
        if self.splits.is_empty() {
            return Ok(vec![("train".into(), 1.0)]);
        }
        let wrong = |says: String| fault(None, "splits", says);
        for (name, share) in &self.splits {
            if !is_name(name) {
                return wrong(format!("\"{name}\": use letters, digits, - and _"));
            }
            if !(0.0..=1.0).contains(share) {
                return wrong(format!("{name} is {share}: it must be from 0 to 1"));
            }
        }
        let sum: f64 = self.splits.values().sum();
        if (sum - 1.0).abs() > 1e-6 {
            return wrong(format!("the shares sum to {sum}: they must sum to 1"));
        }
        Ok(self.splits.iter().map(|(name, share)| (name.clone(), *share)).collect())
    }
}

impl PathEntry {
    fn path(&self, folder: &Path, number: usize, seconds: f64) -> Result<PlanPath, (String, String)> {
        let wrong = |key: &str, says: String| Err((format!("path {key}"), says));
        let kind = match self.cameras.as_deref() {
            Some("capture") => {
                for (key, is_given) in [
                    ("camera", self.camera.is_some()),
                    ("path", self.path.is_some()),
                    ("distance", self.distance.is_some()),
                    ("speed", self.speed.is_some()),
                    ("seconds", self.seconds.is_some()),
                ] {
                    if is_given {
                        return wrong(key, "cameras of photos stand still: leave it out".into());
                    }
                }
                let every = self.every.unwrap_or(1);
                if every == 0 {
                    return wrong("every", "0: it must be at least 1".into());
                }
                PlanPathKind::Photos { every }
            }
            Some(other) => {
                return wrong("cameras", format!("`{other}`: use capture, for those of the photos"));
            }
            None => {
                if self.every.is_some() {
                    return wrong("every", "is for cameras = \"capture\"".into());
                }
                PlanPathKind::Motion(self.motion(folder, seconds)?)
            }
        };
        let name = self.name.clone().unwrap_or_else(|| match &kind {
            PlanPathKind::Photos { .. } => "photo".into(),
            PlanPathKind::Motion(_) if number == 0 => "path".into(),
            PlanPathKind::Motion(_) => format!("path-{}", number + 1),
        });
        if !is_name(&name) {
            return wrong("name", format!("\"{name}\": {NAME_ADVICE}"));
        }
        Ok(PlanPath { name, scene: self.scene.clone(), kind })
    }

    fn motion(&self, folder: &Path, seconds: f64) -> Result<MotionSpec, (String, String)> {
        let wrong = |key: &str, says: String| Err((format!("path {key}"), says));
        let parsed = |key: &str, error: ViewError| (format!("path {key}"), error.to_string());
        let camera = self.camera.as_deref().map(str::parse).transpose();
        let camera = camera.map_err(|error| parsed("camera", error))?.map(|camera| match camera {
            CameraSpec::File(file) => CameraSpec::File(folder.join(file)),
            other => other,
        });
        let path = self.path.as_deref().map(str::parse).transpose();
        let path = path.map_err(|error| parsed("path", error))?.map(|path| match path {
            PathSpec::File(file) => PathSpec::File(folder.join(file)),
            other => other,
        });
        if let Some(distance) = self.distance
            && !(distance.is_finite() && distance > 0.0 && path == Some(PathSpec::Dolly))
        {
            return wrong("distance", format!("{distance}: it is the length of path = \"dolly\", above 0 m"));
        }
        if let Some(speed) = self.speed
            && !(speed.abs() <= 1000.0 && path.is_none())
        {
            return wrong(
                "speed",
                format!("{speed}: it is that of a rig without path, from -1000 to 1000 m/s"),
            );
        }
        let seconds = self.seconds.unwrap_or(seconds);
        if !(seconds > 0.0 && seconds <= 1e6) {
            return wrong("seconds", format!("{seconds}: it must be above 0"));
        }
        Ok(MotionSpec { camera, path, distance: self.distance, speed: self.speed, seconds })
    }
}

/// Finds a weather of a plan: a preset, a file beside it, or a report.
fn find_weather(name: &str, folder: &Path) -> Result<Weather, String> {
    let mut weather = wm_reports::find_weather(name, folder).map_err(|error| error.to_string())?.weather;
    weather.load_images(read_panorama).map_err(|error| error.to_string())?;
    if weather.fidelity == Fidelity::Paper {
        return Err(format!(
            "`{name}` has fidelity paper, which is no weather in physical units: use physical"
        ));
    }
    Ok(weather)
}

/// Seconds since 1970 of a date and time; without an offset it is UTC.
fn seconds_of(time: &toml::value::Datetime) -> Result<i64, String> {
    let date = time.date.as_ref().ok_or("a time without a date: give both, as in 2026-01-31T08:00:00Z")?;
    let (year, month, day) = (i64::from(date.year), i64::from(date.month), i64::from(date.day));
    if !(1980..=2200).contains(&year) {
        return Err(format!("year {year}: give one from 1980 to 2200"));
    }
    let clock = time.time.as_ref().map_or(0, |time| {
        i64::from(time.hour) * 3600 + i64::from(time.minute) * 60 + i64::from(time.second.unwrap_or(0))
    });
    let offset = match time.offset {
        Some(toml::value::Offset::Custom { minutes }) => i64::from(minutes) * 60,
        _ => 0,
    };
    Ok(days(year, month, day) * 86_400 + clock - offset)
}
