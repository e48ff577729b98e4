//! Values that are legal and not finite, or null, in every format.

use super::{round_trip::plausible, *};
use crate::{Group, Severity};

/// Formats with a file of their own, and `lod-meta.json`'s SOG with the others.
fn endings() -> impl Iterator<Item = &'static str> {
    FORMATS.iter().filter_map(|format| format.extensions.first()).copied()
}

pub(super) fn path_of(folder: &TempDir, ending: &str) -> PathBuf {
    folder.path().join(if ending.contains(".json") { ending.into() } else { format!("a.{ending}") })
}

#[test]
fn what_is_flat_stays_flat_and_what_is_opaque_opaque() {
    let folder = tempdir().unwrap();
    for thin in [f32::NEG_INFINITY, -200.0, -18.0] {
        let mut scene = plausible(600, 1);
        for (index, splat) in scene.splats.log_scales.iter_mut().enumerate() {
            splat[index % 3] = thin;
        }
        for (index, logit) in scene.splats.logit_opacities.iter_mut().enumerate() {
            *logit = [f32::INFINITY, f32::NEG_INFINITY][index % 2];
        }
        for ending in endings() {
            let path = path_of(&folder, ending);
            write_scene(&path, &scene).unwrap();
            let back = read(&path).unwrap().splats;
            let opaque = (0..600).filter(|i| back.opacity(*i) > 0.99).count();
            let invisible = (0..600).filter(|i| back.opacity(*i) < 0.004).count();
            assert_eq!((back.len(), opaque, invisible), (600, 300, 300), "{ending}");
            for index in 0..600 {
                let mut scales = back.scales(index);
                scales.sort_by(f64::total_cmp);
                // SPZ has nothing thinner than e^-10.
                assert!(scales[0] < 4.6e-5 && scales[1] > 9e-4, "{ending} {thin}: {scales:?}");
                assert!(!back.faults(index).is_fatal(), "{ending} {thin}");
            }
        }
    }
    // Nothing but flat splats.
    let mut scene = plausible(5, 0);
    scene.splats.log_scales.fill([f32::NEG_INFINITY; 3]);
    for ending in endings() {
        let path = path_of(&folder, ending);
        write_scene(&path, &scene).unwrap();
        assert!(read(&path).unwrap().splats.scales(0)[0] < 4.6e-5, "{ending}");
    }
}

#[test]
fn packed_gltf_keeps_groups_and_states_the_losses_of_spz() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("a.glb");
    let mut scene = plausible(9, 1);
    scene.splats.groups[4] = Group::Sky;
    scene.splats.groups[5] = Group::Snow;
    let options = WriteOptions { gltf: GltfSplats::Spz, ..WriteOptions::default() };
    write_scene_with(&path, &scene, &options).unwrap();
    assert_eq!(read(&path).unwrap().splats.groups, scene.splats.groups);
    scene.splats.log_scales[0] = [-12.0; 3];
    let lines = lost(&gltf::FORMAT.loses_with(&options), &scene);
    assert!(lines.iter().any(|line| line.contains("the size of 1 splats")), "{lines:?}");
    assert!(lines.iter().any(|line| line.contains("rounded: positions")), "{lines:?}");
    assert!(!lines.iter().any(|line| line.contains("sky")), "{lines:?}");
    let cesium = WriteOptions { gltf: GltfSplats::SpzCesium, ..options };
    assert!(lost(&gltf::FORMAT.loses_with(&cesium), &scene)[0].contains("2 splats of the sky or snow"));
}

/// The JSON of a SOG folder, to be changed.
fn meta_of(path: &Path) -> serde_json::Value {
    serde_json::from_slice(&fs::read(path).unwrap()).unwrap()
}

#[test]
fn null_in_a_codebook_continues_the_others() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("meta.json");
    write_scene(&path, &plausible(400, 1)).unwrap();
    let whole = read(&path).unwrap();
    assert_eq!(whole.remarks, []);
    let original = meta_of(&path);
    for (table, places) in [("scales", vec![0]), ("sh0", vec![0, 1, 7, 8, 255]), ("shN", vec![255])] {
        let mut meta = original.clone();
        let values: Vec<f64> =
            meta[table]["codebook"].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect();
        let widest = values.windows(2).map(|pair| pair[1] - pair[0]).fold(0.0, f64::max);
        places.iter().for_each(|place| meta[table]["codebook"][*place] = serde_json::Value::Null);
        fs::write(&path, meta.to_string()).unwrap();
        let scene = read(&path).unwrap();
        assert_eq!((scene.remarks.len(), scene.remarks[0].severity), (1, Severity::Note), "{table}");
        assert!(scene.remarks[0].text.contains(&format!("null in {} of 256 values", places.len())));
        let arrays = [
            (scene.splats.log_scales.as_flattened(), whole.splats.log_scales.as_flattened()),
            (&scene.splats.sh, &whole.splats.sh),
        ];
        for (a, b) in arrays.into_iter().flat_map(|(a, b)| a.iter().zip(b)) {
            assert!(f64::from((a - b).abs()) <= 3.0 * widest, "{table}: {a} {b}");
        }
    }
    let mut meta = original.clone();
    meta["scales"]["codebook"] = vec![serde_json::Value::Null; 256].into();
    fs::write(&path, meta.to_string()).unwrap();
    assert!(say(&folder, read(&path)).contains("a codebook of meta.json has no number"));
}

