//! Sends requests from the edges of every range to a running viewer, in any order, while a page
//! looks at the scene: all are answered, and the page keeps its pictures.
//!
//! `cargo run --release --example fuzz_viewer -- 'http://127.0.0.1:8787/#token=...' [REQUESTS] [PID of the viewer, for its memory]`
//!
//! The page asks for pictures all the time; after each round of requests, when the facts of the
//! scene are what they were, its picture must have the same bytes as before the first. Fails if a
//! request has no answer, or one of several lines, if an answer says that the program panicked, or
//! if the page gets other bytes. Request K is the same every time.

#[path = "fuzz_readers/damage.rs"]
mod damage;
#[path = "fuzz_readers/edges.rs"]
mod edges;
#[path = "../tests/program/viewer/running.rs"]
mod running;
#[path = "../tests/program/viewer/socket.rs"]
mod socket;

use damage::Draws;
use running::{address_and_token, mebibytes};
use serde_json::{Value, json};
use socket::{Socket, SocketEvent, ask};
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;
use wm_viewer::state::weather_to_json;

/// Requests between two looks at the page's own picture.
const REQUESTS_PER_ROUND: u64 = 250;

/// Numbers at and beyond the edges of what requests may say.
const EXTREME_NUMBERS: [f64; 22] = [
    0.0, -0.0, 1.0, -1.0, 0.5, 3.0, 50.0, 0.1, 170.0, 179.9, 1e-3, 1e-6, 1e3, 1e6, 1e10, -1e10, 1.1e10, 1e20,
    1e300, -1e300, 1e-300, 5e-324,
];

/// A request: method, path and body.
struct Request {
    method: &'static str,
    path: String,
    body: Vec<u8>,
}

/// A page's time to a picture, in requests that come at the same time as others.
#[derive(Default)]
struct PageTimes {
    seconds: Vec<f64>,
    failed: u32,
}

fn main() {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let printed = words.first().expect("the address that a viewer printed");
    let (address, token) = address_and_token(printed).expect("an address with a token");
    let bearer = format!("Bearer {token}");
    let headers = [("Authorization", bearer.as_str())];
    let count: u64 = words.get(1).map_or(1000, |word| word.parse().expect("a number"));
    let pid = words.get(2).map_or(0, |word| word.parse().expect("a number"));
    let (status, _, state) = ask(&address, "GET", "/state", &headers, b"");
    assert_eq!(status, 200, "no viewer with a scene at {address}");
    let state: Value = serde_json::from_slice(&state).expect("JSON");

    // A viewer that was killed has left facts that were not saved.
    let undo = json!({ "action": "undo" }).to_string();
    assert_eq!(ask(&address, "POST", "/facts", &headers, undo.as_bytes()).0, 200, "facts can be undone");
    let expected = still_picture(&address, &headers, &state);
    let (mut statuses, mut slowest) = (BTreeMap::<u16, u64>::new(), (0.0, 0));
    let (mut failures, mut times) = (Vec::new(), PageTimes::default());
    let mut internal = BTreeMap::<String, u64>::new();
    let mut begun_videos = Vec::<u64>::new();
    let memory = |name: &str| mebibytes(pid, name).unwrap_or(f64::NAN);
    let begun = Instant::now();
    for first in (0..count).step_by(REQUESTS_PER_ROUND as usize) {
        let is_over = AtomicBool::new(false);
        std::thread::scope(|scope| {
            let page = scope.spawn(|| look(&address, &headers, &state, &is_over));
            for run in first..(first + REQUESTS_PER_ROUND).min(count) {
                let request = request(run, &state);
                let start = Instant::now();
                let (status, _, said) = ask(&address, request.method, &request.path, &headers, &request.body);
                let seconds = start.elapsed().as_secs_f64();
                if seconds > slowest.0 {
                    slowest = (seconds, run);
                }
                *statuses.entry(status).or_default() += 1;
                if status == 200 && request.path == "/videos" {
                    let video: Value = serde_json::from_slice(&said).expect("JSON");
                    begun_videos.extend(video["id"].as_u64());
                }
                let text = String::from_utf8_lossy(&said);
                let is_line = text.trim_end().lines().count() <= 1 && said.len() < 2000;
                if status == 0 || (status >= 400 && !is_line) || text.contains("panicked") {
                    failures
                        .push(format!("request {run}, {} {}: {status} {text}", request.method, request.path));
                } else if status == 500 {
                    *internal.entry(text.chars().filter(|c| !c.is_ascii_digit()).collect()).or_default() += 1;
                }
            }
            is_over.store(true, Ordering::Relaxed);
            let got = page.join().expect("a page");
            times.seconds.extend(got.seconds);
            times.failed += got.failed;
        });
        for id in begun_videos.drain(..) {
            if ask(&address, "DELETE", &format!("/videos/{id}"), &headers, b"").0 == 0 {
                failures.push("a video cannot be stopped".into());
            }
        }
        let (status, ..) = ask(&address, "POST", "/facts", &headers, undo.as_bytes());
        if status != 200 {
            failures.push(format!(
                "after request {}: facts cannot be undone: {status}",
                first + REQUESTS_PER_ROUND
            ));
        } else if still_picture(&address, &headers, &state) != expected {
            failures
                .push(format!("after request {}: the page has another picture", first + REQUESTS_PER_ROUND));
        }
        if first % (40 * REQUESTS_PER_ROUND) == 0 {
            let seconds = begun.elapsed().as_secs_f64();
            eprintln!("{first} requests, {seconds:.0} s, {:.0} MiB", memory("VmRSS"));
        }
        if failures.len() > 20 {
            break;
        }
    }
    times.seconds.sort_by(f64::total_cmp);
    let quantile =
        |share: f64| times.seconds.get((times.seconds.len() as f64 * share) as usize).unwrap_or(&f64::NAN);
    println!(
        "{count} requests, answers by status {statuses:?}; slowest {:.1} s (request {})",
        slowest.0, slowest.1
    );
    println!(
        "the page: {} pictures, {} refused, {:.0} ms in the median, {:.0} ms at 99 %, {:.1} s at most; memory {:.0} MiB, {:.0} MiB at most",
        times.seconds.len(),
        times.failed,
        quantile(0.5) * 1e3,
        quantile(0.99) * 1e3,
        times.seconds.last().unwrap_or(&f64::NAN),
        memory("VmRSS"),
        memory("VmHWM")
    );
    internal.iter().for_each(|(text, count)| println!("500, {count} times: {text}"));
    failures.iter().for_each(|failure| println!("FAILED: {failure}"));
    assert!(failures.is_empty(), "{} failures", failures.len());
}

