//! The light of a capture, split into sun and sky.
//!
//! 1. Surfaces with normals and colours: those that the photos' cameras see ([`FusedSurfaces`]);
//!    leaves have no normal.
//! 2. Openness to the sky by maps of what stands in the way of 32 directions.
//! 3. The sun: given, or found in the shadows, or none.
//! 4. The ratio of sun to sky, a channel, from pairs of one material in light and shade.
//! 5. Visibility of the sun: from the map where it is sure, and where it is not, such as along the
//!    edges of shadows, from the colour: what makes the reflectance that of the sure surfaces of
//!    the same material around.
//! 6. Each splat takes the light of the surface nearest to it.
//!
//! The sun comes from the metadata, from the survey (place, time and north), or from a search over
//! directions (`sun_search.rs`): over those of the sun's elevation alone, if place and time are
//! known and north is not. Where no photo shows the way from level ground to the sun, reflectances
//! tell whether the sun is seen (`unseen_casters.rs`); along the edges of shadows the colours do
//! (`shadow_edges.rs`). In scenes without photos the shares of splats at an edge go beyond full
//! shade and full sun, since a sharp edge in a picture is the mean of splats that go beyond it.
//! Photos show walls from one side: what is behind a wall is solid for all light
//! ([`crate::fused_surfaces`], `backing.rs`).
//!
//! A split that leaves more than a quarter of the contrast across shadow edges is not used
//! ([`CaptureLight::is_split`]). Reflectances are colours over a white card in the captured light
//! (`white_card.rs`).

mod split;
mod terms;

use super::irradiance::{SceneLight, SurfaceLight};
use super::openness;
use super::places::{Surfaces, light_of};
use super::quantile::{median, quantile};
use super::shadow_edges::{edge_share, sharpened_share};
use super::sun_search::{self, FoundSun};
use super::sun_shadows::SunShadows;
use super::white_card::WhiteCard;
use crate::cover::ground::FarFloor;
use crate::fused_surfaces::FusedSurfaces;
use crate::level::dot;
use crate::optics::{CapturedSky, Site};
use crate::point_grid::PointGrid;
use crate::shelter::Occluders;
use crate::threads::map;
use glam::Vec3;
use serde::{Deserialize, Serialize};
use split::Split;
pub use terms::CaptureSun;
use terms::{LOWEST_SUN, MeanSurface, captured_light, surface_of};
use wm_base::color::luminance;
use wm_scene::{Camera, Group, Splats};

/// Distance within which a splat takes the light of a surface, m.
const NEAR_REACH_M: f64 = 0.4;
const FAR_REACH_M: f64 = 1.6;
/// Distance of the surfaces by which leaves are recognised, and the agreement of their normals,
/// 0-1.
const LEAF_RADIUS_M: f32 = 0.3;
const MIN_LEAF_AGREEMENT: f32 = 0.72;
/// Excess of green over red and blue by which leaves and grass are recognised.
pub(crate) const GREEN_EXCESS_RATIO: f64 = 1.08;
/// Least and greatest extent of a place whose light is split: others have a wrong scale.
const PLACE_EXTENTS_M: [f64; 2] = [0.01, 1e6];
/// Distance between surfaces that are told apart, m.
const SURFACE_SPACING_M: f64 = 0.06;
/// Reflectance of surfaces in the mean; the brightness of white cards up to which they count as 1,
/// since bright places are no courtyards; and an upper clamp.
const MEAN_ALBEDO: f64 = 0.25;
const MAX_USUAL_EXPOSURE: f64 = 1.5;
const MAX_EXPOSURE: f64 = 3.0;
/// Quantile of the ground's irradiance at which a white card is at most display white: in even
/// light, and in that of a sun.
const DARK_GROUND: [f64; 2] = [0.25, 0.75];
/// Least cosine between up and the normal of ground.
const MIN_GROUND_COSINE: f32 = 0.8;
/// A splat of which nothing is known.
const IN_THE_OPEN: SplatLight = SplatLight { normal: [0; 3], open: [255; 2], sun: FULL_SUN, is_sky: false };
/// [`SplatLight::sun`] of a splat that sees all of the sun.
const FULL_SUN: i16 = 10_000;
/// Contrast left across shadow edges, of that before, above which a capture keeps its shadows.
const MOST_LEFT: f64 = 0.25;

/// Facts about the sun of the photos that are known before their shadows are examined.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct KnownSun {
    /// Towards it, world axes, length 1.
    pub direction: Option<[f64; 3]>,
    /// Elevation above the horizon, radians, 0 to pi/2, where the direction is not known.
    pub elevation: Option<f64>,
}

