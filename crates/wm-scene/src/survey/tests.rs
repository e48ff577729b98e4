use super::{sky::SkyRegion, *};
use crate::synthetic::{Builder, aerial, moved, rotation, street, table};
use crate::testing::{SPLAT, data};
use crate::{Camera, Group, Metadata, Scene, SceneView, Splats, splats::Splat};
use glam::{DQuat, DVec3};
use proptest::prelude::*;

fn read(name: &str) -> Option<Scene> {
    let path = data(&format!("scenes/{name}.ply"))?;
    Some(crate::formats::read_scene(&path, &Default::default()).unwrap())
}

fn bare(splats: Splats) -> Scene {
    Scene { splats, ..Scene::default() }
}

fn survey(splats: Splats) -> Survey {
    Survey::of(&bare(splats), &Metadata::default())
}

fn with_sky(mut place: Builder, radius: f64, count: usize) -> Splats {
    place.sky(DVec3::ZERO, radius, count);
    place.build()
}

/// Degrees between the up that is found and the true one.
fn off(survey: &Survey, truth: DVec3) -> f64 {
    survey.up.value.angle_between(truth).to_degrees()
}

/// Four equal blocks on a level square; `spacings` are those of the splats of ground and blocks.
fn town(ground: f64, spacings: [f64; 2], corners: [[f64; 2]; 4], block: DVec3) -> Splats {
    let mut place = Builder::new(3);
    place.block(DVec3::new(0.0, 0.0, -0.2), DVec3::new(ground, ground, 0.2), spacings[0], [0.4; 3]);
    for [x, y] in corners {
        place.block(DVec3::new(x, y, 0.0), block, spacings[1], [0.6, 0.5, 0.4]);
    }
    place.build()
}

fn views(eyes: &[(DVec3, DVec3)]) -> Vec<SceneView> {
    let camera = |eye: DVec3, target| Camera::looking((300, 200), 50.0, eye, target, DVec3::Z).unwrap();
    let views = eyes.iter().enumerate();
    views.map(|(i, at)| SceneView { name: format!("{i}.jpg"), camera: camera(at.0, at.1) }).collect()
}

/// Up in the garden: 11 planes of facades, their rows of windows and plumb edges, and 9 pieces of
/// paving, fitted by hand, are 0.4 degrees about it. The scene is 1.5 degrees off its z axis.
fn garden_up() -> DVec3 {
    DVec3::new(0.019, 0.018, 1.0).normalize()
}

#[test]
fn the_garden_has_a_sky_shell() {
    let Some(scene) = read("headquarter-garden") else { return };
    let mut splats = scene.splats.clone();
    assert_eq!(label_sky(&mut splats), 8688);
    let found = Survey::of(&scene, &Metadata::default());
    let labelled = survey(splats.clone());
    assert_eq!((found.sky_splats, labelled.sky_splats, label_sky(&mut splats)), (8688, 8688, 0));
    assert_eq!(found.up.source, FactSource::Estimated);
    assert!(off(&found, garden_up()) < 0.5, "{} off", off(&found, garden_up()));
    assert_eq!(found.ground.source, FactSource::Estimated);
    // The paving falls from -0.3 to -1.4 over the courtyard; in the middle it is at -0.85.
    let middle = found.ground.value - found.up.value.dot(DVec3::new(4.0, -31.0, 0.0));
    assert!((middle + 0.85).abs() < 0.2, "{middle}");
    assert!(found.center.distance(DVec3::new(4.0, -31.0, 0.0)) < 5.0 && found.radius < 60.0);
    // A burned out overcast sky.
    assert!(found.airlight.value.iter().all(|v| (0.85..0.92).contains(v)), "{:?}", found.airlight);
}

#[test]
fn the_camp_from_a_drone_has_none() {
    let Some(mut scene) = read("taebak") else { return };
    let found = Survey::of(&scene, &Metadata::default());
    assert_eq!((found.up.value, found.up.source), (DVec3::NEG_Y, FactSource::Estimated));
    assert_eq!(found.ground.source, FactSource::Estimated);
    assert!((found.ground.value - 0.08).abs() < 0.05, "{}", found.ground.value);
    assert_eq!((found.sky_splats, label_sky(&mut scene.splats)), (0, 0));
    assert!(found.extent[0] > 45.0 && found.extent[2] < 4.0);
    let [r, g, b] = found.airlight.value;
    assert!(r < g && g < b && b < 1.0 && r > 0.35);
}

