//! Looks at a scene in levels: small pictures that tell the light which comes from each splat.
//!
//! [`LevelLooks::cut`] makes a cut in turns. It looks at all leaves where they are coarsest, then
//! at a cut with as many splats as can be held. In the cut that it makes then, a leaf counts with
//! the light that comes from it, and its splats with the share of them that nearly all of that
//! light comes from: the less light may be lost, the coarser are the leaves of which all is drawn.
//! For a shot it tries several such shares, and takes the cut whose small pictures, drawn as
//! [`LevelLooks::drawn`] says, are nearest to those of all that can be held. Few splats of a fine
//! level are best where surfaces are many thin layers, coarse ones where each splat covers
//! something of its own.
//!
//! Looks are pictures of the same renderer. What they say depends on index, cameras and budget
//! alone.

use super::{CutBudget, LevelCut, VisibleLeaf, coverage};
use crate::Result;
use std::sync::Arc;
use wm_render::hooks::{Attribute, AttributeBlock, Revision, SplatAttributes};
use wm_render::{DrawPass, Frame, RenderBackend, RenderConfig, RenderError, SetId, SetView};
use wm_scene::levels::{LevelIndex, LevelLeaf};
use wm_scene::{Camera, Rasterization};

/// Maximum longer side of a look, px; smaller pictures are looked at in their own size. A smaller
/// look would miss splats that fall between its pixels.
const MAX_LOOK_SIDE_PX: f64 = 1280.0;
/// Light that a hidden leaf counts with. A look is small and its splats are coarse: it may not show
/// a gap in the occluder.
const HIDDEN_LEAF_LIGHT: f64 = 0.01;
/// Share of the light of its last look that a leaf keeps in the next: a coarser leaf may stick out
/// farther.
const KEPT_LIGHT_SHARE: f64 = 0.1;
/// Shares of its light that a leaf may lose by not drawing splats: the candidates that are tried.
/// Below 0 all splats of a leaf are drawn.
const TRIED_LOSSES: [f64; 4] = [-1.0, 0.0005, 0.008, 0.06];
/// Index of the candidate that is used where no others are tried.
const DEFAULT_LOSS: usize = 2;
/// Maximum number of cameras by which the candidates are compared.
const MAX_COMPARED_CAMERAS: usize = 4;

/// Splats of all leaves at coarse levels: rendered to tell which leaves a camera sees.
#[derive(Clone, Debug)]
pub(crate) struct CoarseLeaves {
    /// The splats, leaf after leaf.
    pub(crate) set: SetId,
    /// The leaves in the order of their splats, and the number of splats up to their end.
    pub(crate) ends: Vec<(usize, u64)>,
}

/// A leaf of a cut that a renderer holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct HeldLeaf {
    /// The number of the leaf.
    pub(crate) leaf: usize,
    /// The splats of the leaf.
    pub(crate) set: SetId,
    /// Their number.
    pub(crate) splats: usize,
}

/// The inputs of a cut: the index, the cameras of the looks, and the budget.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LevelLooks<'a> {
    /// The scene.
    pub(crate) index: &'a LevelIndex,
    /// All of it at its coarsest.
    pub(crate) coarse: &'a CoarseLeaves,
    /// The cameras of all pictures.
    pub(crate) cameras: &'a [Camera],
    /// The most cameras that look; those between are skipped.
    pub(crate) most: usize,
    /// True to try several cuts and take the best, which takes as long as some 15 frames; else one
    /// is made, after two looks.
    pub(crate) tries_several: bool,
    /// The most that is drawn and held.
    pub(crate) budget: CutBudget,
    /// The drawing of small splats.
    pub(crate) rasterization: Rasterization,
}

