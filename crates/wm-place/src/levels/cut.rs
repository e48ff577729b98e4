//! The level that each leaf of a scene is drawn at, so that a budget of splats shows as much as it
//! can.
//!
//! All leaves begin at their coarsest level. Finer ones are bought, the one first that removes most
//! error a splat: squared error of the leaf's pictures times the pixels that it covers, over the
//! splats that it adds. The first that does not fit ends it, so that the cut of a larger budget is
//! nowhere coarser than that of a smaller one, but for that last leaf.
//!
//! A cut is a pure function of index, cameras and budget: frames need not be rendered in order.

use super::coverage;
use rayon::prelude::*;
use std::{cmp::Reverse, collections::BinaryHeap};
use wm_scene::{
    Camera,
    levels::{LevelIndex, LevelLeaf, LevelRun},
};

/// Error of a leaf's pictures with a share `s` of its splats where the index states none: this
/// times `1 - sqrt(s)`.
///
/// 1 is white for black. The value is the order of what reduced leaves of photographed places lose;
/// only its growth over the levels matters where no leaf has an error.
const DEFAULT_ERROR: f64 = 0.1;
/// Larger errors of an index are taken for this.
const MAX_ERROR: f64 = 10.0;

/// The most that a cut may be. Splats of the environment are not counted. Leaves are never coarser
/// than their coarsest level.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct CutBudget {
    /// Number of splats that a picture draws.
    pub(crate) splats: u64,
    /// Number of splats of all leaves together, drawn or not.
    pub(crate) held: u64,
}

impl CutBudget {
    /// So many splats, all of which are drawn.
    pub(crate) fn of(splats: u64) -> Self {
        Self { splats, held: splats }
    }
}

/// The part of a leaf that pictures show.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct VisibleLeaf {
    /// The light that comes from it over what would come if it hid all behind it and nothing hid
    /// it, 0-1; its weight against other leaves.
    pub(crate) light: f64,
    /// The share of its splats that this light comes from, 0-1: the others are not drawn.
    pub(crate) drawn: f64,
}

impl Default for VisibleLeaf {
    /// All of it.
    fn default() -> Self {
        Self { light: 1.0, drawn: 1.0 }
    }
}

impl VisibleLeaf {
    /// The splats that are drawn of `count`.
    fn drawn_of(&self, count: u64) -> u64 {
        // Larger numbers than this are not added up.
        (count as f64 * self.drawn.clamp(0.0, 1.0)).ceil() as u64
    }
}

/// The level that each leaf of an index is drawn at.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(crate) struct LevelCut {
    pub(crate) positions: Vec<u16>,
    pub(crate) splats: u64,
}

impl LevelCut {
    /// All leaves at their coarsest level.
    pub(crate) fn coarsest(index: &LevelIndex) -> Self {
        Self::at(index, |leaf| leaf.runs.len().saturating_sub(1))
    }

    fn at(index: &LevelIndex, position: impl Fn(&LevelLeaf) -> usize) -> Self {
        let positions: Vec<u16> =
            index.leaves.iter().map(|leaf| u16::try_from(position(leaf)).unwrap_or(u16::MAX)).collect();
        let mut cut = Self { positions, splats: 0 };
        cut.splats = cut.runs(index).fold(0, |sum, (_, run)| sum.saturating_add(run.count));
        cut
    }

    /// The cut for all pictures of `cameras`: for one frame, or for all frames of a path, so that
    /// nothing changes its level between them.
    ///
    /// A leaf counts with the largest area that it covers in a picture. One that no picture shows
    /// stays at its coarsest level.
    pub(crate) fn of(index: &LevelIndex, cameras: &[Camera], budget: &CutBudget) -> Self {
        Self::of_seen(index, cameras, &[], budget)
    }

