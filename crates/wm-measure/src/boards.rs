//! Visibility boards: the meteorological optical range, by channel, as a transmissometer finds it.
//!
//! A board of radiance `L0` at distance `s` is seen as `L0 T + A (1 - T)`. The difference of a
//! white and a black one is free of the airlight `A`, so that
//! `T = (white - black) / (white0 - black0)`, with the same boards in clear air below. The slope of
//! `-ln T` over the true length of each pixel's ray is the extinction, whatever the near drops of a
//! frame hide.
//!
//! Tolerance 3 %. Systematic: a board is square to its ray and opaque to 2e-4, the floats of its
//! colours add 1e-5 of white, 0.1 % of the contrast at 2 %: below 0.3 % in all. The rest is chance,
//! of what falls before the boards.

use super::expected::{self, MOR_DEPTH};
use super::plot::{Axis, Series};
use super::{Bench, Instrument, Tolerance, clear, median};
use wm_place::Result;
use wm_place::{Layers, Picture};
use wm_scene::card::Card;
use wm_scene::{Camera, Splats};
use wm_weather::Weather;

/// The instrument.
pub(crate) const INSTRUMENT: Instrument = Instrument {
    name: "visibility",
    title: "Visibility board",
    about: "White and black boards stand at 16 distances between a tenth and 1.2 of the range that is asked for. What is left \
            of their difference in a picture is the transmittance of the air on the way to them; its logarithm over the length of the rays \
            is a line, whose slope is the extinction, and 2.996 over that the meteorological optical range (5 % of the light, WMO).",
    applies: |weather, time| expected::extinction(weather, time, EYE_HEIGHT_M)[1] > 0.0,
    measure,
    sweep: &[
        "fog.mor=50",
        "fog.mor=100",
        "fog.mor=200",
        "fog.mor=500",
        "fog.mor=1000",
        "haze.mor=2000, haze.scale_height=inf",
        "smog.mor=800, smog.scale_height=inf",
        "rain.rate=25",
    ],
};

/// Height of the camera and of the boards, m.
const EYE_HEIGHT_M: f64 = 1.6;
/// Boards in a row, and rows.
const BOARD_GRID: (usize, usize) = (8, 2);
/// Side of the field of one board, half the side of a board, and of the patch in it that is
/// measured, px.
const FIELD_SIDE_PX: usize = 72;
const BOARD_HALF_SIDE_PX: f64 = 26.0;
const PATCH_SIDE_PX: usize = 18;
/// Transmittances that are measured.
const TRANSMITTANCE_RANGE: [f64; 2] = [0.02, 0.99];
/// Pictures over which what falls is averaged, and the time between them, s.
const FALL_PICTURES: usize = 6;
const PICTURE_INTERVAL_S: f64 = 0.7;

/// Means over the patch of each board, linear light.
type Light = Vec<[f64; 3]>;

struct Boards {
    camera: Camera,
    /// Length of the mean ray to each, m.
    metres: Vec<f64>,
    white: super::ShotSubject,
    black: super::ShotSubject,
    /// White less black in clear air.
    contrast: Light,
}

/// The pixel in the middle of a field.
fn middle(index: usize) -> (usize, usize) {
    (
        index % BOARD_GRID.0 * FIELD_SIDE_PX + FIELD_SIDE_PX / 2,
        index / BOARD_GRID.0 * FIELD_SIDE_PX + FIELD_SIDE_PX / 2,
    )
}

impl Boards {
    fn new(bench: &mut Bench<'_>, range: f64) -> Result<Self> {
        let level = bench.level;
        let size = ((BOARD_GRID.0 * FIELD_SIDE_PX) as u32, (BOARD_GRID.1 * FIELD_SIDE_PX) as u32);
        // A narrow band about the horizon, so that all rays are nearly level.
        let camera = level.camera(size, 8.0, [0.0, 0.0, EYE_HEIGHT_M], [0.0, 1.0, EYE_HEIGHT_M])?;
        let count = BOARD_GRID.0 * BOARD_GRID.1;
        let board = |index: usize| {
            // 7 has no divisor in common with 16: near and far are mixed over the picture.
            let far = (7 * index % count) as f64 / (count - 1) as f64;
            let (metres, (x, y)) = (range * 0.1 * 12f64.powf(far), middle(index));
            let pixel = (x as f64 + 0.5, y as f64 + 0.5);
            Card::over(&camera, pixel, BOARD_HALF_SIDE_PX, level.units(metres), camera.ray(pixel.0, pixel.1))
        };
        let cards: Vec<Card> = (0..count).map(board).collect();
        let mut painted = |rgb: [f32; 3]| {
            let mut splats = Splats::default();
            cards.iter().for_each(|card| card.paint(&mut splats, (18, 18), rgb));
            bench.rig.set_up(splats)
        };
        let (white, black) = (painted([1.0; 3])?, painted([0.0; 3])?);
        let length = |index: usize| {
            let (x, y) = middle(index);
            level.metres(cards[index].ray_length(&camera, x as f64 + 0.5, y as f64 + 0.5))
        };
        let metres = (0..count).map(length).collect();
        let mut boards = Self { camera, metres, white, black, contrast: Vec::new() };
        boards.contrast = boards.seen(bench, &clear(), bench.time)?.0;
        Ok(boards)
    }

