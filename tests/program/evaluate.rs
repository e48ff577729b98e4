//! `evaluate` by running it on a small data set of the built-in street, with the street itself as
//! the scene: that its numbers are right, the same wherever they are written, and what it says to
//! bad input.

use crate::process::{fails, finish, printed, refuses, said};
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::OnceLock;
use tempfile::TempDir;
use wm_base::npy;
use wm_capture::colmap::write::ColmapStorage;
use wm_scene::formats::write_scene;
use wm_scene::{Scene, Splats};
use wm_street::{
    Street,
    dataset::{self, CameraRoute, DatasetOptions, GroundTruth},
};

const PHOTOS: DatasetOptions = DatasetOptions {
    route: CameraRoute::Walk,
    count: 3,
    size: (120, 80),
    samples: 1,
    points: 50,
    storage: ColmapStorage::Binary,
    truth: GroundTruth::Write,
};

/// The street and photos of it; tests read it and write elsewhere.
fn shared() -> &'static Path {
    static MADE: OnceLock<TempDir> = OnceLock::new();
    let made = MADE.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let street = Street::builtin();
        dataset::write(&street, &folder.path().join("set"), &PHOTOS, &mut |_| true).unwrap();
        let sampling = street.sampling(0.2);
        let mut splats = Splats::with_capacity(sampling.len(), 0);
        (0..sampling.len()).filter_map(|index| sampling.splat(index)).for_each(|splat| splats.push(&splat));
        let scene = Scene { splats, metadata: street.metadata(), ..Scene::default() };
        write_scene(&folder.path().join("street.ply"), &scene).unwrap();
        folder
    });
    made.path()
}

/// A folder to write into, and to keep maps in.
struct Desk(TempDir);

