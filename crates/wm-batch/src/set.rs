//! A plan in the terms of data sets: sensors, clips and readings.

use super::clips::{BatchClips, BlockPart, PlannedClip};
use super::condition::{condition_of, is_night, visibility_of};
use super::plan::{BatchPlan, PlanRig};
use super::weathers::value_of;
use crate::{
    CameraInfo, ClipInfo, DatasetDetection, DatasetPoint, PlaceInfo, PointSource, ReadingInfo, RigidPose,
    SensorInfo, SensorInfoKind, SetInfo, WeatherInfo,
};
use glam::{DMat3, DVec3};
use std::sync::Arc;
use wm_place::CameraMotion;
use wm_place::lidar::LidarSweep;
use wm_place::radar::RadarSweep;
use wm_place::rig::{Rig, RigSensor};
use wm_place::sensor::{RigCamera, RigLidar, RigRadar};
use wm_place::{LensView, PreparedPlace, Result};
use wm_scene::Camera;
use wm_sensors::EchoClass;
use wm_sensors::radar::RadarClass;

/// The rig of a plan, in which every sensor is one of a rig.
///
/// # Errors
/// As [`Rig::parse`].
pub(crate) fn rig_of(plan: &BatchPlan, clips: &BatchClips) -> Result<Rig> {
    let camera = |size: (u32, u32), fov: f64| {
        format!(
            "[[sensor]]\nname = \"camera\"\nkind = \"camera\"\nrate = {:?}\nsize = [{}, {}]\nfov = {fov:?}\n",
            plan.frame_rate, size.0, size.1
        )
    };
    match &plan.rig {
        PlanRig::Rig(rig) => Ok((**rig).clone()),
        PlanRig::Camera { size, fov } => Rig::parse(&camera(*size, *fov), &plan.file),
        PlanRig::Photos => {
            let mut rig = Rig { sensors: Vec::new() };
            for (number, own) in clips.cameras.iter().enumerate() {
                let mut sensors =
                    Rig::parse(&camera((own.width, own.height), own.fov_y()), &plan.file)?.sensors;
                for sensor in &mut sensors {
                    if let Some(camera) = sensor.device.camera() {
                        let intrinsics = Camera { viewmat: camera.intrinsics.viewmat, ..*own };
                        sensor.device = Arc::new(RigCamera { intrinsics, ..camera.clone() });
                    }
                    if number > 0 {
                        sensor.name = format!("camera-{}", number + 1);
                    }
                }
                rig.sensors.append(&mut sensors);
            }
            Ok(rig)
        }
    }
}

/// The set of a plan.
pub(crate) fn set_of(plan: &BatchPlan, rig: &Rig) -> SetInfo {
    let about = match plan.about.as_str() {
        "" => format!("{} scenes in weather", plan.scenes.len()),
        about => about.into(),
    };
    SetInfo {
        name: plan.name.clone(),
        about,
        program: concat!("weather-magician ", env!("CARGO_PKG_VERSION")).into(),
        sensors: rig.sensors.iter().map(sensor_info).collect(),
        frame_rate: plan.frame_rate,
        labels: plan.labels.clone(),
    }
}

/// The axes of a camera (x right, y down, z forward) in those of a mount (x forward, y left, z up).
const OPTICAL: DMat3 = DMat3::from_cols(DVec3::NEG_Y, DVec3::NEG_Z, DVec3::X);

fn sensor_info(sensor: &RigSensor) -> SensorInfo {
    let axes = sensor.mount.rig_from_sensor;
    let device = &*sensor.device;
    let (axes, kind) = if let Some(RigCamera { intrinsics, model }) = device.camera() {
        let Camera { width, height, fx, fy, cx, cy, .. } = *intrinsics;
        let lens = model.lens.as_ref().map(LensView::lens);
        let info = CameraInfo { size: (width, height), focal: [fx, fy], center: [cx, cy], lens };
        (axes * OPTICAL, SensorInfoKind::Camera(info))
    } else if let Some(RigLidar { model, .. }) = device.of_kind() {
        let rings = model.pattern.grid().map_or(1, |[rows, _]| rows as u16);
        (axes, SensorInfoKind::Lidar { model: model.name.clone(), rings })
    } else if let Some(RigRadar { model, .. }) = device.of_kind() {
        (axes, SensorInfoKind::Radar { model: model.name.clone() })
    } else {
        (axes, SensorInfoKind::Other { kind: device.kind() })
    };
    SensorInfo {
        name: sensor.name.clone(),
        rig_from_sensor: RigidPose::new(axes, sensor.mount.position),
        rate: sensor.rate,
        kind,
    }
}

/// The axes of the world of a data set: z up, in metres over the ground, x east where north is
/// known.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SetWorld {
    axes: DMat3,
    ground: f64,
    metres: f64,
}

