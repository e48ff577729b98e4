//! Open water of a scene: pools, ponds, rivers. Nothing lies on it.
//!
//! It is what the scene's metadata outline ([`Metadata::water`](wm_scene::Metadata::water)), or, if
//! they say nothing, a guess: pools are blue, level, and no higher than what is around them. Ponds
//! and rivers have the colours of what they mirror, so that they must be outlined, or have
//! [labels](wm_scene::Metadata::water_labels).

use crate::level::level_matrix;
use crate::optics::Site;
use glam::{DMat3, DVec3};
use std::collections::{BTreeMap, BTreeSet, HashMap};
use wm_scene::{Group, Splats, sh};

const CELL_WIDTH_M: f64 = 0.25;
/// Display-referred excess of blue over red that no paving has, and blue over green.
const BLUE_EXCESSES: [f32; 2] = [0.2, 0.85];
/// Least opacity of a splat that counts.
const MIN_OPACITY: f64 = 0.3;
/// Reach of a splat in geometric means of its two longer standard deviations, and at most, m.
const SPLAT_REACH_SIGMAS: f64 = 1.2;
const MAX_REACH_M: f64 = 2.0;
/// Share of the surface in a pool that must be blue.
const MIN_BLUE_SHARE: f64 = 0.5;
/// Least area of a pool, m^2.
const MIN_POOL_AREA_M2: f64 = 6.0;
/// Largest height, m, between the tenth and the ninetieth percentile of a pool's splats: a training
/// sees through water.
const MAX_HEIGHT_RANGE_M: f64 = 2.0;
/// Gaps in a pool that are closed.
const MAX_GAP_CELLS: i32 = 3;
/// Most cells of a rectangle about a pool in which holes are filled: 250 m by 250 m.
const MOST_ROUND: i64 = 1_000_000;
/// Distance, cells, to which the surroundings reach, and the most by which water stands above them,
/// m.
const SURROUNDINGS_CELLS: i32 = 8;
const MAX_RISE_M: f64 = 0.5;
/// Height above and below water, m, within which a surface is its own.
const SURFACE_HEIGHTS_M: [f64; 2] = [0.4, 2.5];

/// A place in the grid.
type Cell = [i32; 2];

/// Areas of open water.
#[derive(Clone, Debug, PartialEq)]
pub struct OpenWater {
    /// World to level axes, m.
    level: DMat3,
    metres_per_unit: f64,
    /// Stated ones: corners, level axes, m.
    outlines: Vec<Vec<DVec3>>,
    /// Pools that were found: the height of the water in each cell of a level grid, m.
    cells: BTreeMap<Cell, f64>,
}

impl OpenWater {
    /// Finds the open water of a scene: the stated `outlines` (world, scene units), or blue pools
    /// if they are `None`.
    #[must_use]
    pub fn of(splats: &Splats, outlines: Option<&[Vec<[f64; 3]>]>, site: &Site) -> Self {
        let level = level_matrix(site.up) * site.metres_per_unit;
        let corners =
            |outline: &Vec<[f64; 3]>| outline.iter().map(|p| level * DVec3::from_array(*p)).collect();
        let stated = outlines.unwrap_or_default().iter().map(corners).collect();
        let mut water =
            Self { level, metres_per_unit: site.metres_per_unit, outlines: stated, cells: BTreeMap::new() };
        if outlines.is_none() {
            water.add(splats, is_blue, Evidence::Colour);
        }
        water
    }

    /// Adds what has one of these `labels` ([`Splats::labels`]); every piece of it counts as level.
    pub fn add_labelled(&mut self, splats: &Splats, labels: &[u16]) {
        let label_of = |index: usize| splats.labels.get(index).copied().unwrap_or(0);
        if !labels.is_empty() {
            self.add(splats, |_, index| labels.contains(&label_of(index)), Evidence::Label);
        }
    }

