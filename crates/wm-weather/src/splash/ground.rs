//! The ground and the water that drops hit.

use crate::level::{level_axes, to_level};
use crate::optics::Site;
use crate::shelter::Shelter;
use crate::water::ripples::SIZE;
use crate::wetness::{Drainage, Eave, GroundMap, WetShares, WetState, WetSurfaces};

/// Height of splashes over the ground: splats of the ground lie some centimetres higher or
/// lower. The surface of puddles is drawn as much higher.
const SPLASH_LIFT_M: f64 = 0.04;
/// Depth of a flood and of open water, as drops feel it, m.
const OPEN_WATER_DEPTH_M: f64 = 1.0;
/// Share of the texture's depth that a film has for drops where it does not fill the texture.
const IN_TEXTURE: f64 = 0.3;
/// Steps of the share of the rain.
const RAIN_SHARE_COUNT: usize = 33;
/// Most tiles of a ground.
const MOST_TILES: usize = 1 << 24;
/// The heights of a tile without ground.
const NO_HEIGHTS: [f32; 2] = [f32::INFINITY, f32::NEG_INFINITY];

/// The heights of the ground on each tile of the drops, lowest and highest, m.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SplashTiles {
    /// The first tile.
    first: [i64; 2],
    columns: usize,
    heights: Vec<[f32; 2]>,
}

impl SplashTiles {
    /// Builds the tiles for the ground of some surfaces.
    #[must_use]
    pub fn of(surfaces: &WetSurfaces, site: &Site) -> Self {
        let ground = surfaces.ground();
        let ([columns, rows], cell, origin) =
            (ground.places.size(), ground.places.cell(), origin_of(ground, site));
        let tile = |k: usize, cells: usize| {
            ((origin[k] + cells as f64 * cell) / SIZE).floor().clamp(-1e15, 1e15) as i64
        };
        let first = [tile(0, 0), tile(1, 0)];
        let [width, height] =
            [tile(0, columns) - first[0] + 1, tile(1, rows) - first[1] + 1].map(|v| v as usize);
        // Ground of a scale that cannot be: its splashes are too small to be seen.
        if width.saturating_mul(height) > MOST_TILES {
            return Self { first, columns: 0, heights: Vec::new() };
        }
        let mut heights = vec![NO_HEIGHTS; width * height];
        let heights_of = ground.rough.iter().enumerate().map(|(at, rough)| ground.surface(at, *rough));
        for (at, rough) in heights_of.enumerate().filter(|(_, height)| height.is_finite()) {
            let (column, row) = (at % columns, at / columns);
            let [x, y] = [(0, column), (1, row)].map(|(k, index)| (tile(k, index) - first[k]) as usize);
            let own = origin[2] as f32 + rough + ground.tilt_at(at);
            let [low, high] = &mut heights[y * width + x];
            (*low, *high) = (low.min(own), high.max(own));
        }
        Self { first, columns: width, heights }
    }

    fn at(&self, cell: [i64; 2]) -> Option<[f64; 2]> {
        let [x, y] = cell;
        let (x, y) = (x - self.first[0], y - self.first[1]);
        if x < 0 || y < 0 || x >= self.columns as i64 {
            return None;
        }
        let found = self.heights.get(y as usize * self.columns + x as usize)?;
        (found[0] <= found[1]).then(|| found.map(f64::from))
    }
}

/// The first corner of a ground at height 0, m along the level axes from the world's origin.
fn origin_of(ground: &GroundMap, site: &Site) -> [f64; 3] {
    to_level(&level_axes(site.up), ground.point([0.0; 2], 0.0)).map(|v| v * site.metres_per_unit)
}

/// Wet ground.
#[derive(Clone, Debug)]
pub struct SplashGround<'a> {
    ground: &'a GroundMap,
    shares: &'a [f32],
    levels: &'a [f32],
    tiles: &'a SplashTiles,
    origin: [f64; 3],
    per_cell: f64,
    /// Water that falls from eaves, m/s: times the area that they shed.
    sheds: f64,
    /// Wet share of the ground, 0-1, and film, m, by the share of the rain.
    films: [[f32; 2]; RAIN_SHARE_COUNT],
}

/// The ground or the water at a place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct SplashPlace {
    /// Height, m along up from the world's origin, of what splashes rise from.
    pub(crate) height: f64,
    /// Depth of the water, m.
    pub(crate) film: f64,
    /// Share of the drops that come there and find it wet, 0-1.
    pub(crate) share: f32,
}

impl<'a> SplashGround<'a> {
    /// The ground of `surfaces` in a state of water; `texture` is the mean depth of its texture,
    /// mm, and `eaves` the share of the water of roofs that falls from them.
    #[must_use]
    pub fn new(
        surfaces: &'a WetSurfaces,
        shares: &'a WetShares,
        state: &'a WetState,
        texture: f64,
        eaves: f64,
        tiles: &'a SplashTiles,
        site: &Site,
    ) -> Self {
        let ground = surfaces.ground();
        let films = std::array::from_fn(|step| {
            let wet = state.wet(Drainage::Level, step as f64 / (RAIN_SHARE_COUNT - 1) as f64);
            let film = f64::from(wet.depth) + IN_TEXTURE * texture * f64::from(wet.film);
            [wet.pores, (1e-3 * film) as f32]
        });
        let (origin, per_cell) = (origin_of(ground, site), 1.0 / ground.places.cell());
        let sheds = 1e-3 / 3600.0 * eaves * state.runs_off();
        Self { ground, shares: &shares.ground, levels: &state.levels, tiles, origin, per_cell, sheds, films }
    }

