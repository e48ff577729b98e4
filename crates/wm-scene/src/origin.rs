//! Local origins of places whose coordinates are far from zero.
//!
//! Splats are kept as f32: four million units from zero, where maps put whole countries, its steps
//! are a quarter of a unit wide. So what is read from far coordinates is kept relative to an
//! origin: `world = origin + local`, along the axes of the file. The origin is
//! [`Metadata::origin`](crate::Metadata::origin); splats, views and all other positions in memory
//! are local. Positions in a file are relative to the origin that the file states, else to zero.
//! Places near zero have no origin.

use crate::similarity::Similarity;
use crate::{Group, Metadata, Remark, Scene, SceneView, Splats};
use glam::DVec3;
use wm_base::statistics::quantile;

/// Distance from zero, in extents of a capture, beyond which its coordinates are far: steps of f32
/// there are a 65,536th of its extent.
const FAR_EXTENTS: f64 = 128.0;
/// Distance from zero, in extents of a scene, beyond which its coordinates are far whatever the
/// size of its splats.
const FAR_SCENE_EXTENTS: f64 = 1024.0;
/// Distance from zero, in extents, beyond which coordinates are far if steps of f32 there are wide
/// against splats: nearer, an origin gains nothing.
const FAR_SMALL_EXTENTS: f64 = 8.0;
/// Steps of f32 in a splat, below which it counts as small.
const STEPS_PER_SPLAT: f64 = 16.0;
/// Least coordinate that may be far, units.
const MIN_FAR_COORDINATE: f64 = 1000.0;
/// Largest coordinate of a place, units: beyond lie faults.
const MAX_COORDINATE: f64 = 1e9;
/// Most positions by which an origin is chosen.
const SAMPLE_SIZE: usize = 1 << 12;
/// Share of the positions that is left out at each end of an axis.
const STRAY_SHARE: f64 = 0.05;
/// Least share of splats narrower than the steps of their positions that is reported.
const COARSE_SHARE: f64 = 0.1;
/// Widest step of a file, in steps of f32 at that place, that is attributed to the numbers of the
/// file.
const MAX_FILE_STEPS: f64 = 2.0;
/// Code of the remark on positions in steps that are wider than the splats.
pub(crate) const COARSE: &str = "coarse-positions";

/// Width of a step of f32 at a coordinate.
#[must_use]
pub(crate) fn float_step(coordinate: f64) -> f64 {
    let coordinate = coordinate.abs() as f32;
    if coordinate.is_finite() {
        f64::from(coordinate.next_up()) - f64::from(coordinate)
    } else {
        f64::INFINITY
    }
}

/// Chooses the origin of positions, of which some thousand are looked at, by their middle, strays
/// left out; `None` if they are not far from zero. `size` is the standard deviation of a usual
/// splat, units; 0 if it is not known.
///
/// The origin is rounded to a power of ten above the extent of the positions, a unit at least, so
/// that captures and scenes of one place mostly have the same.
#[must_use]
pub fn choose(positions: &[DVec3], size: f64) -> Option<DVec3> {
    let step = positions.len().div_ceil(SAMPLE_SIZE).max(1);
    let finite: Vec<DVec3> = positions.iter().step_by(step).copied().filter(|p| p.is_finite()).collect();
    // One position has no extent that it could be far against.
    if finite.len() < 2 {
        return None;
    }
    let (mut middle, mut extent) = (DVec3::ZERO, 0.0f64);
    for axis in 0..3 {
        let mut along: Vec<f64> = finite.iter().map(|p| p[axis]).collect();
        along.sort_unstable_by(f64::total_cmp);
        let strays = (STRAY_SHARE * along.len() as f64) as usize;
        let (low, high) = (along[strays], along[along.len() - 1 - strays]);
        middle[axis] = along[along.len() / 2];
        extent = extent.max(0.5 * (high - low));
    }
    let size = if size.is_finite() { size } else { 0.0 };
    let extent = extent.max(size);
    let far = middle.abs().max_element();
    let is_small = size > 0.0 && STEPS_PER_SPLAT * far * f64::from(f32::EPSILON) > size;
    let least = extent
        * match size > 0.0 {
            true if is_small => FAR_SMALL_EXTENTS,
            true => FAR_SCENE_EXTENTS,
            false => FAR_EXTENTS,
        };
    if !(MIN_FAR_COORDINATE..=MAX_COORDINATE).contains(&far) || far <= least {
        return None;
    }
    let grain = 10f64.powi(extent.max(1.0).log10().ceil() as i32);
    let of_axis =
        |v: f64| if v.abs() > FAR_SMALL_EXTENTS * extent { (v / grain).round() * grain + 0.0 } else { 0.0 };
    let origin = DVec3::from_array(middle.to_array().map(of_axis));
    (origin != DVec3::ZERO).then_some(origin)
}

