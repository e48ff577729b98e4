//! Renders one view of a scene in twelve weathers on one sheet:
//! `cargo run --release --example gallery -- street.ply 0 gallery.png`
//!
//! The view is that of a photo of the scene, by its number; without one it is chosen.

use weather_magician::view::{ViewOptions, choose::choose};
use weather_magician::{FrameRequest, Renderer, Scene, Weather};
use wm_image::color::Dither;
use wm_image::sheet::{SheetLayout, SheetPanel, sheet};
use wm_image::{PictureSize, png};

/// Size of each picture, px, and pictures in a row.
const SIZE: (u32, u32) = (400, 300);
const COLUMNS: u32 = 4;
/// Presets, and a setting of some: sunlit snow is exposed for.
const WEATHERS: [(&str, Option<&str>); 12] = [
    ("clear", None),
    ("after-rain", None),
    ("heavy-rain", None),
    ("flood", None),
    ("fog", None),
    ("snow", None),
    ("snow-covered", Some("look.exposure=-0.8")),
    ("blizzard", None),
    ("golden-hour", None),
    ("night-rain", None),
    ("night-fog", None),
    ("sandstorm", None),
];

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut args = std::env::args().skip(1);
    let scene = Scene::open(args.next().ok_or("which scene?")?)?;
    let photo: Option<usize> = args.next().map(|number| number.parse()).transpose()?;
    let out = args.next().unwrap_or_else(|| "gallery.png".into());

    let view = photo.map(|number| scene.views.get(number).ok_or("no such photo")).transpose()?;
    let view = view.map(|view| view.camera.resized(SIZE.0, SIZE.1));
    let mut renderer = Renderer::auto()?;
    let mut place = renderer.load(scene)?;
    let camera = match view {
        Some(camera) => camera,
        None => {
            let options = ViewOptions { size: Some(SIZE), ..ViewOptions::default() };
            choose(&mut renderer.view_search(&place, options))?.camera
        }
    };
    let mut pictures = Vec::new();
    for (name, setting) in WEATHERS {
        let mut weather = Weather::preset(name)?;
        setting.map_or(Ok(()), |setting| weather.set_text(setting))?;
        pictures
            .push((renderer.render(&mut place, &FrameRequest::new(&weather, camera, 0.0))?.frame.rgb, name));
    }
    let panels: Vec<SheetPanel<'_>> = pictures.iter().map(|(rgb, label)| SheetPanel { rgb, label }).collect();
    let layout = SheetLayout::new(PictureSize::new(SIZE.0, SIZE.1), panels.len() as u32, COLUMNS);
    png::write_rgb(out.as_ref(), &sheet(&layout, &panels), layout.size(), Dither::Ordered, &[])?;
    for warning in place.take_warnings() {
        eprintln!("warning: {warning}");
    }
    println!("{out}: {}", renderer.describe());
    Ok(())
}