impl LevelLooks<'_> {
    /// The best cut for the pictures of all cameras. `hold` makes the renderer hold a cut, and says
    /// what it holds.
    ///
    /// # Errors
    /// Errors of `hold`, and [`crate::Error::Render`] if a look cannot be rendered.
    pub(crate) fn cut<R: RenderBackend>(
        &self,
        renderer: &mut R,
        mut hold: impl FnMut(&mut R, &LevelCut) -> Result<Vec<HeldLeaf>>,
    ) -> Result<LevelCut> {
        let eyes: Vec<Camera> = some_of(self.cameras, self.most).map(small).collect();
        let runs = self.coarse.ends.iter().scan(0, |start, (leaf, end)| {
            let count = (*end - std::mem::replace(start, *end)) as usize;
            Some((*leaf, count))
        });
        let runs: Vec<(usize, usize)> = runs.collect();
        let mut seen = vec![VisibleLeaf { light: 0.0, drawn: 1.0 }; self.index.leaves.len()];
        self.look(&eyes, &[self.coarse.set], &runs, renderer, |leaf, light, _| {
            seen[leaf].light = seen[leaf].light.max(light.max(HIDDEN_LEAF_LIGHT));
        })?;
        // As much as can be held, to see all of it.
        let first = CutBudget { splats: self.budget.held, ..self.budget };
        let cut = LevelCut::of_seen(self.index, self.cameras, &seen, &first);
        if cut.splats <= self.budget.splats {
            return Ok(cut);
        }
        let held = hold(renderer, &cut)?;
        let sets: Vec<SetId> = held.iter().map(|held| held.set).collect();
        let runs: Vec<(usize, usize)> = held.iter().map(|held| (held.leaf, held.splats)).collect();
        let mut found = vec![[VisibleLeaf { light: 0.0, drawn: 0.0 }; TRIED_LOSSES.len()]; seen.len()];
        self.look(&eyes, &sets, &runs, renderer, |leaf, light, drawn| {
            for (found, drawn) in found[leaf].iter_mut().zip(drawn) {
                *found = VisibleLeaf { light: found.light.max(light), drawn: found.drawn.max(drawn) };
            }
        })?;
        let cut_of = |tried: usize| {
            let seen: Vec<VisibleLeaf> = (found.iter().zip(&seen))
                .map(|(found, before)| {
                    let VisibleLeaf { light, drawn } = found[tried];
                    VisibleLeaf { light: light.max(KEPT_LIGHT_SHARE * before.light), drawn }
                })
                .collect();
            LevelCut::of_seen(self.index, self.cameras, &seen, &self.budget)
        };
        if !self.tries_several {
            return Ok(cut_of(DEFAULT_LOSS));
        }
        let few: Vec<Camera> = some_of(&eyes, MAX_COMPARED_CAMERAS).copied().collect();
        let all = vec![DrawnPart::All; held.len()];
        let wanted = few
            .iter()
            .map(|eye| self.picture(eye, &held, &all, renderer))
            .collect::<std::result::Result<Vec<Frame>, RenderError>>()?;
        let mut best: Option<(f64, LevelCut)> = None;
        for tried in 0..TRIED_LOSSES.len() {
            let cut = cut_of(tried);
            let held = hold(renderer, &cut)?;
            let mut off = 0.0;
            for (eye, wanted) in few.iter().zip(&wanted) {
                let drawn = self.drawn_by(eye, &held, renderer)?;
                off += difference(wanted, &self.picture(eye, &held, &drawn, renderer)?);
            }
            if best.as_ref().is_none_or(|(least, _)| off < *least) {
                best = Some((off, cut));
            }
        }
        Ok(best.map_or_else(|| LevelCut::coarsest(self.index), |(_, cut)| cut))
    }

    /// The picture of some of the splats of a cut.
    fn picture(
        &self,
        eye: &Camera,
        held: &[HeldLeaf],
        drawn: &[DrawnPart],
        renderer: &mut dyn RenderBackend,
    ) -> Result<Frame, RenderError> {
        let config = RenderConfig { rasterization: self.rasterization, ..RenderConfig::default() };
        let shown: Vec<Option<DrawnAttributes<'_>>> =
            drawn.iter().map(|part| part.attributes(None)).collect();
        let views = held.iter().zip(drawn).zip(&shown).filter(|((_, part), _)| **part != DrawnPart::None);
        let views: Vec<SetView<'_>> = views
            .map(|((held, _), shown)| {
                let attributes = shown.as_ref().map(|shown| shown as &dyn SplatAttributes);
                SetView::plain(held.set).with_attributes(attributes)
            })
            .collect();
        let mut frame = Frame::default();
        renderer.render(&DrawPass::new(&views, eye, &config), &mut frame)?;
        Ok(frame)
    }

    /// Looks at sets with the leaves `runs` (number, and number of splats), and tells of each leaf
    /// and camera the light and the share of the splats that it comes from.
    fn look(
        &self,
        eyes: &[Camera],
        sets: &[SetId],
        runs: &[(usize, usize)],
        renderer: &mut dyn RenderBackend,
        mut tell: impl FnMut(usize, f64, [f64; TRIED_LOSSES.len()]),
    ) -> Result<(), RenderError> {
        let mut weights = Vec::new();
        for eye in eyes {
            self.weigh(eye, sets, renderer, &mut weights)?;
            let mut first = 0;
            for (leaf, count) in runs {
                let own = &mut weights[first..first + count];
                first += count;
                let LevelLeaf { low, high, .. } = &self.index.leaves[*leaf];
                let area = coverage(*low, *high, eye);
                if area > 0.0 {
                    let (light, drawn) = light_of(own);
                    tell(*leaf, (light / area).min(1.0), drawn);
                }
            }
        }
        Ok(())
    }

    fn weigh(
        &self,
        eye: &Camera,
        sets: &[SetId],
        renderer: &mut dyn RenderBackend,
        weights: &mut Vec<f32>,
    ) -> Result<(), RenderError> {
        let config = RenderConfig { rasterization: self.rasterization, ..RenderConfig::default() };
        let views: Vec<SetView<'_>> = sets.iter().map(|set| SetView::plain(*set)).collect();
        renderer.weigh(&DrawPass::new(&views, eye, &config), weights).map(|_| ())
    }

    /// The splats of each leaf of a cut that the picture of a camera draws, in the order of `held`.
    ///
    /// # Errors
    /// [`RenderError`] if it cannot be looked at.
    pub(crate) fn drawn(
        &self,
        camera: &Camera,
        held: &[HeldLeaf],
        renderer: &mut dyn RenderBackend,
    ) -> Result<Vec<DrawnPart>, RenderError> {
        self.drawn_by(&small(camera), held, renderer)
    }

    /// Finds the drawn splats by the camera of a look.
    fn drawn_by(
        &self,
        eye: &Camera,
        held: &[HeldLeaf],
        renderer: &mut dyn RenderBackend,
    ) -> Result<Vec<DrawnPart>, RenderError> {
        let all: usize = held.iter().map(|held| held.splats).sum();
        let most = usize::try_from(self.budget.splats).unwrap_or(usize::MAX);
        if all <= most {
            return Ok(vec![DrawnPart::All; held.len()]);
        }
        if most == 0 {
            return Ok(vec![DrawnPart::None; held.len()]);
        }
        let sets: Vec<SetId> = held.iter().map(|held| held.set).collect();
        let mut weights = Vec::new();
        self.weigh(eye, &sets, renderer, &mut weights)?;
        let mut sorted = weights.clone();
        let (_, least, _) = sorted.select_nth_unstable_by(all - most, f32::total_cmp);
        let least = *least;
        // Of those that weigh as little as the last, the first.
        let mut left = most - weights.iter().filter(|weight| **weight > least).count();
        let mut first = 0;
        let kept = held.iter().map(|held| {
            let own = &weights[first..first + held.splats];
            first += held.splats;
            DrawnPart::of(own.iter().map(|weight| {
                let is_last = *weight == least && left > 0;
                left -= usize::from(is_last);
                *weight > least || is_last
            }))
        });
        Ok(kept.collect())
    }
}

