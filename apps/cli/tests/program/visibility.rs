//! Visibility, measured as a transmissometer would: black and white cards in rendered pictures.
//!
//! A card of radiance `L0` at distance `s` is seen as `L0 T + A (1 - T)`. The difference of a white
//! and a black one is free of the airlight `A`, so that `T = (white - black) / (white0 - black0)`,
//! with the same cards seen through clear air below. From `T` over the true length of each pixel's
//! ray follows the extinction, and from that the meteorological optical range. Nothing of the
//! program's optics is used: scenes go in as files, pictures come out as files.
//!
//! The tolerance of a measurement: a pixel shows splats of about 1 px standard deviation, the
//! nearer ones of a tilted card before the others. With 1 px = 1/286 of the distance and a tilt of
//! 40 degrees the light comes from up to 1.5/286 tan 40 = 0.44 % nearer than the card's plane, on
//! the two cards of three that are tilted: 0.3 % in the mean. What shines through the cards is
//! below 2e-4, and the floats of EXR add less. So 1 % holds what is claimed, and nothing but the
//! tilt is a systematic error.

use crate::common::*;
use glam::{DQuat, DVec3};
use std::path::PathBuf;
use wm_scene::{Camera, Metadata, Splats};

/// Side of the field of one card.
const FIELD_SIDE_PX: usize = 80;
/// Fields in a row and in a column.
const FIELD_COUNTS: (usize, usize) = (6, 5);
const CARD_HALF_SIDE_PX: f64 = 10.0;
/// The patch in a card's middle that is measured: far from the soft edge, 13 x 13 px.
const PATCH_HALF_SIDE_PX: usize = 6;
/// Radiance of the fog, sRGB, not grey, so that channels cannot be confused.
const AIRLIGHT: [u8; 3] = [0xb4, 0xbe, 0xc8];
/// Colour behind the cards, sRGB.
const BACKGROUND: &str = "#204060";

/// Cards at 4 m to some farthest distance, all over a wide picture, straight and tilted.
struct Chart {
    workshop: Workshop,
    camera: Camera,
    view: ViewArgs,
    cards: Vec<Card>,
    metres_per_unit: f64,
    white: PathBuf,
    black: PathBuf,
    /// Options for every render: the scale, if the file does not say it.
    options: String,
    clear: Pair,
}

/// The white and the black cards, linear light.
struct Pair {
    white: Image<[f64; 3]>,
    black: Image<[f64; 3]>,
}

impl Pair {
    /// Returns how much more light a white card at a pixel sends than a black one.
    fn contrast(&self, x: usize, y: usize, channel: usize) -> f64 {
        self.white.at(x, y)[channel] - self.black.at(x, y)[channel]
    }
}

/// The source of the scale.
#[derive(Clone, Copy)]
enum Scale {
    /// The scene's file.
    File(f64),
    /// `--metres-per-unit`; the file says something else.
    Option(f64),
}

impl Chart {
    fn new(scale: Scale, farthest: f64) -> Self {
        let (metres_per_unit, options, in_file) = match scale {
            Scale::File(metres) => (metres, String::new(), metres),
            Scale::Option(metres) => (metres, format!("--metres-per-unit {metres}"), 7.0),
        };
        // Up and forward as a capture may have them, and the camera away from the origin.
        let (up, eye) = (DVec3::NEG_Y, DVec3::new(3.0, -5.0, 2.0));
        let size = (FIELD_COUNTS.0 * FIELD_SIDE_PX, FIELD_COUNTS.1 * FIELD_SIDE_PX);
        let (camera, view) = look((size.0 as u32, size.1 as u32), 70.0, eye, eye + DVec3::Z, up);
        let count = FIELD_COUNTS.0 * FIELD_COUNTS.1;
        let cards: Vec<Card> = (0..count)
            .map(|index| {
                // 7 has no divisor in common with 30: near and far are mixed over the picture.
                let far = (7 * index % count) as f64 / (count - 1) as f64;
                let metres = 4.0 * (farthest / 4.0).powf(far);
                let (x, y) = Self::middle(index);
                let pixel = (x as f64 + 0.5, y as f64 + 0.5);
                // Square to the ray, or turned about an axis across it.
                let ray = camera.ray(pixel.0, pixel.1);
                let tilt = [0.0, 40f64, -40.0][index % 3].to_radians();
                let across = ray.cross(if index % 2 == 0 { DVec3::X } else { DVec3::Y }).normalize();
                let normal = DQuat::from_axis_angle(across, tilt) * ray;
                Card::over(&camera, pixel, CARD_HALF_SIDE_PX, metres / metres_per_unit, normal)
            })
            .collect();
        let workshop = Workshop::new();
        let metadata = Metadata {
            metres_per_unit: Some(in_file),
            up: Some(up),
            // 15 m under the camera.
            ground: Some(eye.dot(up) - 15.0 / metres_per_unit),
            ..Metadata::default()
        };
        let [white, black] = [("white", WHITE), ("black", BLACK)].map(|(name, rgb)| {
            let mut splats = Splats::default();
            cards.iter().for_each(|card| card.paint(&mut splats, (20, 20), rgb));
            workshop.scene(name, splats, &metadata)
        });
        let nothing = Image { width: 0, height: 0, pixels: Vec::new() };
        let clear = Pair { white: nothing.clone(), black: nothing };
        let mut chart = Self { workshop, camera, view, cards, metres_per_unit, white, black, options, clear };
        chart.clear = chart.seen("exr", "");
        chart
    }

