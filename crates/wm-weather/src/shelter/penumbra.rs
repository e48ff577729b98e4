//! The share of a far, round source of light that a surface sees: shadows whose edges are as wide
//! as the source is, from where the shadow is cast.
//!
//! Light comes along the fall of the map. A surface with a normal is a plane in the map: what
//! stands before a cell of it by more than a margin shades it there, so that the surface does not
//! shade itself however slanted it is, and shadows stay where they are. The mean distance of what
//! shades it, within the widest penumbra, gives the radius of its own; the share of the cells
//! within that radius that are open is the share of the source that it sees. A source of the
//! angular diameter `w` makes an edge `w d` wide at the distance `d`.

use super::map::{MOST_RADIUS, Shelter};
use glam::{Vec2, Vec3};

/// Cells by which a surface stands before itself at most, across it: its roughness.
const MAX_ROUGHNESS_CELLS: f32 = 1.2;
/// Least width of the cells by which roughness goes, m.
const ROUGH_CELL: f32 = 0.1;
/// Least cosine of the incidence for which a surface is a plane.
const MIN_PLANE_COSINE: f32 = 0.1;
/// Points at which it is first looked for what shades a surface.
const FIRST_LOOK_COUNT: usize = 24;
/// Least radius of the edge of a shadow, cells: what the map resolves.
const MIN_EDGE_CELLS: f32 = 1.5;

/// A far, round source of light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct FarSource {
    /// Angular diameter, radians.
    pub(crate) width: f32,
    /// Widest radius of the edge of a shadow, m, across the light.
    pub(crate) widest: f32,
}

/// The sun; the shadows of what is farther than some 110 m have edges as wide as those of that.
pub(crate) const SUN: FarSource = FarSource { width: 0.0093, widest: 0.5 };

/// A surface on the map.
struct Receiver {
    /// Column and row, and distance along the fall, scene units.
    at: Vec2,
    t: f32,
    /// Change of that distance along columns and rows.
    slope: Vec2,
    /// Distance before it at which something shades it, and growth of that a cell away, scene
    /// units.
    margin: f32,
    spread: f32,
}

impl Shelter {
    /// Returns the share of a source in the direction that the fall comes from that a surface at
    /// `point` (world, scene units) sees, 0-1. A normal of zero is that of leaves, which turn to
    /// all sides.
    pub(crate) fn lit(&self, point: Vec3, normal: Vec3, source: FarSource) -> f32 {
        let Some(receiver) = self.receiver(point, normal) else { return 1.0 };
        let widest = source.widest * self.query.cells_per_metre;
        let Some(distance) = self.blocker(&receiver, widest.max(MIN_EDGE_CELLS)) else { return 1.0 };
        let radius = 0.5 * source.width * distance / self.query.cell;
        self.open_within(&receiver, radius.clamp(MIN_EDGE_CELLS, widest.max(MIN_EDGE_CELLS)))
    }

    /// Returns the share of the cells within a radius (m) of a surface that nothing shades, 0-1.
    pub(crate) fn lit_within(&self, point: Vec3, normal: Vec3, radius: f32) -> f32 {
        let radius = (radius * self.query.cells_per_metre).min(MOST_RADIUS);
        self.receiver(point, normal).map_or(1.0, |receiver| self.open_within(&receiver, radius))
    }

    /// A surface on the map; `None` if it is no place.
    fn receiver(&self, point: Vec3, normal: Vec3) -> Option<Receiver> {
        let [u, v, t] = self.locate(point.to_array());
        if !(u.is_finite() && v.is_finite() && t.is_finite()) {
            return None;
        }
        let query = &self.query;
        let [across, down, fall] = query.axes.map(Vec3::from_array);
        let facing = -normal.dot(fall);
        let rough = MAX_ROUGHNESS_CELLS * query.cell.max(ROUGH_CELL / self.metres_per_unit as f32);
        Some(if normal == Vec3::ZERO {
            Receiver {
                at: Vec2::new(u, v),
                t,
                slope: Vec2::ZERO,
                margin: query.margin + rough,
                spread: query.cell,
            }
        } else {
            let facing = facing.max(MIN_PLANE_COSINE);
            let cell = query.cell * query.cell;
            Receiver {
                at: Vec2::new(u, v),
                t,
                // The axes are columns and rows a scene unit.
                slope: Vec2::new(normal.dot(across), normal.dot(down)) * (cell / facing),
                margin: query.margin.max(rough / facing),
                spread: 0.0,
            }
        })
    }