/// The light of a capture, and its fall on each splat.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CaptureLight {
    /// The sun; `None` of a capture in diffuse light.
    pub sun: Option<CaptureSun>,
    /// The place was captured under clouds, as its sky says, or where that is burned out in the
    /// photos, the lack of any shadows.
    pub is_overcast: bool,
    /// The result of the search for the sun, if it was not known.
    pub(crate) search: Option<FoundSun>,
    /// The captured light; level ground in the open has an irradiance of luminance 1.
    pub light: SceneLight,
    /// Means over all surfaces, by which light returns.
    mean: MeanSurface,
    /// The brightness in which white things are drawn in an irradiance of 1, display values; 1 or
    /// more.
    pub(super) exposure: f64,
    /// The brightness of white cards as the photos would show them.
    card: WhiteCard,
    /// One a splat of the scene.
    splats: Vec<SplatLight>,
}

/// The fall of the light on one splat, in few bits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
struct SplatLight {
    /// Normal times 127; zero of leaves.
    normal: [i8; 3],
    open: [u8; 2],
    /// The share of the sun times [`FULL_SUN`]; below 0 or above it beside the edges of shadows
    /// ([`sharpened_share`]).
    sun: i16,
    /// A splat of the captured sky.
    is_sky: bool,
}

impl SplatLight {
    /// The share of the sun that reaches the splat: 0-1, or a little beyond beside the edges of
    /// shadows.
    fn sun_share(self) -> f32 {
        f32::from(self.sun) / f32::from(FULL_SUN)
    }
}

/// [`SplatLight::sun`] of a share.
fn share_number(share: f32) -> i16 {
    (share * f32::from(FULL_SUN)).round() as i16
}

impl CaptureLight {
    /// Returns true if its parts fit each other and a scene of `splats` splats, as an asset that a
    /// stranger made may not.
    #[must_use]
    pub fn is_consistent(&self, splats: usize) -> bool {
        let MeanSurface { even, rising, sun } = self.mean;
        self.splats.len() == splats
            && [even, rising, sun].into_iter().all(f64::is_finite)
            && self.light.sun.into_iter().all(f64::is_finite)
            && (1.0..f64::INFINITY).contains(&self.exposure)
            && self.card.is_sound()
    }

