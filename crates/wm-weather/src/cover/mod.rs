//! Snow, dust and ash that lie.
//!
//! # How much lies where
//! The fall reaches the surfaces of the scene ([`ground`]) by how open they are and by what the
//! wind does with it ([`exposure`]), slides off what is too steep for it and lies below
//! ([`settle`]), and melts. Depth is requested as that on open level ground, or follows from what
//! has fallen until then ([`snowpack`]). It melts slower in the shade, and later where more of it
//! lies ([`thaw`]). All of it is kept account of: what fell is what lies, what has melted, and what
//! is left on walls, falls through leaves or is blown away.
//!
//! Nothing lies on open water ([`crate::open_water`]).
//!
//! # Several
//! Snow lies on sand: each slides and melts by itself on the bare ground, and the later is laid on
//! top of the earlier, that is seen as far as the later does not cover it. The wind carries them
//! all as it does the one that it takes up first.
//!
//! # Over time
//! The ground is found once a scene. On it what has slid is found for a ladder of depths, each 1.5
//! times the one before; between two of them depths are mixed. So a frame at any time can be had
//! alone, and costs no sliding after the first.
//!
//! # How it is drawn
//! As splats of its own on its own surface ([`surfels`]), opaque and lit as the place is
//! (`shading.rs`); and the scene's splats that it buries are hidden, so that none shines through
//! ([`Buried`]). Thin snow covers a share of the ground only, and what has melted leaves it wet
//! until it has dried.
//!
//! # Departures from the paper
//! The paper makes those splats white that face up, and fills planes between them with white ones:
//! it snows under roofs, and white shows through what stands in front. That is [`crate::paper`]'s.

mod airflow;
pub(crate) mod exposure;
pub(crate) mod ground;
pub(crate) mod settle;
mod shading;
pub(crate) mod snowpack;
pub(crate) mod surfels;
#[cfg(test)]
mod tests;
pub(crate) mod thaw;
pub(crate) mod walls;

use crate::fused_surfaces::{FusedSurfaces, StandIn};
use crate::level::level_axes;
use crate::open_water::OpenWater;
use crate::optics::Site;
use crate::shelter::{Occluders, ShelterOptions};
use crate::threads::map;
pub use airflow::Airflow;
use glam::DVec3;
use ground::GroundGrid;
use serde::{Deserialize, Serialize};
pub(crate) use settle::Settled;
pub(crate) use snowpack::Snowpack;
pub use surfels::CoverMaterial;
pub(crate) use surfels::coverage;
use thaw::CoverState;
pub(crate) use thaw::{MeltSample, Thaw};
use walls::Wall;
use wm_render::hooks::{Attribute, AttributeBlock, Revision, SplatAttributes};
use wm_scene::{Group, Splats};

/// Depth below its ground to which a splat is buried with it, m: splats are that rough.
const BURIAL_DEPTH_M: f32 = 0.08;
/// Largest height of a splat above its ground, m, and the largest depth below a plain of one that
/// is replaced.
const MAX_SPLAT_HEIGHT_M: f32 = 1.5;
/// Height above and below other level ground within which a replaced splat belongs to it.
const HAZE_HEIGHTS_M: [f32; 2] = [0.25, 0.3];
/// Cells along a side of a ring, and how many times as wide those of the next ring are.
const RING_SIDE_CELLS: f64 = 420.0;
const RING_WIDTH_FACTOR: f64 = 4.0;
/// Factor on the number of a ring's cells along a path.
const PATH_LENGTH_FACTOR: f64 = 3.0;
const MAX_RING_COUNT: usize = 4;
const MIN_CELL_WIDTH_M: f64 = 0.06;
/// Share of the splats beyond the widest ring on each side: far hills are few splats.
const OUTLIER_SHARE: f64 = 0.000_5;
/// The lowest depth of the ladder, m, and how many times as deep each next one is.
const MIN_RUNG_DEPTH_M: f64 = 0.005;
const RUNG_RATIO: f64 = 1.5;
/// Number of rungs kept.
const MAX_RUNGS: usize = 4;

/// A cover to be laid out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CoverRequest {
    /// All that has come down on open level ground, m, as deep as it would lie at the instant had
    /// none melted.
    pub depth: f64,
    /// The remaining depths; `None` where nothing has melted.
    pub thaw: Option<Thaw>,
    /// Depth that has come down wet, so that it sticks to walls where the wind throws it at them,
    /// m.
    pub wet_fall: f64,
    /// Steepest that it lies, as a tangent.
    pub repose: f64,
    /// Wind that carries it along the ground, m/s at 10 m.
    pub threshold: f64,
    /// The material.
    pub material: CoverMaterial,
}

