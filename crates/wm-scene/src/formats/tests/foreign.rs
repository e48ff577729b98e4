//! Files that other programs write and this one does not: older versions, levels of detail, nodes
//! that turn.

use super::{round_trip::plausible, values::glb_parts, values::read_gltf, *};
use crate::testing::data;

fn spz(version: u32, body: &[u8]) -> Vec<u8> {
    let mut bytes = b"NGSP".to_vec();
    bytes.extend(version.to_le_bytes());
    bytes.extend(1u32.to_le_bytes());
    bytes.extend([0, 12, 1, 0]);
    bytes.extend(body);
    // Two members, as programs write that pack on several threads.
    let gzip = |part: &[u8]| sirocco::compress(sirocco::Format::Gzip, sirocco::deflate::Level::FASTEST, part);
    let (start, end) = bytes.split_at(20);
    [gzip(start), gzip(end)].concat()
}

#[test]
fn old_spz_are_read() {
    // Opacity, colours, scales, and the quaternion (0, 1, 0, 0) but for rounding.
    let rest = [128, 128, 128, 255, 144, 160, 176, 255, 127, 128];
    let halves: Vec<u8> =
        [1.5f32, -2.0, 0.25].into_iter().flat_map(|v| half::f16::from_f32(v).to_le_bytes()).collect();
    let fixed = [0, 24, 0, 0, 224, 255, 0, 4, 0];
    for bytes in [spz(1, &[&halves[..], &rest].concat()), spz(2, &[&fixed[..], &rest].concat())] {
        let scene = read_scene_from(Path::new("a.spz"), &bytes[..], None).unwrap();
        // y and z change their signs: SPZ has y up, z back.
        assert_eq!(scene.splats.means, [[1.5, 2.0, -0.25]]);
        assert_eq!(scene.splats.log_scales, [[-1.0, 0.0, 1.0]]);
        assert!(scene.splats.quats[0][1] > 0.999 && scene.splats.quats[0][0].abs() < 0.01);
        assert_eq!(scene.metadata.rasterization, Some(crate::Rasterization::Antialiased));
    }
}

#[test]
fn sog_of_version_1_is_read() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("meta.json");
    let scene = plausible(40, 1);
    write_scene(&path, &scene).unwrap();
    let mut meta: serde_json::Value = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
    for key in ["version", "count", "antialias", "wm"] {
        meta.as_object_mut().unwrap().remove(key);
    }
    meta["means"]["shape"] = serde_json::json!([40, 3]);
    meta["scales"] =
        serde_json::json!({ "mins": [-9.0, -8.0, -7.0], "maxs": [0.0, 0.0, 0.0], "files": ["scales.webp"] });
    meta["sh0"] = serde_json::json!({ "mins": [-1.0, -1.0, -1.0, -5.0], "maxs": [1.0, 1.0, 1.0, 5.0], "files": ["sh0.webp"] });
    meta["shN"] = serde_json::json!({ "mins": -2.0, "maxs": 2.0, "quantization": 8, "files": ["shN_centroids.webp", "shN_labels.webp"] });
    fs::write(&path, meta.to_string()).unwrap();
    let splats = read(&path).unwrap().splats;
    assert_eq!((splats.len(), splats.sh_degree), (40, 1));
    // A byte is a share of the range of its channel: of 255 steps each.
    let is_step = |v: f32, low: f32, high: f32| {
        ((v - low) / (high - low) * 255.0).fract().abs().min(1.0) < 2e-3
            || ((v - low) / (high - low) * 255.0).fract() > 0.998
    };
    assert!(
        splats
            .log_scales
            .iter()
            .all(|s| is_step(s[0], -9.0, 0.0) && is_step(s[1], -8.0, 0.0) && is_step(s[2], -7.0, 0.0))
    );
    assert!(splats.logit_opacities.iter().all(|v| is_step(*v, -5.0, 5.0)));
    assert!(splats.sh.chunks(12).all(|sh| sh[3..].iter().all(|v| is_step(*v, -2.0, 2.0))));
}

