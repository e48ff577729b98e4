//! The light on the ground, read from the scene itself, so that snow in the shade is dark.

use super::ground::GroundGrid;
use crate::threads::map;
use wm_base::color::{luminance, srgb_decode};
use wm_scene::Splats;

/// Rounds of averaging over neighbouring cells: dark paint is not shade.
const AVERAGING_ROUND_COUNT: usize = 6;

impl GroundGrid {
    /// Finds how lit each node is, 0 in the shade to 1 in the open: by the sky that it sees, and by
    /// how bright the scene is about it beside what is as open.
    pub(super) fn find_shades(&mut self, splats: &Splats) {
        let mut light = self.light(splats);
        for _ in 0..AVERAGING_ROUND_COUNT {
            light = map(self.len(), |node| {
                let [light] = self.mean_about(node, |other| (!light[other].is_nan()).then(|| [light[other]]));
                light
            });
        }
        let in_the_open = light.iter().zip(&self.open).filter(|(v, open)| !v.is_nan() && **open > 0.9);
        let mut known: Vec<f32> = in_the_open.map(|(v, _)| *v).collect();
        let rank = known.len() * 3 / 5;
        let bright =
            if known.is_empty() { 1.0 } else { *known.select_nth_unstable_by(rank, f32::total_cmp).1 };
        let bright = bright.max(1e-3);
        let lit = |light: f32| {
            if light.is_nan() { 1.0 } else { (light / bright).clamp(0.0, 1.0).powf(0.35) }
        };
        let surfaces = light.iter().zip(&self.open);
        self.shade = surfaces.map(|(light, open)| lit(*light) * (0.35 + 0.65 * open)).collect();
    }

    /// The luminance of the splats that make up each surface, linear; not a number where none
    /// tells.
    fn light(&self, splats: &Splats) -> Vec<f32> {
        let bright = |index: usize| {
            let rgb = splats.base_color(index).map(|v| srgb_decode(v.max(0.0)));
            [luminance(rgb) as f32, 1.0]
        };
        self.sums_of_splats(splats, bright).into_iter().map(|[sum, weight]| sum / weight).collect()
    }
}
