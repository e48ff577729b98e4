//! Shadow gauge: what is left, under clouds, of the shadows that the place was captured with.
//!
//! The place is seen from the sun, far away: a point of a view that lies behind what is seen from
//! there is in its shadow, whatever the program's own maps say. Pairs of places in the view, less
//! than a metre apart on one surface of one colour, of which one lies well in the sun and the other
//! well in the shade, have a ratio of light; its logarithm, in the median over pairs, is the
//! contrast of the shadows. The contrast left is that under clouds over that of the place as it was
//! captured.
//!
//! The shaded side of a pair often sees less of the sky too, and is darker under clouds in truth.
//! Views of the place from all over the sky tell how much of a CIE overcast sky each side sees, and
//! so the contrast that clouds leave in truth. Contrasts are measured from that.
//!
//! Bounds: 10 % on a place that was never photographed, such as the built-in street, 20 % on one
//! that was reconstructed from photos. A place that was captured under clouds must not change: less
//! than 1 % in the mean.

use super::lit::GROUND_REFLECTANCE;
use super::plot::Series;
use super::{
    Bench, Instrument, MeasuredPicture, SURFACES, ShadowReport, ShotSubject, Tolerance, changed, clear,
    expected, fov_of, mean, median,
};
use glam::{DQuat, DVec3};
use wm_base::color::luminance;
use wm_place::{Layers, Result};
use wm_scene::Camera;
use wm_weather::{CapturedSky, Site, Weather};

/// The instrument.
pub(crate) const INSTRUMENT: Instrument = Instrument {
    name: "shadows",
    title: "Shadow gauge",
    about: "The place is seen from its own sun to tell what lies in shadow. Pairs of places of one colour across the edges of shadows \
            are compared before and after clouds come: the contrast that is left, in the median. A place that was captured under clouds must stay as it is.",
    applies: |weather, time| {
        ["overcast", "auto"].iter().any(|model| expected::says(weather, time, "light", "model", model))
    },
    measure,
    sweep: &["light.model=overcast", "light.model=auto, rain.rate=10"],
};

/// Turns of the camera about up, degrees.
const TURNS_DEGREES: [f64; 3] = [0.0, -50.0, 50.0];
/// Farthest points that are looked at, and distance from which the place is seen in place of the
/// sun, m.
const MAX_POINT_DISTANCE_M: f64 = 25.0;
const SUN_DISTANCE_M: f64 = 10_000.0;
/// Side of the picture from the sun, px.
const SUN_SIDE_PX: u32 = 1_200;
/// Places of the sky from which the place is seen, and side of those pictures, px.
const SKY_VIEWS: usize = 48;
const SKY_SIDE_PX: u32 = 500;
/// Distance, m, and pixels of the picture across the surface, by which something stands before a
/// point that hides that part of the sky.
const OCCLUDER_DISTANCE_M: f64 = 0.1;
const OCCLUDER_DISTANCE_PX: f64 = 1.5;
/// Distances between the places of a pair, px, and least and most, m.
const PAIR_OFFSETS_PX: [usize; 2] = [8, 14];
const PAIR_DISTANCES_M: [f64; 2] = [0.15, 1.0];
/// Distances, m, between a point and the first surface that the sun sees on the way to it: above
/// the first the point is in the shade, below the second it is in the sun.
const SHADE_DISTANCES_M: [f64; 2] = [0.5, 0.2];
/// Pixels of the picture from the sun that must agree, to each side.
const AGREEING_PIXELS: i64 = 3;
/// Least cosines: between the normals of a pair, and of the incidence.
const MIN_NORMAL_COSINE: f64 = 0.97;
const MIN_INCIDENCE_COSINE: f64 = 0.3;
/// Largest distance of a place from the plane of the other, m, and difference of chromaticity.
const MAX_PLANE_DISTANCE_M: f64 = 0.06;
const MAX_CHROMATICITY_DIFFERENCE: f64 = 0.05;
/// Ratio of light across an edge from which on it is seen as one, as a logarithm.
const MIN_LOG_CONTRAST: f64 = 0.26;
/// Most contrast that is left on places that were never photographed, and on those that were.
const MAX_SAMPLED_CONTRAST: f64 = 0.1;
const MAX_RECONSTRUCTED_CONTRAST: f64 = 0.2;
/// Farthest that a pair's contrast is from the median, as a logarithm.
const MAX_LOG_SPREAD: f64 = 0.4;
/// Fewest pairs that tell something.
const MIN_PAIRS: usize = 60;