#[test]
fn real_scenes_can_lie_any_way() {
    for (name, truth, turns) in [("headquarter-garden", garden_up(), 4), ("taebak", DVec3::NEG_Y, 12)] {
        let Some(scene) = read(name) else { continue };
        for index in 0..turns {
            let turn = rotation(7, index);
            let mut turned = moved(&scene.splats, turn, 0.3, DVec3::new(5.0, -40.0, 11.0));
            // Every other time without its sky, which is the strongest of clues.
            if index % 2 == 1 && label_sky(&mut turned) > 0 {
                let scene: Vec<usize> =
                    (0..turned.len()).filter(|i| turned.groups[*i] == Group::Scene).collect();
                turned = turned.select(&scene);
            }
            let found = survey(turned);
            assert!(off(&found, turn * truth) < 1.0, "{name} {index}: {} off", off(&found, turn * truth));
        }
    }
}

#[test]
fn made_up_places_can_lie_any_way() {
    for (name, splats, height) in [
        ("street", street(1).build(), 0.1),
        ("street with sky", with_sky(street(2), 300.0, 10_000), 0.1),
        ("table", table(1).build(), 0.03),
        ("village", aerial(1).build(), 0.3),
        ("village with sky", with_sky(aerial(2), 800.0, 20_000), 0.3),
    ] {
        for index in 0..6 {
            let turn = if index == 0 { DQuat::IDENTITY } else { rotation(11, index) };
            let (scale, shift) = (0.1 + index as f64, DVec3::new(3.0, -2.0, 7.0));
            let found = survey(moved(&splats, turn, scale, shift));
            let truth = turn * DVec3::Z;
            assert!(off(&found, truth) < 1.0, "{name} {index}: {} off", off(&found, truth));
            let ground = (found.ground.value - shift.dot(truth)) / scale;
            assert!(ground.abs() < height, "{name} {index}: ground at {ground}");
            assert_eq!(found.ground.source, FactSource::Estimated, "{name} {index}");
        }
    }
}

/// A place that is aligned to an axis roughly stands as its walls do, and one that is aligned well
/// stands on the axis.
#[test]
fn no_axis_overrules_walls() {
    let corners = [[-11.0, -10.0], [11.0, -12.0], [-12.0, 11.0], [10.0, 10.0]];
    let place = town(40.0, [0.4, 0.3], corners, DVec3::new(9.0, 7.0, 8.0));
    for (degrees, most) in [(0.2, 0.25), (0.8, 0.5), (1.5, 0.5), (2.5, 0.5)] {
        for axis in [DVec3::X, DVec3::Y, DVec3::new(0.6, -0.8, 0.0)] {
            let turn = DQuat::from_axis_angle(axis, f64::to_radians(degrees));
            let found = survey(moved(&place, turn, 1.0, DVec3::ZERO));
            let error = off(&found, turn * DVec3::Z);
            assert!(error < most, "{degrees} degrees about {axis}: {error} off");
            let is_told = found.lines().iter().any(|line| line.contains("walls lean by"));
            assert!(is_told, "{:?}", found.lines());
        }
    }
}

/// Trainings leave the normals of walls biased; high walls still tell up by where they are.
#[test]
fn high_walls_tell_up_by_where_they_stand() {
    let corners = [[-18.0, -20.0], [22.0, -17.0], [-20.0, 21.0], [16.0, 20.0]];
    let mut place = town(60.0, [0.6, 0.5], corners, DVec3::new(12.0, 9.0, 35.0));
    let bias = DQuat::from_axis_angle(DVec3::new(0.8, 0.6, 0.0), 2f64.to_radians());
    for (mean, quat) in place.means.iter().zip(&mut place.quats) {
        if mean[2] > 1.0 {
            let [w, x, y, z] = quat.map(f64::from);
            let turned = bias * DQuat::from_xyzw(x, y, z, w);
            *quat = [turned.w, turned.x, turned.y, turned.z].map(|v| v as f32);
        }
    }
    for axis in [DVec3::X, DVec3::new(0.6, -0.8, 0.0)] {
        let turn = DQuat::from_axis_angle(axis, 1.5f64.to_radians());
        let found = survey(moved(&place, turn, 1.0, DVec3::ZERO));
        let error = off(&found, turn * DVec3::Z);
        assert!(error < 0.5, "about {axis}: {error} off");
    }
}

