use super::*;
use crate::formats::{
    FORMATS, ReadOptions, Views, folder, lost, read_scene, read_scene_from, write_scene, write_sidecar,
};
use crate::{Camera, Lamp, Severity};
use glam::{DMat3, DQuat};
use proptest::prelude::*;
use std::fs;
use std::path::Path;
use tempfile::tempdir;
use wm_base::random::uniform;

const UTM: DVec3 = DVec3::new(500_000.0, 4_000_000.0, 100.0);

/// Splats of a standard deviation of `size` within 20 units of the origin, but for one on a flat.
fn cloud(count: usize, size: f64) -> Splats {
    let mut splats = Splats::zeroed(count, 0);
    let draw = |index: usize, axis: u64| uniform(index as u64, axis);
    for index in 0..count {
        splats.means[index] = [0, 1, 2].map(|axis| (40.0 * draw(index, axis) - 20.0) as f32);
        splats.quats[index] = [1.0, 0.0, 0.0, 0.0];
        splats.log_scales[index] = [size.ln() as f32; 3];
        splats.sh[3 * index] = 0.25;
    }
    splats
}

fn cloud_at(count: usize, size: f64, origin: DVec3) -> Scene {
    let mut scene = Scene { splats: cloud(count, size), ..Scene::default() };
    scene.metadata.origin = Some(origin);
    scene
}

/// The greatest distance of a splat from where it is in `exact`, in the world.
fn farthest(scene: &Scene, exact: &Scene) -> f64 {
    let world =
        |scene: &Scene, index: usize| wide(scene.splats.means[index]) + scene.metadata.origin_or_zero();
    let off = (0..scene.splats.len()).map(|index| world(scene, index).distance(world(exact, index)));
    off.fold(0.0, f64::max)
}

fn codes(scene: &Scene) -> Vec<(&'static str, Severity)> {
    scene.remarks.iter().map(|remark| (remark.code, remark.severity)).collect()
}

/// A PLY as other programs write it, with x y z of a type.
fn ply(scene: &Scene, encoding: &str, kind: &str, offset: DVec3) -> Vec<u8> {
    let names = [
        "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2",
        "rot_3",
    ];
    let floats: String = names.iter().map(|name| format!("property float {name}\n")).collect();
    let places: String = ["x", "y", "z"].iter().map(|name| format!("property {kind} {name}\n")).collect();
    let count = scene.splats.len();
    let mut out = format!("ply\nformat {encoding} 1.0\nelement vertex {count}\n{places}{floats}end_header\n")
        .into_bytes();
    for index in 0..count {
        let place = (wide(scene.splats.means[index]) + offset).to_array();
        let scale = scene.splats.log_scales[index][0];
        let rest = [0.25, 0.0, 0.0, 1.0, scale, scale, scale, 1.0, 0.0, 0.0, 0.0f32];
        match (encoding, kind) {
            ("ascii", _) => {
                let words = place.iter().map(f64::to_string).chain(rest.iter().map(f32::to_string));
                out.extend(words.collect::<Vec<_>>().join(" ").bytes());
                out.push(b'\n');
            }
            (_, "float") => {
                out.extend(place.iter().flat_map(|v| (*v as f32).to_le_bytes()));
                out.extend(rest.iter().flat_map(|v| v.to_le_bytes()));
            }
            ("binary_big_endian", _) => {
                out.extend(place.iter().flat_map(|v| v.to_be_bytes()));
                out.extend(rest.iter().flat_map(|v| v.to_be_bytes()));
            }
            _ => {
                out.extend(place.iter().flat_map(|v| v.to_le_bytes()));
                out.extend(rest.iter().flat_map(|v| v.to_le_bytes()));
            }
        }
    }
    out
}

fn read_bytes(name: &str, bytes: &[u8]) -> Scene {
    read_scene_from(Path::new(name), bytes, Some(bytes.len() as u64)).unwrap()
}

