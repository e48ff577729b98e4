//! Photos that would spoil a reconstruction: blurred ones, and those that are white or black over
//! much of the picture.
//!
//! Photos show different things, so they are not compared as wholes: about each point of the
//! reconstruction the detail of a photo (its gradients, relative to the brightness) is compared
//! with that of the other photos that show the point from a similar distance. A photo is blurred if
//! most of its points have less than half of the detail that the others show.

use crate::photos::{Photo, Photos};
use crate::priors::points::{inside, seen_points};
use rayon::prelude::*;
use wm_base::statistics;
use wm_capture::Capture;

/// Longest side of the photos in which detail is read, and of those whose white and black pixels
/// are counted, px.
const MAX_SIDES_PX: [u32; 2] = [800, 200];
/// Half the side of the patch about a point, px.
const HALF_PATCH_PX: usize = 3;
/// Least detail that other photos must show around a point: blur is invisible on smooth surfaces.
const MIN_DETAIL: f64 = 0.02;
/// Largest ratio of distances, in focal lengths, at which photos are compared: near objects have
/// wider edges.
const MAX_DISTANCE_RATIO: f64 = 1.35;
/// Fewest points by which a photo is judged.
const MIN_POINTS: usize = 30;
/// Largest detail of a blurred photo relative to the others', and the least number of deviations
/// below the other photos.
const MAX_BLURRED_DETAIL: f64 = 0.5;
const MIN_DEVIATIONS: f64 = 4.0;
/// Levels above and below which all channels of white and black pixels are.
const WHITE_LEVEL: u8 = 250;
const BLACK_LEVEL: u8 = 5;
/// Largest excess of the share of such pixels over the median of the photos.
const MAX_CLIPPED_SHARE: f64 = 0.35;

/// Largest share of the photos that is left out of a training.
pub(crate) const MAX_LEFT_OUT_SHARE: f64 = 0.25;

/// The treatment of poor photos.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PoorPhotoMode {
    /// They are found and left out of the training, as long as they are at most a quarter of the
    /// photos.
    #[default]
    Auto,
    /// All photos are trained on.
    Keep,
}

/// The defect of a poor photo.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PhotoDefect {
    /// Blurred.
    Blurred(f64),
    /// White over much of the picture.
    White {
        /// Share of the pixels.
        share: f64,
        /// The median over the photos.
        usual: f64,
    },
    /// Black over much of the picture.
    Black {
        /// Share of the pixels.
        share: f64,
        /// The median over the photos.
        usual: f64,
    },
}

impl std::fmt::Display for PhotoDefect {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let percent = |share: f64| (100.0 * share).round();
        match self {
            Self::Blurred(detail) => {
                write!(f, "blurred, with {} % of the detail that other photos show", percent(*detail))
            }
            Self::White { share, usual } => {
                write!(f, "white in {} % of its pixels, {} % are usual", percent(*share), percent(*usual))
            }
            Self::Black { share, usual } => {
                write!(f, "black in {} % of its pixels, {} % are usual", percent(*share), percent(*usual))
            }
        }
    }
}

/// The detail of a point in a photo.
#[derive(Clone, Copy, Debug)]
struct PointDetail {
    point: u32,
    /// Logarithm of the distance in focal lengths.
    distance: f64,
    /// Logarithm of the detail.
    detail: f64,
}

/// Returns the poor photos among `places` (indices in `photos`) with their defects, in that order.
/// Damaged photos are not judged.
pub(crate) fn poor_photos(capture: &Capture, photos: &Photos, places: &[usize]) -> Vec<(usize, PhotoDefect)> {
    let seen = seen_points(capture, photos, places);
    let of = |place: usize, seen: &[u32]| {
        let get = |side: u32| photos.get(place, photos.level_within(place, side)).ok();
        let shown = get(MAX_SIDES_PX[0]).map_or(Vec::new(), |photo| shown_points(capture, &photo, seen));
        (shown, get(MAX_SIDES_PX[1]).map_or([0.0; 2], |photo| clipped(&photo)))
    };
    let (shown, clipped): (Vec<Vec<PointDetail>>, Vec<[f64; 2]>) =
        places.par_iter().zip(&seen).map(|(place, seen)| of(*place, seen)).unzip();
    let usual = [0, 1].map(|k| median(clipped.iter().map(|shares| shares[k]).collect()).unwrap_or(0.0));
    let details = details(&shown, capture.points.len());
    let defect = |index: usize| {
        let [white, black] = clipped[index];
        if white > usual[0] + MAX_CLIPPED_SHARE {
            Some(PhotoDefect::White { share: white, usual: usual[0] })
        } else if black > usual[1] + MAX_CLIPPED_SHARE {
            Some(PhotoDefect::Black { share: black, usual: usual[1] })
        } else {
            details[index].map(PhotoDefect::Blurred)
        }
    };
    places.iter().enumerate().filter_map(|(index, place)| Some((*place, defect(index)?))).collect()
}

