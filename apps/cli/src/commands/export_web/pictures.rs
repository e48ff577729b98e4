//! The pictures of a site: its poster, its video, and a small picture of each preset.

use super::output::{make_folder, write};
use super::stop::NOT_WRITTEN;
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

const POSTER_WIDTH_PX: u32 = 1280;
const POSTER_JPEG_QUALITY: u8 = 85;
const VIDEO_WIDTH_PX: u32 = 640;
const VIDEO_FRAMES_PER_S: f64 = 24.0;
const VIDEO_LENGTH_S: f64 = 3.0;
const VIDEO_BITS_PER_S: u32 = 3_000_000;
/// Length of the path of the video's camera, as a multiple of the scene's radius.
const VIDEO_PATH_RADII: f64 = 0.04;

/// Writes the picture that is shown while the page loads.
pub(crate) fn poster(
    loaded: &mut OpenScene,
    weather: &Weather,
    start: &Camera,
    time: f64,
    path: &Path,
) -> Result<()> {
    let camera = resized(start, POSTER_WIDTH_PX);
    let mut picture = Picture::default();
    let request = FrameRequest::new(weather, camera, time);
    let OpenScene { renderer, place } = loaded;
    renderer.render_into(place, &request, &mut picture, &mut Reporter::default())?;
    loaded.warn();
    write(path, &frame_jpeg(&picture.frame, POSTER_JPEG_QUALITY)?)
}

/// Writes a small picture of each preset into `folder`; returns the names of those that it wrote:
/// not of a preset that the place cannot be rendered in.
pub(crate) fn thumbnails(loaded: &mut OpenScene, start: &Camera, folder: &Path) -> Result<Vec<String>> {
    make_folder(folder)?;
    let camera = resized(start, thumbnail::WIDTH_PX);
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
            write(
                &folder.join(format!("{name}.jpg")),
                &frame_jpeg(&picture.frame, thumbnail::JPEG_QUALITY)?,
            )?;
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
    let camera = resized(start, VIDEO_WIDTH_PX);
    let size = (camera.width, camera.height);
    let OpenScene { renderer, place } = loaded;
    let options = ViewOptions { up: None, fov: None, near: Some(camera.near), size: Some(size) };
    let way = VIDEO_PATH_RADII * place.survey().radius;
    let dolly = moves::dolly(&mut renderer.view_search(place, options), &camera, Some(way), VIDEO_LENGTH_S);
    // A view straight down has no way ahead.
    let motion = match dolly {
        Ok(path) => CameraMotion::Along { path, size },
        Err(_) => camera.into(),
    };
    let rate: FrameRate = VIDEO_FRAMES_PER_S.to_string().parse().map_err(Error::msg)?;
    let mut settings = VideoSettings::new(PictureSize::new(size.0, size.1), rate);
    settings.bitrate = Some(VIDEO_BITS_PER_S);
    settings.tags = picture_tags("", place.site(), renderer.backend(), weather, time, &camera);
    let frames: Vec<u32> = (0..rate.frames_within(VIDEO_LENGTH_S).max(1)).collect();
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

/// Returns a camera with another size of its picture, `width` px wide; both sides are even.
fn resized(camera: &Camera, width: u32) -> Camera {
    let width = width.min(camera.width).max(2) & !1;
    let height = f64::from(width) * f64::from(camera.height) / f64::from(camera.width);
    camera.resized(width, ((height / 2.0).round() as u32 * 2).clamp(2, 8192))
}
