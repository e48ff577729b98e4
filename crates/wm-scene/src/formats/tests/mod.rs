mod faults;
mod foreign;
mod round_trip;
mod values;

use super::*;
use crate::{
    Camera, Metadata, Splats,
    splats::Splat,
    testing::{SPLAT, bits},
};
use glam::DVec3;
use proptest::prelude::*;
use std::{fs, path::PathBuf};
use tempfile::{TempDir, tempdir};

fn scene(metres_per_unit: f64) -> Scene {
    let mut splats = Splats::with_capacity(1, 0);
    let mean = [1.0, 2.0, metres_per_unit as f32];
    splats.push(&Splat { mean, log_scale: [-1.0; 3], group: crate::Group::Sky, ..SPLAT });
    let metadata = Metadata { metres_per_unit: Some(metres_per_unit), ..Metadata::default() };
    Scene { splats, metadata, ..Scene::default() }
}

fn read(path: &Path) -> Result<Scene, FormatError> {
    read_scene(path, &ReadOptions::default())
}

/// The message with the folder left out.
fn say<T>(folder: &TempDir, result: Result<T, FormatError>) -> String {
    let message = result.err().expect("an error").to_string();
    assert!(!message.contains(['\n', '\r']), "{message}");
    message.replace(&folder.path().display().to_string(), "DIR")
}

#[test]
fn what_is_no_scene_is_told() {
    let folder = tempdir().unwrap();
    let file = |name: &str, content: &[u8]| {
        let path = folder.path().join(name);
        fs::write(&path, content).unwrap();
        path
    };
    for (path, expected) in [
        (folder.path().join("no.ply"), "DIR/no.ply: no such file or folder; check the path"),
        (
            folder.path().into(),
            "DIR: a folder with no point_cloud/iteration_*/point_cloud.ply, meta.json or lod-meta.json in it; give a \
             scene file, the folder that a 3DGS training wrote, or one of SOG",
        ),
        (file("empty.ply", b""), "DIR/empty.ply: the file is empty; copy or export it again"),
        (
            file("a.rar", b"Rar!\x1a\x07"),
            "DIR/a.rar: of none of the formats that are read (PLY, compressed PLY, SPZ, SOG, SOG folder, streamed SOG, \
             glTF, splat, ksplat): it begins with \"Rar!\\x1a\\x07\"; convert or export the scene again",
        ),
        (
            file("b.PLY", b"plywood is no scene"),
            "DIR/b.PLY: not a PLY file, although its name says so: it begins with \"plywood is no sc\"; convert \
             or export the scene again",
        ),
        (
            file("c.ply", b"\n<!doctype html>"),
            "DIR/c.ply: not a PLY file, although its name says so: it begins with \"\\n<!doctype html>\"; this \
             looks like a web page, download the file itself",
        ),
        (
            file("d.ply", b"version https://git-lfs.github.com/spec/v1\n"),
            "DIR/d.ply: a Git LFS pointer; get the file itself with `git lfs pull`",
        ),
    ] {
        assert_eq!(say(&folder, read(&path)), expected);
    }
    for name in ["e.splat", "e.ksplat", "e.spz", "e.gltf", "meta.json"] {
        let pointer = file(name, b"version https://git-lfs.github.com/spec/v1\n");
        assert!(say(&folder, read(&pointer)).ends_with("get the file itself with `git lfs pull`"), "{name}");
        let page = file(name, b"<!DOCTYPE html><title>Not found");
        assert!(say(&folder, read(&page)).ends_with("a web page, download the file itself"), "{name}");
    }
}

