//! The importance of the splats of a block: the light that comes from them to where pictures are
//! taken from.

use crate::reduce::{cameras, unseen_worth};
use crate::{Error, Progress, Result};
use wm_render::{CpuRenderer, DrawPass, RenderBackend, RenderConfig, SetView};
use wm_scene::survey::Survey;
use wm_scene::{Metadata, Rasterization, Scene, Splats};

/// Longest side of the pictures, px.
const MAX_VIEW_SIDE_PX: u32 = 320;

/// The weights of splats summed over pictures from where a photographer would stand among them and
/// from all around, px; what no picture shows counts a little, by its size.
pub(crate) fn seen_worth(
    splats: &Splats,
    rasterization: Rasterization,
    renderer: &mut CpuRenderer,
    progress: &mut dyn Progress,
) -> Result<Vec<f64>> {
    let scene = Scene { splats: plain(splats), ..Scene::default() };
    let survey = Survey::of(&scene, &Metadata::default());
    let mut worth = unseen_worth(splats, survey.radius);
    let set = renderer.load(&scene.splats)?;
    let config = RenderConfig { rasterization, ..RenderConfig::default() };
    let mut weights = Vec::new();
    for camera in cameras(&scene, &survey, MAX_VIEW_SIDE_PX) {
        if progress.is_stopped() {
            return Err(Error::Stopped);
        }
        renderer.weigh(&DrawPass::new(&[SetView::plain(set)], &camera, &config), &mut weights)?;
        worth.iter_mut().zip(&weights).for_each(|(sum, weight)| *sum += f64::from(*weight));
    }
    renderer.unload(set);
    Ok(worth)
}

/// Splats without colours that depend on the direction.
fn plain(splats: &Splats) -> Splats {
    Splats {
        means: splats.means.clone(),
        quats: splats.quats.clone(),
        log_scales: splats.log_scales.clone(),
        logit_opacities: splats.logit_opacities.clone(),
        sh: splats.sh.chunks(splats.sh_stride().max(1)).flat_map(|own| own[..3].iter().copied()).collect(),
        sh_degree: 0,
        groups: splats.groups.clone(),
        labels: Vec::new(),
        instances: Vec::new(),
    }
}
