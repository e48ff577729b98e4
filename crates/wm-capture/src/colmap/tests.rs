use super::records::MODELS;
use super::*;
use crate::{self as capture, CaptureView, Observation, read_views};
use glam::DVec3;
use proptest::prelude::*;
use std::fs;
use tempfile::{TempDir, tempdir};
use wm_scene::camera::Distortion;
use wm_scene::testing::data;

/// A model in memory, to be written in either form.
#[derive(Clone, Debug)]
struct Model {
    /// Number, model, width, height, parameters.
    cameras: Vec<(u32, u32, u64, u64, Vec<f64>)>,
    images: Vec<Image>,
    points: Vec<Point>,
}

/// Number, pose, camera, name, 2D points with the number of their 3D point.
type Image = (u32, [f64; 7], u32, String, Vec<(f64, f64, i64)>);

/// Number, position, colour, error, track.
type Point = (u64, [f64; 3], [u8; 3], f64, Vec<[u32; 2]>);

impl Model {
    fn binary(&self) -> [Vec<u8>; 3] {
        let mut cameras = (self.cameras.len() as u64).to_le_bytes().to_vec();
        for (id, model, width, height, parameters) in &self.cameras {
            cameras.extend(id.to_le_bytes());
            cameras.extend(model.to_le_bytes());
            cameras.extend(width.to_le_bytes());
            cameras.extend(height.to_le_bytes());
            parameters.iter().for_each(|v| cameras.extend(v.to_le_bytes()));
        }
        let mut images = (self.images.len() as u64).to_le_bytes().to_vec();
        for (id, pose, camera, name, points) in &self.images {
            images.extend(id.to_le_bytes());
            pose.iter().for_each(|v| images.extend(v.to_le_bytes()));
            images.extend(camera.to_le_bytes());
            images.extend(name.as_bytes());
            images.push(0);
            images.extend((points.len() as u64).to_le_bytes());
            for (x, y, point) in points {
                images.extend(x.to_le_bytes());
                images.extend(y.to_le_bytes());
                images.extend(point.to_le_bytes());
            }
        }
        let mut points = (self.points.len() as u64).to_le_bytes().to_vec();
        for (id, position, color, error, track) in &self.points {
            points.extend(id.to_le_bytes());
            position.iter().for_each(|v| points.extend(v.to_le_bytes()));
            points.extend(color);
            points.extend(error.to_le_bytes());
            points.extend((track.len() as u64).to_le_bytes());
            track.as_flattened().iter().for_each(|v| points.extend(v.to_le_bytes()));
        }
        [cameras, images, points]
    }

    fn text(&self) -> [Vec<u8>; 3] {
        let join = |values: &[f64]| values.iter().map(f64::to_string).collect::<Vec<_>>().join(" ");
        let mut cameras = "# Camera list\n\n".to_owned();
        for (id, model, width, height, parameters) in &self.cameras {
            let model = MODELS[*model as usize];
            cameras += &format!("{id} {model} {width} {height} {}\n", join(parameters));
        }
        let mut images = "# Image list\n#\n\n".to_owned();
        for (id, pose, camera, name, points) in &self.images {
            images += &format!("{id} {} {camera} {name}\n", join(pose));
            images += &points.iter().map(|(x, y, id)| format!("{x} {y} {id}")).collect::<Vec<_>>().join(" ");
            images += "\n";
        }
        let mut points = "# 3D point list\n".to_owned();
        for (id, [x, y, z], [r, g, b], error, track) in &self.points {
            points += &format!("{id} {x} {y} {z} {r} {g} {b} {error}");
            track.iter().for_each(|[image, place]| points += &format!(" {image} {place}"));
            points += "\n";
        }
        [cameras.into_bytes(), images.into_bytes(), points.into_bytes()]
    }
}

