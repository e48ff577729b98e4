//! Camera paths of other programs: nerfstudio's `camera_path.json`, which its Blender add-on writes
//! and reads too, the settings of SuperSplat's viewer, and the `transforms.json` of Blender's
//! exporters for radiance fields.
//!
//! nerfstudio has a camera for every frame: world_from_camera row by row with OpenGL axes (y up,
//! looking along -z), the vertical field of view in degrees, and `fps`; the size of pictures is
//! `render_width` and `render_height`. There are `seconds` times `fps` cameras, so the last one is
//! shown for as long as every other. Its world is that of the splats that it exports.
//!
//! SuperSplat's `animTracks` have keyframes: `times` in frames of `frameRate`, and flat lists of
//! `position`, `target` and perhaps `fov` (degrees). Its world has a PLY turned by half a turn
//! about z ([`Axes::YUpZForward`]).
//!
//! Blender's exporters write `frames` with a `transform_matrix` each, of the axes of nerfstudio's,
//! and the field of view as `camera_angle_x` in radians or focal lengths in pixels. They say no
//! rate: Blender's usual one is taken.

use super::DEFAULT_FOV;
use super::path::{CameraPath, PathKey};
use glam::{DMat3, DQuat, DVec3};
use serde::Deserialize;
use serde_json::{Value, json};
use wm_scene::Camera;
use wm_scene::camera::{FOV_RANGE_DEG, MAX_SIDE};
use wm_scene::formats::Axes;

/// nerfstudio's file; other keys are left alone.
#[derive(Deserialize)]
struct Nerfstudio {
    camera_path: Vec<PathPose>,
    fps: Option<f64>,
    seconds: Option<f64>,
    #[serde(default)]
    is_cycle: bool,
    #[serde(default = "perspective")]
    camera_type: String,
    render_width: Option<f64>,
    render_height: Option<f64>,
}

/// Blender's file; other keys are left alone.
#[derive(Deserialize)]
struct Blender {
    #[serde(flatten)]
    lens: Angles,
    frames: Vec<BlenderFrame>,
}

#[derive(Deserialize)]
struct BlenderFrame {
    transform_matrix: Vec<Vec<f64>>,
    #[serde(flatten)]
    lens: Angles,
}

/// The keys that give a field of view, for all frames or for one.
#[derive(Clone, Copy, Default, Deserialize)]
struct Angles {
    camera_angle_x: Option<f64>,
    camera_angle_y: Option<f64>,
    fl_y: Option<f64>,
    w: Option<f64>,
    h: Option<f64>,
}

/// Frames a second of Blender, where its user changes nothing.
const BLENDER_RATE: f64 = 24.0;

#[derive(Deserialize)]
struct PathPose {
    camera_to_world: Vec<f64>,
    #[serde(default = "usual_fov")]
    fov: f64,
}

/// SuperSplat's settings; other keys are left alone.
#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct SuperSplat {
    anim_tracks: Vec<Track>,
    #[serde(default)]
    camera: Option<Lens>,
}

