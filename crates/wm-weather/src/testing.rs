//! A site and views that the tests of several modules share.

use crate::effects::Effect;
use crate::fused_surfaces::PhotoView;
use crate::optics::Site;
use crate::track::Track;
use crate::weather::Weather;
use glam::DVec3;
use wm_render::frame::Frame;
use wm_scene::Camera;

/// A place in metres with z up.
pub(crate) const SITE: Site = Site::PLAIN;

/// A camera's view of whatever is first along a ray: how far along it, with a direction of length
/// 1.
pub(crate) fn photo_view(camera: Camera, way: impl Fn(DVec3, DVec3) -> Option<f64>) -> PhotoView {
    let (center, forward) = (camera.center(), camera.forward());
    let pixel = |k: u32| {
        let ray = camera.ray(f64::from(k % camera.width) + 0.5, f64::from(k / camera.width) + 0.5);
        way(center, ray).map_or(0.0, |way| (way * ray.dot(forward)) as f32)
    };
    PhotoView::new(camera, (0..camera.width * camera.height).map(pixel).collect(), Vec::new())
}

/// A picture of something opaque at one depth.
pub(crate) fn frame(size: [u32; 2], rgb: Vec<f32>, depth: f32) -> Frame {
    let [width, height] = size;
    let pixels = (width * height) as usize;
    Frame { width, height, rgb, alpha: vec![1.0; pixels], depth: vec![depth; pixels], ..Frame::default() }
}

/// Runs `work` on pools of so many threads each.
pub(crate) fn on_threads<T: Send, const N: usize>(
    threads: [usize; N],
    work: impl Fn() -> T + Sync,
) -> [T; N] {
    let pool = |threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    threads.map(|threads| pool(threads).install(&work))
}

/// Clear weather with changes, each as it is written on the command line.
pub(crate) fn weather<T: AsRef<str>>(sets: impl IntoIterator<Item = T>) -> Weather {
    let mut weather = Weather::clear();
    sets.into_iter().for_each(|set| weather.set_text(set.as_ref()).unwrap());
    weather
}

/// A parameter over time, as it is written on the command line.
pub(crate) fn track(effect: &str, param: &str, text: &str) -> Track {
    let effect = Effect::named(effect).unwrap();
    Track::parse(&effect.params[effect.param(param).unwrap()], text).unwrap()
}
