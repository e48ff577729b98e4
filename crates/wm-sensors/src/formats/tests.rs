use super::*;
use crate::echo::{EchoClass, ReturnRank};
use crate::pose::SensorPose;
use crate::sweep::PointFrame;
use glam::DVec3;

fn three_points() -> LidarSweep {
    let point = |index: u16| LidarPoint {
        position: [1.5 * f32::from(index), -2.25, 0.125],
        range: 3.0,
        intensity: 51.0 * f32::from(index),
        time: 0.01 * f32::from(index),
        angles: [0.0; 2],
        ring: index,
        column: 70_000 + u32::from(index),
        rank: ReturnRank::Strongest,
        class: EchoClass::ALL[usize::from(index)],
        label: 0,
    };
    LidarSweep {
        name: "test".into(),
        time: [2.0, 0.1],
        pose: SensorPose::upright(DVec3::ZERO, DVec3::X, DVec3::Z),
        metres_per_unit: 1.0,
        frame: PointFrame::Raw,
        origin: DVec3::ZERO,
        pulses: 3,
        grid: None,
        points: (0..3).map(point).collect(),
    }
}

fn bytes(name: &str) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    three_points().save(&path).unwrap();
    std::fs::read(path).unwrap()
}

/// The bytes after the header, and the header.
fn cut<'a>(all: &'a [u8], end: &str) -> (&'a [u8], String) {
    let at = all.windows(end.len()).position(|w| w == end.as_bytes()).unwrap() + end.len();
    (&all[at..], String::from_utf8(all[..at].to_vec()).unwrap())
}

fn float(bytes: &[u8]) -> f32 {
    f32::from_le_bytes(bytes[..4].try_into().unwrap())
}

#[test]
fn ply_and_pcd_have_records_of_32_bytes() {
    for (name, end) in [("a.ply", "end_header\n"), ("a.PCD", "DATA binary\n")] {
        let all = bytes(name);
        let (body, header) = cut(&all, end);
        assert_eq!(body.len(), 96, "{header}");
        let last = &body[64..];
        assert_eq!([float(last), float(&last[4..]), float(&last[8..])], [3.0, -2.25, 0.125]);
        assert_eq!(float(&last[12..]), 102.0);
        assert_eq!(last[24..], [0x72, 0x11, 0x01, 0, 2, 0, 1, 2]);
    }
}

#[test]
fn bin_is_kittis() {
    let all = bytes("a.bin");
    assert_eq!(all.len(), 48);
    assert_eq!([float(&all[32..]), float(&all[44..])], [3.0, 0.4]);
}

#[test]
fn npy_has_ten_columns() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.npy");
    three_points().save(&path).unwrap();
    let (values, shape) = npy::read(&path).unwrap();
    assert_eq!(shape, [3, 10]);
    assert_eq!(values[20..], [3.0, -2.25, 0.125, 102.0, 3.0, 0.02, 2.0, 70_002.0, 1.0, 2.0]);
}

#[test]
fn las_points_are_where_they_are() {
    let all = bytes("a.las");
    assert_eq!(all.len(), 227 + 3 * 34);
    let double = |at: usize| f64::from_le_bytes(all[at..at + 8].try_into().unwrap());
    let whole = |at: usize| f64::from(i32::from_le_bytes(all[at..at + 4].try_into().unwrap()));
    assert_eq!((&all[..4], all[24], all[25], all[104]), (&b"LASF"[..], 1, 2, 3));
    assert_eq!([double(131), double(155), double(179), double(187)], [0.001, 2.0, 3.0, 0.0]);
    let last = 227 + 68;
    assert!((whole(last) * double(131) + double(155) - 3.0).abs() < 1e-9);
    assert_eq!([all[last + 15], all[last + 17], all[last + 18]], [7, 2, 2]);
    assert!((double(last + 20) - 2.02).abs() < 1e-6);
}

#[test]
fn unknown_extensions_are_refused() {
    let error = three_points().save(Path::new("points.xyz")).unwrap_err().to_string();
    assert!(error.starts_with("points.xyz: points are written to names that end in .ply"), "{error}");
}
