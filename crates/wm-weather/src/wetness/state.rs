//! The water of a place at one instant.

use super::basins::{NO_BASIN, neighbours};
use super::column::{self, Drainage, PORE_CAPACITY_MM, RAIN_SHARE_COUNT, Wet, WetColumns};
use super::relief;
use super::request::WetRequest;
use super::run_off::RunOff;
use super::surfaces::{WetShares, WetSurfaces};

/// The areas that drain into each basin, m^2, by the share of the rain that they get.
#[derive(Clone, Debug, PartialEq)]
pub struct Catchments {
    /// For each basin.
    areas: Vec<[f64; RAIN_SHARE_COUNT]>,
    /// The area of the ground whose water leaves.
    leaves: [f64; RAIN_SHARE_COUNT],
}

impl Catchments {
    /// Finds them for a ground that gets these shares of the rain.
    #[must_use]
    pub fn of(surfaces: &WetSurfaces, shares: &WetShares) -> Self {
        let ground = surfaces.ground();
        let area = ground.places.cell() * ground.places.cell();
        let mut made = Self {
            areas: vec![[0.0; RAIN_SHARE_COUNT]; ground.basins.all.len()],
            leaves: [0.0; RAIN_SHARE_COUNT],
        };
        for (at, drain) in ground.basins.drain.iter().enumerate() {
            if ground.ground[at].is_nan() {
                continue;
            }
            let areas = made.areas.get_mut(*drain as usize).unwrap_or(&mut made.leaves);
            let step = column::step_of(f64::from(shares.ground[at]));
            let low = (step as usize).min(RAIN_SHARE_COUNT - 2);
            areas[low] += area * (1.0 - (step - low as f64));
            areas[low + 1] += area * (step - low as f64);
        }
        made
    }
}

/// Water in and out of the ground of a place until an instant, m^3.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct WaterBudget {
    /// Came down.
    pub came: f64,
    /// Is in pores, and in and above the texture.
    pub(crate) on_ground: f64,
    /// Stands in puddles.
    pub in_puddles: f64,
    /// Ran away.
    pub left: f64,
    /// Dried.
    pub dried: f64,
}

/// Wetness by the share of the rain, and the levels of puddles.
#[derive(Clone, Debug, PartialEq)]
pub struct WetState {
    columns: WetColumns,
    amount: Option<f64>,
    texture: f64,
    pub(crate) levels: Vec<f32>,
    budget: WaterBudget,
}

impl WetState {
    /// The state that a request asks for.
    #[must_use]
    pub fn of(request: &WetRequest, surfaces: &WetSurfaces, catchments: &Catchments) -> Self {
        let basins = &surfaces.ground().basins;
        let mut columns = WetColumns::dry(request.texture);
        let mut volumes = vec![0.0; basins.all.len()];
        let mut came = vec![0.0; volumes.len()];
        let mut budget = WaterBudget::default();
        for step in &request.steps {
            let runs = columns.pass(step);
            let water = |areas: &[f64; RAIN_SHARE_COUNT]| {
                areas.iter().zip(&runs).map(|(area, runs)| 1e-3 * area * runs).sum()
            };
            came.iter_mut().zip(&catchments.areas).for_each(|(came, areas)| *came = water(areas));
            let [left, dried] = basins.pass(&mut volumes, &came, 1e-3 * step.dries * step.snow.open);
            let away: f64 = water(&catchments.leaves);
            budget.left += left + away;
            budget.dried += dried;
        }
        for areas in catchments.areas.iter().chain([&catchments.leaves]) {
            for (k, area) in areas.iter().enumerate() {
                let column = columns.column(Drainage::Level, column::share_of(k as f64));
                budget.came += 1e-3 * area * column.came;
                budget.on_ground += 1e-3 * area * (column.pores + column.store);
                budget.dried += 1e-3 * area * column.dried;
            }
        }
        let given = request.puddles.or(request.amount.map(|amount| (2.0 * amount - 1.0).max(0.0)));
        if let Some(share) = given {
            volumes
                .iter_mut()
                .zip(&basins.all)
                .for_each(|(volume, basin)| *volume = share * basin.capacity());
        }
        budget.in_puddles = volumes.iter().sum();
        let levels = basins.all.iter().zip(&volumes).map(|(basin, volume)| match *volume > 0.0 {
            true => basin.level(*volume).0,
            false => f32::NEG_INFINITY,
        });
        let levels = levels.collect();
        Self { columns, amount: request.amount, texture: request.texture, levels, budget }
    }

