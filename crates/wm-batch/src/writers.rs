//! Writes the readings of a block in all layouts of a plan, on a thread of its own.

use super::plan::{BatchPlan, FRAMES_LAYOUT};
use super::shots::{ActivePart, ReadingBuffer};
use super::store::BlockFiles;
use super::summary::{is_shown, thumbnail};
use crate::{BlockInfo, BlockWriter, PictureReading, ReadingData, ReadingInfo, SensorReading, SetInfo};
use std::path::Path;
use std::time::{Duration, Instant};
use wm_image::PictureSize;
use wm_image::png::{DepthScale, write_rgb8};
use wm_place::output::{PictureStyle, beside};
use wm_place::rig::Rig;
use wm_place::sensor::SensorData;
use wm_place::{Picture, Result};

/// The depth that 16-bit depths of all scenes reach, m: one scale for the whole set.
const MAX_DEPTH_M: f64 = 500.0;
/// Clips of single frames in a folder.
const CLIPS_PER_FOLDER: u64 = 1000;

/// The set that a block belongs to, for its writers.
#[derive(Clone, Copy)]
pub(crate) struct WriterTarget<'a> {
    /// The plan.
    pub(crate) plan: &'a BatchPlan,
    /// The set.
    pub(crate) set: &'a SetInfo,
    /// The sensors.
    pub(crate) rig: &'a Rig,
    /// The number of clips of the set.
    pub(crate) clips: u64,
}

/// The writers of a block.
pub(crate) struct BlockWriters<'a> {
    target: WriterTarget<'a>,
    parts: &'a [ActivePart],
    files: &'a mut BlockFiles,
    /// The part that is being written, and its writers, one for each layout.
    open: Option<(usize, Vec<Box<dyn BlockWriter + 'a>>)>,
    spent: Duration,
}

/// The files of a reading in the program's own layout, from the folder of the set: the picture or
/// the points, the layers beside a picture, and the same view without weather.
pub(crate) fn frame_files(
    plan: &BatchPlan,
    rig: &Rig,
    number: u64,
    name: &str,
    info: &ReadingInfo,
) -> Vec<String> {
    let sensor = &rig.sensors[info.sensor];
    let extension = sensor.device.extension().unwrap_or_else(|| plan.picture.extension());
    let path = if plan.frames == 1 && info.index == 0 {
        // A folder for each of a million clips would be slow to list.
        format!("{FRAMES_LAYOUT}/{:05}/{}/{number:08}.{extension}", number / CLIPS_PER_FOLDER, sensor.name)
    } else {
        format!("{FRAMES_LAYOUT}/{name}/{}/{:06}.{extension}", sensor.name, info.index)
    };
    let mut files = vec![path];
    if sensor.device.camera().is_some() {
        let layers =
            plan.also.iter().map(|also| PictureStyle::path_of(*also, plan.picture, Path::new(&files[0])));
        let layers: Vec<String> = layers.map(|path| path.to_string_lossy().into_owned()).collect();
        files.extend(layers);
        files.extend(plan.pairs.then(|| clear_path(&files[0])));
    }
    files
}

/// The file of the same view without weather.
fn clear_path(path: &str) -> String {
    beside(Path::new(path), "clear", "png").to_string_lossy().into_owned()
}

impl<'a> BlockWriters<'a> {
    /// Begins the files of a block.
    pub(crate) fn new(target: WriterTarget<'a>, parts: &'a [ActivePart], files: &'a mut BlockFiles) -> Self {
        Self { target, parts, files, open: None, spent: Duration::ZERO }
    }