    /// Returns true if a point (world, scene units) is at the surface of open water.
    pub(crate) fn covers(&self, point: [f64; 3]) -> bool {
        if self.cells.is_empty() && self.outlines.is_empty() {
            return false;
        }
        let at = self.level * DVec3::from_array(point);
        self.cells.get(&cell_of(at)).is_some_and(|height| is_water_surface(at.z - height))
            || self.outlines.iter().any(|outline| is_inside(outline, at))
    }

    /// The height of open water above a point (world, scene units) that is over or under it, m;
    /// `None` where there is none.
    #[must_use]
    pub fn above(&self, point: [f64; 3]) -> Option<f64> {
        let at = self.level * DVec3::from_array(point);
        let stated =
            || self.outlines.iter().find(|outline| is_within(outline, at)).map(|outline| height_of(outline));
        let height = self.cells.get(&cell_of(at)).copied().or_else(stated)?;
        Some(height - at.z)
    }

    /// Adds pools of the splats that are water.
    fn add(&mut self, splats: &Splats, shows_water: impl Fn(&Splats, usize) -> bool, evidence: Evidence) {
        let mut found: HashMap<Cell, Vec<Patch>> = HashMap::new();
        let mut left = BTreeSet::new();
        for index in (0..splats.len()).filter(|index| splats.groups[*index] == Group::Scene) {
            let opacity = splats.opacity(index);
            if opacity < MIN_OPACITY {
                continue;
            }
            let at = self.level * DVec3::from_array(splats.means[index].map(f64::from));
            let mut scales = splats.log_scales[index].map(|v| f64::from(v).exp() * self.metres_per_unit);
            scales.sort_by(f64::total_cmp);
            let reach = (SPLAT_REACH_SIGMAS * (scales[1] * scales[2]).sqrt()).min(MAX_REACH_M);
            let area = std::f64::consts::PI * reach * reach * opacity;
            let shows_water = shows_water(splats, index);
            let cell = cell_of(at);
            found.entry(cell).or_default().push(Patch { height: at.z, area, is_water: shows_water });
            if shows_water {
                let cells = (reach / CELL_WIDTH_M).floor();
                let is_near = |[x, y]: &Cell| f64::from(x * x + y * y) <= cells * cells;
                let near = square(cells as i32).filter(is_near);
                left.extend(near.map(|[x, y]| [cell[0] + x, cell[1] + y]));
            }
        }
        while let Some(first) = left.pop_first() {
            let mut pool = vec![first];
            let mut next = 0;
            while next < pool.len() {
                let [x, y] = pool[next];
                next += 1;
                for near in square(2).map(|[dx, dy]| [x + dx, y + dy]) {
                    if left.remove(&near) {
                        pool.push(near);
                    }
                }
            }
            if let Some(height) = pool_height(&pool, &found, evidence) {
                let filled = without_holes(closed(&pool));
                self.cells.extend(filled.into_iter().map(|cell| (cell, height)));
            }
        }
    }
}

/// Returns true if a splat has a blue that no paving has.
fn is_blue(splats: &Splats, index: usize) -> bool {
    let [r, g, b] = [0, 1, 2].map(|c| 0.5 + sh::C0 as f32 * splats.sh_of(index)[c]);
    b - r > BLUE_EXCESSES[0] && b > BLUE_EXCESSES[1] * g
}

/// The reason why splats count as water.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Evidence {
    /// A label says so.
    Label,
    /// They are blue: it is a guess, and must look like a pool.
    Colour,
}

/// A splat in a cell.
struct Patch {
    /// m.
    height: f64,
    /// m^2.
    area: f64,
    is_water: bool,
}

fn cell_of(at: DVec3) -> Cell {
    // Cells next to the farthest have numbers too.
    [at.x, at.y].map(|v| (v / CELL_WIDTH_M).floor().clamp(-1e9, 1e9) as i32)
}

/// Returns true if a point is at the water inside of an outline.
fn is_inside(outline: &[DVec3], at: DVec3) -> bool {
    is_water_surface(at.z - height_of(outline)) && is_within(outline, at)
}