#[derive(Deserialize)]
struct Lens {
    fov: Option<f64>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Track {
    #[serde(default = "usual_rate")]
    frame_rate: f64,
    keyframes: Keyframes,
}

#[derive(Deserialize)]
struct Keyframes {
    times: Vec<f64>,
    values: TrackValues,
}

#[derive(Deserialize)]
struct TrackValues {
    position: Vec<f64>,
    target: Vec<f64>,
    #[serde(default)]
    fov: Vec<f64>,
}

fn usual_rate() -> f64 {
    30.0
}

fn usual_fov() -> f64 {
    DEFAULT_FOV
}

fn perspective() -> String {
    "perspective".into()
}

/// The keyframes of a file, and the size of its pictures where it states one, px.
pub(crate) type SizedKeys = (Vec<PathKey>, Option<(u32, u32)>);

/// Keyframes of a file of another program, or what is wrong with it; `None` if it is of none that
/// is known. `up` is up in the scene's axes, `fov` what was given by hand.
pub(crate) fn keys(text: &str, up: DVec3, fov: Option<f64>) -> Option<Result<SizedKeys, String>> {
    let value: Value = serde_json::from_str(text).ok()?;
    let read = if value.get("camera_path").is_some() {
        let file: Result<Nerfstudio, String> = serde_json::from_value(value).map_err(|e| e.to_string());
        return Some(file.and_then(|file| Ok((nerfstudio(&file, fov)?, file.size()?))));
    } else if value.get("animTracks").is_some() {
        serde_json::from_value(value).map_err(|e| e.to_string()).and_then(|file| supersplat(&file, up, fov))
    } else if value.get("frames").is_some() {
        serde_json::from_value(value).map_err(|e| e.to_string()).and_then(|file| blender(&file, fov))
    } else {
        return None;
    };
    Some(read.map(|keys| (keys, None)))
}

impl Nerfstudio {
    fn size(&self) -> Result<Option<(u32, u32)>, String> {
        let Some((width, height)) = self.render_width.zip(self.render_height) else { return Ok(None) };
        let side = |side: f64| {
            (side.fract() == 0.0 && (1.0..=f64::from(MAX_SIDE)).contains(&side)).then_some(side as u32)
        };
        match side(width).zip(side(height)) {
            Some(size) => Ok(Some(size)),
            None => Err(format!(
                "render_width and render_height are {width} and {height}, which is no size of a picture"
            )),
        }
    }
}

/// Appends to the pictures of a video, one key each, the key at which the last one ends: the first
/// key of a loop, else as far on as the last step went.
fn with_end(mut keys: Vec<PathKey>, rate: f64, is_cycle: bool) -> Vec<PathKey> {
    let time = keys.len() as f64 / rate;
    if let [first, .., before, last] | [first @ before, last] = keys[..] {
        let end = if is_cycle {
            PathKey { time, ..first }
        } else {
            let turn = last.rotation * before.rotation.inverse();
            let rotation = (turn * last.rotation).normalize();
            let fov =
                (2.0 * last.fov - before.fov).clamp(0.5 * last.fov, 0.5 * (last.fov + FOV_RANGE_DEG.end()));
            PathKey { time, eye: 2.0 * last.eye - before.eye, rotation, fov }
        };
        keys.push(end);
    }
    keys
}

fn nerfstudio(file: &Nerfstudio, fov: Option<f64>) -> Result<Vec<PathKey>, String> {
    if file.camera_type != "perspective" {
        return Err(format!(
            "nerfstudio camera type {:?} is not supported: use perspective",
            file.camera_type
        ));
    }
    let by_length = || file.seconds.map(|seconds| file.camera_path.len() as f64 / seconds);
    let rate = rate(file.fps.or_else(by_length).unwrap_or_else(usual_rate))?;
    let key = |index: usize| {
        let posed = &file.camera_path[index];
        let (eye, rotation) = pose(&posed.camera_to_world)
            .map_err(|what| format!("camera {}: camera_to_world {what}", index + 1))?;
        Ok(PathKey { time: index as f64 / rate, eye, rotation, fov: fov.unwrap_or(posed.fov) })
    };
    let keys = (0..file.camera_path.len()).map(key).collect::<Result<_, String>>()?;
    Ok(with_end(keys, rate, file.is_cycle))
}

/// Eye and camera_from_world of a world_from_camera, row by row, with OpenGL axes.
fn pose(matrix: &[f64]) -> Result<(DVec3, DQuat), String> {
    let ([x0, y0, z0, tx, x1, y1, z1, ty, x2, y2, z2, tz]
    | [x0, y0, z0, tx, x1, y1, z1, ty, x2, y2, z2, tz, ..]) = matrix[..]
    else {
        return Err("has fewer than 12 numbers".into());
    };
    let column = DVec3::new;
    let world_from_camera = DMat3::from_cols(column(x0, x1, x2), -column(y0, y1, y2), -column(z0, z1, z2));
    let product = world_from_camera.transpose() * world_from_camera;
    if !product.abs_diff_eq(DMat3::IDENTITY, 1e-3) || world_from_camera.determinant() < 0.0 {
        return Err("is not a rotation with a translation".into());
    }
    Ok((column(tx, ty, tz), DQuat::from_mat3(&world_from_camera.transpose()).normalize()))
}

fn blender(file: &Blender, fov: Option<f64>) -> Result<Vec<PathKey>, String> {
    let key = |index: usize| {
        let frame = &file.frames[index];
        let fault = |what: String| format!("frame {}: transform_matrix {what}", index + 1);
        let (eye, rotation) = pose(&frame.transform_matrix.concat()).map_err(fault)?;
        let said = || frame.lens.fov().or(file.lens.fov()).unwrap_or(DEFAULT_FOV);
        Ok(PathKey { time: index as f64 / BLENDER_RATE, eye, rotation, fov: fov.unwrap_or_else(said) })
    };
    let keys = (0..file.frames.len()).map(key).collect::<Result<_, String>>()?;
    Ok(with_end(keys, BLENDER_RATE, false))
}

impl Angles {
    /// The vertical field of view, degrees; pictures of no known size are square.
    fn fov(&self) -> Option<f64> {
        let aspect = self.w.zip(self.h).map_or(1.0, |(w, h)| w / h);
        let by_width = self.camera_angle_x.map(|angle| ((0.5 * angle).tan() / aspect).atan() * 2.0);
        let by_focal = self.fl_y.zip(self.h).map(|(focal, height)| (0.5 * height / focal).atan() * 2.0);
        self.camera_angle_y.or(by_focal).or(by_width).map(f64::to_degrees)
    }
}

fn supersplat(file: &SuperSplat, up: DVec3, fov: Option<f64>) -> Result<Vec<PathKey>, String> {
    let [track, ..] = &file.anim_tracks[..] else { return Err("there is no track in animTracks".into()) };
    let (rate, Keyframes { times, values }) = (rate(track.frame_rate)?, &track.keyframes);
    let count = times.len();
    let lengths = [values.position.len(), values.target.len()];
    if lengths != [3 * count; 2] || !(values.fov.is_empty() || values.fov.len() == count) {
        return Err(format!(
            "{count} times do not fit {} positions and {} targets",
            lengths[0] / 3,
            lengths[1] / 3
        ));
    }
    let axes = Axes::YUpZForward;
    let point =
        |list: &[f64], i: usize| axes.direction(DVec3::new(list[3 * i], list[3 * i + 1], list[3 * i + 2]));
    let usual = file.camera.as_ref().and_then(|camera| camera.fov).unwrap_or(DEFAULT_FOV);
    let key = |i: usize| {
        let (eye, target) = (point(&values.position, i), point(&values.target, i));
        let camera = Camera::looking((1, 1), DEFAULT_FOV, eye, target, up);
        let camera = camera.map_err(|error| format!("keyframe {}: {error}", i + 1))?;
        let fov = fov.or(values.fov.get(i).copied()).unwrap_or(usual);
        Ok(PathKey { time: times[i] / rate, eye, rotation: DQuat::from_mat3(&camera.rotation()), fov })
    };
    (0..count).map(key).collect()
}

fn rate(frames: f64) -> Result<f64, String> {
    if frames.is_finite() && frames > 0.0 { Ok(frames) } else { Err(format!("{frames} is not a frame rate")) }
}

/// A path as nerfstudio's `camera_path.json`: a camera for each frame.
pub(crate) fn nerfstudio_text(path: &CameraPath, fps: f64, size: (u32, u32)) -> String {
    let (width, height) = size;
    let count = ((path.duration() * fps).round() as usize).max(1);
    let aspect = f64::from(width) / f64::from(height);
    let cameras: Vec<Value> = (0..count)
        .map(|frame| {
            let PathKey { eye, rotation, fov, .. } = path.key_at(path.start() + frame as f64 / fps);
            let turn = DMat3::from_quat(rotation).transpose();
            let row = |k: usize| [turn.x_axis[k], -turn.y_axis[k], -turn.z_axis[k], eye[k]];
            let matrix = [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]];
            json!({ "camera_to_world": matrix.as_flattened(), "fov": fov, "aspect": aspect })
        })
        .collect();
    let file = json!({
        "camera_type": "perspective",
        "render_width": width,
        "render_height": height,
        "fps": fps,
        "seconds": count as f64 / fps,
        "is_cycle": false,
        "smoothness_value": 0.0,
        "keyframes": [],
        "camera_path": cameras,
    });
    format!("{file}\n")
}

