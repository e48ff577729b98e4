//! A driving log as a capture: a folder that every reader of captures and of priors reads.
//!
//! | file | contents |
//! |---|---|
//! | `transforms.json` | cameras, with the log's own photos by their paths |
//! | `points.ply` | points of the sweeps without movers, coloured |
//! | `masks/*.png` | black where something moves, for the photos that show such |
//! | `depth/PHOTO.npy` | view z of the lidar's points, m, 0 where there is none, of the photo without its lens |
//! | `sky/PHOTO.png` | white in the sky, if the log says where it is, of the photo without its lens |
//! | `facts.toml` | scale, up, north, place and time |
//! | `log.json` | what was read, the origin, warnings |

mod depth;
mod masks;
mod photo;
mod points;
mod write;

use super::log::{DrivingLog, LogPicture};
use super::records::Records;
use super::sweep::LogSweep;
use depth::LidarView;
use glam::DVec3;
use photo::Rgb;
use points::{BOX_MARGIN_SHARE, CleanSweep, VoxelCloud};
use serde::Serialize;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use wm_base::{FormatError, Problem};
use wm_scene::Metadata;

/// Options of making a capture of a log.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LogCaptureOptions {
    /// Most pixels of a depth map.
    pub depth_pixels: u32,
    /// True to go on without sweeps, labels and masks that are damaged; they are refused otherwise.
    pub skip_bad: bool,
}

impl Default for LogCaptureOptions {
    fn default() -> Self {
        Self { depth_pixels: 300_000, skip_bad: false }
    }
}

/// A step of writing a capture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LogCaptureStep {
    /// Sweeps are read.
    Sweeps {
        /// So many are done.
        done: usize,
        /// The number of all.
        total: usize,
    },
    /// Pictures are looked at.
    Pictures {
        /// So many are done.
        done: usize,
        /// The number of all.
        total: usize,
    },
}

/// The capture that was written.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LogCaptureSummary {
    /// The folder.
    pub folder: PathBuf,
    /// The log.
    pub source: PathBuf,
    /// The format of the log.
    pub format: String,
    /// The name of the log.
    pub name: String,
    /// Cameras.
    pub cameras: usize,
    /// Pictures.
    pub pictures: usize,
    /// Pictures with a mask.
    pub masks: usize,
    /// Pictures with a depth map.
    pub depth_maps: usize,
    /// Pictures with a sky mask.
    pub sky_masks: usize,
    /// Sweeps.
    pub sweeps: usize,
    /// Points.
    pub points: usize,
    /// Points that no picture shows; they are left out.
    pub unseen_points: usize,
    /// Tracks of movers, whose boxes are left out.
    pub movers: usize,
    /// The mean intensity of the points of the sweeps, 0-1, as the lidar has it: not a reflectance,
    /// which grows with distance.
    pub mean_intensity: Option<f64>,
    /// The world's origin in the log's own coordinates, m.
    pub origin: [f64; 3],
    /// Scale, up, north, place and time.
    #[serde(skip)]
    pub facts: Metadata,
    /// Warnings: parts that are missing or were left out, in words.
    pub warnings: Vec<String>,
}

impl LogCaptureSummary {
    /// The folder of the depth maps, for `priors --depth`; `None` if there are none.
    #[must_use]
    pub fn depth(&self) -> Option<PathBuf> {
        (self.depth_maps > 0).then(|| self.folder.join(DEPTH))
    }

    /// The folder of the sky masks, for `priors --sky`; `None` if there are none.
    #[must_use]
    pub fn sky(&self) -> Option<PathBuf> {
        (self.sky_masks > 0).then(|| self.folder.join(SKY))
    }
}

/// Side of a voxel, which keeps one point, m.
const VOXEL_SIZE_M: f64 = 0.07;
/// Points farther from the lidar are left out of the points, m; depth has all.
const MAX_POINT_RANGE_M: f64 = 100.0;
/// Most points; more are thinned out evenly.
const MAX_POINTS: usize = 3_000_000;
const TRANSFORMS: &str = "transforms.json";
const DEPTH: &str = "depth";
const SKY: &str = "sky";
const MASKS: &str = "masks";
/// Longest time between a picture and the sweep that gives its depth, ns.
const MAX_SWEEP_GAP_NS: u64 = 200_000_000;
/// Largest distance at which a picture colours points, m.
const MAX_COLOUR_DISTANCE_M: f64 = 80.0;

