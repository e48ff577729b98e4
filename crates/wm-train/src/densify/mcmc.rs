//! Splats as samples of a Markov chain (Kheradmand et al. 2024).
//!
//! The number of splats only grows, by a share each time, up to a fixed budget. Dead splats
//! (transparent ones) move to where live ones are, and new ones are born there, chosen by opacity;
//! those that come to share a place share its opacity and size so that the picture stays as it was:
//! of n in one place each has `o' = 1 - (1 - o)^(1/n)` and the scales times
//! `o / sum_{i=1..n} sum_{k=0..i-1} C(i-1, k) (-1)^k o'^(k+1) / sqrt(k+1)`. Noise along each
//! splat's own shape explores, as long as it is nearly transparent. Opacities and sizes are pulled
//! down a little.
//!
//! Other than published: neither the noise nor the pull on sizes depends on the scene's unit; noise
//! moves a splat by its own size at most, or large ones would leave the scene for good; splats that
//! no photo has in view any more are dead, since nothing pulls on their opacity; as long as splats
//! are born none grows wider than a share of its distance from the middle of the place, or of the
//! scene's extent, since one that fills gaps all over a photo stands in the way of every other
//! view; the sky's splats take no part.

use super::population::Population;
use super::strategy::{DensifyStrategy, DensifyTime};
use crate::check::{COUNT_RANGE, ConfigValue, SHARE_RANGE, WEIGHT_RANGE};
use crate::random::Random;
use serde::{Deserialize, Serialize};
use wm_render::training::{DensifyStats, Noise, SplatTerms};
use wm_scene::Group;
use wm_scene::splats::logit;

/// Most splats that share one place after a step.
const MAX_SPLATS_PER_PLACE: usize = 51;
/// Opacity above which splats have no noise: the gate is below 1e-4 there.
const MAX_NOISY_OPACITY: f64 = 0.1;
/// Extent of a scene, scene units, for which [`McmcConfig::noise`] and [`McmcConfig::scale`] are
/// the published values: about that of the published scenes.
const PUBLISHED_EXTENT: f64 = 5.0;
/// Epochs after which splats that no photo has in view are dead; two views of one photo can be
/// nearly two epochs apart.
const UNSEEN_EPOCHS: u32 = 2;

/// Largest standard deviation, as a fraction of the distance from the centre of the scene or of
/// its extent, whichever is larger.
const MAX_SCALE: f64 = 0.1;

/// Constants of the chain.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct McmcConfig {
    /// First step that changes splats.
    pub from: u32,
    /// First step without changes again.
    pub until: u32,
    /// Steps between changes.
    pub every: u32,
    /// Most splats, those of the sky left aside.
    pub max_splats: usize,
    /// Growth of the number of splats at each change.
    pub growth: f64,
    /// Opacity at or below which a splat is dead.
    pub dead: f64,
    /// Noise in units of the step length of means and of the splat's variance, in scenes of extent
    /// 5.
    pub noise: f64,
    /// Weight of the mean opacity in the loss.
    pub opacity: f64,
    /// Weight of the mean scale, in fifths of the scene's extent, in the loss.
    pub scale: f64,
}

impl McmcConfig {
    /// The published constants, for a training of 30,000 steps, in proportion for others.
    #[must_use]
    pub fn for_steps(steps: u32, max_splats: usize) -> Self {
        let share = |of: u32| (u64::from(steps) * u64::from(of) / 30_000) as u32;
        Self {
            from: share(500).max(50),
            until: share(25_000),
            every: (steps / 70).clamp(10, 100),
            max_splats,
            growth: 0.05,
            dead: 0.005,
            noise: 5e5,
            opacity: 0.01,
            scale: 0.01,
        }
    }
}

impl DensifyStrategy for McmcConfig {
    fn max_splats(&self) -> Option<usize> {
        Some(self.max_splats)
    }

    fn values(&self) -> Vec<ConfigValue> {
        vec![
            ConfigValue::new("densify.every", self.every, COUNT_RANGE),
            ConfigValue::new("densify.max_splats", self.max_splats as f64, COUNT_RANGE),
            ConfigValue::new("densify.growth", self.growth, 0.0..=10.0),
            ConfigValue::new("densify.dead", self.dead, SHARE_RANGE),
            ConfigValue::new("densify.noise", self.noise, WEIGHT_RANGE),
            ConfigValue::new("densify.opacity", self.opacity, WEIGHT_RANGE),
            ConfigValue::new("densify.scale", self.scale, WEIGHT_RANGE),
        ]
    }

