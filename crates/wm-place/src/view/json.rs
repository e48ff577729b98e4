//! The JSON format of camera paths: reading and writing; described in docs/guide/camera-paths.md.

use super::path::{CameraPath, PathKey};
use super::{DEFAULT_FOV, ViewError, ViewOptions, foreign};
use glam::{DQuat, DVec3};
use serde::{Deserialize, Serialize};
use wm_base::{
    FormatError, Location, Problem,
    files::{LARGE_TEXT, read_text, write_atomically},
    nearest,
};
use wm_scene::Camera;
use wm_scene::survey::Survey;

/// Every key that a file may have.
const KEYS: [&str; 9] = ["keyframes", "up", "fov", "near", "time", "eye", "target", "rotation", "fov"];

/// A file.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    #[serde(skip_serializing_if = "Option::is_none")]
    up: Option<[f64; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    fov: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    near: Option<f64>,
    keyframes: Vec<Keyframe>,
}

/// One of its keyframes; of `target` and `rotation` just one.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Keyframe {
    time: f64,
    eye: [f64; 3],
    #[serde(skip_serializing_if = "Option::is_none")]
    target: Option<[f64; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    rotation: Option<[f64; 4]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    fov: Option<f64>,
}

impl CameraPath {
    /// Reads a path from a JSON file in coordinates of the world. Options win over the values of
    /// the file.
    ///
    /// # Errors
    /// [`ViewError`] if the file cannot be read or makes no path, with the file's name, and line
    /// and column or the keyframe's number.
    pub fn read(file: &std::path::Path, survey: &Survey, options: &ViewOptions) -> Result<Self, ViewError> {
        let text = read_text(file, LARGE_TEXT).map_err(|error| FormatError::reading(file, error))?;
        parse(&text, survey, options)
            .map_err(|(location, message)| FormatError::at(file, location, Problem::Value(message)).into())
    }

    /// Parses a path in our own or another program's format.
    ///
    /// # Errors
    /// [`ViewError::Path`] if it makes no path.
    pub fn parse(text: &str, survey: &Survey, options: &ViewOptions) -> Result<Self, ViewError> {
        parse(text, survey, options)
            .map_err(|(location, message)| ViewError::Path(format!("{message}{location}")))
    }

    /// Returns the text of the file that [`Self::write`] writes: one keyframe per line.
    #[must_use]
    pub fn text(&self, origin: DVec3) -> String {
        let path = self.moved(origin);
        let keyframe = |key: &PathKey| {
            let DQuat { x, y, z, w } = key.rotation;
            let (eye, rotation) = (key.eye.to_array(), Some([w, x, y, z]));
            let keyframe = Keyframe { time: key.time, eye, target: None, rotation, fov: Some(key.fov) };
            // Every number of a path is finite, and nothing else can fail.
            serde_json::to_string(&keyframe).unwrap_or_default()
        };
        let keyframes: Vec<String> = path.keys().iter().map(keyframe).collect();
        format!("{{\"near\":{},\"keyframes\":[\n{}\n]}}\n", path.near(), keyframes.join(",\n"))
    }

    /// Writes the path, of a scene of this origin, to a JSON file in coordinates of the world,
    /// whole or not at all; with the name `camera_path.json` as nerfstudio does, with
    /// `settings.json` as SuperSplat, for pictures of `size` at `fps` frames a second.
    ///
    /// # Errors
    /// [`ViewError`] if the file cannot be written.
    pub fn write(
        &self,
        file: &std::path::Path,
        origin: DVec3,
        fps: f64,
        size: (u32, u32),
    ) -> Result<(), ViewError> {
        let name = file.file_name().unwrap_or_default().as_encoded_bytes();
        let other = FOREIGN_FORMATS.iter().find(|(ending, _)| name.ends_with(ending.as_bytes()));
        // Other programs use the coordinates of the scene file.
        let text = other.map_or_else(|| self.text(origin), |(_, text)| text(self, fps, size));
        Ok(write_atomically(file, |out| Ok(out.write_all(text.as_bytes())?))?)
    }
}

/// Endings of other programs' file names, and the writers of their formats.
const FOREIGN_FORMATS: [(&str, TextOf); 2] =
    [("camera_path.json", foreign::nerfstudio_text), ("settings.json", foreign::supersplat_text)];
type TextOf = fn(&CameraPath, f64, (u32, u32)) -> String;

