//! Pictures: the right ones, the same each time, and those of `render`.

use crate::viewer::client::{Viewer, rendered, until};
use crate::viewer::socket::SocketEvent;
use crate::viewer::{yard_scene, yard_viewer};
use serde_json::{Value, json};

#[test]
fn saved_files_render_to_the_same_bytes() {
    let (workshop, scene) = yard_scene();
    let viewer = Viewer::of(&scene, &["--port=0", "--ground=0.01", "--simd=portable"]).loaded();
    let start = viewer.json("GET", "/state", &json!({}));
    let camera = json!({ "eye": [0.5, -12.123456789012345, 1.8], "rotation": [0.7123, 0.7, 0.012, -0.003], "fov": 47.3 });
    let mut further = camera.clone();
    further["eye"] = json!([1.5, -10.1, 2.0]);
    let keyed = |time: f64, pose: &Value| {
        let mut key = pose.clone();
        key["time"] = json!(time);
        key
    };
    for patch in [
        json!({ "weather": { "name": "a fog", "fog": { "mor": { "keys": [[0, 200, "smooth"], [3, 40.7]] }, "scale_height": "inf", "airlight": [0.7, 0.71, 0.123456] } }, "time": 1.3 }),
        json!({ "weather": { "name": "rain", "rain": { "rate": 25 }, "wind": { "speed": 4 }, "sky": { "model": "overcast" } }, "time": 2.0, "camera": camera }),
        json!({ "weather": { "name": "snow", "snow_cover": { "depth": 0.2 }, "snowfall": {} }, "time": 0.4 }),
        json!({ "weather": { "name": "paper", "fidelity": "paper", "rain": {}, "snow_cover": {} } }),
        json!({ "weather": { "name": "way", "rain": {} }, "follow": "path", "time": 0.7, "path": [keyed(0.0, &camera), keyed(2.0, &further)] }),
        // The divider and the quality are the screen's.
        json!({ "weather": { "name": "clear" }, "divider": 0.5, "quality": 3 }),
    ] {
        let name = patch["weather"]["name"].as_str().unwrap();
        let mut state = start.clone();
        state.as_object_mut().unwrap().extend(patch.as_object().unwrap().clone());
        let saved = viewer.file("picture", &state);
        let made = viewer.rendered(&state, &workshop.path(name));
        assert!(saved == std::fs::read(made).unwrap(), "{name}: not the same bytes");
    }
    let mut depth = start.clone();
    (depth["output"], depth["weather"]) = (json!("depth"), json!({ "name": "deep" }));
    let saved = viewer.file("picture", &depth);
    let made = viewer.rendered(&depth, &workshop.path("depth")).with_extension("depth.png");
    assert!(saved == std::fs::read(made).unwrap(), "depth: not the same bytes");
}

#[test]
fn pictures_are_functions_of_their_state() {
    let (_workshop, viewer) = yard_viewer();
    let frame = |query: &str| {
        let (status, bytes) = viewer.get(&format!("/frame?{query}"));
        assert_eq!(status, 200, "{query}: {}", String::from_utf8_lossy(&bytes));
        bytes
    };
    let rain = |time: &str| frame(&format!("weather=clear&set=rain.rate%3D40&time={time}&format=png"));
    let first = rain("2");
    assert!(first.starts_with(b"\x89PNG"));
    assert!(rain("1") != first, "time does nothing");
    assert!(rain("2") == first, "the same instant is another picture");
    let clear = frame("");
    let queries = "set=fog.mor=20 output=depth output=normal output=alpha camera=0,-8,2:0,4,2 fov=30 \
                   quality=20 size=90x64";
    for query in queries.split_whitespace() {
        assert!(frame(query) != clear, "{query} does nothing");
        assert!(frame(query) == frame(query), "{query}");
    }
    // A query changes its own picture alone.
    assert!(frame("") == clear);
    // Left of the divider there is no weather.
    let half = frame("set=fog.mor=10&divider=1&quality=90");
    assert!(half == clear && frame("set=fog.mor=10&divider=0.5") != clear);
}

#[test]
fn a_state_that_is_put_reaches_every_page() {
    let (_workshop, viewer) = yard_viewer();
    let mut page = viewer.socket(&[]).unwrap();
    page.view(1, false, &json!({}));
    let (head, clear) = page.whole();
    assert_eq!((head["width"].as_u64(), head["height"].as_u64()), (Some(96), Some(64)));
    assert!(head["mor"].is_null() && head["splats"].as_u64().unwrap() > 100);
    let thick = json!({ "weather": { "name": "thick", "fog": { "mor": 15 } }, "time": 3 });
    let put = viewer.json("PUT", "/state", &thick);
    assert_eq!(viewer.json("GET", "/state", &json!({})), put);
    let told = page.word("state")["state"].clone();
    assert_eq!(told, put);
    page.view(2, false, &told);
    let (head, foggy) = page.whole();
    assert!((head["mor"].as_f64().unwrap() - 15.0).abs() < 1e-9 && head["seq"] == 2 && foggy != clear);
    assert!(viewer.get("/frame").1 == foggy, "a script sees what the page sees");
}

