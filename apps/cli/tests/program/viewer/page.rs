//! The page in headless Chromium.

use crate::viewer::client::{Viewer, rendered, until};
use crate::viewer::webdriver::Browser;
use crate::viewer::yard_scene;
use serde_json::json;
use std::path::{Path, PathBuf};

/// Sets a slider, 0-1, as a hand does.
pub fn slide(browser: &Browser, param: &str, to: f64) {
    browser.script(&format!(
        "const s = document.querySelector('[data-param=\"{param}\"] input[type=range]'); \
         s.value = {to}; s.dispatchEvent(new Event('input', {{ bubbles: true }}))"
    ));
}

fn scrub(browser: &Browser, time: f64) {
    browser.script(&format!(
        "const s = document.getElementById('time'); s.value = {time}; s.dispatchEvent(new Event('input', {{ bubbles: true }}))"
    ));
}

/// Clicks on an element.
pub fn click(browser: &Browser, selector: &str) {
    browser.script(&format!("document.querySelector('{selector}').click()"));
}

fn camera(browser: &Browser) -> String {
    browser.picture();
    browser.script("return document.getElementById('picture').dataset.camera").as_str().unwrap().to_owned()
}

#[test]
fn the_page_works() {
    let (workshop, scene) = yard_scene();
    let downloads = workshop.path("downloads");
    std::fs::create_dir(&downloads).unwrap();
    let Some(browser) = Browser::start(&downloads) else { return };
    let token = "the-token-of-this-test";
    let viewer = Viewer::with_token(&scene, &["--port=0"], token).loaded();
    browser.view(&viewer);
    let clear = browser.picture();
    assert_eq!(browser.script("return location.href"), format!("http://{}/", viewer.address));
    assert_eq!(browser.text("scene-name"), "yard");

    // Weather: a switch, a slider, a preset; sliders come from the tables.
    let effects = browser.script("return document.querySelectorAll('.effect').length");
    assert_eq!(effects, wm_weather::EFFECTS.len());
    slide(&browser, "rain.rate", 0.4);
    let rain = browser.picture();
    assert!(rain != clear, "the rain slider does nothing");
    slide(&browser, "rain.rate", 0.8);
    assert!(browser.picture() != rain, "more rain looks the same");
    assert!(browser.text("stats").contains("mm/h rain"));
    slide(&browser, "rain.rate", 0.4);
    assert!(browser.picture() == rain, "the same rain looks different");

    // Time: the same instant is the same picture; keyframes change it.
    scrub(&browser, 2.0);
    let later = browser.picture();
    scrub(&browser, 3.5);
    assert!(browser.picture() != later);
    scrub(&browser, 2.0);
    assert!(browser.picture() == later, "scrubbing is not deterministic");
    click(&browser, "[data-param=\"rain.rate\"] .key");
    scrub(&browser, 4.0);
    slide(&browser, "rain.rate", 0.1);
    assert_eq!(browser.script("return document.querySelectorAll('.mark.weather').length"), 2);
    assert!(browser.picture() != later);

    // Camera.
    let before = camera(&browser);
    browser.drag((400, 300), (120, 40));
    let turned = camera(&browser);
    assert!(turned != before, "a drag does not turn");
    click(&browser, "#home");
    until("the camera is back", || camera(&browser) == before);

    // Outputs and the divider.
    let whole = browser.picture();
    click(&browser, "[data-output=depth]");
    assert!(browser.picture() != whole);
    click(&browser, "[data-output=rgb]");
    click(&browser, "#divider-switch");
    assert!(browser.picture() != whole);
    assert_eq!(browser.script("return document.getElementById('divider').hidden"), false);
    click(&browser, "#divider-switch");

    saved_files_render_to_the_same_bytes(&browser, &downloads);
    screenshots(&browser, "wide");
    assert_eq!(browser.complaints(), Vec::<String>::new());

    // The program ends and comes back: the page goes on with what it showed.
    let shown = browser.picture();
    let address = viewer.address.clone();
    let port = format!("--port={}", address.rsplit(':').next().unwrap());
    drop(viewer);
    browser.until("document.getElementById('offline')");
    let viewer = Viewer::with_token(&scene, &[&port], token).loaded();
    browser.until("document.body.dataset.live === 'yes' && !document.getElementById('offline')");
    assert!(browser.picture() == shown, "after a new start the page shows something else");

    // A scene that cannot be read is told on the page.
    drop(viewer);
    std::fs::write(&scene, "ply\nformat ascii 1.0\nnonsense").unwrap();
    let mut viewer = Viewer::with_token(&scene, &[&port], token);
    browser.until("!document.getElementById('veil').hidden && document.getElementById('veil-text').textContent.includes('yard.ply')");
    assert_eq!(viewer.ended().code(), Some(1));
    // Nothing but the program that was not there, which a thumbnail may have been asked of as it
    // ended.
    let was_gone = |line: &String| line.contains("WebSocket") || line.contains("ERR_CONNECTION_REFUSED");
    let others: Vec<String> = browser.complaints().into_iter().filter(|line| !was_gone(line)).collect();
    assert_eq!(others, Vec::<String>::new());
}

