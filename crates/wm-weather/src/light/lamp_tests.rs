//! Lamps against formulas: what they light, what is in their shadows, and how they look through
//! air.

use super::lamp_glow::{LampGlow, LampsOn};
use super::lamp_shadows::DepthCube;
use super::{CaptureLight, KnownSun, LampLight, LampLights, LampShadows, NearSplats, PlacedSurfaces};
use crate::fused_surfaces::FusedSurfaces;
use crate::optics::{AirLayer, Atmosphere, CapturedSky, Site, sigma_of_mor};
use crate::shelter::{Occluders, ShelterOptions};
use crate::surfel::surfel;
use crate::testing::on_threads;
use fearless_simd::SimdBase;
use glam::{DVec3, Vec3};
use std::array::from_fn;
use std::f64::consts::PI;
use wm_base::color::srgb_decode;
use wm_base::random;
use wm_render::dispatch;
use wm_render::hooks::{PATCH, PATCH_PIXELS, PixelBatch, PixelEffect};
use wm_render::simd::{Lanes, SimdPath};
use wm_scene::splats::Splat;
use wm_scene::{Camera, Group, Lamp, Splats};

const SITE: Site = Site { captured_sky: CapturedSky::Overcast, ..Site::PLAIN };
/// Distance between the splats of the yard.
const SPLAT_SPACING_M: f64 = 0.15;

/// Level ground of 16 x 16 m, with a wall of 1.5 m across it at x = 3.
fn yard() -> Splats {
    let mut splats = Splats::with_capacity(0, 0);
    let mut add = |point: DVec3, normal: DVec3, up: DVec3| {
        let scales = [0.66 * SPLAT_SPACING_M, 0.66 * SPLAT_SPACING_M, 0.05 * SPLAT_SPACING_M];
        let surfel = surfel(point.to_array(), normal, up, scales, [0.5; 3], 0.98);
        splats.push(&Splat { group: Group::Scene, ..surfel });
    };
    let half = (8.0 / SPLAT_SPACING_M) as i32;
    for x in -half..half {
        for y in -half..half {
            add(
                DVec3::new(f64::from(x) + 0.5, f64::from(y) + 0.5, 0.0) * SPLAT_SPACING_M,
                DVec3::Z,
                DVec3::X,
            );
        }
    }
    for y in -half..half {
        for z in 0..10 {
            add(
                DVec3::new(
                    3.0,
                    (f64::from(y) + 0.5) * SPLAT_SPACING_M,
                    (f64::from(z) + 0.5) * SPLAT_SPACING_M,
                ),
                DVec3::NEG_X,
                DVec3::Z,
            );
        }
    }
    splats
}

fn lit(lamp: Lamp, splats: &Splats) -> (CaptureLight, LampShadows) {
    let occluders = Occluders::of(splats, &SITE, &ShelterOptions::default());
    let found = FusedSurfaces::from_splats(splats);
    let capture = CaptureLight::split(splats, &found, &occluders, KnownSun::default(), &[], &SITE);
    let lamps = LampLights::of(&[lamp], &[], 1.0);
    let shadows = LampShadows::of(&lamps, splats, &capture, &splats.means, &SITE).unwrap();
    (capture, shadows)
}

/// Illuminance on the ground by the law of the inverse square, nothing behind the wall, and the
/// same for any number of threads.
#[test]
fn a_lamp_lights_the_yard_up_to_the_shadow_of_its_wall() {
    let splats = yard();
    let lamp = Lamp { aim: Some([0.0, 0.0, -1.0]), kelvin: 4_000.0, ..Lamp::new([0.0, 0.0, 4.0]) };
    let [(capture, shadows), (_, on_one)] = on_threads([2, 1], || lit(lamp, &splats));
    assert_eq!(on_one, shadows);
    let direct = |x: f64, y: f64| {
        let squared = x * x + y * y + 16.0;
        5_000.0 / PI * 16.0 / (squared * squared)
    };
    let at = |x: f64, y: f64| {
        let point = Vec3::new(x as f32, y as f32, 0.0);
        f64::from(shadows.irradiance(point, Vec3::Z).y)
    };
    // Ground returns nothing to level ground: the light under the lamp shines up.
    for (x, y) in [(0.0, 0.0), (1.5, -1.0), (-5.0, 2.0), (2.5, 0.0)] {
        assert!((at(x, y) / direct(x, y) - 1.0).abs() < 0.02, "{x} {y}: {} {}", at(x, y), direct(x, y));
    }
    // The wall of 1.5 m hides the ground from 3 to 4.8 m.
    assert!(at(3.6, 0.0) < 0.01 * direct(3.6, 0.0) && at(4.4, 1.0) < 0.01 * direct(4.4, 1.0));
    assert!((at(5.3, 0.0) / direct(5.3, 0.0) - 1.0).abs() < 0.02, "{}", at(5.3, 0.0));
    // What is placed on the ground gets the same as the ground.
    let near = NearSplats::new(&splats.means, &capture, &SITE);
    let mut board = Splats::with_capacity(0, 0);
    board.push(&surfel([1.5, -1.0, 0.05], DVec3::Z, DVec3::X, [0.1, 0.1, 0.01], [0.5; 3], 0.98));
    let placed = PlacedSurfaces::of(&board, &near, &SITE);
    let on_board = shadows.irradiance(Vec3::from_array(placed.point(0)), placed.normal(0)).y;
    assert!((f64::from(on_board) / direct(1.5, -1.0) - 1.0).abs() < 0.04, "{on_board}");
}