    fn terms(&self, extent: f64) -> SplatTerms {
        let scale = self.scale * PUBLISHED_EXTENT / extent;
        SplatTerms { opacity: self.opacity, scale, ..SplatTerms::default() }
    }

    fn noise(&self, rate: f64, extent: f64, random: Random) -> Option<Noise> {
        let size = self.noise * rate * (PUBLISHED_EXTENT / extent).powi(2);
        Some(Noise { seed: random.seed(), size, most: MAX_NOISY_OPACITY })
    }

    fn is_due(&self, step: u32) -> bool {
        step >= self.from && step < self.until && step.is_multiple_of(self.every)
    }

    fn apply(&self, time: &DensifyTime, population: &mut Population) {
        let DensifyTime { step, photos, extent, random } = *time;
        if !self.is_due(step) {
            return;
        }
        let count = population.len();
        let lost_after = UNSEEN_EPOCHS.saturating_mul(u32::try_from(photos).unwrap_or(u32::MAX));
        let is_dead = |population: &Population, i: usize| {
            population.splats.groups[i] != Group::Sky
                && (population.splats.opacity(i) <= self.dead
                    || step.saturating_sub(population.seen[i]) > lost_after)
        };
        let dead: Vec<usize> = (0..count).filter(|i| is_dead(population, *i)).collect();
        let hosts = sample(population, &dead, dead.len(), random, 0);
        population.settle(&hosts, self.dead);
        for (dead, host) in dead.iter().zip(&hosts) {
            population.take_place(*dead, *host);
        }
        // Splats of the sky are not copied and do not count for the budget.
        let count = population.splats.groups.iter().filter(|group| **group != Group::Sky).count();
        let grown = (count as f64 * (1.0 + self.growth)) as usize;
        let born = grown.max(count + 1).min(self.max_splats).saturating_sub(count);
        let still_dead = if hosts.is_empty() { &dead[..] } else { &[][..] };
        let hosts = sample(population, still_dead, born, random, dead.len() as u64);
        population.settle(&hosts, self.dead);
        population.copy(&hosts);
        population.bound(extent);
        population.sort();
        population.pulls = DensifyStats::new(population.len());
    }
}

/// Samples `wanted` live splats with probability proportional to opacity, except those in `dead`
/// (ascending) and the sky's; empty if there are none.
fn sample(population: &Population, dead: &[usize], wanted: usize, random: Random, first: u64) -> Vec<usize> {
    let mut total = 0.0;
    let mut next = 0;
    let sums: Vec<f64> = (0..population.len())
        .map(|i| {
            if dead.get(next) == Some(&i) {
                next += 1;
            } else if population.splats.groups[i] != Group::Sky {
                total += population.splats.opacity(i);
            }
            total
        })
        .collect();
    if total == 0.0 {
        return Vec::new();
    }
    (0..wanted as u64)
        .map(|k| {
            let at = random.uniform(first + k) * total;
            sums.partition_point(|sum| *sum <= at).min(population.len() - 1)
        })
        .collect()
}

impl Population {
    /// Shares the opacity and scale of each of `hosts` among the splats at its place; a host is
    /// listed once for each splat that joins it.
    fn settle(&mut self, hosts: &[usize], dead: f64) {
        let mut sorted = hosts.to_vec();
        sorted.sort_unstable();
        for group in sorted.chunk_by(|a, b| a == b) {
            let (host, many) = (group[0], (group.len() + 1).min(MAX_SPLATS_PER_PLACE));
            let opacity = self.splats.opacity(host);
            let (each, factor) = shared(opacity, many);
            self.splats.logit_opacities[host] = logit(each.clamp(dead, 1.0 - 1e-7)) as f32;
            for value in &mut self.splats.log_scales[host] {
                *value += factor.ln() as f32;
            }
            self.forget(host);
        }
    }

    /// Clamps the scales of splats to the largest one at their place.
    fn bound(&mut self, extent: f64) {
        let splats = &mut self.splats;
        let own: Vec<usize> = (0..splats.len()).filter(|i| splats.groups[*i] != Group::Sky).collect();
        let middle: [f64; 3] = std::array::from_fn(|k| {
            let mut values: Vec<f32> = own.iter().map(|i| splats.means[*i][k]).collect();
            let half = values.len() / 2;
            if values.is_empty() {
                0.0
            } else {
                f64::from(*values.select_nth_unstable_by(half, f32::total_cmp).1)
            }
        });
        for i in own {
            let far = (0..3).map(|k| (f64::from(splats.means[i][k]) - middle[k]).powi(2)).sum::<f64>().sqrt();
            let widest = (MAX_SCALE * far.max(extent)).ln() as f32;
            splats.log_scales[i].iter_mut().for_each(|scale| *scale = scale.min(widest));
        }
    }

