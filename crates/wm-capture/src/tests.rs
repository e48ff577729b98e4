use super::*;
use glam::DQuat;
use std::fs;
use tempfile::tempdir;
use wm_scene::survey::{FactSource, Survey};
use wm_scene::testing::data;
use wm_scene::{Metadata, Scene};

/// A COLMAP model of views with these names in `sparse/0`, without points.
fn dataset(folder: &Path, names: &[&str]) {
    let model = folder.join("sparse/0");
    fs::create_dir_all(&model).unwrap();
    fs::write(model.join("cameras.txt"), "1 PINHOLE 10 10 5 5 5 5\n").unwrap();
    let images: Vec<String> = names.iter().map(|name| format!("1 1 0 0 0 0 0 0 1 {name}\n\n")).collect();
    fs::write(model.join("images.txt"), images.concat()).unwrap();
}

fn touch(path: &Path) {
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    fs::write(path, "x").unwrap();
}

#[test]
fn photos_are_found_where_data_sets_have_them() {
    for place in ["images", "input", "rgb", "images_4", ""] {
        let folder = tempdir().unwrap();
        dataset(folder.path(), &["left/a.jpg", "right\\b.JPG"]);
        // A folder that is there but has other files is no better than none.
        fs::create_dir_all(folder.path().join("images")).unwrap();
        let root = folder.path().join(place);
        touch(&root.join("left/a.jpg"));
        touch(&root.join("right/b.png"));
        let capture = read(folder.path(), &CaptureOptions::default()).unwrap();
        assert_eq!(capture.photo(0), Some(root.join("left/a.jpg")), "{place}");
        assert_eq!(capture.views[1].name, "right/b.JPG");
        // With the extension that it has, not that of the model.
        assert_eq!(capture.photo(1), Some(root.join("right/b.png")), "{place}");
    }
}

#[test]
fn the_folder_that_was_asked_for_is_taken_or_missed() {
    let folder = tempdir().unwrap();
    dataset(folder.path(), &["a.jpg"]);
    touch(&folder.path().join("images/a.jpg"));
    touch(&folder.path().join("images_4/a.jpg"));
    touch(&folder.path().join("masks_4/a.jpg.png"));
    touch(&folder.path().join("masks/a.png"));
    let asked = |images: &str| {
        read(folder.path(), &CaptureOptions { images: Some(images.into()), ..CaptureOptions::default() })
    };
    let reduced = asked("images_4").unwrap();
    assert_eq!(reduced.photo(0), Some(folder.path().join("images_4/a.jpg")));
    assert_eq!(reduced.views[0].mask, Some(folder.path().join("masks_4/a.jpg.png")));
    let whole = read(folder.path(), &CaptureOptions::default()).unwrap();
    assert_eq!(whole.photo(0), Some(folder.path().join("images/a.jpg")));
    assert_eq!(whole.views[0].mask, Some(folder.path().join("masks/a.png")));
    let error = asked("images_3").unwrap_err().to_string();
    assert!(error.ends_with("images_3: no such file or folder; check the path"), "{error}");
}

/// The codes of the remarks of a data set, or its error without the folder.
fn remarks(folder: &Path, options: &CaptureOptions) -> Result<Vec<&'static str>, String> {
    match read(folder, options) {
        Ok(capture) => Ok(capture.remarks.iter().map(|remark| remark.code).collect()),
        Err(error) => Err(error.to_string().replace(&folder.display().to_string(), "DIR")),
    }
}