    /// As [`Self::of`], with what is seen of each leaf; of those without, all.
    pub(crate) fn of_seen(
        index: &LevelIndex,
        cameras: &[Camera],
        seen: &[VisibleLeaf],
        budget: &CutBudget,
    ) -> Self {
        let areas: Vec<f64> = index
            .leaves
            .par_iter()
            .with_min_len(256)
            .map(|leaf| {
                cameras.iter().map(|camera| coverage(leaf.low, leaf.high, camera)).fold(0.0, f64::max)
            })
            .collect();
        let mut cut = Self::coarsest(index);
        let seen_of = |leaf: usize| seen.get(leaf).copied().unwrap_or_default();
        let drawn_of = |leaf: usize, run: &LevelRun| seen_of(leaf).drawn_of(run.count);
        let mut drawn =
            cut.runs(index).fold(0u64, |sum, (leaf, run)| sum.saturating_add(drawn_of(leaf, run)));
        let step = |leaf: usize, from: usize| {
            LevelStep::best(&index.leaves[leaf], leaf, from, areas[leaf], seen_of(leaf))
        };
        let first = |leaf: usize| step(leaf, usize::from(cut.positions[leaf]));
        let mut steps: BinaryHeap<LevelStep> = (0..areas.len()).filter_map(first).collect();
        while let Some(LevelStep { leaf: Reverse(leaf), to: best, .. }) = steps.pop() {
            let (runs, from) = (&index.leaves[leaf].runs, usize::from(cut.positions[leaf]));
            // The splats that are held and those that are drawn in addition.
            let added = |to: usize| {
                let drawn = drawn_of(leaf, &runs[to]).saturating_sub(drawn_of(leaf, &runs[from]));
                (runs[to].count.saturating_sub(runs[from].count), drawn)
            };
            let left = (budget.held.saturating_sub(cut.splats), budget.splats.saturating_sub(drawn));
            let fits = |to: &usize| added(*to).0 <= left.0 && added(*to).1 <= left.1;
            // The finest of it that fits, and then no other leaf: it would look better than one
            // that is worth more.
            let Some(to) = (usize::from(best)..from).find(fits) else { break };
            cut.splats += added(to).0;
            drawn += added(to).1;
            cut.positions[leaf] = to as u16;
            if to != usize::from(best) {
                break;
            }
            steps.extend(step(leaf, to));
        }
        cut
    }

    /// The leaves and the run that is drawn of each, in the order of the index that it was made
    /// for.
    pub(crate) fn runs<'a>(
        &'a self,
        index: &'a LevelIndex,
    ) -> impl Iterator<Item = (usize, &'a LevelRun)> + 'a {
        let run = |(leaf, position): (usize, &u16)| {
            Some((leaf, index.leaves.get(leaf)?.runs.get(usize::from(*position))?))
        };
        self.positions.iter().enumerate().filter_map(run)
    }
}

/// A finer level of a leaf. The greatest is taken first: the one with the largest gain, and of
/// equal gains that of the first leaf.
#[derive(PartialEq, Eq, PartialOrd, Ord)]
struct LevelStep {
    /// Squared error removed per splat that is drawn in addition, as the bits of an `f64`: above 0
    /// they have the order of the numbers.
    gain: u64,
    leaf: Reverse<usize>,
    to: u16,
}

impl LevelStep {
    /// The finer level of a leaf that removes most per splat; `None` if none removes anything.
    fn best(leaf: &LevelLeaf, number: usize, from: usize, area: f64, seen: VisibleLeaf) -> Option<Self> {
        let weight = area * seen.light;
        if !(weight > 0.0 && weight.is_finite()) {
            return None;
        }
        let lost = |position: usize| seen_error(leaf, position, area).powi(2);
        let (now, count) = (lost(from), leaf.runs.get(from)?.count);
        let (mut best, mut most) = (None, 0.0);
        for to in (0..from).rev() {
            let added = seen.drawn_of(leaf.runs[to].count).saturating_sub(seen.drawn_of(count));
            let gain = weight * (now - lost(to)) / added.max(1) as f64;
            if gain > most {
                most = gain;
                best =
                    Some(Self { gain: gain.to_bits(), leaf: Reverse(number), to: u16::try_from(to).ok()? });
            }
        }
        best
    }
}