/// Parses a path; returns the place and the text of an error.
fn parse(text: &str, survey: &Survey, options: &ViewOptions) -> Result<CameraPath, (Location, String)> {
    if text.trim_ascii().is_empty() {
        return Err((Location::Whole, Problem::Empty.to_string()));
    }
    if let Some(keys) = foreign::keys(text, options.up(survey), options.fov) {
        let path = keys.and_then(|(keys, size)| {
            let keys = near_scene(keys, survey);
            let path = CameraPath::new(keys, options.near(survey)).map_err(|error| error.to_string())?;
            Ok(path.with_size(size))
        });
        return path.map_err(|message| (Location::Whole, message));
    }
    let file: File = serde_json::from_str(text).map_err(|error| {
        let location = Location::LineColumn(error.line() as u64, error.column() as u64);
        (location, explained(&error.to_string()))
    })?;
    let whole = |message: String| (Location::Whole, message);
    let up = options.up.or(file.up.map(DVec3::from_array)).unwrap_or(survey.up.value);
    let mut keys = Vec::with_capacity(file.keyframes.len());
    for (index, keyframe) in file.keyframes.iter().enumerate() {
        let fault = |message: &str| whole(format!("keyframe {}: {message}", index + 1));
        let eye = DVec3::from_array(keyframe.eye) - survey.origin;
        let rotation = match (keyframe.target, keyframe.rotation) {
            (Some(target), None) => {
                let target = DVec3::from_array(target) - survey.origin;
                let camera = Camera::looking((1, 1), DEFAULT_FOV, eye, target, up);
                let camera = camera.map_err(|error| fault(&error.to_string()))?;
                DQuat::from_mat3(&camera.rotation())
            }
            (None, Some([w, x, y, z])) => {
                let rotation = DQuat::from_xyzw(x, y, z, w);
                if !(rotation.length() > 1e-9 && rotation.is_finite()) {
                    return Err(fault("rotation [0, 0, 0, 0] is invalid; [1, 0, 0, 0] is the identity"));
                }
                rotation.normalize()
            }
            _ => return Err(fault("give either \"target\" or \"rotation\"")),
        };
        let fov = options.fov.or(keyframe.fov).or(file.fov).unwrap_or(DEFAULT_FOV);
        keys.push(PathKey { time: keyframe.time, eye, rotation, fov });
    }
    let near = ViewOptions { near: options.near.or(file.near), ..*options }.near(survey);
    CameraPath::new(keys, near).map_err(|error| match error {
        ViewError::Path(message) => whole(message),
        other => whole(other.to_string()),
    })
}

/// Keyframes of another program, relative to the origin of the scene. Such programs know no origin:
/// they have looked at the numbers of the scene file, or at those of the capture, whichever are
/// nearer to the scene.
fn near_scene(mut keys: Vec<PathKey>, survey: &Survey) -> Vec<PathKey> {
    let is_world =
        |key: &&PathKey| (key.eye - survey.origin).distance(survey.center) < key.eye.distance(survey.center);
    if 2 * keys.iter().filter(is_world).count() > keys.len() {
        keys.iter_mut().for_each(|key| key.eye -= survey.origin);
    }
    keys
}

