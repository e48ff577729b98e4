//! Makes a capture of a folder of photos with the COLMAP that is installed, and says what came out.
//!
//! `cargo run --release -p wm-train --example reconstruct_photos -- PHOTOS RUN_FOLDER`

use std::path::Path;
use wm_scene::capture::{self, CaptureOptions};
use wm_train::colmap::{ColmapOptions, reconstruct};

fn main() {
    if let Err(error) = run() {
        eprintln!("{error}");
        std::process::exit(1);
    }
}

fn run() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [photos, run] = &arguments[..] else { return Err("which photos, and into which folder?".into()) };
    let mut progress = |at: wm_train::colmap::ColmapProgress| {
        let total = at.total.map(|total| format!(" of {total}")).unwrap_or_default();
        println!("{}: {}{total}", at.step.name(), at.done);
    };
    let options = ColmapOptions::default();
    let made = reconstruct(Path::new(photos), Path::new(run), &options, &mut progress, &|| false)?;
    let capture = capture::read(&made.dataset, &CaptureOptions::default())?;
    let (registered, all, dataset) = (made.registered, made.photos, made.dataset.display());
    println!("{registered} of {all} photos, {} points: {dataset}", capture.points.len());
    Ok(())
}
