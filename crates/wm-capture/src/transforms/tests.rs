use super::*;
use crate::{self as capture, read_views};
use proptest::prelude::*;
use std::fs;
use tempfile::{TempDir, tempdir};

/// A camera at (1, 2, 3) with OpenGL axes that are the world's: it looks along -z.
const POSE: &str = "[[1,0,0,1],[0,1,0,2],[0,0,1,3],[0,0,0,1]]";

fn folder_with(json: &str) -> TempDir {
    let folder = tempdir().unwrap();
    fs::write(folder.path().join("transforms.json"), json).unwrap();
    folder
}

fn read_json(json: &str) -> Result<Capture, FormatError> {
    let folder = folder_with(json);
    capture::read(folder.path(), &CaptureOptions::default())
}

fn say(json: &str) -> String {
    let folder = folder_with(json);
    let message = capture::read(folder.path(), &CaptureOptions::default()).unwrap_err().to_string();
    assert!(!message.contains('\n'), "{message}");
    message.replace(&folder.path().display().to_string(), "DIR")
}

/// The first bytes of a PNG of 800 x 600 px.
const PNG: &[u8] = b"\x89PNG\r\n\x1a\n\0\0\0\x0dIHDR\0\0\x03\x20\0\0\x02\x58\x08\x02\0\0\0CRC_\0\0\0\0IDAT";

#[test]
fn axes_are_turned_to_opencv() {
    let json = format!(
        r#"{{"fl_x": 500, "fl_y": 510, "cx": 320, "cy": 240, "w": 640, "h": 480.0, "k1": 0.1, "p2": 0.01,
        "camera_model": "OPENCV", "frames": [{{"file_path": "./images/b.jpg", "transform_matrix": {POSE}}}]}}"#
    );
    let capture = read_json(&json).unwrap();
    let view = &capture.views[0];
    assert_eq!(view.name, "images/b.jpg");
    assert_eq!(view.distortion, Distortion::OpenCv { k1: 0.1, k2: 0.0, p1: 0.0, p2: 0.01, k3: 0.0 });
    assert_eq!((view.camera.fx, view.camera.fy, view.camera.height), (500.0, 510.0, 480));
    assert!((view.camera.center() - DVec3::new(1.0, 2.0, 3.0)).length() < 1e-12);
    assert!((view.camera.forward() - DVec3::NEG_Z).length() < 1e-12);
    assert!((view.camera.up() - DVec3::Y).length() < 1e-12);
}

#[test]
fn frames_may_have_their_own_cameras() {
    let json = format!(
        r#"{{"fl_x": 500, "w": 640, "h": 480, "frames": [
        {{"file_path": "a.png", "transform_matrix": {POSE}}},
        {{"file_path": "b.png", "transform_matrix": {POSE}, "fl_x": 300, "w": 320, "h": 240}},
        {{"file_path": "c.png", "transform_matrix": {POSE}, "camera_angle_x": 1.5707963267948966}},
        {{"file_path": "d.png", "transform_matrix": {POSE}, "mask_path": "masks/x.png"}}]}}"#
    );
    let folder = folder_with(&json);
    fs::create_dir(folder.path().join("masks")).unwrap();
    fs::write(folder.path().join("masks/x.png"), PNG).unwrap();
    let capture = capture::read(folder.path(), &CaptureOptions::default()).unwrap();
    let focal: Vec<f64> = capture.views.iter().map(|view| view.camera.fx).collect();
    assert!((focal[2] - 320.0).abs() < 1e-9, "{focal:?}");
    assert_eq!((focal[0], focal[1]), (500.0, 300.0));
    assert_eq!(capture.views[1].camera.cx, 160.0);
    let cameras: Vec<u32> = capture.views.iter().map(|view| view.camera_id).collect();
    assert_eq!(cameras, [1, 2, 3, 1]);
    assert!(capture.views[3].mask.as_ref().unwrap().ends_with("masks/x.png"));
    assert_eq!(capture.views[0].mask, None);
    fs::remove_file(folder.path().join("masks/x.png")).unwrap();
    let capture = capture::read(folder.path(), &CaptureOptions::default()).unwrap();
    assert_eq!((capture.views[3].mask.clone(), capture.remarks[0].code), (None, "masks-missing"));
}

