//! Adaptive density control as published (Kerbl et al. 2023).
//!
//! Splats whose mean screen-space gradient, over the steps that saw them, is above a threshold mark
//! places with too little detail: a small splat is cloned, a large one is split in two, sampled
//! from itself and smaller by 1.6. Transparent splats are removed, later also huge ones, in the
//! image or in space. Opacities are reset now and then, so that only splats that are needed
//! recover.
//!
//! Departure: a hard limit on the number of splats; those with the largest gradients come first.

use super::population::Population;
use super::strategy::{DensifyStrategy, DensifyTime};
use crate::check::{COUNT_RANGE, ConfigValue, WEIGHT_RANGE};
use crate::random::Random;
use serde::{Deserialize, Serialize};
use wm_render::training::DensifyStats;
use wm_scene::quat;
use wm_scene::splats::logit;

/// Parts into which a splat is split.
const SPLIT_PARTS: u64 = 2;
/// Divisor of the scales of the parts.
const SPLIT_SCALE_DIVISOR: f64 = 1.6;

/// Constants of adaptive control; lengths in units of the scene's extent.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AdaptiveConfig {
    /// First step that changes splats.
    pub from: u32,
    /// First step without changes again.
    pub until: u32,
    /// Steps between changes.
    pub every: u32,
    /// Mean screen-space gradient above which splats are added, in units of half an image.
    pub pull: f64,
    /// Largest standard deviation of splats that are cloned and not split.
    pub small: f64,
    /// Opacity below which a splat is removed.
    pub faint: f64,
    /// Steps between resets of opacities; after the first one huge splats are removed.
    pub reset_every: u32,
    /// Radius above which a splat is huge, px.
    pub huge_radius: f64,
    /// Standard deviation above which a splat is huge.
    pub huge: f64,
    /// Most splats.
    pub max_splats: usize,
}

impl AdaptiveConfig {
    /// The published constants, for a training of 30,000 steps, in proportion for others.
    #[must_use]
    pub fn for_steps(steps: u32, max_splats: usize) -> Self {
        let share = |of: u32| (u64::from(steps) * u64::from(of) / 30_000) as u32;
        Self {
            from: share(500).max(100),
            until: share(15_000),
            every: 100,
            pull: 2e-4,
            small: 0.01,
            faint: 0.005,
            reset_every: share(3_000).max(500),
            huge_radius: 20.0,
            huge: 0.1,
            max_splats,
        }
    }

    fn densify(&self, step: u32, population: &mut Population, extent: f64, random: Random) {
        let count = population.len();
        let pulls = &population.pulls;
        let pull = |i: usize| f64::from(pulls.sums[i]) / f64::from(pulls.counts[i]).max(1.0);
        let mut wanted: Vec<usize> = (0..count).filter(|i| pull(*i) > self.pull).collect();
        let room = self.max_splats.saturating_sub(count);
        if wanted.len() > room {
            wanted.sort_by(|a, b| pull(*b).total_cmp(&pull(*a)).then(a.cmp(b)));
            wanted.truncate(room);
            wanted.sort_unstable();
        }
        let largest = |i: usize| population.splats.scales(i).into_iter().fold(0.0, f64::max);
        let is_small: Vec<bool> = wanted.iter().map(|i| largest(*i) <= self.small * extent).collect();
        let mut gone = vec![false; count];
        let may_be_huge = step > self.reset_every;
        for (i, gone) in gone.iter_mut().enumerate() {
            let huge = f64::from(pulls.radii[i]) > self.huge_radius || largest(i) > self.huge * extent;
            *gone = population.splats.opacity(i) < self.faint || (may_be_huge && huge);
        }
        // A clone is a copy; both parts of a split splat are sampled from it.
        population.copy(&wanted);
        for (k, (index, small)) in wanted.iter().zip(is_small).enumerate() {
            if !small {
                for part in 0..SPLIT_PARTS {
                    let place = if part == 0 { count + k } else { *index };
                    population.draw_part(*index, place, random.normal3(SPLIT_PARTS * k as u64 + part));
                }
                for place in [*index, count + k] {
                    for value in &mut population.splats.log_scales[place] {
                        *value -= SPLIT_SCALE_DIVISOR.ln() as f32;
                    }
                    population.forget(place);
                }
                gone[*index] = false;
            }
        }
        gone.resize(population.len(), false);
        let kept: Vec<usize> = (0..population.len()).filter(|i| !gone[*i]).collect();
        population.select(&kept);
        population.sort();
        population.pulls = DensifyStats::new(population.len());
    }
}

