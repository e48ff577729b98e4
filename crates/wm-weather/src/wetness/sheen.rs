//! The sheen of wet walls and roofs: the sky that they mirror.
//!
//! A wet surface mirrors as much of the sky's light as Fresnel's equations say, in the mean over
//! the slopes of its water, from the mirrored direction of the view, as far as nothing stands
//! before the sky there. Level ground is [`crate::water`]'s; this is the light that steep surfaces
//! add, a splat at a time: rough as they are, they show nothing of what they mirror but its light.

use crate::water::fresnel;
use glam::Vec3;
use std::f64::consts::{FRAC_PI_2, PI};

/// Intervals of the sky's light by the sine of the elevation, of reflectance by the cosine of the
/// view, and by how wet it is.
const SINE_INTERVAL_COUNT: usize = 16;
const COSINE_INTERVAL_COUNT: usize = 32;
const FILM_INTERVAL_COUNT: usize = 8;
/// Directions around of which the sky's light is the mean.
const SKY_DIRECTIONS: usize = 8;
/// Slopes of a damp surface, rms along one axis; of a film they are as much less as it fills the
/// texture, and more.
const DAMP_ROUGHNESS: f32 = 0.25;
/// The film, in depths of the texture, at which the table ends.
const MOST_FILM: f32 = 4.0;
/// Slopes in standard deviations, and their weights: a normal distribution.
const WEIGHTED_SLOPES: [(f32, f32); 5] =
    [(0.0, 0.399), (-1.0, 0.242), (1.0, 0.242), (-2.0, 0.058), (2.0, 0.058)];
/// Steps of the elevation up to which something stands before the sky; the last one sees none.
const SKYLINE_STEP_COUNT: f64 = 254.0;
pub(super) const NO_SKY: u8 = 255;

/// The sky about a place at one instant, as an eye sees it mirrored.
#[derive(Clone, Debug)]
pub struct SkySheen {
    /// The eye, scene units.
    eye: Vec3,
    up: Vec3,
    /// Light of the sky by the sine of the elevation, linear RGB.
    sky: [[f32; 3]; SINE_INTERVAL_COUNT + 1],
    /// Mean reflectance by the film and by the cosine between the view and the normal.
    reflectance: Box<[[f32; COSINE_INTERVAL_COUNT + 1]; FILM_INTERVAL_COUNT + 1]>,
}

impl SkySheen {
    /// The sheen for an eye (world, scene units), with up (length 1) and the light of the sky in a
    /// direction (world axes, length 1), linear RGB.
    pub(crate) fn new(eye: [f64; 3], axes: &[[f64; 3]; 3], sky: impl Fn([f64; 3]) -> [f64; 3]) -> Self {
        let sky = std::array::from_fn(|i| {
            // At the horizon itself haze and ground meet.
            let sine = (i as f64 / SINE_INTERVAL_COUNT as f64).max(0.01);
            let level = (1.0 - sine * sine).max(0.0).sqrt();
            let mut sum = [0.0; 3];
            for turn in 0..SKY_DIRECTIONS {
                let (sin, cos) = (PI * (2 * turn) as f64 / SKY_DIRECTIONS as f64).sin_cos();
                let way = crate::level::from_level(axes, [level * cos, level * sin, sine]);
                sum.iter_mut().zip(sky(way)).for_each(|(sum, light)| *sum += light / SKY_DIRECTIONS as f64);
            }
            sum.map(|light| light as f32)
        });
        let single = |v: [f64; 3]| Vec3::from_array(v.map(|v| v as f32));
        let reflectance = Box::new(std::array::from_fn(|film| {
            let slopes = slopes_of(MOST_FILM * film as f32 / FILM_INTERVAL_COUNT as f32);
            std::array::from_fn(|cosine| mean_fresnel(cosine as f32 / COSINE_INTERVAL_COUNT as f32, slopes))
        }));
        Self { eye: single(eye), up: single(axes[2]), sky, reflectance }
    }

    /// The light that a surface mirrors, linear RGB: at a `point` (scene units) with a `normal`
    /// (length 1, either side), with a film, in depths of its texture, that sees no sky below
    /// `skyline` of [`skyline_of`].
    #[inline]
    pub(super) fn light(&self, point: Vec3, normal: Vec3, film: f32, skyline: u8) -> [f32; 3] {
        let way = (point - self.eye).normalize_or_zero();
        let facing = way.dot(normal);
        let mirrored = way - 2.0 * facing * normal;
        let sine = mirrored.dot(self.up);
        // A rough surface mirrors a piece of the sky that is two slopes tall.
        let soft = 2.0 * slopes_of(film);
        let edge = f32::from(skyline) * (FRAC_PI_2 / SKYLINE_STEP_COUNT) as f32;
        let open = ((sine.clamp(-1.0, 1.0).asin() - edge) / (2.0 * soft) + 0.5).clamp(0.0, 1.0);
        if open <= 0.0 {
            return [0.0; 3];
        }
        let row = ((film / MOST_FILM).clamp(0.0, 1.0) * FILM_INTERVAL_COUNT as f32 + 0.5) as usize;
        let reflected = between(facing.abs(), COSINE_INTERVAL_COUNT, |at| [self.reflectance[row][at]])[0];
        let share = open * reflected;
        between(sine.max(0.0), SINE_INTERVAL_COUNT, |at| self.sky[at]).map(|light| share * light)
    }
}

