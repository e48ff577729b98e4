//! Points of a lidar over the picture, and their files.

use crate::viewer::client::{Viewer, rendered, until};
use crate::viewer::page::{click, file_of, screenshots, slide, take_file};
use crate::viewer::socket::SocketEvent;
use crate::viewer::webdriver::Browser;
use crate::viewer::{yard_scene, yard_viewer};
use serde_json::{Value, json};

/// A lidar that stands in the yard.
fn standing() -> Value {
    json!({ "model": "vlp-16", "at": { "eye": [0.5, -6.123, 1.7], "target": [0, 4, 1] }, "returns": "dual" })
}

#[test]
fn points_are_those_of_scan() {
    let (workshop, scene) = yard_scene();
    let viewer = Viewer::of(&scene, &["--port=0", "--simd=portable"]).loaded();
    let mut key = viewer.json("GET", "/state", &json!({}))["camera"].clone();
    key["time"] = json!(0);
    let mut further = key.clone();
    (further["time"], further["eye"]) = (json!(2), json!([1.0, -9.0, 2.0]));
    let riding = |rays: u8| json!({ "model": "vlp-16", "sub_rays": rays });
    let fog = json!({ "name": "murk", "fog": { "mor": 40 } });
    let rain = json!({ "name": "murk", "rain": { "rate": 20 } });
    let mut sizes = Vec::new();
    for (follow, lidar, weather) in
        [("fixed", standing(), &rain), ("camera", riding(7), &fog), ("path", riding(1), &fog)]
    {
        let mut state = json!({ "weather": weather, "time": 0.25, "lidar": lidar, "path": [key, further] });
        if follow == "path" {
            state["follow"] = json!("path");
        }
        let folder = workshop.path(follow);
        std::fs::create_dir(&folder).unwrap();
        std::fs::write(folder.join("yard-murk.toml"), viewer.file("weather", &state)).unwrap();
        std::fs::write(folder.join("yard-murk.camera.json"), viewer.file("camera", &state)).unwrap();
        let command = String::from_utf8(viewer.file("scan", &state)).unwrap();
        let points = viewer.file("points", &state);
        assert!(points == std::fs::read(rendered(&command, &folder)).unwrap(), "not the points of {command}");
        sizes.push(points.len());
    }
    assert!(sizes.iter().all(|size| *size > 100_000), "{sizes:?}");
}

#[test]
fn pictures_have_points_and_saved_ones_have_none() {
    let (_workshop, viewer) = yard_viewer();
    let frames = || ["format=jpeg", "format=png"].map(|query| viewer.get(&format!("/frame?{query}")).1);
    let plain = frames();
    let put = viewer.json("PUT", "/state", &json!({ "lidar": { "model": "vlp-16" } }));
    let whole =
        json!({ "model": "vlp-16", "at": null, "sub_rays": 1, "returns": "strongest", "colors": "class" });
    assert_eq!(put["lidar"], whole);
    let pointed = frames();
    assert!(pointed[0] != plain[0] && pointed[1] == plain[1]);
    assert!(frames() == pointed, "the same request gives another picture");
    let presets = viewer.json("GET", "/parameters", &json!({}))["lidars"].clone();
    assert!(presets.as_array().unwrap().iter().any(|lidar| lidar["name"] == "vlp-16"), "{presets}");
    for (lidar, expected) in [
        (json!({ "model": "vlp16" }), "lidar: `vlp16` is no lidar; did you mean vlp-16?"),
        (json!({ "model": "/etc/passwd.toml" }), "is no lidar; give vlp-16, "),
        (json!({ "model": "vlp-16", "sub_rays": 3 }), "lidar.sub_rays is 3: must be 1 or 7"),
        (
            json!({ "model": "vlp-16", "returns": "most" }),
            "lidar.returns is `most`: must be one of strongest, ",
        ),
        (json!({ "model": "vlp-16", "colors": "red" }), "use class, range or intensity"),
        (json!({ "model": "vlp-16", "at": { "eye": [0, 0, 0], "target": [0, 0, 5] } }), "lidar.at: "),
        (
            json!({ "model": "vlp-16", "at": { "eye": [1e9, 0, 0], "target": [0, 0, 0] } }),
            "within 1000000 scene",
        ),
        (json!({ "modl": "vlp-16" }), "unknown field `modl`"),
    ] {
        viewer.refuses("PUT", "/state", &json!({ "lidar": lidar }).to_string(), expected);
    }
    viewer.refuses("POST", "/files/points", &json!({ "lidar": null }).to_string(), "no lidar");
    let flood = json!({ "weather": { "name": "flood", "flood": { "level": 0.3 } } });
    viewer.refuses("POST", "/files/points", &flood.to_string(), "do not see floods");
}