#[test]
fn what_a_sog_states_wrongly_is_doubted() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("meta.json");
    write_scene(&path, &plausible(400, 1)).unwrap();
    let original = meta_of(&path);
    for (key, value, says) in [
        ("bands", 4.0, "shN.bands is 4, but its palette has SH of degree 1"),
        ("count", 1e300, "but its palette has room for"),
        ("count", 2.0, "splats have an entry of the palette beyond shN.count, 2"),
    ] {
        let mut meta = original.clone();
        meta["shN"][key] = value.into();
        fs::write(&path, meta.to_string()).unwrap();
        let remarks = read(&path).unwrap().remarks;
        assert_eq!((remarks.len(), remarks[0].severity), (1, Severity::Doubt));
        assert!(remarks[0].text.contains(says), "{}", remarks[0]);
    }
    let mut meta = original.clone();
    meta["sh0"]["codebook"].as_array_mut().unwrap().pop();
    fs::write(&path, meta.to_string()).unwrap();
    assert!(
        read(&path).unwrap().remarks[0].text.contains("the codebook of sh0 has 255 values, 256 are needed")
    );
}

/// The JSON and the binary chunk of a GLB.
pub(super) fn glb_parts(bytes: &[u8]) -> (serde_json::Value, Vec<u8>) {
    let length = u32::from_le_bytes(*bytes[12..].first_chunk().unwrap()) as usize;
    (serde_json::from_slice(&bytes[20..20 + length]).unwrap(), bytes[28 + length..].to_vec())
}

/// Reads a glTF of JSON whose one buffer lies beside it.
pub(super) fn read_gltf(
    folder: &TempDir,
    mut json: serde_json::Value,
    buffer: &[u8],
) -> Result<Scene, FormatError> {
    json["buffers"][0]["uri"] = "a.bin".into();
    let path = folder.path().join("a.gltf");
    fs::write(&path, json.to_string()).unwrap();
    fs::write(folder.path().join("a.bin"), buffer).unwrap();
    read(&path)
}

const SPLATTING: &str = "KHR_gaussian_splatting";

#[test]
fn linear_colours_become_srgb() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("a.glb");
    let mut scene = plausible(6, 2);
    // Colours within 0.2 to 0.8 from everywhere.
    scene.splats.sh.chunks_exact_mut(27).for_each(|sh| sh.iter_mut().for_each(|v| *v *= 0.1));
    scene.splats.sh[27..54].iter_mut().skip(3).for_each(|v| *v = 0.0);
    write_scene(&path, &scene).unwrap();
    let (mut json, buffer) = glb_parts(&fs::read(&path).unwrap());
    json["meshes"][0]["primitives"][0]["extensions"][SPLATTING]["colorSpace"] = "lin_rec709_display".into();
    let linear = read_gltf(&folder, json.clone(), &buffer).unwrap();
    assert_eq!((linear.remarks.len(), linear.remarks[0].severity), (1, Severity::Note));
    for index in 0..6 {
        for direction in [[0.6, 0.0, 0.8], [0.0, -1.0, 0.0], [-0.48, 0.64, 0.6]] {
            let shown = crate::sh::color(linear.splats.sh_of(index), direction);
            let expected =
                crate::sh::color(scene.splats.sh_of(index), direction).map(wm_base::color::srgb_encode);
            // What is the same from everywhere is exact; else SH of that degree come near.
            let most = if index == 1 { 1e-6 } else { 0.02 };
            assert!(shown.iter().zip(expected).all(|(a, b)| (a - b).abs() < most), "{shown:?} {expected:?}");
        }
    }
    assert!(linear.splats.sh_of(1)[3..].iter().all(|v| v.abs() < 1e-6));
    // What nobody knows is taken for the usual, and doubted.
    json["meshes"][0]["primitives"][0]["extensions"][SPLATTING]["colorSpace"] = "acescg_scene".into();
    json["meshes"][0]["primitives"][0]["extensions"][SPLATTING]["kernel"] = "box".into();
    let other = read_gltf(&folder, json, &buffer).unwrap();
    assert_eq!(other.splats.sh, scene.splats.sh);
    let said: Vec<&str> = other.remarks.iter().map(|remark| &*remark.text).collect();
    assert!(
        said[0].contains("the kernel box is not known") && said[1].contains("the colorSpace acescg_scene"),
        "{said:?}"
    );
    assert!(other.remarks.iter().all(|remark| remark.severity == Severity::Doubt));
}

