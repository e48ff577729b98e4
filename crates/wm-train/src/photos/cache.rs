//! Things that are made when they are asked for, and kept while they fit.

use std::{
    collections::{BTreeMap, HashMap},
    hash::Hash,
    sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError},
};

/// Keeps what was used last, up to a number of bytes; the newest is kept however large it is.
///
/// Each thing is made by one thread at a time; others that ask for it wait.
pub(crate) struct Cache<K, T> {
    state: Mutex<State<K, T>>,
    changed: Condvar,
    budget: usize,
}

struct State<K, T> {
    slots: HashMap<K, Slot<T>>,
    /// Keys of what is ready, by when it was used.
    uses: BTreeMap<u64, K>,
    clock: u64,
    bytes: usize,
}

enum Slot<T> {
    Making,
    Ready { thing: Arc<T>, bytes: usize, used: u64 },
}

/// A value that knows how much memory it takes.
pub(crate) trait Weigh {
    /// Bytes.
    fn bytes(&self) -> usize;
}

/// A thing that this thread makes. Dropped without it, whoever waits tries for himself.
struct Claim<'a, K: Copy + Eq + Hash, T> {
    cache: &'a Cache<K, T>,
    key: K,
}

impl<K: Copy + Eq + Hash, T: Weigh> Cache<K, T> {
    pub(crate) fn new(budget: usize) -> Self {
        let state = State { slots: HashMap::new(), uses: BTreeMap::new(), clock: 0, bytes: 0 };
        Self { state: Mutex::new(state), changed: Condvar::new(), budget }
    }

    /// The thing of `key`, if it is there; it counts as used.
    pub(crate) fn peek(&self, key: K) -> Option<Arc<T>> {
        self.lock().used(key)
    }

    /// Returns true if the value of `key` exists or is being made.
    pub(crate) fn is_under_way(&self, key: K) -> bool {
        self.lock().slots.contains_key(&key)
    }

    /// Returns the memory of all values that are kept, bytes.
    #[cfg(test)]
    pub(crate) fn bytes(&self) -> usize {
        self.lock().bytes
    }

    /// The thing of `key`, made if it is not there.
    ///
    /// # Errors
    /// The errors of `make`; nothing is kept then.
    pub(crate) fn get<E>(&self, key: K, make: impl FnOnce() -> Result<T, E>) -> Result<Arc<T>, E> {
        let mut state = self.lock();
        loop {
            if let Some(thing) = state.used(key) {
                return Ok(thing);
            }
            if !state.slots.contains_key(&key) {
                break;
            }
            state = self.changed.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
        state.slots.insert(key, Slot::Making);
        drop(state);
        let claim = Claim { cache: self, key };
        let thing = Arc::new(make()?);
        self.lock().insert(key, &thing, self.budget);
        drop(claim);
        Ok(thing)
    }

    fn lock(&self) -> MutexGuard<'_, State<K, T>> {
        lock(&self.state)
    }
}

fn lock<S>(state: &Mutex<S>) -> MutexGuard<'_, S> {
    // Nothing panics while it holds the lock; if it did, the state is still whole.
    state.lock().unwrap_or_else(PoisonError::into_inner)
}

impl<K: Copy + Eq + Hash, T> Drop for Claim<'_, K, T> {
    fn drop(&mut self) {
        let mut state = lock(&self.cache.state);
        if matches!(state.slots.get(&self.key), Some(Slot::Making)) {
            state.slots.remove(&self.key);
        }
        drop(state);
        self.cache.changed.notify_all();
    }
}

impl<K: Copy + Eq + Hash, T: Weigh> State<K, T> {
    fn used(&mut self, key: K) -> Option<Arc<T>> {
        let Some(Slot::Ready { thing, used, .. }) = self.slots.get_mut(&key) else { return None };
        self.clock += 1;
        self.uses.remove(used);
        self.uses.insert(self.clock, key);
        *used = self.clock;
        Some(Arc::clone(thing))
    }

    fn insert(&mut self, key: K, thing: &Arc<T>, budget: usize) {
        self.clock += 1;
        let bytes = thing.bytes();
        self.bytes += bytes;
        self.uses.insert(self.clock, key);
        self.slots.insert(key, Slot::Ready { thing: Arc::clone(thing), bytes, used: self.clock });
        while self.bytes > budget && self.uses.len() > 1 {
            let Some((_, oldest)) = self.uses.pop_first() else { break };
            if let Some(Slot::Ready { bytes, .. }) = self.slots.remove(&oldest) {
                self.bytes -= bytes;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicU32, Ordering};

    impl Weigh for usize {
        fn bytes(&self) -> usize {
            *self
        }
    }

    #[test]
    fn what_was_used_last_stays() {
        let cache = Cache::<u32, usize>::new(100);
        let get = |key| *cache.get(key, || Ok::<_, ()>(40)).unwrap();
        get(1);
        get(2);
        assert_eq!(cache.bytes(), 80);
        get(1);
        get(3);
        assert!(cache.peek(1).is_some() && cache.peek(2).is_none() && cache.peek(3).is_some());
        assert_eq!(cache.bytes(), 80);
        assert_eq!(*cache.get(9, || Ok::<_, ()>(500)).unwrap(), 500);
        assert_eq!(cache.bytes(), 500);
        get(1);
        assert_eq!(cache.bytes(), 40);
    }

    #[test]
    fn errors_and_panics_leave_nothing_behind() {
        let cache = Cache::<u32, usize>::new(100);
        assert_eq!(cache.get(1, || Err("bad")), Err("bad"));
        let caught = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
            cache.get(1, || -> Result<usize, ()> { panic!("worse") })
        }));
        assert!(caught.is_err() && !cache.is_under_way(1));
        assert_eq!(cache.get(1, || Ok::<_, ()>(7)).as_deref(), Ok(&7));
    }

    #[test]
    fn a_thing_is_made_once() {
        let (cache, made) = (Cache::<u32, usize>::new(1000), AtomicU32::new(0));
        std::thread::scope(|scope| {
            for _ in 0..8 {
                scope.spawn(|| {
                    for key in 0..10 {
                        let thing = cache.get(key, || {
                            made.fetch_add(1, Ordering::Relaxed);
                            std::thread::sleep(std::time::Duration::from_millis(2));
                            Ok::<_, ()>(key as usize)
                        });
                        assert_eq!(*thing.unwrap(), key as usize);
                    }
                });
            }
        });
        assert_eq!(made.into_inner(), 10);
    }
}
