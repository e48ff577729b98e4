//! Secchi disc: how far one sees into the water.
//!
//! A disc is lowered into a flood and looked at from above. What is left of its difference to the
//! water without it falls with the depth as `exp(-(c + K) z)`; 8.69 over that slope is the depth at
//! which an eye loses it (Tyler 1968).
//!
//! Tolerance 5 %.

use super::boards::slope;
use super::fresnel::still;
use super::plot::{Axis, Series};
use super::{Bench, Instrument, Tolerance, expected};
use wm_base::color::srgb_encode;
use wm_place::Result;
use wm_scene::Splats;

/// The instrument.
pub(crate) const INSTRUMENT: Instrument = Instrument {
    name: "secchi",
    title: "Secchi disc",
    about: "A white disc is lowered into the flood and seen from above. The logarithm of its contrast over its depth is a line; \
            8.69 over the slope is the Secchi depth.",
    applies: expected::is_flooded,
    measure,
    sweep: &["flood.level=0.5, flood.secchi=0.3", "flood.level=2, flood.secchi=4"],
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

fn measure(bench: &mut Bench<'_>) -> Result<()> {
    let level = bench.level;
    let number = |param: &str| bench.number("flood", param);
    let (water, asked) = (number("level").unwrap_or_default(), number("secchi").unwrap_or_default());
    let weather = still(bench, "")?;
    let camera = level.camera(
        (PICTURE_SIDE_PX, PICTURE_SIDE_PX),
        FIELD_OF_VIEW_DEGREES,
        [0.0, 0.0, water + EYE_HEIGHT_M],
        [0.0, 0.0, water],
    )?;
    let middle = 0.5 * f64::from(PICTURE_SIDE_PX);
    let bare = bench.rig.set_up(Splats::default())?;
    let without = bench.light(bare, &camera, &weather)?;
    let mut points = Vec::new();
    for share in DEPTH_SHARES {
        let depth = share * asked;
        let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        let half = 0.12 * (EYE_HEIGHT_M + depth);
        let subject =
            bench.square([0.0, 0.0, water - depth], axes, half, 24, srgb_encode(DISC_LIGHT) as f32)?;
        let picture = bench.light(subject, &camera, &weather)?;
        let contrast = picture.patch(middle, middle, PATCH_HALF_SIDE_PX)
            - without.patch(middle, middle, PATCH_HALF_SIDE_PX);
        if contrast > 0.0 {
            points.push([depth, contrast.ln()]);
        }
        if share == DEPTH_SHARES[1] {
            bench.show(format!("a disc {depth:.2} m deep"), &picture.picture);
        }
    }
    let measured = if points.len() < 3 { f64::NAN } else { SECCHI_CONSTANT / -slope(&points) };
    bench.add("Secchi depth", "m", [asked, measured], Tolerance::Relative(0.05));
    let first = points.first().copied().unwrap_or_default();
    let law = [0.0, 0.5 * asked].map(|z| [z, (first[1] - SECCHI_CONSTANT / asked * (z - first[0])).exp()]);
    bench.plot(
        "Contrast of a disc",
        "depth of the disc, m",
        Axis::log("light over that of the water"),
        vec![
            Series::line("8.69 over the depth asked for", law.to_vec()),
            Series::points("measured", points.iter().map(|[z, ln]| [*z, ln.exp()]).collect()),
        ],
    );
    Ok(())
}