impl CoverRequest {
    /// Returns true if nothing of it is visible anywhere.
    pub(crate) fn is_nothing(&self) -> bool {
        self.wet_fall <= 0.0 && self.thaw.map_or(self.depth <= 0.0, |thaw| thaw.is_over())
    }
}

/// A place that something can lie on.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Cover {
    /// Around where the photos were taken, and farther out in wider cells.
    rings: Vec<GroundGrid>,
    metres_per_unit: f64,
    /// The place of each splat of the scene on the ground; `None` for those that nothing buries.
    spots: Vec<Option<Spot>>,
    walls: Vec<Wall>,
    /// Depths after sliding for some depths and angles of repose, the last used at the end.
    ladder: Vec<Rung>,
    /// Always 0: older programs write their number of threads here, and files stay readable.
    reserved: usize,
}

/// The depths after sliding for one depth of the ladder.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct Rung {
    depth: f64,
    repose: f64,
    settled: Vec<Settled>,
}

/// The cover that is left on a ring.
struct SettledLayer {
    settled: Settled,
    /// Wetness of the ground, 0-1.
    wet: Vec<f32>,
    /// Melted amount, as a depth on one cell, m.
    melted: f64,
}

/// The position of a splat on the ground.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
struct Spot {
    ring: u8,
    /// The nodes under its middle and its ends.
    nodes: [u32; SPLAT_PROBE_COUNT],
    /// Height that it reaches above the ground, m.
    reach: f32,
    /// True if it is no surface of its own: it is hidden where most of its nodes are.
    is_haze: bool,
}

/// Places of a splat that must lie under snow for it to be hidden.
const SPLAT_PROBE_COUNT: usize = 5;

/// A cover that is laid out, ready to be drawn.
#[derive(Clone, Debug)]
pub struct LyingCover {
    /// The splats of it.
    pub splats: Splats,
    /// The visibility of the scene's splats below it.
    pub buried: Buried,
    /// The depths on each ring; of several covers the lowest on each ring first.
    pub settled: Vec<Settled>,
    /// Melted amounts of each of those, as depths on one cell, m.
    #[allow(dead_code, reason = "read by the tests that balance what fell and what became of it")]
    melted: Vec<f64>,
}

/// The visible share of each splat of the scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Buried {
    factors: Vec<f32>,
    revision: Revision,
}

impl SplatAttributes for Buried {
    fn fill(&self, indices: &[u32], block: &mut AttributeBlock) {
        for (index, factor) in indices.iter().zip(block.column_mut(Attribute::Visibility)) {
            *factor = self.factor(*index as usize);
        }
    }

    fn revision(&self) -> Option<Revision> {
        Some(self.revision)
    }
}

impl LyingCover {
    /// Splats that hide none of the scene's.
    #[must_use]
    pub fn on_top(splats: Splats) -> Self {
        Self { splats, buried: Buried::default(), settled: Vec::new(), melted: Vec::new() }
    }

    /// The scene with what lies on it, as one set of splats: those of the scene keep their places,
    /// buried ones are transparent.
    #[must_use]
    pub fn over(&self, scene: &Splats) -> Splats {
        self.lay_on_splats(scene, scene.clone(), 0..scene.len())
    }

    /// The scene with what lies on it, as one set of splats of the scene's SH degree.
    #[must_use]
    pub fn bake(&self, scene: &Splats) -> Splats {
        let is_seen = |index: &usize| self.buried.factor(*index) > MIN_VISIBILITY;
        let kept: Vec<usize> = (0..scene.len()).filter(is_seen).collect();
        self.lay_on_splats(scene, scene.select(&kept), kept)
    }

    /// Lays it on splats of the scene, whose places there are `of`.
    fn lay_on_splats(&self, scene: &Splats, mut out: Splats, of: impl IntoIterator<Item = usize>) -> Splats {
        for (opacity, index) in out.logit_opacities.iter_mut().zip(of) {
            let factor = self.buried.factor(index);
            if factor < 1.0 {
                *opacity = wm_scene::splats::logit(scene.opacity(index) * f64::from(factor)) as f32;
            }
        }
        out.append(&self.splats);
        out
    }
}