impl DrivingLog {
    /// Writes the log as a capture into a folder, which is made. `None` if `progress` said to stop.
    ///
    /// Photos that cannot be decoded are warnings: reading the capture tells of them.
    ///
    /// # Errors
    /// [`FormatError`] if a sweep or a mask of the log cannot be read, or a file of the capture
    /// cannot be written.
    pub fn write_capture(
        &self,
        folder: &Path,
        options: &LogCaptureOptions,
        progress: &mut dyn FnMut(LogCaptureStep) -> ControlFlow<()>,
    ) -> Result<Option<LogCaptureSummary>, FormatError> {
        make(folder)?;
        // What is being replaced is no capture until it is whole again.
        let transforms = folder.join(TRANSFORMS);
        if let Err(e) = std::fs::remove_file(&transforms)
            && e.kind() != std::io::ErrorKind::NotFound
        {
            return Err(FormatError::whole(&transforms, Problem::Write(e.into())));
        }
        let mut warnings = self.warnings.clone();
        let mut cloud = VoxelCloud::new(VOXEL_SIZE_M);
        let (mut intensities, mut count) = (0.0, 0u64);
        let mut records = Records::new(options.skip_bad);
        let mut sweeps = Vec::with_capacity(self.sweeps.len());
        for (done, sweep) in self.sweeps.iter().enumerate() {
            let clean = records.sound("sweeps", CleanSweep::read(self, sweep))?;
            // A download that failed leaves files without a byte.
            let is_empty = clean.as_ref().is_some_and(|clean| clean.is_empty);
            records.lost("sweeps have no points", usize::from(is_empty));
            sweeps.extend((clean.is_some() && !is_empty).then_some(sweep));
            let clean = clean.unwrap_or_default();
            records.lost("points of sweeps are not finite or over a kilometre away", clean.unusable);
            cloud.add(&clean, MAX_POINT_RANGE_M);
            intensities += clean.points.iter().map(|point| f64::from(point.intensity)).sum::<f64>();
            count += clean.points.len() as u64;
            if progress(LogCaptureStep::Sweeps { done: done + 1, total: self.sweeps.len() }).is_break() {
                return Ok(None);
            }
        }
        if cloud.is_full() {
            warnings.push(format!(
                "the sweeps cover more than {} voxels; later ones add no points",
                points::MAX_VOXELS
            ));
        }
        let mut points = cloud.points(MAX_POINTS);
        let mut frames = Frames {
            log: self,
            folder,
            options,
            frames: Vec::new(),
            warnings: Vec::new(),
            records,
            sweeps,
            sweep: None,
            lenses: Vec::new(),
            depth_maps: 0,
            masks: 0,
            sky_masks: 0,
        };
        // In the order of time, so that each sweep is read once.
        let mut order: Vec<usize> = (0..self.pictures.len()).collect();
        order.sort_by_key(|index| (self.pictures[*index].timestamp, *index));
        let mut bad = Vec::new();
        for (done, index) in order.into_iter().enumerate() {
            let picture = &self.pictures[index];
            let rgb = match Rgb::read(&picture.file, self.cameras[picture.camera].size) {
                Ok(rgb) => Some(rgb),
                Err(error) => {
                    bad.push(error.to_string());
                    None
                }
            };
            frames.add(index, picture, rgb.as_ref(), &mut points)?;
            if progress(LogCaptureStep::Pictures { done: done + 1, total: self.pictures.len() }).is_break() {
                return Ok(None);
            }
        }
        if let Some(first) = bad.first() {
            warnings.push(format!("{} of {} photos cannot be read: {first}", bad.len(), self.pictures.len()));
        }
        warnings.append(&mut frames.warnings);
        warnings.extend(frames.records.warnings());
        let all = points.len();
        // Without photos nothing is seen, and all is kept, grey.
        let unseen_points = if bad.len() == self.pictures.len() { 0 } else { points.drop_unseen() };
        if all > 0 && all == unseen_points {
            warnings.push(
                "no photo shows a point of the lidar: its poses or its calibration are wrong, perhaps".into(),
            );
        }
        let summary = LogCaptureSummary {
            folder: folder.into(),
            source: self.source.clone(),
            format: self.format.into(),
            name: self.name.clone(),
            cameras: self.cameras.len(),
            pictures: self.pictures.len(),
            masks: frames.masks,
            depth_maps: frames.depth_maps,
            sky_masks: frames.sky_masks,
            sweeps: frames.sweeps.len(),
            points: points.len(),
            unseen_points,
            movers: self.tracks.iter().filter(|track| track.is_mover).count(),
            mean_intensity: (count > 0).then(|| intensities / count as f64),
            origin: self.origin.to_array(),
            facts: self.facts(),
            warnings,
        };
        write::points(&folder.join("points.ply"), &points)?;
        write::facts(&folder.join("facts.toml"), &summary.facts)?;
        write::json(&folder.join("log.json"), &summary)?;
        // Last: without it the folder is no capture.
        frames.frames.sort_by_key(|(index, _)| *index);
        write::transforms(&transforms, frames.frames.into_iter().map(|(_, frame)| frame).collect())?;
        Ok(Some(summary))
    }

