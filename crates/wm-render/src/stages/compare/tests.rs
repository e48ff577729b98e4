//! Held against the formulas in f64, and against their finite differences.

use super::*;
use crate::differentiable::{ForwardConfig, Resident};
use crate::frame::Frame;
use crate::stages::optimize::tests::LearntState;
use crate::testing::{Backend, camera, gpu_differentiable, random_splats};
use wm_base::random::uniform;

/// Two by two tiles, none of them whole.
const SIZE: (usize, usize) = (29, 21);
const PIXELS: usize = SIZE.0 * SIZE.1;

/// A photo in f64, what is rendered of it, and weights.
struct Case {
    rendered: Vec<f64>,
    photo: Vec<f64>,
    mask: Vec<f64>,
    exposure: [f64; 12],
    weights: [f64; 2],
}

impl Case {
    /// Returns the colours of the pixels in the exposure of the photo.
    fn exposed(&self) -> Vec<f64> {
        let of = |rgb: &[f64]| {
            let rgb = [rgb[0], rgb[1], rgb[2], 1.0];
            [0, 1, 2].map(|row| (0..4).map(|k| self.exposure[4 * row + k] * rgb[k]).sum::<f64>())
        };
        self.rendered.chunks(3).flat_map(of).collect()
    }

    fn l1(&self) -> f64 {
        let offs = self.exposed().into_iter().zip(&self.photo).enumerate();
        let sum: f64 = offs.map(|(i, (x, y))| self.mask[i / 3] * (x - y).abs()).sum();
        sum / (3.0 * self.mask.iter().sum::<f64>())
    }

    fn dssim(&self) -> f64 {
        let within =
            |rgb: &[f64]| -> Vec<f64> { rgb.iter().enumerate().map(|(i, v)| v * self.mask[i / 3]).collect() };
        let (x, y) = (within(&self.exposed()), within(&self.photo));
        let reach = WINDOW_RADIUS_PX as isize;
        let (width, height) = (SIZE.0 as isize, SIZE.1 as isize);
        let mut sum = 0.0;
        for at in 0..3 * PIXELS {
            let (row, column) = ((at / 3 / SIZE.0) as isize, (at / 3 % SIZE.0) as isize);
            let mut means = [0.0f64; 5];
            for dy in -reach..=reach {
                for dx in -reach..=reach {
                    let (row, column) = (row + dy, column + dx);
                    if (0..height).contains(&row) && (0..width).contains(&column) {
                        let near = 3 * (row * width + column) as usize + at % 3;
                        let tap = |d: isize| f64::from(WINDOW_WEIGHTS[(d + reach) as usize]);
                        let (x, y) = (x[near], y[near]);
                        let products = [x, y, x * x, y * y, x * y];
                        means.iter_mut().zip(products).for_each(|(m, v)| *m += tap(dy) * tap(dx) * v);
                    }
                }
            }
            let [mx, my, xx, yy, xy] = means;
            let (c1, c2) = (f64::from(C1), f64::from(C2));
            sum += (2.0 * mx * my + c1) * (2.0 * (xy - mx * my) + c2)
                / ((mx * mx + my * my + c1) * (xx - mx * mx + yy - my * my + c2));
        }
        1.0 - sum / (3 * PIXELS) as f64
    }

    fn loss(&self) -> f64 {
        self.weights[0] * self.l1() + self.weights[1] * self.dssim()
    }

    /// The slope of the loss by one of the numbers.
    fn slope(&mut self, which: impl Fn(&mut Self) -> &mut f64) -> f64 {
        const STEP: f64 = 1e-6;
        *which(self) += STEP;
        let more = self.loss();
        *which(self) -= 2.0 * STEP;
        let less = self.loss();
        *which(self) += STEP;
        (more - less) / (2.0 * STEP)
    }
}

fn check(mask: Option<&[f32]>, exposure: Exposure, weights: [f64; 2]) {
    let mut gpu = gpu_differentiable();
    let kept = LearntState::new(random_splats(300, 1, 5));
    gpu.load(kept.learnt()).unwrap();
    let camera = camera(SIZE.0 as u32, SIZE.1 as u32);
    let config = ForwardConfig { sh_degree: 1, background: [0.1, 0.2, 0.3], ..ForwardConfig::default() };
    let mut frame = Frame::default();
    Resident::forward(&mut gpu, &camera, &config, &mut frame).unwrap();
    // As it is kept. It is noise, whose similarity is nowhere a small difference of large numbers.
    let fraction = |i: usize| (65_535.0 * uniform(8, i as u64)).round() / 65_535.0;
    let photo: Vec<f64> = (0..3 * PIXELS).map(fraction).collect();
    let rgb: Vec<f32> = photo.iter().map(|v| *v as f32).collect();
    let mut case = Case {
        rendered: frame.rgb.iter().map(|v| f64::from(*v)).collect(),
        photo,
        mask: mask.map_or(vec![1.0; PIXELS], |mask| mask.iter().map(|v| f64::from(*v)).collect()),
        exposure: exposure.map(f64::from),
        weights,
    };
    let by_colors: Vec<(usize, f64)> =
        (0..3 * PIXELS).step_by(17).map(|i| (i, case.slope(|case| &mut case.rendered[i]))).collect();
    let by_exposure: Vec<f64> = (0..12).map(|k| case.slope(|case| &mut case.exposure[k])).collect();
    // Twice: the second photo is one that was kept.
    for _ in 0..2 {
        let mut comparison = Comparison { photo: 3, rgb: &rgb, mask, exposure, ..Comparison::default() };
        comparison.weights[..2].copy_from_slice(&weights);
        let (_, found) = gpu.compare(&camera, &config, &comparison).unwrap();
        for (found, wanted) in found.values.into_iter().zip([case.l1(), case.dssim()]) {
            assert!((found - wanted).abs() < 1e-5, "{found} instead of {wanted}");
        }
        let derived = gpu.upstream().unwrap();
        let (mut off, mut all) = (0.0, 0.0);
        for (i, wanted) in &by_colors {
            off += (f64::from(derived[*i]) - wanted).powi(2);
            all += wanted * wanted;
        }
        let relative = (off / all).sqrt();
        eprintln!("derivative by colours off by {relative:.1e}");
        assert!(relative < 1e-5, "{relative:.1e}");
        let largest = found.by_exposure.iter().fold(0.0, |a: f64, b| a.max(b.abs()));
        for (found, wanted) in found.by_exposure.into_iter().zip(&by_exposure) {
            assert!((found - wanted).abs() < 1e-5 * largest, "{found} instead of {wanted}");
        }
    }
}

#[test]
fn colours_are_compared_as_by_the_formulas() {
    let Some(_) = Backend::gpu() else { return };
    let exposure = [0.9, 0.05, 0.0, 0.02, -0.03, 1.1, 0.04, -0.05, 0.0, 0.1, 0.8, 0.03];
    let mask: Vec<f32> = (0..PIXELS).map(|i| if i % SIZE.0 < 20 && i > 70 { 1.0 } else { 0.0 }).collect();
    check(None, NO_EXPOSURE, [0.8, 0.2]);
    check(Some(&mask), exposure, [0.3, 0.7]);
}