    /// Makes splat `index` a copy of `host`, with empty moments.
    fn take_place(&mut self, index: usize, host: usize) {
        let splats = &mut self.splats;
        splats.means[index] = splats.means[host];
        splats.quats[index] = splats.quats[host];
        splats.log_scales[index] = splats.log_scales[host];
        splats.logit_opacities[index] = splats.logit_opacities[host];
        splats.groups[index] = splats.groups[host];
        self.seen[index] = self.seen[host];
        self.copy_colors(index, host);
        self.forget(index);
    }
}

/// Returns opacity and scale factor of each of `many` splats that replace one of `opacity`.
fn shared(opacity: f64, many: usize) -> (f64, f64) {
    let each = 1.0 - (1.0 - opacity).powf(1.0 / many as f64);
    let mut sum = 0.0;
    for i in 0..many {
        // Binomial coefficients by recurrence.
        let mut binomial = 1.0;
        for k in 0..=i {
            let sign = if k % 2 == 0 { 1.0 } else { -1.0 };
            sum += sign * binomial * each.powi(k as i32 + 1) / ((k + 1) as f64).sqrt();
            binomial *= (i - k) as f64 / (k + 1) as f64;
        }
    }
    // Alternating sums of large numbers lose precision: implausible factors are ignored.
    let factor = opacity / sum;
    (each, if factor.is_finite() && factor > 0.0 { factor.clamp(0.1, 1.0) } else { 1.0 })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::densify::explore;
    use crate::random::Purpose;
    use wm_render::testing::random_splats;

    /// A step of a training on ten photos.
    fn at(step: u32) -> DensifyTime {
        DensifyTime { step, photos: 10, extent: 5.0, random: Random::new(0, Purpose::Sample, step) }
    }

    fn explore_with(config: &McmcConfig, population: &mut Population, rate: f64, extent: f64) {
        let random = Random::new(1, Purpose::Noise, 9);
        explore(population, &config.noise(rate, extent, random).unwrap(), random);
    }

    #[test]
    fn only_far_splats_are_wide() {
        let mut population = Population::new(random_splats(50, 0, 2));
        let (near, far, sky) = (0, 1, 2);
        for (index, x) in [(near, 1.0), (far, 300.0), (sky, 1.0)] {
            population.splats.means[index] = [x, 0.0, 0.0];
            population.splats.log_scales[index] = [3.0, -2.0, 8.0];
            population.splats.logit_opacities[index] = 2.0;
        }
        population.splats.groups[sky] = Group::Sky;
        population.bound(5.0);
        let widest = |index: usize| population.splats.scales(index)[2];
        assert!(widest(near) <= MAX_SCALE * 5.0 * 1.0001, "{}", widest(near));
        assert!((widest(far) / (MAX_SCALE * 300.0) - 1.0).abs() < 0.05, "{}", widest(far));
        assert!(widest(sky) > 2000.0);
        assert!((population.splats.scales(near)[1] - (-2f64).exp()).abs() < 1e-6);
    }

    #[test]
    fn no_unit_changes_the_pull_on_sizes() {
        let config = McmcConfig::for_steps(1000, 100);
        let pull = |unit: f64| config.terms(5.0 * unit).scale * 0.1 * unit;
        assert!((pull(1.0) - config.scale * 0.1).abs() < 1e-12);
        assert!((pull(30.0) - pull(1.0)).abs() < 1e-12);
    }

    /// n splats of the shared form, blended, have the alpha of the one at the centre, and nearly
    /// its integral: the formula makes the integrals over the picture's plane equal in one
    /// dimension.
    #[test]
    fn a_shared_place_looks_as_it_did() {
        for (opacity, many) in [(0.5, 2), (0.9, 3), (0.3, 5), (0.99, 2)] {
            let (each, factor) = shared(opacity, many);
            assert!((1.0 - (1.0 - each).powi(many as i32) - opacity).abs() < 1e-12);
            let line = |opacity: f64, sigma: f64, many: i32| -> f64 {
                (-4000..4000)
                    .map(|i| {
                        1.0 - (1.0 - opacity * (-(f64::from(i) * 0.002 / sigma).powi(2) / 2.0).exp())
                            .powi(many)
                    })
                    .sum()
            };
            let (one, all) = (line(opacity, 1.0, 1), line(each, factor, many as i32));
            assert!((all / one - 1.0).abs() < 1e-3, "{opacity} {many}: {one} {all}");
        }
    }

    #[test]
    fn the_dead_move_to_the_living_and_the_budget_holds() {
        let mut population = Population::new(random_splats(400, 1, 2));
        population.splats.logit_opacities.fill(0.5);
        population.splats.logit_opacities[..40].fill(-9.0);
        population.seen.fill(595);
        let config = McmcConfig { max_splats: 410, ..McmcConfig::for_steps(30_000, 410) };
        config.apply(&at(600), &mut population);
        assert_eq!(population.len(), 410);
        assert!((0..410).all(|i| population.splats.opacity(i) > 0.01));
        let before = population.clone();
        config.apply(&at(601), &mut population);
        assert!(population == before);
        config.apply(&at(700), &mut population);
        assert_eq!(population.len(), 410);
    }

    #[test]
    fn only_what_is_nearly_transparent_explores() {
        let mut population = Population::new(random_splats(50, 0, 3));
        population.splats.logit_opacities.fill(2.0);
        population.splats.logit_opacities[3] = -6.0;
        let before = population.splats.means.clone();
        explore_with(&McmcConfig::for_steps(30_000, 50), &mut population, 1e-4, 5.0);
        let moved: Vec<usize> = (0..50).filter(|i| population.splats.means[*i] != before[*i]).collect();
        assert_eq!(moved, [3]);
    }

    /// A far splat moves as far in units of the scene as a near one, and no splat farther than its
    /// size.
    #[test]
    fn noise_knows_no_unit_and_keeps_splats_at_home() {
        let config = McmcConfig::for_steps(30_000, 50);
        let moved = |unit: f64, growth: f64| -> Vec<f64> {
            let mut population = Population::new(random_splats(50, 0, 3));
            population.splats.logit_opacities.fill(-6.0);
            let add = (unit * growth).ln() as f32;
            population.splats.log_scales.iter_mut().flatten().for_each(|v| *v += add);
            population.splats.means.iter_mut().flatten().for_each(|v| *v *= unit as f32);
            let before = population.clone();
            explore_with(&config, &mut population, 1e-6 * unit, 5.0 * unit);
            let pairs = population.splats.means.iter().zip(&before.splats.means);
            let off = pairs.map(|(a, b)| (0..3).map(|k| f64::from(a[k] - b[k]).powi(2)).sum::<f64>().sqrt());
            off.map(|off| off / unit).collect()
        };
        for (one, thousand) in moved(1.0, 1.0).into_iter().zip(moved(1000.0, 1.0)) {
            assert!((one - thousand).abs() < 1e-3 * one + 1e-5, "{one} {thousand}");
        }
        // Sizes of 1e4: 5 standard deviations of three axes.
        let largest = random_splats(50, 0, 3).log_scales.iter().flatten().fold(f32::MIN, |a, b| a.max(*b));
        let reach = 1e4 * f64::from(largest).exp() * 5.0 * 3f64.sqrt();
        assert!(moved(1.0, 1e4).into_iter().all(|off| off < reach));
    }

    #[test]
    fn what_no_photo_sees_any_more_moves_and_the_sky_stays() {
        let mut population = Population::new(random_splats(60, 0, 4));
        population.splats.logit_opacities.fill(0.5);
        population.seen.fill(590);
        population.seen[5] = 579;
        population.splats.means[5] = [1e6; 3];
        for sky in 10..40 {
            population.splats.groups[sky] = Group::Sky;
            population.seen[sky] = 0;
        }
        let skies = |population: &Population| {
            population.splats.groups.iter().filter(|group| **group == Group::Sky).count()
        };
        let config = McmcConfig::for_steps(30_000, 80);
        config.apply(&at(600), &mut population);
        assert!(population.splats.means.iter().flatten().all(|v| v.abs() < 1e5));
        assert_eq!((population.len(), skies(&population)), (61, 30));
    }

    #[test]
    fn where_nothing_lives_nothing_comes() {
        let mut population = Population::new(random_splats(20, 0, 4));
        population.splats.logit_opacities.fill(-9.0);
        let before = population.splats.clone();
        McmcConfig::for_steps(30_000, 80).apply(&at(600), &mut population);
        assert_eq!(population.splats, before);
    }
}