/// A figure without ground: the splats tell nothing, so up is what most programs write, and said to
/// be a guess.
#[test]
fn a_figure_on_nothing_stands_as_programs_write_it() {
    // Feet at y = 0.9, as programs with y down have it: legs, trunk, arms, head.
    let mut figure = Builder::new(5);
    for (x, y, radius) in [
        (-0.1, 0.7, 0.1),
        (0.1, 0.4, 0.1),
        (0.0, 0.1, 0.2),
        (0.0, -0.2, 0.2),
        (0.3, 0.0, 0.1),
        (0.0, -0.6, 0.15),
    ] {
        figure.ball(DVec3::new(x, y, 0.3 * x), radius, 0.02, [0.4; 3]);
    }
    let figure = figure.build();
    for turn in [DQuat::IDENTITY, DQuat::from_rotation_x(std::f64::consts::FRAC_PI_2)] {
        let found = survey(moved(&figure, turn, 1.0, DVec3::ZERO));
        assert_eq!((found.up.value, found.up.source), (DVec3::NEG_Y, FactSource::Assumed));
        assert_eq!(found.up.confidence, Confidence::Guess);
        assert!(found.lines()[1].contains("the splats hardly tell"), "{:?}", found.lines());
    }
}

#[test]
fn a_dome_is_the_sky() {
    let mut splats = with_sky(street(3), 400.0, 8000);
    let count = splats.len();
    assert_eq!(label_sky(&mut splats), 8000);
    assert!(splats.groups[..count - 8000].iter().all(|g| *g == Group::Scene));
    assert!(splats.groups[count - 8000..].iter().all(|g| *g == Group::Sky));
    // Also where it is nearly half of all splats.
    assert_eq!(label_sky(&mut with_sky(street(3), 400.0, 25_000)), 25_000);
}

#[test]
fn distant_things_are_no_sky() {
    // A ring of towers half a kilometre away, 20 degrees high at most; and strays everywhere.
    let mut place = street(4);
    for i in 0..24 {
        let (sin, cos) = (f64::from(i) * 0.26).sin_cos();
        let base = DVec3::new(500.0 * cos, 500.0 * sin, 0.0);
        place.block(base, DVec3::new(60.0, 60.0, 60.0 + 5.0 * f64::from(i)), 6.0, [0.6; 3]);
    }
    let towers = place.clone().build();
    place.strays(DVec3::splat(-4000.0), DVec3::splat(4000.0), 60);
    for mut splats in [street(4).build(), table(4).build(), towers.clone(), place.build()] {
        assert_eq!(label_sky(&mut splats), 0);
    }
    // With a sky behind them the towers stay.
    let mut place = street(4);
    place.sky(DVec3::ZERO, 3000.0, 4000);
    let sky = place.build();
    let mut all = towers;
    let before = all.len();
    all.append(&sky.select(&(sky.len() - 4000..sky.len()).collect::<Vec<_>>()));
    assert_eq!(label_sky(&mut all), 4000);
    assert!(all.groups[..before].iter().all(|g| *g == Group::Scene));
}