    /// White less black of each board through a weather, and the picture of the black ones.
    fn seen(&self, bench: &mut Bench<'_>, weather: &Weather, time: f64) -> Result<(Light, Picture)> {
        let mut look = |board| bench.draw_at(time, board, &self.camera, weather, Layers::COLOR);
        let (white, black) = (look(self.white)?, look(self.black)?);
        let [light, dark] = [&white, &black].map(|picture| patches(&picture.frame.rgb_linear()));
        let less = |light: &[f64; 3], dark: &[f64; 3]| std::array::from_fn(|k| light[k] - dark[k]);
        Ok((light.iter().zip(&dark).map(|(light, dark)| less(light, dark)).collect(), black))
    }
}

/// The mean of each patch.
fn patches(rgb: &[f32]) -> Light {
    let width = BOARD_GRID.0 * FIELD_SIDE_PX;
    let patch = |index: usize| {
        let (x, y) = middle(index);
        let mut sum = [0.0; 3];
        for row in y - PATCH_SIDE_PX..=y + PATCH_SIDE_PX {
            for column in x - PATCH_SIDE_PX..=x + PATCH_SIDE_PX {
                (0..3).for_each(|k| sum[k] += f64::from(rgb[3 * (row * width + column) + k]));
            }
        }
        sum.map(|sum| sum / (2 * PATCH_SIDE_PX + 1).pow(2) as f64)
    };
    (0..BOARD_GRID.0 * BOARD_GRID.1).map(patch).collect()
}

/// Least squares slope of a line through points.
pub(super) fn slope(points: &[[f64; 2]]) -> f64 {
    let mean = |k: usize| points.iter().map(|p| p[k]).sum::<f64>() / points.len() as f64;
    let (x, y) = (mean(0), mean(1));
    let products: f64 = points.iter().map(|p| (p[0] - x) * (p[1] - y)).sum();
    products / points.iter().map(|p| (p[0] - x).powi(2)).sum::<f64>()
}

fn measure(bench: &mut Bench<'_>) -> Result<()> {
    let asked = expected::extinction(bench.weather, bench.time, EYE_HEIGHT_M).map(|sigma| MOR_DEPTH / sigma);
    let boards = Boards::new(bench, asked[1])?;
    let times = if expected::fall_extinction(bench.weather, bench.time) > 0.0 { FALL_PICTURES } else { 1 };
    let mut kept = vec![[0.0; 3]; boards.metres.len()];
    let mut shown = Picture::default();
    for index in 0..times {
        let (light, picture) =
            boards.seen(bench, bench.weather, bench.time + PICTURE_INTERVAL_S * index as f64)?;
        for (kept, (light, clear)) in kept.iter_mut().zip(light.iter().zip(&boards.contrast)) {
            (0..3).for_each(|k| kept[k] += light[k] / clear[k] / times as f64);
        }
        shown = picture;
    }
    let farthest = boards.metres.iter().copied().fold(0.0, f64::max);
    let law = (0..=60).map(|k| farthest * f64::from(k) / 60.0);
    let mut series = vec![Series::line(
        "5 % at the range asked for green",
        law.map(|s| [s, (-MOR_DEPTH * s / asked[1]).exp()]).collect(),
    )];
    for (channel, name) in ["red", "green", "blue"].into_iter().enumerate() {
        let points: Vec<[f64; 2]> = boards
            .metres
            .iter()
            .zip(&kept)
            .filter(|(_, kept)| {
                TRANSMITTANCE_RANGE[0] < kept[channel] && kept[channel] < TRANSMITTANCE_RANGE[1]
            })
            .map(|(metres, kept)| [*metres, -kept[channel].ln()])
            .collect();
        let measured = if points.len() < 4 { f64::NAN } else { MOR_DEPTH / slope(&points) };
        bench.add(format!("MOR, {name}"), "m", [asked[channel], measured], Tolerance::Relative(0.03));
        series.push(Series::points(name, points.iter().map(|[x, y]| [*x, (-y).exp()]).collect()));
    }
    bench.plot(
        "Contrast left",
        "distance of the board, m",
        Axis::log("white less black, share of clear air"),
        series,
    );
    let near = median(boards.metres.clone());
    bench.show(
        format!("black boards at {:.0} to {farthest:.0} m, half of them within {near:.0} m", 0.1 * asked[1]),
        &shown,
    );
    Ok(())
}
