//! Work on the threads of the current pool, with the same result for any number of them.

use rayon::prelude::*;

/// `work` of every number below `count`, in order.
pub(crate) fn map<T: Send>(count: usize, work: impl Fn(usize) -> T + Sync + Send) -> Vec<T> {
    (0..count).into_par_iter().map(work).collect()
}
