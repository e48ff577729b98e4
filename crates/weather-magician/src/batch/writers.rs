//! Writes the readings of a block in all layouts of a plan, on a thread of its own.

use super::plan::{BatchPlan, FRAMES_LAYOUT};
use super::shots::{ActivePart, ReadingBuffer};
use super::store::BlockFiles;
use super::summary::{is_shown, thumbnail};
use crate::Result;
use crate::output::{PictureStyle, beside};
use crate::rig::{Rig, RigDevice};
use std::path::Path;
use std::time::{Duration, Instant};
use wm_datasets::{BlockInfo, BlockWriter, PictureReading, ReadingData, ReadingInfo, SensorReading, SetInfo};
use wm_media::PictureSize;
use wm_media::png::{DepthScale, write_rgb8};

/// The depth that 16-bit depths of all scenes reach, m: one scale for the whole set.
const FARTHEST: f64 = 500.0;
/// Clips of single frames in a folder.
const GROUP: u64 = 1000;

/// What is written, and for whom.
#[derive(Clone, Copy)]
pub struct WriterTarget<'a> {
    /// The plan.
    pub plan: &'a BatchPlan,
    /// The set.
    pub set: &'a SetInfo,
    /// The sensors.
    pub rig: &'a Rig,
    /// The scale of the scene.
    pub metres: f64,
    /// The number of clips of the set.
    pub clips: u64,
}

/// The writers of a block.
pub struct BlockWriters<'a> {
    target: WriterTarget<'a>,
    parts: &'a [ActivePart],
    files: &'a mut BlockFiles,
    /// The part that is being written, and its writers, one for each layout.
    open: Option<(usize, Vec<Box<dyn BlockWriter + 'a>>)>,
    spent: Duration,
}

/// The file of a reading in the program's own layout, from the folder of the set.
#[must_use]
pub fn frame_path(plan: &BatchPlan, rig: &Rig, (number, name): (u64, &str), info: &ReadingInfo) -> String {
    let sensor = &rig.sensors[info.sensor];
    let extension = match &sensor.device {
        RigDevice::Camera { .. } => plan.picture.extension(),
        RigDevice::Lidar { format, .. } => format.extension(),
        RigDevice::Radar { format, .. } => format.extension(),
    };
    if plan.frames == 1 && info.index == 0 {
        // A folder for each of a million clips would be slow to list.
        return format!("{FRAMES_LAYOUT}/{:05}/{}/{number:08}.{extension}", number / GROUP, sensor.name);
    }
    format!("{FRAMES_LAYOUT}/{name}/{}/{:06}.{extension}", sensor.name, info.index)
}

/// The file of the same view without weather.
#[must_use]
pub fn clear_path(path: &str) -> String {
    beside(Path::new(path), "clear", "png").to_string_lossy().into_owned()
}

impl<'a> BlockWriters<'a> {
    /// Begins the files of a block.
    pub fn new(target: WriterTarget<'a>, parts: &'a [ActivePart], files: &'a mut BlockFiles) -> Self {
        Self { target, parts, files, open: None, spent: Duration::ZERO }
    }

    /// Writes reading `index` of a part, in order.
    ///
    /// # Errors
    /// A file cannot be written.
    pub fn write(&mut self, part: usize, index: usize, buffer: &ReadingBuffer) -> Result<()> {
        let started = Instant::now();
        let WriterTarget { plan, set, clips, .. } = self.target;
        let active = &self.parts[part];
        if self.open.as_ref().is_none_or(|(open, _)| *open != part) {
            self.close()?;
            let own =
                BlockInfo { set, clip: &active.info, number: active.part.number, readings: &active.readings };
            self.open = Some((part, plan.layouts.iter().map(|layout| layout.block(own)).collect()));
        }
        let info = active.readings[index];
        let reading = SensorReading { info, data: self.data(&info, buffer) };
        if let Some((_, writers)) = &mut self.open {
            for (layout, writer) in plan.layouts.iter().zip(writers) {
                writer.write(&reading, &mut self.files.layout(layout.name()))?;
            }
        }
        if plan.writes_frames {
            self.own(active, &info, buffer)?;
        }
        if info.sensor == 0
            && info.frame == 0
            && !buffer.rgb.is_empty()
            && is_shown(active.info.number, clips)
        {
            let size = (buffer.picture.frame.width, buffer.picture.frame.height);
            let (path, bytes) = thumbnail(active.info.number, &buffer.rgb, size)?;
            self.files.bytes_of(&path, &bytes)?;
        }
        self.spent += started.elapsed();
        Ok(())
    }

    fn data<'d>(&self, info: &ReadingInfo, buffer: &'d ReadingBuffer) -> ReadingData<'d> {
        let some = |values: &'d [u8]| (!values.is_empty()).then_some(values);
        match &self.target.rig.sensors[info.sensor].device {
            RigDevice::Camera { .. } => ReadingData::Picture(PictureReading {
                rgb: &buffer.rgb,
                clean: some(&buffer.clean),
                depth: (!buffer.depth.is_empty()).then_some(&buffer.depth[..]),
                flow: Some(&buffer.picture.flow.vectors[..]).filter(|flow| !flow.is_empty()),
                flow_states: some(&buffer.picture.flow.states),
            }),
            RigDevice::Lidar { .. } => ReadingData::Points(&buffer.points),
            RigDevice::Radar { .. } => ReadingData::Detections(&buffer.detections),
        }
    }

    /// Writes the program's own files of a reading.
    fn own(&mut self, active: &ActivePart, info: &ReadingInfo, buffer: &ReadingBuffer) -> Result<()> {
        let WriterTarget { plan, rig, metres, .. } = self.target;
        let path = frame_path(plan, rig, (active.info.number, &active.info.name), info);
        let staged = self.files.path(&path)?;
        match &rig.sensors[info.sensor].device {
            RigDevice::Camera { .. } => {
                let style = PictureStyle {
                    also: plan.also.clone(),
                    metres_per_unit: metres,
                    depth_scale: DepthScale::reaching(FARTHEST),
                    ..PictureStyle::default()
                };
                style.write(&buffer.picture, &staged)?;
                self.files.add(&path)?;
                if plan.pairs {
                    let frame = &buffer.picture.frame;
                    let (size, clear) = (PictureSize::new(frame.width, frame.height), clear_path(&path));
                    write_rgb8(&self.files.path(&clear)?, &buffer.clean, size, &[])?;
                    self.files.add(&clear)?;
                }
                for also in &plan.also {
                    let beside = PictureStyle::path_of(*also, plan.picture, Path::new(&path));
                    self.files.add(&beside.to_string_lossy())?;
                }
            }
            RigDevice::Lidar { .. } => {
                if let Some(sweep) = &buffer.sweep {
                    sweep.save(&staged)?;
                    self.files.add(&path)?;
                }
            }
            RigDevice::Radar { .. } => {
                if let Some(sweep) = &buffer.radar {
                    sweep.save(&staged)?;
                    self.files.add(&path)?;
                }
            }
        }
        Ok(())
    }

    fn close(&mut self) -> Result<()> {
        let Some((_, writers)) = self.open.take() else { return Ok(()) };
        for (layout, writer) in self.target.plan.layouts.iter().zip(writers) {
            writer.finish(&mut self.files.layout(layout.name()))?;
        }
        Ok(())
    }

    /// Writes what is left; returns the time that writing took.
    ///
    /// # Errors
    /// A file cannot be written.
    pub fn finish(mut self) -> Result<Duration> {
        let started = Instant::now();
        self.close()?;
        Ok(self.spent + started.elapsed())
    }
}
