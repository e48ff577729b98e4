//! Facts that are set by hand: up and the ground from points of the ground, the scale from a known
//! length.
//!
//! The geometry of a scene stays as it is; its metadata say how it stands.

use super::facts::Survey;
use super::report::{Decimal, listed, origin};
use super::sample::SurveySample;
use super::sky::SkyRegion;
use crate::Scene;
use glam::DVec3;
use thiserror::Error;
use wm_base::statistics::quantile;

/// Least ratio of the height of the triangle of three points to its longest side with which they
/// determine a plane: an error of 1 % of the side tilts it by 11 degrees there.
const MIN_TRIANGLE_RATIO: f64 = 0.05;
/// Least share of the cameras on one side of the ground with which that side is up.
const MIN_CAMERA_SHARE: f64 = 0.8;
/// Least ratio of the splats above the ground to those below it with which splats determine up.
const MIN_SPLAT_RATIO: f64 = 2.0;
/// Half thickness of the ground, scene radii.
const GROUND_HALF_RADII: f64 = 0.02;
/// Largest turn of up, degrees, after which facts estimated along the old one are kept.
const MAX_TURN_DEG: f64 = 5.0;

/// Facts about a scene that its user sets.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Alignment {
    /// The direction against gravity, world axes, of any length but 0.
    pub up: Option<DVec3>,
    /// Turns up round: the given one, that of the ground's points, or that of the scene.
    pub flip: bool,
    /// The ground.
    pub ground: Option<GivenGround>,
    /// The scale.
    pub scale: Option<GivenScale>,
}

/// The ground as a user gives it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum GivenGround {
    /// Height along up, scene units.
    Height(f64),
    /// Three points of it, scene units. They also tell up, unless that is given.
    Points([DVec3; 3]),
}

/// The scale as a user gives it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum GivenScale {
    /// Metres per scene unit.
    MetresPerUnit(f64),
    /// Two points (scene units) and the metres between them.
    Distance(DVec3, DVec3, f64),
    /// Height of the photos' cameras above the ground, metres.
    CameraHeight(f64),
}

/// The reason why an alignment cannot be used.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum AlignError {
    /// Nothing is given.
    #[error("nothing to set: give up, the ground, the scale, or flip")]
    Nothing,
    /// Up is not finite or has no length.
    #[error("up is {0}: it must be finite and have a length")]
    Up(DVec3),
    /// The height of the ground is not finite.
    #[error("the height of the ground is {0}: it must be finite")]
    Height(f64),
    /// A point of the ground is not finite, or too far off to compute with.
    #[error("a point of the ground is {0}: its numbers must be finite")]
    Point(DVec3),
    /// Two points of the ground are one.
    #[error("two points of the ground are the same, {0}: give three that are apart")]
    Same(DVec3),
    /// The points of the ground lie on a line.
    #[error(
        "the points of the ground lie nearly on one line ({width:.3} units wide, {length:.3} long): give a third that is \
         as far to the side"
    )]
    Line {
        /// The longest side of their triangle, scene units.
        length: f64,
        /// Height of the triangle over that side, scene units.
        width: f64,
    },
    /// The metres per unit are not finite and above 0.
    #[error("{0} metres per unit are no scale: give a finite number above 0")]
    MetresPerUnit(f64),
    /// The two points and their distance give no scale.
    #[error(transparent)]
    Distance(#[from] ScaleError),
    /// The height of the cameras is not finite and above 0.
    #[error("a camera height of {0} m gives no scale: it must be finite and above 0")]
    CameraHeight(f64),
    /// The scene has no cameras whose height could be known.
    #[error(
        "the scene has no cameras of photos, so their height gives no scale: give a known distance or the metres per unit"
    )]
    NoCameras,
    /// The cameras are not above the ground.
    #[error(
        "the cameras are {0:.3} units above the ground, which gives no scale: set the ground and up first"
    )]
    BelowGround(f64),
}