    /// The facts that the log states of the place.
    #[must_use]
    pub fn facts(&self) -> Metadata {
        let source = format!("the {} log", self.format);
        let (first, last) = self.span();
        let span = first.abs_diff(last) as f64 * 1e-9;
        let captured = self.captured.filter(|time| Metadata::TIME_RANGE_S.contains(time));
        Metadata {
            metres_per_unit: Some(1.0),
            scale_source: Some(source.clone()),
            up: Some(DVec3::Z),
            up_source: Some(source.clone()),
            north: self.is_north_known.then_some(DVec3::Y),
            north_source: self.is_north_known.then_some(source),
            location: self
                .location
                .filter(|[latitude, longitude]| latitude.abs() <= 90.0 && longitude.abs() <= 180.0),
            captured,
            captured_span: (captured.is_some() && span >= 60.0).then_some(span),
            ..Metadata::default()
        }
    }
}

/// Makes a folder.
fn make(folder: &Path) -> Result<(), FormatError> {
    std::fs::create_dir_all(folder).map_err(|e| FormatError::whole(folder, Problem::Write(e.into())))
}

/// Writes what belongs to each picture.
struct Frames<'a> {
    log: &'a DrivingLog,
    folder: &'a Path,
    options: &'a LogCaptureOptions,
    frames: Vec<(usize, write::Frame)>,
    warnings: Vec<String>,
    records: Records,
    /// The sweeps that can be read.
    sweeps: Vec<&'a LogSweep>,
    /// The last sweep that was read.
    sweep: Option<(usize, CleanSweep)>,
    /// For each camera what its masks need; made when it is first needed.
    lenses: Vec<Option<masks::MaskLens>>,
    depth_maps: usize,
    masks: usize,
    sky_masks: usize,
}

