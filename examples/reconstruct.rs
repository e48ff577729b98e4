//! Turns photos with known cameras into a scene:
//! `cargo run --release -p weather-magician --example reconstruct -- photos/ place.ply 2000`
//!
//! Without photos it takes some of the built-in street.

use weather_magician::train::{Preset, Session};
use wm_street::{Street, dataset};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut args = std::env::args().skip(1);
    let made = tempfile::tempdir()?;
    let photos = match args.next() {
        Some(folder) => folder.into(),
        None => {
            let options = dataset::DatasetOptions { count: 6, size: (96, 64), ..Default::default() };
            dataset::write(&Street::builtin(), made.path(), &options, &mut |_| true)?;
            made.path().to_owned()
        }
    };
    let out = args.next().unwrap_or_else(|| "place.ply".into());
    let steps = args.next().map_or(Ok(100), |text| text.parse())?;

    let scene = Session::new(photos).preset(Preset::Quick).steps(steps).run(&mut ())?;
    scene.save(&out)?;
    println!("{out}: {} splats", scene.splats.len());
    Ok(())
}
