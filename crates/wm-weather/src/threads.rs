//! Work on several threads, with the same result for any number of them.

/// `work` of every number below `count`, in order.
pub fn map<T: Send>(count: usize, threads: usize, work: impl Fn(usize) -> T + Sync) -> Vec<T> {
    let each = count.div_ceil(threads.max(1)).max(1);
    let work = &work;
    std::thread::scope(|scope| {
        let parts: Vec<_> = (0..count)
            .step_by(each)
            .map(|first| scope.spawn(move || (first..count.min(first + each)).map(work).collect::<Vec<T>>()))
            .collect();
        parts.into_iter().flat_map(|part| part.join().expect("no work of a cover panics")).collect()
    })
}