/// Returns the detail of the blurred photos relative to the others', `None` for those that are not
/// blurred.
fn details(shown: &[Vec<PointDetail>], points: usize) -> Vec<Option<f64>> {
    let mut by_point: Vec<Vec<(usize, PointDetail)>> = vec![Vec::new(); points];
    for (photo, shown) in shown.iter().enumerate() {
        shown.iter().for_each(|it| by_point[it.point as usize].push((photo, *it)));
    }
    let mut offs: Vec<Vec<f64>> = vec![Vec::new(); shown.len()];
    for all in &by_point {
        for (photo, it) in all {
            let is_like = |other: &&(usize, PointDetail)| {
                other.0 != *photo && (other.1.distance - it.distance).abs() < MAX_DISTANCE_RATIO.ln()
            };
            let usual = median(all.iter().filter(is_like).map(|(_, other)| other.detail).collect());
            if let Some(usual) = usual.filter(|usual| *usual > MIN_DETAIL.ln()) {
                offs[*photo].push(it.detail - usual);
            }
        }
    }
    let medians: Vec<Option<f64>> =
        offs.into_iter().map(|offs| if offs.len() < MIN_POINTS { None } else { median(offs) }).collect();
    let known = || medians.iter().flatten().copied();
    let middle = median(known().collect()).unwrap_or(0.0);
    let deviation = 1.4826 * median(known().map(|off| (off - middle).abs()).collect()).unwrap_or(0.0);
    let is_blurred = |off: &f64| *off - middle < MAX_BLURRED_DETAIL.ln().min(-MIN_DEVIATIONS * deviation);
    medians.into_iter().map(|off| off.filter(is_blurred).map(|off| (off - middle).exp())).collect()
}

/// Returns the points `seen` that a photo shows away from its edges.
fn shown_points(capture: &Capture, photo: &Photo, seen: &[u32]) -> Vec<PointDetail> {
    let (width, height) = (photo.width as usize, photo.height as usize);
    let luminance = |x: usize, y: usize| {
        let [r, g, b] = [0, 1, 2].map(|c| f64::from(photo.rgb[3 * (y * width + x) + c]));
        0.25 * r + 0.5 * g + 0.25 * b
    };
    let shown = |point: &u32| {
        let (x, y, z) = inside(capture, &photo.camera, *point)?;
        let (x, y) = (x as usize, y as usize);
        if x <= HALF_PATCH_PX
            || y <= HALF_PATCH_PX
            || x + HALF_PATCH_PX + 1 >= width
            || y + HALF_PATCH_PX + 1 >= height
        {
            return None;
        }
        let (mut squares, mut sum) = (0.0, 0.0);
        for row in y - HALF_PATCH_PX..=y + HALF_PATCH_PX {
            for column in x - HALF_PATCH_PX..=x + HALF_PATCH_PX {
                let across = luminance(column + 1, row) - luminance(column - 1, row);
                let down = luminance(column, row + 1) - luminance(column, row - 1);
                squares += 0.25 * (across * across + down * down);
                sum += luminance(column, row);
            }
        }
        let patch = ((2 * HALF_PATCH_PX + 1) * (2 * HALF_PATCH_PX + 1)) as f64;
        // Detail below half a step of 8 bits is quantisation.
        let detail = ((squares / patch).sqrt().max(0.5) / (sum / patch).max(1.0)).ln();
        Some(PointDetail { point: *point, distance: (z / photo.camera.fx).ln(), detail })
    };
    seen.iter().filter_map(shown).collect()
}

/// Returns the shares of white and of black pixels.
fn clipped(photo: &Photo) -> [f64; 2] {
    let pixels = photo.rgb.as_chunks::<3>().0;
    let share = |is: fn(&u8) -> bool| {
        pixels.iter().filter(|rgb| rgb.iter().all(is)).count() as f64 / pixels.len().max(1) as f64
    };
    [share(|v| *v >= WHITE_LEVEL), share(|v| *v <= BLACK_LEVEL)]
}

fn median(mut values: Vec<f64>) -> Option<f64> {
    statistics::median(&mut values)
}

#[cfg(test)]
mod tests {
    use super::*;
    use wm_base::random::uniform;

    /// Photos along a way that show their neighbours' points, with noise, from changing distances.
    fn walk(blurred: &[usize]) -> Vec<Vec<PointDetail>> {
        let (photos, points) = (20usize, 1000usize);
        let photo = |p: usize| {
            let distance = 0.2 * (p as f64).sin();
            let shown = |i: usize| {
                let noise = 0.6 * (uniform(p as u64, i as u64) - 0.5);
                let blur: f64 = if blurred.contains(&p) { 0.35 } else { 1.0 };
                let detail = -2.5 + uniform(99, i as u64) + distance + noise + blur.ln();
                PointDetail { point: i as u32, distance, detail }
            };
            (0..points).filter(|i| (i * photos / points).abs_diff(p) <= 2).map(shown).collect()
        };
        (0..photos).map(photo).collect()
    }

    #[test]
    fn blurred_photos_are_found_and_sharp_ones_are_not() {
        assert!(details(&walk(&[]), 1000).iter().all(Option::is_none));
        let found = details(&walk(&[3, 4, 12]), 1000);
        let which: Vec<usize> = (0..20).filter(|p| found[*p].is_some()).collect();
        assert_eq!(which, [3, 4, 12]);
        let detail = found[12].unwrap();
        assert!((detail - 0.35).abs() < 0.1, "{detail}");
        // All alike are not poor beside each other.
        assert!(details(&walk(&(0..20).collect::<Vec<_>>()), 1000).iter().all(Option::is_none));
    }

    #[test]
    fn near_views_are_not_blurred() {
        let mut shown = walk(&[]);
        for it in &mut shown[7] {
            (it.distance, it.detail) = (it.distance - 1.0, it.detail - 1.0);
        }
        assert!(details(&shown, 1000).iter().all(Option::is_none));
    }
}
