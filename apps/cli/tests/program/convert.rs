//! `convert` and `inspect` on every format, by running the binary: what was there is there again,
//! and what is lost is said.

use crate::common::{Workshop, read_png};
use crate::process::{finish, said, succeeds};
use glam::DVec3;
use std::fs;
use wm_scene::formats::{FORMATS, write_scene};
use wm_scene::splats::Splat;
use wm_scene::{Camera, Group, Metadata, SceneView, Splats};

/// A folder with a scene `a.ply` in it: a floor and a wall of 600 splats of SH degree 1, up -y, two
/// units a metre.
fn desk() -> Workshop {
    let mut splats = Splats::with_capacity(600, 1);
    for i in 0..600 {
        let (x, along) = ((i % 30) as f32 * 0.1 - 1.5, (i / 30) as f32 * 0.15);
        let mean = if i < 300 { [x, 0.0, along] } else { [x, -along + 1.5, 1.5] };
        splats.push(&Splat {
            mean,
            quat: [1.0, 0.0, 0.0, 0.0],
            log_scale: [-2.5; 3],
            logit_opacity: 2.0,
            rgb: [(i % 7) as f32 / 7.0, 0.5, 0.25],
            group: Group::Scene,
        });
    }
    let metadata = Metadata {
        up: Some(DVec3::NEG_Y),
        metres_per_unit: Some(0.5),
        ground: Some(0.0),
        ..Metadata::default()
    };
    let desk = Workshop::new();
    desk.scene("a", splats, &metadata);
    desk
}

/// The eye of a view that is written beside `a.ply`.
const EYE: DVec3 = DVec3::new(0.0, -1.0, -2.0);

fn write_view(desk: &Workshop) {
    let camera = Camera::looking((64, 48), 50.0, EYE, DVec3::new(0.0, 0.0, 1.0), DVec3::NEG_Y).unwrap();
    let view = SceneView { name: "one.jpg".into(), camera };
    wm_scene::formats::folder::write_cameras(&desk.path("a.ply.cameras.json"), &[view]).unwrap();
}

#[test]
fn every_format_becomes_every_other() {
    let desk = desk();
    let endings: Vec<&str> = FORMATS.iter().filter_map(|f| f.extensions.first().copied()).collect();
    for from in &endings {
        let from = if from.contains(".json") { format!("from/{from}") } else { format!("from.{from}") };
        desk.run(&format!("convert a.ply {from}"));
        for to in &endings {
            let to = if to.contains(".json") { format!("to/{to}") } else { format!("to.{to}") };
            let line = desk.run(&format!("convert {from} {to} --overwrite"));
            assert!(line.starts_with(&format!("{to}: 600 splats, ")), "{line}");
            let metadata = desk.open(&to).metadata;
            assert!((metadata.up.unwrap() - DVec3::NEG_Y).length() < 1e-6, "{from} {to}");
            assert_eq!(metadata.metres_per_unit, Some(0.5), "{from} {to}");
        }
        let report: serde_json::Value =
            serde_json::from_str(&desk.run(&format!("inspect --json {from}"))).unwrap();
        assert_eq!(report["health"]["splats"], 600);
        let loses = report["format"]["loses"].as_array().unwrap();
        assert_eq!(
            loses.is_empty(),
            from.ends_with(".ply") && !from.contains("compressed"),
            "{from}: {loses:?}"
        );
    }
    let lines = desk.run("convert a.ply b.splat");
    assert!(lines.contains("lost: colour by direction: SH degree 1 becomes 0"), "{lines}");
    assert!(desk.run("inspect b.splat").contains("not in it: SH above degree 0"));
}

#[test]
fn scenes_are_turned_scaled_cropped_and_reduced() {
    let desk = desk();
    let before = desk.open("a.ply");
    desk.run("convert a.ply up.ply --up 0,0,1 --scale metres --sh-degree 0");
    let after = desk.open("up.ply");
    assert_eq!((after.splats.sh_degree, after.metadata.metres_per_unit), (0, Some(1.0)));
    assert!((after.metadata.up.unwrap() - DVec3::Z).length() < 1e-6);
    for (a, b) in before.splats.means.iter().zip(&after.splats.means) {
        // Heights, half as many units as before.
        assert!((b[2] + 0.5 * a[1]).abs() < 1e-5, "{a:?} {b:?}");
    }
    let line = desk.run("convert a.ply box.ply --crop -0.45,-9,-9:0.45,9,9");
    assert!(line.starts_with("box.ply: 180 splats"), "{line}");
    let line = desk.run("convert a.ply few.ply --max-splats 250 --threads 2");
    assert!(
        line.starts_with("few.ply: 250 splats") && line.contains("reduced from 600 to 250 splats: PSNR "),
        "{line}"
    );
    assert!((0..250).all(|i| desk.open("few.ply").splats.is_sound(i)));
    // What is small enough is left alone.
    desk.run("convert a.ply all.ply --max-splats 600");
    assert_eq!(desk.open("all.ply"), before);
}

