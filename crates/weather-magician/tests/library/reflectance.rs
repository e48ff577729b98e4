//! Reflectances that are found in captures whose surfaces are known: the built-in street and park
//! in sun and under clouds, as cameras of several exposures and tone curves would show them.
//! `WM_ALL_CAPTURES=1` tries every camera in every place.

use glam::DVec3;
use weather_magician::{Metadata, Renderer, Scene};
use wm_base::color::{luminance, srgb_decode};
use wm_scene::{Group, Splats, sh};
use wm_street::{Lighting, Park, Place, Street};

/// A camera: the factor of its exposure, and the exponent of its tone curve.
const CAMERAS: [[f64; 2]; 4] = [[1.0, 1.0], [0.6, 1.0], [1.5, 0.85], [0.8, 1.2]];

/// Shows splats as another camera would: bright colours clip.
fn taken(splats: &mut Splats, [exposure, exponent]: [f64; 2]) {
    let stride = splats.sh_stride();
    for index in 0..splats.len() {
        for value in &mut splats.sh[index * stride..index * stride + 3] {
            let shown = (0.5 + sh::C0 * f64::from(*value)).clamp(0.0, 1.0);
            let linear = (exposure * srgb_decode(shown)).min(1.0);
            *value = sh::dc_of(wm_base::color::srgb_encode(linear).powf(exponent)) as f32;
        }
    }
}

/// Ratios of the reflectances that are found to the true ones, of ground in the open and in shade.
fn ratios(place: &Place, camera: [f64; 2]) -> Vec<f64> {
    let mut scene = place.sampling(0.2).scene(&|_| true).unwrap();
    taken(&mut scene.splats, camera);
    scene.metadata.lamps = None;
    let mut renderer = Renderer::cpu().unwrap();
    let mut prepared = renderer.load(scene.clone()).unwrap();
    let capture = renderer.capture_light(&mut prepared, &mut ()).unwrap();
    let up = [0.0, 0.0, 1.0];
    let mean = capture.mean(&capture.light);
    let Scene { splats, .. } = &scene;
    let stride = splats.sh_stride();
    let mut ratios = Vec::new();
    for index in (0..splats.len()).step_by(5).filter(|index| splats.groups[*index] != Group::Sky) {
        let point = DVec3::from_array(splats.means[index].map(f64::from));
        let is_ground = capture.normal(index).z.abs() > 0.9
            && place.ground_height(point.x, point.y).is_some_and(|z| (z - point.z).abs() < 0.05);
        let Some(truth) = place.reflectance(point + 0.1 * DVec3::Z, DVec3::NEG_Z).filter(|_| is_ground)
        else {
            continue;
        };
        let irradiance = luminance(capture.surface(index, up).irradiance(&capture.light, mean));
        let shown: [f64; 3] = std::array::from_fn(|k| {
            srgb_decode((0.5 + sh::C0 * f64::from(splats.sh[index * stride + k])).clamp(0.0, 1.0))
        });
        ratios.push(luminance(shown) / capture.white(irradiance) / luminance(truth));
    }
    ratios
}

#[test]
fn reflectances_of_ground_are_found() {
    let places = [
        ("street in the sun", Street::builtin()),
        ("street under clouds", Street::builtin().in_light(Lighting::Overcast)),
        ("park in the sun", Park::builtin()),
        ("park under clouds", Park::builtin().in_light(Lighting::Overcast)),
    ];
    let mut errors = Vec::new();
    let is_all = std::env::var_os("WM_ALL_CAPTURES").is_some();
    for (number, (name, place)) in places.iter().enumerate().take(if is_all { 4 } else { 3 }) {
        for camera in
            CAMERAS.into_iter().skip(if is_all { 0 } else { number }).take(if is_all { 4 } else { 1 })
        {
            let mut ratios = ratios(place, camera);
            ratios.sort_by(f64::total_cmp);
            let at = |share: f64| ratios[(share * (ratios.len() - 1) as f64) as usize];
            println!(
                "{name}, {camera:?}: {} splats of ground, {:.2} {:.2} {:.2}",
                ratios.len(),
                at(0.1),
                at(0.5),
                at(0.9)
            );
            errors.push((at(0.5) - 1.0).abs());
        }
    }
    errors.sort_by(f64::total_cmp);
    println!("{errors:.2?}");
    assert!(errors[errors.len() / 2] < 0.2, "{errors:.2?}");
    assert!(errors[errors.len() - 1] < 0.4, "{errors:.2?}");
}

#[test]
fn a_card_that_is_stated_is_used() {
    let mut scene = Street::builtin().sampling(0.1).scene(&|_| true).unwrap();
    scene.metadata = Metadata { white_card: Some(2.0), ..scene.metadata };
    let mut renderer = Renderer::cpu().unwrap();
    let mut place = renderer.load(scene).unwrap();
    let capture = renderer.capture_light(&mut place, &mut ()).unwrap();
    assert_eq!(capture.white(0.5), 1.0);
}
