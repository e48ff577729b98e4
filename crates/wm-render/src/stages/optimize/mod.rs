//! One step of learning: splats move along their gradients.
//!
//! Contract, for the splats that a step has in view; others neither move nor forget:
//!
//! - Adam as published (Kingma and Ba 2014), with betas 0.9 and 0.999 and eps 1e-15:
//!   `m = b1 m + (1 - b1) g`, `v = b2 v + (1 - b2) g^2`,
//!   `x -= rate (m / (1 - b1^t)) / (sqrt(v / (1 - b2^t)) + eps)`. The bias correction goes by the
//!   step of training, t.
//! - [`SplatTerms`] add to the gradients what pulls on splats whatever a picture shows.
//! - The sky does not learn: nothing has a gradient there. It would learn what stands before it
//!   while that is still transparent, and keep it.
//! - [`DensifyStats`] grow by what the step pulled, and it is noted which step saw a splat last.
//!
//! On a GPU splats and moments stay where they learn
//! ([`Resident`](crate::differentiable::Resident)), and what explores by noise does so there
//! (`explore.wgsl`), by the same random numbers. Which splats come and go is decided by their
//! [`Shapes`], which are read back; the rest of them, nine tenths, is moved where it is
//! (`rearrange.wgsl`).
//!
//! Tolerance: some ulp of the step. Where a gradient is within its own error of 0 the first step
//! may go either way.

pub mod cpu;
#[cfg(feature = "gpu")]
pub mod gpu;
#[cfg(all(test, feature = "gpu"))]
pub(crate) mod tests;

use crate::gradients::Gradients;
use wm_scene::{Splats, sh};

/// Decay of the first moments.
pub(crate) const BETA1: f32 = 0.9;
/// Decay of the second moments.
pub(crate) const BETA2: f32 = 0.999;
/// The constant of Adam that keeps quotients finite.
pub(crate) const EPS: f32 = 1e-15;
/// Ratio of the shortest scale to the next that is flat enough.
pub(crate) const MAX_FLAT_RATIO: f32 = 0.1;

/// Step lengths of one step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rates {
    /// Learning rate of means, scene units.
    pub means: f64,
    /// Learning rate of quaternions.
    pub quats: f64,
    /// Learning rate of the logarithms of scales.
    pub log_scales: f64,
    /// Learning rate of the logits of opacities.
    pub logit_opacities: f64,
    /// Learning rate of the first SH coefficient.
    pub sh_dc: f64,
    /// Learning rate of the other SH coefficients.
    pub sh_rest: f64,
}

/// First and second moments of one parameter, flat like the parameter itself.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Pair {
    /// Mean of the gradient.
    pub first: Vec<f32>,
    /// Mean of its square.
    pub second: Vec<f32>,
}

/// Moments of all parameters, in the order of [`Moments::arrays`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Moments {
    /// `[N, 3]`.
    pub means: Pair,
    /// `[N, 4]`.
    pub quats: Pair,
    /// `[N, 3]`.
    pub log_scales: Pair,
    /// `[N]`.
    pub logit_opacities: Pair,
    /// `[N, K, 3]`.
    pub sh: Pair,
}

impl Moments {
    /// Zeros for `splats`.
    #[must_use]
    pub fn new(splats: &Splats) -> Self {
        let mut moments = Self::default();
        moments.resize(splats);
        moments
    }

    /// Each parameter's moments with the number of its values a splat.
    pub fn arrays(&mut self, sh_degree: u8) -> [(&mut Pair, usize); 5] {
        [
            (&mut self.means, 3),
            (&mut self.quats, 4),
            (&mut self.log_scales, 3),
            (&mut self.logit_opacities, 1),
            (&mut self.sh, 3 * sh::coefficients(sh_degree)),
        ]
    }

    /// Resizes to the number of rows of `splats`; new rows are zeros.
    pub fn resize(&mut self, splats: &Splats) {
        for (pair, width) in self.arrays(splats.sh_degree) {
            pair.first.resize(splats.len() * width, 0.0);
            pair.second.resize(splats.len() * width, 0.0);
        }
    }

    /// Sets the moments of one splat to 0.
    pub fn clear_row(&mut self, index: usize, sh_degree: u8) {
        for (pair, width) in self.arrays(sh_degree) {
            pair.first[index * width..(index + 1) * width].fill(0.0);
            pair.second[index * width..(index + 1) * width].fill(0.0);
        }
    }