#[test]
fn origins_are_round_and_the_same_for_strays_and_parts() {
    let place: Vec<DVec3> = cloud(500, 0.1).means.iter().map(|mean| wide(*mean)).collect();
    let at = |by: DVec3| place.iter().map(|point| *point + by).collect::<Vec<_>>();
    assert_eq!(choose(&place, 0.1), None);
    assert_eq!(choose(&at(DVec3::new(1000.0, -1500.0, 3.0)), 0.1), None);
    // 20 km from zero, where steps are of 2 mm: fine for walls, not for leaves.
    assert_eq!(choose(&at(DVec3::new(1_900.0, 0.0, 0.0)), 0.1), None);
    assert_eq!(choose(&at(DVec3::new(1_900.0, 0.0, 0.0)), 0.003), Some(DVec3::new(1_900.0, 0.0, 0.0)));
    let utm = at(DVec3::new(499_960.0, 4_000_030.0, 97.0));
    assert_eq!(choose(&utm, 0.1), Some(DVec3::new(500_000.0, 4_000_000.0, 0.0)));
    assert_eq!(choose(&utm[..100], 0.0), choose(&utm, 0.1));
    let strays = [DVec3::splat(1e20), DVec3::NAN, DVec3::ZERO, DVec3::splat(-3e7)];
    assert_eq!(choose(&[&utm[..], &strays[..]].concat(), 0.1), choose(&utm, 0.1));
    for none in [&[][..], &strays[..1], &[DVec3::NAN]] {
        assert_eq!(choose(none, 0.1), None);
    }
}

#[test]
fn every_format_keeps_an_origin() {
    let folder = tempdir().unwrap();
    let (far, near) = (cloud_at(300, 0.02, UTM), cloud_at(300, 0.02, DVec3::ZERO));
    let near = Scene { metadata: Metadata::default(), ..near };
    for format in FORMATS {
        let Some(ending) = format.extensions.first() else { continue };
        let read = |name: &str, scene: &Scene| {
            let path = match ending.contains(".json") {
                true => folder.path().join(name).join(ending),
                false => folder.path().join(format!("{name}.{ending}")),
            };
            write_scene(&path, scene).unwrap();
            read_scene(&path, &ReadOptions::default()).unwrap()
        };
        let (far, near) = (read("far", &far), read("near", &near));
        assert_eq!(far.metadata.origin, Some(UTM), "{ending}");
        assert_eq!(near.metadata.origin, None, "{ending}");
        assert!(far.splats == near.splats && far.remarks.is_empty(), "{ending}: {:?}", far.remarks);
    }
}

#[test]
fn double_precision_and_text_are_read_to_a_micrometre() {
    let exact = cloud_at(300, 0.005, DVec3::new(4_123_456.0, -500_000.0, 4e6));
    let offset = exact.metadata.origin.unwrap();
    let inputs = [("binary_little_endian", "double"), ("binary_big_endian", "double"), ("ascii", "float")];
    for (encoding, kind) in inputs {
        let scene = read_bytes("a.ply", &ply(&exact, encoding, kind, offset));
        assert_eq!(scene.metadata.origin, Some(DVec3::new(4_123_500.0, -500_000.0, 4e6)), "{encoding}");
        assert!(farthest(&scene, &exact) < 1e-5, "{encoding}");
        assert_eq!(codes(&scene), [("far-origin", Severity::Note)]);
    }
    // Near zero they are what f32 makes of them.
    let near = read_bytes("a.ply", &ply(&exact, "binary_little_endian", "double", DVec3::ZERO));
    assert_eq!(
        (&near.splats.means, near.metadata.origin, near.moved_by),
        (&exact.splats.means, None, DVec3::ZERO)
    );
}

#[test]
fn positions_that_were_rounded_before_are_doubted_where_splats_are_small() {
    for (size, kind, is_doubted) in [(0.005, "float", true), (1.0, "float", false), (0.005, "double", false)]
    {
        let exact = cloud_at(300, size, UTM);
        let scene = read_bytes("a.ply", &ply(&exact, "binary_little_endian", kind, UTM));
        assert_eq!(scene.remarks.iter().any(|r| r.code == COARSE), is_doubted, "{size} {kind}");
        assert!(farthest(&scene, &exact) < if kind == "float" { 0.15 } else { 1e-5 });
        if is_doubted {
            let text = &scene.remarks[1].text;
            assert!(
                text.starts_with("positions have steps of up to 0.25 units, wider than 100 % of"),
                "{text}"
            );
        }
    }
    // f32 that were saved as f64 are no finer.
    let mut exact = cloud_at(300, 0.005, UTM);
    let rounded = |mean: &[f32; 3]| (wide(*mean) + UTM).to_array().map(|v| f64::from(v as f32));
    let means =
        exact.splats.means.iter().map(|m| (DVec3::from_array(rounded(m)) - UTM).to_array().map(|v| v as f32));
    exact.splats.means = means.collect();
    let scene = read_bytes("a.ply", &ply(&exact, "binary_little_endian", "double", UTM));
    assert_eq!(codes(&scene), [("far-origin", Severity::Note), (COARSE, Severity::Doubt)]);
}

