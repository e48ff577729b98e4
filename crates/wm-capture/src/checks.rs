//! Checks of what every format reads: points and names that no capture has.

use super::{Capture, CaptureView, Observation};
use std::collections::HashSet;
use wm_base::FormatError;
use wm_scene::{Remark, SparsePoints};

/// Largest coordinate of a point or camera, scene units: a hundred times the Earth's radius in
/// millimetres.
pub(super) const MAX_COORDINATE: f64 = 1e12;
/// Fewest points whose equal colours are a sign that the colours were not read.
const MIN_COLORED_POINTS: usize = 10;

/// Range of focal lengths, in longer sides of the photo.
const FOCAL_RANGE: std::ops::RangeInclusive<f64> = 1e-2..=1e4;

/// Leaves out points that are nowhere and photos that are there twice, and remarks on them and on
/// colours that all points share.
///
/// # Errors
/// [`FormatError`] if a camera is one that cannot be.
pub(super) fn clean(capture: &mut Capture) -> Result<(), FormatError> {
    if let Some((view, what)) = capture.views.iter().find_map(|view| Some((view, absurd(view)?))) {
        let what = format!("the camera of {:?} {what}; reconstruct or export the capture again", view.name);
        return Err(FormatError::value(&capture.source, what));
    }
    let absurd = leave_out_absurd(&mut capture.points, &mut capture.observations);
    if absurd > 0 {
        capture.remarks.push(Remark::doubt(
            "absurd-points",
            format!("{absurd} points are not finite or farther away than {MAX_COORDINATE:e} and are left out; look at the model"),
        ));
    }
    let mut known = HashSet::new();
    let is_first: Vec<bool> = capture.views.iter().map(|view| known.insert(view.name.clone())).collect();
    let twice = is_first.iter().filter(|is_first| !**is_first).count();
    if let Some(at) = is_first.iter().position(|is_first| !is_first) {
        let text = format!(
            "{twice} photos are there twice, such as {:?}; the first of each is used",
            capture.views[at].name
        );
        capture.remarks.push(Remark::doubt("photos-twice", text));
        let mut at = is_first.iter();
        capture.views.retain(|_| *at.next().unwrap_or(&true));
        let mut at = is_first.iter();
        capture.observations.retain(|_| *at.next().unwrap_or(&true));
    }
    capture.remarks.extend(colors(&capture.points));
    Ok(())
}

/// Says what about a camera cannot be.
fn absurd(view: &CaptureView) -> Option<String> {
    let camera = &view.camera;
    let side = f64::from(camera.width.max(camera.height));
    if let Some(focal) =
        [camera.fx, camera.fy].into_iter().find(|focal| !FOCAL_RANGE.contains(&(focal / side)))
    {
        return Some(format!("has a focal length of {focal:e} px for {} px of width", camera.width));
    }
    if [camera.cx, camera.cy].iter().any(|v| v.abs() > 100.0 * side) {
        return Some(format!("has its principal point at ({:e}, {:e}) px", camera.cx, camera.cy));
    }
    let center = camera.center();
    (center.abs().max_element() >= MAX_COORDINATE)
        .then(|| format!("is at ({:e}, {:e}, {:e})", center.x, center.y, center.z))
}

/// Returns the number of points that were left out.
fn leave_out_absurd(points: &mut SparsePoints, observations: &mut [Vec<Observation>]) -> usize {
    let is_sane = |position: &[f64; 3]| position.iter().all(|v| v.abs() < MAX_COORDINATE);
    let absurd = points.positions.iter().filter(|position| !is_sane(position)).count();
    if absurd > 0 {
        let mut places = vec![u32::MAX; points.len()];
        let mut kept = SparsePoints::default();
        for at in (0..points.len()).filter(|at| is_sane(&points.positions[*at])) {
            places[at] = kept.len() as u32;
            kept.push(points.positions[at], points.colors[at], points.errors[at], points.track_lengths[at]);
        }
        *points = kept;
        for seen in observations.iter_mut() {
            seen.iter_mut().for_each(|seen| seen.point = places[seen.point as usize]);
            seen.retain(|seen| seen.point != u32::MAX);
        }
    }
    for seen in observations {
        seen.retain(|seen| seen.xy.iter().all(|v| v.is_finite()));
    }
    absurd
}

/// A doubt if all points have one colour.
fn colors(points: &SparsePoints) -> Option<Remark> {
    let [r, g, b] = *points.colors.first().filter(|_| points.len() >= MIN_COLORED_POINTS)?;
    let all = |is: fn(u8) -> bool| points.colors.iter().flatten().all(|v| is(*v));
    let what = if all(|v| v <= 1) {
        "black".into()
    } else if all(|v| v >= 254) {
        "white".into()
    } else if points.colors.iter().all(|color| *color == [r, g, b]) {
        format!("of the colour {r} {g} {b}")
    } else {
        return None;
    };
    Some(Remark::doubt(
        "equal-colours",
        format!(
            "all {} points are {what}; export them with their colours, which the splats begin with",
            points.len()
        ),
    ))
}
