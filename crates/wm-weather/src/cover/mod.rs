//! Snow, dust and ash that lie.
//!
//! # How much lies where
//! What falls reaches the surfaces of the scene by how open they are ([`ground`]), slides off what is too steep for it
//! and lies below ([`settle`]). Depth is asked for as that on open level ground, and all of it is kept account of:
//! what fell is what lies and what is left on walls.
//!
//! # How it is drawn
//! As splats of its own on its own surface ([`surfels`]), opaque and lit as the place is; and the scene's splats that it
//! buries are hidden, so that none shines through ([`Buried`]). Thin snow covers a share of the ground only.
//!
//! # Departures from the paper
//! The paper makes those splats white that face up, and fills planes between them with white ones: it snows under
//! roofs, and white shows through what stands in front. That is [`crate::paper`]'s.

pub mod ground;
pub mod settle;
pub mod surfels;
#[cfg(test)]
mod tests;

use crate::optics::Site;
use crate::shelter::{Occluders, ShelterOptions};
use ground::Ground;
pub use settle::Settled;
pub use surfels::{Matter, coverage};
use wm_render::hooks::Visibility;
use wm_scene::{Group, Splats};

/// How far below its ground a splat is buried with it, m: splats are that rough.
const BURIED: f32 = 0.08;
/// Cells along a side of a ring, and how many times as wide those of the next ring are.
const SIDE: f64 = 420.0;
const WIDER: f64 = 4.0;
/// Rings at most.
const RINGS: usize = 3;
/// Narrowest cells, m.
const NARROWEST: f64 = 0.06;

/// What is asked to lie.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Asked {
    /// On open level ground, m.
    pub depth: f64,
    /// Steepest that it lies, as a tangent.
    pub repose: f64,
    /// What it is.
    pub matter: Matter,
}

/// A place that something can lie on.
#[derive(Clone, Debug)]
pub struct Cover {
    /// Around where the photos were taken, and farther out in wider cells.
    rings: Vec<Ground>,
    metres_per_unit: f64,
    /// Of each splat of the scene. Those that nothing buries have none.
    spots: Vec<Option<Spot>>,
}

/// Where a splat is on the ground.
#[derive(Clone, Copy, Debug)]
struct Spot {
    ring: u8,
    /// The nodes under its middle and its ends.
    nodes: [u32; ENDS],
    /// How far it reaches above the ground, m.
    reach: f32,
}

/// Places of a splat that must lie under snow for it to be hidden.
const ENDS: usize = 5;

/// What lies, ready to be drawn.
#[derive(Clone, Debug)]
pub struct Lying {
    /// The splats of it.
    pub splats: Splats,
    /// Which of the scene's splats it hides.
    pub buried: Buried,
    /// What lies where on each ring.
    pub settled: Vec<Settled>,
}

/// How much of each splat of the scene is still seen.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Buried(Vec<f32>);

impl Visibility for Buried {
    fn factors(&self, indices: &[u32], out: &mut [f32]) {
        for (index, factor) in indices.iter().zip(out) {
            *factor = self.0.get(*index as usize).copied().unwrap_or(1.0);
        }
    }
}

impl Lying {
    /// Splats that hide none of the scene's.
    #[must_use]
    pub fn on_top(splats: Splats) -> Self {
        Self { splats, buried: Buried::default(), settled: Vec::new() }
    }

    /// The scene with what lies on it, as one set of splats of the scene's SH degree.
    #[must_use]
    pub fn bake(&self, scene: &Splats) -> Splats {
        let factor = |index: usize| self.buried.factors().get(index).copied().unwrap_or(1.0);
        let kept: Vec<usize> = (0..scene.len()).filter(|index| factor(*index) > GONE).collect();
        let mut out = scene.select(&kept);
        for (opacity, index) in out.logit_opacities.iter_mut().zip(&kept) {
            if factor(*index) < 1.0 {
                let left = scene.opacity(*index) * f64::from(factor(*index));
                *opacity = wm_scene::splats::logit(left) as f32;
            }
        }
        out.append(&self.splats);
        out
    }
}

/// Share of a splat below which nothing of it is seen: 1/255 of an opaque one.
const GONE: f32 = 1.0 / 255.0;

impl Buried {
    /// The factor of each splat, 0-1.
    #[must_use]
    pub fn factors(&self) -> &[f32] {
        &self.0
    }
}

