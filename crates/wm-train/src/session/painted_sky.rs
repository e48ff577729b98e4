//! Splats in front of the sky that training painted in its colours.
//!
//! They fill gaps that the splats of the sky leave. They would stay blue under other weather, be
//! lit by fog and bear snow, so they are labelled as sky; renders of the scene as captured do not
//! change.
//!
//! For each splat its blending weights are added up over the pixels of all photos where priors have
//! the sky, and where they have the place. The sums are derivatives of colours, so a backward pass
//! gives them for all splats at once.

use super::error::SessionError;
use super::priors::PriorView;
use crate::priors::SkyClass;
use wm_render::{
    CpuConfig, CpuDifferentiable, Differentiable, ForwardConfig, Frame, Gradients, Learn, Upstream,
};
use wm_scene::sh::C0;
use wm_scene::{Group, Rasterization, Splats};

/// Least share of a splat's weight that lies in the sky.
const MIN_SKY_SHARE: f64 = 0.65;
/// Least weight in the sky, px over all photos: below it the colour is unreliable.
const MIN_SKY_WEIGHT_PX: f64 = 0.5;
/// Largest distance of a splat's colour from that of the photos where it is drawn in the sky, a
/// channel, 0-1: wires and twigs that priors take for the sky are further.
const COLOR_TOLERANCE: f64 = 0.2;

/// The weights of one splat over the photos, px.
#[derive(Clone, Copy, Default)]
struct Drawn {
    sky: f64,
    place: f64,
    /// The photos' colour in the sky in the scene's exposure, times weight.
    color: [f64; 3],
}

/// Gives the splats before the sky that have its colours to the group of the sky, and returns their
/// number.
pub(super) fn label_painted_sky(
    splats: &mut Splats,
    views: &[PriorView],
    rasterization: Rasterization,
    cpu: CpuConfig,
) -> Result<usize, SessionError> {
    if views.iter().all(|view| view.prior.sky.is_empty()) {
        return Ok(0);
    }
    let drawn = weights(splats, views, rasterization, cpu)?;
    let stride = splats.sh_stride();
    let mut count = 0;
    for (index, drawn) in drawn.iter().enumerate() {
        let own = &splats.sh[index * stride..][..3];
        let is_close = |c: usize| {
            let shown = drawn.color[c] / drawn.sky;
            (f64::from(own[c]) * C0 + 0.5 - shown).abs() < COLOR_TOLERANCE
        };
        if splats.groups[index] == Group::Scene
            && drawn.sky > MIN_SKY_WEIGHT_PX
            && drawn.sky > MIN_SKY_SHARE * (drawn.sky + drawn.place)
            && (0..3).all(is_close)
        {
            splats.groups[index] = Group::Sky;
            count += 1;
        }
    }
    Ok(count)
}

