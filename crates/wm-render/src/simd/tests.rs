use super::*;
use fearless_simd::{Fallback, Simd, SimdBase, f32x8};

/// Defines functions that map a slice, a vector at a time.
macro_rules! maps {
    ($($name:ident => |$simd:ident, $x:ident| $value:expr;)*) => {$(
        #[inline(always)]
        fn $name<S: Lanes>($simd: S, values: &mut [f32]) {
            for chunk in values.chunks_exact_mut(S::N) {
                let $x = S::F::from_slice($simd, chunk);
                $value.store_slice(chunk);
            }
        }
    )*};
}

maps! {
    map_exp2 => |simd, x| exp2(simd, [x])[0];
    map_log2 => |simd, x| log2(simd, [x])[0];
    map_powf => |simd, x| powf(simd, [x], 2.4)[0];
    map_reciprocal => |simd, x| reciprocal(simd, [x])[0];
    // Each channel has its own values.
    map_decode_rough => |simd, x| srgb_decode_rough(simd, [simd.set(0.1), x, simd.set(0.0)])[1];
    map_encode_rough => |simd, x| srgb_encode_rough(simd, [simd.set(0.1), x, simd.set(0.0)])[1];
}

/// Checks a function on all paths: `$holds` is to be true for each value and result, in f64.
macro_rules! check {
    ($map:ident, $values:expr, |$x:ident, $y:ident| $holds:expr) => {
        for path in SimdPath::available() {
            let values: Vec<f32> = $values;
            let mut results = values.clone();
            dispatch!(path, s => $map(s, &mut results));
            for (x, y) in values.iter().zip(&results) {
                let ($x, $y) = (f64::from(*x), f64::from(*y));
                assert!($holds, "{path}: {} of {x} is {y}", stringify!($map));
            }
        }
    };
}

fn grid(from: f32, to: f32) -> Vec<f32> {
    (0..4096).map(|i| from + (to - from) * i as f32 / 4095.0).collect()
}

#[test]
fn functions_are_as_exact_as_they_say() {
    check!(map_exp2, grid(-30.0, 4.0), |x, y| (y / x.exp2() - 1.0).abs() < 3e-7);
    let magnitudes = || grid(-90.0, 90.0).iter().map(|e| e.exp2()).chain(grid(0.5, 2.0)).collect();
    check!(map_log2, magnitudes(), |x, y| (y - x.log2()).abs() < 2e-7 * x.log2().abs().max(1.0));
    check!(map_powf, grid(0.0, 3.0), |x, y| {
        if x == 0.0 { y == 0.0 } else { (y - x.powf(2.4)).abs() < 2e-6 * x.powf(2.4) + 1e-12 }
    });
    check!(map_reciprocal, [grid(0.009, 1.0), grid(1.0, 1e6)].concat(), |x, y| (y * x - 1.0).abs() < 4e-7);
}

#[inline(always)]
fn map_exp2_unfused<S: Simd>(simd: S, values: &mut [f32]) {
    for chunk in values.chunks_exact_mut(8) {
        exp2_unfused(simd, f32x8::from_slice(simd, chunk)).store_slice(chunk);
    }
}

#[test]
fn exp2_without_fused_multiplication_has_the_same_bytes_on_all_paths() {
    let x = grid(-30.0, 4.0);
    let evaluate = |path: SimdPath| {
        let mut y = x.clone();
        dispatch!(path, s => map_exp2_unfused(s, &mut y));
        y
    };
    let first = evaluate(SimdPath::widest());
    for (x, y) in x.iter().zip(&first) {
        assert!((f64::from(*y) / f64::from(*x).exp2() - 1.0).abs() < 5e-7, "2^{x} = {y}");
    }
    for path in SimdPath::available() {
        let bits = |values: &[f32]| values.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(&evaluate(path)), bits(&first), "{path}");
    }
}

