//! The park's terrain: a hill, a hollow with a pond, a level lawn, and a mesh of all that.

use super::builder::Builder;
use super::far::FIELD_HEIGHT_M;
use crate::hash::{noise2, smoothstep};
use crate::paint::PaintId;
use glam::{DVec2, DVec3};

/// Half the width of the mesh, m: its border lies at the height of the fields.
pub(super) const TERRAIN_HALF_WIDTH_M: f64 = 72.0;
/// Width of the mesh's squares, m; each is two triangles.
const MESH_SQUARE_M: f64 = 2.0;
/// The top of the hill.
pub(super) const HILL_TOP: DVec2 = DVec2::new(-31.0, 19.0);
/// The middle of the pond and its radii, m.
pub(super) const POND_ELLIPSE: (DVec2, DVec2) = (DVec2::new(31.0, 19.0), DVec2::new(15.0, 10.5));
/// Height of the water, m.
pub(super) const WATER_LEVEL_M: f64 = -0.35;
/// The middle of the level lawn and the radius in which it is level, m.
pub(super) const LAWN_CIRCLE: (DVec2, f64) = (DVec2::new(28.0, -27.0), 14.0);

/// The distance from the pond's middle, 1 at its shore.
fn pond_reach(p: DVec2) -> f64 {
    let (center, radii) = POND_ELLIPSE;
    let way = (p - center) / radii;
    way.length() * (1.0 + 0.14 * noise2(p / 6.0, 63))
}

/// Height of the terrain that the mesh follows, m.
pub(super) fn height(p: DVec2) -> f64 {
    let (lawn, level) = LAWN_CIRCLE;
    let open = smoothstep(4.0, 10.0, p.x.abs()) * smoothstep(level, level + 10.0, p.distance(lawn));
    let inner = smoothstep(TERRAIN_HALF_WIDTH_M - 1.0, TERRAIN_HALF_WIDTH_M - 14.0, p.abs().max_element());
    let roll = 0.30 * noise2(p / 17.0, 61) + 0.10 * noise2(p / 7.0, 62);
    let bump =
        |center: DVec2, radii: DVec2, high: f64| high * (-((p - center) / radii).length_squared()).exp();
    let hills =
        bump(HILL_TOP, DVec2::new(15.0, 12.0), 5.4) + bump(DVec2::new(-52.0, -16.0), DVec2::splat(8.0), 1.7);
    let bowl = 1.5 * smoothstep(1.22, 0.72, pond_reach(p));
    let free = open * (roll + hills) - bowl;
    FIELD_HEIGHT_M + inner * (free - FIELD_HEIGHT_M)
}

/// Builds the mesh and the water.
pub(super) fn build(b: &mut Builder, lawn: PaintId, water: PaintId) {
    let count = (2.0 * TERRAIN_HALF_WIDTH_M / MESH_SQUARE_M) as i32;
    let point = |i: i32, j: i32| {
        let p = DVec2::new(f64::from(i), f64::from(j)) * MESH_SQUARE_M - TERRAIN_HALF_WIDTH_M;
        p.extend(height(p))
    };
    for j in 0..count {
        for i in 0..count {
            let (a, c, d, e) = (point(i, j), point(i + 1, j), point(i, j + 1), point(i + 1, j + 1));
            b.triangle(a, c - a, d - a, lawn);
            b.triangle(e, d - e, c - e, lawn);
        }
    }
    // The terrain rises out of the water's plane all around: that line is the shore.
    let (center, radii) = POND_ELLIPSE;
    let corner = (center - radii * 1.25).extend(WATER_LEVEL_M);
    let quarter = radii * 0.625;
    for j in 0..4 {
        for i in 0..4 {
            let at = corner + DVec3::new(quarter.x * f64::from(i), quarter.y * f64::from(j), 0.0);
            b.quad(at, DVec3::X * quarter.x, DVec3::Y * quarter.y, water);
        }
    }
}
