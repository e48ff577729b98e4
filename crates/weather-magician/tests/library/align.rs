//! Facts of a loaded place that are set by hand: points under clicks, and pictures that follow the
//! facts.

use glam::DVec3;
use weather_magician::{Camera, Error, FrameRequest, Metadata, PlaceOptions, Renderer, Scene, Weather};
use wm_scene::Group;
use wm_scene::splats::Splat;
use wm_scene::survey::{Alignment, GivenGround};
use wm_scene::synthetic::Builder;

const UP: DVec3 = DVec3::Z;

/// A paved ground with a wall, under a sky of splats.
fn court() -> Scene {
    let mut place = Builder::new(5);
    place.surface(DVec3::new(-8.0, -8.0, 0.0), DVec3::X * 16.0, DVec3::Y * 16.0, 0.15, |_, _| [0.5; 3]);
    place.block(DVec3::new(0.0, 5.0, 0.0), DVec3::new(4.0, 1.0, 3.0), 0.15, [0.7, 0.6, 0.5]);
    place.sky(DVec3::ZERO, 120.0, 3000);
    let metadata =
        Metadata { up: Some(-UP), ground: Some(0.0), metres_per_unit: Some(1.0), ..Metadata::default() };
    Scene { splats: place.build(), metadata, ..Scene::default() }
}

/// A plane of flat splats under a sky of splats: its points are known.
fn floor() -> Scene {
    const SPACING: f64 = 0.06;
    let mut place = Builder::new(6);
    place.sky(DVec3::ZERO, 120.0, 3000);
    let mut splats = place.build();
    let size = ((0.6 * SPACING).ln() as f32, (0.03 * SPACING).ln() as f32);
    for (i, j) in (-130..130).flat_map(|i| (-130..130).map(move |j| (i, j))) {
        splats.push(&Splat {
            mean: [f64::from(i) * SPACING, f64::from(j) * SPACING, 0.0].map(|v| v as f32),
            quat: [1.0, 0.0, 0.0, 0.0],
            log_scale: [size.0, size.0, size.1],
            logit_opacity: 2.5,
            rgb: [0.5; 3],
            group: Group::Scene,
        });
    }
    Scene { splats, ..Scene::default() }
}

fn camera() -> Camera {
    Camera::looking((480, 320), 55.0, DVec3::new(0.5, -9.0, 2.5), DVec3::new(0.0, 2.0, 0.5), UP).unwrap()
}

#[test]
fn the_point_under_a_click_is_on_the_surface() {
    let mut renderer = Renderer::cpu().unwrap();
    let place = renderer.load(floor()).unwrap();
    let camera = camera();
    for truth in [[-2.0, -4.0], [1.5, -5.0], [-3.0, 0.0], [0.3, 2.0], [2.5, -1.0]] {
        let truth = DVec3::new(truth[0], truth[1], 0.0);
        let (x, y, _) = camera.project(truth).unwrap();
        let found = renderer.surface_at(&place, &camera, [x, y]).unwrap().expect("a surface");
        let share = found.distance(truth) / truth.distance(camera.center());
        assert!(share < 0.01, "{truth}: {found}, off by {:.2} %", 100.0 * share);
    }
    // The sky is none, although splats show it.
    assert_eq!(renderer.surface_at(&place, &camera, [40.0, 20.0]).unwrap(), None);
    assert_eq!(renderer.surface_at(&place, &camera, [-1.0, 900.0]).unwrap(), None);
}

#[test]
fn pictures_are_those_of_a_scene_with_the_new_facts() {
    let mut weather = Weather::clear();
    weather.set_text("snow_cover.depth=0.2").unwrap();
    let camera = camera().resized(96, 64);
    let mut renderer = Renderer::cpu().unwrap();
    let mut place = renderer.load_with(court(), &PlaceOptions::default()).unwrap();
    let start = place.facts();
    let upside_down = renderer.render(&mut place, &FrameRequest::new(&weather, camera, 0.0)).unwrap();

    let points = [DVec3::new(-4.0, -4.0, 0.0), DVec3::new(5.0, -3.0, 0.0), DVec3::new(0.0, 4.0, 0.0)];
    let by = Alignment { ground: Some(GivenGround::Points(points)), ..Alignment::default() };
    let aligned = renderer.align(&mut place, &by).unwrap();
    assert!(aligned.after.up.value.angle_between(UP) < 1e-6 && *place.survey() == aligned.after);
    let upright = renderer.render(&mut place, &FrameRequest::new(&weather, camera, 0.0)).unwrap();
    assert!(upright.frame.rgb != upside_down.frame.rgb);
    let fresh = Scene { metadata: place.facts().scene, ..court() };
    let mut other = Renderer::cpu().unwrap();
    let mut loaded = other.load(fresh).unwrap();
    assert_eq!(loaded.site(), place.site());
    assert!(
        other.render(&mut loaded, &FrameRequest::new(&weather, camera, 0.0)).unwrap().frame == upright.frame
    );

    // Values that cannot be used change nothing.
    let line = Alignment {
        ground: Some(GivenGround::Points([DVec3::ZERO, DVec3::X, DVec3::X * 2.0])),
        ..Alignment::default()
    };
    let facts = place.facts();
    assert!(matches!(renderer.align(&mut place, &line), Err(Error::Align(_))));
    assert_eq!(place.facts(), facts);
    renderer.set_facts(&mut place, start).unwrap();
    assert!(
        renderer.render(&mut place, &FrameRequest::new(&weather, camera, 0.0)).unwrap().frame
            == upside_down.frame
    );

    renderer.prepare(&mut place, &weather, &mut ()).unwrap();
    place.release_splats();
    assert!(matches!(renderer.align(&mut place, &by), Err(Error::Unsupported(_))));
}
