//! The moving surface at one instant.

use super::foam::Foam;
use super::map::WaterGrid;
use super::rills::Slope;
use super::ripples;
use super::tile::SlopeTile;
use super::waves::WindWaves;
use std::sync::Arc;
use wm_render::simd::Lanes;

/// Slopes that still water has, variance along one axis: it is never perfectly still.
const STILL_SLOPE_VARIANCE: f32 = 1.6e-5;
/// Slopes of rough water, variance along one axis: what it mirrors is moved by 7 degrees.
const MIN_ROUGH_SLOPE_VARIANCE: f64 = 0.004;

/// The slopes of water at one instant: a pure function of place and time.
#[derive(Clone, Debug, Default)]
pub struct WaterMotion {
    tiles: Vec<SlopeTile>,
    /// Variance of slopes along one axis that no tile holds.
    beyond: f32,
    /// The water whose streams run, and the time, s.
    pub(super) running: Option<(Arc<WaterGrid>, f64)>,
    /// True if the strongest wind of the shot makes the water so rough that what it mirrors is seen
    /// in pieces: alike for a whole shot, so that nothing changes at once when the wind rises.
    pub is_rough: bool,
    /// The foam of the wind.
    pub(crate) foam: Option<Foam>,
}

/// Wind and rain that move the water.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct WaterForces {
    /// Mean wind, m/s along the two level axes.
    pub(crate) wind: [f64; 2],
    /// The strongest wind of the shot, m/s.
    pub(crate) strongest: f64,
    /// Length of water that the wind blows over, m.
    pub(crate) fetch: f64,
    /// Rain, mm/h.
    pub(crate) rain: f64,
    /// Depth of the water, m: shallow water stays smoother.
    pub(crate) depth: f64,
    /// Seconds.
    pub(crate) time: f64,
    /// Seed of the random waves.
    pub(crate) seed: u64,
}

impl WaterMotion {
    /// The motion of water under these forces, with the streams of a grid.
    pub(crate) fn new(forces: &WaterForces, grid: Option<&Arc<WaterGrid>>) -> Self {
        let strongest = forces.wind[0].hypot(forces.wind[1]).max(forces.strongest);
        let roughest = WindWaves::new([strongest, 0.0], forces.fetch, strongest);
        let is_rough = roughest.is_some_and(|waves| waves.slope_variance() >= MIN_ROUGH_SLOPE_VARIANCE);
        let running = grid.filter(|grid| grid.rills.is_some()).map(|grid| (Arc::clone(grid), forces.time));
        let mut motion =
            Self { tiles: Vec::new(), beyond: STILL_SLOPE_VARIANCE, running, is_rough, foam: None };
        let rms = ripples::slope_rms(forces.rain, forces.depth);
        if let Some(waves) = WindWaves::new(forces.wind, forces.fetch, forces.strongest) {
            motion.tiles.push(waves.slopes(forces.time, forces.seed ^ 0x5741_5645));
            motion.beyond += waves.beyond_tile();
            motion.foam = Foam::new(&waves, forces.wind[0].hypot(forces.wind[1]), rms * rms);
        }
        if rms > 0.0 {
            motion.tiles.push(ripples::slopes(
                forces.rain,
                rms,
                forces.time,
                forces.seed ^ ripples::FIELD_SEED,
            ));
        }
        motion
    }

    /// Adds the slopes of streams at a place, metres along the two level axes, of a piece `width`
    /// metres wide.
    #[inline]
    pub(super) fn add_rills(&self, place: [f64; 2], width: f32, sum: &mut Slope) {
        if let Some((grid, time)) = &self.running
            && let Some((rills, nodes)) = grid.rills()
        {
            rills.add(nodes, place, width, *time, sum);
        }
    }

    /// The places of a point on the tiles, metres along the two level axes: shares of each tile,
    /// 0-1.
    pub(crate) fn phases(&self, point: [f64; 2]) -> Vec<[f32; 2]> {
        self.tiles.iter().map(|tile| point.map(|along| tile.phase(along))).collect()
    }

    /// The slopes of pieces of the surface, by the logarithms to base 2 of their widths, m: at
    /// `points`, metres along the two level axes from the point of `phases`. Lanes without a bit in
    /// `wanted` have none. Returns the two mean slopes, and their variance within the piece along
    /// one axis.
    #[inline(always)]
    pub(crate) fn at<S: Lanes>(
        &self,
        simd: S,
        points: [S::F; 2],
        phases: &[[f32; 2]],
        log_width: S::F,
        wanted: u32,
    ) -> [S::F; 3] {
        let mut sum = [simd.set(0.0), simd.set(0.0), simd.set(self.beyond)];
        for (tile, phase) in self.tiles.iter().zip(phases) {
            let own = tile.at(simd, points, *phase, log_width, wanted);
            for k in 0..3 {
                sum[k] += own[k];
            }
        }
        sum
    }
}
