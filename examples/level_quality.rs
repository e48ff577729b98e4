//! Measures levels of detail: builds them for a scene, and compares pictures of a cut with pictures
//! of all splats.
//!
//! ```text
//! cargo run --release --example level_quality -- SCENE|street|park OUT/lod-meta.json [SHARE] [LEAF_SPLATS] [TURN]
//! ```
//!
//! SHARE is that of the splats which a picture draws, 0.25 if not given; TURN turns all views about
//! up, degrees. A row a view: PSNR in dB, relative error of the expected depth in percent, mean
//! difference of alpha; the splats that are drawn and those that are held; the milliseconds that
//! the picture takes with its looks, and again without. The cut is the program's own. `all` are the
//! splats of the files at the finest level, so that the rounding of SOG counts on neither side.
//! With the variable PICTURES, a folder, pictures are written there.

use glam::{DMat3, DMat4, DVec3};
use std::error::Error;
use std::path::Path;
use std::time::Instant;
use weather_magician::levels::{LevelBudget, LevelBuilder, LevelOptions};
use weather_magician::view::{ViewOptions, choose};
use weather_magician::{
    Camera, FrameRequest, Layers, LevelCounts, Metadata, Picture, PlaceOptions, Renderer, Scene, Weather,
};
use wm_render::{Background, Frame};
use wm_scene::Group;
use wm_scene::formats::DetailLevel;
use wm_scene::levels::LevelIndex;
use wm_scene::survey::{Survey, label_sky};
use wm_street::{Park, Street};

/// Size of the pictures, px.
const SIZE: (u32, u32) = (960, 640);

fn main() -> Result<(), Box<dyn Error>> {
    let args: Vec<String> = std::env::args().collect();
    let [_, scene, out, rest @ ..] = &args[..] else {
        return Err(
            "usage: level_quality SCENE|street|park OUT/lod-meta.json [SHARE] [LEAF_SPLATS] [TURN]".into()
        );
    };
    let share: f64 = rest.first().map_or(Ok(0.25), |text| text.parse())?;
    let defaults = LevelOptions::default();
    let leaf_splats: usize = rest.get(1).map_or(Ok(defaults.leaf_splats), |text| text.parse())?;
    let turn: f64 = rest.get(2).map_or(Ok(0.0), |text| text.parse())?;
    let mut scene = match scene.as_str() {
        "street" => Street::builtin().sampling(1.0).scene(&|_| true).ok_or("stopped")?,
        "park" => Park::builtin().sampling(1.0).scene(&|_| true).ok_or("stopped")?,
        path => Scene::open(path)?,
    };
    label_sky(&mut scene.splats);
    let sky = scene.splats.groups.iter().filter(|group| **group == Group::Sky).count();
    let rasterization = scene.metadata.rasterization;
    let out = Path::new(out);
    let started = Instant::now();
    let mut builder = LevelBuilder::create(out, LevelOptions { leaf_splats, rasterization, ..defaults })?;
    builder.add(&scene.splats, &mut ())?;
    let summary = builder.finish(&scene.metadata, &mut ())?;
    let (count, seconds) = (scene.splats.len(), started.elapsed().as_secs_f64());
    println!("{count} splats in {seconds:.1} s, {:.0} a second: {summary:?}", count as f64 / seconds);

    let mut renderer = Renderer::cpu()?;
    let cameras = cameras(&mut renderer, &scene, turn)?;
    drop(scene);
    let all = LevelIndex::open(out)?.read_level(DetailLevel::Finest)?;
    // Splats of the sky are drawn in addition.
    let splats = ((share * count as f64) as u64).saturating_sub(sky as u64);
    let budget = LevelBudget { memory: 16 << 30, splats: Some(splats) };
    let options = PlaceOptions::default();
    let mut place = renderer.load_levels(LevelIndex::open(out)?, &options, &budget, false)?;
    let mut whole = renderer.load_with(all, &options)?;
    for place in [&mut place, &mut whole] {
        place.background = Background::Color([0.5; 3]);
    }
    let clear = Weather::clear();
    let request = |camera: &Camera| FrameRequest {
        layers: Layers::COLOR | Layers::DEPTH,
        ..FrameRequest::new(&clear, camera, 0.0)
    };
    let (mut truth, mut picture) = (Picture::default(), Picture::default());
    for (number, camera) in cameras.iter().enumerate() {
        renderer.render_into(&mut whole, &request(camera), &mut truth, &mut ())?;
        let mut counts = LevelCounts::default();
        for is_shot in [false, true] {
            let shot = if is_shot { vec![*camera] } else { Vec::new() };
            place.set_shot(&shot);
            // Read and loaded by the first picture; the second has a camera that is a hair's
            // breadth away and looks again.
            renderer.render_into(&mut place, &request(camera), &mut picture, &mut ())?;
            let again = Camera { near: camera.near * (1.0 + 1e-12), ..*camera };
            place.set_shot(&if is_shot { vec![again] } else { Vec::new() });
            let mut milliseconds = [0.0; 2];
            for time in &mut milliseconds {
                let started = Instant::now();
                renderer.render_into(&mut place, &request(&again), &mut picture, &mut ())?;
                *time = 1e3 * started.elapsed().as_secs_f64();
            }
            let (psnr, depth, alpha) = compare(&truth.frame, &picture.frame);
            counts = place.level_counts().unwrap_or_default();
            let [with, without] = milliseconds;
            println!(
                "view {number}, {}: {psnr:.1} dB, {:.2} %, {alpha:.4}; {} drawn, {} held; {with:.0} ms, {without:.0} ms without looks",
                if is_shot { "shot" } else { "frame" },
                100.0 * depth,
                counts.drawn + sky as u64,
                counts.held + sky as u64,
            );
        }
        if let Some(folder) = std::env::var_os("PICTURES") {
            save(&picture.frame, &Path::new(&folder).join(format!("{number}-{}.png", counts.drawn)))?;
            save(&truth.frame, &Path::new(&folder).join(format!("{number}-all.png")))?;
        }
    }
    Ok(())
}