/// [`DepthCube::open_each`] of 16 offsets.
#[inline(always)]
fn open_all<S: Lanes>(simd: S, cube: &DepthCube, offsets: &[[f32; 16]; 3]) -> [f32; 16] {
    let mut open = [0.0; 16];
    for first in (0..16).step_by(S::N) {
        let offset = offsets.each_ref().map(|along| simd.load(&along[first..]));
        cube.open_each(simd, &offset).store_slice(&mut open[first..first + S::N]);
    }
    open
}

#[test]
fn many_points_at_once_are_as_open_as_each() {
    let (_, shadows) = lit(Lamp { kelvin: 4_000.0, ..Lamp::new([0.0, 0.0, 3.0]) }, &yard());
    let (_, cube) = shadows.sources().next().unwrap();
    let mut open = 0;
    for group in 0..200u64 {
        let offsets: [[f32; 16]; 3] = from_fn(|axis| {
            from_fn(|lane| {
                12.0 * random::uniform(3, 48 * group + 16 * axis as u64 + lane as u64) as f32 - 6.0
            })
        });
        let each = dispatch!(SimdPath::widest(), s => open_all(s, cube, &offsets));
        for (lane, each) in each.into_iter().enumerate() {
            let offset = Vec3::from_array(offsets.map(|along| along[lane]));
            assert_eq!(each == 1.0, cube.is_open(offset), "{offset}");
            open += usize::from(each == 1.0);
        }
    }
    assert!((800..2400).contains(&open), "{open}");
}

fn fog(mor: f64) -> Atmosphere {
    let layer = AirLayer {
        sigma_t: [sigma_of_mor(mor); 3],
        airlight: [0.0; 3],
        scale_height: f64::INFINITY,
        base_height: 0.0,
    };
    Atmosphere::new(vec![layer], Site::PLAIN)
}

fn camera() -> Camera {
    Camera::looking((640, 480), 50.0, DVec3::new(0.0, 0.0, 2.0), DVec3::new(30.0, 0.0, 2.0), DVec3::Z)
        .unwrap()
}

/// Linear light that is added to each pixel of a black picture, `[height, width]`, green. `depth`
/// is the view z of a surface that fills the picture.
fn added(glow: &LampGlow, camera: &Camera, depth: Option<f32>) -> Vec<f64> {
    let (width, height) = (camera.width as usize, camera.height as usize);
    let mut picture = vec![0.0; width * height];
    let path = SimdPath::widest();
    for y in (0..height).step_by(PATCH) {
        for x in (0..width).step_by(PATCH) {
            let mut rgb = [[0.0f32; PATCH_PIXELS]; 3];
            let alpha = [if depth.is_some() { 1.0 } else { 0.0 }; PATCH_PIXELS];
            let depth_sum = [depth.unwrap_or(0.0); PATCH_PIXELS];
            let (x, y) = (x as u32, y as u32);
            glow.apply(path, &mut PixelBatch { x, y, rgb: &mut rgb, alpha: &alpha, depth_sum: &depth_sum });
            for (at, value) in rgb[1].iter().enumerate() {
                let place = (y as usize + at / PATCH) * width + x as usize + at % PATCH;
                picture[place] = srgb_decode(f64::from(*value));
            }
        }
    }
    picture
}