#[test]
fn a_picture_does_not_wait_for_its_points() {
    let (_workshop, viewer) = yard_viewer();
    let mut page = viewer.socket(&[]).unwrap();
    let mut next = |seq: u64, is_moving: bool, state: Value| {
        page.view(seq, is_moving, &state);
        let mut heads = Vec::new();
        loop {
            match page.next() {
                SocketEvent::Picture(head, _) if head["seq"] == seq => {
                    page.say(&json!({ "type": "seen", "seq": seq }));
                    heads.push((head["whole"] == true, head["lidar"].clone()));
                    if is_moving || head["whole"] == true {
                        break heads;
                    }
                }
                SocketEvent::Closed => panic!("closed"),
                _ => {}
            }
        }
    };
    let first = next(1, false, json!({ "lidar": standing() }));
    let [(false, Value::Null), (true, made)] = &first[..] else { panic!("{first:?}") };
    assert!(made["points"].as_u64().unwrap() > 1000 && made["classes"]["air"] == 0, "{made}");
    // Who flies keeps the points, at once, also in other colours.
    let mut camera = viewer.json("GET", "/state", &json!({}))["camera"].clone();
    camera["eye"] = json!([1, -11, 2]);
    let mut colored = standing();
    colored["colors"] = json!("range");
    assert_eq!(next(2, true, json!({ "camera": camera })), [(false, made.clone())]);
    assert_eq!(next(3, false, json!({ "lidar": colored })), [(true, made.clone())]);
    // In other weather they are made when it rests.
    let fog = json!({ "name": "fog", "fog": { "mor": 30 } });
    assert_eq!(next(4, true, json!({ "weather": fog })), [(false, Value::Null)]);
    let foggy = next(5, false, json!({}));
    assert!(foggy.len() == 2 && foggy[1].1["classes"]["air"].as_u64() > Some(100), "{foggy:?}");
    // What cannot be scanned is told with the picture.
    let flood = json!({ "name": "flood", "flood": { "level": 0.3 } });
    let flooded = next(6, false, json!({ "weather": flood }));
    let error = flooded.last().unwrap().1["error"].as_str().unwrap();
    assert!(error.contains("do not see floods"), "{error}");
}

#[test]
fn the_panel_places_a_lidar_and_saves_its_points() {
    let (workshop, scene) = yard_scene();
    let downloads = workshop.path("downloads");
    std::fs::create_dir(&downloads).unwrap();
    let Some(browser) = Browser::start(&downloads) else { return };
    let viewer = Viewer::of(&scene, &["--port=0"]).loaded();
    browser.view(&viewer);
    let plain = browser.picture();
    let text = |id: &str| browser.text(id);
    click(&browser, "[data-tab=lidar]");
    let choose = |model: &str| {
        let set = format!("s.value = '{model}'; s.dispatchEvent(new Event('change'))");
        browser.script(&format!("const s = document.getElementById('lidar-model'); {set}"));
    };
    choose("vlp-16");
    let pointed = browser.picture();
    assert!(pointed != plain && text("lidar-counts").contains(" points of "), "{}", text("lidar-counts"));
    // It stays while the camera moves, until it is placed anew.
    let place = text("lidar-where");
    browser.drag((400, 300), (120, 10));
    browser.picture();
    assert_eq!(text("lidar-where"), place);
    click(&browser, "#lidar-here");
    browser.picture();
    assert!(text("lidar-where") != place);
    click(&browser, "[data-value=range]");
    slide(&browser, "fog.mor", 0.2);
    browser.picture();
    until("air is counted", || text("lidar-counts").contains(" air"));
    screenshots(&browser, "lidar");
    let mut last = String::new();
    until("the command is that of the points", || {
        let command = text("lidar-command");
        std::mem::replace(&mut last, command.clone()) == command && command.contains("scan") && {
            std::thread::sleep(std::time::Duration::from_millis(450));
            text("lidar-command") == command
        }
    });
    click(&browser, "#lidar-save");
    let saved = |end: &str| file_of(&downloads, end).is_some();
    until("the files are saved", || saved("-scan.ply") && saved(".toml") && !saved(".crdownload"));
    let points = take_file(&downloads, "-scan.ply");
    assert!(points == std::fs::read(rendered(&last, &downloads)).unwrap(), "other points: {last}");
    choose("");
    browser.picture();
    assert_eq!(browser.script("return document.getElementById('lidar-save').checkVisibility()"), false);
    assert_eq!(browser.complaints(), Vec::<String>::new());
}