/// People give and are told coordinates of the world, wherever the origin is.
#[test]
fn far_places_keep_an_origin() {
    let desk = desk();
    let origin = DVec3::new(500_000.0, -4_000_000.0, 100.0);
    let mut scene = desk.open("a.ply");
    scene.metadata.origin = Some(origin);
    write_scene(&desk.path("far.ply"), &scene).unwrap();
    let camera = |at: DVec3, target: DVec3| {
        let text = |point: DVec3| point.to_array().map(|v| v.to_string()).join(",");
        format!("--camera={}:{}", text(at), text(target))
    };
    let (eye, target) = (DVec3::new(0.25, -1.0, -3.0), DVec3::new(0.0, 0.0, 1.0));
    let draw = |scene: &str, name: &str, by: DVec3| {
        let camera = camera(eye + by, target + by);
        let words = format!("render {scene} {camera} --size 48x32 --device cpu --assets off -o {name}.png");
        desk.run(&format!("{words} --save-path {name}.json"));
        let path = fs::read_to_string(desk.path(format!("{name}.json"))).unwrap();
        let eye_of: serde_json::Value = serde_json::from_str(&path).unwrap();
        let written: [f64; 3] = serde_json::from_value(eye_of["keyframes"][0]["eye"].clone()).unwrap();
        assert!((DVec3::from(written) - eye - by).length() < 1e-6, "{path}");
        let words = format!("--size 48x32 --device cpu --assets off -o again-{name}.png");
        desk.run(&format!("render {scene} --camera {name}.json {words}"));
        let [picture, again] =
            ["", "again-"].map(|start| read_png(&desk.path(format!("{start}{name}.png"))).pixels);
        assert!(again == picture, "{name}: the path that was saved shows another view");
        picture
    };
    assert!(draw("a.ply", "near", DVec3::ZERO) == draw("far.ply", "far", origin));
    let about = desk.run("inspect far.ply");
    assert!(about.contains("origin: 500000,-4000000,100"), "{about}");
    assert!(about.contains("x 499998.50 .. 500001.40, y -4000001.35 .. -4000000.00"), "{about}");
    // The ground is at y = -4000000 and up is -y.
    assert!(about.contains("ground: 4000000 units along up"), "{about}");
    let half = desk.run("convert far.ply half.ply --crop 499999.55,-4000009,91:500000.45,-3999991,109");
    assert!(half.starts_with("half.ply: 180 splats"), "{half}");
    // Scaled and turned it is where the world is scaled and turned to.
    desk.run("convert far.ply up.ply --up 0,0,1 --scale 0.5");
    let turned = desk.open("up.ply").metadata.origin.unwrap();
    assert!(turned.distance(0.5 * DVec3::new(500_000.0, 100.0, 4_000_000.0)) < 1e-6, "{turned}");
    // With no origin, or one far away, f32 folds its splats together, and that is said.
    let baked = desk.run("convert far.ply baked.ply --origin none");
    assert!(
        baked.contains("lost: positions have steps of up to 0.25 units, wider than 100 % of the splats"),
        "{baked}"
    );
    let read = desk.open("baked.ply");
    assert_eq!(read.metadata.origin, Some(DVec3::new(500_000.0, -4_000_000.0, 100.0)));
    assert_eq!(read.remarks.len(), 2);
    desk.run("convert far.ply other.ply --origin 500001,-4000002,100");
    let other = desk.open("other.ply");
    assert_eq!(other.metadata.origin, Some(DVec3::new(500_001.0, -4_000_002.0, 100.0)));
    assert!((other.splats.means[0][1] - scene.splats.means[0][1] - 2.0).abs() < 1e-5);
    desk.refused("convert far.ply x.ply --origin 1,2", &["\"1,2\" has 2 numbers, a point has three"]);
    // Facts beside a file that is left as it is are in its coordinates.
    desk.run("align baked.ply --overwrite --ground 3999990 --lamp 500000,-4000003,101");
    let facts = fs::read_to_string(desk.path("baked.ply.wm.toml")).unwrap();
    assert!(facts.contains("ground = 3999990.0") && !facts.contains("origin"), "{facts}");
    let lamp = desk.open("baked.ply").metadata.lamps.unwrap()[0].at;
    assert!((DVec3::from(lamp) - DVec3::new(0.0, -3.0, 1.0)).length() < 1e-6, "{lamp:?}");
}

