//! The splats of a place as a weather changes them.

use super::levels::DrawnSet;
use crate::levels::{DrawnAttributes, DrawnPart};
use crate::thinned::ChosenAttributes;
use wm_render::hooks::{AttributeBlock, Revision, SplatAttributes};
use wm_render::{SetId, SetView};
use wm_weather::cover::Buried;
use wm_weather::light::FrameGains;
use wm_weather::wetness::WetGains;

/// The attributes of the splats of a scene under a weather.
#[derive(Clone, Copy, Default)]
pub(super) struct SceneAttributes<'a> {
    /// The splats under what lies.
    pub buried: Option<&'a Buried>,
    /// The change of the light.
    pub light: Option<FrameGains<'a>>,
    /// The darkening of what is wet.
    pub wet: Option<&'a WetGains<'a>>,
}

impl SceneAttributes<'_> {
    /// Returns true if they change how any splat is drawn.
    pub fn is_changed(&self) -> bool {
        self.buried.is_some() || self.changes_light()
    }
}

impl SplatAttributes for SceneAttributes<'_> {
    fn fill(&self, indices: &[u32], block: &mut AttributeBlock) {
        if let Some(buried) = self.buried {
            buried.fill(indices, block);
        }
        if let Some(light) = self.light {
            light.fill(indices, block);
        }
    }

    fn changes_visibility(&self) -> bool {
        self.buried.is_some() || self.light.is_some_and(|light| light.changes_visibility())
    }

    fn fill_light(&self, indices: &[u32], block: &mut AttributeBlock) {
        if let Some(light) = self.light {
            light.fill_light(indices, block);
        }
        if let Some(wet) = self.wet {
            wet.fill_light(indices, block);
        }
    }

    fn changes_light(&self) -> bool {
        self.light.is_some() || self.wet.is_some()
    }

    fn revision(&self) -> Option<Revision> {
        if self.wet.is_some() {
            return None;
        }
        let buried = self.buried.map_or(Some(Revision::default()), SplatAttributes::revision)?;
        let light = self.light.map_or(Some(Revision::default()), |light| light.revision())?;
        Some(buried.and(light))
    }
}

/// The sets of a scene with their attributes, if there `is_changed` anything, and what lies on it.
pub(super) fn with_cover<'a>(
    scene: &[(SetId, &'a dyn SplatAttributes)],
    is_changed: bool,
    lying: Option<(SetId, Option<&'a dyn SplatAttributes>)>,
) -> Vec<SetView<'a>> {
    let own = |(set, attributes): &(SetId, &'a dyn SplatAttributes)| {
        SetView::plain(*set).with_attributes(is_changed.then_some(*attributes))
    };
    let lying = lying.map(|(set, light)| SetView::plain(set).with_attributes(light));
    scene.iter().map(own).chain(lying).collect()
}

/// The attributes of the sets of a cut, by those of the weather's splats.
pub(super) fn chosen_attributes<'a>(
    drawn: &'a [DrawnSet],
    scene: &'a SceneAttributes<'a>,
) -> Vec<ChosenAttributes<'a>> {
    drawn.iter().map(|part| ChosenAttributes { all: scene, chosen: &part.chosen }).collect()
}

/// The attributes of the sets of a cut of which a part is shown; `views` are the sets as a whole.
pub(super) fn shown_attributes<'a>(
    drawn: &'a [DrawnSet],
    views: &[SetView<'a>],
) -> Vec<Option<DrawnAttributes<'a>>> {
    drawn.iter().zip(views).map(|(set, view)| set.part.attributes(view.attributes)).collect()
}

/// The parts of the sets of a cut that are shown.
pub(super) fn shown_views<'a>(
    drawn: &[DrawnSet],
    views: &[SetView<'a>],
    shown: &'a [Option<DrawnAttributes<'a>>],
) -> impl Iterator<Item = SetView<'a>> {
    let sets = drawn.iter().zip(views).zip(shown).filter(|((set, _), _)| set.part != DrawnPart::None);
    sets.map(|((_, view), shown)| match shown {
        Some(shown) => view.with_attributes(Some(shown)),
        None => *view,
    })
}
