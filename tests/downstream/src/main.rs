//! Makes a foggy, a rainy and a snowy picture of a scene, and trains 100 steps on photos:
//! `downstream SCENE PHOTOS OUT`.

use std::path::PathBuf;
use weather_magician::train::Session;
use weather_magician::{Camera, FrameRequest, Renderer, Scene, Weather};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut args = std::env::args_os().skip(1).map(PathBuf::from);
    let (Some(scene), Some(photos), Some(out)) = (args.next(), args.next(), args.next()) else {
        return Err("usage: downstream SCENE PHOTOS OUT".into());
    };
    let mut renderer = Renderer::auto()?;
    let mut place = renderer.load(Scene::open(&scene)?.metres_per_unit(1.0))?;
    let camera = Camera::look_at([0.0, 4.0, 1.7], [0.0, 30.0, 2.0]).fov_y(55.0).size(240, 160);
    for (name, weather) in [
        ("fog", Weather::preset("fog")?),
        ("rain", Weather::clear().set("rain.rate", 30.0)?),
        ("snow", Weather::clear().set("snow_cover.depth", 0.1)?),
    ] {
        let picture = renderer.render(&mut place, &FrameRequest::new(&weather, camera, 0.0))?;
        picture.save(out.join(format!("{name}.png")))?;
    }
    let trained = Session::new(photos).steps(100).run(&mut ())?;
    trained.save(out.join("trained.ply"))?;
    println!("3 pictures, and {} splats after 100 steps", trained.splats.len());
    Ok(())
}
