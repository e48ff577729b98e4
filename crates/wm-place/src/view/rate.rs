//! The rating of a view by a small picture of it.

use super::candidates::room;
use glam::DVec3;
use wm_base::color::luminance;
use wm_render::Frame;
use wm_scene::survey::Survey;
use wm_scene::{Camera, Group, Splats};

/// Size of the pictures that are judged, px.
pub(crate) const SIZE: (u32, u32) = (120, 80);

/// Farther than this many scene radii is sky.
const SKY_DISTANCE_RADII: f64 = 2.5;

/// Splats by which the sharpness of a view is judged.
pub(crate) struct SplatSample {
    points: Vec<(DVec3, f64)>,
}

impl SplatSample {
    /// A sample of a scene's splats.
    pub(crate) fn of(splats: &Splats) -> Self {
        let step = splats.len().div_ceil(20_000).max(1);
        let points = (0..splats.len())
            .step_by(step)
            .filter(|i| splats.groups[*i] != Group::Sky && splats.is_sound(*i) && splats.opacity(*i) > 0.3)
            .map(|i| {
                let mut scales = splats.scales(i);
                scales.sort_by(f64::total_cmp);
                (DVec3::from_array(splats.means[i].map(f64::from)), scales[2])
            })
            .collect();
        Self { points }
    }

    /// Returns the visible share of the splats, and how coarse they are.
    fn seen(&self, camera: &Camera, frame: &Frame) -> VisibleSplats {
        let (mut sum, mut weight, mut count) = (0.0, 0.0, 0.0);
        for (at, size) in &self.points {
            let Some((x, y, depth)) = camera.project(*at) else { continue };
            if !(x >= 0.0 && y >= 0.0 && x < f64::from(frame.width) && y < f64::from(frame.height)) {
                continue;
            }
            if depth > 1.1 * f64::from(frame.depth[frame.index(x as u32, y as u32)]) {
                continue;
            }
            count += 1.0;
            let pixels = size * camera.fy / depth;
            // Each counts by the area it fills.
            let area = (pixels * pixels).min(100.0);
            sum += area * (pixels / (0.012 * f64::from(camera.height))).ln().max(0.0);
            weight += area;
        }
        let coarseness = if weight > 0.0 { sum / weight } else { 3.0 };
        VisibleSplats { share: count / self.points.len().max(1) as f64, coarseness }
    }
}

/// The splats that a picture shows.
struct VisibleSplats {
    /// Share of the scene's splats.
    share: f64,
    /// Mean logarithm of how far they exceed a hundredth of the picture's height: 0 for a sharp
    /// view, 1 where splats are e times too large.
    coarseness: f64,
}

/// The terms of a view's rating; their sum is the rating.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct ViewRating {
    /// Holes in the lower part.
    pub(crate) cover: f64,
    /// Things right in front of the lens.
    pub(crate) clear: f64,
    /// Near and far together.
    pub(crate) depth: f64,
    /// Distance of the visible things.
    pub(crate) reach: f64,
    /// Structure in the picture.
    pub(crate) detail: f64,
    /// Share of the well captured parts: splats are many where cameras looked.
    pub(crate) content: f64,
    /// Splats so large that they are seen as blobs.
    pub(crate) grain: f64,
    /// Share of sky.
    pub(crate) sky: f64,
    /// Half transparent parts: the back of the reconstruction, floaters.
    pub(crate) haze: f64,
}

impl ViewRating {
    /// The sum.
    pub(crate) fn sum(&self) -> f64 {
        let Self { cover, clear, depth, reach, detail, content, grain, sky, haze } = *self;
        cover + clear + depth + reach + detail + content + grain + sky + haze
    }
}

/// Judges a picture with colour, alpha and depth.
pub(crate) fn rate(frame: &Frame, camera: &Camera, survey: &Survey, grain: &SplatSample) -> ViewRating {
    let room = room(survey, survey.height(camera.center()));
    let parts = PixelClasses::of(frame, camera, survey);
    let PixelClasses { mut depths, mut things, .. } = parts;
    let pixels = frame.pixels() as f64;
    if (things.len() as f64) < 0.1 * pixels {
        return ViewRating { cover: -10.0, ..ViewRating::default() };
    }
    let [nearest, middle] = [0.01, 0.5].map(|q| quantile(&mut depths, q));
    let [near, far] = [0.1, 0.9].map(|q| quantile(&mut things, q));
    let share = |count: u32| f64::from(count) / pixels;
    let (open, close) = (share(parts.open), share(parts.close));
    let seen = grain.seen(camera, frame);
    // An empty sky is worth less than one with clouds, and not missed in a room.
    let (most_open, missed) = if survey.sky_splats > 0 { (0.35, 5.0) } else { (0.25, 3.0) };
    ViewRating {
        cover: -8.0 * share(parts.holes) - 2.0 * share(parts.beyond),
        clear: -1.5 * (0.03 * room / nearest).ln().clamp(0.0, 2.0) - 4.0 * (close - 0.05).max(0.0),
        depth: 0.6 * (far / near).ln().clamp(0.0, 2.0),
        reach: -0.7 * (0.25 * room / middle).ln().max((middle / (1.2 * survey.radius)).ln()).clamp(0.0, 3.0),
        detail: 0.5 * (detail(frame) / 0.03).ln().clamp(-2.0, 1.0),
        content: 0.4 * (seen.share / 0.1).ln().clamp(-2.0, 2.0),
        grain: -1.5 * seen.coarseness,
        sky: -4.0 * (open - most_open).max(0.0) - missed * (0.08 - open).max(0.0),
        haze: -4.0 * share(parts.half),
    }
}

