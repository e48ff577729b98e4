//! `evaluate --pictures` and `--paper` by running them: on embeddings that are made up, and with
//! `nets` on pictures by a small random network; and what they say to bad input.

use crate::common::Workshop;
#[cfg(feature = "nets")]
use crate::process::said;
use serde_json::Value;
use std::fs;
use std::path::Path;
#[cfg(feature = "nets")]
use std::path::PathBuf;
use wm_base::npy;
use wm_base::random::uniform;
use wm_train::metrics::{Collection, Embeddings};

/// Numbers of an embedding.
const EMBEDDING_WIDTH: usize = 16;

/// A folder to work in, whose commands are `evaluate`.
fn desk() -> Workshop {
    Workshop::with("evaluate", &["warning: "]).with_own_weights()
}

/// Writes unit rows about a direction that `shift` turns.
fn embeddings(desk: &Workshop, name: &str, count: usize, shift: f64) -> Embeddings {
    let mut values = Vec::new();
    let seed = name.bytes().map(u64::from).sum();
    for row in 0..count {
        let number = |index: usize| {
            let noise = uniform(seed, (row * EMBEDDING_WIDTH + index) as u64) - 0.5;
            if index.is_multiple_of(2) { 1.0 + noise } else { shift + noise }
        };
        let row: Vec<f64> = (0..EMBEDDING_WIDTH).map(number).collect();
        let length = row.iter().map(|v| v * v).sum::<f64>().sqrt();
        values.extend(row.iter().map(|v| (v / length) as f32));
    }
    npy::write(&desk.put(name, ""), &values, &[count, EMBEDDING_WIDTH]).unwrap();
    Embeddings::new(values, EMBEDDING_WIDTH).unwrap()
}

fn cmmd(x: &Embeddings, y: &Embeddings) -> f64 {
    Collection::new(x.clone()).cmmd(&Collection::new(y.clone())).value
}

/// The number of a row of the JSON file.
fn found(json: &Value, method: &str, weather: Option<&str>, scene: Option<&str>) -> f64 {
    let is_it = |row: &&Value| {
        row["method"] == method && row["weather"].as_str() == weather && row["scene"].as_str() == scene
    };
    let row = json["cmmd"].as_array().unwrap().iter().find(is_it);
    row.unwrap_or_else(|| panic!("no {method} {weather:?} {scene:?} in {json}"))["cmmd"].as_f64().unwrap()
}

#[test]
fn embeddings_are_compared_and_all_outputs_agree() {
    let desk = desk();
    let (near, far) = (embeddings(&desk, "near.npy", 30, 0.1), embeddings(&desk, "far.npy", 40, 0.5));
    let real = embeddings(&desk, "photos.npy", 50, 0.0);
    let (text, beside, json) =
        desk.run_with_json("--pictures near.npy far.npy --real photos.npy --csv out.csv --markdown out.md");
    assert_eq!(beside, "");
    for (name, embeddings) in [("near", &near), ("far", &far)] {
        let value = found(&json, name, None, None);
        assert!((value - cmmd(embeddings, &real)).abs() < 1e-12, "{name} {value}");
        let line = text.lines().find(|line| line.starts_with(&format!("| {name} "))).unwrap();
        assert!(line.contains(&format!(" {value:.4} ")) && line.ends_with("| 50          |"), "{line}");
        let csv = fs::read_to_string(desk.path("out.csv")).unwrap();
        assert!(csv.contains(&format!("\ncmmd,measured,{name},,,{value},")), "{csv}");
    }
    assert!(found(&json, "far", None, None) > 10.0 * found(&json, "near", None, None), "{json}");
    assert_eq!(fs::read_to_string(desk.path("out.md")).unwrap(), text);
    // The paper is not spoken of.
    assert!(!text.contains("paper") && json.get("paper").is_none(), "{text}");
    // On one thread the same bytes.
    let before = desk.read("out.json");
    desk.run_with_json("--pictures near.npy far.npy --real photos.npy --threads 1");
    assert_eq!(desk.read("out.json"), before);
}