/// A value between those of a table of `intervals`, at a place of 0 to 1.
#[inline(always)]
fn between<const N: usize>(place: f32, intervals: usize, value: impl Fn(usize) -> [f32; N]) -> [f32; N] {
    let along = place.clamp(0.0, 1.0) * intervals as f32;
    let low = (along as usize).min(intervals - 1);
    let (a, b, part) = (value(low), value(low + 1), along - low as f32);
    std::array::from_fn(|k| a[k] + (b[k] - a[k]) * part)
}

/// Slopes of a wet surface, rms along one axis, under a film in depths of its texture.
fn slopes_of(film: f32) -> f32 {
    DAMP_ROUGHNESS * (-film).exp()
}

/// The share of light that a rough surface reflects to a view that meets it at an angle of this
/// cosine: the mean over its slopes along the view, each as far as it is seen.
fn mean_fresnel(cosine: f32, slopes: f32) -> f32 {
    let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
    let (mut sum, mut weights) = (0.0, 0.0);
    for (sigma, weight) in WEIGHTED_SLOPES {
        let slope = sigma * slopes;
        let facing = (cosine + slope * sine) / (1.0 + slope * slope).sqrt();
        let weight = weight * facing.max(0.02);
        sum += weight * fresnel(facing.max(0.0));
        weights += weight;
    }
    sum / weights
}

/// The elevation up to which something stands before the sky that an upright surface looks at, in
/// steps of [`SKYLINE_STEP_COUNT`] to the zenith, by the share of the sky's light that reaches it,
/// 0-1. Of an even sky behind a level skyline at `e` it gets `1 - (2 e + sin 2 e) / pi`.
pub(super) fn skyline_of(open: f64) -> u8 {
    let (mut low, mut high) = (0.0, FRAC_PI_2);
    for _ in 0..12 {
        let middle = 0.5 * (low + high);
        let seen = 1.0 - (2.0 * middle + (2.0 * middle).sin()) / PI;
        if seen > open { low = middle } else { high = middle }
    }
    (low / FRAC_PI_2 * SKYLINE_STEP_COUNT).round() as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    const AXES: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

    fn sheen(eye: [f64; 3]) -> SkySheen {
        SkySheen::new(eye, &AXES, |way| [0.5 * way[2]; 3])
    }

    #[test]
    fn a_film_mirrors_by_fresnel_and_damp_walls_less_at_a_low_angle() {
        for cosine in [0.1, 0.3, 0.7, 1.0] {
            assert!((mean_fresnel(cosine, 0.0) - fresnel(cosine)).abs() < 1e-6);
        }
        assert!(mean_fresnel(0.1, DAMP_ROUGHNESS) < 0.6 * fresnel(0.1));
        assert!(mean_fresnel(1.0, DAMP_ROUGHNESS) < 1.2 * fresnel(1.0));
    }

    /// A wall that faces the first axis, seen from below at 60 degrees from its normal, shows the
    /// sky at the elevation of the view.
    #[test]
    fn a_wall_shows_the_sky_that_lies_in_the_mirrored_direction() {
        let (wall, normal) = (Vec3::new(0.0, 0.0, 5.0), Vec3::X);
        let away = |up: f64| {
            let level = (1.0f64 - up * up).sqrt();
            let cos = 60f64.to_radians().cos();
            [10.0 * cos, 10.0 * (level * level - cos * cos).max(0.0).sqrt(), 5.0 - 10.0 * up]
        };
        for up in [0.3, 0.6] {
            let seen = sheen(away(up)).light(wall, normal, MOST_FILM, 0)[0];
            let want = fresnel(0.5) * 0.5 * up as f32;
            assert!((seen / want - 1.0).abs() < 0.05, "{up}: {seen} {want}");
            // From either side of the normal, and nothing behind a house.
            assert_eq!(sheen(away(up)).light(wall, -normal, MOST_FILM, 0)[0], seen);
            assert_eq!(sheen(away(up)).light(wall, normal, MOST_FILM, 254)[0], 0.0);
        }
        // From above it shows the ground, which is not the sky's.
        assert_eq!(sheen([10.0, 0.0, 15.0]).light(wall, normal, MOST_FILM, 0), [0.0; 3]);
    }

    #[test]
    fn skylines_follow_from_the_light_that_is_left() {
        assert_eq!(skyline_of(1.0), 0);
        assert!(skyline_of(0.0) > 250);
        // 30 degrees leave 1 - (pi / 3 + 0.866) / pi.
        let half = skyline_of(1.0 - (PI / 3.0 + 0.866) / PI);
        assert!((f64::from(half) / SKYLINE_STEP_COUNT * 90.0 - 30.0).abs() < 1.0, "{half}");
    }
}
