//! Tests of plans: numbers of clips and blocks, readings, and what is said of wrong plans.

use super::clips::BlockPart;
use super::condition::condition_of;
use super::plan::slug;
use super::set::{readings_of, rig_of};
use super::store::scene_digest_of;
use super::*;
use crate::RigidPose;
use glam::{DQuat, DVec3};
use std::path::Path;
use wm_scene::{Camera, SceneView};

/// A folder with two scenes that nobody opens.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for name in ["street.ply", "park.ply"] {
        std::fs::write(folder.path().join(name), "").unwrap();
    }
    folder
}

fn parse(text: &str, folder: &Path) -> Result<BatchPlan, String> {
    BatchPlan::parse(text, "p.toml", folder, "p").map_err(|error| error.to_string())
}

fn views(count: usize) -> Vec<SceneView> {
    let of = |number: usize| SceneView {
        name: format!("photos/DSC {number:02}.jpg"),
        camera: Camera::look_at([0.0, 0.0, 1.5], [5.0, number as f64, 1.0])
            .fov_y(50.0)
            .size(64, 48)
            .camera(DVec3::Z, 0.1)
            .unwrap(),
    };
    (0..count).map(of).collect()
}

const TWO_SCENES: &str = r#"
seed = 3
frames = 4
frame_rate = 10
block = 6
splits = { train = 0.75, val = 0.25 }
[[scene]]
file = "street.ply"
[[scene]]
file = "park.ply"
[[path]]
name = "drive"
path = "dolly"
[[path]]
name = "photo"
scene = "park"
cameras = "capture"
[[weather]]
from = ["fog", "snow"]
at = [0, 2.5]
[[weather]]
samples = 2
"#;

#[test]
fn every_frame_is_in_one_block_and_every_clip_is_found_by_its_number() {
    let folder = folder();
    let plan = parse(TWO_SCENES, folder.path()).unwrap();
    let clips = BatchClips::of(&plan, &mut |_| Ok(views(3))).unwrap();
    // Six weathers; one way in the street, one and three photos in the park.
    assert_eq!((clips.clips(), clips.frames()), (6 * (1 + 4), 120));
    let mut next = 0;
    let mut seen = std::collections::BTreeSet::new();
    for number in 0..clips.blocks() {
        let block = clips.block(number);
        assert_eq!((block.number, block.frames.start), (number, next));
        next = block.frames.end;
        for part in clips.parts(&block.frames) {
            let clip = clips.clip(&plan, part.clip).unwrap();
            assert_eq!(clip.scene, block.scene);
            part.frames.clone().for_each(|frame| assert!(seen.insert((part.clip, frame)), "{part:?}"));
            // The parts of a clip are numbered from 0.
            assert_eq!(part.number == 0, part.frames.start == 0);
        }
    }
    assert_eq!((next, seen.len()), (120, 120));
    // Seven shards are the same blocks as one.
    let shards: Vec<u64> = (0..7).flat_map(|shard| clips.shard(shard, 7)).collect();
    assert!(shards.iter().copied().eq(clips.shard(0, 1)));
    let names: std::collections::BTreeSet<String> =
        (0..30).map(|number| clips.clip(&plan, number).unwrap().name).collect();
    assert_eq!(names.len(), 30);
    assert!(
        names.contains("000006-park-drive-fog") && names.contains("000007-park-photo-DSC-00-fog"),
        "{names:?}"
    );
    // Samples are one hypercube over both scenes: five ways by two.
    let temperatures: Vec<f64> = (0..30)
        .filter_map(|number| clips.clip(&plan, number).unwrap().weather.variables.get("temperature").copied())
        .collect();
    assert_eq!(temperatures.len(), 10);
    // What prevails is in the name, and in clear air nothing does.
    let prevailing = |text: &str| {
        let plan =
            parse(&format!("[[scene]]\nfile = \"street.ply\"\n[[weather]]\n{text}"), folder.path()).unwrap();
        let clips = BatchClips::of(&plan, &mut |_| Ok(Vec::new())).unwrap();
        condition_of(&clips.clip(&plan, 0).unwrap().weather).name()
    };
    for (text, name) in [
        ("grid = { \"wind.speed\" = [3] }", "clear"),
        ("from = [\"fog\"]", "fog"),
        ("from = [\"night-fog\"]", "fog"),
        ("from = [\"night\"]", "night"),
        ("from = [\"heavy-rain\"]", "rain"),
        ("from = [\"snow-covered\"]", "snow"),
        ("from = [\"sandstorm\"]", "dust"),
    ] {
        assert_eq!(prevailing(text), name, "{text}");
    }
    let clip = clips.clip(&plan, 13).unwrap();
    assert_eq!(clip.weather.weather, clips.clip(&plan, 13).unwrap().weather.weather);
    let mut starts: Vec<i64> = (0..30).map(|number| clips.clip(&plan, number).unwrap().start).collect();
    starts.dedup();
    assert!(starts.len() == 30 && starts[1] - starts[0] >= 1_000_000_000);
}