#[test]
fn the_content_counts_when_reading_and_the_extension_when_writing() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("a.PLY");
    write_scene(&path, &scene(2.0)).unwrap();
    let other = folder.path().join("a.dat");
    fs::rename(&path, &other).unwrap();
    assert_eq!(read(&other).unwrap(), scene(2.0));
    for (name, extension) in [("b.dat", ".dat"), ("b", ""), ("b.ply.gz", ".gz")] {
        let expected = format!(
            "DIR/{name}: no scene format is written to a name that ends in \"{extension}\"; use .ply, .compressed.ply, \
             .spz, .sog, meta.json, .glb, .splat, .ksplat"
        );
        assert_eq!(say(&folder, write_scene(&folder.path().join(name), &scene(2.0))), expected);
    }
    for (name, format) in [
        ("x.Ply", "PLY"),
        ("x.compressed.ply", "compressed PLY"),
        ("compressed.ply", "PLY"),
        ("x/meta.json", "SOG folder"),
        ("x.SPZ", "SPZ"),
    ] {
        assert_eq!(format_for(Path::new(name)).unwrap().name, format, "{name}");
    }
    assert!(format_for(Path::new("lod-meta.json")).is_err() && format_for(Path::new("x.meta.json")).is_err());
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
}

#[test]
fn a_failed_write_leaves_nothing_new() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("a.ply");
    assert_eq!(
        say(&folder, write_scene(&path, &Scene::default())),
        "DIR/a.ply: there are no splats in it; nothing can be shown"
    );
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
    assert_eq!(
        say(&folder, write_scene(&folder.path().join("no/a.ply"), &scene(1.0))),
        "DIR/no/a.ply: cannot be written: the folder \"DIR/no\" does not exist; create it first"
    );
}

#[test]
fn the_sidecar_wins_key_by_key() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("a.ply");
    write_scene(
        &path,
        &Scene { metadata: Metadata { ground: Some(3.0), ..scene(2.0).metadata }, ..scene(2.0) },
    )
    .unwrap();
    let beside = Metadata { metres_per_unit: Some(5.0), up: Some(DVec3::Y), ..Metadata::default() };
    write_sidecar(&path, &beside).unwrap();
    let expected = Metadata { ground: Some(3.0), ..beside };
    assert_eq!(read(&path).unwrap().metadata, expected);
    fs::write(sidecar_path(&path), "metres_per_unit = 1.0\nup = [0, 2, 0]\n").unwrap();
    assert_eq!(
        say(&folder, read(&path)),
        "DIR/a.ply.wm.toml, line 2, column 1: up is [0, 2, 0]: it must have length 1; correct or remove it"
    );
}

/// A training folder with the iterations given; each has its number as metres per unit.
fn training(iterations: &[u32]) -> TempDir {
    let folder = tempdir().unwrap();
    for iteration in iterations {
        let path = folder.path().join(format!("point_cloud/iteration_{iteration}/point_cloud.ply"));
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        write_scene(&path, &scene(f64::from(*iteration))).unwrap();
    }
    folder
}

const CAMERA: &str = r#"{"id": 0, "img_name": "a b.jpg", "width": 1200, "height": 800,
 "position": [1.0, 2.0, 3.0],
 "rotation": [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
 "fy": 900.0, "fx": 1000.0}"#;

#[test]
fn the_last_iteration_of_a_training_is_read() {
    let folder = training(&[7000, 30_000, 9000]);
    fs::create_dir_all(folder.path().join("point_cloud/iteration_90000")).unwrap();
    fs::create_dir_all(folder.path().join("point_cloud/iteration_best")).unwrap();
    assert_eq!(read(folder.path()).unwrap(), scene(30_000.0));
    let beside = Metadata { ground: Some(1.0), ..Metadata::default() };
    write_sidecar(folder.path(), &beside).unwrap();
    assert_eq!(read(folder.path()).unwrap().metadata.ground, Some(1.0));
    let expected: PathBuf = folder.path().join("point_cloud/iteration_30000/point_cloud.ply");
    assert_eq!(folder::scene_file(folder.path()).unwrap(), expected);
    assert!(sidecar_path(&expected).is_file());
}

#[test]
fn views_of_a_training_are_read() {
    let folder = training(&[1]);
    fs::write(folder.path().join("cameras.json"), format!("[{CAMERA}]")).unwrap();
    let scene = read(folder.path()).unwrap();
    assert_eq!(bits(&scene.splats).len(), 16);
    let [view] = &scene.views[..] else { panic!("one view") };
    let camera = &view.camera;
    assert_eq!(view.name, "a b.jpg");
    assert_eq!((camera.width, camera.height, camera.cx, camera.cy), (1200, 800, 600.0, 400.0));
    assert_eq!((camera.fx, camera.fy, camera.near), (1000.0, 900.0, Camera::DEFAULT_NEAR));
    assert!((camera.center() - DVec3::new(1.0, 2.0, 3.0)).length() < 1e-12);
    // The third column of world_from_camera is the forward direction.
    assert!((camera.forward() - DVec3::X).length() < 1e-12);
    let ignore = ReadOptions { views: Views::Ignore, ..ReadOptions::default() };
    assert!(read_scene(folder.path(), &ignore).unwrap().views.is_empty());
}

