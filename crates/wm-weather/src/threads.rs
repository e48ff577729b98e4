//! Work on several threads, with the same result for any number of them.

use std::sync::atomic::{AtomicUsize, Ordering};

/// Parts of the work for each thread, since some parts take longer than others.
const PARTS: usize = 16;

/// `work` of every number below `count`, in order.
pub(crate) fn map<T: Send>(count: usize, threads: usize, work: impl Fn(usize) -> T + Sync) -> Vec<T> {
    let threads = threads.min(count);
    if threads <= 1 {
        return (0..count).map(work).collect();
    }
    let each = count.div_ceil(threads * PARTS);
    let next = AtomicUsize::new(0);
    let run = || {
        let mut done = Vec::new();
        loop {
            let first = each * next.fetch_add(1, Ordering::Relaxed);
            if first >= count {
                return done;
            }
            done.push((first, (first..count.min(first + each)).map(&work).collect::<Vec<T>>()));
        }
    };
    let mut parts = std::thread::scope(|scope| {
        let others: Vec<_> = (1..threads).map(|_| scope.spawn(run)).collect();
        let mut parts = run();
        others.into_iter().for_each(|other| parts.extend(other.join().expect("no work of a cover panics")));
        parts
    });
    parts.sort_unstable_by_key(|(first, _)| *first);
    let mut all = Vec::with_capacity(count);
    parts.into_iter().for_each(|(_, part)| all.extend(part));
    all
}