impl Desk {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn at(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn command(&self, options: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_weather-magician"));
        command.arg("evaluate").arg(shared().join("street.ply")).arg("--dataset").arg(shared().join("set"));
        command.args(options).current_dir(self.0.path()).stdin(Stdio::null());
        command
    }

    /// Returns stdout, stderr and the JSON.
    fn run(&self, options: &[&str]) -> (String, String, Value) {
        let mut command = self.command(options);
        let output = finish(command.args(["--overwrite", "--json", "out.json"]));
        assert!(output.status.success(), "{}", said(&output));
        let json = serde_json::from_slice(&fs::read(self.at("out.json")).unwrap()).unwrap();
        (printed(&output), said(&output), json)
    }

    fn refused(&self, options: &[&str], says: &[&str]) {
        refuses(&mut self.command(options), self.0.path(), says, &["warning: "]);
    }

    /// Writes maps that `of` makes of the true depth.
    fn maps(&self, folder: &str, photos: &[&str], of: impl Fn(Vec<f32>) -> (Vec<f32>, [usize; 2])) {
        fs::create_dir(self.at(folder)).unwrap();
        for photo in photos {
            let name = format!("{photo}.npy");
            let (depth, _) = npy::read(&shared().join("set/truth/depth").join(&name)).unwrap();
            let (values, shape) = of(depth);
            npy::write(&self.at(folder).join(name), &values, &shape).unwrap();
        }
    }
}

fn mean(json: &Value, key: &str) -> f64 {
    json["mean"][key].as_f64().unwrap_or_else(|| panic!("no {key} in {}", json["mean"]))
}

#[test]
fn the_street_is_near_to_itself_and_all_outputs_agree() {
    let desk = Desk::new();
    let (text, _, json) = desk.run(&["--report", "page.html", "--report-photos", "2"]);
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
    let page = fs::read_to_string(desk.at("page.html")).unwrap();
    let photos = json["photos"].as_array().unwrap();
    assert_eq!(photos.len(), 3);
    let in_table = [
        "psnr",
        "ssim",
        "sharpness",
        "depth_abs_rel",
        "depth_delta",
        "depth_median_rel",
        "median_depth_abs_rel",
    ];
    let in_table =
        in_table.into_iter().chain(["median_depth_delta", "median_depth_median_rel", "normal_mean"]);
    let in_table: Vec<&str> = in_table.chain(["normal_median", "sky_covered", "surface_lost"]).collect();
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
    let desk = Desk::new();
    let run = |threads: &str| {
        let (text, _, json) = desk.run(&["--threads", threads, "--report", "page.html"]);
        (text, json, fs::read(desk.at("page.html")).unwrap())
    };
    assert!(run("1") == run("3"));
}

#[test]
fn units_scale_the_truth() {
    let desk = Desk::new();
    let error = |options: &[&str]| mean(&desk.run(options).2, "median_depth_median_rel");
    let exact = error(&[]);
    // Twice as far as it is: half of it is missing. Half as far: as much too much. Both: right.
    assert!((error(&["--depth-unit", "2"]) - 0.5).abs() < 0.5 * exact + 0.01);
    assert!((error(&["--metres-per-unit", "2"]) - 1.0).abs() < 2.0 * exact + 0.02);
    assert!((error(&["--metres-per-unit", "2", "--depth-unit", "2"]) - exact).abs() < 1e-6);
    assert!((error(&["--metres-per-unit", "2", "--depth-unit", "units"]) - exact).abs() < 1e-6);
    let invert = |depth: Vec<f32>| (depth.iter().map(|z| 1.0 / z).collect(), [80, 120]);
    desk.maps("disparity", &["00000", "00001", "00002"], invert);
    assert!((error(&["--depth", "disparity", "--depth-kind", "disparity"]) - exact).abs() < 1e-6);
}

#[test]
fn maps_may_be_of_other_sizes_and_of_some_photos() {
    let desk = Desk::new();
    desk.maps("half", &["00000", "00002"], |depth| {
        let pick = |index: usize| depth[2 * (index / 60) * 120 + 2 * (index % 60)];
        ((0..40 * 60).map(pick).collect(), [40, 60])
    });
    let (_, said, json) = desk.run(&["--depth", "half"]);
    assert!(said.contains("warning: half: no map of 00001.png; 2 of 3 photos have one"), "{said}");
    assert_eq!(json["truth"]["depth"]["missing"][0], "00001.png");
    assert!(
        json["photos"][1].get("depth_abs_rel").is_none() && json["photos"][1].get("normal_mean").is_some()
    );
    let error = mean(&json, "median_depth_median_rel");
    assert!(error < 0.08, "{error}");

    let (text, said, json) = desk.run(&["--eval-every", "2", "--exposure-fit", "affine", "--depth", "half"]);
    assert!(text.contains("2 of 3 photos, every 2 from 0") && said.is_empty(), "{text}{said}");
    assert!(mean(&json, "psnr") > 15.0);
    assert_eq!(json["exposure_fit"], "affine");
}

#[test]
fn bad_input_is_told_in_one_line() {
    let desk = Desk::new();
    desk.maps("square", &["00000"], |depth| (depth[..6400].to_vec(), [80, 80]));
    desk.refused(
        &["--depth", "square"],
        &["00000.npy: the map is 80x80 px, its photo 120x80; make the map of"],
    );
    desk.refused(&["--depth", "nowhere"], &["--depth nowhere: there is no such folder"]);
    fs::create_dir(desk.at("empty")).unwrap();
    desk.refused(
        &["--sky", "empty"],
        &["empty: no photo that is compared has a map in it", "00000.npy", "--sky"],
    );
    desk.refused(
        &["--eval-every", "9", "--eval-from", "5"],
        &["--eval-every 9 from 5 takes none of 3 photos"],
    );
    desk.refused(&["--json", "no/where.json"], &["no/where.json: cannot be written", "does not exist"]);
    let usage = finish(&mut desk.command(&["--depth-unit", "furlong"]));
    assert!(said(&usage).contains("`furlong` is no unit of depth: m, cm, mm"), "{}", said(&usage));
    // A photo as depth: counts without a unit.
    fs::create_dir(desk.at("photo")).unwrap();
    fs::copy(shared().join("set/images/00000.png"), desk.at("photo/00000.png")).unwrap();
    desk.refused(&["--depth", "photo"], &["00000.png: holds whole numbers", "give --depth-unit, such as mm"]);
    desk.refused(
        &["--depth", "photo", "--depth-unit", "mm"],
        &["3 different channels, but one number a pixel"],
    );
    // Two maps of a photo, neither of which has its whole name.
    fs::remove_file(desk.at("photo/00000.png")).unwrap();
    fs::copy(desk.at("square/00000.npy"), desk.at("photo/00000.npy")).unwrap();
    fs::copy(desk.at("square/00000.npy"), desk.at("photo/00000.exr")).unwrap();
    desk.refused(&["--depth", "photo"], &["00000.exr", "00000.npy"]);

    // A scene that lies elsewhere, and data sets that are none.
    let street = Street::builtin();
    let sampling = street.sampling(0.1);
    let mut away = Splats::with_capacity(1, 0);
    let splat = (0..).find_map(|index| sampling.splat(index)).unwrap();
    away.push(&wm_scene::splats::Splat { mean: [0.0, -9000.0, 0.0], ..splat });
    let scene = Scene { splats: away, metadata: street.metadata(), ..Scene::default() };
    write_scene(&desk.at("away.ply"), &scene).unwrap();
    let mut elsewhere = Command::new(env!("CARGO_BIN_EXE_weather-magician"));
    elsewhere.args(["evaluate", "away.ply", "--json", "x.json", "-d"]).arg(shared().join("set"));
    elsewhere.current_dir(desk.0.path());
    refuses(
        &mut elsewhere,
        desk.0.path(),
        &["away.ply: no splat of it is seen by any camera of"],
        &["warning: "],
    );
    let mut none = Command::new(env!("CARGO_BIN_EXE_weather-magician"));
    none.args(["evaluate", "away.ply", "-d", "empty"]).current_dir(desk.0.path());
    fails(
        &mut none,
        &["empty: no COLMAP model, transforms.json, reconstruction.json (OpenSfM) or bundle.out here"],
        &[],
    );
}
