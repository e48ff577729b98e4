//! The moving surface at one instant.

use super::map::WaterGrid;
use super::ripples;
use super::tile::{Slope, SlopeTile};
use super::waves::WindWaves;
use std::sync::Arc;

/// Slopes that still water has, variance along one axis: it is never perfectly still.
const STILL: f32 = 1.6e-5;

/// The slopes of water at one instant: a pure function of place and time.
#[derive(Clone, Debug, Default)]
pub struct WaterMotion {
    tiles: Vec<SlopeTile>,
    /// Variance of slopes along one axis that no tile holds.
    beyond: f32,
    /// The water whose streams run, and the time, s.
    running: Option<(Arc<WaterGrid>, f64)>,
}

/// Wind and rain that move the water.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct WaterForces {
    /// Mean wind, m/s along the two level axes.
    pub wind: [f64; 2],
    /// The strongest wind of the shot, m/s.
    pub strongest: f64,
    /// Length of water that the wind blows over, m.
    pub fetch: f64,
    /// Rain, mm/h.
    pub rain: f64,
    /// Depth of the water, m: shallow water stays smoother.
    pub depth: f64,
    /// Seconds.
    pub time: f64,
    /// Seed of the random waves.
    pub seed: u64,
}

impl WaterMotion {
    /// The motion of water under these forces.
    #[must_use]
    pub fn new(forces: &WaterForces) -> Self {
        let mut motion = Self { tiles: Vec::new(), beyond: STILL, running: None };
        if let Some(waves) = WindWaves::new(forces.wind, forces.fetch, forces.strongest) {
            motion.tiles.push(waves.slopes(forces.time, forces.seed ^ 0x5741_5645));
            motion.beyond += waves.beyond_tile();
        }
        let rms = ripples::slope_rms(forces.rain, forces.depth);
        if rms > 0.0 {
            motion.tiles.push(ripples::slopes(forces.rain, rms, forces.time, forces.seed ^ ripples::FIELD));
        }
        motion
    }

    /// The same with the streams of a water at a time, s.
    #[must_use]
    pub fn with_rills(self, grid: Option<&Arc<WaterGrid>>, time: f64) -> Self {
        let running = grid.filter(|grid| grid.rills.is_some()).map(|grid| (Arc::clone(grid), time));
        Self { running, ..self }
    }

    /// The slope of a piece of the surface `width` metres wide about a point, metres along the two level axes.
    #[inline(always)]
    #[must_use]
    pub fn at(&self, x: f64, y: f64, width: f32) -> Slope {
        let mut sum = Slope { mean: [0.0; 2], variance: self.beyond };
        for tile in &self.tiles {
            let own = tile.at(x, y, width);
            sum.mean = [sum.mean[0] + own.mean[0], sum.mean[1] + own.mean[1]];
            sum.variance += own.variance;
        }
        if let Some((grid, time)) = &self.running
            && let Some(rills) = &grid.rills
        {
            let nodes = (grid.origin, grid.step, [grid.width, grid.height]);
            rills.add(nodes, [x, y], width, *time, &mut sum);
        }
        sum
    }
}
