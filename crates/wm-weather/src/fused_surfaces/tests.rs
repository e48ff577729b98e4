//! Scans of made-up places: what cameras see, and what they see through.

use super::*;
use crate::shelter::{Occluders, ShelterOptions};
use crate::testing::{SITE, on_threads, photo_view as view};
use wm_scene::Camera;
use wm_scene::synthetic::Builder;

fn camera(eye: DVec3, target: DVec3) -> Camera {
    Camera::looking((160, 120), 60.0, eye, target, DVec3::Z).unwrap()
}

/// Level ground at z = 0 and a wall at y = 8, seen as rough as 4 cm.
fn yard(from: DVec3, ray: DVec3) -> Option<f64> {
    let ground = -from.z / ray.z;
    let wall = (8.0 - from.y) / ray.y;
    let at = |way: f64| (way > 0.0).then_some(way);
    let first = [at(ground), at(wall)].into_iter().flatten().min_by(f64::total_cmp)?;
    let place = from + first * ray;
    Some(first + 0.04 * ((7.0 * place.x).sin() + (9.0 * (place.y + place.z) + 5.0 * from.x).sin()))
}

#[test]
fn discs_lie_on_what_cameras_see_and_look_where_it_looks() {
    let eyes = [-2.0, -1.0, 0.0, 1.0, 2.0].map(|x| DVec3::new(x, 0.0, 1.6));
    let views = eyes.map(|eye| view(camera(eye, DVec3::new(0.0, 8.0, 0.8)), yard));
    let splats = Splats::with_capacity(0, 0);
    let [scan, other] = on_threads([2, 3], || FusedSurfaces::from_views(&splats, &views, &SITE));
    assert_eq!(scan, other, "equal for any number of threads");
    let (mut worst, mut turned, mut edges, mut count) = ([0.0; 2], [0, 0], [0, 0], [0, 0]);
    for index in 0..scan.oriented {
        let [_, y, z] = scan.splats.means[index].map(f64::from);
        let normal = scan.splats.normal(index);
        // Away from the corner.
        let (k, off, facing) = match () {
            () if z < 0.3 && y < 7.5 && y > 4.0 => (0, z.abs(), normal[2]),
            () if y > 7.7 && z > 0.5 => (1, (y - 8.0).abs(), -normal[1]),
            () => continue,
        };
        worst[k] += off * off;
        // Where no plane was found there are balls.
        let is_edge = scan.splats.scales(index)[2] > 0.5 * scan.splats.scales(index)[0];
        edges[k] += i32::from(is_edge);
        turned[k] += i32::from(!is_edge && facing < 0.9);
        count[k] += 1;
    }
    let rough = [0, 1].map(|k| (worst[k] / f64::from(count[k])).sqrt());
    assert!(count[0] > 500 && count[1] > 1000 && rough[0] < 0.02 && rough[1] < 0.03, "{rough:?}");
    assert!(turned[0] * 50 < count[0] && turned[1] * 50 < count[1], "{turned:?} of {count:?}");
    assert!(edges[0] * 5 < count[0] && edges[1] * 5 < count[1], "{edges:?} of {count:?}");
}

#[test]
fn discs_stand_for_the_splats_that_are_seen() {
    let mut place = Builder::new(1);
    // The wall; and something behind it.
    place.surface(DVec3::new(-3.0, 8.0, 0.0), DVec3::X * 6.0, DVec3::Z * 3.0, 0.1, |_, _| [0.5; 3]);
    let wall = place.build();
    place = Builder::new(1);
    place.surface(DVec3::new(-1.0, 10.0, 0.0), DVec3::X * 2.0, DVec3::Z, 0.1, |_, _| [0.5; 3]);
    let mut splats = wall.clone();
    splats.append(&place.build());
    let views = [-1.0, 1.0].map(|x| view(camera(DVec3::new(x, 0.0, 1.6), DVec3::new(0.0, 8.0, 1.6)), yard));
    let scan = FusedSurfaces::from_views(&splats, &views, &SITE);
    let replaced = |range: std::ops::Range<usize>| {
        range.filter(|index| scan.stand_ins[*index] != StandIn::Itself).count()
    };
    assert_eq!(replaced(0..wall.len()), wall.len());
    assert_eq!(replaced(wall.len()..splats.len()), 0);
    assert_eq!(scan.splats.len(), scan.oriented + splats.len() - wall.len());
}