impl SetWorld {
    /// Returns the axes of a place.
    pub(crate) fn of(place: &PreparedPlace) -> Self {
        let (survey, site) = (place.survey(), place.site());
        let up = DVec3::from_array(site.up);
        let level = |way: DVec3| way.reject_from_normalized(up).try_normalize();
        let x = match survey.north.and_then(level) {
            Some(north) => north.cross(up),
            None => {
                level(DVec3::X).filter(|_| up.x.abs() < 0.9).or_else(|| level(DVec3::Y)).unwrap_or(DVec3::X)
            }
        };
        let axes = DMat3::from_cols(x, up.cross(x), up).transpose();
        Self { axes, ground: site.ground * site.metres_per_unit, metres: site.metres_per_unit }
    }

    /// The pose of a rig that moves so.
    pub(crate) fn pose(&self, motion: &CameraMotion, time: f64) -> RigidPose {
        let pose = motion.sensor_pose(time);
        let at = self.axes * pose.origin * self.metres - DVec3::Z * self.ground;
        RigidPose::new(self.axes * pose.world_from_sensor, at)
    }
}

/// The place of a clip.
pub(crate) fn place_of(name: &str, place: &PreparedPlace) -> PlaceInfo {
    let survey = place.survey();
    PlaceInfo {
        name: name.into(),
        origin: survey.location.map(|[latitude, longitude]| [latitude, longitude, 0.0]),
        is_north_known: survey.north.is_some(),
    }
}

/// The clip of a set.
pub(crate) fn clip_of(plan: &BatchPlan, clip: &PlannedClip, place: PlaceInfo) -> ClipInfo {
    let planned = &clip.weather;
    let number = |key: &str| value_of(&planned.weather, key, planned.at).unwrap_or(0.0);
    ClipInfo {
        number: clip.number,
        name: clip.name.clone(),
        split: clip.split.clone(),
        start: clip.start,
        seconds: f64::from(plan.frames) / plan.frame_rate,
        place,
        weather: WeatherInfo {
            name: super::plan::slug(&planned.weather.name),
            condition: condition_of(planned),
            mor: visibility_of(planned),
            rain_rate: number("rain.rate"),
            snow_rate: number("snowfall.rate"),
            is_night: is_night(planned),
            file: planned.weather.to_toml(),
        },
    }
}

/// The readings of a part of a clip, in the order of time, then of sensors. `pose` is that of the
/// rig at a time of the clip, s.
pub(crate) fn readings_of(
    plan: &BatchPlan,
    rig: &Rig,
    part: &BlockPart,
    only: Option<usize>,
    pose: &dyn Fn(f64) -> RigidPose,
) -> Vec<ReadingInfo> {
    let mut readings = Vec::new();
    for (sensor, own) in rig.sensors.iter().enumerate() {
        if only.is_some_and(|only| only != sensor) {
            continue;
        }
        let time = |index: u32| own.phase + f64::from(index) / own.rate;
        // Rounding must not move a reading into the frame before.
        let frame = |index: u32| (time(index) * plan.frame_rate + 1e-6).floor() as u32;
        let begin = (f64::from(part.frames.start) / plan.frame_rate - own.phase) * own.rate;
        let first = (begin.floor() - 1.0).max(0.0) as u32;
        for index in (first..).skip_while(|index| frame(*index) < part.frames.start) {
            let of = frame(index);
            if of >= part.frames.end {
                break;
            }
            readings.push(ReadingInfo {
                sensor,
                index,
                frame: of,
                is_key: index == 0 || frame(index - 1) < of,
                block: part.number,
                time: time(index),
                world_from_rig: pose(time(index)),
            });
        }
    }
    readings.sort_by(|a, b| a.time.total_cmp(&b.time).then(a.sensor.cmp(&b.sensor)));
    readings
}

/// The points of a sweep.
pub(crate) fn points_of(sweep: &LidarSweep) -> Vec<DatasetPoint> {
    let of = |point: &wm_sensors::LidarPoint| DatasetPoint {
        position: point.position,
        range: point.range,
        intensity: point.intensity,
        time: point.time,
        angles: point.angles,
        ring: point.ring,
        rank: point.rank as u8 - 1,
        source: match point.class {
            EchoClass::Surface => PointSource::Surface,
            EchoClass::Drop => PointSource::Rain,
            EchoClass::Flake => PointSource::Snow,
            EchoClass::Air => PointSource::Air,
            EchoClass::Ghost => PointSource::Ghost,
        },
        label: point.label,
    };
    let mut points: Vec<DatasetPoint> = sweep.points.iter().map(of).collect();
    // Rows of a spinning lidar fire at once: a stable order by time.
    points.sort_by(|a, b| a.time.total_cmp(&b.time));
    points
}

/// The detections of a radar's sweep.
pub(crate) fn detections_of(sweep: &RadarSweep) -> Vec<DatasetDetection> {
    let of = |one: &wm_sensors::radar::RadarDetection| DatasetDetection {
        position: one.position,
        velocity: one.velocity,
        ground_velocity: one.ground_velocity,
        rcs: one.rcs,
        snr: one.snr,
        is_rain: one.class == RadarClass::Rain,
    };
    sweep.detections.iter().map(of).collect()
}
