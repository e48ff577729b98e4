//! Reading and writing scene files of every format: splats and megabytes a second, best of several.
//! The first reading is told apart, since it alone pays for fresh pages of memory.
//! `tests/peers/formats.py` has the times of others.
//!
//! `cargo bench -p wm-scene --bench formats [-- scene.ply ...]`; without a file, random scenes of
//! SH degree 0 and 3 are made. Run as a test it uses small ones.

use std::{
    path::{Path, PathBuf},
    time::Instant,
};
use wm_scene::{
    Scene,
    formats::{FORMATS, ReadOptions, read_scene, write_scene},
    synthetic::rippled,
};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let measured = arguments.iter().any(|a| a == "--bench");
    let mut files: Vec<PathBuf> =
        arguments.iter().filter(|a| !a.starts_with('-')).map(PathBuf::from).collect();
    let folder = tempfile::tempdir()?;
    let folder = folder.path();
    if files.is_empty() {
        for degree in [0, 3] {
            let path = folder.join(format!("random-degree-{degree}.ply"));
            let splats = rippled(if measured { 300_000 } else { 1000 }, degree);
            write_scene(&path, &Scene { splats, ..Scene::default() })?;
            files.push(path);
        }
    }
    let rounds = if measured { 5 } else { 1 };
    for file in &files {
        let scene = read_scene(file, &ReadOptions::default())?;
        let name = file.file_name().unwrap_or_default().to_string_lossy();
        println!("{name}: {} splats, SH degree {}", scene.splats.len(), scene.splats.sh_degree);
        for ending in FORMATS.iter().filter_map(|format| format.extensions.first()) {
            let written = if ending.contains(".json") {
                folder.join("sog").join(ending)
            } else {
                folder.join(format!("a.{ending}"))
            };
            // Packing takes longer than reading.
            measure(&scene, &written, ending, rounds)?;
        }
    }
    Ok(())
}

fn measure(scene: &Scene, file: &Path, ending: &str, rounds: u32) -> Result<(), Box<dyn std::error::Error>> {
    let (mut reading, mut writing) = (f64::INFINITY, f64::INFINITY);
    let mut first = None;
    for _ in 0..rounds {
        let start = Instant::now();
        write_scene(file, scene)?;
        writing = writing.min(start.elapsed().as_secs_f64());
        let start = Instant::now();
        read_scene(file, &ReadOptions::default())?;
        let seconds = start.elapsed().as_secs_f64();
        first.get_or_insert(seconds);
        reading = reading.min(seconds);
    }
    let folder = file.parent().filter(|_| ending.contains(".json"));
    let files = folder.map_or(Ok(vec![file.to_owned()]), |folder| {
        std::fs::read_dir(folder)?.map(|entry| Ok(entry?.path())).collect::<std::io::Result<Vec<_>>>()
    })?;
    let bytes = files.iter().map(|file| Ok(std::fs::metadata(file)?.len())).sum::<std::io::Result<u64>>()?;
    let (megabytes, millions) = (bytes as f64 / 1e6, scene.splats.len() as f64 / 1e6);
    println!(
        "  {ending:15} {megabytes:6.1} MB, read {:5.2} M splats/s, {:5.0} MB/s (first {:.0}), write {:5.2} M splats/s, {:5.0} MB/s",
        millions / reading,
        megabytes / reading,
        megabytes / first.unwrap_or(reading),
        millions / writing,
        megabytes / writing
    );
    Ok(())
}
