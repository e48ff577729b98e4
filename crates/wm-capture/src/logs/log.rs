//! A driving log in no format's terms, and what the readers of all formats share.

use super::files;
use super::records::{LogOptions, Records, whole_name};
use super::sweep::{LogSweep, SweepRecords};
use super::track::{LogBox, LogTrack};
use crate::RigidPose;
use glam::{DVec3, dvec3};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use wm_base::FormatError;
use wm_image::header::read_header;
use wm_scene::Camera;
use wm_scene::camera::Distortion;

/// Focal lengths and principal points that lenses have, px.
const FOCAL_RANGE_PX: [f64; 2] = [1.0, 1e7];
const CENTER_RANGE_PX: [f64; 2] = [-1e6, 1e6];

/// Time between two frames where no times are stated, ns.
pub(super) const FRAME_NS: i64 = 100_000_000;

/// A format of driving logs.
pub(crate) struct LogFormat {
    /// The name in messages.
    pub(super) name: &'static str,
    /// The log in a folder; `None` if it is not of this format.
    pub(super) read: fn(&Path, &LogOptions) -> Result<Option<DrivingLog>, FormatError>,
}

/// A driving log, in no format's terms: metres, z up, x of boxes ahead. Cameras have OpenCV's axes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DrivingLog {
    /// The folder that was read.
    pub source: PathBuf,
    /// The name of its format.
    pub format: &'static str,
    /// The name: a drive, a sequence or a scene.
    pub name: String,
    /// The cameras.
    pub cameras: Vec<LogCamera>,
    /// The pictures, camera by camera, in the order of time.
    pub pictures: Vec<LogPicture>,
    /// The sweeps of the lidar, in the order of time.
    pub sweeps: Vec<LogSweep>,
    /// Things around the vehicle that have boxes.
    pub tracks: Vec<LogTrack>,
    /// The world's origin in the log's own coordinates, m: all poses here are relative to it.
    pub origin: DVec3,
    /// Latitude and longitude of the world's origin, degrees, WGS 84.
    pub location: Option<[f64; 2]>,
    /// True if x is east and y is north.
    pub is_north_known: bool,
    /// Seconds since 1970, UTC, of the middle of the log, where that is known.
    pub captured: Option<f64>,
    /// Warnings: parts that are missing or were left out, in words.
    pub warnings: Vec<String>,
}

/// A camera of a log.
#[derive(Clone, Debug, PartialEq)]
pub struct LogCamera {
    /// The name.
    pub name: String,
    /// Picture width and height, px.
    pub size: (u32, u32),
    /// Focal lengths, px.
    pub focal: [f64; 2],
    /// Principal point from the corner of the first pixel, px. Logs count from its middle; 0.5 has
    /// been added.
    pub center: [f64; 2],
    /// The distortion of its lens.
    pub distortion: Distortion,
}

/// A picture of a log.
#[derive(Clone, Debug, PartialEq)]
pub struct LogPicture {
    /// Index into [`DrivingLog::cameras`].
    pub camera: usize,
    /// The file of the photo.
    pub file: PathBuf,
    /// Nanoseconds: since 1970, or since the start of the log.
    pub timestamp: i64,
    /// `world_from_camera` at that time.
    pub world_from_camera: RigidPose,
    /// Masks that the log has of it.
    pub masks: LogPictureMasks,
}

/// The masks that a log has of a picture.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LogPictureMasks {
    /// White where something moves.
    pub movers: Option<PathBuf>,
    /// White where the sky is.
    pub sky: Option<PathBuf>,
}

impl LogCamera {
    /// The pinhole camera of a picture taken at a pose, before the lens bends it.
    #[must_use]
    pub fn camera(&self, world_from_camera: &RigidPose) -> Camera {
        let viewmat = world_from_camera.inverse().matrix();
        Camera { viewmat, ..Camera::pinhole(self.size, self.focal, self.center) }
    }
}

