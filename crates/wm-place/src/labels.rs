//! Labels and instances of splats: as pictures, and voted for by masks of photos.
//!
//! The label of a pixel is that of one splat, the one at the median depth, so labels are never
//! mixed: an edge between two things lies where half of the light is that of the nearer one. Pixels
//! of which less than half is covered have none, 0.
//!
//! A pass writes the index of that splat where the median depth would be (`MedianDepth::Splat`), so
//! no kernel knows of labels, and any number of labels takes one pass. The label with the most
//! weight in a pixel would take a sum a label. Votes need such sums: they are derivatives of
//! colours, which a backward pass has.

use crate::drawing::Drawing;
use crate::layers::{LayerForm, LayerSpan, Layers, Row, Source};
pub use crate::picture::LabelLayers;
use crate::{LensView, Result};
use rayon::prelude::*;
use std::borrow::Cow;
use std::collections::BTreeSet;
use wm_render::{Differentiable, ForwardConfig, Frame, Gradients, Learn, RenderError, Stats, Upstream};
use wm_scene::sh::C0;
pub use wm_scene::splats::LabelKind;
use wm_scene::{Camera, Rasterization, Splats};

/// Labels that one backward pass sums up: one a channel.
const LABELS_PER_PASS: usize = 3;
/// Least weight in all masks by which a splat gets a label, px: of less nothing is seen.
const MIN_LABEL_WEIGHT_PX: f32 = 1e-3;

pub(crate) const LABEL_ROW: Row = Row {
    note: "of a scene that has them, 0 for none: one more render",
    channels: &["ID"],
    source: Source::Later(|drawing, frame, picture| {
        Box::pin(async {
            picture.labels = drawing.labels(frame.camera.lens(), &frame.shot.camera.camera)?;
            Ok(Stats::default())
        })
    }),
    span: LayerSpan::Instant,
    form: LayerForm::Ids,
    values: |picture| ids_as_f32(&picture.labels.label),
};

pub(crate) const INSTANCE_ROW: Row = Row {
    note: "as label",
    source: Source::With(Layers::LABEL),
    values: |picture| ids_as_f32(&picture.labels.instance),
    ..LABEL_ROW
};

/// IDs of 16 bits as floats, which represent them exactly.
fn ids_as_f32(names: &[u16]) -> Cow<'_, [f32]> {
    names.iter().map(|name| f32::from(*name)).collect()
}

impl Drawing<'_> {
    /// Draws the labels and the instances that the splats of a place have: those of the scene,
    /// without weather and what lies on it. Through a lens, the size is that of the lens.
    pub(crate) fn labels(&mut self, lens: Option<&LensView>, camera: &Camera) -> Result<LabelLayers> {
        let (place, backend) = (&*self.place, self.renderer.backend_mut());
        let mut frame = Frame::default();
        let mut draw = |camera: &Camera| -> Result<Vec<Option<u32>>> {
            place.draw_median_splats(backend, camera, &mut frame)?;
            Ok((0..frame.pixels()).map(|pixel| frame.median_splat(pixel)).collect())
        };
        let seen = match lens {
            None => draw(camera)?,
            Some(lens) => {
                let sides = lens.cameras(camera).iter().map(draw).collect::<Result<Vec<_>>>()?;
                let Camera { width, height, .. } = *lens.intrinsics();
                let of_side = |pixel: usize| {
                    let point = lens.side_of(pixel)?;
                    let (width, height) = (point.size.0 as usize, point.size.1 as usize);
                    let [x, y] = point.at.map(|v| v as usize);
                    sides[point.side][y.min(height - 1) * width + x.min(width - 1)]
                };
                (0..width as usize * height as usize).into_par_iter().map(of_side).collect()
            }
        };
        let of = |kind| {
            let names = place.labels(kind);
            let name = |splat: &Option<u32>| splat.map_or(0, |splat| names[splat as usize]);
            if names.is_empty() { Vec::new() } else { seen.iter().map(name).collect() }
        };
        Ok(LabelLayers { label: of(LabelKind::Label), instance: of(LabelKind::Instance) })
    }
}