fn small_model() -> Model {
    let pose = [0.5, 0.5, 0.5, 0.5, 1.0, 2.0, 3.0];
    Model {
        cameras: vec![
            (7, 1, 1200, 800, vec![1000.0, 900.0, 600.5, 400.25]),
            (2, 0, 640, 480, vec![500.0, 320.0, 240.0]),
        ],
        images: vec![
            (4, pose, 7, "b two.jpg".into(), vec![(1.5, 2.5, 90), (3.0, 4.0, -1), (5.0, 6.0, 5)]),
            (1, [2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], 2, "a.jpg".into(), vec![]),
        ],
        points: vec![
            (5, [1.0, -2.0, 3.0], [1, 2, 3], 0.5, vec![[4, 2]]),
            (90, [4.0, 5.0, 6.0], [4, 5, 255], -1.0, vec![[4, 0], [1, 7]]),
        ],
    }
}

/// A folder with the two files of a model at `place`.
fn folder_with(place: &str, extension: &str, files: &[Vec<u8>; 3]) -> TempDir {
    let folder = tempdir().unwrap();
    let path = folder.path().join(place);
    fs::create_dir_all(&path).unwrap();
    for (name, content) in ["cameras", "images", "points3D"].into_iter().zip(files) {
        fs::write(path.join(format!("{name}.{extension}")), content).unwrap();
    }
    folder
}

/// The files in memory, without a folder; without the third one 2D points are stepped over.
fn read_model(kind: &Kind, files: &[&[u8]]) -> Result<(Images, SparsePoints), FormatError> {
    let open =
        |name, bytes| Source::new(Path::new(name), Box::new(bytes), Some((bytes as &[u8]).len() as u64));
    let cameras = (kind.read_cameras)(&mut open(kind.cameras, files[0]))?;
    let (points, places) = match files.get(2) {
        Some(bytes) => {
            let (points, places) = (kind.read_points)(&mut open(kind.points, bytes))?;
            (points, Some(places))
        }
        None => (SparsePoints::default(), None),
    };
    Ok(((kind.read_images)(&mut open(kind.images, files[1]), &cameras, &places)?, points))
}

fn read_bytes(kind: &Kind, files: [&[u8]; 2]) -> Result<Vec<CaptureView>, FormatError> {
    read_model(kind, &files).map(|((views, _), _)| views)
}

fn say(kind: &Kind, files: [&[u8]; 2]) -> String {
    let message = read_bytes(kind, files).unwrap_err().to_string();
    assert!(!message.contains(['\n', '\r']), "{message}");
    message
}

#[test]
fn a_model_is_found_in_every_place() {
    for place in FOLDERS {
        for (extension, files) in [("bin", small_model().binary()), ("txt", small_model().text())] {
            let folder = folder_with(place, extension, &files);
            let views = read_views(folder.path()).unwrap();
            let [a, b] = &views[..] else { panic!("two views") };
            assert_eq!((a.name.as_str(), b.name.as_str()), ("a.jpg", "b two.jpg"));
            assert_eq!((a.camera.fx, a.camera.fy, a.camera.cx, a.camera.cy), (500.0, 500.0, 320.0, 240.0));
            assert_eq!((b.camera.fx, b.camera.fy, b.camera.cx, b.camera.cy), (1000.0, 900.0, 600.5, 400.25));
            assert_eq!((b.camera.width, b.camera.height), (1200, 800));
            assert_eq!(a.camera.viewmat, glam::DMat4::IDENTITY);
            // This quaternion moves x to y, y to z and z to x.
            let seen = b.camera.viewmat.transform_point3(DVec3::new(10.0, 20.0, 30.0));
            assert!((seen - DVec3::new(31.0, 12.0, 23.0)).length() < 1e-12);
            assert_eq!(read_views(&folder.path().join(place)).unwrap(), views);
        }
    }
}