impl Cover {
    /// Of a scene in a fall of `slope`: what it goes sideways while it falls by 1, along [`crate::dome::level_axes`].
    /// Cells are narrowest about `middle` (world, scene units).
    #[must_use]
    pub fn of(splats: &Splats, site: &Site, slope: [f64; 2], middle: [f64; 3], threads: usize) -> Self {
        let mut rings: Vec<Ground> = Vec::new();
        let mut occluders = Occluders::of(splats, site, &ShelterOptions::default());
        for ring in 0..RINGS {
            let cell = NARROWEST * WIDER.powi(ring as i32);
            let reach = if ring + 1 == RINGS { f64::INFINITY } else { 0.5 * SIDE * cell };
            let options = ShelterOptions {
                cell,
                most_cells: (SIDE * SIDE) as usize,
                focus: reach.is_finite().then_some((middle, reach)),
                margin: 0.1,
                ..ShelterOptions::default()
            };
            occluders = occluders.mapped(&options);
            let ground = Ground::of(splats, &occluders, site, slope, rings.last(), threads);
            // The whole scene is in it.
            let [columns, rows] = ground.size.map(|v| v as f64);
            let is_all = columns < 0.98 * SIDE && rows < 0.98 * SIDE;
            rings.push(ground);
            if is_all {
                break;
            }
        }
        let spots =
            (0..splats.len()).map(|index| spot(&rings, splats, index, site.metres_per_unit)).collect();
        Self { rings, metres_per_unit: site.metres_per_unit, spots }
    }

    /// The ground, from the inside out.
    #[must_use]
    pub fn rings(&self) -> &[Ground] {
        &self.rings
    }

    /// What lies as it is asked for.
    #[must_use]
    pub fn lying(&self, Asked { depth, repose, matter }: &Asked) -> Lying {
        let (mut settled, mut tops) = (Vec::new(), Vec::new());
        let mut splats = Splats::with_capacity(0, 0);
        for ground in &self.rings {
            let fell: Vec<f32> = ground.share.iter().map(|share| share * *depth as f32).collect();
            let lies = settle::settle(ground, &fell, *repose as f32);
            let top = surfels::surface(ground, &lies.depth);
            surfels::add(ground, (&lies.depth, &top), self.metres_per_unit, matter, &mut splats);
            settled.push(lies);
            tops.push(top);
        }
        let factor = |spot: &Option<Spot>| {
            let Some(Spot { ring, nodes, reach }) = spot else { return 1.0 };
            let ring = usize::from(*ring);
            let (ground, depth, top) = (&self.rings[ring], &settled[ring].depth, &tops[ring]);
            let hidden = |node: &u32| {
                let node = *node as usize;
                // Those that stick out stay.
                let sunk = ((top[node] - ground.height[node] - reach) / 0.02 + 1.0).clamp(0.0, 1.0);
                sunk * coverage(depth[node])
            };
            1.0 - nodes.iter().map(hidden).fold(1.0, f32::min)
        };
        let buried = Buried(self.spots.iter().map(factor).collect());
        Lying { splats, buried, settled }
    }
}

/// Where a splat is on the ground, if it is.
fn spot(rings: &[Ground], splats: &Splats, index: usize, metres_per_unit: f64) -> Option<Spot> {
    if splats.groups[index] == Group::Sky || !splats.is_sound(index) {
        return None;
    }
    let mean = splats.means[index].map(f64::from);
    let is_in = |ground: &Ground| ground.places.cell_at(ground.places.locate(mean).0).is_some();
    let ring = rings.iter().position(is_in)?;
    let ground = &rings[ring];
    let under = |at: [f64; 3]| {
        let (place, height) = ground.places.locate(at);
        let cell = ground.places.cell_at(place)?;
        let above = |node: usize| height as f32 - ground.height[node];
        let is_near = |node: &usize| (-BURIED..1.5).contains(&above(*node));
        let node = ground.nodes_of(cell).find(is_near)?;
        Some((node as u32, above(node)))
    };
    let (node, above) = under(mean)?;
    let turn = wm_scene::quat::to_matrix(splats.quats[index].map(f64::from));
    let scales = splats.scales(index);
    let axis = |k: usize| -> [f64; 3] { std::array::from_fn(|i| turn[i][k] * scales[k]) };
    let up = ground.places.axes()[2];
    let rise = |k: usize| axis(k).iter().zip(&up).map(|(a, b)| a * b).sum::<f64>().abs() * metres_per_unit;
    let mut order = [0, 1, 2];
    order.sort_by(|a, b| scales[*b].total_cmp(&scales[*a]));
    // Those that stand up reach as far as they are long; of those that lie only their thickness counts.
    let upright = (0..3).map(|k| rise(k).powi(2)).sum::<f64>().sqrt();
    let lies = rise(order[0]) < 0.35 * scales[order[0]] * metres_per_unit;
    let (mut nodes, mut reach) = ([node; ENDS], above);
    // Wide ones lie on more than one node.
    if scales[order[0]] * metres_per_unit > 0.7 * f64::from(ground.cell) {
        for (end, node) in nodes.iter_mut().skip(1).enumerate() {
            let (along, way) = (axis(order[end / 2]), if end % 2 == 0 { 1.2 } else { -1.2 });
            let (other, above) = under(std::array::from_fn(|i| mean[i] + way * along[i]))?;
            *node = other;
            reach = if lies { reach.max(0.5 * above) } else { reach };
        }
    }
    let reach = reach + if lies { 0.3 * rise(order[2]) } else { upright } as f32;
    Some(Spot { ring: ring as u8, nodes, reach })
}