/// Returns the names of the views of a scene, and its height of the ground.
#[cfg(unix)]
fn found_beside(path: &Path) -> (Vec<String>, Option<f64>) {
    let scene = read(path).unwrap();
    (scene.views.into_iter().map(|view| view.name).collect(), scene.metadata.ground)
}

#[cfg(unix)]
#[test]
fn a_link_finds_what_lies_beside_the_file() {
    use std::os::unix::fs::symlink;
    let (store, desk) = (tempdir().unwrap(), tempdir().unwrap());
    let (file, link) = (store.path().join("a.ply"), desk.path().join("b.ply"));
    let named = |name: &str| format!("[{}]", CAMERA.replace("a b.jpg", name));
    let ground = |ground: f64| Metadata { ground: Some(ground), ..Metadata::default() };
    write_scene(&file, &scene(1.0)).unwrap();
    fs::write(cameras_path(&file), named("store.jpg")).unwrap();
    write_sidecar(&file, &ground(1.0)).unwrap();
    symlink(&file, &link).unwrap();
    assert_eq!(found_beside(&link), (vec!["store.jpg".into()], Some(1.0)));
    // What lies beside the link itself wins.
    fs::write(cameras_path(&link), named("desk.jpg")).unwrap();
    write_sidecar(&link, &ground(2.0)).unwrap();
    assert_eq!(found_beside(&link), (vec!["desk.jpg".into()], Some(2.0)));
    assert_eq!(found_beside(&file), (vec!["store.jpg".into()], Some(1.0)));

    // Parts of a scene that has several files.
    let sog = store.path().join("sog/meta.json");
    write_scene(&sog, &scene(1.0)).unwrap();
    let link = desk.path().join("meta.json");
    symlink(&sog, &link).unwrap();
    assert_eq!(read(&link).unwrap().splats.len(), 1);
}

#[cfg(unix)]
#[test]
fn links_into_trainings_find_their_cameras() {
    use std::os::unix::fs::symlink;
    let (training, desk) = (training(&[7]), tempdir().unwrap());
    fs::write(training.path().join("cameras.json"), format!("[{CAMERA}]")).unwrap();
    let file = training.path().join("point_cloud/iteration_7/point_cloud.ply");
    write_sidecar(&file, &Metadata { ground: Some(3.0), ..Metadata::default() }).unwrap();
    let found = (vec!["a b.jpg".to_owned()], Some(3.0));
    assert_eq!(found_beside(&file), found);
    let at = |name: &str| desk.path().join(name);
    symlink(training.path(), at("whole")).unwrap();
    symlink(&file, at("a.ply")).unwrap();
    symlink("a.ply", at("b.ply")).unwrap();
    // A folder of links, as programs make them.
    fs::create_dir(at("parts")).unwrap();
    symlink(training.path().join("point_cloud"), at("parts/point_cloud")).unwrap();
    for name in ["whole", "a.ply", "b.ply", "parts"] {
        assert_eq!(found_beside(&at(name)), found, "{name}");
    }
}

#[test]
fn views_of_a_folder_of_pictures_are_read() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("meta.json");
    write_scene(&path, &scene(1.0)).unwrap();
    fs::write(cameras_path(&path), format!("[{CAMERA}]")).unwrap();
    assert_eq!(read(&path).unwrap().views, read(folder.path()).unwrap().views);
    assert_eq!(read(&path).unwrap().views.len(), 1);
}