#[test]
fn folders_without_a_model_are_told() {
    let folder = tempdir().unwrap();
    let say = |path: PathBuf| {
        let message = read_views(&path).unwrap_err().to_string();
        message.replace(&folder.path().display().to_string(), "DIR")
    };
    let expected = "DIR: no COLMAP model, transforms.json, reconstruction.json (OpenSfM) or bundle.out here: of COLMAP cameras.bin and images.bin (or both as .txt) \
                    are needed in the folder itself, in sparse/0, sparse, 0, colmap/sparse/0 or sparse_txt";
    assert_eq!(say(folder.path().into()), expected);
    assert_eq!(say(folder.path().join("no")), "DIR/no: no such file or folder; check the path");
    fs::create_dir(folder.path().join("sparse")).unwrap();
    fs::write(folder.path().join("sparse/cameras.txt"), &small_model().text()[0]).unwrap();
    assert_eq!(say(folder.path().into()), "DIR/sparse/images.txt: no such file or folder; check the path");
    fs::write(folder.path().join("sparse/images.txt"), "# none\n").unwrap();
    assert_eq!(
        say(folder.path().into()),
        "DIR/sparse/images.txt: no image is registered in the model; reconstruct the capture again"
    );
}

#[test]
fn cameras_with_distortion_are_refused_by_name() {
    let cure = "whose distortion is not read; remove it with `colmap image_undistorter --image_path IMAGES \
                --input_path MODEL --output_path DATASET` and give DATASET";
    for (number, name) in MODELS.into_iter().enumerate().skip(5).filter(|(_, name)| *name != "FULL_OPENCV") {
        let mut model = small_model();
        model.cameras[1].1 = number as u32;
        let reason = if name == "EQUIRECTANGULAR" {
            "which is a panorama; cut it into pinhole pictures and reconstruct those"
        } else {
            cure
        };
        let [cameras, images, _] = model.binary();
        let expected = format!("cameras.bin, byte 64: camera 2 has the model {name}, {reason}");
        assert_eq!(say(&KINDS[0], [&cameras, &images]), expected);
        let [cameras, images, _] = model.text();
        let expected = format!("cameras.txt, line 4: camera 2 has the model {name}, {reason}");
        assert_eq!(say(&KINDS[1], [&cameras, &images]), expected);
    }
    let unknown =
        "which is not known; PINHOLE, SIMPLE_PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV and FULL_OPENCV are read";
    let mut model = small_model();
    model.cameras[0].1 = u32::MAX;
    let expected = format!("cameras.bin, byte 8: camera 7 has the model number -1, {unknown}");
    assert_eq!(say(&KINDS[0], [&model.binary()[0], b""]), expected);
    let expected = format!("cameras.txt, line 1: camera 7 has the model LENS, {unknown}");
    assert_eq!(say(&KINDS[1], [b"7 LENS 10 10 1\n", b""]), expected);
}

#[test]
fn broken_binary_models_are_told() {
    let again = "export the model again";
    for (edit, expected) in [
        (
            (|m| m.cameras[0].2 = 1 << 40) as fn(&mut Model),
            "cameras.bin, byte 8: camera 7: picture size 4294967295x800: each side must be 1 to 32768 px, 268435456 px in all",
        ),
        (
            |m| m.cameras[1].4[0] = f64::NAN,
            "cameras.bin, byte 64: camera 2: camera fx is NaN: must be finite and above 0",
        ),
        (|m| m.cameras[1].0 = 7, "cameras.bin, byte 64: camera 7 appears twice"),
        (
            |m| m.images[0].1[..4].fill(0.0),
            "images.bin, byte 8: the rotation of \"b two.jpg\" is not a quaternion",
        ),
        (
            |m| m.images[1].1[4] = f64::INFINITY,
            "images.bin, byte 162: the image \"a.jpg\": camera viewmat is inf: must be finite",
        ),
        (
            |m| m.images[1].2 = 3,
            "images.bin, byte 162: the image \"a.jpg\" has camera 3, which is not in the list of cameras",
        ),
        (|m| m.images[0].3 = "x".repeat(5000), "images.bin, byte 72: a name is longer than 4096 bytes"),
    ] {
        let mut model = small_model();
        edit(&mut model);
        let [cameras, images, _] = model.binary();
        assert_eq!(say(&KINDS[0], [&cameras, &images]), format!("{expected}; {again}"));
    }
    let [cameras, mut images, _] = small_model().binary();
    images[72] = 0xff;
    let expected =
        "images.bin, byte 72: the image name \"\\xff two.jpg\" is not UTF-8; export the model again";
    assert_eq!(say(&KINDS[0], [&cameras, &images]), expected);
}

