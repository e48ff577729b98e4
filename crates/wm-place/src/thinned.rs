//! A scene with few splats, for views in which more could not be told apart: small ones and blurred
//! ones.
//!
//! Splats that look small are kept by chance, and those that are kept grow denser and wider, so
//! that they cover about as much as all. The wide view of drops on the lens draws such a scene, and
//! so do the mirrored views of films and waves.

use wm_base::random::uniform;
use wm_render::SetId;
use wm_render::hooks::{AttributeBlock, Revision, SplatAttributes};
use wm_scene::Splats;
use wm_scene::splats::logit;

/// Approximate number of splats of a thinned scene: the large ones and a share of the others.
const TARGET_SPLATS: usize = 60_000;
/// Number of splats, and as a share of all, that are kept however small they look: they may be near
/// a camera.
const MAX_KEPT_SPLATS: usize = 50_000;
const MAX_KEPT_SHARE: f64 = 0.15;
/// Maximum factor of widening: surfaces of many layers stay closed, and narrow things stay narrow.
const MAX_WIDENING: f64 = 1.8;
/// Minimum viewing distance of splats near the middle of the scene, radii of the scene.
const NEAR_DISTANCE_RADII: f64 = 0.3;
/// A splat grows denser instead of wider up to this opacity.
const MAX_OPACITY: f64 = 0.95;
/// Seed of the random choice of splats.
const CHOICE_SEED: u64 = 0x7769_6465;

/// A choice of a scene's splats that covers as much as all: of those that look small few are kept,
/// and widened.
#[derive(Debug)]
pub(crate) struct ThinnedSet {
    /// The splats in the renderer.
    pub(crate) set: SetId,
    /// Their indices in the scene.
    pub(crate) chosen: Vec<u32>,
}

/// Chooses splats of a scene about `middle`, of this radius, and widens them; with their indices in
/// the scene.
pub(crate) fn thin(splats: &Splats, middle: [f64; 3], radius: f64) -> (Splats, Vec<u32>) {
    let near = NEAR_DISTANCE_RADII * radius.max(1e-6);
    // How much of a picture each takes.
    let sizes: Vec<f64> = (0..splats.len())
        .map(|i| {
            let mut scales = splats.scales(i);
            scales.sort_by(f64::total_cmp);
            let mean = splats.means[i];
            let far: f64 = (0..3).map(|k| (f64::from(mean[k]) - middle[k]).powi(2)).sum();
            splats.opacity(i) * scales[1] * scales[2] / far.max(near * near)
        })
        .collect();
    let share = threshold(&sizes);
    let least = MAX_KEPT_SHARE.min(MAX_KEPT_SPLATS as f64 / splats.len().max(1) as f64);
    let kept = |i: usize| (sizes[i] / share).clamp(least, 1.0);
    let keeps = |i: &usize| sizes[*i] > 0.0 && uniform(CHOICE_SEED, *i as u64) < kept(*i);
    let chosen: Vec<usize> = (0..splats.len()).filter(keeps).collect();
    let mut thin = splats.select(&chosen);
    for (k, i) in chosen.iter().enumerate() {
        let kept = kept(*i);
        if kept < 1.0 {
            // They cover about as much as those that are left out with them: denser first, then
            // wider.
            let opacity = splats.opacity(*i);
            let wanted = (opacity / kept).clamp(opacity, opacity.max(MAX_OPACITY));
            let wider = (opacity / kept / wanted).sqrt().min(MAX_WIDENING).ln() as f32;
            thin.logit_opacities[k] = logit(wanted) as f32;
            thin.log_scales[k] = thin.log_scales[k].map(|scale| scale + wider);
        }
    }
    (thin, chosen.into_iter().map(|i| i as u32).collect())
}

/// The size at which all larger splats are kept, and smaller ones in proportion, so that
/// [`TARGET_SPLATS`] are kept.
fn threshold(sizes: &[f64]) -> f64 {
    let mut sorted: Vec<f64> = sizes.iter().copied().filter(|size| *size > 0.0).collect();
    sorted.sort_by(|a, b| b.total_cmp(a));
    let mut rest: f64 = sorted.iter().sum();
    for (k, size) in sorted.iter().enumerate() {
        // With the k largest kept as they are.
        let share = rest / (TARGET_SPLATS as f64 - k as f64).max(1.0);
        if *size <= share {
            return if sorted.len() <= TARGET_SPLATS { 0.0 } else { share };
        }
        rest -= size;
    }
    0.0
}

/// The attributes of a scene's splats for those of its choice.
pub(crate) struct ChosenAttributes<'a> {
    /// The attributes of the splats of the scene.
    pub(crate) all: &'a dyn SplatAttributes,
    /// The indices of the choice.
    pub(crate) chosen: &'a [u32],
}

impl ChosenAttributes<'_> {
    /// Calls `fill` with the indices in the scene.
    fn with_indices(&self, indices: &[u32], fill: impl FnOnce(&[u32])) {
        let mut scene = [0; AttributeBlock::MAX_SPLATS];
        for (scene, index) in scene.iter_mut().zip(indices) {
            *scene = self.chosen[*index as usize];
        }
        fill(&scene[..indices.len()]);
    }
}

impl SplatAttributes for ChosenAttributes<'_> {
    fn fill(&self, indices: &[u32], block: &mut AttributeBlock) {
        self.with_indices(indices, |indices| self.all.fill(indices, block));
    }

    fn changes_visibility(&self) -> bool {
        self.all.changes_visibility()
    }

    fn fill_light(&self, indices: &[u32], block: &mut AttributeBlock) {
        self.with_indices(indices, |indices| self.all.fill_light(indices, block));
    }

    fn changes_light(&self) -> bool {
        self.all.changes_light()
    }

    fn revision(&self) -> Option<Revision> {
        // The choice stays.
        self.all.revision()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_thinned_scene_covers_as_much_as_all_of_it() {
        let mut splats = Splats::zeroed(200_000, 0);
        for i in 0..splats.len() {
            let u = |k: u64| uniform(3, 4 * i as u64 + k) as f32;
            splats.means[i] = [40.0 * u(0) - 20.0, 40.0 * u(1) - 20.0, 0.0];
            splats.quats[i] = [1.0, 0.0, 0.0, 0.0];
            splats.log_scales[i] = [(0.02 + 0.1 * u(2)).ln(); 3];
            splats.logit_opacities[i] = logit(0.2 + 0.6 * f64::from(u(3))) as f32;
        }
        let (kept, chosen) = thin(&splats, [0.0; 3], 20.0);
        let most = TARGET_SPLATS + (MAX_KEPT_SHARE * splats.len() as f64) as usize;
        assert!((TARGET_SPLATS / 2..most).contains(&kept.len()), "{}", kept.len());
        let cover = |splats: &Splats| -> f64 {
            (0..splats.len()).map(|i| splats.opacity(i) * splats.scales(i)[0].powi(2)).sum()
        };
        let ratio = cover(&kept) / cover(&splats);
        assert!((0.85..1.02).contains(&ratio), "{ratio}");
        assert!((0..kept.len()).all(|k| kept.means[k] == splats.means[chosen[k] as usize]));
        // A small scene stays as it is.
        let few = splats.select(&(0..1000).collect::<Vec<_>>());
        assert_eq!(thin(&few, [0.0; 3], 20.0).0, few);
    }
}