#[test]
fn the_papers_tables_are_made_of_folders() {
    let desk = desk();
    let real = ["fog", "rain"].map(|weather| embeddings(&desk, &format!("real/{weather}.npy"), 40, 0.0));
    let fog = embeddings(&desk, "ours/fog.npy", 30, 0.2);
    let rain =
        ["garden", "v1.5 stump"].map(|scene| embeddings(&desk, &format!("ours/rain/{scene}.npy"), 20, 0.3));
    let haze = embeddings(&desk, "other/Haze/garden.npy", 25, 0.4);
    let mut lying = embeddings(&desk, "other/snow-cover/garden.npy", 12, 0.6);
    lying.extend(&embeddings(&desk, "other/snowfall/garden.npy", 11, 0.4));
    let snow = embeddings(&desk, "real/snow.npy", 40, 0.0);
    // What was stopped is no scene.
    embeddings(&desk, "other/Haze/street.unfinished.npy", 3, 0.4);
    desk.put("ours/notes.txt", "nothing");
    desk.put(
        "uvq.csv",
        "method,weather,scene,uvq_1_0,uvq_1_5\nours,fog,garden,4.25,3.5\nours,fog,SJTU-main-gate,4.5,\n",
    );
    let (text, beside, json) =
        desk.run_with_json("--paper ours other --real real --uvq uvq.csv --csv out.csv");
    assert_eq!(beside, "");
    let mut both = rain[0].clone();
    both.extend(&rain[1]);
    for (method, weather, scene, expected) in [
        ("ours", "fog", None, cmmd(&fog, &real[0])),
        ("ours", "rain", None, cmmd(&both, &real[1])),
        ("ours", "rain", Some("garden"), cmmd(&rain[0], &real[1])),
        ("ours", "rain", Some("v1.5 stump"), cmmd(&rain[1], &real[1])),
        ("other", "fog", None, cmmd(&haze, &real[0])),
        ("other", "fog", Some("garden"), cmmd(&haze, &real[0])),
        ("other", "snow", None, cmmd(&lying, &snow)),
        ("other", "snow", Some("garden"), cmmd(&lying, &snow)),
    ] {
        let value = found(&json, method, Some(weather), scene);
        assert!((value - expected).abs() < 1e-12, "{method} {weather} {scene:?}: {value} for {expected}");
    }
    assert_eq!(json["cmmd"].as_array().unwrap().len(), 8);
    let (fog, rain) = (found(&json, "ours", Some("fog"), None), found(&json, "ours", Some("rain"), None));
    let words = |line: &str| line.split('|').map(|cell| cell.trim().to_owned()).collect::<Vec<_>>();
    let rows: Vec<Vec<String>> = text.lines().map(words).collect();
    for row in [
        ["", "Weather-Magician", "1.40", "2.79", "3.30", "paper", ""],
        ["", "DID-MDN", "-", "3.14", "-", "paper", ""],
        ["", "ours", &format!("{fog:.2}"), &format!("{rain:.2}"), "-", "measured", ""],
        ["", "Garden", "3.75", "4.10", "4.17", "3.87", "4.25"],
        ["", "SJTU main gate", "3.45", "4.14", "3.37", "3.96", "4.50"],
    ] {
        assert!(rows.iter().any(|found| found.starts_with(&row.map(str::to_owned))), "{row:?} in\n{text}");
    }
    assert_eq!(json["paper"]["cmmd"].as_array().unwrap().len(), 10);
    assert_eq!(json["uvq"][0]["uvq_1_5"], 3.5);
    // UVQ alone.
    let (text, _, json) = desk.run_with_json("--paper --uvq uvq.csv");
    assert!(text.starts_with("UVQ 1.0") && json["cmmd"].as_array().unwrap().is_empty(), "{text}");
}

#[test]
fn embeddings_that_are_refused() {
    let desk = desk();
    embeddings(&desk, "real.npy", 9, 0.0);
    embeddings(&desk, "one.npy", 1, 0.0);
    npy::write(&desk.path("long.npy"), &[1.0; 2 * EMBEDDING_WIDTH], &[2, EMBEDDING_WIDTH]).unwrap();
    npy::write(&desk.path("flat.npy"), &[0.25; EMBEDDING_WIDTH], &[EMBEDDING_WIDTH]).unwrap();
    npy::write(&desk.path("wide.npy"), &[0.5; 8], &[2, 4]).unwrap();
    npy::write(
        &desk.path("nan.npy"),
        &[[0.25; EMBEDDING_WIDTH], [f32::NAN; EMBEDDING_WIDTH]].concat(),
        &[2, EMBEDDING_WIDTH],
    )
    .unwrap();
    let bytes = desk.read("real.npy");
    desk.put("cut.npy", &bytes[..bytes.len() - 3]);
    desk.put("empty/readme.txt", "no picture");
    desk.put("some.txt", "");
    for (pictures, says) in [
        ("one.npy", &["one.npy: has 1 picture, and CMMD compares collections; give at least two"][..]),
        ("long.npy", &["long.npy: row 0 has length 4.000, and CMMD takes embeddings of length 1; divide"]),
        ("flat.npy", &["flat.npy: an array of shape [16], not [pictures, numbers a picture]"]),
        (
            "wide.npy",
            &[
                "real.npy: its embeddings have 16 numbers, those of wide.npy 4; take embeddings of one network",
            ],
        ),
        ("nan.npy", &["nan.npy: row 1 holds NaN or infinite numbers; embed its picture again"]),
        ("cut.npy", &["cut.npy: ", "save it again with numpy.save as float32"]),
        ("no.npy", &["no.npy: no such file or folder"]),
        ("some.txt", &["some.txt: is a single file; give a folder of pictures"]),
        ("empty", &["empty: there is no picture (JPEG or PNG) in it among 1 files; name another folder"]),
        ("real.npy real.npy --embeddings kept", &["real.npy and real.npy have one name, and --embeddings"]),
    ] {
        desk.refused(&format!("--pictures {pictures} --real real.npy --json out.json"), says);
    }
    desk.refused(
        "--pictures real.npy --real real.npy --json no/out.json",
        &["no/out.json: cannot be written"],
    );
}