#[test]
fn cameras_decide_where_there_are_any() {
    // A wall that fills the view, so that the splats alone mislead, and people before it.
    let mut place = Builder::new(1);
    place.surface(DVec3::new(-9.0, 5.0, 0.0), DVec3::X * 18.0, DVec3::Z * 20.0, 0.2, |_, _| [0.6; 3]);
    place.surface(DVec3::new(-9.0, -3.0, 0.0), DVec3::X * 18.0, DVec3::Y * 8.0, 0.2, |_, _| [0.3; 3]);
    let eyes: Vec<_> = (0..9)
        .map(|i| DVec3::new(f64::from(i) - 4.0, -10.0, 1.6))
        .map(|eye| (eye, DVec3::new(0.5 * eye.x, 5.0, 6.0)))
        .collect();
    let scene = Scene { views: views(&eyes), ..bare(place.build()) };
    let found = Survey::of(&scene, &Metadata::default());
    assert_eq!((found.up.value, found.up.source), (DVec3::Z, FactSource::Cameras));
    assert!(found.ground.value.abs() < 0.1);
    // A drone that looks down one way: the cameras are 50 degrees off, the village is not.
    let slanted: Vec<_> = (0..8)
        .map(|i| DVec3::new(f64::from(i) * 7.0 - 24.0, -40.0, 60.0))
        .map(|eye| (eye, eye + DVec3::new(0.0, 50.0, -60.0)))
        .collect();
    let scene = Scene { views: views(&slanted), ..bare(aerial(5).build()) };
    let found = Survey::of(&scene, &Metadata::default());
    assert!(off(&found, DVec3::Z) < 1.0 && found.up.source == FactSource::Estimated);
    // Straight down from a drone: the cameras do not know, the splats do.
    let down: Vec<_> = (0..8)
        .map(|i| DVec3::new(f64::from(i) * 7.0 - 24.0, (f64::from(i) * 2.4).sin() * 20.0, 60.0))
        .map(|eye| (eye, eye + DVec3::new((eye.x * 0.8).sin(), (eye.x * 0.8).cos(), -60.0)))
        .collect();
    let scene = Scene { views: views(&down), ..bare(aerial(5).build()) };
    let found = Survey::of(&scene, &Metadata::default());
    assert!(off(&found, DVec3::Z) < 1.0);
}

#[test]
fn level_cameras_bound_the_roll_of_sloping_ground() {
    // A road that slopes by 6 degrees across its length, along which all cameras look.
    let mut place = Builder::new(3);
    let across = DVec3::new(0.0, 40.0, 4.2);
    place.surface(DVec3::X * -20.0 - 0.5 * across, DVec3::X * 40.0, across, 0.4, |_, _| [0.4; 3]);
    let scene = bare(place.build());
    let eyes: Vec<_> =
        (0..12).map(|i| DVec3::new(f64::from(i) - 6.0, 0.0, 1.6)).map(|eye| (eye, eye + DVec3::X)).collect();
    let seen = Scene { views: views(&eyes), ..scene.clone() };
    let [alone, with] = [scene, seen].map(|scene| off(&Survey::of(&scene, &Metadata::default()), DVec3::Z));
    // Without them the axis near by bounds it.
    assert!((2.0..5.0).contains(&alone) && with < 1.5, "{alone} and {with} degrees");
}

#[test]
fn the_ground_is_no_cellar_and_no_roof() {
    let mut place = street(9);
    let dark = |_: f64, _: f64| [0.1; 3];
    place.surface(DVec3::new(5.0, -2.0, -3.0), DVec3::X * 6.0, DVec3::Y * 4.0, 0.3, dark);
    place.surface(DVec3::new(-20.0, -12.0, 9.0), DVec3::X * 20.0, DVec3::Y * 6.0, 0.2, dark);
    place.strays(DVec3::new(-30.0, -8.0, -9.0), DVec3::new(30.0, 8.0, 0.0), 1000);
    let found = survey(place.build());
    assert!(off(&found, DVec3::Z) < 1.0 && found.ground.value.abs() < 0.1, "{found:?}");
}

