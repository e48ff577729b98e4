//! `align`, by running the binary: what is set by hand goes with the scene, and weather follows it.

use crate::common::{Workshop, yard_metadata};
use glam::{DQuat, DVec3};
use serde_json::Value;
use wm_scene::synthetic::{moved, rotation};
use wm_scene::{Group, Metadata};

/// A yard that lies as it should not: turned, moved, half as large, with an up in its file that is
/// wrong.
struct Yard {
    shop: Workshop,
    turn: DQuat,
}

const SHIFT: DVec3 = DVec3::new(3.0, -8.0, 5.0);

impl Yard {
    fn new() -> Self {
        let yard = Self { shop: Workshop::with("", &[]), turn: rotation(3, 1) };
        let metadata = Metadata { up: Some(yard.turn * DVec3::X), ..yard_metadata(1.0) };
        let metadata = Metadata { ground: Some(-40.0), metres_per_unit: None, ..metadata };
        yard.shop.scene("yard", moved(&crate::common::yard().build(), yard.turn, 0.5, SHIFT), &metadata);
        yard
    }

    /// A point of the yard as the scene has it, as an option takes it.
    fn at(&self, x: f64, y: f64, z: f64) -> String {
        let [x, y, z] = (self.turn * (0.5 * DVec3::new(x, y, z)) + SHIFT).to_array();
        format!("{x:.4},{y:.4},{z:.4}")
    }

    /// The places of a scene's splats in the yard, m.
    fn places(&self, scene: &str) -> Vec<DVec3> {
        let place =
            |mean: &[f32; 3]| 2.0 * (self.turn.inverse() * (DVec3::from(mean.map(f64::from)) - SHIFT));
        self.shop.open(scene).splats.means.iter().map(place).collect()
    }

    fn ground(&self) -> String {
        format!("{}:{}:{}", self.at(-10.0, -8.0, 0.0), self.at(9.0, -6.0, 0.0), self.at(1.0, 12.0, 0.05))
    }

    fn run(&self, words: &str) -> String {
        self.shop.run(words)
    }

    fn survey(&self, scene: &str) -> Value {
        self.shop.inspected(scene)["survey"].clone()
    }

    /// Checks that all commands know how the scene stands.
    fn stands(&self, scene: &str) {
        let survey = self.survey(scene);
        let number = |value: &Value| value.as_f64().unwrap();
        let up: Vec<f64> = survey["up"]["value"].as_array().unwrap().iter().map(number).collect();
        let truth = self.turn * DVec3::Z;
        let off = DVec3::from_slice(&up).angle_between(truth).to_degrees();
        assert!(off < 1.0, "{scene}: {off} degrees: {survey}");
        assert_eq!(survey["up"]["confidence"], "sure");
        assert!(survey["up_source"].as_str().unwrap().contains("set by hand"), "{survey}");
        let ground = number(&survey["ground"]["value"]) - SHIFT.dot(truth);
        assert!(ground.abs() < 0.05, "{scene}: ground {ground} off: {survey}");
        assert!((number(&survey["metres_per_unit"]["value"]) - 2.0).abs() < 1e-3, "{survey}");
    }
}

#[test]
fn three_points_and_a_length_set_a_scene_right() {
    let yard = Yard::new();
    let bytes = yard.shop.read("yard.ply");
    let length = format!("{}:{}=10", yard.at(0.0, 0.0, 0.0), yard.at(0.0, 10.0, 0.0));
    let ground = yard.ground();
    let lines = yard.run(&format!("align yard.ply --overwrite --ground {ground} --known-distance {length}"));
    assert!(lines.starts_with("yard.ply.wm.toml: written\n  up: "), "{lines}");
    assert!(lines.contains(", 90.") || lines.contains(", 89."), "{lines}");
    assert!(lines.contains("most splats are on that side of the ground; --flip turns it round"), "{lines}");
    assert!(lines.contains("scale: 1 unit is 1 m (assumed) -> 2 m ("), "{lines}");
    assert_eq!(yard.shop.read("yard.ply"), bytes, "the splats stay");
    yard.stands("yard.ply");
    // It goes with the scene, whatever the format.
    for name in ["a.ply", "a.spz", "a.glb", "a.splat"] {
        yard.run(&format!("convert yard.ply {name}"));
        yard.stands(name);
    }

    // Snow lies on the ground and on what stands on it, and on nothing's underside.
    yard.run("bake a.splat --set snow_cover.depth=0.2 -o white.ply --device cpu");
    let bare = yard.shop.open("a.splat").splats.len();
    let heights: Vec<f64> = yard.places("white.ply")[bare..].iter().map(|at| 0.5 * at.z).collect();
    assert!(heights.len() > 500, "{}", heights.len());
    let on_ground = heights.iter().filter(|z| (0.0..0.2).contains(*z)).count();
    let below = heights.iter().filter(|z| **z < -0.05).count();
    let all = heights.len();
    assert!(on_ground * 2 > all && below * 50 < all, "{on_ground} {below} of {all}");
}