    /// The pixel in the middle of field `index`.
    fn middle(index: usize) -> (usize, usize) {
        (
            index % FIELD_COUNTS.0 * FIELD_SIDE_PX + FIELD_SIDE_PX / 2,
            index / FIELD_COUNTS.0 * FIELD_SIDE_PX + FIELD_SIDE_PX / 2,
        )
    }

    /// The pixels of the patch of card `index`.
    fn patch(index: usize) -> impl Iterator<Item = (usize, usize)> {
        let (x, y) = Self::middle(index);
        (y - PATCH_HALF_SIDE_PX..=y + PATCH_HALF_SIDE_PX)
            .flat_map(move |y| (x - PATCH_HALF_SIDE_PX..=x + PATCH_HALF_SIDE_PX).map(move |x| (x, y)))
    }

    /// Renders both scenes through a weather, as `exr` or `png`.
    fn seen(&self, format: &str, weather: &str) -> Pair {
        let options = format!("--background {BACKGROUND} {} {weather}", self.options);
        let [white, black] = [&self.white, &self.black].map(|scene| {
            let path = self.workshop.render(scene, &self.view, &format!("seen.{format}"), &options);
            if format == "exr" { read_exr(&path) } else { light_of(&read_png(&path)) }
        });
        Pair { white, black }
    }

    /// Length of the ray through a pixel to card `index`, m.
    fn metres(&self, index: usize, x: usize, y: usize) -> f64 {
        self.cards[index].ray_length(&self.camera, x as f64 + 0.5, y as f64 + 0.5) * self.metres_per_unit
    }

    /// Optical depth that is measured at one pixel.
    fn depth(&self, seen: &Pair, x: usize, y: usize) -> f64 {
        -(seen.contrast(x, y, 1) / self.clear.contrast(x, y, 1)).ln()
    }

    /// Measures each card whose transmittance is between the two bounds, means over its patch:
    /// true ray length (m) and optical depth.
    fn measured(&self, seen: &Pair, channel: usize, transmittances: (f64, f64)) -> Vec<(usize, f64, f64)> {
        let mut points = Vec::new();
        for index in 0..self.cards.len() {
            let (mut metres, mut kept, mut count) = (0.0, 0.0, 0.0);
            for (x, y) in Self::patch(index) {
                metres += self.metres(index, x, y);
                kept += seen.contrast(x, y, channel) / self.clear.contrast(x, y, channel);
                count += 1.0;
            }
            let transmittance: f64 = kept / count;
            if transmittances.0 < transmittance && transmittance < transmittances.1 {
                points.push((index, metres / count, -transmittance.ln()));
            }
        }
        assert!(points.len() >= 6, "{} cards can be measured", points.len());
        points
    }

    /// The extinction that is measured, 1/m: slope of the optical depth over the ray length.
    fn extinction(&self, seen: &Pair, channel: usize, transmittances: (f64, f64)) -> f64 {
        let points = self.measured(seen, channel, transmittances);
        slope(&points.iter().map(|(_, metres, depth)| (*metres, *depth)).collect::<Vec<_>>())
    }

    /// [`Self::extinction`] by view z: wrong, and to be told from right.
    fn extinction_by_z(&self, seen: &Pair) -> f64 {
        let z_of = |index: usize, metres: f64| {
            let (x, y) = Self::middle(index);
            metres * self.camera.ray(x as f64 + 0.5, y as f64 + 0.5).dot(self.camera.forward())
        };
        let points = self.measured(seen, 1, (0.02, 0.995));
        slope(
            &points.iter().map(|(index, metres, depth)| (z_of(*index, *metres), *depth)).collect::<Vec<_>>(),
        )
    }
}