/// The height of the water inside of an outline, m.
fn height_of(outline: &[DVec3]) -> f64 {
    outline.iter().map(|corner| corner.z).sum::<f64>() / outline.len() as f64
}

/// Returns true if a point is over or under an outline: a level line from it to one side crosses
/// that an odd number of times.
fn is_within(outline: &[DVec3], at: DVec3) -> bool {
    let edges = outline.iter().zip(outline.iter().cycle().skip(1));
    let crossed = edges.filter(|(a, b)| {
        (a.y > at.y) != (b.y > at.y) && at.x < a.x + (at.y - a.y) / (b.y - a.y) * (b.x - a.x)
    });
    crossed.count() % 2 == 1
}

/// The places in a square about one.
fn square(radius: i32) -> impl Iterator<Item = Cell> {
    (-radius..=radius).flat_map(move |y| (-radius..=radius).map(move |x| [x, y]))
}

/// The height of a pool, m; `None` if what is guessed is no pool: too small, too uneven, too mixed,
/// or raised like a roof.
fn pool_height(pool: &[Cell], found: &HashMap<Cell, Vec<Patch>>, evidence: Evidence) -> Option<f64> {
    let inside = || pool.iter().filter_map(|cell| found.get(cell)).flatten();
    let [low, height] = heights(inside().filter(|patch| patch.is_water), [0.1, 0.9])?;
    if evidence == Evidence::Label {
        return Some(height);
    }
    if (pool.len() as f64) * CELL_WIDTH_M * CELL_WIDTH_M < MIN_POOL_AREA_M2 {
        return None;
    }
    let share = |is_counted: fn(&Patch) -> bool| -> f64 {
        let at_height = |patch: &&Patch| is_water_surface(patch.height - height) && is_counted(patch);
        inside().filter(at_height).map(|patch| patch.area).sum()
    };
    if height - low > MAX_HEIGHT_RANGE_M || share(|patch| patch.is_water) < MIN_BLUE_SHARE * share(|_| true) {
        return None;
    }
    let mut around = widened(pool, SURROUNDINGS_CELLS);
    pool.iter().for_each(|cell| {
        around.remove(cell);
    });
    let outside = around.iter().filter_map(|cell| found.get(cell)).flatten();
    let [ground] = heights(outside, [0.3])?;
    (height < ground + MAX_RISE_M).then_some(height)
}

/// Heights below which such shares of the area lie; `None` where there is no area.
fn heights<'a, const N: usize>(
    patches: impl Iterator<Item = &'a Patch>,
    shares: [f64; N],
) -> Option<[f64; N]> {
    let mut all: Vec<(f64, f64)> = patches.map(|patch| (patch.height, patch.area)).collect();
    all.sort_by(|a, b| a.0.total_cmp(&b.0));
    let total: f64 = all.iter().map(|(_, area)| area).sum();
    let at = |share: f64| {
        let mut below = 0.0;
        all.iter().find(|(_, area)| {
            below += area;
            below >= share * total
        })
    };
    let mut out = [0.0; N];
    for (out, share) in out.iter_mut().zip(shares) {
        *out = at(share)?.0;
    }
    Some(out)
}

/// The cells with those that they enclose, such as what a pool mirrors in another colour.
fn without_holes(mut pool: BTreeSet<Cell>) -> BTreeSet<Cell> {
    let Some([mut low, mut high]) = pool.first().map(|cell| [*cell; 2]) else { return pool };
    for cell in &pool {
        low = [0, 1].map(|k| low[k].min(cell[k]));
        high = [0, 1].map(|k| high[k].max(cell[k]));
    }
    let (wide, tall) = (i64::from(high[0]) - i64::from(low[0]), i64::from(high[1]) - i64::from(low[1]));
    if wide.saturating_mul(tall) > MOST_ROUND {
        return pool;
    }
    let is_round =
        |[x, y]: &Cell| (low[0] - 1..=high[0] + 1).contains(x) && (low[1] - 1..=high[1] + 1).contains(y);
    // All that can be reached from the corner is outside.
    let mut outside = BTreeSet::from([[low[0] - 1, low[1] - 1]]);
    let mut left: Vec<Cell> = outside.iter().copied().collect();
    while let Some([x, y]) = left.pop() {
        for near in [[x + 1, y], [x - 1, y], [x, y + 1], [x, y - 1]] {
            if is_round(&near) && !pool.contains(&near) && outside.insert(near) {
                left.push(near);
            }
        }
    }
    let inside = (low[0]..=high[0]).flat_map(|x| (low[1]..=high[1]).map(move |y| [x, y]));
    pool.extend(inside.filter(|cell| !outside.contains(cell)));
    pool
}

