//! Measures a running viewer: pictures a second that pages get while their camera goes round, and
//! how long a whole picture takes.
//!
//! `cargo run --release --example drive_viewer -- 'http://127.0.0.1:8787/#token=...' [PAGES] [SECONDS] [PID of the viewer, for its CPU time and memory]`

#[path = "../tests/program/viewer/running.rs"]
mod running;
#[path = "../tests/program/viewer/socket.rs"]
mod socket;

use running::{address_and_token, mebibytes};
use serde_json::{Value, json};
use socket::{Socket, SocketEvent, ask};
use std::time::{Duration, Instant};

/// The frames that a page received.
#[derive(Debug, Default)]
struct ReceivedFrames {
    pictures: u32,
    pixels: f64,
    bytes: f64,
    /// From the wish to the picture, s.
    waits: Vec<f64>,
    /// Till the whole picture when it stood still, s.
    whole: f64,
}

fn main() {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let number =
        |at: usize, default: u64| words.get(at).map_or(default, |word| word.parse().expect("a number"));
    let printed = words.first().expect("the address that a viewer printed");
    let (address, token) = address_and_token(printed).expect("an address with a token");
    let bearer = format!("Bearer {token}");
    let headers = [("Authorization", bearer.as_str())];
    let (pages, seconds) = (number(1, 1), number(2, 10));
    let pid = words.get(3).map_or(0, |word| word.parse().expect("a number"));
    let (status, _, parameters) = ask(&address, "GET", "/parameters", &headers, b"");
    assert_eq!(status, 200, "no viewer with a scene at {address}");
    let parameters: Value = serde_json::from_slice(&parameters).expect("JSON");
    let (cpu, started) = (cpu_seconds(pid), Instant::now());
    let got: Vec<ReceivedFrames> = std::thread::scope(|scope| {
        let all: Vec<_> = (0..pages).map(|page| (page, &address, &parameters)).collect();
        let all = all.into_iter().map(|(page, address, parameters)| {
            scope.spawn(move || drive(address, &headers, parameters, page, seconds))
        });
        all.collect::<Vec<_>>().into_iter().map(|page| page.join().expect("a page")).collect()
    });
    let wall = started.elapsed().as_secs_f64();
    for (page, mut got) in got.into_iter().enumerate() {
        got.waits.sort_by(f64::total_cmp);
        let pictures = f64::from(got.pictures.max(1));
        println!(
            "page {page}: {:.1} pictures a second, {:.0} px wide in the mean (3:2), {:.0} kB each, {:.0} ms from wish to picture (median), \
             whole picture {:.0} ms after the last wish",
            f64::from(got.pictures) / seconds as f64,
            (got.pixels / pictures * 1.5).sqrt(),
            got.bytes / pictures / 1e3,
            got.waits.get(got.waits.len() / 2).unwrap_or(&f64::NAN) * 1e3,
            got.whole * 1e3
        );
    }
    if pid > 0 {
        let cores = (cpu_seconds(pid) - cpu) / wall;
        println!(
            "the viewer took {cores:.2} cores in the mean, and has {:.0} MiB",
            mebibytes(pid, "VmRSS").unwrap_or(f64::NAN)
        );
    }
}

/// A page whose camera turns to and fro at 60 wishes a second.
fn drive(
    address: &str,
    headers: &[(&str, &str)],
    parameters: &Value,
    page: u64,
    seconds: u64,
) -> ReceivedFrames {
    let mut socket = Socket::open(address, headers).expect("a page may be opened");
    let mut send = Socket { stream: socket.stream.try_clone().expect("a second handle") };
    let start = parameters["state"]["camera"].clone();
    let turned = move |seq: u64| {
        let angle = 0.15 * (seq as f64 / 60.0 + page as f64).sin() / 2.0;
        let r: Vec<f64> = start["rotation"]
            .as_array()
            .expect("wxyz")
            .iter()
            .map(|v| v.as_f64().expect("a number"))
            .collect();
        // About the camera's own down.
        let (c, s) = (angle.cos(), angle.sin());
        let rotation = [c * r[0] - s * r[2], c * r[1] + s * r[3], c * r[2] + s * r[0], c * r[3] - s * r[1]];
        json!({ "camera": { "eye": start["eye"], "rotation": rotation, "fov": start["fov"] }, "size": [1200, 800] })
    };
    let begun = Instant::now();
    let mut got = ReceivedFrames::default();
    std::thread::scope(|scope| {
        scope.spawn(move || {
            let mut seq = 0;
            while begun.elapsed() < Duration::from_secs(seconds) {
                seq += 1;
                send.view(seq, true, &turned(seq));
                std::thread::sleep(
                    (begun + Duration::from_secs_f64(seq as f64 / 60.0))
                        .saturating_duration_since(Instant::now()),
                );
            }
            send.view(seq + 1, false, &json!({}));
        });
        loop {
            let (head, jpeg) = match socket.next() {
                SocketEvent::Picture(head, jpeg) => (head, jpeg),
                SocketEvent::Word(_) => continue,
                SocketEvent::Closed => panic!("the viewer closed the page"),
            };
            socket.say(&json!({ "type": "seen", "seq": head["seq"] }));
            if head["whole"] == true {
                got.whole = begun.elapsed().as_secs_f64() - seconds as f64;
                return;
            }
            let side = |name: &str| head[name].as_f64().expect("a number");
            got.pictures += 1;
            got.pixels += side("width") * side("height");
            got.bytes += jpeg.len() as f64;
            got.waits.push(begun.elapsed().as_secs_f64() - (side("seq") - 1.0) / 60.0);
        }
    });
    got
}

/// CPU time of a process; 0 where the system does not tell.
fn cpu_seconds(pid: u32) -> f64 {
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
    let fields: Vec<&str> = stat.rsplit(')').next().unwrap_or_default().split_whitespace().collect();
    // Of users and of the system, in hundredths of a second.
    [11, 12].iter().filter_map(|at| fields.get(*at)?.parse::<f64>().ok()).sum::<f64>() / 100.0
}