#[test]
fn readings_are_in_the_frame_of_their_time_and_each_sensor_has_one_key() {
    let folder = folder();
    let rig = "
        [[sensor]]
        name = \"front\"
        kind = \"camera\"
        rate = 20.0
        phase = 0.01
        size = [64, 48]
        fov = 60.0
        [[sensor]]
        name = \"slow\"
        kind = \"camera\"
        rate = 10.0
        size = [64, 48]
        fov = 60.0";
    std::fs::write(folder.path().join("rig.toml"), rig).unwrap();
    let text = "frames = 5\n[[scene]]\nfile = \"street.ply\"\n[rig]\nfile = \"rig.toml\"\n[[weather]]\nfrom = [\"fog\"]";
    let plan = parse(text, folder.path()).unwrap();
    assert_eq!(plan.frame_rate, 10.0);
    let clips = BatchClips::of(&plan, &mut |_| Ok(Vec::new())).unwrap();
    let rig = rig_of(&plan, &clips).unwrap();
    let pose = |time: f64| RigidPose { rotation: DQuat::IDENTITY, translation: DVec3::X * time };
    let of = |frames: std::ops::Range<u32>| {
        readings_of(&plan, &rig, &BlockPart { clip: 0, frames, number: 0 }, None, &pose)
    };
    let all = of(0..5);
    assert_eq!(all.len(), 15);
    assert!(all.windows(2).all(|pair| pair[0].time <= pair[1].time));
    for frame in 0..5 {
        for sensor in 0..2 {
            let own: Vec<_> = all.iter().filter(|one| one.frame == frame && one.sensor == sensor).collect();
            assert_eq!(own.iter().filter(|one| one.is_key).count(), 1);
            assert!(
                own[0].is_key
                    && (own[0].time - (f64::from(frame) / 10.0 + 0.01 * (1 - sensor) as f64)).abs() < 1e-9
            );
        }
    }
    // A part has what the whole has.
    let parts: Vec<_> = [of(0..2), of(2..5)].concat();
    assert_eq!(parts, all);
}

#[test]
fn photos_bring_their_own_cameras() {
    let folder = folder();
    let text = "[[scene]]\nfile = \"street.ply\"\n[[path]]\ncameras = \"capture\"\nevery = 2\n[[weather]]\nfrom = [\"fog\"]";
    let plan = parse(text, folder.path()).unwrap();
    let mut photos = views(5);
    photos[2].camera.fx += 1.0;
    let clips = BatchClips::of(&plan, &mut |_| Ok(photos.clone())).unwrap();
    assert_eq!((clips.clips(), rig_of(&plan, &clips).unwrap().sensors.len()), (3, 2));
    let none = BatchClips::of(&plan, &mut |_| Ok(Vec::new())).unwrap_err().to_string();
    assert!(none.contains("no cameras of photos"), "{none}");
}

