//! The health of a set of splats: faults, the spread of its values, and the repair.

use crate::{
    Group, Splats,
    splats::sigmoid,
    values::{Faults, MAX_SCENE_COORDINATE},
};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use thiserror::Error;

/// A splat below this opacity is never drawn: it changes no 8 bit picture.
pub const MIN_OPACITY: f64 = 1.0 / 255.0;

/// A report on a set of splats; plain data, for people and programs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Health {
    /// Number of splats.
    pub splats: usize,
    /// Degree of their spherical harmonics, 0 to 3.
    pub sh_degree: u8,
    /// Splats with any of `faults`.
    pub faulty: usize,
    /// Splats with each fault; one splat may have several.
    pub faults: FaultCounts,
    /// Splats whose stored values all equal those of another that is counted as the first (found by
    /// a 64 bit hash of the bits: wrong for one in 10^7 scenes of a million splats). Groups are not
    /// compared.
    pub duplicates: usize,
    /// Splats whose mean equals that of another, counted likewise.
    pub duplicate_means: usize,
    /// Splats with an opacity below [`MIN_OPACITY`].
    pub invisible: usize,
    /// Splats with a standard deviation above the diagonal of `robust_bounds`, sky left out.
    pub oversized: usize,
    /// Splats in each group.
    pub groups: BTreeMap<Group, usize>,
    /// The box around the means that are places, sky left out; none if there are none.
    pub bounds: Option<Bounds>,
    /// The box from the 1 % to the 99 % quantile of each coordinate of the same means.
    pub robust_bounds: Option<Bounds>,
    /// Opacities, 0 to 1.
    pub opacity: Histogram,
    /// Decimal logarithm of the largest standard deviation of a splat, scene units.
    pub log10_scale: Histogram,
}

/// Number of splats with each fault; see [`crate::values`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct FaultCounts {
    /// The mean is NaN, infinite or absurdly far.
    pub mean: usize,
    /// A scale is NaN, infinite or absurdly large.
    pub scale: usize,
    /// The opacity is NaN.
    pub opacity: usize,
    /// The quaternion is NaN, infinite or absurdly long.
    pub quat: usize,
    /// The quaternion is zero.
    pub zero_quat: usize,
    /// A colour coefficient is NaN, infinite or absurdly large.
    pub sh: usize,
    /// All values are zero.
    #[serde(default)]
    pub blank: usize,
}

/// A box along the world axes, scene units.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Bounds {
    /// Lowest corner.
    pub min: [f64; 3],
    /// Highest corner.
    pub max: [f64; 3],
}

impl Bounds {
    /// Length of the diagonal, scene units.
    #[must_use]
    pub(crate) fn diagonal(&self) -> f64 {
        (0..3).map(|axis| (self.max[axis] - self.min[axis]).powi(2)).sum::<f64>().sqrt()
    }
}

/// Counts of values in bins of equal width; values that are no number are left out.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Histogram {
    /// Lower edge of the first bin.
    pub min: f64,
    /// Upper edge of the last bin, which it belongs to.
    pub max: f64,
    /// Values in each bin.
    pub counts: Vec<usize>,
    /// Values below `min`.
    pub below: usize,
    /// Values above `max`.
    pub above: usize,
}

impl Histogram {
    /// Empty bins from `min` to `max`.
    #[must_use]
    pub(crate) fn new(min: f64, max: f64, bins: usize) -> Self {
        Self { min, max, counts: vec![0; bins], below: 0, above: 0 }
    }

    /// Counts a value.
    pub(crate) fn add(&mut self, value: f64) {
        if value < self.min {
            self.below += 1;
        } else if value > self.max {
            self.above += 1;
        } else if !value.is_nan() {
            let bins = self.counts.len();
            let bin = ((value - self.min) / (self.max - self.min) * bins as f64) as usize;
            self.counts[bin.min(bins - 1)] += 1;
        }
    }
}