/// The standard deviation of a usual splat: the median of that along the middle axis, units; 0 if
/// no splat has a finite one.
pub(crate) fn usual_size(splats: &Splats) -> f64 {
    let step = splats.len().div_ceil(SAMPLE_SIZE).max(1);
    let scales = splats.log_scales.iter().step_by(step);
    let mut sizes: Vec<f64> =
        scales.map(|scale| middle_size(*scale)).filter(|size| size.is_finite()).collect();
    quantile(&mut sizes, 0.5)
}

/// The standard deviation along the middle axis.
fn middle_size(mut log_scale: [f32; 3]) -> f64 {
    log_scale.sort_unstable_by(f32::total_cmp);
    f64::from(log_scale[1]).exp()
}

/// A vector of a position as it is kept.
pub(crate) fn wide(mean: [f32; 3]) -> DVec3 {
    DVec3::from_array(mean.map(f64::from))
}

/// Chooses the origin of splats; `None` if they are not far from zero.
fn of_splats(splats: &Splats) -> Option<DVec3> {
    let step = splats.len().div_ceil(SAMPLE_SIZE).max(1);
    let positions: Vec<DVec3> = splats.means.iter().step_by(step).map(|mean| wide(*mean)).collect();
    choose(&positions, usual_size(splats))
}

/// Returns true if splats would be read relative to an origin.
#[cfg(test)]
pub(crate) fn is_far(splats: &Splats) -> bool {
    of_splats(splats).is_some()
}

/// Chooses an origin for a scene that was read, if it is far from zero, and makes splats, metadata
/// and views relative to it; remarks on it, and on positions that the file has in steps wider than
/// the splats. A reader may have chosen one for the splats already: [`Scene::moved_by`].
pub(crate) fn settle(scene: &mut Scene) {
    let read = scene.moved_by;
    // Whoever stated an origin chose it.
    let chosen = if read == DVec3::ZERO && scene.metadata.origin.is_none() {
        of_splats(&scene.splats).unwrap_or(DVec3::ZERO)
    } else {
        DVec3::ZERO
    };
    let by = read + chosen;
    scene.moved_by = by;
    if by == DVec3::ZERO {
        return;
    }
    Similarity { translation: -chosen, ..Similarity::IDENTITY }.apply_to(&mut scene.splats);
    move_facts(scene, by);
    let origin = text_of(scene.metadata.origin_or_zero());
    scene.remarks.push(Remark::note(
        "far-origin",
        format!("the coordinates are far from zero: they are kept relative to the origin {origin}"),
    ));
    let is_known = scene.remarks.iter().any(|remark| remark.code == COARSE);
    if let Some(step) = file_step(&scene.splats, by).filter(|_| !is_known) {
        let advice = "export the scene with an offset near zero, or as a PLY with x y z in double precision";
        scene
            .remarks
            .extend(coarse_line(&scene.splats, |_| step, advice).map(|line| Remark::doubt(COARSE, line)));
    }
}

/// A line on positions in steps that are wider than many of the splats; `None` if they are fine.
/// `step` tells the step at a position, units, `advice` what to do.
pub(crate) fn coarse_line(splats: &Splats, step: impl Fn([f32; 3]) -> f64, advice: &str) -> Option<String> {
    let stride = splats.len().div_ceil(SAMPLE_SIZE).max(1);
    let (mut all, mut narrow, mut widest) = (0u32, 0u32, 0.0f64);
    for index in (0..splats.len()).step_by(stride).filter(|i| splats.groups[*i] != Group::Sky) {
        let step = step(splats.means[index]);
        all += 1;
        let largest = splats.log_scales[index].into_iter().fold(f32::NEG_INFINITY, f32::max);
        if f64::from(largest).exp() < step {
            narrow += 1;
            widest = widest.max(step);
        }
    }
    let share = f64::from(narrow) / f64::from(all.max(1));
    (share >= COARSE_SHARE).then(|| {
        let share = (100.0 * share).round();
        format!(
            "positions have steps of up to {} units, wider than {share} % of the splats, which fold together; {advice}",
            digits(widest)
        )
    })
}

/// A number with three digits.
fn digits(v: f64) -> String {
    let decimals = (2.0 - v.abs().max(1e-12).log10().floor()).clamp(0.0, 12.0) as usize;
    let text = format!("{v:.decimals$}");
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').into() } else { text }
}

