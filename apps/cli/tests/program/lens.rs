//! Drops on the lens: frames alone and in sequences, and weathers whose glass is clear. Pictures
//! through fisheyes, panoramas and distorted lenses.

use crate::common::*;
use crate::process::{finish, said};
use glam::DVec3;
use weather_magician::camera_model::{CameraModel, SensorCamera};
use weather_magician::{Camera, FrameCamera, FrameRequest, Layers, LensModel, LensView, Picture, Renderer};
use wm_base::statistics::median;
use wm_scene::camera::Distortion;

const SIZE: (u32, u32) = (144, 96);

/// Rain that begins on dry ground and ends, on a dirty windscreen.
const SHOWER: &str = r#"
[rain]
rate = { keys = [[0, 0], [1, 60], [2, 60], [3, 0]] }
[wind]
speed = 4
[lens]
distance = 0.1
rained_before = 0
drying = 20
dirt = 0.1
veil = 1
"#;

#[test]
fn a_wet_lens_alone_is_that_of_the_sequence_on_any_number_of_threads() {
    Shot::yard(SIZE).check_frames_alone(SHOWER);
}

/// Mean and greatest change of colour between two pictures.
fn change(a: &Picture, b: &Picture) -> (f32, f32) {
    let changes = a.frame.rgb.iter().zip(&b.frame.rgb).map(|(a, b)| (a - b).abs());
    let (sum, most) = changes.fold((0.0, 0.0f32), |(sum, most), change| (sum + change, most.max(change)));
    (sum / a.frame.rgb.len() as f32, most)
}

#[test]
fn a_clear_glass_changes_no_byte_and_a_wet_one_the_colour_alone() {
    let shown = pictures(
        yard().build(),
        &yard_look(SIZE).0,
        5.0,
        &[
            &[],
            &["lens=on"],
            &["lens.rate=0", "rain.rate=20", "rain.opacity=0"],
            &["rain.rate=20", "rain.opacity=0"],
            &["lens.rate=20", "lens.distance=0.1"],
            &["lens.rate=20", "lens.distance=0.03", "lens.aperture=5"],
            &["lens.dirt=0.3"],
            &["lens.veil=1"],
        ],
    );
    assert_eq!(shown[0].frame, shown[1].frame);
    assert_eq!(shown[2].frame, shown[3].frame);
    for (k, least) in [(4, 0.005), (5, 0.005), (6, 0.01), (7, 0.002)] {
        let (mean, most) = change(&shown[0], &shown[k]);
        println!("{k}: {mean} {most}");
        assert!(mean > least && most > 0.02, "{k}: {mean} {most}");
        assert_eq!(
            (&shown[0].frame.depth, &shown[0].frame.alpha),
            (&shown[k].frame.depth, &shown[k].frame.alpha)
        );
    }
}

/// Rain in fog, and the wet ground below it.
const RAIN: [&str; 2] = ["fog.mor=120", "rain.rate=30"];
const WET: [&str; 2] = ["wetness.amount=1", "wetness.puddles=0.5"];

