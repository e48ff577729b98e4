//! The tool that sets up, the ground and the scale by hand.

use crate::common::{Workshop, yard, yard_metadata};
use crate::viewer::client::{Viewer, until};
use crate::viewer::page::screenshots;
use crate::viewer::webdriver::Browser;
use crate::viewer::yard_scene;
use glam::{DQuat, DVec3};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use wm_scene::formats::{ReadOptions, read_scene};
use wm_scene::{Metadata, PhotoSun};

/// The yard with an up that is wrong by more than 140 degrees.
fn tilted_yard() -> (Workshop, PathBuf) {
    let workshop = Workshop::new();
    let up = DVec3::new(0.3, 0.5, -0.8).normalize();
    let metadata = Metadata { up: Some(up), ground: None, ..yard_metadata(1.0) };
    let scene = workshop.scene("yard", yard().build(), &metadata);
    (workshop, scene)
}

const CAMERA: &str = "--camera=0.5,-12,3:0,4,1";
const GROUND_POINTS: [DVec3; 3] =
    [DVec3::new(-1.9, -4.5, 0.0), DVec3::new(2.4, -4.8, 0.0), DVec3::new(0.0, 1.5, 0.0)];
const SKY_POINT: DVec3 = DVec3::new(0.5, -2.0, 5.7);

fn saved_up(scene: &Path) -> DVec3 {
    read_scene(scene, &ReadOptions::default()).unwrap().metadata.up.unwrap()
}

/// Position in a picture of a point that a pose sees, as shares of the sides.
fn seen(pose: &Value, aspect: f64, point: DVec3) -> [f64; 2] {
    let numbers = |key: &str| -> Vec<f64> {
        pose[key].as_array().unwrap().iter().map(|value| value.as_f64().unwrap()).collect()
    };
    let (eye, r) = (DVec3::from_slice(&numbers("eye")), numbers("rotation"));
    let p = DQuat::from_xyzw(r[1], r[2], r[3], r[0]).normalize() * (point - eye);
    let focal = 0.5 / (0.5 * pose["fov"].as_f64().unwrap().to_radians()).tan();
    [0.5 + focal * p.x / p.z / aspect, 0.5 + focal * p.y / p.z]
}

#[test]
fn three_clicks_on_the_ground_set_up_upright() {
    let (workshop, scene) = tilted_yard();
    let Some(browser) = Browser::start(&workshop.path("")) else { return };
    let viewer = Viewer::of(&scene, &["--port=0", CAMERA]).loaded();
    browser.view(&viewer);
    browser.picture();
    let is_fetched = "performance.getEntriesByType('resource').some(e => e.name.includes('/align.'))";
    assert_eq!(browser.script(&format!("return {is_fetched}")), false, "fetched before it is opened");
    let press = |id: &str| browser.script(&format!("document.getElementById('{id}').click()"));
    let says = |text: &str| {
        browser.until(&format!("document.getElementById('align-said')?.textContent.includes('{text}')"));
    };
    press("align-switch");
    says("3 more points");
    let click = |point: DVec3| {
        browser.picture();
        let shown = browser.script(
            "const c = document.getElementById('picture'), b = c.getBoundingClientRect(); \
             return [JSON.parse(c.dataset.camera), b.left, b.top, b.width, b.height]",
        );
        let side = |index: usize| shown[index].as_f64().unwrap();
        let [x, y] = seen(&shown[0], side(3) / side(4), point);
        let at = ((side(1) + x * side(3)).round() as i32, (side(2) + y * side(4)).round() as i32);
        let under = browser.script(&format!("return document.elementFromPoint({}, {})?.id", at.0, at.1));
        assert_eq!(under, "picture", "{at:?} is covered");
        browser.drag(at, (0, 0));
    };
    click(SKY_POINT);
    browser.until("document.getElementById('align-error').textContent.includes('only sky')");
    says("3 more points");
    click(GROUND_POINTS[0]);
    says("2 more points");
    click(GROUND_POINTS[1]);
    says("1 more point.");
    click(GROUND_POINTS[2]);
    says("The ground is set");
    browser.until("document.getElementById('align-facts').textContent.includes('not saved')");
    assert!(!scene.with_extension("ply.wm.toml").exists(), "written without being asked to");
    // The picture is level: up is up in it.
    until("the view is level", || {
        browser.picture();
        let pose = browser.script("return JSON.parse(document.getElementById('picture').dataset.camera)");
        seen(&pose, 1.0, DVec3::new(0.0, 4.0, 2.0))[1] < seen(&pose, 1.0, DVec3::new(0.0, 4.0, 0.0))[1]
    });
    screenshots(&browser, "align");
    press("align-save");
    says("Saved as yard.ply.wm.toml");
    let off = saved_up(&scene).angle_between(DVec3::Z).to_degrees();
    assert!(off < 2.0, "{off} degrees");
    browser.script("dispatchEvent(new KeyboardEvent('keydown', { key: 'Escape' }))");
    browser.until("!document.getElementById('align')");
    assert_eq!(browser.complaints(), Vec::<String>::new());
}

