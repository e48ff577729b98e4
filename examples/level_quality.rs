//! Measures levels of detail: builds them for a scene, and compares pictures of a cut with pictures of all splats.
//!
//! ```text
//! cargo run --release --example level_quality -- SCENE|street|park OUT/lod-meta.json [SHARE] [LEAF_SPLATS]
//! ```
//!
//! SHARE is that of the splats which the cut has, 0.25 if not given. A row a view: PSNR in dB, relative error of the expected depth in
//! percent, mean difference of alpha; by the cut alone, and by the cut that knows what is hidden. `all` are the splats of the files at
//! the finest level, so that the rounding of SOG counts on neither side.

use glam::{DMat3, DMat4, DVec3};
use std::error::Error;
use std::path::Path;
use std::time::Instant;
use weather_magician::levels::{CoarseLeaves, CutBudget, LevelBuilder, LevelCut, LevelOptions};
use weather_magician::view::{ViewOptions, choose};
use weather_magician::{Camera, Metadata, PlaceOptions, Renderer, Scene};
use wm_render::{Background, DrawPass, Frame, Geometry, Outputs, RenderBackend, RenderConfig, SetView};
use wm_scene::formats::DetailLevel;
use wm_scene::levels::{LevelFile, LevelIndex};
use wm_scene::survey::{Survey, label_sky};
use wm_scene::{Group, Splats};
use wm_street::{Park, Street};

/// Size of the pictures, px.
const SIZE: (u32, u32) = (960, 640);

fn main() -> Result<(), Box<dyn Error>> {
    let args: Vec<String> = std::env::args().collect();
    let [_, scene, out, rest @ ..] = &args[..] else {
        return Err("usage: level_quality SCENE|street|park OUT/lod-meta.json [SHARE] [LEAF_SPLATS]".into());
    };
    let share: f64 = rest.first().map_or(Ok(0.25), |text| text.parse())?;
    let defaults = LevelOptions::default();
    let leaf_splats: usize = rest.get(1).map_or(Ok(defaults.leaf_splats), |text| text.parse())?;
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
    let cameras = cameras(&mut renderer, &scene)?;
    let index = LevelIndex::open(out)?;
    let files: Vec<LevelFile> =
        (0..index.files.len()).map(|file| index.read_file(file)).collect::<Result<_, _>>()?;
    let all = index.read_level(DetailLevel::Finest)?.splats;
    let environment = index.read_environment()?.map(|scene| scene.splats).unwrap_or_default();
    let rasterization = rasterization.unwrap_or_default();
    let outputs = Outputs { geometry: Geometry::Depth, ..Outputs::default() };
    let config = RenderConfig { outputs, background: Background::Color([0.5; 3]), rasterization };
    let mut look = |splats: &Splats, camera: &Camera| {
        let mut frame = Frame::default();
        renderer
            .backend_mut()
            .render(&DrawPass::new(&[SetView::transient(splats)], camera, &config), &mut frame)
            .map(|_| frame)
    };
    let truths: Vec<Frame> = cameras.iter().map(|camera| look(&all, camera)).collect::<Result<_, _>>()?;
    let coarsest = LevelCut::coarsest(&index);
    let outline = splats_of(&index, &files, &coarsest)?;
    let mut small = wm_render::CpuRenderer::new(wm_render::CpuConfig::default())?;
    let outline = CoarseLeaves::of(&index, &coarsest, small.load(&outline)?);
    let budget = CutBudget { splats: ((share * count as f64) as u64).saturating_sub(sky as u64) };
    for (number, (camera, truth)) in cameras.iter().zip(&truths).enumerate() {
        let started = Instant::now();
        let plain = LevelCut::of(&index, &[*camera], &budget);
        let milliseconds = 1e3 * started.elapsed().as_secs_f64();
        let weights = outline.seen_shares(&index, &[*camera], rasterization, &mut small)?;
        let knowing = LevelCut::weighted(&index, &[*camera], &weights, &budget);
        let mut row = format!("view {number}: cut in {milliseconds:.2} ms");
        for cut in [plain, knowing] {
            let splats = Splats::joined(splats_of(&index, &files, &cut)?, environment.clone());
            let frame = look(&splats, camera)?;
            let (psnr, depth, alpha) = compare(truth, &frame);
            row += &format!(" | {} splats, {psnr:.1} dB, {:.2} %, {alpha:.4}", splats.len(), 100.0 * depth);
            if let Some(folder) = std::env::var_os("PICTURES") {
                let name = format!("{number}-{}.png", splats.len());
                save(&frame, &Path::new(&folder).join(name))?;
                save(truth, &Path::new(&folder).join(format!("{number}-all.png")))?;
            }
        }
        println!("{row}");
    }
    Ok(())
}

/// The view that is chosen for the scene, and others from its place: to both sides and back.
fn cameras(renderer: &mut Renderer, scene: &Scene) -> Result<Vec<Camera>, Box<dyn Error>> {
    let up = Survey::of(scene, &Metadata::default()).up.value;
    let options = ViewOptions { size: Some(SIZE), ..ViewOptions::default() };
    let place = renderer.load_with(scene.clone(), &PlaceOptions::default())?;
    let chosen = choose::choose(&mut renderer.view_search(&place, options))?.camera;
    let turned = |degrees: f64| {
        let about = DMat4::from_mat3(DMat3::from_axis_angle(up, f64::to_radians(degrees)));
        let there = |sign: f64| DMat4::from_translation(sign * chosen.center());
        Camera { viewmat: chosen.viewmat * there(1.0) * about * there(-1.0), ..chosen }
    };
    // A step back and up shows more of the place.
    let away = turned(20.0);
    let back: DVec3 = away.forward() * -0.15 * Survey::of(scene, &Metadata::default()).radius;
    let far = Camera { viewmat: away.viewmat * DMat4::from_translation(-back), ..away };
    Ok(vec![chosen, turned(45.0), turned(-45.0), far])
}

/// The splats of a cut, leaf after leaf.
fn splats_of(index: &LevelIndex, files: &[LevelFile], cut: &LevelCut) -> Result<Splats, Box<dyn Error>> {
    let mut splats = Splats::default();
    for (_, run) in cut.runs(index) {
        splats = Splats::joined(splats, files[run.file].splats(run.offset, run.count)?);
    }
    Ok(splats)
}

/// PSNR, mean relative error of the depth where half of the light is stopped, mean difference of alpha.
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
    let size = wm_media::PictureSize::new(frame.width, frame.height);
    Ok(wm_media::png::write_rgb(path, &frame.rgb, size, wm_media::color::Dither::Ordered, &[])?)
}
