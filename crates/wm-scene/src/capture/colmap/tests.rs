use super::*;
use crate::{capture::read_views, testing::data};
use proptest::prelude::*;
use std::{collections::HashMap, fs, path::PathBuf};
use tempfile::{TempDir, tempdir};

/// A model in memory, to be written in either form.
#[derive(Clone, Debug)]
struct Model {
    /// Number, model, width, height, parameters.
    cameras: Vec<(u32, u32, u64, u64, Vec<f64>)>,
    images: Vec<Image>,
}

/// Number, pose, camera, name, 2D points.
type Image = (u32, [f64; 7], u32, String, Vec<[f64; 2]>);

impl Model {
    fn binary(&self) -> [Vec<u8>; 2] {
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
            for [x, y] in points {
                images.extend(x.to_le_bytes());
                images.extend(y.to_le_bytes());
                images.extend((-1i64).to_le_bytes());
            }
        }
        [cameras, images]
    }

    fn text(&self) -> [Vec<u8>; 2] {
        let join = |values: &[f64]| values.iter().map(f64::to_string).collect::<Vec<_>>().join(" ");
        let mut cameras = "# Camera list\n\n".to_owned();
        for (id, model, width, height, parameters) in &self.cameras {
            let model = MODELS[*model as usize];
            cameras += &format!("{id} {model} {width} {height} {}\n", join(parameters));
        }
        let mut images = "# Image list\n#\n\n".to_owned();
        for (id, pose, camera, name, points) in &self.images {
            images += &format!("{id} {} {camera} {name}\n", join(pose));
            images += &points.iter().map(|[x, y]| format!("{x} {y} -1")).collect::<Vec<_>>().join(" ");
            images += "\n";
        }
        [cameras.into_bytes(), images.into_bytes()]
    }
}

fn small_model() -> Model {
    let pose = [0.5, 0.5, 0.5, 0.5, 1.0, 2.0, 3.0];
    Model {
        cameras: vec![(7, 1, 1200, 800, vec![1000.0, 900.0, 600.5, 400.25]), (2, 0, 640, 480, vec![500.0, 320.0, 240.0])],
        images: vec![
            (4, pose, 7, "b two.jpg".into(), vec![[1.5, 2.5], [3.0, 4.0]]),
            (1, [2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], 2, "a.jpg".into(), vec![]),
        ],
    }
}

/// A folder with the two files of a model at `place`.
fn folder_with(place: &str, extension: &str, files: &[Vec<u8>; 2]) -> TempDir {
    let folder = tempdir().unwrap();
    let path = folder.path().join(place);
    fs::create_dir_all(&path).unwrap();
    for (name, content) in ["cameras", "images"].into_iter().zip(files) {
        fs::write(path.join(format!("{name}.{extension}")), content).unwrap();
    }
    folder
}

/// Both files in memory, without a folder.
fn read_bytes(kind: &Kind, files: [&[u8]; 2]) -> Result<Vec<View>, FormatError> {
    let open = |name, bytes| Source::new(Path::new(name), Box::new(bytes), Some((bytes as &[u8]).len() as u64));
    let cameras = (kind.read_cameras)(&mut open(kind.cameras, files[0]))?;
    (kind.read_images)(&mut open(kind.images, files[1]), &cameras)
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
            assert_eq!(a.camera.viewmat, DMat4::IDENTITY);
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
    let expected = "DIR: no COLMAP model here: cameras.bin and images.bin (or both as .txt) are needed in the \
                    folder itself, in sparse/0, in sparse or in 0";
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
    let cure = "which has distortion; remove it with `colmap image_undistorter --image_path IMAGES \
                --input_path MODEL --output_path DATASET` and give DATASET";
    for (number, name) in MODELS.into_iter().enumerate().skip(2) {
        let mut model = small_model();
        model.cameras[1].1 = number as u32;
        let reason = if name == "EQUIRECTANGULAR" {
            "which is a panorama; cut it into pinhole pictures and reconstruct those"
        } else {
            cure
        };
        let [cameras, images] = model.binary();
        let expected = format!("cameras.bin, byte 64: camera 2 has the model {name}, {reason}");
        assert_eq!(say(&KINDS[0], [&cameras, &images]), expected);
        let [cameras, images] = model.text();
        let expected = format!("cameras.txt, line 4: camera 2 has the model {name}, {reason}");
        assert_eq!(say(&KINDS[1], [&cameras, &images]), expected);
    }
    let unknown = "which is not known; only PINHOLE and SIMPLE_PINHOLE are read";
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
        (|m| m.cameras[1].0 = 7, "cameras.bin, byte 64: camera 7 is there twice"),
        (|m| m.images[0].1[..4].fill(0.0), "images.bin, byte 8: the rotation of \"b two.jpg\" is no quaternion"),
        (
            |m| m.images[1].1[4] = f64::INFINITY,
            "images.bin, byte 138: the image \"a.jpg\": camera viewmat is inf: must be finite",
        ),
        (
            |m| m.images[1].2 = 3,
            "images.bin, byte 138: the image \"a.jpg\" has camera 3, which is not in the list of cameras",
        ),
        (|m| m.images[0].3 = "x".repeat(5000), "images.bin, byte 72: a name is longer than 4096 bytes"),
    ] {
        let mut model = small_model();
        edit(&mut model);
        let [cameras, images] = model.binary();
        assert_eq!(say(&KINDS[0], [&cameras, &images]), format!("{expected}; {again}"));
    }
    let [cameras, mut images] = small_model().binary();
    images[72] = 0xff;
    let expected = "images.bin, byte 72: the image name \"\\xff two.jpg\" is not UTF-8; export the model again";
    assert_eq!(say(&KINDS[0], [&cameras, &images]), expected);
}