/// Visibility below which a splat is invisible: 1/255.
const MIN_VISIBILITY: f32 = 1.0 / 255.0;

impl Buried {
    fn new(factors: Vec<f32>) -> Self {
        let revision = Revision::of(factors.iter().map(|factor| factor.to_bits()));
        Self { factors, revision }
    }

    fn factor(&self, index: usize) -> f32 {
        self.factors.get(index).copied().unwrap_or(1.0)
    }
}

impl Cover {
    /// Returns true if its parts fit each other and a scene of `splats` splats, as an asset that a
    /// stranger made may not.
    #[must_use]
    pub fn is_consistent(&self, splats: usize) -> bool {
        let fits = |settled: &Settled, ground: &GroundGrid| {
            settled.depth.len() == ground.len() && settled.depth.iter().all(|depth| depth.is_finite())
        };
        let is_spot = |spot: &Spot| {
            let ring = self.rings.get(usize::from(spot.ring));
            ring.is_some_and(|ring| spot.nodes.iter().all(|node| (*node as usize) < ring.len()))
        };
        self.metres_per_unit.is_finite()
            && self.metres_per_unit > 0.0
            && !self.rings.is_empty()
            && self.rings.iter().all(|ground| ground.is_consistent(splats))
            && self.spots.len() == splats
            && self.spots.iter().flatten().all(is_spot)
            && self.walls.iter().all(Wall::is_finite)
            && self.ladder.iter().all(|rung| {
                rung.settled.len() == self.rings.len()
                    && rung.settled.iter().zip(&self.rings).all(|(settled, ground)| fits(settled, ground))
            })
    }

    /// Builds the ground of a scene, on the surfaces of its scan; air may carry what falls. Cells
    /// are narrowest about a `path`, a line from one end to the other (world, scene units), or
    /// about its middle where it is long.
    #[must_use]
    pub fn of(
        splats: &Splats,
        scan: &FusedSurfaces<'_>,
        site: &Site,
        airflow: &Airflow,
        path: [[f64; 3]; 2],
    ) -> Self {
        let (mut rings, mut above) = (Vec::<GroundGrid>::new(), Vec::new());
        let mut occluders = Occluders::of(&scan.splats, site, &ShelterOptions::default());
        let is_path = path[0] != path[1];
        for ring in 0..MAX_RING_COUNT {
            let cell = MIN_CELL_WIDTH_M * RING_WIDTH_FACTOR.powi(ring as i32);
            let reach = if ring + 1 == MAX_RING_COUNT { f64::INFINITY } else { 0.5 * RING_SIDE_CELLS * cell };
            let options = ShelterOptions {
                cell,
                // Only what goes along a path is longer; the outermost ring is the whole place.
                most_cells: (RING_SIDE_CELLS
                    * RING_SIDE_CELLS
                    * if is_path && reach.is_finite() { PATH_LENGTH_FACTOR } else { 1.0 })
                    as usize,
                focus: reach
                    .is_finite()
                    .then(|| (path_middle(path, reach / site.metres_per_unit, site), reach)),
                margin: 0.1,
                outliers: OUTLIER_SHARE,
                ..ShelterOptions::default()
            };
            occluders = occluders.mapped(&options);
            let (ground, floaters) = GroundGrid::new(scan, &occluders, rings.last());
            let is_whole = ground.places.is_whole();
            rings.push(ground);
            above.push((options, floaters));
            if is_whole {
                break;
            }
        }
        let maps = exposure::maps(&occluders, &above, site, airflow);
        for (ground, maps) in rings.iter_mut().zip(&maps) {
            ground.expose(scan, maps, site, airflow);
        }
        let spots = map(splats.len(), |index| {
            let stand_in = scan.stand_ins.get(index).copied().unwrap_or(StandIn::Itself);
            spot(&rings, splats, index, site.metres_per_unit, stand_in)
        });
        // The widest ring's cells are too wide to tell the lee of a house.
        let occluders = occluders.mapped(&ShelterOptions::default());
        let walls = walls::find(&scan.splats, &occluders, site, airflow);
        Self { rings, metres_per_unit: site.metres_per_unit, spots, walls, ladder: Vec::new(), reserved: 0 }
    }

    /// Removes the cover from open water.
    #[must_use]
    pub fn off_water(mut self, water: &OpenWater) -> Self {
        self.rings.iter_mut().for_each(|ground| ground.keep_bare(|point| water.covers(point)));
        self
    }

