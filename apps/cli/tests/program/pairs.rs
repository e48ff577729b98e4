//! The parts of a picture, and data sets of pictures with and without a weather, as files.

use crate::common::*;
use crate::process::{finish, said};
use glam::DVec3;
use std::path::{Path, PathBuf};
use wm_base::npy;
use wm_scene::formats::folder::{cameras_path, write_cameras};
use wm_scene::{Camera, SceneView, Splats};

const SIZE: (u32, u32) = (96, 64);
const WEATHER: &str = "--set fog.mor=60 --set rain.rate=60 --set snowfall.rate=4 --set rain.seed=5";

/// The yard with three photos' views, one of them in a folder of its own.
fn place() -> Shot {
    let yard = Shot::yard(SIZE);
    let view = |name: &str, x: f64, size: (u32, u32)| {
        let (eye, target) = (DVec3::new(x, -12.0, 1.8), DVec3::new(0.0, 4.0, 2.2));
        let camera = Camera::looking(size, 50.0, eye, target, DVec3::Z).unwrap();
        SceneView { name: name.into(), camera: Camera { cx: camera.cx + 3.0, ..camera } }
    };
    let views =
        [view("one.jpg", 0.5, SIZE), view("left/two.png", -2.0, (80, 60)), view("three.JPG", 3.0, SIZE)];
    write_cameras(&cameras_path(&yard.scene), &views).unwrap();
    yard
}

fn pairs(workshop: &Workshop, out: &str, options: &str) -> PathBuf {
    workshop
        .run(&format!("render yard.ply --cameras capture --pairs --time 2 --out {out} {WEATHER} {options}"));
    workshop.path(out)
}

#[test]
fn the_layers_make_up_the_picture() {
    let yard = Shot::yard(SIZE);
    let options = format!("{WEATHER} --layers --also clean,transmittance,airlight,particles,depth");
    let path = yard.render("all.exr", &options);
    let channel = |name: &str| read_channel(&path, name).pixels;
    let coverage = channel("particles.A");
    let (mut worst, mut covered, mut hazy) = (0.0f64, 0, 0);
    for c in ["R", "G", "B"] {
        let [color, clean, share, airlight, light] =
            ["", "clean.", "transmittance.", "airlight.", "particles."]
                .map(|layer| channel(&format!("{layer}{c}")));
        for i in 0..color.len() {
            let through = clean[i] * share[i] + airlight[i];
            worst = worst.max((through * (1.0 - coverage[i]) + light[i] - color[i]).abs());
            covered += usize::from(coverage[i] > 0.02);
            hazy += usize::from(share[i] > 0.05 && share[i] < 0.9);
        }
    }
    assert!(worst < 1e-3, "{worst}");
    assert!(covered > 1000 && hazy > 3000, "{covered} {hazy}");
    assert!(channel("depth.Z").iter().any(|metres| *metres > 10.0));
    // Without --layers each is a file of its own with the same numbers.
    let options = format!("{WEATHER} --also airlight,particles.npy,clean.png");
    let beside = yard.render("own.exr", &options);
    assert!(read_exr(&beside) == read_exr(&path));
    assert!(read_channel(&yard.path("own.airlight.exr"), "G").pixels == channel("airlight.G"));
    let (values, shape) = npy::read(&yard.path("own.particles.npy")).unwrap();
    assert_eq!(shape, [SIZE.1 as usize, SIZE.0 as usize, 4]);
    assert!(values.iter().skip(3).step_by(4).map(|v| f64::from(*v)).eq(coverage.iter().copied()));
    // Clean is the picture without weather.
    let (bare, clean) = (read_channel(&yard.render("bare.exr", ""), "G").pixels, channel("clean.G"));
    assert!(largest(bare.iter().zip(&clean).map(|(a, b)| (a - b).abs())) < 1e-6);
}

/// A card within 1 % of Koschmieder's law: see `visibility.rs` for what a measurement may be off
/// by.
#[test]
fn transmittance_is_that_of_the_distance() {
    let (camera, view) = look((96, 64), 40.0, DVec3::new(0.0, 0.0, 1.7), DVec3::new(0.0, 9.0, 1.7), DVec3::Z);
    for metres in [8.0, 35.0] {
        let card = Card::over(&camera, (48.0, 32.0), 16.0, metres, DVec3::Y);
        let mut splats = Splats::default();
        card.paint(&mut splats, (20, 20), [0.6, 0.2, 0.1]);
        let card_shot = Shot::of("card", splats, &yard_metadata(1.0), view.clone());
        for (set, mor) in [("fog.mor=50", 50.0), ("smog.mor=90 --set smog.scale_height=inf", 90.0)] {
            card_shot.png(&format!("--set {set} --also transmittance.npy"));
            let (shares, shape) = npy::read(&card_shot.path("shot.transmittance.npy")).unwrap();
            assert_eq!(shape, [64, 96, 3]);
            for (x, y) in [(44, 28), (48, 32), (53, 36)] {
                let length = card.ray_length(&camera, x as f64 + 0.5, y as f64 + 0.5);
                let want = (-MOR_DEPTH * length / mor).exp();
                let got = f64::from(shares[3 * (y * 96 + x) + 1]);
                assert!((got / want - 1.0).abs() < 0.01, "{set} {metres} m: {got}, not {want}");
            }
            // Nothing comes through an endless way.
            assert!(shares[..3].iter().all(|share| *share < 1e-4));
        }
    }
}