/// Least squares slope of a line through points.
fn slope(points: &[(f64, f64)]) -> f64 {
    let mean = |pick: fn(&(f64, f64)) -> f64| points.iter().map(pick).sum::<f64>() / points.len() as f64;
    let (x, y) = (mean(|p| p.0), mean(|p| p.1));
    let products: f64 = points.iter().map(|p| (p.0 - x) * (p.1 - y)).sum();
    products / points.iter().map(|p| (p.0 - x).powi(2)).sum::<f64>()
}

fn fog(mor: f64) -> String {
    let [r, g, b] = AIRLIGHT;
    format!("--set fog.mor={mor} --set fog.airlight=#{r:02x}{g:02x}{b:02x}")
}

/// Asserts a relative error and says it.
fn within(what: &str, measured: f64, asked: f64, bound: f64) {
    let error = measured / asked - 1.0;
    println!("{what}: asked {asked:.6}, measured {measured:.6}, error {:+.3} %", 100.0 * error);
    assert!(error.abs() < bound, "{what}: asked {asked}, measured {measured}");
}

#[test]
fn fog_has_the_range_that_is_asked_for() {
    let all = [50.0, 200.0, 1000.0];
    for (name, scale, mors) in
        [("file", Scale::File(2.5), &all[..]), ("option", Scale::Option(0.4), &all[1..2])]
    {
        let chart = Chart::new(scale, 600.0);
        // The cards are opaque, and as white and black as they were painted.
        for (x, y) in (0..chart.cards.len()).flat_map(Chart::patch) {
            let (white, black) = (chart.clear.white.at(x, y), chart.clear.black.at(x, y));
            assert!(white.iter().all(|v| *v > 0.999) && black.iter().all(|v| *v < 1e-4));
        }
        for &mor in mors {
            let seen = chart.seen("exr", &fog(mor));
            for channel in 0..3 {
                // Down to 2 %, which f32 about a radiance of 1/2 holds to 1e-5 of itself.
                let measured = MOR_DEPTH / chart.extinction(&seen, channel, (0.02, 0.995));
                within(&format!("EXR, scale by {name}, channel {channel}, MOR"), measured, mor, 0.01);
            }
            // At the picture's corners z is two thirds of the ray: fog by z would show, five times
            // the bound.
            let by_z = MOR_DEPTH / chart.extinction_by_z(&seen);
            assert!((by_z / mor - 1.0).abs() > 0.05, "by z the range would be {by_z}");
        }
    }
}

/// 8 bits. Dithered, the mean over 13 x 13 px is right within 0.06 of a step; a step is 1/255 of
/// the encoded value, 0.0055 of linear light at the slope 1.4 that the curve has at most between
/// airlight and white. A contrast of 10 % then errs by 2 x 0.06 x 0.0055 / 0.1 = 0.7 %, its
/// logarithm of 2.3 by 0.3 %. Without dithering a patch may be off by half a step as a whole, 2 x
/// 0.5 x 0.0055 / 0.1 = 5.5 %, or 2.4 % of the logarithm, and the error is shared with eight other
/// cards. So 3 % holds both.
#[test]
fn eight_bits_still_tell_the_range() {
    let chart = Chart::new(Scale::File(2.5), 600.0);
    for (mor, dither) in [(50.0, "ordered"), (200.0, "ordered"), (1000.0, "ordered"), (200.0, "off")] {
        let seen = chart.seen("png", &format!("{} --dither {dither}", fog(mor)));
        for channel in 0..3 {
            let measured = MOR_DEPTH / chart.extinction(&seen, channel, (0.1, 0.95));
            within(&format!("PNG, dither {dither}, channel {channel}, MOR"), measured, mor, 0.03);
        }
    }
}

/// By wavelength to the power of -1.3 (Angstrom 1929): 0.874 / 1 / 1.244 at 610 / 550 / 465 nm. The
/// ratio of two channels at the same pixels is free of the tilt's error and leaves the floats'
/// alone.
#[test]
fn haze_takes_each_color_by_its_own_measure() {
    let chart = Chart::new(Scale::File(2.5), 600.0);
    // The airlight is given, since a survey finds another among white cards than among black ones.
    let weather = "--set haze.mor=1500 --set haze.scale_height=inf --set haze.airlight=#b4bec8";
    let seen = chart.seen("exr", weather);
    let green = chart.extinction(&seen, 1, (0.02, 0.995));
    for (channel, nanometres) in [610.0f64, 550.0, 465.0].into_iter().enumerate() {
        let relative = (nanometres / 550.0).powf(-1.3);
        let measured = chart.extinction(&seen, channel, (0.02, 0.995));
        within(&format!("haze, channel {channel}, 1/m"), measured, relative * MOR_DEPTH / 1500.0, 0.01);
        within(&format!("haze, channel {channel} over green"), measured / green, relative, 0.001);
    }
}