#[test]
fn pictures_follow_the_facts_at_once() {
    let (workshop, scene) = tilted_yard();
    let viewer = Viewer::of(&scene, &["--port=0", CAMERA]).loaded();
    let change = |body: &Value| viewer.json("POST", "/facts", body);
    let mut state = viewer.json("GET", "/state", &json!({}));
    state["weather"] = json!({ "name": "snow", "snow_cover": { "depth": 0.3 } });
    let wrong = viewer.file("picture", &state);

    let surface = |point: DVec3| {
        let [x, y] = seen(&state["camera"], 96.0 / 64.0, point);
        let answer = viewer.json("POST", "/surface", &json!({ "state": state, "x": x, "y": y }));
        answer["point"].clone()
    };
    assert_eq!(surface(SKY_POINT), Value::Null);
    let points = GROUND_POINTS.map(surface);
    let answer = change(&json!({ "action": "ground", "points": points }));
    assert_eq!(answer["facts"]["unsaved"], true);
    assert!(answer["text"].as_str().unwrap().contains("most of the scene"), "{answer}");
    let right = viewer.file("picture", &state);
    assert!(right != wrong, "snow lies as before");
    let command = String::from_utf8(viewer.file("command", &state)).unwrap();
    assert!(command.contains(" --up=") && command.contains(" --ground="), "{command}");

    change(&json!({ "action": "undo" }));
    assert!(viewer.file("picture", &state) == wrong, "undone, the picture is another one");
    change(&json!({ "action": "ground", "points": points }));
    change(&json!({ "action": "scale", "points": [[0, 0, 0], [0, 2, 0]], "metres": 1 }));
    let facts = change(&json!({ "action": "save" }))["facts"].clone();
    assert!(facts["metres_per_unit"] == 0.5 && facts["unsaved"] == false, "{facts}");
    // `render` reads the facts from the file, and draws the same.
    let saved = viewer.file("picture", &state);
    let made = viewer.rendered(&state, &workshop.path("saved"));
    assert!(saved == std::fs::read(made).unwrap(), "not the bytes of render");
    let off = saved_up(&scene).angle_between(DVec3::Z).to_degrees();
    assert!(off < 2.0, "{off} degrees");

    change(&json!({ "action": "flip" }));
    for (body, expected) in [
        (json!({ "action": "ground", "points": [[0, 0, 0], [1, 0, 0], [2, 0.01, 0]] }), "nearly on one line"),
        (json!({ "action": "scale", "points": [[0, 0, 0], [1, 0, 0]], "metres": -1 }), "-1 m gives no scale"),
        (json!({ "action": "ground", "points": [[0, 0, 0]] }), "facts: "),
        (json!({ "action": "write", "file": "/etc/passwd" }), "unknown variant"),
        (json!({ "action": "save", "file": "/etc/passwd" }), "facts: "),
    ] {
        viewer.refuses("POST", "/facts", &body.to_string(), expected);
    }
    // Pages of other origins change nothing.
    let (status, _) =
        viewer.ask("POST", "/facts", &[("Origin", "http://evil.example")], br#"{"action": "save"}"#);
    assert_eq!(status, 403);
    assert!(saved_up(&scene).z > 0.9, "saved by a refused request");
}

/// A lamp on a post and a lit window, put by points, light the yard by night; saved, they are there
/// for `render`.
#[test]
fn lamps_are_put_where_a_click_was() {
    let (workshop, scene) = yard_scene();
    let viewer = Viewer::of(&scene, &["--port=0", CAMERA, "--simd=portable"]).loaded();
    let change = |body: &Value| viewer.json("POST", "/facts", body);
    let mut state = viewer.json("GET", "/state", &json!({}));
    state["weather"] = json!({ "name": "night", "light": { "model": "night" } });
    let brightest = |picture: &[u8]| {
        let mut reader = png::Decoder::new(std::io::Cursor::new(picture)).read_info().unwrap();
        let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
        let size = reader.next_frame(&mut bytes).unwrap().buffer_size();
        bytes[..size].iter().copied().max().unwrap()
    };
    let dark = viewer.file("picture", &state);
    let answer = change(&json!({ "action": "lamp", "point": [0.0, -3.0, 0.0] }));
    assert_eq!(answer["text"], "1 lamp and 0 lit windows.");
    let lit = viewer.file("picture", &state);
    assert!(brightest(&lit) > brightest(&dark) + 40, "{} {}", brightest(&lit), brightest(&dark));
    let corners = json!([[-0.4, 3.9, 0.6], [0.4, 3.9, 1.4]]);
    let answer = change(&json!({ "action": "window", "points": corners, "eye": [0.5, -12.0, 3.0] }));
    assert_eq!(answer["text"], "1 lamp and 1 lit window.");
    change(&json!({ "action": "save" }));
    let saved = viewer.file("picture", &state);
    let made = viewer.rendered(&state, &workshop.path("saved"));
    assert!(saved == std::fs::read(made).unwrap(), "not the bytes of render");
    let read = read_scene(&scene, &ReadOptions::default()).unwrap().metadata;
    let lamps = read.lamps.unwrap();
    assert!((lamps[0].at[2] - 5.0).abs() < 1e-9 && read.windows.unwrap().len() == 1, "{lamps:?}");

    change(&json!({ "action": "dark" }));
    assert!(viewer.file("picture", &state) == dark, "a lamp is left");
    change(&json!({ "action": "undo" }));
    assert!(viewer.file("picture", &state) == saved, "undone, the lamps are others");
    let level = json!({ "action": "window", "points": [[0, 4, 1], [1, 4, 1]], "eye": [0, 0, 1] });
    viewer.refuses("POST", "/facts", &level.to_string(), "corners of a window");
}

/// The sun of the photos by a point and the end of its shadow; saved, it is there for `render`.
#[test]
fn the_sun_of_the_photos_is_told_by_a_shadow() {
    let (_workshop, scene) = yard_scene();
    let viewer = Viewer::of(&scene, &["--port=0", CAMERA]).loaded();
    let change = |body: &Value| viewer.json("POST", "/facts", body);
    let answer = change(&json!({ "action": "sun", "points": [[0, 4, 3], [3, 4, 0]] }));
    assert_eq!(answer["text"], "The sun of the photos was 45° high.");
    assert_eq!(answer["facts"]["unsaved"], true);
    change(&json!({ "action": "save" }));
    let sun = || read_scene(&scene, &ReadOptions::default()).unwrap().metadata.sun;
    let Some(PhotoSun::Towards(towards)) = sun() else { panic!("{:?}", sun()) };
    assert!(towards.distance(DVec3::new(-1.0, 0.0, 1.0).normalize()) < 1e-6, "{towards}");

    change(&json!({ "action": "clouds" }));
    change(&json!({ "action": "undo" }));
    assert_eq!(change(&json!({ "action": "save" }))["text"], "There is nothing to save.");
    change(&json!({ "action": "clouds" }));
    change(&json!({ "action": "save" }));
    assert_eq!(sun(), Some(PhotoSun::Diffuse));
    let below = json!({ "action": "sun", "points": [[3, 4, 0], [0, 4, 3]] });
    viewer.refuses("POST", "/facts", &below.to_string(), "click the top first");
}

/// The sun is set on its dial by keys.
#[test]
fn the_sun_stands_where_the_dial_says() {
    let (workshop, scene) = yard_scene();
    let Some(browser) = Browser::start(&workshop.path("")) else { return };
    let viewer = Viewer::of(&scene, &["--port=0", CAMERA]).loaded();
    browser.view(&viewer);
    browser.picture();
    let press = |key: &str| {
        browser.script(&format!(
            "document.querySelector('#sun-dial svg').dispatchEvent(new KeyboardEvent('keydown', {{ key: '{key}', bubbles: true }}))"
        ))
    };
    press("ArrowUp");
    press("ArrowRight");
    browser.until("document.querySelector('#sun-dial p').textContent === '46° high, azimuth 182°'");
    let light = || viewer.json("GET", "/state", &json!({}))["weather"]["light"].clone();
    until("the program has the sun", || light()["sun_elevation"] == 46 && light()["model"] == "clear");
    assert_eq!(browser.complaints(), Vec::<String>::new());
}