#[test]
fn a_data_set_has_every_photo_and_says_what_it_is() {
    let workshop = place();
    let folder = pairs(&workshop, "set", "--threads 1");
    let all = files(&folder);
    assert_eq!(all.len(), 3 * 5 + 1);
    let manifest: serde_json::Value = serde_json::from_slice(&all[Path::new("manifest.json")]).unwrap();
    let photos = manifest["photos"].as_array().unwrap();
    assert_eq!(photos.len(), 3);
    for photo in photos {
        for file in photo["files"].as_object().unwrap().values() {
            assert!(all.contains_key(Path::new(file.as_str().unwrap())), "{file}");
        }
        let matrix = &photo["camera_from_world"];
        let center: Vec<f64> = (0..3).map(|k| photo["center"][k].as_f64().unwrap()).collect();
        for row in 0..3 {
            let at = |column: usize| matrix[row][column].as_f64().unwrap();
            assert!((at(0) * center[0] + at(1) * center[1] + at(2) * center[2] + at(3)).abs() < 1e-9);
        }
    }
    assert_eq!((&photos[1]["photo"], &photos[1]["width"]), (&"left/two.png".into(), &80.into()));
    assert_eq!(photos[1]["files"]["depth"], "depth/left/two.npy");
    assert_eq!(photos[0]["cx"], 51.0);
    let effects = &manifest["weather"]["effects"];
    assert_eq!(effects["fog"]["mor"], serde_json::json!({ "value": 60.0, "unit": "m" }));
    assert_eq!((&manifest["seeds"]["rain"], &manifest["time"]), (&5.0.into(), &2.0.into()));

    // One of them alone is the same to the byte: all cameras see the same drops.
    let alone = "render yard.ply -o alone.png --camera three --time 2";
    workshop.run(&format!("{alone} {WEATHER} --also particles,depth.npy,transmittance.npy"));
    for (name, in_set) in [
        ("alone.png", "weather/three.png"),
        ("alone.particles.png", "particles/three.png"),
        ("alone.depth.npy", "depth/three.npy"),
        ("alone.transmittance.npy", "transmittance/three.npy"),
    ] {
        assert!(workshop.read(name) == all[Path::new(in_set)], "{name}");
    }
    workshop.run(&format!("{alone} --overwrite"));
    assert!(read_png(&workshop.path("alone.png")) == read_png(&folder.join("clean/three.png")));
    assert!(all[Path::new("particles/three.png")] != all[Path::new("particles/one.png")]);

    // Any number of threads; and what is missing is made again.
    let other = files(&pairs(&workshop, "other", "--threads 3"));
    assert!(other == all);
    std::fs::remove_file(folder.join("transmittance/one.npy")).unwrap();
    std::fs::remove_file(folder.join("weather/one.png")).unwrap();
    pairs(&workshop, "set", "");
    assert!(files(&folder) == all);
}

#[test]
fn what_makes_no_data_set_is_said_in_a_line() {
    let workshop = place();
    workshop.scene("bare", yard().build(), &yard_metadata(1.0));
    workshop.put("taken", "a file");
    let set = "yard.ply --cameras capture --pairs";
    for (words, says) in [
        (
            "bare.ply --cameras capture --pairs -w fog -o set",
            "the scene has no views of photos; name the folder",
        ),
        ("yard.ply --pairs -w fog -o set", "--pairs needs cameras: add --cameras capture"),
        ("yard.ply --cameras capture -w fog -o set", "--cameras is for data sets: add --pairs"),
        ("yard.ply --cameras all --pairs -o set", "invalid value 'all' for '--cameras <SET>'"),
        (&format!("{set} -o set"), "--pairs needs a weather"),
        (&format!("{set} -w fog -o taken"), "taken: is not a folder; --pairs writes many files"),
        (&format!("{set} -w fog -o a.png"), "--out a.png: is not a folder"),
        (&format!("{set} -w fog --path orbit -o set"), "leave out --path"),
        (
            &format!("{set} -w fog --set fidelity=paper -o set"),
            "has no transmittance; use --set fidelity=physical",
        ),
        ("yard.ply -w fog --set fidelity=paper --also clean -o a.png", "has no transmittance"),
        ("yard.ply --also depth --layers -o a.png", "--layers are those of an .exr"),
        ("yard.ply --layers -o a.exr", "--also"),
    ] {
        workshop.refused(&format!("render {words}"), &[says]);
    }
    // A folder of another run is left as it is.
    pairs(&workshop, "set", "");
    let words = format!("render {set} -w fog -o set");
    workshop.refused(&words, &["holds pictures of another run"]);
    assert!(said(&finish(&mut (*workshop).command(&words))).contains("another folder"));
}
