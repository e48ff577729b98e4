//! A yard with a wall under a sun, whose light is known.

use super::irradiance::{SceneLight, SkyGradation};
use super::{CaptureLight, KnownSun, LightCasts, LightGains, NewLight, ShadowCasters, SunShadows};
use crate::fused_surfaces::FusedSurfaces;
use crate::optics::{CapturedSky, Site};
use crate::shelter::{Occluders, ShelterOptions};
use crate::surfel::surfel;
use crate::testing::{self, on_threads};
use glam::DVec3;
use wm_base::color::{luminance, srgb_encode};
use wm_base::random::uniform;
use wm_scene::splats::Splat;
use wm_scene::{Group, Splats};

/// Distance between splats.
const SPLAT_SPACING_M: f64 = 0.1;
/// Half of the yard's width.
const YARD_HALF_WIDTH_M: f64 = 8.0;
/// Two walls, since the shadow of one is alike for many suns: the axis that each stands across and
/// its place along that, the middle and half of its length, m.
const WALLS: [(usize, f64, f64, f64); 2] = [(0, 1.0, 0.0, 4.0), (1, 3.0, -3.5, 2.5)];
/// Height of the walls.
const WALL_HEIGHT_M: f64 = 2.4;

fn sun() -> DVec3 {
    DVec3::new(0.55, 0.35, 0.75).normalize()
}

fn is_lit(point: DVec3, sun: DVec3) -> bool {
    WALLS.into_iter().all(|(across, at, middle, half)| {
        let way = (at - point[across]) / sun[across];
        let hit = point + sun * way;
        way <= 0.05 || (hit[1 - across] - middle).abs() > half || hit.z > WALL_HEIGHT_M
    })
}

/// The yard with ground and wall of albedo 0.3 with some texture, in a light whose level irradiance
/// brings a white card to 1.3.
fn yard(light: &SceneLight) -> Splats {
    let mut splats = Splats::with_capacity(0, 0);
    let mut add = |point: DVec3, normal: DVec3, up: DVec3, key: u64| {
        let incidence = normal.dot(sun()).max(0.0) * f64::from(u8::from(is_lit(point, sun())));
        // Walls take little of the yard's sky: an open yard is what is tested.
        let sky = light.sky.irradiance().map(|v| v * if normal.z > 0.5 { 1.0 } else { 0.5 });
        let texture = 0.3 * (0.85 + 0.3 * uniform(3, key));
        let shown =
            [0, 1, 2].map(|k| srgb_encode(1.3 * texture * (light.sun[k] * incidence + sky[k])) as f32);
        let scales = [0.66 * SPLAT_SPACING_M, 0.66 * SPLAT_SPACING_M, 0.1 * SPLAT_SPACING_M];
        splats.push(&Splat {
            group: Group::Scene,
            ..surfel(point.to_array(), normal, up, scales, shown, 0.98)
        });
    };
    let count = (2.0 * YARD_HALF_WIDTH_M / SPLAT_SPACING_M) as usize;
    for i in 0..count * count {
        let [x, y] = [i % count, i / count].map(|v| -YARD_HALF_WIDTH_M + SPLAT_SPACING_M * (v as f64 + 0.5));
        add(DVec3::new(x, y, 0.0), DVec3::Z, DVec3::X, i as u64);
    }
    for (across, at, middle, half) in WALLS {
        let (long, high) =
            ((2.0 * half / SPLAT_SPACING_M) as usize, (WALL_HEIGHT_M / SPLAT_SPACING_M) as usize);
        for i in 0..long * high {
            for side in [-1.0, 1.0] {
                let (mut point, mut normal) = (DVec3::ZERO, DVec3::ZERO);
                point[across] = at + 0.03 * side;
                point[1 - across] = middle - half + SPLAT_SPACING_M * ((i % long) as f64 + 0.5);
                point.z = SPLAT_SPACING_M * ((i / long) as f64 + 0.5);
                normal[across] = side;
                add(
                    point,
                    normal,
                    DVec3::Z,
                    ((across as u64 + 1) << 40) + 2 * i as u64 + u64::from(side > 0.0),
                );
            }
        }
    }
    splats
}

fn site() -> Site {
    Site { metres_per_unit: 1.0, up: [0.0, 0.0, 1.0], ground: 0.0, ..testing::SITE }
}

fn split(splats: &Splats) -> CaptureLight {
    split_at(&site(), splats)
}

fn split_at(site: &Site, splats: &Splats) -> CaptureLight {
    let occluders = Occluders::of(splats, site, &ShelterOptions::default());
    split_knowing(KnownSun::default(), &occluders, site, splats)
}

fn split_knowing(known: KnownSun, occluders: &Occluders, site: &Site, splats: &Splats) -> CaptureLight {
    CaptureLight::split(splats, &FusedSurfaces::from_splats(splats), occluders, known, &[], site)
}