/// A pixel of a view of the place.
#[derive(Clone, Copy)]
struct ShadowPoint {
    /// World, scene units.
    at: DVec3,
    normal: DVec3,
    /// The sun shines on it, or something stands before that; `None` where it is not sure.
    lit: Option<bool>,
}

/// Two places of one colour, the first in the sun and the second in the shade.
struct ShadowPair {
    /// Log of the ratio of their light as captured, and under clouds.
    own: f64,
    left: f64,
    places: [ShadowPoint; 2],
}

/// The depth of the place, seen from far away.
struct FarView {
    camera: Camera,
    /// `[side, side]`; 0 where nothing is.
    depth: Vec<f32>,
    metres_per_unit: f64,
}

impl FarView {
    /// The place about some points, seen from a direction in a square picture of a side, px.
    fn of(bench: &mut Bench<'_>, points: &[DVec3], towards: DVec3, side: u32) -> Result<Self> {
        let site = bench.level.site;
        let middle = points.iter().sum::<DVec3>() / points.len() as f64;
        let reach =
            points.iter().map(|at| (at - middle).reject_from(towards).length()).fold(0.0, f64::max) * 1.05;
        let away = SUN_DISTANCE_M / site.metres_per_unit;
        let fov = fov_of(reach / away);
        let up = DVec3::from_array(site.up);
        let up = if up.dot(towards).abs() > 0.999 { towards.any_orthonormal_vector() } else { up };
        let mut camera = Camera::looking((side, side), fov, middle + towards * away, middle, up)?;
        camera.near = 0.5 * away;
        // Without the sky, which stands between.
        let weather = changed(&clear(), "sky=overcast, sky.scene_sky=replace")?;
        let shot = PlaceShot::of(bench, &camera, &weather, SURFACES)?;
        Ok(Self { camera, depth: shot.frame.median_depth, metres_per_unit: site.metres_per_unit })
    }

    /// Width of a pixel at the place, m.
    fn pixel(&self) -> f64 {
        SUN_DISTANCE_M / self.camera.fx
    }

    /// Distance by which a point lies behind the first surface at its pixel, or at a pixel so many
    /// columns and rows off, m; `None` where the pixel shows no surface.
    fn behind(&self, at: DVec3, dx: i64, dy: i64) -> Option<f64> {
        let Self { camera, depth, .. } = self;
        let offset = at - camera.center();
        let (z, view) = (offset.dot(camera.forward()), camera.rotation() * offset);
        let [x, y] = [camera.fx * view.x / z + camera.cx, camera.fy * view.y / z + camera.cy];
        let (x, y) = (x as i64 + dx, y as i64 + dy);
        let side = i64::from(camera.width);
        let is_in = (0..side).contains(&x) && (0..side).contains(&y);
        let first = f64::from(depth[(is_in.then_some(y * side + x)?) as usize]);
        (first > 0.0).then_some((z - first) * self.metres_per_unit)
    }
}

/// A view of the place.
struct PlaceShot {
    camera: Camera,
    frame: wm_render::Frame,
    light: Vec<f32>,
}

impl PlaceShot {
    fn of(bench: &mut Bench<'_>, camera: &Camera, weather: &Weather, layers: Layers) -> Result<Self> {
        let picture = bench.draw(ShotSubject::Place, camera, weather, layers)?;
        let light = picture.frame.rgb_linear();
        Ok(Self { camera: *camera, frame: picture.frame, light })
    }

    /// Mean light of the pixels about one, linear RGB.
    fn rgb(&self, pixel: usize) -> [f64; 3] {
        let width = self.frame.width as usize;
        let around = [pixel - 1, pixel, pixel + 1, pixel - width, pixel + width];
        std::array::from_fn(|k| mean(around.iter().map(|at| f64::from(self.light[3 * at + k]))))
    }