impl Frames<'_> {
    /// Writes mask, depth and sky of a picture, and colours points by it.
    fn add(
        &mut self,
        index: usize,
        picture: &LogPicture,
        rgb: Option<&Rgb>,
        points: &mut points::ColoredPoints,
    ) -> Result<(), FormatError> {
        let camera = &self.log.cameras[picture.camera];
        let photo = camera.camera(&picture.world_from_camera);
        photo.check().map_err(|e| super::files::fault(&picture.file, e.to_string()))?;
        let name = photo_name(&picture.file)?;
        self.lenses.resize(self.log.cameras.len(), None);
        let lens = self.lenses[picture.camera].get_or_insert_with(|| masks::MaskLens::new(camera));
        let boxes = self.log.movers_at(picture.timestamp);
        let mut mask = lens.mask(&photo, &boxes, BOX_MARGIN_SHARE);
        if let Some(file) = &picture.masks.movers {
            let added = masks::add_file(&mut mask, file, camera.size);
            self.records.sound("masks", added)?;
        }
        let mut mask_path = None;
        if let Some(mask) = &mask {
            let camera: String =
                camera.name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
            let path = format!("{MASKS}/{camera}_{index:06}.png");
            make(&self.folder.join(MASKS))?;
            write::grey(&self.folder.join(&path), mask, photo.width, photo.height)?;
            mask_path = Some(path);
            self.masks += 1;
        }
        match camera.distortion.undistorted(&photo) {
            None => {
                let warning = format!("the lens of camera {} folds over within its pictures", camera.name);
                if !self.warnings.contains(&warning) {
                    self.warnings.push(warning);
                }
            }
            Some(ideal) => {
                let size = depth::map_size(&ideal, self.options.depth_pixels);
                let view = match self.sweep_near(picture.timestamp) {
                    Some(near) => LidarView::new(&ideal.resized(size.0, size.1), &self.clean(near)?.points),
                    None => LidarView::new(&ideal.resized(size.0, size.1), &[]),
                };
                if let Some(map) = view.depth() {
                    let path = map_path(&self.folder.join(DEPTH), &name, "npy");
                    make(path.parent().unwrap_or(self.folder))?;
                    wm_base::npy::write(&path, &map, &[size.1 as usize, size.0 as usize])?;
                    self.depth_maps += 1;
                }
                if let Some(file) = &picture.masks.sky {
                    let sky =
                        masks::pinhole_sky(file, &photo, camera.distortion, &ideal.resized(size.0, size.1));
                    if let Some(sky) = self.records.sound("masks", sky)? {
                        let path = map_path(&self.folder.join(SKY), &name, "png");
                        make(path.parent().unwrap_or(self.folder))?;
                        write::grey(&path, &sky, size.0, size.1)?;
                        self.sky_masks += 1;
                    }
                }
                if let Some(rgb) = rgb {
                    points.paint(
                        &photo,
                        camera.distortion,
                        &view,
                        rgb,
                        mask.as_deref(),
                        MAX_COLOUR_DISTANCE_M,
                    );
                }
            }
        }
        self.frames.push((index, write::Frame::new(&photo, camera.distortion, picture, name, mask_path)));
        Ok(())
    }

    fn clean(&mut self, index: usize) -> Result<&CleanSweep, FormatError> {
        let sweep = match self.sweep.take() {
            Some((own, sweep)) if own == index => sweep,
            _ => CleanSweep::read(self.log, self.sweeps[index])?,
        };
        Ok(&self.sweep.insert((index, sweep)).1)
    }

    /// The sweep that is nearest in time, at most 0.2 s away.
    fn sweep_near(&self, time: i64) -> Option<usize> {
        let after = self.sweeps.partition_point(|sweep| sweep.timestamp < time);
        let near = [after.checked_sub(1), Some(after)].into_iter().flatten();
        let away = |index: &usize| self.sweeps.get(*index).map(|sweep| sweep.timestamp.abs_diff(time));
        near.filter(|index| away(index).is_some_and(|away| away <= MAX_SWEEP_GAP_NS))
            .min_by_key(|index| away(index))
    }
}

/// The name of a photo in the capture: its whole path.
fn photo_name(file: &Path) -> Result<String, FormatError> {
    let whole = std::path::absolute(file).map_err(|e| FormatError::reading(file, e))?;
    let name = whole.to_str().map(str::to_owned);
    name.ok_or_else(|| {
        super::files::fault(file, "its path is not text in UTF-8, which JSON cannot hold; rename it")
    })
}

/// The file of a map of a photo, as maps of photos are looked for.
fn map_path(folder: &Path, name: &str, extension: &str) -> PathBuf {
    let parts = Path::new(name).components().filter(|part| matches!(part, std::path::Component::Normal(_)));
    folder.join(parts.collect::<PathBuf>()).with_extension(extension)
}