/// A sheet in the air over a floor: cameras below it look at a wall behind it, through it.
#[test]
fn what_cameras_see_through_stops_nothing() {
    let mut place = Builder::new(1);
    place.surface(DVec3::ZERO, DVec3::X * 8.0, DVec3::Y * 8.0, 0.1, |_, _| [0.5; 3]);
    let mut splats = place.build();
    place = Builder::new(1);
    place.surface(DVec3::new(3.0, 3.0, 1.2), DVec3::X * 2.0, DVec3::Y * 2.0, 0.1, |_, _| [0.5; 3]);
    splats.append(&place.build());
    // At a wall 10 m ahead, whatever is before it.
    let view = |eye: DVec3, depth: f32| {
        let camera = Camera::looking((40, 30), 60.0, eye, DVec3::new(4.0, 4.0, 1.2), DVec3::Z).unwrap();
        PhotoView::new(camera, vec![depth; 40 * 30], Vec::new())
    };
    let eyes = [DVec3::new(-1.0, 4.0, 1.2), DVec3::new(4.0, -1.0, 1.2), DVec3::new(9.0, 4.0, 1.2)];
    let shelters = |views: &[PhotoView]| {
        let scan = FusedSurfaces::from_views(&splats, views, &SITE);
        let shelter =
            Occluders::of(&scan.splats, &SITE, &ShelterOptions::default()).shelter([0.0, 0.0, -1.0]);
        assert!(shelter.is_exposed([1.0, 1.0, 0.3]));
        !shelter.is_exposed([4.0, 4.0, 0.3])
    };
    assert!(shelters(&[]));
    // One camera may be wrong; two are not.
    assert!(shelters(&[view(eyes[0], 10.0)]));
    assert!(!shelters(&[view(eyes[0], 10.0), view(eyes[1], 0.0)]));
    // From behind something nobody knows.
    assert!(shelters(&eyes.map(|eye| view(eye, 1.0))));
}

/// A walk up a street of 6 in a hundred whose ground was left far too low by a training.
#[test]
fn the_ground_of_a_walk_is_where_it_must_be() {
    let height = 1.6;
    let street = |y: f64| 0.06 * y;
    let eyes: Vec<DVec3> = (0..8)
        .map(|k| {
            let y = 5.0 * f64::from(k);
            // Arms up and down, and from side to side.
            DVec3::new(0.3 * f64::from(k % 3), y, street(y) + height + [0.03, -0.04, 0.02][k as usize % 3])
        })
        .collect();
    let floors: Vec<FloorPlane> =
        eyes.iter().map(|eye| FloorPlane::below(*eye, &eyes, DVec3::Z, height)).collect();
    // A pit 3 m below the street, and a house whose wall is 3 m to the side.
    let seen = |from: DVec3, ray: DVec3| {
        let pit = (street(from.y) - 3.0 - from.z) / (ray.z - 0.06 * ray.y);
        let wall = (3.0 - from.x) / ray.x;
        [pit, wall].into_iter().filter(|way| *way > 0.0).min_by(f64::total_cmp)
    };
    let mut views: Vec<PhotoView> =
        eyes.iter().map(|eye| view(camera(*eye, *eye + DVec3::new(0.0, 10.0, 0.0)), seen)).collect();
    views.iter_mut().for_each(|view| view.stop_at(&floors));
    let splats = Splats::with_capacity(0, 0);
    let scan = FusedSurfaces::from_views(&splats, &views, &SITE);
    let (mut off, mut ground, mut wall) = (0.0f64, 0, 0);
    for mean in &scan.splats.means {
        let [x, y, z] = mean.map(f64::from);
        let above = z - street(y);
        if (3.0..33.0).contains(&y) && x.abs() < 2.0 {
            off = off.max(above.abs());
            ground += 1;
        }
        wall += i32::from((x - 3.0).abs() < 0.1 && above > 0.3);
    }
    assert!(ground > 2000 && off < 0.2 && wall > 1000, "{ground} {off} {wall}");
}