    /// Returns the share of the ground that covers hide at a point (world, scene units) of the
    /// ground, 0-1, by their `depths` on each ring, m, as [`LyingCover::settled`] lists them.
    #[must_use]
    pub fn hides(&self, depths: &[Vec<f32>], point: [f64; 3]) -> f32 {
        let found = self.rings.iter().enumerate().find_map(|(ring, ground)| {
            let (place, height) = ground.places.locate(point);
            Some((ring, ground, ground.places.cell_at(place)?, height as f32))
        });
        let Some((ring, ground, cell, height)) = found else { return 0.0 };
        let off = |node: &usize| (ground.height[*node] - height).abs();
        let near = ground.nodes_of(cell).filter(|node| off(node) < ground.edge);
        let Some(node) = near.min_by(|a, b| off(a).total_cmp(&off(b))) else { return 0.0 };
        let own = depths.iter().skip(ring).step_by(self.rings.len());
        1.0 - own.map(|depths| 1.0 - coverage(depths[node])).product::<f32>()
    }

    /// Returns true if nothing can lie anywhere: no surface is known to face the sky.
    #[must_use]
    pub fn is_bare(&self) -> bool {
        self.rings.iter().all(|ground| ground.share.iter().all(|share| *share <= 0.0))
    }

    /// Lays out several covers, each on those before it.
    #[must_use]
    pub fn lay_all(&mut self, asked: &[CoverRequest]) -> LyingCover {
        let layers: Vec<Vec<SettledLayer>> = asked.iter().map(|asked| self.left(asked)).collect();
        // What is above a splat, from the lowest layer up, and how much of the ground all of it
        // leaves seen.
        let (mut tops, mut seen) = (Vec::new(), Vec::new());
        let mut splats = Splats::with_capacity(0, 0);
        for (ring, ground) in self.rings.iter().enumerate() {
            let (mut top, mut base) = (ground.height.clone(), ground.height.clone());
            let mut bare = vec![1.0; ground.len()];
            for (place, asked) in asked.iter().enumerate() {
                let SettledLayer { settled: Settled { depth, .. }, wet, .. } = &layers[place][ring];
                let above = layers.get(place + 1).map_or(&[][..], |above| &above[ring].settled.depth);
                top = surfels::surface(ground, &base, depth);
                let layer = surfels::CoverLayer { depth, top: &top, wet, above };
                surfels::add(ground, &layer, self.metres_per_unit, &asked.material, &mut splats);
                base = top.iter().zip(depth).map(|(top, depth)| surfels::drawn(*top, *depth)).collect();
                bare.iter_mut().zip(depth).for_each(|(bare, depth)| *bare *= 1.0 - coverage(*depth));
            }
            tops.push(top);
            seen.push(bare);
        }
        let up = DVec3::from_array(self.rings[0].places.axes()[2]);
        for asked in asked {
            walls::add(&self.walls, asked.wet_fall, up, self.metres_per_unit, &asked.material, &mut splats);
        }
        let factor = |index: usize| {
            let Some(Spot { ring, nodes, reach, is_haze }) = &self.spots[index] else { return 1.0 };
            let ring = usize::from(*ring);
            let (ground, seen, top) = (&self.rings[ring], &seen[ring], &tops[ring]);
            let hidden = |node: &u32| {
                let node = *node as usize;
                // Those that stick out stay.
                let sunk = ((top[node] - ground.height[node] - reach) / 0.02 + 1.0).clamp(0.0, 1.0);
                sunk * (1.0 - seen[node])
            };
            let mut hidden: [f32; SPLAT_PROBE_COUNT] = std::array::from_fn(|k| hidden(&nodes[k]));
            hidden.sort_by(f32::total_cmp);
            1.0 - hidden[if *is_haze { SPLAT_PROBE_COUNT / 2 } else { 0 }]
        };
        let buried = Buried::new(map(self.spots.len(), factor));
        let layers = layers.into_iter().flatten();
        let (settled, melted) = layers.map(|layer| (layer.settled, layer.melted)).unzip();
        LyingCover { splats, buried, settled, melted }
    }