impl Alignment {
    /// Checks all that can be checked without the scene.
    ///
    /// # Errors
    /// [`AlignError`] with the first value that cannot be used.
    pub fn check(&self) -> Result<(), AlignError> {
        if *self == Self::default() {
            return Err(AlignError::Nothing);
        }
        if let Some(up) = self.up
            && up.try_normalize().is_none()
        {
            return Err(AlignError::Up(up));
        }
        match self.ground {
            Some(GivenGround::Height(height)) if !height.is_finite() => {
                return Err(AlignError::Height(height));
            }
            Some(GivenGround::Points(points)) if self.up.is_some() => {
                // Their plane is not asked for.
                points.into_iter().try_for_each(check_point)?;
            }
            Some(GivenGround::Points(points)) => {
                ground_normal(points)?;
            }
            _ => {}
        }
        let is_length = |value: f64| value.is_finite() && value > 0.0;
        match self.scale {
            Some(GivenScale::MetresPerUnit(value)) if !is_length(value) => {
                Err(AlignError::MetresPerUnit(value))
            }
            Some(GivenScale::Distance(a, b, metres)) => Ok(known_distance(a, b, metres).map(|_| ())?),
            Some(GivenScale::CameraHeight(value)) if !is_length(value) => {
                Err(AlignError::CameraHeight(value))
            }
            _ => Ok(()),
        }
    }
}

fn check_point(point: DVec3) -> Result<(), AlignError> {
    // Beyond, squares of differences have no room.
    if point.abs().cmplt(DVec3::splat(1e100)).all() { Ok(()) } else { Err(AlignError::Point(point)) }
}

/// Normal of the plane through three points (scene units), length 1; its side follows from the
/// order of the points.
///
/// # Errors
/// [`AlignError::Point`], [`AlignError::Same`] or [`AlignError::Line`] if they make no plane.
pub(crate) fn ground_normal(points: [DVec3; 3]) -> Result<DVec3, AlignError> {
    points.into_iter().try_for_each(check_point)?;
    let [a, b, c] = points;
    let sides = [(a, b), (b, c), (c, a)];
    let (from, to) = sides.into_iter().fold((a, a), |longest, side| {
        if side.0.distance(side.1) > longest.0.distance(longest.1) { side } else { longest }
    });
    let length = from.distance(to);
    if let Some((same, _)) = sides.into_iter().find(|(p, q)| p.distance(*q) <= 1e-6 * length) {
        return Err(AlignError::Same(same));
    }
    // In units of the longest side, so that neither overflows nor underflows.
    let normal = ((b - a) / length).cross((c - a) / length);
    let width = normal.length();
    match normal.try_normalize() {
        Some(normal) if width >= MIN_TRIANGLE_RATIO => Ok(normal),
        _ => Err(AlignError::Line { length, width: width * length }),
    }
}

/// The evidence for the side of the ground that is up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum UpSide {
    /// The cameras of the photos are on it.
    Cameras,
    /// Most splats are on it.
    Splats,
    /// It is nearer to the up that the scene had.
    Before,
}

impl UpSide {
    /// Turns the normal of the ground through `point` to the side that is up.
    fn choose(normal: DVec3, point: DVec3, scene: &Scene, before: &Survey) -> (DVec3, Self) {
        let turned = |above: bool, side| (if above { normal } else { -normal }, side);
        let height = |p: DVec3| (p - point).dot(normal);
        if !scene.views.is_empty() {
            let above = scene.views.iter().filter(|view| height(view.camera.center()) > 0.0).count();
            let share = above as f64 / scene.views.len() as f64;
            if share >= MIN_CAMERA_SHARE || share <= 1.0 - MIN_CAMERA_SHARE {
                return turned(share > 0.5, Self::Cameras);
            }
        }
        let sample = SurveySample::of(&scene.splats, &SkyRegion::of(&scene.splats));
        let least = GROUND_HALF_RADII * sample.radius;
        let count = |sign: f64| sample.points.iter().filter(|p| sign * height(p.at) > least).count() as f64;
        let (above, below) = (count(1.0), count(-1.0));
        if above.max(below) > MIN_SPLAT_RATIO * above.min(below) {
            return turned(above > below, Self::Splats);
        }
        turned(normal.dot(before.up.value) >= 0.0, Self::Before)
    }

