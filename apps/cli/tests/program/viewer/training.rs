//! `reconstruct --view`.

use crate::common::Workshop;
use crate::viewer::client::{Viewer, until};
use serde_json::{Value, json};

#[test]
fn a_training_is_shown_while_it_runs() {
    let workshop = Workshop::new();
    workshop.run("demo --photos photos --count=6 --size=120x80 --truth=omit");
    let command = workshop.command(
        "reconstruct photos --view --port=0 --steps=100000 --priors=none --device=cpu --eval-every=3 \
         --max-splats=2000 --out place.ply",
    );
    let viewer = Viewer::run(command);
    let told = || -> Value { serde_json::from_slice(&viewer.get("/training").1).unwrap() };
    // Somebody looks, so a picture is drawn; its PSNR is that of the photo.
    until("a picture is there", || told()["shown"].as_array().is_some_and(|shown| !shown.is_empty()));
    let (status, jpeg) = viewer.get("/training/picture");
    assert!(status == 200 && jpeg.starts_with(&[0xff, 0xd8, 0xff]));
    until("there are losses", || told()["loss"].as_array().is_some_and(|loss| loss.len() > 1));
    let now = told();
    assert!(now["steps"] == 100_000 && now["splats"].as_u64().unwrap() > 10 && now["end"].is_null(), "{now}");
    assert!(now["shown"][0][1].as_f64().is_some_and(|psnr| psnr > 3.0), "{now}");
    assert_eq!(viewer.ask("PUT", "/training/camera", &[], json!("orbit").to_string().as_bytes()).0, 200);
    assert_eq!(viewer.ask("PUT", "/training/camera", &[], b"\"upside\"").0, 400);
    until("the camera swings", || told()["picture"].as_u64() > now["picture"].as_u64());
    assert_eq!(told()["camera"], "orbit");
    // The same door as that of the viewer.
    assert_eq!(viewer.ask("GET", "/training", &[("Host", "evil.example")], b"").0, 403);
    assert_eq!(viewer.socket(&[]).err(), Some(404));
    assert!(String::from_utf8(viewer.get("/").1).unwrap().contains("training.js"));
}
