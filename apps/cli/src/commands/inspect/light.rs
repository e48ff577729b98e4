//! `inspect --light`: the light of the photos, split into sun and sky, as a line and as a picture.

use crate::output::write_sheet;
use crate::progress::Reporter;
use crate::scene::AssetFolder;
use anyhow::{Context, Result};
use std::path::Path;
use weather_magician::view::{ViewOptions, choose};
use weather_magician::{
    Camera, FrameRequest, Metadata, PictureSize, PlaceOptions, PreparedPlace, Renderer, Scene, Weather,
};
use wm_image::color::Dither;
use wm_scene::{Splats, sh};
use wm_weather::light::CaptureLight;

const PANEL_SIZE_PX: (u32, u32) = (600, 400);

/// Finds the light of the photos, or reads it from the scene's assets, and prints it; also draws
/// it into the file `picture` if given. `path` is that of the scene.
pub(crate) fn show(path: &Path, scene: Scene, facts: Metadata, picture: Option<&Path>) -> Result<()> {
    let mut renderer = Renderer::cpu()?;
    let options =
        PlaceOptions { facts, assets: AssetFolder::default().folder(path), ..PlaceOptions::default() };
    let mut place = renderer.load_with(scene, &options)?;
    let light = renderer.capture_light(&mut place, &mut Reporter::default())?;
    println!("Light of the photos\n  {}", light.report(place.site().up));
    if let Some(picture) = picture {
        draw(&mut renderer, &mut place, &light, picture)?;
        println!("  drawn in {}", picture.display());
    }
    Ok(())
}

/// Draws the place as captured and under clouds, what of it is in the sun, and what is open to the
/// sky.
fn draw(renderer: &mut Renderer, place: &mut PreparedPlace, light: &CaptureLight, path: &Path) -> Result<()> {
    let options = ViewOptions { size: Some(PANEL_SIZE_PX), ..ViewOptions::default() };
    let camera = choose::choose(&mut renderer.view_search(place, options))?.camera;
    let mut clouds = Weather::find("overcast")?;
    clouds.set_text("light.exposure=0")?;
    let mut panels = Vec::new();
    for (weather, label) in [(Weather::clear(), "as captured"), (clouds, "under clouds")] {
        panels.push((renderer.render(place, &FrameRequest::new(&weather, camera, 0.0))?.frame.rgb, label));
    }
    let shares = [
        (light.sun_shares().collect::<Vec<f32>>(), "white: in the sun of the photos"),
        (light.open_shares().collect(), "white: open to the sky"),
    ];
    for (shares, label) in shares {
        panels.push((painted(renderer, place, &shares, &camera)?, label));
    }
    let size = PictureSize::new(PANEL_SIZE_PX.0, PANEL_SIZE_PX.1);
    let written = write_sheet(path, &panels, size, 2, Dither::Ordered, &[]);
    written.map(drop).with_context(|| format!("{}", path.display()))
}

/// Renders the splats of a place in greys, 0-1, one a splat.
fn painted(
    renderer: &mut Renderer,
    place: &PreparedPlace,
    shares: &[f32],
    camera: &Camera,
) -> Result<Vec<f32>> {
    let scene = place.scene();
    let mut splats: Splats = scene.splats.clone();
    let stride = splats.sh_stride();
    splats.sh.fill(0.0);
    for (index, share) in shares.iter().enumerate() {
        splats.sh[index * stride..index * stride + 3].fill(sh::dc_of(f64::from(*share)) as f32);
    }
    let mut greys = renderer.load(Scene { splats, metadata: scene.metadata.clone(), ..Scene::default() })?;
    Ok(renderer.render(&mut greys, &FrameRequest::new(&Weather::clear(), camera, 0.0))?.frame.rgb)
}