impl Health {
    /// Looks at every splat.
    #[must_use]
    pub fn of(splats: &Splats) -> Self {
        let robust_bounds = bounds(splats, 0.01);
        let extent = robust_bounds.map_or(0.0, |b| b.diagonal());
        let mut health = Self {
            splats: splats.len(),
            sh_degree: splats.sh_degree,
            faulty: 0,
            faults: FaultCounts::default(),
            duplicates: repeats(splats.len(), |index| hash(all_values(splats, index))),
            duplicate_means: repeats(splats.len(), |index| hash(splats.means[index])),
            invisible: 0,
            oversized: 0,
            groups: Group::ALL.into_iter().map(|group| (group, 0)).collect(),
            bounds: bounds(splats, 0.0),
            robust_bounds,
            opacity: Histogram::new(0.0, 1.0, 20),
            log10_scale: Histogram::new(-6.0, 4.0, 40),
        };
        for index in 0..splats.len() {
            let faults = splats.faults(index);
            health.faulty += usize::from(faults != Faults::default());
            health.faults.add(faults);
            *health.groups.entry(splats.groups[index]).or_default() += 1;
            let opacity = sigmoid(f64::from(splats.logit_opacities[index]));
            health.opacity.add(opacity);
            health.invisible += usize::from(opacity < MIN_OPACITY);
            if !faults.scale {
                let [a, b, c] = splats.log_scales[index].map(f64::from);
                let log_scale = a.max(b).max(c);
                health.log10_scale.add(log_scale * std::f64::consts::LOG10_E);
                let is_place = splats.groups[index] != Group::Sky && extent > 0.0;
                health.oversized += usize::from(is_place && log_scale.exp() > extent);
            }
        }
        health
    }
}

impl FaultCounts {
    fn add(&mut self, faults: Faults) {
        let Faults { mean, scale, opacity, quat, zero_quat, sh, blank } = faults;
        self.mean += usize::from(mean);
        self.scale += usize::from(scale);
        self.opacity += usize::from(opacity);
        self.quat += usize::from(quat);
        self.zero_quat += usize::from(zero_quat);
        self.sh += usize::from(sh);
        self.blank += usize::from(blank);
    }
}

/// Splats that hold NaN, infinite or absurd numbers, or nothing but zeros, and cannot be drawn: how
/// many, and in which arrays.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[error("{faulty} of {splats} splats hold NaN, infinite or absurd numbers ({})", self.arrays())]
pub struct NonFiniteSplats {
    /// Number of all splats.
    pub(crate) splats: usize,
    /// Splats with at least one such number.
    pub(crate) faulty: usize,
    /// Splats with each fault; zero quaternions are not counted, for they can be repaired in place.
    pub(crate) counts: FaultCounts,
}

impl NonFiniteSplats {
    fn arrays(&self) -> String {
        let FaultCounts { mean, scale, opacity, quat, sh, blank, .. } = self.counts;
        let counts = [mean, scale, opacity, quat, sh];
        let named = counts.into_iter().zip(["positions", "scales", "opacities", "rotations", "colours"]);
        let named = named.filter(|(count, _)| *count > 0).map(|(count, name)| format!("{count} in {name}"));
        let blank = (blank > 0).then(|| format!("{blank} are rows of zeros"));
        named.chain(blank).collect::<Vec<_>>().join(", ")
    }
}

/// The changes that [`Splats::repaired`] made.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Repairs {
    /// Splats that were left out.
    pub dropped: usize,
    /// Splats whose zero quaternion became the identity.
    pub turned: usize,
}

impl Splats {
    /// Checks that every splat can be drawn: that it has no fault ([`crate::values`]) but a zero
    /// quaternion.
    ///
    /// # Errors
    /// [`NonFiniteSplats`] counts the splats that do.
    pub fn check_finite(&self) -> Result<(), NonFiniteSplats> {
        let mut found = NonFiniteSplats { splats: self.len(), faulty: 0, counts: FaultCounts::default() };
        for index in 0..self.len() {
            let faults = self.faults(index);
            found.faulty += usize::from(faults.is_fatal());
            found.counts.add(Faults { zero_quat: false, ..faults });
        }
        if found.faulty == 0 { Ok(()) } else { Err(found) }
    }

    /// The splats that can be drawn, in their order: a zero quaternion becomes the identity, splats
    /// with any other fault are left out.
    #[must_use]
    pub fn repaired(mut self) -> (Self, Repairs) {
        let mut repairs = Repairs::default();
        let mut kept = Vec::with_capacity(self.len());
        for index in 0..self.len() {
            let faults = self.faults(index);
            if faults.is_fatal() {
                repairs.dropped += 1;
                continue;
            }
            if faults.zero_quat {
                self.quats[index] = [1.0, 0.0, 0.0, 0.0];
                repairs.turned += 1;
            }
            kept.push(index);
        }
        let repaired = if repairs.dropped == 0 { self } else { self.select(&kept) };
        (repaired, repairs)
    }
}