#[test]
fn counts_are_not_believed() {
    let [mut cameras, mut images, points] = small_model().binary();
    let whole = cameras.clone();
    cameras[..8].copy_from_slice(&u64::MAX.to_le_bytes());
    let again = "copy the file or export the model again";
    assert_eq!(
        say(&KINDS[0], [&cameras, &images]),
        format!("cameras.bin: cut off in camera 3 of {}; {again}", u64::MAX)
    );
    // The count of 2D points of the first image, after its name.
    images[82..90].copy_from_slice(&u64::MAX.to_le_bytes());
    assert_eq!(say(&KINDS[0], [&whole, &images]), format!("images.bin: cut off in image 1 of 2; {again}"));
    let mut many = points.clone();
    many[..8].copy_from_slice(&u64::MAX.to_le_bytes());
    let error = read_model(&KINDS[0], &[&whole, b"", &many]).unwrap_err().to_string();
    assert_eq!(error, format!("points3D.bin: cut off in point 3 of {}; {again}", u64::MAX));
    assert_eq!(say(&KINDS[0], [b"", b""]), "cameras.bin: the file is empty; copy or export it again");
    assert_eq!(
        say(&KINDS[0], [&whole, &[1, 0, 0]]),
        format!("images.bin: cut off in the number of images; {again}")
    );
}

#[test]
fn a_binary_model_cut_at_any_byte_is_an_error() {
    let [cameras, images, points] = small_model().binary();
    assert_eq!(read_bytes(&KINDS[0], [&cameras, &images]).unwrap().len(), 2);
    for end in 0..cameras.len() {
        say(&KINDS[0], [&cameras[..end], &images]);
    }
    for end in 0..images.len() {
        say(&KINDS[0], [&cameras, &images[..end]]);
        assert!(read_model(&KINDS[0], &[&cameras, &images[..end], &points]).is_err());
    }
    for end in 0..points.len() {
        let error = read_model(&KINDS[0], &[&cameras, &images, &points[..end]]).unwrap_err().to_string();
        assert!(error.starts_with("points3D.bin: ") && !error.contains('\n'), "{error}");
    }
}

