//! Rows of splats on all threads.

use super::{BETA1, BETA2, EPS, MAX_FLAT_RATIO, Moments, Pair, Rates, SplatTerms};
use crate::dispatch;
use crate::gradients::Gradients;
use crate::simd::SimdPath;
use rayon::prelude::*;
use wm_scene::{Group, Splats};

/// Rows of one task.
const ROWS_PER_TASK: usize = 2048;

/// Adds to the gradients what `terms` pull.
pub fn add_terms(splats: &Splats, terms: &SplatTerms, gradients: &mut Gradients) {
    let count = splats.len().max(1) as f64;
    let (per_splat, flatness) = (1.0 / count, (terms.flatness / count) as f32);
    for (row, index) in gradients.visible.iter().enumerate() {
        let index = *index as usize;
        if flatness != 0.0 && splats.groups[index] != Group::Sky {
            let scales = splats.log_scales[index];
            let mut order = [0, 1, 2];
            // As the renderer: of equal ones the first is the shortest.
            order.sort_by(|a, b| scales[*a].total_cmp(&scales[*b]));
            let ratio = (scales[order[0]] - scales[order[1]]).exp();
            if ratio > MAX_FLAT_RATIO {
                gradients.log_scales[row][order[0]] += flatness * ratio;
                gradients.log_scales[row][order[1]] -= flatness * ratio;
            }
        }
        if terms.opacity != 0.0 {
            let opacity = splats.opacity(index);
            gradients.logit_opacities[row] += (terms.opacity * per_splat * opacity * (1.0 - opacity)) as f32;
        }
        if terms.scale != 0.0 {
            for (gradient, scale) in gradients.log_scales[row].iter_mut().zip(splats.scales(index)) {
                *gradient += (terms.scale * per_splat / 3.0 * scale) as f32;
            }
        }
    }
}

/// Takes the gradients of the sky, which does not learn.
pub fn hold_sky(splats: &Splats, gradients: &mut Gradients) {
    let stride = gradients.sh_stride();
    for (row, index) in gradients.visible.iter().enumerate() {
        if splats.groups[*index as usize] == Group::Sky {
            gradients.means[row] = [0.0; 3];
            gradients.quats[row] = [0.0; 4];
            gradients.log_scales[row] = [0.0; 3];
            gradients.logit_opacities[row] = 0.0;
            gradients.sh[row * stride..(row + 1) * stride].fill(0.0);
        }
    }
}

/// A run of rows: arrays from row `first` on.
struct Piece<'a> {
    first: usize,
    visible: &'a [u32],
    gradients: &'a [f32],
    parameters: &'a mut [f32],
    moments: [&'a mut [f32]; 2],
}

/// Takes step number `step` (from 1) along `gradients`. Arrays of gradients that are empty do not
/// learn.
pub fn step(
    path: SimdPath,
    splats: &mut Splats,
    moments: &mut Moments,
    gradients: &Gradients,
    rates: &Rates,
    step: u32,
) {
    let mut sh_rates = vec![rates.sh_rest as f32; gradients.sh_stride()];
    sh_rates[..3].fill(rates.sh_dc as f32);
    let corrections = [BETA1, BETA2].map(|beta| (1.0 - f64::from(beta).powf(f64::from(step))) as f32);
    let (visible, count) = (&gradients.visible[..], splats.len());
    let update = |parameters: &mut [f32], pair: &mut Pair, gradients: &[f32], rates: &[f32]| {
        if !gradients.is_empty() {
            update(path, parameters, pair, count, visible, gradients, rates, corrections);
        }
    };
    let Gradients { means, quats, log_scales, logit_opacities, sh, .. } = gradients;
    let [of_means, of_quats] = [rates.means as f32, rates.quats as f32];
    let [of_scales, of_opacities] = [rates.log_scales as f32, rates.logit_opacities as f32];
    update(splats.means.as_flattened_mut(), &mut moments.means, means.as_flattened(), &[of_means; 3]);
    update(splats.quats.as_flattened_mut(), &mut moments.quats, quats.as_flattened(), &[of_quats; 4]);
    let (parameters, pair) = (splats.log_scales.as_flattened_mut(), &mut moments.log_scales);
    update(parameters, pair, log_scales.as_flattened(), &[of_scales; 3]);
    update(&mut splats.logit_opacities, &mut moments.logit_opacities, logit_opacities, &[of_opacities]);
    update(&mut splats.sh, &mut moments.sh, sh, &sh_rates);
}

/// Takes a step along the gradients of one parameter of `count` splats. `rates` has the step length
/// of each value of a row of gradients.
#[allow(clippy::too_many_arguments, reason = "one caller; a struct would only repeat the names")]
fn update(
    path: SimdPath,
    mut parameters: &mut [f32],
    pair: &mut Pair,
    count: usize,
    visible: &[u32],
    gradients: &[f32],
    rates: &[f32],
    corrections: [f32; 2],
) {
    let (mut first, mut second) = (&mut pair.first[..], &mut pair.second[..]);
    // Values per splat in the parameters and in the moments.
    let width = parameters.len() / count.max(1);
    let row = rates.len();
    let mut pieces = Vec::with_capacity(visible.len().div_ceil(ROWS_PER_TASK));
    let mut begun = 0;
    // Indices ascend, so that each run of them has rows of its own.
    for (visible, gradients) in visible.chunks(ROWS_PER_TASK).zip(gradients.chunks(ROWS_PER_TASK * row)) {
        let end = visible[visible.len() - 1] as usize + 1;
        let size = (end - begun) * width;
        let own = parameters.split_at_mut(size);
        let own_first = first.split_at_mut(size);
        let own_second = second.split_at_mut(size);
        pieces.push(Piece {
            first: begun,
            visible,
            gradients,
            parameters: own.0,
            moments: [own_first.0, own_second.0],
        });
        (parameters, first, second, begun) = (own.1, own_first.1, own_second.1, end);
    }
    pieces.into_par_iter().for_each(|piece| {
        dispatch!(path, _simd => piece.run(width, rates, corrections[0], corrections[1]));
    });
}