impl DrivingLog {
    /// A log of the folder that was chosen, with nothing in it; `note` says what was passed over.
    pub(super) fn begun(source: &Path, note: Option<String>) -> Self {
        let warnings = note.into_iter().collect();
        Self { source: source.into(), name: whole_name(source), warnings, ..Self::default() }
    }

    /// Thins the pictures, and checks what all formats have in common.
    pub(super) fn finished(
        mut self,
        format: &'static str,
        options: &LogOptions,
    ) -> Result<Self, FormatError> {
        self.format = format;
        let times = || self.pictures.iter().map(|picture| picture.timestamp);
        if let (Some(first), Some(seconds)) = (times().min(), options.seconds) {
            let most = u64::from(seconds) * 1_000_000_000;
            self.pictures.retain(|picture| picture.timestamp.abs_diff(first) < most);
        }
        self.pictures.sort_by_key(|picture| (picture.camera, picture.timestamp));
        self.thin(options);
        if self.pictures.is_empty() {
            return Err(files::fault(&self.source, "there are no pictures with a pose in it"));
        }
        // Sweeps from half a second before the first picture to half a second after the last.
        const TIME_WINDOW_NS: i64 = 500_000_000;
        let (first, last) = self.span();
        let (first, last) = (first.saturating_sub(TIME_WINDOW_NS), last.saturating_add(TIME_WINDOW_NS));
        self.sweeps.retain(|sweep| (first..=last).contains(&sweep.timestamp));
        self.sweeps.sort_by_key(|sweep| sweep.timestamp);
        self.tracks.sort_by(|a, b| a.id.cmp(&b.id));
        if self.sweeps.is_empty() {
            self.warnings.push("it has no lidar sweeps: no points and no depth".into());
        }
        let has_masks = self.pictures.iter().any(|picture| picture.masks.movers.is_some());
        let has_labels = self.sweeps.iter().any(|sweep| sweep.labels.is_some());
        if self.tracks.is_empty() && !has_masks {
            let points = if has_labels { "" } else { "what moves stays in the points, and " };
            self.warnings.push(format!("it has no boxes: {points}no photo gets a mask"));
        }
        for camera in &self.cameras {
            let fault = |what: String| files::fault(&self.source, format!("camera {}: {what}", camera.name));
            // Written so that NaN is refused.
            let ([fx, fy], [cx, cy]) = (camera.focal, camera.center);
            let is_within =
                |[low, high]: [f64; 2], values: [f64; 2]| values.iter().all(|v| (low..=high).contains(v));
            let damaged = |what: String| Err(fault(format!("{what} px; its calibration is damaged")));
            if !is_within(FOCAL_RANGE_PX, camera.focal) {
                return damaged(format!("focal lengths of {fx:e} and {fy:e}"));
            }
            if !is_within(CENTER_RANGE_PX, camera.center) {
                return damaged(format!("a principal point at {cx:e}, {cy:e}"));
            }
            camera.camera(&RigidPose::IDENTITY).check().map_err(|e| fault(e.to_string()))?;
            if camera.distortion.coefficients().iter().any(|v| !v.is_finite()) {
                return Err(fault("its distortion is not finite".into()));
            }
        }
        Ok(self)
    }

    /// Thins the pictures of each camera out.
    fn thin(&mut self, options: &LogOptions) {
        let all = self.pictures.len();
        let stride = match options.stride {
            0 => all.div_ceil(options.most_pictures.max(1)).max(1),
            stride => stride,
        };
        if stride > 1 {
            let mut counts = BTreeMap::<usize, usize>::new();
            self.pictures.retain(|picture| {
                let count = counts.entry(picture.camera).or_default();
                *count += 1;
                (*count - 1).is_multiple_of(stride)
            });
            if options.stride == 0 {
                let kept = self.pictures.len();
                self.warnings
                    .push(format!("{kept} of {all} pictures are taken, one in {stride} of each camera"));
            }
        }
    }