#[test]
fn an_spz_is_found_under_all_names_of_its_extension() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("a.glb");
    let options = WriteOptions { gltf: GltfSplats::Spz, ..WriteOptions::default() };
    write_scene_with(&path, &plausible(9, 0), &options).unwrap();
    let whole = read(&path).unwrap();
    let (json, buffer) = glb_parts(&fs::read(&path).unwrap());
    for name in [
        "KHR_gaussian_splatting_compression_spz",
        "KHR_spz_gaussian_splats_compression",
        "KHR_spz_compression",
    ] {
        let mut other = json.clone();
        let extension = &mut other["meshes"][0]["primitives"][0]["extensions"];
        let packed = serde_json::json!({ "bufferView": 0 });
        let mut base = extension[SPLATTING].clone();
        base["extensions"] = serde_json::json!({ name: packed });
        *extension = serde_json::json!({ SPLATTING: base });
        other["extensionsRequired"] = serde_json::json!([SPLATTING, name, "KHR_materials_unlit"]);
        assert_eq!(read_gltf(&folder, other.clone(), &buffer).unwrap().splats, whole.splats, "{name}");
        // Beside the extension, and instead of it: then the axes of its program are those of glTF.
        base["extensions"].take();
        for extensions in
            [serde_json::json!({ SPLATTING: base, name: packed }), serde_json::json!({ name: packed })]
        {
            other["meshes"][0]["primitives"][0]["extensions"] = extensions;
            assert_eq!(read_gltf(&folder, other.clone(), &buffer).unwrap().splats.len(), 9, "{name}");
        }
    }
}

#[test]
fn drafts_of_the_extension_name_their_attributes_otherwise() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("a.glb");
    write_scene(&path, &plausible(9, 0)).unwrap();
    let whole = read(&path).unwrap();
    let (json, buffer) = glb_parts(&fs::read(&path).unwrap());
    let primitive =
        |change: &dyn Fn(&mut serde_json::Map<String, serde_json::Value>) -> serde_json::Value| {
            let mut other = json.clone();
            let primitive = &mut other["meshes"][0]["primitives"][0];
            let extension = change(primitive["attributes"].as_object_mut().unwrap());
            primitive["extensions"] = serde_json::json!({ SPLATTING: extension });
            read_gltf(&folder, other, &buffer).unwrap().splats
        };
    let name = |part: &str| format!("{SPLATTING}:{part}");
    let inside = primitive(&|attributes| {
        let mut take = |part: &str| attributes.remove(&name(part)).unwrap();
        serde_json::json!({
            "rotation": take("ROTATION"), "scale": take("SCALE"), "opacity": take("OPACITY"), "sh": [take("SH_DEGREE_0_COEF_0")],
        })
    });
    assert_eq!(inside, whole.splats);
    // The colour and the opacity of bytes, in COLOR_0.
    let colored = primitive(&|attributes| {
        for part in ["ROTATION", "SCALE"] {
            let accessor = attributes.remove(&name(part)).unwrap();
            attributes.insert(format!("_{part}"), accessor);
        }
        attributes.remove(&name("OPACITY")).unwrap();
        attributes.remove(&name("SH_DEGREE_0_COEF_0")).unwrap();
        serde_json::json!({})
    });
    assert_eq!((&colored.means, &colored.log_scales), (&whole.splats.means, &whole.splats.log_scales));
    for index in 0..9 {
        let (a, b) = (colored.base_color(index), whole.splats.base_color(index).map(|v| v.clamp(0.0, 1.0)));
        assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < 0.003), "{a:?} {b:?}");
        assert!((colored.opacity(index) - whole.splats.opacity(index)).abs() < 0.003);
    }
}

#[test]
fn spz_that_are_not_packed_and_of_degree_4_are_read() {
    let mut file = b"NGSP".to_vec();
    file.extend(2u32.to_le_bytes());
    file.extend(1u32.to_le_bytes());
    file.extend([4, 12, 0, 0]);
    file.extend([0, 16, 0, 0, 0, 0, 0, 0, 0, 128, 128, 128, 128, 160, 160, 160, 127, 127, 127]);
    file.extend([200; 72]);
    let scene = read_scene_from(Path::new("a.spz"), &file[..], None).unwrap();
    assert_eq!((scene.splats.means[0], scene.splats.sh_degree), ([1.0, -0.0, -0.0], 3));
    assert_eq!((scene.remarks.len(), scene.remarks[0].code), (1, "sh-degree"));
    assert!(read_scene_from(Path::new("a.spz"), &file[..file.len() - 1], None).is_err());
}