    /// Returns the cover that is left on each ring after sliding and melting.
    fn left(&mut self, asked: &CoverRequest) -> Vec<SettledLayer> {
        let CoverRequest { depth: fell, thaw, .. } = *asked;
        // How it slides at the least depth says where even less lies.
        let slides = thaw.map_or(fell, |thaw| thaw.deepest()).max(MIN_RUNG_DEPTH_M);
        let settled = self.slid_depths(slides, asked.repose);
        let layer = |ground: &GroundGrid, slid: Settled| {
            let fell = |node: usize| slid.depth[node] * (fell / slides) as f32;
            let left = |node: usize| match &thaw {
                None => CoverState { depth: fell(node), wet: 0.0 },
                Some(thaw) => thaw.at(slid.depth[node] / slides as f32, ground.shade[node]),
            };
            let left = map(ground.len(), left);
            let melted = left.iter().enumerate().map(|(node, left)| f64::from(fell(node) - left.depth)).sum();
            let depth = map(left.len(), |node| ground.held(node, left[node].depth));
            let fell_through =
                left.iter().zip(&depth).map(|(left, held)| f64::from(left.depth - held)).sum::<f64>();
            let wet = left.into_iter().map(|left| left.wet).collect();
            let settled = Settled { depth, lost: slid.lost * asked.depth / slides + fell_through };
            SettledLayer { settled, wet, melted }
        };
        self.rings.iter().zip(settled).map(|(ground, slid)| layer(ground, slid)).collect()
    }

    /// Returns the depths on each ring after sliding, for a depth on open level ground, m, the
    /// lowest of the ladder or more: mixed of the two depths of it about that.
    fn slid_depths(&mut self, depth: f64, repose: f64) -> Vec<Settled> {
        let above = (depth / MIN_RUNG_DEPTH_M).log(RUNG_RATIO).ceil().max(1.0) as i32;
        let [low, high] = [above - 1, above].map(|k| MIN_RUNG_DEPTH_M * RUNG_RATIO.powi(k));
        self.find_slid_rungs([low, high], repose);
        let rung = |depth: f64| {
            let mut rungs = self.ladder.iter();
            &rungs.find(|rung| rung.depth == depth && rung.repose == repose).expect("just climbed").settled
        };
        let share = (depth - low) / (high - low);
        let mix = |low: &Settled, high: &Settled| Settled {
            depth: map(low.depth.len(), |node| {
                low.depth[node] + (high.depth[node] - low.depth[node]) * share as f32
            }),
            lost: low.lost + (high.lost - low.lost) * share,
        };
        rung(low).iter().zip(rung(high)).map(|(low, high)| mix(low, high)).collect()
    }

    /// Finds what has slid at two depths, if it is not known.
    fn find_slid_rungs(&mut self, depths: [f64; 2], repose: f64) {
        let is = |rung: &Rung, depth: f64| rung.depth == depth && rung.repose == repose;
        let missing: Vec<f64> =
            depths.into_iter().filter(|depth| !self.ladder.iter().any(|rung| is(rung, *depth))).collect();
        let jobs: Vec<(f64, &GroundGrid)> =
            missing.iter().flat_map(|depth| self.rings.iter().map(|ground| (*depth, ground))).collect();
        let mut settled = map(jobs.len(), |job| {
            let (depth, ground) = jobs[job];
            let fell: Vec<f32> = ground.share.iter().map(|share| share * depth as f32).collect();
            settle::settle(ground, &fell, repose as f32)
        })
        .into_iter();
        for depth in missing {
            let settled = settled.by_ref().take(self.rings.len()).collect();
            self.ladder.push(Rung { depth, repose, settled });
        }
        self.ladder.sort_by_key(|rung| depths.iter().any(|depth| is(rung, *depth)));
        let old = self.ladder.len().saturating_sub(MAX_RUNGS);
        self.ladder.drain(..old);
    }
}

/// Returns the middle part of a path for which a ring has enough cells, if the ring goes `reach`
/// scene units away from it.
fn path_middle(path: [[f64; 3]; 2], reach: f64, site: &Site) -> [[f64; 3]; 2] {
    let [a, b] = path.map(DVec3::from_array);
    let (middle, half) = (0.5 * (a + b), 0.5 * (b - a));
    let [across, along, _] = level_axes(site.up).map(|axis| half.dot(DVec3::from_array(axis)).abs());
    // Its rectangle is `PATH_LENGTH_FACTOR` times the square about a point: (1 + s x) (1 + s y)
    // with s the share that is taken.
    let [x, y] = [across / reach, along / reach];
    // The root in a form that holds where the path runs along an axis, and is one point.
    let share = 2.0 * (PATH_LENGTH_FACTOR - 1.0)
        / ((x + y) + ((x + y).powi(2) + 4.0 * x * y * (PATH_LENGTH_FACTOR - 1.0)).sqrt()).max(1e-9);
    let share = share.min(1.0);
    [middle - share * half, middle + share * half].map(|end| end.to_array())
}