/// The cells with the gaps between them.
fn closed(pool: &[Cell]) -> BTreeSet<Cell> {
    let wide = widened(pool, MAX_GAP_CELLS);
    let is_inside = |[x, y]: &Cell| square(MAX_GAP_CELLS).all(|[dx, dy]| wide.contains(&[x + dx, y + dy]));
    wide.iter().filter(|cell| is_inside(cell)).copied().collect()
}

/// The cells with those in a square about each. Only those at the border have others about them.
fn widened(cells: &[Cell], radius: i32) -> BTreeSet<Cell> {
    let own: BTreeSet<Cell> = cells.iter().copied().collect();
    let about = |[x, y]: Cell, radius: i32| square(radius).map(move |[dx, dy]| [x + dx, y + dy]);
    let border = cells.iter().filter(|cell| !about(**cell, 1).all(|near| own.contains(&near)));
    let around: BTreeSet<Cell> = border.flat_map(|cell| about(*cell, radius)).collect();
    &own | &around
}

/// Returns true if a surface so far above water, m, is the water's own.
fn is_water_surface(above: f64) -> bool {
    (-SURFACE_HEIGHTS_M[1]..SURFACE_HEIGHTS_M[0]).contains(&above)
}

#[cfg(test)]
mod tests {
    use super::*;
    use wm_scene::synthetic::Builder;

    const SITE: Site = Site { metres_per_unit: 0.5, ..Site::PLAIN };
    const POOL_COLOR: [f32; 3] = [0.2, 0.55, 0.8];

    /// A yard of 20 m by 20 m with a square of 8 m by 8 m in a colour at some height, m.
    fn yard(rgb: [f32; 3], height: f64) -> Splats {
        let unit = 1.0 / SITE.metres_per_unit;
        let mut yard = Builder::new(3);
        let square = |yard: &mut Builder, corner: [f64; 2], side: f64, height: f64, rgb| {
            let at = DVec3::new(corner[0], corner[1], height) * unit;
            yard.surface(at, DVec3::X * side * unit, DVec3::Y * side * unit, 0.2 * unit, |_, _| rgb);
        };
        for (x, y) in [(-10.0, -10.0), (-10.0, 4.0), (4.0, -10.0), (4.0, 4.0)] {
            square(&mut yard, [x, y], 6.0, 0.0, [0.6, 0.55, 0.5]);
        }
        for (x, y) in [(-4.0, -12.0), (-4.0, 4.0), (-12.0, -4.0), (4.0, -4.0)] {
            square(&mut yard, [x, y], 8.0, 0.0, [0.6, 0.55, 0.5]);
        }
        square(&mut yard, [-4.0, -4.0], 8.0, height, rgb);
        yard.build()
    }

    #[test]
    fn blue_pools_are_found_and_blue_roofs_and_grey_yards_are_not() {
        let water = |rgb, height| OpenWater::of(&yard(rgb, height), None, &SITE);
        let area = |water: &OpenWater| water.cells.len() as f64 * CELL_WIDTH_M * CELL_WIDTH_M;
        let pool = water(POOL_COLOR, -0.2);
        assert!((50.0..85.0).contains(&area(&pool)), "{}", area(&pool));
        // 1 m in the air belongs to no water, and neither does the deck.
        assert!(
            pool.covers([0.0, 0.0, -0.4]) && !pool.covers([0.0, 0.0, 2.0]) && !pool.covers([12.0, 0.0, 0.0])
        );
        assert_eq!(area(&water(POOL_COLOR, 4.0)), 0.0);
        assert_eq!(area(&water([0.5, 0.55, 0.6], -0.2)), 0.0);
    }

