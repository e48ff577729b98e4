//! nuScenes (Caesar et al. 2020), as nuscenes-devkit reads it, with nuScenes-lidarseg (Fong et al.
//! 2021) for the points of key sweeps.
//!
//! `v1.0-SET/*.json` are the tables, `samples/CHANNEL` and `sweeps/CHANNEL` the readings,
//! `lidarseg/v1.0-SET` a class for each point.
//!
//! - Samples are every nth frame, n the nearest to half the rate of frames (2 Hz of 10, 12 or 20
//!   Hz), or every frame below 3 Hz. The key readings of their frames are in `samples`, all others
//!   in `sweeps`. A reading of `sweeps` belongs to the next sample in time, or the last.
//! - The rig is nuScenes' ego vehicle (x forward, y left, z up), the world its global frame; a pose
//!   for each reading. Metres, quaternions wxyz, microseconds.
//! - Points: x right, y forward, z up, so the rotation of a lidar is the rig's times a quarter
//!   turn; intensity 0-255, ring 0 is the lowest.
//! - Cameras: x right, y down, z forward. The centre of the first pixel is at (0, 0), half a pixel
//!   less than in [`crate::CameraInfo`]: the devkit draws what its `view_points` gives over
//!   `imshow`, which has pixels' centres at whole numbers.
//! - Radars: x forward, y left, z up. The radial velocity is the length of `vx, vy`, and that of
//!   `vx_comp, vy_comp` without the rig's own; what moves less than 1 m/s is `stationary`. A sweep
//!   without detections has one record of NaN, as there.
//! - Channels are named by direction, `CAM_FRONT_LEFT`, where one sensor alone looks there, else by
//!   the sensor's name.
//! - Classes of points are those of nuScenes-lidarseg: drops, flakes, fog and mirrored surfaces are
//!   `noise` (0), as there.
//! - `scene.description` has the weather in words: `rain` or `snow` with mm/h, `visibility` in m,
//!   `night`. Readers that look for "rain" and "night" in it, as is usual, find those scenes.
//!   Categories of boxes are listed, boxes are none: nothing moves.
//! - `splits.json` has each split under its name and under `SET_NAME`: the devkit knows `train` and
//!   `val` as those of nuScenes itself.
//!
//! Tokens are the first 32 digits of the SHA-256 of the set's, clip's and sensor's names and a
//! number. Source: nuscenes-devkit, `docs/schema_nuscenes.md`, checked with nuscenes-devkit 1.2.0
//! (`tests/peers/nuscenes.py`).

mod channels;
mod files;
mod names;
mod tables;
#[cfg(test)]
mod tests;

use super::{LayerNeeds, Layout};
use crate::{SetError, SetInfo};
use channels::channels;
use names::key_interval;

pub(super) const LAYOUT: Layout = Layout {
    name: "nuscenes",
    about: "nuScenes v1.0: pinhole cameras as JPEG, lidars with nuScenes-lidarseg, radars, samples at 2 Hz and sweeps; no boxes, nothing moves",
    needs: LayerNeeds::NONE,
    needs_every_sensor: true,
    check: |set| check(set).map_err(|problem| SetError::Layout { layout: "nuscenes", problem }),
    block: files::block,
    tables: tables::write,
};

fn check(set: &SetInfo) -> Result<(), String> {
    if set.sensors.is_empty() {
        return Err("it needs a sensor: add one to the rig".into());
    }
    for sensor in &set.sensors {
        let name = &sensor.name;
        if sensor.camera().is_some_and(|camera| camera.lens.is_some()) {
            return Err(format!("camera \"{name}\" has a lens, but its cameras are pinholes: give it none"));
        }
        let rate = set.frame_rate / f64::from(key_interval(set));
        if sensor.rate < rate * (1.0 - 1e-9) {
            let own = sensor.rate;
            return Err(format!(
                "sensor \"{name}\" has {own} Hz and samples {rate} Hz, but each has a reading of each sensor: raise its rate"
            ));
        }
    }
    let mut names = channels(set);
    names.sort();
    if let Some(pair) = names.windows(2).find(|pair| pair[0] == pair[1]) {
        let name = &pair[0];
        return Err(format!("two sensors would be channel {name}: rename one, capitals do not count"));
    }
    Ok(())
}