#[test]
fn files_that_are_used_are_counted() {
    let folder = tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let masks = |name: &str| CaptureOptions { masks: Some(name.into()), ..CaptureOptions::default() };
    dataset(folder.path(), &["left/a.jpg", "right/a.jpg", "b.jpg"]);
    ["left/a.jpg", "right/a.jpg", "b.jpg"].iter().for_each(|name| touch(&at("images").join(name)));
    let usual = CaptureOptions::default();
    assert_eq!(remarks(folder.path(), &usual).unwrap(), [] as [&str; 0]);
    touch(&at("masks/other.png"));
    assert_eq!(remarks(folder.path(), &usual).unwrap(), ["masks-unused"]);
    assert_eq!(
        remarks(folder.path(), &masks("masks")).unwrap_err(),
        "DIR/masks: no mask of any of the 3 photos is in it, such as of \"left/a.jpg\"; name another folder"
    );
    touch(&at("masks/right/a.png"));
    touch(&at("masks/B.JPG.PNG"));
    assert_eq!(remarks(folder.path(), &usual).unwrap(), ["masks"]);
    let capture = read(folder.path(), &masks("masks")).unwrap();
    assert!(capture.remarks[0].text.starts_with("masks of 2 of 3 photos are used"), "{:?}", capture.remarks);
    assert_eq!(capture.views[2].mask, Some(at("masks/right/a.png")));
    // Further photos that have no camera, and masks beside them.
    fs::remove_dir_all(at("masks")).unwrap();
    touch(&at("images/b_mask.png"));
    touch(&at("images/c.jpg"));
    assert_eq!(remarks(folder.path(), &usual).unwrap(), ["photos-unused", "masks"]);
    let originals = CaptureOptions { originals: Some(at("camera")), ..CaptureOptions::default() };
    touch(&at("camera/x.jpg"));
    assert!(
        remarks(folder.path(), &originals)
            .unwrap_err()
            .starts_with("DIR/camera: no original of any of the 3")
    );
    touch(&at("camera/b.jpg"));
    assert!(remarks(folder.path(), &originals).unwrap().contains(&"originals"));
}

#[test]
fn photos_of_other_computers_are_found_by_their_names() {
    let folder = tempdir().unwrap();
    dataset(folder.path(), &["D:\\scan\\left\\a 1.jpg", "D:\\scan\\right\\a 1.jpg"]);
    touch(&folder.path().join("images/left/A 1.JPG"));
    touch(&folder.path().join("images/right/a 1.png"));
    let capture = read(folder.path(), &CaptureOptions::default()).unwrap();
    let names: Vec<&str> = capture.views.iter().map(|view| view.name.as_str()).collect();
    assert_eq!(names, ["left/a 1.jpg", "right/a 1.jpg"]);
    assert_eq!(capture.photo(0), Some(folder.path().join("images/left/A 1.JPG")));
    assert_eq!(capture.photo(1), Some(folder.path().join("images/right/a 1.png")));
    assert_eq!(capture.remarks[0].code, "photos-by-name");
    // Both could be the only one there is.
    fs::remove_dir_all(folder.path().join("images")).unwrap();
    touch(&folder.path().join("images/a 1.jpg"));
    let error = read(folder.path(), &CaptureOptions::default()).unwrap_err().to_string();
    assert!(error.contains("could be \"D:") && !error.contains('\n'), "{error}");
}

#[test]
fn the_largest_of_several_models_is_read() {
    let folder = tempdir().unwrap();
    let model = |name: &str, photos: &[&str]| {
        let parts = tempdir().unwrap();
        dataset(parts.path(), photos);
        fs::create_dir_all(folder.path().join("sparse")).unwrap();
        fs::rename(parts.path().join("sparse/0"), folder.path().join("sparse").join(name)).unwrap();
    };
    model("0", &["a.jpg"]);
    model("1", &["b.jpg", "c.jpg", "d.jpg"]);
    model("10", &["e.jpg", "f.jpg", "g.jpg"]);
    let capture = read(folder.path(), &CaptureOptions::default()).unwrap();
    assert_eq!(capture.views[0].name, "b.jpg");
    let text = &capture.remarks[0].text;
    let expected = "sparse/1 is read, which has most photos (3); sparse/0 (1 photos), sparse/10 (3 photos) are passed over";
    assert!(text.contains(expected), "{text}");
    let options = CaptureOptions { model: Some("sparse/0".into()), ..CaptureOptions::default() };
    assert_eq!(remarks(folder.path(), &options).unwrap(), [] as [&str; 0]);
}

