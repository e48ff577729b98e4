//! Fresnel board: the share of light that water reflects, by the elevation of the view.
//!
//! A flood of black water that hides its bottom lies before a board of half of white, which fills
//! all that the water mirrors. The light of the water over that of the board is the reflectance at
//! the pixel's own elevation, against Fresnel's equations for unpolarised light and a refractive
//! index of 1.333, by the angles on both sides of the surface (Snell).
//!
//! Tolerance 3 %. Systematic: still water has slopes of 0.4 % rms, which change 0.1 % at 5 degrees;
//! below 1 % in all.

use super::plot::{Axis, Series};
use super::{Bench, Instrument, Tolerance, changed, expected};
use std::f64::consts::FRAC_PI_2;
use wm_base::color::srgb_encode;
use wm_place::Result;
use wm_weather::Weather;

/// The instrument.
pub(crate) const INSTRUMENT: Instrument = Instrument {
    name: "fresnel",
    title: "Fresnel board",
    about: "Black water before a board of half of white that fills all it mirrors: the light of the water over that of the board, \
            at elevations of 5 to 60 degrees, against Fresnel's equations.",
    applies: expected::is_flooded,
    measure,
    sweep: &["flood.level=0.3"],
};

/// Elevations, degrees.
const ELEVATIONS_DEGREES: [f64; 6] = [5.0, 10.0, 20.0, 30.0, 45.0, 60.0];
/// Light of the board.
const BOARD_LIGHT: f64 = 0.5;
/// From the eye to the water and from there to the board, m.
const DISTANCES_M: [f64; 2] = [8.0, 6.0];
/// Side of the pictures and of the patch in their middle that is read, px; their field of view,
/// degrees.
pub(super) const PICTURE_SIDE_PX: u32 = 64;
const PATCH_HALF_SIDE_PX: usize = 8;
const FIELD_OF_VIEW_DEGREES: f64 = 4.0;

/// Changes that make water black.
pub(super) const BLACK_WATER: &str = "flood.tint=0,0,0, flood.secchi=0.05";

/// The weather with still water alone, and with changes.
pub(super) fn still(bench: &Bench<'_>, changes: &str) -> Result<Weather> {
    let mut weather = bench.alone("flood")?;
    // Instruments set up boards at heights over the ground of the site.
    weather.set_text("flood.ground=0")?;
    changed(&weather, changes)
}

fn measure(bench: &mut Bench<'_>) -> Result<()> {
    let level = bench.level;
    let reflectance = |elevation: f64| expected::water_reflectance(FRAC_PI_2 - elevation.to_radians());
    let height = bench.number("flood", "level").unwrap_or_default();
    let weather = still(bench, BLACK_WATER)?;
    let mut points = Vec::new();
    for degrees in ELEVATIONS_DEGREES {
        let (sin, cos) = degrees.to_radians().sin_cos();
        let eye = [-DISTANCES_M[0] * cos, 0.0, height + DISTANCES_M[0] * sin];
        let camera = level.camera(
            (PICTURE_SIDE_PX, PICTURE_SIDE_PX),
            FIELD_OF_VIEW_DEGREES,
            eye,
            [0.0, 0.0, height],
        )?;
        let center = [DISTANCES_M[1] * cos, 0.0, height + DISTANCES_M[1] * sin];
        let subject = bench.square(
            center,
            [[0.0, 1.0, 0.0], [-sin, 0.0, cos]],
            0.9,
            24,
            srgb_encode(BOARD_LIGHT) as f32,
        )?;
        let picture = bench.light(subject, &camera, &weather)?;
        let middle = 0.5 * f64::from(PICTURE_SIDE_PX);
        let measured = picture.patch(middle, middle, PATCH_HALF_SIDE_PX) / BOARD_LIGHT;
        let asked = reflectance(degrees);
        bench.add(
            format!("reflectance of water at {degrees} degrees"),
            "",
            [asked, measured],
            Tolerance::Relative(0.03),
        );
        points.push([degrees, measured]);
        if degrees == ELEVATIONS_DEGREES[1] {
            bench.show(format!("water that mirrors a board, at {degrees} degrees"), &picture.picture);
        }
    }
    let law = (1..=90).map(|degrees| [f64::from(degrees), reflectance(f64::from(degrees))]);
    bench.plot(
        "Reflectance of water",
        "elevation of the view, degrees",
        Axis::log("share of light that is reflected"),
        vec![Series::line("Fresnel, 1.333", law.collect()), Series::points("measured", points)],
    );
    Ok(())
}