    /// The eaves from which water falls, with their numbers and the water that falls from each,
    /// m^3/s; none if none falls.
    pub(super) fn eaves(&self) -> impl Iterator<Item = (usize, &Eave, f64)> {
        let all = if self.sheds > 0.0 { &self.ground.eaves[..] } else { &[] };
        all.iter().enumerate().map(|(number, eave)| (number, eave, f64::from(eave.area) * self.sheds))
    }

    /// The place on which the water of an eave falls, and the width of a cell: m along the level
    /// axes and up from the world's origin.
    pub(super) fn under(&self, eave: &Eave) -> ([f64; 3], f64) {
        let cell = 1.0 / self.per_cell;
        let [x, y] = eave.place.map(f64::from);
        let [columns, _] = self.ground.places.size();
        let tilt = self.ground.tilt_at(y as usize * columns + x as usize);
        let height = self.origin[2] + f64::from(eave.ground + tilt) + SPLASH_LIFT_M;
        ([self.origin[0] + x * cell, self.origin[1] + y * cell, height], cell)
    }

    /// Returns the ground or puddle at a place, m along the level axes; `None` where there is no
    /// ground.
    fn at(&self, x: f64, y: f64) -> Option<SplashPlace> {
        let [columns, rows] = self.ground.places.size();
        let (u, v) = ((x - self.origin[0]) * self.per_cell, (y - self.origin[1]) * self.per_cell);
        if !(u >= 0.0 && v >= 0.0 && u < columns as f64 && v < rows as f64) {
            return None;
        }
        let at = v as usize * columns + u as usize;
        let (rough, pool) = (self.ground.rough[at], self.ground.open[at]);
        let surface = self.ground.surface(at, rough);
        if surface.is_nan() {
            return None;
        }
        let open = self.shares[at].clamp(0.0, 1.0);
        if pool.is_finite() {
            let height = self.origin[2] + f64::from(surface + self.ground.tilt_at(at)) + SPLASH_LIFT_M;
            return Some(SplashPlace { height, film: OPEN_WATER_DEPTH_M, share: open });
        }
        let [wet, film] = self.films[(open * (RAIN_SHARE_COUNT - 1) as f32).round() as usize];
        let level = self.levels.get(self.ground.basins.of[at] as usize).copied().unwrap_or(f32::NEG_INFINITY);
        let stands = (level - rough).max(0.0);
        let (film, wet) = if stands > film { (stands, 1.0) } else { (film, wet) };
        let height = self.origin[2] + f64::from(rough + stands + self.ground.tilt_at(at)) + SPLASH_LIFT_M;
        Some(SplashPlace { height, film: f64::from(film), share: open * wet })
    }
}

/// All that drops hit: wet ground, and water at one level.
#[derive(Clone, Copy, Debug)]
pub(super) struct Floor<'a> {
    /// Wet ground.
    pub(crate) ground: Option<&'a SplashGround<'a>>,
    /// Height of the water, m along up from the world's origin.
    pub(crate) plane: Option<f64>,
    /// The map of sheltered places, for the water at one level.
    pub(crate) shelter: Option<&'a Shelter>,
    /// Level axes in world axes, scene units of a metre.
    pub(crate) units: [[f64; 3]; 3],
}

impl Floor<'_> {
    /// Returns the ground or water at a place, m along the level axes; `None` where there is
    /// neither.
    pub(crate) fn at(&self, x: f64, y: f64) -> Option<SplashPlace> {
        let own = self.ground.and_then(|ground| ground.at(x, y));
        let Some(plane) = self.plane.filter(|plane| own.is_none_or(|own| own.height < *plane)) else {
            return own;
        };
        let world = |k: usize| {
            x * self.units[0][k] + y * self.units[1][k] + (plane + SPLASH_LIFT_M) * self.units[2][k]
        };
        let point = [world(0) as f32, world(1) as f32, world(2) as f32];
        let is_open = self.shelter.is_none_or(|shelter| shelter.is_exposed(point));
        Some(SplashPlace { height: plane, film: OPEN_WATER_DEPTH_M, share: if is_open { 1.0 } else { 0.0 } })
    }

    /// The heights on a tile, lowest and highest, m; `None` where there is nothing.
    pub(crate) fn heights(&self, tile: [i64; 2]) -> Option<[f64; 2]> {
        // Puddles stand no more than this above the ground.
        const MAX_PUDDLE_HEIGHT_M: f64 = 0.3;
        let own = self.ground.and_then(|ground| ground.tiles.at(tile));
        let own = own.map(|[low, high]| [low + SPLASH_LIFT_M, high + SPLASH_LIFT_M + MAX_PUDDLE_HEIGHT_M]);
        match (own, self.plane) {
            (Some([low, high]), Some(plane)) => Some([low.min(plane), high.max(plane)]),
            (own, plane) => own.or(plane.map(|plane| [plane; 2])),
        }
    }
}