impl DensifyStrategy for AdaptiveConfig {
    fn max_splats(&self) -> Option<usize> {
        Some(self.max_splats)
    }

    fn values(&self) -> Vec<ConfigValue> {
        vec![
            ConfigValue::new("densify.every", self.every, COUNT_RANGE),
            ConfigValue::new("densify.reset_every", self.reset_every, COUNT_RANGE),
            ConfigValue::new("densify.max_splats", self.max_splats as f64, COUNT_RANGE),
            ConfigValue::new("densify.pull", self.pull, WEIGHT_RANGE),
            ConfigValue::new("densify.small", self.small, WEIGHT_RANGE),
            // Opacities are reset to twice this.
            ConfigValue::new("densify.faint", self.faint, 1e-6..=0.4),
            ConfigValue::new("densify.huge", self.huge, WEIGHT_RANGE),
            ConfigValue::new("densify.huge_radius", self.huge_radius, WEIGHT_RANGE),
        ]
    }

    fn sums_gradients(&self) -> bool {
        true
    }

    fn is_due(&self, step: u32) -> bool {
        let changes = step >= self.from && step.is_multiple_of(self.every);
        step < self.until && (changes || step.is_multiple_of(self.reset_every))
    }

    fn apply(&self, time: &DensifyTime, population: &mut Population) {
        let DensifyTime { step, extent, random, .. } = *time;
        if step < self.until && step >= self.from && step.is_multiple_of(self.every) {
            self.densify(step, population, extent, random);
        }
        if step < self.until && step.is_multiple_of(self.reset_every) {
            let most = logit(2.0 * self.faint) as f32;
            for value in &mut population.splats.logit_opacities {
                *value = value.min(most);
            }
            population.forget_opacities();
        }
    }
}

impl Population {
    /// Samples the centre of splat `place` from splat `from`, at `normal` standard deviations.
    fn draw_part(&mut self, from: usize, place: usize, normal: [f64; 3]) {
        let splats = &mut self.splats;
        let matrix = quat::to_matrix(splats.quats[from].map(f64::from));
        let scales = splats.scales(from);
        let mean = splats.means[from];
        splats.means[place] = std::array::from_fn(|row| {
            let off: f64 = (0..3).map(|k| matrix[row][k] * scales[k] * normal[k]).sum();
            (f64::from(mean[row]) + off) as f32
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Purpose;
    use wm_render::testing::random_splats;

    #[test]
    fn what_is_pulled_grows_and_what_is_faint_goes() {
        let mut config = AdaptiveConfig::for_steps(30_000, 1000);
        let mut population = Population::new(random_splats(100, 0, 1));
        population.splats.logit_opacities.fill(1.0);
        population.splats.log_scales.fill([-3.0; 3]);
        population.splats.log_scales[10] = [1.0; 3];
        population.splats.logit_opacities[20] = -8.0;
        population.pulls.sums[10] = 1.0;
        population.pulls.sums[30] = 1.0;
        population.pulls.counts.fill(2.0);
        let before = population.clone();
        let random = Random::new(0, Purpose::Sample, 600);
        let at = |step| DensifyTime { step, photos: 1, extent: 10.0, random };
        config.apply(&at(550), &mut population);
        assert!(population == before);
        // Two are born, one goes.
        config.apply(&at(600), &mut population);
        assert_eq!(population.len(), 101);
        let halves =
            population.splats.log_scales.iter().filter(|s| (s[0] - (1.0 - 0.47)).abs() < 1e-3).count();
        let clones = population.splats.means.iter().filter(|m| **m == before.splats.means[30]).count();
        assert_eq!((halves, clones), (2, 2));
        config.max_splats = 100;
        let mut full = before;
        config.apply(&at(600), &mut full);
        assert_eq!(full.len(), 99);
        config.apply(&at(3000), &mut full);
        assert!((0..full.len()).all(|i| full.splats.opacity(i) < 0.0101));
    }
}
