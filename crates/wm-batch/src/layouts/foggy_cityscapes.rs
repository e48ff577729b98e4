//! Foggy Cityscapes' names: photos in fog, named by its density, the same view without it, and
//! Cityscapes' camera files.
//!
//! With ID = `CITY_SEQ_FRAME`:
//! - `leftImg8bit_foggy/SPLIT/CITY/ID_leftImg8bit_foggy_beta_B.png`, 8-bit RGB. B is the extinction
//!   coefficient of the fog, 2.996 over the visibility, per metre, to two digits: 0.005, 0.01 and
//!   0.02 are 600, 300 and 150 m, as in the data set; 0 is clear air.
//! - `leftImg8bit/SPLIT/CITY/ID_leftImg8bit.png` without weather.
//! - `camera/SPLIT/CITY/ID_camera.json`: `intrinsic` (fx, fy, u0, v0) and `extrinsic` in the
//!   vehicle's axes, x forward, y left and z up: position, m, and yaw, pitch, roll, radians, of
//!   axes that look along the camera (x forward, y left, z up), `Rz(yaw) Ry(pitch) Rx(roll)`. The
//!   first pixel's centre is taken to be at (0, 0), as in OpenCV: u0 and v0 are 0.5 less than ours.
//!   `baseline` is 0, since there is no second camera.
//!
//! CITY is the place, with `-CAMERA` if the rig has more than one camera; SEQ is the clip's number
//! and FRAME that of the picture, both with six digits. `_` in names becomes `-`, since readers cut
//! names there. Lidars, radars, disparity and `gtFine` are left out. Weathers other than fog are
//! written too: B is the extinction of all that is in the air, of rain and snow too.
//!
//! Source: Sakaridis, Dai and Van Gool, "Semantic Foggy Scene Understanding with Synthetic Data"
//! (2018), and Cityscapes' README and camera calibration.

use super::{BlockWriter, FileSink, LayerNeeds, Layout};
use crate::cameras::{cameras, check_cameras, check_pinholes, layer, picture, refuse};
use crate::{BlockInfo, CameraInfo, RigidPose, SensorReading, SetError, SetInfo, picture_files};
use glam::{DMat3, DVec3, EulerRot};
use serde_json::{Value, json};

const NAME: &str = "foggy-cityscapes";

/// `-ln 0.05`: the optical depth at the visibility.
const OPTICAL_DEPTH: f64 = 2.995_732_273_553_991;

pub(super) const LAYOUT: Layout = Layout {
    name: NAME,
    about: "Foggy Cityscapes' names: PNG by density of fog, the same view without weather, camera files",
    needs: LayerNeeds { clean: true, ..LayerNeeds::NONE },
    needs_every_sensor: false,
    check,
    block,
    tables: |_, _, _| Ok(()),
};

fn check(set: &SetInfo) -> Result<(), SetError> {
    check_cameras(NAME, set)?;
    check_pinholes(NAME, set)?;
    let names: Vec<_> = cameras(set).map(|(_, sensor, _)| word(&sensor.name)).collect();
    match (1..names.len()).find(|index| names[..*index].contains(&names[*index])) {
        None => Ok(()),
        Some(index) => {
            Err(refuse(NAME, format!("two cameras are \"{}\" in its names; rename one", names[index])))
        }
    }
}

/// A name without what divides names.
fn word(name: &str) -> String {
    name.replace('_', "-")
}

/// The extinction coefficient in names, of a visibility in metres.
fn beta(mor: f64) -> String {
    let beta = OPTICAL_DEPTH / mor;
    if !(beta > 0.0 && beta.is_finite()) {
        return "0".into();
    }
    // The digit after the first.
    let places = 1 - beta.log10().floor() as i32;
    let scale = 10f64.powi(places);
    let text = format!("{:.*}", places.max(0) as usize, (beta * scale).round() / scale);
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').into() } else { text }
}

