//! Mirror pole: where still water shows what stands over it.
//!
//! White marks on a pole stand over black water. The middle of the light of each image in the water
//! is held against the picture point of the mark's place, as deep below the surface as the mark is
//! above it.
//!
//! Tolerance 1 px of a picture of 480 x 360.

use super::fresnel::{BLACK_WATER, still};
use super::{Bench, Instrument, Tolerance, expected};
use wm_place::Result;
use wm_scene::Splats;

/// The instrument.
pub(crate) const INSTRUMENT: Instrument = Instrument {
    name: "mirror",
    title: "Mirror pole",
    about: "White marks at heights of 0.3 to 1.4 m over still water, 4 and 9 m away: the middle of the light of their images in \
            the water against the points that lie as deep as the marks are high.",
    applies: expected::is_flooded,
    measure,
    sweep: &["flood.level=0.5"],
};

/// Heights of the marks over the water, their distances, and how far they are to the side, m.
const MARK_HEIGHTS_M: [f64; 3] = [0.3, 0.8, 1.4];
const MARK_POSITIONS_M: [[f64; 2]; 2] = [[4.0, -0.8], [9.0, 1.3]];
/// Half the side of a mark, m.
const MARK_HALF_SIDE_M: f64 = 0.05;
/// Height of the eye over the water, m.
const EYE_HEIGHT_M: f64 = 1.7;
/// Size of the picture, px, and field of view, degrees.
const SIZE: (u32, u32) = (480, 360);
const FIELD_OF_VIEW_DEGREES: f64 = 60.0;
/// Half the side of the part of the picture that an image is looked for in, px.
const SEARCH_HALF_SIDE_PX: f64 = 12.0;

fn measure(bench: &mut Bench<'_>) -> Result<()> {
    let level = bench.level;
    let water = bench.number("flood", "level").unwrap_or_default();
    let weather = still(bench, BLACK_WATER)?;
    let camera = level.camera(
        SIZE,
        FIELD_OF_VIEW_DEGREES,
        [0.0, 0.0, water + EYE_HEIGHT_M],
        [6.0, 0.0, water + 0.3],
    )?;
    let mut farthest: f64 = 0.0;
    for [x, y] in MARK_POSITIONS_M {
        for height in MARK_HEIGHTS_M {
            let subject = bench.square(
                [x, y, water + height],
                [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
                MARK_HALF_SIDE_M,
                6,
                1.0,
            )?;
            let with = bench.light(subject, &camera, &weather)?;
            let bare = bench.rig.set_up(Splats::default())?;
            let without = bench.light(bare, &camera, &weather)?;
            let image = level.point([x, y, water - height]);
            let Some((u, v, _)) = camera.project(image) else { continue };
            let (mut sum, mut at) = (0.0, [0.0; 2]);
            let inside = |along: f64, side: u32| {
                (along - SEARCH_HALF_SIDE_PX).max(0.0) as usize
                    ..(along + SEARCH_HALF_SIDE_PX).min(f64::from(side)) as usize
            };
            for row in inside(v, SIZE.1) {
                for column in inside(u, SIZE.0) {
                    // Haze is mirrored where the mark is not.
                    let light = (with.light(column, row) - without.light(column, row)).max(0.0);
                    sum += light;
                    at[0] += light * (column as f64 + 0.5);
                    at[1] += light * (row as f64 + 0.5);
                }
            }
            let off = if sum > 1e-3 { (at[0] / sum - u).hypot(at[1] / sum - v) } else { f64::NAN };
            farthest = farthest.max(if off.is_nan() { f64::INFINITY } else { off });
            if height == MARK_HEIGHTS_M[1] && x == MARK_POSITIONS_M[0][0] {
                bench.show("a mark and its image in still water", &with.picture);
            }
        }
    }
    bench.add(
        "images in the water, farthest from their places",
        "px",
        [0.0, farthest],
        Tolerance::Absolute(1.0),
    );
    Ok(())
}
