//! Checks the planes of one photo against those of others.

use super::matching::{StereoSource, inverse_depth};
use super::sweep::{PlaneMap, Reference};
use crate::photo_warp::PhotoWarp;
use crate::pieces::pieces;

/// Largest cost of a plane that is checked.
const MAX_AGREED_COST: f32 = 0.7;
/// Largest distance from its start of a point that was projected to another photo and back, px.
const MAX_RETURN_PX: f32 = 1.5;
/// The largest relative difference between the distances in two photos.
const DEPTH_TOLERANCE: f32 = 0.02;
/// Fewest photos that must agree, if there are so many.
const MIN_AGREEING_PHOTOS: usize = 2;
/// Fewest pixels of a connected piece: outliers agree by chance.
const MIN_PIECE_PX: usize = 30;
/// Largest relative difference of depth between neighbouring pixels of one piece.
const PIECE_TOLERANCE: f32 = 0.05;

/// A source photo, its planes, and the warp back.
pub(crate) struct OtherPhoto<'a> {
    /// The warp into the other photo.
    pub(crate) there: &'a StereoSource<'a>,
    /// The planes of the other photo.
    pub(crate) planes: &'a PlaneMap,
    /// The warp back into the first photo.
    pub(crate) back: PhotoWarp,
    /// Third row of the rotation and translation there: view z of a point is
    /// `z (row . ray) + shift`.
    pub(crate) depth: ([f32; 3], f32),
}

/// Returns the inverse depth of each pixel, `[H, W]`; NaN where too few others agree.
pub(crate) fn agreed(reference: &Reference<'_>, found: &PlaneMap, others: &[OtherPhoto<'_>]) -> Vec<f32> {
    let (width, height) = (reference.picture.width, reference.picture.height);
    let wanted = MIN_AGREEING_PHOTOS.min(others.len());
    let mut inverse = vec![f32::NAN; width * height];
    for (pixel, out) in inverse.iter_mut().enumerate() {
        let (x, y) = ((pixel % width) as f32 + 0.5, (pixel / width) as f32 + 0.5);
        let at = inverse_depth(&found.planes[pixel], x, y);
        let is_told = found.costs[pixel] < MAX_AGREED_COST && at > 0.0;
        if is_told && others.iter().filter(|other| other.agrees(reference, x, y, at)).count() >= wanted {
            *out = at;
        }
    }
    remove_small(&mut inverse, width, MIN_PIECE_PX.max(width * height / 1500));
    inverse
}

impl OtherPhoto<'_> {
    fn agrees(&self, reference: &Reference<'_>, x: f32, y: f32, inverse: f32) -> bool {
        let Some((u, v, _)) = self.there.warp.point(x, y, inverse) else { return false };
        let picture = self.there.picture;
        if !(u >= 0.0 && v >= 0.0 && u < picture.width as f32 && v < picture.height as f32) {
            return false;
        }
        let theirs = inverse_depth(&self.planes.planes[v as usize * picture.width + u as usize], u, v);
        // The view z of the same point in the other photo, by both photos.
        let [fx, fy, cx, cy] = reference.intrinsics;
        let ray = [(x - cx) / fx, (y - cy) / fy, 1.0];
        let (row, shift) = self.depth;
        let z = (row[0] * ray[0] + row[1] * ray[1] + row[2] * ray[2]) / inverse + shift;
        if !(theirs > 0.0 && (theirs * z - 1.0).abs() < DEPTH_TOLERANCE) {
            return false;
        }
        self.back.point(u, v, theirs).is_some_and(|(bx, by, _)| (bx - x).hypot(by - y) < MAX_RETURN_PX)
    }
}

/// Makes pieces of fewer than `least` pixels unknown.
pub(crate) fn remove_small(inverse: &mut [f32], width: usize, least: usize) {
    let is_known = inverse.iter().map(|inverse| !inverse.is_nan()).collect();
    let joins = |pixel: usize, near: usize| (inverse[near] / inverse[pixel] - 1.0).abs() < PIECE_TOLERANCE;
    for piece in pieces(is_known, width, joins) {
        if piece.len() < least {
            piece.iter().for_each(|pixel| inverse[*pixel] = f32::NAN);
        }
    }
}
