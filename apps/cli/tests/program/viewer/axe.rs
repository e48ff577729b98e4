//! The page under axe-core, which finds what people with keyboards, screen readers and weak eyes
//! cannot use.
//!
//! axe-core (MPL-2.0) is not part of this repository. `npm install --prefix FOLDER axe-core@4`
//! fetches it; `WM_AXE=FOLDER/node_modules/axe-core/axe.min.js` names it.

use crate::viewer::client::Viewer;
use crate::viewer::page::{click, screenshots, slide};
use crate::viewer::webdriver::Browser;
use crate::viewer::yard_scene;
use serde_json::{Value, json};

/// Returns the serious and critical findings for what is shown, a line each.
fn findings(browser: &Browser, axe: &str) -> Vec<String> {
    // Scripts of the driver pass the policy of the page.
    browser.script(&format!("if (!window.axe) {{ {axe} }}; window.found = null; \
        axe.run(document, {{ resultTypes: ['violations'] }}).then((result) => {{ window.found = result.violations; }}, \
        (error) => {{ window.found = [{{ impact: 'critical', id: String(error), nodes: [] }}]; }})"));
    browser.until("window.found");
    let found = browser.script(
        "return window.found.filter((found) => ['serious', 'critical'].includes(found.impact)) \
            .flatMap((found) => found.nodes.map((node) => found.id + ': ' + node.target.join(' ')).concat(found.nodes.length ? [] : [found.id]))",
    );
    let lines = found.as_array().into_iter().flatten();
    lines.map(|line| line.as_str().unwrap_or_default().to_owned()).collect()
}

/// Emulates a window, px, and a preferred scheme of colours; a narrow window is that of a phone.
fn emulate(browser: &Browser, window: [u32; 2], scheme: &str) {
    let [width, height] = window;
    let mobile = width < 500;
    let metrics = json!({ "width": width, "height": height, "deviceScaleFactor": 1, "mobile": mobile });
    browser.chromium("Emulation.setDeviceMetricsOverride", metrics);
    let features = json!([
        { "name": "prefers-color-scheme", "value": scheme },
        { "name": "prefers-reduced-motion", "value": "reduce" },
    ]);
    browser.chromium("Emulation.setEmulatedMedia", json!({ "features": features }));
}

#[test]
fn everyone_can_use_the_page() {
    let Some(path) = std::env::var_os("WM_AXE") else {
        println!("skipped: WM_AXE does not name axe.min.js of axe-core");
        return;
    };
    let axe = std::fs::read_to_string(&path).expect("WM_AXE names a file");
    let (workshop, scene) = yard_scene();
    let Some(browser) = Browser::start(&workshop.path("")) else { return };
    let viewer = Viewer::of(&scene, &["--port=0"]).loaded();
    browser.open_at(&viewer.address, "");
    browser.until("document.getElementById('login')?.open");
    assert_eq!(findings(&browser, &axe), Vec::<String>::new(), "the login");
    let (desk, phone) = ([1280, 800], [390, 844]);
    for (window, scheme) in [(desk, "light"), (desk, "dark"), (phone, "light"), (phone, "dark")] {
        let name = format!("axe-{}-{scheme}", window[0]);
        emulate(&browser, window, scheme);
        browser.view(&viewer);
        browser.picture();
        let check = |what: &str| {
            screenshots(&browser, &format!("{name}-{what}"));
            assert_eq!(findings(&browser, &axe), Vec::<String>::new(), "{name}: {what}");
        };
        check("start");
        click(&browser, "[data-tab=weather]");
        for effect in ["fog", "light"] {
            click(&browser, &format!("[data-effect={effect}] summary"));
        }
        click(&browser, "[data-effect=fog] .more summary");
        slide(&browser, "fog.mor", 0.3);
        click(&browser, "[data-param=\"fog.mor\"] .key");
        click(&browser, "#add-key");
        browser.picture();
        check("weather");
        for tab in ["camera", "lidar", "save"] {
            click(&browser, &format!("[data-tab={tab}]"));
            check(tab);
        }
        click(&browser, "#divider-switch");
        click(&browser, "#align-switch");
        browser.until("document.getElementById('align')");
        check("align");
        click(&browser, "#align-close");
        click(&browser, "#help-switch");
        check("help");
    }
}

#[test]
fn keys_reach_and_move_every_control() {
    let (workshop, scene) = yard_scene();
    let Some(browser) = Browser::start(&workshop.path("")) else { return };
    let viewer = Viewer::of(&scene, &["--port=0"]).loaded();
    emulate(&browser, [1280, 800], "light");
    browser.view(&viewer);
    browser.picture();
    let focused =
        || browser.script("const e = document.activeElement; return e.id || e.dataset.name || e.className");
    let focus = |selector: &str| browser.script(&format!("document.querySelector('{selector}').focus()"));
    let value = |expression: &str| -> Value { browser.script(&format!("return {expression}")) };

    // The tabs are one stop, and the arrows go round.
    focus("[data-tab=weather]");
    browser.press("\u{E014}");
    assert_eq!(
        (focused(), value("document.getElementById('tab-camera').hidden")),
        (json!("of-camera"), json!(false))
    );
    browser.press("\u{E012}");
    browser.press("\u{E012}");
    assert_eq!(focused(), "of-save");
    assert_eq!(value("document.querySelectorAll('[role=tab][tabindex=\"0\"]').length"), 1);

    // The line of Compare, and the sun; the camera stays.
    let camera = value("document.getElementById('picture').dataset.camera");
    click(&browser, "#divider-switch");
    focus("#divider");
    browser.press("\u{E014}");
    assert_eq!(value("document.getElementById('divider').getAttribute('aria-valuenow')"), "51");
    click(&browser, "[data-tab=weather]");
    click(&browser, "[data-effect=light] summary");
    focus("#sun-dial svg");
    browser.press("\u{E013}");
    assert_eq!(value("document.querySelector('#sun-dial svg').getAttribute('aria-valuenow')"), "46");
    browser.picture();
    assert_eq!(value("document.getElementById('picture').dataset.camera"), camera);

    // Escape closes the help.
    focus("#picture");
    browser.press("?");
    browser.until("document.getElementById('help').open");
    browser.press("\u{E00C}");
    browser.until("!document.getElementById('help').open");
    assert_eq!(browser.complaints(), Vec::<String>::new());
}
