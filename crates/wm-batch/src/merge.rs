//! The end of a set: what lacks, the tables of the layouts, and the manifest.

use super::run::BatchRun;
use super::store::{BatchStore, BlockMarker, MarkedFile, TableFiles, digest_of};
use super::summary::SetSummary;
use super::writers::frame_files;
use crate::{ClipInfo, ClipRecord, ReadingInfo, SensorInfoKind, SetError};
use serde_json::{Value as Json, json};
use std::collections::{BTreeMap, BTreeSet};
use std::io::Write;
use std::path::Path;
use wm_base::FormatError;
use wm_base::files::{WriteFault, write_atomically, write_whole};
use wm_place::{Error, Progress, Result};

/// The file that describes a set.
pub const MANIFEST: &str = "manifest.json";
/// The file with a row for each frame.
pub const FRAMES: &str = "frames.jsonl";
/// The file with a row for each clip.
pub(crate) const CLIPS: &str = "clips.jsonl";

/// The outcome of a merge.
#[derive(Clone, Debug)]
pub struct MergedSet {
    /// Clips, frames and readings.
    pub counts: [u64; 3],
    /// Bytes of all files.
    pub bytes: u64,
    /// Doubts, in words.
    pub warnings: Vec<String>,
}

/// The blocks that are not done.
///
/// # Errors
/// As [`BatchStore::marker`].
pub fn missing_blocks(run: &BatchRun, store: &BatchStore) -> Result<Vec<u64>> {
    let mut missing = Vec::new();
    for block in 0..run.clips.blocks() {
        if store.marker(block, &run.plan.digest)?.is_none() {
            missing.push(block);
        }
    }
    Ok(missing)
}

/// Numbers as runs: `0-3, 7, 9-10`.
#[must_use]
pub fn runs_of(numbers: &[u64]) -> String {
    let runs = numbers.chunk_by(|a, b| a + 1 == *b).map(|run| match run {
        [one] => one.to_string(),
        [first, .., last] => format!("{first}-{last}"),
        [] => String::new(),
    });
    runs.collect::<Vec<_>>().join(", ")
}

/// Writes the tables of all layouts, the rows of clips and frames, the summary and the manifest.
/// Files are looked for by name and length; with `verify` their hashes are compared too.
///
/// # Errors
/// [`Error::Unsupported`] with what lacks; errors of the disk.
pub fn merge(
    run: &BatchRun,
    store: &BatchStore,
    verify: bool,
    progress: &mut dyn Progress,
) -> Result<MergedSet> {
    let missing = missing_blocks(run, store)?;
    if !missing.is_empty() {
        return Err(Error::Unsupported(format!(
            "{}: {} of {} blocks are missing: {}; run `batch {}` again, which makes them",
            store.folder().display(),
            missing.len(),
            run.clips.blocks(),
            runs_of(&missing),
            run.plan.file
        )));
    }
    let mut rows = SetRows::new(run, store, verify);
    let (frames_file, clips_file) = (store.folder().join(FRAMES), store.folder().join(CLIPS));
    progress.begin("blocks", Some(run.clips.blocks()));
    write_rows(&frames_file, &mut |frames| {
        write_rows(&clips_file, &mut |clips| {
            for block in 0..run.clips.blocks() {
                rows.block(block, frames, clips)?;
                progress.advance(1);
            }
            Ok(())
        })
    })?;
    let SetRows { mut merged, summary, renderers, scenes, lacking, .. } = rows;
    progress.end();
    if let Some(first) = lacking.first() {
        return Err(Error::Unsupported(format!(
            "{} files are not as they were made, the first {first}; remove the markers of their blocks in done/ and run the plan again",
            lacking.len()
        )));
    }
    if renderers.len() > 1 {
        let all: Vec<&str> = renderers.iter().map(String::as_str).collect();
        merged.warnings.push(format!(
            "blocks were drawn by different arithmetic: {}; their last bits may differ",
            all.join("; ")
        ));
    }
    for (scene, hashes) in &scenes {
        if hashes.len() > 1 {
            return Err(Error::Unsupported(format!(
                "scene \"{scene}\" changed while the set was made: remove done/ and run the plan again"
            )));
        }
    }
    let mut tables: Vec<MarkedFile> = Vec::new();
    for layout in &run.plan.layouts {
        let mut files = TableFiles { folder: store.folder(), name: layout.name, files: Vec::new() };
        let mut records = ClipRecords { run, store, block: 0, waiting: Vec::new(), open: None };
        (layout.tables)(&run.set, &mut records, &mut files)?;
        tables.append(&mut files.files);
    }
    merged.bytes += tables.iter().map(|file| file.bytes).sum::<u64>();
    let manifest = manifest(run, &merged, &renderers, &scenes);
    write_text(
        &store.folder().join(MANIFEST),
        &format!("{}\n", serde_json::to_string_pretty(&manifest).unwrap_or_default()),
    )?;
    summary.write(store.folder())?;
    store.clean();
    Ok(merged)
}

