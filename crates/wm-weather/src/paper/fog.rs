//! Fog exactly as the paper has it: over finished pixels, in display-referred colour, by view z.
//!
//! `eq:style_intensity`: `alpha_style = min(1, 1 - exp(-I_style D_ref))`,
//! `D_ref = min(1, D_abs / d_max)`, with `D_abs` the sum of weight times view z. `eq:fog style`:
//! `C = C_fog alpha_style + C_render (1 - alpha_style)`. What no splat covers counts as `d_max`
//! away, as the paper's sky hemisphere does. Since `D_ref` ends at 1, the sky gets
//! `1 - exp(-I_style)`.
//!
//! A pixel at a silhouette has one mean depth here, which draws a bright rim; the physical fidelity
//! has none.

use wm_render::hooks::{PATCH_PIXELS, PixelBatch, PixelEffect};
use wm_render::simd::SimdPath;

/// The paper's fog at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct PaperFog {
    /// I_style.
    pub(crate) intensity: f64,
    /// C_fog, display-referred, 0-1.
    pub(crate) color: [f64; 3],
    /// Depth that counts as 1, scene units.
    pub(crate) d_max: f64,
}

impl PaperFog {
    /// alpha_style of a pixel with depth sum `depth` (scene units) and coverage `alpha`.
    fn alpha_style(&self, depth: f64, alpha: f64) -> f64 {
        let relative = ((depth + (1.0 - alpha) * self.d_max) / self.d_max).min(1.0);
        (1.0 - (-self.intensity * relative).exp()).min(1.0)
    }
}

impl PixelEffect for PaperFog {
    fn apply(&self, _: SimdPath, pixels: &mut PixelBatch<'_>) {
        for i in 0..PATCH_PIXELS {
            let alpha = self.alpha_style(f64::from(pixels.depth_sum[i]), f64::from(pixels.alpha[i]));
            for k in 0..3 {
                let color = f64::from(pixels.rgb[k][i]);
                pixels.rgb[k][i] = (self.color[k] * alpha + color * (1.0 - alpha)) as f32;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The printed equations, number by number.
    #[test]
    fn it_is_the_papers_equation() {
        let fog = PaperFog { intensity: 2.0, color: [0.8, 0.85, 0.9], d_max: 50.0 };
        let mut rgb = [[0.3f32; PATCH_PIXELS]; 3];
        let mut depth = [0.0f32; PATCH_PIXELS];
        let mut alpha = [1.0f32; PATCH_PIXELS];
        (depth[0], depth[1], depth[2]) = (20.0, 80.0, 0.0);
        alpha[2] = 0.0;
        let mut pixels = PixelBatch { x: 0, y: 0, rgb: &mut rgb, alpha: &alpha, depth_sum: &depth };
        fog.apply(SimdPath::select(wm_render::simd::SimdChoice::Auto).unwrap(), &mut pixels);
        for (i, relative) in [(0, 0.4f64), (1, 1.0), (2, 1.0), (3, 0.0)] {
            let style = 1.0 - (-2.0 * relative).exp();
            for k in 0..3 {
                let want = fog.color[k] * style + 0.3 * (1.0 - style);
                assert!((f64::from(rgb[k][i]) - want).abs() < 1e-6);
            }
        }
    }
}