/// A pinhole picture of the yard in a weather and one through a lens, with depth.
fn both(camera: &Camera, lens: &LensView, changes: &[&str]) -> [Picture; 2] {
    let mut renderer = Renderer::cpu().unwrap();
    let mut place = load_yard(&mut renderer, &yard_metadata(1.0));
    let weather = weather(changes);
    let model = CameraModel { lens: Some(lens.clone()), ..CameraModel::default() };
    let device = SensorCamera::new(model, (*camera).into());
    let cameras: [FrameCamera<'_>; 2] = [camera.into(), (&device).into()];
    cameras.map(|camera| {
        let layers = Layers::COLOR | Layers::DEPTH;
        let request = FrameRequest { layers, ..FrameRequest::new(&weather, camera, 2.0) };
        renderer.render(&mut place, &request).unwrap()
    })
}

/// A lens without distortion is a pinhole: its one side is the same picture with a margin.
#[test]
fn a_lens_without_distortion_is_a_pinhole() {
    let (camera, _) = yard_look((120, 80));
    let lens = LensView::new(LensModel::Perspective(Distortion::None), &camera).unwrap();
    let [pinhole, picture] = both(&camera, &lens, &RAIN);
    let pairs = pinhole.frame.rgb.iter().zip(&picture.frame.rgb);
    let off: Vec<f64> = pairs.map(|(a, b)| f64::from((a - b).abs())).collect();
    let (mean, most) = (off.iter().sum::<f64>() / off.len() as f64, largest(off.iter().copied()));
    // Near splats beside the view are flattened as its sides are, which the margin moves a little.
    println!("{mean} {most}");
    assert!(mean < 2e-4 && most < 0.1, "{mean} {most}");
}

/// A fisheye and a panorama show the place where a pinhole shows it, with the same weather before
/// it, and as far away. The pinhole sees as much as a side of the cube: near splats beside the view
/// reach into it the farther, the wider it is.
#[test]
fn lenses_show_what_pinholes_show() {
    let (eye, target) = (DVec3::new(0.5, -12.0, 1.8), DVec3::new(0.0, 4.0, 2.2));
    let (camera, _) = look((174, 174), 94.0, eye, target, DVec3::Z);
    let (fisheye, round) = LensModel::fisheye((256, 256), 180.0).unwrap();
    let wide = Camera { width: 768, height: 384, ..round };
    for (lens, own) in [(fisheye, round), (LensModel::Equirectangular, wide)] {
        let view = LensView::new(lens, &own).unwrap();
        let [pinhole, picture] = both(&camera, &view, &[RAIN, WET].concat());
        let (mut sum, mut count) = (0.0, 0);
        let mut off = Vec::new();
        for y in 0..own.height {
            for x in 0..own.width {
                let Some(ray) = lens.ray(&own, [f64::from(x) + 0.5, f64::from(y) + 0.5]) else {
                    let at = picture.frame.index(x, y);
                    assert_eq!(picture.frame.rgb[3 * at..3 * at + 3], [0.0; 3]);
                    continue;
                };
                let at = [ray.x / ray.z * camera.fx + camera.cx, ray.y / ray.z * camera.fy + camera.cy];
                let inside = at[0] > 1.0 && at[1] > 1.0 && at[0] < 173.0 && at[1] < 173.0;
                if ray.z <= 0.0 || !inside {
                    continue;
                }
                let (from, to) = (picture.frame.index(x, y), pinhole.frame.index(at[0] as u32, at[1] as u32));
                for k in 0..3 {
                    sum += f64::from((picture.frame.rgb[3 * from + k] - pinhole.frame.rgb[3 * to + k]).abs());
                }
                count += 3;
                let (far, z) = (f64::from(picture.frame.depth[from]), f64::from(pinhole.frame.depth[to]));
                // Farther from the axis another side shows it, and flattens near splats otherwise;
                // far away a pixel of flat ground is long.
                let is_solid = picture.frame.alpha[from].min(pinhole.frame.alpha[to]) > 0.9;
                if is_solid && z < 9.0 && ray.z > 0.8 {
                    off.push((far * ray.z / z - 1.0).abs());
                }
            }
        }
        let (mean, middle) = (sum / f64::from(count), median(&mut off).unwrap());
        let wrong = off.iter().filter(|off| **off > 0.2).count() as f64 / off.len() as f64;
        println!("{lens:?}: colour {mean:.4}, depth {middle:.4}, off by a fifth {wrong:.4}");
        // Pixels of other sizes, taken by the nearest: edges and what is flat differ.
        assert!(count > 5000 && mean < 0.008 && middle < 0.06 && wrong < 0.03, "{lens:?}");
    }
}

#[test]
fn the_program_draws_through_lenses_and_refuses_what_it_cannot_draw() {
    let mut yard = Shot::yard((96, 64));
    yard.view = yard.view.without("--fov");
    let options = "--weather heavy-rain --assets off --lens fisheye:200 --also depth.npy";
    let [one, two] = [1, 2].map(|threads| yard.png(&format!("{options} --threads {threads}")));
    assert!(one == two);
    let says = |lens: &str, options: &str, words: &[&str]| {
        yard.put("lens.toml", lens);
        let output = finish(&mut yard.command("no.png", &format!("--assets off --lens lens.toml {options}")));
        let said = said(&output);
        assert!(!output.status.success() && words.iter().all(|word| said.contains(word)), "{said}");
        assert!(!yard.path("no.png").exists());
    };
    let lens = "model = \"OPENCV\"\nsize = [96, 64]\nfocal = [80.0, 80.0]\n";
    says(&format!("{lens}distortion = [-2.0]\n"), "", &["lens.toml", "folds within the picture"]);
    says(&format!("{lens}focus = 1\n"), "", &["lens.toml, line 4", "focus"]);
    says(lens, "--fov 50", &["--fov: cannot be used with --lens"]);
    says(lens, "--set lens.rate=20", &["drops on the lens are drawn for pinholes only"]);
    says(lens, "--set fidelity=paper --weather heavy-rain", &["fidelity paper"]);
}

#[test]
fn shutters_and_rigs_make_what_they_say() {
    let mut yard = Shot::yard((96, 64));
    let options = "--weather heavy-rain --assets off --camera-speed 14 --readout 0.02 --exposure-time 0.004 --exposure auto --iso 400";
    let [one, two] = [1, 2].map(|threads| yard.png(&format!("{options} --threads {threads}")));
    assert!(one == two);
    let rig = "[[sensor]]\nname = \"front\"\nkind = \"camera\"\nrate = 10\nphase = 0.05\nsize = [48, 32]\nreadout = 0.01\n\
               [[sensor]]\nname = \"top\"\nkind = \"lidar\"\nmodel = \"vlp-16\"\nsub_rays = 1\nformat = \"bin\"\n\
               [[sensor]]\nname = \"dvs\"\nkind = \"events\"\nrate = 10\nsize = [48, 32]\npictures = 2\n";
    yard.view = yard.view.without("--fov").without("--size");
    let drive = |rig: &str, options: &str| {
        yard.put("rig.toml", rig);
        let usual = "--assets off --weather moderate-rain --seconds 0.2 --camera-speed 10 --rig rig.toml";
        finish(&mut yard.command("drive", &format!("{usual} --also depth.npy {options}")))
    };
    let output = drive(rig, "");
    assert!(output.status.success(), "{}", said(&output));
    let file = |name: &str| yard.read(&format!("drive/{name}"));
    let about: serde_json::Value = serde_json::from_slice(&file("rig.json")).unwrap();
    let frames = |sensor: usize| about["sensors"][sensor]["frames"].as_array().unwrap().clone();
    assert_eq!((frames(0).len(), frames(1).len()), (2, 2));
    let number = |value: &serde_json::Value| value.as_f64().unwrap();
    assert!((number(&frames(0)[1]["time"]) - 0.15).abs() < 1e-12);
    // 10 m/s from frame to frame.
    let at = |frame: &serde_json::Value| {
        DVec3::from_array([0, 1, 2].map(|k| number(&frame["world_from_sensor"][k][3])))
    };
    assert!((at(&frames(0)[1]).distance(at(&frames(0)[0])) - 1.0).abs() < 1e-6);
    let all = [
        "front/000000.png",
        "front/000001.png",
        "front/000001.depth.npy",
        "top/000000.bin",
        "top/000001.bin",
        "dvs/000000.npy",
        "dvs/000001.npy",
    ];
    let made = all.map(file);
    assert!(made[3].len() > 16 * 1000 && made[3] != made[4]);
    // 13 bytes an event, which a car at 10 m/s has at every edge.
    assert!(made[5].len() > 13 * 100 && made[5] != made[6], "{}", made[5].len());
    // What is missing is made again, with the same bytes.
    for gone in [1, 4, 6] {
        std::fs::remove_file(yard.path("drive").join(all[gone])).unwrap();
    }
    assert!(drive(rig, "").status.success());
    assert!(made == all.map(file));
    for (rig, options, says) in [
        (rig.replace("top", "front"), "", "rig.toml, line 8: there are two sensors \"front\""),
        (rig.replace("rate = 10", "rate = 0"), "", "rate is 0"),
        (
            rig.replace("pictures = 2", "threshold = 0"),
            "",
            "sensor \"dvs\": threshold is 0: it must be 0.01 to 10",
        ),
        (
            rig.replace("pictures = 2", "iso = 100"),
            "",
            "rig.toml, line 19: sensor \"dvs\": iso is not for kind events",
        ),
        (rig.to_owned(), "--iso 100", "leave out --iso"),
        (rig.to_owned(), "--set lens.rate=10", "sensor \"front\": drops on the lens"),
        (rig.to_owned(), "--time 1", "holds files of another run"),
    ] {
        let output = drive(&rig, options);
        let said = said(&output);
        assert!(!output.status.success() && said.contains(says), "{said}, not {says}");
    }
}