    /// Adds a camera and its pictures without masks. `at` gives the time, ns, and
    /// `world_from_camera` of a picture by the stem of its file; those without are counted as
    /// `lost`.
    pub(super) fn add_camera(
        &mut self,
        camera: LogCamera,
        files: Vec<(String, PathBuf)>,
        at: impl Fn(&str) -> Option<(i64, RigidPose)>,
        lost: &str,
        records: &mut Records,
    ) {
        for (stem, file) in files {
            let Some((timestamp, world_from_camera)) = at(&stem) else {
                records.lost(lost, 1);
                continue;
            };
            let (camera, masks) = (self.cameras.len(), LogPictureMasks::default());
            self.pictures.push(LogPicture { camera, file, timestamp, world_from_camera, masks });
        }
        self.cameras.push(camera);
    }

    /// Adds sweeps whose points are in the axes of one time. `at` gives that time, ns, and the pose
    /// of the axes in the world by the stem of a sweep's file; those without are counted as `lost`.
    pub(super) fn add_sweeps(
        &mut self,
        files: Vec<(String, PathBuf)>,
        layout: SweepRecords,
        at: impl Fn(&str) -> Option<(i64, RigidPose)>,
        lost: &str,
        records: &mut Records,
    ) {
        for (stem, file) in files {
            match at(&stem) {
                Some((timestamp, pose)) => self.sweeps.push(LogSweep::still(file, timestamp, pose, layout)),
                None => records.lost(lost, 1),
            }
        }
    }

    /// The times of the first and the last picture, ns.
    #[must_use]
    pub fn span(&self) -> (i64, i64) {
        let times = || self.pictures.iter().map(|picture| picture.timestamp);
        (times().min().unwrap_or(0), times().max().unwrap_or(0))
    }

    /// Boxes of what moves at some time of the log, at a time, ns.
    #[must_use]
    pub(super) fn movers_at(&self, time: i64) -> Vec<LogBox> {
        self.tracks.iter().filter(|track| track.is_mover).filter_map(|track| track.at(time)).collect()
    }
}

/// Returns true if a camera of this name is asked for.
pub(super) fn is_asked(options: &LogOptions, name: &str) -> bool {
    options.cameras.is_empty() || options.cameras.iter().any(|asked| asked == name)
}

/// Refuses cameras that are not in the log.
pub(super) fn check_cameras(source: &Path, options: &LogOptions, names: &[&str]) -> Result<(), FormatError> {
    match options.cameras.iter().find(|asked| !names.contains(&asked.as_str())) {
        Some(unknown) => {
            let known = names.join(", ");
            Err(files::fault(
                source,
                format!("there is no camera \"{}\"; its cameras are {known}", files::excerpt(unknown)),
            ))
        }
        None => Ok(()),
    }
}

/// The size of the first photo whose header can be read, px; `None` if there is none.
pub(super) fn size_of_first(
    photos: &[(String, PathBuf)],
    records: &mut Records,
) -> Result<Option<(u32, u32)>, FormatError> {
    for (_, photo) in photos {
        let header = read_header(photo);
        if let Some(header) = records.sound("pictures", header)? {
            return Ok(Some((header.width, header.height)));
        }
    }
    Ok(None)
}

/// Moves a pose so that the world's origin is at `origin`.
pub(super) fn moved(pose: RigidPose, origin: DVec3) -> RigidPose {
    RigidPose { translation: pose.translation - origin, ..pose }
}

/// WGS 84's equatorial radius, m.
pub(super) const EARTH_RADIUS_M: f64 = 6_378_137.0;

/// Returns the latitude and longitude, degrees, of the point `east` and `north` m of a location.
pub(super) fn displaced(location: [f64; 2], east: f64, north: f64) -> [f64; 2] {
    let [latitude, longitude] = location;
    // Over a city the difference to the ellipsoid is below 0.5 % of the way.
    let shift = dvec3(east, north, 0.0) / EARTH_RADIUS_M;
    let longitude = longitude + (shift.x / latitude.to_radians().cos().max(1e-6)).to_degrees();
    [latitude + shift.y.to_degrees(), longitude]
}
