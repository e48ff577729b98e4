//! Compares lying snow in rendered pictures of the built-in street with rays cast into its exact
//! geometry.

use glam::DVec3;
use std::sync::OnceLock;
use wm_render::{
    CpuConfig, CpuRenderer, DrawPass, Frame, Geometry, MedianDepth, Outputs, RenderBackend, RenderConfig,
    SetView,
};
use wm_scene::{Camera, Group, Splats, sh};
use wm_street::{Place, Street as StreetGeometry};
use wm_weather::Site;
use wm_weather::cover::{Airflow, Cover, CoverMaterial, CoverRequest};
use wm_weather::fused_surfaces::FusedSurfaces;

const SIZE: (u32, u32) = (300, 200);
const SNOW_DEPTH_M: f64 = 0.1;

/// The street with its snow, snow white and all else black.
struct Street {
    place: Place,
    baked: Splats,
}

/// Exposure and slope of a point of the street, by ray casting.
#[derive(Clone, Copy)]
struct Truth {
    /// Share of the sky that what falls comes from, 0-1.
    exposure: f64,
    /// Degrees.
    slope: f64,
}

impl Street {
    fn get() -> &'static Self {
        static MADE: OnceLock<Street> = OnceLock::new();
        MADE.get_or_init(|| {
            let place = StreetGeometry::builtin();
            let sampling = place.sampling(1.0);
            let scene = sampling.splats_in(0..sampling.len());
            let site = Site::PLAIN;
            let mut cover = Cover::of(
                &scene,
                &FusedSurfaces::from_splats(&scene),
                &site,
                &Airflow::default(),
                [[0.0, 30.0, 0.0]; 2],
            );
            let asked = CoverRequest {
                depth: SNOW_DEPTH_M,
                thaw: None,
                wet_fall: 0.0,
                repose: 0.9,
                threshold: f64::INFINITY,
                material: CoverMaterial { color: [0.8; 3], shade: [0.2; 3] },
            };
            let mut baked = cover.lay_all(&[asked]).bake(&scene);
            println!("{} splats, {} with snow", scene.len(), baked.len());
            let is_snow: Vec<bool> = baked.groups.iter().map(|group| *group == Group::Snow).collect();
            for (rgb, is_snow) in baked.sh.chunks_mut(3).zip(is_snow) {
                rgb.fill(sh::dc_of(f64::from(u8::from(is_snow))) as f32);
            }
            Self { place, baked }
        })
    }

    fn view(name: &str) -> Camera {
        let views = StreetGeometry::views();
        views.iter().find(|view| view.name == name).unwrap().camera(SIZE).unwrap()
    }

    /// Returns for each pixel whether it shows snow, and the point that it shows.
    fn mask(&self, camera: &Camera) -> Vec<(bool, Option<DVec3>)> {
        let mut renderer = CpuRenderer::new(CpuConfig::default()).unwrap();
        let set = renderer.load(&self.baked).unwrap();
        let outputs =
            Outputs { geometry: Geometry::Depth, median_depth: MedianDepth::On, ..Outputs::default() };
        let config = RenderConfig { outputs, ..RenderConfig::default() };
        let mut frame = Frame::default();
        let sets = [SetView::plain(set)];
        let job = DrawPass::new(&sets, camera, &config);
        renderer.render(&job, &mut frame).unwrap();
        let pixel = |index: usize| {
            let (x, y) = (index as u32 % SIZE.0, index as u32 / SIZE.0);
            let ray = camera.ray(f64::from(x) + 0.5, f64::from(y) + 0.5);
            let z = f64::from(frame.median_depth[index]);
            let point = camera.center() + ray * (z / ray.dot(camera.forward()));
            (frame.rgb[3 * index] > 0.5, (z > 0.0).then_some(point))
        };
        (0..frame.alpha.len()).map(pixel).collect()
    }

    fn truth(&self, at: DVec3, normal: DVec3) -> Truth {
        let over = at + DVec3::Z * 0.03 + normal * 0.03;
        // Two circles of the flakes' spread.
        let ways = (0..24).map(|k| {
            let (sin, cos) = (f64::from(k) * std::f64::consts::TAU / 12.0).sin_cos();
            let slope = if k < 12 { 0.15 } else { 0.3 };
            DVec3::new(slope * cos, slope * sin, 1.0)
        });
        let open = ways.filter(|way| self.place.first(over, *way).is_none()).count();
        Truth { exposure: open as f64 / 24.0, slope: normal.z.clamp(-1.0, 1.0).acos().to_degrees() }
    }

    /// The surface below a point, up to so far.
    fn below(&self, at: DVec3, reach: f64) -> Option<(DVec3, DVec3)> {
        let surface = self.place.first(at, -DVec3::Z).filter(|surface| surface.t < reach)?;
        Some((at - DVec3::Z * surface.t, surface.normal))
    }
}

