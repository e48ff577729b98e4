//! Skies that a reconstruction got wrong: left out, or decided anew.

use super::facts::Survey;
use super::sample::SurveySample;
use super::sky::{SkyRegion, find};
use super::sourced::Confidence;
use crate::{Group, Metadata, Scene, Splats};
use glam::DVec3;

/// Least distance of splats of a sky, in radii that hold 95 % of the rest of the scene.
const MIN_SKY_RADII: f64 = 1.5;
/// Sine of the lowest elevation of a sky: 6 degrees below the horizon, so that no gap opens above a
/// scene's end.
const MIN_ELEVATION_SINE: f64 = -0.105;
/// Least share of the sky that photos show: less of it is made up, as the cameras look down.
const MIN_SEEN_SHARE: f64 = 0.02;

/// The treatment of the splats that a scene has for a sky.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum OwnSky {
    /// Keeps the sky as the scene has it.
    #[default]
    Keep,
    /// Leaves the sky out.
    Drop,
    /// Decides anew which splats are sky: those that are far and above the horizon.
    Rebuild,
}

/// The number of splats that a change of the sky moved.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SkyChange {
    /// Splats of the sky before.
    pub(crate) before: usize,
    /// Splats of the sky now.
    pub(crate) sky: usize,
    /// Splats that were left out.
    pub(crate) dropped: usize,
    /// Splats that were sky and belong to the scene now.
    pub(crate) returned: usize,
}

impl SkyChange {
    /// One line for people; `None` if nothing changed.
    #[must_use]
    pub fn line(&self) -> Option<String> {
        let Self { before, sky, dropped, returned } = self;
        (dropped + returned > 0 || before != sky).then(|| {
            format!(
                "sky: {before} splats before, {sky} now; {dropped} left out, {returned} given back to the scene"
            )
        })
    }
}

impl OwnSky {
    /// Treats the sky of a scene; `given` are facts that win over the scene's own, such as up.
    ///
    /// A dropped sky takes its light with it: the scene's airlight is forgotten, and comes from the
    /// weather. To rebuild it, up is found without the sky, unless it is known. What was labelled
    /// as sky or looks like a shell of sky stays one where it is beyond 1.5 radii of the rest and
    /// at most 6 degrees below the horizon. What is below is left out, what is nearer belongs to
    /// the scene. If next to no photo looks at what stays, it is made up and left out too. About
    /// 200 ms for 850,000 splats.
    pub fn apply(self, scene: &mut Scene, given: &Metadata) -> SkyChange {
        let is_sky = |splats: &Splats, region: SkyRegion| -> Vec<bool> {
            (0..splats.len()).map(|index| region.holds(splats, index)).collect()
        };
        let before = is_sky(&scene.splats, SkyRegion::of(&scene.splats));
        let count = |flags: &[bool]| flags.iter().filter(|flag| **flag).count();
        let was_sky = count(&before);
        let mut change = SkyChange { before: was_sky, sky: was_sky, ..SkyChange::default() };
        match self {
            Self::Keep => {}
            Self::Drop => {
                keep(scene, |index| !before[index]);
                (change.sky, change.dropped) = (0, was_sky);
            }
            Self::Rebuild => {
                let decisions = decisions(scene, given, &before);
                for (group, decision) in scene.splats.groups.iter_mut().zip(&decisions) {
                    match decision {
                        SkyDecision::Sky => *group = Group::Sky,
                        SkyDecision::Scene if *group == Group::Sky => *group = Group::Scene,
                        _ => {}
                    }
                }
                let number = |decision| decisions.iter().filter(|other| **other == decision).count();
                let returned = before
                    .iter()
                    .zip(&decisions)
                    .filter(|(was, decision)| **was && **decision == SkyDecision::Scene);
                change.returned = returned.count();
                (change.sky, change.dropped) = (number(SkyDecision::Sky), number(SkyDecision::Dropped));
                keep(scene, |index| decisions[index] != SkyDecision::Dropped);
            }
        }
        if change.line().is_some() {
            // The light of a sky that is no more.
            scene.metadata.airlight = None;
        }
        change
    }
}

/// The place of a splat after the sky was decided anew.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum SkyDecision {
    Scene,
    Sky,
    Dropped,
}