/// The JSON of a GLB after a change, with its binary chunk.
fn glb_with(bytes: &[u8], change: impl Fn(&mut serde_json::Value)) -> Vec<u8> {
    let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    let mut json: serde_json::Value = serde_json::from_slice(&bytes[20..20 + length]).unwrap();
    change(&mut json);
    let mut text = json.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let rest = &bytes[20 + length..];
    let words = [2, (20 + text.len() + rest.len()) as u32, text.len() as u32, 0x4e4f_534a];
    let words = words.iter().flat_map(|word: &u32| word.to_le_bytes());
    b"glTF".iter().copied().chain(words).chain(text).chain(rest.iter().copied()).collect()
}

#[test]
fn the_nodes_of_a_gltf_may_stand_far_away() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("a.glb");
    let exact = cloud_at(300, 0.005, UTM);
    write_scene(&path, &exact).unwrap();
    let bytes = fs::read(&path).unwrap();
    // Another program's file: the place of the node, and no word of an origin.
    let foreign = glb_with(&bytes, |json| {
        assert_eq!(json["nodes"][0]["translation"], serde_json::json!([-5e5, -4e6, 100.0]));
        json["asset"].as_object_mut().unwrap().remove("extras");
    });
    let scene = read_bytes("a.glb", &foreign);
    assert_eq!(scene.metadata.origin, Some(DVec3::new(5e5, 4e6, 0.0)));
    assert!(farthest(&scene, &exact) < 1e-5 && codes(&scene).len() == 1);
    // A node that is moved a little is no far place.
    let near =
        glb_with(&foreign, |json| json["nodes"][0]["translation"] = serde_json::json!([1.0, 2.0, 3.0]));
    assert_eq!(read_bytes("a.glb", &near).metadata.origin, None);
}

#[test]
fn one_far_splat_coarsens_an_spz_and_that_is_said() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("a.spz");
    let mut scene = Scene { splats: cloud(300, 0.01), ..Scene::default() };
    let loses = |scene: &Scene| lost(&crate::formats::format_for(&path).unwrap().loses, scene);
    assert!(!loses(&scene).iter().any(|line| line.starts_with("positions")));
    scene.splats.means[7] = [2e5, 0.0, 0.0];
    let line = loses(&scene).into_iter().find(|line| line.starts_with("positions")).unwrap();
    assert!(
        line.starts_with("positions have steps of up to 0.0312 units, wider than 100 % of the splats"),
        "{line}"
    );
    write_scene(&path, &scene).unwrap();
    let read = read_scene(&path, &ReadOptions::default()).unwrap();
    assert_eq!((codes(&read), read.metadata.origin), (vec![(COARSE, Severity::Doubt)], None));
    // At far coordinates all are coarse, as f32 is.
    let mut far = cloud_at(300, 0.01, UTM);
    far.set_origin(DVec3::ZERO);
    assert_eq!(far.metadata.origin, None);
    for name in ["a.spz", "a.ply", "a.sog", "a.splat"] {
        let format = crate::formats::format_for(Path::new(name)).unwrap();
        assert!(
            lost(&format.loses, &far).iter().any(|line| line.starts_with("positions have steps")),
            "{name}"
        );
    }
    write_scene(&path, &far).unwrap();
    let read = read_scene(&path, &ReadOptions::default()).unwrap();
    assert_eq!(codes(&read), [(COARSE, Severity::Doubt), ("far-origin", Severity::Note)]);
    assert_eq!(read.metadata.origin, Some(DVec3::new(5e5, 4e6, 0.0)));
}