#[test]
fn a_level_or_a_budget_is_chosen() {
    let folder = tempdir().unwrap();
    for (name, count) in [("0_0", 100), ("1_0", 30), ("env", 5)] {
        fs::create_dir(folder.path().join(name)).unwrap();
        write_scene(&folder.path().join(name).join("meta.json"), &plausible(count, 1)).unwrap();
    }
    let leaf = |first: [u64; 2], coarse: Option<[u64; 2]>| {
        let mut lods = serde_json::json!({ "0": { "file": 0, "offset": first[0], "count": first[1] } });
        if let Some([offset, count]) = coarse {
            lods["1"] = serde_json::json!({ "file": 1, "offset": offset, "count": count });
        }
        serde_json::json!({ "bound": {}, "lods": lods })
    };
    let mut meta = serde_json::json!({
        "version": 1, "lodLevels": 2, "environment": "env/meta.json", "filenames": ["0_0/meta.json", "1_0/meta.json"],
        "tree": { "children": [leaf([60, 40], Some([0, 30])), leaf([0, 60], None)] },
    });
    let path = folder.path().join("lod-meta.json");
    fs::write(&path, meta.to_string()).unwrap();
    let count = |level| {
        read_scene(folder.path(), &ReadOptions { level, ..Default::default() })
            .map(|scene| scene.splats.len())
    };
    assert_eq!(count(DetailLevel::Finest).unwrap(), 105);
    // A leaf without the level keeps its own.
    assert_eq!(count(DetailLevel::Number(1)).unwrap(), 30 + 60 + 5);
    assert_eq!(count(DetailLevel::Budget(99)).unwrap(), 95);
    assert_eq!(count(DetailLevel::Budget(1)).unwrap(), 95);
    let message = say(&folder, count(DetailLevel::Number(2)));
    assert_eq!(message, "DIR/lod-meta.json: there is no level 2: it has 0 to 1");
    meta["tree"]["children"][1]["lods"]["0"]["count"] = 61.into();
    fs::write(&path, meta.to_string()).unwrap();
    let message = say(&folder, count(DetailLevel::Finest));
    assert_eq!(
        message,
        "DIR/lod-meta.json: SOG: a leaf of lod-meta.json has splats that another has too; export the file again"
    );
}

#[test]
fn nodes_of_a_gltf_move_their_splats() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("a.glb");
    let scene = plausible(20, 2);
    write_scene(&path, &scene).unwrap();
    let (mut json, buffer) = glb_parts(&fs::read(&path).unwrap());
    // A quarter turn about y in glTF's axes, twice the size, then moved.
    json["nodes"] = serde_json::json!([
        { "children": [1], "translation": [1.0, 2.0, 3.0] },
        { "mesh": 0, "rotation": [0.0, 0.5f64.sqrt(), 0.0, 0.5f64.sqrt()], "scale": [2.0, 2.0, 2.0] },
    ]);
    let moved = read_gltf(&folder, json.clone(), &buffer).unwrap().splats;
    for (a, b) in scene.splats.means.iter().zip(&moved.means) {
        // In glTF's axes (-x, -y, z); the turn takes (x, y, z) to (z, y, -x).
        let [x, y, z] = [-a[0], -a[1], a[2]];
        let expected = [-(2.0 * z + 1.0), -(2.0 * y + 2.0), -2.0 * x + 3.0];
        assert!(b.iter().zip(expected).all(|(b, e)| (b - e).abs() < 1e-4), "{b:?} {expected:?}");
    }
    assert!((moved.log_scales[0][0] - scene.splats.log_scales[0][0] - 2f32.ln()).abs() < 1e-5);
    json["nodes"][1]["scale"] = serde_json::json!([1.0, 2.0, 1.0]);
    let message = say(&folder, read_gltf(&folder, json, &buffer));
    assert!(message.contains("node 1 is not scaled alike"), "{message}");
}

/// A chunk of a scene in SOG 2 that others trained and packed.
#[test]
fn the_flowers_are_read() {
    let Some(path) = data("scenes/flowers-sog") else { return };
    let scene = read(&path).unwrap();
    assert_eq!((scene.splats.len(), scene.splats.sh_degree), (26_895, 2));
    assert!((0..scene.splats.len()).all(|i| scene.splats.is_sound(i)));
    let inside = |mean: &[f32; 3]| mean.iter().all(|v| v.abs() < 0.5);
    assert!(scene.splats.means.iter().all(inside));
}
