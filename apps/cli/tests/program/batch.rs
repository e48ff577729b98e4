//! Data sets by a plan, as files: shards, killed ones too, single frames, and wrong plans.

use crate::common::*;
use crate::process::{fails, finish, printed, said, succeeds};
use glam::DVec3;
use std::path::Path;
use wm_scene::formats::folder::{cameras_path, write_cameras};
use wm_scene::{Camera, SceneView};

const RIG: &str = r#"
[[sensor]]
name = "front"
kind = "camera"
position = [0.0, 0.0, 0.5]
rate = 10.0
size = [64, 48]
fov = 60.0

[[sensor]]
name = "top"
kind = "lidar"
model = "vlp-16"
position = [0.0, 0.0, 1.0]
sub_rays = 1
"#;

const PLAN: &str = r#"
seed = 4
frames = 3
block = 2
layouts = ["frames", "kitti-odometry", "ros2-mcap"]
also = ["depth.npy"]
splits = { train = 0.5, val = 0.5 }

[[scene]]
file = "yard.ply"

[[path]]
name = "drive"
camera = "0,-12,1:0,4,1.2"
speed = 5

[rig]
file = "rig.toml"

[[weather]]
from = ["fog"]

[[weather]]
samples = 1
[weather.vary]
"rain.rate" = { distribution = "log-uniform", min = 2, max = 60 }
"#;

/// The yard with three photos, a rig and a plan.
fn place() -> Workshop {
    let workshop = Workshop::new();
    let scene = workshop.scene("yard", yard().build(), &yard_metadata(1.0));
    let view = |name: &str, x: f64| {
        let (eye, target) = (DVec3::new(x, -12.0, 1.8), DVec3::new(0.0, 4.0, 2.2));
        let camera = Camera::looking((64, 48), 50.0, eye, target, DVec3::Z).unwrap();
        SceneView { name: name.into(), camera }
    };
    let views = [view("one.jpg", 0.5), view("two.jpg", -2.0), view("three.jpg", 3.0)];
    write_cameras(&cameras_path(&scene), &views).unwrap();
    workshop.put("rig.toml", RIG);
    workshop.put("plan.toml", PLAN);
    workshop
}

fn batch(workshop: &Workshop, out: &str, options: &str) -> std::process::Command {
    workshop.command(&format!("batch plan.toml --device cpu --out {out} {options}"))
}

#[test]
fn shards_make_the_same_tree_as_one_run_and_a_killed_one_is_made_again() {
    let workshop = place();
    succeeds(&mut batch(&workshop, "whole", ""));
    let whole = files(&workshop.path("whole"));
    let has = |name: &str| whole.keys().any(|path| path.ends_with(name));
    assert!(has("summary.html") && has("manifest.json"));
    assert!(has("000000-yard-drive-fog/front/000002.depth.npy"));
    // Two clips of three frames, two readings each, in blocks of two frames.
    let rows = String::from_utf8(whole[Path::new("frames.jsonl")].clone()).unwrap();
    let rows: Vec<serde_json::Value> = rows.lines().map(|row| serde_json::from_str(row).unwrap()).collect();
    assert_eq!(rows.len(), 6);
    let list = |value: &serde_json::Value| value.as_array().unwrap().clone();
    for (index, row) in rows.iter().enumerate() {
        assert!(row["frame"] == index && list(&row["readings"]).len() == 2, "{index}: {row}");
    }
    for file in rows.iter().flat_map(|row| list(&row["readings"])).flat_map(|one| list(&one["files"])) {
        let bytes = &whole[Path::new(file["path"].as_str().unwrap())];
        assert_eq!(file["bytes"].as_u64().unwrap(), bytes.len() as u64);
    }

    for shard in [0, 2] {
        succeeds(&mut batch(&workshop, "shards", &format!("--shard {shard}/3")));
    }
    let lacks = fails(&mut batch(&workshop, "shards", "--merge"), &["1 of 3 blocks are missing: 1;"], &[]);
    assert!(lacks.contains("plan.toml"), "{lacks}");
    // A run that was killed leaves parts of a block, and some of its files in place.
    let shards = workshop.path("shards");
    workshop.put("shards/.work/000001/frames/part", "part");
    workshop.put("shards/frames/000000-yard-drive-fog/front/000002.png", "part");
    let told = printed(&succeeds(&mut batch(&workshop, "shards", "")));
    assert!(told.contains("1 of 3 blocks made, 2 kept"), "{told}");
    let shards = files(&shards);
    let others: Vec<_> = shards.keys().filter(|path| !whole.contains_key(*path)).collect();
    assert!(shards.keys().eq(whole.keys()), "{others:?}");
    for (path, bytes) in &shards {
        assert!(*bytes == whole[path], "{} differs", path.display());
    }

    // A power cut may empty a marker and a file: their blocks are made again, through a file system
    // that fails, and by one process at a time.
    let folder = workshop.path("shards");
    let marker = workshop.read("shards/done/000002.json");
    let marker: serde_json::Value = serde_json::from_slice(&marker).unwrap();
    workshop.put(folder.join(marker["files"][0]["path"].as_str().unwrap()), "");
    workshop.put("shards/done/000000.json", "");
    for failing in ["create:1", "write:3", "rename:2", "flush:1"] {
        let broken = finish(batch(&workshop, "shards", "").env("WM_FAIL_FILES", failing));
        assert_eq!(broken.status.code(), Some(1), "{failing}: {}", said(&broken));
    }
    let work = folder.join(".work/000000");
    std::fs::create_dir_all(&work).unwrap();
    let lock = wm_base::files::lock_folder(&work).unwrap();
    fails(&mut batch(&workshop, "shards", ""), &["another process makes block 0"], &["note: block 2"]);
    drop(lock);
    succeeds(&mut batch(&workshop, "shards", ""));
    assert!(files(&folder) == whole);

    // A frame alone has the files that it has among all.
    succeeds(&mut batch(&workshop, "alone", "--frames 4"));
    let alone = files(&workshop.path("alone"));
    let own = Path::new("frames/000001-yard-drive-rain/front/000001.png");
    assert!(alone[own] == whole[own] && !alone.contains_key(Path::new("manifest.json")));
    // A changed file is found by its hash.
    let other = &alone[Path::new("frames/000001-yard-drive-rain/front/000001.depth.npy")];
    workshop.put(folder.join(own), &other[..whole[own].len()]);
    let says = ["1 files are not as they were made", "has other bytes"];
    fails(&mut batch(&workshop, "shards", "--merge --verify"), &says, &[]);
    // Another plan does not continue the set.
    workshop.put("plan.toml", PLAN.replace("seed = 4", "seed = 5"));
    fails(&mut batch(&workshop, "shards", ""), &["is of another plan"], &[]);
}

