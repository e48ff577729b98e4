//! A coarse occupancy grid of the scene.

use glam::DVec3;
use wm_scene::{Group, Splats, quat, survey::Survey};

/// Maximum radius of a clearance test, cells: with a wrong scale it would visit the whole grid.
const MAX_CLEARANCE_CELLS: f64 = 24.0;
/// Cells per scene radius.
const CELLS_PER_RADIUS: f64 = 56.0;
/// Half the width of the grid in scene radii.
const HALF_WIDTH_RADII: f64 = 1.3;
/// Maximum number of splats that are counted.
const MAX_SPLATS: usize = 250_000;
/// A cell counts as filled if splats cover this share of a face of it.
const MIN_FILLED_SHARE: f32 = 0.35;
/// Maximum distance of the ground from the survey's height, scene radii.
const MAX_RELIEF_RADII: f64 = 0.1;

/// Filled and empty cells about the middle of the scene, and the height of the ground below.
pub(crate) struct OccupancyGrid {
    center: DVec3,
    /// The grid's axes: two level ones and up.
    axes: [DVec3; 3],
    cell: f64,
    /// Height of the lowest cell's floor, along up.
    floor: f64,
    side: usize,
    layers: usize,
    filled: Vec<bool>,
    /// Height of what is low and level in each column, along up; NaN where nothing is.
    ground: Vec<f64>,
}

impl OccupancyGrid {
    /// Looks at the splats of a scene, sky left out.
    pub(crate) fn of(splats: &Splats, survey: &Survey) -> Self {
        let up = survey.up.value;
        let least = up.abs().min_position();
        let x = (DVec3::AXES[least] - up * up[least]).normalize();
        let radius = survey.radius.max(1e-6);
        let cell = radius / CELLS_PER_RADIUS;
        let low = survey.ground.value - 0.3 * radius;
        let high = (survey.center.dot(up) + radius).max(survey.ground.value + radius);
        let side = (2.0 * HALF_WIDTH_RADII * CELLS_PER_RADIUS) as usize;
        let layers = (((high - low) / cell) as usize).clamp(1, 4 * side);
        let mut space = Self {
            center: survey.center,
            axes: [x, up.cross(x), up],
            cell,
            floor: low,
            side,
            layers,
            filled: Vec::new(),
            ground: Vec::new(),
        };
        space.fill(splats, survey.ground.value, MAX_RELIEF_RADII * radius);
        space
    }

    fn fill(&mut self, splats: &Splats, ground: f64, relief: f64) {
        let step = splats.len().div_ceil(MAX_SPLATS).max(1);
        let mut cover = vec![0.0f32; self.side * self.side * self.layers];
        let mut heights: Vec<(usize, f64)> = Vec::new();
        for index in (0..splats.len()).step_by(step) {
            if splats.groups[index] == Group::Sky || !splats.is_sound(index) {
                continue;
            }
            let at = DVec3::from_array(splats.means[index].map(f64::from));
            let opacity = splats.opacity(index);
            let (Some(_), true) = (self.index(at), opacity > 0.2) else { continue };
            let matrix = quat::to_matrix(splats.quats[index].map(f64::from));
            let mut axes: Vec<(f64, DVec3)> = splats
                .scales(index)
                .into_iter()
                .enumerate()
                .map(|(k, s)| (s, DVec3::new(matrix[0][k], matrix[1][k], matrix[2][k])))
                .collect();
            axes.sort_by(|a, b| b.0.total_cmp(&a.0));
            let [(long, u), (wide, v), (_, normal)] = axes[..] else { continue };
            // Large splats fill many cells: a point per cell over one standard deviation to each
            // side.
            let points = |size: f64| ((size / self.cell) as i32).min(4);
            let (nu, nv) = (points(long), points(wide));
            let share = f64::from((2 * nu + 1) * (2 * nv + 1));
            // The area to one standard deviation, each splat standing for those that were left out.
            let area = std::f64::consts::PI * long * wide * opacity * step as f64 / share;
            let area = (area / (self.cell * self.cell)) as f32;
            for i in -nu..=nu {
                for j in -nv..=nv {
                    let [du, dv] = [(i, nu, long), (j, nv, wide)]
                        .map(|(k, n, size)| if n > 0 { f64::from(k) * size / f64::from(n) } else { 0.0 });
                    if let Some(cell) = self.index(at + u * du + v * dv) {
                        cover[cell] += area;
                    }
                }
            }
            let height = at.dot(self.axes[2]);
            if normal.dot(self.axes[2]).abs() > 0.7 && (height - ground).abs() < relief {
                let column = self.column(at).unwrap_or(0);
                heights.push((column, height));
            }
        }
        self.filled = cover.into_iter().map(|c| c >= MIN_FILLED_SHARE).collect();
        heights.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
        self.ground = vec![f64::NAN; self.side * self.side];
        for column in heights.chunk_by(|a, b| a.0 == b.0) {
            self.ground[column[0].0] = column[column.len() / 4].1;
        }
    }

    fn column(&self, at: DVec3) -> Option<usize> {
        let offset = at - self.center;
        let half = 0.5 * self.side as f64;
        let [x, y] = [0, 1].map(|k| offset.dot(self.axes[k]) / self.cell + half);
        let inside = |v: f64| v >= 0.0 && v < self.side as f64;
        (inside(x) && inside(y)).then_some(y as usize * self.side + x as usize)
    }