impl Piece<'_> {
    #[inline(always)]
    fn run(self, width: usize, rates: &[f32], correction1: f32, correction2: f32) {
        let [first, second] = self.moments;
        let row = rates.len();
        for (index, gradient) in self.visible.iter().zip(self.gradients.chunks_exact(row)) {
            let at = (*index as usize - self.first) * width;
            let rows =
                (&mut first[at..at + row], &mut second[at..at + row], &mut self.parameters[at..at + row]);
            for i in 0..row {
                let g = gradient[i];
                let m = BETA1 * rows.0[i] + (1.0 - BETA1) * g;
                let v = BETA2 * rows.1[i] + (1.0 - BETA2) * g * g;
                rows.0[i] = m;
                rows.1[i] = v;
                rows.2[i] -= rates[i] * (m / correction1) / ((v / correction2).sqrt() + EPS);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use wm_base::random::uniform;

    fn splats(count: usize) -> Splats {
        let mut splats = Splats::with_capacity(count, 1);
        for i in 0..count {
            splats.means.push([i as f32; 3]);
            splats.quats.push([1.0, 0.0, 0.0, 0.0]);
            splats.log_scales.push([-1.0; 3]);
            splats.logit_opacities.push(0.5);
            splats.sh.extend([0.25; 12]);
            splats.groups.push(Group::Scene);
        }
        splats
    }

    /// The textbook's formula in f64 for one value, several steps long.
    #[test]
    fn steps_are_those_of_the_textbook_and_spare_what_is_out_of_view() {
        let rates =
            Rates { means: 0.1, quats: 0.0, log_scales: 0.0, logit_opacities: 0.2, sh_dc: 0.3, sh_rest: 0.4 };
        for path in SimdPath::available() {
            let mut splats = splats(5000);
            let before = splats.clone();
            let mut moments = Moments::new(&splats);
            let visible: Vec<u32> = (0..5000).filter(|i| i % 3 == 1).collect();
            let pull = |i: u32, step: u32| uniform(9, u64::from(i) * 16 + u64::from(step)) as f32 - 0.3;
            for now in 1..=3 {
                let gradients = Gradients {
                    means: visible.iter().map(|i| [pull(*i, now); 3]).collect(),
                    sh: visible.iter().flat_map(|i| [pull(*i, now); 12]).collect(),
                    sh_degree: 1,
                    visible: visible.clone(),
                    ..Gradients::default()
                };
                step(path, &mut splats, &mut moments, &gradients, &rates, now);
            }
            for i in [0u32, 1, 2, 3, 4, 4996, 4999] {
                let (mut m, mut v, mut moved) = (0.0f64, 0.0f64, 0.0f64);
                if i % 3 == 1 {
                    for now in 1..=3 {
                        let g = f64::from(pull(i, now));
                        (m, v) = (0.9 * m + 0.1 * g, 0.999 * v + 0.001 * g * g);
                        let (first, second) =
                            (m / (1.0 - 0.9f64.powi(now as i32)), v / (1.0 - 0.999f64.powi(now as i32)));
                        moved -= first / second.sqrt();
                    }
                }
                let i = i as usize;
                let sh = f64::from(splats.sh[12 * i] - before.sh[12 * i]);
                let rest = f64::from(splats.sh[12 * i + 11] - before.sh[12 * i + 11]);
                assert!((f64::from(splats.means[i][1] - before.means[i][1]) - 0.1 * moved).abs() < 1e-3);
                assert!((sh - 0.3 * moved).abs() < 1e-5 && (rest - 0.4 * moved).abs() < 1e-5);
            }
            assert_eq!(splats.logit_opacities, before.logit_opacities);
        }
    }

    #[test]
    fn moments_follow_their_splats() {
        let mut moments = Moments::new(&splats(3));
        moments.quats.first = (0..12u8).map(f32::from).collect();
        moments.select(&[2, 0], 1);
        assert_eq!(moments.quats.first, [8.0, 9.0, 10.0, 11.0, 0.0, 1.0, 2.0, 3.0]);
        moments.clear_row(0, 1);
        assert_eq!(moments.quats.first[..5], [0.0, 0.0, 0.0, 0.0, 0.0]);
        assert_eq!(moments.sh.second.len(), 24);
    }

    #[test]
    fn the_shortest_axis_is_made_shorter_and_kept() {
        let mut splats = crate::testing::random_splats(3, 0, 4);
        splats.log_scales = vec![[0.0, -0.1, 0.5], [-3.0, 0.0, 0.0], [0.0, -0.1, 0.5]];
        splats.groups[2] = Group::Sky;
        let mut gradients = Gradients { visible: vec![0, 1, 2], ..Gradients::default() };
        gradients.log_scales = vec![[0.0; 3]; 3];
        add_terms(&splats, &SplatTerms { flatness: 3.0, ..SplatTerms::default() }, &mut gradients);
        let ratio = (-0.1f32).exp();
        assert_eq!(gradients.log_scales, [[-ratio, ratio, 0.0], [0.0; 3], [0.0; 3]]);
    }
}