#[test]
fn arms_that_rise_to_one_side_are_no_slope() {
    let arms = [[-0.9, 0.5], [0.9, -0.3], [0.0, 0.0]];
    let eyes: Vec<DVec3> = (0..40)
        .map(|k| DVec3::new(arms[k % 3][0], 0.9 * k as f64, 0.03 * k as f64 + 1.6 + arms[k % 3][1]))
        .collect();
    for eye in &eyes {
        let FloorPlane { normal, .. } = FloorPlane::below(*eye, &eyes, DVec3::Z, 1.6);
        let [across, along] = [normal.x, normal.y].map(|v| -v / normal.z);
        assert!(across.abs() < 1e-3 && (along - 0.033).abs() < 0.02, "{across} {along}");
    }
}

/// A court that cameras look over from one height, left 2 m too low by a training: its wall is 30 m
/// off.
#[test]
fn the_ground_of_a_court_is_where_all_cameras_are_as_high() {
    let (height, off) = (1.6, 30.0);
    let eyes = [-4.0, 0.0, 4.0].map(|x| DVec3::new(x, 0.0, height));
    let cameras = eyes.map(|eye| camera(eye, eye + DVec3::new(0.0, 10.0, 0.0)));
    let seen = |pit: f64| {
        move |from: DVec3, ray: DVec3| {
            let ways = [(-pit - from.z) / ray.z, (off - from.y) / ray.y];
            ways.into_iter().filter(|way| *way > 0.0).min_by(f64::total_cmp)
        }
    };
    let floor = FloorPlane::under(&cameras, DVec3::Z, 0.0).expect("they are as high");
    assert!(!floor.is_lost(&cameras.map(|camera| view(camera, seen(0.0)))), "there it is");
    let mut views = cameras.map(|camera| view(camera, seen(2.0)));
    assert!(floor.is_lost(&views));
    // What a training made of it: upright, before the ground behind.
    let mut place = Builder::new(1);
    place.surface(DVec3::new(-1.0, 12.0, 0.1), DVec3::X * 2.0, DVec3::Z * 0.1, 0.05, |_, _| [0.5; 3]);
    let junk = place.build();
    views.iter_mut().for_each(|view| view.stop_at(&[floor]));
    let scan = FusedSurfaces::from_views(&junk, &views, &SITE);
    assert!(scan.stand_ins.iter().all(|it| *it == StandIn::Floor), "{:?}", scan.stand_ins);
    // Row by row pixels are metres apart out there; the floor is closed all the same.
    let mut rows = vec![0; off as usize];
    for mean in &scan.splats.means {
        let [x, y, z] = mean.map(f64::from);
        rows[(y as usize).min(off as usize - 1)] += i32::from(z.abs() < 0.01 && x.abs() < 2.0);
    }
    assert!(rows[6..off as usize - 1].iter().all(|count| *count >= 6), "{rows:?}");
}

