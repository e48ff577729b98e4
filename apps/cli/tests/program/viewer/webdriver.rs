//! A browser without a window, driven by WebDriver (W3C): chromedriver and Chromium, if they are
//! installed.

use crate::viewer::client::{Viewer, until};
use crate::viewer::socket::{MAX_ANSWER_TIME, ask};
use serde_json::{Value, json};
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// A browser; it ends with the value.
pub struct Browser {
    driver: Child,
    address: String,
    session: String,
}

impl Browser {
    /// Starts one that saves files in a folder; `None`, and says so, without chromedriver, which is
    /// a failure with `WM_REQUIRE_BROWSER=1`.
    pub fn start(downloads: &Path) -> Option<Self> {
        Self::start_with(downloads, &["--disable-gpu"])
    }

    /// Starts one whose WebGPU is a GPU in software.
    pub fn with_webgpu(downloads: &Path) -> Option<Self> {
        let options = [
            "--enable-unsafe-webgpu",
            "--enable-features=Vulkan,WebGPU",
            "--use-webgpu-adapter=swiftshader",
            "--use-angle=swiftshader",
        ];
        Self::start_with(downloads, &options)
    }

    fn start_with(downloads: &Path, options: &[&str]) -> Option<Self> {
        let started =
            Command::new("chromedriver").arg("--port=0").stdout(Stdio::piped()).stderr(Stdio::null()).spawn();
        let Ok(mut driver) = started else {
            assert!(
                std::env::var_os("WM_REQUIRE_BROWSER").is_none_or(|v| v != "1"),
                "no chromedriver: install chromium-driver"
            );
            println!("skipped: there is no chromedriver (Debian's chromium and chromium-driver)");
            return None;
        };
        let lines = BufReader::new(driver.stdout.take().unwrap()).lines();
        let port = lines.map_while(Result::ok).find_map(|line| {
            let (_, rest) = line.split_once("successfully on port ")?;
            rest.trim_end_matches('.').parse::<u16>().ok()
        });
        let mut browser =
            Self { driver, address: format!("127.0.0.1:{}", port.expect("a port")), session: String::new() };
        let usual = ["--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--window-size=1280,720"];
        let args = [&usual, options].concat();
        let options = json!({
            "args": args,
            "prefs": { "download.default_directory": downloads, "profile.default_content_setting_values.automatic_downloads": 1 },
        });
        let wanted = json!({ "goog:chromeOptions": options, "goog:loggingPrefs": { "browser": "ALL" } });
        let session = browser.post("/session", &json!({ "capabilities": { "alwaysMatch": wanted } }));
        browser.session = format!("/session/{}", session["sessionId"].as_str().unwrap());
        Some(browser)
    }

    fn command(&self, method: &str, path: &str, body: &[u8]) -> Value {
        let path = format!("{}{path}", self.session);
        let headers = [("Content-Type", "application/json"), ("Host", "localhost")];
        let (status, _, answer) = ask(&self.address, method, &path, &headers, body);
        let text = String::from_utf8_lossy(&answer);
        assert_eq!(status, 200, "{method} {path}: {text}");
        serde_json::from_str::<Value>(&text).unwrap()["value"].take()
    }

    fn post(&self, path: &str, body: &Value) -> Value {
        self.command("POST", path, body.to_string().as_bytes())
    }

    /// Opens the page of a viewer at the address that it printed.
    pub fn view(&self, viewer: &Viewer) {
        // From one fragment to another no page is loaded.
        self.post("/url", &json!({ "url": "about:blank" }));
        self.open_at(&viewer.address, &format!("#token={}", viewer.token));
    }

    /// Opens a page with a query and a fragment.
    pub fn open_at(&self, address: &str, rest: &str) {
        self.post("/url", &json!({ "url": format!("http://{address}/{rest}") }));
    }

    /// The value of a script's `return`.
    pub fn script(&self, script: &str) -> Value {
        self.post("/execute/sync", &json!({ "script": script, "args": [] }))
    }

    /// The text of an element by its name.
    pub fn text(&self, id: &str) -> String {
        let text = self.script(&format!("return document.getElementById('{id}').textContent"));
        text.as_str().unwrap().to_owned()
    }

    /// Waits until an expression of JavaScript is true.
    pub fn until(&self, expression: &str) {
        until(expression, || self.script(&format!("return Boolean({expression})")) == true);
    }

    /// Presses the mouse at a point of the window, moves it by steps, and lets go.
    pub fn drag(&self, from: (i32, i32), by: (i32, i32)) {
        let step = |x: i32, y: i32, duration: u32| json!({ "type": "pointerMove", "x": x, "y": y, "duration": duration });
        let actions = json!([
            step(from.0, from.1, 0),
            { "type": "pointerDown", "button": 0 },
            step(from.0 + by.0 / 2, from.1 + by.1 / 2, 60),
            step(from.0 + by.0, from.1 + by.1, 60),
            { "type": "pointerUp", "button": 0 },
        ]);
        let mouse = json!({ "type": "pointer", "id": "mouse", "parameters": { "pointerType": "mouse" }, "actions": actions });
        self.post("/actions", &json!({ "actions": [mouse] }));
    }

    /// Presses a key and lets it go; keys without a letter have their code of WebDriver.
    pub fn press(&self, key: &str) {
        let actions = json!([{ "type": "keyDown", "value": key }, { "type": "keyUp", "value": key }]);
        self.post("/actions", &json!({ "actions": [{ "type": "key", "id": "keys", "actions": actions }] }));
    }

    /// A command of Chromium's own protocol.
    pub fn chromium(&self, command: &str, params: Value) -> Value {
        self.post("/goog/cdp/execute", &json!({ "cmd": command, "params": params }))
    }

    /// Returns the console's new warnings and errors since the last call.
    pub fn complaints(&self) -> Vec<String> {
        let log = self.post("/se/log", &json!({ "type": "browser" }));
        let is_bad = |line: &&Value| matches!(line["level"].as_str(), Some("SEVERE" | "WARNING"));
        let lines = log.as_array().into_iter().flatten();
        lines.filter(is_bad).map(|line| line["message"].as_str().unwrap_or_default().to_owned()).collect()
    }

    /// Waits for the whole picture, and returns it as text.
    pub fn picture(&self) -> String {
        self.picture_within(MAX_ANSWER_TIME)
    }

    /// Waits for the whole picture for so long; fails at once if the page says that it failed.
    pub fn picture_within(&self, patience: Duration) -> String {
        let start = Instant::now();
        let whole = "const c = document.getElementById('picture'); \
            return c.dataset.whole === 'true' && c.dataset.settled === 'true' ? c.toDataURL() : null";
        loop {
            if let Some(picture) = self.script(whole).as_str() {
                return picture.to_owned();
            }
            if start.elapsed() > patience || self.script("return document.body.dataset.failed").is_string() {
                let shown = "return JSON.stringify([document.getElementById('picture').dataset, document.body.dataset, \
                    document.getElementById('veil').textContent, document.getElementById('status')?.textContent])";
                panic!("no whole picture: {} {:?}", self.script(shown), self.complaints());
            }
            std::thread::sleep(Duration::from_millis(30));
        }
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        // A failed test must not fail again here.
        if !std::thread::panicking() {
            self.command("DELETE", "", b"");
        }
        let _ = self.driver.kill();
        let _ = self.driver.wait();
    }
}