#[test]
fn what_is_given_wins() {
    let turn = DQuat::from_rotation_x(0.2);
    let file = Metadata {
        up: Some(turn * DVec3::Z),
        ground: Some(-5.0),
        airlight: Some([0.1, 0.2, 0.3]),
        ..Metadata::default()
    };
    let scene = Scene { metadata: file, ..bare(street(5).build()) };
    let found = Survey::of(&scene, &Metadata::default());
    let sources = [found.up.source, found.ground.source, found.airlight.source];
    assert_eq!(sources, [FactSource::File; 3]);
    assert_eq!(found.metadata(), scene.metadata);
    // The file's ground is along its own up, and goes with it.
    let given = Metadata { up: Some(DVec3::Z), metres_per_unit: Some(2.0), ..Metadata::default() };
    let found = Survey::of(&scene, &given);
    assert_eq!((found.up.source, found.ground.source), (FactSource::Given, FactSource::Estimated));
    assert!(found.ground.value.abs() < 0.1);
    assert_eq!((found.warning(), found.metadata().metres_per_unit), (None, Some(2.0)));
    assert!((found.height(DVec3::new(3.0, 4.0, 7.0)) - 7.0).abs() < 0.1);
    // What cannot be used is as good as missing.
    let broken = Metadata { up: Some(DVec3::ZERO), ..Metadata::default() };
    assert_eq!(Survey::of(&scene, &broken).up.source, FactSource::File);
}

#[test]
fn it_is_told_in_lines() {
    let mut found = survey(with_sky(street(6), 300.0, 5000));
    found.extent = [126.4, 93.2, 40.3];
    found.airlight.value = [0.7, 0.755, 0.8];
    found.ground.value = -1e-9;
    assert!(found.lines().remove(1).starts_with("    before "));
    found.up_estimate = None;
    let lines = [
        "up: 0, 0, 1 (estimated from the splats; sure)",
        "ground: 0 units along up (estimated from the splats; likely)",
        "scale: 1 unit is 1 m (assumed)",
        "size: 126 x 93 x 40 m",
        "airlight: 0.7, 0.76, 0.8 linear (estimated from the sky near the horizon)",
        "sky: 5000 splats",
    ];
    assert_eq!(found.lines(), lines);
    let warning = "scale is not known: 1 unit is taken as 1 m, which makes the scene 126 x 93 x 40 m; give \
                   the metres per unit or a known distance (--metres-per-unit, --known-distance)";
    assert_eq!(found.warning().unwrap(), warning);
    found.extent = [0.51, 0.26, 0.033];
    assert_eq!(found.lines()[3], "size: 0.510 x 0.260 x 0.033 m");

    let metadata =
        Metadata { metres_per_unit: Some(16.25), scale_source: Some("a tape".into()), ..Metadata::default() };
    let scene = Scene { metadata, ..bare(street(6).build()) };
    let found = Survey::of(&scene, &Metadata::default());
    assert_eq!(found.lines()[4], "scale: 1 unit is 16.25 m (from the scene's metadata: a tape; sure)");
    assert_eq!(found.metadata().scale_source, scene.metadata.scale_source);
    let given = Metadata { metres_per_unit: Some(2.0), ..Metadata::default() };
    let found = Survey::of(&scene, &given);
    assert_eq!((found.lines()[4].as_str(), found.scale_source), ("scale: 1 unit is 2 m (given)", None));
}

#[test]
fn airlight_is_that_of_the_horizon() {
    // White at the horizon, blue above: the mean to 20 degrees is nearer to white.
    let found = survey(with_sky(street(7), 300.0, 10_000));
    // From 0 to 20 degrees the mean share of white is 0.6: (0.67, 0.76, 0.89) on a display.
    let seen = [0.67, 0.76, 0.89].map(wm_base::color::srgb_decode);
    // As bright, and no bluer than daylight fog: 1.1 times the red.
    let grey = wm_base::color::luminance(seen);
    let share = (seen[2] - 1.1 * seen[0]) / (seen[2] - 1.1 * seen[0] + 0.1 * grey);
    let expected = seen.map(|v| (1.0 - share) * v + share * grey);
    for (got, want) in found.airlight.value.into_iter().zip(expected) {
        assert!((got - want).abs() < 0.03, "{:?}", found.airlight);
    }
    // Without a sky: grey-white, a touch blue, in its bounds even where all is dark.
    let mut dark = street(7).build();
    for value in &mut dark.sh {
        *value -= 1.5;
    }
    let [r, g, b] = survey(dark).airlight.value;
    assert!((0.3..0.4).contains(&g) && r < g && g < b && b < 1.1 * g);
}