    /// White clouds that a pool mirrors are a part of it.
    #[test]
    fn a_pool_has_no_holes() {
        let mut splats = yard(POOL_COLOR, -0.2);
        let mut more = Builder::new(4);
        let unit = 1.0 / SITE.metres_per_unit;
        more.surface(
            DVec3::new(-1.5, -1.5, -0.19) * unit,
            DVec3::X * 3.0 * unit,
            DVec3::Y * 3.0 * unit,
            0.05 * unit,
            |_, _| [0.95; 3],
        );
        splats.append(&more.build());
        let water = OpenWater::of(&splats, None, &SITE);
        let at = |x: f64, y: f64, z: f64| [x * unit, y * unit, z * unit];
        assert!(water.covers(at(0.0, 0.0, -0.19)) && water.covers(at(3.0, 0.0, -0.2)));
    }

    #[test]
    fn what_has_a_label_of_water_is_water_whatever_its_colour() {
        let mut splats = yard([0.5, 0.55, 0.6], -0.2);
        let is_pond = |mean: &[f32; 3]| {
            mean[..2].iter().all(|v| v.abs() < 8.0) && mean[2] < -0.2 / SITE.metres_per_unit as f32 + 0.1
        };
        splats.labels = splats.means.iter().map(|mean| if is_pond(mean) { 21 } else { 7 }).collect();
        let mut water = OpenWater::of(&splats, None, &SITE);
        water.add_labelled(&splats, &[3]);
        assert!(water.cells.is_empty(), "{} cells without its label", water.cells.len());
        water.add_labelled(&splats, &[3, 21]);
        let area = water.cells.len() as f64 * CELL_WIDTH_M * CELL_WIDTH_M;
        assert!((55.0..80.0).contains(&area), "{area}");
        assert!(
            (water.above([0.0, 0.0, 0.0]).unwrap() + 0.2).abs() < 0.02 && !water.covers([12.0, 0.0, 0.0])
        );
    }

    #[test]
    fn outlines_are_filled_and_replace_the_guess() {
        let splats = yard(POOL_COLOR, 0.0);
        let corner = |x: f64, y: f64| [x / SITE.metres_per_unit, y / SITE.metres_per_unit, 0.0];
        // An L of 30 m^2.
        let outline = [(0.0, 0.0), (6.0, 0.0), (6.0, 3.0), (4.0, 3.0), (4.0, 6.0), (0.0, 6.0)];
        let outline: Vec<[f64; 3]> = outline.iter().map(|(x, y)| corner(*x, *y)).collect();
        let water = OpenWater::of(&splats, Some(&[outline]), &SITE);
        let inside = (0..14 * 14).filter(|k| {
            let [x, y] = [k % 14, k / 14].map(|v| f64::from(v) - 3.5);
            water.covers(corner(x, y))
        });
        assert_eq!(inside.count(), 30);
        assert!(water.covers(corner(1.0, 5.0)) && !water.covers(corner(5.0, 5.0)));
        let [x, y, _] = corner(1.0, 5.0);
        assert!((water.above([x, y, -1.0]).unwrap() - SITE.metres_per_unit).abs() < 1e-9);
        assert_eq!(water.above(corner(5.0, 5.0)), None);
        assert!(!OpenWater::of(&splats, Some(&[]), &SITE).covers(corner(1.0, 1.0)));
        // Of any size.
        let far = vec![[-1e300, -1e300, 0.0], [1e300, -1e300, 0.0], [0.0, 1e300, 0.0]];
        assert!(OpenWater::of(&splats, Some(&[far]), &SITE).covers(corner(1.0, 1.0)));
    }
}
