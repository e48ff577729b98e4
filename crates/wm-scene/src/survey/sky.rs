//! Finds the splats of the sky, for files that do not mark them.
//!
//! Reconstructions put the sky on a shell far outside everything else. A shell is taken for the sky
//! where all of this holds, and nothing is labelled otherwise:
//! - there is a gap: a spherical layer about the scene's middle, at least half as thick again as
//!   its inner radius, with next to nothing in it;
//! - the shell begins beyond three times the radius that holds 90 % of what is inside;
//! - its splats are much larger than those inside;
//! - seen from the middle they cover a wide piece of the heavens: stray splats are too few for it,
//!   and distant buildings cover but a strip along the horizon.

use super::middle::{center_of, strided};
use crate::{Group, Splats};
use glam::{DMat3, DVec3};
use std::ops::Range;
use wm_base::linear::{direction, eigen, outer};
use wm_base::statistics::quantile;

/// Layers per doubling of the radius.
const LAYERS_PER_OCTAVE: f64 = 8.0;
/// Fewest layers in a gap: a factor of 1.54 in radius.
const MIN_GAP_LAYERS: usize = 5;
/// Largest share of the splats beyond a gap that may float in it.
const MAX_FLOATER_SHARE: f64 = 0.01;
/// Largest share of the sky in all splats.
const MAX_SKY_SHARE: f64 = 0.5;
/// Fewest splats of a sky.
const MIN_SPLATS: usize = 24;
/// Least inner radius of a sky, in radii that hold 90 % of the splats inside.
const MIN_RADIUS_RATIO: f64 = 3.0;
/// Least ratio of the size of sky splats to that of the splats inside.
const MIN_SIZE_RATIO: f64 = 3.0;
/// Cells of equal solid angle over the sphere.
const SKY_CELLS: usize = 256;
/// Fewest cells that a sky covers: half a steradian.
const MIN_CELLS: usize = 10;
/// Least share of a covered cell that splats fill to two standard deviations.
const COVERED_SHARE: f64 = 0.5;
/// Largest share of a cell that one splat fills, so that a few giant strays cover nothing.
const MAX_SPLAT_COVER: f64 = 0.2;
/// Least second moment of the covered cells about any plane through the middle: 1/3 for a half
/// sphere, 0.01 for a ring 10 degrees high, 0.04 for one of 20 degrees.
const MIN_MOMENT: f64 = 0.05;

/// The region of the sky's splats.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SkyRegion {
    /// No sky was found.
    None,
    /// The splats of the sky's group.
    Labelled,
    /// All splats farther from `center` than `radius`, scene units.
    Beyond {
        /// Middle of the scene.
        center: DVec3,
        /// Inner radius of the shell.
        radius: f64,
    },
}

impl SkyRegion {
    /// Looks for the sky. Groups that the file labels are kept.
    pub fn of(splats: &Splats) -> Self {
        if splats.groups.contains(&Group::Sky) { Self::Labelled } else { find(splats) }
    }

    /// Returns true if splat `index` is part of it.
    pub(crate) fn holds(&self, splats: &Splats, index: usize) -> bool {
        match *self {
            Self::None => false,
            Self::Labelled => splats.groups[index] == Group::Sky,
            Self::Beyond { center, radius } => {
                let distance = mean(splats, index).distance(center);
                distance.is_finite() && distance > radius && splats.groups[index] == Group::Scene
            }
        }
    }

    /// The indices of its splats.
    pub fn indices(&self, splats: &Splats) -> Vec<usize> {
        match self {
            Self::None => Vec::new(),
            _ => (0..splats.len()).filter(|index| self.holds(splats, *index)).collect(),
        }
    }
}

/// Gives the splats of the sky their group, if no splat has it yet and there is a sky shell;
/// returns how many there were.
///
/// A sky is a shell of large splats far outside the rest, above or all around; distant buildings
/// are not taken for it. About 40 ns a splat.
pub fn label_sky(splats: &mut Splats) -> usize {
    let sky = SkyRegion::of(splats);
    if sky == SkyRegion::Labelled {
        return 0;
    }
    let indices = sky.indices(splats);
    for index in &indices {
        splats.groups[*index] = Group::Sky;
    }
    indices.len()
}

fn mean(splats: &Splats, index: usize) -> DVec3 {
    DVec3::from_array(splats.means[index].map(f64::from))
}

/// Looks for a shell of sky, whatever the splats are labelled.
pub(super) fn find(splats: &Splats) -> SkyRegion {
    let finite = |p: &DVec3| p.is_finite();
    let few: Vec<DVec3> = strided(splats.len(), 20_000).map(|i| mean(splats, i)).filter(finite).collect();
    let center = center_of(&few);
    let mut distances: Vec<f64> = few.iter().map(|p| p.distance(center)).collect();
    let unit = quantile(&mut distances, 0.5);
    if !(unit > 0.0 && unit.is_finite()) {
        return SkyRegion::None;
    }
    let layers = Layers::of(splats, center, unit);
    // From outside in, each shell on its own: a row of far houses stays with the scene where the
    // sky is farther still. What floats in a gap goes to the nearer side.
    let (mut sky, mut outer) = (None, f64::INFINITY);
    for gap in layers.gaps().into_iter().rev() {
        let radius = (layers.radius(gap.start) * layers.radius(gap.end)).sqrt();
        if is_sky(splats, center, radius..outer) {
            (sky, outer) = (Some(radius), radius);
        } else if sky.is_some() {
            break;
        }
    }
    sky.map_or(SkyRegion::None, |radius| SkyRegion::Beyond { center, radius })
}