#[test]
fn a_flight_and_a_climb_are_no_walk() {
    let look = |eye: DVec3, down: f64| camera(eye, eye + DVec3::new(0.0, 10.0, -down));
    let eyes = [-4.0, 0.0, 4.0].map(|x| DVec3::new(x, 0.0, 30.0));
    assert_eq!(FloorPlane::under(&eyes.map(|eye| look(eye, 8.0)), DVec3::Z, 0.0), None);
    assert!(FloorPlane::under(&eyes.map(|eye| look(eye, 1.0)), DVec3::Z, 0.0).is_some());
    let climb = [1.6, 2.2, 2.8].map(|z| look(DVec3::new(z, 0.0, z), 0.0));
    assert_eq!(FloorPlane::under(&climb, DVec3::Z, 0.0), None);
    assert_eq!(FloorPlane::under(&[], DVec3::Z, 0.0), None);
    assert_eq!(FloorPlane::under(&eyes.map(|eye| look(eye, 0.0)), DVec3::Z, 40.0), None, "ground above them");
}

/// A walk over rolling ground that beyond 10 m is lost in strips, and too near in others; a lump on
/// the path, as errors of depth leave them; and a post beside it.
#[test]
fn ground_at_a_grazing_angle_is_closed_and_posts_stay() {
    let ground = |place: DVec3| 0.4 * (0.12 * place.y).sin() + 0.02 * place.x;
    let post = DVec3::new(3.0, 34.0, 0.0);
    let seen = |from: DVec3, ray: DVec3| {
        let mut way = 0.0;
        while way < 90.0 && from.z + way * ray.z > ground(from + way * ray) {
            way += 0.02 + 0.002 * way;
        }
        let strip = (from + way * ray).x.floor().rem_euclid(3.0);
        let shown = match () {
            () if way > 90.0 || way > 10.0 && strip == 0.0 => None,
            () if way > 10.0 && strip == 1.0 => Some(0.85 * way),
            () if (6.0..8.0).contains(&(from + way * ray).y) && way < 6.0 => Some(0.82 * way),
            () => Some(way),
        };
        let before = (post - from).with_z(0.0).length();
        let is_post = (from + before * ray - post).with_z(0.0).length() < 0.15 && before < way;
        if is_post { Some(before) } else { shown }
    };
    let eyes: Vec<DVec3> = (0..8)
        .map(|k| DVec3::new(0.0, 3.0 * f64::from(k), 0.0))
        .map(|foot| foot.with_z(ground(foot) + 1.6))
        .collect();
    let views: Vec<PhotoView> =
        eyes.iter().map(|eye| view(camera(*eye, *eye + DVec3::new(0.0, 10.0, -0.8)), seen)).collect();
    let splats = Splats::with_capacity(0, 0);
    // Square metres of ground 12 to 25 m before the last camera that have discs within 0.2 m of it;
    // and discs of the post.
    let found = |views: &[PhotoView]| {
        let scan = FusedSurfaces::from_views(&splats, views, &SITE);
        let (mut closed, mut upright, mut lump) = (std::collections::BTreeSet::new(), 0, 0);
        for mean in &scan.splats.means {
            let place = DVec3::from_array(mean.map(f64::from));
            let above = place.z - ground(place);
            if (33.0..46.0).contains(&place.y) && place.x.abs() < 4.0 && above.abs() < 0.2 {
                closed.insert((place.x.floor() as i64, place.y.floor() as i64));
            }
            lump += i32::from(
                (3.0..8.0).contains(&place.y) && place.x.abs() < 1.0 && (0.2..0.6).contains(&above),
            );
            upright += i32::from((place - post).with_z(0.0).length() < 0.4 && above > 0.8);
        }
        (closed.len(), upright, lump)
    };
    let before = found(&views);
    let [snapped, again] = on_threads([2, 3], || GroundField::snap(&views, SITE.up, SITE.metres_per_unit));
    let after = found(&snapped);
    assert!(before.0 < 90 && after.0 >= 100, "{before:?} {after:?}");
    assert!(after.1 > 10 && after.1 * 4 >= before.1 * 3, "{before:?} {after:?}");
    assert!(before.2 > 20 && after.2 == 0, "{before:?} {after:?}");
    assert!(again.iter().zip(&snapped).all(|(a, b)| a.depth == b.depth), "equal for any number of threads");
}