#[test]
fn a_camera_may_be_faster_than_frames_and_stand_behind_a_lidar() {
    let workshop = place();
    let camera = RIG.find("[[sensor]]\nname = \"front\"").unwrap();
    let lidar = RIG.find("[[sensor]]\nname = \"top\"").unwrap();
    let rig = format!("{}{}", &RIG[lidar..], RIG[camera..lidar].replace("rate = 10.0", "rate = 20.0"));
    workshop.put("rig.toml", rig);
    workshop.put("plan.toml", PLAN.replace("frames = 3", "frames = 1"));
    for out in ["one", "two"] {
        let told = printed(&succeeds(&mut batch(&workshop, out, "")));
        assert!(told.contains("2 clips, 2 frames, 6 readings"), "{told}");
    }
    // The pictures of the summary are those of the camera, and the same each time.
    let [one, two] = ["one", "two"].map(|out| files(&workshop.path(out)));
    assert!(one == two && one.keys().filter(|path| path.starts_with("summary")).count() == 2);
}

#[test]
fn photos_get_their_weathers_and_wrong_plans_one_line() {
    let workshop = place();
    let plan = "pairs = true\n[[scene]]\nfile = \"yard.ply\"\n[[path]]\ncameras = \"capture\"\n[[weather]]\nfrom = [\"fog\", \"snow\"]\n";
    workshop.put("plan.toml", plan);
    let listed = printed(&finish(&mut batch(&workshop, "set", "--list")));
    for says in ["6 clips, 6 frames", "000004-yard-photo-two-snow"] {
        assert!(listed.contains(says), "{listed}");
    }
    succeeds(&mut batch(&workshop, "set", ""));
    let picture = |number: u32, kind: &str| {
        read_png(&workshop.path(format!("set/frames/00000/camera/{number:08}{kind}.png")))
    };
    assert_eq!((picture(0, "").width, picture(0, "").height), (64, 48));
    // The same view in fog and in snow, with one clean picture.
    assert!(picture(1, ".clear").pixels == picture(4, ".clear").pixels);
    assert!(picture(1, "").pixels != picture(4, "").pixels);
    assert!(picture(0, ".clear").pixels != picture(1, ".clear").pixels);
    for (from, to, says) in [
        ("\", \"snow\"]", "g\"]", "line 7: from: there is no weather `fogg`, did you mean `fog`?"),
        ("cameras", "cameraz", "line 5: unknown field `cameraz`"),
        ("pairs", "layouts = [\"nope\"]\npairs", "line 1: layouts: there is no layout `nope`"),
    ] {
        workshop.put("plan.toml", plan.replace(from, to));
        fails(&mut batch(&workshop, "other", ""), &[says], &[]);
    }
    assert!(!workshop.path("other").exists());
    fails(binary().args(["batch", "gone.toml"]), &["gone.toml: cannot be read"], &[]);
    fails(binary().args(["batch", "plan.toml", "--shard", "3/3"]), &["the parts of 3 are 0 to 2"], &[]);
}
