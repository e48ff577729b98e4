//! Lamp streak: how long and how wide a lamp is mirrored in a wet road.
//!
//! A small white board stands before a black wall behind a black yard under a film. The difference
//! of the pictures with the board and without it is its image in the film: a streak towards the
//! eye, as long as the film is rough, and as much narrower as the view is flat. Its standard
//! deviations along both axes of the picture are held against those of an image that is computed
//! here, facet by facet: normal slopes of `0.3 exp(-2 film)` rms along each axis, Fresnel by
//! Snell's angles, and facets hidden by others (Smith 1967).
//!
//! Tolerance 7 %.

use super::lit::{overcast_card, paint_card};
use super::{Bench, Instrument, LevelFrame, Tolerance, expected};
use glam::DVec3;
use std::f64::consts::TAU;
use wm_place::Result;
use wm_scene::{Camera, Splats};
use wm_weather::Weather;

/// The instrument.
pub(crate) const INSTRUMENT: Instrument = Instrument {
    name: "lamp-streak",
    title: "Lamp streak",
    about: "A white board before a black wall, mirrored in a yard under a film: length and width of its streak against those of facets with the \
            slopes of the film.",
    applies: |weather, time| film(weather, time).is_some(),
    measure,
    sweep: &["wetness.amount=1", "wetness.amount=0.8"],
};

/// Ends and half the width of the yard, m; the distance, the height and half the side of the board;
/// half the width and the height of the wall.
const YARD_ENDS_M: [f64; 2] = [1.0, 15.0];
const YARD_HALF_WIDTH_M: f64 = 4.0;
const BOARD_POSITION_M: [f64; 2] = [15.5, 3.0];
const BOARD_HALF_SIDE_M: f64 = 0.25;
const WALL_SIZE_M: [f64; 2] = [14.0, 9.0];
/// Distance of the splats of yard and wall, m, and the light of what is black.
const SPLAT_SPACING_M: f64 = 0.25;
const BLACK_LIGHT: f64 = 0.002;
/// Height of the eye, m, and the point that it looks at.
const EYE_HEIGHT_M: f64 = 1.6;
const TARGET: [f64; 3] = [6.0, 0.0, 0.3];
/// Size of the picture, px, and field of view, degrees; distance of the pixels that are summed, px.
pub(super) const SIZE: (u32, u32) = (640, 480);
const FIELD_OF_VIEW_DEGREES: f64 = 60.0;
const PIXEL_STEP: usize = 2;
/// Distances of the ground on which the streak is looked at, m.
const STREAK_RANGE_M: [f64; 2] = [2.5, 13.0];
/// Points along a side of the board.
const BOARD_POINTS: usize = 5;
/// Slopes of damp ground, rms along one axis.
const RMS_SLOPE: f64 = 0.3;

/// The film in depths of the texture, if a wetness is asked for that has one.
fn film(weather: &Weather, time: f64) -> Option<f64> {
    let amount = expected::number(weather, time, "wetness", "amount")?;
    Some(2.0 * amount - 1.0).filter(|film| *film > 0.0)
}

/// The share that is reflected of light that meets water at an angle from its normal of this
/// cosine.
fn reflectance(cosine: f64) -> f64 {
    expected::water_reflectance(cosine.clamp(1e-6, 1.0 - 1e-9).acos())
}

/// The light of the board, of 1, that facets of these slopes reflect at a point of the ground
/// (level coordinates) to the eye.
fn streak_at(ground: DVec3, slopes: f64) -> f64 {
    let view = (DVec3::new(0.0, 0.0, EYE_HEIGHT_M) - ground).normalize();
    // Facets as far as the eye sees them: their mean area over that of the ground.
    let level = view.x.hypot(view.y).max(1e-9);
    let edge = view.z / (level * slopes);
    let normal = (-0.5 * edge * edge).exp() / TAU.sqrt();
    let below = {
        // The share of a normal distribution below `edge`, by its integral.
        let parts = 400;
        let from = -8.0f64;
        let width = (edge.min(8.0) - from) / f64::from(parts);
        let at = |k: i32| from + (f64::from(k) + 0.5) * width;
        (0..parts).map(|k| (-0.5 * at(k) * at(k)).exp() / TAU.sqrt() * width).sum::<f64>()
    };
    let seen = view.z * below + level * slopes * normal;
    let mut sum = 0.0;
    for i in 0..BOARD_POINTS {
        for j in 0..BOARD_POINTS {
            let [a, b] = [i, j].map(|k| BOARD_HALF_SIDE_M * ((2 * k + 1) as f64 / BOARD_POINTS as f64 - 1.0));
            let way = DVec3::new(BOARD_POSITION_M[0], a, BOARD_POSITION_M[1] + b) - ground;
            let (far, light) = (way.length(), way.normalize());
            let half = (view + light).normalize();
            let steep = (half.x * half.x + half.y * half.y) / (half.z * half.z);
            let facets = (-0.5 * steep / (slopes * slopes)).exp() / (TAU * slopes * slopes) / half.z.powi(4);
            let area = (2.0 * BOARD_HALF_SIDE_M / BOARD_POINTS as f64).powi(2) * light.x / (far * far);
            sum += reflectance(view.dot(half)) * facets * area / (4.0 * seen);
        }
    }
    sum
}

