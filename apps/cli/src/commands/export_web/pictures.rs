//! The pictures of a site: its poster, its video, and a small picture of each preset.

use super::output::{make_folder, write};
use super::{NOT_WRITTEN, resized};
use crate::output::write_video;
use crate::progress::{self, Reporter};
use crate::scene::OpenScene;
use anyhow::{Error, Result};
use std::path::Path;
use weather_magician::levels::shot_cameras;
use weather_magician::video::{FrameRate, VideoSettings};
use weather_magician::view::ViewOptions;
use weather_magician::view::moves;
use weather_magician::{
    Camera, CameraMotion, FrameRequest, Patience, Picture, PictureSize, Weather, picture_tags,
};
use wm_viewer::encode::frame_jpeg;
use wm_viewer::thumbnail::{self, thumbnail_weather};
use wm_weather::presets::PRESETS;

/// Width, px, and JPEG quality of the poster.
const POSTER: (u32, u8) = (1280, 85);
/// Width, px, frames a second and length, s, of the video.
const VIDEO: (u32, f64, f64) = (640, 24.0, 3.0);
/// Bits a second of the video.
const BITRATE: u32 = 3_000_000;
/// Way of the video's camera, scene radii.
const WAY: f64 = 0.04;

/// Writes the picture that is shown while the page loads.
pub(crate) fn poster(
    loaded: &mut OpenScene,
    weather: &Weather,
    start: &Camera,
    time: f64,
    path: &Path,
) -> Result<()> {
    let camera = resized(start, POSTER.0);
    let mut picture = Picture::default();
    let request = FrameRequest::new(weather, camera, time);
    let OpenScene { renderer, place } = loaded;
    renderer.render_into(place, &request, &mut picture, &mut Reporter::default())?;
    loaded.warn();
    write(path, &frame_jpeg(&picture.frame, POSTER.1)?)
}

/// Writes a small picture of each preset into `folder`; returns the names of those that it wrote:
/// not of a preset that the place cannot be rendered in.
pub(crate) fn thumbnails(loaded: &mut OpenScene, start: &Camera, folder: &Path) -> Result<Vec<String>> {
    make_folder(folder)?;
    let camera = resized(start, thumbnail::WIDTH);
    let (mut names, mut picture) = (Vec::new(), Picture::default());
    let OpenScene { renderer, place } = loaded;
    progress::for_each(PRESETS.iter(), "thumbnails", NOT_WRITTEN, |(name, _), _| {
        let Some((weather, time)) = thumbnail_weather(name).map_err(Error::msg)? else { return Ok(()) };
        let missing = place.missing_assets(&weather, time);
        let is_similar = !missing.is_empty() && place.has_similar(&missing);
        let patience = if is_similar { Patience::Draft } else { Patience::Whole };
        let request = FrameRequest { patience, ..FrameRequest::new(&weather, camera, time) };
        // Such as a flood where the ground is not known.
        if renderer.render_into(place, &request, &mut picture, &mut ()).is_ok() {
            write(&folder.join(format!("{name}.jpg")), &frame_jpeg(&picture.frame, thumbnail::QUALITY)?)?;
            names.push((*name).to_owned());
        }
        Ok(())
    })?;
    // They are of weathers that nobody asked for.
    loaded.place.take_warnings();
    Ok(names)
}

/// Writes a video of a few seconds from the start on, for browsers that cannot run the player. A
/// program without an encoder writes none.
pub(crate) fn video(
    loaded: &mut OpenScene,
    weather: &Weather,
    start: &Camera,
    time: f64,
    path: &Path,
) -> Result<()> {
    if !cfg!(feature = "h264") {
        eprintln!("this program was built without the video encoder: the site has no video");
        return Ok(());
    }
    let (width, rate, seconds) = VIDEO;
    let camera = resized(start, width);
    let size = (camera.width, camera.height);
    let OpenScene { renderer, place } = loaded;
    let options = ViewOptions { up: None, fov: None, near: Some(camera.near), size: Some(size) };
    let way = WAY * place.survey().radius;
    let dolly = moves::dolly(&mut renderer.view_search(place, options), &camera, Some(way), seconds);
    // A view straight down has no way ahead.
    let motion = match dolly {
        Ok(path) => CameraMotion::Along { path, size },
        Err(_) => camera.into(),
    };
    let rate: FrameRate = rate.to_string().parse().map_err(Error::msg)?;
    let mut settings = VideoSettings::new(PictureSize::new(size.0, size.1), rate);
    settings.bitrate = Some(BITRATE);
    settings.tags = picture_tags("", place.site(), renderer.backend(), weather, time, &camera);
    let frames: Vec<u32> = (0..rate.frames_within(seconds).max(1)).collect();
    let at = |frame: u32| rate.seconds(u64::from(frame));
    place.set_shot(&shot_cameras(frames.len() as u32, |frame| motion.camera(at(frame)), false));
    let scale = place.site().metres_per_unit;
    let mut render = |frame: u32, picture: &mut Picture| -> Result<()> {
        let request = FrameRequest::new(weather, motion.at(at(frame), scale), time + at(frame));
        renderer.render_into(place, &request, picture, &mut ())?;
        Ok(())
    };
    let written = write_video(path, settings, &frames, &mut render, |_| NOT_WRITTEN.into());
    place.set_shot(&[]);
    loaded.warn();
    written.map(drop)
}
