//! The viewer as a process.

use crate::common::{binary, run};
use crate::viewer::running::{address_and_token, mebibytes};
use crate::viewer::socket::{MAX_ANSWER_TIME, Socket, ask};
use serde_json::Value;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// A viewer that runs; it ends with the value.
pub struct Viewer {
    child: Child,
    /// `127.0.0.1:PORT`.
    pub address: String,
    /// The token that it printed.
    pub token: String,
}

impl Viewer {
    /// Shows a scene of the yard.
    pub fn of(scene: &Path, options: &[&str]) -> Self {
        Self::run(Self::command(scene, options))
    }

    /// Shows a scene of the yard with a token that does not change from one start to the next.
    pub fn with_token(scene: &Path, options: &[&str], token: &str) -> Self {
        let mut command = Self::command(scene, options);
        command.env("WEATHER_MAGICIAN_TOKEN", token);
        Self::run(command)
    }

    fn command(scene: &Path, options: &[&str]) -> Command {
        let mut command = binary();
        command.arg("view").arg(scene).args(["--device=cpu", "--size=96x64"]).args(options);
        command
    }

    /// Runs a command that prints an address.
    pub fn run(mut command: Command) -> Self {
        let mut child = command.stdout(Stdio::piped()).spawn().expect("the binary starts");
        let lines = BufReader::new(child.stdout.take().unwrap()).lines();
        let line = lines.map_while(Result::ok).find(|line| line.contains("http://"));
        let line = line.expect("it prints an address");
        let (address, token) = address_and_token(&line).expect("the address has the token");
        Self { child, address, token }
    }

    /// Waits until the scene is read.
    pub fn loaded(self) -> Self {
        until("the scene is read", || self.get("/state").0 == 200);
        self
    }

    /// The number of its process.
    pub fn id(&self) -> u32 {
        self.child.id()
    }

    /// Returns the exit status, within the time limit of the tests.
    pub fn ended(&mut self) -> std::process::ExitStatus {
        until("it ends", || self.child.try_wait().unwrap().is_some());
        self.child.wait().unwrap()
    }

    /// Status and body of a request with the token.
    pub fn ask(&self, method: &str, path: &str, headers: &[(&str, &str)], body: &[u8]) -> (u16, Vec<u8>) {
        let bearer = self.bearer();
        let headers = [headers, &[("Authorization", bearer.as_str())]].concat();
        let (status, _, body) = ask(&self.address, method, path, &headers, body);
        (status, body)
    }

    /// The header `Authorization` with the token.
    pub fn bearer(&self) -> String {
        format!("Bearer {}", self.token)
    }

    /// Opens a WebSocket with the token; the status that it was refused with otherwise.
    pub fn socket(&self, headers: &[(&str, &str)]) -> Result<Socket, u16> {
        let bearer = self.bearer();
        Socket::open(&self.address, &[headers, &[("Authorization", bearer.as_str())]].concat())
    }

    /// [`Self::ask`] without headers and body, by GET.
    pub fn get(&self, path: &str) -> (u16, Vec<u8>) {
        self.ask("GET", path, &[], b"")
    }

    /// A request that is answered with JSON.
    pub fn json(&self, method: &str, path: &str, body: &Value) -> Value {
        let (status, answer) = self.ask(method, path, &[], body.to_string().as_bytes());
        assert_eq!(status, 200, "{method} {path}: {}", String::from_utf8_lossy(&answer));
        serde_json::from_slice(&answer).unwrap()
    }

    /// Sends a request that must be refused with one short line that holds `says`.
    pub fn refuses(&self, method: &str, path: &str, body: &str, says: &str) -> String {
        let (status, text) = self.ask(method, path, &[], body.as_bytes());
        let text = String::from_utf8(text).unwrap();
        let is_line = text.trim().lines().count() == 1 && text.len() < 600;
        assert!(
            status == 400 && is_line && text.contains(says),
            "{method} {path} {body:.80}: {status} {text}"
        );
        text
    }

    /// Saves a kind of file of a state.
    pub fn file(&self, kind: &str, state: &Value) -> Vec<u8> {
        let (status, answer) = self.ask("POST", &format!("/files/{kind}"), &[], state.to_string().as_bytes());
        assert_eq!(status, 200, "{kind}: {}", String::from_utf8_lossy(&answer));
        answer
    }

    /// Runs the printed `render` command on the files saved from a state, and returns its picture.
    pub fn rendered(&self, state: &Value, folder: &Path) -> std::path::PathBuf {
        let command = String::from_utf8(self.file("command", state)).unwrap();
        let words: Vec<&str> = command.split_whitespace().collect();
        let option = |name: &str| {
            words.iter().find_map(|word| word.strip_prefix(&format!("--{name}=")).map(str::to_owned))
        };
        std::fs::create_dir_all(folder).unwrap();
        std::fs::write(folder.join(option("weather").unwrap()), self.file("weather", state)).unwrap();
        let camera = option("camera").or(option("path")).unwrap();
        std::fs::write(folder.join(camera), self.file("camera", state)).unwrap();
        rendered(&command, folder)
    }

    /// Memory that it has, MiB.
    pub fn memory(&self) -> f64 {
        mebibytes(self.id(), "VmRSS").expect("the system tells it")
    }
}

impl Drop for Viewer {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Runs a command that the viewer printed on files in a folder; returns the picture, the video or
/// the points.
pub fn rendered(command: &str, folder: &Path) -> std::path::PathBuf {
    let mut out = None;
    let mut words = Vec::new();
    for word in command.split_whitespace().skip(1) {
        let is_file = |name: &str| word.starts_with(&format!("--{name}="));
        let is_place = is_file("at") && !word.ends_with(".json");
        if ["weather", "camera", "path", "at", "out"].iter().any(|name| is_file(name)) && !is_place {
            let (option, name) = word.split_once('=').unwrap();
            words.push(format!("{option}={}", folder.join(name).display()));
            out = (option == "--out").then(|| folder.join(name)).or(out);
        } else {
            words.push(word.to_owned());
        }
    }
    run(&words);
    out.unwrap()
}

/// Waits until something holds.
pub fn until(what: &str, mut holds: impl FnMut() -> bool) {
    let end = Instant::now() + MAX_ANSWER_TIME;
    while !holds() {
        assert!(Instant::now() < end, "too long until {what}");
        std::thread::sleep(Duration::from_millis(20));
    }
}
