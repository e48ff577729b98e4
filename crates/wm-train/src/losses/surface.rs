//! Coverage: surfaces cover their pixels completely, and nothing covers pixels of the sky.
//!
//! `mean max(|A - S| - 0.05, 0)` with the coverage A by all splats but the sky's, from a render of
//! its own, and S, 1 where the prior has the place and 0 where it has the sky. Only opacities learn
//! from it: shapes would be blown up over gaps that no splat covers yet. On the border between sky
//! and place, which the prior leaves unknown and which is finer in the photo, S is the position of
//! the photo's colour between those of the sky and the place beside it; other unknown pixels do not
//! count. Without this term the sky is painted on splats in front of it, which fog lights up, and
//! shines through walls.

use super::term::{LossGradients, LossInput, LossTerm, OwnRender, TrainPhoto};
use crate::priors::{Prior, SkyClass};
use wm_render::training::{COVERAGE_TOLERANCE, Term};
use wm_render::{Channels, DepthAlpha, DrawnSplats, Learn, Opacity};

/// The term `surface`.
#[derive(Clone, Debug)]
pub(crate) struct SurfaceTerm {
    /// The weight at all steps together.
    pub(crate) weight: f64,
    /// Steps between two that count.
    pub(crate) every: u32,
}

impl LossTerm for SurfaceTerm {
    fn name(&self) -> &'static str {
        "surface"
    }

    fn weight(&self, step: u32, truth: &TrainPhoto<'_>) -> f64 {
        let is_on = step.is_multiple_of(self.every) && truth.prior.is_some_and(|prior| !prior.sky.is_empty());
        // The weight makes up for the steps in between.
        if is_on { self.weight * f64::from(self.every) } else { 0.0 }
    }

    fn own_render(&self) -> Option<OwnRender> {
        Some(OwnRender {
            channels: Channels::Depth,
            opacity: Opacity::Stored,
            drawn: DrawnSplats::WithoutSky,
            learn: Learn::OPACITIES,
            depth_alpha: DepthAlpha::Detached,
        })
    }

    fn on_device(&self) -> Option<Term> {
        Some(Term::Coverage)
    }

    fn add(&mut self, input: &LossInput<'_>, weight: f64, out: &mut LossGradients) -> f64 {
        let (Some(prior), alpha) = (input.truth.prior, &input.frame.alpha) else { return 0.0 };
        let mut sum = 0.0;
        let scale = (weight / alpha.len() as f64) as f32;
        shares(input.truth, prior, |at, wanted| {
            let off = alpha[at] - wanted;
            let beyond = off.abs() - COVERAGE_TOLERANCE;
            if beyond > 0.0 {
                sum += f64::from(beyond);
                out.alpha[at] += if off > 0.0 { scale } else { -scale };
            }
        });
        sum / alpha.len() as f64
    }
}

/// Calls `give` with each pixel of the photo that counts and its S.
pub(crate) fn shares(truth: &TrainPhoto<'_>, prior: &Prior, mut give: impl FnMut(usize, f32)) {
    let (width, height) = (truth.camera.width as usize, truth.camera.height as usize);
    let colors = cell_colors(truth, prior);
    let mut mattes = vec![Matte::Unasked; prior.sky.len()];
    for y in 0..height {
        let row = y * prior.height as usize / height * prior.width as usize;
        for x in 0..width {
            let (at, cell) = (y * width + x, row + x * prior.width as usize / width);
            let wanted = if prior.sky[cell] == SkyClass::Place {
                1.0
            } else {
                if mattes[cell] == Matte::Unasked {
                    mattes[cell] = Matte::beside(prior, &colors, cell);
                }
                let rgb = [0, 1, 2].map(|c| truth.rgb[3 * at + c]);
                let Some(share) = mattes[cell].share(rgb) else { continue };
                share
            };
            if truth.mask.is_none_or(|mask| mask[at] != 0.0) {
                give(at, wanted);
            }
        }
    }
}

/// The colours of sky and place beside a cell of the prior that is not of the place.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Matte {
    Unasked,
    /// One of them is missing, or they look the same.
    Neither,
    /// A cell of the sky, and its colour.
    Sky([f32; 3]),
    /// The colour of the sky, and the difference of the place's colour from it.
    Between([f32; 3], [f32; 3]),
}

/// The distance up to which neighbours of a cell count, cells of the prior: the width of a border.
const BORDER_CELLS: usize = 2;
/// Least distance of the colours of sky and place, and the largest distance of a pixel's colour
/// from the line between them, as a fraction of that distance.
const MIN_COLOR_DISTANCE: f32 = 0.12;
const MAX_LINE_DISTANCE: f32 = 0.5;