    /// The point of the surface that a pixel shows.
    fn point(&self, pixel: usize) -> Option<DVec3> {
        let (width, z) = (self.frame.width as usize, f64::from(self.frame.median_depth[pixel]));
        let ray = self.camera.ray((pixel % width) as f64 + 0.5, (pixel / width) as f64 + 0.5);
        (z > 0.0).then(|| self.camera.center() + ray * (z / ray.dot(self.camera.forward())))
    }
}

fn measure(bench: &mut Bench<'_>) -> Result<()> {
    match bench.rig.shadows()? {
        ShadowReport::Split { sun, is_photographed } => {
            let most = if is_photographed { MAX_RECONSTRUCTED_CONTRAST } else { MAX_SAMPLED_CONTRAST };
            contrast(bench, sun, Tolerance::Above(most))
        }
        ShadowReport::None => control(bench),
        // The program says that it leaves them.
        ShadowReport::Kept { sun } => contrast(bench, sun, Tolerance::None),
    }
}

/// Turns a camera about up.
fn turned(camera: &Camera, site: &Site, degrees: f64) -> Camera {
    let turn =
        glam::DMat3::from_quat(DQuat::from_axis_angle(DVec3::from_array(site.up), degrees.to_radians()));
    let rotation = camera.rotation() * turn;
    Camera { viewmat: wm_scene::camera::viewmat_of(rotation, -(rotation * camera.center())), ..*camera }
}

/// Measures what is left of shadows.
fn contrast(bench: &mut Bench<'_>, sun: DVec3, tolerance: Tolerance) -> Result<()> {
    let site = bench.level.site;
    let [camera, _] = bench.rig.views()?;
    let cloudy = bench.with_light("light.clouds=1")?;
    let layers = SURFACES.with(Layers::NORMAL);
    let mut found: Vec<ShadowPair> = Vec::new();
    for degrees in TURNS_DEGREES {
        let camera = turned(&camera, &site, degrees);
        let captured = PlaceShot::of(bench, &camera, &clear(), layers)?;
        let Some(seen) = seen_points(bench, &captured, sun)? else { continue };
        let relit = PlaceShot::of(bench, &camera, &cloudy, SURFACES)?;
        for [lit, shaded] in pairs(&captured, &seen, &site) {
            let ratio = |shot: &PlaceShot| {
                (luminance(shot.rgb(lit)).max(1e-6) / luminance(shot.rgb(shaded)).max(1e-6)).ln()
            };
            let (own, left) = (ratio(&captured), ratio(&relit));
            if own > MIN_LOG_CONTRAST {
                found.extend(seen[lit].zip(seen[shaded]).map(|places| ShadowPair {
                    own,
                    left,
                    places: places.into(),
                }));
            }
        }
        if degrees == TURNS_DEGREES[0] {
            let size = (camera.width, camera.height);
            let shade = seen.iter().map(|point| match point.and_then(|point| point.lit) {
                Some(true) => 1.0,
                Some(false) => 0.0,
                None => 0.5,
            });
            bench.finding.pictures.push(MeasuredPicture::of("as captured", &captured.frame));
            bench.show_picture(MeasuredPicture::of("under clouds", &relit.frame));
            let told = MeasuredPicture::grey("seen from the sun: white is lit", shade, size);
            bench.finding.pictures.push(told);
        }
    }
    // A contrast far from that of most pairs is one of materials: black and white are of one hue.
    let most = median(found.iter().map(|pair| pair.own).collect());
    found.retain(|pair| (pair.own - most).abs() < MAX_LOG_SPREAD);
    let under_sky = contrasts_under_sky(bench, &found)?;
    let of_pairs = |value: fn(&ShadowPair) -> f64| {
        median(found.iter().zip(&under_sky).map(|(pair, under_sky)| value(pair) - under_sky).collect())
    };
    let count = found.len();
    let left = (of_pairs(|pair| pair.left) / of_pairs(|pair| pair.own)).abs();
    let points: Vec<[f64; 2]> = found.iter().map(|pair| [pair.own, pair.left]).collect();
    let is_told = count >= MIN_PAIRS;
    bench.add(
        if is_told {
            format!("contrast left of shadows, median of {count} pairs")
        } else {
            format!("contrast left of shadows, too few to tell: {count} pairs")
        },
        "",
        [0.0, left],
        if is_told { tolerance } else { Tolerance::None },
    );
    let few = points.iter().step_by((count / 600).max(1)).copied().collect();
    bench.plot(
        "Light over shade",
        "log of the ratio, as captured",
        "log of the ratio, under clouds",
        vec![
            Series::line("as before", vec![[0.0; 2], [2.0; 2]]),
            Series::line("none", vec![[0.0; 2], [2.0, 0.0]]),
            Series::points("pairs", few),
        ],
    );
    Ok(())
}

