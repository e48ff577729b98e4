//! Renders the photos' views and measures each.

use super::page::{self, Shown};
use super::scores::{Scores, ViewScores};
use super::truth::{TrueMaps, Truth};
use super::{EvaluateArgs, ExposureFit};
use crate::dataset::Dataset;
use crate::interrupt::{self, Interrupted};
use crate::scene::Loaded;
use anyhow::{Result, bail};
use indicatif::ProgressBar;
use wm_render::hooks::{Attribute, AttributeBlock, SplatAttributes};
use wm_render::{DrawPass, Frame, Geometry, MedianDepth, Outputs, RenderBackend, RenderConfig, SetView};
use wm_scene::{Camera, Group};
use wm_train::metrics::{
    FloaterShare, Floaters, Ssim, depth_errors, fit_exposure, normal_errors, psnr, sky_covered, surface_lost,
};
use wm_train::photos::Photo;

/// Measures the photos of `data`; the second are floaters, where there is true depth, the third what is shown of
/// `pictures` photos.
pub fn measure(
    loaded: Loaded,
    data: &Dataset,
    truth: &Truth,
    args: &EvaluateArgs,
    pictures: usize,
    bar: &ProgressBar,
) -> Result<(Vec<ViewScores>, Option<FloaterShare>, Vec<Shown>)> {
    let rasterization = loaded.scene.metadata.rasterization.unwrap_or_default();
    let Loaded { scene, mut renderer, set, .. } = loaded;
    let not_sky = NotSky(&scene.splats.groups);
    let has_sky = scene.splats.groups.contains(&Group::Sky);
    let outputs = Outputs {
        geometry: if truth.any() || pictures > 0 { Geometry::DepthNormal } else { Geometry::None },
        median_depth: MedianDepth::On,
        ..Outputs::default()
    };
    // Over black, as it was trained and as `reconstruct` measures.
    let config = RenderConfig { outputs, rasterization, ..RenderConfig::default() };
    let mut ssim = Ssim::new(renderer.path());
    let mut floaters = truth.depth.as_ref().map(|_| Floaters::new(&scene.splats, rasterization));
    let chosen = evenly(data.places.len(), pictures);
    let (mut views, mut shown) = (Vec::new(), Vec::new());
    let (mut frame, mut solid) = (Frame::default(), Frame::default());
    let mut is_seen = false;
    for (index, place) in data.places.iter().enumerate() {
        if interrupt::asked() {
            return Err(Interrupted("nothing was written".into()).into());
        }
        if let Some(next) = data.places.get(index + 1) {
            data.photos.prefetch(*next, 0);
        }
        let photo = match data.photos.get(*place, 0) {
            Ok(photo) => photo,
            Err(error) if args.photos.set.skip_bad => {
                eprintln!("warning: {error}; it is left out");
                continue;
            }
            Err(error) => return Err(error.into()),
        };
        let name = data.name(*place);
        let (rgb, mask) = floats(&photo);
        let maps = truth.read(name, &photo.camera, mask.as_deref())?;
        let mut render =
            |attributes: Option<&dyn SplatAttributes>, config: &RenderConfig, frame: &mut Frame| {
                let sets = [SetView::plain(set).with_attributes(attributes)];
                let job = DrawPass::new(&sets, &photo.camera, config);
                renderer.render(&job, frame).map(drop)
            };
        render(None, &config, &mut frame)?;
        is_seen |= frame.alpha.iter().any(|alpha| *alpha > 0.0);
        if has_sky {
            let outputs = Outputs { geometry: Geometry::None, ..outputs };
            render(Some(&not_sky), &RenderConfig { outputs, ..config }, &mut solid)?;
        } else {
            solid.clone_from(&frame);
        }
        let (scores, picture) = renderer.pool().install(|| {
            if let (Some(floaters), Some(depth)) = (&mut floaters, &maps.depth) {
                floaters.add(&photo.camera, depth);
            }
            // Pictures are what a screen shows: 0 to 1.
            let mut picture: Vec<f32> = frame.rgb.iter().map(|v| v.clamp(0.0, 1.0)).collect();
            if args.photos.exposure_fit == ExposureFit::Affine {
                picture = fit_exposure(&picture, &rgb, mask.as_deref());
                picture.iter_mut().for_each(|v| *v = v.clamp(0.0, 1.0));
            }
            let width = photo.width as usize;
            let ssim = match mask.as_deref() {
                Some(mask) => ssim.masked_value(&picture, &rgb, mask, width),
                None => ssim.value(&picture, &rgb, width),
            };
            let psnr = psnr(&picture, &rgb, mask.as_deref());
            (Scores { psnr, ssim, ..against(&frame, &solid, &maps) }, picture)
        });
        if chosen.contains(&index) {
            let rendered = page::Rendered { picture: &picture, frame: &frame, solid: &solid };
            shown.push(Shown::new(name, &rgb, &rendered, &maps, truth.metres_per_unit)?);
        }
        let Camera { width, height, .. } = photo.camera;
        views.push(ViewScores { name: name.to_owned(), width, height, scores });
        bar.inc(1);
    }
    if views.is_empty() {
        bail!("{}: no photo is left to compare with; copy them again", args.dataset().display());
    }
    if !is_seen {
        bail!(
            "{}: no splat of it is seen by any camera of {}; give the data set that it was made from",
            args.scene().scene.display(),
            args.dataset().display()
        );
    }
    Ok((views, floaters.and_then(|floaters| floaters.share()), shown))
}

/// All splats but the sky's.
struct NotSky<'a>(&'a [Group]);

impl SplatAttributes for NotSky<'_> {
    fn fill(&self, indices: &[u32], block: &mut AttributeBlock) {
        for (index, out) in indices.iter().zip(block.column_mut(Attribute::Visibility)) {
            *out = f32::from(u8::from(self.0[*index as usize] != Group::Sky));
        }
    }
}

/// The photo and its mask, 0-1.
fn floats(photo: &Photo) -> (Vec<f32>, Option<Vec<f32>>) {
    let mask = photo.mask.as_ref().map(|mask| mask.iter().map(|v| f32::from(*v) / 255.0).collect());
    (photo.rgb_f32(), mask)
}

/// The scores against maps; `solid` is without the sky's splats.
fn against(frame: &Frame, solid: &Frame, maps: &TrueMaps) -> Scores {
    let depth = maps.depth.as_deref();
    Scores {
        expected: depth.and_then(|depth| depth_errors(&frame.depth, depth)),
        median: depth.and_then(|depth| depth_errors(&frame.median_depth, depth)),
        lost: depth.and_then(|depth| surface_lost(&solid.alpha, &solid.median_depth, depth)),
        normal: maps.normal.as_deref().and_then(|normal| normal_errors(&frame.normal, normal)),
        sky_covered: maps.sky.as_deref().and_then(|sky| sky_covered(&solid.alpha, sky)),
        ..Scores::default()
    }
}

/// At most `most` places out of `count`, the first and the last among them.
fn evenly(count: usize, most: usize) -> Vec<usize> {
    match most.min(count) {
        1 => vec![count / 2],
        most => (0..most).map(|index| index * (count - 1) / (most - 1)).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_are_chosen_evenly() {
        assert_eq!(evenly(9, 3), [0, 4, 8]);
        assert_eq!(evenly(2, 8), [0, 1]);
        assert_eq!(evenly(5, 1), [2]);
        assert_eq!(evenly(5, 0), [0; 0]);
    }
}