    /// Splits the light of a scene. `found` are its surfaces, `occluders` what stands in the way of
    /// light, `known` what is known of the sun, `cameras` those of the photos. Equal for any number
    /// of threads.
    #[must_use]
    pub fn split(
        splats: &Splats,
        found: &FusedSurfaces<'_>,
        occluders: &Occluders,
        known: KnownSun,
        cameras: &[Camera],
        site: &Site,
    ) -> Self {
        let fine = Surfaces::new(found);
        let metres = site.metres_per_unit * f64::from(fine.extent());
        if !(PLACE_EXTENTS_M[0]..PLACE_EXTENTS_M[1]).contains(&metres) {
            return Self::in_the_open(splats, site);
        }
        let mut surfaces = fine.thinned((SURFACE_SPACING_M / site.metres_per_unit) as f32);
        let coarseness = coarseness(&surfaces, site);
        let coarser = occluders.coarser(f64::from(coarseness));
        let occluders = if coarseness > 1.0 { &coarser } else { occluders };
        mark_leaves(&mut surfaces, coarseness, site);
        level_ground(&mut surfaces, &FarFloor::new(found, site), site);
        let open = openness::find(&mut surfaces, occluders, site);
        let [narrow, wide] = [sun_search::NARROW_PAIR_M, sun_search::WIDE_PAIR_M]
            .map(|apart| sun_search::pairs(&surfaces, apart.map(|metres| coarseness * metres), site));
        // Under a grey sky a known sun may have shone or not: shadows tell.
        let is_asked = known.direction.is_none() || site.captured_sky == CapturedSky::Overcast;
        let search = is_asked.then(|| {
            let elevation = known.elevation;
            sun_search::find_sun(&surfaces, &open, &narrow, &wide, occluders, coarseness, site, elevation)
        });
        let search = search.flatten();
        let up = Vec3::from_array(site.up.map(|v| v as f32));
        let sun = known
            .direction
            .or_else(|| search.filter(|found| found.is_sun(site.up)).map(|found| found.direction));
        let sun = sun.filter(|sun| dot(*sun, site.up) > LOWEST_SUN);
        let split = sun
            .and_then(|sun| Split::new(&surfaces, &open, &wide, occluders, coarseness, sun, cameras, site));
        let (capture_sun, seen, amounts) = match split {
            Some(split) => (Some(split.sun), split.seen, split.amounts),
            None => (None, vec![0.0; surfaces.len()], Vec::new()),
        };
        let place = |i: usize| {
            surface_of(surfaces.normals[i], open[i], seen[i], up, capture_sun.map(|sun| sun.direction))
        };
        let light = captured_light(capture_sun.as_ref(), site);
        let mean = MeanSurface::new((0..surfaces.len()).map(place));
        let is_overcast = match site.captured_sky {
            // Photos that show little of the sky may show its clouds alone: shadows tell more.
            CapturedSky::Overcast => capture_sun.is_none() && search.is_none_or(|search| search.is_none()),
            CapturedSky::Burned => search.is_some_and(|search| search.is_none()),
            _ => false,
        };
        let is_known = capture_sun.is_some() || is_overcast;
        let exposure = exposure(&surfaces, &light, is_known, mean.under(&light), up, place);
        let of_sky =
            capture_sun.map_or(1.0, |sun| 1.0 / (1.0 + luminance(sun.ratio) * dot(sun.direction, site.up)));
        let under_light = mean.under(&light);
        let card = WhiteCard::new(&surfaces, site, of_sky, is_overcast, |i| {
            luminance(place(i).irradiance(&light, under_light))
        });
        let own: Vec<SplatLight> = (0..surfaces.len())
            .map(|i| SplatLight {
                normal: surfaces.normals[i].to_array().map(|v| (127.0 * v).round() as i8),
                open: open[i].map(|v| (255.0 * v).round() as u8),
                sun: share_number(seen[i]),
                is_sky: false,
            })
            .collect();
        // What a training lost below its ground goes by the ground above it.
        let grids = [NEAR_REACH_M, FAR_REACH_M].map(|metres| {
            let reach = (metres / site.metres_per_unit) as f32;
            (PointGrid::new(&surfaces.points, reach), reach)
        });
        let points = found.places(splats);
        let splats = map(splats.len(), |index| {
            if splats.groups[index] == Group::Sky {
                return SplatLight { is_sky: true, ..IN_THE_OPEN };
            }
            let point = Vec3::from_array(points[index]);
            let distance = |i: &usize| surfaces.points[*i].distance_squared(point);
            let within = |grid: usize| {
                let (grid, reach) = &grids[grid];
                grid.near(point).filter(move |i| distance(i) <= reach * reach)
            };
            let nearest = (0..grids.len()).find_map(|grid| {
                within(grid).min_by(|a, b| distance(a).total_cmp(&distance(b)).then(a.cmp(b)))
            });
            let Some(nearest) = nearest else { return IN_THE_OPEN };
            let around = || within(0);
            let is_trained = found.oriented > 0;
            let share = if is_trained {
                edge_share(&surfaces, &amounts, &seen, nearest, around, light_of(splats, index))
            } else {
                sharpened_share(&surfaces, &amounts, &seen, nearest, around, splats, index)
            };
            share.map_or(own[nearest], |share| SplatLight { sun: share_number(share), ..own[nearest] })
        });
        Self { sun: capture_sun, is_overcast, search, light, mean, exposure, card, splats }
    }

    /// The light of a scene of whose surfaces nothing is known: all of it sees the sky.
    fn in_the_open(splats: &Splats, site: &Site) -> Self {
        let of = |group: &Group| SplatLight { is_sky: *group == Group::Sky, ..IN_THE_OPEN };
        Self {
            sun: None,
            is_overcast: site.captured_sky == CapturedSky::Overcast,
            search: None,
            light: captured_light(None, site),
            mean: MeanSurface::new(std::iter::empty()),
            exposure: 1.0,
            card: WhiteCard::USUAL,
            splats: splats.groups.iter().map(of).collect(),
        }
    }

    /// Returns true if the sun's shadows can be taken away: they were found, and little of them is
    /// left.
    #[must_use]
    pub fn is_split(&self) -> bool {
        self.sun.is_some_and(|sun| sun.contrast_left <= MOST_LEFT)
    }

