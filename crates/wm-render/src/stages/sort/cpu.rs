//! LSD radix sort of short lists that stay in the first cache.

/// Lists up to this length are sorted by comparison.
const MAX_COMPARISON_SORT_LENGTH: usize = 40;

/// Sorts `keys` ascending; `scratch` is grown as needed.
///
/// Byte passes over the highest bits in which the keys differ bring all but near ties in order; an
/// insertion pass over the whole key does the rest. Longer lists have more near ties, so they get
/// more passes.
pub fn sort(keys: &mut [u64], scratch: &mut Vec<u64>) {
    match keys.len() {
        n if n <= MAX_COMPARISON_SORT_LENGTH => {}
        n if n <= 2048 => radix::<2>(keys, scratch),
        n if n <= 16_384 => radix::<3>(keys, scratch),
        _ => radix::<5>(keys, scratch),
    }
    insertion(keys);
}

fn radix<const PASSES: usize>(keys: &mut [u64], scratch: &mut Vec<u64>) {
    let n = keys.len();
    let (mut low, mut high) = (u64::MAX, 0);
    for &key in keys.iter() {
        low = low.min(key);
        high = high.max(key);
    }
    let bits = 64 - (high - low).leading_zeros();
    let shift = bits.saturating_sub(8 * PASSES as u32);
    if scratch.len() < n {
        scratch.resize(n, 0);
    }
    let mut next = [[0u32; 256]; PASSES];
    for &key in keys.iter() {
        let digits = (key - low) >> shift;
        for (pass, counts) in next.iter_mut().enumerate() {
            counts[(digits >> (8 * pass) & 255) as usize] += 1;
        }
    }
    let (mut from, mut to) = (&mut *keys, &mut scratch[..n]);
    for (pass, slots) in next.iter_mut().enumerate() {
        let mut sum = 0;
        for slot in slots.iter_mut() {
            let count = *slot;
            *slot = sum;
            sum += count;
        }
        for &key in from.iter() {
            let slot = &mut slots[((key - low) >> shift >> (8 * pass) & 255) as usize];
            to[*slot as usize] = key;
            *slot += 1;
        }
        std::mem::swap(&mut from, &mut to);
    }
    if PASSES % 2 == 1 {
        keys.copy_from_slice(&scratch[..n]);
    }
}

fn insertion(keys: &mut [u64]) {
    for i in 1..keys.len() {
        let key = keys[i];
        let mut j = i;
        while j > 0 && keys[j - 1] > key {
            keys[j] = keys[j - 1];
            j -= 1;
        }
        keys[j] = key;
    }
}
