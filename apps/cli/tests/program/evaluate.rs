//! `evaluate` by running it on a small data set of the built-in street, with the street itself as
//! the scene: that its numbers are right, the same wherever they are written, and what it says to
//! bad input.

use crate::common::Workshop;
use crate::process::{fails, finish, said};
use serde_json::Value;
use std::fs;
use std::path::Path;
use std::sync::OnceLock;
use wm_base::npy;
use wm_scene::Splats;
use wm_street::Street;
use wm_street::dataset::{CameraRoute, DatasetOptions, GroundTruth};

const PHOTOS: DatasetOptions = DatasetOptions {
    route: CameraRoute::Walk,
    count: 3,
    size: (120, 80),
    points: 50,
    truth: GroundTruth::Write,
    ..DatasetOptions::TINY
};

/// The street and photos of it; tests read it and write elsewhere.
fn shared() -> &'static Workshop {
    static MADE: OnceLock<Workshop> = OnceLock::new();
    MADE.get_or_init(|| {
        let made = Workshop::new();
        let street = Street::builtin();
        made.photos("set", &PHOTOS);
        let sampling = street.sampling(0.2);
        let mut splats = Splats::with_capacity(sampling.len(), 0);
        (0..sampling.len()).filter_map(|index| sampling.splat(index)).for_each(|splat| splats.push(&splat));
        made.scene("street", splats, &street.metadata());
        made
    })
}

/// A folder to write into, and to keep maps in, whose commands evaluate the street.
fn desk() -> Workshop {
    let [scene, set] = ["street.ply", "set"].map(|name| shared().path(name).display().to_string());
    Workshop::with(format!("evaluate {scene} --dataset {set}"), &["warning: "])
}

/// Writes maps that `of` makes of the true depth.
fn maps(desk: &Workshop, folder: &str, photos: &[&str], of: impl Fn(Vec<f32>) -> (Vec<f32>, [usize; 2])) {
    fs::create_dir(desk.path(folder)).unwrap();
    for photo in photos {
        let (depth, _) = npy::read(&shared().path(format!("set/truth/depth/{photo}.npy"))).unwrap();
        let (values, shape) = of(depth);
        npy::write(&desk.path(format!("{folder}/{photo}.npy")), &values, &shape).unwrap();
    }
}

fn mean(json: &Value, key: &str) -> f64 {
    json["mean"][key].as_f64().unwrap_or_else(|| panic!("no {key} in {}", json["mean"]))
}

#[test]
fn the_street_is_near_to_itself_and_all_outputs_agree() {
    let desk = desk();
    let (text, _, json) = desk.run_with_json("--report page.html --report-photos 2");
    // Splats are soft and photos of 120 px coarse: a pixel at 50 m is half a metre.
    for (key, low, high) in [
        ("psnr", 15.0, 40.0),
        ("ssim", 0.4, 1.0),
        ("median_depth_abs_rel", 0.0, 0.12),
        ("median_depth_delta", 0.8, 1.0),
        ("median_depth_median_rel", 0.0, 0.06),
        ("depth_delta", 0.75, 1.0),
        ("normal_median", 0.0, 15.0),
        ("sky_covered", 0.0, 0.3),
        ("surface_lost", 0.0, 0.02),
    ] {
        let found = mean(&json, key);
        assert!((low..=high).contains(&found), "{key} {found}");
    }
    let share = json["floaters"]["share"].as_f64().unwrap();
    assert!(share > 0.0 && share < 0.02, "{share}");

    // The table says what the file says, line by line.
    let page = fs::read_to_string(desk.path("page.html")).unwrap();
    let photos = json["photos"].as_array().unwrap();
    assert_eq!(photos.len(), 3);
    let in_table: Vec<&str> = "psnr ssim sharpness depth_abs_rel depth_delta depth_median_rel \
        median_depth_abs_rel median_depth_delta median_depth_median_rel normal_mean normal_median \
        sky_covered surface_lost"
        .split_whitespace()
        .collect();
    let mean = (&Value::from("mean"), &json["mean"]);
    for (name, numbers) in photos.iter().map(|photo| (&photo["name"], photo)).chain([mean]) {
        let name = name.as_str().unwrap();
        let line = text.lines().find(|line| line.starts_with(name)).unwrap();
        let written: Vec<&str> = line.split_whitespace().skip(1).collect();
        assert_eq!(written.len(), in_table.len(), "{line}");
        for (key, written) in in_table.iter().zip(written) {
            let value = numbers[key].as_f64().unwrap();
            let expected = match *key {
                "psnr" | "normal_mean" | "normal_median" => format!("{value:.2}"),
                "depth_delta" | "median_depth_delta" | "sky_covered" | "surface_lost" => {
                    format!("{:.2}", 100.0 * value)
                }
                _ => format!("{value:.4}"),
            };
            assert_eq!(written, expected, "{name} {key}");
            assert!(page.contains(&format!("<td>{expected}</td>")), "{name} {key} {expected} in the page");
        }
    }
    assert!(text.contains("all 3 photos, including those that the scene was trained on"), "{text}");
    assert!(text.contains("Scale: 1 m a scene unit, from the scene's metadata; nothing is fitted"), "{text}");

    // Ten pictures of two photos, and nothing from anywhere else.
    assert_eq!(page.matches("<img src=\"data:image/").count(), 20);
    let policy = "<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; style-src 'unsafe-inline'; \
                  img-src data:\">";
    assert_eq!(page.matches(policy).count(), 1);
    let rest = page.replace(policy, "");
    assert!(!rest.contains("<script") && !rest.contains("http"), "the page is by itself");
    assert!(page.contains("prefers-color-scheme: dark") && page.ends_with("</html>\n"));
}

