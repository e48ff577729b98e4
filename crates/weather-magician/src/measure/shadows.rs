//! Shadow gauge: what is left, under clouds, of the shadows that the place was captured with.
//!
//! The place is seen from the sun, far away: a point of a view that lies behind what is seen from there is in its shadow, whatever the
//! program's own maps say. Pairs of places in the view, less than a metre apart on one surface of one colour, of which one lies
//! well in the sun and the other well in the shade, have a ratio of light; its logarithm, in the median over pairs, is the contrast of the
//! shadows. The contrast left is that under clouds over that of the place as it was captured.
//!
//! Bounds: 10 % on a place that was never photographed, such as the built-in street, 20 % on one that was reconstructed from
//! photos. What stands in the way of the sky makes the shaded side of a pair a little darker under clouds too; it counts as
//! left. A place that was captured under clouds must not change: less than 1 % in the mean.

use super::lit::LIGHT_ALONE;
use super::plot::{Axis, Plot, Series};
use super::{
    DEPTH, Finding, Instrument, InstrumentRenderer, InstrumentShot, MeasureRequest, MeasuredPicture, Reading,
    ShadowReport, ShotSubject, Tolerance, clear, expected, mean, median,
};
use crate::{Picture, Result};
use glam::{DQuat, DVec3};
use wm_render::{Geometry, MedianDepth, Outputs};
use wm_scene::Camera;
use wm_scene::color::luminance;
use wm_weather::{CapturedSky, Site, Weather};

/// The instrument.
pub const INSTRUMENT: Instrument = Instrument {
    name: "shadows",
    title: "Shadow gauge",
    about: "The place is seen from its own sun to tell what lies in shadow. Pairs of places of one colour across the edges of shadows \
            are compared before and after clouds come: the contrast that is left, in the median. A place that was captured under clouds must stay as it is.",
    applies: |weather, time| {
        ["overcast", "auto"].iter().any(|model| expected::says(weather, time, "light", "model", model))
    },
    read,
    sweep: &[&["light.model=overcast"], &["light.model=auto", "rain.rate=10"]],
};

/// Turns of the camera about up, degrees.
const TURNS: [f64; 3] = [0.0, -50.0, 50.0];
/// Farthest points that are looked at, and distance from which the place is seen in place of the sun, m.
const FAR: f64 = 25.0;
const SUN_AWAY: f64 = 10_000.0;
/// Side of the picture from the sun, px.
const SUN_SIDE: u32 = 1_200;
/// Distances between the places of a pair, px, and least and most, m.
const APART: [usize; 2] = [8, 14];
const METRES: [f64; 2] = [0.15, 1.0];
/// Distances, m, between a point and the first surface that the sun sees on the way to it: above the first the point is in the
/// shade, below the second it is in the sun.
const BEHIND: [f64; 2] = [0.5, 0.2];
/// Pixels of the picture from the sun that must agree, to each side.
const SURE: i64 = 3;
/// Least cosines: between the normals of a pair, and of the incidence.
const ALIKE: f64 = 0.97;
const INCIDENCE: f64 = 0.3;
/// Largest distance of a place from the plane of the other, m, and difference of chromaticity.
const FLAT: f64 = 0.06;
const COLOR: f64 = 0.05;
/// Ratio of light across an edge from which on it is seen as one, as a logarithm.
const SEEN: f64 = 0.26;
/// Most contrast that is left on places that were never photographed, and on those that were.
const SAMPLED: f64 = 0.1;
const RECONSTRUCTED: f64 = 0.2;
/// Farthest that a pair's contrast is from the median, as a logarithm.
const SPREAD: f64 = 0.4;
/// Fewest pairs that tell something.
const FEWEST: usize = 60;

/// A pixel of a view of the place.
#[derive(Clone, Copy)]
struct SeenPoint {
    /// World, scene units.
    at: DVec3,
    normal: DVec3,
    /// The sun shines on it, or something stands before that; `None` where it is not sure.
    lit: Option<bool>,
}

/// A view of the place.
struct PlaceShot {
    camera: Camera,
    frame: wm_render::Frame,
    light: Vec<f32>,
}

