//! Measures how long the photos of a capture take to open and to decode, and how much memory stays
//! in use.
//!
//! `cargo run --release -p wm-train --example photo_times -- DATASET [LONGEST_SIDE]`

use std::{path::Path, time::Instant};
use wm_scene::capture::{self, CaptureOptions};
use wm_train::photos::{PhotoOptions, PhotoSize, Photos};

fn main() {
    if let Err(error) = run() {
        eprintln!("{error}");
        std::process::exit(1);
    }
}

fn run() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let dataset = arguments.next().ok_or("which data set?")?;
    let longest = arguments.next().map(|side| side.parse()).transpose()?;
    let start = Instant::now();
    let capture = capture::read(Path::new(&dataset), &CaptureOptions::default())?;
    println!(
        "model: {} views, {} points, {:.3} s",
        capture.views.len(),
        capture.points.len(),
        seconds(start)
    );
    let size = longest.map_or(PhotoSize::Full, PhotoSize::Longest);
    let start = Instant::now();
    let photos = Photos::open(&capture, &PhotoOptions { size, ..PhotoOptions::default() })?;
    println!("headers: {:.3} s; {}", seconds(start), memory());
    let count = photos.len().min(200);
    let start = Instant::now();
    for index in 0..count {
        photos.get(index, 0)?;
    }
    let each = 1000.0 * seconds(start) / count as f64;
    println!("decode: {each:.2} ms each on one thread; {} bytes cached; {}", photos.cached_bytes(), memory());
    Ok(())
}

fn seconds(start: Instant) -> f64 {
    start.elapsed().as_secs_f64()
}

/// Memory of this process, where Linux says it.
fn memory() -> String {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find(|line| line.starts_with("VmHWM"));
    line.map_or_else(
        || "memory not known".into(),
        |line| line.split_whitespace().collect::<Vec<_>>().join(" "),
    )
}
