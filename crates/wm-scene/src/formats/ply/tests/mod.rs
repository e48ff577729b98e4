//! Round trips, the layout of written files, and real scenes.

mod dialects;
mod faults;
mod foreign;

use super::*;
use crate::{
    Group, Metadata, Splats,
    formats::read_scene_from,
    splats::Splat,
    testing::{SPLAT, any_scene, bits, data, push_row},
};
use glam::DVec3;
use proptest::prelude::*;
use std::path::Path;

fn written(scene: &Scene, encoding: PlyEncoding) -> Vec<u8> {
    let mut bytes = Vec::new();
    write(&mut bytes, scene, encoding).unwrap();
    bytes
}

fn read_bytes(bytes: &[u8]) -> Result<Scene, FormatError> {
    read_scene_from(Path::new("a.ply"), bytes, Some(bytes.len() as u64))
}

/// Reads the bytes with no length to check a count against.
fn read_pipe(bytes: &[u8]) -> Result<Scene, FormatError> {
    read_scene_from(Path::new("a.ply"), bytes, None)
}

fn small_scene() -> Scene {
    let mut splats = Splats::with_capacity(3, 1);
    for (index, group) in Group::ALL.into_iter().enumerate() {
        let mean = [index as f32, 0.5, -1e-7];
        let (quat, log_scale) = ([1.0, 0.25, 0.0, 0.0], [-2.0, -3.5, -1.0]);
        splats.push(&Splat { mean, quat, log_scale, logit_opacity: 2.5, rgb: [0.2, 0.4, 0.8], group });
    }
    splats.sh.iter_mut().enumerate().for_each(|(i, v)| *v = i as f32);
    let metadata =
        Metadata { up: Some(DVec3::Z), provenance: Some("a \"test\"".into()), ..Metadata::default() };
    Scene { splats, metadata, ..Scene::default() }
}

proptest! {
    #[test]
    fn every_encoding_gives_everything_back(scene in any_scene(12)) {
        for encoding in PlyEncoding::ALL {
            let bytes = written(&scene, encoding);
            for read in [read_bytes(&bytes), read_pipe(&bytes)] {
                let read = read.unwrap();
                prop_assert_eq!(bits(&read.splats), bits(&scene.splats));
                prop_assert_eq!(&read.metadata, &scene.metadata);
                prop_assert_eq!(read.splats.check(), Ok(()));
            }
        }
    }
}

#[test]
fn many_rows_cross_the_blocks() {
    // 20,000 rows of 248 bytes are five blocks, and a block holds no whole number of rows.
    let mut splats = Splats::with_capacity(20_000, 3);
    for index in 0..20_000u32 {
        let row: [f32; 59] = std::array::from_fn(|i| (index * 64 + i as u32) as f32);
        push_row(&mut splats, &row, Group::ALL[index as usize % 3]);
    }
    let scene = Scene { splats, ..Scene::default() };
    for encoding in PlyEncoding::ALL {
        let bytes = written(&scene, encoding);
        assert!(read_bytes(&bytes).unwrap() == scene, "{encoding:?}");
        assert!(read_pipe(&bytes).unwrap() == scene, "{encoding:?}");
    }
}

#[test]
fn the_order_is_that_of_the_reference_writer() {
    let bytes = written(&small_scene(), PlyEncoding::BinaryLittleEndian);
    let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap();
    let header = String::from_utf8(bytes[..end].to_vec()).unwrap();
    let rest: String = (0..9).map(|i| format!("property float f_rest_{i}\n")).collect();
    let expected = format!(
        "ply\nformat binary_little_endian 1.0\ncomment wm.up [0.0, 0.0, 1.0]\n\
         comment wm.provenance 'a \"test\"'\nelement vertex 3\nproperty float x\nproperty float y\n\
         property float z\nproperty float nx\nproperty float ny\nproperty float nz\nproperty float f_dc_0\n\
         property float f_dc_1\nproperty float f_dc_2\n{rest}property float opacity\nproperty float scale_0\n\
         property float scale_1\nproperty float scale_2\nproperty float rot_0\nproperty float rot_1\n\
         property float rot_2\nproperty float rot_3\nproperty uchar group\n"
    );
    assert_eq!(header, expected);
    // Coefficient by coefficient in memory, channel by channel in the file.
    let row: Vec<f32> = bytes[end + 11..]
        .chunks_exact(4)
        .take(26)
        .map(|b| f32::from_le_bytes(b.try_into().unwrap()))
        .collect();
    assert_eq!(row[6..18], [0., 1., 2., 3., 6., 9., 4., 7., 10., 5., 8., 11.]);
    // The second axis is the shortest; the rotation is about x.
    let normal = small_scene().splats.normal(0).map(|v| v as f32);
    assert_eq!(row[3..6], normal);
    assert!(normal[0] == 0.0 && normal[1] > 0.8);

    let mut plain = small_scene();
    plain.splats.groups.fill(Group::Scene);
    let bytes = written(&plain, PlyEncoding::BinaryLittleEndian);
    assert!(!bytes.windows(5).any(|w| w == b"group"));
}

