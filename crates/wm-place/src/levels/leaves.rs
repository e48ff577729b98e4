//! The leaves of a scene in levels: parts of space with about as many splats each.

use wm_scene::Splats;

/// Splits splats, by their indices, into leaves of at most `most` splats and at most `longest`
/// units to a side between their means.
///
/// Each is halved across its longest side: at the middle splat, or where only the size is too
/// large, in the middle.
pub(crate) fn leaves(splats: &Splats, indices: Vec<u32>, most: usize, longest: f64) -> Vec<Vec<u32>> {
    let (mut done, mut open) = (Vec::new(), vec![indices]);
    while let Some(mut leaf) = open.pop() {
        let (low, high) = bounds(splats, &leaf);
        let side = |k: usize| f64::from(high[k]) - f64::from(low[k]);
        let axis = (0..3).rev().max_by(|a, b| side(*a).total_cmp(&side(*b))).unwrap_or(0);
        if leaf.len() <= most.max(1) && (side(axis) <= longest || leaf.len() < 2) {
            if !leaf.is_empty() {
                done.push(leaf);
            }
            continue;
        }
        let key = |index: &u32| splats.means[*index as usize][axis];
        let other = if leaf.len() > most.max(1) {
            let half = leaf.len() / 2;
            leaf.select_nth_unstable_by(half, |a, b| key(a).total_cmp(&key(b)).then(a.cmp(b)));
            let other = leaf.split_off(half);
            // Selection leaves no order of its own: what comes out must not hang on the order that
            // went in.
            leaf.sort_unstable();
            other
        } else {
            let middle = (0.5 * (f64::from(low[axis]) + f64::from(high[axis]))) as f32;
            let (first, second) = leaf.into_iter().partition(|index| key(index) <= middle);
            leaf = first;
            second
        };
        if leaf.is_empty() || other.is_empty() {
            // Nothing between two neighbouring numbers.
            done.push(if leaf.is_empty() { other } else { leaf });
            continue;
        }
        // The stack gives the first half first.
        open.push(other);
        open.push(leaf);
    }
    done.iter_mut().for_each(|leaf| leaf.sort_unstable());
    done
}

/// The box of the means.
pub(crate) fn bounds(splats: &Splats, indices: &[u32]) -> ([f32; 3], [f32; 3]) {
    let empty = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    indices.iter().fold(empty, |(low, high), index| {
        let mean = splats.means[*index as usize];
        (std::array::from_fn(|k| low[k].min(mean[k])), std::array::from_fn(|k| high[k].max(mean[k])))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_splat_is_in_one_leaf_that_is_small_enough() {
        let mut splats = Splats::zeroed(1000, 0);
        for (index, mean) in splats.means.iter_mut().enumerate() {
            let turn = index as f32 * 0.7;
            *mean = [turn.cos() * index as f32, turn.sin() * 20.0, 3.0];
        }
        for (most, longest) in [(64, f64::INFINITY), (400, 30.0), (1, 1.0)] {
            let all: Vec<u32> = (0..1000).collect();
            let parts = leaves(&splats, all.clone(), most, longest);
            let mut found = parts.concat();
            found.sort_unstable();
            assert_eq!(found, all);
            for leaf in parts {
                let (low, high) = bounds(&splats, &leaf);
                let side = (0..3).map(|k| f64::from(high[k] - low[k])).fold(0.0, f64::max);
                assert!(leaf.len() <= most && side <= longest, "{} {side}", leaf.len());
            }
        }
    }

    #[test]
    fn splats_in_one_place_end_it() {
        let splats = Splats::zeroed(100, 0);
        let parts = leaves(&splats, (0..100).collect(), 30, 0.0);
        assert_eq!(parts.iter().map(Vec::len).sum::<usize>(), 100);
        assert!(parts.iter().all(|leaf| leaf.len() <= 30));
    }
}