#[test]
fn photos_say_their_size_where_the_file_does_not() {
    let json = format!(
        r#"{{"camera_angle_x": 1.5707963267948966, "frames": [{{"file_path": "./train/r_0", "transform_matrix": {POSE}}}]}}"#
    );
    let folder = folder_with(&json);
    let message = capture::read(folder.path(), &CaptureOptions::default()).unwrap_err().to_string();
    assert!(message.contains("the frame \"./train/r_0\": the photo is missing"), "{message}");
    fs::create_dir(folder.path().join("train")).unwrap();
    fs::write(folder.path().join("train/r_0.png"), PNG).unwrap();
    for path in [folder.path().to_path_buf(), folder.path().join("transforms.json")] {
        let capture = capture::read(&path, &CaptureOptions::default()).unwrap();
        let camera = capture.views[0].camera;
        assert_eq!((camera.width, camera.height), (800, 600));
        assert!((camera.fx - 400.0).abs() < 1e-9 && camera.fy == camera.fx);
        assert_eq!(capture.photo(0), Some(folder.path().join("train/r_0.png")));
        assert_eq!(read_views(&path).unwrap()[0].camera, camera);
    }
}

#[test]
fn reduced_photos_and_points_are_found() {
    let json = format!(
        r#"{{"fl_x": 500, "w": 640, "h": 480, "ply_file_path": "sparse_pc.ply", "applied_transform":
        [[1,0,0,9],[0,1,0,0],[0,0,1,0]], "frames": [{{"file_path": "images/s/a.png", "transform_matrix": {POSE}}}]}}"#
    );
    let folder = folder_with(&json);
    let ply = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n\
               end_header\n1 2 3\n";
    fs::write(folder.path().join("sparse_pc.ply"), ply).unwrap();
    fs::create_dir_all(folder.path().join("images_2/s")).unwrap();
    fs::write(folder.path().join("images_2/s/a.png"), PNG).unwrap();
    let options = CaptureOptions { images: Some("images_2".into()), ..CaptureOptions::default() };
    let capture = capture::read(folder.path(), &options).unwrap();
    assert_eq!(capture.photo(0), Some(folder.path().join("images_2/s/a.png")));
    assert_eq!(capture.points.positions, [[1.0, 2.0, 3.0]]);
    // Without a file of points, those of the model beside it, moved as the cameras were.
    fs::write(folder.path().join("transforms.json"), json.replace("ply_file_path", "unknown")).unwrap();
    let model = folder.path().join("colmap/sparse/7");
    fs::create_dir_all(&model).unwrap();
    let options = CaptureOptions { images: Some("images_2".into()), ..CaptureOptions::default() };
    assert!(capture::read(&folder.path().join("transforms.json"), &options).is_err());
    for (name, text) in [
        ("cameras.txt", "1 PINHOLE 10 10 5 5 5 5\n"),
        ("images.txt", "1 1 0 0 0 0 0 0 1 a.png\n\n"),
        ("points3D.txt", "4 1 2 3 7 8 9 0.5\n"),
    ] {
        fs::create_dir_all(folder.path().join("colmap/sparse/0")).unwrap();
        fs::write(folder.path().join("colmap/sparse/0").join(name), text).unwrap();
    }
    let capture = capture::read(&folder.path().join("transforms.json"), &options).unwrap();
    assert_eq!(capture.points.positions, [[10.0, 2.0, 3.0]]);
}

#[test]
fn masks_in_subfolders_are_found_without_their_path() {
    let frame = |side: &str| format!(r#"{{"file_path": "images/{side}/0.jpg", "transform_matrix": {POSE}}}"#);
    let folder = folder_with(&format!(
        r#"{{"fl_x": 500, "w": 640, "h": 480, "frames": [{}, {}]}}"#,
        frame("back"),
        frame("front")
    ));
    for file in ["images/back/0.jpg", "images/front/0.jpg", "masks/back/0.png", "masks/front/0.png"] {
        let path = folder.path().join(file);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, PNG).unwrap();
    }
    for masks in [None, Some("masks".into())] {
        let options = CaptureOptions { masks, ..CaptureOptions::default() };
        let capture = capture::read(folder.path(), &options).unwrap();
        let masks: Vec<_> = capture.views.iter().map(|view| view.mask.clone().unwrap()).collect();
        assert_eq!(masks, ["back", "front"].map(|side| folder.path().join(format!("masks/{side}/0.png"))));
        assert!(
            capture.remarks[0].text.starts_with("masks of 2 of 2 photos are used"),
            "{:?}",
            capture.remarks
        );
    }
}