    /// The distance of the first surface of a cell before a receiver's plane, scene units, if it
    /// shades the receiver.
    #[inline]
    fn shade(&self, receiver: &Receiver, column: i32, row: i32) -> Option<f32> {
        let [width, height] = [self.grid.columns, self.grid.rows].map(|v| v as i32);
        if column < 0 || row < 0 || column >= width || row >= height {
            return None;
        }
        let away = Vec2::new(column as f32 + 0.5, row as f32 + 0.5) - receiver.at;
        let stop = self.stops[row as usize * self.grid.columns + column as usize];
        let before = receiver.t + receiver.slope.dot(away) - stop;
        (before > receiver.margin + receiver.spread * away.length()).then_some(before)
    }

    /// Mean distance of what shades a receiver within a radius, cells; `None` if nothing does.
    fn blocker(&self, receiver: &Receiver, radius: f32) -> Option<f32> {
        let (mut sum, mut count) = (0.0f32, 0.0f32);
        let mut look = |at: Vec2| {
            if let Some(distance) = self.shade(receiver, at.x.floor() as i32, at.y.floor() as i32) {
                (sum, count) = (sum + distance, count + 1.0);
            }
        };
        look(receiver.at);
        // A spiral, alike for all points: where little is seen of an edge, its distance is told by
        // few.
        for k in 0..FIRST_LOOK_COUNT {
            let share = (k as f32 + 0.5) / FIRST_LOOK_COUNT as f32;
            let (sin, cos) = (2.399_963_2 * k as f32).sin_cos();
            look(receiver.at + Vec2::new(cos, sin) * (radius * share.sqrt()));
        }
        (count > 0.0).then(|| sum / count)
    }

    /// Returns the exposure of a point (world, scene units), 0-1, with soft edges: the share of the
    /// cells within `radius` (m, at most 64 cells) of it, across the fall, that hold nothing above
    /// it, nearer ones counting more (`1 - r^2 / radius^2`): it changes smoothly as the point
    /// moves, and is a half under a straight edge.
    ///
    /// A thing in another cell must be above the point by more than it is away, and the margin, so
    /// that slopes up to 45 degrees do not shelter themselves, and low things have harder edges
    /// than high ones. A radius below half a cell asks for the point's own cell. Visits about
    /// `4 (radius / cell)^2` cells.
    pub(crate) fn exposure(&self, point: [f32; 3], radius: f32) -> f32 {
        let own = || if self.is_exposed(point) { 1.0 } else { 0.0 };
        let reach = (radius * self.query.cells_per_metre).min(MOST_RADIUS);
        let [u, v, t] = self.locate(point);
        let [width, height] = self.query.size;
        let is_near = u > -reach && v > -reach && u < width + reach && v < height + reach;
        if reach.is_nan() || reach < 0.5 || !is_near {
            return own();
        }
        let (at, margin, spread) = (Vec2::new(u, v), self.query.margin, self.query.cell);
        let receiver = Receiver { at, t, slope: Vec2::ZERO, margin, spread };
        let weight = |away: Vec2| (1.0 - away.length_squared() / (reach * reach)).max(0.0);
        self.mean_open(&receiver, reach, weight).unwrap_or_else(own)
    }

    /// The share of the cells within a radius (cells) of a receiver that do not shade it, those
    /// across the rim by their part.
    fn open_within(&self, receiver: &Receiver, radius: f32) -> f32 {
        let reach = radius + 0.5;
        let weight = |away: Vec2| (reach - away.length()).clamp(0.0, 1.0);
        self.mean_open(receiver, reach, weight).unwrap_or(1.0)
    }

