use super::*;
use crate::testing::{self, SPOT};
use glam::{DQuat, DVec3};
use std::collections::BTreeMap;

/// Little-endian f64 at a byte.
fn f64_at(data: &[u8], at: usize) -> f64 {
    f64::from_le_bytes(data[at..at + 8].try_into().unwrap())
}

/// A pose whose translation is at a byte.
fn pose_at(data: &[u8], at: usize) -> RigidPose {
    let [x, y, z, qx, qy, qz, qw] = [0, 1, 2, 3, 4, 5, 6].map(|k| f64_at(data, at + 8 * k));
    RigidPose { rotation: DQuat::from_xyzw(qx, qy, qz, qw), translation: DVec3::new(x, y, z) }
}

#[test]
fn the_spot_is_where_messages_say() {
    let files = testing::written(&LAYOUT, 8);
    let (set, clip) = (testing::set(), &testing::clips()[1]);
    let mut found = BTreeMap::new();
    let (mut rig, mut world) = (None, None);
    let mut seen = testing::SpotCount::default();
    let front: Vec<_> = testing::readings(&set).into_iter().filter(|info| info.sensor == 0).collect();
    for block in 0..3 {
        let bytes = &files[&format!("{}/{}", clip.folder(), file_name(clip, block))];
        for message in ::mcap::MessageStream::new(bytes).unwrap() {
            let message = message.unwrap();
            let data = &message.data;
            assert_eq!(data[..4], [0, 1, 0, 0]);
            *found.entry(message.channel.topic.clone()).or_insert(0) += 1;
            match message.channel.topic.as_str() {
                // Count, time, "base_link" from 12 to 26, "front" from 28 to 38, the next multiple
                // of 8.
                "/tf_static" => rig = Some(pose_at(data, 4 + 40)),
                // "map" from 12 to 20, "base_link" from 20 to 34.
                "/tf" => world = Some(pose_at(data, 4 + 40)),
                "/sensors/front/camera_info" => {
                    // Header to 18, size from 20, model from 28 to 42, count on 44, five numbers
                    // from 48, K.
                    let k = [0, 4, 2, 5].map(|place| f64_at(data, 4 + 88 + 8 * place));
                    let pose = world.unwrap().then(&rig.unwrap());
                    let spot = pose.inverse().point(SPOT);
                    let at = [0, 1].map(|axis| k[axis] * spot[axis] / spot.z + k[2 + axis] + 0.5);
                    seen.add(&set, &front[found[&message.channel.topic] - 1], at);
                }
                _ => {}
            }
        }
    }
    assert!(files == testing::written(&LAYOUT, 8), "other bytes the second time");
    let metadata = String::from_utf8(files[&format!("{}/metadata.yaml", clip.folder())].clone()).unwrap();
    let total: usize = found.values().sum();
    assert!(metadata.contains(&format!("\n  message_count: {total}\n")), "{metadata}");
    for (topic, count) in found {
        let entry = metadata.split(&format!("name: {topic}\n")).nth(1).unwrap();
        assert!(entry.split("message_count: ").nth(1).unwrap().starts_with(&format!("{count}\n")), "{topic}");
    }
    assert!(metadata.contains("nanoseconds: 1900000000"), "{metadata}");
}

#[test]
fn names_that_ros_has_no_place_for_are_refused() {
    let says = |name: &str| {
        let mut set = testing::set();
        set.sensors[1].name = name.into();
        check(&set)
    };
    assert!(says("2nd").unwrap_err().contains("begin its name with a letter"));
    assert!(says("base-link").unwrap_err().contains("rename"));
    assert!(says("front").unwrap_err().contains("two sensors are"));
    assert!(says("front-left").is_ok());
}