#[test]
fn folders_and_scores_that_are_refused() {
    let desk = desk();
    embeddings(&desk, "real/fog.npy", 9, 0.0);
    embeddings(&desk, "ours/fog.npy", 9, 0.1);
    embeddings(&desk, "ours/snow.npy", 9, 0.1);
    embeddings(&desk, "more/ours/fog.npy", 9, 0.1);
    embeddings(&desk, "hail/hail.npy", 9, 0.1);
    desk.put("hollow/fog/readme.txt", "");
    desk.put("bad.csv", "method,weather,scene,uvq_1_0\nours,fog,garden,4.0\nours,fog,stump,7\n");
    desk.put("bad.json", "{");
    desk.put("empty.csv", "method,weather,scene,uvq_1_0\n");
    for (options, says) in [
        ("--paper ours", &["--paper: there is nothing to compare with; give --real FOLDER"][..]),
        ("--paper --real real", &["--paper: no folder of a method is named"]),
        (
            "--paper ours --real real",
            &["real: there are no photographs of snow to compare ours's pictures with"],
        ),
        ("--paper hail --real real", &["hail: there is no folder fog, rain or snow in it"]),
        ("--paper no --real real", &["no: cannot be read"]),
        ("--paper hollow --real real", &["hollow/fog: there is no picture"]),
        ("--paper ours more/ours --real real", &["more/ours: the name ours is taken"]),
        ("--paper --uvq bad.csv", &["bad.csv, line 3: uvq_1_0 7 is not from 1 to 5"]),
        ("--paper --uvq bad.json", &["bad.json: EOF while parsing"]),
        ("--paper --uvq empty.csv", &["empty.csv: there is no score in it"]),
        ("--paper --uvq no.csv", &["no.csv: cannot be read"]),
        ("scene.ply --dataset set --paper ours --real real", &["cannot be used with"]),
        ("--paper ours --real real --eval-every 8", &["--eval-every", "cannot be used with"]),
        ("--paper ours --real real --up 0,1,0", &["--up", "cannot be used with"]),
        ("--pictures ours/fog.npy", &["--real"]),
        ("--uvq bad.csv", &["--paper"]),
        ("scene.ply --dataset set --real real", &["--real goes with --pictures or --paper"]),
        ("scene.ply", &["--dataset"]),
        ("--dataset set", &["<SCENE>"]),
    ] {
        desk.refused(options, says);
    }
}

#[cfg(not(feature = "nets"))]
#[test]
fn a_build_without_networks_says_so() {
    let desk = desk();
    let picture = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../crates/wm-nets/fixtures/clip/wide.png");
    for name in ["a.png", "b.png"] {
        desk.put(format!("frames/{name}"), fs::read(&picture).unwrap());
    }
    embeddings(&desk, "real.npy", 9, 0.0);
    desk.refused(
        "--pictures frames --real real.npy",
        &["frames: this build has no neural networks", "`--features nets`", "NPY"],
    );
}

#[cfg(feature = "nets")]
mod network {
    use super::*;
    use std::fs::{File, FileTimes};
    use wm_image::photo::read_photo;
    use wm_nets::Clip;

    fn fixtures(name: &str) -> PathBuf {
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../crates/wm-nets/fixtures").join(name)
    }

    fn weights() -> PathBuf {
        fixtures("clip/model.safetensors")
    }

    /// The network is a small one.
    const REMARK: &str = "model.safetensors: is not CLIP ViT-L/14 at 336 px, which CMMD is defined by";