/// The light in the air along a ray by a sum of many steps: written from the formula alone.
fn in_the_air(lamp: DVec3, candela: f64, eye: DVec3, ray: DVec3, mor: f64, most: f64) -> f64 {
    let g: f64 = 0.85;
    let (kept, narrow) = (1.0 - g * g, g / (1.0 + g));
    let sigma = 2.995_732_273_553_991 / mor * kept;
    let steps = 200_000;
    // Steps by distance from the place abreast of the lamp, finer there.
    let abreast = (lamp - eye).dot(ray);
    let h = ((lamp - eye).length_squared() - abreast * abreast).sqrt().max(1e-3);
    let [from, to] = [0.0, most].map(|t: f64| ((t - abreast) / h).atan());
    let step = (to - from) / f64::from(steps);
    (0..steps)
        .map(|i| {
            let phi = from + (f64::from(i) + 0.5) * step;
            let t = abreast + h * phi.tan();
            let point = eye + ray * t;
            let way = point - lamp;
            let r = way.length();
            let cos = (way / r).dot(-ray);
            let phase =
                (1.0 - narrow * narrow) / (4.0 * PI * (1.0 + narrow * narrow - 2.0 * narrow * cos).powf(1.5));
            let dt = h / phi.cos().powi(2) * step;
            sigma * candela * phase * (-sigma * (t + r)).exp() / (r * r) * dt
        })
        .sum()
}

/// The light about a lamp in fog, at all distances from its picture, within the bound of 5 %.
#[test]
fn the_halo_is_the_integral() {
    let camera = camera();
    for (x, mor) in [(20.0, 80.0), (60.0, 150.0)] {
        let place = DVec3::new(x, 1.0, 4.0);
        let lamp = LampLight::of_lamp(&Lamp { radius: 0.05, kelvin: 4_000.0, ..Lamp::new(place.to_array()) });
        let air = fog(mor);
        let lamps = LampsOn { lights: &[(lamp, None)], display: 1e-3 };
        let glow = LampGlow::new(&lamps, &camera, &air, &Site::PLAIN, SimdPath::widest());
        let picture = added(&glow, &camera, None);
        let (u, v, _) = camera.project(place).unwrap();
        for (dx, dy) in
            [(14.0, 0.0), (0.0, 25.0), (-30.0, 20.0), (60.0, -40.0), (150.0, 90.0), (-200.0, 30.0)]
        {
            let (px, py) = ((u + dx).floor(), (v + dy).floor());
            let ray = camera.ray(px + 0.5, py + 0.5);
            let candela = f64::from(lamp.intensity[1]);
            let want = in_the_air(place, candela, camera.center(), ray, mor, 3_000.0) * PI * 1e-3;
            let got = picture[py as usize * camera.width as usize + px as usize];
            assert!((got / want - 1.0).abs() < 0.05, "{x} m, {dx} {dy} px: {got}, want {want}");
        }
    }
}

/// Before a wall nothing is seen of what shines behind it.
#[test]
fn the_air_before_a_wall_shows_its_own_light() {
    let (camera, place) = (camera(), DVec3::new(20.0, 2.0, 4.0));
    let lamp = LampLight::of_lamp(&Lamp { radius: 0.05, kelvin: 4_000.0, ..Lamp::new(place.to_array()) });
    let air = fog(60.0);
    let lamps = LampsOn { lights: &[(lamp, None)], display: 1e-3 };
    let glow = LampGlow::new(&lamps, &camera, &air, &Site::PLAIN, SimdPath::widest());
    for depth in [6.0, 15.0, 40.0] {
        let picture = added(&glow, &camera, Some(depth as f32));
        for (px, py) in [(100.0, 240.0), (320.0, 100.0), (500.0, 400.0)] {
            let ray = camera.ray(px + 0.5, py + 0.5);
            let most = depth / ray.dot(camera.forward());
            let candela = f64::from(lamp.intensity[1]);
            let want = in_the_air(place, candela, camera.center(), ray, 60.0, most) * PI * 1e-3;
            let got = picture[py as usize * camera.width as usize + px as usize];
            assert!((got / want - 1.0).abs() < 0.06, "{depth} m, {px} {py}: {got}, want {want}");
        }
    }
}

