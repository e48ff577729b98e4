//! The place as a whole.

use super::*;
use build::Builder;
use glam::DVec3;
use hash::Dice;
use std::sync::OnceLock;
use wm_scene::{Camera, Group, Splats};

pub(crate) fn street() -> &'static Place {
    static STREET: OnceLock<Place> = OnceLock::new();
    STREET.get_or_init(Street::builtin)
}

/// Every `step`-th splat of the default detail.
fn some_splats(street: &Place, step: usize) -> Splats {
    let sampling = street.sampling(1.0);
    let mut splats = Splats::with_capacity(sampling.len() / step, 0);
    (0..sampling.len()).step_by(step).filter_map(|index| sampling.splat(index)).for_each(|s| splats.push(&s));
    splats
}

#[test]
fn a_seed_makes_one_place() {
    let again = Street::builtin();
    assert_eq!(some_splats(street(), 1999), some_splats(&again, 1999));
    let mut other = Builder::new(2);
    build::street::build(&mut other);
    assert!(other.primitives.iter().zip(&street().primitives).any(|(one, two)| one.shape != two.shape));
}

#[test]
fn splats_do_not_depend_on_how_they_are_asked_for() {
    let sampling = street().sampling(0.5);
    let (from, to) = (sampling.len() / 3, sampling.len() / 3 + 400);
    let whole = sampling.splats_in(from..to);
    assert!(!whole.is_empty() && whole.check().is_ok());
    let mut backwards: Vec<_> = (from..to).rev().filter_map(|index| sampling.splat(index)).collect();
    backwards.reverse();
    let mut other = Splats::with_capacity(0, 0);
    backwards.iter().for_each(|splat| other.push(splat));
    assert_eq!(whole, other);
    assert!(sampling.splat(sampling.len()).is_none());
    assert!(sampling.splats_in(sampling.len()..sampling.len() + 9).is_empty());
}

#[test]
fn splats_are_sound_grouped_and_above_ground() {
    let step = 61;
    let splats = some_splats(street(), step);
    let lowest_sky = (-10f64).to_radians().sin();
    let mut sky = 0;
    for index in 0..splats.len() {
        assert!(splats.is_sound(index), "{index}");
        let mean = DVec3::from_array(splats.means[index].map(f64::from));
        match splats.groups[index] {
            Group::Sky => {
                sky += 1;
                assert!((mean.length() - 1000.0).abs() < 0.1 && mean.normalize().z > lowest_sky);
            }
            Group::Scene => assert!(mean.z > -0.01 && mean.length() < 999.0, "{mean}"),
            Group::Snow => panic!("nothing made snow"),
        }
        let rgb = wm_scene::sh::color(splats.sh_of(index), [0.0, 0.0, 1.0]);
        assert!(rgb.iter().all(|v| (-1e-6..1.0).contains(v)), "{rgb:?}");
    }
    // Every 61st of about 580,000, 16,000 of them sky.
    let total = splats.len() * step;
    assert!((500_000..600_000).contains(&total), "{total}");
    assert!((13_000..19_000).contains(&(sky * step)), "{sky}");
}

#[test]
fn detail_counts_by_its_square() {
    let [coarse, fine] = [0.25, 1.0].map(|detail| street().sampling(detail).len() as f64);
    // Leaves stay one splat each, so the ratio is below 16.
    assert!(fine / coarse > 2.5 && fine / coarse < 16.0, "{}", fine / coarse);
}

#[test]
fn normals_face_the_ray_and_points_lie_on_it() {
    let mut dice = Dice::new(9, 0);
    let mut materials = std::collections::BTreeSet::new();
    for _ in 0..4000 {
        let origin = DVec3::new(dice.range(-3.0, 3.0), dice.range(-5.0, 60.0), dice.range(0.5, 4.0));
        let direction = dice.direction();
        let surface = street().first(origin, direction);
        if dice.unit() < 0.1 {
            let hit = street().cast(origin, direction);
            assert_eq!(
                hit.map(|h| (h.t, h.normal, h.material)),
                surface.map(|s| (s.t, s.normal, s.material))
            );
            if let Some(hit) = hit {
                assert!((origin + direction * hit.t).distance(hit.point) < 1e-9);
                assert!(hit.radiance.iter().all(|v| v.is_finite() && *v >= 0.0));
            }
        }
        if let Some(surface) = surface {
            assert!(surface.normal.dot(direction) <= 0.0 && (surface.normal.length() - 1.0).abs() < 1e-9);
            materials.insert(surface.material);
        }
        assert!(street().sky(direction).iter().all(|v| (0.0..4.0).contains(v)));
    }
    assert!(materials.len() > 15, "{materials:?}");
}