/// Number of splats by distance from the middle, in layers of equal ratio.
struct Layers {
    unit: f64,
    counts: [usize; Self::COUNT],
}

impl Layers {
    /// From 1/16 to 4096 times the middle distance; all others fall in the first and last layer.
    const COUNT: usize = 16 * LAYERS_PER_OCTAVE as usize;
    const FIRST_OCTAVE: f64 = -4.0;

    fn of(splats: &Splats, center: DVec3, unit: f64) -> Self {
        let mut counts = [0; Self::COUNT];
        let scale = 1.0 / (unit * unit);
        for index in 0..splats.len() {
            let squared = mean(splats, index).distance_squared(center) * scale;
            if squared.is_finite() {
                let layer =
                    ((0.5 * squared.log2() - Self::FIRST_OCTAVE) * LAYERS_PER_OCTAVE).max(0.0) as usize;
                counts[layer.min(Self::COUNT - 1)] += 1;
            }
        }
        Self { unit, counts }
    }

    /// Inner radius of a layer, scene units.
    fn radius(&self, layer: usize) -> f64 {
        self.unit * (layer as f64 / LAYERS_PER_OCTAVE + Self::FIRST_OCTAVE).exp2()
    }

    /// The runs of all but empty layers with a sky's share of the splats beyond, from inside out.
    fn gaps(&self) -> Vec<Range<usize>> {
        let total: usize = self.counts.iter().sum();
        let mut inside = vec![0; Self::COUNT + 1];
        for (layer, count) in self.counts.iter().enumerate() {
            inside[layer + 1] = inside[layer] + count;
        }
        let mut gaps = Vec::new();
        for end in 1..Self::COUNT {
            let beyond = total - inside[end];
            if self.counts[end] == 0 || beyond < MIN_SPLATS || beyond as f64 > MAX_SKY_SHARE * total as f64 {
                continue;
            }
            let floaters = (MAX_FLOATER_SHARE * beyond as f64) as usize;
            let start = (0..end).find(|start| inside[end] - inside[*start] <= floaters).unwrap_or(end);
            let begins = (0..end).find(|layer| inside[*layer] as f64 >= 0.9 * inside[start] as f64);
            let far = begins.is_some_and(|layer| self.radius(end) > MIN_RADIUS_RATIO * self.radius(layer));
            if end - start >= MIN_GAP_LAYERS && far {
                gaps.push(start..end);
            }
        }
        gaps
    }
}

/// Returns true if the splats at the distances `shell` have the size and the spread of a sky.
fn is_sky(splats: &Splats, center: DVec3, shell: Range<f64>) -> bool {
    let (mut near, mut far) = (Vec::new(), Vec::new());
    let mut filled = [0.0; SKY_CELLS];
    let cells: [DVec3; SKY_CELLS] = std::array::from_fn(|i| direction(i, SKY_CELLS));
    for index in 0..splats.len() {
        let offset = mean(splats, index) - center;
        let squared = offset.length_squared();
        let beyond = squared > shell.start * shell.start;
        // The inside is sampled, the shell may be small and is taken whole.
        let counts = if beyond { squared.sqrt() < shell.end } else { index % 16 == 0 };
        if !squared.is_finite() || !counts {
            continue;
        }
        let mut sizes = splats.log_scales[index].map(f64::from);
        sizes.sort_by(f64::total_cmp);
        if !sizes[2].is_finite() {
            continue;
        }
        if !beyond {
            near.push(sizes[2]);
            continue;
        }
        far.push(sizes[2]);
        // An ellipse of two standard deviations, in areas of a cell: 4 pi s s / r^2 / (4 pi /
        // SKY_CELLS).
        let share = (sizes[1] + sizes[2]).exp() * splats.opacity(index) / squared * SKY_CELLS as f64;
        let nearest = |a: &usize, b: &usize| cells[*a].dot(offset).total_cmp(&cells[*b].dot(offset));
        filled[(0..SKY_CELLS).max_by(nearest).unwrap_or(0)] += share.min(MAX_SPLAT_COVER);
    }
    if quantile(&mut far, 0.5) - quantile(&mut near, 0.5) < MIN_SIZE_RATIO.ln() {
        return false;
    }
    let covered =
        || cells.iter().zip(filled).filter(|(_, filled)| *filled >= COVERED_SHARE).map(|(cell, _)| *cell);
    let count = covered().count();
    let moments = covered().fold(DMat3::ZERO, |sum, cell| sum + outer(cell, 1.0 / count as f64));
    count >= MIN_CELLS && eigen(moments)[0].0 >= MIN_MOMENT
}