/// The state that the page looks at.
fn page_state(state: &Value) -> Value {
    let weather = json!({ "name": "mine", "fog": { "mor": 300 }, "rain": { "rate": 10 } });
    json!({ "camera": state["camera"], "weather": weather, "time": 2, "size": [64, 48], "follow": "camera",
            "path": [], "output": "rgb", "divider": null, "lidar": null, "quality": 90 })
}

fn still_picture(address: &str, headers: &[(&str, &str)], state: &Value) -> Vec<u8> {
    let mut page = Socket::open(address, headers).expect("a page may be opened");
    page.view(1, false, &page_state(state));
    page.whole().1
}

/// Asks for pictures as a page does, until the others are done.
fn look(address: &str, headers: &[(&str, &str)], state: &Value, is_over: &AtomicBool) -> PageTimes {
    let mut page = Socket::open(address, headers).expect("a page may be opened");
    let mut times = PageTimes::default();
    for seq in 1.. {
        if is_over.load(Ordering::Relaxed) {
            break;
        }
        let start = Instant::now();
        page.view(seq, false, &page_state(state));
        loop {
            match page.next() {
                SocketEvent::Picture(head, _) => {
                    page.say(&json!({ "type": "seen", "seq": head["seq"] }));
                    if head["seq"] == seq && head["whole"] == true {
                        break;
                    }
                }
                SocketEvent::Word(word) if word["type"] == "error" => {
                    times.failed += 1;
                    break;
                }
                SocketEvent::Word(_) => {}
                SocketEvent::Closed => panic!("the viewer closed the page"),
            }
        }
        times.seconds.push(start.elapsed().as_secs_f64());
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    times
}

/// Returns request `run`; a third of the bodies are damaged.
fn request(run: u64, state: &Value) -> Request {
    let mut draws = Draws::new(run);
    let mut request = whole_request(&mut draws, state);
    if draws.below(3) == 0 {
        request.body = damage::damage(&request.body, b"{\"a\": 1}", &mut draws);
    }
    request
}

fn whole_request(draws: &mut Draws, state: &Value) -> Request {
    let post = |path: &str, body: Value| Request {
        method: "POST",
        path: path.into(),
        body: body.to_string().into_bytes(),
    };
    let get = |path: String| Request { method: "GET", path, body: Vec::new() };
    match draws.below(14) {
        0 => Request { method: "PUT", path: "/state".into(), body: patch(draws, state).to_string().into() },
        1 => {
            let key = draws.pick(&["time", "fov", "quality", "divider", "size", "output", "camera", "set"]);
            let [a, b, c] = point(draws);
            let value = match key {
                "size" => draws.pick(&["64x48", "1x1", "0x0", "4097x1", "99999999999x1", "x"]).to_owned(),
                "output" => draws.pick(&["rgb", "depth", "normal", "alpha", "\u{1b}"]).to_owned(),
                "camera" => format!("{a},{b},{c}:{},0,1", draws.pick(&EXTREME_NUMBERS)),
                "set" => format!("rain.rate={a}"),
                _ => a.to_string(),
            };
            get(format!("/frame?size=64x48&{key}={value}"))
        }
        2 => {
            let [x, y, _] = point(draws);
            post("/surface", json!({ "state": patch(draws, state), "x": x, "y": y }))
        }
        3..=5 => post("/facts", facts(draws)),
        6 => Request {
            method: "POST",
            path: "/weather".into(),
            body: include_bytes!("fuzz_readers/seeds/weather.toml").to_vec(),
        },
        7 => post("/link", patch(draws, state)),
        8 => {
            let numbers: Vec<String> = (0..8).map(|_| draws.pick(&EXTREME_NUMBERS).to_string()).collect();
            Request {
                method: "POST",
                path: "/unlink".into(),
                body: format!("v=1&w=4ysoyk_OTgQA&c={}&t=1", numbers.join(",")).into(),
            }
        }
        9 | 10 => {
            let kind =
                draws.pick(&["picture", "weather", "camera", "command", "points", "scan", "..", "%00"]);
            post(&format!("/files/{kind}"), patch(draws, state))
        }
        11 => post(
            "/videos",
            json!({ "state": patch(draws, state), "fps": draws.pick(&EXTREME_NUMBERS), "seconds": draws.pick(&[0.1, 0.0, -1.0, 1e9, 1e300]) }),
        ),
        12 => {
            let id = draws.pick(&["0", "1", "2", "-1", "99999999999", "x"]);
            let method = draws.pick(&["GET", "DELETE"]);
            let file = if method == "GET" { draws.pick(&["", "/file"]) } else { "" };
            Request { method, path: format!("/videos/{id}{file}"), body: Vec::new() }
        }
        _ => get(draws
            .pick(&["/parameters", "/state", "/thumbnails/fog", "/thumbnails/%2e%2e", "/no", "/ws"])
            .into()),
    }
}

fn point(draws: &mut Draws) -> [f64; 3] {
    // Two of three are usual, so that one edge is met at a time.
    let is_usual = draws.below(3) > 0;
    std::array::from_fn(|_| {
        if is_usual { draws.pick(&[-2.0, 0.0, 0.5, 1.0, 3.0]) } else { draws.pick(&EXTREME_NUMBERS) }
    })
}

/// Some fields of a state, small enough to be drawn often.
fn patch(draws: &mut Draws, state: &Value) -> Value {
    let mut patch = json!({ "size": [64, 48] });
    let eye = point(draws);
    if draws.below(2) == 0 {
        patch["camera"] = json!({ "eye": eye, "rotation": state["camera"]["rotation"], "fov": draws.pick(&EXTREME_NUMBERS) });
    }
    if draws.below(3) == 0
        && let Ok(weather) = edges::weather_at_edges(draws)
    {
        patch["weather"] = weather_to_json(&weather);
    }
    if draws.below(3) == 0 {
        patch["time"] = json!(draws.pick(&EXTREME_NUMBERS));
    }
    if draws.below(6) == 0 {
        patch["divider"] = json!(draws.pick(&[0.0, 0.5, 1.0, 1.1, 1e300]));
    }
    if draws.below(6) == 0 {
        patch["output"] = json!(draws.pick(&["rgb", "depth", "normal", "alpha", "none"]));
    }
    if draws.below(6) == 0 {
        let at = json!({ "eye": point(draws), "target": point(draws) });
        patch["lidar"] = json!({ "model": draws.pick(&["vlp-16", "os1-64", "none"]), "at": at });
    }
    if draws.below(6) == 0 {
        let key = |draws: &mut Draws| json!({ "time": draws.pick(&EXTREME_NUMBERS), "eye": point(draws), "rotation": [1, 0, 0, 0], "fov": 50 });
        patch["path"] = json!([key(draws), key(draws)]);
        patch["follow"] = json!("path");
    }
    if draws.below(40) == 0 {
        patch["size"] = json!([draws.pick(&[0, 1, 1000, 4096, 5000]), draws.pick(&[1, 64, 4096])]);
    }
    patch
}

fn facts(draws: &mut Draws) -> Value {
    let (a, b, c) = (point(draws), point(draws), point(draws));
    match draws.below(9) {
        0 => json!({ "action": "ground", "points": [a, b, c] }),
        1 => json!({ "action": "scale", "points": [a, b], "metres": draws.pick(&EXTREME_NUMBERS) }),
        2 => json!({ "action": "flip" }),
        3 | 4 => json!({ "action": "lamp", "point": a }),
        5 => json!({ "action": "window", "points": [a, b], "eye": c }),
        6 => json!({ "action": "dark" }),
        7 => json!({ "action": "sun", "points": [a, b] }),
        _ => json!({ "action": draws.pick(&["clouds", "undo", "none"]) }),
    }
}