/// The log of the ratio of light of each pair under the CIE's overcast sky: by the parts of the sky
/// that the first and the second see, and what comes from other surfaces instead of the rest.
fn contrasts_under_sky(bench: &mut Bench<'_>, pairs: &[ShadowPair]) -> Result<Vec<f64>> {
    let places: Vec<ShadowPoint> = pairs.iter().flat_map(|pair| pair.places).collect();
    if places.len() < 2 * MIN_PAIRS {
        return Ok(vec![0.0; pairs.len()]);
    }
    let points: Vec<DVec3> = places.iter().map(|place| place.at).collect();
    // The light of the sky, and the part of all that a surface sees which is sky.
    let mut light = vec![[0.0f64; 2]; places.len()];
    for k in 0..SKY_VIEWS {
        // A spiral of equal parts of the upper half of the sphere.
        let z = (k as f64 + 0.5) / SKY_VIEWS as f64;
        let (sin, cos) = (std::f64::consts::TAU * 0.618_034 * k as f64).sin_cos();
        let r = (1.0 - z * z).sqrt();
        let towards = bench.level.vector([r * cos, r * sin, z]).normalize();
        let view = FarView::of(bench, &points, towards, SKY_SIDE_PX)?;
        for (place, [sky, part]) in places.iter().zip(&mut light) {
            let facing = place.normal.dot(towards);
            if facing <= 0.0 {
                continue;
            }
            let slope = (1.0 - facing * facing).sqrt() / facing.max(0.02);
            let most = OCCLUDER_DISTANCE_M + OCCLUDER_DISTANCE_PX * view.pixel() * slope;
            if view.behind(place.at, 0, 0).is_none_or(|behind| behind < most) {
                // The mean of the cosine over the upper half is a half.
                *part += 2.0 * facing / SKY_VIEWS as f64;
                *sky += (6.0 / 7.0) * facing * (1.0 + 2.0 * z) / SKY_VIEWS as f64;
            }
        }
    }
    let around = GROUND_REFLECTANCE * mean(light.iter().map(|[sky, _]| *sky));
    let all = |[sky, part]: [f64; 2]| (sky + around * (1.0 - part).max(0.0)).max(1e-3);
    Ok(light.chunks_exact(2).map(|pair| (all(pair[0]) / all(pair[1])).ln()).collect())
}