/// Chooses an origin for splats that are read from positions finer than f32, if they are far from
/// zero and `metadata` state none, and makes them relative to it: `residues` are what f32 left of
/// their positions, none or one a splat. Returns it, or zero; [`settle`] does the rest.
pub(crate) fn subtract_fine(splats: &mut Splats, residues: &[[f32; 3]], metadata: &Metadata) -> DVec3 {
    let fine = |mean: &[f32; 3], residue: &[f32; 3]| wide(*mean) + wide(*residue);
    let step = splats.len().div_ceil(SAMPLE_SIZE).max(1);
    let sampled = splats.means.iter().zip(residues).step_by(step);
    let positions: Vec<DVec3> = sampled.map(|(mean, residue)| fine(mean, residue)).collect();
    let chosen = if metadata.origin.is_none() { choose(&positions, usual_size(splats)) } else { None };
    let Some(origin) = chosen else { return DVec3::ZERO };
    for (mean, residue) in splats.means.iter_mut().zip(residues) {
        *mean = (fine(mean, residue) - origin).to_array().map(|v| v as f32);
    }
    origin
}

/// Makes metadata and views of a scene relative to an origin `by` farther from zero, and states it.
fn move_facts(scene: &mut Scene, by: DVec3) {
    let origin = scene.metadata.origin_or_zero() + by;
    let splats = std::mem::take(&mut scene.splats);
    Similarity { translation: -by, ..Similarity::IDENTITY }.apply_local(scene);
    scene.splats = splats;
    scene.metadata.origin = (origin != DVec3::ZERO).then_some(origin);
}

impl Scene {
    /// Makes everything in the scene relative to another origin, zero for none: the place stays
    /// where it is in the world. Positions are rounded to f32 anew.
    pub fn set_origin(&mut self, origin: DVec3) {
        let by = origin - self.metadata.origin_or_zero();
        if by != DVec3::ZERO {
            Similarity { translation: -by, ..Similarity::IDENTITY }.apply_to(&mut self.splats);
            move_facts(self, by);
        }
    }

    /// The scene with positions as its file has them: without the origin that the reader chose.
    #[must_use]
    pub fn as_in_file(mut self) -> Self {
        self.set_origin(self.metadata.origin_or_zero() - self.moved_by);
        self.moved_by = DVec3::ZERO;
        self
    }

    /// Metadata of this scene as they belong beside its file, which has no word of the origin that
    /// the reader chose.
    #[must_use]
    pub fn metadata_beside_file(&self, metadata: Metadata) -> Metadata {
        let origin = self.metadata.origin;
        let facts =
            Self { metadata: Metadata { origin, ..metadata }, moved_by: self.moved_by, ..Self::default() };
        facts.as_in_file().metadata
    }

    /// Takes views whose cameras are in world coordinates.
    pub fn set_world_views(&mut self, views: Vec<SceneView>) {
        self.views = views;
        let origin = self.metadata.origin_or_zero();
        for view in &mut self.views {
            view.camera = view.camera.moved(-origin);
        }
    }
}

/// The step of the positions in a file, of splats that were `by` farther from zero there, units;
/// `None` if they are not in steps that numbers of 32 bits explain.
///
/// A step shows itself: all positions along an axis are multiples of it.
fn file_step(splats: &Splats, by: DVec3) -> Option<f64> {
    let stride = splats.len().div_ceil(SAMPLE_SIZE).max(1);
    let step_along = |axis: usize| {
        let least = float_step(by[axis]);
        let along = splats.means.iter().step_by(stride).map(|mean| f64::from(mean[axis]) + by[axis]);
        let values: Vec<f64> = along.filter(|v| v.is_finite()).collect();
        // A few strays near zero have finer steps.
        let most = (STRAY_SHARE * values.len() as f64) as usize;
        let is_step = |step: f64| values.iter().filter(|v| (*v / step).fract() != 0.0).count() <= most;
        // Finer on this side of a power of two, coarser beyond.
        [MAX_FILE_STEPS, 1.0, 0.5].map(|steps| steps * least).into_iter().find(|step| is_step(*step))
    };
    (0..3).filter(|axis| by[*axis] != 0.0).filter_map(step_along).max_by(f64::total_cmp)
}

/// A point in the form of the command line: `500000,4000000,0`.
#[must_use]
pub fn text_of(point: DVec3) -> String {
    point.to_array().map(|v| v.to_string()).join(",")
}

#[cfg(test)]
mod tests;