/// The error of a leaf at a level in pictures where it covers `area` px.
///
/// A level lacks details that are finer than the distance of its splats. Where that is below a
/// pixel, the pixel averages them away.
fn seen_error(leaf: &LevelLeaf, position: usize, area: f64) -> f64 {
    let run = &leaf.runs[position];
    let count = run.count as f64;
    let error = run.error.map_or_else(
        || DEFAULT_ERROR * (1.0 - (count / leaf.runs[0].count.max(1) as f64).sqrt()).max(0.0),
        |error| f64::from(error).min(MAX_ERROR),
    );
    error * (area / count.max(1.0)).sqrt().min(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    /// Leaves along y, from near to far, of 1000, 500, 250 and 125 splats.
    fn index(leaves: usize, errors: &str) -> LevelIndex {
        let leaf = |i: usize| {
            let runs: Vec<String> = [1000, 500, 250, 125]
                .iter()
                .enumerate()
                .map(|(level, count)| {
                    format!(r#""{level}": {{"file": {level}, "offset": {}, "count": {count}}}"#, i * count)
                })
                .collect();
            let (from, to) = (10 * i, 10 * i + 4);
            format!(
                r#"{{"bound": {{"min": [-2, {from}, -2], "max": [2, {to}, 2]}}, "lods": {{{}}} {errors}}}"#,
                runs.join(",")
            )
        };
        let text = format!(
            r#"{{"lodLevels": 4, "lodErrors": true, "filenames": ["a", "b", "c", "d"], "tree": {{"children": [{}]}}}}"#,
            (0..leaves).map(leaf).collect::<Vec<_>>().join(",")
        );
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("lod-meta.json");
        std::fs::write(&path, text).unwrap();
        LevelIndex::open(&path).unwrap()
    }

    fn camera(y: f64, forward: f64) -> Camera {
        let eye = DVec3::new(0.0, y, 0.0);
        Camera::looking((800, 600), 50.0, eye, eye + forward * DVec3::Y, DVec3::Z).unwrap()
    }

    const ERRORS: &str = r#", "errors": [0, 0.01, 0.02, 0.04]"#;

    #[test]
    fn what_is_near_is_finer_and_what_is_not_seen_is_coarsest() {
        let index = index(10, ERRORS);
        let budget = CutBudget::of(4000);
        let cut = LevelCut::of(&index, &[camera(-10.0, 1.0)], &budget);
        assert!(cut.positions.is_sorted() && cut.positions[0] == 0 && cut.positions[9] == 2, "{cut:?}");
        assert!((3500..=4000).contains(&cut.splats), "{cut:?}");
        assert_eq!(cut.runs(&index).map(|(_, run)| run.count).sum::<u64>(), cut.splats);
        let away = LevelCut::of(&index, &[camera(-10.0, -1.0)], &budget);
        assert_eq!(away, LevelCut::coarsest(&index));
        // A path that ends there: both ends are fine, whatever the order of its cameras.
        let path = [camera(-10.0, 1.0), camera(110.0, -1.0)];
        let cut = LevelCut::of(&index, &path, &budget);
        assert!(cut.positions[0] < cut.positions[5] && cut.positions[9] < cut.positions[5], "{cut:?}");
        assert_eq!(cut, LevelCut::of(&index, &[path[1], path[0]], &budget));
        let hidden = [VisibleLeaf { light: 0.0, drawn: 0.0 }; 2];
        assert_eq!(LevelCut::of_seen(&index, &path, &hidden, &budget).positions[..2], [3, 3]);
    }

    #[test]
    fn budgets_are_kept_and_more_is_never_coarser() {
        let (mut before, index) = (LevelCut::coarsest(&index(30, ERRORS)), index(30, ERRORS));
        for splats in (0..32_000).step_by(1000) {
            let cut = LevelCut::of(&index, &[camera(-10.0, 1.0)], &CutBudget::of(splats));
            assert!(cut.splats <= splats.max(30 * 125));
            let coarser = cut.positions.iter().zip(&before.positions).filter(|(now, then)| now > then);
            // The last leaf of the smaller budget may have had another step.
            assert!(coarser.count() <= 1);
            before = cut;
        }
    }

    /// Splats that are held and not drawn leave room for other leaves, up to the number that may be
    /// held.
    #[test]
    fn splats_that_show_nothing_are_held_and_not_drawn() {
        let (index, cameras) = (index(10, ERRORS), [camera(-10.0, 1.0)]);
        let fifth = [VisibleLeaf { drawn: 0.2, ..VisibleLeaf::default() }; 10];
        let held = |held| LevelCut::of_seen(&index, &cameras, &fifth, &CutBudget { splats: 800, held });
        let (some, all) = (held(3000), LevelCut::of(&index, &cameras, &CutBudget::of(4000)));
        assert_eq!(held(9000), all);
        assert!(some.splats <= 3000 && all.splats > 3000, "{some:?}");
    }

    #[test]
    fn indices_without_errors_or_with_bad_ones_are_cut_too() {
        let cameras = [camera(-10.0, 1.0)];
        for errors in ["", r#", "errors": [1e38, 0, 1e38, 0.5]"#, r#", "errors": [0, 0, 0, 0]"#] {
            let index = index(10, errors);
            let cut = LevelCut::of(&index, &cameras, &CutBudget::of(4000));
            assert!(cut.splats <= 4000, "{errors} {cut:?}");
            assert_eq!(cut.positions[0] == 0, errors.is_empty(), "{errors} {cut:?}");
        }
    }
}