    fn describe(self) -> &'static str {
        match self {
            Self::Cameras => "the cameras are on that side of the ground",
            Self::Splats => "most splats are on that side of the ground",
            Self::Before => "as near as the ground allows to up before",
        }
    }
}

/// An alignment that was applied: what was known of the scene before and after.
#[derive(Clone, Debug, PartialEq)]
pub struct Aligned {
    /// The survey before.
    pub before: Survey,
    /// The survey after.
    pub after: Survey,
    /// The evidence for the side of the ground, where its points told up.
    pub side: Option<UpSide>,
    /// Angle between both ups, degrees.
    pub turned: f64,
}

/// Sets facts of a scene by hand: writes them into its metadata, as sure.
///
/// The splats and the cameras stay. Three points of the ground give up on the side of the cameras,
/// else of most splats. What was found along another up, the height of the ground and the light
/// near the horizon, is found anew, unless it is given. North becomes level again
/// ([`crate::Metadata::level_north`]). About 200 ms for 850,000 splats on one core.
///
/// # Errors
/// [`AlignError`] if a value cannot be used; the scene is as it was then.
pub fn align(scene: &mut Scene, by: &Alignment) -> Result<Aligned, AlignError> {
    by.check()?;
    let before = Survey::of(scene, &Default::default());
    let (mut up, mut side) = (by.up.and_then(DVec3::try_normalize), None);
    let mut up_source = up.map(|_| "set by hand");
    if let (None, Some(GivenGround::Points(points))) = (up, by.ground) {
        let (normal, found) = UpSide::choose(ground_normal(points)?, points[0], scene, &before);
        (up, side, up_source) = (Some(normal), Some(found), Some("three points of the ground, set by hand"));
    }
    if by.flip {
        up = Some(-up.unwrap_or(before.up.value));
        up_source = up_source.or(Some("turned round by hand"));
    }
    let kept = scene.metadata.clone();
    let turned = up.map_or(0.0, |up| up.angle_between(before.up.value).to_degrees());
    let metadata = &mut scene.metadata;
    if let Some(up) = up {
        (metadata.up, metadata.up_confidence) = (Some(up), None);
        metadata.up_source = up_source.map(Into::into);
        (metadata.ground, metadata.ground_confidence) = (None, None);
        if turned > MAX_TURN_DEG && before.sky_splats > 0 {
            metadata.airlight = None;
        }
    }
    let along = up.unwrap_or(before.up.value);
    if let Some(ground) = by.ground {
        metadata.ground_confidence = None;
        metadata.ground = Some(match ground {
            GivenGround::Height(height) => height,
            GivenGround::Points(points) => points.map(|p| p.dot(along)).iter().sum::<f64>() / 3.0,
        });
        // A height is along this up and no other.
        metadata.up = Some(along);
        if up.is_none() {
            metadata.up_confidence = Some(before.up.confidence).filter(|known| *known != Default::default());
        }
    }
    metadata.level_north();
    let mut after = Survey::of(scene, &Default::default());
    if up.is_some() || by.ground.is_some() {
        scene.metadata = std::mem::take(&mut scene.metadata).or(after.metadata());
        if (turned > MAX_TURN_DEG || by.ground.is_some())
            && kept.camera_height.is_some()
            && let Some(height) = camera_height(scene, &after).filter(|height| *height > 0.0)
        {
            scene.metadata.camera_height = Some(height);
        }
    }
    let scale = by.scale.map(|scale| metres_per_unit(scale, scene, &after)).transpose();
    let scale = scale.inspect_err(|_| scene.metadata = kept)?;
    if let Some((metres, source)) = scale {
        scene.metadata.metres_per_unit = Some(metres);
        scene.metadata.scale_source = Some(source);
        scene.metadata.scale_confidence = None;
    }
    after = Survey::of(scene, &Default::default());
    Ok(Aligned { before, after, side, turned })
}