/// Finds the position of a splat on the ground, if it has one.
fn spot(
    rings: &[GroundGrid],
    splats: &Splats,
    index: usize,
    metres_per_unit: f64,
    stand_in: StandIn,
) -> Option<Spot> {
    if splats.groups[index] == Group::Sky || !splats.is_sound(index) {
        return None;
    }
    let mean = splats.means[index].map(f64::from);
    let is_in = |ground: &GroundGrid, at| ground.places.cell_at(ground.places.locate(at).0).is_some();
    let ring = rings.iter().position(|ground| is_in(ground, mean))?;
    let ground = &rings[ring];
    let turn = wm_scene::quat::to_matrix(splats.quats[index].map(f64::from));
    let scales = splats.scales(index);
    let axis = |k: usize| -> [f64; 3] { std::array::from_fn(|i| turn[i][k] * scales[k]) };
    let up = ground.places.axes()[2];
    let rise = |k: usize| axis(k).iter().zip(&up).map(|(a, b)| a * b).sum::<f64>().abs() * metres_per_unit;
    let mut order = [0, 1, 2];
    order.sort_by(|a, b| scales[*b].total_cmp(&scales[*a]));
    // Those that stand up reach as far as they are long; of those that lie only their thickness
    // counts.
    let upright = (0..3).map(|k| rise(k).powi(2)).sum::<f64>().sqrt();
    let lies = rise(order[0]) < 0.35 * scales[order[0]] * metres_per_unit;
    let under = |at: [f64; 3]| {
        let (place, height) = ground.places.locate(at);
        let cell = ground.places.cell_at(place)?;
        let above = |node: usize| height as f32 - ground.height_at(node, place);
        let is_near = |node: &usize| {
            // What hangs on an edge is below it too, but does not lie.
            let below = match stand_in {
                _ if ground.is_solid(*node) => f32::INFINITY,
                StandIn::Itself => BURIAL_DEPTH_M,
                StandIn::Discs if !(ground.is_plain(*node) || lies && ground.is_level(*node)) => {
                    HAZE_HEIGHTS_M[1]
                }
                StandIn::Discs | StandIn::Floor => MAX_SPLAT_HEIGHT_M,
            };
            (-below.max(0.2 * ground.cell)..MAX_SPLAT_HEIGHT_M).contains(&above(*node))
        };
        let node = ground.nodes_of(cell).find(is_near)?;
        Some((node as u32, above(node)))
    };
    let (node, above) = under(mean)?;
    let is_haze = stand_in != StandIn::Itself || above < -BURIAL_DEPTH_M;
    let (mut nodes, mut reach) = ([node; SPLAT_PROBE_COUNT], above);
    // Wide ones lie on more than one node.
    if scales[order[0]] * metres_per_unit > 0.7 * f64::from(ground.cell) {
        for (end, node) in nodes.iter_mut().skip(1).enumerate() {
            let (along, way) = (axis(order[end / 2]), if end % 2 == 0 { 1.2 } else { -1.2 });
            let at = std::array::from_fn(|i| mean[i] + way * along[i]);
            match under(at) {
                // Beyond the ends of a ring the ground goes on.
                Some((other, _)) if ground.is_elsewhere(other as usize) => {}
                None if !is_in(ground, at) => {}
                Some((other, above)) => {
                    *node = other;
                    reach = if lies { reach.max(0.5 * above) } else { reach };
                }
                // An end of haze may be anywhere.
                None if is_haze => {}
                None => return None,
            }
        }
    }
    let mut reach = reach + if lies { 0.3 * rise(order[2]) } else { upright } as f32;
    let node = node as usize;
    reach = match stand_in {
        StandIn::Discs if ground.is_plain(node) => reach.min(0.0),
        StandIn::Discs if ground.is_level(node) => reach - reach.clamp(0.0, HAZE_HEIGHTS_M[0]),
        StandIn::Floor if ground.is_level(node) => reach.min(0.0),
        _ => reach,
    };
    Some(Spot { ring: ring as u8, nodes, reach, is_haze })
}