/// Rows of a file, each a line.
struct Rows<'a> {
    path: &'a Path,
    out: &'a mut dyn Write,
}

impl Rows<'_> {
    fn write(&mut self, row: &Json) -> Result<()> {
        let fault = |error: std::io::Error| FormatError::whole(self.path, WriteFault::from(error).into());
        Ok(writeln!(self.out, "{row}").map_err(fault)?)
    }
}

/// Writes a file of rows, whole or not at all.
fn write_rows(path: &Path, write: &mut dyn FnMut(&mut Rows<'_>) -> Result<()>) -> Result<()> {
    let fault = |fault: WriteFault| Error::from(FormatError::whole(path, fault.into()));
    write_whole(path, fault, |out| write(&mut Rows { path, out }))
}

/// The rows of a set and the counts over them.
struct SetRows<'a> {
    run: &'a BatchRun,
    store: &'a BatchStore,
    verify: bool,
    merged: MergedSet,
    summary: SetSummary,
    renderers: BTreeSet<String>,
    /// Hashes of the file of each scene.
    scenes: BTreeMap<String, BTreeSet<String>>,
    /// Files that are not as they were made.
    lacking: Vec<String>,
    /// The last clip that has a row.
    last: Option<u64>,
}

impl<'a> SetRows<'a> {
    fn new(run: &'a BatchRun, store: &'a BatchStore, verify: bool) -> Self {
        Self {
            run,
            store,
            verify,
            merged: MergedSet { counts: [0; 3], bytes: 0, warnings: Vec::new() },
            summary: SetSummary::new(&run.plan, run.clips.clips()),
            renderers: BTreeSet::new(),
            scenes: BTreeMap::new(),
            lacking: Vec::new(),
            last: None,
        }
    }

    /// Adds the rows of a block.
    fn block(&mut self, number: u64, frames: &mut Rows<'_>, clips: &mut Rows<'_>) -> Result<()> {
        let marker = marker_of(self.run, self.store, number)?;
        for file in &marker.files {
            self.lacking.extend(check_file(self.store.folder(), file, self.verify));
            self.merged.bytes += file.bytes;
        }
        let files = marker.files.iter().map(|file| (file.path.as_str(), file)).collect();
        for marked in &marker.clips {
            let clip = marked.clip();
            if self.last.replace(clip.number) != Some(clip.number) {
                self.merged.counts[0] += 1;
                self.summary.add(&clip, &marked.variables);
                clips.write(&clip_row(&clip, marked.at, &marked.variables))?;
            }
            for own in marked.readings.chunk_by(|a, b| a.frame == b.frame) {
                self.merged.counts[1] += u64::from(own.iter().any(|info| info.is_key));
                self.merged.counts[2] += own.len() as u64;
                frames.write(&frame_row(self.run, &clip, own, &files))?;
            }
        }
        self.renderers.insert(marker.renderer);
        self.scenes.entry(marker.scene).or_default().insert(marker.scene_sha256);
        Ok(())
    }
}