#[test]
fn the_porch_shelters_and_the_street_does_not() {
    let (low, high) = Street::porch();
    for i in 0..20 {
        for j in 0..10 {
            let share = DVec3::new((f64::from(j) + 0.5) / 10.0, (f64::from(i) + 0.5) / 20.0, 0.0);
            let at = low + (high - low) * share + DVec3::Z * 0.02;
            let above = street().first(at, DVec3::Z).expect("the porch has a roof");
            assert!(above.t < 4.0);
            // The floor is there, a little below.
            let floor = street().first(at, -DVec3::Z).expect("the porch has a floor");
            assert!((floor.t - 0.02).abs() < 1e-9, "{at} {}", floor.t);
        }
    }
    // The middle of the road before the first lamps is open to the sky.
    for y in [-2.0, 5.0, 12.0, 17.0, 25.0] {
        assert_eq!(street().first(DVec3::new(0.0, y, 0.05), DVec3::Z * 3.0), None);
    }
}

#[test]
fn photos_have_the_depth_of_their_rays() {
    let camera: Camera = Street::views()[0].camera((60, 40)).unwrap();
    let (mut sky, mut ground) = (0, 0);
    for (x, y) in [(5, 5), (30, 3), (30, 36), (50, 20), (10, 25), (29, 19)] {
        let pixel = street().photo(&camera, x, y, 2);
        let direction = camera.ray(f64::from(x) + 0.5, f64::from(y) + 0.5);
        match street().cast(camera.center(), direction) {
            Some(hit) => {
                let (u, v, z) = camera.project(hit.point).unwrap();
                assert!((u - f64::from(x) - 0.5).abs() < 1e-6 && (v - f64::from(y) - 0.5).abs() < 1e-6);
                assert!((z - pixel.depth).abs() < 1e-9 && !pixel.is_sky);
                assert_eq!((pixel.normal, pixel.material), (hit.normal, Some(hit.material)));
                ground += usize::from(hit.material == Material::Asphalt);
            }
            None => {
                assert!(pixel.is_sky && pixel.depth == 0.0 && pixel.material.is_none());
                sky += 1;
            }
        }
        assert!(pixel.rgb.iter().all(|v| (0.0..1.0).contains(v)));
        assert_eq!(display_of(pixel.radiance), pixel.rgb);
    }
    assert!(sky > 0 && ground > 0);
    assert_eq!(street().photo_row(&camera, 36, 2)[30], street().photo(&camera, 30, 36, 2));
}

#[test]
fn the_sun_lights_one_side_of_the_street() {
    let shown = |x: f64| {
        let mut sum = 0.0;
        for i in 0..40 {
            let at = DVec3::new(x, -20.0 + 2.0 * f64::from(i), 1.0);
            let hit = street().cast(at, -DVec3::Z).unwrap();
            sum += display_of(hit.radiance)[1] / 40.0;
        }
        sum
    };
    let (left, right) = (shown(-2.0), shown(2.4));
    assert!(left > right + 0.04, "{left} {right}");
    assert!(left < 0.85 && right > 0.08, "{left} {right}");
}

#[test]
fn views_stand_free_and_metadata_is_sound() {
    let eyes = Street::views().into_iter().map(|view| view.eye);
    let walk = (0..=20).map(|i| Street::dolly(f64::from(i) / 20.0).eye);
    let mut dice = Dice::new(10, 0);
    for eye in eyes.chain(walk) {
        for _ in 0..40 {
            let near = street().first(eye, dice.direction());
            assert!(near.is_none_or(|surface| surface.t > 0.5), "{eye}");
        }
    }
    let metadata = street().metadata();
    assert_eq!(metadata.fault(), None);
    assert_eq!(
        (metadata.metres_per_unit, metadata.up, metadata.ground),
        (Some(1.0), Some(DVec3::Z), Some(0.0))
    );
    assert!(metadata.airlight.unwrap().iter().all(|v| (0.5..1.0).contains(v)));
}