/// The box between two quantiles of each coordinate: `cut` of the means that are places are below,
/// as many above; the sky does not count.
fn bounds(splats: &Splats, cut: f64) -> Option<Bounds> {
    let mut bounds = Bounds { min: [0.0; 3], max: [0.0; 3] };
    for axis in 0..3 {
        let means = splats.means.iter().zip(&splats.groups);
        let mut values: Vec<f32> = means
            .filter(|(mean, group)| {
                **group != Group::Sky && mean.iter().all(|v| v.abs() <= MAX_SCENE_COORDINATE)
            })
            .map(|(mean, _)| mean[axis])
            .collect();
        let last = values.len().checked_sub(1)?;
        let rank = (cut * last as f64) as usize;
        bounds.min[axis] = f64::from(*values.select_nth_unstable_by(rank, f32::total_cmp).1);
        bounds.max[axis] = f64::from(*values.select_nth_unstable_by(last - rank, f32::total_cmp).1);
    }
    Some(bounds)
}

/// Number of splats whose hash another one had before.
fn repeats(count: usize, hash: impl Fn(usize) -> u64) -> usize {
    let mut hashes: Vec<u64> = (0..count).map(hash).collect();
    hashes.sort_unstable();
    hashes.dedup();
    count - hashes.len()
}

/// Every stored value of a splat but its group.
fn all_values(splats: &Splats, index: usize) -> impl Iterator<Item = f32> {
    let shape = splats.means[index].into_iter().chain(splats.quats[index]).chain(splats.log_scales[index]);
    shape.chain([splats.logit_opacities[index]]).chain(splats.sh_of(index).iter().copied())
}