/// The marker of a block that is done.
fn marker_of(run: &BatchRun, store: &BatchStore, block: u64) -> Result<BlockMarker> {
    let marker = store.marker(block, &run.plan.digest)?;
    marker.ok_or_else(|| {
        Error::Unsupported(format!("{}: the marker of block {block} is gone", store.folder().display()))
    })
}

fn write_text(path: &Path, text: &str) -> Result<()> {
    Ok(write_atomically(path, |out| Ok(out.write_all(text.as_bytes())?))?)
}

/// A file's fault.
fn check_file(folder: &Path, file: &MarkedFile, verify: bool) -> Option<String> {
    let path = folder.join(&file.path);
    match std::fs::metadata(&path) {
        Err(_) => Some(format!("{} is gone", path.display())),
        Ok(about) if about.len() != file.bytes => Some(format!("{} has another length", path.display())),
        Ok(_) if verify => match digest_of(&path) {
            Ok((_, hash)) if hash == file.sha256 => None,
            _ => Some(format!("{} has other bytes", path.display())),
        },
        Ok(_) => None,
    }
}

/// The clips of all blocks in order, each whole.
struct ClipRecords<'a> {
    run: &'a BatchRun,
    store: &'a BatchStore,
    block: u64,
    waiting: Vec<ClipRecord>,
    open: Option<ClipRecord>,
}

impl ClipRecords<'_> {
    /// Reads the next block.
    fn read(&mut self) -> Result<()> {
        let marker = marker_of(self.run, self.store, self.block)?;
        self.block += 1;
        for marked in marker.clips {
            let (clip, readings) = (marked.clip(), marked.readings);
            match &mut self.open {
                Some(open) if open.clip.number == clip.number => open.readings.extend(readings),
                open => self.waiting.extend(open.replace(ClipRecord { clip, readings })),
            }
        }
        Ok(())
    }
}

impl Iterator for ClipRecords<'_> {
    type Item = Result<ClipRecord, SetError>;

    fn next(&mut self) -> Option<Self::Item> {
        while self.waiting.is_empty() {
            if self.block >= self.run.clips.blocks() {
                return self.open.take().map(Ok);
            }
            if let Err(error) = self.read() {
                return Some(Err(SetError::Clips(error.to_string())));
            }
        }
        Some(Ok(self.waiting.remove(0)))
    }
}

/// A row of [`CLIPS`].
fn clip_row(clip: &ClipInfo, at: f64, variables: &BTreeMap<String, f64>) -> Json {
    let weather = &clip.weather;
    json!({
        "clip": clip.number,
        "name": clip.name,
        "split": clip.split,
        "start_ns": clip.start,
        "seconds": clip.seconds,
        "scene": clip.place.name,
        "weather": {
            "name": weather.name,
            "condition": weather.condition.name(),
            "mor": weather.mor.is_finite().then_some(weather.mor),
            "rain_rate": weather.rain_rate,
            "snow_rate": weather.snow_rate,
            "is_night": weather.is_night,
            "at": at,
            "variables": variables,
            "file": weather.file,
        },
    })
}

