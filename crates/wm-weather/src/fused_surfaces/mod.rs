//! The surfaces of a scene as the cameras of its photos see them.
//!
//! A trained scene looks right from where its photos were taken, and is rough or worse from
//! anywhere else: a street of wide splats seen at a slant has holes from above and junk below,
//! facades have lumps, and haze floats where no photo tells. What the cameras see is much better
//! known. So what lies and what shelters is found on a scan: the depth that each camera sees (with
//! at least half of the light stopped), as small discs with normals, all cameras' together.
//!
//! # How it is made
//! Each pixel gives a place and, but at edges, a normal from the places about it. Those of all
//! cameras are averaged in cubes as wide as pixels are apart there (`cubes.rs`), nearer views
//! counting more, and none from where they would be metres apart; before that, ground at a grazing
//! angle is put on the ground field of all views (`ground_field.rs`). What other cameras see
//! through is dropped (`photo_view.rs`); and the discs are levelled onto the surface through those
//! about them (`level.rs`), since depth is rough. The scene's own splats stay where no camera
//! tells: those that none sees, and that not two see through.

mod backing;
mod cubes;
mod floor;
mod ground_field;
mod ground_views;
mod level;
mod normals;
mod photo_view;
#[cfg(test)]
mod tests;

use crate::optics::Site;
use crate::surfel::surfel;
use crate::threads::map;
use cubes::Disc;
pub use floor::FloorPlane;
use glam::DVec3;
pub use ground_field::GroundField;
pub use photo_view::PhotoView;
use photo_view::{PointEvidence, ViewEvidence};
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use wm_scene::splats::Splat;
use wm_scene::{Group, Splats};

/// The number of cameras that must see through a point for it to be dropped.
const MIN_CAMERA_COUNT: u32 = 2;
/// Distance, m, that a disc must have been moved by to be asked for again.
const MIN_MOVE_M: f64 = 0.02;
/// Standard deviations of a disc along the surface, and of a ball, in cubes; through a disc, in
/// those; and opacity.
const DISC_SIGMAS: [f64; 2] = [0.6, 0.4];
const DISC_FLATNESS_RATIO: f64 = 0.1;
const DISC_OPACITY: f64 = 0.95;

/// The surfaces of a scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FusedSurfaces<'a> {
    /// The surfaces as splats.
    pub splats: Cow<'a, Splats>,
    /// The first so many are discs whose third axis looks to where they were seen from.
    pub(crate) oriented: usize,
    /// Splats that make the space behind the discs solid, such as the houses behind walls: they
    /// stop light and are not seen.
    backing: Cow<'a, Splats>,
    /// The replacement of each splat of the scene; empty where no views were given.
    pub(crate) stand_ins: Vec<StandIn>,
    /// The places that [`Self::places`] returns; empty where no splat was moved.
    places: Vec<[f32; 3]>,
}

/// The replacement of a splat of the scene in its fused surfaces.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) enum StandIn {
    /// It is still there.
    Itself,
    /// Discs, or nothing since cameras see through it.
    Discs,
    /// The ground of a walk: it is what a training made of that.
    Floor,
}

impl<'a> FusedSurfaces<'a> {
    /// Returns true if its parts fit each other and a scene of `splats` splats, as an asset that a
    /// stranger made may not.
    #[must_use]
    pub fn is_consistent(&self, splats: usize) -> bool {
        let is_drawn = |splats: &Splats| splats.check().is_ok() && splats.check_finite().is_ok();
        is_drawn(&self.splats)
            && is_drawn(&self.backing)
            && self.oriented <= self.splats.len()
            && (self.stand_ins.is_empty() || self.stand_ins.len() == splats)
            && (self.places.is_empty() || self.places.len() == splats)
            && self.places.as_flattened().iter().all(|place| place.is_finite())
    }

    /// The splats themselves, for a scene without photos.
    #[must_use]
    pub fn from_splats(splats: &'a Splats) -> Self {
        Self {
            splats: Cow::Borrowed(splats),
            oriented: 0,
            backing: Cow::default(),
            stand_ins: Vec::new(),
            places: Vec::new(),
        }
    }