fn weights(
    splats: &Splats,
    views: &[PriorView],
    rasterization: Rasterization,
    cpu: CpuConfig,
) -> Result<Vec<Drawn>, SessionError> {
    // Grey, so that no colour is clamped at 0.
    let grey = Splats { sh: vec![0.0; 3 * splats.len()], sh_degree: 0, ..splats.clone() };
    let mut renderer = CpuDifferentiable::new(cpu)?;
    let (mut frame, mut gradients) = (Frame::default(), Gradients::default());
    let config = ForwardConfig { rasterization, sh_degree: 0, ..ForwardConfig::default() };
    let learn = Learn { sh: true, ..Learn::NONE };
    let mut drawn = vec![Drawn::default(); splats.len()];
    for PriorView { prior, photo, gain, .. } in views.iter().filter(|view| !view.prior.sky.is_empty()) {
        renderer.forward(&grey, &photo.camera, &config, &mut frame)?;
        let (width, height) = (photo.width as usize, photo.height as usize);
        let class = |at: usize| {
            let (x, y) =
                (at % width * prior.width as usize / width, at / width * prior.height as usize / height);
            let counts = photo.mask.as_ref().is_none_or(|mask| mask[at] != 0);
            if counts { prior.sky[y * prior.width as usize + x] } else { SkyClass::Unknown }
        };
        let classes: Vec<SkyClass> = (0..width * height).map(class).collect();
        let is = |wanted: SkyClass, at: usize| f32::from(u8::from(classes[at] == wanted));
        let shares: Vec<f32> =
            (0..classes.len()).flat_map(|at| [is(SkyClass::Sky, at), is(SkyClass::Place, at), 0.0]).collect();
        let colors: Vec<f32> = (0..3 * classes.len())
            .map(|at| is(SkyClass::Sky, at / 3) * f32::from(photo.rgb[at]) / (255.0 * gain[at % 3]))
            .collect();
        for (rgb, is_color) in [(&shares, false), (&colors, true)] {
            renderer.backward(&grey, &Upstream { rgb, ..Upstream::default() }, learn, &mut gradients)?;
            for (index, sums) in gradients.visible.iter().zip(gradients.sh.chunks_exact(3)) {
                let (drawn, sums) = (&mut drawn[*index as usize], [0, 1, 2].map(|c| f64::from(sums[c]) / C0));
                if is_color {
                    (0..3).for_each(|c| drawn.color[c] += sums[c]);
                } else {
                    drawn.sky += sums[0];
                    drawn.place += sums[1];
                }
            }
        }
    }
    Ok(drawn)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::photos::Photo;
    use crate::priors::Prior;
    use glam::DVec3;
    use std::sync::Arc;
    use wm_render::testing::threads;
    use wm_scene::Camera;

    const SIZE: (u32, u32) = (48, 32);
    const BLUE: [u8; 3] = [90, 140, 220];
    const GREEN: [u8; 3] = [60, 110, 50];

    /// A view along y: blue sky above the horizon, a green meadow below.
    fn view(eye: DVec3) -> PriorView {
        let camera = Camera::looking(SIZE, 60.0, eye, eye + DVec3::Y, DVec3::Z).unwrap();
        let is_above = |at: u32| at < SIZE.0 * SIZE.1 / 2;
        let pixels = 0..SIZE.0 * SIZE.1;
        let sky = |at| if is_above(at) { SkyClass::Sky } else { SkyClass::Place };
        let prior = Prior {
            width: SIZE.0,
            height: SIZE.1,
            sky: pixels.clone().map(sky).collect(),
            ..Prior::default()
        };
        let rgb = pixels.flat_map(|at| if is_above(at) { BLUE } else { GREEN }).collect();
        let photo = Photo { width: SIZE.0, height: SIZE.1, rgb, mask: None, camera };
        PriorView { camera, prior: Arc::new(prior), photo: Arc::new(photo), gain: [1.0; 3] }
    }

    #[test]
    fn blue_before_the_sky_is_sky_and_wires_and_blue_cars_are_not() {
        let mut splats = Splats::with_capacity(4, 1);
        // Blue before the sky, a dark wire before it, a blue car, and blue half before the sky.
        for (z, color) in [(0.8, BLUE), (1.0, [40; 3]), (-0.8, BLUE), (0.0, BLUE)] {
            splats.means.push([0.0, 3.0, z]);
            splats.quats.push([1.0, 0.0, 0.0, 0.0]);
            splats.log_scales.push([0.1f32.ln(); 3]);
            splats.logit_opacities.push(2.0);
            splats.sh.extend(color.map(|c| ((f64::from(c) / 255.0 - 0.5) / C0) as f32));
            splats.sh.extend([0.0; 9]);
            splats.groups.push(Group::Scene);
        }
        let views = [view(DVec3::ZERO), view(DVec3::new(0.3, -0.2, 0.0))];
        let count = label_painted_sky(&mut splats, &views, Rasterization::default(), threads(1)).unwrap();
        assert_eq!(count, 1);
        assert_eq!(splats.groups, [Group::Sky, Group::Scene, Group::Scene, Group::Scene]);
    }
}