#[test]
fn a_scene_is_written_anew_and_turned_round() {
    let yard = Yard::new();
    yard.run(&format!("align yard.ply -o b.spz --ground {} --metres-per-unit 2", yard.ground()));
    yard.stands("b.spz");
    // The input is as it was.
    assert_eq!(yard.shop.open("yard.ply").metadata.up, Some(yard.turn * DVec3::X));
    let lines = yard.run("align b.spz --flip --overwrite");
    assert!(lines.contains("180.0 degrees apart"), "{lines}");
    let lines = yard.run("align b.spz --flip -o c.ply");
    assert!(lines.contains("c.ply: written") && lines.contains("turned round by hand"), "{lines}");
    let metadata = yard.shop.open("c.ply").metadata;
    assert!(metadata.up.unwrap().angle_between(yard.turn * DVec3::Z).to_degrees() < 1.0);
    // In place twice, and a name that is taken.
    yard.run("align c.ply --up 0,0,1 -o c.ply --overwrite");
    let metadata = yard.shop.open("c.ply").metadata;
    assert_eq!((metadata.up, metadata.metres_per_unit), (Some(DVec3::Z), Some(2.0)));
}

#[test]
fn values_that_cannot_be_used_are_refused() {
    let yard = Yard::new();
    yard.shop.put("text.ply", "ply\nnonsense\n");
    for (words, says) in [
        ("align yard.ply --flip", "give an output scene with -o, or --overwrite to set"),
        ("align yard.ply --overwrite", "nothing to set"),
        ("align yard.ply -o yard.ply --flip", "yard.ply: is the input itself"),
        ("align yard.ply -o a.jpg --flip", "a.jpg"),
        ("align yard.ply -o none/a.ply --flip", "none"),
        ("align none.ply --overwrite --flip", "none.ply"),
        ("align text.ply --overwrite --flip", "text.ply"),
        ("align yard.ply --overwrite --up 0,0,0", "it has no length"),
        ("align yard.ply --overwrite --up NaN,0,1", "\"NaN\" is not a number"),
        ("align yard.ply --overwrite --ground NaN", "the height of the ground is NaN: it must be finite"),
        ("align yard.ply --overwrite --ground 0,0,0:1,0,0", "give three points"),
        ("align yard.ply --overwrite --ground 0,0,0:1,0,0:inf,1,0", "\"inf\" is not a number"),
        ("align yard.ply --overwrite --ground 0,0,0:5,0,0:9,0.1,0", "lie nearly on one line"),
        ("align yard.ply --overwrite --ground 0,0,0:1,1,1:1,1,1", "two points of the ground are the same"),
        (
            "align yard.ply --overwrite --known-distance 0,0,0:1,0,0=-2",
            "a known distance of -2 m gives no scale",
        ),
        ("align yard.ply --overwrite --known-distance 1,0,0:1,0,0=2", "must be finite and apart"),
        ("align yard.ply --overwrite --metres-per-unit -1", "-1 metres per unit are no scale"),
        ("align yard.ply --overwrite --water 0,0,0:1,0,0", "give three points or more"),
        ("align yard.ply --overwrite --camera-height 1.6", "the scene has no cameras of photos"),
    ] {
        yard.shop.refused(words, &[says]);
    }
}