    /// Copies fixtures to names.
    fn put_all(desk: &Workshop, pictures: &[(&str, &str)]) {
        for (name, file) in pictures {
            desk.put(name, fs::read(fixtures(file)).unwrap());
        }
    }

    /// Pictures of three sizes in two folders.
    fn put_pictures(desk: &Workshop) {
        let pictures = [
            ("frames/1.png", "depth_anything/wide.png"),
            ("frames/2.png", "depth_anything/tall.png"),
            ("frames/below/3.png", "clip/wide.png"),
            ("photos/a.png", "clip/tall.png"),
            ("photos/b.png", "depth_anything/wide.png"),
        ];
        put_all(desk, &pictures);
    }

    fn with_weights(options: &str) -> String {
        format!("{options} --weights {}", weights().display())
    }

    fn embedded(clip: &Clip, files: &[PathBuf]) -> Embeddings {
        let row = |file: &PathBuf| {
            let photo = read_photo(file, &|_, _| Ok(())).unwrap();
            clip.embed(&photo.rgb, photo.width as usize).unwrap()
        };
        Embeddings::new(files.iter().flat_map(row).collect(), clip.width()).unwrap()
    }

    #[test]
    fn pictures_are_embedded_kept_and_not_embedded_twice() {
        let desk = desk();
        put_pictures(&desk);
        let clip = Clip::read(&[weights()]).unwrap();
        let files = |names: &[&str]| names.iter().map(|name| desk.path(name)).collect::<Vec<_>>();
        let frames = embedded(&clip, &files(&["frames/1.png", "frames/2.png", "frames/below/3.png"]));
        let photos = embedded(&clip, &files(&["photos/a.png", "photos/b.png"]));
        let options = with_weights("--pictures frames --real photos --embeddings kept");
        let (_, beside, json) = desk.run_with_json(&options);
        assert!(beside.contains(REMARK), "{beside}");
        let value = found(&json, "frames", None, None);
        assert!((value - cmmd(&frames, &photos)).abs() < 1e-12, "{value}");
        assert_eq!(Embeddings::read(&desk.path("kept/frames.npy")).unwrap(), frames);
        // What is kept can be given in place of the pictures, without weights.
        let (_, beside, json) = desk.run_with_json("--pictures kept/frames.npy --real kept/photos.npy");
        assert_eq!((beside.as_str(), found(&json, "frames", None, None)), ("", value));

        // A picture that was spoilt without a trace is not looked at again; one that has another
        // time is.
        let spoilt = desk.path("frames/1.png");
        let (bytes, time) = (fs::read(&spoilt).unwrap(), fs::metadata(&spoilt).unwrap().modified().unwrap());
        let mut bad = bytes.clone();
        bad[200..].fill(0);
        fs::write(&spoilt, &bad).unwrap();
        let set = |time| {
            File::options().write(true).open(&spoilt).unwrap().set_times(FileTimes::new().set_modified(time))
        };
        set(time).unwrap();
        let (_, _, json) = desk.run_with_json(&options);
        assert_eq!(found(&json, "frames", None, None), value);
        set(time + std::time::Duration::from_secs(1)).unwrap();
        let says = ["frames/1.png: the photo is damaged", "--skip-bad"];
        crate::process::fails(&mut desk.command(&options), &says, &["warning: "]);
        // What is left of them is kept for the next time, and left out where that is wished.
        let (_, beside, json) = desk.run_with_json(&format!("{options} --skip-bad"));
        assert!(beside.contains(says[0]) && beside.contains("it is left out"), "{beside}");
        let rest = embedded(&clip, &files(&["frames/2.png", "frames/below/3.png"]));
        assert!((found(&json, "frames", None, None) - cmmd(&rest, &photos)).abs() < 1e-12);
        assert_eq!(Embeddings::read(&desk.path("kept/frames.npy")).unwrap(), rest);
        assert!(!desk.path("kept/frames.unfinished.npy").exists());

        // Files that do not fit each other are made anew.
        fs::write(&spoilt, &bytes).unwrap();
        fs::copy(desk.path("kept/photos.npy"), desk.path("kept/frames.npy")).unwrap();
        let (_, _, json) = desk.run_with_json(&options);
        assert_eq!(found(&json, "frames", None, None), value);
    }