    /// The wetness of surfaces that get a share of the rain.
    pub(crate) fn wet(&self, kind: Drainage, share: f64) -> Wet {
        let Some(amount) = self.amount else { return self.columns.wet(kind, share) };
        // What gets half of the rain is as wet as is requested.
        let reached = (2.0 * share).min(1.0);
        let (pores, film) = ((2.0 * amount).min(1.0), (2.0 * amount - 1.0).max(0.0));
        Wet { pores: (reached * pores) as f32, film: (reached * film) as f32, depth: 0.0 }
    }

    /// Returns true if the wetness was asked for by hand: then hollows are no wetter than bumps.
    pub(crate) fn is_even(&self) -> bool {
        self.amount.is_some()
    }

    /// Water that runs off of ground that gets all of the rain, mm/h; 0 for a wetness by hand.
    pub(crate) fn runs_off(&self) -> f64 {
        if self.amount.is_some() { 0.0 } else { self.columns.runs_off(Drainage::Level, 1.0) }
    }
}

/// Water on the ground of a place, on a level grid, `[height, width]` each.
#[derive(Clone, Debug, PartialEq)]
pub struct WaterState {
    /// The point (world, scene units) at the first corner of the grid, at height 0.
    pub(crate) origin: [f64; 3],
    /// The world axes of columns, of rows, and up, length 1.
    pub(crate) axes: [[f64; 3]; 3],
    /// Width of a cell, m.
    pub step: f64,
    /// Number of columns.
    pub(crate) width: usize,
    /// Number of rows.
    pub(crate) height: usize,
    /// Heights of the ground above `origin`, m; NaN where there is none.
    pub ground: Vec<f32>,
    /// Level of the water that stands there, m; NaN without water.
    pub level: Vec<f32>,
    /// Depth of water above the texture of the ground that drains, mm.
    pub(crate) film: Vec<f32>,
    /// Share of the texture that is under water, 0-1.
    pub(crate) filled: Vec<f32>,
    /// Filled share of the pores, 0-1.
    pub(crate) pores: Vec<f32>,
    /// Depth of water that runs together on slopes, over the texture, mm; it is on its way, and no
    /// part of the films.
    pub(crate) running: Vec<f32>,
    /// Height of open water, such as a pool, m; not a number where there is none. It is no part of
    /// the budget.
    pub(crate) open: Vec<f32>,
    /// Share of what is about each node that the capture shows, 0-1: water is drawn as much.
    pub(crate) seen: Vec<f32>,
    /// Share of each cell that is lawn or soil, 0-1, which does not shine when it is wet.
    pub(crate) matte: Vec<f32>,
    /// Rain that came, and where it went.
    pub budget: WaterBudget,
}

/// Moves the water of nodes from bumps into hollows; the sums over the place stay. `rough` is
/// `ground` with its relief, m.
fn move_into_hollows(wet: &mut [Wet], ground: &[f32], rough: &[f32]) {
    let [pores_before, film_before] = sums(wet);
    for (wet, (height, rough)) in wet.iter_mut().zip(ground.iter().zip(rough)) {
        if height.is_finite() {
            let lower = relief::lower_share(f64::from(rough - height));
            [wet.pores, wet.film] = relief::patchy([wet.pores, wet.film], lower);
        }
    }
    // Hollows and bumps of a small place, or one with unequal rain, do not quite balance.
    let count = ground.iter().filter(|height| height.is_finite()).count() as f64;
    let [pores_now, film_now] = sums(wet);
    for (wet, height) in wet.iter_mut().zip(ground) {
        if height.is_finite() {
            wet.pores = balanced(wet.pores, pores_now, pores_before, count);
            wet.film = balanced(wet.film, film_now, film_before, count);
        }
    }
}

/// Sums of the filled shares of pores and of the texture.
fn sums(wet: &[Wet]) -> [f64; 2] {
    let sum = |share: fn(&Wet) -> f32| wet.iter().map(|wet| f64::from(share(wet))).sum();
    [sum(|wet| wet.pores), sum(|wet| wet.film)]
}

/// A share of a node, 0-1, changed so that `count` nodes whose shares have the sum `now` get the
/// sum `wanted`.
fn balanced(share: f32, now: f64, wanted: f64, count: f64) -> f32 {
    let share = f64::from(share);
    let made = if now > wanted {
        share * wanted / now
    } else if now < wanted {
        1.0 - (1.0 - share) * (count - wanted) / (count - now)
    } else {
        share
    };
    made.clamp(0.0, 1.0) as f32
}