#[test]
fn what_is_open_is_white_and_what_is_not_is_bare() {
    let street = Street::get();
    let (mut open, mut covered, mut bare, mut wrong, mut snow, mut astray) = (0, 0, 0, 0, 0, 0);
    for name in ["street", "porch", "corner", "lime", "high"] {
        let camera = Street::view(name);
        let mask = street.mask(&camera);
        let before = (open, covered, bare, wrong, snow, astray);
        for (index, (is_snow, seen)) in mask.into_iter().enumerate() {
            let (x, y) = (index as u32 % SIZE.0, index as u32 / SIZE.0);
            let ray = camera.ray(f64::from(x) + 0.5, f64::from(y) + 0.5);
            let Some(surface) = street.place.first(camera.center(), ray) else { continue };
            let at = camera.center() + ray * surface.t;
            let truth = street.truth(at, surface.normal);
            if truth.exposure > 0.9 && truth.slope < 30.0 {
                open += 1;
                covered += u32::from(is_snow);
            }
            // Steep or sheltered, and seen: not behind snow that lies before it.
            let stands_before = seen.is_some_and(|seen| is_snow && seen.distance(at) > 0.15);
            // The slope of a leaf says nothing: snow lies on the crown.
            let is_leaf = surface.material.is_foliage();
            if (truth.exposure == 0.0 || truth.slope > 60.0) && !stands_before && !is_leaf {
                bare += 1;
                wrong += u32::from(is_snow);
            }
            // What snow lies on.
            let Some(seen) = seen.filter(|_| is_snow) else { continue };
            let Some((at, normal)) = street.below(seen + DVec3::Z * 0.05, 0.4) else { continue };
            let truth = street.truth(at, normal);
            snow += 1;
            astray += u32::from(truth.exposure == 0.0 || truth.slope > 60.0);
        }
        let share = |a: i32, b: i32| f64::from(a) / f64::from(b.max(1));
        let part = |a: u32, b: u32| (a - b) as i32;
        println!(
            "{name}: {:.4} of {} open, {:.4} of {} bare, {:.4} of {} snow astray",
            share(part(covered, before.1), part(open, before.0)),
            open - before.0,
            share(part(wrong, before.3), part(bare, before.2)),
            bare - before.2,
            share(part(astray, before.5), part(snow, before.4)),
            snow - before.4
        );
    }
    let share = |a: u32, b: u32| f64::from(a) / f64::from(b);
    println!("all: {:.4} {:.4} {:.4}", share(covered, open), share(wrong, bare), share(astray, snow));
    assert!(share(covered, open) >= 0.97 && share(wrong, bare) <= 0.02 && share(astray, snow) <= 0.02);
}

/// Points that show snow in one view show it in every other view that sees them.
#[test]
fn two_views_see_the_same_snow() {
    let street = Street::get();
    let walk = |time: f64| StreetGeometry::dolly(time).camera(SIZE).unwrap();
    let pairs = [
        ("street, high", [Street::view("street"), Street::view("high")]),
        ("walk at 0.0 and 0.1", [walk(0.0), walk(0.1)]),
        ("walk at 0.3 and 0.4", [walk(0.3), walk(0.4)]),
        ("walk at 0.6 and 0.7", [walk(0.6), walk(0.7)]),
        ("walk at 0.9 and 0.95", [walk(0.9), walk(0.95)]),
    ];
    for (name, cameras) in pairs {
        let [here, there] = cameras.each_ref().map(|camera| street.mask(camera));
        let (mut both, mut either, mut seen) = (0, 0, 0);
        for (is_snow, point) in here {
            let Some(point) = point else { continue };
            let Some((x, y, _)) = cameras[1].project(point) else { continue };
            if x < 0.0 || y < 0.0 || x >= f64::from(SIZE.0) || y >= f64::from(SIZE.1) {
                continue;
            }
            let (is_snow_there, other) = there[y as usize * SIZE.0 as usize + x as usize];
            // Not hidden by something else.
            if other.is_none_or(|other| other.distance(point) > 0.1) {
                continue;
            }
            seen += 1;
            both += u32::from(is_snow && is_snow_there);
            either += u32::from(is_snow || is_snow_there);
        }
        let overlap = f64::from(both) / f64::from(either);
        println!("{name}: {seen} points, {either} with snow, overlap {overlap:.4}");
        assert!(either > 1000 && overlap >= 0.95, "{name}: {overlap}");
    }
}