    /// Keeps the rows `indices`, in that order.
    pub fn select(&mut self, indices: &[usize], sh_degree: u8) {
        for (pair, width) in self.arrays(sh_degree) {
            for array in [&mut pair.first, &mut pair.second] {
                let rows = indices.iter().flat_map(|i| &array[i * width..(i + 1) * width]);
                *array = rows.copied().collect();
            }
        }
    }
}

/// Statistics of screen-space gradients for densification; empty if no strategy needs them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DensifyStats {
    /// Sum of the lengths of screen-space gradients, in units of half a picture, `[N]`.
    pub sums: Vec<f32>,
    /// Steps that saw the splat, `[N]`.
    pub counts: Vec<f32>,
    /// Largest radius in a picture, px, `[N]`.
    pub radii: Vec<f32>,
}

impl DensifyStats {
    /// Zeros for `count` splats.
    #[must_use]
    pub fn new(count: usize) -> Self {
        Self { sums: vec![0.0; count], counts: vec![0.0; count], radii: vec![0.0; count] }
    }

    /// Adds one step's gradients, of a picture of `width` x `height` px.
    pub fn add(&mut self, gradients: &Gradients, width: u32, height: u32) {
        let half = [width as f32 / 2.0, height as f32 / 2.0];
        for (row, index) in gradients.visible.iter().enumerate() {
            let index = *index as usize;
            let [x, y] = gradients.means2d[row];
            self.sums[index] += (x * half[0]).hypot(y * half[1]);
            self.counts[index] += 1.0;
            self.radii[index] = self.radii[index].max(gradients.radii[row]);
        }
    }
}

/// Weights of the loss terms that depend on the splats alone: means over all splats, derived for
/// those in view.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SplatTerms {
    /// Weight of the mean opacity.
    pub opacity: f64,
    /// Weight of the mean scale.
    pub scale: f64,
    /// Weight of the mean of `min(1, s_1 / s_2 - r)` with the shortest scale, the next and the
    /// ratio r that is flat enough ([`MAX_FLAT_RATIO`]): the shortest gets shorter and the next
    /// longer. The sky has no share in it.
    pub flatness: f64,
}

/// One step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step {
    /// Number of the step, from 1.
    pub number: u32,
    /// Step lengths.
    pub rates: Rates,
    /// The loss terms beside the picture.
    pub terms: SplatTerms,
    /// Width and height of the picture, px.
    pub size: (u32, u32),
}

/// Noise by which splats that are nearly transparent explore.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Noise {
    /// The seed of its random numbers, three normal ones a splat: see
    /// [`wm_base::random::uniform`].
    pub seed: u64,
    /// Size of the noise, in units of a splat's variance.
    pub size: f64,
    /// Opacity above which a splat has no noise.
    pub most: f64,
}

/// Splats that learn and everything that is known of each, to be read.
#[derive(Clone, Copy, Debug)]
pub struct Learnt<'a> {
    /// The splats.
    pub splats: &'a Splats,
    /// The moments of the optimiser.
    pub moments: &'a Moments,
    /// The gradients that splats had.
    pub pulls: &'a DensifyStats,
    /// The last step that had each in view.
    pub seen: &'a [u32],
}

/// The numbers that decide which splats come and go, of splats that learn on a device: their shapes
/// and gradients.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Shapes {
    /// The splats with colours of degree 0: higher coefficients stay on the device, as moments do.
    pub splats: Splats,
    /// The gradients that splats had.
    pub pulls: DensifyStats,
    /// The last step that had each in view.
    pub seen: Vec<u32>,
}

/// The origin of a splat.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Origin {
    /// The splat before whose coefficients above degree 0 it has, below 2^31.
    pub row: u32,
    /// True if its moments are 0, and not those of that splat.
    pub forgotten: bool,
}

/// Splats that came of those on a device.
#[derive(Clone, Copy, Debug)]
pub struct Changed<'a> {
    /// Their values now, of degree 0.
    pub splats: &'a Splats,
    /// The gradients that splats had.
    pub pulls: &'a DensifyStats,
    /// The last step that had each in view.
    pub seen: &'a [u32],
    /// The origin of each.
    pub origins: &'a [Origin],
    /// True if the moments of all opacities are 0.
    pub forgets_opacities: bool,
}

/// As [`Learnt`], to be written: of as many splats.
#[derive(Debug)]
pub struct LearntMut<'a> {
    /// The splats.
    pub splats: &'a mut Splats,
    /// The moments of the optimiser.
    pub moments: &'a mut Moments,
    /// The gradients that splats had.
    pub pulls: &'a mut DensifyStats,
    /// The last step that had each in view.
    pub seen: &'a mut [u32],
}