/// A far PLY of another program, with metadata and views beside it.
#[test]
fn what_lies_beside_a_far_file_is_moved_with_it_and_back() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("a.ply");
    let exact = cloud_at(300, 0.5, UTM);
    fs::write(&path, ply(&exact, "binary_little_endian", "double", UTM)).unwrap();
    let beside = Metadata {
        up: Some(DVec3::Z),
        ground: Some(98.0),
        lamps: Some(vec![Lamp::new((UTM + DVec3::X).to_array())]),
        water: Some(vec![vec![UTM.to_array(); 3]]),
        ..Metadata::default()
    };
    write_sidecar(&path, &beside).unwrap();
    let camera = Camera::looking((40, 30), 60.0, UTM, UTM + DVec3::Y, DVec3::Z).unwrap();
    let view = SceneView { name: "p.jpg".into(), camera };
    folder::write_cameras(&folder::cameras_path(&path), std::slice::from_ref(&view)).unwrap();
    let scene = read_scene(&path, &ReadOptions::default()).unwrap();
    let origin = DVec3::new(5e5, 4e6, 0.0);
    let Metadata { ground, lamps, water, .. } = scene.metadata.clone();
    assert_eq!((scene.metadata.origin, ground), (Some(origin), Some(98.0)));
    assert_eq!(lamps.unwrap()[0].at, [1.0, 0.0, 100.0]);
    assert_eq!(water.unwrap()[0][0], [0.0, 0.0, 100.0]);
    assert!(scene.views[0].camera.center().distance(UTM - origin) < 1e-6);
    // Beside the file that is left as it is, all is said in its coordinates.
    assert_eq!(scene.metadata_beside_file(scene.metadata.clone()), beside);
    let without = ReadOptions { views: Views::Ignore, ..ReadOptions::default() };
    let again = read_scene(&path, &without).unwrap().as_in_file();
    assert_eq!((again.metadata, again.moved_by), (beside, DVec3::ZERO));
    // A new file and what is beside it are local.
    let copy = folder.path().join("b.spz");
    scene.save(&copy).unwrap();
    let read = read_scene(&copy, &ReadOptions::default()).unwrap();
    assert_eq!((&read.metadata, read.moved_by), (&scene.metadata, DVec3::ZERO));
    assert!(read.views[0].camera.center().distance(scene.views[0].camera.center()) < 1e-9);
    // Views of a capture are those of the world.
    let mut other = read;
    other.set_world_views(vec![view]);
    assert!(other.views[0].camera.center().distance(UTM - origin) < 1e-6);
}

proptest! {
    /// A scene with an origin turns, grows and moves in the world as one without.
    #[test]
    fn similarities_are_those_of_the_world(
        q in prop::array::uniform4(-1.0..1.0f64),
        scale in 0.1..10.0f64,
        t in prop::array::uniform3(-1e3..1e3f64),
    ) {
        let q = DQuat::from_array(q);
        prop_assume!(q.length() > 0.1);
        let rotation = DMat3::from_quat(q.normalize());
        let change = Similarity { scale, rotation, translation: DVec3::from_array(t) };
        let before = cloud_at(20, 0.1, UTM);
        let mut after = before.clone();
        after.metadata = Metadata { up: Some(DVec3::Z), ground: Some(-3.0), ..after.metadata };
        let ground_point = UTM - 3.0 * DVec3::Z;
        change.apply(&mut after);
        let origin = after.metadata.origin.unwrap();
        for (mean, old) in after.splats.means.iter().zip(&before.splats.means) {
            prop_assert!((wide(*mean) + origin).distance(change.point(wide(*old) + UTM)) < 1e-4 * scale);
        }
        let height = after.metadata.up.unwrap().dot(change.point(ground_point) - origin);
        prop_assert!((height - after.metadata.ground.unwrap()).abs() < 1e-6);
    }

    #[test]
    fn any_positions_have_an_origin_that_is_near_to_them_or_none(
        numbers in prop::collection::vec(prop::num::f64::ANY, 0..60),
        size in prop::num::f64::ANY,
    ) {
        let positions: Vec<DVec3> = numbers.chunks_exact(3).map(|p| DVec3::new(p[0], p[1], p[2])).collect();
        if let Some(origin) = choose(&positions, size.abs()) {
            prop_assert!(origin.is_finite() && origin.abs().max_element() <= 1.1 * MAX_COORDINATE);
        }
    }
}