#[test]
fn what_is_read_otherwise_and_what_is_lost_is_said() {
    let desk = desk();
    let lines = desk.run("convert a.ply packed.glb --gltf spz");
    assert!(lines.contains("lost: rounded: positions 2^-22"), "{lines}");
    let floats = "x y z f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 rot_0 rot_1 rot_2 rot_3 beta";
    let properties: String = floats.split(' ').map(|name| format!("property float {name}\n")).collect();
    let file = |rows: &str| {
        let count = rows.lines().count();
        format!("ply\nformat ascii 1.0\nelement vertex {count}\n{properties}end_header\n{rows}")
    };
    let row = "0 0 1 0.5 0.5 0.5 2 -2 -3 1 0 0 0 1\n";
    desk.put("flat.ply", file(&row.repeat(3)));
    let told = said(&succeeds(&mut desk.command("convert flat.ply flat.sog")));
    assert!(told.contains("note: 2D splats (two scales each)"), "{told}");
    assert!(told.contains("warning: the property beta "), "{told}");
    assert!(desk.open("flat.sog").splats.scales(0).contains(&f64::from(-30f32).exp()));
    // What cannot be drawn is refused, or left out.
    let far = row.replacen("0 0 1", "1e20 0 1", 1);
    desk.put("far.ply", file(&format!("{row}{far}")));
    let says = "far.ply: 1 of 2 splats hold NaN, infinite or absurd numbers (1 in positions); --repair leaves them out";
    let output = finish(&mut desk.command("convert far.ply far.spz"));
    assert!(!output.status.success() && said(&output).contains(says), "{}", said(&output));
    desk.run("convert far.ply far.spz --repair");
    assert_eq!(desk.open("far.spz").splats.len(), 1);
}

#[test]
fn many_at_once_go_into_a_folder() {
    let desk = desk();
    fs::copy(desk.path("a.ply"), desk.path("b.ply")).unwrap();
    fs::create_dir(desk.path("web")).unwrap();
    let lines = desk.run("convert a.ply b.ply --to spz --folder web");
    assert!(lines.contains("web/a.spz: 600 splats") && lines.contains("web/b.spz: 600 splats"), "{lines}");
    desk.run("convert a.ply b.ply --to meta.json --folder web");
    assert_eq!(desk.open("web/b").splats.len(), 600);
    desk.run("convert web/a.spz --to glb");
    assert!(desk.path("web/a.glb").is_file());
}

#[test]
fn nothing_is_replaced_unasked() {
    let desk = desk();
    let before = desk.open("a.ply");
    fs::create_dir(desk.path("web")).unwrap();
    fs::hard_link(desk.path("a.ply"), desk.path("hard.ply")).unwrap();
    desk.run("convert a.ply b.spz");
    desk.run("convert a.ply web/meta.json");
    let mut own = vec!["a.ply", "./a.ply", "web/../a.ply", "hard.ply"];
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink("a.ply", desk.path("soft.ply")).unwrap();
        own.push("soft.ply");
    }
    for out in own {
        let says = format!("{out}: is the input itself; choose another name, or replace it with --overwrite");
        desk.refused(&format!("convert a.ply {out} --max-splats 100"), &[&says]);
    }
    let exists = "exists already; choose another name, or replace it with --overwrite";
    for (words, out) in [
        ("convert a.ply b.spz", "b.spz"),
        ("convert a.ply web/meta.json", "web/meta.json"),
        ("convert a.ply --to spz --folder .", "./a.spz"),
    ] {
        if out == "./a.spz" {
            desk.run("convert a.ply a.spz");
        }
        desk.refused(words, &[&format!("{out}: {exists}")]);
    }
    desk.refused("convert web web/meta.json --max-splats 100", &["web/meta.json: is the input itself"]);
    let bake = "bake a.ply --set snow_cover.depth=0.2 --device cpu --threads 2";
    let other = "give another name with --out, or replace it with --overwrite";
    desk.refused(&format!("{bake} -o b.spz"), &[&format!("b.spz: exists already; {other}")]);
    desk.refused(&format!("{bake} -o a.ply"), &[&format!("a.ply: is the input itself; {other}")]);
    assert_eq!(desk.open("a.ply"), before);

    // Asked for, also in place: the metadata beside it are those of the new scene.
    wm_scene::formats::write_sidecar(&desk.path("a.ply"), &before.metadata).unwrap();
    desk.run("convert a.ply a.ply --max-splats 500 --scale 2 --overwrite");
    let after = desk.open("a.ply");
    assert_eq!((after.splats.len(), after.metadata.metres_per_unit), (500, Some(0.25)));
    assert_eq!(desk.open("hard.ply"), before, "the other name of the file keeps the file");
    desk.run("convert web web/meta.json --max-splats 400 --overwrite");
    assert_eq!(desk.open("web").splats.len(), 400);
    desk.run("convert a.ply --to ply --max-splats 300 --overwrite");
    assert_eq!(desk.open("a.ply").splats.len(), 300);
    desk.run(&format!("{bake} -o b.spz --overwrite"));
    assert!(desk.open("b.spz").splats.len() > 300);
}