#[test]
fn broken_text_models_have_their_line() {
    let cameras = b"1 PINHOLE 1200 800 1000 1000 600 400\n";
    let good = "1 1 0 0 0 0 0 0 1 a.jpg\n\n";
    assert_eq!(read_bytes(&KINDS[1], [cameras, good.as_bytes()]).unwrap().len(), 1);
    let again = "export the model again";
    let correct = "correct it or export the file again";
    for (line, expected) in [
        ("1 PINHOLE 1200 800 1000 1000 600", format!("the camera has no further parameter; {again}")),
        ("1 PINHOLE 1200 800 1 1 1 1 1", format!("camera 1 has more than 4 parameters; {again}")),
        (
            "x PINHOLE 1200 800 1 1 1 1",
            format!("\"x\" is not a number for the number of a camera; {correct}"),
        ),
        ("1 PINHOLE 1200 8e2 1 1 1 1", format!("\"8e2\" is not a number for the height; {correct}")),
        ("1", format!("the camera has no model; {again}")),
    ] {
        let text = format!("# one\n\n{line}\n");
        assert_eq!(say(&KINDS[1], [text.as_bytes(), b""]), format!("cameras.txt, line 3: {expected}"));
    }
    for (line, expected) in [
        ("2 1 0 0 0 0 0 0 1", format!("the image has no name; {again}")),
        ("2 1 0 0 0 0 0", format!("the image has no complete pose; {again}")),
        ("2 1 0 0 zero 0 0 0 1 b.jpg", format!("\"zero\" is not a number for a pose; {correct}")),
        ("2 1 0 0 0 0 0 0 9 b.jpg", {
            format!("the image \"b.jpg\" has camera 9, which is not in the list of cameras; {again}")
        }),
    ] {
        let text = format!("{good}{line}\r\n\r\n");
        assert_eq!(say(&KINDS[1], [cameras, text.as_bytes()]), format!("images.txt, line 3: {expected}"));
    }
    let packed = "1 1 0 0 0 0 0 0 1 a.jpg\n2 1 0 0 0 0 0 0 1 b.jpg\n";
    assert_eq!(
        say(&KINDS[1], [cameras, packed.as_bytes()]),
        format!(
            "images.txt, line 2: the line after an image is not a list of 2D points (x y number), empty if there \
             are none; {again}"
        )
    );
    assert_eq!(
        say(&KINDS[1], [cameras, b"1 1 0 0 0 0 0"]),
        "images.txt, line 1: cut off in the last line; copy the file or export the model again"
    );
}

#[test]
fn text_with_other_line_ends_and_a_missing_last_line() {
    let cameras = b"  # c\r\n\r\n 1 SIMPLE_PINHOLE 10 20 5 5 10 \r\n";
    let images = b"\r\n1 1 0 0 0 0 0 0 1  two  words.jpg \r\n\r\n#\r\n2 1 0 0 0 0 0 0 1 last";
    let views = read_bytes(&KINDS[1], [cameras, images]).unwrap();
    let names: Vec<&str> = views.iter().map(|v| v.name.as_str()).collect();
    assert_eq!(names, ["two  words.jpg", "last"]);
}

proptest! {
    #[test]
    fn both_forms_give_the_same(
        poses in prop::collection::vec(prop::array::uniform7(-5.0..5.0f64), 1..5),
        points in prop::collection::vec((-1e6..1e6f64, -1e6..1e6f64, -1..100i64), 0..5),
        name in "[^\\p{C}\\p{Z}#\\\\]{1,9}( [^\\p{C}\\p{Z}\\\\]{1,9})?",
    ) {
        let mut model = small_model();
        model.images = poses.into_iter().enumerate().map(|(index, pose)| {
            (index as u32, pose, 7, format!("{name}{index}"), points.clone())
        }).collect();
        let (binary, text) = (model.binary(), model.text());
        let from_binary = read_model(&KINDS[0], &[&binary[0], &binary[1], &binary[2]]).unwrap();
        let from_text = read_model(&KINDS[1], &[&text[0], &text[1], &text[2]]).unwrap();
        prop_assert_eq!(&from_binary.0, &from_text.0);
        prop_assert_eq!(&from_binary.1.positions, &from_text.1.positions);
        let seen = points.iter().filter(|(_, _, id)| [5, 90].contains(id)).count();
        prop_assert!(from_binary.0.1.iter().all(|o| o.len() == seen));
        for (view, image) in from_binary.0.0.iter().zip(&model.images) {
            prop_assert_eq!(&view.name, &image.3);
            prop_assert!((view.camera.rotation().determinant() - 1.0).abs() < 1e-12);
            prop_assert_eq!(view.camera.viewmat.w_axis.truncate().to_array(), [image.1[4], image.1[5], image.1[6]]);
        }
    }

    #[test]
    fn mutated_models_never_panic(
        kind in 0..2usize,
        file in 0..3usize,
        edits in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>(), 0..4u8), 1..6),
    ) {
        let mut files = if kind == 0 { small_model().binary() } else { small_model().text() };
        for (at, byte, edit) in edits {
            let bytes = &mut files[file];
            if bytes.is_empty() {
                break;
            }
            let at = at.index(bytes.len());
            match edit {
                0 => bytes[at] = byte,
                1 => bytes.insert(at, byte),
                2 => { bytes.remove(at); }
                _ => bytes.truncate(at),
            }
        }
        check(&KINDS[kind], &[&files[0], &files[1]])?;
        check(&KINDS[kind], &[&files[0], &files[1], &files[2]])?;
    }

    #[test]
    fn random_bytes_never_panic(
        kind in 0..2usize,
        cameras in prop::collection::vec(any::<u8>(), 0..200),
        images in prop::collection::vec(any::<u8>(), 0..200),
        points in prop::collection::vec(any::<u8>(), 0..200),
    ) {
        check(&KINDS[kind], &[&cameras, &images])?;
        check(&KINDS[kind], &[&small_model().binary()[0], &images, &points])?;
    }
}

