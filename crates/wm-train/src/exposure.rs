//! Photos that are brighter, darker or of another white than the scene.
//!
//! Each photo has an affine colour transform, `rgb' = M rgb + b`, that starts as the identity and
//! is trained with the scene. It is applied to the render before the comparison; the scene does
//! not contain it. The mean over all photos is held at the identity, or scene and photos could
//! drift in brightness: the change of one photo is subtracted from all in equal parts.

use rayon::prelude::*;
use wm_render::dispatch;
use wm_render::simd::SimdPath;
use wm_render::training::{Exposure, NO_EXPOSURE};

/// Values of one transform: the rows of M, each followed by its b.
pub(crate) const TRANSFORM_VALUES: usize = NO_EXPOSURE.len();

/// The colour transforms of all photos.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Exposures {
    /// `[P]`.
    pub(crate) changes: Vec<Exposure>,
    /// The optimiser's moments: means of gradients and of their squares.
    pub(crate) moments: Vec<[[f32; TRANSFORM_VALUES]; 2]>,
    /// The number of steps that each photo has learnt.
    pub(crate) steps: Vec<u32>,
}

impl Exposures {
    /// Returns identity transforms for `photos` photos.
    pub(crate) fn new(photos: usize) -> Self {
        Self {
            changes: vec![NO_EXPOSURE; photos],
            moments: vec![[[0.0; TRANSFORM_VALUES]; 2]; photos],
            steps: vec![0; photos],
        }
    }

    /// Returns transforms that multiply red, green and blue by gains, whose mean over the photos
    /// should be 1.
    pub(crate) fn with_gains(gains: &[[f32; 3]]) -> Self {
        let mut exposures = Self::new(gains.len());
        for (change, gain) in exposures.changes.iter_mut().zip(gains) {
            (0..3).for_each(|c| change[5 * c] = gain[c]);
        }
        exposures
    }

    /// Returns the transform of photo `photo`.
    pub(crate) fn of(&self, photo: usize) -> Exposure {
        self.changes.get(photo).copied().unwrap_or(NO_EXPOSURE)
    }

    /// Applies the transform of photo `photo` to colours, `[H, W, 3]`.
    pub(crate) fn apply(&self, path: SimdPath, photo: usize, rgb: &[f32], out: &mut [f32]) {
        let m = &self.changes[photo];
        let mix = Mix::new(|row, column| m[4 * row + column], |row| m[4 * row + 3]);
        out.par_chunks_mut(VALUES_PER_TASK).zip(rgb.par_chunks(VALUES_PER_TASK)).for_each(|(out, rgb)| {
            dispatch!(path, _simd => mix.apply(rgb, out));
        });
    }

    /// Converts the gradient by transformed colours to that by rendered ones, in place, and takes
    /// one Adam step for the photo.
    pub(crate) fn learn(
        &mut self,
        path: SimdPath,
        photo: usize,
        rgb: &[f32],
        gradient: &mut [f32],
        rate: f64,
    ) {
        let m = &self.changes[photo];
        let back = Mix::new(|row, column| m[4 * column + row], |_| 0.0);
        let parts: Vec<[f64; TRANSFORM_VALUES]> = gradient
            .par_chunks_mut(VALUES_PER_TASK)
            .zip(rgb.par_chunks(VALUES_PER_TASK))
            .map(|(gradient, rgb)| dispatch!(path, _simd => back.apply_transpose(rgb, gradient)))
            .collect();
        let mut total = [0.0; TRANSFORM_VALUES];
        for part in parts {
            for (total, part) in total.iter_mut().zip(part) {
                *total += part;
            }
        }
        self.step(photo, &total, rate);
    }