/// Sun and sky of which level ground gets 1 in all, the sun `ratio` times the sky.
fn sunny(ratio: [f64; 3]) -> SceneLight {
    let sky = ratio.map(|ratio| 1.0 / (1.0 + ratio * sun().z));
    SceneLight { sun: std::array::from_fn(|k| sky[k] * ratio[k]), sky: SkyGradation::even(sky) }
}

fn new(light: SceneLight) -> NewLight {
    NewLight { light, sin_sun: sun().z, sky_gain: 1.0, sky_opacity: 1.0, is_diffuse: false, lamps: 0.0 }
}

/// A yard that was captured under clouds gets a sun, whose shadows lie where the walls cast them.
#[test]
fn a_new_sun_casts_shadows() {
    let splats = yard(&SceneLight { sun: [0.0; 3], sky: SkyGradation::overcast([1.0; 3]) });
    let site = Site { captured_sky: CapturedSky::Overcast, ..site() };
    let occluders = Occluders::of(&splats, &site, &ShelterOptions::default());
    let capture = split_at(&site, &splats);
    assert!(capture.takes_another_sun(false) && capture.sun.is_none());
    let other = DVec3::new(-0.5, 0.6, 0.62).normalize();
    let casters = ShadowCasters::new(splats.means.clone(), &occluders);
    let [shadows, on_more] =
        on_threads([2, 7], || SunShadows::of(&casters, &capture, other.to_array(), &site));
    assert_eq!(shadows, on_more);
    let light = SceneLight { sun: [1.2; 3], sky: SkyGradation::even([0.2; 3]) };
    let new = NewLight { sin_sun: other.z, ..new(light) };
    let relit =
        LightGains::new(&capture, &new, LightCasts { shadows: Some(&shadows), lamps: None }, None, site.up)
            .applied(&splats);
    let (mut gains, mut wrong) = ([Vec::new(), Vec::new()], 0);
    for (index, mean) in splats.means.iter().enumerate() {
        let point = DVec3::from_array(mean.map(f64::from));
        if point.z == 0.0 && point.truncate().length() < 6.0 {
            let light = |splats| super::places::light_of(splats, index).y;
            let gain = f64::from(light(&relit) / light(&splats));
            let lit = is_lit(point, other);
            gains[usize::from(lit)].push(gain);
            wrong += usize::from((gain > 0.6) != lit);
        }
    }
    let all = gains[0].len() + gains[1].len();
    let [shade, lit] = gains.map(|mut gains| {
        let middle = gains.len() / 2;
        *gains.select_nth_unstable_by(middle, f64::total_cmp).1
    });
    assert!(25 * wrong < all, "{wrong} of {all} on the wrong side of an edge");
    assert!((lit / (1.2 * other.z + 0.2) - 1.0).abs() < 0.1, "{lit}");
    assert!((0.15..0.35).contains(&shade), "{shade}");
}

#[test]
fn the_sun_of_a_yard_is_found_and_its_shadow_goes() {
    let ratio = [4.0, 3.4, 2.8];
    let splats = yard(&sunny(ratio));
    let light = split(&splats);
    let found = light.sun.unwrap_or_else(|| panic!("{}", light.report(site().up)));
    let off = DVec3::from_array(found.direction).angle_between(sun()).to_degrees();
    assert!(off < 1.5, "{off} degrees off");
    for k in 0..3 {
        assert!((found.ratio[k] / ratio[k] - 1.0).abs() < 0.15, "{:?}", found.ratio);
    }
    assert!(light.is_split() && found.contrast_left < 0.1, "{found:?}");

    // Under clouds ground that lay in the shadow is as bright as ground that lay in the sun.
    let overcast = SceneLight { sun: [0.0; 3], sky: SkyGradation::overcast([1.0; 3]) };
    let relit =
        LightGains::new(&light, &new(overcast), LightCasts::default(), None, site().up).applied(&splats);
    let mean = |splats: &Splats, lit: bool| {
        let (mut sum, mut count) = (0.0, 0.0);
        for (index, mean) in splats.means.iter().enumerate() {
            let point = DVec3::from_array(mean.map(f64::from));
            // The feet of walls get less of the sky, and lie in the same shadow.
            let is_open = point.z == 0.0
                && point.truncate().length() < 6.0
                && WALLS.iter().all(|(across, at, ..)| (point[*across] - at).abs() > 0.5);
            if is_open && is_lit(point, sun()) == lit {
                let light = super::places::light_of(splats, index).to_array().map(f64::from);
                sum += luminance(light);
                count += 1.0;
            }
        }
        assert!(count > 500.0, "{count} splats");
        sum / count
    };
    let before = mean(&splats, true) / mean(&splats, false);
    let after = mean(&relit, true) / mean(&relit, false);
    assert!(before > 3.0, "{before}");
    assert!((after - 1.0).abs() < 0.1 * (before - 1.0), "{before} to {after}");
}

