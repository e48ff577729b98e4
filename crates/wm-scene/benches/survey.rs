//! Surveying a scene: milliseconds on one core, best of several.
//!
//! `cargo bench -p wm-scene --bench survey [-- scene.ply ...]`; without a file, made-up places are
//! surveyed. Run as a test it does so once.

use std::{path::PathBuf, time::Instant};
use wm_scene::{
    Metadata, Scene,
    formats::{ReadOptions, read_scene},
    survey::{Survey, label_sky},
    synthetic,
};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let rounds = if arguments.iter().any(|a| a == "--bench") { 10 } else { 1 };
    let mut scenes = Vec::new();
    for path in arguments.iter().filter(|a| !a.starts_with('-')).map(PathBuf::from) {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        scenes.push((name, read_scene(&path, &ReadOptions::default())?));
    }
    if scenes.is_empty() {
        let places = [("street", synthetic::street(1)), ("village", synthetic::aerial(1))];
        let scene = |place: synthetic::Builder| Scene { splats: place.build(), ..Scene::default() };
        scenes.extend(places.map(|(name, place)| (name.to_owned(), scene(place))));
    }
    for (name, scene) in &scenes {
        let (mut surveying, mut labelling) = (f64::INFINITY, f64::INFINITY);
        for _ in 0..rounds {
            let start = Instant::now();
            let _ = Survey::of(scene, &Metadata::default());
            surveying = surveying.min(start.elapsed().as_secs_f64());
            let mut splats = scene.splats.clone();
            let start = Instant::now();
            label_sky(&mut splats);
            labelling = labelling.min(start.elapsed().as_secs_f64());
        }
        let (count, surveying, labelling) = (scene.splats.len(), surveying * 1e3, labelling * 1e3);
        println!("{name}: {count} splats, survey {surveying:.0} ms, sky alone {labelling:.0} ms");
    }
    Ok(())
}