#[test]
fn metadata_of_later_versions_is_left_alone() {
    let mut bytes = written(&small_scene(), PlyEncoding::Ascii);
    let extra = b"comment wm.weather \"fine\"\ncomment wm.up [0, -1, 0]\ncomment wm.\ncomment wm\n";
    let at = bytes.windows(14).position(|w| w == b"element vertex").unwrap();
    bytes.splice(at..at, extra.iter().copied());
    let metadata = read_bytes(&bytes).unwrap().metadata;
    assert_eq!(metadata, Metadata { up: Some(DVec3::NEG_Y), ..small_scene().metadata });
}

#[test]
fn what_cannot_be_read_back_is_not_written() {
    let fail = |scene: &Scene| write(&mut Vec::new(), scene, PlyEncoding::Ascii).unwrap_err().to_string();
    let mut scene = small_scene();
    scene.metadata.ground = Some(f64::NAN);
    assert_eq!(fail(&scene), "not written: ground is NaN: it must be finite and within 10^10 units of zero");
    assert_eq!(fail(&Scene::default()), "there are no splats in it; nothing can be shown");
    let mut scene = small_scene();
    scene.splats.quats.pop();
    assert_eq!(fail(&scene), "not written: `quats` has 2 values, 3 expected for 3 splats");
}

#[test]
fn real_scenes_come_back() {
    for (name, count) in [("headquarter-garden", 851_756), ("taebak", 212_464)] {
        let Some(path) = data(&format!("scenes/{name}.ply")) else { continue };
        let bytes = std::fs::read(&path).unwrap();
        let scene = read_bytes(&bytes).unwrap();
        assert_eq!((scene.splats.len(), scene.splats.sh_degree), (count, 0));
        // The last row by hand: x y z nx ny nz, then three colours, opacity, scales, rotation.
        let last: Vec<f32> = bytes[bytes.len() - 68..]
            .chunks_exact(4)
            .map(|b| f32::from_le_bytes(b.try_into().unwrap()))
            .collect();
        let end = count - 1;
        assert_eq!(scene.splats.means[end][..], last[..3]);
        assert_eq!(scene.splats.sh_of(end), &last[6..9]);
        assert_eq!(scene.splats.logit_opacities[end], last[9]);
        assert_eq!(scene.splats.log_scales[end][..], last[10..13]);
        assert_eq!(scene.splats.quats[end][..], last[13..]);
        let again = read_bytes(&written(&scene, PlyEncoding::BinaryLittleEndian)).unwrap();
        assert!(bits(&again.splats) == bits(&scene.splats));
    }
}

#[test]
fn real_points_are_balls() {
    let Some(path) = data("points/garden_points.ply") else { return };
    let scene = crate::formats::read_scene(&path, &Default::default()).unwrap();
    assert!(scene.remarks[0].text.contains("points and no splats"), "{:?}", scene.remarks);
    assert_eq!(scene.check_finite(), Ok(()));
}

/// A scene with labels comes back in every encoding, and without instances it has none.
#[test]
fn labels_come_back() {
    let mut scene = Scene { splats: Splats::with_capacity(3, 0), ..Scene::default() };
    for _ in 0..3 {
        scene.splats.push(&SPLAT);
    }
    scene.splats.labels = vec![0, 300, 65535];
    for instances in [vec![], vec![1, 2, 0]] {
        scene.splats.instances = instances;
        for encoding in PlyEncoding::ALL {
            assert_eq!(read_bytes(&written(&scene, encoding)).unwrap().splats, scene.splats, "{encoding:?}");
        }
    }
    // Labels of any number type; below 0 is none, and what is no label is refused in one line.
    let text = String::from_utf8(written(&scene, PlyEncoding::Ascii)).unwrap();
    for kind in ["float", "double", "int", "short"] {
        let typed = text.replace("ushort label", &format!("{kind} label")).replace(" 65535 0\n", " -1 0\n");
        assert_eq!(read_bytes(typed.as_bytes()).unwrap().splats.labels, [0, 300, 0], "{kind}");
    }
    for bad in ["1.5", "65536", "1e9", "nan", "inf"] {
        let wrong = text.replace("ushort label", "float label").replace(" 65535 0\n", &format!(" {bad} 0\n"));
        let error = read_bytes(wrong.as_bytes()).unwrap_err().to_string();
        assert!(error.contains("the label of splat 2") && !error.contains('\n'), "{bad}: {error}");
    }
    let list = text.replace("property ushort label", "property list uchar ushort label");
    let error = read_bytes(list.as_bytes()).unwrap_err().to_string();
    assert!(error.contains("label is a list"), "{error}");
    let twice = text.replace("property ushort instance", "property ushort label");
    assert!(read_bytes(twice.as_bytes()).unwrap_err().to_string().contains("declared twice"));
}