#[test]
fn a_yard_under_clouds_has_no_sun() {
    let light = split(&yard(&SceneLight { sun: [0.0; 3], sky: SkyGradation::even([1.0; 3]) }));
    assert_eq!(light.sun, None);
    assert!(light.report(site().up).starts_with("no sun"), "{}", light.report(site().up));
}

/// Dark patches no darker than dirt or the corners of walls are no evidence, even where a sun would
/// cast them.
#[test]
fn faint_patches_are_no_shadows() {
    for (ratio, is_sun) in [(0.35, false), (1.5, true)] {
        let light = split(&yard(&sunny([ratio; 3])));
        let search = light.search.expect("the ground tells");
        assert_eq!(search.is_sun(site().up), is_sun, "{ratio}: {search:?}");
    }
}

/// A white sky may be overexposed, and a grey one the clouds of a sunny day: both count as clouded
/// only without shadows.
#[test]
fn white_and_grey_skies_without_shadows_are_clouds() {
    for captured_sky in [CapturedSky::Burned, CapturedSky::Overcast] {
        let site = Site { captured_sky, ..site() };
        let clouds = SceneLight { sun: [0.0; 3], sky: SkyGradation::even([1.0; 3]) };
        assert!(split_at(&site, &yard(&clouds)).is_overcast, "{captured_sky:?}");
        let shadowed = split_at(&site, &yard(&sunny([4.0, 3.4, 2.8])));
        assert!(!shadowed.is_overcast && shadowed.is_split(), "{captured_sky:?}");
    }
}

/// The elevation of the sun is known, and its azimuth is found by the shadows.
#[test]
fn a_known_elevation_is_kept() {
    let splats = yard(&sunny([4.0, 3.4, 2.8]));
    let occluders = Occluders::of(&splats, &site(), &ShelterOptions::default());
    let elevation = sun().z.asin();
    let known = KnownSun { direction: None, elevation: Some(elevation) };
    let found = split_knowing(known, &occluders, &site(), &splats).sun.unwrap();
    let direction = DVec3::from_array(found.direction);
    assert!((direction.z.asin() - elevation).abs() < 1e-6, "{direction}");
    assert!(direction.angle_between(sun()).to_degrees() < 2.0, "{direction}");
}

#[test]
fn threads_do_not_change_the_split() {
    let splats = yard(&sunny([4.0, 3.4, 2.8]));
    let [one, seven] = on_threads([1, 7], || split(&splats));
    assert_eq!(one, seven);
}

#[test]
fn the_captured_light_changes_nothing() {
    let splats = yard(&sunny([4.0, 3.4, 2.8]));
    let light = split(&splats);
    let same =
        LightGains::new(&light, &new(light.light), LightCasts::default(), None, site().up).applied(&splats);
    let worst = same.sh.iter().zip(&splats.sh).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(worst < 1e-5, "{worst}");
}

#[test]
fn ground_whose_normals_turn_to_all_sides_is_lit_as_level_ground() {
    let mut splats = Splats::with_capacity(0, 0);
    let mut add = |point: [f64; 3], color: [f32; 3], key: u64| {
        let side = |lane: u64| uniform(8, 3 * key + lane) - 0.5;
        let normal = DVec3::new(side(0), side(1), side(2)).normalize();
        let scales = [0.66 * SPLAT_SPACING_M, 0.66 * SPLAT_SPACING_M, 0.1 * SPLAT_SPACING_M];
        splats.push(&surfel(point, normal, normal.any_orthonormal_vector(), scales, color, 0.98));
    };
    let count = (2.0 * YARD_HALF_WIDTH_M / SPLAT_SPACING_M) as usize;
    for i in 0..count * count {
        let [x, y] = [i % count, i / count].map(|v| -YARD_HALF_WIDTH_M + SPLAT_SPACING_M * (v as f64 + 0.5));
        // One half is paved, the other is a lawn.
        let color = if x < 0.0 { [0.5, 0.48, 0.45] } else { [0.3, 0.5, 0.2] };
        add([x, y, 0.0], color, i as u64);
    }
    let found = split(&splats);
    let upright = |x: f64| {
        let is_here = |i: &usize| (f64::from(splats.means[*i][0]) - x).abs() < 3.0;
        let all: Vec<f64> =
            (0..splats.len()).filter(is_here).map(|i| found.surface(i, site().up).upright).collect();
        all.iter().sum::<f64>() / all.len() as f64
    };
    assert!(upright(-4.5) > 0.9, "{}", upright(-4.5));
    assert!(upright(4.5) < 0.1, "{}", upright(4.5));
}
