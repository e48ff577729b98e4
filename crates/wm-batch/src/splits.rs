//! The parts of a set, such as `train` and `val`: a clip belongs to one by its number alone.

use super::plan::BatchPlan;
use wm_base::random::uniform;

/// Clips that are counted together: a clip of a part is found within one such run.
const RUN_CLIPS: u64 = 1024;

/// The index of the part of the set that a clip belongs to, into [`BatchPlan::splits`].
pub(crate) fn split_of(plan: &BatchPlan, clip: u64) -> usize {
    part_of(plan.seed, plan.splits.iter().map(|(_, share)| *share), clip)
}

fn part_of(seed: u64, shares: impl ExactSizeIterator<Item = f64>, clip: u64) -> usize {
    let mut at = uniform(seed ^ 0x5eed_5917, clip);
    let last = shares.len().saturating_sub(1);
    for (index, share) in shares.enumerate() {
        if at < share {
            return index;
        }
        at -= share;
    }
    last
}

/// The clips of one part of a set, in their order. Each is found without a list of the others, in
/// microseconds; a million clips take 8 KB.
#[derive(Clone, Debug)]
pub struct SplitClips {
    seed: u64,
    shares: Vec<f64>,
    split: usize,
    clips: u64,
    /// The number of the part's clips before each run of clips, and of all of them.
    before: Vec<u64>,
}

impl SplitClips {
    /// Counts the clips of part `split`, an index into the plan's, of a set of `clips` clips.
    #[must_use]
    pub fn count(plan: &BatchPlan, split: usize, clips: u64) -> Self {
        let shares = plan.splits.iter().map(|(_, share)| *share).collect();
        let mut own = Self { seed: plan.seed, shares, split, clips, before: vec![0] };
        for run in 0..clips.div_ceil(RUN_CLIPS) {
            own.before.push(own.len() + own.run(run).count() as u64);
        }
        own
    }

    /// The clips of the part in a run of clips.
    fn run(&self, run: u64) -> impl Iterator<Item = u64> {
        let first = run * RUN_CLIPS;
        let is_own = |clip: &u64| part_of(self.seed, self.shares.iter().copied(), *clip) == self.split;
        (first..(first + RUN_CLIPS).min(self.clips)).filter(is_own)
    }

    /// The number of clips.
    #[must_use]
    pub fn len(&self) -> u64 {
        self.before.last().copied().unwrap_or_default()
    }

    /// Returns true if no clip belongs to the part.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The clip at a place among those of the part; `None` past the last.
    #[must_use]
    pub fn get(&self, index: u64) -> Option<u64> {
        let run = self.before.partition_point(|before| *before <= index).checked_sub(1)?;
        self.run(run as u64).nth((index - self.before[run]) as usize)
    }
}