    /// The share of the cells about a receiver that do not shade it, weighted by how far away they
    /// are; `None` if none has a weight.
    #[inline]
    fn mean_open(&self, receiver: &Receiver, reach: f32, weight: impl Fn(Vec2) -> f32) -> Option<f32> {
        let within = |at: f32| ((at - reach - 0.5).ceil() as i32, (at + reach - 0.5).floor() as i32);
        let ((left, right), (top, bottom)) = (within(receiver.at.x), within(receiver.at.y));
        let (mut open, mut all) = (0.0f32, 0.0f32);
        for row in top..=bottom {
            for column in left..=right {
                let weight = weight(Vec2::new(column as f32 + 0.5, row as f32 + 0.5) - receiver.at);
                if weight > 0.0 {
                    all += weight;
                    open += if self.shade(receiver, column, row).is_none() { weight } else { 0.0 };
                }
            }
        }
        (all > 0.0).then(|| open / all)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optics::Site;
    use crate::shelter::{Occluders, ShelterOptions};
    use glam::DVec3;
    use wm_scene::synthetic::Builder;

    /// A floor, and a plate over the half of it with x below 0.
    fn map(height: f64, towards: DVec3) -> Shelter {
        let mut place = Builder::new(5);
        let mut level = |corner: DVec3, size: [f64; 2]| {
            place.surface(corner, DVec3::X * size[0], DVec3::Y * size[1], 0.05, |_, _| [0.5; 3]);
        };
        level(DVec3::new(-4.0, -2.0, 0.0), [8.0, 4.0]);
        let slide = towards * (height / towards.z);
        level(DVec3::new(slide.x - 4.0, slide.y - 2.5, height), [4.0, 5.0]);
        let options = ShelterOptions { cell: 0.05, ..ShelterOptions::default() };
        Occluders::of(&place.build(), &Site::PLAIN, &options).shelter((-towards).to_array())
    }

    /// Shares of the source along a line of the floor across the edge, 1 cm apart, from x -1 on.
    fn across(map: &Shelter, source: FarSource) -> Vec<f32> {
        let mean = |x: f32| {
            let at = |k: i32| map.lit(Vec3::new(x, 0.023 * k as f32, 0.0), Vec3::Z, source);
            (-20..20).map(at).sum::<f32>() / 40.0
        };
        (0..200).map(|k| mean(-1.0 + 0.01 * k as f32)).collect()
    }

    fn crossing(shares: &[f32], level: f32) -> f32 {
        0.01 * shares.iter().position(|share| *share >= level).unwrap() as f32 - 1.0
    }

    #[test]
    fn edges_are_as_wide_as_the_source_and_stay_where_they_are() {
        let source = FarSource { width: 0.04, widest: 0.5 };
        for (towards, height) in [(DVec3::Z, 8.0), (DVec3::Z, 16.0), (DVec3::new(0.0, 0.8, 0.6), 8.0)] {
            let shares = across(&map(height, towards), source);
            let distance = (height / towards.z) as f32;
            let width = (crossing(&shares, 0.9) - crossing(&shares, 0.1)) / 0.687;
            assert!((width / (0.04 * distance) - 1.0).abs() < 0.1, "{height}: {width}");
            // A plate ends half a splat beyond its last.
            assert!(crossing(&shares, 0.5).abs() < 0.06, "{height}: {}", crossing(&shares, 0.5));
        }
    }

    /// Low light, in which a surface is nearly along the map's rays.
    #[test]
    fn a_slanted_surface_does_not_shade_itself() {
        for rise in [0.2f64, 0.5, 1.0] {
            let towards = DVec3::new(0.6, -0.4, rise).normalize();
            let map = map(8.0, towards);
            for k in 0..400 {
                let point = Vec3::new(0.8 + 0.02 * (k % 100) as f32, -1.5 + 0.7 * (k / 100) as f32, 0.0);
                assert_eq!(map.lit(point, Vec3::Z, SUN), 1.0, "{rise}: {point}");
            }
        }
    }

    #[test]
    fn what_is_no_place_is_lit() {
        let map = map(2.0, DVec3::Z);
        for point in [Vec3::NAN, Vec3::splat(1e30), Vec3::new(90.0, 0.0, -5.0)] {
            assert_eq!(map.lit(point, Vec3::Z, SUN), 1.0);
        }
        assert_eq!(map.lit(Vec3::new(-2.0, 0.0, 0.0), Vec3::Z, SUN), 0.0);
        assert_eq!(map.lit(Vec3::new(-2.0, 0.0, 0.0), Vec3::ZERO, SUN), 0.0);
    }
}