    /// A line about the sun that was found, or about the reason for none.
    #[must_use]
    pub fn report(&self, up: [f64; 3]) -> String {
        let height = |direction: [f64; 3]| dot(direction, up).clamp(-1.0, 1.0).asin().to_degrees();
        if let Some(sun) = &self.sun {
            let [r, g, b] = sun.ratio;
            return format!(
                "a sun {:.1} degrees high, towards {}, {r:.1} / {g:.1} / {b:.1} times the sky's light; {:.0} % of what faces it lies in \
                 it; {:.0} % of the contrast of shadows is left when they are taken away",
                height(sun.direction),
                direction_text(sun.direction),
                100.0 * sun.lit,
                100.0 * sun.contrast_left
            );
        }
        if self.is_overcast {
            return "no sun: the place was captured under clouds".into();
        }
        match &self.search {
            None => {
                "no sun to take away: shadows on the ground are too few or too faint to measure its light"
                    .into()
            }
            Some(found) if found.is_sun(up) => format!(
                "no sun: shadows fit one {:.1} degrees high, towards {}, but are too few or too faint to measure it",
                height(found.direction),
                direction_text(found.direction),
            ),
            Some(FoundSun { direction, score, rival }) => format!(
                "no sun: the best direction, {:.1} degrees high, towards {}, explains too little (score {score:.1}; {rival:.1} far from it)",
                height(*direction),
                direction_text(*direction),
            ),
        }
    }

    /// The share of the captured sun that reaches each splat, 0-1; 0 without a sun.
    pub fn sun_shares(&self) -> impl Iterator<Item = f32> {
        let has_sun = self.sun.is_some();
        self.splats.iter().map(move |splat| if has_sun { splat.sun_share().clamp(0.0, 1.0) } else { 0.0 })
    }

    /// The share of an even sky's light that reaches each splat, 0-1.
    pub fn open_shares(&self) -> impl Iterator<Item = f32> {
        self.splats.iter().map(|splat| f32::from(splat.open[0]) / 255.0)
    }

    /// The number of splats.
    pub(crate) fn len(&self) -> usize {
        self.splats.len()
    }

    /// The geometry of the light on one splat.
    #[must_use]
    pub fn surface(&self, index: usize, up: [f64; 3]) -> SurfaceLight {
        self.surface_beside(index, self.normal(index), up, None)
    }

    /// The geometry of the light on a small surface with this normal that sees what a splat sees.
    /// `shadows` are those of another sun than the captured one.
    pub(super) fn surface_beside(
        &self,
        index: usize,
        normal: Vec3,
        up: [f64; 3],
        shadows: Option<&SunShadows>,
    ) -> SurfaceLight {
        let SplatLight { open, .. } = self.splats[index];
        let seen = shadows.map_or_else(|| self.splats[index].sun_share(), |shadows| shadows.seen(index));
        let direction = shadows.map(SunShadows::direction).or(self.sun.map(|sun| sun.direction));
        let up = Vec3::from_array(up.map(|v| v as f32));
        surface_of(normal, open.map(|v| f32::from(v) / 255.0), seen, up, direction)
    }

    /// Light on a splat that sees all of the sky and of the sun.
    pub(super) fn surface_in_the_open(
        &self,
        normal: Vec3,
        up: [f64; 3],
        shadows: Option<&SunShadows>,
    ) -> SurfaceLight {
        let direction = shadows.map(SunShadows::direction).or(self.sun.map(|sun| sun.direction));
        surface_of(normal, [1.0; 2], 1.0, Vec3::from_array(up.map(|v| v as f32)), direction)
    }

    /// The shares of the sky's light that reach a splat, as [`SurfaceLight::open`].
    pub(super) fn open(&self, index: usize) -> [f32; 2] {
        self.splats[index].open.map(|v| f32::from(v) / 255.0)
    }

    /// The light of a white card in an irradiance as the photos would show it, display values in
    /// linear light: the colour of a surface over it is its reflectance.
    #[must_use]
    pub fn white(&self, irradiance: f64) -> f64 {
        self.card.light(irradiance)
    }

    /// The normal of the surface of a splat, length 1; zero of leaves.
    #[must_use]
    pub fn normal(&self, index: usize) -> Vec3 {
        Vec3::from_array(self.splats[index].normal.map(|v| f32::from(v) / 127.0)).normalize_or_zero()
    }

    /// Returns true for a splat of the captured sky.
    pub(crate) fn is_sky(&self, index: usize) -> bool {
        self.splats[index].is_sky
    }

    /// Returns true if another sun can shine on the place: it has no shadows, or is said to have
    /// none, or they can be taken away.
    #[must_use]
    pub fn takes_another_sun(&self, is_diffuse: bool) -> bool {
        self.is_split() || (self.sun.is_none() && (self.is_overcast || is_diffuse))
    }

    /// Sine of the elevation of the captured sun; 0 without one.
    pub(crate) fn sin_sun(&self, up: [f64; 3]) -> f64 {
        self.sun.map_or(0.0, |sun| dot(sun.direction, up))
    }