/// The value below which the share `q` of the values lies; there must be some.
fn quantile(values: &mut [f64], q: f64) -> f64 {
    let rank = (q * (values.len() - 1) as f64) as usize;
    *values.select_nth_unstable_by(rank, f64::total_cmp).1
}

/// The pixels of a picture by what they show.
#[derive(Default)]
struct PixelClasses {
    /// Depths where there is something that is no sky, scene units.
    depths: Vec<f64>,
    /// The sums above the foreground.
    things: Vec<f64>,
    /// Nothing, where there should be something: the ground within the scene, or the sky if it has
    /// one.
    holes: u32,
    /// Nothing below the horizon, beyond the edge of the scene.
    beyond: u32,
    /// The sky, or nothing above the horizon.
    open: u32,
    /// Half transparent.
    half: u32,
    /// Things near the lens that hide what is behind: not the ground at one's feet.
    close: u32,
}

impl PixelClasses {
    fn of(frame: &Frame, camera: &Camera, survey: &Survey) -> Self {
        let up = survey.up.value;
        let above = survey.height(camera.center());
        let (forward, room) = (camera.forward(), room(survey, above));
        let mut parts = Self::default();
        for y in 0..frame.height {
            for x in 0..frame.width {
                let i = frame.index(x, y);
                let (alpha, depth) = (frame.alpha[i], f64::from(frame.depth[i]));
                let ray = camera.ray(f64::from(x) + 0.5, f64::from(y) + 0.5);
                let sine = ray.dot(up);
                // Distance along the ray to where level ground would be.
                let ground = if sine < -0.02 { above.max(0.0) / -sine } else { f64::INFINITY };
                let is_empty = alpha < 0.5;
                parts.half += u32::from(alpha > 0.08 && alpha < 0.85);
                if is_empty || depth > SKY_DISTANCE_RADII * survey.radius {
                    let foot = camera.center() + ray * ground - survey.center;
                    let is_hole = (is_empty && survey.sky_splats > 0)
                        || (ground.is_finite() && foot.reject_from_normalized(up).length() < survey.radius);
                    parts.holes += u32::from(is_hole);
                    parts.beyond += u32::from(!is_hole && ground.is_finite());
                    parts.open += u32::from(!is_hole && ground.is_infinite());
                    continue;
                }
                parts.depths.push(depth);
                if y < frame.height * 2 / 3 {
                    parts.things.push(depth);
                }
                let is_near = depth < 0.12 * room && depth < 0.6 * ground * ray.dot(forward);
                parts.close += u32::from(is_near);
            }
        }
        parts
    }
}

/// Mean difference of luminance between neighbours, display-referred.
fn detail(frame: &Frame) -> f64 {
    let value = |x: u32, y: u32| luminance(frame.rgb_at(x, y).map(|v| f64::from(v).clamp(0.0, 1.0)));
    let mut sum = 0.0;
    for y in 1..frame.height {
        for x in 1..frame.width {
            let here = value(x, y);
            sum += (here - value(x - 1, y)).abs() + (here - value(x, y - 1)).abs();
        }
    }
    sum / (2.0 * frame.pixels() as f64)
}

#[cfg(test)]
mod tests {
    use super::super::ViewOptions;
    use super::super::testing::{LoadedScene, place};
    use super::*;

    fn rating(loaded: &mut LoadedScene, eye: [f64; 3], target: [f64; 3]) -> ViewRating {
        let camera = Camera::looking(SIZE, 50.0, eye.into(), target.into(), DVec3::Z).unwrap();
        let mut frame = Frame::default();
        let set = loaded.set;
        loaded.site(ViewOptions::default()).look(set, &camera, &mut frame).unwrap();
        rate(&frame, &camera, &loaded.survey, &SplatSample::of(&loaded.scene.splats))
    }

    #[test]
    fn good_views_are_rated_above_bad_ones() {
        let mut street = LoadedScene::new(place("street-sky"), Some(2));
        let good = rating(&mut street, [-20.0, 0.0, 1.7], [10.0, 0.0, 2.0]);
        for (what, eye, target) in [
            ("a wall in front of the lens", [0.0, 4.0, 1.7], [0.0, 9.0, 1.7]),
            ("the back of a house", [0.0, -40.0, 4.0], [0.0, -6.0, 4.0]),
            ("the ground alone", [0.0, 0.0, 4.0], [1.0, 0.0, 0.0]),
            ("the sky alone", [0.0, 0.0, 2.0], [1.0, 0.0, 9.0]),
            ("from inside a tree", [-12.0, 4.8, 3.5], [0.0, 4.8, 3.5]),
            ("from below", [0.0, 0.0, -6.0], [20.0, 0.0, 0.0]),
        ] {
            let bad = rating(&mut street, eye, target);
            assert!(bad.sum() < good.sum() - 0.5, "{what}: {bad:?}, {good:?}");
        }
    }

    #[test]
    fn nothing_is_rated_lowest() {
        let mut table = LoadedScene::new(place("table"), Some(1));
        assert_eq!(rating(&mut table, [0.0, 0.0, 90.0], [0.0, 1.0, 190.0]).cover, -10.0);
    }
}