/// The scale that is given, metres per scene unit, and its source.
fn metres_per_unit(scale: GivenScale, scene: &Scene, after: &Survey) -> Result<(f64, String), AlignError> {
    match scale {
        GivenScale::MetresPerUnit(metres) => Ok((metres, "set by hand".into())),
        GivenScale::Distance(a, b, metres) => {
            Ok((known_distance(a, b, metres)?, format!("a distance of {metres} m, set by hand")))
        }
        GivenScale::CameraHeight(metres) => {
            let height = scene.metadata.camera_height.filter(|_| !scene.views.is_empty());
            let height = height.or_else(|| camera_height(scene, after)).ok_or(AlignError::NoCameras)?;
            let scale = metres / height;
            if !(scale.is_finite() && scale > 0.0) {
                return Err(AlignError::BelowGround(height));
            }
            Ok((scale, format!("the camera height of {metres} m above the ground, set by hand")))
        }
    }
}

/// Median height of the cameras above the ground, scene units; `None` without cameras.
fn camera_height(scene: &Scene, survey: &Survey) -> Option<f64> {
    let mut heights: Vec<f64> = scene.views.iter().map(|view| survey.height(view.camera.center())).collect();
    (!heights.is_empty()).then(|| quantile(&mut heights, 0.5))
}

impl Aligned {
    /// Returns true if the scene has a sky that was made along another up.
    #[must_use]
    pub fn has_old_sky(&self) -> bool {
        self.turned > MAX_TURN_DEG && self.after.sky_splats > 0
    }

    /// One line for each fact that changed, old and new, for people.
    #[must_use]
    pub fn lines(&self) -> Vec<String> {
        let (before, after) = (&self.before, &self.after);
        let mut lines = Vec::new();
        if before.up != after.up || before.up_source != after.up_source {
            lines.push(format!(
                "up: {} ({}) -> {} ({}), {:.1} degrees apart",
                listed(before.up.value.to_array(), 3),
                origin(&before.up, &before.up_source),
                listed(after.up.value.to_array(), 3),
                origin(&after.up, &after.up_source),
                self.turned
            ));
            lines.extend(self.side.map(|side| format!("    {}; --flip turns it round", side.describe())));
        }
        if before.ground != after.ground {
            lines.push(format!(
                "ground: {} units along up ({}) -> {} ({})",
                Decimal(before.world_ground(), 3),
                origin(&before.ground, &None),
                Decimal(after.world_ground(), 3),
                origin(&after.ground, &None)
            ));
        }
        if before.metres_per_unit != after.metres_per_unit || before.scale_source != after.scale_source {
            lines.push(format!(
                "scale: 1 unit is {} m ({}) -> {} m ({})",
                Decimal(before.metres_per_unit.value, 4),
                origin(&before.metres_per_unit, &before.scale_source),
                Decimal(after.metres_per_unit.value, 4),
                origin(&after.metres_per_unit, &after.scale_source)
            ));
        }
        let [old, new] = [before, after].map(|survey| listed(survey.airlight.value, 2));
        if old != new {
            lines.push(format!("airlight: {old} -> {new} linear (of the sky near the new horizon)"));
        }
        lines
    }
}

/// The reason why two points and a distance give no scale.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum ScaleError {
    /// The distance is not finite and above 0.
    #[error("a known distance of {0} m gives no scale: it must be finite and above 0")]
    Metres(f64),
    /// A point is not finite, or both are the same.
    #[error("the points ({0}) and ({1}) give no scale: they must be finite and apart")]
    Points(DVec3, DVec3),
}