/// The pixels of a lamp hold its light, however small it is: Allard's law.
#[test]
fn the_picture_of_a_lamp_holds_its_light() {
    let camera = camera();
    for (x, y, mor) in [(15.0, 0.0, f64::INFINITY), (80.0, 25.0, 300.0), (300.0, -60.0, 500.0)] {
        let place = DVec3::new(x, y, 5.0);
        let lamp = LampLight::of_lamp(&Lamp { kelvin: 4_000.0, ..Lamp::new(place.to_array()) });
        let distance = place.distance(camera.center());
        let display = 1e-6 * distance * distance;
        let lamps = LampsOn { lights: &[(lamp, None)], display: display as f32 };
        let clear = LampGlow::new(
            &lamps,
            &camera,
            &Atmosphere::new(vec![], Site::PLAIN),
            &Site::PLAIN,
            SimdPath::widest(),
        );
        let seen = |glow: &LampGlow| {
            let picture = added(glow, &camera, None);
            let solid = |at: usize| {
                let ray = camera.ray((at % 640) as f64 + 0.5, (at / 640) as f64 + 0.5);
                ray.dot(camera.forward()).powi(3) / (camera.fx * camera.fy)
            };
            picture.iter().enumerate().map(|(at, value)| value * solid(at)).sum::<f64>()
        };
        let want = PI * display * f64::from(lamp.intensity[1]) / (distance * distance);
        assert!((seen(&clear) / want - 1.0).abs() < 0.01, "{x} m: {} {want}", seen(&clear));
        // In fog by the whole extinction, without the light in the air.
        if mor.is_finite() {
            let dim = LampsOn { lights: &[(lamp, None)], display: display as f32 };
            let mut glow = LampGlow::new(&dim, &camera, &fog(mor), &Site::PLAIN, SimdPath::widest());
            glow.table.clear();
            let kept = (-2.995_732_273_553_991 / mor * distance).exp();
            assert!((seen(&glow) / (want * kept) - 1.0).abs() < 0.01, "{x} m in fog");
        }
    }
}

/// A particle scatters all that falls on it.
#[test]
fn what_falls_scatters_all_of_its_light() {
    let lamp = LampLight::of_lamp(&Lamp { kelvin: 4_000.0, radius: 0.01, ..Lamp::new([10.0, 0.0, 0.0]) });
    let lamps = LampsOn { lights: &[(lamp, None)], display: 1.0 };
    let (mut sum, count) = (0.0, 4_000);
    for i in 0..count {
        let z = (f64::from(i) + 0.5) / f64::from(count) * 2.0 - 1.0;
        let (sin, cos) = (f64::from(i) * 2.399_963).sin_cos();
        let level = (1.0 - z * z).sqrt();
        // Eyes all around the particle at the origin.
        let eye = DVec3::new(level * cos, level * sin, z).as_vec3();
        sum += f64::from(lamps.scattered(eye, -eye, 0.8, 1.0).y) / f64::from(count);
    }
    let irradiance = f64::from(lamp.intensity[1]) / 100.0;
    // Radiance over its face times 4 pi, shown times pi.
    assert!((sum * 4.0 / irradiance - 1.0).abs() < 0.01, "{sum} {irradiance}");
}

/// A closed house on level ground, and a lantern of 0.2 m around a place.
fn house(lantern: DVec3) -> Splats {
    let mut splats = yard();
    let mut add = |point: DVec3, normal: DVec3, step: f64| {
        let aside = normal.any_orthonormal_vector();
        let scales = [0.66 * step, 0.66 * step, 0.05 * step];
        let surfel = surfel(point.to_array(), normal, aside, scales, [0.5; 3], 0.98);
        splats.push(&Splat { group: Group::Scene, ..surfel });
    };
    let (low, high) = (DVec3::new(-6.0, -2.0, 0.0), DVec3::new(-2.0, 2.0, 3.0));
    for axis in 0..3 {
        for side in [-1.0, 1.0] {
            let normal = DVec3::AXES[axis] * side;
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            for i in 0..((high[u] - low[u]) / SPLAT_SPACING_M) as i32 {
                for j in 0..((high[v] - low[v]) / SPLAT_SPACING_M) as i32 {
                    let mut point = if side < 0.0 { low } else { high };
                    point[u] = low[u] + SPLAT_SPACING_M * (f64::from(i) + 0.5);
                    point[v] = low[v] + SPLAT_SPACING_M * (f64::from(j) + 0.5);
                    add(point, normal, SPLAT_SPACING_M);
                }
            }
        }
    }
    for i in 0..100 {
        let z = (f64::from(i) + 0.5) / 50.0 - 1.0;
        let (sin, cos) = (2.399_963 * f64::from(i)).sin_cos();
        let away = DVec3::new((1.0 - z * z).sqrt() * cos, (1.0 - z * z).sqrt() * sin, z);
        add(lantern + 0.2 * away, away, 0.06);
    }
    splats
}

#[test]
fn a_lamp_in_a_wall_is_told_and_one_in_its_lantern_is_not() {
    let lantern = DVec3::new(0.0, 0.0, 3.0);
    let splats = house(lantern);
    for (at, is_inside) in [
        (lantern, false),
        (DVec3::new(-2.2, 0.0, 1.8), true),
        (DVec3::new(-1.6, 0.0, 1.8), false),
        (DVec3::new(-4.0, 0.0, 2.8), true),
        (DVec3::new(-4.0, 0.0, 3.3), false),
    ] {
        let shadows = lit(Lamp::new(at.to_array()), &splats).1;
        assert_eq!(shadows.enclosed().count(), usize::from(is_inside), "{at}");
    }
}
