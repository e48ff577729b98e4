//! Colours of the reconstruction's points as photos show them, in linear light.
//!
//! A point lies where there is texture, and from afar a pixel shows more of what is around it:
//! colours of pixels would fade with distance in the clearest air. So a point's colour is the mean
//! over a window that is as large in the scene in all of its photos.

use crate::photos::{Photo, Photos};
use crate::priors::points::inside;
use rayon::prelude::*;
use std::sync::LazyLock;
use wm_base::color::srgb_decode;
use wm_capture::Capture;

/// A point as a photo shows it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Sighting {
    /// Index of the photo among those in use.
    pub(crate) photo: u32,
    /// Length of the ray, scene units.
    pub(crate) distance: f32,
    /// Mean colour of the window about the point, linear.
    pub(crate) light: [f32; 3],
}

/// All sightings of one point.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct PointTrack {
    /// Index of the point.
    pub(crate) point: u32,
    /// The sightings, in the order of photos.
    pub(crate) sightings: Vec<Sighting>,
}

/// Half the side of a point's window in the photo that shows it smallest, px: larger windows show
/// surfaces at several distances.
const MIN_HALF_WINDOW_PX: f64 = 1.0;
/// Largest half side of a window, px: points seen from nearer are left out.
const MAX_HALF_WINDOW_PX: f64 = 16.0;
/// Longest side of the photos in which colours are read, px.
const MAX_SIDE_PX: u32 = 1600;
/// Range of display-referred means, 0-1, that are neither crushed nor clipped.
const MIN_EXPOSED: f32 = 0.012;
const MAX_EXPOSED: f32 = 0.96;

/// The linear value of each byte.
static LINEAR_LIGHT: LazyLock<[f32; 256]> =
    LazyLock::new(|| std::array::from_fn(|byte| srgb_decode(byte as f64 / 255.0) as f32));

/// Returns the tracks of the points that at least two of the photos `places` show, by the
/// observations of the capture.
pub(crate) fn tracks(capture: &Capture, photos: &Photos, places: &[usize]) -> Vec<PointTrack> {
    let levels: Vec<u8> = places.iter().map(|place| photos.level_within(*place, MAX_SIDE_PX)).collect();
    let seen: Vec<Vec<(u32, PlacedPoint)>> = places
        .par_iter()
        .zip(&levels)
        .map(|(place, level)| {
            let camera = photos.camera(*place, *level);
            let placed = |point: u32| {
                let (x, y, z) = inside(capture, &camera, point)?;
                let across = ((x - camera.cx) / camera.fx).hypot((y - camera.cy) / camera.fy);
                let scale = (camera.fx * camera.fy).sqrt() / z;
                Some((point, PlacedPoint { at: [x, y], scale, distance: z * across.hypot(1.0) }))
            };
            let observed = &capture.observations[photos.view(*place)];
            observed.iter().filter_map(|seen| placed(seen.point)).collect()
        })
        .collect();
    // Pixels per unit of length in the photo that shows the point smallest, and the number of
    // photos.
    let mut least = vec![(f64::INFINITY, 0u32); capture.points.len()];
    for (point, placed) in seen.iter().flatten() {
        let (scale, count) = &mut least[*point as usize];
        (*scale, *count) = (scale.min(placed.scale), *count + 1);
    }
    let shown: Vec<Vec<(u32, Sighting)>> = places
        .par_iter()
        .zip(&levels)
        .zip(&seen)
        .enumerate()
        .map(|(index, ((place, level), seen))| {
            // Damaged photos are reported by the training when it reads them.
            let Ok(photo) = photos.get(*place, *level) else { return Vec::new() };
            let sums = LightSums::new(&photo);
            let sighting = |point: u32, placed: &PlacedPoint| {
                let (scale, count) = least[point as usize];
                let half = MIN_HALF_WINDOW_PX * placed.scale / scale;
                let light = (count > 1 && half < MAX_HALF_WINDOW_PX)
                    .then(|| sums.mean(placed.at[0], placed.at[1], half))
                    .flatten()?;
                Some((point, Sighting { photo: index as u32, distance: placed.distance as f32, light }))
            };
            seen.iter().filter_map(|(point, placed)| sighting(*point, placed)).collect()
        })
        .collect();
    let mut tracks = vec![PointTrack::default(); capture.points.len()];
    for (point, sighting) in shown.into_iter().flatten() {
        tracks[point as usize].point = point;
        tracks[point as usize].sightings.push(sighting);
    }
    tracks.retain(|track| track.sightings.len() > 1);
    tracks
}

/// A point projected into a photo.
struct PlacedPoint {
    at: [f64; 2],
    /// Pixels per unit of length at the point.
    scale: f64,
    distance: f64,
}

/// A summed-area table of linear light.
struct LightSums {
    width: usize,
    height: usize,
    /// `[H + 1, W + 1]`: red, green, blue, and the number of unmasked pixels.
    sums: Vec<[f64; 4]>,
}

impl LightSums {
    fn new(photo: &Photo) -> Self {
        let (width, height) = (photo.width as usize, photo.height as usize);
        let mut sums = vec![[0.0; 4]; (width + 1) * (height + 1)];
        for row in 0..height {
            let mut own = [0.0; 4];
            for column in 0..width {
                let at = row * width + column;
                let rgb = &photo.rgb[3 * at..3 * at + 3];
                let counts = photo.mask.as_ref().is_none_or(|mask| mask[at] > 127);
                if counts {
                    (0..3).for_each(|c| own[c] += f64::from(LINEAR_LIGHT[rgb[c] as usize]));
                    own[3] += 1.0;
                }
                let above = sums[row * (width + 1) + column + 1];
                sums[(row + 1) * (width + 1) + column + 1] = std::array::from_fn(|k| above[k] + own[k]);
            }
        }
        Self { width, height, sums }
    }

    /// Returns the mean over the window about a point; `None` if the window is not inside the
    /// photo, is masked, crushed or clipped.
    fn mean(&self, x: f64, y: f64, half: f64) -> Option<[f32; 3]> {
        let (left, right) = ((x - half).round(), (x + half).round());
        let (top, bottom) = ((y - half).round(), (y + half).round());
        let is_inside =
            left >= 0.0 && top >= 0.0 && right <= self.width as f64 && bottom <= self.height as f64;
        if !is_inside {
            return None;
        }
        let at = |column: f64, row: f64| self.sums[row as usize * (self.width + 1) + column as usize];
        let [a, b, c, d] = [at(right, bottom), at(left, bottom), at(right, top), at(left, top)];
        let sum: [f64; 4] = std::array::from_fn(|k| a[k] - b[k] - c[k] + d[k]);
        let pixels = (right - left) * (bottom - top);
        if sum[3] < 0.99 * pixels {
            return None;
        }
        let light = [0, 1, 2].map(|k| (sum[k] / sum[3]) as f32);
        let (low, high) =
            (srgb_decode(f64::from(MIN_EXPOSED)) as f32, srgb_decode(f64::from(MAX_EXPOSED)) as f32);
        light.iter().all(|v| (low..high).contains(v)).then_some(light)
    }
}