#[test]
fn threads_change_nothing() {
    let desk = desk();
    let on = |threads: u8| {
        let (text, _, json) = desk.run_with_json(&format!("--threads {threads} --report page.html"));
        (text, json, desk.read("page.html"))
    };
    assert!(on(1) == on(3));
}

#[test]
fn units_scale_the_truth() {
    let desk = desk();
    let error = |options: &str| mean(&desk.run_with_json(options).2, "median_depth_median_rel");
    let exact = error("");
    // Twice as far as it is: half of it is missing. Half as far: as much too much. Both: right.
    assert!((error("--depth-unit 2") - 0.5).abs() < 0.5 * exact + 0.01);
    assert!((error("--metres-per-unit 2") - 1.0).abs() < 2.0 * exact + 0.02);
    assert!((error("--metres-per-unit 2 --depth-unit 2") - exact).abs() < 1e-6);
    assert!((error("--metres-per-unit 2 --depth-unit units") - exact).abs() < 1e-6);
    let invert = |depth: Vec<f32>| (depth.iter().map(|z| 1.0 / z).collect(), [80, 120]);
    maps(&desk, "disparity", &["00000", "00001", "00002"], invert);
    assert!((error("--depth disparity --depth-kind disparity") - exact).abs() < 1e-6);
}

#[test]
fn maps_may_be_of_other_sizes_and_of_some_photos() {
    let desk = desk();
    maps(&desk, "half", &["00000", "00002"], |depth| {
        let pick = |index: usize| depth[2 * (index / 60) * 120 + 2 * (index % 60)];
        ((0..40 * 60).map(pick).collect(), [40, 60])
    });
    let (_, said, json) = desk.run_with_json("--depth half");
    assert!(said.contains("warning: half: no map of 00001.png; 2 of 3 photos have one"), "{said}");
    assert_eq!(json["truth"]["depth"]["missing"][0], "00001.png");
    assert!(
        json["photos"][1].get("depth_abs_rel").is_none() && json["photos"][1].get("normal_mean").is_some()
    );
    let error = mean(&json, "median_depth_median_rel");
    assert!(error < 0.08, "{error}");

    let (text, said, json) = desk.run_with_json("--eval-every 2 --exposure-fit affine --depth half");
    assert!(text.contains("2 of 3 photos, every 2 from 0") && said.is_empty(), "{text}{said}");
    assert!(mean(&json, "psnr") > 15.0);
    assert_eq!(json["exposure_fit"], "affine");
}

#[test]
fn bad_input_is_told_in_one_line() {
    let desk = desk();
    maps(&desk, "square", &["00000"], |depth| (depth[..6400].to_vec(), [80, 80]));
    for (options, says) in [
        ("--depth square", &["00000.npy: the map is 80x80 px, its photo 120x80; make the map of"][..]),
        ("--depth nowhere", &["--depth nowhere: there is no such folder"]),
        ("--eval-every 9 --eval-from 5", &["--eval-every 9 from 5 takes none of 3 photos"]),
        ("--json no/where.json", &["no/where.json: cannot be written", "does not exist"]),
    ] {
        desk.refused(options, says);
    }
    fs::create_dir(desk.path("empty")).unwrap();
    let says = ["empty: no photo that is compared has a map in it", "00000.npy", "--sky"];
    desk.refused("--sky empty", &says);
    let usage = said(&finish(&mut desk.command("--depth-unit furlong")));
    assert!(usage.contains("`furlong` is no unit of depth: m, cm, mm"), "{usage}");
    // A photo as depth: counts without a unit.
    desk.put("photo/00000.png", shared().read("set/images/00000.png"));
    desk.refused("--depth photo", &["00000.png: holds whole numbers", "give --depth-unit, such as mm"]);
    desk.refused("--depth photo --depth-unit mm", &["3 different channels, but one number per pixel"]);
    // Two maps of a photo, neither of which has its whole name.
    fs::remove_file(desk.path("photo/00000.png")).unwrap();
    for name in ["photo/00000.npy", "photo/00000.exr"] {
        desk.put(name, desk.read("square/00000.npy"));
    }
    desk.refused("--depth photo", &["00000.exr", "00000.npy"]);

    // A scene that lies elsewhere, and data sets that are none.
    let street = Street::builtin();
    let sampling = street.sampling(0.1);
    let mut away = Splats::with_capacity(1, 0);
    let splat = (0..).find_map(|index| sampling.splat(index)).unwrap();
    away.push(&wm_scene::splats::Splat { mean: [0.0, -9000.0, 0.0], ..splat });
    desk.scene("away", away, &street.metadata());
    let set = shared().path("set");
    let words = ["evaluate", "away.ply", "--json", "x.json", "-d"].map(Path::new);
    let mut elsewhere = desk.program(words.into_iter().chain([&*set]));
    desk.refused_by(&mut elsewhere, &["away.ply: no splat of it is seen by any camera of"]);
    let says = "empty: no COLMAP model, transforms.json, reconstruction.json (OpenSfM) or bundle.out here";
    fails(&mut desk.program(["evaluate", "away.ply", "-d", "empty"]), &[says], &[]);
}