#[test]
fn a_wrong_plan_is_told_with_its_line_and_key() {
    let folder = folder();
    let scene = "[[scene]]\nfile = \"street.ply\"\n";
    let weather = "[[weather]]\nfrom = [\"fog\"]\n";
    for (text, says) in [
        ("frames = 0\n<scene><weather>", "p.toml, line 1: frames: 0: it must be"),
        ("sed = 1\n<scene><weather>", "p.toml, line 1: unknown field `sed`"),
        ("name = \"a b\"\n<scene><weather>", "line 1: name"),
        ("<weather>", "scene: the plan has no scene"),
        ("<scene>", "weather: the plan has no weather"),
        ("[[scene]]\nfile = \"gone.ply\"\n<weather>", "line 2: scene file"),
        ("<scene><scene><weather>", "there are two scenes \"street\""),
        ("layouts = [\"kiti-raw\"]\n<scene><weather>", "line 1: layouts: there is no layout `kiti-raw`"),
        ("layouts = []\n<scene><weather>", "layouts: the list is empty"),
        ("also = [\"depht\"]\n<scene><weather>", "line 1: also: `depht`"),
        ("splits = { train = 0.5 }\n<scene><weather>", "line 1: splits: the shares sum to 0.5"),
        ("start = 08:00:00\n<scene><weather>", "line 1: start: a time without a date"),
        (
            "<scene><weather>[[path]]\nscene = \"stret\"\n",
            "line 6: path scene: there is no scene `stret`, did you mean `street`?",
        ),
        ("<scene><weather>[[path]]\npath = \"dollly\"\n", "line 6: path path"),
        ("<scene><weather>[[path]]\ncameras = \"capture\"\nspeed = 3\n", "line 7: path speed"),
        ("<scene><weather>[rig]\nfov = 190\n", "line 6: rig fov"),
        ("<scene><weather>[rig]\nfile = \"gone.toml\"\n", "line 6: rig file"),
        (
            "<scene>[[weather]]\nfrom = [\"fogg\"]\n",
            "line 4: from: there is no weather `fogg`, did you mean `fog`?",
        ),
        (
            "<scene>[[weather]]\nsamples = 5\n[weather.vary]\n\"fog.mor\" = { distribution = \"uniform\", min = 9 }\n",
            "line 6: vary fog.mor: max is missing",
        ),
        (
            "<scene>[[weather]]\nsamples = 5\nset.temperature = 3\nvary.temperature = { distribution = \"uniform\", min = 9 }\n",
            "line 6: vary temperature: max is missing",
        ),
        (
            "<scene>[[weather]]\nsamples = 5\n\nvary.\"fog.mor\" = { distribution = \"uniform\", min = 9 }\n",
            "line 6: vary fog.mor: max is missing",
        ),
        (
            "<scene>[[weather]]\nsamples = 5\n[weather.vary]\n'fog.mor'.distribution = \"uniform\"\n'fog.mor'.min = 9\n",
            "line 6: vary fog.mor: max is missing",
        ),
        ("splits.train = 0.5\n<scene><weather>", "line 1: splits: the shares sum to 0.5"),
        ("<scene><weather>[[path]]\n\npath=\"dollly\"\n", "line 7: path path"),
    ] {
        let text = text.replace("<scene>", scene).replace("<weather>", weather);
        let fault = parse(&text, folder.path()).unwrap_err();
        assert!(fault.contains(says) && !fault.contains('\n'), "{text}\n{fault}");
    }
}

#[test]
fn plans_are_told_apart_by_what_they_say() {
    let folder = folder();
    let of = |text: &str| parse(text, folder.path()).unwrap().digest;
    let plan = "seed = 1\n[[scene]]\nfile = \"street.ply\"\n[[weather]]\nfrom = [\"fog\"]\n";
    assert_eq!(of(plan), of(&format!("# The same.\n{plan}")));
    assert_ne!(of(plan), of(&plan.replace("seed = 1", "seed = 2")));
    assert_ne!(of(plan), of(&plan.replace("fog", "snow")));
    let other = self::folder();
    assert_eq!(of(plan), parse(plan, other.path()).unwrap().digest);
    // A plan in the present folder has none in its path.
    let there = folder.path().join("street.ply").display().to_string();
    let plan = format!("about = \"fog/snow\"\n{plan}").replace("street.ply", &there);
    assert_eq!(of(&plan), parse(&plan, Path::new("")).unwrap().digest);
    assert_eq!(slug("a/b c.JPG--x"), "a-b-c-JPG-x");
    assert_eq!(runs_of(&[0, 1, 2, 5, 7, 8]), "0-2, 5, 7-8");
}

#[test]
fn what_is_found_of_a_scene_in_a_folder_is_no_part_of_it() {
    let folder = folder();
    std::fs::write(folder.path().join("meta.json"), "{}").unwrap();
    let before = scene_digest_of(folder.path()).unwrap();
    let assets = wm_place::assets::AssetCache::folder_of(folder.path());
    std::fs::create_dir(&assets).unwrap();
    std::fs::write(assets.join("shelter.wmasset"), "rain").unwrap();
    assert_eq!(scene_digest_of(folder.path()).unwrap(), before);
    std::fs::write(folder.path().join("sh0.webp"), "colours").unwrap();
    assert_ne!(scene_digest_of(folder.path()).unwrap(), before);
}