/// The camera file.
fn calibration(camera: &CameraInfo, rig_from_camera: &RigidPose) -> Value {
    // x forward, y left and z up, in the camera's axes.
    let camera_from_looking = DMat3::from_cols(DVec3::Z, DVec3::NEG_X, DVec3::NEG_Y);
    let axes = DMat3::from_quat(rig_from_camera.rotation) * camera_from_looking;
    let (yaw, pitch, roll) = axes.to_euler(EulerRot::ZYX);
    let [x, y, z] = rig_from_camera.translation.to_array();
    json!({
        "extrinsic": { "baseline": 0.0, "pitch": pitch, "roll": roll, "yaw": yaw, "x": x, "y": y, "z": z },
        "intrinsic": {
            "fx": camera.focal[0],
            "fy": camera.focal[1],
            "u0": camera.center[0] - 0.5,
            "v0": camera.center[1] - 0.5,
        },
    })
}

fn block(block: BlockInfo<'_>) -> Box<dyn BlockWriter + '_> {
    let BlockInfo { set, clip, .. } = block;
    Box::new(move |reading: &SensorReading<'_>, files: &mut dyn FileSink| {
        let Some((sensor, camera, picture)) = picture(set, reading) else { return Ok(()) };
        let mut city = word(&clip.place.name);
        if cameras(set).count() > 1 {
            city = format!("{city}-{}", word(&sensor.name));
        }
        let id = format!("{city}_{:06}_{:06}", clip.number, reading.info.index);
        let path = |kind: &str, end: &str| format!("{kind}/{}/{city}/{id}_{end}", clip.split);
        let clean = layer(sensor, camera, picture.clean, 3, "picture without weather")?;
        let end = format!("leftImg8bit_foggy_beta_{}.png", beta(clip.weather.mor));
        files.write(&path("leftImg8bit_foggy", &end), &picture_files::png(sensor, camera, picture.rgb)?)?;
        files.write(&path("leftImg8bit", "leftImg8bit.png"), &picture_files::png(sensor, camera, clean)?)?;
        let mut json = calibration(camera, &sensor.rig_from_sensor).to_string();
        json.push('\n');
        files.write(&path("camera", "camera.json"), json.as_bytes())
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{self, SPOT};

    #[test]
    fn densities_are_named_as_in_the_set() {
        let named = [600.0, 300.0, 150.0, 900.0, 30.0, 2.0, f64::INFINITY].map(beta);
        assert_eq!(named, ["0.005", "0.01", "0.02", "0.0033", "0.1", "1.5", "0"]);
    }

    #[test]
    fn the_spot_is_where_camera_files_say() {
        let files = testing::written(&LAYOUT, 8);
        let (set, mut seen) = (testing::set(), testing::SpotCount::default());
        for info in testing::readings(&set) {
            let sensor = &set.sensors[info.sensor];
            if sensor.camera().is_none() {
                continue;
            }
            let (city, index) = (format!("bend-{}", sensor.name), info.index);
            let id = format!("train/{city}/{city}_000000_{index:06}");
            for path in [
                format!("leftImg8bit_foggy/{id}_leftImg8bit_foggy_beta_0.0033.png"),
                format!("leftImg8bit/{id}_leftImg8bit.png"),
            ] {
                assert!(files.contains_key(&path), "{path}");
            }
            let file: Value = serde_json::from_slice(&files[&format!("camera/{id}_camera.json")]).unwrap();
            let at = |part: &str, name: &str| file[part][name].as_f64().unwrap();
            let [yaw, pitch, roll] = ["yaw", "pitch", "roll"].map(|name| at("extrinsic", name));
            let turn =
                DMat3::from_rotation_z(yaw) * DMat3::from_rotation_y(pitch) * DMat3::from_rotation_x(roll);
            let place = DVec3::from_array(["x", "y", "z"].map(|name| at("extrinsic", name)));
            let local = turn.transpose() * (info.world_from_rig.inverse().point(SPOT) - place);
            let x = at("intrinsic", "fx") * -local.y / local.x + at("intrinsic", "u0") + 0.5;
            let y = at("intrinsic", "fy") * -local.z / local.x + at("intrinsic", "v0") + 0.5;
            seen.add(&set, &info, [x, y]);
        }
    }
}