/// The message of the JSON reader without the location, and with the key that was meant.
fn explained(message: &str) -> String {
    let message = message.rsplit_once(" at line ").map_or(message, |(text, _)| text);
    let unknown = message.strip_prefix("unknown field `").and_then(|rest| rest.split_once('`'));
    let Some((key, expected)) = unknown else { return message.into() };
    match nearest(key, KEYS.into_iter(), 1)[..] {
        [near] => format!("unknown key \"{key}\"; did you mean \"{near}\"?"),
        _ => format!("unknown key \"{key}\"{expected}"),
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::survey;
    use super::*;
    use proptest::prelude::*;

    fn say(text: &str) -> String {
        let (location, message) = parse(text, &survey(), &ViewOptions::default()).unwrap_err();
        format!("{location}: {message}")
    }

    #[test]
    fn both_kinds_of_keyframes_are_read() {
        let text = r#"{"up": [0, -1, 0], "fov": 40, "near": 0.05, "keyframes": [
            {"time": 0, "eye": [1, 2, 3], "target": [1, 2, 9]},
            {"time": 2.5, "eye": [1, 2, 4], "rotation": [2, 0, 0, 0], "fov": 60}]}"#;
        let path = parse(text, &survey(), &ViewOptions::default()).unwrap();
        let [first, second] = path.keys() else { panic!("two keys") };
        // With y down and looking along z, a camera is not turned at all.
        assert!(first.rotation.angle_between(DQuat::IDENTITY) < 1e-9 && first.fov == 40.0);
        assert_eq!(
            *second,
            PathKey { time: 2.5, eye: DVec3::new(1.0, 2.0, 4.0), rotation: DQuat::IDENTITY, fov: 60.0 }
        );
        assert_eq!(path.near(), 0.05);
        // What is given by hand wins over the file.
        let given = ViewOptions { fov: Some(30.0), near: Some(1.0), up: Some(DVec3::Y), size: None };
        let path = parse(text, &survey(), &given).unwrap();
        assert_eq!((path.keys()[1].fov, path.near()), (30.0, 1.0));
        assert!((path.keys()[0].rotation * DVec3::NEG_Y - DVec3::Y).length() < 1e-9);
    }

    #[test]
    fn what_is_written_is_read() {
        let key = |i: f64| PathKey {
            time: i,
            eye: DVec3::new(i / 3.0, -i, 1e-7 * i),
            rotation: DQuat::from_rotation_y(i),
            fov: 50.0 + i,
        };
        let path = CameraPath::new(vec![key(0.0), key(1.5), key(2.0)], 0.125).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("path.json");
        path.write(&file, DVec3::ZERO, 30.0, (64, 48)).unwrap();
        let again = CameraPath::read(&file, &survey(), &ViewOptions::default()).unwrap();
        for (a, b) in again.keys().iter().zip(path.keys()) {
            assert!((a.eye - b.eye).length() < 1e-12 && (a.time, a.fov) == (b.time, b.fov));
            assert!(a.rotation.angle_between(b.rotation) < 1e-7);
        }
        assert_eq!(again.near(), 0.125);
        // A target does not say which way is up, and the path must not look there.
        let options = ViewOptions { up: Some(DVec3::NEG_Y), ..ViewOptions::default() };
        for name in ["my camera_path.json", "settings.json"] {
            let theirs = folder.path().join(name);
            path.write(&theirs, DVec3::ZERO, 30.0, (64, 48)).unwrap();
            assert_eq!(CameraPath::read(&theirs, &survey(), &options).unwrap().keys().len(), 61);
        }
        let missing =
            CameraPath::read(&folder.path().join("no.json"), &survey(), &ViewOptions::default()).unwrap_err();
        assert!(missing.to_string().ends_with("no.json: no such file or folder; check the path"));
    }

    #[test]
    fn errors_tell_place_and_remedy() {
        let one = |key: &str| format!("{{\"keyframes\": [\n {{{key}}}]}}");
        for (text, expected) in [
            (one(r#""tiem": 0"#), r#", line 2, column 8: unknown key "tiem"; did you mean "time"?"#),
            (
                one(r#""frobnicate": 0"#),
                ", line 2, column 14: unknown key \"frobnicate\", expected one of `time`, `eye`, `target`, \
                 `rotation`, `fov`",
            ),
            (one(r#""time": "0""#), r#", line 2, column 13: invalid type: string "0", expected f64"#),
            (one(r#""time": 0"#), ", line 2, column 12: missing field `eye`"),
            (
                "{\"keyframes\": 3".into(),
                ", line 1, column 15: invalid type: integer `3`, expected a sequence",
            ),
            (r#"{"keyframes": []}"#.into(), ": there are no keyframes"),
            (" \n".into(), ": the file is empty; copy or export it again"),
            (one(r#""time": 0, "eye": [0,0,0]"#), r#": keyframe 1: give either "target" or "rotation""#),
            (
                one(r#""time": 0, "eye": [0,0,0], "rotation": [0,0,0,0]"#),
                ": keyframe 1: rotation [0, 0, 0, 0] is invalid; [1, 0, 0, 0] is the identity",
            ),
            (
                one(r#""time": 0, "eye": [0,0,0], "target": [0,0,1]"#),
                ": keyframe 1: camera from 0,0,0 to 0,0,1 with up 0,0,1 has no direction or no up; look from one \
                 point to another, not along up",
            ),
            (one(r#""time": 1e999, "eye": [0,0,0]"#), ", line 2, column 15: number out of range"),
        ] {
            assert_eq!(say(&text), expected, "{text}");
        }
    }

    const WHOLE: &str = r#"{"up": [0, -1, 0], "fov": 40, "near": 0.05, "keyframes": [
        {"time": 0, "eye": [1, 2, 3], "target": [1, 2, 9]},
        {"time": 2.5, "eye": [1, 2, 4], "rotation": [2, 0, 0, 0], "fov": 60}]}"#;

    /// A path with cameras that can be rendered, or one line.
    fn check(text: &str) -> Result<(), TestCaseError> {
        match parse(text, &survey(), &ViewOptions::default()) {
            Ok(path) => {
                let end = path.start() + path.duration();
                for time in [path.start(), 0.5 * (path.start() + end), end] {
                    prop_assert_eq!(path.at(time, (64, 48)).check(), Ok(()), "{}", text);
                }
            }
            Err((_, message)) => prop_assert!(!message.contains(['\n', '\r']), "{}", message),
        }
        Ok(())
    }

    proptest! {
        #[test]
        fn any_text_is_read_or_refused_in_one_line(text in "(?s).{0,200}") {
            check(&text)?;
        }

        #[test]
        fn mutated_files_are_read_or_refused(
            edits in prop::collection::vec((any::<prop::sample::Index>(), "[-0-9e.,{}\\[\\]\": a-z]", 0..3u8), 1..6),
            end in any::<prop::sample::Index>(),
            cut in any::<bool>(),
        ) {
            let mut bytes = WHOLE.as_bytes().to_vec();
            for (at, by, kind) in edits {
                let at = at.index(bytes.len());
                match kind {
                    0 => bytes[at] = by.as_bytes()[0],
                    1 => bytes.insert(at, by.as_bytes()[0]),
                    _ => { bytes.remove(at); }
                }
            }
            if cut {
                bytes.truncate(end.index(bytes.len()));
            }
            check(&String::from_utf8_lossy(&bytes))?;
        }
    }
}
