//! Pictures of what is chosen, for people to look at; written where `WM_PREVIEW` says:
//! `WM_DATA=... WM_PREVIEW=folder cargo test --release preview -- --ignored`.

use super::choose::choose;
use super::moves::{dolly, orbit};
use super::testing::{Loaded, place, real};
use super::{Options, path::Path};
use glam::{DQuat, DVec3};
use std::path::PathBuf;
use std::time::Instant;
use wm_render::hooks::{Hooks, Medium, ShadeBatch};
use wm_render::simd::SimdPath;
use wm_render::{Background, Frame, Job, RenderConfig, Renderer, SetView, SkyGradient};
use wm_scene::color::{srgb_decode, srgb_encode};
use wm_scene::synthetic::moved;
use wm_scene::{Camera, Scene};

/// A picture as a binary PPM.
fn write(file: PathBuf, frame: &Frame) {
    let mut out = format!("P6 {} {} 255\n", frame.width, frame.height).into_bytes();
    out.extend(frame.rgb.iter().map(|v| (v.clamp(0.0, 1.0) * 255.0 + 0.5) as u8));
    std::fs::write(file, out).unwrap();
}

/// A plain fog in the airlight that was found, to see whether it looks like one.
struct Fog {
    airlight: [f64; 3],
    /// Extinction, 1/unit.
    sigma: f64,
}

impl Medium for Fog {
    fn shade(&self, _: SimdPath, _: [f32; 3], batch: &mut ShadeBatch) {
        for i in 0..batch.len {
            let rgb = [0, 1, 2].map(|k| f64::from(batch.rgb[k][i]));
            let seen = self.reference([0.0; 3], [0.0; 3], f64::from(batch.distance[i]), rgb);
            for (channel, value) in batch.rgb.iter_mut().zip(seen) {
                channel[i] = value as f32;
            }
        }
    }

    fn reference(&self, _: [f64; 3], _: [f64; 3], distance: f64, rgb: [f64; 3]) -> [f64; 3] {
        let through = (-self.sigma * distance).exp();
        let light = |k: usize| srgb_decode(rgb[k]) * through + self.airlight[k] * (1.0 - through);
        [0, 1, 2].map(|k| srgb_encode(light(k)))
    }
}

struct Studio {
    folder: PathBuf,
    loaded: Loaded,
}

impl Studio {
    fn shoot(&mut self, name: &str, camera: &Camera, fog: Option<&dyn Medium>) {
        let sky = SkyGradient::daylight(self.loaded.survey.up.value.as_vec3().to_array());
        let config = RenderConfig { background: Background::Sky(sky), ..RenderConfig::default() };
        let sets = [SetView::plain(self.loaded.set)];
        let job =
            Job { sets: &sets, camera, config: &config, hooks: Hooks { medium: fog, ..Hooks::default() } };
        let mut frame = Frame::default();
        self.loaded.renderer.render(&job, &mut frame).unwrap();
        write(self.folder.join(format!("{name}.ppm")), &frame);
    }

    fn shoot_path(&mut self, name: &str, path: &Path, options: &Options) {
        for i in 0..6 {
            let camera = path.at(path.start() + path.duration() * f64::from(i) / 6.0, options.size());
            self.shoot(&format!("{name}-{i}"), &camera, None);
        }
    }
}

#[test]
#[ignore = "writes pictures to look at"]
fn preview() {
    let folder = PathBuf::from(std::env::var_os("WM_PREVIEW").expect("WM_PREVIEW names a folder"));
    let scenes = ["headquarter-garden", "taebak"].into_iter().filter_map(|name| Some((name, real(name)?)));
    let places = ["street", "table", "village", "street-sky"].map(|name| (name, place(name)));
    let resized = [("garden-small", 0.08), ("garden-large", 20.0)].into_iter().filter_map(|(name, scale)| {
        let scene = real("headquarter-garden")?;
        Some((name, Scene { splats: moved(&scene.splats, DQuat::IDENTITY, scale, DVec3::ZERO), ..scene }))
    });
    for (name, scene) in scenes.chain(places).chain(resized) {
        show(&mut Studio { folder: folder.clone(), loaded: Loaded::new(scene, None) }, name);
    }
}

fn show(studio: &mut Studio, name: &str) {
    let options = Options { size: Some((600, 400)), ..Options::default() };
    let begun = Instant::now();
    let start = choose(&mut studio.loaded.site(options)).unwrap().camera;
    println!("{name}: {:.2?}, eye {:.2}, forward {:.2}", begun.elapsed(), start.center(), start.forward());
    studio.shoot(&format!("{name}-chosen"), &start, None);
    let survey = &studio.loaded.survey;
    let (middle, fog) = (survey.center, Fog { airlight: survey.airlight.value, sigma: 2.0 / survey.radius });
    studio.shoot(&format!("{name}-fog"), &start, Some(&fog));
    let around = orbit(&studio.loaded.site(options), &start, 10.0).unwrap();
    studio.shoot_path(&format!("{name}-orbit"), &around, &options);
    let ahead = dolly(&mut studio.loaded.site(options), &start, None, 10.0).unwrap();
    let way = ahead.keys()[0].eye.distance(ahead.at(99.0, (1, 1)).center());
    println!("  orbit at {:.1}, dolly over {way:.1}", around.keys()[0].eye.distance(middle));
    studio.shoot_path(&format!("{name}-dolly"), &ahead, &options);
}