    /// Writes reading `index` of a part, in order.
    ///
    /// # Errors
    /// A file cannot be written.
    pub(crate) fn write(&mut self, part: usize, index: usize, buffer: &ReadingBuffer) -> Result<()> {
        let started = Instant::now();
        let WriterTarget { plan, set, clips, .. } = self.target;
        let active = &self.parts[part];
        if self.open.as_ref().is_none_or(|(open, _)| *open != part) {
            self.close()?;
            let own =
                BlockInfo { set, clip: &active.info, number: active.part.number, readings: &active.readings };
            self.open = Some((part, plan.layouts.iter().map(|layout| (layout.block)(own)).collect()));
        }
        let info = active.readings[index];
        let data = data_of(buffer);
        if let (Some((_, writers)), Some(data)) = (&mut self.open, data) {
            let reading = SensorReading { info, data };
            for (layout, writer) in plan.layouts.iter().zip(writers) {
                writer.write(&reading, &mut self.files.layout(layout.name))?;
            }
        }
        if plan.writes_frames {
            self.own(active, &info, buffer)?;
        }
        // The first picture of the clip, in its first block: a camera may begin later. Buffers of
        // other sensors may hold an old one.
        let is_camera = |sensor: usize| self.target.rig.sensors[sensor].device.camera().is_some();
        let first = active.readings.iter().find(|other| other.index == 0 && is_camera(other.sensor));
        if first == Some(&info)
            && active.part.number == 0
            && is_shown(active.info.number, clips)
            && let Some(Picture { frame, .. }) = buffer.picture()
        {
            let (path, bytes) = thumbnail(active.info.number, &buffer.rgb, frame.width, frame.height)?;
            self.files.bytes_of(&path, &bytes)?;
        }
        self.spent += started.elapsed();
        Ok(())
    }

    /// Writes the program's own files of a reading.
    fn own(&mut self, active: &ActivePart, info: &ReadingInfo, buffer: &ReadingBuffer) -> Result<()> {
        let WriterTarget { plan, rig, .. } = self.target;
        let files = frame_files(plan, rig, active.info.number, &active.info.name, info);
        let style = PictureStyle {
            also: plan.also.clone(),
            depth_scale: DepthScale::reaching(MAX_DEPTH_M),
            ..PictureStyle::default()
        };
        buffer.reading.save(&self.files.path(&files[0])?, &style)?;
        if let Some(Picture { frame, .. }) = buffer.picture().filter(|_| plan.pairs) {
            let size = PictureSize::new(frame.width, frame.height);
            write_rgb8(&self.files.path(&clear_path(&files[0]))?, &buffer.clear, size, &[])?;
        }
        files.iter().try_for_each(|file| self.files.add(file))
    }

    fn close(&mut self) -> Result<()> {
        let Some((_, writers)) = self.open.take() else { return Ok(()) };
        for (layout, writer) in self.target.plan.layouts.iter().zip(writers) {
            writer.finish(&mut self.files.layout(layout.name))?;
        }
        Ok(())
    }

    /// Writes what is left; returns the time that writing took.
    ///
    /// # Errors
    /// A file cannot be written.
    pub(crate) fn finish(mut self) -> Result<Duration> {
        let started = Instant::now();
        self.close()?;
        Ok(self.spent + started.elapsed())
    }
}

/// The data of a reading for layouts; `None` if they have no room for it.
fn data_of(buffer: &ReadingBuffer) -> Option<ReadingData<'_>> {
    match &buffer.reading {
        SensorData::Picture(picture) => Some(ReadingData::Picture(PictureReading {
            rgb: &buffer.rgb,
            clean: (!buffer.clear.is_empty()).then_some(&buffer.clear[..]),
            depth: (!buffer.depth.is_empty()).then_some(&buffer.depth[..]),
            flow: Some(&picture.flow.vectors[..]).filter(|flow| !flow.is_empty()),
            flow_states: Some(&picture.flow.states[..]).filter(|states| !states.is_empty()),
        })),
        SensorData::Points(_) => Some(ReadingData::Points(&buffer.points)),
        SensorData::Detections(_) => Some(ReadingData::Detections(&buffer.detections)),
        _ => None,
    }
}