/// The points of a view, with what the sun says of them; `None` if there are next to none.
fn seen_points(
    bench: &mut Bench<'_>,
    shot: &PlaceShot,
    sun: DVec3,
) -> Result<Option<Vec<Option<ShadowPoint>>>> {
    let far = bench.level.units(MAX_POINT_DISTANCE_M);
    let point = |pixel: usize| {
        let normal = DVec3::from_array(std::array::from_fn(|k| f64::from(shot.frame.normal[3 * pixel + k])));
        let at = shot.point(pixel).filter(|at| at.distance(shot.camera.center()) < far)?;
        (shot.frame.alpha[pixel] > 0.99).then_some(ShadowPoint { at, normal, lit: None })
    };
    let mut seen: Vec<Option<ShadowPoint>> = (0..shot.frame.alpha.len()).map(point).collect();
    let known: Vec<DVec3> = seen.iter().flatten().map(|point| point.at).collect();
    if known.len() < MIN_PAIRS {
        return Ok(None);
    }
    let from_sun = FarView::of(bench, &known, sun, SUN_SIDE_PX)?;
    for point in seen.iter_mut().flatten() {
        let behind = |dx: i64, dy: i64| from_sun.behind(point.at, dx, dy);
        let around = [-AGREEING_PIXELS, 0, AGREEING_PIXELS]
            .into_iter()
            .flat_map(|dx| [-AGREEING_PIXELS, 0, AGREEING_PIXELS].map(|dy| behind(dx, dy)));
        let around: Option<Vec<f64>> = around.collect();
        point.lit = around.and_then(|around| {
            let is_shaded = around.iter().all(|behind| *behind > SHADE_DISTANCES_M[0]);
            let is_lit = around.iter().all(|behind| *behind < SHADE_DISTANCES_M[1]);
            (is_shaded != is_lit).then_some(is_lit)
        });
        if point.normal.dot(sun) < MIN_INCIDENCE_COSINE {
            point.lit = None;
        }
    }
    Ok(Some(seen))
}

/// Pairs of pixels of one surface and colour, the first in the sun and the second in the shade.
fn pairs(shot: &PlaceShot, seen: &[Option<ShadowPoint>], site: &Site) -> Vec<[usize; 2]> {
    let (width, height) = (shot.frame.width as usize, shot.frame.height as usize);
    let mut found = Vec::new();
    for pixel in 0..width * height {
        let (x, y) = (pixel % width, pixel / width);
        for apart in PAIR_OFFSETS_PX {
            for (dx, dy) in [(apart, 0), (0, apart)] {
                let is_in = x > 0 && y > 0 && x + dx + 1 < width && y + dy + 1 < height;
                if !is_in {
                    continue;
                }
                let other = pixel + dy * width + dx;
                let Some((a, b)) = seen[pixel].zip(seen[other]) else { continue };
                let (Some(a_lit), Some(b_lit)) = (a.lit, b.lit) else { continue };
                let metres = a.at.distance(b.at) * site.metres_per_unit;
                let off = (b.at - a.at).dot(a.normal).abs() * site.metres_per_unit;
                let is_one = a.normal.dot(b.normal) > MIN_NORMAL_COSINE
                    && (PAIR_DISTANCES_M[0]..PAIR_DISTANCES_M[1]).contains(&metres)
                    && off < MAX_PLANE_DISTANCE_M;
                if a_lit != b_lit && is_one && is_one_color(shot.rgb(pixel), shot.rgb(other)) {
                    found.push(if a_lit { [pixel, other] } else { [other, pixel] });
                }
            }
        }
    }
    found
}

/// Returns true if two colours are of one hue.
fn is_one_color(a: [f64; 3], b: [f64; 3]) -> bool {
    let [a, b] = [a, b].map(|rgb| rgb.map(|v| v / rgb.iter().sum::<f64>().max(1e-6)));
    (0..3).all(|k| (a[k] - b[k]).abs() < MAX_CHROMATICITY_DIFFERENCE)
}

/// Measures the change of a place without shadows.
fn control(bench: &mut Bench<'_>) -> Result<()> {
    let [camera, _] = bench.rig.views()?;
    let lit = PlaceShot::of(bench, &camera, bench.weather, SURFACES)?;
    let plain = PlaceShot::of(bench, &camera, &bench.with("light=off")?, SURFACES)?;
    let sums = [&lit, &plain].map(|shot| shot.light.iter().map(|v| f64::from(*v)).sum::<f64>());
    let is_overcast = bench.level.site.captured_sky == CapturedSky::Overcast;
    // Where the sky does not say that it was overcast, clouds take 0.3 EV of exposure.
    let tolerance = if is_overcast { Tolerance::Relative(0.01) } else { Tolerance::None };
    let quantity = "mean light of a place without shadows, over that without the effect";
    bench.add(quantity, "", [1.0, sums[0] / sums[1]], tolerance);
    bench.show_place(&lit.frame);
    Ok(())
}