    /// Takes one Adam step for the photo, along the gradient by its transform.
    pub(crate) fn step(&mut self, photo: usize, gradient: &[f64; TRANSFORM_VALUES], rate: f64) {
        self.steps[photo] += 1;
        let corrections = [0.9f64, 0.999].map(|beta| 1.0 - beta.powi(self.steps[photo].min(100_000) as i32));
        let [first, second] = &mut self.moments[photo];
        for k in 0..TRANSFORM_VALUES {
            let g = gradient[k];
            let (m, v) = (0.9 * f64::from(first[k]) + 0.1 * g, 0.999 * f64::from(second[k]) + 0.001 * g * g);
            (first[k], second[k]) = (m as f32, v as f32);
            let moved = rate * (m / corrections[0]) / ((v / corrections[1]).sqrt() + 1e-15);
            self.changes[photo][k] -= moved as f32;
            let back = (moved / self.changes.len() as f64) as f32;
            self.changes.iter_mut().for_each(|change| change[k] += back);
        }
    }
}

/// Values per task.
const VALUES_PER_TASK: usize = 256 * VALUES_PER_BLOCK;
/// Values per block: 16 pixels, a multiple of the vector width of every SIMD path.
const VALUES_PER_BLOCK: usize = 48;
/// Offsets at which values are mixed: up to two values to each side.
const SHIFT_COUNT: usize = 5;

/// A change of colour for interleaved values: by how much each value's neighbours come into it, 0
/// for those of other pixels. Plain loops over a block, of which the compiler makes vectors.
struct Mix {
    shares: [[f32; VALUES_PER_BLOCK]; SHIFT_COUNT],
    offsets: [f32; VALUES_PER_BLOCK],
}

/// A block between zeros, short ones filled up with zeros.
#[inline(always)]
fn padded(values: &[f32]) -> [f32; VALUES_PER_BLOCK + SHIFT_COUNT - 1] {
    let mut padded = [0.0; VALUES_PER_BLOCK + SHIFT_COUNT - 1];
    padded[2..2 + values.len()].copy_from_slice(values);
    padded
}

impl Mix {
    fn new(matrix: impl Fn(usize, usize) -> f32, offset: impl Fn(usize) -> f32) -> Self {
        let mut mix =
            Self { shares: [[0.0; VALUES_PER_BLOCK]; SHIFT_COUNT], offsets: [0.0; VALUES_PER_BLOCK] };
        for i in 0..VALUES_PER_BLOCK {
            let row = i % 3;
            mix.offsets[i] = offset(row);
            for column in 0..3 {
                mix.shares[2 + column - row][i] = matrix(row, column);
            }
        }
        mix
    }

    #[inline(always)]
    fn of_block(&self, values: &[f32; VALUES_PER_BLOCK + SHIFT_COUNT - 1]) -> [f32; VALUES_PER_BLOCK] {
        let mut mixed = self.offsets;
        for (shift, shares) in self.shares.iter().enumerate() {
            for i in 0..VALUES_PER_BLOCK {
                mixed[i] += shares[i] * values[i + shift];
            }
        }
        mixed
    }

    #[inline(always)]
    fn apply(&self, rgb: &[f32], out: &mut [f32]) {
        for (out, rgb) in out.chunks_mut(VALUES_PER_BLOCK).zip(rgb.chunks(VALUES_PER_BLOCK)) {
            out.copy_from_slice(&self.of_block(&padded(rgb))[..out.len()]);
        }
    }