/// The view that is chosen for the scene, and others from its place: to both sides and back.
fn cameras(renderer: &mut Renderer, scene: &Scene, turn: f64) -> Result<Vec<Camera>, Box<dyn Error>> {
    let up = Survey::of(scene, &Metadata::default()).up.value;
    let options = ViewOptions { size: Some(SIZE), ..ViewOptions::default() };
    let place = renderer.load_with(scene.clone(), &PlaceOptions::default())?;
    let chosen = choose::choose(&mut renderer.view_search(&place, options))?.camera;
    let turned = |degrees: f64| {
        let about = DMat4::from_mat3(DMat3::from_axis_angle(up, f64::to_radians(degrees + turn)));
        let there = |sign: f64| DMat4::from_translation(sign * chosen.center());
        Camera { viewmat: chosen.viewmat * there(1.0) * about * there(-1.0), ..chosen }
    };
    // A step back and up shows more of the place.
    let away = turned(20.0);
    let back: DVec3 = away.forward() * -0.15 * Survey::of(scene, &Metadata::default()).radius;
    let far = Camera { viewmat: away.viewmat * DMat4::from_translation(-back), ..away };
    Ok(vec![turned(0.0), turned(45.0), turned(-45.0), far])
}

/// PSNR, mean relative error of the depth where half of the light is stopped, mean difference of
/// alpha.
fn compare(a: &Frame, b: &Frame) -> (f64, f64, f64) {
    let apart = |a: &f32, b: &f32| f64::from(a.clamp(0.0, 1.0) - b.clamp(0.0, 1.0));
    let squares: f64 = a.rgb.iter().zip(&b.rgb).map(|(a, b)| apart(a, b).powi(2)).sum();
    let solid = (0..a.pixels()).filter(|pixel| a.alpha[*pixel] > 0.5 && a.depth[*pixel] > 0.0);
    let depths: Vec<f64> =
        solid.map(|pixel| f64::from(((a.depth[pixel] - b.depth[pixel]) / a.depth[pixel]).abs())).collect();
    let alpha: f64 = a.alpha.iter().zip(&b.alpha).map(|(a, b)| apart(a, b).abs()).sum();
    (
        -10.0 * (squares / a.rgb.len() as f64).log10(),
        depths.iter().sum::<f64>() / depths.len().max(1) as f64,
        alpha / a.alpha.len() as f64,
    )
}

fn save(frame: &Frame, path: &Path) -> Result<(), Box<dyn Error>> {
    let size = wm_image::PictureSize::new(frame.width, frame.height);
    Ok(wm_image::png::write_rgb(path, &frame.rgb, size, wm_image::color::Dither::Ordered, &[])?)
}