#[test]
fn points_and_photos_that_cannot_be_are_told() {
    let folder = tempdir().unwrap();
    dataset(folder.path(), &["a.jpg", "b.jpg", "a.jpg"]);
    let mut points = String::from("1 1e20 0 0 1 2 3 0.5\n");
    (2..14).for_each(|id| points += &format!("{id} 1 2 3 255 255 255 0.5\n"));
    fs::write(folder.path().join("sparse/0/points3D.txt"), points).unwrap();
    let capture = read(folder.path(), &CaptureOptions::default()).unwrap();
    assert_eq!((capture.points.len(), capture.views.len(), capture.observations.len()), (12, 2, 2));
    let codes: Vec<&str> = capture.remarks.iter().map(|remark| remark.code).collect();
    assert_eq!(codes, ["absurd-points", "photos-twice", "equal-colours"]);
}

#[test]
fn captures_that_cannot_be_trained_are_told() {
    let folder = tempdir().unwrap();
    let say = || {
        let capture = read(folder.path(), &CaptureOptions::default()).unwrap();
        let message = capture.check_trainable().unwrap_err().to_string();
        message.replace(&folder.path().display().to_string(), "DIR")
    };
    dataset(folder.path(), &["a.jpg"]);
    assert_eq!(
        say(),
        "DIR: 1 of the photos is registered, at least 3 are needed; take more, with overlap, and reconstruct again"
    );
    dataset(folder.path(), &["a.jpg", "b.jpg"]);
    assert!(say().starts_with("DIR: 2 of the photos are registered"));
    dataset(folder.path(), &["a.jpg", "b.jpg", "c.jpg"]);
    let expected =
        "DIR: the model has no points to start from; reconstruct again, or give a capture with points3D";
    assert_eq!(say(), expected);
    fs::write(folder.path().join("sparse/0/points3D.txt"), "# none\n").unwrap();
    assert_eq!(say(), expected);
}

#[test]
fn views_with_distortion_are_given_without() {
    let folder = tempdir().unwrap();
    dataset(folder.path(), &["a.jpg"]);
    let cameras = folder.path().join("sparse/0/cameras.txt");
    fs::write(&cameras, "1 SIMPLE_RADIAL 640 480 500 320 240 0.1\n").unwrap();
    let views = read_views(folder.path()).unwrap();
    assert!(views[0].camera.width < 640 && views[0].camera.fx == 500.0);
    fs::write(&cameras, "1 SIMPLE_RADIAL 640 480 500 320 240 -1\n").unwrap();
    let error = read_views(folder.path()).unwrap_err().to_string();
    assert!(error.contains("the distortion of the camera of \"a.jpg\" folds over"), "{error}");
}

#[test]
fn neighbours_share_the_most_points() {
    let folder = tempdir().unwrap();
    dataset(folder.path(), &["a.jpg", "b.jpg", "c.jpg"]);
    let mut capture = read(folder.path(), &CaptureOptions::default()).unwrap();
    for _ in 0..4 {
        capture.points.push([0.0; 3], [0; 3], 0.0, 2);
    }
    let seen = |points: &[u32]| points.iter().map(|p| Observation { point: *p, xy: [0.0; 2] }).collect();
    capture.observations = vec![seen(&[0, 1, 2]), seen(&[2]), seen(&[0, 1, 3])];
    assert_eq!(capture.neighbours(0, 5), [(2, 2), (1, 1)]);
    assert_eq!(capture.neighbours(0, 1), [(2, 2)]);
    assert_eq!(capture.neighbours(1, 5), [(0, 1)]);
}