/// Leaves out the splats that `is_kept` does not hold, if there are any.
fn keep(scene: &mut Scene, is_kept: impl Fn(usize) -> bool) {
    let kept: Vec<usize> = (0..scene.splats.len()).filter(|index| is_kept(*index)).collect();
    if kept.len() < scene.splats.len() {
        scene.splats = scene.splats.select(&kept);
    }
}

/// Decides for each splat what it is. Writes up into the scene's metadata as it is found without
/// the sky.
fn decisions(scene: &mut Scene, given: &Metadata, before: &[bool]) -> Vec<SkyDecision> {
    let at = |index: usize| DVec3::from_array(scene.splats.means[index].map(f64::from));
    let shell = find(&scene.splats);
    let is_candidate = |index: usize| {
        let in_shell = match shell {
            SkyRegion::Beyond { center, radius } => at(index).distance(center) > radius,
            _ => false,
        };
        before[index] || (in_shell && scene.splats.groups[index] == Group::Scene)
    };
    let candidates: Vec<bool> = (0..scene.splats.len()).map(is_candidate).collect();
    let rest: Vec<usize> = (0..candidates.len()).filter(|index| !candidates[*index]).collect();
    let views = std::mem::take(&mut scene.views);
    let rest = Scene {
        splats: scene.splats.select(&rest),
        metadata: scene.metadata.clone(),
        views,
        ..Scene::default()
    };
    let survey = Survey::of(&rest, given);
    let sample = SurveySample::of(&rest.splats, &SkyRegion::None);
    let views = rest.views;
    let up = survey.up.value;
    let mut eye: DVec3 = views.iter().map(|view| view.camera.center()).sum();
    eye = if views.is_empty() { sample.center } else { eye / views.len() as f64 };
    let mut decisions: Vec<SkyDecision> = (0..candidates.len())
        .map(|index| match candidates[index] {
            true if at(index).distance(sample.center) <= MIN_SKY_RADII * sample.radius => SkyDecision::Scene,
            true if (at(index) - eye).normalize_or_zero().dot(up) >= MIN_ELEVATION_SINE => SkyDecision::Sky,
            true => SkyDecision::Dropped,
            false => SkyDecision::Scene,
        })
        .collect();
    let sky: Vec<usize> =
        (0..decisions.len()).filter(|index| decisions[*index] == SkyDecision::Sky).collect();
    let is_seen = |index: &usize| {
        views.iter().any(|view| {
            let (width, height) = (f64::from(view.camera.width), f64::from(view.camera.height));
            let place = view.camera.project(at(*index));
            place.is_some_and(|(x, y, _)| x >= 0.0 && x < width && y >= 0.0 && y < height)
        })
    };
    // Some thousand tell the share.
    let few: Vec<usize> = sky.iter().copied().step_by(sky.len().div_ceil(4000).max(1)).collect();
    let seen = few.iter().filter(|index| is_seen(index)).count();
    if !views.is_empty() && (seen as f64) < MIN_SEEN_SHARE * few.len() as f64 {
        sky.iter().for_each(|index| decisions[*index] = SkyDecision::Dropped);
    }
    scene.views = views;
    if scene.metadata.up.is_none()
        && given.up.is_none()
        && survey.up.source != super::sourced::FactSource::Assumed
    {
        scene.metadata.up = Some(up);
        let confidence = survey.up.confidence;
        scene.metadata.up_confidence = (confidence != Confidence::Sure).then_some(confidence);
    }
    decisions
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic::{aerial, moved, rotation, street};
    use crate::{Camera, SceneView};

    const SKY_RADIUS: f64 = 400.0;

    fn view(eye: DVec3, target: DVec3) -> SceneView {
        let camera = Camera::looking((300, 200), 60.0, eye, target, DVec3::new(0.1, 0.0, 1.0)).unwrap();
        SceneView { name: "a.jpg".into(), camera }
    }

    /// A village under a dome whose axis is `axis`, all labelled.
    fn domed(axis: DVec3) -> Scene {
        let mut splats = aerial(1).build();
        let mut dome = crate::synthetic::Builder::new(2);
        dome.sky(DVec3::ZERO, SKY_RADIUS, 3000);
        let turn = glam::DQuat::from_rotation_arc(DVec3::Z, axis);
        let dome = moved(&dome.build(), turn, 1.0, DVec3::ZERO);
        let first = splats.len();
        splats.append(&dome);
        splats.groups[first..].fill(Group::Sky);
        let mut scene = Scene { splats, ..Scene::default() };
        scene.metadata.airlight = Some([0.53, 0.45, 0.52]);
        scene
    }

    #[test]
    fn a_sky_is_left_out_with_its_light() {
        for is_labelled in [true, false] {
            let mut scene = domed(DVec3::Z);
            let count = scene.splats.len() - 3000;
            if !is_labelled {
                scene.splats.groups.fill(Group::Scene);
            }
            let change = OwnSky::Drop.apply(&mut scene, &Metadata::default());
            assert_eq!(change, SkyChange { before: 3000, dropped: 3000, ..SkyChange::default() });
            assert_eq!((scene.splats.len(), scene.metadata.airlight), (count, None));
            let after = scene.clone();
            assert_eq!(OwnSky::Drop.apply(&mut scene, &Metadata::default()).line(), None);
            assert_eq!(scene, after);
        }
        let mut scene = domed(DVec3::Z);
        let before = scene.clone();
        assert_eq!(OwnSky::Keep.apply(&mut scene, &Metadata::default()).line(), None);
        assert_eq!(scene, before);
    }

    #[test]
    fn what_is_below_the_horizon_is_no_sky() {
        // A dome on its side: up comes from the village, whatever way it lies.
        for index in 0..3 {
            let turn = rotation(4, index);
            let mut scene = domed(DVec3::X);
            let count = scene.splats.len() - 3000;
            // Things by the houses that were taken for sky.
            scene.splats.groups[100..150].fill(Group::Sky);
            scene.splats = moved(&scene.splats, turn, 0.5, DVec3::ONE);
            let change = OwnSky::Rebuild.apply(&mut scene, &Metadata::default());
            assert_eq!((change.before, change.returned), (3050, 50), "{index}: {change:?}");
            assert!((1400..1800).contains(&change.sky), "{index}: {change:?}");
            assert_eq!(change.sky + change.dropped, 3000);
            assert_eq!(scene.splats.len(), count + change.sky);
            let up = scene.metadata.up.unwrap();
            assert!(up.angle_between(turn * DVec3::Z).to_degrees() < 1.0);
            for (mean, group) in scene.splats.means.iter().zip(&scene.splats.groups) {
                let offset = DVec3::from_array(mean.map(f64::from)) - DVec3::ONE;
                let is_far = offset.length() > 0.45 * SKY_RADIUS;
                assert_eq!(*group == Group::Sky, is_far);
                assert!(!is_far || offset.normalize().dot(up) > -0.13);
            }
            assert_eq!(scene.metadata.airlight, None);
        }
        // The given up wins.
        let mut scene = domed(DVec3::X);
        let given = Metadata { up: Some(DVec3::X), ..Metadata::default() };
        assert_eq!(OwnSky::Rebuild.apply(&mut scene, &given).sky, 3000);
    }

    #[test]
    fn photos_that_look_down_have_no_sky() {
        let mut scene = domed(DVec3::Z);
        scene.views =
            (-2..=2).map(|x| view(DVec3::new(f64::from(x) * 9.0, 0.0, 60.0), DVec3::ZERO)).collect();
        let mut level = scene.clone();
        let change = OwnSky::Rebuild.apply(&mut scene, &Metadata::default());
        assert_eq!((change.sky, change.dropped), (0, 3000));
        assert!(scene.splats.groups.iter().all(|group| *group == Group::Scene));
        level.views.push(view(DVec3::new(0.0, -30.0, 2.0), DVec3::new(0.0, 0.0, 6.0)));
        let views = level.views.clone();
        let change = OwnSky::Rebuild.apply(&mut level, &Metadata::default());
        // Seen from 50 m up, the lowest of this near sky is below the horizon.
        assert!(change.sky > 2900 && change.sky + change.dropped == 3000, "{change:?}");
        assert_eq!(level.views, views);
    }

    #[test]
    fn a_scene_without_a_sky_stays_as_it_is() {
        let scene = Scene { splats: street(1).build(), ..Scene::default() };
        for how in [OwnSky::Keep, OwnSky::Drop, OwnSky::Rebuild] {
            let mut changed = scene.clone();
            assert_eq!(how.apply(&mut changed, &Metadata::default()).line(), None);
            assert_eq!(changed.splats, scene.splats);
        }
        // Nor does a scene that is nothing.
        let mut nothing = Scene::default();
        assert_eq!(OwnSky::Rebuild.apply(&mut nothing, &Metadata::default()), SkyChange::default());
    }
}