#[test]
fn nothing_and_next_to_nothing_can_be_surveyed() {
    let nothing = survey(Splats::default());
    assert_eq!((nothing.up.value, nothing.up.source, nothing.radius), (DVec3::Z, FactSource::Assumed, 0.0));
    assert_eq!(nothing.metadata(), Metadata::default());
    let some = street(8).build();
    for count in [1, 2, 3, 10] {
        let found = survey(some.select(&(0..count).map(|i| i * 50).collect::<Vec<_>>()));
        assert!(found.up.value.is_normalized() && found.ground.value.is_finite(), "{found:?}");
        assert!(found.airlight.value.iter().all(|v| v.is_finite()));
    }
    let one_place = some.select(&[5; 100]);
    assert!(survey(one_place).metadata().fault().is_none());
}

#[test]
fn scales_from_a_known_distance() {
    assert_eq!(known_distance(DVec3::ZERO, DVec3::X * 4.0, 2.0), Ok(0.5));
    let say = |a, b, metres| known_distance(a, b, metres).unwrap_err().to_string();
    assert_eq!(
        say(DVec3::ZERO, DVec3::X, -1.0),
        "a known distance of -1 m gives no scale: it must be finite and above 0"
    );
    assert_eq!(
        say(DVec3::ONE, DVec3::ONE, 1.0),
        "the points ([1, 1, 1]) and ([1, 1, 1]) give no scale: they must be finite and apart"
    );
    assert!(known_distance(DVec3::NAN, DVec3::ONE, 1.0).is_err());
    assert!(known_distance(DVec3::ZERO, DVec3::X * 1e-320, 1.0).is_err());
}

#[test]
fn facts_that_are_only_likely_are_named() {
    let mut found = survey(street(7).build());
    found.up.confidence = Confidence::Likely;
    found.ground.confidence = Confidence::Likely;
    found.metres_per_unit.confidence = Confidence::Sure;
    let line = found.likely_facts().unwrap();
    assert!(line.contains("up, the height of the ground;") && !line.contains("scale"), "{line}");
    found.ground.confidence = Confidence::Sure;
    found.metres_per_unit.confidence = Confidence::Likely;
    assert!(found.likely_facts().unwrap().contains("up, the scale"));
    // A guess has a warning of its own.
    found.up.confidence = Confidence::Guess;
    assert!(found.up_warning().is_some() && !found.likely_facts().unwrap().contains("up"));
    found.metres_per_unit.confidence = Confidence::Sure;
    assert_eq!(found.likely_facts(), None);
}

#[test]
fn an_object_without_ground_has_no_more_than_a_guess_of_up() {
    // A ball of surface looks everywhere alike; stretched, one direction leads clearly.
    for stretch in [1.0, 0.3] {
        let mut splats = Splats::with_capacity(0, 0);
        for normal in (0..4000).map(|i| wm_base::linear::direction(i, 4000)) {
            flat(&mut splats, normal * DVec3::new(1.0, 1.0, stretch), normal, [-3.2, -3.2, -6.0]);
        }
        let found = survey(splats);
        assert_eq!(found.up.confidence, Confidence::Guess, "{stretch}: {:?}", found.up);
    }
}

/// Adds a splat whose z axis is the normal.
fn flat(splats: &mut Splats, mean: DVec3, normal: DVec3, log_scale: [f32; 3]) {
    let turn = DQuat::from_rotation_arc(DVec3::Z, normal);
    let quat = [turn.w, turn.x, turn.y, turn.z].map(|v| v as f32);
    splats.push(&Splat { mean: mean.as_vec3().to_array(), quat, log_scale, logit_opacity: 3.0, ..SPLAT });
}

/// Flat splats on a surface that a function of two numbers of -1 to 1 gives, with its normal.
fn sheet(side: u64, at: impl Fn(f64, f64) -> (DVec3, DVec3)) -> Splats {
    let mut splats = Splats::with_capacity(0, 0);
    let number = |i: u64| 2.0 * (i as f64 + 0.5) / side as f64 - 1.0;
    for (u, v) in (0..side * side).map(|i| (number(i % side), number(i / side))) {
        let (mean, normal) = at(u, v);
        flat(&mut splats, mean, normal.normalize(), [-5.0, -5.0, -7.0]);
    }
    splats
}

