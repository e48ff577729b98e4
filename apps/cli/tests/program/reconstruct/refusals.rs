//! Data sets and options that make no training.

use super::*;

#[test]
fn data_sets_that_are_none() {
    let place = place();
    place.untrained("nowhere", &[], &["nowhere: "]);
    fs::create_dir(place.path("empty")).unwrap();
    place.untrained("empty", &[], &["empty: ", "at least 3 are needed"]);
    place.put("file.txt", "no data set");
    place.untrained("file.txt", &[], &["file.txt"]);
    // Photos alone, where there is no COLMAP.
    for name in ["0", "1", "2"] {
        place.put(format!("plain/{name}.png"), place.read("set/images/00000.png"));
    }
    let mut command = place.program(reconstruct("plain", &[]));
    command.env("PATH", place.path("empty")).env_remove("COLMAP");
    let says = ["neither COLMAP nor pycolmap is installed", "install one with `pip install pycolmap`"];
    place.refused_by(&mut command, &says);
    place.put("tiny/a.png", place.read("set/images/00000.png"));
    place.put("tiny/b.png", place.read("set/images/00001.png"));
    lies::png_of(&place.path("tiny/c.png"), (2, 2), 100);
    place.untrained("tiny", &[], &["tiny/c.png: 2x2 px is too small to find its camera"]);
    let mut command = place.program(reconstruct("plain", &[]));
    place.refused_by(command.env("COLMAP", "no/such"), &["no/such: cannot be started"]);
}

#[test]
fn models_that_are_too_little() {
    let place = place();
    let images = place.read("set/sparse/0/images.bin");
    place.put("set/sparse/0/images.bin", [0; 8]);
    place.untrained("set", &[], &["set/sparse/0/images.bin: no image is registered in the model"]);
    place.put("set/sparse/0/images.bin", &images[..images.len() / 2]);
    place.untrained("set", &[], &["set/sparse/0/images.bin: cut off"]);
    for (count, says) in [(1, "1 of the photos is registered"), (2, "2 of the photos are registered")] {
        place_with(&DatasetOptions { count, ..PHOTOS }).untrained("set", &[], &["set: ", says]);
    }
}

#[test]
fn a_model_without_points_is_enough() {
    let place = place_with(&DatasetOptions { points: 0, ..PHOTOS });
    let output = place.trained(&[]);
    assert!(said(&output).contains("warning: set: the model has no points"), "{}", said(&output));
    assert!(place.path("scene.ply").is_file());
}

#[test]
fn lenses_that_are_not_read() {
    let place = place_with(&DatasetOptions { storage: ColmapStorage::Text, ..PHOTOS });
    let cameras = String::from_utf8(place.read("set/sparse/0/cameras.txt")).unwrap();
    let line = cameras.lines().find(|line| line.contains("PINHOLE")).unwrap();
    let fisheye = format!("{} 0 0 0 0\n", line.replace("SIMPLE_", "").replace("PINHOLE", "OPENCV_FISHEYE"));
    place.put("set/sparse/0/cameras.txt", fisheye);
    place.untrained("set", &[], &["OPENCV_FISHEYE", "`colmap image_undistorter --image_path "]);
}

#[test]
fn outputs_that_cannot_be() {
    let place = place();
    place.untrained(
        "set",
        &["--out", "no/scene.ply"],
        &["no/scene.ply: ", "the folder \"no\" does not exist"],
    );
    place.untrained("set", &["--out", "scene.xyz"], &["scene.xyz"]);
    place.untrained("set", &["--out", "set"], &["set"]);
    place.put("file", "mine");
    for folder in ["file", "file/run"] {
        place.untrained("set", &["--run-folder", folder], &["cannot make the folder file"]);
    }
    fs::create_dir_all(place.path("scene.ply.run/config.json")).unwrap();
    place.untrained("set", &[], &["scene.ply.run/config.json: cannot be written: it is a folder"]);
}

#[test]
fn options_that_make_no_training() {
    let place = place();
    let cases: [(&[&str], &str); 11] = [
        (&["--steps", "0"], "--steps"),
        (&["--longest", "4"], "--longest"),
        (&["--cache", "0"], "--cache"),
        (&["--max-splats", "10"], "--max-splats"),
        (&["--eval-every", "1"], "set: 0 of 6 photos are left to learn from, at least 3 are needed"),
        (&["--checkpoint-every", "0"], "--checkpoint-every 0: must be a number of seconds above 0"),
        (&["--checkpoint-every", "nan"], "--checkpoint-every NaN: "),
        (&["--camera-height", "0"], "--camera-height is 0: it must be finite and above 0"),
        (&["--camera-height", "nan"], "--camera-height is NaN: it must be finite and above 0"),
        (&["--images", "photos"], "set/photos"),
        (&["--model", "sparse/7"], "sparse/7"),
    ];
    for (more, says) in cases {
        place.untrained("set", more, &[says]);
    }
    // What is left to learn from is the least that there may be.
    place.trained(&["--steps", "2", "--eval-every", "2", "--eval-from", "1"]);
}

#[test]
fn configurations_that_are_none() {
    let place = place();
    place.untrained("set", &["--config", "no.json"], &["no.json: cannot be read: "]);
    let config = restless("mcmc", 10);
    let text = serde_json::to_string_pretty(&config).unwrap();
    for (from, to, says) in [
        ("\"steps\": 10", "\"steps\": ten", "at line 2 column 13"),
        ("\"steps\": 10", "\"steps\": -3", "at line 2 column 13"),
        ("\"steps\": 10", "\"steps\": 0", "steps is 0; it must be 1 to 1000000"),
        ("\"steps\": 10", "\"stepts\": 10", "unknown field `stepts`"),
        ("\"sh_degree\": 1", "\"sh_degree\": 200", "sh_degree is 200; it must be 0 to 3"),
        ("\"strategy\": \"mcmc\"", "\"strategy\": \"other\"", "unknown variant `other`"),
        ("\"start_opacity\": 0.1", "\"start_opacity\": 1.0", "start_opacity is 1; "),
        ("\"l1\": 0.8", "\"l1\": 1e999", "line "),
    ] {
        assert!(text.contains(from), "{text}");
        place.put("a.json", text.replace(from, to));
        place.untrained("set", &["--config", "a.json"], &["a.json: ", says]);
    }
    place.put("a.json", &text[..text.len() / 2]);
    place.untrained("set", &["--config", "a.json"], &["a.json: is no configuration of a training: EOF"]);
}