/// A row of [`FRAMES`].
fn frame_row(
    run: &BatchRun,
    clip: &ClipInfo,
    readings: &[ReadingInfo],
    files: &BTreeMap<&str, &MarkedFile>,
) -> Json {
    let (plan, rig) = (&run.plan, &run.rig);
    let frame = clip.number * u64::from(plan.frames) + u64::from(readings[0].frame);
    let row = |info: &ReadingInfo| {
        let pose = info.world_from_sensor(&run.set);
        let (t, q) = (pose.translation, pose.rotation);
        let own = if plan.writes_frames {
            frame_files(plan, rig, clip.number, &clip.name, info)
        } else {
            Vec::new()
        };
        let files: Vec<Json> = own
            .iter()
            .filter_map(|path| files.get(path.as_str()))
            .map(|file| json!({ "path": file.path, "bytes": file.bytes, "sha256": file.sha256 }))
            .collect();
        json!({
            "sensor": run.set.sensors[info.sensor].name,
            "index": info.index,
            "is_key": info.is_key,
            "time": info.time,
            "timestamp_ns": info.timestamp(clip),
            "world_from_sensor": { "translation": [t.x, t.y, t.z], "quaternion": [q.w, q.x, q.y, q.z] },
            "files": files,
        })
    };
    json!({
        "frame": frame,
        "clip": clip.number,
        "index": readings[0].frame,
        "readings": readings.iter().map(row).collect::<Vec<_>>(),
    })
}

/// The manifest.
fn manifest(
    run: &BatchRun,
    merged: &MergedSet,
    renderers: &BTreeSet<String>,
    scenes: &BTreeMap<String, BTreeSet<String>>,
) -> Json {
    let sensors: Vec<Json> = run.set.sensors.iter().map(sensor_row).collect();
    let scenes: Vec<Json> = run
        .plan
        .scenes
        .iter()
        .map(|scene| {
            let hash = scenes.get(&scene.name).and_then(|hashes| hashes.first());
            json!({ "name": scene.name, "file": scene.file.file_name().map(|name| name.to_string_lossy()), "sha256": hash })
        })
        .collect();
    let [clips, frames, readings] = merged.counts;
    json!({
        "name": run.plan.name,
        "about": run.set.about,
        "program": run.set.program,
        "plan_sha256": run.plan.digest,
        "seed": run.plan.seed,
        "renderers": renderers,
        "scenes": scenes,
        "sensors": sensors,
        "layouts": run.plan.layouts.iter().map(|layout| layout.name).chain(run.plan.writes_frames.then_some("frames")).collect::<Vec<_>>(),
        "clips": clips,
        "frames": frames,
        "readings": readings,
        "frame_rate": run.plan.frame_rate,
        "bytes": merged.bytes,
        "boxes": "none: nothing moves in the scenes",
        "units": {
            "world": "m; z up, 0 at the ground; x east and y north where north is known",
            "sensor": "rigs, lidars and radars: x forward, y left, z up; cameras: x right, y down, z forward",
            "quaternion": "w, x, y, z",
            "intrinsics": "px, the centre of the first pixel at 0.5, 0.5",
            "mor": "m, where 5 % of light is left",
            "rain_rate": "mm/h",
            "snow_rate": "mm/h of water",
            "time": "s since the start of the clip",
            "at": "s, the time of the weather at which the clip begins",
        },
    })
}

fn sensor_row(sensor: &crate::SensorInfo) -> Json {
    let (t, q) = (sensor.rig_from_sensor.translation, sensor.rig_from_sensor.rotation);
    let mut row = json!({
        "name": sensor.name,
        "kind": sensor.kind.name(),
        "rate": sensor.rate,
        "rig_from_sensor": { "translation": [t.x, t.y, t.z], "quaternion": [q.w, q.x, q.y, q.z] },
    });
    match &sensor.kind {
        SensorInfoKind::Camera(camera) => {
            row["intrinsics"] = json!({
                "width": camera.size.0, "height": camera.size.1,
                "fx": camera.focal[0], "fy": camera.focal[1], "cx": camera.center[0], "cy": camera.center[1],
            });
            row["lens"] = camera.lens.map(|lens| format!("{lens:?}")).into();
        }
        SensorInfoKind::Lidar { model, rings } => {
            row["model"] = model.as_str().into();
            row["rings"] = (*rings).into();
        }
        SensorInfoKind::Radar { model } => row["model"] = model.as_str().into(),
        SensorInfoKind::Other { .. } => {}
    }
    row
}
