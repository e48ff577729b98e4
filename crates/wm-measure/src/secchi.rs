//! Secchi disc: how far one sees into the water.
//!
//! A disc is lowered into a flood and looked at from above. What is left of its difference to the
//! water without it falls with the depth as `exp(-(c + K) z)`; 8.69 over that slope is the depth at
//! which an eye loses it (Tyler 1968).
//!
//! Tolerance 5 %.

use super::boards::slope;
use super::fresnel::still;
use super::lit::LightPicture;
use super::plot::{Axis, Series};
use super::{Finding, Instrument, InstrumentRenderer, LevelFrame, MeasureRequest, Tolerance, expected};
use wm_base::color::srgb_encode;
use wm_place::Result;
use wm_scene::Splats;
use wm_scene::card::Card;

/// The instrument.
pub(crate) const INSTRUMENT: Instrument = Instrument {
    name: "secchi",
    title: "Secchi disc",
    about: "A white disc is lowered into the flood and seen from above. The logarithm of its contrast over its depth is a line; \
            8.69 over the slope is the Secchi depth.",
    applies: expected::is_flooded,
    read,
    sweep: &[&["flood.level=0.5", "flood.secchi=0.3"], &["flood.level=2", "flood.secchi=4"]],
};

/// Depths of the disc, of the Secchi depth.
const DEPTH_SHARES: [f64; 5] = [0.05, 0.12, 0.2, 0.3, 0.4];
/// Light of the disc in the air.
const DISC_LIGHT: f64 = 0.82;
/// Height of the eye over the water, m.
const EYE_HEIGHT_M: f64 = 3.0;
/// Side of the pictures and of the patch that is read, px; field of view, degrees.
const PICTURE_SIDE_PX: u32 = 48;
const PATCH_HALF_SIDE_PX: usize = 6;
const FIELD_OF_VIEW_DEGREES: f64 = 8.0;
/// `(c + K) Z`.
const SECCHI_CONSTANT: f64 = 8.69;

fn read(rig: &mut dyn InstrumentRenderer, request: &MeasureRequest<'_>) -> Result<Finding> {
    let level = LevelFrame::of(&rig.site());
    let number = |param: &str| expected::number(request.weather, request.time, "flood", param);
    let (water, asked) = (number("level").unwrap_or_default(), number("secchi").unwrap_or_default());
    let weather = still(request, &[])?;
    let camera = level.camera(
        (PICTURE_SIDE_PX, PICTURE_SIDE_PX),
        FIELD_OF_VIEW_DEGREES,
        [0.0, 0.0, water + EYE_HEIGHT_M],
        [0.0, 0.0, water],
    )?;
    let middle = 0.5 * f64::from(PICTURE_SIDE_PX);
    let bare = rig.set_up(Splats::default())?;
    let without = LightPicture::of(rig, bare, &camera, &weather, request.time)?;
    let (mut points, mut finding) = (Vec::new(), request.finding());
    for share in DEPTH_SHARES {
        let depth = share * asked;
        let half = level.units(0.12 * (EYE_HEIGHT_M + depth));
        let card = Card {
            center: level.point([0.0, 0.0, water - depth]),
            u: level.vector([1.0, 0.0, 0.0]) * half,
            v: level.vector([0.0, 1.0, 0.0]) * half,
        };
        let mut splats = Splats::default();
        card.paint(&mut splats, (24, 24), [srgb_encode(DISC_LIGHT) as f32; 3]);
        let subject = rig.set_up(splats)?;
        let picture = LightPicture::of(rig, subject, &camera, &weather, request.time)?;
        let contrast = picture.patch(middle, middle, PATCH_HALF_SIDE_PX)
            - without.patch(middle, middle, PATCH_HALF_SIDE_PX);
        if contrast > 0.0 {
            points.push([depth, contrast.ln()]);
        }
        if share == DEPTH_SHARES[1] {
            finding.show(format!("a disc {depth:.2} m deep"), &picture.picture);
        }
    }
    let measured = if points.len() < 3 { f64::NAN } else { SECCHI_CONSTANT / -slope(&points) };
    finding.add("Secchi depth", "m", [asked, measured], Tolerance::Relative(0.05));
    let first = points.first().copied().unwrap_or_default();
    let law = [0.0, 0.5 * asked].map(|z| [z, (first[1] - SECCHI_CONSTANT / asked * (z - first[0])).exp()]);
    finding.plot(
        "Contrast of a disc",
        "depth of the disc, m",
        Axis::log("light over that of the water"),
        vec![
            Series::line("8.69 over the depth asked for", law.to_vec()),
            Series::points("measured", points.iter().map(|[z, ln]| [*z, ln.exp()]).collect()),
        ],
    );
    Ok(finding)
}