#[test]
fn a_page_without_the_token_asks_for_it() {
    let (workshop, scene) = yard_scene();
    let Some(browser) = Browser::start(&workshop.path("")) else { return };
    let viewer = Viewer::of(&scene, &["--port=0"]).loaded();
    browser.open_at(&viewer.address, "");
    browser.until("document.getElementById('login')?.open");
    assert_eq!(browser.complaints(), Vec::<String>::new());
    screenshots(&browser, "login");
    let enter = |text: &str| {
        browser.script(&format!("document.getElementById('token').value = '{text}'"));
        click(&browser, "#login button");
    };
    enter("something-else-entirely");
    browser.until("document.getElementById('login-said').textContent.startsWith('This is not the token')");
    browser.press("\u{E00C}");
    browser.press("\u{E00C}");
    browser.until("document.getElementById('login').open");
    // The whole address will do.
    enter(&format!("http://{}/#token={}", viewer.address, viewer.token));
    browser.picture();
    assert_eq!(browser.script("return document.getElementById('login')"), serde_json::Value::Null);
    assert_eq!(browser.script("return document.cookie"), "", "a script can read the token");
    // The cookie is there for the next page.
    browser.open_at(&viewer.address, "?again");
    browser.picture();
    // A program that was started anew has another token. Its address, opened in the same tab, is
    // enough.
    let port = format!("--port={}", viewer.address.rsplit(':').next().unwrap());
    drop(viewer);
    browser.until("document.getElementById('offline')");
    let viewer = Viewer::of(&scene, &[&port]).loaded();
    browser.until("document.getElementById('login')?.open");
    browser.open_at(&viewer.address, &format!("?again#token={}", viewer.token));
    browser.until(
        "!document.getElementById('login') && !document.getElementById('offline') && location.hash === ''",
    );
    browser.picture();
}

/// The file in a folder whose name ends so.
pub fn file_of(folder: &Path, end: &str) -> Option<PathBuf> {
    let mut files = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    files.find(|path| path.to_string_lossy().ends_with(end))
}

/// Reads a saved file and removes it.
pub fn take_file(folder: &Path, end: &str) -> Vec<u8> {
    let path = file_of(folder, end).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    std::fs::remove_file(&path).unwrap();
    bytes
}

fn saved_files_render_to_the_same_bytes(browser: &Browser, downloads: &Path) {
    click(browser, "#save-all");
    let is_saved = |end: &str| file_of(downloads, end).is_some();
    until("the files are saved", || {
        [".png", ".toml", ".camera.json"].iter().all(|end| is_saved(end)) && !is_saved(".crdownload")
    });
    browser.until("document.getElementById('command').textContent.startsWith('weather-magician render ')");
    let mut last = String::new();
    // The command follows what is shown a little later.
    until("the command is that of the files", || {
        let command = browser.text("command");
        std::mem::replace(&mut last, command.clone()) == command && command.contains("--time=4")
    });
    let saved = take_file(downloads, ".png");
    let made = rendered(&last, downloads);
    assert!(saved == std::fs::read(made).unwrap(), "the command gives other bytes: {last}");
}

#[test]
fn it_fits_a_phone_and_both_lights() {
    let (workshop, scene) = yard_scene();
    let Some(browser) = Browser::start(&workshop.path("")) else { return };
    let viewer = Viewer::of(&scene, &["--port=0"]).loaded();
    let ground = |browser: &Browser| browser.script("return getComputedStyle(document.body).backgroundColor");
    let prefer = |light: &str| {
        let features = json!([{ "name": "prefers-color-scheme", "value": light }]);
        browser.chromium("Emulation.setEmulatedMedia", json!({ "features": features }));
    };
    for (name, width, height, mobile) in [("phone", 390, 844, true), ("small", 1280, 720, false)] {
        let metrics = json!({ "width": width, "height": height, "deviceScaleFactor": 1, "mobile": mobile });
        browser.chromium("Emulation.setDeviceMetricsOverride", metrics);
        prefer("light");
        browser.view(&viewer);
        browser.picture();
        // Nothing stands out of the window, and the picture has most of it. What screen readers
        // alone read is a pixel wide.
        let inside = "[...document.querySelectorAll('#bar > *, #outputs, #timeline > *, .tabs button')].every(e => e.hidden || e.clientWidth <= 1 || e.scrollWidth <= e.clientWidth + 2 && \
            e.getBoundingClientRect().right <= innerWidth + 1 && e.getBoundingClientRect().bottom <= innerHeight + 1)";
        assert_eq!(browser.script(&format!("return {inside}")), true, "{name}");
        let share = browser.script("const b = document.getElementById('stage').getBoundingClientRect(); return b.width * b.height / innerWidth / innerHeight");
        assert!(share.as_f64().unwrap() > 0.5, "{name}: {share}");
        click(&browser, "[data-tab=weather]");
        click(&browser, "[data-effect=fog] summary");
        slide(&browser, "fog.mor", 0.3);
        browser.picture();
        let light = ground(&browser);
        screenshots(&browser, &format!("{name}-light"));
        prefer("dark");
        let dark = ground(&browser);
        assert!(dark != light, "{name}: dark is not dark");
        screenshots(&browser, &format!("{name}-dark"));
        // The switch wins over the system.
        click(&browser, "#theme");
        assert_eq!(ground(&browser), light, "{name}");
        browser.script("localStorage.clear()");
    }
    assert_eq!(browser.complaints(), Vec::<String>::new());
}

/// Keeps a picture of the page for who wants to look at it: `WM_SCREENSHOTS=FOLDER`.
pub fn screenshots(browser: &Browser, name: &str) {
    if let Some(folder) = std::env::var_os("WM_SCREENSHOTS") {
        let shot = browser.chromium("Page.captureScreenshot", json!({}));
        let text = shot["data"].as_str().unwrap();
        std::fs::write(Path::new(&folder).join(format!("{name}.png.base64")), text).unwrap();
    }
}
