//! Renders one picture of a scene in fog:
//! `cargo run --release -p weather-magician --example fog_picture -- garden.ply fog.png`
//!
//! Without a scene it renders the built-in street.

use weather_magician::view::{ViewOptions, choose::choose};
use weather_magician::{FrameRequest, Renderer, Scene, Weather};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut args = std::env::args().skip(1);
    let scene = match args.next() {
        Some(path) => Scene::open(path)?,
        None => wm_street::Street::builtin().sampling(0.2).scene(&|_| true).expect("nobody stops it"),
    };
    let out = args.next().unwrap_or_else(|| "fog.png".into());

    // Visibility of 80 m, thinner above 30 m over the ground.
    let weather = Weather::preset("fog")?.set("fog.mor", 80.0)?.set("fog.scale_height", 30.0)?;
    let mut renderer = Renderer::auto()?;
    let mut place = renderer.load(scene)?;
    for warning in place.take_warnings() {
        eprintln!("warning: {warning}");
    }
    let options = ViewOptions { size: Some((480, 320)), ..ViewOptions::default() };
    let camera = choose(&mut renderer.view_search(&place, options))?.camera;
    renderer.render(&mut place, &FrameRequest::new(&weather, camera, 0.0))?.save(&out)?;
    println!("{out}: {}", renderer.describe());
    Ok(())
}