#[test]
fn only_the_latest_request_counts_and_moving_views_are_smaller() {
    let (_workshop, viewer) = yard_viewer();
    let mut page = viewer.socket(&[]).unwrap();
    for seq in 1..=50 {
        page.view(seq, true, &json!({ "time": seq, "size": [480, 320] }));
    }
    page.view(51, false, &json!({}));
    let mut pictures = 0;
    loop {
        let (head, _) = page.picture();
        pictures += 1;
        page.say(&json!({ "type": "seen", "seq": head["seq"] }));
        if head["whole"] == true {
            assert!(head["seq"] == 51 && head["time"] == 50.0 && head["width"] == 480, "{head}");
            break;
        }
        assert!(head["width"].as_u64().unwrap() < 480, "{head}");
    }
    assert!(pictures < 50, "{pictures} pictures for 51 requests at once");
    // Who sees nothing gets no more than three.
    for seq in 100..140 {
        page.view(seq, true, &json!({ "time": seq }));
        std::thread::sleep(std::time::Duration::from_millis(10));
    }
    page.stream.set_read_timeout(Some(std::time::Duration::from_millis(500))).unwrap();
    let mut unseen = 0;
    while let SocketEvent::Picture(..) = page.next() {
        unseen += 1;
    }
    assert!((1..=3).contains(&unseen), "{unseen}");
}

#[test]
fn snow_is_prepared_while_pictures_go_on() {
    let (_workshop, viewer) = yard_viewer();
    let mut page = viewer.socket(&[]).unwrap();
    page.view(1, false, &json!({ "weather": { "name": "white", "snow_cover": { "depth": 0.3 } } }));
    let (mut words, mut drafts) = (Vec::new(), 0);
    loop {
        match page.next() {
            SocketEvent::Word(word) => words.push(word),
            SocketEvent::Picture(head, _) if head["whole"] == true => break,
            SocketEvent::Picture(..) => drafts += 1,
            SocketEvent::Closed => panic!("closed"),
        }
    }
    let said = |text: &str| words.iter().any(|word| word["type"] == "status" && word["text"] == text);
    assert!(drafts == 1 && said("finding what snow can lie on") && said(""), "{drafts} {words:?}");
}

#[test]
#[cfg(feature = "h264")]
fn videos_are_those_of_render() {
    let (workshop, viewer) = yard_viewer();
    let state = json!({ "weather": { "name": "wet", "rain": { "rate": 30 } }, "size": [96, 64] });
    let begun = viewer.json("POST", "/videos", &json!({ "state": state, "fps": 10, "seconds": 0.5 }));
    let path = format!("/videos/{}", begun["id"]);
    until("the video is done", || viewer.json("GET", &path, &json!({}))["state"] == "done");
    let (status, video) = viewer.get(&format!("{path}/file"));
    assert_eq!(status, 200);
    for kind in ["weather", "camera"] {
        let name = format!("yard-wet.{}", if kind == "weather" { "toml" } else { "camera.json" });
        std::fs::write(workshop.path(&name), viewer.file(kind, &state)).unwrap();
    }
    let made = rendered(begun["command"].as_str().unwrap(), &workshop.path(""));
    assert!(std::fs::read(made).unwrap() == video, "not the bytes of render");
    // One that is too long is refused, one that runs can be stopped.
    let asked = json!({ "state": {}, "fps": 1000, "seconds": 1e6 }).to_string();
    assert_eq!(viewer.ask("POST", "/videos", &[], asked.as_bytes()).0, 400);
    let long = json!({ "state": { "size": [640, 480] }, "fps": 30, "seconds": 100 });
    let begun = viewer.json("POST", "/videos", &long);
    assert_eq!(viewer.ask("POST", "/videos", &[], long.to_string().as_bytes()).0, 409);
    let path = format!("/videos/{}", begun["id"]);
    viewer.json("DELETE", &path, &json!({}));
    until("the video is stopped", || viewer.json("GET", &path, &json!({}))["state"] == "failed");
    assert_eq!(viewer.get(&format!("{path}/file")).0, 409);
}

#[test]
fn parameters_are_those_of_the_effects() {
    let (_workshop, viewer) = yard_viewer();
    let all = viewer.json("GET", "/parameters", &json!({}));
    let effects = all["effects"].as_array().unwrap();
    assert_eq!(effects.len(), wm_weather::EFFECTS.len());
    for (effect, known) in effects.iter().zip(wm_weather::EFFECTS) {
        assert_eq!(effect["name"], known.name);
        for (param, known) in effect["params"].as_array().unwrap().iter().zip(known.params) {
            assert_eq!((&param["name"], &param["unit"]), (&json!(known.name), &json!(known.unit)));
            assert!(!param["meaning"].as_str().unwrap().is_empty() && !param["default"].is_null());
        }
    }
    // A preset is a state's weather as it stands; a file is made into one.
    for preset in all["presets"].as_array().unwrap() {
        viewer.json("PUT", "/state", &json!({ "weather": preset["weather"] }));
    }
    let (status, read) = viewer.ask("POST", "/weather", &[], b"name = \"v\"\n[fog]\nmor = 80");
    let read: Value = serde_json::from_slice(&read).unwrap();
    assert_eq!((status, read), (200, json!({ "name": "v", "fog": { "mor": 80.0 } })));
    viewer.refuses("POST", "/weather", "[fog]\nmoor = 80", "weather.toml:2:1: ");
}

#[test]
fn a_scene_that_cannot_be_read_is_told_to_page_and_terminal() {
    let (workshop, _) = yard_scene();
    let broken = workshop.path("broken.ply");
    std::fs::write(&broken, "ply\nformat ascii 1.0\nnonsense").unwrap();
    let mut command = crate::common::binary();
    command.arg("view").arg(&broken).arg("--port=0").stderr(std::process::Stdio::null());
    let mut viewer = Viewer::run(command);
    let mut page = viewer.socket(&[]).unwrap();
    let text = page.word("failed")["text"].as_str().unwrap().to_owned();
    assert!(text.contains("broken.ply") && !text.contains('\n'), "{text}");
    assert_eq!(viewer.get("/parameters").0, 503);
    assert_eq!(viewer.ended().code(), Some(1));
}