/// Metres per scene unit, from two points of the scene (scene units) that are `metres` apart.
///
/// # Errors
/// [`ScaleError`] if the points are not apart or the distance is not above 0.
pub fn known_distance(a: DVec3, b: DVec3, metres: f64) -> Result<f64, ScaleError> {
    if !(metres.is_finite() && metres > 0.0) {
        return Err(ScaleError::Metres(metres));
    }
    let scale = metres / a.distance(b);
    if scale.is_finite() && scale > 0.0 { Ok(scale) } else { Err(ScaleError::Points(a, b)) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::survey::sourced::{Confidence, FactSource};
    use crate::synthetic::{aerial, moved, rotation, street};
    use crate::{Camera, Metadata, SceneView};
    use proptest::prelude::*;

    fn by_points(ground: [DVec3; 3]) -> Alignment {
        Alignment { ground: Some(GivenGround::Points(ground)), ..Alignment::default() }
    }

    fn fault_of_points(points: [[f64; 3]; 3]) -> String {
        by_points(points.map(DVec3::from_array)).check().unwrap_err().to_string()
    }

    fn view(eye: DVec3, target: DVec3, up: DVec3) -> SceneView {
        let camera = Camera::looking((300, 200), 50.0, eye, target, up).unwrap();
        SceneView { name: "a.jpg".into(), camera }
    }

    proptest! {
        #[test]
        fn the_normal_is_that_of_the_plane(
            q in prop::array::uniform4(-1.0..1.0f64),
            at in prop::array::uniform3(-1e3..1e3f64),
            flat in prop::array::uniform3((-1.0..1.0f64, -1.0..1.0f64)),
            log_size in -6.0..6.0f64,
        ) {
            let turn = glam::DQuat::from_array(q);
            prop_assume!(turn.length() > 0.1);
            let (turn, size, at) = (turn.normalize(), 10f64.powf(log_size), DVec3::from_array(at));
            let points = flat.map(|(x, y)| at * size + turn * DVec3::new(x, y, 0.0) * size);
            match ground_normal(points) {
                Ok(normal) => {
                    prop_assert!((normal.length() - 1.0).abs() < 1e-9);
                    prop_assert!(1.0 - normal.dot(turn * DVec3::Z).abs() < 1e-9);
                }
                // What is refused is narrow.
                Err(error) => {
                    let is_narrow = matches!(error, AlignError::Line { .. } | AlignError::Same(_));
                    prop_assert!(is_narrow, "{error}");
                }
            }
        }

        #[test]
        fn any_numbers_give_a_direction_or_an_error(points in prop::array::uniform3(prop::array::uniform3(prop::num::f64::ANY))) {
            match ground_normal(points.map(DVec3::from_array)) {
                Ok(normal) => prop_assert!((normal.length() - 1.0).abs() < 1e-9),
                Err(error) => prop_assert!(!error.to_string().contains('\n')),
            }
        }
    }

    #[test]
    fn points_that_make_no_plane_are_refused() {
        let line = fault_of_points([[0.0; 3], [5.0, 0.0, 0.0], [10.0, 0.1, 0.0]]);
        assert!(line.contains("nearly on one line (0.050 units wide, 10.000"), "{line}");
        let same = fault_of_points([[1.0, 2.0, 3.0], [0.0; 3], [1.0, 2.0, 3.0]]);
        assert_eq!(same, "two points of the ground are the same, [1, 2, 3]: give three that are apart");
        assert!(fault_of_points([[1.0; 3]; 3]).contains("are the same"));
        assert!(
            fault_of_points([[f64::NAN, 0.0, 0.0], [1.0; 3], [2.0, 0.0, 0.0]]).contains("must be finite")
        );
        assert!(
            fault_of_points([[1e300, 0.0, 0.0], [-1e300, 0.0, 1.0], [2.0, 0.0, 0.0]])
                .contains("must be finite")
        );
        assert!(by_points([DVec3::ZERO, DVec3::X, DVec3::Y]).check().is_ok());
    }

    #[test]
    fn values_that_cannot_be_used_are_refused() {
        let whole = Alignment::default();
        let say = |by: Alignment| by.check().unwrap_err().to_string();
        assert!(say(whole).starts_with("nothing to set"));
        for up in [DVec3::ZERO, DVec3::NAN, DVec3::INFINITY] {
            assert!(say(Alignment { up: Some(up), ..whole }).starts_with("up is ["));
        }
        assert!(say(Alignment { ground: Some(GivenGround::Height(f64::NAN)), ..whole }).contains("is NaN"));
        let scale = |scale| say(Alignment { scale: Some(scale), ..whole });
        for value in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert!(scale(GivenScale::MetresPerUnit(value)).contains("metres per unit are no scale"));
            assert!(scale(GivenScale::CameraHeight(value)).contains("gives no scale"));
            assert!(scale(GivenScale::Distance(DVec3::ZERO, DVec3::X, value)).contains("gives no scale"));
        }
        assert!(scale(GivenScale::Distance(DVec3::X, DVec3::X, 1.0)).contains("must be finite and apart"));
    }

    #[test]
    fn any_scene_stands_by_three_points() {
        for index in 0..4 {
            let (turn, shift) = (rotation(5, index), DVec3::new(3.0, -2.0, 7.0));
            let place = |p: [f64; 3]| turn * (0.4 * DVec3::from_array(p)) + shift;
            let splats = moved(&aerial(1).build(), turn, 0.4, shift);
            let mut scene = Scene { splats, ..Scene::default() };
            scene.metadata.up = Some(turn * DVec3::NEG_X);
            scene.metadata.ground = Some(12.0);
            scene.metadata.up_confidence = Some(Confidence::Guess);
            // North at 30 degrees.
            scene.metadata.north = Some(turn * DVec3::new(0.0, 0.75f64.sqrt(), 0.5));
            let points = [[-50.0, -40.0, 0.0], [50.0, -40.0, 0.1], [0.0, 40.0, -0.1]].map(place);
            let done = align(&mut scene, &by_points(points)).unwrap();
            assert_eq!(done.side, Some(UpSide::Splats));
            let up = done.after.up;
            assert!(up.value.angle_between(turn * DVec3::Z).to_degrees() < 1.0, "{index}: {done:?}");
            assert_eq!((up.source, up.confidence), (FactSource::File, Confidence::Sure));
            assert!((done.turned - 90.0).abs() < 1.0 && (done.after.height(place([0.0; 3]))).abs() < 0.1);
            let north = scene.metadata.north.unwrap();
            assert!(north.dot(up.value).abs() < 1e-9 && north.angle_between(turn * DVec3::Y) < 0.02);
            let again = Survey::of(&scene, &Metadata::default());
            assert_eq!(again, done.after);
            assert!(done.lines()[0].contains("90.") || done.lines()[0].contains("89."), "{:?}", done.lines());
        }
    }

    #[test]
    fn the_ground_faces_the_cameras() {
        // A pit: the splats are below the points, the cameras above.
        let mut scene = Scene { splats: street(1).build(), ..Scene::default() };
        scene.views = vec![view(DVec3::new(0.0, 0.0, 30.0), DVec3::ZERO, DVec3::Y)];
        let points = [[-20.0, -4.0, 12.0], [20.0, -4.0, 12.0], [0.0, 4.0, 12.0]].map(DVec3::from_array);
        let done = align(&mut scene, &by_points(points)).unwrap();
        assert_eq!((done.side, done.after.up.value), (Some(UpSide::Cameras), DVec3::Z));
        // Turned round, it is not: the user has the last word.
        let done = align(&mut scene, &Alignment { flip: true, ..by_points(points) }).unwrap();
        assert_eq!(done.after.up.value, DVec3::NEG_Z);
        assert!((done.after.ground.value + 12.0).abs() < 1e-9);
    }

    #[test]
    fn a_scene_is_turned_round_and_its_ground_is_found_anew() {
        let mut scene = Scene { splats: street(1).build(), ..Scene::default() };
        scene.metadata.up = Some(DVec3::NEG_Z);
        scene.metadata.ground = Some(-9.0);
        let done = align(&mut scene, &Alignment { flip: true, ..Alignment::default() }).unwrap();
        assert!((done.turned - 180.0).abs() < 1e-6);
        assert_eq!(scene.metadata.up, Some(DVec3::Z));
        assert!(scene.metadata.ground.unwrap().abs() < 0.1, "{:?}", scene.metadata);
        assert_eq!(scene.metadata.up_source.as_deref(), Some("turned round by hand"));
    }

    #[test]
    fn the_scale_follows_from_a_length() {
        let scene = Scene { splats: street(1).build(), ..Scene::default() };
        let set = |scene: &mut Scene, scale| {
            align(scene, &Alignment { scale: Some(scale), ..Alignment::default() })
        };
        let mut by_distance = scene.clone();
        let done = set(&mut by_distance, GivenScale::Distance(DVec3::ZERO, DVec3::X * 4.0, 10.0)).unwrap();
        assert_eq!(done.after.metres_per_unit.value, 2.5);
        assert_eq!(
            done.lines(),
            [
                "scale: 1 unit is 1 m (assumed) -> 2.5 m (from the scene's metadata: a distance of 10 m, set by hand; sure)"
            ]
        );
        // Nothing else is written down.
        let alone = Metadata {
            metres_per_unit: Some(2.5),
            scale_source: by_distance.metadata.scale_source.clone(),
            ..Metadata::default()
        };
        assert_eq!(by_distance.metadata, alone);

        let mut bare = scene.clone();
        assert_eq!(set(&mut bare, GivenScale::CameraHeight(1.6)), Err(AlignError::NoCameras));
        assert_eq!(bare, scene);
        let mut walked = scene.clone();
        let eyes = [-9.0, 0.0, 9.0].map(|x| DVec3::new(x, 0.0, 3.2));
        walked.views = eyes.iter().map(|eye| view(*eye, *eye + DVec3::X, DVec3::Z)).collect();
        let given = Alignment {
            up: Some(DVec3::Z * 3.0),
            ground: Some(GivenGround::Height(0.0)),
            scale: Some(GivenScale::CameraHeight(1.6)),
            flip: false,
        };
        let done = align(&mut walked, &given).unwrap();
        assert!((done.after.metres_per_unit.value - 0.5).abs() < 1e-9);
        let below = Alignment { ground: Some(GivenGround::Height(5.0)), ..given };
        let kept = walked.clone();
        assert!(matches!(align(&mut walked, &below), Err(AlignError::BelowGround(_))));
        assert_eq!(walked, kept);
    }

    #[test]
    fn what_was_found_along_a_wrong_up_is_found_anew() {
        let mut place = street(2);
        place.sky(DVec3::ZERO, 300.0, 4000);
        let mut scene = Scene { splats: place.build(), ..Scene::default() };
        scene.views = vec![view(DVec3::new(0.0, 0.0, 2.0), DVec3::new(9.0, 0.0, 2.0), DVec3::Z)];
        scene.metadata = Metadata {
            up: Some(DVec3::Y),
            ground: Some(3.0),
            camera_height: Some(7.0),
            airlight: Some([0.1, 0.5, 0.1]),
            ..Metadata::default()
        };
        let mut nudged = scene.clone();
        let slightly = Alignment { up: Some(DVec3::new(0.0, 1.0, 0.01)), ..Alignment::default() };
        align(&mut nudged, &slightly).unwrap();
        assert_eq!(nudged.metadata.airlight, Some([0.1, 0.5, 0.1]));
        align(&mut scene, &Alignment { up: Some(DVec3::Z), ..Alignment::default() }).unwrap();
        let Metadata { ground, camera_height, airlight, .. } = scene.metadata;
        assert!(ground.unwrap().abs() < 0.1 && (camera_height.unwrap() - 2.0).abs() < 0.1);
        assert!(airlight.unwrap().iter().all(|v| *v > 0.4), "{airlight:?}");
    }
}
