use super::*;
use crate::PreparedWeather;
use crate::testing;
use crate::weather::Observer;

const SITE: Site = Site { metres_per_unit: 0.5, airlight: [0.7; 3], far: 60.0, ..testing::SITE };

fn sky(texts: &[&str], time: f64) -> PreparedWeather {
    testing::weather(["fidelity=paper"].iter().chain(texts)).at(time).prepare(&SITE)
}

fn camera() -> Camera {
    Camera::looking((160, 90), 50.0, DVec3::new(31.0, -7.0, 4.0), DVec3::new(31.5, 9.0, 5.0), DVec3::Z)
        .unwrap()
}

fn before(camera: &Camera) -> PaperFallContext<'_> {
    PaperFallContext { site: &SITE, wind_now: WindSample::default(), camera, velocity: [0.0; 3] }
}

/// No Gaussian is lost, none is there twice, and the slices of depth do not overlap.
#[test]
fn sub_clouds_partition_the_noise() {
    let camera = camera();
    for (texts, each) in [(["rain.paper_k=4"], 1), (["snowfall.paper_k=7"], 3), (["rain.paper_k=1"], 1)] {
        let sky = sky(&texts, 3.0);
        let fall = &sky.paper_falls[0];
        let noise = fall.noise(&before(&camera));
        let clouds = fall.sub_clouds(&before(&camera));
        assert!(noise.len() > 400, "{}", noise.len());
        assert_eq!(clouds.len(), fall.layers);
        let most = noise.len().div_ceil(fall.layers);
        let mut last = f64::INFINITY;
        let mut means = Vec::new();
        for cloud in &clouds {
            assert!(!cloud.is_empty() && cloud.len() <= each * most);
            let depth = |mean: &[f32; 3]| {
                camera.forward().dot(DVec3::from_array(mean.map(f64::from)) - camera.center())
            };
            let depths: Vec<f64> = cloud.means.iter().map(depth).collect();
            // Means are stored in f32: at 40 units 4e-6.
            assert!(depths.iter().all(|v| *v <= last + 1e-5));
            last = depths.iter().copied().fold(f64::INFINITY, f64::min);
            means.extend_from_slice(&cloud.means);
        }
        let all = DVec3::from_array;
        let mut wanted: Vec<[f32; 3]> = noise
            .iter()
            .map(|thing| (camera.center() + all(thing.offset) / 0.5).to_array().map(|v| v as f32))
            .flat_map(|mean| std::iter::repeat_n(mean, each))
            .collect();
        for list in [&mut means, &mut wanted] {
            list.sort_by(|a, b| a.partial_cmp(b).unwrap());
        }
        assert_eq!(means, wanted);
    }
}

#[test]
fn it_fills_what_is_seen_of_the_box_evenly() {
    let camera = camera();
    let sky = sky(&["rain.paper_number=400000", "rain.paper_box=20"], 12.3);
    let noise = sky.paper_falls[0].noise(&before(&camera));
    let within =
        |radius: f64| noise.iter().filter(|t| DVec3::from_array(t.offset).length() < radius).count() as f64;
    // Of a cone the volume goes with the cube of the distance: half of it in the outer 20.6 %.
    let share = within(10.0 * 0.5f64.cbrt()) / within(10.0);
    let error = (0.25 / noise.len() as f64).sqrt();
    assert!(noise.len() > 5000 && (share - 0.5).abs() < 4.0 * error + 0.01, "{share} of {}", noise.len());
    assert_eq!(within(10.0) as usize, noise.len());
}

/// Each goes down by its own share of the fall, and with the wind; an instant does not depend on
/// those asked for before.
#[test]
fn things_fall_as_a_function_of_time() {
    let camera = camera();
    let at = |time: f64| {
        let sky = sky(&["rain.paper_speed=0:8,10:4", "rain.seed=3"], time);
        sky.paper_falls[0].noise(&before(&camera))
    };
    let (first, then, again) = (at(2.0), at(2.01), at(2.0));
    assert_eq!(first, again);
    let mut pairs = 0;
    for thing in &first {
        let Some(later) = then.iter().find(|other| other.index == thing.index) else { continue };
        let moved = DVec3::from_array(later.offset) - DVec3::from_array(thing.offset);
        // 8 - 0.4 t m/s: 7.2 at 2 s, 7.198 in the mean to 2.01 s; one that wrapped has come 24 m.
        let fall = -moved.z;
        if fall < 0.0 {
            continue;
        }
        pairs += 1;
        assert!(moved.x.abs() < 1e-9 && moved.y.abs() < 1e-9);
        assert!(
            fall > 0.0749 * 0.7198
                && fall < 0.1251 * 0.7198
                && (thing.speed / 7.2 * 0.07198 - fall).abs() < 1e-9
        );
    }
    assert!(pairs > first.len() / 2);
    let other = sky(&["rain.seed=4"], 2.0).paper_falls[0].noise(&before(&camera));
    assert_ne!(other.first().map(|t| t.offset), first.first().map(|t| t.offset));
}

