//! The files that a training writes.

use super::*;
use crate::common::{BYTE_STEP, psnr, read_png};
use serde_json::Value;

#[test]
fn a_scene_that_knows_its_place() {
    let place = place();
    // As many splats as make a ground.
    let output = place.trained(&["--eval-every", "3", "--max-splats", "2000"]);
    let printed = printed(&output);
    for (name, count) in
        [("held-out 00000.png: ", 1), ("held-out 00003.png: ", 1), ("held-out mean of 2: ", 1)]
    {
        assert_eq!(printed.matches(name).count(), count, "{printed}");
    }
    assert!(printed.lines().last().unwrap().starts_with("scene.ply: "), "{printed}");

    let report = place.inspected("scene.ply");
    assert_eq!(report["views"], 6);
    assert!(report["health"]["splats"].as_u64().unwrap() >= 250, "{report}");
    let metadata = &report["metadata"];
    assert!(metadata["provenance"].as_str().unwrap().ends_with(", 4 photos, 40 steps"), "{metadata}");
    assert_eq!(report["survey"]["up"]["source"], report["survey"]["ground"]["source"]);
    // The place stands upright, z up, if roughly after so few steps.
    let up: Vec<f64> = metadata["up"].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect();
    assert!(up[2] > 0.9, "{up:?}");
    assert!(metadata["ground"].is_number(), "{metadata}");
    assert!(place.path("scene.ply.cameras.json").is_file());

    let run = listing(&place.path("scene.ply.run"));
    let (believed, run): (Vec<_>, Vec<_>) =
        run.into_keys().partition(|path| path.components().any(|part| part.as_os_str() == "priors"));
    assert!(believed.iter().any(|path| path.ends_with("priors/priors.json")), "{believed:?}");
    let names: Vec<String> = run.iter().map(|p| p.file_name().unwrap().to_string_lossy().into()).collect();
    let previews = names.iter().filter(|name| name.starts_with("preview-") && name.ends_with(".png")).count();
    assert_eq!((previews, names.len()), (10, 13), "{names:?}");
    for name in ["config.json", "metrics.jsonl", "checkpoint.wmtrain", "preview-000040.png"] {
        assert!(names.iter().any(|n| n == name), "{names:?}");
    }
    assert_eq!(place.metrics("scene.ply.run").iter().filter(|(_, held_out)| *held_out).count(), 10);
}

#[cfg(feature = "h264")]
#[test]
fn a_flight_along_its_photos() {
    let place = place();
    place.trained(&["--steps", "5"]);
    let words =
        ["render", "scene.ply", "--path", "capture", "--seconds", "0.2", "--fps", "10", "--size", "64x48"];
    succeeds(&mut place.program([&words[..], &["--out", "x.mp4", "--threads", "1"]].concat()));
    assert!(place.read("x.mp4").windows(4).any(|window| window == b"ftyp"));
}

#[test]
fn what_is_known_may_be_given() {
    let place = place();
    place.trained(&["--steps", "5", "--metres-per-unit", "2.5", "--up", "0,0,1"]);
    let report = place.inspected("scene.ply");
    assert_eq!(report["metadata"]["metres_per_unit"], 2.5);
    assert_eq!(report["metadata"]["up"], serde_json::json!([0.0, 0.0, 1.0]));
}

/// Photos from eye level give the scale by the height at which cameras are held; from above they do
/// not.
#[test]
fn a_walk_tells_how_large_its_place_is() {
    let walk = DatasetOptions { route: CameraRoute::Walk, count: 8, points: 1500, ..PHOTOS };
    let place = place_with(&walk);
    let output = place.trained(&["--steps", "2"]);
    let from = "from the camera height of 1.6 m above the ground";
    let line = said(&output);
    let line = line.lines().find(|line| line.starts_with("scale: ")).unwrap();
    assert!(line.ends_with(from) && !said(&output).contains("warning"), "{}", said(&output));
    let report = place.inspected("scene.ply");
    let scale = report["metadata"]["metres_per_unit"].as_f64().unwrap();
    assert!(
        (scale - 1.0).abs() < 0.1 && line.starts_with(&format!("scale: {scale:.4} m per unit, ")),
        "{line}"
    );
    assert_eq!(format!("from {}", report["metadata"]["scale_source"].as_str().unwrap()), from);
    assert_eq!(report["survey"]["scale_source"], report["metadata"]["scale_source"]);
    assert!(report["metadata"]["ground"].as_f64().unwrap().abs() < 0.2, "{report}");

    // The cameras were 1.6 m up: told otherwise, all is larger. A scale that is given wins.
    place.trained(&["--steps", "2", "--camera-height", "3.2", "--overwrite"]);
    let report = place.inspected("scene.ply");
    let larger = report["metadata"]["metres_per_unit"].as_f64().unwrap();
    assert!((larger / scale - 2.0).abs() < 1e-9, "{larger}");
    assert_eq!(report["metadata"]["scale_source"], "the camera height of 3.2 m above the ground");
    place.trained(&["--steps", "2", "--camera-height", "3.2", "--metres-per-unit", "7", "--overwrite"]);
    let report = place.inspected("scene.ply");
    assert_eq!(report["metadata"]["metres_per_unit"], 7.0);
    assert!(report["metadata"]["scale_source"].is_null(), "{report}");

    let place = place_with(&DatasetOptions { points: 1500, ..PHOTOS });
    let said = said(&place.trained(&["--steps", "2"]));
    for says in
        ["the photos were not taken level: their middle looks down 30 degrees", "warning: scale is not known"]
    {
        assert!(said.contains(says), "{said}");
    }
    assert!(place.inspected("scene.ply")["metadata"]["metres_per_unit"].is_null());
}

/// More is learnt of photos that were never seen than their colour: of a picture of one colour the
/// error is the variance of the photo.
#[test]
fn photos_that_were_held_out_are_met_ever_better() {
    let place = place_with(&DatasetOptions { count: 24, points: 1500, ..PHOTOS });
    let more = ["--steps", "240", "--max-splats", "3000", "--eval-every", "8", "--eval-from", "3"];
    place.trained(&[&more[..], &["--resolution", "full", "--threads", "2"]].concat());
    let text = String::from_utf8(place.read("scene.ply.run/metrics.jsonl")).unwrap();
    let lines = text.lines().map(|line| serde_json::from_str::<Value>(line).unwrap());
    let psnr: Vec<f64> = lines.filter_map(|line| line["held_out"]["psnr"].as_f64()).collect();
    let flat: Vec<f64> =
        [3, 11, 19].map(|photo| flat_psnr(&place.path(format!("set/images/{photo:05}.png")))).into();
    let flat = flat.iter().sum::<f64>() / 3.0;
    let (first, last) = (psnr[0], psnr[psnr.len() - 1]);
    assert!(last > first + 1.0 && last > flat + 2.0, "{psnr:?}, of one colour {flat:.2}");
}

/// PSNR of a picture that has the mean colour of a photo everywhere, dB.
fn flat_psnr(path: &Path) -> f64 {
    let pixels = read_png(path).pixels.as_flattened().to_vec();
    let lanes = [0, 1, 2].map(|lane| pixels[lane..].iter().step_by(3).map(|v| BYTE_STEP * f64::from(*v)));
    let mean = lanes.map(|lane| lane.sum::<f64>() / (pixels.len() / 3) as f64);
    psnr(pixels.iter().enumerate().map(|(index, v)| BYTE_STEP * f64::from(*v) - mean[index % 3]))
}
