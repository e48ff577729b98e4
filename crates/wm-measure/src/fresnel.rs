//! Fresnel board: the share of light that water reflects, by the elevation of the view.
//!
//! A flood of black water that hides its bottom lies before a board of half of white, which fills
//! all that the water mirrors. The light of the water over that of the board is the reflectance at
//! the pixel's own elevation, against Fresnel's equations for unpolarised light and a refractive
//! index of 1.333, by the angles on both sides of the surface (Snell).
//!
//! Tolerance 3 %. Systematic: still water has slopes of 0.4 % rms, which change 0.1 % at 5 degrees;
//! below 1 % in all.

use super::lit::LightPicture;
use super::plot::{Axis, Series};
use super::{Finding, Instrument, InstrumentRenderer, LevelFrame, MeasureRequest, Tolerance, expected};
use std::f64::consts::FRAC_PI_2;
use wm_base::color::srgb_encode;
use wm_place::Result;
use wm_scene::Splats;
use wm_scene::card::Card;

/// The instrument.
pub(crate) const INSTRUMENT: Instrument = Instrument {
    name: "fresnel",
    title: "Fresnel board",
    about: "Black water before a board of half of white that fills all it mirrors: the light of the water over that of the board, \
            at elevations of 5 to 60 degrees, against Fresnel's equations.",
    applies: expected::is_flooded,
    read,
    sweep: &[&["flood.level=0.3"]],
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

/// The weather with still and black water alone.
pub(super) fn still(request: &MeasureRequest<'_>, changes: &[&str]) -> Result<wm_weather::Weather> {
    let mut weather = request.weather.clone();
    for effect in weather.clone().effects().map(|(effect, _)| effect.name).filter(|name| *name != "flood") {
        weather.set_text(&format!("{effect}=off"))?;
    }
    // Instruments set up boards at heights over the ground of the site.
    weather.set_text("flood.ground=0")?;
    changes.iter().try_for_each(|change| weather.set_text(change))?;
    Ok(weather)
}

fn read(rig: &mut dyn InstrumentRenderer, request: &MeasureRequest<'_>) -> Result<Finding> {
    let level = LevelFrame::of(&rig.site());
    let reflectance = |elevation: f64| expected::water_reflectance(FRAC_PI_2 - elevation.to_radians());
    let height = expected::number(request.weather, request.time, "flood", "level").unwrap_or_default();
    let weather = still(request, &["flood.tint=0,0,0", "flood.secchi=0.05"])?;
    let mut finding = request.finding();
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
        let center = level.point([DISTANCES_M[1] * cos, 0.0, height + DISTANCES_M[1] * sin]);
        let half = level.units(0.9);
        let up = level.vector([-sin, 0.0, cos]);
        let card = Card { center, u: level.vector([0.0, 1.0, 0.0]) * half, v: up * half };
        let mut splats = Splats::default();
        card.paint(&mut splats, (24, 24), [srgb_encode(BOARD_LIGHT) as f32; 3]);
        let subject = rig.set_up(splats)?;
        let picture = LightPicture::of(rig, subject, &camera, &weather, request.time)?;
        let middle = 0.5 * f64::from(PICTURE_SIDE_PX);
        let measured = picture.patch(middle, middle, PATCH_HALF_SIDE_PX) / BOARD_LIGHT;
        let asked = reflectance(degrees);
        finding.add(
            format!("reflectance of water at {degrees} degrees"),
            "",
            [asked, measured],
            Tolerance::Relative(0.03),
        );
        points.push([degrees, measured]);
        if degrees == ELEVATIONS_DEGREES[1] {
            finding.show(format!("water that mirrors a board, at {degrees} degrees"), &picture.picture);
        }
    }
    let law = (1..=90).map(|degrees| [f64::from(degrees), reflectance(f64::from(degrees))]);
    finding.plot(
        "Reflectance of water",
        "elevation of the view, degrees",
        Axis::log("share of light that is reflected"),
        vec![Series::line("Fresnel, 1.333", law.collect()), Series::points("measured", points)],
    );
    Ok(finding)
}