/// Reads; what comes out may not be larger than the input allows: an image takes 20 bytes at least,
/// a point 16.
fn check(kind: &Kind, files: &[&[u8]]) -> Result<(), TestCaseError> {
    match read_model(kind, files) {
        Ok(((views, _), points)) => {
            prop_assert!(views.len() * 20 <= files[1].len());
            prop_assert!(points.len() * 16 <= files.get(2).map_or(0, |bytes| bytes.len()));
        }
        Err(error) => prop_assert!(!error.to_string().contains(['\n', '\r']), "{}", error),
    }
    Ok(())
}

#[test]
fn real_captures_are_read() {
    for (name, count, size) in [("sceaux-castle", 11, (1200, 887)), ("lund-street", 29, (995, 746))] {
        let Some(path) = data(&format!("photos/{name}")) else { continue };
        let views = read_views(&path).unwrap();
        assert_eq!(views.len(), count);
        for view in &views {
            assert_eq!((view.camera.width, view.camera.height), size);
            assert!(path.join("images").join(&view.name).is_file(), "{}", view.name);
        }
        assert!(views.is_sorted_by(|a, b| a.name < b.name));
    }
}

/// The pose, its direction, the pixel convention, the points and which photo shows which, together:
/// points of the model fall where they were seen. COLMAP keeps points to a few pixels, so that a
/// mean below 1 px leaves no doubt.
#[test]
fn real_points_fall_where_they_were_seen() {
    for (name, points, most) in [("sceaux-castle", 3000, 1.0), ("lund-street", 2105, 1.5)] {
        let Some(path) = data(&format!("photos/{name}")) else { continue };
        let capture = capture::read(&path, &CaptureOptions::default()).unwrap();
        assert!(capture.points.len() >= points, "{}", capture.points.len());
        assert!(capture.images.ends_with("images") && capture.views.iter().all(|view| view.mask.is_none()));
        capture.check_trainable().unwrap();
        let (mut sum, mut count) = (0.0, 0u32);
        for (view, seen) in capture.views.iter().zip(&capture.observations) {
            for observation in seen {
                let point = DVec3::from(capture.points.positions[observation.point as usize]);
                let (x, y) = view.project(point).unwrap();
                let [seen_x, seen_y] = observation.xy.map(f64::from);
                sum += (x - seen_x).hypot(y - seen_y);
                count += 1;
            }
        }
        let mean = sum / f64::from(count);
        eprintln!("{name}: {count} observations, mean {mean:.3} px");
        assert!(count > 4000 && mean < most, "{count}: {mean}");
        let tracks: u32 = capture.points.track_lengths.iter().sum();
        assert_eq!(tracks, count);
    }
}