impl Matte {
    /// Sums over the neighbours of `cell`; `colors` are those of [`cell_colors`].
    fn beside(prior: &Prior, colors: &[[f32; 3]], cell: usize) -> Self {
        let (width, height) = (prior.width as usize, prior.height as usize);
        let (u, v) = (cell % width, cell / width);
        let (mut sums, mut counts) = ([[0.0f32; 3]; 2], [0.0f32; 2]);
        for v in v.saturating_sub(BORDER_CELLS)..(v + BORDER_CELLS + 1).min(height) {
            for u in u.saturating_sub(BORDER_CELLS)..(u + BORDER_CELLS + 1).min(width) {
                let side = match prior.sky[v * width + u] {
                    SkyClass::Sky => 0,
                    SkyClass::Place => 1,
                    SkyClass::Unknown => continue,
                };
                counts[side] += 1.0;
                let color = colors[v * width + u];
                sums[side].iter_mut().zip(color).for_each(|(sum, value)| *sum += value);
            }
        }
        let [sky, place] = [0, 1].map(|side| sums[side].map(|sum| sum / counts[side]));
        if prior.sky[cell] == SkyClass::Sky {
            return Self::Sky(sky);
        }
        let way = [0, 1, 2].map(|c| place[c] - sky[c]);
        // If one of them is missing the distance is NaN, and the comparison false.
        if dot(way, way) > MIN_COLOR_DISTANCE * MIN_COLOR_DISTANCE {
            Self::Between(sky, way)
        } else {
            Self::Neither
        }
    }

    /// Returns the place's share of a colour, 0-1; `None` if the colour is neither of the two nor
    /// between them, such as that of a wire in front of the sky that is finer than the prior.
    fn share(&self, rgb: [f32; 3]) -> Option<f32> {
        let (sky, way) = match *self {
            Self::Sky(sky) => (sky, None),
            Self::Between(sky, way) => (sky, Some(way)),
            Self::Unasked | Self::Neither => return None,
        };
        let from = [0, 1, 2].map(|c| rgb[c] - sky[c]);
        let Some(way) = way else {
            return (dot(from, from) < MIN_COLOR_DISTANCE * MIN_COLOR_DISTANCE).then_some(0.0);
        };
        let share = dot(from, way) / dot(way, way);
        let rest = [0, 1, 2].map(|c| from[c] - share * way[c]);
        (dot(rest, rest) < MAX_LINE_DISTANCE * MAX_LINE_DISTANCE * dot(way, way))
            .then_some(share.clamp(0.0, 1.0))
    }
}

fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Returns the photo's colour at the centre of each cell of the prior, `[H, W]` of the prior.
fn cell_colors(truth: &TrainPhoto<'_>, prior: &Prior) -> Vec<[f32; 3]> {
    let (width, height) = truth.size();
    let middle = |i: usize, cells: u32, pixels: u32| (2 * i + 1) * pixels as usize / (2 * cells as usize);
    let cells = 0..prior.width as usize * prior.height as usize;
    let color = |cell: usize| {
        let x = middle(cell % prior.width as usize, prior.width, width);
        let y = middle(cell / prior.width as usize, prior.height, height);
        let at = y * width as usize + x;
        [0, 1, 2].map(|c| truth.rgb[3 * at + c])
    };
    cells.map(color).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::losses::LossInput;
    use glam::DVec3;
    use wm_render::Frame;
    use wm_render::simd::SimdPath;
    use wm_scene::Camera;

    /// Twice as fine as the prior: blue sky over a brown roof whose edge lies within the prior's
    /// border.
    #[test]
    fn border_and_wires_are_as_fine_as_the_photo() {
        let (width, height) = (8u32, 16u32);
        let (sky, roof) = ([0.4, 0.6, 0.9], [0.5, 0.3, 0.2]);
        let color = |y: u32| match y {
            0 => [0.1; 3],
            1..7 => sky,
            // Half and half.
            7 => [0.45, 0.45, 0.55],
            8 => [0.1, 0.9, 0.1],
            _ => roof,
        };
        let rgb: Vec<f32> = (0..height).flat_map(|y| (0..width).flat_map(move |_| color(y))).collect();
        let class = |v: u32| match v {
            0..3 => SkyClass::Sky,
            3..5 => SkyClass::Unknown,
            _ => SkyClass::Place,
        };
        let classes = (0..8).flat_map(|v| [class(v); 4]).collect();
        let prior = Prior { width: 4, height: 8, sky: classes, ..Prior::default() };
        let alpha = vec![0.25; (width * height) as usize];
        let frame = Frame { width, height, alpha, ..Frame::default() };
        let camera = Camera::looking((width, height), 50.0, DVec3::ZERO, DVec3::Y, DVec3::Z).unwrap();
        let truth = TrainPhoto { rgb: &rgb, mask: None, camera: &camera, prior: Some(&prior) };
        let input = LossInput { frame: &frame, truth: &truth, step: 0, path: SimdPath::available()[0] };
        let mut out = LossGradients::default();
        out.clear(&frame);
        let value = SurfaceTerm { weight: 1.0, every: 1 }.add(&input, 128.0, &mut out);
        // A wire, six rows of sky, half a pixel, one that is neither, seven of roof.
        let beyond = |off: f64| off - f64::from(COVERAGE_TOLERANCE);
        let wanted = (7.0 * beyond(0.25) + 7.0 * beyond(0.75)) / 16.0;
        assert!((value - wanted).abs() < 1e-6, "{value} {wanted}");
        let column: Vec<f32> = out.alpha.iter().step_by(8).copied().collect();
        assert_eq!(column[0], 0.0);
        assert_eq!(column[1..7], [1.0; 6]);
        assert_eq!(column[7..9], [-1.0, 0.0]);
        assert_eq!(column[9..], [-1.0; 7]);
    }
}