#[test]
fn a_photo_elsewhere_is_not_its_own_mask() {
    let photos = tempdir().unwrap();
    let photo = photos.path().join("a.png");
    fs::write(&photo, PNG).unwrap();
    let path = photo.display().to_string().replace('\\', "/");
    let folder = folder_with(&format!(
        r#"{{"fl_x": 500, "w": 640, "h": 480, "frames": [{{"file_path": "{path}", "transform_matrix": {POSE}}}]}}"#
    ));
    fs::create_dir(folder.path().join("masks")).unwrap();
    let capture = capture::read(folder.path(), &CaptureOptions::default()).unwrap();
    assert_eq!((capture.photo(0), capture.views[0].mask.clone()), (Some(photo), None));
}

#[test]
fn faults_are_told() {
    let frames = |inner: &str, pose: &str| {
        format!(
            r#"{{"w": 640, "h": 480, {inner} "frames": [{{"file_path": "a.png", "transform_matrix": {pose}}}]}}"#
        )
    };
    let cure = "undistort the photos with `colmap image_undistorter` and give its output";
    let start = "DIR/transforms.json: the frame \"a.png\":";
    for (json, expected) in [
        (r#"{"frames": []}"#.to_owned(), "DIR/transforms.json: there are no frames in it; export the capture again".into()),
        (frames("", POSE), format!("{start} it has no focal length: fl_x or camera_angle_x is needed")),
        (
            frames(r#""fl_x": 500, "camera_model": "OPENCV_FISHEYE","#, POSE),
            format!("{start} its camera model OPENCV_FISHEYE is not read; {cure}"),
        ),
        (frames(r#""fl_x": 500, "k4": 0.1,"#, POSE), format!("{start} its lens has k4, which is not read; {cure}")),
        (
            frames(r#""fl_x": 500, "is_fisheye": true,"#, POSE),
            format!("{start} its lens is a fisheye, which is not read; {cure}"),
        ),
        (
            frames(r#""fl_x": 500,"#, "[[1,0,0,1],[0,1,0,2]]"),
            format!("{start} its transform_matrix has 2 rows: 4 are needed"),
        ),
        (
            frames(r#""fl_x": 500,"#, "[[2,0,0,1],[0,1,0,2],[0,0,1,3]]"),
            format!("{start} its transform_matrix is not a rotation with a translation: row 1 has the length 2.000000, not 1"),
        ),
        (frames(r#""fl_x": -1,"#, POSE), format!("{start} camera fx is -1: must be finite and above 0")),
        (
            r#"{"frames": 1}"#.into(),
            "DIR/transforms.json, line 1, column 13: invalid type: integer `1`, expected a sequence; correct the \
             file or export it again"
                .into(),
        ),
    ] {
        assert_eq!(say(&json), expected);
    }
    let json = frames(r#""fl_x": 500,"#, POSE);
    for end in 0..json.len() {
        say(&json[..end]);
    }
}

proptest! {
    #[test]
    fn mutated_files_never_panic(edits in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..4)) {
        let json = format!(
            r#"{{"fl_x": 500, "w": 640, "h": 480, "k1": 0.1, "frames": [{{"file_path": "a.png", "transform_matrix": {POSE}}}]}}"#
        );
        let mut bytes = json.into_bytes();
        for (at, byte) in edits {
            let at = at.index(bytes.len());
            bytes[at] = byte;
        }
        let folder = tempdir().unwrap();
        fs::write(folder.path().join("transforms.json"), bytes).unwrap();
        if let Err(error) = capture::read(folder.path(), &CaptureOptions::default()) {
            prop_assert!(!error.to_string().contains('\n'), "{}", error);
        }
    }
}
