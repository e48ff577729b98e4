//! Gradients by the parameters of splats.

use wm_scene::sh;

/// The parameters that learn; gradients of the others are neither computed nor filled.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Learn {
    /// Centres.
    pub means: bool,
    /// Orientations.
    pub quats: bool,
    /// Scales.
    pub log_scales: bool,
    /// Opacities; nothing to learn where they are [`Opacity::Fixed`](crate::differentiable::Opacity::Fixed).
    pub logit_opacities: bool,
    /// Colours.
    pub sh: bool,
}

impl Learn {
    /// Everything.
    pub const ALL: Self =
        Self { means: true, quats: true, log_scales: true, logit_opacities: true, sh: true };
    /// Nothing.
    pub const NONE: Self =
        Self { means: false, quats: false, log_scales: false, logit_opacities: false, sh: false };
    /// Centres alone.
    pub const MEANS: Self = Self { means: true, ..Self::NONE };
    /// Opacities alone.
    pub const OPACITIES: Self = Self { logit_opacities: true, ..Self::NONE };
}

impl Default for Learn {
    fn default() -> Self {
        Self::ALL
    }
}

/// The gradients of one view: V rows, one for each splat in view. Arrays of parameters that do not
/// learn are empty. All memory is re-used from step to step.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Gradients {
    /// Index of each splat in view, ascending, `[V]`.
    pub visible: Vec<u32>,
    /// By `means`, `[V, 3]`.
    pub(crate) means: Vec<[f32; 3]>,
    /// By `quats` as they are stored, of any length, `[V, 4]`.
    pub(crate) quats: Vec<[f32; 4]>,
    /// By `log_scales`, `[V, 3]`.
    pub(crate) log_scales: Vec<[f32; 3]>,
    /// By `logit_opacities`, `[V]`.
    pub(crate) logit_opacities: Vec<f32>,
    /// By the first `(sh_degree + 1)^2` coefficients of `sh`, `[V, K, 3]` flat; the others have
    /// none.
    pub sh: Vec<f32>,
    /// Degree of `sh`: the one in use.
    pub(crate) sh_degree: u8,
    /// By the centre in the picture, px, `[V, 2]`.
    pub(crate) means2d: Vec<[f32; 2]>,
    /// Like `means2d`, but a sum over pixels of absolute values, so that opposite pulls do not
    /// cancel (AbsGS), `[V, 2]`.
    pub(crate) absgrads: Vec<[f32; 2]>,
    /// Sum of the splat's weights over the picture, px, `[V]`.
    pub weights: Vec<f32>,
    /// Three standard deviations along the longest axis in the picture, px, `[V]`.
    pub(crate) radii: Vec<f32>,
}

impl Gradients {
    /// Values of `sh` a row: 3 K.
    pub(crate) fn sh_stride(&self) -> usize {
        3 * sh::coefficients(self.sh_degree)
    }

    /// Adds the parameters' gradients of another loss on the same view. What this one has no row
    /// for is left out: its picture does not show it.
    ///
    /// # Panics
    /// If the other has a parameter that this one has not, or another degree of colours.
    pub fn add_parameters(&mut self, other: &Self) {
        assert!(other.sh.is_empty() || other.sh_degree == self.sh_degree, "colours of one degree");
        let stride = self.sh_stride();
        let mut row = 0;
        for (theirs, index) in other.visible.iter().enumerate() {
            row += self.visible[row..].partition_point(|own| own < index);
            match self.visible.get(row) {
                None => break,
                Some(own) if own != index => continue,
                Some(_) => {}
            }
            add_row(&mut self.means, row, &other.means, theirs);
            add_row(&mut self.quats, row, &other.quats, theirs);
            add_row(&mut self.log_scales, row, &other.log_scales, theirs);
            if let Some(value) = other.logit_opacities.get(theirs) {
                self.logit_opacities[row] += value;
            }
            if !other.sh.is_empty() {
                let (own, their) = (row * stride..(row + 1) * stride, theirs * stride..(theirs + 1) * stride);
                self.sh[own].iter_mut().zip(&other.sh[their]).for_each(|(a, b)| *a += b);
            }
        }
    }

    /// Sets the sizes for `visible` rows.
    pub(crate) fn resize(&mut self, visible: usize, learn: Learn, sh_degree: u8) {
        let rows = |wanted: bool| if wanted { visible } else { 0 };
        self.sh_degree = sh_degree;
        self.visible.resize(visible, 0);
        self.means.resize(rows(learn.means), [0.0; 3]);
        self.quats.resize(rows(learn.quats), [0.0; 4]);
        self.log_scales.resize(rows(learn.log_scales), [0.0; 3]);
        self.logit_opacities.resize(rows(learn.logit_opacities), 0.0);
        self.sh.resize(rows(learn.sh) * self.sh_stride(), 0.0);
        self.means2d.resize(visible, [0.0; 2]);
        self.absgrads.resize(visible, [0.0; 2]);
        self.weights.resize(visible, 0.0);
        self.radii.resize(visible, 0.0);
    }
}

/// Adds a row, if it learns there.
fn add_row<const N: usize>(to: &mut [[f32; N]], row: usize, from: &[[f32; N]], theirs: usize) {
    if let Some(from) = from.get(theirs) {
        to[row].iter_mut().zip(from).for_each(|(a, b)| *a += b);
    }
}