#[test]
fn real_text_says_what_real_binary_says() {
    let Some(path) = data("photos/sceaux-castle") else { return };
    let binary = capture::read(&path, &CaptureOptions::default()).unwrap();
    let options = CaptureOptions { model: Some("sparse_txt".into()), ..CaptureOptions::default() };
    let text = capture::read(&path, &options).unwrap();
    // Given itself, the folder of the model finds the photos above it.
    assert_eq!(
        capture::read(&path.join("sparse/0"), &CaptureOptions::default()).unwrap().photo(0),
        binary.photo(0)
    );
    assert_eq!(binary.views.len(), text.views.len());
    for (a, b) in binary.views.iter().zip(&text.views) {
        assert!(a.name == b.name && a.camera.viewmat.abs_diff_eq(b.camera.viewmat, 1e-9));
        assert_eq!((a.camera.fx, a.camera.cy), (b.camera.fx, b.camera.cy));
    }
    // Points may stand in another order: they are told by their position.
    let key =
        |capture: &Capture, at: u32| capture.points.positions[at as usize].map(|v| (v * 1e6).round() as i64);
    for (a, b) in binary.observations.iter().zip(&text.observations) {
        let rows = |capture: &Capture, seen: &[Observation]| {
            let mut rows: Vec<_> = seen
                .iter()
                .map(|o| (key(capture, o.point), o.xy.map(|v| (v * 100.0).round() as i64)))
                .collect();
            rows.sort_unstable();
            rows
        };
        assert_eq!(rows(&binary, a), rows(&text, b));
    }
}

#[test]
fn lenses_are_read() {
    let files = |model: &str, parameters: &str| format!("1 {model} 100 80 {parameters}\n");
    for (model, parameters, expected) in [
        ("SIMPLE_PINHOLE", "90 50 40", Distortion::None),
        ("PINHOLE", "90 90 50 40", Distortion::None),
        ("SIMPLE_RADIAL", "90 50 40 0.1", Distortion::Radial { k1: 0.1, k2: 0.0 }),
        ("SIMPLE_RADIAL", "90 50 40 0", Distortion::None),
        ("RADIAL", "90 50 40 0.1 -0.2", Distortion::Radial { k1: 0.1, k2: -0.2 }),
        (
            "OPENCV",
            "90 90 50 40 .1 .2 .3 .4",
            Distortion::OpenCv { k1: 0.1, k2: 0.2, p1: 0.3, p2: 0.4, k3: 0.0 },
        ),
        (
            "FULL_OPENCV",
            "90 90 50 40 .1 .2 .3 .4 .5 0 0 0",
            Distortion::OpenCv { k1: 0.1, k2: 0.2, p1: 0.3, p2: 0.4, k3: 0.5 },
        ),
    ] {
        let images = b"1 1 0 0 0 0 0 0 1 a.jpg\n\n";
        let views = read_bytes(&KINDS[1], [files(model, parameters).as_bytes(), images]).unwrap();
        assert_eq!(views[0].distortion, expected, "{model}");
        let camera = views[0].camera;
        assert_eq!((camera.fx, camera.fy, camera.cx, camera.cy), (90.0, 90.0, 50.0, 40.0));
    }
    assert_eq!(
        say(&KINDS[1], [files("FULL_OPENCV", "90 90 50 40 .1 .2 .3 .4 .5 0 .1 0").as_bytes(), b""]),
        "cameras.txt, line 1: camera 1 has k4, k5 or k6, which are not read; undistort its photos with `colmap image_undistorter`"
    );
    assert_eq!(
        say(&KINDS[1], [files("RADIAL", "90 50 40 0.1 nan").as_bytes(), b""]),
        "cameras.txt, line 1: camera 1: a coefficient of its distortion is NaN: must be finite; export the model again"
    );
}

