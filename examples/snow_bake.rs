//! Lays 10 cm of snow on a scene and writes it for any viewer of 3DGS:
//! `cargo run --release -p weather-magician --example snow_bake -- garden.ply garden-snow.ply`
//!
//! Without a scene it bakes the built-in street.

use weather_magician::{Renderer, Scene, Weather};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut args = std::env::args().skip(1);
    let scene = match args.next() {
        Some(path) => Scene::open(path)?,
        None => wm_street::Street::builtin().sampling(0.2).scene(&|_| true).expect("nobody stops it"),
    };
    let out = args.next().unwrap_or_else(|| "snow.ply".into());

    let weather = Weather::clear().set("snow_cover.depth", 0.1)?;
    let mut renderer = Renderer::auto()?;
    let mut place = renderer.load(scene)?;
    let baked = renderer.bake(&mut place, &weather, 0.0, &mut ())?.ok_or("this weather lays nothing")?;
    baked.scene.save(&out)?;
    println!("{out}: {} splats, {} of them are snow", baked.scene.splats.len(), baked.added);
    Ok(())
}