/// The camera of a look.
fn small(camera: &Camera) -> Camera {
    let scale = (MAX_LOOK_SIDE_PX / f64::from(camera.width.max(camera.height))).min(1.0);
    let side = |length: u32| ((f64::from(length) * scale).round() as u32).max(1);
    camera.resized(side(camera.width), side(camera.height))
}

/// The sum of the squared differences of colour and of alpha.
fn difference(a: &Frame, b: &Frame) -> f64 {
    let squares = |a: &[f32], b: &[f32]| -> f64 {
        a.iter().zip(b).map(|(a, b)| f64::from(a.clamp(0.0, 1.0) - b.clamp(0.0, 1.0)).powi(2)).sum()
    };
    squares(&a.rgb, &b.rgb) + squares(&a.alpha, &b.alpha)
}

/// The sum of the weights of a leaf's splats, px, and the shares of its splats that it comes from,
/// but for each of [`TRIED_LOSSES`]. The order of the weights is lost.
fn light_of(weights: &mut [f32]) -> (f64, [f64; TRIED_LOSSES.len()]) {
    let light: f64 = weights.iter().copied().map(f64::from).sum();
    if light <= 0.0 {
        return (0.0, [0.0; TRIED_LOSSES.len()]);
    }
    weights.sort_unstable_by(f32::total_cmp);
    let drawn = TRIED_LOSSES.map(|most| {
        let mut lost = 0.0;
        let dark = weights.iter().take_while(|weight| {
            lost += f64::from(**weight);
            lost <= most * light
        });
        1.0 - dark.count() as f64 / weights.len() as f64
    });
    (light, drawn)
}