#[test]
fn observations_know_their_points() {
    for (kind, files) in KINDS.iter().zip([small_model().binary(), small_model().text()]) {
        let ((views, observations), points) = read_model(kind, &[&files[0], &files[1], &files[2]]).unwrap();
        assert_eq!(views[0].name, "b two.jpg");
        let seen = |point, x, y| Observation { point, xy: [x, y] };
        assert_eq!(observations, [vec![seen(1, 1.5, 2.5), seen(0, 5.0, 6.0)], vec![]]);
        assert_eq!(points.positions, [[1.0, -2.0, 3.0], [4.0, 5.0, 6.0]]);
        assert_eq!(
            (&points.colors[..], &points.track_lengths[..]),
            (&[[1, 2, 3], [4, 5, 255]][..], &[1, 2][..])
        );
        assert!(points.errors[0] == 0.5 && points.errors[1].is_nan());
    }
}

#[test]
fn broken_points_have_their_line() {
    let say = |points: &str| {
        let cameras = b"1 PINHOLE 10 10 5 5 5 5\n";
        read_model(&KINDS[1], &[cameras, b"", points.as_bytes()]).unwrap_err().to_string()
    };
    let again = "export the model again";
    assert_eq!(say("#\n\n1 2 3 4 5\n"), format!("points3D.txt, line 3: the point is not complete; {again}"));
    assert_eq!(
        say("1 0 0 0 1 1 1 0.5 7\n"),
        format!("points3D.txt, line 1: half an entry of the track is missing; {again}")
    );
    assert_eq!(
        say("1 0 0 0 1 1 1 0.5\n1 0 0 0 1 1 1 0.5\n"),
        format!("points3D.txt, line 2: point 1 appears twice; {again}")
    );
    assert_eq!(
        say("1 0 inf 0 1 1 1 0.5\n"),
        format!("points3D.txt, line 1: the position of point 1 is not finite; {again}")
    );
    assert_eq!(
        say("1 0 0 0 1 1 256 0.5\n"),
        "points3D.txt, line 1: \"256\" is not a number for a colour; correct it or export the file again"
    );
    assert_eq!(
        say("1 0 0 0 1 1"),
        "points3D.txt, line 1: cut off in the last line; copy the file or export the model again"
    );
}

/// A capture as its files would give it.
fn capture_of(model: &Model, lens: [f64; 5]) -> Capture {
    let files = model.binary();
    let ((mut views, observations), points) =
        read_model(&KINDS[0], &[&files[0], &files[1], &files[2]]).unwrap();
    for view in &mut views {
        view.distortion = Distortion::of(lens);
    }
    let mut capture = Capture { views, points, observations, ..Capture::default() };
    capture.sort();
    // What is written is the observations there are, so tracks are as long as those.
    capture.points.track_lengths = vec![1, 1];
    capture
}

#[test]
fn what_is_written_comes_back() {
    for lens in
        [[0.0; 5], [0.1, -0.02, 0.0, 0.0, 0.0], [0.1, 0.0, 0.01, 0.02, 0.0], [0.1, 0.0, 0.0, 0.0, -0.03]]
    {
        let capture = capture_of(&small_model(), lens);
        for storage in [write::ColmapStorage::Binary, write::ColmapStorage::Text] {
            let folder = tempdir().unwrap();
            write::write(&capture, &folder.path().join("sparse/0"), storage).unwrap();
            let read = capture::read(folder.path(), &CaptureOptions::default()).unwrap();
            assert_eq!(read.observations, capture.observations);
            assert_eq!(read.points.positions, capture.points.positions);
            assert_eq!(read.points.colors, capture.points.colors);
            assert_eq!(read.points.track_lengths, capture.points.track_lengths);
            for (a, b) in read.views.iter().zip(&capture.views) {
                assert_eq!((&a.name, a.camera_id, a.distortion), (&b.name, b.camera_id, b.distortion));
                assert!(a.camera.viewmat.abs_diff_eq(b.camera.viewmat, 1e-14));
                let numbers =
                    |v: &CaptureView| (v.camera.width, v.camera.fx, v.camera.fy, v.camera.cx, v.camera.cy);
                assert_eq!(numbers(a), numbers(b));
            }
        }
    }
}