    #[test]
    fn the_papers_folders_may_hold_pictures() {
        let desk = desk();
        let pictures = [
            ("ours/fog/garden/1.png", "depth_anything/wide.png"),
            ("ours/fog/garden/2.png", "clip/wide.png"),
            ("ours/fog/0001.png", "depth_anything/tall.png"),
            ("ours/fog/0002.png", "clip/tall.png"),
            ("photos/fog/a.png", "depth_anything/tall.png"),
            ("photos/fog/b.png", "depth_anything/wide.png"),
        ];
        put_all(&desk, &pictures);
        let (_, _, json) = desk.run_with_json(&with_weights("--paper ours --real photos --embeddings kept"));
        let whole = found(&json, "ours", Some("fog"), None);
        let garden = found(&json, "ours", Some("fog"), Some("garden"));
        assert!(whole != garden && json["cmmd"][0]["pictures"] == 4, "{json}");
        // The folder of embeddings is laid out as that of the pictures.
        let (_, _, again) = desk.run_with_json("--paper kept/ours --real kept/real");
        assert_eq!(again["cmmd"], json["cmmd"]);
    }

    #[test]
    fn pictures_that_are_refused() {
        let desk = desk();
        put_pictures(&desk);
        desk.put("one/1.png", fs::read(fixtures("clip/wide.png")).unwrap());
        for (name, content) in [("text/1.png", "no picture"), ("text/2.png", ""), ("text/3.jpg", "\u{89}PNG")]
        {
            desk.put(name, content);
        }
        let cut = fs::read(fixtures("clip/wide.png")).unwrap();
        desk.put("cut/1.png", &cut[..cut.len() / 2]);
        desk.put("cut/2.png", &cut);
        embeddings(&desk, "real.npy", 9, 0.0);
        for (options, says) in [
            ("--pictures one --real photos", &["one: has 1 picture, and CMMD compares collections"][..]),
            ("--pictures text --real photos", &["text/1.png: ", "(--skip-bad continues without it)"]),
            ("--pictures text --real photos --skip-bad", &["text: has 0 pictures, and CMMD compares"]),
            ("--pictures cut --real photos", &["cut/1.png: the photo is damaged", "--skip-bad"]),
            ("--pictures cut --real photos --skip-bad", &["cut: has 1 picture, and CMMD"]),
            (
                "--pictures frames --real real.npy",
                &["real.npy: its embeddings have 16 numbers, those of the network 48"],
            ),
        ] {
            desk.refused(&with_weights(options), says);
        }
        let others = fixtures("depth_anything/v2/model.safetensors");
        for (options, says) in [
            ("--weights no.safetensors", &["no.safetensors: cannot be read"][..]),
            (
                &format!("--weights {}", others.display()),
                &["no tensors of CLIP's vision_model; give the weights of openai/"],
            ),
            (
                "--offline",
                &["clip-vit-large-patch14-336.bin: is not there", "--offline", "huggingface.co", "--weights"],
            ),
        ] {
            desk.refused(&format!("--pictures frames --real photos {options}"), says);
        }
    }

    #[cfg(unix)]
    #[test]
    fn work_that_is_stopped_goes_on() {
        let desk = desk();
        put_pictures(&desk);
        // Seconds of work.
        let picture = fs::read(fixtures("clip/tall.png")).unwrap();
        for index in 0..1500 {
            desk.put(format!("many/{index}.png"), &picture);
        }
        let options = with_weights("--pictures photos many --real photos2 --embeddings kept --threads 1");
        for name in ["a.png", "b.png"] {
            desk.put(format!("photos2/{name}"), desk.read(&format!("photos/{name}")));
        }
        let child = crate::process::begin(&mut desk.command(&options));
        // The first collection is finished when the second one is begun.
        while !desk.path("kept/photos.json").is_file() {
            std::thread::sleep(std::time::Duration::from_millis(1));
        }
        std::thread::sleep(std::time::Duration::from_millis(300));
        assert!(crate::process::signal(&child, "-INT"));
        let output = crate::process::wait(child, "stopped");
        let line = said(&output);
        assert_eq!(output.status.code(), Some(130), "{line}");
        assert!(
            line.contains("of 1500 pictures of many are kept in kept/many.unfinished.npy; run it again"),
            "{line}"
        );
        let (values, shape) = npy::read(&desk.path("kept/many.unfinished.npy")).unwrap();
        assert!(shape[0] > 0 && shape[0] < 1500 && values.iter().all(|v| v.is_finite()), "{shape:?}");
        desk.run_with_json(&options);
        assert_eq!(Embeddings::read(&desk.path("kept/many.npy")).unwrap().count(), 1500);
        assert!(
            !desk.path("kept/many.unfinished.npy").exists()
                && !desk.path("kept/many.unfinished.json").exists()
        );
    }
}