/// A hash of the bits. Every step is one-to-one in the state, so that only values that differ in
/// several places can meet, as rarely as random numbers do.
fn hash(values: impl IntoIterator<Item = f32>) -> u64 {
    let step = |state: u64, word: u32| {
        let mixed = (state ^ u64::from(word)).wrapping_mul(0xd6e8_feb8_6659_fd93);
        mixed ^ (mixed >> 32)
    };
    let all = values.into_iter().fold(0x9e37_79b9_7f4a_7c15, |state, value| step(state, value.to_bits()));
    step(all, 0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        splats::{Splat, logit},
        testing::{SPLAT, any_scene, bits, data},
    };
    use proptest::prelude::*;

    /// 200 splats on the diagonal from 0 to 199, of standard deviation 0.1.
    fn diagonal() -> Splats {
        let mut splats = Splats::with_capacity(200, 1);
        for index in 0..200 {
            splats.push(&Splat {
                mean: [index as f32; 3],
                log_scale: [0.1f32.ln(), -4.0, -5.0],
                logit_opacity: logit(0.52) as f32,
                group: if index == 199 { Group::Sky } else { Group::Scene },
                ..SPLAT
            });
        }
        splats
    }

    #[test]
    fn a_sound_scene_has_a_clean_report() {
        let health = Health::of(&diagonal());
        assert_eq!((health.splats, health.sh_degree, health.faulty), (200, 1, 0));
        assert_eq!(health.faults, FaultCounts::default());
        assert_eq!((health.duplicates, health.duplicate_means), (0, 0));
        assert_eq!((health.invisible, health.oversized), (0, 0));
        assert_eq!(health.groups[&Group::Scene], 199);
        assert_eq!(health.groups[&Group::Snow], 0);
        // The sky splat at 199 does not count; 1 % of 198 steps is one step.
        assert_eq!(health.bounds, Some(Bounds { min: [0.0; 3], max: [198.0; 3] }));
        assert_eq!(health.robust_bounds, Some(Bounds { min: [1.0; 3], max: [197.0; 3] }));
        assert_eq!(health.opacity.counts[10], 200);
        // 0.1 is -1 in decimal logarithm; rounding to f32 may put it on either side of the edge.
        assert_eq!(health.log10_scale.counts[19] + health.log10_scale.counts[20], 200);
    }

    #[test]
    fn every_fault_is_counted_and_repaired() {
        let mut splats = diagonal();
        splats.means[0][1] = f32::NAN;
        splats.log_scales[1][2] = f32::INFINITY;
        splats.logit_opacities[2] = f32::NAN;
        splats.quats[3][0] = f32::NEG_INFINITY;
        splats.quats[4] = [0.0; 4];
        splats.sh[5 * 12 + 7] = f32::NAN;
        splats.quats[5] = [0.0; 4];
        let health = Health::of(&splats);
        let expected = FaultCounts { mean: 1, scale: 1, opacity: 1, quat: 1, zero_quat: 2, sh: 1, blank: 0 };
        assert_eq!((health.faulty, health.faults), (6, expected));
        assert_eq!(health.bounds.unwrap().min, [1.0; 3]);
        let found = splats.check_finite().unwrap_err();
        assert_eq!((found.faulty, found.counts), (5, FaultCounts { zero_quat: 0, ..expected }));
        let says = "5 of 200 splats hold NaN, infinite or absurd numbers (1 in positions, 1 in scales, 1 in opacities, \
                    1 in rotations, 1 in colours)";
        assert_eq!(found.to_string(), says);
        let (repaired, repairs) = splats.clone().repaired();
        assert_eq!((repairs, repaired.check_finite()), (Repairs { dropped: 5, turned: 1 }, Ok(())));
        assert_eq!(repaired.means[0], [4.0; 3]);
        assert_eq!(repaired.quats[0], [1.0, 0.0, 0.0, 0.0]);
        assert_eq!(Health::of(&repaired).faulty, 0);
        assert_eq!(repaired.check(), Ok(()));
    }

    #[test]
    fn what_is_odd_is_counted() {
        let mut splats = diagonal();
        splats.logit_opacities[0] = logit(0.0039) as f32;
        splats.logit_opacities[1] = logit(0.0040) as f32;
        splats.logit_opacities[2] = f32::NEG_INFINITY;
        // The diagonal of the robust box is 196 sqrt 3 = 339.5.
        splats.log_scales[3][1] = 339f32.ln();
        splats.log_scales[4][1] = 340f32.ln();
        splats.log_scales[199][1] = 340f32.ln();
        splats.log_scales[5] = [f32::NEG_INFINITY; 3];
        let health = Health::of(&splats);
        assert_eq!((health.invisible, health.oversized, health.faulty), (2, 1, 0));
        assert_eq!((health.opacity.counts[0], health.log10_scale.below), (3, 1));
    }

    #[test]
    fn duplicates_are_counted() {
        let mut splats = diagonal();
        let again: Vec<usize> = (0..200).chain([7, 7, 9, 11]).collect();
        splats = splats.select(&again);
        splats.sh[203 * 12 + 11] += 1.0;
        splats.groups[202] = Group::Snow;
        let health = Health::of(&splats);
        assert_eq!((health.duplicates, health.duplicate_means), (3, 4));
    }

    #[test]
    fn hashes_of_close_values_differ() {
        // A grid of small whole numbers: few bits differ, in several places at once.
        let grid = (0..1_000_000).map(|i| [(i % 100) as f32, (i / 100 % 100) as f32, (i / 10_000) as f32]);
        let cells: Vec<[f32; 3]> = grid.collect();
        assert_eq!(repeats(cells.len(), |index| hash(cells[index])), 0);
    }

    #[test]
    fn nothing_gives_an_empty_report() {
        let health = Health::of(&Splats::default());
        assert_eq!((health.splats, health.bounds, health.robust_bounds), (0, None, None));
        assert_eq!(Splats::default().repaired(), (Splats::default(), Repairs::default()));
    }

    #[test]
    fn reports_are_plain_data() {
        let health = Health::of(&diagonal());
        let text = serde_json::to_string(&health).unwrap();
        assert!(text.contains(r#""groups":{"scene":199,"sky":1,"snow":0}"#), "{text}");
        assert_eq!(serde_json::from_str::<Health>(&text).unwrap(), health);
    }

    #[test]
    fn real_scenes_are_sound() {
        for name in ["headquarter-garden", "taebak"] {
            let Some(path) = data(&format!("scenes/{name}.ply")) else { continue };
            let scene = crate::formats::read_scene(&path, &Default::default()).unwrap();
            let health = Health::of(&scene.splats);
            assert_eq!(health.faulty, 0, "{name}");
            assert_eq!(health.opacity.counts.iter().sum::<usize>(), health.splats);
            assert!(health.robust_bounds.unwrap().diagonal() <= health.bounds.unwrap().diagonal());
        }
    }

    proptest! {
        #[test]
        fn any_splats_can_be_repaired(scene in any_scene(10)) {
            let splats = scene.splats;
            let health = Health::of(&splats);
            let (repaired, repairs) = splats.clone().repaired();
            prop_assert_eq!(health.faulty, repairs.dropped + repairs.turned);
            prop_assert_eq!(repaired.len() + repairs.dropped, splats.len());
            prop_assert!((0..repaired.len()).all(|index| repaired.is_sound(index)));
            prop_assert_eq!(bits(&repaired.clone().repaired().0), bits(&repaired));
        }
    }
}