#[test]
fn counts_are_not_believed() {
    let [mut cameras, mut images] = small_model().binary();
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
    assert_eq!(say(&KINDS[0], [b"", b""]), "cameras.bin: the file is empty; copy or export it again");
    assert_eq!(
        say(&KINDS[0], [&whole, &[1, 0, 0]]),
        format!("images.bin: cut off in the number of images; {again}")
    );
}

#[test]
fn a_binary_model_cut_at_any_byte_is_an_error() {
    let [cameras, images] = small_model().binary();
    assert_eq!(read_bytes(&KINDS[0], [&cameras, &images]).unwrap().len(), 2);
    for end in 0..cameras.len() {
        say(&KINDS[0], [&cameras[..end], &images]);
    }
    for end in 0..images.len() {
        say(&KINDS[0], [&cameras, &images[..end]]);
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
        ("x PINHOLE 1200 800 1 1 1 1", format!("\"x\" is no number for the number of a camera; {correct}")),
        ("1 PINHOLE 1200 8e2 1 1 1 1", format!("\"8e2\" is no number for the height; {correct}")),
        ("1", format!("the camera has no model; {again}")),
    ] {
        let text = format!("# one\n\n{line}\n");
        assert_eq!(say(&KINDS[1], [text.as_bytes(), b""]), format!("cameras.txt, line 3: {expected}"));
    }
    for (line, expected) in [
        ("2 1 0 0 0 0 0 0 1", format!("the image has no name; {again}")),
        ("2 1 0 0 0 0 0", format!("the image has no complete pose; {again}")),
        ("2 1 0 0 zero 0 0 0 1 b.jpg", format!("\"zero\" is no number for a pose; {correct}")),
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
            "images.txt, line 2: the line after an image is no list of 2D points (x y number), empty if there \
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
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn both_forms_give_the_same(
        poses in prop::collection::vec(prop::array::uniform7(-5.0..5.0f64), 1..5),
        points in prop::collection::vec(prop::array::uniform2(-1e6..1e6f64), 0..5),
        name in "[^\\p{C}\\p{Z}#]{1,9}( [^\\p{C}\\p{Z}]{1,9})?",
    ) {
        let mut model = small_model();
        model.images = poses.into_iter().enumerate().map(|(index, pose)| {
            (index as u32, pose, 7, format!("{name}{index}"), points.clone())
        }).collect();
        let (binary, text) = (model.binary(), model.text());
        let from_binary = read_bytes(&KINDS[0], [&binary[0], &binary[1]]).unwrap();
        let from_text = read_bytes(&KINDS[1], [&text[0], &text[1]]).unwrap();
        prop_assert_eq!(&from_binary, &from_text);
        for (view, image) in from_binary.iter().zip(&model.images) {
            prop_assert_eq!(&view.name, &image.3);
            prop_assert!((view.camera.rotation().determinant() - 1.0).abs() < 1e-12);
            prop_assert_eq!(view.camera.viewmat.w_axis.truncate().to_array(), [image.1[4], image.1[5], image.1[6]]);
        }
    }

    #[test]
    fn mutated_models_never_panic(
        kind in 0..2usize,
        file in 0..2usize,
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
        check(&KINDS[kind], [&files[0], &files[1]])?;
    }

    #[test]
    fn random_bytes_never_panic(
        kind in 0..2usize,
        cameras in prop::collection::vec(any::<u8>(), 0..200),
        images in prop::collection::vec(any::<u8>(), 0..200),
    ) {
        check(&KINDS[kind], [&cameras, &images])?;
    }
}

/// Reads; what comes out may not be larger than the input allows: an image takes 20 bytes at least.
fn check(kind: &Kind, files: [&[u8]; 2]) -> Result<(), TestCaseError> {
    match read_bytes(kind, files) {
        Ok(views) => prop_assert!(views.len() * 20 <= files[1].len()),
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

/// The pose, its direction and the pixel convention together: points of the model fall where they
/// were seen. COLMAP keeps points to a few pixels, so that a mean below 1 px leaves no doubt.
#[test]
fn real_points_fall_where_they_were_seen() {
    let Some(path) = data("photos/sceaux-castle") else { return };
    let views = read_views(&path).unwrap();
    let text = read_views(&path.join("sparse_txt")).unwrap();
    assert_eq!(views.len(), text.len());
    for (a, b) in views.iter().zip(&text) {
        assert!(a.name == b.name && a.camera.viewmat.abs_diff_eq(b.camera.viewmat, 1e-9));
    }
    let open = |name: &str| fs::read_to_string(path.join("sparse_txt").join(name)).unwrap();
    let rows = |text: &str| -> Vec<String> {
        text.lines().filter(|l| !l.starts_with('#')).map(str::to_owned).collect()
    };
    let points: HashMap<i64, DVec3> = rows(&open("points3D.txt"))
        .iter()
        .map(|line| {
            let v: Vec<f64> = line.split(' ').take(4).map(|w| w.parse().unwrap()).collect();
            (v[0] as i64, DVec3::new(v[1], v[2], v[3]))
        })
        .collect();
    let (mut sum, mut count) = (0.0, 0);
    for pair in rows(&open("images.txt")).chunks_exact(2) {
        let view = views.iter().find(|v| pair[0].ends_with(&v.name)).unwrap();
        let numbers: Vec<f64> = pair[1].split_whitespace().map(|w| w.parse().unwrap()).collect();
        for seen in numbers.chunks_exact(3) {
            let Some(point) = points.get(&(seen[2] as i64)) else { continue };
            let (x, y, _) = view.camera.project(*point).unwrap();
            sum += (x - seen[0]).hypot(y - seen[1]);
            count += 1;
        }
    }
    assert!(count > 10_000 && sum / f64::from(count) < 1.0, "{count}: {}", sum / f64::from(count));
}