/// A head and shoulders seen by one photo, y down: most of it faces the camera, which is no ground.
#[test]
fn a_portrait_does_not_lie_on_its_back() {
    let ball = |u: f64, v: f64| {
        let (u, v) = (u * (1.0 - 0.5 * v * v).sqrt(), v * (1.0 - 0.5 * u * u).sqrt());
        let round = (1.0 - u * u - v * v).max(0.0).sqrt();
        (DVec3::new(0.2 * u, 0.35 * v, -0.15 * round), DVec3::new(u, 0.5 * v, -round - 0.2))
    };
    // A head and shoulders before a wall.
    let mut before_wall = sheet(100, ball);
    before_wall.append(&sheet(120, |u, v| {
        let bumps = 0.01 * (9.0 * u).sin() * (7.0 * v).sin();
        (DVec3::new(0.6 * u, 0.6 * v, 0.3 + bumps), DVec3::new(0.1 * u, 0.1 * v, -1.0))
    }));
    let found = survey(before_wall);
    assert_eq!(found.up.confidence, Confidence::Guess);
    assert!(found.up_warning().unwrap().contains("0,-1,0"), "{:?}", found.up_warning());
    // A trunk between what is nearer and what is farther.
    let found = survey(sheet(130, |u, v| {
        let rough = DVec3::new((40.0 * u).sin(), (37.0 * v).cos(), -0.2);
        let (depth, normal) = match u {
            ..-0.4 => (0.5, rough),
            0.4.. => (-0.5, rough),
            _ => (0.0, DVec3::NEG_Z),
        };
        (DVec3::new(u, v, depth), normal)
    }));
    assert_eq!((found.up.value, found.up.confidence), (DVec3::NEG_Y, Confidence::Guess));
}

#[test]
fn there_is_no_ground_where_little_is_level() {
    // Some pieces of the bark of a trunk face up, at all heights.
    let trunk = sheet(130, |u, v| {
        let (sin, cos) = (std::f64::consts::PI * u).sin_cos();
        let bark = DVec3::Z * (2.3 * (37.0 * u + 91.0 * v).sin());
        (DVec3::new(0.25 * sin, -0.25 * cos, v), DVec3::new(sin, -cos, 0.0) + bark)
    });
    let given = Metadata { up: Some(DVec3::Z), ..Metadata::default() };
    let found = Survey::of(&bare(trunk), &given);
    assert_eq!(found.ground.source, FactSource::Assumed);
    assert!(
        found.metadata().ground.is_none()
            && found.lines().iter().any(|line| line.starts_with("ground: none"))
    );
    assert!(found.remarks().iter().any(|remark| remark.code == "no-ground"), "{:?}", found.remarks());
}

#[test]
fn a_handful_of_splats_tells_nothing() {
    for count in [1, 3, 40] {
        let level = sheet(10, |u, v| (DVec3::new(u, v, 0.0), DVec3::Z));
        let found = survey(level.select(&(0..count).collect::<Vec<_>>()));
        assert_eq!((found.up.value, found.up.source), (DVec3::NEG_Y, FactSource::Assumed), "{count}");
        let sure = [found.up.confidence, found.ground.confidence];
        assert_eq!((sure, found.ground.source), ([Confidence::Guess; 2], FactSource::Assumed), "{count}");
    }
}

proptest! {
    #[test]
    fn any_splats_can_be_surveyed(scene in crate::testing::any_scene(40)) {
        let found = Survey::of(&scene, &Metadata::default());
        prop_assert!(found.up.value.is_normalized());
        prop_assert!(found.metadata().fault().is_none(), "{found:?}");
        prop_assert!(found.lines().iter().all(|line| !line.contains('\n')));
        let sky = SkyRegion::of(&scene.splats);
        prop_assert_eq!(found.sky_splats, sky.indices(&scene.splats).len());
    }
}
