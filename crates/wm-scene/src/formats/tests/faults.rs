//! Files that are cut, damaged, or lie about their size.

use super::{round_trip::below, round_trip::plausible, values::glb_parts, values::read_gltf, *};
use crate::testing::Dice;

/// Bytes of a small scene in a format that is one file, and its name.
fn small(format: &SceneFormat) -> Option<(PathBuf, Vec<u8>, Scene)> {
    let ending = format.extensions.first().filter(|ending| !ending.contains(".json"))?;
    let folder = tempdir().unwrap();
    let path = folder.path().join(format!("a.{ending}"));
    write_scene(&path, &plausible(3, 1)).unwrap();
    let (name, bytes) = (PathBuf::from(format!("a.{ending}")), fs::read(&path).unwrap());
    let scene = read_bytes(&name, &bytes).unwrap();
    Some((name, bytes, scene))
}

fn read_bytes(name: &Path, bytes: &[u8]) -> Result<Scene, FormatError> {
    read_scene_from(name, bytes, Some(bytes.len() as u64))
}

/// Reads bytes that may be anything: a scene or one line.
fn survives(name: &Path, bytes: &[u8]) -> Option<Scene> {
    match read_bytes(name, bytes) {
        Ok(scene) => {
            assert_eq!(scene.splats.check(), Ok(()));
            Some(scene)
        }
        Err(error) => {
            assert!(!error.to_string().contains(['\n', '\r']), "{error}");
            None
        }
    }
}

#[test]
fn every_length_of_every_format_is_refused_or_whole() {
    for (name, bytes, whole) in FORMATS.iter().filter_map(small) {
        for length in 0..bytes.len() {
            let Some(scene) = survives(&name, &bytes[..length]) else { continue };
            // A .splat has no end; a gzip may lack its checksum, a glTF its padding.
            if name.ends_with("a.splat") {
                assert_eq!(length % 32, 0);
            } else {
                assert_eq!(
                    bits(&scene.splats),
                    bits(&whole.splats),
                    "{} at {length} of {}",
                    name.display(),
                    bytes.len()
                );
            }
            // Of no known length, as through a pipe.
            _ = read_scene_from(&name, &bytes[..length], None);
        }
        assert!(survives(&name, &bytes).is_some());
    }
}

#[test]
fn flipped_bytes_do_no_harm() {
    // `apps/cli/examples/fuzz_readers` damages a million files of each format.
    for (name, bytes, _) in FORMATS.iter().filter_map(small) {
        let mut dice = Dice::new(1);
        for _ in 0..1500 {
            let mut damaged = bytes.clone();
            for _ in 0..=below(&mut dice, 4) {
                let at = below(&mut dice, damaged.len());
                damaged[at] = below(&mut dice, 256) as u8;
            }
            survives(&name, &damaged);
        }
    }
}

#[test]
fn counts_that_lie_are_refused_before_memory_is_taken() {
    let spz = |version: u32| {
        let mut header = b"NGSP".to_vec();
        header.extend(version.to_le_bytes());
        header.extend(u32::MAX.to_le_bytes());
        header.extend([3, 12, 0, 6]);
        header
    };
    // A bomb: 20 MB of zeros in 20 kB.
    let bomb = [spz(3), vec![0; 20_000_000]].concat();
    let gzip = sirocco::compress(sirocco::Format::Gzip, sirocco::deflate::Level::BEST, &bomb);
    let mut four = spz(4);
    four.extend(32u32.to_le_bytes());
    four.resize(32 + 6 * 16, 0);
    let mut ksplat = vec![0; 4096 + 1024];
    ksplat[1] = 1;
    ksplat[4] = 1;
    ksplat[4096..4104].fill(0xff);
    let glb = |json: &str| {
        let mut glb = b"glTF".to_vec();
        for word in [2, 0, json.len() as u32, 0x4e4f_534a] {
            glb.extend(word.to_le_bytes());
        }
        glb.extend(json.bytes());
        glb
    };
    let accessor = r#"{"asset":{"version":"2.0"},"buffers":[{"uri":"data:;base64,AAAA"}],
        "bufferViews":[{"buffer":0,"byteLength":3}],
        "accessors":[{"componentType":5126,"type":"VEC3","count":4000000000,"bufferView":0}],
        "meshes":[{"primitives":[{"attributes":{"POSITION":0},"extensions":{"KHR_gaussian_splatting":{}}}]}]}"#;
    for (name, bytes, says) in [
        ("a.spz", gzip, "bytes unpack to"),
        ("a.spz", four, "bytes unpack to"),
        ("a.ksplat", ksplat, "cut off in the .ksplat"),
        ("a.glb", glb(accessor), "cut off in an accessor of the glTF"),
        ("a.ply", b"ply\nformat binary_little_endian 1.0\nelement chunk 1\nelement vertex 4000000000\nproperty uint packed_position\nproperty uint packed_rotation\nproperty uint packed_scale\nproperty uint packed_color\nend_header\n".to_vec(), "cut off: the header promises"),
    ] {
        let error = read_bytes(Path::new(name), &bytes).unwrap_err().to_string();
        assert!(error.contains(says), "{error}");
    }
}

#[test]
fn nodes_that_share_splats_are_no_bomb() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("a.glb");
    write_scene(&path, &plausible(2000, 0)).unwrap();
    let (mut json, buffer) = glb_parts(&fs::read(&path).unwrap());
    json["scenes"][0]["nodes"] = (0..2000).collect();
    json["nodes"] = vec![serde_json::json!({ "mesh": 0 }); 2000].into();
    let error = read_gltf(&folder, json, &buffer).unwrap_err().to_string();
    assert!(error.contains("whose nodes share splats"), "{error}");
}

#[test]
fn pictures_of_sog_that_are_damaged_or_missing_are_named() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("meta.json");
    write_scene(&path, &plausible(40, 2)).unwrap();
    let names: Vec<_> = fs::read_dir(folder.path()).unwrap().map(|e| e.unwrap().file_name()).collect();
    assert_eq!(names.len(), 8);
    for name in names {
        let file = folder.path().join(&name);
        let bytes = fs::read(&file).unwrap();
        let mut dice = Dice::new(2);
        for round in 0..300 {
            let mut damaged = bytes.clone();
            let at = below(&mut dice, damaged.len());
            damaged[at] = below(&mut dice, 256) as u8;
            if round % 3 == 0 {
                damaged.truncate(at);
            }
            fs::write(&file, damaged).unwrap();
            if let Err(error) = read(&path) {
                assert!(!error.to_string().contains(['\n', '\r']), "{error}");
            }
        }
        fs::remove_file(&file).unwrap();
        let message = say(&folder, read(&path));
        assert!(message.contains(name.to_str().unwrap()) || name == "meta.json", "{message}");
        fs::write(&file, bytes).unwrap();
    }
    assert!(read(&path).is_ok());
    let meta = fs::read_to_string(&path).unwrap().replace("quats.webp", "../quats.webp");
    fs::write(&path, meta).unwrap();
    let message = say(&folder, read(&path));
    assert!(message.contains("SOG: \"../quats.webp\" is not a file below its folder"), "{message}");
}