/// Standard deviations along rows and columns of an image of this light, px, over the pixels that
/// show the ground that is looked at.
fn spread(level: &LevelFrame, camera: &Camera, light: impl Fn((usize, usize), DVec3) -> f64) -> [f64; 2] {
    let (mut sum, mut first, mut second) = (0.0, [0.0; 2], [0.0; 2]);
    let eye = DVec3::new(0.0, 0.0, EYE_HEIGHT_M);
    for y in (0..SIZE.1 as usize).step_by(PIXEL_STEP) {
        for x in (0..SIZE.0 as usize).step_by(PIXEL_STEP) {
            let place = [x, y].map(|v| v as f64 + 0.5);
            let ray = camera.ray(place[0], place[1]);
            let way = DVec3::from_array(level.axes.map(|axis| axis.dot(ray)));
            let ground = eye + way * (EYE_HEIGHT_M / (-way.z).max(1e-9));
            let is_looked_at = (STREAK_RANGE_M[0]..STREAK_RANGE_M[1]).contains(&ground.x)
                && ground.y.abs() < 0.9 * YARD_HALF_WIDTH_M;
            if way.z < 0.0 && is_looked_at {
                let own = light((x, y), ground);
                sum += own;
                for k in 0..2 {
                    first[k] += own * place[k];
                    second[k] += own * place[k] * place[k];
                }
            }
        }
    }
    [0, 1].map(|k| (second[k] / sum - (first[k] / sum).powi(2)).sqrt())
}

fn measure(bench: &mut Bench<'_>) -> Result<()> {
    let Some(film) = film(bench.weather, bench.time) else { return Ok(()) };
    let level = bench.level;
    let place = |has_lamp: bool| {
        let mut splats = Splats::default();
        let mut card = |center: [f64; 3], halves: [[f64; 3]; 2], grain: f64, light: f64| {
            paint_card(&level, center, halves, grain, overcast_card(light, 0.0), &mut splats);
        };
        let [near, far] = YARD_ENDS_M;
        let yard = [[0.5 * (far - near), 0.0, 0.0], [0.0, YARD_HALF_WIDTH_M, 0.0]];
        card([0.5 * (near + far), 0.0, 0.0], yard, SPLAT_SPACING_M, BLACK_LIGHT);
        let wall = [[0.0, WALL_SIZE_M[0], 0.0], [0.0, 0.0, 0.5 * WALL_SIZE_M[1]]];
        card(
            [BOARD_POSITION_M[0] + 0.3, 0.0, 0.5 * WALL_SIZE_M[1]],
            wall,
            2.0 * SPLAT_SPACING_M,
            BLACK_LIGHT,
        );
        if has_lamp {
            let halves = [[0.0, BOARD_HALF_SIDE_M, 0.0], [0.0, 0.0, BOARD_HALF_SIDE_M]];
            card([BOARD_POSITION_M[0], 0.0, BOARD_POSITION_M[1]], halves, 0.1, 1.0);
        }
        splats
    };
    let amount = format!("wetness.amount={}", 0.5 * (film + 1.0));
    let weather = bench.with_light(&format!("light=off, wetness.puddles=0, {amount}"))?;
    let camera = level.camera(SIZE, FIELD_OF_VIEW_DEGREES, [0.0, 0.0, EYE_HEIGHT_M], TARGET)?;
    let [with, without] = [true, false].map(|has_lamp| {
        let subject = bench.set_up_lit(place(has_lamp))?;
        bench.light(subject, &camera, &weather)
    });
    let (with, without) = (with?, without?);
    let measured = spread(&level, &camera, |(x, y), _| (with.light(x, y) - without.light(x, y)).max(0.0));
    let slopes = RMS_SLOPE * (-2.0 * film).exp();
    let asked = spread(&level, &camera, |_, ground| streak_at(ground, slopes));
    for (axis, what) in [(1, "length"), (0, "width")] {
        let quantity = format!("{what} of the streak, standard deviation");
        bench.add(quantity, "px", [asked[axis], measured[axis]], Tolerance::Relative(0.07));
    }
    bench.show("a white board in a wet yard", &with.picture);
    Ok(())
}