/// A path as settings of SuperSplat's viewer: a keyframe for each frame. It knows no roll, and of
/// the fields of view older ones have the first alone.
pub(crate) fn supersplat_text(path: &CameraPath, fps: f64, _size: (u32, u32)) -> String {
    let axes = Axes::YUpZForward;
    let count = (path.duration() * fps).round() as usize + 1;
    let keys: Vec<PathKey> = (0..count).map(|frame| path.key_at(path.start() + frame as f64 / fps)).collect();
    let eye = |key: &PathKey| axes.direction(key.eye).to_array();
    let target = |key: &PathKey| axes.direction(key.eye + key.rotation.inverse() * DVec3::Z).to_array();
    let (eyes, targets): (Vec<_>, Vec<_>) = keys.iter().map(|key| (eye(key), target(key))).unzip();
    let fovs: Vec<f64> = keys.iter().map(|key| key.fov).collect();
    let file = json!({
        "camera": {
            "fov": fovs[0],
            "position": eyes[0],
            "target": targets[0],
            "startAnim": "animTrack",
            "animTrack": "cameraAnim",
        },
        "background": { "color": [0, 0, 0] },
        "animTracks": [{
            "name": "cameraAnim",
            "duration": count as f64 / fps,
            "frameRate": fps,
            "target": "camera",
            "loopMode": "none",
            "interpolation": "spline",
            "smoothness": 0,
            "keyframes": {
                "times": (0..count).collect::<Vec<_>>(),
                "values": { "position": eyes.as_flattened(), "target": targets.as_flattened(), "fov": fovs },
            },
        }],
    });
    format!("{file}\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Vec<PathKey>, String> {
        keys(text, DVec3::NEG_Y, None).expect("a known program").map(|(keys, _)| keys)
    }

    #[test]
    fn paths_that_are_written_come_back() {
        // Without roll, which a target cannot say.
        let key = |i: f64| PathKey {
            time: i,
            eye: DVec3::new(i, 2.0 * i, -1.0),
            rotation: DQuat::from_rotation_x(0.2) * DQuat::from_rotation_y(0.3 * i),
            fov: 50.0 + i,
        };
        let path = CameraPath::new(vec![key(0.0), key(1.0), key(3.0)], 0.1).unwrap();
        for text in [nerfstudio_text(&path, 10.0, (640, 480)), supersplat_text(&path, 10.0, (640, 480))] {
            let again = read(&text).unwrap();
            // Of nerfstudio 30 pictures of a tenth of a second, and the end of the last.
            assert_eq!(again.len(), 31);
            for (i, key) in again[..30].iter().enumerate() {
                let there = path.key_at(i as f64 / 10.0);
                assert!((key.time - i as f64 / 10.0).abs() < 1e-12 && (key.fov - there.fov).abs() < 1e-9);
                let turn = key.rotation.angle_between(there.rotation);
                assert!((key.eye - there.eye).length() < 1e-9 && turn < 1e-6, "{i}: {turn}");
            }
        }
    }

    #[test]
    fn frames_of_blender_have_its_rate_and_angles() {
        let text = r#"{"camera_angle_x": 1.5707963267948966, "w": 1600, "h": 800, "frames": [
            {"file_path": "a", "transform_matrix": [[1,0,0,4], [0,1,0,5], [0,0,1,6], [0,0,0,1]]},
            {"file_path": "b", "transform_matrix": [[1,0,0,4], [0,1,0,5], [0,0,1,7], [0,0,0,1]], "fl_y": 400, "h": 800}]}"#;
        let [first, second, end] = read(text).unwrap()[..] else { panic!("two keys and the end") };
        assert_eq!((first.eye, second.time), (DVec3::new(4.0, 5.0, 6.0), 1.0 / 24.0));
        assert_eq!((end.eye, end.time), (DVec3::new(4.0, 5.0, 8.0), 2.0 / 24.0));
        // tan 45 degrees over twice as wide a picture; half the height over the focal length.
        assert!(
            (first.fov - 2.0 * 0.5f64.atan().to_degrees()).abs() < 1e-9 && (second.fov - 90.0).abs() < 1e-9
        );
        let camera = Camera::posed((64, 48), first.fov, first.eye, DMat3::from_quat(first.rotation));
        assert!((camera.forward() - DVec3::NEG_Z).length() < 1e-9);
    }

    #[test]
    fn a_camera_of_nerfstudio_looks_along_its_minus_z() {
        let text = r#"{"camera_path": [{"camera_to_world": [1,0,0,4, 0,1,0,5, 0,0,1,6, 0,0,0,1], "fov": 60}], "fps": 24}"#;
        let [key] = read(text).unwrap()[..] else { panic!("one key") };
        let camera = Camera::posed((64, 48), key.fov, key.eye, DMat3::from_quat(key.rotation));
        assert!(
            (camera.forward() - DVec3::NEG_Z).length() < 1e-9 && (camera.up() - DVec3::Y).length() < 1e-9
        );
        assert_eq!((key.eye, key.fov), (DVec3::new(4.0, 5.0, 6.0), 60.0));
    }

    #[test]
    fn paths_of_nerfstudio_keep_their_pictures_and_their_size() {
        let pose = r#"{"camera_to_world": [1,0,0,4, 0,1,0,5, 0,0,1,6, 0,0,0,1], "fov": 60}"#;
        for (rate, is_cycle, size) in [
            (r#""fps": 24, "seconds": 0.125"#, false, Some((1920, 1080))),
            (r#""seconds": 0.125"#, true, None),
        ] {
            let sides = if size.is_some() { r#","render_width": 1920, "render_height": 1080.0"# } else { "" };
            let text = format!(
                r#"{{"camera_path": [{pose}, {pose}, {pose}], {rate}, "is_cycle": {is_cycle} {sides}}}"#
            );
            let (read, found) = keys(&text, DVec3::Z, None).unwrap().unwrap();
            let path = CameraPath::new(read, 0.1).unwrap();
            assert_eq!((path.keys().len(), path.duration(), found), (4, 0.125, size));
            let again: Value = serde_json::from_str(&nerfstudio_text(&path, 24.0, (64, 48))).unwrap();
            assert_eq!(again["camera_path"].as_array().unwrap().len(), 3);
            assert_eq!((&again["seconds"], &again["render_width"]), (&json!(0.125), &json!(64)));
        }
        let text = format!(r#"{{"camera_path": [{pose}], "render_width": 0, "render_height": 3}}"#);
        assert!(keys(&text, DVec3::Z, None).unwrap().unwrap_err().contains("which is no size of a picture"));
    }

    #[test]
    fn a_track_of_supersplat_is_turned_to_the_ply() {
        let text = r#"{"camera": {"fov": 65}, "animTracks": [{"frameRate": 30, "keyframes": {"times": [0, 60],
            "values": {"position": [1,2,3, 1,2,4], "target": [0,2,3, 0,2,4]}}}]}"#;
        let [first, second] = read(text).unwrap()[..] else { panic!("two keys") };
        assert_eq!((first.eye, second.time, second.fov), (DVec3::new(-1.0, -2.0, 3.0), 2.0, 65.0));
        let camera = Camera::posed((64, 48), 50.0, first.eye, DMat3::from_quat(first.rotation));
        assert!((camera.forward() - DVec3::X).length() < 1e-9);
    }

    #[test]
    fn what_is_wrong_is_told() {
        for (text, says) in [
            (r#"{"camera_path": 3}"#, "invalid type"),
            (r#"{"camera_path": [{"camera_to_world": [1, 2]}]}"#, "camera 1: camera_to_world has fewer"),
            (r#"{"camera_path": [{"camera_to_world": [2,0,0,0,0,1,0,0,0,0,1,0]}]}"#, "is not a rotation"),
            (r#"{"camera_path": [], "fps": 0}"#, "0 is not a frame rate"),
            (r#"{"camera_path": [], "camera_type": "fisheye"}"#, "\"fisheye\" is not supported"),
            (r#"{"animTracks": []}"#, "no track"),
            (r#"{"frames": [{"file_path": "a"}]}"#, "missing field `transform_matrix`"),
            (r#"{"frames": [{"transform_matrix": [[1, 2, 3]]}]}"#, "frame 1: transform_matrix has fewer"),
            (r#"{"frames": [{"transform_matrix": [[1,0,0,0],[0,1,0,0],[0,0,-1,0]]}]}"#, "is not a rotation"),
            (
                r#"{"animTracks": [{"keyframes": {"times": [0], "values": {"position": [1], "target": []}}}]}"#,
                "1 times do not fit",
            ),
        ] {
            let message = read(text).unwrap_err();
            assert!(message.contains(says) && !message.contains('\n'), "{message}");
        }
        assert!(keys("{\"keyframes\": []}", DVec3::Z, None).is_none() && keys("", DVec3::Z, None).is_none());
    }
}