    /// The surfaces with splats of their own.
    #[must_use]
    pub fn into_owned(self) -> FusedSurfaces<'static> {
        FusedSurfaces {
            splats: Cow::Owned(self.splats.into_owned()),
            backing: Cow::Owned(self.backing.into_owned()),
            oriented: self.oriented,
            stand_ins: self.stand_ins,
            places: self.places,
        }
    }

    /// Returns what stands in the way of light: the discs that the cameras see and what is behind
    /// them, without the splats that no camera confirms; all splats where there are no photos.
    #[must_use]
    pub fn casters(&self) -> Cow<'_, Splats> {
        if self.oriented == 0 {
            return Cow::Borrowed(&*self.splats);
        }
        let mut casters = self.splats.select(&(0..self.oriented).collect::<Vec<_>>());
        casters.append(&self.backing);
        Cow::Owned(casters)
    }

    /// The places at which the splats of a scene are seen, world axes, scene units. Training leaves
    /// the ground of a walk at any depth: its splats are where the camera nearest to each sees them
    /// on the ground that replaces them.
    #[must_use]
    pub fn places<'s>(&'s self, splats: &'s Splats) -> &'s [[f32; 3]] {
        if self.places.is_empty() { &splats.means } else { &self.places }
    }

    /// Fuses the surfaces that the cameras see and keeps the splats that none sees. Equal for any
    /// number of threads.
    #[must_use]
    pub fn from_views(splats: &'a Splats, views: &[PhotoView], site: &Site) -> Self {
        if views.is_empty() {
            return Self::from_splats(splats);
        }
        let metres_per_unit = site.metres_per_unit;
        let witnesses = map(views.len(), |index| views[index].witness());
        let hears_of = |middle: DVec3, radius: f64| {
            let mut said = CameraVotes::default();
            let evidence = |witness: &ViewEvidence| witness.evidence_at_ball(middle, radius, metres_per_unit);
            witnesses.iter().for_each(|witness| said.add(evidence(witness)));
            said
        };
        let hears = |point: DVec3| hears_of(point, 0.0);
        let mut discs = cubes::fuse(views, site.up, metres_per_unit);
        let carve = |discs: &mut Vec<Disc>, is_asked: &(dyn Fn(usize, &Disc) -> bool + Sync)| {
            let is_free = |k: usize| is_asked(k, &discs[k]) && hears(discs[k].point).is_free();
            let mut free = map(discs.len(), is_free).into_iter();
            discs.retain(|_| !free.next().unwrap_or(false));
        };
        // Before they are levelled, since what is not there levels nothing; and what that has moved
        // into the open.
        carve(&mut discs, &|_, _| true);
        let before: Vec<DVec3> = discs.iter().map(|disc| disc.point).collect();
        level::level(&mut discs, metres_per_unit);
        let moved = MIN_MOVE_M / metres_per_unit;
        carve(&mut discs, &|k, disc| disc.point.distance_squared(before[k]) > moved * moved);
        let stand_ins = map(splats.len(), |index| match splats.groups[index] {
            Group::Sky => StandIn::Itself,
            _ => {
                let [a, b, c] = splats.scales(index);
                hears_of(DVec3::from_array(splats.means[index].map(f64::from)), a.max(b).max(c)).stand_in()
            }
        });
        let up = DVec3::from_array(site.up);
        let is_hidden = |point: DVec3| hears(point).through == 0;
        let backing = backing::behind(&discs, &is_hidden, up, metres_per_unit);
        let mut out = Splats::with_capacity(discs.len(), 0);
        for disc in &discs {
            let (wide, flat) =
                if disc.is_edge { (DISC_SIGMAS[1], 0.9) } else { (DISC_SIGMAS[0], DISC_FLATNESS_RATIO) };
            let wide = wide * disc.size;
            let (at, scales) = (disc.point.to_array(), [wide, wide, flat * wide]);
            out.push(&Splat {
                group: Group::Scene,
                ..surfel(at, disc.normal, up, scales, disc.rgb, DISC_OPACITY)
            });
        }
        let has_floor = stand_ins.contains(&StandIn::Floor);
        let places = map(if has_floor { splats.len() } else { 0 }, |index| {
            let mean = DVec3::from_array(splats.means[index].map(f64::from));
            let seen = |view: &PhotoView| view.on_ground(mean);
            let nearest = match stand_ins[index] {
                StandIn::Floor => views.iter().filter_map(seen).min_by(|a, b| a.1.total_cmp(&b.1)),
                _ => None,
            };
            nearest.map_or(splats.means[index], |(place, _)| place.as_vec3().to_array())
        });
        let left = (0..splats.len()).filter(|index| stand_ins[*index] == StandIn::Itself);
        let rest = splats.select(&left.collect::<Vec<_>>());
        out.append(&rest);
        Self {
            splats: Cow::Owned(out),
            oriented: discs.len(),
            backing: Cow::Owned(backing),
            stand_ins,
            places,
        }
    }
}

/// The evidence of all cameras about a point: numbers of cameras.
#[derive(Clone, Copy, Debug, Default)]
struct CameraVotes {
    seen: u32,
    through: u32,
    /// Cameras of either kind that see a floor there.
    seen_floor: u32,
    through_floor: u32,
}

impl CameraVotes {
    fn add(&mut self, evidence: PointEvidence) {
        let (count, floors, floor) = match evidence {
            PointEvidence::OnSurface { floor } => (&mut self.seen, &mut self.seen_floor, floor),
            PointEvidence::SeenThrough { floor } => (&mut self.through, &mut self.through_floor, floor),
            PointEvidence::Unknown => return,
        };
        *count += 1;
        *floors += u32::from(floor);
    }

    /// Returns true if cameras see through the point: several and more than see it, or to a floor
    /// no fewer than see it.
    fn is_free(self) -> bool {
        if self.through_floor > 0 {
            return self.through > self.seen || self.through_floor >= self.seen;
        }
        self.through >= MIN_CAMERA_COUNT && self.through > self.seen
    }

    fn stand_in(self) -> StandIn {
        match self {
            _ if self.seen == 0 && !self.is_free() => StandIn::Itself,
            _ if 2 * (self.seen_floor + self.through_floor) > self.seen + self.through => StandIn::Floor,
            _ => StandIn::Discs,
        }
    }
}
