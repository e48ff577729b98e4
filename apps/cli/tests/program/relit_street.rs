//! Compares the street's light as weather changes it with the same street under the sky that it is
//! changed to.

use crate::common::psnr;
use weather_magician::{FrameRequest, Picture, Renderer, Weather};
use wm_base::color::{luminance, srgb_decode};
use wm_base::statistics::median;
use wm_scene::{Camera, Scene};
use wm_street::{Lighting, Place, Street};

const SIZE: (u32, u32) = (240, 160);
/// Distance of the pixels that are compared across an edge of a shadow.
const PAIR_DISTANCE_PX: usize = 10;

fn sampled(place: &Place) -> Scene {
    place.sampling(0.5).scene(&|_| true).expect("nobody stops it")
}

fn rendered(scene: Scene, weather: &Weather, cameras: &[Camera]) -> Vec<Picture> {
    let mut renderer = Renderer::cpu().unwrap();
    let mut place = renderer.load(scene).unwrap();
    let draw =
        |camera: &Camera| renderer.render(&mut place, &FrameRequest::new(weather, camera, 0.0)).unwrap();
    let pictures = cameras.iter().map(draw).collect();
    assert!(place.take_warnings().is_empty());
    pictures
}

fn light(picture: &Picture, pixel: usize) -> f64 {
    luminance([0, 1, 2].map(|k| srgb_decode(f64::from(picture.frame.rgb[3 * pixel + k]))))
}

/// Logs of the ratios of light to shade across the edges of shadows on one material.
fn edges(place: &Place, camera: &Camera, picture: &Picture) -> Vec<f64> {
    let (width, height) = (SIZE.0 as usize, SIZE.1 as usize);
    let seen = |pixel: usize| {
        let ray = camera.ray((pixel % width) as f64 + 0.5, (pixel / width) as f64 + 0.5);
        let hit = place.first(camera.center(), ray)?;
        let point = camera.center() + ray.normalize() * hit.t + hit.normal * 2e-3;
        let is_near = hit.t < 25.0 && hit.normal.z > 0.9;
        is_near.then(|| (hit.material, place.first(point, Place::sun_direction()).is_none()))
    };
    let pixels: Vec<_> = (0..width * height).map(seen).collect();
    let pairs =
        (0..width * height - PAIR_DISTANCE_PX).filter(|first| first % width + PAIR_DISTANCE_PX < width);
    let ratio = |first: usize| {
        let ((material, lit), (other, other_lit)) = (pixels[first]?, pixels[first + PAIR_DISTANCE_PX]?);
        let ratio = (light(picture, first) / light(picture, first + PAIR_DISTANCE_PX)).ln();
        (material == other && lit != other_lit).then_some(if lit { ratio } else { -ratio })
    };
    pairs.filter_map(ratio).collect()
}

#[test]
fn clouds_take_the_shadows_of_the_street_away() {
    let sunny = Street::builtin();
    let scene = sampled(&sunny);
    let truth = sampled(&sunny.clone().in_light(Lighting::Overcast));
    let cameras: Vec<Camera> =
        [0.02, 0.4].map(|time| Street::dolly(time).camera(SIZE).unwrap()).into_iter().collect();
    let clear = Weather::clear();
    let overcast = Weather::clear().set("light.model", "overcast").unwrap();
    let before = rendered(scene.clone(), &clear, &cameras);
    let relit = rendered(scene, &overcast, &cameras);
    let truth = rendered(truth, &clear, &cameras);

    let contrast = |pictures: &[Picture]| {
        let all = cameras.iter().zip(pictures).flat_map(|(camera, picture)| edges(&sunny, camera, picture));
        let mut all: Vec<f64> = all.collect();
        assert!(all.len() > 300, "{} pairs", all.len());
        median(&mut all).unwrap()
    };
    let [had, left, none] = [&before, &relit, &truth].map(|pictures| contrast(pictures));
    assert!(had > 0.4 && none.abs() < 0.1, "{had} before, {none} in truth");
    let share = (left - none).abs() / (had - none);
    // Splats twice as wide as the demo's blur the edges by which the light is told.
    assert!(share < 0.15, "{share} of the contrast is left: {had} before, {left} relit, {none} in truth");

    for (relit, truth) in relit.iter().zip(&truth) {
        let psnr = psnr(relit.frame.rgb.iter().zip(&truth.frame.rgb).map(|(a, b)| f64::from(a - b)));
        assert!(psnr > 26.0, "{psnr} dB");
    }
}