#[test]
fn nothing_lies_on_outlined_water() {
    let yard = Yard::new();
    yard.run(&format!("align yard.ply -o dry.ply --ground {} --metres-per-unit 2", yard.ground()));
    let corners = [(-9.0, -10.0), (-4.5, -10.0), (-4.5, -4.0), (-9.0, -4.0)];
    let outline = corners.map(|(x, y)| yard.at(x, y, 0.0)).join(":");
    let lines = yard.run(&format!("align dry.ply -o pond.spz --water {outline}"));
    assert!(lines.contains("water: 1 outline"), "{lines}");
    assert!(yard.run("inspect pond.spz").contains("water: 1 outline in the metadata"));
    let snow = |scene: &str| {
        yard.run(&format!("bake {scene} --set snow_cover.depth=0.1 -o white.ply --device cpu --overwrite"));
        let groups = yard.shop.open("white.ply").splats.groups;
        let is_there = |p: &DVec3| (-8.5..-5.0).contains(&p.x) && (-9.5..-4.5).contains(&p.y);
        let all = yard.places("white.ply").into_iter().zip(groups);
        all.filter(|(place, group)| *group == Group::Snow && is_there(place)).count()
    };
    let (dry, pond) = (snow("dry.ply"), snow("pond.spz"));
    assert!(dry > 200 && pond == 0, "{dry} {pond}");
    yard.run("align pond.spz -o none.ply --water none");
    assert_eq!(yard.shop.open("none.ply").metadata.water, Some(Vec::new()));
}

/// Writes the yard under a dome of lilac sky that stands on its side, labelled, with its light in
/// the file.
fn domed(shop: &Workshop) {
    let mut place = crate::common::yard();
    place.sky(DVec3::ZERO, 300.0, 2000);
    let mut splats = place.build();
    let first = splats.len() - 2000;
    let mut dome = splats.select(&(first..splats.len()).collect::<Vec<_>>());
    dome = moved(&dome, DQuat::from_rotation_arc(DVec3::Z, DVec3::Y), 1.0, DVec3::ZERO);
    splats.means[first..].copy_from_slice(&dome.means);
    splats.quats[first..].copy_from_slice(&dome.quats);
    splats.groups[first..].fill(Group::Sky);
    for index in first..splats.len() {
        let stride = splats.sh_stride();
        splats.sh[index * stride..index * stride + 3].copy_from_slice(&[0.9, -0.6, 1.2]);
    }
    let metadata = Metadata { airlight: Some([0.6, 0.3, 0.7]), ..yard_metadata(1.0) };
    shop.scene("domed", splats, &metadata);
}

#[test]
fn a_wrong_sky_is_dropped_or_decided_anew() {
    let yard = Yard::new();
    domed(&yard.shop);
    let sky = |scene: &str| yard.survey(scene)["sky_splats"].as_u64().unwrap();
    assert_eq!(sky("domed.ply"), 2000);
    let lines = yard.run("convert domed.ply none.ply --sky drop");
    assert!(lines.contains("sky: 2000 splats before, 0 now; 2000 left out"), "{lines}");
    let none = yard.shop.open("none.ply");
    assert_eq!((none.metadata.airlight, none.metadata.up), (None, Some(DVec3::Z)));
    assert_eq!(sky("none.ply"), 0);
    yard.run("convert domed.ply half.ply --sky rebuild");
    let half = yard.shop.open("half.ply");
    let count = half.splats.groups.iter().filter(|group| **group == Group::Sky).count();
    assert!((950..1250).contains(&count), "{count}");
    let lowest = half.splats.means.iter().map(|mean| mean[2]).fold(f32::INFINITY, f32::min);
    assert!(lowest > -35.0, "{lowest}");

    // Fog takes its colour from the weather and not from a sky that is none.
    let (_, view) = crate::common::yard_look((48, 32));
    let fog = |sky: &str| {
        let options = format!("--weather=fog --set=fog.mor=10 --device=cpu --sky={sky}");
        let picture = yard.shop.render(&yard.shop.path("domed.ply"), &view, &format!("{sky}.png"), &options);
        let picture = crate::common::read_png(&picture);
        let sum = picture.pixels.iter().fold([0u32; 3], |s, p| [0, 1, 2].map(|k| s[k] + u32::from(p[k])));
        sum.map(|v| f64::from(v) / picture.pixels.len() as f64)
    };
    let tint = |[r, g, b]: [f64; 3]| r.max(b) - g;
    let (kept, dropped) = (fog("keep"), fog("drop"));
    assert!(tint(kept) > 30.0 && tint(dropped) < 12.0, "{kept:?} {dropped:?}");
    yard.shop.refused("render yard.ply --sky away", &["--sky", "keep, drop, rebuild"]);
}