    /// Applies the transpose to a gradient in place; returns the derivatives by the values of the
    /// transform.
    #[inline(always)]
    fn apply_transpose(&self, rgb: &[f32], gradient: &mut [f32]) -> [f64; TRANSFORM_VALUES] {
        let mut products = [[0.0f32; VALUES_PER_BLOCK]; SHIFT_COUNT];
        let mut sums = [0.0f32; VALUES_PER_BLOCK];
        for (gradient, rgb) in gradient.chunks_mut(VALUES_PER_BLOCK).zip(rgb.chunks(VALUES_PER_BLOCK)) {
            let (by, rgb) = (padded(gradient), padded(rgb));
            for (shift, products) in products.iter_mut().enumerate() {
                for i in 0..VALUES_PER_BLOCK {
                    products[i] += by[i + 2] * rgb[i + shift];
                }
            }
            for i in 0..VALUES_PER_BLOCK {
                sums[i] += by[i + 2];
            }
            gradient.copy_from_slice(&self.of_block(&by)[..gradient.len()]);
        }
        let mut pulls = [0.0; TRANSFORM_VALUES];
        for i in 0..VALUES_PER_BLOCK {
            let row = i % 3;
            pulls[4 * row + 3] += f64::from(sums[i]);
            for column in 0..3 {
                pulls[4 * row + column] += f64::from(products[2 + column - row][i]);
            }
        }
        pulls
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use wm_base::random::uniform;

    /// One of two photos is brighter and bluer than the scene, and the other darker by as much.
    #[test]
    fn a_change_of_colour_is_learnt() {
        let rgb: Vec<f32> = (0..3000).map(|i| uniform(1, i) as f32).collect();
        let photo = |by: f32| -> Vec<f32> {
            let changed = |c: &[f32]| {
                [(1.0 + by) * c[0], (1.0 + by) * c[1] + 0.1 * by, (1.0 + 0.7 * by) * c[2] + 0.3 * by]
            };
            rgb.chunks(3).flat_map(changed).collect()
        };
        let photos = [photo(-0.3), photo(0.3)];
        let mut exposures = Exposures::new(2);
        let mut out = vec![0.0; rgb.len()];
        let mut off = [1.0; 2];
        for step in 0..1600 {
            let place = step as usize % 2;
            exposures.apply(SimdPath::available()[0], place, &rgb, &mut out);
            let mut gradient: Vec<f32> = out.iter().zip(&photos[place]).map(|(a, b)| a - b).collect();
            off[place] = gradient.iter().fold(0.0, |a: f32, b| a.max(b.abs()));
            exposures.learn(
                SimdPath::available()[0],
                place,
                &rgb,
                &mut gradient,
                0.01 * 0.9975f64.powi(step),
            );
        }
        assert!(off[0] < 0.01 && off[1] < 0.01, "{off:?}");
        for k in 0..TRANSFORM_VALUES {
            assert!((exposures.changes[0][k] + exposures.changes[1][k] - 2.0 * NO_EXPOSURE[k]).abs() < 1e-4);
        }
    }

    /// Against the definition, of a size that is no whole number of blocks nor of tasks.
    #[test]
    fn the_gradient_goes_through_the_change() {
        let pixels = VALUES_PER_TASK / 3 + 21;
        let m: [f32; TRANSFORM_VALUES] = std::array::from_fn(|k| k as f32 - 4.5);
        let value =
            |seed: u64| -> Vec<f32> { (0..3 * pixels).map(|i| uniform(seed, i as u64) as f32).collect() };
        let (rgb, by) = (value(3), value(4));
        for path in SimdPath::available() {
            let mut exposures = Exposures::new(1);
            exposures.changes[0] = m;
            let mut out = vec![0.0; rgb.len()];
            exposures.apply(path, 0, &rgb, &mut out);
            let mut gradient = by.clone();
            exposures.learn(path, 0, &rgb, &mut gradient, 0.0);
            let mut pulls = [0.0; TRANSFORM_VALUES];
            for pixel in 0..pixels {
                let (c, g) = (&rgb[3 * pixel..][..3], &by[3 * pixel..][..3]);
                for row in 0..3 {
                    let changed: f32 = (0..3).map(|k| m[4 * row + k] * c[k]).sum::<f32>() + m[4 * row + 3];
                    let back: f32 = (0..3).map(|k| m[4 * k + row] * g[k]).sum();
                    assert!((out[3 * pixel + row] - changed).abs() < 1e-4, "{path}");
                    assert!((gradient[3 * pixel + row] - back).abs() < 1e-4, "{path}");
                    (0..3).for_each(|k| pulls[4 * row + k] += f64::from(g[row] * c[k]));
                    pulls[4 * row + 3] += f64::from(g[row]);
                }
            }
            // What Adam remembers of the first step is a tenth of the gradient.
            for (first, pull) in exposures.moments[0][0].iter().zip(pulls) {
                assert!((f64::from(*first) / (0.1 * pull) - 1.0).abs() < 1e-5, "{path}: {first} {pull}");
            }
        }
    }
}