#[cfg(unix)]
#[test]
fn a_scene_behind_a_link_is_replaced_with_what_lies_beside_it() {
    let desk = desk();
    write_view(&desk);
    fs::create_dir(desk.path("links")).unwrap();
    std::os::unix::fs::symlink(desk.path("a.ply"), desk.path("links/b.ply")).unwrap();
    assert_eq!(desk.open("links/b.ply"), desk.open("a.ply"));
    desk.run("convert links/b.ply links/b.ply --scale 2 --overwrite");
    assert!(desk.path("links/b.ply").is_symlink());
    assert_eq!(fs::read_dir(desk.path("links")).unwrap().count(), 1);
    let scene = desk.open("a.ply");
    assert_eq!((scene.metadata.metres_per_unit, desk.open("links/b.ply")), (Some(0.25), scene.clone()));
    assert!((scene.views[0].camera.center() - 2.0 * EYE).length() < 1e-9);
}

#[test]
fn views_and_baked_snow_go_along() {
    let desk = desk();
    write_view(&desk);
    desk.run("convert a.ply b.spz --scale 2");
    let [view] = &desk.open("b.spz").views[..] else { panic!("one view") };
    assert!((view.camera.center() - 2.0 * EYE).length() < 1e-9);
    let bake = "bake a.ply --set snow_cover.depth=0.2 -o snowy.spz --device cpu --threads 2";
    let said = said(&succeeds(&mut desk.command(bake)));
    assert!(said.contains("snowy.spz: lost: the label of "), "{said}");
    assert!(desk.open("snowy.spz").splats.len() > 600);
}

/// Levels of detail are written, drawn under a budget, read back whole and written as 3D Tiles; a
/// file that is missing is named.
#[test]
fn levels_of_detail() {
    let desk = desk();
    fs::create_dir(desk.path("lod")).unwrap();
    let line = desk.run("convert a.ply lod/lod-meta.json --lod 3");
    assert!(line.starts_with("lod/lod-meta.json: 3 levels of 600, 300, 150 splats"), "{line}");
    desk.run("convert lod/lod-meta.json back.ply");
    assert_eq!(desk.open("back.ply").splats.len(), 600);
    desk.run("convert lod/lod-meta.json coarse.ply --level 2");
    assert_eq!(desk.open("coarse.ply").splats.len(), 150);
    desk.run("convert lod/lod-meta.json tiles/tileset.json");
    assert!(fs::read_to_string(desk.path("tiles/tileset.json")).unwrap().contains("KHR_gaussian_splatting"));
    fs::remove_file(desk.path("lod/1_0/sh0.webp")).unwrap();
    desk.refused("convert lod/lod-meta.json d.ply --level 1", &["lod/1_0/meta.json", "sh0.webp"]);
}

#[test]
fn what_cannot_be_is_refused_and_nothing_is_written() {
    let desk = desk();
    fs::create_dir(desk.path("other")).unwrap();
    fs::copy(desk.path("a.ply"), desk.path("other/a.ply")).unwrap();
    for (words, says) in [
        ("convert a.ply", "1 paths: give an input and an output scene, or --to"),
        ("convert a.ply other/a.ply c.ply", "3 paths: give an input"),
        (
            "convert a.ply b.obj",
            "b.obj: no scene format is written to a name that ends in \".obj\"; use .ply",
        ),
        ("convert a.ply tileset.json", "a.ply: 3D Tiles are made of a scene in levels of detail"),
        ("convert a.ply no/b.spz", "the folder \"no\" does not exist"),
        ("convert no.ply b.spz", "no.ply: no such file"),
        ("convert a.ply --to ply", "a.ply has that ending already"),
        ("convert a.ply other/a.ply --to spz --folder other", "would both be other/a.spz"),
        ("convert a.ply b.ply --crop 5,5,5:6,6,6", "--crop: no splat is in the box"),
        ("convert a.ply b.ply --crop 5,5:6,6,6", "a point has three"),
        ("convert a.ply b.ply --scale 0", "give a number above 0, or metres"),
        ("convert a.ply b.ply --max-splats 0", "0 is not in 1.."),
    ] {
        desk.refused(words, &[says]);
    }
    let mut scene = desk.open("a.ply");
    scene.metadata.metres_per_unit = None;
    write_scene(&desk.path("a.ply"), &scene).unwrap();
    desk.refused("convert a.ply b.ply --scale metres", &["its scale is not known"]);
    scene.splats.means[3][0] = f32::NAN;
    write_scene(&desk.path("a.ply"), &scene).unwrap();
    desk.refused("convert a.ply b.ply", &["1 of 600 splats hold NaN", "--repair leaves them out"]);
    let line = desk.run("convert a.ply b.ply --repair");
    assert!(line.starts_with("b.ply: 599 splats"), "{line}");
}
