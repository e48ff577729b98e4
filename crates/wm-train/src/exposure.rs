//! Photos that are brighter, darker or of another white than the scene.
//!
//! Each photo has an affine change of colour, `rgb' = M rgb + b`, that begins as none at all and learns with
//! the scene. It is applied to what is rendered before that is compared; the scene is without it.

use rayon::prelude::*;
use wm_render::dispatch;
use wm_render::simd::SimdPath;

/// Numbers of one change: the rows of M, each with its b behind it.
pub const NUMBERS: usize = 12;
/// No change.
const NONE: [f32; NUMBERS] = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0];

/// The changes of all photos.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Exposures {
    /// `[P]`.
    pub changes: Vec<[f32; NUMBERS]>,
    /// What the optimiser remembers: means of gradients and of their squares.
    pub moments: Vec<[[f32; NUMBERS]; 2]>,
    /// How often each photo has learnt.
    pub steps: Vec<u32>,
}

impl Exposures {
    /// No change for `photos`.
    #[must_use]
    pub fn new(photos: usize) -> Self {
        Self {
            changes: vec![NONE; photos],
            moments: vec![[[0.0; NUMBERS]; 2]; photos],
            steps: vec![0; photos],
        }
    }

    /// Colours as photo `photo` would have them, `[H, W, 3]`.
    pub fn apply(&self, path: SimdPath, photo: usize, rgb: &[f32], out: &mut [f32]) {
        let m = &self.changes[photo];
        out.par_chunks_mut(3 * 4096).zip(rgb.par_chunks(3 * 4096)).for_each(|(out, rgb)| {
            dispatch!(path, _simd => change(m, rgb, out));
        });
    }

    /// From the derivative by the changed colours to that by the rendered ones, in place, and one step of
    /// Adam for the photo.
    pub fn learn(&mut self, photo: usize, rgb: &[f32], gradient: &mut [f32], rate: f64) {
        let m = self.changes[photo];
        let parts: Vec<[f64; NUMBERS]> = gradient
            .par_chunks_mut(3 * 4096)
            .zip(rgb.par_chunks(3 * 4096))
            .map(|(gradient, rgb)| pull(&m, rgb, gradient))
            .collect();
        let mut total = [0.0; NUMBERS];
        for part in parts {
            for (total, part) in total.iter_mut().zip(part) {
                *total += part;
            }
        }
        self.steps[photo] += 1;
        let corrections = [0.9f64, 0.999].map(|beta| 1.0 - beta.powi(self.steps[photo].min(100_000) as i32));
        let [first, second] = &mut self.moments[photo];
        for k in 0..NUMBERS {
            let g = total[k];
            let (m, v) = (0.9 * f64::from(first[k]) + 0.1 * g, 0.999 * f64::from(second[k]) + 0.001 * g * g);
            (first[k], second[k]) = (m as f32, v as f32);
            let moved = rate * (m / corrections[0]) / ((v / corrections[1]).sqrt() + 1e-15);
            self.changes[photo][k] -= moved as f32;
        }
    }
}

#[inline(always)]
fn change(m: &[f32; NUMBERS], rgb: &[f32], out: &mut [f32]) {
    for (out, rgb) in out.as_chunks_mut::<3>().0.iter_mut().zip(rgb.as_chunks::<3>().0) {
        for (row, out) in out.iter_mut().enumerate() {
            *out = m[4 * row] * rgb[0] + m[4 * row + 1] * rgb[1] + m[4 * row + 2] * rgb[2] + m[4 * row + 3];
        }
    }
}

fn pull(m: &[f32; NUMBERS], rgb: &[f32], gradient: &mut [f32]) -> [f64; NUMBERS] {
    let mut sums = [0.0f64; NUMBERS];
    for (gradient, rgb) in gradient.as_chunks_mut::<3>().0.iter_mut().zip(rgb.as_chunks::<3>().0) {
        let by = *gradient;
        for row in 0..3 {
            for column in 0..3 {
                sums[4 * row + column] += f64::from(by[row] * rgb[column]);
            }
            sums[4 * row + 3] += f64::from(by[row]);
        }
        *gradient = std::array::from_fn(|column| (0..3).map(|row| m[4 * row + column] * by[row]).sum());
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::*;
    use wm_scene::synthetic::uniform;

    /// A photo that is a third brighter and bluer is found again.
    #[test]
    fn a_change_of_colour_is_learnt() {
        let rgb: Vec<f32> = (0..3000).map(|i| uniform(1, i) as f32).collect();
        let photo: Vec<f32> =
            rgb.chunks(3).flat_map(|c| [1.3 * c[0], 1.3 * c[1] + 0.02, 1.2 * c[2] + 0.1]).collect();
        let mut exposures = Exposures::new(2);
        let mut out = vec![0.0; rgb.len()];
        for step in 0..800 {
            exposures.apply(SimdPath::available()[0], 1, &rgb, &mut out);
            let mut gradient: Vec<f32> = out.iter().zip(&photo).map(|(a, b)| a - b).collect();
            exposures.learn(1, &rgb, &mut gradient, 0.01 * 0.995f64.powi(step));
        }
        let off = out.iter().zip(&photo).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(off < 0.01, "{off}");
        assert_eq!(exposures.changes[0], NONE);
    }

    #[test]
    fn the_gradient_goes_through_the_change() {
        let mut exposures = Exposures::new(1);
        exposures.changes[0] = std::array::from_fn(|k| k as f32);
        let mut gradient = [1.0, 10.0, 100.0];
        exposures.learn(0, &[0.5; 3], &mut gradient, 0.0);
        assert_eq!(gradient, [0.0 + 40.0 + 800.0, 1.0 + 50.0 + 900.0, 2.0 + 60.0 + 1000.0]);
    }
}