/// Returns cameras at even steps, `most` at most.
fn some_of(cameras: &[Camera], most: usize) -> impl Iterator<Item = &Camera> {
    cameras.iter().step_by(cameras.len().div_ceil(most).max(1))
}

/// The splats of a set that are drawn.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum DrawnPart {
    /// Every one.
    All,
    /// The splats whose bit is set.
    Some(Arc<[u32]>),
    /// None.
    None,
}

impl DrawnPart {
    fn of(kept: impl Iterator<Item = bool>) -> Self {
        let (mut words, mut count, mut all) = (Vec::new(), 0, 0);
        for (index, kept) in kept.enumerate() {
            if index % 32 == 0 {
                words.push(0);
            }
            if let Some(word) = words.last_mut() {
                *word |= u32::from(kept) << (index % 32);
            }
            (count, all) = (count + usize::from(kept), all + 1);
        }
        match count {
            0 => Self::None,
            _ if count == all => Self::All,
            _ => Self::Some(words.into()),
        }
    }

    /// The attributes of a set of which this part is drawn, with its own ones; `None` where all or
    /// none is.
    pub(crate) fn attributes<'a>(
        &'a self,
        own: Option<&'a dyn SplatAttributes>,
    ) -> Option<DrawnAttributes<'a>> {
        match self {
            Self::Some(drawn) => Some(DrawnAttributes { own, drawn }),
            Self::All | Self::None => None,
        }
    }

    /// Number of those that are drawn of a set of `splats`.
    pub(crate) fn count(&self, splats: usize) -> usize {
        match self {
            Self::All => splats,
            Self::Some(words) => words.iter().map(|word| word.count_ones() as usize).sum(),
            Self::None => 0,
        }
    }
}

/// The attributes of the splats of a set of which some are not drawn.
pub(crate) struct DrawnAttributes<'a> {
    /// The attributes of the drawn splats; `None` if they have none.
    pub(crate) own: Option<&'a dyn SplatAttributes>,
    /// A bit for each splat that is drawn.
    pub(crate) drawn: &'a [u32],
}

impl SplatAttributes for DrawnAttributes<'_> {
    fn fill(&self, indices: &[u32], block: &mut AttributeBlock) {
        if let Some(own) = self.own.filter(|own| own.changes_visibility()) {
            own.fill(indices, block);
        }
        for (index, factor) in indices.iter().zip(block.column_mut(Attribute::Visibility)) {
            if self.drawn[*index as usize / 32] >> (index % 32) & 1 == 0 {
                *factor = 0.0;
            }
        }
    }

    fn fill_light(&self, indices: &[u32], block: &mut AttributeBlock) {
        if let Some(own) = self.own {
            own.fill_light(indices, block);
        }
    }

    fn changes_light(&self) -> bool {
        self.own.is_some_and(SplatAttributes::changes_light)
    }

    fn revision(&self) -> Option<Revision> {
        let own = self.own.map_or(Some(Revision::default()), SplatAttributes::revision)?;
        Some(Revision::of(self.drawn.iter().copied()).and(own))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn light_comes_from_few_splats() {
        let mut weights = [0.0, 50.0, 0.001, 0.0, 49.0, 0.002, 0.0, 0.0];
        let (light, drawn) = light_of(&mut weights);
        assert!((light - 99.003).abs() < 1e-3);
        assert_eq!(drawn, [1.0, 0.25, 0.25, 0.25]);
        assert_eq!(light_of(&mut [0.0; 3]), (0.0, [0.0; 4]));
    }

    #[test]
    fn bits_are_those_of_the_drawn() {
        let drawn = DrawnPart::of((0..70).map(|index| index % 3 == 0));
        assert_eq!(drawn.count(70), 24);
        let DrawnPart::Some(words) = &drawn else { panic!("{drawn:?}") };
        let attributes = DrawnAttributes { own: None, drawn: words };
        let mut block = AttributeBlock::default();
        attributes.fill(&[0, 1, 69, 68], &mut block);
        assert_eq!(block.column(Attribute::Visibility)[..4], [1.0, 0.0, 1.0, 0.0]);
        assert_eq!(DrawnPart::of([true; 40].into_iter()), DrawnPart::All);
        assert_eq!(DrawnPart::of([false; 3].into_iter()), DrawnPart::None);
    }
}