/// Votes for the labels of splats by masks of photos.
///
/// For each splat its blending weights are added up over the pixels of each label in all photos;
/// the label with the largest sum wins. The sums are derivatives of colours, so a backward pass
/// gives three of them for all splats at once.
pub struct LabelVotes {
    /// The splats, all grey, so that no colour is cut off at 0.
    grey: Splats,
    config: ForwardConfig,
    frame: Frame,
    gradients: Gradients,
    /// The sum of weights of each label that a splat was seen with, px.
    sums: Vec<Vec<(u16, f32)>>,
}

/// The winners of [`LabelVotes`].
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct VotedLabels {
    /// The label of each splat, 0 for none.
    pub labels: Vec<u16>,
    /// Splats that no mask shows; their label is 0.
    pub unseen: usize,
    /// The labels other than 0 that won somewhere.
    pub won: BTreeSet<u16>,
}

impl LabelVotes {
    /// No votes yet.
    #[must_use]
    pub fn new(splats: &Splats, rasterization: Rasterization) -> Self {
        let grey = Splats {
            sh: vec![0.0; 3 * splats.len()],
            sh_degree: 0,
            labels: Vec::new(),
            instances: Vec::new(),
            ..splats.clone()
        };
        Self {
            sums: vec![Vec::new(); grey.len()],
            grey,
            config: ForwardConfig { rasterization, sh_degree: 0, ..ForwardConfig::default() },
            frame: Frame::default(),
            gradients: Gradients::default(),
        }
    }

    /// Adds the mask of a photo, `[H, W]` of its camera. The label 0 counts as the others do, so
    /// that a thing's splats are not those of what is around it.
    ///
    /// # Errors
    /// [`RenderError`] if the camera cannot be rendered with.
    ///
    /// # Panics
    /// If the mask has another size than the camera.
    pub fn add(
        &mut self,
        renderer: &mut dyn Differentiable,
        camera: &Camera,
        mask: &[u16],
    ) -> Result<(), RenderError> {
        assert_eq!(mask.len(), camera.width as usize * camera.height as usize, "a label per pixel");
        let labels: Vec<u16> = mask.iter().copied().collect::<BTreeSet<_>>().into_iter().collect();
        let learn = Learn { sh: true, ..Learn::NONE };
        renderer.forward(&self.grey, camera, &self.config, &mut self.frame)?;
        for labels in labels.chunks(LABELS_PER_PASS) {
            let is = |label: &u16| {
                let at = labels.iter().position(|own| own == label);
                [0, 1, 2].map(|channel| f32::from(u8::from(at == Some(channel))))
            };
            let rgb: Vec<f32> = mask.iter().flat_map(is).collect();
            let upstream = Upstream { rgb: &rgb, ..Upstream::default() };
            renderer.backward(&self.grey, &upstream, learn, &mut self.gradients)?;
            for (index, sums) in self.gradients.visible.iter().zip(self.gradients.sh.chunks_exact(3)) {
                let own = &mut self.sums[*index as usize];
                for (label, sum) in labels.iter().zip(sums) {
                    let weight = sum / C0 as f32;
                    if weight > 0.0 {
                        match own.iter_mut().find(|(known, _)| known == label) {
                            Some((_, sum)) => *sum += weight,
                            None => own.push((*label, weight)),
                        }
                    }
                }
            }
        }
        Ok(())
    }

    /// The sum of each splat's weights over all masks, px: how well it is seen.
    #[must_use]
    pub fn weights(&self) -> Vec<f32> {
        self.sums.iter().map(|sums| sums.iter().map(|(_, sum)| sum).sum()).collect()
    }

    /// The label with the largest sum for each splat; of equal ones the lowest.
    #[must_use]
    pub fn finish(self) -> VotedLabels {
        let mut voted = VotedLabels::default();
        for mut sums in self.sums {
            sums.sort_unstable_by_key(|(label, _)| *label);
            let best = sums.iter().fold((0, 0.0), |best, next| if next.1 > best.1 { *next } else { best });
            let is_seen = sums.iter().map(|(_, sum)| sum).sum::<f32>() > MIN_LABEL_WEIGHT_PX;
            voted.unseen += usize::from(!is_seen);
            voted.labels.push(if is_seen { best.0 } else { 0 });
            if is_seen && best.0 > 0 {
                voted.won.insert(best.0);
            }
        }
        voted
    }
}

#[cfg(test)]
mod tests;
