//! The Fourier transform of a square tile: radix 2, in place.

use rayon::prelude::*;
use std::f32::consts::TAU;
use std::sync::LazyLock;

/// Nodes along a side of a tile.
pub(crate) const TILE_SIDE_NODES: usize = 256;

/// A complex number.
pub(crate) type Complex = [f32; 2];

/// `exp(2 pi i k / TILE_SIDE_NODES)`.
static TURNS: LazyLock<Vec<Complex>> = LazyLock::new(|| {
    let turn = |k: usize| {
        let (sin, cos) = (TAU * k as f32 / TILE_SIDE_NODES as f32).sin_cos();
        [cos, sin]
    };
    (0..TILE_SIDE_NODES / 2).map(turn).collect()
});

/// The sums `sum_k X_k exp(2 pi i k n / TILE_SIDE_NODES)` of one row.
fn row(values: &mut [Complex; TILE_SIDE_NODES]) {
    let bits = TILE_SIDE_NODES.trailing_zeros();
    for i in 0..TILE_SIDE_NODES {
        let j = (i as u32).reverse_bits() as usize >> (32 - bits);
        if i < j {
            values.swap(i, j);
        }
    }
    let mut half = 1;
    while half < TILE_SIDE_NODES {
        let stride = TILE_SIDE_NODES / (2 * half);
        for block in values.chunks_exact_mut(2 * half) {
            let (low, high) = block.split_at_mut(half);
            for (k, (a, b)) in low.iter_mut().zip(high).enumerate() {
                let [c, s] = TURNS[k * stride];
                let turned = [b[0] * c - b[1] * s, b[0] * s + b[1] * c];
                *b = [a[0] - turned[0], a[1] - turned[1]];
                *a = [a[0] + turned[0], a[1] + turned[1]];
            }
        }
        half *= 2;
    }
}

/// The sums over both axes, `[TILE_SIDE_NODES, TILE_SIDE_NODES]`.
pub(crate) fn transform(values: &mut [Complex]) {
    let rows = |values: &mut [Complex]| {
        values.par_chunks_exact_mut(TILE_SIDE_NODES).for_each(|line| {
            row(line.as_chunks_mut::<TILE_SIDE_NODES>().0.first_mut().expect("a whole row"));
        });
    };
    rows(values);
    transpose(values);
    rows(values);
    transpose(values);
}

fn transpose(values: &mut [Complex]) {
    for y in 0..TILE_SIDE_NODES {
        for x in 0..y {
            values.swap(y * TILE_SIDE_NODES + x, x * TILE_SIDE_NODES + y);
        }
    }
}