impl WaterState {
    /// The water of a place. Levels go on for a cell about each puddle, below its ground, so that
    /// edges can be found between nodes.
    #[must_use]
    pub fn of(surfaces: &WetSurfaces, shares: &WetShares, run_off: &RunOff, state: &WetState) -> Self {
        let ground = surfaces.ground();
        let [width, height] = ground.places.size();
        let wet = shares.ground.iter().map(|share| state.wet(Drainage::Level, f64::from(*share)));
        let of = &ground.basins.of;
        let level = (0..of.len()).map(|at| {
            let about = || neighbours(at, width, of.len()).map(|next| of[next]);
            let basin = Some(of[at])
                .filter(|basin| *basin != NO_BASIN)
                .or_else(|| about().find(|basin| *basin != NO_BASIN));
            let level = basin.map(|basin| state.levels[basin as usize]).filter(|level| level.is_finite());
            level.filter(|_| ground.ground[at].is_finite()).unwrap_or(f32::NAN)
        });
        // Pores, texture and depth at each node.
        let on_ground = wet.zip(&ground.ground);
        let mut wet: Vec<Wet> =
            on_ground.map(|(wet, height)| if height.is_nan() { Wet::default() } else { wet }).collect();
        if !state.is_even() {
            move_into_hollows(&mut wet, &ground.ground, &ground.rough);
        }
        Self {
            origin: ground.point([0.0; 2], 0.0),
            axes: ground.places.axes(),
            step: ground.places.cell(),
            width,
            height,
            level: level.enumerate().map(|(at, level)| level + ground.tilt_at(at)).collect(),
            ground: ground.rough.iter().enumerate().map(|(at, height)| height + ground.tilt_at(at)).collect(),
            film: wet.iter().map(|wet| wet.depth).collect(),
            filled: wet.iter().map(|wet| wet.film).collect(),
            pores: wet.iter().map(|wet| wet.pores).collect(),
            running: run_off.depths(state.runs_off()),
            open: ground.open.iter().enumerate().map(|(at, level)| level + ground.tilt_at(at)).collect(),
            seen: ground.seen.clone(),
            matte: ground.matte.clone(),
            budget: state.budget,
        }
    }

    /// Water in pores, m^3.
    #[must_use]
    pub fn water_in_pores(&self) -> f64 {
        1e-3 * PORE_CAPACITY_MM
            * self.step
            * self.step
            * self.pores.iter().map(|share| f64::from(*share)).sum::<f64>()
    }

    /// Water in and above the texture of ground that drains, of a mean depth of `texture` mm, m^3.
    #[must_use]
    pub fn water_in_films(&self, texture: f64) -> f64 {
        let depths = self.film.iter().zip(&self.filled);
        let depths = depths.map(|(film, filled)| f64::from(*film) + texture * f64::from(*filled));
        1e-3 * self.step * self.step * depths.sum::<f64>()
    }

    /// Water that stands, m^3.
    #[must_use]
    pub fn water_in_puddles(&self) -> f64 {
        let depths = self.level.iter().zip(&self.ground).filter(|(level, _)| level.is_finite());
        let depths = depths.map(|(level, ground)| f64::from((level - ground).max(0.0)));
        self.step * self.step * depths.sum::<f64>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn hollows_and_bumps_hold_the_water_of_the_place(
            pores in 0.0f32..=1.0, film in 0.0f32..=1.0, side in 2u16..40, unequal in 0.0f32..1.0,
        ) {
            let place = |at: usize| [at % usize::from(side), at / usize::from(side)].map(|k| 0.1 * k as f64);
            let count = usize::from(side).pow(2);
            let ground: Vec<f32> = (0..count).map(|at| if at % 7 == 3 { f32::NAN } else { 0.0 }).collect();
            let height = |at: usize| relief(place(at)[0], place(at)[1]) as f32;
            let rough: Vec<f32> = (0..count).map(height).collect();
            let wet = |at: usize| {
                let share = 1.0 - unequal * (at as f32 / count as f32);
                match ground[at].is_nan() {
                    true => Wet::default(),
                    false => Wet { pores: share * pores, film: share * film, depth: 0.0 },
                }
            };
            let mut patches: Vec<Wet> = (0..count).map(wet).collect();
            let before = sums(&patches);
            move_into_hollows(&mut patches, &ground, &rough);
            let after = sums(&patches);
            for kind in 0..2 {
                let off = (after[kind] - before[kind]).abs();
                prop_assert!(off < 1e-5 * count as f64, "{before:?} {after:?}");
            }
            let is_share = |share: f32| (0.0..=1.0).contains(&share);
            prop_assert!(patches.iter().all(|wet| is_share(wet.pores) && is_share(wet.film)));
        }
    }
}