    /// The mean irradiance of the surfaces under a light, without what they return to each other;
    /// `shadows` are those of another sun.
    pub(crate) fn mean_in(&self, light: &SceneLight, shadows: Option<&SunShadows>) -> [f64; 3] {
        MeanSurface { sun: shadows.map_or(self.mean.sun, |shadows| shadows.mean), ..self.mean }.under(light)
    }

    /// The mean irradiance of the surfaces under a light, without what they return to each other.
    #[must_use]
    pub fn mean(&self, light: &SceneLight) -> [f64; 3] {
        self.mean.under(light)
    }
}

fn direction_text(direction: [f64; 3]) -> String {
    let [x, y, z] = direction;
    format!("{x:.3}, {y:.3}, {z:.3}")
}

/// The brightness of a white card in an irradiance of 1, display values, from 1 to
/// [`MAX_EXPOSURE`]: the median of what the surfaces say, since photos of a courtyard are exposed
/// for its shade. If the light is not known, the median over the ground counts too: the ground may
/// lie in a sun that the search missed. Ground as bright as the quantile [`DARK_GROUND`] shows the
/// card at most as display white.
fn exposure(
    surfaces: &Surfaces,
    light: &SceneLight,
    is_known: bool,
    mean: [f64; 3],
    up: Vec3,
    place: impl Fn(usize) -> SurfaceLight,
) -> f64 {
    let (mut cards, mut ground_cards, mut ground) = (Vec::new(), Vec::new(), Vec::new());
    for i in (0..surfaces.len()).filter(|i| surfaces.normals[*i] != Vec3::ZERO) {
        let irradiance = luminance(place(i).irradiance(light, mean)).max(1e-3);
        let card = luminance(surfaces.light[i].to_array().map(f64::from)) / MEAN_ALBEDO / irradiance;
        cards.push(card);
        if surfaces.normals[i].dot(up) > MIN_GROUND_COSINE {
            ground.push(irradiance);
            ground_cards.push(card);
        }
    }
    let has_sun = luminance(light.sun) > 0.0;
    let (Some(card), Some(ground)) = (median(cards), quantile(ground, DARK_GROUND[usize::from(has_sun)]))
    else {
        return 1.0;
    };
    let by_ground = median(ground_cards).filter(|_| !is_known).unwrap_or(0.0);
    (card / MAX_USUAL_EXPOSURE).max(by_ground).min(1.0 / ground).clamp(1.0, MAX_EXPOSURE)
}

/// Distance between surfaces that the distances of this module are meant for.
const REFERENCE_SPACING_M: f32 = 0.1;

/// The factor by which the surfaces are farther apart than [`REFERENCE_SPACING_M`], 1 to 10.
fn coarseness(surfaces: &Surfaces, site: &Site) -> f32 {
    let metres = site.metres_per_unit as f32;
    (surfaces.spacing(10.0 * REFERENCE_SPACING_M / metres) * metres / REFERENCE_SPACING_M).clamp(1.0, 10.0)
}

/// Takes the normals of leaves away: those about them turn to all sides.
fn mark_leaves(surfaces: &mut Surfaces, coarseness: f32, site: &Site) {
    let reach = coarseness * LEAF_RADIUS_M / site.metres_per_unit as f32;
    let grid = PointGrid::new(&surfaces.points, reach);
    let agreed = map(surfaces.len(), |i| {
        let (own, mut sum, mut count) = (surfaces.normals[i], Vec3::ZERO, 0.0f32);
        for other in grid.near(surfaces.points[i]) {
            let normal = surfaces.normals[other];
            if surfaces.points[other].distance_squared(surfaces.points[i]) < reach * reach
                && normal != Vec3::ZERO
            {
                sum += if normal.dot(own) < 0.0 { -normal } else { normal };
                count += 1.0;
            }
        }
        sum.length() >= MIN_LEAF_AGREEMENT * count
    });
    for (normal, agreed) in surfaces.normals.iter_mut().zip(agreed) {
        if !agreed {
            *normal = Vec3::ZERO;
        }
    }
}

/// Gives level normals to ground without normals: a rough capture turns them to all sides, and as
/// leaves the ground would count as lit by half. Lawns stay leaves.
fn level_ground(surfaces: &mut Surfaces, floor: &FarFloor, site: &Site) {
    let up = Vec3::from_array(site.up.map(|v| v as f32));
    for i in 0..surfaces.len() {
        let is_green =
            || surfaces.light[i].y > GREEN_EXCESS_RATIO as f32 * surfaces.light[i].x.max(surfaces.light[i].z);
        let is_ground = || floor.holds(surfaces.points[i].to_array().map(f64::from));
        if surfaces.normals[i] == Vec3::ZERO && !is_green() && is_ground() {
            surfaces.normals[i] = up;
        }
    }
}