/// The model of a place moved far away: as precise as near zero, relative to an origin.
#[test]
fn far_captures_have_an_origin() {
    let shift = DVec3::new(6_378_137.0, -1_234.5, 4e5);
    let read_at = |shift: DVec3| {
        let folder = tempdir().unwrap();
        let model = folder.path().join("sparse/0");
        fs::create_dir_all(&model).unwrap();
        fs::write(model.join("cameras.txt"), "1 PINHOLE 10 10 5 5 5 5\n").unwrap();
        // Rotations about x, as camera_from_world.
        let image = |index: usize| {
            let quat = DQuat::from_rotation_x(0.3 * index as f64);
            let center = DVec3::new(index as f64, 2.0, 0.5) + shift;
            let [x, y, z] = (-(quat * center)).to_array();
            format!("{} {} {} {} {} {x} {y} {z} 1 {index}.jpg\n\n", index + 1, quat.w, quat.x, quat.y, quat.z)
        };
        fs::write(model.join("images.txt"), (0..4).map(image).collect::<String>()).unwrap();
        let point = |index: usize| {
            let [x, y, z] = (DVec3::new(0.01 * index as f64, (index % 7) as f64, 3.0) + shift).to_array();
            format!("{} {x} {y} {z} 1 2 3 0.5\n", index + 1)
        };
        fs::write(model.join("points3D.txt"), (0..200).map(point).collect::<String>()).unwrap();
        touch(&folder.path().join("images/0.jpg"));
        let views = read_views(folder.path()).unwrap();
        (read(folder.path(), &CaptureOptions::default()).unwrap(), views)
    };
    let (near, near_views) = read_at(DVec3::ZERO);
    let (mut far, far_views) = read_at(shift);
    assert_eq!(near.origin, DVec3::ZERO);
    assert!(!near.remarks.iter().any(|remark| remark.code == "far-origin"));
    assert_eq!(far.origin, DVec3::new(6_378_140.0, -1_230.0, 4e5));
    assert!(far.remarks.iter().any(|remark| remark.code == "far-origin"));
    let off = shift - far.origin;
    for (a, b) in near.views.iter().zip(&far.views) {
        assert!(a.camera.center().distance(b.camera.center() - off) < 1e-6);
    }
    for (a, b) in near.points.positions.iter().zip(&far.points.positions) {
        assert!(DVec3::from(*a).distance(DVec3::from(*b) - off) < 1e-6);
    }
    // Views alone are where the file has them.
    for (a, b) in near_views.iter().zip(&far_views) {
        assert!((a.camera.center() + shift).distance(b.camera.center()) < 1e-6);
    }
    far.set_origin(DVec3::ZERO);
    assert!(far.views[1].camera.center().distance(far_views[1].camera.center()) < 1e-6);
    // Written, it is in the world again.
    let folder = tempdir().unwrap();
    far.set_origin(DVec3::new(6e6, 0.0, 0.0));
    colmap::write::write(&far, &folder.path().join("sparse/0"), colmap::write::ColmapStorage::Binary)
        .unwrap();
    let views = read_views(folder.path()).unwrap();
    assert!(views[1].camera.center().distance(far_views[1].camera.center()) < 1e-6);
}

#[test]
fn photographers_hold_their_cameras_level() {
    // A plane through the points of the road, and one through those of the facade, which is plumb.
    // The castle was photographed from below: the mean of the ups alone is 11 degrees off.
    let (road, facade) = (DVec3::new(-0.003, -1.0, 0.001), DVec3::new(0.231, -0.159, -0.960));
    let found = |name: &str| {
        let views = read_views(&data(&format!("photos/{name}"))?).unwrap();
        Some(Survey::of(&Scene { views, ..Scene::default() }, &Metadata::default()).up)
    };
    let Some(street) = found("lund-street") else { return };
    assert!(street.value.angle_between(road).to_degrees() < 3.0 && street.source == FactSource::Cameras);
    let Some(castle) = found("sceaux-castle") else { return };
    assert!((castle.value.angle_between(facade).to_degrees() - 90.0).abs() < 4.0, "{castle:?}");
}