    fn index(&self, at: DVec3) -> Option<usize> {
        let layer = (at.dot(self.axes[2]) - self.floor) / self.cell;
        let inside = layer >= 0.0 && layer < self.layers as f64;
        let column = self.column(at)?;
        inside.then(|| layer as usize * self.side * self.side + column)
    }

    /// Returns true if the cell at a point is filled; no cell outside the grid is.
    pub(crate) fn is_filled(&self, at: DVec3) -> bool {
        self.index(at).is_some_and(|index| self.filled[index])
    }

    /// The level axes and up.
    pub(crate) fn axes(&self) -> [DVec3; 3] {
        self.axes
    }

    /// Height of the ground below a point, along up: a low quantile of the columns about it, so
    /// that a car or a table is not stood on. `None` where no ground is seen.
    pub(crate) fn ground(&self, at: DVec3) -> Option<f64> {
        let column = self.column(at)?;
        let (x, y) = (column % self.side, column / self.side);
        let near = |v: usize| v.saturating_sub(3)..(v + 4).min(self.side);
        let columns = near(y).flat_map(|y| near(x).map(move |x| (x, y)));
        let heights = columns.map(|(x, y)| self.ground[y * self.side + x]);
        let mut heights: Vec<f64> = heights.filter(|height| !height.is_nan()).collect();
        heights.sort_by(f64::total_cmp);
        // Fewer are strays, or the edge of what was seen.
        if heights.len() < 12 { None } else { heights.get(heights.len() / 4).copied() }
    }

    /// The unit direction at an azimuth and elevation, radians.
    pub(crate) fn direction(&self, azimuth: f64, elevation: f64) -> DVec3 {
        let [x, y, up] = self.axes;
        (x * azimuth.cos() + y * azimuth.sin()) * elevation.cos() + up * elevation.sin()
    }

    /// Distance along a ray to the first filled cell; `None` if it is beyond `most`.
    pub(crate) fn hit(&self, from: DVec3, direction: DVec3, most: f64) -> Option<f64> {
        let step = 0.7 * self.cell;
        let steps = (most / step).min(4.0 * self.side as f64) as usize;
        // The cell of the eye itself is judged elsewhere.
        (1..=steps).map(|i| i as f64 * step).find(|distance| self.is_filled(from + direction * *distance))
    }

    /// Returns true if no filled cell is within `distance` of a point.
    pub(crate) fn is_clear(&self, at: DVec3, distance: f64) -> bool {
        let reach = (distance / self.cell).ceil().min(MAX_CLEARANCE_CELLS) as i32;
        let [x, y, up] = self.axes;
        let offset = |k: i32| f64::from(k) * distance / f64::from(reach.max(1));
        for i in -reach..=reach {
            for j in -reach..=reach {
                for k in -reach..=reach {
                    let by = x * offset(i) + y * offset(j) + up * offset(k);
                    if by.length() <= 1.001 * distance && self.is_filled(at + by) {
                        return false;
                    }
                }
            }
        }
        true
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::place;
    use super::*;
    use wm_scene::{Metadata, Scene, synthetic::Builder};

    #[test]
    fn walls_are_hit_and_air_is_not() {
        let mut lane = Builder::new(1);
        lane.surface(DVec3::new(-30.0, -6.0, 0.0), DVec3::X * 60.0, DVec3::Y * 12.0, 0.3, |_, _| [0.4; 3]);
        for y in [-6.0, 6.0] {
            lane.surface(DVec3::new(-30.0, y, 0.0), DVec3::X * 60.0, DVec3::Z * 9.0, 0.3, |_, _| [0.7; 3]);
        }
        let scene = Scene { splats: lane.build(), ..Scene::default() };
        let lane = OccupancyGrid::of(&scene.splats, &Survey::of(&scene, &Metadata::default()));
        let eye = DVec3::new(-6.0, 0.0, 2.0);
        assert!(lane.is_clear(eye, 1.2) && !lane.is_clear(eye + DVec3::Y * 5.0, 1.2));
        for way in [DVec3::Y, DVec3::NEG_Y] {
            let distance = lane.hit(eye, way, 30.0).unwrap();
            assert!((distance - 6.0).abs() < 2.0 * lane.cell, "{distance}");
        }
        assert!((lane.hit(eye, DVec3::NEG_Z, 30.0).unwrap() - 2.0).abs() < 2.0 * lane.cell);
        assert_eq!(lane.hit(eye, DVec3::Z, 30.0), None);
        assert_eq!(lane.hit(eye, DVec3::NEG_Z, 0.5), None);
        assert!(lane.is_clear(DVec3::splat(1e9), 1.0));
    }

    #[test]
    fn the_ground_is_not_what_stands_on_it() {
        let scene = place("street");
        let street = OccupancyGrid::of(&scene.splats, &Survey::of(&scene, &Metadata::default()));
        // Beside a car, on a car, on the pavement.
        for (at, height) in [([-18.0, 0.0], 0.0), ([-18.0, 3.0], 0.0), ([-10.0, 5.0], 0.1)] {
            let ground = street.ground(DVec3::new(at[0], at[1], 7.0)).unwrap();
            assert!((ground - height).abs() < 0.15, "{at:?}: {ground}");
        }
        assert_eq!(street.ground(DVec3::new(0.0, 28.0, 0.0)), None);
        assert_eq!(street.ground(DVec3::new(0.0, 1e6, 0.0)), None);
    }
}