#[test]
fn rough_colors_are_within_a_twentieth_of_a_step_of_8_bits() {
    use wm_base::color::srgb_encode as encode;
    // Linear light has one curve from 0 to some light 50 times as bright as white.
    let light = || [grid(0.0, 0.05), grid(0.0, 1.4), grid(1.0, 50.0)].concat();
    check!(map_encode_rough, light(), |x, y| (y - encode(x)).abs() < 2e-4 * encode(x).max(1.0));
    check!(map_decode_rough, [grid(0.0, 0.1), grid(0.0, 2.5)].concat(), |x, y| (encode(y) - x).abs() < 2e-4);
}

#[inline(always)]
fn row_sums<S: Lanes>(simd: S, rows: &[[f32; 16]; 16], out: &mut [f32; 16]) {
    if S::N == 16 {
        let mut vectors = [simd.set(0.0); 16];
        for k in 0..16 {
            vectors[k] = simd.load(&rows[k]);
        }
        sums::<S, 16>(simd, vectors).store_slice(out);
    } else {
        for half in 0..2 {
            let mut vectors = [simd.set(0.0); 8];
            for k in 0..8 {
                vectors[k] = simd.load(&rows[8 * half + k]) + simd.load(&rows[8 * half + k][8..]);
            }
            sums::<S, 8>(simd, vectors).store_slice(&mut out[8 * half..8 * half + 8]);
        }
    }
}

#[test]
fn rows_are_summed_and_turned() {
    let matrix: [[f32; 16]; 16] = std::array::from_fn(|i| std::array::from_fn(|j| (i * i + 3 * j) as f32));
    for path in SimdPath::available() {
        let mut out = [0.0; 16];
        dispatch!(path, s => row_sums(s, &matrix, &mut out));
        assert!((0..16).all(|i| out[i] == matrix[i].iter().sum::<f32>()), "{path}: {out:?}");
        let mut turned = matrix;
        dispatch!(path, s => transpose(s, &mut turned));
        assert!((0..16).all(|i| (0..16).all(|j| turned[i][j] == matrix[j][i])), "{path}");
    }
}

#[cfg(target_arch = "x86_64")]
#[test]
fn the_portable_path_has_the_bytes_of_plain_rust() {
    let plain = Fallback::new();
    let SimdPath::Portable(portable) = SimdPath::portable() else { unreachable!() };
    let x: Vec<f32> = [grid(0.0, 0.05), grid(-3.0, 3.0), grid(-30.0, 30.0)].concat();
    macro_rules! same {
        ($($map:ident of $x:expr;)*) => {$(
            let x: Vec<f32> = $x;
            let (mut a, mut b) = (x.clone(), x.clone());
            $map(plain, &mut a);
            $map(portable, &mut b);
            for ((x, a), b) in x.iter().zip(&a).zip(&b) {
                assert_eq!(a.to_bits(), b.to_bits(), "{} of {x}: {a} and {b}", stringify!($map));
            }
        )*};
    }
    let positive: Vec<f32> = x.iter().map(|x| x.abs().max(1e-6)).collect();
    same! {
        map_exp2 of x.clone();
        map_exp2_unfused of x;
        map_log2 of positive.clone();
        map_powf of positive.clone();
        map_decode_rough of positive.clone();
        map_encode_rough of positive.clone();
        map_reciprocal of positive;
    }
    let matrix: [[f32; 16]; 16] =
        std::array::from_fn(|i| std::array::from_fn(|j| (i as f32 - 3.3) * (j as f32 + 0.7)));
    let (mut a, mut b) = ([0.0; 16], [0.0; 16]);
    row_sums(plain, &matrix, &mut a);
    row_sums(portable, &matrix, &mut b);
    assert_eq!(a.map(f32::to_bits), b.map(f32::to_bits));
}

#[test]
fn names_round_trip() {
    for choice in SimdChoice::ALL {
        assert_eq!(choice.name().parse::<SimdChoice>(), Ok(choice));
    }
    assert!("avx3".parse::<SimdChoice>().is_err());
    assert!(SimdPath::select(SimdChoice::Portable).is_some());
}