impl PlaceShot {
    fn of(
        rig: &mut dyn InstrumentRenderer,
        camera: &Camera,
        weather: &Weather,
        (time, outputs): (f64, Outputs),
    ) -> Result<Self> {
        let mut picture = Picture::default();
        let subject = ShotSubject::Place;
        rig.draw(&InstrumentShot { subject, camera, weather, time, outputs, parts: &[] }, &mut picture)?;
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

fn read(rig: &mut dyn InstrumentRenderer, request: &MeasureRequest<'_>) -> Result<Finding> {
    match rig.shadows()? {
        ShadowReport::Split { sun, is_photographed } => {
            let most = if is_photographed { RECONSTRUCTED } else { SAMPLED };
            contrast(rig, request, sun, Tolerance::Above(most))
        }
        ShadowReport::None => control(rig, request),
        // The program says that it leaves them.
        ShadowReport::Kept { sun } => contrast(rig, request, sun, Tolerance::None),
    }
}

/// The same camera, turned about up.
fn turned(camera: &Camera, site: &Site, degrees: f64) -> Camera {
    let turn =
        glam::DMat3::from_quat(DQuat::from_axis_angle(DVec3::from_array(site.up), degrees.to_radians()));
    let rotation = camera.rotation() * turn;
    Camera { viewmat: wm_scene::camera::viewmat_of(rotation, -(rotation * camera.center())), ..*camera }
}

/// Measures what is left of shadows.
fn contrast(
    rig: &mut dyn InstrumentRenderer,
    request: &MeasureRequest<'_>,
    sun: DVec3,
    tolerance: Tolerance,
) -> Result<Finding> {
    let site = rig.site();
    let [camera, _] = rig.views()?;
    let mut cloudy = request.with(&LIGHT_ALONE)?;
    cloudy.set_text("light.clouds=1")?;
    let outputs =
        Outputs { geometry: Geometry::DepthNormal, median_depth: MedianDepth::On, ..Outputs::default() };
    let mut points: Vec<[f64; 2]> = Vec::new();
    let mut finding = Finding::default();
    for degrees in TURNS {
        let camera = turned(&camera, &site, degrees);
        let captured = PlaceShot::of(rig, &camera, &clear(), (request.time, outputs))?;
        let Some(seen) = seen_points(rig, &captured, &site, sun, request.time)? else { continue };
        let relit = PlaceShot::of(rig, &camera, &cloudy, (request.time, DEPTH))?;
        for [lit, shaded] in pairs(&captured, &seen, &site) {
            let ratio = |shot: &PlaceShot| {
                (luminance(shot.rgb(lit)).max(1e-6) / luminance(shot.rgb(shaded)).max(1e-6)).ln()
            };
            let (own, left) = (ratio(&captured), ratio(&relit));
            if own > SEEN {
                points.push([own, left]);
            }
        }
        if degrees == TURNS[0] {
            let size = (camera.width, camera.height);
            let shade = seen.iter().map(|point| match point.and_then(|point| point.lit) {
                Some(true) => 1.0,
                Some(false) => 0.0,
                None => 0.5,
            });
            let name = request.setting;
            finding.pictures.push(MeasuredPicture::of("as captured", &captured.frame));
            finding.pictures.push(MeasuredPicture::of(format!("{name}: under clouds"), &relit.frame));
            finding.pictures.push(MeasuredPicture::grey("seen from the sun: white is lit", shade, size));
        }
    }
    // A contrast far from that of most pairs is one of materials: black and white are of one hue.
    let most = median(points.iter().map(|[own, _]| *own).collect());
    points.retain(|[own, _]| (own - most).abs() < SPREAD);
    let [before, after] = [0, 1].map(|k: usize| points.iter().map(|p: &[f64; 2]| p[k]).collect::<Vec<_>>());
    let count = before.len();
    let left = (median(after) / median(before)).abs();
    let is_told = count >= FEWEST;
    finding.readings.push(Reading {
        quantity: if is_told {
            format!("contrast left of shadows, median of {count} pairs")
        } else {
            format!("contrast left of shadows, too few to tell: {count} pairs")
        },
        setting: request.setting.to_owned(),
        unit: "",
        asked: 0.0,
        measured: left,
        standard_error: None,
        tolerance: if is_told { tolerance } else { Tolerance::None },
    });
    let few = points.iter().step_by((count / 600).max(1)).copied().collect();
    finding.plots.push(Plot {
        title: format!("Light over shade, {}", request.setting),
        x: Axis::linear("log of the ratio, as captured"),
        y: Axis::linear("log of the ratio, under clouds"),
        series: vec![
            Series::line("as before", vec![[0.0; 2], [2.0; 2]]),
            Series::line("none", vec![[0.0; 2], [2.0, 0.0]]),
            Series::points("pairs", few),
        ],
    });
    Ok(finding)
}

/// The points of a view, with what the sun says of them; `None` if there are next to none.
fn seen_points(
    rig: &mut dyn InstrumentRenderer,
    shot: &PlaceShot,
    site: &Site,
    sun: DVec3,
    time: f64,
) -> Result<Option<Vec<Option<SeenPoint>>>> {
    let metres = site.metres_per_unit;
    let far = FAR / metres;
    let point = |pixel: usize| {
        let normal = DVec3::from_array(std::array::from_fn(|k| f64::from(shot.frame.normal[3 * pixel + k])));
        let at = shot.point(pixel).filter(|at| at.distance(shot.camera.center()) < far)?;
        (shot.frame.alpha[pixel] > 0.99).then_some(SeenPoint { at, normal, lit: None })
    };
    let mut seen: Vec<Option<SeenPoint>> = (0..shot.frame.alpha.len()).map(point).collect();
    let known = || seen.iter().flatten().map(|point| point.at);
    let count = known().count();
    if count < FEWEST {
        return Ok(None);
    }
    let middle = known().sum::<DVec3>() / count as f64;
    let reach = known().map(|at| (at - middle).reject_from(sun).length()).fold(0.0, f64::max) * 1.05;
    let away = SUN_AWAY / metres;
    let fov = 2.0 * (reach / away).atan().to_degrees();
    let up = DVec3::from_array(site.up);
    let up = if up.dot(sun).abs() > 0.999 { sun.any_orthonormal_vector() } else { up };
    let mut from_sun = Camera::looking((SUN_SIDE, SUN_SIDE), fov, middle + sun * away, middle, up)?;
    from_sun.near = 0.5 * away;
    // Without the sky, which stands between.
    let mut weather = clear();
    ["sky=overcast", "sky.scene_sky=replace"].iter().try_for_each(|change| weather.set_text(change))?;
    let lit = PlaceShot::of(rig, &from_sun, &weather, (time, DEPTH))?;
    let (forward, rotation) = (from_sun.forward(), from_sun.rotation());
    for point in seen.iter_mut().flatten() {
        let offset = point.at - from_sun.center();
        let z = offset.dot(forward);
        let view = rotation * offset;
        let [x, y] = [from_sun.fx * view.x / z + from_sun.cx, from_sun.fy * view.y / z + from_sun.cy];
        let behind = |dx: i64, dy: i64| -> Option<f64> {
            let (x, y) = (x as i64 + dx, y as i64 + dy);
            let side = i64::from(SUN_SIDE);
            let is_in = (0..side).contains(&x) && (0..side).contains(&y);
            let first = f64::from(lit.frame.median_depth[(is_in.then_some(y * side + x)?) as usize]);
            (first > 0.0).then_some((z - first) * metres)
        };
        let around = [-SURE, 0, SURE].into_iter().flat_map(|dx| [-SURE, 0, SURE].map(|dy| behind(dx, dy)));
        let around: Option<Vec<f64>> = around.collect();
        point.lit = around.and_then(|around| {
            let is_shaded = around.iter().all(|behind| *behind > BEHIND[0]);
            let is_lit = around.iter().all(|behind| *behind < BEHIND[1]);
            (is_shaded != is_lit).then_some(is_lit)
        });
        if point.normal.dot(sun) < INCIDENCE {
            point.lit = None;
        }
    }
    Ok(Some(seen))
}

/// Pairs of pixels of one surface and colour, the first in the sun and the second in the shade.
fn pairs(shot: &PlaceShot, seen: &[Option<SeenPoint>], site: &Site) -> Vec<[usize; 2]> {
    let (width, height) = (shot.frame.width as usize, shot.frame.height as usize);
    let mut found = Vec::new();
    for pixel in 0..width * height {
        let (x, y) = (pixel % width, pixel / width);
        for apart in APART {
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
                let is_one =
                    a.normal.dot(b.normal) > ALIKE && (METRES[0]..METRES[1]).contains(&metres) && off < FLAT;
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
    (0..3).all(|k| (a[k] - b[k]).abs() < COLOR)
}

/// Measures the change of a place without shadows.
fn control(rig: &mut dyn InstrumentRenderer, request: &MeasureRequest<'_>) -> Result<Finding> {
    let [camera, _] = rig.views()?;
    let mut without = request.weather.clone();
    without.set_text("light=off")?;
    let lit = PlaceShot::of(rig, &camera, request.weather, (request.time, DEPTH))?;
    let plain = PlaceShot::of(rig, &camera, &without, (request.time, DEPTH))?;
    let sums = [&lit, &plain].map(|shot| shot.light.iter().map(|v| f64::from(*v)).sum::<f64>());
    let is_overcast = rig.site().captured_sky == CapturedSky::Overcast;
    let mut finding = Finding::default();
    finding.readings.push(Reading {
        quantity: "mean light of a place without shadows, over that without the effect".into(),
        setting: request.setting.to_owned(),
        unit: "",
        asked: 1.0,
        measured: sums[0] / sums[1],
        standard_error: None,
        // Where the sky does not say that it was overcast, clouds take 0.3 EV of exposure.
        tolerance: if is_overcast { Tolerance::Relative(0.01) } else { Tolerance::None },
    });
    finding.pictures.push(MeasuredPicture::of(request.setting.to_owned(), &lit.frame));
    Ok(finding)
}