/// Optical depth over `metres` of a ray that begins at `height` and rises by `rise` a metre, in air
/// whose extinction is `exp(-h / scale_height)`: Simpson's rule over 2000 pieces, right to 1e-9
/// here.
fn simpson(height: f64, rise: f64, metres: f64, scale_height: f64) -> f64 {
    let pieces = 2000;
    let step = metres / f64::from(pieces);
    let at = |i: i32| (-(height + rise * step * f64::from(i)) / scale_height).exp();
    let inner: f64 = (1..pieces).map(|i| if i % 2 == 1 { 4.0 * at(i) } else { 2.0 * at(i) }).sum();
    step / 3.0 * (at(0) + inner + at(pieces))
}

/// Fog that thins upwards, against the integral along each ray, taken numerically. Its base lies 3
/// m above the ground, which is 15 m below the camera.
#[test]
fn fog_that_thins_upwards_is_the_integral_along_each_ray() {
    let chart = Chart::new(Scale::Option(0.4), 120.0);
    for (mor, scale_height) in [(60.0, 20.0), (30.0, 8.0)] {
        let weather = format!("{} --set fog.scale_height={scale_height} --set fog.base_height=3", fog(mor));
        let seen = chart.seen("exr", &weather);
        // Cards that are seen upwards, level and downwards.
        for (name, rises) in [("up", 0.1..1.0), ("level", -0.01..0.01), ("down", -1.0..-0.1)] {
            let (mut cards, mut sum) = (0, 0.0);
            for index in 0..chart.cards.len() {
                let (mut measured, mut integral) = (0.0, 0.0);
                let (x, y) = Chart::middle(index);
                let rise = -chart.camera.ray(x as f64 + 0.5, y as f64 + 0.5).y;
                for (x, y) in Chart::patch(index) {
                    let rise = -chart.camera.ray(x as f64 + 0.5, y as f64 + 0.5).y;
                    measured += chart.depth(&seen, x, y);
                    integral += simpson(15.0 - 3.0, rise, chart.metres(index, x, y), scale_height);
                }
                let pixels = Chart::patch(index).count() as f64;
                // Neither next to nothing nor swamped.
                if rises.contains(&rise) && (0.02..4.0).contains(&(measured / pixels)) {
                    // The extinction at the base that the card tells: what it lost over the shape's
                    // integral.
                    sum += measured / integral;
                    cards += 1;
                }
            }
            assert!(cards >= 3, "{name}: {cards} cards");
            let found = MOR_DEPTH / (sum / f64::from(cards));
            within(&format!("H {scale_height} m, {name}, {cards} cards, MOR"), found, mor, 0.01);
        }
    }
}

/// Endlessly far things have the airlight's colour; near ones keep their own; more fog never shows
/// more.
#[test]
fn fog_only_takes_contrast_and_ends_in_the_airlight() {
    let chart = Chart::new(Scale::File(2.5), 600.0);
    let airlight = AIRLIGHT.map(|byte| decode(f64::from(byte) * BYTE_STEP));
    let thick = chart.seen("exr", &fog(50.0));
    // f32 between encoded and linear light: a few units of 6e-8 at a slope below 2.
    let corner = thick.white.at(2, 2);
    assert!((0..3).all(|k| (corner[k] - airlight[k]).abs() < 1e-5), "{corner:?}, {airlight:?}");

    let (thin, none) = (chart.seen("exr", &fog(1000.0)), &chart.clear);
    let middle = chart.seen("exr", &fog(200.0));
    for (x, y) in (0..chart.cards.len()).flat_map(Chart::patch) {
        for (k, airlight) in airlight.into_iter().enumerate() {
            let contrasts = [&thick, &middle, &thin, none].map(|pair| pair.contrast(x, y, k));
            // As far as f32 tells, which at 600 m and 50 m of range is nothing any more.
            assert!(contrasts.windows(2).all(|pair| pair[0] <= pair[1] + 1e-6), "{contrasts:?}");
            for pair in [&thick, &middle, &thin] {
                // White is dimmed towards the airlight and black is lifted towards it, neither
                // beyond.
                let (white, black) = (pair.white.at(x, y)[k], pair.black.at(x, y)[k]);
                assert!(white <= none.white.at(x, y)[k] + 1e-6 && white >= airlight - 1e-4, "{white}");
                assert!(black >= none.black.at(x, y)[k] - 1e-6 && black <= airlight + 1e-5, "{black}");
            }
        }
    }
}
