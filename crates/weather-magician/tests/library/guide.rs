//! The Rust in `docs/guide/library.md`: each block stands here or in an example, line by line, and
//! runs.

use std::path::Path;
use weather_magician::assets::AssetCache;
use weather_magician::output::{LayerFile, PictureStyle, layers_of};
use weather_magician::{Camera, FrameRequest, PlaceOptions, Renderer, Scene, Weather};

const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../..");

fn lines(text: &str) -> Vec<&str> {
    text.lines().map(str::trim).filter(|line| !line.is_empty()).collect()
}

/// Returns true if `block` stands in `text` without gaps, but for `use` lines and indentation.
fn stands_in(block: &str, text: &str) -> bool {
    let (block, text) = (lines(block), lines(text));
    let (imports, body): (Vec<&str>, Vec<&str>) =
        block.into_iter().partition(|line| line.starts_with("use "));
    text.windows(body.len()).any(|window| window == body)
        && imports.iter().all(|line| {
            let names = line.trim_start_matches("use weather_magician::").trim_end_matches(';');
            names.split(['{', '}', ',', ':']).all(|name| text.iter().any(|line| line.contains(name.trim())))
        })
}

#[test]
fn every_block_of_the_guide_is_compiled() {
    let guide = std::fs::read_to_string(Path::new(ROOT).join("docs/guide/library.md")).unwrap();
    let compiled = ["crates/weather-magician/tests/library/guide.rs"]
        .into_iter()
        .chain(["examples/rain_video.rs", "examples/snow_bake.rs", "examples/reconstruct.rs"])
        .map(|path| std::fs::read_to_string(Path::new(ROOT).join(path)).unwrap())
        .collect::<Vec<_>>();
    let blocks: Vec<&str> =
        guide.split("```rust\n").skip(1).filter_map(|rest| rest.split("```").next()).collect();
    assert!(blocks.len() >= 6, "{} blocks", blocks.len());
    for block in blocks {
        assert!(compiled.iter().any(|text| stands_in(block, text)), "not compiled anywhere:\n{block}");
    }
}

#[test]
fn the_blocks_run() -> Result<(), Box<dyn std::error::Error>> {
    let folder = tempfile::tempdir()?;
    std::env::set_current_dir(&folder)?;
    let street = wm_street::Street::builtin().sampling(0.06).scene(&|_| true).expect("nobody stops it");
    street.save("garden.ply")?;

    let scene = Scene::open("garden.ply")?.metres_per_unit(0.4);
    let weather = Weather::preset("fog")?.set("fog.mor", 80.0)?;
    let mut renderer = Renderer::auto()?; // a GPU if there is one, else the CPU
    let mut place = renderer.load(scene)?;
    let camera = Camera::look_at([4.0, -20.0, 1.6], [4.0, -30.0, 1.5]).fov_y(50.0).size(1200, 800);
    let request = FrameRequest::new(&weather, camera, 0.0); // time in seconds
    let picture = renderer.render(&mut place, &request)?;
    picture.save("fog.png")?;

    let also: Vec<LayerFile> = vec!["depth".parse()?, "transmittance.npy".parse()?];
    let layers = layers_of(&also); // as Layers::COLOR | Layers::DEPTH | Layers::TRANSMITTANCE
    let request = FrameRequest { layers, ..FrameRequest::new(&weather, camera, 0.0) };
    let picture = renderer.render(&mut place, &request)?;
    let style = PictureStyle { also, ..Default::default() };
    style.write(&picture, "fog.png".as_ref())?;
    assert!(Path::new("fog.transmittance.npy").exists());

    let scene = Scene::open("garden.ply")?;
    let assets = Some(AssetCache::folder_of("garden.ply".as_ref()));
    let options = PlaceOptions { assets, ..PlaceOptions::default() };
    let mut place = renderer.load_with(scene, &options)?;
    renderer.render(&mut place, &FrameRequest::new(&Weather::preset("heavy-rain")?, camera, 0.0))?;
    assert!(AssetCache::folder_of("garden.ply".as_ref()).exists());
    Ok(())
}