/// A camera that goes along sees the same drops from elsewhere.
#[test]
fn things_stand_in_the_world() {
    let camera = camera();
    let step = DVec3::new(0.3, 0.6, 0.0);
    let other = Camera::looking(
        (160, 90),
        50.0,
        camera.center() + step,
        camera.center() + step + camera.forward(),
        DVec3::Z,
    )
    .unwrap();
    let sky = sky(&["snowfall.rate=1"], 5.0);
    let fall = &sky.paper_falls[0];
    let (here, there) = (fall.noise(&before(&camera)), fall.noise(&before(&other)));
    let mut same = 0;
    for thing in &here {
        let Some(again) = there.iter().find(|other| other.index == thing.index) else { continue };
        let off = DVec3::from_array(again.offset) + step * 0.5 - DVec3::from_array(thing.offset);
        same += usize::from(off.length() < 1e-9);
    }
    assert!(same > 7 * here.len() / 10, "{same} of {}", here.len());
}

#[test]
fn a_drop_lies_along_its_apparent_way() {
    let camera = camera();
    // Wind of 8 m/s along x, drops at 8 m/s, by a camera that goes 3 m/s along y.
    let sky = sky(&["rain.paper_speed=8", "wind.speed=8", "wind.direction=0", "wind.gusts=0"], 1.0);
    let fall = &sky.paper_falls[0];
    let clouds = sky.sub_clouds(fall, &Observer { velocity: [0.0, 3.0, 0.0], ..Observer::at_rest(&camera) });
    let cloud = &clouds[0];
    for i in 0..cloud.len() {
        let turn = wm_scene::quat::to_matrix(cloud.quats[i].map(f64::from));
        let [x, y, z] = [0, 1, 2].map(|row| turn[row][0]);
        // Its own speed is 6 to 10 m/s.
        let own = -z * 8.0 / x;
        assert!((5.999..10.001).contains(&own) && (y / x + 3.0 / 8.0).abs() < 1e-5, "{x} {y} {z}");
        let scales = cloud.scales(i);
        // 0.25 m and 4 mm over four, at half a metre a unit.
        assert!((scales[0] / 0.125 - 1.0).abs() < 1e-5 && (scales[1] / 0.002 - 1.0).abs() < 1e-5);
        assert_eq!(scales[1], scales[2]);
    }
}

#[test]
fn a_flake_has_three_arms_at_60_degrees() {
    let camera = camera();
    let sky = sky(&["snowfall.rate=1"], 0.0);
    let cloud = &sky.paper_falls[0].sub_clouds(&before(&camera))[0];
    let mut normals = DVec3::ZERO;
    for flake in 0..cloud.len() / 3 {
        let axis = |arm: usize| {
            let turn = wm_scene::quat::to_matrix(cloud.quats[3 * flake + arm].map(f64::from));
            DVec3::new(turn[0][0], turn[1][0], turn[2][0])
        };
        let [a, b, c] = [axis(0), axis(1), axis(2)];
        for (one, other) in [(a, b), (b, c), (a, c)] {
            assert!((one.dot(other).abs() - 0.5).abs() < 1e-5);
        }
        let normal = a.cross(b).normalize();
        assert!(normal.dot(c).abs() < 1e-5);
        normals += normal;
        let scales = cloud.scales(3 * flake);
        assert!((scales[1] / scales[0] - 0.1).abs() < 1e-6 && (scales[2] / scales[0] - 0.1).abs() < 1e-6);
    }
    // Planes of all directions: the mean of n unit vectors is about 1 / sqrt n long.
    let flakes = (cloud.len() / 3) as f64;
    assert!(normals.length() / flakes < 4.0 / flakes.sqrt());
}