#[test]
fn broken_views_have_line_and_column() {
    let folder = training(&[1]);
    let message = |from: &str, to: &str| {
        let text = format!("[{}]", CAMERA.replace(from, to));
        fs::write(folder.path().join("cameras.json"), text).unwrap();
        say(&folder, read(folder.path()))
    };
    for (from, to, expected) in [
        (
            "[0.0, 1.0, 0.0]]",
            "[0.0, 1.0, 1.0]]",
            "its rotation is not a rotation matrix: row 3 has the length 1.414214, not 1",
        ),
        ("\"fy\": 900.0", "\"fy\": 00.1", ""),
        ("\"fy\": 900.0", "\"fy\": 0e+00", "camera fy is 0: must be finite and above 0"),
    ] {
        let expected = match expected {
            "" => "DIR/cameras.json, line 4, column 9: invalid number; correct or remove the file".into(),
            // The parser stands behind the camera when its values are checked.
            fault => format!(
                "DIR/cameras.json, line 4, column 28: the camera of \"a b.jpg\": {fault}; correct or remove \
                 the file"
            ),
        };
        assert_eq!(message(from, to), expected);
    }
    for (from, to, line) in [("2.0, 3.0", "2.0", 2), ("\"fx\"", "\"f\"", 4), ("1200", "-1", 1), ("}", "", 4)]
    {
        let message = message(from, to);
        assert!(message.starts_with(&format!("DIR/cameras.json, line {line}, column ")), "{message}");
        assert!(message.ends_with("; correct or remove the file"), "{message}");
    }
}

#[test]
fn a_stream_is_read() {
    let mut bytes = Vec::new();
    ply::write(&mut bytes, &scene(4.0), ply::PlyEncoding::Ascii).unwrap();
    assert_eq!(read_scene_from(Path::new("stdin"), &bytes[..], None).unwrap(), scene(4.0));
}

/// A change to a text: its place, the new text, and whether to replace, insert or remove.
type Edit = (prop::sample::Index, char, u8);

fn edits() -> impl Strategy<Value = Vec<Edit>> {
    let letter = prop_oneof![prop::sample::select(&b"0123456789-+.eE[]{},:\"= \n"[..]), any::<u8>()];
    prop::collection::vec((any::<prop::sample::Index>(), letter.prop_map(char::from), 0..4u8), 0..6)
}

fn edited(text: &str, edits: &[Edit]) -> String {
    let mut chars: Vec<char> = text.chars().collect();
    for (at, by, kind) in edits {
        let at = at.index(chars.len().max(1)).min(chars.len().saturating_sub(1));
        match kind {
            _ if chars.is_empty() => chars.push(*by),
            0 => chars[at] = *by,
            1 => chars.insert(at, *by),
            2 => _ = chars.remove(at),
            _ => chars.truncate(at),
        }
    }
    chars.into_iter().collect()
}

proptest! {
    #[test]
    fn mutated_cameras_are_read_or_refused_in_one_line(edits in edits()) {
        let folder = tempdir().unwrap();
        fs::write(folder.path().join("cameras.json"), edited(&format!("[{CAMERA}]"), &edits)).unwrap();
        match folder::cameras_in(&folder.path().join("cameras.json")) {
            Ok(views) => prop_assert!(views.iter().flatten().all(|view| view.camera.check().is_ok())),
            Err(error) => prop_assert!(!error.to_string().contains(['\n', '\r']), "{}", error),
        }
    }

    #[test]
    fn mutated_sidecars_are_read_or_refused_in_one_line(edits in edits(), bytes in any::<[u8; 8]>(), raw in any::<bool>()) {
        let text = "metres_per_unit = 2.5\nup = [0.0, -1.0, 0.0]\nground = 0.5\nairlight = [0.7, 0.8, 0.9]\n\
                    rasterization = \"antialiased\"\nprovenance = \"a test\"\n";
        let folder = tempdir().unwrap();
        let file = folder.path().join("a.ply");
        let mut text = edited(text, &edits).into_bytes();
        if raw {
            text.extend(bytes);
        }
        fs::write(sidecar_path(&file), text).unwrap();
        match sidecar::read(&file) {
            Ok(metadata) => prop_assert_eq!(metadata.and_then(|m| m.fault()), None),
            Err(error) => prop_assert!(!error.to_string().contains(['\n', '\r']), "{}", error),
        }
    }
}
